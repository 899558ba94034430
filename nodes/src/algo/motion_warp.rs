//! Motions that pass through examples: displacements that come and go about single frames.
//!
//! **Source** Witkin, Popović, *Motion Warping*, SIGGRAPH 1995; Li, Gleicher, Xu, Shum 2003, section 3.1: q(t) = q0(t) + d(t), d of two cubic Hermite
//! segments with d(t_e) = q(t_e) − q0(t_e), nought at both ends of the range, and level at all three. Rotations are displaced in the space of their
//! logarithms, q0(t) exp(h(t) log(q0(t_e)⁻¹ q(t_e))), which knows no wrap of angles; lengths and scales by their logarithms, so that they stay above nought.

use nalgebra::{DMatrix, UnitQuaternion, Vector3};

use super::rotation::{exp, log, near, slerp};
use super::skeleton::Joint;

/// The frames over which an example comes and goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where it is met.
    pub frame: f64,
    /// Frames over which it comes; infinity where it was there all along.
    pub before: f64,
    /// Frames over which it goes; infinity where it stays.
    pub after: f64,
}

/// From 0 at 0 to 1 at 1, level at both.
pub fn hermite(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

impl Span {
    /// How much of the example there is: 1 at its frame, 0 from `before` frames before it and `after` frames after it (Li et al. 2003, section 3.1).
    pub fn influence(&self, time: f64) -> f64 {
        let (away, reach) = (time - self.frame, if time < self.frame { self.before } else { self.after });
        match away {
            0.0 => 1.0,
            _ if reach == f64::INFINITY => 1.0,
            _ if reach > away.abs() => hermite(1.0 - away.abs() / reach),
            _ => 0.0,
        }
    }
}

/// Several examples, which may overlap.
#[derive(Clone, Debug)]
pub struct Spans {
    spans: Vec<Span>,
    /// What the examples' own influences are taken by, so that each is met where others are on their way; `None` where they are added.
    solved: Option<DMatrix<f64>>,
}

/// Examples that cannot all be met.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpansError {
    /// No frame, or a range of less than nothing.
    #[error("example {at}: expected a frame, and 0 or more frames before and after it, found {found:?}")]
    Span {
        /// The example, from 0.
        at: usize,
        /// What it is.
        found: Span,
    },
    /// Two examples at one frame.
    #[error("expected examples at frames of their own, found two at {frame}")]
    Twice {
        /// The frame.
        frame: f64,
    },
    /// Examples that take from each other what they give.
    #[error("expected examples that can all be met, found ranges that overlap so far that none is left of one; make them shorter")]
    Singular,
}

impl Spans {
    /// Examples that are met although they overlap (`solved`), or whose displacements are just added up.
    ///
    /// # Errors
    /// Where a range is none, two examples share a frame, or no sum of them meets all.
    pub fn new(spans: Vec<Span>, solved: bool) -> Result<Self, SpansError> {
        let fine = |s: &Span| s.frame.is_finite() && s.before >= 0.0 && s.after >= 0.0;
        if let Some(at) = spans.iter().position(|s| !fine(s)) {
            return Err(SpansError::Span { at, found: spans[at] });
        }
        if !solved {
            return Ok(Self { spans, solved: None });
        }
        if let Some(s) = spans.iter().enumerate().find(|(k, s)| spans[..*k].iter().any(|o| o.frame == s.frame)) {
            return Err(SpansError::Twice { frame: s.1.frame });
        }
        let n = spans.len();
        let there = DMatrix::from_fn(n, n, |row, column| spans[column].influence(spans[row].frame));
        let solved = there.lu().try_inverse().filter(|m| m.iter().all(|v| v.abs() < 1e6)).ok_or(SpansError::Singular)?;
        Ok(Self { spans, solved: Some(solved) })
    }

