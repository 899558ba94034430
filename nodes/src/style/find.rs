//! `style.find`: where else a motion is as it is at its drawings, so that they may serve again.
//!
//! **Method** joints of a window of frames are laid on those of each example ([`crate::algo::similar_poses`]); where they are nearest, and near enough, the
//! example comes and goes again, as much as it is sure.
//!
//! **Source** Kovar, Gleicher, Pighin, *Motion Graphs*, 2002, equation 1; Li, Gleicher, Xu, Shum 2003, section 5 (named there as work to do).
//!
//! **Fails when** a frame is outside of the motion, or skeleton and pose do not go together. A figure that stands still is like itself all along: nothing is found.
//!
//! **Cost** O(frames · examples · window · joints).
//!
//! ```ron
//! "again": (type: "style.find", skeleton: "@ant.skeleton", pose: "@ant.pose", frames: [12, 20]),
//! ```

use nalgebra::Vector3;
use pegbar_engine::node::{Context, Fault, In, NodeError, Sequence, Stream, Whole};
use pegbar_engine::value::Vector;
use pegbar_engine::{Node, Outputs};

use crate::algo::similar_poses::{Facing, Search, amount, distance, finds};
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::data::{Pose, Skeleton};

/// Where else a motion is as it is at its drawings, so that they may serve again.
#[derive(Node)]
#[node(
    id = "style.find",
    version = 1,
    kind = whole,
    outputs = StyleFindOutputs,
    source = "Kovar, Gleicher, Pighin 2002, eq. 1; Li, Gleicher, Xu, Shum 2003, section 5",
    example = "\"again\": (type: \"style.find\", skeleton: \"@ant.skeleton\", pose: \"@ant.pose\", frames: [12, 20])"
)]
pub(crate) struct StyleFind {
    /// The figure's joints.
    skeleton: In<Skeleton>,
    /// What they do, before it is edited.
    pose: Sequence<Pose>,
    /// The examples' frames, in the order of the fields and edits that are to serve again.
    frames: Vec<i64>,
    /// How far joints may be, of the figure's own size, until poses are not alike at all. Small finds the same alone; large gives much a little.
    #[input(default = 0.2, range = 0.001..=10.0)]
    tolerance: f64,
    /// Frames before and after each that are compared too: 0 knows poses alone, more knows which way they go.
    #[input(default = 2, range = 0..=1000)]
    window: u32,
    /// Frames before and after a find over which it comes and goes.
    #[input(default = 6.0, range = 0.0..=1000000.0, unit = "frames")]
    transition: f64,
    /// Which way the figure must look.
    #[input(default = same)]
    facing: Facing,
}

/// What was found.
#[derive(Outputs)]
pub(crate) struct StyleFindOutputs {
    /// How much of each example there is to be again: its confidence at a find, 0 at the example itself. For `elsewhere` of `motion.warp` and
    /// `style.assemble`.
    amounts: Stream<Vector>,
    /// How far each frame is from each example, of the figure's size.
    distances: Stream<Vector>,
}

impl StyleFind {
    /// Places of the joints at each frame.
    fn places(&self, first: i64) -> Result<Vec<Vec<Vector3<f64>>>, NodeError> {
        let n = self.skeleton.n_joints();
        let one = |k: usize| {
            let refused = |e: String| NodeError::input(format!("pose at frame {}: {e}", first + k as i64));
            let joints = self.pose.get(k)?.joints().map_err(refused)?;
            if joints.len() != n {
                return Err(refused(format!("expected {n} joints as in the skeleton, found {}", joints.len())));
            }
            let local: Vec<_> = joints.iter().map(Joint::matrix).collect();
            let world = world_from_joint(&self.skeleton.parents, &local).map_err(|e| NodeError::input(format!("skeleton: {e}")))?;
            Ok(world.iter().map(|m| Vector3::new(m[(0, 3)], m[(1, 3)], m[(2, 3)])).collect())
        };
        let places: Vec<_> = (0..self.pose.len()).map(one).collect::<Result<_, NodeError>>()?;
        if places.is_empty() { Err(NodeError::input("pose: expected at least one frame, found none")) } else { Ok(places) }
    }
}

impl Whole for StyleFind {
    fn run(self, cx: &Context) -> Result<StyleFindOutputs, NodeError> {
        let clock = self.pose.clock().unwrap_or(cx.clock);
        let mut places = self.places(clock.first)?;
        // One pose stands for every frame of the clock.
        if self.pose.clock().is_none() {
            places.resize(cx.clock.len(), places[0].clone());
        }
        let search = Search { window: self.window as usize, tolerance: self.tolerance, transition: self.transition, facing: self.facing };
        let (mut found, mut distances) = (Vec::new(), Vec::new());
        for frame in &self.frames {
            cx.check()?;
            let last = clock.first + places.len() as i64 - 1;
            let example = usize::try_from(frame - clock.first).ok().filter(|k| *k < places.len());
            let example = example.ok_or_else(|| {
                NodeError::new(Fault::Parameters, format!("frames: expected a frame from {} to {last}, found {frame}", clock.first))
            })?;
            let away: Vec<f64> = (0..places.len()).map(|k| distance(&places, example, k, &search)).collect();
            found.push(finds(&away, example, &search));
            distances.push(away);
        }
        let row = |f: &dyn Fn(usize, usize) -> f64| {
            Stream((0..places.len()).map(|k| Vector { values: (0..found.len()).map(|e| f(e, k)).collect() }).collect())
        };
        Ok(StyleFindOutputs { amounts: row(&|e, k| amount(&found[e], k, self.transition)), distances: row(&|e, k| distances[e][k]) })
    }
}
