use std::f64::consts::TAU;

use super::*;

/// Numbers that every language makes alike: Knuth's congruential generator, its upper 53 bits.
fn series(mut seed: u64, n: usize, k: usize, low: f64, high: f64) -> Series {
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * ((seed >> 11) as f64 / (1u64 << 53) as f64)
    };
    let frames: Vec<Vec<f64>> = (0..n).map(|_| (0..k).map(|_| next()).collect()).collect();
    Series::new(&frames.iter().map(Vec::as_slice).collect::<Vec<_>>(), None).unwrap()
}

fn angles(seed: u64, n: usize) -> Series {
    series(seed, n, 8, -3.0, 3.0)
}

/// The sum over a path's pairs, each by its place: no two paths are likely to have the same.
fn checksum(path: &[[usize; 2]]) -> usize {
    path.iter().enumerate().map(|(t, [i, j])| (t + 1) * (100 * i + j)).sum()
}

fn options(steps: Steps) -> Options {
    Options { steps, ..Options::default() }
}

fn band(steps: Steps, shape: BandShape, width: f64) -> Options {
    Options { band: Some(Band { shape, width }), ..options(steps) }
}

/// `dtw(C, step_pattern=..., ...)` of dtw-python 1.9.0 on NumPy 2.3's distances, summed dimension by dimension: cost and path.
#[test]
fn as_dtw_python_has_it() {
    use BandShape::{SakoeChiba, Slanted};
    use Steps::{Asymmetric, AsymmetricP1, AsymmetricP2, AsymmetricP05};
    use Steps::{Symmetric1, Symmetric2, SymmetricP1, SymmetricP2, SymmetricP05};
    let open = |steps, open_begin| Options { open_begin, open_end: true, ..options(steps) };
    let (small, large) = ((angles(1, 40), angles(2, 55)), (angles(3, 700), angles(4, 900)));
    let cases = [
        (&small, options(Symmetric1), 630.1773815227725, 3470440),
        (&small, options(Symmetric2), 956.8216120541233, 6600028),
        (&small, options(Asymmetric), 432.6771378750936, 2162990),
        (&small, open(Asymmetric, false), 413.1781193069569, 2148337),
        (&small, open(Asymmetric, true), 393.1724908390094, 2163169),
        (&small, open(Symmetric2, false), 764.6567085500093, 4455224),
        (&small, band(Symmetric1, Slanted, 6.0), 635.7170320066243, 4243840),
        (&small, band(Symmetric2, Slanted, 6.0), 1002.4411314195386, 7527100),
        (&small, band(Asymmetric, Slanted, 6.0), 436.31607153348835, 2162778),
        (&small, band(Symmetric1, SakoeChiba, 18.0), 630.1773815227725, 3470440),
        (&small, band(Symmetric2, SakoeChiba, 18.0), 982.9076875017213, 7076883),
        (&small, band(Asymmetric, SakoeChiba, 18.0), 432.6771378750936, 2162990),
        (&large, options(Symmetric1), 9597.709553741412, 19963420253),
        (&large, options(Symmetric2), 15487.458667787176, 31865056345),
        (&large, options(Asymmetric), 6841.451755802583, 11580671219),
        (&small, options(SymmetricP05), 1004.0070077542355, 4829047),
        (&small, open(SymmetricP05, false), 808.2372828522729, 3511953),
        (&small, options(SymmetricP1), 1079.4088105862902, 4416589),
        (&small, open(SymmetricP1, false), 834.0615014932105, 2881473),
        (&small, options(SymmetricP2), 1144.5044341007385, 4364945),
        (&small, open(SymmetricP2, false), 848.0101900602506, 2517431),
        (&small, options(AsymmetricP05), 422.61907497258824, 5816224),
        (&small, open(AsymmetricP05, false), 418.14565155053464, 4793547),
        (&small, options(AsymmetricP1), 457.89275529345065, 4567148),
        (&small, open(AsymmetricP1, false), 435.4546801351104, 2881394),
        (&small, options(AsymmetricP2), 483.56231806032633, 4371545),
        (&small, open(AsymmetricP2, false), 443.25779664851245, 2519371),
        (&large, options(SymmetricP05), 15995.299666223224, 26591936148),
        (&large, open(SymmetricP05, false), 14109.740817304948, 19890461014),
        (&large, options(SymmetricP1), 16618.918952115397, 23687344741),
        (&large, open(SymmetricP1, false), 15158.535985978042, 19305390730),
        (&large, options(SymmetricP2), 17552.31254317832, 20544443182),
        (&large, open(SymmetricP2, false), 15788.73388153227, 16807517764),
        (&large, options(AsymmetricP05), 6953.200159298177, 26868727284),
        (&large, open(AsymmetricP05, false), 6934.4689440295615, 24799109136),
        (&large, options(AsymmetricP1), 7237.716346697836, 23491378343),
        (&large, open(AsymmetricP1, false), 7165.787020846872, 19423151329),
        (&large, options(AsymmetricP2), 7702.238665483927, 20713744723),
        (&large, open(AsymmetricP2, false), 7445.780250819323, 16676159927),
    ];
    for ((target, source), options, cost, path) in cases {
        let found = dtw(target, source, Metric::Angle, &options).unwrap();
        assert_eq!((found.cost, checksum(&found.path)), (cost, path), "{options:?}");
    }
}

