//! What the nodes of motion capture share: whose fault a failure is, and which of a file's frames plays when.

use std::path::Path;

use pegbar_engine::node::{Context, Fault, NodeError, Stream};
use pegbar_engine::value::Curve;

use super::file;
use super::read_gltf::End;
use crate::algo::skeleton::Joint;
use crate::algo::take::{Space, sampled};
use crate::data::{Pose, Skeleton};

/// The text of a file. Characters that are no UTF-8, as in the names of old files, are replaced.
pub(super) fn text(path: &Path) -> Result<String, NodeError> {
    Ok(String::from_utf8(file::read(path)?).unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned()))
}

/// A failure at a file.
pub(super) fn refused(path: &Path, error: impl std::fmt::Display) -> NodeError {
    NodeError::input(format!("{}: {error}", path.display()))
}

/// Which part of a take plays, and how.
pub(super) struct Playback {
    /// Frames of the file before the first that plays.
    pub skip: u32,
    /// Seconds after the first at the clock's first frame.
    pub start: f64,
    pub speed: f64,
    pub end: End,
}

/// What a reader makes of a take.
pub(super) struct Played {
    pub pose: Stream<Pose>,
    pub duration: Curve,
    pub fps: Curve,
}

/// A skeleton of joints at rest.
pub(super) fn skeleton(parents: Vec<i64>, rest: &[Joint], names: Vec<String>, space: &Space) -> Result<Skeleton, NodeError> {
    let rest: Vec<_> = rest.iter().map(|j| space.joint(j).matrix()).collect();
    Skeleton::new(parents, &rest, names).map_err(NodeError::internal)
}

impl Playback {
    /// The poses of a take in `path` of `n` frames, `fps` a second, at the frames of a clock.
    pub(super) fn play(
        &self,
        cx: &Context,
        path: &Path,
        (n, fps): (usize, f64),
        space: &Space,
        pose: impl Fn(usize) -> Vec<Joint>,
    ) -> Result<Played, NodeError> {
        let left = n.saturating_sub(self.skip as usize);
        if left == 0 {
            let message = format!("{}: expected `skip` below {n}, the number of the file's frames, found {}", path.display(), self.skip);
            return Err(NodeError::new(Fault::Parameters, message));
        }
        let last = (left - 1) as f64;
        let frame = |k: usize| {
            let seconds = self.start + self.speed * k as f64 * f64::from(cx.clock.fps.1) / f64::from(cx.clock.fps.0);
            let at = seconds * fps;
            if self.end == End::Loop && last > 0.0 { at.rem_euclid(last) } else { at }
        };
        let mut poses = Vec::new();
        for k in 0..cx.clock.len() {
            cx.check()?;
            let joints = sampled(left, frame(k), |i| Ok::<_, NodeError>(pose(i + self.skip as usize)))?;
            poses.push(joints.iter().map(|j| space.joint(j)).collect());
        }
        Ok(Played { pose: Stream(poses), duration: Curve { value: last / fps }, fps: Curve { value: fps } })
    }
}
