//! Where else a motion is as it is at its examples: the distance of point clouds of joints, turned about the vertical and moved over the ground such that
//! they lie on each other as well as they may.
//!
//! **Source** Kovar, Gleicher, Pighin, *Motion Graphs*, SIGGRAPH 2002, section 3.1, equation 1 (the closed form); Li, Gleicher, Xu, Shum 2003, section 5, which
//! names the re-use of drawings at similar poses as work to do.

use nalgebra::Vector3;

use super::motion_warp::hermite;

/// Which way a figure looks, as poses are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Facing {
    /// The same way: a drawing is right for one view alone.
    Same,
    /// Any way: clouds are turned about the vertical first.
    Any,
}

/// How poses are compared, and how what is found fades.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Frames before and after each that are compared with it: how the figure moves, not only how it stands.
    pub window: usize,
    /// Distance, as a share of the figure's size, from which on poses are not alike.
    pub tolerance: f64,
    /// Frames before and after a find over which it comes and goes.
    pub transition: f64,
    /// Which way the figure looks.
    pub facing: Facing,
}

/// A frame that is like an example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Find {
    /// Its position in the motion.
    pub at: usize,
    /// How sure it is: 1 where it is the same, 0 at the tolerance.
    pub confidence: f64,
}

/// The distance of the frame `at` from the frame `example`, as a share of the size of the figure at the example: root of the mean square over the joints of a window, the
/// frames nearer to its middle counting more. Beyond the ends of the motion the last frame is held. Cost: O(window · joints).
pub fn distance(motion: &[Vec<Vector3<f64>>], example: usize, at: usize, search: &Search) -> f64 {
    let (w, last) = (search.window as i64, motion.len() as i64 - 1);
    let frame = |middle: usize, k: i64| &motion[(middle as i64 + k).clamp(0, last) as usize];
    let weights: Vec<f64> = (-w..=w).map(|k| (w + 1 - k.abs()) as f64).collect();
    let pairs =
        || (-w..=w).zip(&weights).flat_map(|(k, weight)| frame(example, k).iter().zip(frame(at, k)).map(move |(a, b)| (*weight, a, b)));
    let sum: f64 = pairs().map(|p| p.0).sum();
    if sum == 0.0 {
        return 0.0;
    }
    let middle_a: Vector3<f64> = pairs().map(|(w, a, _)| a * (w / sum)).sum();
    let middle_b: Vector3<f64> = pairs().map(|(w, _, b)| b * (w / sum)).sum();
    // Over the ground alone: who jumps is not who stands.
    let level = |v: Vector3<f64>| Vector3::new(v.x, 0.0, v.z);
    let (from_a, from_b) = (level(middle_a), level(middle_b));
    let (mut sine, mut cosine) = (0.0, 0.0);
    for (w, a, b) in pairs() {
        let (a, b) = (a - from_a, b - from_b);
        sine += w * (a.x * b.z - a.z * b.x);
        cosine += w * (a.x * b.x + a.z * b.z);
    }
    let length = libm::hypot(sine, cosine);
    let (s, c) = match search.facing {
        Facing::Any if length > 0.0 => (sine / length, cosine / length),
        _ => (0.0, 1.0),
    };
    let turned = |b: Vector3<f64>| Vector3::new(c * b.x + s * b.z, b.y, c * b.z - s * b.x);
    let (mut off, mut size) = (0.0, 0.0);
    for (w, a, b) in pairs() {
        off += w * ((a - from_a) - turned(b - from_b)).norm_squared();
        size += w * (a - middle_a).norm_squared();
    }
    if size > 0.0 { libm::sqrt(off / size) } else { 0.0 }
}

/// The frames that are nearest to an example among their neighbours, and near enough: the most alike first, none within `transition` frames of one that is more alike,
/// or of the example itself.
pub fn finds(distances: &[f64], example: usize, search: &Search) -> Vec<Find> {
    let n = distances.len();
    let least = |i: usize| {
        let before = i == 0 || distances[i - 1] > distances[i];
        before && distances[i..].iter().find(|d| **d != distances[i]).is_none_or(|d| *d > distances[i])
    };
    let mut order: Vec<usize> = (0..n).filter(|&i| distances[i] < search.tolerance && least(i)).collect();
    order.sort_by(|a, b| distances[*a].total_cmp(&distances[*b]).then(a.cmp(b)));
    let mut taken: Vec<usize> = vec![example];
    let mut out = Vec::new();
    for at in order {
        if taken.iter().all(|t| (at.abs_diff(*t) as f64) >= search.transition.max(1.0)) {
            taken.push(at);
            out.push(Find { at, confidence: hermite(1.0 - distances[at] / search.tolerance) });
        }
    }
    out
}

