use super::*;
use crate::algo::raster::Affine;
use crate::algo::smoothness::Smoothing;
use proptest::prelude::*;

/// Numbers in -1..1 from a seed.
pub(super) struct Rng(pub(super) u64);

impl Rng {
    pub(super) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Keys in a few directions that they share, so that many sets are nearly as good; and a shape near some of them.
fn correlated(k: usize, seed: u64) -> Problem {
    let (mut rng, rows) = (Rng(seed), 24);
    let shared: Vec<Vec<f64>> = (0..3).map(|_| (0..rows).map(|_| rng.next()).collect()).collect();
    let mut column = |own: f64| -> Vec<f64> {
        let mix = [rng.next(), rng.next(), rng.next()];
        (0..rows).map(|i| (0..3).map(|s| mix[s] * shared[s][i]).sum::<f64>() + own * rng.next()).collect()
    };
    let keys: Vec<Vec<f64>> = (0..k).map(|_| column(0.15)).collect();
    let shape = column(0.3);
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    Problem {
        gram: keys.iter().flat_map(|a| keys.iter().map(|b| product(a, b)).collect::<Vec<_>>()).collect(),
        linear: keys.iter().map(|a| product(a, &shape)).collect(),
        constant: product(&shape, &shape),
    }
}

/// Least cost on a set by trying every choice of which weights stand at which bound: `None` where no choice is feasible.
fn by_hand(problem: &Problem, set: &[usize], limits: Limits) -> Option<(f64, Vec<f64>)> {
    let (n, k) = (set.len(), problem.linear.len());
    let mut best: Option<(f64, Vec<f64>)> = None;
    for choice in 0..3usize.pow(n as u32) {
        let side: Vec<usize> = (0..n).map(|i| choice / 3usize.pow(i as u32) % 3).collect();
        let free: Vec<usize> = (0..n).filter(|&i| side[i] == 0).collect();
        let mut w: Vec<f64> = side.iter().map(|s| [0.0, limits.lower, limits.upper][*s]).collect();
        let m = free.len();
        let rest = 1.0 - w.iter().sum::<f64>();
        if m == 0 && rest.abs() > 1e-12 {
            continue;
        }
        let mut a = nalgebra::DMatrix::zeros(m + 1, m + 1);
        let mut b = nalgebra::DVector::zeros(m + 1);
        for (p, &i) in free.iter().enumerate() {
            for (q, &j) in free.iter().enumerate() {
                a[(p, q)] = problem.gram[set[i] * k + set[j]];
            }
            (a[(p, m)], a[(m, p)]) = (1.0, 1.0);
            b[p] = problem.linear[set[i]] - (0..n).map(|j| problem.gram[set[i] * k + set[j]] * w[j]).sum::<f64>();
        }
        b[m] = rest;
        if m > 0 {
            let Some(x) = a.lu().solve(&b) else { continue };
            free.iter().enumerate().for_each(|(p, &i)| w[i] = x[p]);
        }
        if w.iter().any(|w| *w < limits.lower - 1e-12 || *w > limits.upper + 1e-12) {
            continue;
        }
        let mut whole = vec![0.0; k];
        set.iter().zip(&w).for_each(|(i, w)| whole[*i] = *w);
        let cost = problem.cost(&whole);
        if best.as_ref().is_none_or(|b| cost < b.0) {
            best = Some((cost, whole));
        }
    }
    best
}

fn sets_of(n: usize, k: usize) -> Vec<Vec<usize>> {
    (0..1u32 << n).filter(|m| m.count_ones() as usize == k).map(|m| (0..n).filter(|i| m >> i & 1 == 1).collect()).collect()
}

fn solved(problem: &Problem, limits: Limits) -> (Certificate, Vec<f64>) {
    let k = problem.linear.len();
    let mut weights = vec![0.0; k];
    let certificate = Solver::new(k, limits).unwrap().solve(problem, &mut weights);
    (certificate, weights)
}

fn proven(found: &Certificate, weights: &[f64], limits: Limits) {
    assert!(found.finished && found.kkt < 1e-10, "{found:?}");
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    assert!(weights.iter().all(|w| (limits.lower..=limits.upper).contains(w)), "{weights:?}");
    assert!(weights.iter().filter(|w| **w != 0.0).count() <= limits.max_nonzero);
    assert!(found.lower_bound <= found.cost && found.cost - found.lower_bound < 1e-9 * (1.0 + found.cost), "{found:?}");
}

/// Recorded from quadprog 0.1.14 and Clarabel 0.11.1 (gaps and feasibility 1e-12) for six sets of contours under a motion, G and b divided
/// by the mean of G's diagonal: keys, points, lower, upper; points of the keys and of the shape; linear part, row by row, and translation;
/// weights of the one, weights of the other.
const PEERS: &[u8] = include_bytes!("../testdata/quadprog_clarabel_weights.f64");

#[test]
fn dense_weights_are_those_of_quadprog_and_clarabel() {
    let mut numbers = PEERS.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()));
    let (mut off, mut met) = (0.0f64, 0);
    while let Some(k) = numbers.next() {
        let mut take = |n: usize| numbers.by_ref().take(n).collect::<Vec<f64>>();
        let (k, n) = (k as usize, take(1)[0] as usize);
        let limits = Limits { max_nonzero: k, lower: take(1)[0], upper: take(1)[0] };
        let points = |flat: Vec<f64>| flat.as_chunks::<2>().0.to_vec();
        let (keys, shape, m) = (points(take(2 * k * n)), points(take(2 * n)), take(6));
        let motion = Affine::new(m[0], m[1], m[4], m[2], m[3], m[5]);
        let mut problem = Problem::default();
        KeySpace::new(k, &keys).unwrap().problem(&motion, &shape, &mut problem);
        let (found, weights) = solved(&problem, limits);
        proven(&found, &weights, limits);
        for peer in [take(k), take(k)] {
            off = weights.iter().zip(&peer).fold(off, |o, (a, b)| o.max((a - b).abs()));
        }
        met += weights.iter().filter(|w| **w == limits.lower || **w == limits.upper).count();
    }
    // Clarabel itself stops 5e-11 from quadprog.
    assert!(off < 1e-10 && met == 26, "{off}, {met} weights at bounds");
}

