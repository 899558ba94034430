//! `pose.pin`: holds joints or vertices of a figure in place over ranges of frames, and keeps it above the ground.
//!
//! **Method** `shift` moves the whole figure, as the paper does: by what brings each point to its place while it is pinned, and smoothly from pin to pin
//! ([`crate::algo::pins`]). `two_bone` leaves the figure where it is and bends the limb: the two joints above a pinned joint are turned so that it comes to
//! its place, in the plane in which the limb is bent, and the pinned joint keeps its own direction. At last the figure is lifted wherever it is below the
//! ground. Feet that stand are found where they are slow and low ([`crate::algo::contacts`]), in this motion or the captured one.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 (global translations as constraints); Fritsch and Carlson 1980 (slopes).
//!
//! **Fails when** a pin names frames, a joint or a vertex that there is not. Where pins overlap, or are further than a limb reaches, `error` says what is
//! left.
//!
//! **Cost** O(frames · (joints + pins)), with a mesh O(frames · vertices · influences).
//!
//! ```ron
//! "stood": (type: "pose.pin", skeleton: "@otter.skeleton", pose: "@otter.pose", pins: [(frames: (8, 14), joint: "foot.L")], ground: 0.0),
//! ```

use nalgebra::{Matrix4, UnitQuaternion, Vector3};
use pegbar_engine::node::{Context, In, NodeError, Problem, Sequence, Stream, Whole};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Setting};

use super::{Pin, Pins};
use crate::algo::contacts::{Contact, contacts};
use crate::algo::pins::{Pinned, lifts, miss, shifts, two_bone};
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::algo::skin::Skin;
use crate::data::{Pose, Skeleton, SkinnedMesh};

/// What gives way to a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Method {
    /// The whole figure is shifted.
    Shift,
    /// The limb of two bones above the pinned joint is bent.
    TwoBone,
}

/// Frames over which a bent limb comes and goes where nothing else is said.
const LIMB_BLEND: f64 = 4.0;

/// Holds joints or vertices of a figure in place over ranges of frames, and keeps it above the ground.
#[derive(Node)]
#[node(
    id = "pose.pin",
    version = 1,
    kind = whole,
    outputs = PosePinOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4",
    example = "\"stood\": (type: \"pose.pin\", skeleton: \"@otter.skeleton\", pose: \"@otter.pose\", pins: [(frames: (8, 14), joint: \"foot.L\")])"
)]
pub(crate) struct PosePin {
    /// The figure's joints.
    pub(super) skeleton: In<Skeleton>,
    /// What they do.
    pub(super) pose: Sequence<Pose>,
    /// The surface that they move: pins may then name its vertices, and none of it goes below the ground. The joints themselves do not where it is left out.
    pub(super) mesh: Option<In<SkinnedMesh>>,
    /// What stands where: `frames` from first to last; `joint` by name, or `vertex` from 0; `at`, its place in metres, where it is left out the one that it has
    /// at the first of the frames.
    #[input(default = [])]
    pub(super) pins: Pins,
    /// Joints that are pinned besides wherever they stand: where they are slow and low, each time where they touch down.
    #[input(default = [])]
    pub(super) contacts: Vec<String>,
    /// The motion in which stands are found: the captured one. This one where it is left out.
    pub(super) contact_pose: Option<Sequence<Pose>>,
    /// What is faster does not stand.
    #[input(default = 0.2, range = 0.0..=1000000.0, unit = "m/s")]
    pub(super) contact_speed: f64,
    /// What is higher above its lowest place does not stand.
    #[input(default = 0.05, range = 0.0..=1000000.0, unit = "m")]
    pub(super) contact_height: f64,
    /// What is shorter is no stand.
    #[input(default = 2, range = 1..=1000000, unit = "frames")]
    pub(super) contact_frames: u32,
    /// What gives way.
    #[input(default = shift)]
    pub(super) method: Method,
    /// Height that the figure does not go below at any frame. None where it is left out.
    #[input(default = None, range = -1000000.0..=1000000.0, unit = "m")]
    pub(super) ground: Option<f64>,
    /// Frames on either side over which a lift above the ground comes and goes. 0 lifts only where it must.
    #[input(default = 0, range = 0..=10000, unit = "frames")]
    pub(super) soften: u32,
    /// Frames over which a pin comes before the first and goes after the last. Left out, a shift is held, and a limb takes 4; 0 lets go at once.
    #[input(default = None, range = 0.0..=1000000.0, unit = "frames")]
    pub(super) blend: Option<f64>,
}