    /// How much of each example's displacement there is at a time: of its own all and of others nothing at its frame, and nothing at all outside of all ranges.
    pub fn amounts(&self, time: f64) -> Vec<f64> {
        let own: Vec<f64> = self.spans.iter().map(|s| s.influence(time)).collect();
        // At a frame of an example rounding has no say.
        let at = self.spans.iter().position(|s| s.frame == time);
        match (&self.solved, at) {
            (Some(_), Some(at)) => (0..own.len()).map(|k| f64::from(u8::from(k == at))).collect(),
            (Some(m), None) => (0..own.len()).map(|k| own.iter().enumerate().map(|(l, h)| h * m[(l, k)]).sum()).collect(),
            (None, _) => own,
        }
    }

    /// [`Spans::amounts`], and what there is of each example elsewhere, as far as no example's own range claims the time.
    pub fn amounts_with(&self, time: f64, elsewhere: &[f64]) -> Vec<f64> {
        let claimed: f64 = self.spans.iter().map(|s| s.influence(time)).sum();
        let free = (1.0 - claimed).max(0.0);
        let mut amounts = self.amounts(time);
        amounts.iter_mut().zip(elsewhere).for_each(|(a, e)| *a += free * e);
        amounts
    }
}

/// How one joint differs from another: what is added in the space of logarithms.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Offset {
    /// Half the rotation vector.
    rotation: Vector3<f64>,
    /// Logarithms of the ratios of scales, or their differences.
    scale: Vector3<f64>,
    /// Half the rotation vector of a bone's direction, or the difference of places.
    turn: Vector3<f64>,
    /// The logarithm of the ratio of a bone's lengths.
    length: f64,
}

/// Which parts of a joint are displaced by logarithms.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Kind {
    is_bone: bool,
    is_positive: [bool; 3],
}

impl Kind {
    /// Of a joint and what examples make of it; a root's place is a place, and no bone.
    fn of<'a>(is_root: bool, joints: impl Iterator<Item = &'a Joint> + Clone) -> Self {
        let is_bone = !is_root && joints.clone().all(|j| j.translation.norm() > 1e-12);
        Self { is_bone, is_positive: [0, 1, 2].map(|k| joints.clone().all(|j| j.scale[k] > 0.0)) }
    }

    fn offset(self, from: &Joint, to: &Joint) -> Offset {
        let rotation = log(&(from.rotation.inverse() * near(&to.rotation, &from.rotation)));
        let scale =
            Vector3::from_fn(|k, _| if self.is_positive[k] { libm::log(to.scale[k] / from.scale[k]) } else { to.scale[k] - from.scale[k] });
        let (a, b) = (from.translation, to.translation);
        if !self.is_bone {
            return Offset { rotation, scale, turn: b - a, length: 0.0 };
        }
        Offset { rotation, scale, turn: log(&arc(&a, &b)), length: libm::log(b.norm() / a.norm()) }
    }

    fn displaced(self, joint: &Joint, by: &Offset) -> Joint {
        let scale =
            Vector3::from_fn(
                |k, _| {
                    if self.is_positive[k] { joint.scale[k] * libm::exp(by.scale[k]) } else { joint.scale[k] + by.scale[k] }
                },
            );
        let translation = if self.is_bone { exp(&by.turn) * joint.translation * libm::exp(by.length) } else { joint.translation + by.turn };
        Joint { translation, rotation: joint.rotation * exp(&by.rotation), scale }
    }
}

/// The shortest rotation from one direction to another; about any axis across where they are opposite.
fn arc(a: &Vector3<f64>, b: &Vector3<f64>) -> UnitQuaternion<f64> {
    let (a, b) = (a.normalize(), b.normalize());
    let (cross, cosine) = (a.cross(&b), a.dot(&b));
    let (sine, axis) = match cross.norm() {
        s if s > 1e-12 => (s, cross / s),
        _ if cosine > 0.0 => return UnitQuaternion::identity(),
        // The axis of the frame that is most across.
        _ => (0.0, Vector3::ith(a.iamin(), 1.0).cross(&a).normalize()),
    };
    exp(&(axis * (libm::atan2(sine, cosine) / 2.0)))
}