/// `dtw_ndim.distance(a, b, inner_dist='euclidean')` of dtaidistance 2.5.1.
#[test]
fn as_dtaidistance_has_it() {
    let found = dtw(&series(5, 40, 3, 0.0, 1.0), &series(6, 50, 3, 0.0, 1.0), Metric::Euclidean, &Options::default()).unwrap();
    assert!((found.cost - 25.202617504225998).abs() < 1e-13, "{}", found.cost);
}

/// The recursion as it is written, all sums kept.
fn plain(target: &Series, source: &Series, metric: Metric, steps: Steps, open_begin: bool) -> Vec<f64> {
    let costs = Costs::new(target, source, metric);
    let (n, m) = (target.len(), source.len());
    let mut sums = vec![vec![f64::INFINITY; m]; n];
    for i in 0..n {
        let mut c = vec![0.0; m];
        costs.row(i, 0, &mut c);
        for j in 0..m {
            let at = |di: usize, dj: usize| if i >= di && j >= dj { sums[i - di][j - dj] } else { f64::INFINITY };
            let twice = if steps == Steps::Symmetric2 { 2.0 * c[j] } else { c[j] };
            sums[i][j] = match steps {
                _ if i == 0 && (j == 0 || open_begin) => c[j],
                Steps::Asymmetric => (at(1, 0) + c[j]).min(at(1, 1) + c[j]).min(at(1, 2) + c[j]),
                _ => (at(1, 1) + twice).min(at(0, 1) + c[j]).min(at(1, 0) + c[j]),
            };
        }
    }
    sums.pop().unwrap()
}

/// Lengths about those of strips, bands and tiles, and both metrics: not a bit is lost.
#[test]
fn the_cost_has_the_bits_of_the_plain_recursion() {
    for (n, m) in [(1, 1), (1, 9), (9, 1), (2, 3), (7, 8), (16, 127), (127, 129), (128, 128), (129, 300), (257, 256), (300, 5)] {
        for (metric, k) in [(Metric::Angle, 8), (Metric::Angle, 3), (Metric::Euclidean, 8), (Metric::Euclidean, 2)] {
            let (target, source) = (series(7, n, k, -9.0, 9.0), series(8, m, k, -9.0, 9.0));
            for steps in [Steps::Symmetric1, Steps::Symmetric2, Steps::Asymmetric] {
                for open_begin in [false, true] {
                    let truth = plain(&target, &source, metric, steps, open_begin)[m - 1];
                    let options = Options { open_begin, ..options(steps) };
                    let found = dtw(&target, &source, metric, &options).map(|a| a.cost).unwrap_or(f64::INFINITY);
                    assert_eq!(found.to_bits(), truth.to_bits(), "{n} {m} {k} {options:?}: {found} {truth}");
                }
            }
        }
    }
}