#[test]
fn every_set_of_keys_was_beaten_on_a_thousand_problems() {
    let (mut rounded_off, mut bounds_met) = (0, 0);
    for trial in 0..1000 {
        let (k, j) = (8 + trial as usize % 5, 2 + trial as usize / 5 % 3);
        let limits = Limits { max_nonzero: j, ..Limits::default() };
        let problem = correlated(k, trial);
        let (found, weights) = solved(&problem, limits);
        proven(&found, &weights, limits);
        let mut costs: Vec<(f64, Vec<usize>, Vec<f64>)> =
            sets_of(k, j).into_iter().filter_map(|s| by_hand(&problem, &s, limits).map(|(c, w)| (c, s, w))).collect();
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (cost, set, expected) = &costs[0];
        assert!((found.cost - cost).abs() < 1e-10 * (1.0 + cost), "trial {trial}: {} for {cost}", found.cost);
        let off = weights.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-8, "trial {trial}: {weights:?} for {expected:?}");
        assert!((0..k).all(|i| weights[i] == 0.0 || set.contains(&i)), "trial {trial}");
        let second = costs[1].0;
        assert!(found.runner_up <= second * (1.0 + 1e-10) + 1e-12, "trial {trial}: {} for {second}", found.runner_up);
        bounds_met += usize::from(weights.iter().any(|w| *w == limits.lower || *w == limits.upper));
        // What keeping the largest of the dense answer's weights would have cost.
        let (_, dense) = solved(&problem, Limits { max_nonzero: k, ..limits });
        let mut largest: Vec<usize> = (0..k).collect();
        largest.sort_by(|a, b| dense[*b].abs().total_cmp(&dense[*a].abs()));
        largest.truncate(j);
        rounded_off += usize::from(by_hand(&problem, &largest, limits).is_none_or(|(c, _)| c > cost * (1.0 + 1e-9)));
    }
    println!("keeping the largest weights of the dense answer is beaten in {rounded_off} of 1000, bounds are met in {bounds_met}");
    assert!(rounded_off >= 800, "keeping the largest weights is beaten in {rounded_off}");
    assert!(bounds_met > 50, "bounds were met in {bounds_met}");
}

#[test]
fn large_searches_are_bounded_and_exact() {
    // 142,506 sets: most are never looked at.
    let problem = correlated(30, 5);
    let limits = Limits { max_nonzero: 5, ..Limits::default() };
    let (found, weights) = solved(&problem, limits);
    proven(&found, &weights, limits);
    // No exchange of one key for another, and no key more, is better.
    let set: Vec<usize> = (0..30).filter(|&i| weights[i] != 0.0).collect();
    for out in 0..set.len() {
        for other in (0..30).filter(|i| !set.contains(i)) {
            let mut swapped = set.clone();
            swapped[out] = other;
            assert!(by_hand(&problem, &swapped, limits).is_none_or(|(c, _)| c >= found.cost - 1e-12));
        }
    }
}

