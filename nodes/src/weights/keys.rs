//! `weights.keys`: weights of key drawings set by hand on a few frames.
//!
//! **Method** rows of weights are blended between their frames by the easing: see [`crate::algo::keyframes`]. Rows that add up to 1 do so between their
//! frames too; an overshoot or a spline goes below 0 and above 1, which carries a pose further than it is drawn.
//!
//! **Source** Thomas and Johnston, *The Illusion of Life*, 1981 (pose to pose); Bregler, Loeb, Chuang, Deshpande 2002, equation 2.
//!
//! **Fails when** frames are not in order, rows are not of one length, or do not add up to 1.
//!
//! **Cost** O(keys · weights) a frame.
//!
//! ```ron
//! "walk": (type: "weights.keys", frames: [1, 4, 7, 10, 13], poses: [1, 2, 3, 4, 1], easing: spline, beyond: loop, hold: 2),
//! ```

use pegbar_engine::node::{Context, NodeError, PerFrame, Problem};
use pegbar_engine::setting::ClockName;
use pegbar_engine::{Node, Outputs};

use crate::algo::keyframes::{Beyond, Keyframes, drawn};
use crate::data::Weights;
use crate::motion::timing::{Easings, problems, unless};

/// Weights of key drawings set by hand on a few frames.
///
/// A pose is a row of weights; without rows, pose 1 is the first key drawing, pose 2 the second.
#[derive(Node)]
#[node(
    id = "weights.keys",
    version = 1,
    kind = source,
    outputs = WeightsKeysOutputs,
    uses_frame,
    source = "Thomas, Johnston 1981; Bregler, Loeb, Chuang, Deshpande 2002, eq. 2",
    example = "\"walk\": (type: \"weights.keys\", frames: [1, 4, 7, 10, 13], poses: [1, 2, 3, 4, 1], easing: spline, beyond: loop, hold: 2)"
)]
pub(crate) struct WeightsKeys {
    /// The frames at which a pose is set, each later than the one before.
    frames: Vec<i64>,
    /// The pose at each frame, from 1. One after the other where there are none.
    #[input(default = [], range = 1.0..=100000.0)]
    poses: Vec<i64>,
    /// Poses: a weight for each key drawing. Each is one key drawing alone where there are none.
    #[input(default = [])]
    weights: Vec<Vec<f64>>,
    /// Number of key drawings, where no rows say it. As many as the last of the poses where it is left out.
    #[input(default = None, range = 1..=100000)]
    count: Option<u32>,
    /// Refuse rows that do not add up to 1, as those of key shapes do. Weights that are added to a rest pose need not.
    #[input(default = true)]
    sum_to_one: bool,
    /// How each key goes over into the next: one word for all, or a list.
    #[input(default = smooth)]
    easing: Easings,
    /// How far an overshoot goes past its key: 0 not at all, 1.70158 by a tenth of the way.
    #[input(default = 1.70158, range = 0.0..=100.0)]
    overshoot: f64,
    /// What is shown before the first key and after the last.
    #[input(default = hold)]
    beyond: Beyond,
    /// Film frames that show one drawing, from the clock's first: 1 on ones, 2 on twos.
    #[input(default = 1, range = 1..=1000, unit = "frames")]
    hold: u32,
    /// The clock that it plays on.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

/// The weights.
#[derive(Outputs)]
pub(crate) struct WeightsKeysOutputs {
    /// One for each key drawing.
    weights: Weights,
}

impl WeightsKeys {
    /// The pose at each frame, from 0.
    fn order(&self) -> Vec<usize> {
        if self.poses.is_empty() {
            (0..self.frames.len()).collect()
        } else {
            self.poses.iter().map(|&p| usize::try_from(p - 1).unwrap_or(0)).collect()
        }
    }

    fn count(&self) -> usize {
        let most = self.order().iter().max().map_or(0, |p| p + 1);
        self.weights.first().map_or_else(|| self.count.map_or(most, |c| c as usize), Vec::len)
    }

    /// The weights where this much of each frame's pose is shown.
    fn blend(&self, coefficients: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.count()];
        for (pose, c) in self.order().into_iter().zip(coefficients) {
            match self.weights.get(pose) {
                Some(row) => out.iter_mut().zip(row).for_each(|(o, w)| *o += c * w),
                None => out.iter_mut().skip(pose).take(1).for_each(|o| *o += c),
            }
        }
        out
    }

