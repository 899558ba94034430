//! `io.search_bvh`: the take of motion capture that goes best with drawings, out of many.
//!
//! **Method** every take is seen by the drawings' camera, from as many sides as are asked for, and put in time with the drawings as `retime.dtw` does it, both
//! ends open; the least distance wins. It comes out in time with the drawings, turned as it fits, and all takes' distances with it.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, sections 3.2 and 3.3; that the take is found and not given goes beyond the paper.
//!
//! **Fails when** a file is no BVH, a rig has no joint for a limb's marker, or no take can be run along with all drawings.
//!
//! **Cost** O(takes · headings · drawings · frames · limbs); one take is in memory.
//!
//! ```ron
//! "found": (type: "io.search_bvh", target: "@drawn.angles", camera: "@camera", path: ["walk.bvh", "jump.bvh", "kick.bvh"], scale: 0.0254, skip: 1, headings: 8),
//! ```

use std::path::Path;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use pegbar_engine::node::{Context, Fault, In, NodeError, Problem, Sequence, Stream, Whole};
use pegbar_engine::setting::InputPaths;
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use super::capture::{refused, skeleton, text};
use crate::algo::bvh;
use crate::algo::camera::Camera as View;
use crate::algo::dtw::{Drawings, Metric, Options, Series, Steps, dtw, source_frames};
use crate::algo::pose_descriptor::{Reference, angles};
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::algo::take::{Space, Up, sampled};
use crate::data::{Camera, Pose, Skeleton};
use crate::lift::Limbs;
use crate::markers::{Chosen, JointNames, Names, Unmatched, seen};

/// Finds the take that goes best with drawings.
#[derive(Node)]
#[node(
    id = "io.search_bvh",
    version = 1,
    kind = whole,
    outputs = IoSearchBvhOutputs,
    source = "Jain, Sheikh, Hodgins 2009, sections 3.2 and 3.3",
    example = "\"found\": (type: \"io.search_bvh\", target: \"@drawn.angles\", camera: \"@camera\", path: [\"walk.bvh\", \"jump.bvh\"], scale: 0.0254)"
)]
pub(crate) struct IoSearchBvh {
    /// The drawings' descriptors, as `pose.descriptor` makes them of `limbs`. NaN counts nothing.
    target: Sequence<Vector>,
    /// How the drawings look at the figure.
    camera: In<Camera>,
    /// The takes.
    path: InputPaths,
    /// Metres a unit of the files.
    #[input(default = 1.0, range = 0.000001..=1000000.0, unit = "m")]
    scale: f64,
    /// The axis that points up in the files.
    #[input(default = y)]
    up: Up,
    /// Frames that are left out at the start of each: 1 for a T-pose before the take.
    #[input(default = 0, range = 0..=1000000000, unit = "frames")]
    skip: u32,
    /// Frames a second at which takes are looked at. Drawings are matched to these.
    #[input(default = 30.0, range = 1.0..=1000.0)]
    fps: f64,
    /// From how many sides each take is looked at, evenly around: 1 is as it was captured.
    #[input(default = 1, range = 1..=360)]
    headings: u32,
    /// Limbs, each by the names of the markers where it begins and ends, as the target has them.
    #[input(default = [
        ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist"),
        ("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("right_hip", "right_knee"), ("right_knee", "right_ankle"),
    ])]
    limbs: Limbs,
    /// What the target's directions are measured from.
    #[input(default = absolute)]
    reference: Reference,
    /// How takes may run against drawings.
    #[input(default = asymmetric)]
    steps: Steps,
    /// Which names the rigs' joints have.
    #[input(default = auto)]
    naming: Names,
    /// Joints by the names of markers, as in `markers.from_pose`.
    #[input(default = {})]
    joints: JointNames,
}

/// The take.
#[derive(Outputs)]
pub(crate) struct IoSearchBvhOutputs {
    /// The joints of the best take's figure.
    skeleton: Skeleton,
    /// Its pose at each drawing, turned to the heading that fits.
    pose: Stream<Pose>,
    /// The file's frame at each drawing, from 0, those that are skipped counted.
    frame: Stream<Curve>,
    /// Positions of the files, from 0, the best first.
    order: Vector,
    /// Of each file, in the order of `path`: distance a drawing, radians summed over limbs; infinity where it cannot be run along with them.
    distances: Vector,
    /// Of each file: the heading that fits best, degrees anticlockwise as seen from above.
    headings_deg: Vector,
}