/// The figure, and how well the pins hold.
#[derive(Outputs)]
pub(crate) struct PosePinOutputs {
    /// Its pose.
    pub(super) pose: Stream<Pose>,
    /// How far the worst pinned point is from its place, metres: more than nothing where pins overlap, are out of reach, or lie below the ground.
    pub(super) error: Stream<Curve>,
}

/// A figure frame by frame.
struct Figure<'a> {
    skeleton: &'a Skeleton,
    skin: Option<(Skin, Vec<Matrix4<f64>>)>,
    frames: Vec<Vec<Joint>>,
}

impl Figure<'_> {
    fn world(&self, k: usize) -> Result<Vec<Matrix4<f64>>, NodeError> {
        let local: Vec<_> = self.frames[k].iter().map(Joint::matrix).collect();
        world_from_joint(&self.skeleton.parents, &local).map_err(|e| NodeError::input(format!("skeleton: {e}")))
    }

    /// Every point that may be pinned or touch the ground: vertices where there is a surface.
    fn vertices(&self, world: &[Matrix4<f64>]) -> Result<Vec<[f64; 3]>, NodeError> {
        let Some((skin, inverse_bind)) = &self.skin else { return Ok(Vec::new()) };
        let motions: Vec<_> = world.iter().zip(inverse_bind).map(|(w, b)| w * b).collect();
        Ok(skin.pose(&motions, false).map_err(|e| NodeError::input(format!("pose: {e}")))?.0)
    }

    /// Where a pin's point is at a frame.
    fn point(&self, pin: &Pin, k: usize) -> Result<Vector3<f64>, NodeError> {
        let world = self.world(k)?;
        match (&pin.joint, pin.vertex) {
            (Some(name), _) => Ok(place(&world[self.joint(name)?])),
            (None, Some(vertex)) => {
                let vertices = self.vertices(&world)?;
                let message = || match self.skin {
                    Some(_) => format!("pins: expected a vertex below {}, found {vertex}", vertices.len()),
                    None => "pins: expected `mesh` where a vertex is pinned, found none".to_owned(),
                };
                vertices.get(vertex).copied().map(Vector3::from).ok_or_else(|| NodeError::input(message()))
            }
            (None, None) => Err(NodeError::input("pins: expected a joint or a vertex, found neither")),
        }
    }

    fn joint(&self, name: &str) -> Result<usize, NodeError> {
        self.skeleton.find(name).ok_or_else(|| {
            let names = self.skeleton.names.iter().take(40).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
            NodeError::input(format!("pins: expected a joint of the skeleton, found {name:?}")).help(format!("the joints are {names}"))
        })
    }

    /// Height of the lowest point.
    fn lowest(&self, k: usize) -> Result<f64, NodeError> {
        let world = self.world(k)?;
        let heights: Vec<f64> = match self.skin {
            Some(_) => self.vertices(&world)?.iter().map(|p| p[1]).collect(),
            None => world.iter().map(|m| place(m).y).collect(),
        };
        Ok(heights.into_iter().fold(f64::INFINITY, f64::min))
    }

    fn shift(&mut self, k: usize, by: Vector3<f64>) {
        for (joint, _) in self.frames[k].iter_mut().zip(&self.skeleton.parents).filter(|(_, p)| **p == -1) {
            joint.translation += by;
        }
    }

    /// Bends the limb above a joint so that it comes to a place.
    fn bend(&mut self, k: usize, joint: usize, to: Vector3<f64>) -> Result<(), NodeError> {
        let above = |j: usize| usize::try_from(self.skeleton.parents[j]).ok();
        let (Some(knee), Some(hip)) = (above(joint), above(joint).and_then(above)) else {
            let name = self.skeleton.names.get(joint).cloned().unwrap_or_default();
            let error = NodeError::input(format!("pins: expected a joint with two above it for `two_bone`, found {name:?}"));
            return Err(error.help("`method: shift` moves the whole figure"));
        };
        let world = self.world(k)?;
        let rotations = self.rotations(k)?;
        // The axis in which the limb is bent at rest, should it be straight now; else as a knee bends that goes forwards, to +z.
        let rest: Vec<_> = world_from_joint(&self.skeleton.parents, &self.skeleton.rest()).map_err(|e| NodeError::input(e.to_string()))?;
        let [a, b, c] = [hip, knee, joint].map(|j| place(&rest[j]));
        let at_rest = (c - a).cross(&(b - a));
        let bend = if at_rest.norm() > 1e-6 * (c - a).norm() * (b - a).norm() { at_rest } else { (c - a).cross(&Vector3::z()) };
        let Some((swing, fold)) = two_bone([hip, knee, joint].map(|j| place(&world[j])), to, bend) else { return Ok(()) };
        let parent = above(hip).map_or_else(UnitQuaternion::identity, |p| rotations[p]);
        let (hip_now, knee_now) = (swing * rotations[hip], swing * fold * rotations[knee]);
        let joints = &mut self.frames[k];
        joints[hip].rotation = parent.inverse() * hip_now;
        joints[knee].rotation = hip_now.inverse() * knee_now;
        joints[joint].rotation = knee_now.inverse() * rotations[joint];
        Ok(())
    }

    /// How each joint is turned in the world.
    fn rotations(&self, k: usize) -> Result<Vec<UnitQuaternion<f64>>, NodeError> {
        let own = &self.frames[k];
        let mut world: Vec<_> = own.iter().map(|j| j.rotation).collect();
        for j in crate::algo::skeleton::order(&self.skeleton.parents).map_err(|e| NodeError::input(e.to_string()))? {
            if let Ok(parent) = usize::try_from(self.skeleton.parents[j]) {
                world[j] = world[parent] * own[j].rotation;
            }
        }
        Ok(world)
    }
}

