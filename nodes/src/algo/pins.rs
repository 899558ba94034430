//! Points of the world that stand where they are told to, for as long as they are told to.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4: a figure is moved as a whole so that its foot is at a given place at a given frame.
//! Between pins the shift goes along a cubic that never swings past either (Hermite; slopes of Fritsch and Carlson 1980).

use nalgebra::{Unit, UnitQuaternion, Vector3};

/// One pin, at positions of the motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Pinned {
    /// First position.
    pub first: usize,
    /// Last position.
    pub last: usize,
    /// Where the motion itself has the point at each position, metres.
    pub path: Vec<Vector3<f64>>,
    /// Where it is to be. Where it is at the first position, if it is not said.
    pub target: Option<Vector3<f64>>,
}

impl Pinned {
    /// What brings the point to its place.
    fn shift(&self, k: usize) -> Option<Vector3<f64>> {
        let to = self.target.or_else(|| self.path.get(self.first).copied())?;
        (self.first..=self.last).contains(&k).then(|| self.path.get(k).map(|from| to - from)).flatten()
    }
}

/// What the motion is shifted by at each of `n` positions. Where pins overlap their shifts are averaged; before the first and after the last the shift comes
/// and goes over `blend` positions, or is held.
pub fn shifts(pins: &[&Pinned], n: usize, blend: Option<f64>) -> Vec<Vector3<f64>> {
    let wanted = |k: usize| {
        let here: Vec<Vector3<f64>> = pins.iter().filter_map(|p| p.shift(k)).collect();
        (!here.is_empty()).then(|| here.iter().sum::<Vector3<f64>>() / here.len() as f64)
    };
    let wanted: Vec<Option<Vector3<f64>>> = (0..n).map(wanted).collect();
    let axes: [Vec<f64>; 3] = std::array::from_fn(|d| between(&wanted.iter().map(|w| w.map(|w| w[d])).collect::<Vec<_>>(), blend));
    (0..n).map(|k| Vector3::from_fn(|d, _| axes[d][k])).collect()
}

/// How far the worst of the pins of a position is from its place, its point standing at `at`; 0 where nothing is pinned.
pub fn miss<'a>(pins: impl Iterator<Item = (&'a Pinned, Vector3<f64>)>, k: usize) -> f64 {
    let far = |(pin, at): (&Pinned, Vector3<f64>)| pin.shift(k).and_then(|s| pin.path.get(k).map(|from| (from + s - at).norm()));
    pins.filter_map(far).fold(0.0, f64::max)
}

/// What lifts each position so that its lowest point is never below the ground, with `soft` positions on either side to come and go.
pub fn lifts(lowest: &[f64], ground: f64, soft: usize) -> Vec<f64> {
    let needed: Vec<f64> = lowest.iter().map(|y| (ground - y).max(0.0)).collect();
    let around = |k: usize| k.saturating_sub(soft)..(k + soft + 1).min(needed.len());
    // The mean over a window of the greatest need over the same window is nowhere less than the need.
    let greatest: Vec<f64> = (0..needed.len()).map(|k| around(k).map(|i| needed[i]).fold(0.0, f64::max)).collect();
    let mean = |k: usize| around(k).map(|i| greatest[i]).sum::<f64>() / around(k).len().max(1) as f64;
    (0..needed.len()).map(|k| if soft == 0 { needed[k] } else { mean(k).max(needed[k]) }).collect()
}

/// One curve through what is known: between known positions along a cubic that goes on as both sides leave off and swings past neither; before the first
/// and after the last what is known comes and goes over `blend` positions, or is held.
pub(crate) fn between(known: &[Option<f64>], blend: Option<f64>) -> Vec<f64> {
    let n = known.len();
    let at: Vec<(usize, f64)> = known.iter().enumerate().filter_map(|(k, v)| v.map(|v| (k, v))).collect();
    let (Some(&first), Some(&last)) = (at.first(), at.last()) else { return vec![0.0; n] };
    let ease = |distance: usize| {
        let t = |b: f64| 1.0 - distance as f64 / (b + 1.0);
        blend.map_or(1.0, |b| if t(b) > 0.0 { t(b) * t(b) * (3.0 - 2.0 * t(b)) } else { 0.0 })
    };
    let mut out: Vec<f64> = known.iter().map(|v| v.unwrap_or(0.0)).collect();
    (0..first.0).for_each(|k| out[k] = first.1 * ease(first.0 - k));
    (last.0 + 1..n).for_each(|k| out[k] = last.1 * ease(k - last.0));
    // The slope with which a run of pinned positions leaves off; none for a single one.
    let value = |k: usize| known.get(k).copied().flatten();
    let slope = |a: Option<usize>, b: usize| a.and_then(value).zip(value(b)).map_or(0.0, |(a, b)| b - a);
    for pair in at.windows(2).filter(|p| p[1].0 > p[0].0 + 1) {
        let ((a, from), (b, to)) = (pair[0], pair[1]);
        let slopes = [slope(a.checked_sub(1), a), slope(Some(b), b + 1)];
        let width = (b - a) as f64;
        (a + 1..b).for_each(|k| out[k] = hermite(from, to, slopes, width, (k - a) as f64 / width));
    }
    out
}

