//! `io.read_amc`: motion capture from Acclaim files, a motion (`.amc`) of a skeleton (`.asf`).
//!
//! A bone becomes a joint where it begins, and the last of each chain an end besides, `<bone>_end` ([`crate::algo::amc`]). The motion plays on the clock as
//! that of `io.read_bvh` does; AMC does not tell its rate, which is 120 frames a second in the files of Carnegie Mellon.
//!
//! **Source**: Lander, *Working with Motion Capture File Formats*, 1998. **Fails when** the text is no Acclaim file, a bone stretches or moves along, or a
//! frame has other bones than the skeleton moves: with line and column. **Cost**: O(bytes), and O(joints) a frame.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "walk": (type: "io.read_amc", path: "02_01.amc", skeleton: "02.asf"),
//! }, outputs: { "pose": "@walk.pose" })
//! ```

use pegbar_engine::node::{Context, NodeError, Problem, Stream, Whole};
use pegbar_engine::setting::{ClockName, InputPath};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use super::capture::{Playback, refused, skeleton, text};
use super::read_gltf::End;
use crate::algo::amc::{read_amc, read_asf};
use crate::algo::take::{Space, Up};
use crate::data::{Pose, Skeleton};

/// Reads motion capture: `.amc` with its `.asf`.
#[derive(Node)]
#[node(
    id = "io.read_amc",
    version = 1,
    kind = whole,
    outputs = IoReadAmcOutputs,
    source = "Lander 1998",
    example = "\"walk\": (type: \"io.read_amc\", path: \"02_01.amc\", skeleton: \"02.asf\")"
)]
pub(crate) struct IoReadAmc {
    /// The motion, from the graph's folder, ending in .amc.
    path: InputPath,
    /// The skeleton, likewise, ending in .asf.
    skeleton: InputPath,
    /// Metres a unit of the files' lengths, which are divided by the `length` of the skeleton's units first: as Carnegie Mellon has it, inches.
    #[input(default = 0.0254, range = 0.000001..=1000000.0, unit = "m")]
    scale: f64,
    /// The axis that points up in the files; the figure is turned so that y does.
    #[input(default = y)]
    up: Up,
    /// Frames of the file that are left out at its start.
    #[input(default = 0, range = 0..=1000000000, unit = "frames")]
    skip: u32,
    /// Frames a second of the file.
    #[input(default = 120.0, range = 0.001..=100000.0)]
    fps: f64,
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
pub(crate) struct IoReadAmcOutputs {
    /// The joints at rest, not turned: the root, the bones, and the ends of chains.
    skeleton: Skeleton,
    /// Every joint at each frame.
    pose: Stream<Pose>,
    /// Seconds from the first frame that is not skipped to the last.
    duration: Curve,
}

impl Whole for IoReadAmc {
    fn check(&self) -> Vec<Problem> {
        let message = "expected one file, found a frame number as #### in its path";
        let paths = [("path", &self.path), ("skeleton", &self.skeleton)];
        paths.into_iter().filter(|(_, p)| p.is_sequence()).map(|(input, _)| Problem { input, message: message.to_owned() }).collect()
    }

    fn run(self, cx: &Context) -> Result<IoReadAmcOutputs, NodeError> {
        let (path, bones) = (self.path.at(0), self.skeleton.at(0));
        let asf = read_asf(&text(&bones)?).map_err(|e| refused(&bones, e))?;
        let motion = read_amc(&text(&path)?, &asf).map_err(|e| refused(&path, e))?;
        let space = Space::new(self.up, self.scale);
        let playback = Playback { skip: self.skip, start: self.start, speed: self.speed, end: self.end };
        let played = playback.play(cx, &path, (motion.n_frames, self.fps), &space, |k| asf.pose(&motion, k))?;
        let (parents, names) = asf.joints();
        let skeleton = skeleton(parents, &asf.rest(), names, &space)?;
        Ok(IoReadAmcOutputs { skeleton, pose: played.pose, duration: played.duration })
    }
}
