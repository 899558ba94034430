//! The pose descriptor: directions of limbs in the picture, blind to place and size. Jain, Sheikh, Hodgins 2009, section 3.2, equation 2.

use std::f64::consts::{PI, TAU};

use pegbar_engine::Setting;

use super::camera::Camera;

/// What a limb's direction is measured from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Reference {
    /// The picture's x axis.
    Absolute,
    /// The limb above, that which ends where this one begins; the x axis where there is none.
    Relative,
}

/// Angle from −π to π, −π itself left out, that is as good as `angle`.
pub fn wrap(angle: f64) -> f64 {
    let rest = angle % TAU;
    if rest > PI {
        rest - TAU
    } else if rest <= -PI {
        rest + TAU
    } else {
        rest
    }
}

/// Length of a limb in the picture, pixels; NaN where an end is not seen.
pub fn length(points: &[[f64; 2]], [from, to]: [usize; 2]) -> f64 {
    libm::hypot(points[to][0] - points[from][0], points[to][1] - points[from][1])
}

/// How many times as long limbs are in one picture as in another: the median over those that are seen in both. `None` where there are none.
pub fn size_ratio(points: &[[f64; 2]], other: &[[f64; 2]], limbs: &[[usize; 2]]) -> Option<f64> {
    let ratio = |limb: &[usize; 2]| length(points, *limb) / length(other, *limb);
    let mut ratios: Vec<f64> = limbs.iter().map(ratio).filter(|r| *r > 0.0 && r.is_finite()).collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied()
}

/// Direction of each limb `[parent, child]` (eq. 2), radians, anticlockwise as it is seen, though rows count downwards. NaN where an end is not seen, or
/// the limb is no longer than `least` pixels: a limb that points at the camera has no direction.
pub fn angles(points: &[[f64; 2]], limbs: &[[usize; 2]], reference: Reference, least: f64) -> Vec<f64> {
    let absolute = |limb: &[usize; 2]| {
        let [from, to] = limb.map(|k| points[k]);
        let long = length(points, *limb) > least;
        if long { libm::atan2(from[1] - to[1], to[0] - from[0]) } else { f64::NAN }
    };
    let all: Vec<f64> = limbs.iter().map(absolute).collect();
    match reference {
        Reference::Absolute => all.into_iter().map(wrap).collect(),
        Reference::Relative => {
            let above = |limb: &[usize; 2]| limbs.iter().position(|l| l[1] == limb[0]).map_or(0.0, |k| all[k]);
            limbs.iter().zip(&all).map(|(limb, angle)| wrap(angle - above(limb))).collect()
        }
    }
}

/// The length in pixels that each limb would have in the picture if it lay across the line of sight at its depth: its true length.
pub fn true_lengths(points: &[[f64; 3]], limbs: &[[usize; 2]], camera: &Camera) -> Vec<f64> {
    limbs.iter().map(|limb| limb.map(|k| points[k])).map(|[a, b]| pixels_a_metre(camera, mid(a, b)) * distance(a, b)).collect()
}

fn mid(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| (a[c] + b[c]) / 2.0)
}

/// Distance of two points.
pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>().sqrt()
}

