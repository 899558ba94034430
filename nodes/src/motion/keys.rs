//! `motion.keys`: an affine motion set by hand on a few frames.
//!
//! **Method** scale, then a squash that keeps the area, then rotation, all about a pivot, then translation; each between its keys by the easing, squash in
//! logarithms, so that 2 and 1/2 are as far from 1. See [`crate::algo::keyframes`].
//!
//! **Source** Thomas and Johnston, *The Illusion of Life*, 1981 (squash and stretch, slow in and slow out); Bregler, Loeb, Chuang, Deshpande 2002,
//! equation 1.
//!
//! **Fails when** frames are not in order, or a list has neither one entry nor one for each key.
//!
//! **Cost** O(keys) a frame.
//!
//! ```ron
//! "hop": (
//!     type: "motion.keys", frames: [1, 7, 13, 17], translation: [(0.0, 0.0), (60.0, -80.0), (120.0, 0.0), (120.0, 0.0)],
//!     squash: [1.0, 1.2, 0.7, 1.0], pivot: (80.0, 200.0), easing: [slow_in, slow_out, overshoot], hold: 2,
//! ),
//! ```

use nalgebra::{Matrix2, Vector2};
use pegbar_engine::node::{Context, NodeError, PerFrame, Problem};
use pegbar_engine::setting::ClockName;
use pegbar_engine::{Node, Outputs};

use super::timing::{Easings, each, problems, unless};
use crate::algo::keyframes::{Beyond, Keyframes, drawn};
use crate::algo::raster::Affine;
use crate::data::Affine2;

/// An affine motion set by hand on a few frames.
///
/// Each list has one entry for all keys, or one for each.
#[derive(Node)]
#[node(
    id = "motion.keys",
    version = 1,
    kind = source,
    outputs = MotionKeysOutputs,
    uses_frame,
    source = "Thomas, Johnston 1981; Bregler, Loeb, Chuang, Deshpande 2002, eq. 1",
    example = "\"hop\": (type: \"motion.keys\", frames: [1, 7, 13], translation: [(0.0, 0.0), (60.0, -80.0), (120.0, 0.0)], squash: [1.0, 1.2, 0.7], easing: [slow_in, slow_out])"
)]
pub(crate) struct MotionKeys {
    /// The frames of the keys, each later than the one before.
    frames: Vec<i64>,
    /// Translation, to the right and down.
    #[input(default = [(0.0, 0.0)], unit = "px")]
    translation: Vec<[f64; 2]>,
    /// Rotation, clockwise as seen on screen; beyond 360 it turns more than once.
    #[input(default = [0.0], unit = "deg")]
    rotation_deg: Vec<f64>,
    /// Scale across and down; negative mirrors.
    #[input(default = [(1.0, 1.0)], range = -10000.0..=10000.0)]
    scale: Vec<[f64; 2]>,
    /// Length along the squash's axis, the width its inverse, so that the area stays: below 1 squashes, above 1 stretches.
    #[input(default = [1.0], range = 0.0001..=10000.0)]
    squash: Vec<f64>,
    /// Direction in which a squash stretches, clockwise from upright, before the rotation.
    #[input(default = [0.0], unit = "deg")]
    squash_angle_deg: Vec<f64>,
    /// The point of the reference that scale, squash and rotation leave where it is: a foot, a hip.
    #[input(default = (0.0, 0.0), unit = "px")]
    pivot: [f64; 2],
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

/// The motion.
#[derive(Outputs)]
pub(crate) struct MotionKeysOutputs {
    /// Frame from reference, pixels.
    motion: Affine2,
}

/// The blend of a list of one entry, or of one for each key.
fn blend<const N: usize>(entries: &[[f64; N]], coefficients: &[f64]) -> [f64; N] {
    match entries {
        [one] => *one,
        _ => std::array::from_fn(|i| entries.iter().zip(coefficients).map(|(e, c)| e[i] * c).sum()),
    }
}

fn single(entries: &[f64], coefficients: &[f64]) -> f64 {
    let [value] = blend(entries.as_chunks::<1>().0, coefficients);
    value
}

fn rotation(degrees: f64) -> Matrix2<f64> {
    let (sin, cos) = libm::sincos(degrees.to_radians());
    Matrix2::new(cos, -sin, sin, cos)
}

impl MotionKeys {
    fn motion(&self, c: &[f64]) -> Affine {
        let [sx, sy] = blend(&self.scale, c);
        let logs: Vec<f64> = self.squash.iter().map(|&s| libm::log(s)).collect();
        let squash = libm::exp(single(&logs, c));
        let axis = rotation(single(&self.squash_angle_deg, c));
        let squashed = axis * Matrix2::new(1.0 / squash, 0.0, 0.0, squash) * axis.transpose();
        let linear = rotation(single(&self.rotation_deg, c)) * squashed * Matrix2::new(sx, 0.0, 0.0, sy);
        let pivot = Vector2::from(self.pivot);
        let offset = pivot + Vector2::from(blend(&self.translation, c)) - linear * pivot;
        Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), offset])
    }
}