/// A take as it is looked at.
struct Take {
    skeleton: Skeleton,
    /// Each frame that is looked at.
    poses: Vec<Vec<Joint>>,
    /// The limbs' ends of each, in the world.
    points: Vec<Vec<[f64; 3]>>,
    /// Frames of the file from one to the next.
    step: f64,
}

/// How well a take fits from one side.
struct Fit {
    distance: f64,
    turn: f64,
    /// Frames that are looked at, one for each drawing.
    frames: Vec<f64>,
}

fn about_up(turn: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::y_axis(), turn)
}

impl IoSearchBvh {
    fn take(&self, path: &Path, cx: &Context) -> Result<Take, NodeError> {
        let file = bvh::read(&text(path)?).map_err(|e| refused(path, &e))?;
        let space = Space::new(self.up, self.scale);
        let left = file.n_frames.saturating_sub(self.skip as usize);
        if left == 0 {
            let message = format!(
                "{}: expected more than {} frames, the number that `skip` leaves out, found {}",
                path.display(),
                self.skip,
                file.n_frames
            );
            return Err(NodeError::new(Fault::Parameters, message));
        }
        let parents: Vec<i64> = file.joints.iter().map(|j| j.parent.map_or(-1, |p| p as i64)).collect();
        let names = file.joints.iter().map(|j| j.name.clone()).collect();
        let skeleton = skeleton(parents, &file.rest(), names, &space)?;
        let chosen = Chosen { skeleton: &skeleton, naming: self.naming, joints: &self.joints, missing: Unmatched::Skip }.joints()?;
        let joint = |marker: &String| {
            let at = chosen.iter().find(|(name, _)| name == marker).map(|(_, joint)| *joint);
            at.ok_or_else(|| {
                refused(path, format!("expected a joint for the marker `{marker}`, found none")).help("say which with `joints`")
            })
        };
        let ends = self.limbs.0.iter().flat_map(|(a, b)| [a, b]).map(joint).collect::<Result<Vec<usize>, _>>()?;
        // Slower takes than are asked for are looked at as they are.
        let step = (file.fps / self.fps).max(1.0);
        let count = ((left - 1) as f64 / step).floor() as usize + 1;
        let mut take = Take { skeleton, poses: Vec::with_capacity(count), points: Vec::with_capacity(count), step };
        for k in 0..count {
            cx.check()?;
            let file_pose = |i: usize| Ok::<_, NodeError>(file.pose(i + self.skip as usize, false));
            let pose: Vec<Joint> = sampled(left, k as f64 * step, file_pose)?.iter().map(|j| space.joint(j)).collect();
            let local: Vec<_> = pose.iter().map(Joint::matrix).collect();
            let world = world_from_joint(&take.skeleton.parents, &local).map_err(|e| refused(path, e))?;
            take.points.push(ends.iter().map(|&j| [world[j].m14, world[j].m24, world[j].m34]).collect());
            take.poses.push(pose);
        }
        Ok(take)
    }

    /// How well a take fits, seen as it is after it has turned by `turn` radians; `None` where it cannot be run along with the drawings.
    fn fit(&self, take: &Take, target: &Series, drawings: &Drawings, view: &View, turn: f64) -> Result<Option<Fit>, NodeError> {
        let limbs: Vec<[usize; 2]> = (0..self.limbs.0.len()).map(|k| [2 * k, 2 * k + 1]).collect();
        let rotation = about_up(turn);
        let directions = |points: &Vec<[f64; 3]>| {
            let picture: Vec<[f64; 2]> = points.iter().map(|p| seen(view, (rotation * Vector3::from(*p)).into())).collect();
            angles(&picture, &limbs, self.reference, 1e-6)
        };
        let rows: Vec<Vec<f64>> = take.points.iter().map(directions).collect();
        let rows: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
        let source = Series::new(&rows, None).map_err(|e| NodeError::input(format!("limbs: {e}")))?;
        let options = Options { steps: self.steps, open_begin: true, open_end: true, ..Options::default() };
        let Ok(found) = dtw(target, &source, Metric::Angle, &options) else { return Ok(None) };
        let frames = source_frames(&found.path, drawings, &[], 0.0);
        Ok(Some(Fit { distance: found.cost / target.len().max(1) as f64, turn, frames }))
    }