/// Examples and what they make of each joint.
#[derive(Clone, Debug)]
pub struct MotionWarp {
    spans: Spans,
    kinds: Vec<Kind>,
    /// For each example, for each joint.
    offsets: Vec<Vec<Offset>>,
}

impl MotionWarp {
    /// Of `parents` (-1 for a root), the motion at each example's frame, and what it is to be there. Shapes: as many pairs as spans, as many joints as parents.
    pub fn new(parents: &[i64], spans: Spans, pairs: &[(Vec<Joint>, Vec<Joint>)]) -> Self {
        let kind = |j: usize| Kind::of(parents[j] < 0, pairs.iter().flat_map(move |(a, b)| [&a[j], &b[j]]));
        let kinds: Vec<Kind> = (0..parents.len()).map(kind).collect();
        let offset = |(from, to): &(Vec<Joint>, Vec<Joint>)| {
            let joints = kinds.iter().zip(from.iter().zip(to));
            joints.map(|(kind, (a, b))| if a == b { Offset::default() } else { kind.offset(a, b) }).collect()
        };
        let offsets = pairs.iter().map(offset).collect();
        Self { spans, kinds, offsets }
    }

    /// The motion at a time, whose own joints are `joints`, with so much of each example `elsewhere` ([`Spans::amounts_with`]); to the bit what it was where
    /// there is nothing of any example.
    pub fn warp(&self, time: f64, elsewhere: &[f64], joints: &[Joint]) -> Vec<Joint> {
        let amounts = self.spans.amounts_with(time, elsewhere);
        let one = |(j, joint): (usize, &Joint)| {
            let mut by = Offset::default();
            for (offsets, h) in self.offsets.iter().zip(&amounts).filter(|(o, h)| **h != 0.0 && o[j] != Offset::default()) {
                let o = &offsets[j];
                by.rotation += o.rotation * *h;
                by.scale += o.scale * *h;
                by.turn += o.turn * *h;
                by.length += o.length * h;
            }
            if by == Offset::default() { *joint } else { self.kinds[j].displaced(joint, &by) }
        };
        joints.iter().enumerate().map(one).collect()
    }
}