fn place(world: &Matrix4<f64>) -> Vector3<f64> {
    world.fixed_view::<3, 1>(0, 3).into_owned()
}

impl PosePin {
    fn figure(&self, cx: &Context, pose: &Sequence<Pose>, name: &str) -> Result<Figure<'_>, NodeError> {
        let n = self.skeleton.n_joints();
        let first = pose.clock().unwrap_or(cx.clock).first;
        let frame = |k: usize| {
            let refused = |e: String| NodeError::input(format!("{name} at frame {}: {e}", first + k as i64));
            let joints = pose.get(k)?.joints().map_err(refused)?;
            if joints.len() == n {
                Ok(joints)
            } else {
                Err(refused(format!("expected {n} joints as in the skeleton, found {}", joints.len())))
            }
        };
        let skin = self.mesh.as_deref().map(|mesh| {
            let influences = mesh.joints.shape()[1];
            if mesh.n_joints() != n {
                return Err(NodeError::input(format!("mesh: expected {n} joints as in the skeleton, found {}", mesh.n_joints())));
            }
            let skin = Skin::new(&mesh.positions, &[], influences, mesh.joints.data(), mesh.weights.data(), n);
            Ok((skin.map_err(|e| NodeError::input(format!("mesh: {e}")))?, mesh.inverse_bind()))
        });
        // One pose stands for every frame of the clock.
        let mut frames = (0..pose.len()).map(frame).collect::<Result<Vec<_>, _>>()?;
        while let (true, Some(last)) = (frames.len() < cx.clock.len(), frames.last()) {
            frames.push(last.clone());
        }
        Ok(Figure { skeleton: &self.skeleton, skin: skin.transpose()?, frames })
    }

    /// A pin for each stand of the joints that are looked at.
    fn stands(&self, cx: &Context) -> Result<Vec<Pin>, NodeError> {
        let figure = match &self.contact_pose {
            _ if self.contacts.is_empty() => return Ok(Vec::new()),
            Some(pose) => self.figure(cx, pose, "contact_pose")?,
            None => self.figure(cx, &self.pose, "pose")?,
        };
        let contact = Contact { speed: self.contact_speed, height: self.contact_height, least: self.contact_frames as usize };
        let (first, rate) = (cx.clock.first, cx.clock.rate());
        let mut pins = Vec::new();
        for name in &self.contacts {
            let pin = |frames: [i64; 2]| Pin { frames, joint: Some(name.clone()), vertex: None, at: None };
            let path = (0..figure.frames.len()).map(|k| figure.point(&pin([first; 2]), k)).collect::<Result<Vec<_>, _>>()?;
            let frame = |k: usize| first + k as i64;
            pins.extend(contacts(&path, rate, contact).into_iter().map(|(a, b)| pin([frame(a), frame(b)])));
        }
        Ok(pins)
    }

    /// Bends limbs: the pins of each joint by themselves.
    fn bend(&self, figure: &mut Figure, pins: &[Pinned]) -> Result<(), NodeError> {
        let blend = self.blend.or(Some(LIMB_BLEND));
        let mut done: Vec<&str> = Vec::new();
        for pin in &self.pins.0 {
            let name = pin.joint.as_deref().ok_or_else(|| NodeError::input("pins: expected joints for `two_bone`, found a vertex"))?;
            if done.contains(&name) {
                continue;
            }
            done.push(name);
            let joint = figure.joint(name)?;
            let own: Vec<&Pinned> =
                self.pins.0.iter().zip(pins).filter(|(p, _)| p.joint.as_deref() == Some(name)).map(|(_, p)| p).collect();
            for (k, by) in shifts(&own, figure.frames.len(), blend).into_iter().enumerate() {
                if by != Vector3::zeros() {
                    figure.bend(k, joint, own[0].path[k] + by)?;
                }
            }
        }
        Ok(())
    }
}

