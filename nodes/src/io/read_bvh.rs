//! `io.read_bvh`: motion capture from BVH.
//!
//! Any hierarchy, several roots, any channels in any order for each joint ([`crate::algo::bvh`]); an `End Site` becomes a joint `<parent>_end`, and a name
//! that stands twice gets a number. A clock with the file's rate shows the file's frames as they are; on any other each frame's pose is taken at its time,
//! turned the short way between the two frames around it, so that capture of 120 frames a second plays on film in its own time.
//!
//! BVH says nothing of its unit. Usual ones: 0.01 where numbers are centimetres (Rokoko, Mixamo, Vicon), 0.0254 for inches, 0.056444 for the takes of
//! Carnegie Mellon in the conversion by B. Hahne (cgspeed; 1 / 0.45 inches), whose first frame is a T-pose that is not part of the take: `skip: 1`.
//!
//! **Source**: Meredith and Maddock, *Motion Capture File Formats Explained*, 2001. **Fails when** the text is no BVH, a number is none, or there are
//! fewer or more frames than it declares: with line and column. **Cost**: O(bytes), and O(joints) a frame.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), clocks: { "capture": (first: 1, last: 125, fps: 30) }, nodes: {
//!     "jacks": (type: "io.read_bvh", path: "jumping_jacks.bvh", scale: 0.056444, skip: 1, clock: "capture"),
//!     "film": (type: "io.read_bvh", path: "jumping_jacks.bvh", scale: 0.056444, skip: 1),
//! }, outputs: { "pose": "@jacks.pose" })
//! ```

use pegbar_engine::node::{Context, NodeError, Problem, Stream, Whole};
use pegbar_engine::setting::{ClockName, InputPath};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Setting};

use super::capture::{Playback, refused, skeleton, text};
use super::read_gltf::End;
use crate::algo::bvh;
use crate::algo::take::{Space, Up};
use crate::data::{Pose, Skeleton};

/// What position channels say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Positions {
    /// Where a joint stands, in place of its OFFSET: as nearly all programs write.
    Absolute,
    /// How far it is from its OFFSET.
    Added,
}

/// Reads motion capture: `.bvh`.
#[derive(Node)]
#[node(
    id = "io.read_bvh",
    version = 1,
    kind = whole,
    outputs = IoReadBvhOutputs,
    source = "Meredith, Maddock 2001",
    example = "\"jacks\": (type: \"io.read_bvh\", path: \"jumping_jacks.bvh\", scale: 0.056444, skip: 1)"
)]
pub(crate) struct IoReadBvh {
    /// The file, from the graph's folder.
    path: InputPath,
    /// Metres a unit of the file: 0.01 for centimetres, 0.0254 for inches.
    #[input(default = 1.0, range = 0.000001..=1000000.0, unit = "m")]
    scale: f64,
    /// The axis that points up in the file; the figure is turned so that y does.
    #[input(default = y)]
    up: Up,
    /// Frames of the file that are left out at its start: 1 for a T-pose before the take.
    #[input(default = 0, range = 0..=1000000000, unit = "frames")]
    skip: u32,
    /// What position channels say.
    #[input(default = absolute)]
    positions: Positions,
    /// Frames a second of the file; as it says itself where it is left out, without what rounding took off (.0083333 s are 120).
    #[input(default = None, range = 0.001..=100000.0)]
    fps: Option<f64>,
    /// Time of the take at the clock's first frame, from the first frame that is not skipped.
    #[input(default = 0.0, range = -86400.0..=86400.0, unit = "s")]
    start: f64,
    /// How fast it plays: 1 as it was captured, 2 twice as fast, 0 not at all, negative backwards.
    #[input(default = 1.0, range = -1000.0..=1000.0)]
    speed: f64,
    /// What follows its end. In a loop the last frame is the first again.
    #[input(default = hold)]
    end: End,
    /// The clock whose frames it is sampled at; `None` for the graph's own.
    #[input(default = None)]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: Option<ClockName>,
}

/// A take.
#[derive(Outputs)]
pub(crate) struct IoReadBvhOutputs {
    /// The joints at their offsets, not turned: parents first, in the order of the file.
    skeleton: Skeleton,
    /// Every joint at each frame.
    pose: Stream<Pose>,
    /// Seconds from the first frame that is not skipped to the last.
    duration: Curve,
    /// Frames a second of the file.
    fps: Curve,
}

impl Whole for IoReadBvh {
    fn check(&self) -> Vec<Problem> {
        let message = "expected one file, found a frame number as #### in its path".to_owned();
        if self.path.is_sequence() { vec![Problem { input: "path", message }] } else { Vec::new() }
    }

    fn run(self, cx: &Context) -> Result<IoReadBvhOutputs, NodeError> {
        let path = self.path.at(0);
        let file = bvh::read(&text(&path)?).map_err(|e| refused(&path, e))?;
        let space = Space::new(self.up, self.scale);
        let playback = Playback { skip: self.skip, start: self.start, speed: self.speed, end: self.end };
        let added = self.positions == Positions::Added;
        let played = playback.play(cx, &path, (file.n_frames, self.fps.unwrap_or(file.fps)), &space, |k| file.pose(k, added))?;
        let parents = file.joints.iter().map(|j| j.parent.map_or(-1, |p| p as i64)).collect();
        let names = file.joints.iter().map(|j| j.name.clone()).collect();
        let skeleton = skeleton(parents, &file.rest(), names, &space)?;
        Ok(IoReadBvhOutputs { skeleton, pose: played.pose, duration: played.duration, fps: played.fps })
    }
}