    /// The best of all headings.
    fn best(&self, take: &Take, target: &Series, drawings: &Drawings, view: &View, cx: &Context) -> Result<Option<Fit>, NodeError> {
        let mut best: Option<Fit> = None;
        for k in 0..self.headings {
            cx.check()?;
            let turn = std::f64::consts::TAU * f64::from(k) / f64::from(self.headings);
            let found = self.fit(take, target, drawings, view, turn)?;
            if let Some(fit) = found.filter(|f| best.as_ref().is_none_or(|b| f.distance < b.distance)) {
                best = Some(fit);
            }
        }
        Ok(best)
    }

    /// The poses of a take at the frames that go with the drawings, turned.
    fn poses(&self, take: &Take, fit: &Fit) -> Result<Vec<Pose>, NodeError> {
        let rotation = about_up(fit.turn);
        let turn = UnitQuaternion::from_rotation_matrix(&rotation);
        let turned = |(j, joint): (usize, Joint)| {
            let is_root = take.skeleton.parents[j] < 0;
            if is_root { Joint { translation: rotation * joint.translation, rotation: turn * joint.rotation, ..joint } } else { joint }
        };
        let pose = |at: &f64| {
            let joints = sampled(take.poses.len(), *at, |k| Ok::<_, NodeError>(take.poses[k].clone()))?;
            Ok(joints.into_iter().enumerate().map(turned).collect())
        };
        fit.frames.iter().map(pose).collect()
    }
}

impl Whole for IoSearchBvh {
    fn check(&self) -> Vec<Problem> {
        let problem = |message: &str| vec![Problem { input: "path", message: message.to_owned() }];
        match &self.path.0[..] {
            [] => problem("expected at least one file, found none"),
            paths if paths.iter().any(|p| p.is_sequence()) => problem("expected files, found a frame number as #### in a path"),
            _ => Vec::new(),
        }
    }

    fn run(self, cx: &Context) -> Result<IoSearchBvhOutputs, NodeError> {
        let view = View::try_from(&*self.camera).map_err(|e| NodeError::input(format!("camera: {e}")))?;
        let drawn = (0..self.target.len()).map(|k| self.target.get(k)).collect::<Result<Vec<_>, _>>()?;
        if let Some(odd) = drawn.iter().find(|v| v.values.len() != self.limbs.0.len()) {
            let message = format!("target: expected a direction for each of {} limbs, found {}", self.limbs.0.len(), odd.values.len());
            return Err(NodeError::input(message));
        }
        let rows: Vec<&[f64]> = drawn.iter().map(|v| v.values.as_slice()).collect();
        let target = Series::new(&rows, None).map_err(|e| NodeError::input(format!("target: {e}")))?;
        let drawings = Drawings::new(drawn.len(), |k| drawn[k] == drawn[k - 1]);
        let (mut distances, mut turns) = (Vec::new(), Vec::new());
        let mut winner: Option<(Take, Fit)> = None;
        for path in &self.path.0 {
            let take = self.take(&path.at(0), cx)?;
            let fit = self.best(&take, &target, &drawings, &view, cx)?;
            distances.push(fit.as_ref().map_or(f64::INFINITY, |f| f.distance));
            turns.push(fit.as_ref().map_or(0.0, |f| f.turn.to_degrees()));
            if let Some(fit) = fit.filter(|f| winner.as_ref().is_none_or(|(_, w)| f.distance < w.distance)) {
                winner = Some((take, fit));
            }
        }
        let Some((take, fit)) = winner else {
            let message = format!("expected a take that runs along with {} drawings, found none among {}", drawn.len(), self.path.0.len());
            return Err(NodeError::input(message).help("other `steps` let shorter takes through"));
        };
        let mut pose = self.poses(&take, &fit)?;
        let file_frame = |at: &f64| Curve { value: f64::from(self.skip) + at * take.step };
        let mut frame: Vec<Curve> = fit.frames.iter().map(file_frame).collect();
        // A single descriptor stands for every frame of the clock.
        while let (true, Some(last), Some(at)) = (pose.len() < cx.clock.len(), pose.last().cloned(), frame.last().cloned()) {
            pose.push(last);
            frame.push(at);
        }
        let mut order: Vec<usize> = (0..distances.len()).collect();
        order.sort_by(|a, b| distances[*a].total_cmp(&distances[*b]));
        Ok(IoSearchBvhOutputs {
            skeleton: take.skeleton,
            pose: Stream(pose),
            frame: Stream(frame),
            order: Vector { values: order.into_iter().map(|k| k as f64).collect() },
            distances: Vector { values: distances },
            headings_deg: Vector { values: turns },
        })
    }
}
