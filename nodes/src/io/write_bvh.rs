//! `io.write_bvh`: a skeleton and its motion to BVH.
//!
//! In BVH nothing is turned at rest: offsets are those between the joints as they rest in the world, and rotations count from there
//! ([`crate::algo::bvh::write`]), so that any skeleton comes out with its joints in their places. What was read from BVH comes out as it went in, with the
//! joints in the file's order. Angles do not jump from frame to frame. The file is written beside its place and renamed.
//!
//! **Source**: Meredith and Maddock, *Motion Capture File Formats Explained*, 2001. **Fails when** the pose has other joints than the skeleton, a joint
//! rests sheared, or one does more than turn with `channels: roots`. **Cost**: O(frames · joints · depth); the file is made in memory.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "walk": (type: "io.read_bvh", path: "walk.bvh", scale: 0.01),
//!     "out": (type: "io.write_bvh", skeleton: "@walk.skeleton", pose: "@walk.pose", path: "$out/walk.bvh", scale: 0.01),
//! })
//! ```

use pegbar_engine::Node;
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Context, Fault, In, NodeError, Problem, Sequence, Whole};
use pegbar_engine::setting::OutputPath;

use super::capture::refused;
use super::file;
use crate::algo::bvh::{self, Channels, Export, Order};
use crate::algo::skeleton::Joint;
use crate::data::{Pose, Skeleton};

/// Writes a skeleton and its motion: `.bvh`.
#[derive(Node)]
#[node(
    id = "io.write_bvh",
    version = 1,
    kind = whole,
    source = "Meredith, Maddock 2001",
    example = "\"out\": (type: \"io.write_bvh\", skeleton: \"@walk.skeleton\", pose: \"@walk.pose\", path: \"$out/walk.bvh\", scale: 0.01)"
)]
pub(crate) struct IoWriteBvh {
    /// The joints.
    skeleton: In<Skeleton>,
    /// What they do: a frame of the file each. The file has the rate of their clock.
    pose: Sequence<Pose>,
    /// The file, inside the output folder, ending in .bvh.
    path: OutputPath,
    /// Metres a unit of the file: 0.01 writes centimetres.
    #[input(default = 1.0, range = 0.000001..=1000000.0, unit = "m")]
    scale: f64,
    /// The order of each joint's rotations: the first is leftmost in their product.
    #[input(default = zxy)]
    order: Order,
    /// Which joints have channels for their place beside those for their rotation.
    #[input(default = auto)]
    channels: Channels,
}

impl Whole for IoWriteBvh {
    fn check(&self) -> Vec<Problem> {
        let path = self.path.at(0);
        let mut problems = Vec::new();
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("bvh")) {
            let found = path.extension().unwrap_or_default().to_string_lossy().into_owned();
            problems.push(Problem { input: "path", message: format!("expected a path ending in .bvh, found {found:?}") });
        }
        if self.path.is_sequence() {
            problems.push(Problem { input: "path", message: "expected one file, found a frame number as #### in its path".to_owned() });
        }
        problems
    }

    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let skeleton = &*self.skeleton;
        let n = skeleton.n_joints();
        let rest = |(j, m)| {
            let message = format!("skeleton: joint {j}: expected a translation, rotation and scale at rest, found another matrix");
            Joint::from_matrix(m).ok_or_else(|| NodeError::input(message))
        };
        let rest = skeleton.rest().iter().enumerate().map(rest).collect::<Result<Vec<_>, _>>()?;
        let first = self.pose.clock().map_or(0, |c| c.first);
        let mut frames = Vec::with_capacity(self.pose.len());
        for k in 0..self.pose.len() {
            cx.check()?;
            let at = |e: String| NodeError::input(format!("pose at frame {}: {e}", first + k as i64));
            let joints = self.pose.get(k)?.joints().map_err(at)?;
            if joints.len() != n {
                return Err(at(format!("expected {n} joints as in the skeleton, found {}", joints.len())));
            }
            frames.push(joints);
        }
        let numbered = || (0..n).map(|j| format!("joint_{j}")).collect();
        let names = if skeleton.names.is_empty() { numbered() } else { skeleton.names.clone() };
        let export = Export {
            parents: &skeleton.parents,
            names: &names,
            rest: &rest,
            frames: &frames,
            fps: self.pose.clock().map_or(24.0, Clock::rate),
            scale: self.scale,
            order: self.order,
            channels: self.channels,
        };
        let path = self.path.at(0);
        let text = bvh::write(&export).map_err(|e| refused(&path, e))?;
        file::write(&path, Fault::Io, |out| std::io::Write::write_all(out, text.as_bytes()))
    }
}