impl PerFrame for MotionKeys {
    fn run(self, cx: &Context) -> Result<MotionKeysOutputs, NodeError> {
        let keys = Keyframes { times: &self.frames, easing: &self.easing.0, beyond: self.beyond, overshoot: self.overshoot };
        let motion = self.motion(&keys.coefficients(drawn(cx.frame, cx.clock.first, self.hold)));
        if !motion.iter().all(|v| v.is_finite()) {
            return Err(NodeError::input("expected a finite motion, found numbers too large for one"));
        }
        Ok(MotionKeysOutputs { motion: motion.into() })
    }

    fn check(&self) -> Vec<Problem> {
        let n = self.frames.len();
        let mut found = problems(&self.frames, &self.easing);
        found.extend(each("translation", n, self.translation.len(), self.translation.as_flattened()));
        found.extend(each("rotation_deg", n, self.rotation_deg.len(), &self.rotation_deg));
        found.extend(each("scale", n, self.scale.len(), self.scale.as_flattened()));
        found.extend(each("squash", n, self.squash.len(), &self.squash));
        found.extend(each("squash_angle_deg", n, self.squash_angle_deg.len(), &self.squash_angle_deg));
        found.extend(unless(self.pivot.iter().all(|v| v.is_finite()), "pivot", || {
            "expected finite numbers, found NaN or infinity".to_owned()
        }));
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::keyframes::Easing;
    use crate::algo::raster::apply;

    fn node() -> MotionKeys {
        MotionKeys {
            frames: vec![1, 5],
            translation: vec![[0.0, 0.0]],
            rotation_deg: vec![0.0],
            scale: vec![[1.0, 1.0]],
            squash: vec![1.0],
            squash_angle_deg: vec![0.0],
            pivot: [10.0, 20.0],
            easing: Easings(vec![Easing::Linear]),
            overshoot: 1.70158,
            beyond: Beyond::Hold,
            hold: 1,
            clock: ClockName("frames".to_owned()),
        }
    }

    fn close(found: Affine, truth: Affine) {
        assert!((found - truth).amax() < 1e-12, "{found}, expected {truth}");
    }

    #[test]
    fn each_part_of_the_motion_is_its_own() {
        close(node().motion(&[0.3, 0.7]), Affine::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0));
        let moved = MotionKeys { translation: vec![[0.0, 0.0], [8.0, -4.0]], ..node() };
        close(moved.motion(&[0.25, 0.75]), Affine::new(1.0, 0.0, 6.0, 0.0, 1.0, -3.0));
        // A quarter turn, clockwise on screen: right goes down.
        let turned = MotionKeys { rotation_deg: vec![0.0, 180.0], ..node() };
        close(turned.motion(&[0.5, 0.5]), Affine::new(0.0, -1.0, 30.0, 1.0, 0.0, 10.0));
        let scaled = MotionKeys { scale: vec![[1.0, 1.0], [3.0, 0.5]], ..node() };
        close(scaled.motion(&[0.0, 1.0]), Affine::new(3.0, 0.0, -20.0, 0.0, 0.5, 10.0));
        let squashed = MotionKeys { squash: vec![0.5, 2.0], ..node() };
        close(squashed.motion(&[1.0, 0.0]), Affine::new(2.0, 0.0, -10.0, 0.0, 0.5, 10.0));
        close(squashed.motion(&[0.5, 0.5]), Affine::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0));
        let along = MotionKeys { squash: vec![2.0], squash_angle_deg: vec![90.0], pivot: [0.0, 0.0], ..node() };
        close(along.motion(&[1.0, 0.0]), Affine::new(2.0, 0.0, 0.0, 0.0, 0.5, 0.0));
    }

    #[test]
    fn a_squash_keeps_the_area_and_all_keeps_the_pivot() {
        let all = MotionKeys {
            rotation_deg: vec![-30.0, 500.0],
            squash: vec![0.4, 3.0],
            squash_angle_deg: vec![10.0, 70.0],
            translation: vec![[3.0, 4.0]],
            ..node()
        };
        for k in -2..=14 {
            let u = f64::from(k) / 10.0;
            let m = all.motion(&[1.0 - u, u]);
            assert!((m.fixed_view::<2, 2>(0, 0).determinant() - 1.0).abs() < 1e-12);
            assert!((apply(&m, Vector2::new(10.0, 20.0)) - Vector2::new(13.0, 24.0)).amax() < 1e-12);
        }
    }

    #[test]
    fn everything_that_is_wrong_is_said() {
        let wrong = MotionKeys {
            frames: vec![1, 5, 5],
            translation: vec![[0.0, 0.0], [1.0, 1.0]],
            rotation_deg: vec![f64::NAN],
            easing: Easings(vec![Easing::Linear; 5]),
            pivot: [f64::INFINITY, 0.0],
            ..node()
        };
        let said: Vec<String> = wrong.check().into_iter().map(|p| format!("{}: {}", p.input, p.message)).collect();
        let truth = [
            "frames: expected each frame later than the one before, found 5 after 5 at position 3",
            "easing: expected one easing, or one for each of 3 keys, found 5",
            "translation: expected one entry, or one for each of 3 keys, found 2",
            "rotation_deg: expected finite numbers, found NaN or infinity",
            "pivot: expected finite numbers, found NaN or infinity",
        ];
        assert_eq!(said, truth);
        let none = MotionKeys { frames: Vec::new(), ..node() };
        assert_eq!(none.check()[0].message, "expected a frame for each key, found none");
    }
}
