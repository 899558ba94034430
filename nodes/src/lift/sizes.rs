//! Whether drawing and capture are in the units that they are taken to be in.

use pegbar_engine::Setting;
use pegbar_engine::node::NodeError;

use crate::algo::pose_descriptor::{distance, size_ratio};

/// What is made of sizes that no figure has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Sizes {
    /// An error: they look like another unit.
    Checked,
    /// Nothing.
    Any,
}

/// How many times larger or smaller than the capture a drawn figure may be: proportions of cartoons and foreshortening stay below, centimetres, inches,
/// feet and pictures of ten times the size do not.
const LARGEST_RATIO: f64 = 3.0;
/// Metres of a figure's longest limb: a puppet's of a hand's height, and a giant's of twelve times a man's.
const LONGEST_LIMB: std::ops::RangeInclusive<f64> = 0.02..=5.0;

impl Sizes {
    /// That the drawn figure is about as large as the captured one as the camera sees it, by their limbs.
    pub(crate) fn expect_alike(self, drawn: &[[f64; 2]], seen: &[[f64; 2]], limbs: &[[usize; 2]]) -> Result<(), NodeError> {
        let ratio = size_ratio(drawn, seen, limbs).filter(|_| self == Self::Checked).unwrap_or(1.0);
        if (1.0 / LARGEST_RATIO..=LARGEST_RATIO).contains(&ratio) {
            return Ok(());
        }
        let found = format!("expected limbs drawn about as long as the camera sees the capture's, found them {ratio:.3} times as long");
        Err(NodeError::input(format!("{found}: markers, capture or camera are in another unit")).help(
            "set `scale` of `io.read_markers` (and `size`, which finds it out), of the capture (metres a unit: 0.01 for centimetres) or of the camera (pixels a metre); \
             `sizes: any` takes them as they are",
        ))
    }

    /// That a figure's limbs are metres.
    pub(crate) fn expect_metres(self, points: &[[f64; 3]], limbs: &[[usize; 2]]) -> Result<(), NodeError> {
        let longest = limbs.iter().map(|l| distance(points[l[0]], points[l[1]])).filter(|l| l.is_finite()).fold(0.0, f64::max);
        if self == Self::Any || longest == 0.0 || LONGEST_LIMB.contains(&longest) {
            return Ok(());
        }
        let (least, most) = (LONGEST_LIMB.start(), LONGEST_LIMB.end());
        Err(NodeError::input(format!("expected a figure in metres, its longest limb from {least} to {most}, found {longest:.4}")).help(
            "set `scale` of the capture, metres a unit: 0.01 for centimetres, 0.0254 for inches, 0.056444 for Carnegie Mellon's takes as BVH; \
             `sizes: any` takes it as it is",
        ))
    }
}
