//! `motion.warp`: a motion that passes through poses of your own on a few frames.
//!
//! **Method** each edit says what the figure does at one frame: a whole pose, or single joints turned, moved, lengthened or scaled. It comes and goes over a
//! range of frames about its own ([`crate::algo::motion_warp`]): rotations by their logarithms, lengths and scales by theirs, so that nothing wraps and
//! nothing turns inside out. Where ranges overlap a small linear system shares out the displacements so that each edit is met at its frame; frames
//! outside of all ranges stay as they are, to the bit. An edit may also say which frame of the motion is to be shown: time is warped by the same curve.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.1; Witkin, Popović, *Motion Warping*, 1995.
//!
//! **Fails when** an edit names a frame, a joint or a pose that there is not; two edits share a frame; ranges overlap so far that no sum meets all edits; time
//! would run backwards.
//!
//! **Cost** O(frames · joints · edits).
//!
//! ```ron
//! "warp": (
//!     type: "motion.warp", skeleton: "@ant.skeleton", pose: "@ant.pose",
//!     edits: [(frame: 12, before: 6, after: 8, joints: [(joint: "leg.L", rotate_deg: (0, 0, 25), length: 1.4)])],
//! ),
//! ```

use nalgebra::Vector3;
use pegbar_engine::node::{Context, Fault, In, List, NodeError, Problem, Sequence, Stream, Whole};
use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use pegbar_engine::value::{TimeMap, Vector};
use pegbar_engine::{Node, Outputs};
use serde::Deserialize;

use crate::algo::motion_warp::{MotionWarp as Warp, Span, Spans, between};
use crate::algo::rotation::exp;
use crate::algo::skeleton::Joint;
use crate::data::{Pose, Skeleton};

/// What becomes of one joint.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Change {
    joint: String,
    #[serde(default)]
    rotate_deg: [f64; 3],
    #[serde(default)]
    translate: [f64; 3],
    #[serde(default = "one")]
    length: f64,
    #[serde(default = "ones")]
    scale: [f64; 3],
}

fn one() -> f64 {
    1.0
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

/// What the figure does at one frame.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Edit {
    frame: i64,
    #[serde(default)]
    before: Option<f64>,
    #[serde(default)]
    after: Option<f64>,
    #[serde(default)]
    pose: Option<usize>,
    #[serde(default)]
    pose_frame: Option<i64>,
    #[serde(default)]
    shows: Option<f64>,
    #[serde(default)]
    joints: Vec<Change>,
}

/// Several edits.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Edits(Vec<Edit>);

impl Setting for Edits {
    fn type_name() -> String {
        "list of edits (frame: n, before: n, after: n, pose: n, pose_frame: n, shows: n, joints: [(joint: \"name\", rotate_deg: (x, y, z), translate: (x, y, z), length: n, scale: (x, y, z))])".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        // A range or a pose is written as it is, without `Some`.
        let found: Result<Vec<Edit>, _> = parse_slice(text, Extensions::IMPLICIT_SOME);
        found.map(Self).map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
    fn numbers(&self) -> Vec<f64> {
        let changes = self.0.iter().flat_map(|e| &e.joints);
        changes.flat_map(|c| c.rotate_deg.into_iter().chain(c.translate).chain(c.scale).chain([c.length])).collect()
    }
}

/// A motion that passes through poses of your own on a few frames.
#[derive(Node)]
#[node(
    id = "motion.warp",
    version = 1,
    kind = whole,
    outputs = MotionWarpOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.1; Witkin, Popović 1995",
    example = "\"warp\": (type: \"motion.warp\", skeleton: \"@ant.skeleton\", pose: \"@ant.pose\", edits: [(frame: 12, before: 6, after: 8, joints: [(joint: \"leg.L\", rotate_deg: (0, 0, 25), length: 1.4)])])"
)]
pub(crate) struct MotionWarp {
    /// The figure's joints.
    skeleton: In<Skeleton>,
    /// What they do.
    pose: Sequence<Pose>,
    /// Poses that edits name by their numbers, from 0: single ones, or motions of which the pose at the edit's frame is taken.
    poses: List<Option<Sequence<Pose>>>,
    /// What the figure does at which `frame`, and over how many frames `before` and `after` it that comes and goes (`inf`: all along): `pose`, one of `poses`,
    /// at `pose_frame` where that is not the edit's own; then `joints` by name, each turned about its own axes by `rotate_deg` (x, then y, then z), moved in its
    /// parent's space by `translate`, its distance from its parent multiplied by `length`, and it with all below it by `scale`. `shows` is the frame of the motion
    /// that is shown at the edit's frame, fractional between frames: the timing of the drawing.
    edits: Edits,
    /// Frames before and after an edit where it does not say.
    #[input(default = 6.0, range = 0.0..=1000000.0, unit = "frames")]
    transition: f64,
    /// How much of each edit there is to be elsewhere too, in the edits' order, as `style.find` says; its timing is not taken there.
    elsewhere: Option<Sequence<Vector>>,
}