/// What a path costs, step by step.
fn walked(path: &[[usize; 2]], target: &Series, source: &Series, steps: Steps) -> f64 {
    let costs = Costs::new(target, source, Metric::Angle);
    let mut before = None;
    path.iter().fold(0.0, |sum, &[i, j]| {
        let mut c = [0.0];
        costs.row(i, j, &mut c);
        let both = before.is_some_and(|[a, b]: [usize; 2]| a < i && b < j);
        before = Some([i, j]);
        sum + if both && steps == Steps::Symmetric2 { 2.0 * c[0] } else { c[0] }
    })
}

#[test]
fn paths_cost_what_is_said_of_them_and_take_the_steps_of_their_pattern() {
    let (target, source) = (angles(11, 500), angles(12, 620));
    for steps in [Steps::Symmetric1, Steps::Symmetric2, Steps::Asymmetric] {
        for open in [false, true] {
            let found = dtw(&target, &source, Metric::Angle, &Options { open_begin: open, open_end: open, ..options(steps) }).unwrap();
            assert_eq!(walked(&found.path, &target, &source, steps), found.cost, "{steps:?}");
            assert_eq!((found.path[0][0], found.path.last().unwrap()[0]), (0, 499));
            assert!(open || found.path[0][1] == 0 && found.path.last().unwrap()[1] == 619);
            for w in found.path.windows(2) {
                let step = [w[1][0] - w[0][0], w[1][1] - w[0][1]];
                let fits =
                    if steps == Steps::Asymmetric { step[0] == 1 && step[1] <= 2 } else { step.iter().all(|s| *s <= 1) && step != [0, 0] };
                assert!(fits, "{steps:?} {step:?}");
            }
        }
    }
}

#[test]
fn a_turn_more_or_less_is_the_same_angle_and_a_series_is_nothing_from_itself() {
    let target = angles(1, 60);
    let turned: Vec<Vec<f64>> =
        (0..60).map(|i| target_frame(&target, i).iter().map(|v| v + TAU * (i % 5) as f64 - TAU).collect()).collect();
    let turned = Series::new(&turned.iter().map(Vec::as_slice).collect::<Vec<_>>(), None).unwrap();
    let found = dtw(&target, &turned, Metric::Angle, &Options::default()).unwrap();
    assert!(found.cost < 1e-12 && found.path.iter().enumerate().all(|(t, p)| *p == [t, t]));
}

fn target_frame(series: &Series, i: usize) -> Vec<f64> {
    let costs = Costs::new(series, series, Metric::Euclidean);
    costs.a[i * costs.k..][..costs.k].to_vec()
}

#[test]
fn pins_are_passed() {
    let (target, source) = (angles(1, 40), angles(2, 55));
    for steps in [Steps::Symmetric1, Steps::Symmetric2, Steps::Asymmetric] {
        let free = dtw(&target, &source, Metric::Angle, &options(steps)).unwrap();
        let pinned = Options { pins: vec![[10, 18], [20, 21]], ..options(steps) };
        let found = dtw(&target, &source, Metric::Angle, &pinned).unwrap();
        assert!(found.path.contains(&[10, 18]) && found.path.contains(&[20, 21]) && found.cost > free.cost, "{steps:?}");
    }
    let crossed = Options { pins: vec![[10, 18], [20, 17]], ..options(Steps::Symmetric1) };
    assert!(matches!(dtw(&target, &source, Metric::Angle, &crossed), Err(DtwError::NoPath { .. })));
    let outside = Options { pins: vec![[40, 0]], ..Options::default() };
    assert_eq!(dtw(&target, &source, Metric::Angle, &outside), Err(DtwError::Pin { pin: [40, 0], n: 40, m: 55 }));
}