impl Whole for PosePin {
    fn check(&self) -> Vec<Problem> {
        self.pins.problems()
    }

    fn run(mut self, cx: &Context) -> Result<PosePinOutputs, NodeError> {
        let stands = self.stands(cx)?;
        self.pins.0.extend(stands);
        let mut figure = self.figure(cx, &self.pose, "pose")?;
        let n = figure.frames.len();
        let pins = self.pins.pinned(cx.clock, |pin| (0..n).map(|k| figure.point(pin, k)).collect())?;
        match self.method {
            Method::Shift => {
                let by = shifts(&pins.iter().collect::<Vec<_>>(), n, self.blend);
                by.into_iter().enumerate().for_each(|(k, by)| figure.shift(k, by));
            }
            Method::TwoBone => self.bend(&mut figure, &pins)?,
        }
        cx.check()?;
        if let Some(ground) = self.ground {
            let lowest = (0..n).map(|k| figure.lowest(k)).collect::<Result<Vec<_>, _>>()?;
            let up = lifts(&lowest, ground, self.soften as usize);
            up.into_iter().enumerate().for_each(|(k, up)| figure.shift(k, Vector3::y() * up));
        }
        let mut error = Vec::with_capacity(n);
        for k in 0..n {
            let now = self.pins.0.iter().zip(&pins).filter(|(_, p)| (p.first..=p.last).contains(&k));
            let now = now.map(|(pin, p)| Ok((p, figure.point(pin, k)?))).collect::<Result<Vec<_>, NodeError>>()?;
            error.push(Curve { value: miss(now.into_iter(), k) });
        }
        Ok(PosePinOutputs { pose: Stream(figure.frames.into_iter().map(|f| f.into_iter().collect()).collect()), error: Stream(error) })
    }
}