/// The motion, and how it came about.
#[derive(Outputs)]
pub(crate) struct MotionWarpOutputs {
    /// The motion.
    pose: Stream<Pose>,
    /// The frame of the motion that is shown at each frame, for what else is to keep its time: `retime.apply` takes it.
    times: TimeMap,
    /// How much of each edit there is: 1 at its own frame.
    amounts: Stream<Vector>,
}

fn refused(message: String) -> NodeError {
    NodeError::new(Fault::Parameters, message)
}

impl Edit {
    fn wrong(&self, at: usize) -> Option<String> {
        let far = |v: &Option<f64>| v.is_some_and(|v| v < 0.0 || v.is_nan());
        if far(&self.before) || far(&self.after) {
            return Some(format!("edit {at}: expected 0 or more frames before and after it, found {:?} and {:?}", self.before, self.after));
        }
        if self.shows.is_some_and(|v| !v.is_finite()) {
            return Some(format!("edit {at}: expected a frame that it shows, found {:?}", self.shows));
        }
        let wrong = |c: &&Change| {
            let numbers = c.rotate_deg.iter().chain(&c.translate).chain(&c.scale).chain([&c.length]);
            !(numbers.copied().all(f64::is_finite) && c.length > 0.0 && c.scale.iter().all(|s| *s > 0.0))
        };
        let message =
            |c: &Change| format!("edit {at}, joint {:?}: expected finite numbers, and a length and a scale above 0, found {c:?}", c.joint);
        self.joints.iter().find(wrong).map(message)
    }

    fn span(&self, transition: f64) -> Span {
        Span { frame: self.frame as f64, before: self.before.unwrap_or(transition), after: self.after.unwrap_or(transition) }
    }
}

impl Change {
    fn applied(&self, joint: &Joint) -> Joint {
        let [x, y, z] = self.rotate_deg.map(|d| d.to_radians() / 2.0);
        let turn = exp(&(Vector3::x() * x)) * exp(&(Vector3::y() * y)) * exp(&(Vector3::z() * z));
        Joint {
            translation: joint.translation * self.length + Vector3::from(self.translate),
            rotation: joint.rotation * turn,
            scale: joint.scale.component_mul(&Vector3::from(self.scale)),
        }
    }
}

/// The motion as it came.
struct Motion {
    /// Its first frame.
    first: i64,
    poses: Vec<std::sync::Arc<Pose>>,
    joints: Vec<Vec<Joint>>,
}

impl Motion {
    /// What it does at a time, held before it begins and after it ends.
    fn at(&self, time: f64) -> Vec<Joint> {
        let last = self.joints.len().saturating_sub(1);
        let t = (time - self.first as f64).clamp(0.0, last as f64);
        let (k, share) = (t as usize, t - libm::floor(t));
        if share == 0.0 {
            return self.joints[k].clone();
        }
        self.joints[k].iter().zip(&self.joints[(k + 1).min(last)]).map(|(a, b)| between(a, b, share)).collect()
    }
}

impl MotionWarp {
    /// Joints of a pose, as many as the skeleton has.
    fn joints(&self, pose: &Pose, what: &dyn Fn() -> String) -> Result<Vec<Joint>, NodeError> {
        let joints = pose.joints().map_err(|e| NodeError::input(format!("{}: {e}", what())))?;
        let n = self.skeleton.n_joints();
        let message = || format!("{}: expected {n} joints as in the skeleton, found {}", what(), joints.len());
        if joints.len() == n { Ok(joints) } else { Err(NodeError::input(message())) }
    }

    fn motion(&self, cx: &Context) -> Result<Motion, NodeError> {
        let first = self.pose.clock().unwrap_or(cx.clock).first;
        let (mut poses, mut joints) = (Vec::new(), Vec::new());
        for k in 0..self.pose.len() {
            poses.push(self.pose.get(k)?);
            joints.push(self.joints(&poses[k], &|| format!("pose at frame {}", first + k as i64))?);
        }
        // One pose stands for every frame of the clock.
        while let (true, Some(pose), Some(joint)) = (poses.len() < cx.clock.len(), poses.last(), joints.last()) {
            let (pose, joint) = (pose.clone(), joint.clone());
            poses.push(pose);
            joints.push(joint);
        }
        if poses.is_empty() {
            return Err(NodeError::input("pose: expected at least one frame, found none"));
        }
        Ok(Motion { first, poses, joints })
    }