/// A cubic from one value to another that stays between them: slopes of the other direction are none, and steep ones are cut.
fn hermite(from: f64, to: f64, slopes: [f64; 2], width: f64, t: f64) -> f64 {
    let rise = (to - from) / width;
    let [m0, m1] = slopes.map(|m| if m * rise > 0.0 { m.abs().min(3.0 * rise.abs()).copysign(rise) } else { 0.0 });
    let s = 1.0 - t;
    from * (1.0 + 2.0 * t) * s * s + to * t * t * (3.0 - 2.0 * t) + width * t * s * (m0 * s - m1 * t)
}

/// Turns of a limb of two bones from a to b to c, the world's: what a and all below it turn by, then what b and all below it turn by, such that c comes
/// to `target`, or as near as the limb reaches. It bends about the axis in which it is bent; a straight one about `bend`.
///
/// `None` where a bone has no length.
pub fn two_bone(
    [a, b, c]: [Vector3<f64>; 3],
    target: Vector3<f64>,
    bend: Vector3<f64>,
) -> Option<(UnitQuaternion<f64>, UnitQuaternion<f64>)> {
    let (upper, lower) = ((b - a).norm(), (c - b).norm());
    if upper < 1e-12 || lower < 1e-12 {
        return None;
    }
    let reach = (target - a).norm().clamp((upper - lower).abs(), upper + lower);
    let size = upper + lower;
    let straight = |v: Vector3<f64>| v.norm() < 1e-9 * size * size;
    let folded = (c - a).cross(&(b - a));
    let axis = if straight(folded) { across(bend, b - a) } else { Unit::new_normalize(folded) };
    // Angles at a and b, now and as they are to be, by the law of cosines.
    let angle = |u: Vector3<f64>, v: Vector3<f64>| libm::atan2(u.cross(&v).dot(&axis), u.dot(&v));
    let corner = |x: f64, y: f64, opposite: f64| libm::acos(((x * x + y * y - opposite * opposite) / (2.0 * x * y)).clamp(-1.0, 1.0));
    let at_b = corner(upper, lower, reach) - angle(a - b, c - b);
    let knee = UnitQuaternion::from_axis_angle(&axis, at_b);
    let foot = b - a + knee * (c - b);
    // Once it is bent right, the whole limb swings so that its end points at the target.
    let swing = match Unit::try_new(foot.cross(&(target - a)), 1e-12 * size * size) {
        Some(about) => UnitQuaternion::from_axis_angle(&about, libm::atan2(foot.cross(&(target - a)).norm(), foot.dot(&(target - a)))),
        // Straight away from the target it may swing about the axis of its bend.
        None if foot.dot(&(target - a)) < 0.0 => UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI),
        None => UnitQuaternion::identity(),
    };
    Some((swing, knee))
}