/// Pixels that a metre across the line of sight has at a point.
pub fn pixels_a_metre(camera: &Camera, at: [f64; 3]) -> f64 {
    let world = camera.world_from_camera();
    let [x, y, _] = camera.project(at);
    let up = world.column(1).xyz();
    let [u, v, _] = camera.project(std::array::from_fn(|c| at[c] + 1e-3 * up[c]));
    libm::hypot(u - x, v - y) / (1e-3 * up.norm())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMBS: [[usize; 2]; 3] = [[0, 1], [1, 2], [0, 3]];

    fn points() -> Vec<[f64; 2]> {
        vec![[100.0, 100.0], [130.0, 60.0], [90.0, 60.0], [100.0, 180.0]]
    }

    #[test]
    fn angles_are_those_that_are_seen() {
        let found = angles(&points(), &LIMBS, Reference::Absolute, 0.0);
        let truth = [libm::atan2(40.0, 30.0), PI, -PI / 2.0];
        assert!(found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-15), "{found:?}");
        let relative = angles(&points(), &LIMBS, Reference::Relative, 0.0);
        assert!((relative[1] - (PI - truth[0])).abs() < 1e-15 && relative[0] == found[0], "{relative:?}");
    }

    #[test]
    fn neither_place_nor_size_matters() {
        for reference in [Reference::Absolute, Reference::Relative] {
            let before = angles(&points(), &LIMBS, reference, 0.0);
            for size in [1e-6, 0.37, 1e6] {
                let moved: Vec<_> = points().iter().map(|p| [size * p[0] + 17.3 * size, size * p[1] - 250.1 * size]).collect();
                let after = angles(&moved, &LIMBS, reference, 0.0);
                assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 1e-12), "{before:?} {after:?}");
            }
        }
    }

    #[test]
    fn half_a_turn_is_itself_from_both_sides() {
        assert_eq!((wrap(PI), wrap(-PI), wrap(3.0 * PI), wrap(0.0)), (PI, PI, PI, 0.0));
        assert_eq!(angles(&[[0.0, 0.0], [-1.0, 0.0]], &[[0, 1]], Reference::Absolute, 0.0), [PI]);
        assert_eq!(angles(&[[0.0, 0.0], [-1.0, -0.0]], &[[0, 1]], Reference::Absolute, 0.0), [PI]);
    }

    #[test]
    fn limbs_without_a_direction_have_none() {
        let points = [[0.0, 0.0], [0.0, 0.0], [f64::NAN, 3.0], [5.0, 0.0]];
        let found = angles(&points, &[[0, 1], [0, 2], [0, 3], [1, 3]], Reference::Relative, 0.0);
        assert!(found[0].is_nan() && found[1].is_nan() && found[2] == 0.0);
        assert!(found[3].is_nan(), "what hangs on it has none either");
        assert!(angles(&points, &[[0, 3]], Reference::Absolute, 5.0)[0].is_nan());
    }

    #[test]
    fn the_ratio_of_sizes_is_the_median_of_what_is_seen() {
        let mut larger: Vec<_> = points().iter().map(|p| [10.0 * p[0], 10.0 * p[1] + 7.0]).collect();
        larger[3][1] += 1e5;
        assert!((size_ratio(&larger, &points(), &LIMBS).unwrap() - 10.0).abs() < 1e-12, "one stray marker does not tell");
        assert_eq!(size_ratio(&[[f64::NAN; 2]; 4], &points(), &LIMBS), None);
        assert_eq!(size_ratio(&points(), &[[1.0; 2]; 4], &LIMBS), None);
    }

    #[test]
    fn true_lengths_are_those_across_the_view() {
        use crate::algo::camera::{Orbit, orthographic, perspective};
        let orbit = Orbit { target: [0.0, 1.0, 0.0], azimuth: 0.4, elevation: 0.2, roll: 0.1, distance: 8.0 };
        let points = [[0.0, 1.0, 0.0], [0.0, 1.0, 0.5]];
        let flat = Camera::new(orbit.view(), orthographic(120.0, [640, 480], 0.1, 100.0), [640, 480]).unwrap();
        assert!((true_lengths(&points, &[[0, 1]], &flat)[0] - 60.0).abs() < 1e-9);
        let deep = Camera::new(orbit.view(), perspective(0.6, [640, 480], 0.1, 100.0), [640, 480]).unwrap();
        let scale = 240.0 / libm::tan(0.3) / deep.project([0.0, 1.0, 0.25])[2];
        assert!((true_lengths(&points, &[[0, 1]], &deep)[0] / (0.5 * scale) - 1.0).abs() < 1e-6);
    }
}