    /// What an edit makes of the figure, `own` being what it does without.
    fn edited(&self, at: usize, edit: &Edit, own: &[Joint]) -> Result<Vec<Joint>, NodeError> {
        let mut joints = match edit.pose {
            None => own.to_vec(),
            Some(k) => {
                let n = self.poses.0.len();
                let given = self.poses.0.get(k).and_then(Option::as_ref);
                let given = given.ok_or_else(|| refused(format!("edit {at}: expected a number below {n} of one of `poses`, found {k}")))?;
                let frame = edit.pose_frame.unwrap_or(edit.frame);
                let idx = given.clock().map_or(Some(0), |c| c.index(frame));
                let idx = idx.ok_or_else(|| refused(format!("edit {at}: expected a frame of pose {k}, found {frame}")))?;
                self.joints(&*given.get(idx)?, &|| format!("poses: pose {k} at frame {frame}"))?
            }
        };
        for change in &edit.joints {
            let joint = self.skeleton.find(&change.joint).ok_or_else(|| {
                let names = self.skeleton.names.iter().take(40).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
                let error = refused(format!("edit {at}: expected a joint of the skeleton, found {:?}", change.joint));
                error.help(format!("the joints are {names}"))
            })?;
            joints[joint] = change.applied(&joints[joint]);
        }
        Ok(joints)
    }
}

impl MotionWarp {
    /// How much of each edit there is elsewhere at each of `n` frames.
    fn elsewhere(&self, n: usize) -> Result<Vec<Vec<f64>>, NodeError> {
        let Some(given) = &self.elsewhere else { return Ok(vec![Vec::new(); n]) };
        let (edits, last) = (self.edits.0.len(), given.len().saturating_sub(1));
        if given.is_empty() || (given.clock().is_some() && given.len() != n) {
            return Err(NodeError::input(format!("elsewhere: expected {n} frames as the motion has, found {}", given.len())));
        }
        let one = |k: usize| {
            let values = given.get(k.min(last))?.values.clone();
            match values.len() == edits && values.iter().all(|v| v.is_finite()) {
                true => Ok(values),
                false => Err(NodeError::input(format!("elsewhere: expected a finite number for each of {edits} edits, found {values:?}"))),
            }
        };
        (0..n).map(one).collect()
    }
}

impl Whole for MotionWarp {
    fn check(&self) -> Vec<Problem> {
        let wrong = self.edits.0.iter().enumerate().filter_map(|(at, e)| e.wrong(at));
        wrong.map(|message| Problem { input: "edits", message }).collect()
    }

    fn run(self, cx: &Context) -> Result<MotionWarpOutputs, NodeError> {
        let motion = self.motion(cx)?;
        let n = motion.poses.len();
        let edits = &self.edits.0;
        let time = |k: usize| (motion.first + k as i64) as f64;
        let last = motion.first + n as i64 - 1;
        if let Some((at, e)) = edits.iter().enumerate().find(|(_, e)| !(motion.first..=last).contains(&e.frame)) {
            return Err(refused(format!("edit {at}: expected a frame from {} to {last}, found {}", motion.first, e.frame)));
        }
        let spans = edits.iter().map(|e| e.span(self.transition)).collect();
        let spans = Spans::new(spans, true).map_err(|e| refused(format!("edits: {e}")))?;
        let shifts: Vec<f64> = edits.iter().map(|e| e.shows.map_or(0.0, |s| s - e.frame as f64)).collect();
        let shown = |t: f64| t + spans.amounts(t).iter().zip(&shifts).map(|(a, s)| a * s).sum::<f64>();
        let times: Vec<f64> = (0..n).map(|k| shown(time(k))).collect();
        if let Some(k) = times.windows(2).position(|w| w[1] < w[0]) {
            let message = format!("edits: expected time to run forwards, found frame {} shown after {}", times[k + 1], times[k]);
            return Err(refused(message).help("give the edit that `shows` it more frames before and after"));
        }
        let pairs = edits.iter().enumerate().map(|(at, e)| {
            let own = motion.at(shown(e.frame as f64));
            let edited = self.edited(at, e, &own)?;
            Ok((own, edited))
        });
        let pairs = pairs.collect::<Result<Vec<_>, NodeError>>()?;
        let warp = Warp::new(&self.skeleton.parents, spans.clone(), &pairs);
        let elsewhere = self.elsewhere(n)?;
        let (mut pose, mut amounts) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (k, &shown) in times.iter().enumerate() {
            cx.check()?;
            let values = spans.amounts_with(time(k), &elsewhere[k]);
            let is_own = shown == time(k) && values.iter().all(|a| *a == 0.0);
            pose.push(if is_own {
                (*motion.poses[k]).clone()
            } else {
                warp.warp(time(k), &elsewhere[k], &motion.at(shown)).into_iter().collect()
            });
            amounts.push(Vector { values });
        }
        Ok(MotionWarpOutputs { pose: Stream(pose), times: TimeMap { source_frames: times }, amounts: Stream(amounts) })
    }
}