/// A direction across `bone`, as near to `wanted` as it gets.
fn across(wanted: Vector3<f64>, bone: Vector3<f64>) -> Unit<Vector3<f64>> {
    let away = |v: Vector3<f64>| Unit::try_new(v - bone * (v.dot(&bone) / bone.norm_squared()), 1e-9 * v.norm().max(1e-12));
    away(wanted).or_else(|| away(Vector3::x())).or_else(|| away(Vector3::y())).unwrap_or_else(Vector3::x_axis)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64, z: f64) -> Vector3<f64> {
        Vector3::new(x, y, z)
    }

    fn walk(n: usize) -> Vec<Vector3<f64>> {
        (0..n).map(|k| v(0.1 * k as f64, 0.02 * k as f64, 0.0)).collect()
    }

    #[test]
    fn a_pinned_point_stands_and_its_shift_goes_smoothly_between() {
        let a = Pinned { first: 2, last: 5, path: walk(20), target: None };
        let b = Pinned { first: 12, last: 12, path: walk(20), target: Some(v(1.0, 0.0, 0.5)) };
        let by = shifts(&[&a, &b], 20, None);
        let stands = |k: usize| walk(20)[k] + by[k];
        (2..=5).for_each(|k| assert!((stands(k) - walk(20)[2]).norm() < 1e-12));
        assert!((stands(12) - v(1.0, 0.0, 0.5)).norm() < 1e-12);
        // Held outside, between the two ends inside, and leaving the first pin at its own speed.
        assert_eq!((by[0], by[19]), (by[2], by[12]));
        (5..12).for_each(|k| assert!(by[k + 1].z >= by[k].z && by[k].z >= 0.0 && by[k].z <= 0.5));
        let pinned: Vec<_> = (0..20).map(|k| miss([(&a, stands(k)), (&b, stands(k))].into_iter(), k)).collect();
        assert!(pinned.iter().all(|m| *m < 1e-12));
    }

    #[test]
    fn a_shift_comes_and_goes_over_so_many_frames() {
        let pin = Pinned { first: 10, last: 10, path: walk(21), target: Some(v(0.0, 0.0, 1.0)) };
        let by: Vec<f64> = shifts(&[&pin], 21, Some(3.0)).iter().map(|s| s.z).collect();
        assert_eq!((by[6], by[14], by[10]), (0.0, 0.0, 1.0));
        assert!((by[8] - 0.5).abs() < 1e-12 && by[7] > 0.0 && by[7] < by[8]);
        assert_eq!(shifts(&[&pin], 21, Some(0.0))[9], v(0.0, 0.0, 0.0));
        assert_eq!(shifts(&[], 3, None), vec![v(0.0, 0.0, 0.0); 3]);
    }

    #[test]
    fn overlapping_pins_share_and_the_miss_is_told() {
        let pin = |z| Pinned { first: 0, last: 1, path: vec![v(0.0, 0.0, 0.0); 2], target: Some(v(0.0, 0.0, z)) };
        let (a, b) = (pin(1.0), pin(3.0));
        let by = shifts(&[&a, &b], 2, None);
        assert_eq!(by[0], v(0.0, 0.0, 2.0));
        assert_eq!(miss([(&a, by[0]), (&b, by[0])].into_iter(), 0), 1.0);
    }

    #[test]
    fn nothing_goes_below_the_ground() {
        let lowest = [1.0, 0.2, -0.3, 0.1, -0.05, 0.4, 1.0, 1.0];
        for soft in [0, 1, 2, 50] {
            let up = lifts(&lowest, 0.0, soft);
            assert!(lowest.iter().zip(&up).all(|(y, l)| y + l >= 0.0 && *l >= 0.0), "{soft}: {up:?}");
        }
        assert_eq!(lifts(&lowest, 0.0, 0)[2], 0.3);
        assert_eq!(lifts(&[1.0, 2.0], 0.5, 3), [0.0, 0.0]);
    }

    /// Where c comes under the turns.
    fn end(p: [Vector3<f64>; 3], target: Vector3<f64>, bend: Vector3<f64>) -> Vector3<f64> {
        let (swing, knee) = two_bone(p, target, bend).unwrap();
        p[0] + swing * (p[1] - p[0] + knee * (p[2] - p[1]))
    }

    #[test]
    fn a_limb_reaches_what_it_can_reach() {
        let bent = [v(0.0, 1.0, 0.0), v(0.05, 0.55, 0.1), v(0.0, 0.1, 0.0)];
        let straight = [v(0.0, 1.0, 0.0), v(0.0, 0.5, 0.0), v(0.0, 0.1, 0.0)];
        let targets = [v(0.2, 0.3, 0.1), v(0.0, 0.1, 0.0), v(-0.3, 0.9, 0.4), v(0.1, 1.6, 0.1), v(0.0, 1.4, 0.0)];
        for limb in [bent, straight] {
            for target in targets {
                assert!((end(limb, target, v(1.0, 0.0, 0.0)) - target).norm() < 1e-9, "{target:?}");
            }
            let (far, length) = (v(3.0, 1.0, 0.0), (limb[1] - limb[0]).norm() + (limb[2] - limb[1]).norm());
            assert!((end(limb, far, v(1.0, 0.0, 0.0)) - v(length, 1.0, 0.0)).norm() < 1e-6, "stretched to what it cannot reach");
        }
        assert!(two_bone([v(0.0, 0.0, 0.0); 3], v(1.0, 0.0, 0.0), v(1.0, 0.0, 0.0)).is_none());
    }

    #[test]
    fn a_straight_limb_bends_about_the_axis_that_is_given() {
        let straight = [v(0.0, 1.0, 0.0), v(0.0, 0.5, 0.0), v(0.0, 0.0, 0.0)];
        let target = v(0.0, 0.2, 0.0);
        let (swing, _) = two_bone(straight, target, v(-1.0, 0.0, 0.0)).unwrap();
        let knee = straight[0] + swing * (straight[1] - straight[0]);
        assert!(knee.x.abs() < 1e-12 && knee.z > 0.1, "a knee goes forwards: {knee:?}");
    }
}