proptest! {
    #[test]
    fn dense_answers_meet_the_conditions(seed in any::<u64>(), k in 1usize..25, lower in -1.0f64..=0.0, room in 0.0f64..2.0) {
        let limits = Limits { max_nonzero: k, lower, upper: 1.0 / k as f64 + room };
        let (found, weights) = solved(&correlated(k, seed), limits);
        proven(&found, &weights, limits);
    }

    #[test]
    fn more_keys_never_cost_more(seed in any::<u64>()) {
        let problem = correlated(9, seed);
        let costs: Vec<f64> = (1..=9).map(|j| solved(&problem, Limits { max_nonzero: j, ..Limits::default() }).0.cost).collect();
        prop_assert!(costs.windows(2).all(|c| c[1] <= c[0] + 1e-12), "{costs:?}");
    }

    #[test]
    fn the_order_of_the_keys_does_not_matter(seed in any::<u64>(), turn in 1usize..8) {
        let (problem, limits) = (correlated(8, seed), Limits::default());
        let mut other = problem.clone();
        for i in 0..8 {
            for j in 0..8 {
                other.gram[i * 8 + j] = problem.gram[(i + turn) % 8 * 8 + (j + turn) % 8];
            }
            other.linear[i] = problem.linear[(i + turn) % 8];
        }
        let ((_, a), (_, b)) = (solved(&problem, limits), solved(&other, limits));
        for i in 0..8 {
            prop_assert!((a[(i + turn) % 8] - b[i]).abs() < 1e-9);
        }
    }
}

#[test]
fn repeated_keys_count_once() {
    let single = correlated(3, 8);
    let mut repeated = Problem { gram: vec![0.0; 36], linear: vec![0.0; 6], constant: single.constant };
    for i in 0..6 {
        for j in 0..6 {
            repeated.gram[i * 6 + j] = single.gram[i / 2 * 3 + j / 2];
        }
        repeated.linear[i] = single.linear[i / 2];
    }
    for j in 1..=6 {
        let limits = Limits { max_nonzero: j, ..Limits::default() };
        let (found, weights) = solved(&repeated, limits);
        let (expected, _) = solved(&single, Limits { max_nonzero: j.min(3), ..limits });
        proven(&found, &weights, limits);
        // Two of a kind together may pass the bounds that one has.
        assert!(found.cost <= expected.cost + 1e-9, "{j}: {found:?} {expected:?}");
    }
}

#[test]
fn what_has_no_answer_is_said() {
    let text = |n, max_nonzero, lower, upper| Solver::new(n, Limits { max_nonzero, lower, upper }).unwrap_err().to_string();
    assert_eq!(text(0, 3, -0.5, 1.5), "expected at least one key, found none");
    assert_eq!(text(5, 2, -0.5, 0.4), "expected lower <= 0 and upper >= 1 / 2, so that 2 weights can add up to 1, found -0.5 and 0.4");
    assert!(text(5, 2, 0.1, 1.5).starts_with("expected lower <= 0"));
    assert!(text(5, 2, f64::NAN, 1.5).starts_with("expected lower <= 0"));
    let keys = [[0.0, 0.0], [1.0, 1.0], [2.0, f64::INFINITY], [3.0, 0.0]];
    assert_eq!(KeySpace::new(2, &keys).unwrap_err().to_string(), "expected finite keys, found (2, inf) at point 0 of key 1");
    let space = KeySpace::new(2, &[[0.0; 2]; 4]).unwrap();
    assert!(space.check(&[[0.0; 2]; 3]).unwrap_err().to_string().starts_with("expected 2 points, as the keys have, found 3"));
}

#[test]
fn the_gram_matrix_under_a_motion_is_that_of_the_moved_keys() {
    let mut rng = Rng(4);
    let keys: Vec<[f64; 2]> = (0..3 * 17).map(|_| [400.0 + 50.0 * rng.next(), 50.0 * rng.next()]).collect();
    let shape: Vec<[f64; 2]> = (0..17).map(|_| [100.0 * rng.next(), 90.0 * rng.next()]).collect();
    let m = Affine::new(0.9, -0.4, 12.0, 0.3, 1.2, -7.0);
    let (mut space, mut problem) = (KeySpace::new(3, &keys).unwrap(), Problem::default());
    space.problem(&m, &shape, &mut problem);
    for w in [[1.0, 0.0, 0.0], [0.2, -0.3, 1.1], [0.4, 0.4, 0.2]] {
        let mut mixed = vec![[0.0; 2]; 17];
        space.mix(&w, &mut mixed);
        let error: f64 = mixed
            .iter()
            .zip(&shape)
            .map(|(s, v)| (crate::algo::raster::apply(&m, (*s).into()) - nalgebra::Vector2::from(*v)).norm_squared())
            .sum();
        assert!((problem.cost(&w) - error).abs() < 1e-10 * error, "{} for {error}", problem.cost(&w));
    }
}