    fn rows(&self) -> Option<Problem> {
        let count = self.weights.first()?.len();
        self.weights.iter().enumerate().find_map(|(i, row)| {
            let sum: f64 = row.iter().sum();
            // What is written by hand has so many digits.
            let adds_up = !self.sum_to_one || (sum - 1.0).abs() <= 1e-5;
            let row_no = i + 1;
            unless(row.len() == count && count > 0, "weights", || {
                format!("expected rows of as many weights each, at least one, found {} in row {row_no} and {count} in the first", row.len())
            })
            .or_else(|| unless(sum.is_finite(), "weights", || format!("expected finite numbers, found NaN or infinity in row {row_no}")))
            .or_else(|| {
                unless(adds_up, "weights", || {
                    format!(
                        "expected rows that add up to 1, found {sum} in row {row_no}; say `sum_to_one: false` for weights that need not"
                    )
                })
            })
        })
    }
}

impl PerFrame for WeightsKeys {
    fn run(self, cx: &Context) -> Result<WeightsKeysOutputs, NodeError> {
        let keys = Keyframes { times: &self.frames, easing: &self.easing.0, beyond: self.beyond, overshoot: self.overshoot };
        let weights = self.blend(&keys.coefficients(drawn(cx.frame, cx.clock.first, self.hold)));
        if !weights.iter().all(|w| w.is_finite()) {
            return Err(NodeError::input("expected finite weights, found numbers too large for one"));
        }
        Ok(WeightsKeysOutputs { weights: Weights { weights } })
    }

    fn check(&self) -> Vec<Problem> {
        let (n, p) = (self.frames.len(), self.poses.len());
        let mut found = problems(&self.frames, &self.easing);
        found.extend(unless(p == 0 || p == n, "poses", || format!("expected a pose for each of {n} frames, found {p}")));
        found.extend(self.rows());
        let most = self.order().iter().max().map_or(0, |p| p + 1);
        let there = if self.weights.is_empty() { self.count() } else { self.weights.len() };
        let input = if p > 0 { "poses" } else { "frames" };
        found.extend(unless(most <= there, input, || format!("expected poses 1 to {there}, found {most}")));
        let said = self.count.filter(|_| !self.weights.is_empty()).map_or(self.count(), |c| c as usize);
        found.extend(unless(said == self.count(), "count", || format!("expected {} as each row has weights, found {said}", self.count())));
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::keyframes::Easing;

    fn node() -> WeightsKeys {
        WeightsKeys {
            frames: vec![1, 5, 9],
            poses: Vec::new(),
            weights: Vec::new(),
            count: None,
            sum_to_one: true,
            easing: Easings(vec![Easing::Linear]),
            overshoot: 1.70158,
            beyond: Beyond::Hold,
            hold: 1,
            clock: ClockName("frames".to_owned()),
        }
    }

    #[test]
    fn poses_are_rows_or_keys_alone() {
        let c = [0.0, 0.25, 0.75];
        assert_eq!(node().blend(&c), [0.0, 0.25, 0.75]);
        assert_eq!(WeightsKeys { poses: vec![2, 1, 2], count: Some(3), ..node() }.blend(&c), [0.25, 0.75, 0.0]);
        let rows = vec![vec![0.5, 0.5], vec![1.0, 0.0], vec![-0.5, 1.5]];
        assert_eq!(WeightsKeys { weights: rows.clone(), ..node() }.blend(&c), [-0.125, 1.125]);
        assert_eq!(WeightsKeys { weights: rows, poses: vec![3, 2, 2], ..node() }.blend(&c), [1.0, 0.0]);
    }

    #[test]
    fn everything_that_is_wrong_is_said() {
        let said = |node: WeightsKeys| node.check().into_iter().map(|p| format!("{}: {}", p.input, p.message)).collect::<Vec<_>>();
        assert_eq!(said(node()), [""; 0]);
        let poses = said(WeightsKeys { poses: vec![1, 4], count: Some(3), ..node() });
        assert_eq!(poses, ["poses: expected a pose for each of 3 frames, found 2", "poses: expected poses 1 to 3, found 4"]);
        let row = |weights: Vec<Vec<f64>>| said(WeightsKeys { weights, poses: vec![1; 3], ..node() });
        assert_eq!(
            row(vec![vec![0.5, 0.5], vec![1.0]]),
            ["weights: expected rows of as many weights each, at least one, found 1 in row 2 and 2 in the first"]
        );
        assert_eq!(row(vec![vec![0.5, f64::NAN]]), ["weights: expected finite numbers, found NaN or infinity in row 1"]);
        let sum = "weights: expected rows that add up to 1, found 0.75 in row 1; say `sum_to_one: false` for weights that need not";
        assert_eq!(row(vec![vec![0.5, 0.25]]), [sum]);
        assert_eq!(said(WeightsKeys { weights: vec![vec![0.5, 0.25]; 3], sum_to_one: false, ..node() }), [""; 0]);
        assert_eq!(said(WeightsKeys { weights: vec![vec![1.0]; 2], ..node() }), ["frames: expected poses 1 to 2, found 3"]);
        let count = said(WeightsKeys { weights: vec![vec![1.0]; 3], count: Some(2), ..node() });
        assert_eq!(count, ["count: expected 1 as each row has weights, found 2"]);
    }
}