#[test]
fn what_cannot_be_aligned_is_refused() {
    let (some, none) = (angles(1, 4), Series::new(&[], None).unwrap());
    assert_eq!(dtw(&some, &none, Metric::Angle, &Options::default()), Err(DtwError::Empty { n: 4, m: 0, dims: 8 }));
    let other = series(1, 4, 3, 0.0, 1.0);
    assert_eq!(dtw(&some, &other, Metric::Angle, &Options::default()), Err(DtwError::Dimensions { target: 8, found: 3 }));
    let long = dtw(&some, &angles(2, 8), Metric::Angle, &options(Steps::Asymmetric));
    assert_eq!(long, Err(DtwError::NoPath { n: 4, m: 8, steps: Steps::Asymmetric }), "twice the speed is not enough");
    let narrow = dtw(&some, &angles(2, 8), Metric::Angle, &band(Steps::Symmetric1, BandShape::SakoeChiba, 2.0));
    assert!(matches!(narrow, Err(DtwError::NoPath { .. })));
    assert_eq!(Series::new(&[&[1.0], &[1.0, 2.0]], None), Err(SeriesError::Count { frame: 1, expected: 1, found: 2 }));
    assert!(matches!(Series::new(&[&[f64::INFINITY]], None), Err(SeriesError::NotFinite { frame: 0, .. })));
    assert!(matches!(Series::new(&[&[1.0]], Some(&[&[-1.0]])), Err(SeriesError::Weight { frame: 0, .. })));
}

#[test]
fn what_is_not_seen_counts_nothing() {
    let (n, k) = (30, 8);
    let whole: Vec<Vec<f64>> = (0..n).map(|i| (0..k).map(|d| libm::sin(0.3 * i as f64 + d as f64)).collect()).collect();
    let mut holed = whole.clone();
    for (i, frame) in holed.iter_mut().enumerate() {
        frame[i % k] = f64::NAN;
    }
    holed[12].fill(f64::NAN);
    let series = |frames: &[Vec<f64>]| Series::new(&frames.iter().map(Vec::as_slice).collect::<Vec<_>>(), None).unwrap();
    let found = dtw(&series(&holed), &series(&whole), Metric::Angle, &Options::default()).unwrap();
    assert!(found.cost < 1e-12 && found.path.iter().all(|[i, j]| i == j), "{found:?}");
}

/// With weights of 1 the mean is the sum, but for its last bits.
#[test]
fn weights_of_one_change_nothing() {
    let (target, source) = (angles(1, 40), angles(2, 55));
    let frames: Vec<Vec<f64>> = (0..40).map(|i| target_frame(&target, i)).collect();
    let frames: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
    let ones = vec![[1.0; 8].as_slice(); 40];
    let weighted = Series::new(&frames, Some(&ones)).unwrap();
    let [a, b] = [&target, &weighted].map(|t| dtw(t, &source, Metric::Angle, &Options::default()).unwrap());
    assert!((a.cost - b.cost).abs() < 1e-9 && a.path == b.path);
}

#[test]
fn each_drawing_has_one_frame_and_holds_are_held() {
    // The source runs at twice the drawings' rate, and waits in the middle; drawings are held for two frames.
    let path: Vec<[usize; 2]> = (0..12).flat_map(|i| [[i, 2 * i], [i, 2 * i + 1]]).collect();
    let twos = Drawings::new(12, |i| i % 2 == 1);
    let found = source_frames(&path, &twos, &[], 0.0);
    assert_eq!(found[..4], [1.5, 1.5, 5.5, 5.5]);
    let single = Drawings::new(12, |_| false);
    assert_eq!(source_frames(&path, &single, &[], 0.0)[..3], [0.5, 2.5, 4.5]);
    // Even steps are smooth already, and pins stand.
    let smooth = source_frames(&path, &single, &[[5, 9]], 2.0);
    assert!((smooth[0], smooth[5], smooth[11]) == (0.5, 9.0, 22.5), "{smooth:?}");
}