/// How much of an example there is at a frame for its finds: the most that any of them gives.
pub fn amount(finds: &[Find], at: usize, transition: f64) -> f64 {
    let one = |f: &Find| match at.abs_diff(f.at) as f64 {
        0.0 => f.confidence,
        away if away < transition => f.confidence * hermite(1.0 - away / transition),
        _ => 0.0,
    };
    finds.iter().map(one).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEARCH: Search = Search { window: 2, tolerance: 0.2, transition: 4.0, facing: Facing::Same };

    /// A figure of three joints that swings with a period of 20 frames and walks along x, or turns on the spot by `turn` a frame.
    fn figure(frame: usize, turn: f64) -> Vec<Vector3<f64>> {
        let t = frame as f64;
        let swing = libm::sin(t * std::f64::consts::TAU / 20.0);
        let (s, c) = (libm::sin(turn * t), libm::cos(turn * t));
        let walked = if turn == 0.0 { 0.1 * t } else { 0.0 };
        [[0.0, 1.0, 0.0], [0.2, 0.5, swing], [-0.2, 0.0, -swing]]
            .map(|[x, y, z]| Vector3::new(c * x + s * z + walked, y, c * z - s * x))
            .to_vec()
    }

    fn motion(turn: f64) -> Vec<Vec<Vector3<f64>>> {
        (0..70).map(|k| figure(k, turn)).collect()
    }

    fn distances(turn: f64, search: &Search) -> Vec<f64> {
        let motion = motion(turn);
        (0..motion.len()).map(|k| distance(&motion, 12, k, search)).collect()
    }

    #[test]
    fn a_walk_comes_back_to_its_example_every_period() {
        let d = distances(0.0, &SEARCH);
        assert!(d[12] == 0.0 && d[32] < 1e-12 && d[52] < 1e-12 && d[22] > 0.2, "{d:?}");
        let found = finds(&d, 12, &SEARCH);
        let frames: Vec<usize> = found.iter().map(|f| f.at).collect();
        assert!(frames.len() == 2 && frames.contains(&32) && frames.contains(&52), "{found:?}");
        assert!(found.iter().all(|f| f.confidence > 1.0 - 1e-9));
        assert!((amount(&found, 32, 4.0) - 1.0).abs() < 1e-9 && amount(&found, 36, 4.0) == 0.0 && amount(&found, 12, 4.0) == 0.0);
        assert!((amount(&found, 34, 4.0) - 0.5).abs() < 1e-9, "half way of a fade is half");
    }

    #[test]
    fn one_frame_alone_does_not_tell_there_from_back() {
        // At 18 the legs stand as at 12, on their way back.
        let (alone, window) = (Search { window: 0, ..SEARCH }, SEARCH);
        assert!(distances(0.0, &alone)[18] < 1e-12);
        assert!(distances(0.0, &window)[18] > 0.1);
    }

    #[test]
    fn who_has_turned_is_found_facing_any_way_alone() {
        let (same, any) = (distances(0.05, &SEARCH), distances(0.05, &Search { facing: Facing::Any, ..SEARCH }));
        assert!(any[32] < 1e-9 && same[32] > 0.2, "{} {}", any[32], same[32]);
        assert!((0..70).all(|k| any[k] <= same[k] + 1e-12), "the turn is the best one");
    }

    #[test]
    fn a_figure_without_a_size_and_one_without_joints_are_alike_everywhere() {
        let still = vec![vec![Vector3::zeros()]; 3];
        assert_eq!(distance(&still, 0, 2, &SEARCH), 0.0);
        assert_eq!(distance(&[vec![], vec![]], 0, 1, &SEARCH), 0.0);
        assert_eq!(finds(&[0.0; 9], 0, &SEARCH), [], "a plateau begins at the example");
    }
}
