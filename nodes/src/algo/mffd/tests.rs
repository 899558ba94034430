use super::*;

/// Numbers from 0 to 1 that look random and are always the same (Vigna, SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.next()
    }
}

const DOMAIN: [f64; 4] = [0.0, 0.0, 128.0, 128.0];

/// Points of a picture of 128 pixels with moves of up to so many: most sets ask for folds.
fn wild(random: &mut Random, n: usize, far: f64) -> Vec<Datum> {
    let place = |random: &mut Random| [random.between(8.0, 120.0), random.between(8.0, 120.0)];
    let one = |_| {
        let from = place(random);
        let to = from.map(|v| (v + random.between(-far, far)).clamp(2.0, 126.0));
        Datum { from, to, weight: random.between(0.2, 1.0) }
    };
    (0..n).map(one).collect()
}

/// Points under a smooth map that folds nowhere: shears by waves one after another.
fn tame(random: &mut Random, n: usize) -> Vec<Datum> {
    let waves: Vec<(f64, f64, f64)> =
        (0..4).map(|_| (random.between(-6.0, 6.0), random.between(20.0, 40.0), random.between(0.0, 6.0))).collect();
    let map = |p: [f64; 2]| {
        waves.iter().enumerate().fold(p, |mut p, (k, (height, width, phase))| {
            p[k % 2] += height * libm::sin(p[1 - k % 2] / width + phase);
            p
        })
    };
    let one = |_| {
        let from = [random.between(12.0, 116.0), random.between(12.0, 116.0)];
        Datum { from, to: map(from), weight: 1.0 }
    };
    (0..n).map(one).collect()
}

#[test]
fn a_thousand_sets_fold_nowhere_and_most_of_them_would_if_levels_were_added() {
    let mut random = Random(1);
    let composed = Options::default();
    let added = Options { combine: Combine::Added, levels: 5, ..composed };
    let (mut n_folds, mut n_feasible) = (0, 0);
    for k in 0..1000 {
        let n = 2 + k % 9;
        // Every tenth set is one that a map without folds meets.
        let is_feasible = k % 10 == 0;
        let data = if is_feasible { tame(&mut random, n) } else { wild(&mut random, n, 15.0 + 5.0 * (k % 7) as f64) };
        let options = Options { levels: if is_feasible { 10 } else { 7 }, ..composed };
        let (ffd, fit) = Ffd::fit(&data, DOMAIN, &options).unwrap();
        let least = ffd.least_growth(DOMAIN, 33);
        assert!(least > 0.0, "set {k} of {n} folds: {least}");
        for d in &data {
            let (q, growth) = ffd.warp_and_growth(d.from);
            assert!(growth > 0.0 && (0..2).all(|k| (q[k] - ffd.warp(d.from)[k]).abs() < 1e-6));
        }
        if is_feasible {
            n_feasible += 1;
            assert!(fit.worst() < 1e-6, "set {k} of {n}: {}", fit.worst());
        } else {
            let (ffd, _) = Ffd::fit(&data, DOMAIN, &added).unwrap();
            n_folds += usize::from(ffd.least_growth(DOMAIN, 33) <= 0.0);
        }
    }
    assert!(n_feasible == 100 && n_folds >= 200, "{n_folds} of 1000 fold when levels are added");
}