/// Between two joints: rotations the shorter way at constant speed, scales by logarithms where both are above nought.
pub fn between(a: &Joint, b: &Joint, t: f64) -> Joint {
    let mix = |x: f64, y: f64| x + (y - x) * t;
    let scale = |k: usize| match (a.scale[k], b.scale[k]) {
        (x, y) if x > 0.0 && y > 0.0 && x != y => x * libm::exp(libm::log(y / x) * t),
        (x, y) => mix(x, y),
    };
    Joint {
        translation: Vector3::from_fn(|k, _| mix(a.translation[k], b.translation[k])),
        rotation: slerp(&a.rotation, &b.rotation, t),
        scale: Vector3::from_fn(|k, _| scale(k)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint(turn: [f64; 3], at: [f64; 3], scale: [f64; 3]) -> Joint {
        Joint { translation: at.into(), rotation: exp(&(Vector3::from(turn) / 2.0)), scale: scale.into() }
    }

    fn span(frame: f64, before: f64, after: f64) -> Span {
        Span { frame, before, after }
    }

    /// A motion of a root and a bone.
    fn motion(t: f64) -> Vec<Joint> {
        let s = libm::sin(0.3 * t);
        vec![joint([0.1 * t, 0.2, s], [t, 1.0, s], [1.0; 3]), joint([s, 0.5, 0.1 * t], [0.0, 1.0 + 0.1 * s, 0.2], [1.0, 1.5, 2.0 + s])]
    }

    fn example(k: usize) -> Vec<Joint> {
        let u = k as f64;
        vec![
            joint([2.0 - u, 0.4 * u, 1.0], [3.0 * u, -1.0, 2.0], [1.0, 2.0, 0.5]),
            joint([0.3, -1.5, 0.9 * u], [0.5, 2.0, -0.3 * u], [0.2 + u, 1.0, 3.0]),
        ]
    }

    /// The largest difference of any number, rotations as what they turn.
    fn apart(a: &[Joint], b: &[Joint]) -> f64 {
        let one = |(a, b): (&Joint, &Joint)| {
            let turned = log(&(a.rotation.inverse() * near(&b.rotation, &a.rotation))).norm();
            turned.max((a.translation - b.translation).amax()).max((a.scale - b.scale).amax())
        };
        a.iter().zip(b).map(one).fold(0.0, f64::max)
    }

    fn warp(spans: &[Span]) -> MotionWarp {
        let pairs: Vec<_> = spans.iter().enumerate().map(|(k, s)| (motion(s.frame), example(k))).collect();
        MotionWarp::new(&[-1, 0], Spans::new(spans.to_vec(), true).unwrap(), &pairs)
    }

    #[test]
    fn the_curve_has_its_values_and_is_level_at_all_three_knots() {
        let s = span(10.0, 4.0, 7.0);
        for (t, truth) in [(6.0, 0.0), (10.0, 1.0), (17.0, 0.0)] {
            assert!((s.influence(t) - truth).abs() < 1e-15);
            // A cubic's one-sided differences fall with the step.
            for e in [1e-5, -1e-5] {
                assert!(((s.influence(t + e) - s.influence(t)) / e).abs() < 1e-5, "{t} {e}");
            }
        }
        // d(t) = 3 u^2 - 2 u^3, its slope 6 u (1 - u) / before, exactly nought at both ends.
        for u in [0.0, 0.25, 0.5, 0.8, 1.0] {
            assert!((s.influence(6.0 + 4.0 * u) - (3.0 * u * u - 2.0 * u * u * u)).abs() < 1e-12);
            assert!((s.influence(17.0 - 7.0 * u) - (3.0 * u * u - 2.0 * u * u * u)).abs() < 1e-12);
        }
        assert_eq!([span(3.0, 0.0, f64::INFINITY).influence(2.9), span(3.0, 0.0, f64::INFINITY).influence(900.0)], [0.0, 1.0]);
    }

    #[test]
    fn an_example_is_met_and_both_ends_are_as_they_were() {
        let warp = warp(&[span(10.0, 4.0, 7.0)]);
        assert!(apart(&warp.warp(10.0, &[], &motion(10.0)), &example(0)) < 1e-12);
        for t in [-3.0, 6.0, 17.0, 40.0] {
            assert_eq!(warp.warp(t, &[], &motion(t)), motion(t));
        }
        // Level at all three: what is displaced moves as the motion does there, within the square of the step.
        for (t, to) in [(6.0, motion(6.0)), (17.0, motion(17.0))] {
            let e = 1e-5;
            assert!(apart(&warp.warp(t + e, &[], &motion(t)), &to) < 1e-9 && apart(&warp.warp(t - e, &[], &motion(t)), &to) < 1e-9);
        }
        let e = 1e-5;
        assert!(apart(&warp.warp(10.0 + e, &[], &motion(10.0)), &example(0)) < 1e-9);
    }

    #[test]
    fn three_examples_that_overlap_are_each_met() {
        let spans = [span(10.0, 8.0, 9.0), span(14.0, 7.0, 7.0), span(17.0, 12.0, 4.0)];
        let warp = warp(&spans);
        for (k, s) in spans.iter().enumerate() {
            assert!(apart(&warp.warp(s.frame, &[], &motion(s.frame)), &example(k)) < 1e-12, "{k}");
            // The solution near the frame is that at the frame: rounding is not hidden.
            let near_by = warp.warp(s.frame + 1e-13, &[], &motion(s.frame));
            assert!(apart(&near_by, &example(k)) < 1e-9, "{k}");
        }
        for t in [2.0, 21.0, 30.0] {
            assert_eq!(warp.warp(t, &[], &motion(t)), motion(t));
        }
        let added = Spans::new(spans.to_vec(), false).unwrap().amounts(14.0);
        assert!(added[0] > 0.1 && added[1] == 1.0 && added[2] > 0.1, "{added:?}");
    }

    #[test]
    fn an_example_serves_elsewhere_but_not_in_anothers_place() {
        let spans = [span(10.0, 4.0, 4.0), span(20.0, 4.0, 4.0)];
        let warp = warp(&spans);
        // All of the first example, far from both: what was added to the one joint is added to the other.
        let there = warp.warp(40.0, &[1.0, 0.0], &motion(10.0));
        assert!(apart(&there, &example(0)) < 1e-12);
        assert!(apart(&warp.warp(20.0, &[1.0, 0.5], &motion(20.0)), &example(1)) < 1e-12, "an example is met whatever else there is");
        assert_eq!(warp.warp(40.0, &[0.0, 0.0], &motion(40.0)), motion(40.0));
    }

    #[test]
    fn lengths_and_scales_stay_above_nought() {
        let warp = warp(&[span(10.0, 8.0, 8.0), span(12.0, 8.0, 8.0)]);
        for k in 0..40 {
            let t = 0.5 * f64::from(k);
            let made = warp.warp(t, &[], &motion(t));
            assert!(made[1].translation.norm() > 0.0 && made.iter().all(|j| j.scale.iter().all(|s| *s > 0.0)), "{t}");
        }
    }

    #[test]
    fn turns_over_the_wrap_go_the_short_way() {
        let (a, b) = (joint([0.0, 0.0, 3.0], [0.0; 3], [1.0; 3]), joint([0.0, 0.0, 3.4], [0.0; 3], [1.0; 3]));
        let warp = MotionWarp::new(&[-1], Spans::new(vec![span(0.0, 2.0, 2.0)], true).unwrap(), &[(vec![a], vec![b])]);
        let half = warp.warp(1.0, &[], &[a]);
        assert!(apart(&half, &[joint([0.0, 0.0, 3.2], [0.0; 3], [1.0; 3])]) < 1e-12);
    }

    #[test]
    fn bones_that_turn_back_or_have_no_length_are_met_too() {
        let bone = |at: [f64; 3]| joint([0.0; 3], at, [1.0; 3]);
        for (a, b) in [([0.0, 2.0, 0.0], [0.0, -1.0, 0.0]), ([0.0; 3], [1.0, 0.0, 0.0]), ([1.0, 0.0, 0.0], [0.0; 3])] {
            let pair = (vec![bone([0.0; 3]), bone(a)], vec![bone([0.0; 3]), bone(b)]);
            let warp = MotionWarp::new(&[-1, 0], Spans::new(vec![span(5.0, 2.0, 2.0)], true).unwrap(), std::slice::from_ref(&pair));
            assert!(apart(&warp.warp(5.0, &[], &pair.0), &pair.1) < 1e-12, "{a:?} {b:?}");
        }
    }

    #[test]
    fn examples_that_cannot_be_met_are_refused() {
        let refused = |spans: &[Span]| Spans::new(spans.to_vec(), true).unwrap_err().to_string();
        assert_eq!(refused(&[span(1.0, 2.0, 2.0), span(1.0, 3.0, 2.0)]), "expected examples at frames of their own, found two at 1");
        assert!(refused(&[span(1.0, 2.0, -1.0)]).starts_with("example 0: expected a frame"));
        assert!(refused(&[span(f64::NAN, 2.0, 1.0)]).starts_with("example 0: expected a frame"));
        let all_along = [span(1.0, f64::INFINITY, f64::INFINITY), span(4.0, f64::INFINITY, f64::INFINITY)];
        assert!(refused(&all_along).starts_with("expected examples that can all be met"));
    }
}