#[test]
fn smoothing_takes_the_stutter_and_never_runs_backwards() {
    let frames = [0, 0, 0, 4, 4, 8, 8, 8, 9, 20, 20, 21];
    let path: Vec<[usize; 2]> = frames.iter().enumerate().map(|(i, j)| [i, *j]).collect();
    let single = Drawings::new(12, |_| false);
    for sigma in [0.5, 1.0, 3.0, 40.0] {
        let found = source_frames(&path, &single, &[], sigma);
        assert!((found[0], found[11]) == (0.0, 21.0) && found.windows(2).all(|w| w[0] <= w[1]), "{sigma} {found:?}");
        let jerk = |f: &[f64]| f.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2)).sum::<f64>();
        assert!(jerk(&found) < jerk(&source_frames(&path, &single, &[], 0.0)));
    }
    assert_eq!(source_frames(&[[0, 3]], &Drawings::new(1, |_| false), &[], 2.0), [3.0]);
}

const SLOPES: [Steps; 6] =
    [Steps::SymmetricP05, Steps::SymmetricP1, Steps::SymmetricP2, Steps::AsymmetricP05, Steps::AsymmetricP1, Steps::AsymmetricP2];

/// Paths of patterns that limit the slope leave out no frame of either series, run no faster and no slower than they may, and pass through their pins.
#[test]
fn slopes_are_limited() {
    let (target, source) = (angles(11, 300), angles(12, 320));
    for steps in SLOPES {
        let most = match steps {
            Steps::SymmetricP05 | Steps::AsymmetricP05 => 2,
            _ => 1,
        };
        for open in [false, true] {
            let pins = if open { vec![[150, 170]] } else { vec![[40, 45], [200, 205]] };
            let asked = Options { pins: pins.clone(), open_begin: open, open_end: open, ..options(steps) };
            let found = dtw(&target, &source, Metric::Angle, &asked).unwrap();
            assert!(pins.iter().all(|p| found.path.contains(p)), "{steps:?}");
            assert_eq!((found.path[0][0], found.path.last().unwrap()[0]), (0, 299));
            assert!(open || found.path[0][1] == 0 && found.path.last().unwrap()[1] == 319);
            let moves: Vec<[usize; 2]> = found.path.windows(2).map(|w| [w[1][0] - w[0][0], w[1][1] - w[0][1]]).collect();
            assert!(moves.iter().all(|m| m.iter().all(|d| *d <= 1) && *m != [0, 0]), "{steps:?}");
            for along in [[0, 1], [1, 0]] {
                let longest = moves.split(|m| *m != along).map(<[_]>::len).max().unwrap_or(0);
                assert!(longest <= most, "{steps:?} {longest}");
            }
        }
        let long = dtw(&angles(1, 10), &angles(2, 40), Metric::Angle, &options(steps));
        assert_eq!(long, Err(DtwError::NoPath { n: 10, m: 40, steps }), "four times the speed is too much");
        let same = dtw(&target, &target, Metric::Angle, &options(steps)).unwrap();
        assert!(same.cost == 0.0 && same.path.iter().all(|[i, j]| i == j), "{steps:?}");
    }
}

/// A frame of the source may be where a path with an open beginning begins: the first among them, and a later one where that is better.
#[test]
fn slopes_begin_where_it_is_best() {
    let whole = angles(13, 90);
    let frames: Vec<Vec<f64>> = (0..90).map(|i| target_frame(&whole, i)).collect();
    let part = |from: usize| Series::new(&frames[from..from + 40].iter().map(Vec::as_slice).collect::<Vec<_>>(), None).unwrap();
    for (steps, from) in SLOPES.into_iter().flat_map(|s| [(s, 0), (s, 31)]) {
        let asked = Options { open_begin: true, open_end: true, ..options(steps) };
        let found = dtw(&part(from), &whole, Metric::Angle, &asked).unwrap();
        assert!(found.cost == 0.0 && found.path.iter().all(|[i, j]| i + from == *j), "{steps:?} {from} {found:?}");
    }
}