#[test]
fn order_turned_round_is_left_in_the_residual() {
    let pair = |x: f64, to: f64| Datum { from: [x, 64.0], to: [to, 64.0], weight: 1.0 };
    // Between two that stand, one is to pass the other.
    let data = [pair(40.0, 40.0), pair(60.0, 72.0), pair(68.0, 60.0), pair(88.0, 88.0)];
    // Above and below, points that stand leave no way round.
    let wall = (0..24).flat_map(|k| [58.0, 70.0].map(|y| [34.0 + 2.5 * f64::from(k), y])).map(|p| Datum { from: p, to: p, weight: 1.0 });
    let data: Vec<Datum> = data.into_iter().chain(wall).collect();
    let (ffd, fit) = Ffd::fit(&data, DOMAIN, &Options::default()).unwrap();
    assert!(fit.worst() > 1.0 && ffd.least_growth([30.0, 50.0, 98.0, 78.0], 101) > 0.0, "{fit:?}");
    let off: Vec<f64> = data.iter().map(|d| length([ffd.warp(d.from)[0] - d.to[0], ffd.warp(d.from)[1] - d.to[1]])).collect();
    assert!(off.iter().zip(&fit.residuals).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn growth_is_the_determinant_of_differences() {
    let mut random = Random(5);
    for combine in [Combine::Composed, Combine::Added] {
        let (ffd, _) = Ffd::fit(&wild(&mut random, 9, 12.0), DOMAIN, &Options { combine, levels: 4, ..Options::default() }).unwrap();
        for _ in 0..200 {
            let [x, y] = [random.between(-20.0, 150.0), random.between(-20.0, 150.0)];
            let e = 1e-5;
            let by = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|k| (ffd.warp(b)[k] - ffd.warp(a)[k]) / (2.0 * e));
            let (dx, dy) = (by([x - e, y], [x + e, y]), by([x, y - e], [x, y + e]));
            let found = ffd.warp_and_growth([x, y]).1;
            assert!((dx[0] * dy[1] - dx[1] * dy[0] - found).abs() < 1e-5 * (1.0 + found.abs()), "{x} {y} {found}");
        }
    }
}

#[test]
fn far_outside_nothing_moves_and_weights_say_who_gives_way() {
    let datum = |to: f64, weight: f64| Datum { from: [64.0, 64.0], to: [to, 64.0], weight };
    let options = Options { levels: 3, ..Options::default() };
    let (ffd, fit) = Ffd::fit(&[datum(70.0, 3.0), datum(62.0, 1.0)], DOMAIN, &options).unwrap();
    assert!((ffd.warp([64.0, 64.0])[0] - 68.0).abs() < 1e-9, "the mean by weights: {:?}", ffd.warp([64.0, 64.0]));
    assert!((fit.residuals[0] - 2.0).abs() < 1e-9 && (fit.residuals[1] - 6.0).abs() < 1e-9);
    for p in [[-1e6, 64.0], [64.0, 1e9], [-300.0, -300.0], [f64::INFINITY, 0.0]] {
        assert_eq!(ffd.warp(p), p);
    }
    let (none, fit) = Ffd::fit(&[datum(70.0, 0.0)], DOMAIN, &options).unwrap();
    assert!(none.steps() == 0 && fit.residuals == [6.0] && none.warp([3.0, 4.0]) == [3.0, 4.0]);
    assert!(Ffd::fit(&[], DOMAIN, &options).unwrap().1.residuals.is_empty());
}

#[test]
fn a_grid_of_samples_is_what_each_sample_is() {
    let mut random = Random(11);
    for combine in [Combine::Composed, Combine::Added] {
        let (ffd, _) = Ffd::fit(&wild(&mut random, 20, 10.0), DOMAIN, &Options { combine, levels: 7, ..Options::default() }).unwrap();
        let size = [150, 141];
        let grid = ffd.displacements([-11.5, -6.5], size);
        for (k, d) in grid.iter().enumerate() {
            let p = [(k % size[0]) as f64 - 11.5, (k / size[0]) as f64 - 6.5];
            let q = ffd.warp(p);
            assert!((0..2).all(|n| (p[n] + f64::from(d[n]) - q[n]).abs() < 1e-4), "{combine:?} {p:?} {q:?} {d:?}");
        }
        assert_eq!(ffd.displacements([0.0, 0.0], [0, 3]).len(), 0);
    }
}

/// Places, moves and weights.
const POINTS: [([f64; 2], [f64; 2], f64); 12] = [
    ([20.375, 8.625], [0.34375, -0.34375], 0.375),
    ([1.25, 0.5], [1.5, 1.4375], 0.875),
    ([26.0, 29.25], [0.5625, 0.4375], 0.875),
    ([19.375, 23.375], [0.5625, -0.34375], 0.375),
    ([17.375, 29.875], [-1.09375, 0.65625], 0.875),
    ([26.125, 0.125], [0.0625, -0.5625], 0.25),
    ([27.375, 1.125], [-0.03125, 1.15625], 0.5),
    ([23.375, 5.625], [1.3125, -0.4375], 0.375),
    ([27.625, 17.375], [0.21875, -0.53125], 0.625),
    ([9.625, 13.5], [0.28125, -0.5], 0.875),
    ([0.875, 4.0], [-0.3125, 1.15625], 0.375),
    ([21.5, 20.75], [-0.8125, 0.375], 0.25),
];

/// What `BSplineScatteredDataPointSetToImageFilter` of ITK makes of them (32 bits; through antspyx 0.6.3: `fit_bspline_object_to_scattered_data(moves, places,
/// [0, 0], [1, 1], [33, 33], number_of_fitting_levels=..., mesh_size=[2, 3], spline_order=3, data_weights=weights)`) with one level and with four, at x of 5, 13,
/// 21, 29 and y of 2, 8, 14, 20, x first. Farther out its 32 bits do not hold the squares of small weights (1e-5), and at the border it looks inwards. Over four
/// levels it is 2.7e-5 from [`NUMPY`].
#[rustfmt::skip]
const ITK: [[[f64; 2]; 16]; 2] = [
    [[0.95252525806427, 0.9451398253440857], [0.6775410175323486, 0.4643462300300598], [0.42428863048553467, 0.23244813084602356], [0.27691635489463806, 0.2838886082172394], [0.6125436425209045, 0.38824567198753357], [0.5431334376335144, 0.04073084890842438], [0.45021554827690125, -0.11680363118648529], [0.3602921962738037, -0.05946898087859154], [0.28005334734916687, -0.04792901873588562], [0.31990373134613037, -0.21325039863586426], [0.33971139788627625, -0.29423433542251587], [0.32328322529792786, -0.27049094438552856], [0.05916702747344971, -0.09470348805189133], [0.0522954985499382, -0.10536783933639526], [0.11425116658210754, -0.1377904862165451], [0.2011195570230484, -0.17337557673454285]],
    [[0.8321258425712585, 1.1550122499465942], [0.6957250833511353, 0.44447061419487], [0.5760449171066284, 0.008970414288341999], [0.048945385962724686, 1.0730478763580322], [0.10398536920547485, 0.33347010612487793], [0.4413178265094757, -0.15308226644992828], [0.5100184082984924, -0.3593015670776367], [0.5854890942573547, -0.17186787724494934], [0.2284751534461975, -0.33621686697006226], [0.2758137881755829, -0.5288345813751221], [0.26975831389427185, -0.5443772077560425], [0.3139367997646332, -0.5258287787437439], [0.05379129946231842, -0.2101871222257614], [0.1383626013994217, -0.30024248361587524], [-0.7081992626190186, 0.25416168570518494], [0.09165618568658829, -0.2969207763671875]],
];

/// The same with four levels by NumPy 2 in 64 bits: eqs. 3 and 5 of Lee, Wolberg and Shin (1997) with weights, each level on what the sum of those before leaves.
#[rustfmt::skip]
const NUMPY: [[f64; 2]; 16] = [[0.8321251193890049, 1.155011048903996], [0.6957518297918203, 0.44445879280601025], [0.5760504601943317, 0.008967659857007456], [0.04894507850861867, 1.0730473935619524], [0.10396261252922792, 0.33346868988868567], [0.44131223177435186, -0.1530823434088524], [0.5100176724026536, -0.3593011992656688], [0.5854855639194515, -0.17186706167095483], [0.22847490652834992, -0.33621670560679123], [0.2758134606904479, -0.5288340801730923], [0.26975802555212, -0.5443768014135015], [0.3139349412323951, -0.5258279313354624], [0.05379182384163629, -0.2101875348337812], [0.1383633960819664, -0.3002427195950577], [-0.7081994851828728, 0.25416192830632206], [0.09165608637801533, -0.2969206258609099]];

#[test]
fn added_levels_are_those_of_itk_and_numpy() {
    let data = POINTS.map(|(from, by, weight)| Datum { from, to: [from[0] + by[0], from[1] + by[1]], weight });
    let check = |levels: usize, truth: &[[f64; 2]; 16], off: f64| {
        let options = Options { combine: Combine::Added, cells: [2, 3], levels, tolerance: 0.0, ..Options::default() };
        let (ffd, _) = Ffd::fit(&data, [0.0, 0.0, 32.0, 32.0], &options).unwrap();
        let places = [[5.0, 13.0, 21.0, 29.0], [2.0, 8.0, 14.0, 20.0]];
        for (k, truth) in truth.iter().enumerate() {
            let p = [places[0][k % 4], places[1][k / 4]];
            let q = ffd.warp(p);
            assert!((0..2).all(|n| (q[n] - p[n] - truth[n]).abs() < off), "{levels} {p:?}: {:?} {truth:?}", [q[0] - p[0], q[1] - p[1]]);
        }
    };
    check(1, &ITK[0], 1e-6);
    check(4, &ITK[1], 3e-5);
    check(4, &NUMPY, 1e-12);
}

#[test]
fn what_is_no_number_is_refused_by_position() {
    let fine = Datum { from: [1.0, 2.0], to: [3.0, 4.0], weight: 1.0 };
    let refused = |d: Datum| Ffd::fit(&[fine, d], DOMAIN, &Options::default()).unwrap_err().to_string();
    assert!(refused(Datum { to: [f64::NAN, 0.0], ..fine }).starts_with("point 1: expected finite places"));
    assert!(refused(Datum { weight: -1.0, ..fine }).starts_with("point 1: expected finite places"));
    let none = Ffd::fit(&[fine], [0.0, 0.0, 0.0, 5.0], &Options::default()).unwrap_err().to_string();
    assert!(none.starts_with("expected a rectangle of left < right"));
    let cells = Ffd::fit(&[fine], DOMAIN, &Options { cells: [0, 1], ..Options::default() }).unwrap_err().to_string();
    assert!(cells.starts_with("expected at least one cell each way"));
}