#[test]
fn deviations_are_those_of_repeated_noise() {
    let mut rng = Rng(21);
    let keys: Vec<[f64; 2]> = (0..4 * 30).map(|_| [50.0 * rng.next(), 50.0 * rng.next()]).collect();
    let (mut space, limits) = (KeySpace::new(4, &keys).unwrap(), Limits { max_nonzero: 3, ..Limits::default() });
    let truth = [0.5, 0.0, 0.3, 0.2];
    let (mut off, mut told, mut problem) = ([0.0; 4], [0.0; 4], Problem::default());
    for _ in 0..400 {
        let mut shape = vec![[0.0; 2]; 30];
        space.mix(&truth, &mut shape);
        shape.iter_mut().flatten().for_each(|v| *v += 3.0 * rng.next());
        space.problem(&crate::algo::raster::identity(), &shape, &mut problem);
        let (_, weights) = solved(&problem, limits);
        let (condition, deviations) = spread(&problem, &weights, limits, 60);
        assert!((1.0..10.0).contains(&condition));
        for i in 0..4 {
            off[i] += (weights[i] - truth[i]).powi(2);
            told[i] += deviations[i].powi(2);
        }
    }
    for i in [0, 2, 3] {
        assert!((off[i] / told[i] - 1.0).abs() < 0.25, "{off:?} {told:?}");
    }
    assert_eq!((off[1], told[1]), (0.0, 0.0));
    // Two keys that do the same: nobody knows which.
    let same = Problem { gram: vec![2.0; 4], linear: vec![1.0; 2], constant: 1.0 };
    assert_eq!(spread(&same, &[0.5, 0.5], limits, 60), (f64::INFINITY, vec![f64::INFINITY; 2]));
    assert_eq!(spread(&same, &[1.0, 0.0], limits, 60), (1.0, vec![0.0; 2]));
}

#[test]
fn smoothness_takes_out_jitter_and_keeps_the_extremes() {
    let (mut rng, k, n) = (Rng(11), 3, 60);
    let keys: Vec<Vec<f64>> = (0..k).map(|_| (0..40).map(|_| rng.next()).collect()).collect();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let truth: Vec<Vec<f64>> = (0..n)
        .map(|t| {
            let (s, c) = libm::sincos(f64::from(t) * std::f64::consts::TAU / 30.0);
            vec![0.4 + 0.4 * s, 0.3 + 0.3 * c, 0.3 - 0.4 * s - 0.3 * c]
        })
        .collect();
    let problems: Vec<Problem> = truth
        .iter()
        .map(|w| {
            let shape: Vec<f64> = (0..40).map(|i| (0..k).map(|j| w[j] * keys[j][i]).sum::<f64>() + 0.3 * rng.next()).collect();
            Problem {
                gram: keys.iter().flat_map(|a| keys.iter().map(|b| product(a, b)).collect::<Vec<_>>()).collect(),
                linear: keys.iter().map(|a| product(a, &shape)).collect(),
                constant: product(&shape, &shape),
            }
        })
        .collect();
    let mut solver = Solver::new(k, Limits { max_nonzero: 3, ..Limits::default() }).unwrap();
    let (mut weights, mut certificates) = (vec![vec![0.0; k]; n as usize], vec![Certificate::default(); n as usize]);
    for (t, p) in problems.iter().enumerate() {
        certificates[t] = solver.solve(p, &mut weights[t]);
    }
    let bend =
        |w: &[Vec<f64>]| -> f64 { w.windows(3).map(|w| (0..k).map(|j| (w[0][j] - 2.0 * w[1][j] + w[2][j]).powi(2)).sum::<f64>()).sum() };
    let peak = |w: &[Vec<f64>]| w.iter().map(|w| w[0]).fold(0.0, f64::max);
    let total = |w: &[Vec<f64>]| problems.iter().zip(w).map(|(p, w)| p.cost(w)).sum::<f64>() + 2.0 * sequence::unit(&problems) * bend(w);
    let (rough, before) = (bend(&weights), total(&weights));
    let smoothing = Smoothing { strength: 2.0, accents: 0.0 };
    let (_, still) = smooth(&mut solver, &problems, smoothing, &mut weights, &mut certificates, || Ok::<_, ()>(())).unwrap();
    assert!(still);
    assert!(bend(&weights) < rough / 5.0 && total(&weights) < before, "{} of {rough}", bend(&weights));
    assert!(peak(&weights) > 0.95 * peak(&truth), "{} of {}", peak(&weights), peak(&truth));
    // The least there is: no small change of two neighbouring frames lowers the total.
    let least = total(&weights);
    for t in 0..n as usize - 1 {
        for change in [1e-4, -1e-4] {
            let mut other = weights.clone();
            for frame in &mut other[t..t + 2] {
                frame[0] += change;
                frame[1] -= change;
            }
            assert!(total(&other) >= least - 1e-12);
        }
    }
}
