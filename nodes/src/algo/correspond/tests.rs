use super::*;

fn ellipse(n: usize, centre: [f64; 2], [a, b]: [f64; 2]) -> Vec<[f64; 2]> {
    let at = |i: usize| {
        let (s, c) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
        [centre[0] + a * c, centre[1] + b * s]
    };
    (0..n).map(at).collect()
}

fn options() -> Options {
    Options { pairing: Pairing::Length, snap: 3.0, bridge: 6.0, spacing: 0.0, step: 0.0, missing: Missing::Error }
}

/// Every point at a vertex of its own.
fn vertices(n: usize) -> (Vec<[u32; 2]>, Vec<f64>) {
    ((0..n as u32).map(|i| [i; 2]).collect(), vec![0.0; n])
}

fn find(
    lines: &[Strand<'_>],
    visible: &[u8],
    drawn: &[Strand<'_>],
    anchors: &[Anchor],
    options: &Options,
) -> Result<Paired, CorrespondError> {
    let (edges, shares) = vertices(lines.iter().map(|l| l.points.len()).sum());
    pair(&MeshLines { strands: lines, visible, edges: &edges, shares: &shares }, drawn, anchors, options)
}

fn anchor(at: usize, drawn: [f64; 2]) -> Anchor {
    Anchor { spot: Some(Spot::point(at)), drawn }
}

fn strand(points: &[[f64; 2]], closed: bool) -> Strand<'_> {
    Strand { first: 0, points, closed }
}

#[test]
fn a_closed_line_goes_the_way_that_the_drawing_goes() {
    let (mesh, drawn) = (ellipse(80, [50.0, 50.0], [30.0, 30.0]), ellipse(300, [60.0, 40.0], [45.0, 25.0]));
    // A quarter and three quarters between two anchors: the longer way must not be cut short.
    let anchors = [(0, 0), (20, 75)].map(|(m, d)| anchor(m, drawn[d]));
    let found = find(&[strand(&mesh, true)], &[1; 80], &[strand(&drawn, true)], &anchors, &options()).unwrap();
    assert_eq!((found.sections, found.pairs.len()), (2, 78));
    for p in &found.pairs {
        let angle = std::f64::consts::TAU * f64::from(p.edge[0]) / 80.0;
        let truth = [60.0 + 45.0 * angle.cos(), 40.0 + 25.0 * angle.sin()];
        assert!(distance(p.drawn, truth) < 9.0, "{} at {:?}, not {truth:?}", p.edge[0], p.drawn);
    }
}

#[test]
fn a_way_goes_over_to_the_line_that_hides_its_own() {
    // A line that goes behind a second one two pixels off.
    let first: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i), 10.0]).collect();
    let second: Vec<[f64; 2]> = (0..40).map(|i| [21.0, 11.0 + f64::from(i)]).collect();
    let all = [first.clone(), second.clone()].concat();
    let lines = [Strand { first: 0, points: &first, closed: false }, Strand { first: 40, points: &second, closed: false }];
    let visible: Vec<u8> = (0..80).map(|i| u8::from(!(21..40).contains(&i))).collect();
    let drawn: Vec<[f64; 2]> = vec![[0.0, 0.0], [21.0, 0.0], [21.0, 40.0]];
    let anchors = [anchor(0, drawn[0]), anchor(79, drawn[2])];
    let found = find(&lines, &visible, &[strand(&drawn, false)], &anchors, &options()).unwrap();
    assert!(found.pairs.iter().any(|p| p.edge[0] < 21) && found.pairs.iter().any(|p| p.edge[0] >= 40));
    assert!(found.pairs.iter().all(|p| visible[p.edge[0] as usize] == 1 && all[p.edge[0] as usize][0] < 22.0));
    let error = find(&lines, &visible, &[strand(&drawn, false)], &anchors, &Options { bridge: 0.5, ..options() }).unwrap_err();
    assert_eq!(
        error.to_string(),
        "anchors 1 and 2: expected a way between them along the lines of the mesh, found none within gaps of 0.5 px"
    );
}

#[test]
fn corners_come_to_lie_on_corners() {
    let corner = |at: f64| vec![[0.0, 0.0], [at, 0.0], [at, 60.0]];
    let mesh: Vec<[f64; 2]> = (0..=100).map(|i| if i < 50 { [f64::from(i), 0.0] } else { [50.0, f64::from(i - 50)] }).collect();
    let drawn = corner(90.0);
    let anchors = [anchor(0, drawn[0]), anchor(100, drawn[2])];
    let at_corner = |pairing| {
        let found = find(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], &anchors, &Options { pairing, ..options() }).unwrap();
        distance(found.pairs.iter().find(|p| p.edge[0] == 50).unwrap().drawn, [90.0, 0.0])
    };
    assert!(at_corner(Pairing::Length) > 10.0);
    assert!(at_corner(Pairing::Corners) < 3.0, "{}", at_corner(Pairing::Corners));
}

#[test]
fn an_anchor_is_of_the_nearest_of_curves_that_run_close_by() {
    // Two lines of the mesh, drawn two pixels from each other, less than an anchor may be off: eyes that nearly touch.
    let [left, right] = [0.0, 40.0].map(|x| (0..=50).map(|i| [x, f64::from(i)]).collect::<Vec<_>>());
    let lines = [Strand { first: 0, points: &left, closed: false }, Strand { first: 51, points: &right, closed: false }];
    let drawn = [19.0, 21.0].map(|x| vec![[x, 0.0], [x, 50.0]]);
    let curves = [strand(&drawn[0], false), strand(&drawn[1], false)];
    let on = |at: usize, x: f64, y: f64| anchor(at, [x, y]);
    let ends = [on(0, 19.0, 0.0), on(50, 19.3, 50.0), on(51, 21.0, 0.0), on(101, 20.8, 50.0)];
    let found = find(&lines, &[], &curves, &ends, &options()).unwrap();
    assert_eq!((found.sections, found.pairs.len()), (2, 98));
    assert!(found.pairs.iter().all(|p| (p.drawn[0] - if p.edge[0] <= 50 { 19.0 } else { 21.0 }).abs() < 1e-9));
    // Where they meet it is of both.
    let cross = [vec![[0.0, 10.0], [50.0, 10.0]], vec![[25.0, 10.3], [25.0, 50.0]]];
    let mesh: Vec<[f64; 2]> = (0..=50).map(|i| [f64::from(i), 10.0]).chain((1..=40).map(|i| [25.0, 10.0 + f64::from(i)])).collect();
    let tee = [Strand { first: 0, points: &mesh[..51], closed: false }, Strand { first: 51, points: &mesh[51..], closed: false }];
    let ends = [on(0, 0.0, 10.0), on(25, 25.0, 10.0), on(50, 50.0, 10.0), on(90, 25.0, 50.0)];
    assert_eq!(find(&tee, &[], &[strand(&cross[0], false), strand(&cross[1], false)], &ends, &options()).unwrap().sections, 3);
}

#[test]
fn anchors_away_from_curves_make_no_section_and_pairs_keep_their_distance() {
    let mesh: Vec<[f64; 2]> = (0..=100).map(|i| [f64::from(i), 0.0]).collect();
    let drawn = vec![[0.0, 5.0], [100.0, 5.0]];
    let on = |m: usize, x: f64, y: f64| anchor(m, [x, y]);
    let all_of = |anchors: &[Anchor], spacing| {
        find(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], anchors, &Options { spacing, ..options() }).unwrap()
    };
    assert_eq!(all_of(&[on(0, 0.0, 5.0), on(100, 100.0, 30.0)], 0.0), Paired::default());
    let all = all_of(&[on(0, 0.0, 5.0), on(100, 100.0, 5.0)], 0.0);
    assert!(all.pairs.iter().all(|p| distance(p.drawn, [f64::from(p.edge[0]), 5.0]) < 1e-9) && all.pairs.len() == 99);
    assert_eq!(all_of(&[on(0, 0.0, 5.0), on(100, 100.0, 5.0)], 10.0).pairs.len(), 9);
    assert_eq!(find(&[], &[], &[strand(&drawn, false)], &[], &options()).unwrap(), Paired::default());
}

#[test]
fn a_drawn_curve_is_followed_along_an_edge() {
    // One edge of 100 px, drawn as an arc: pairs at every 4 px of it, where the arc is at that share of its length.
    let mesh = [[0.0, 0.0], [100.0, 0.0]];
    let arc = |t: f64| [50.0 - 50.0 * (std::f64::consts::PI * t).cos(), 50.0 * (std::f64::consts::PI * t).sin()];
    let drawn: Vec<[f64; 2]> = (0..=1000).map(|i| arc(f64::from(i) / 1000.0)).collect();
    let anchors = [anchor(0, drawn[0]), anchor(1, drawn[1000])];
    let at = |step, spacing| {
        find(&[strand(&mesh, false)], &[], &[strand(&drawn, false)], &anchors, &Options { step, spacing, ..options() }).unwrap().pairs
    };
    assert_eq!((at(0.0, 0.0).len(), at(4.0, 0.0).len(), at(4.0, 9.0).len()), (0, 24, 7));
    for (i, p) in at(4.0, 0.0).iter().enumerate() {
        let share = (i + 1) as f64 / 25.0;
        assert_eq!(p.edge, [0, 1]);
        assert!((p.share - share).abs() < 1e-12 && distance(p.at, [100.0 * share, 0.0]) < 1e-9);
        assert!(distance(p.drawn, arc(share)) < 0.01, "{p:?}");
    }
}

#[test]
fn ways_go_over_where_long_segments_cross() {
    // A line of one segment goes behind another of one: no point of either is near the crossing.
    let (first, second) = ([[0.0, 10.0], [100.0, 10.0]], [[50.0, -50.0], [50.0, 60.0]]);
    let lines = [Strand { first: 0, points: &first, closed: false }, Strand { first: 2, points: &second, closed: false }];
    let drawn = [[0.0, 10.0], [50.0, 10.0], [50.0, 60.0]];
    let anchors = [anchor(0, drawn[0]), anchor(3, drawn[2])];
    let options = Options { step: 4.0, ..options() };
    let found = find(&lines, &[1, 0, 1, 1], &[strand(&drawn, false)], &anchors, &options).unwrap();
    assert!(found.pairs.len() >= 24 && found.pairs.iter().all(|p| distance(p.at, p.drawn) < 1e-9), "{:?}", found.pairs);
}

#[test]
fn a_drawing_that_is_the_render_moves_nothing() {
    // Two rings, one partly behind the other, and a short way through their middle; the drawing is the outline of both.
    let (left, right) = (ellipse(60, [50.0, 50.0], [30.0, 30.0]), ellipse(60, [90.0, 50.0], [30.0, 30.0]));
    let inside = |p: &[f64; 2], centre: f64| distance(*p, [centre, 50.0]) < 29.9;
    let bar: Vec<[f64; 2]> = (0..=20).map(|i| [70.0, 28.0 + 2.2 * f64::from(i)]).collect();
    let mut visible: Vec<u8> = left.iter().map(|p| u8::from(!inside(p, 90.0))).collect();
    visible.extend([1; 81]);
    let lines = [(0, &left, true), (60, &right, true), (120, &bar, false)].map(|(first, points, closed)| Strand { first, points, closed });
    // Round the left one from crossing to crossing, then round the right one.
    let corner = 30.0 * (1.0 - (20.0_f64 / 30.0).powi(2)).sqrt();
    let mut drawn = vec![[70.0, 50.0 + corner]];
    drawn.extend((0..60).map(|i| left[i]).filter(|p| !inside(p, 90.0)));
    drawn.push([70.0, 50.0 - corner]);
    drawn.extend((31..90).map(|i| right[i % 60]).filter(|p| !inside(p, 50.0)));
    let anchors = [anchor(30, left[30]), anchor(60, right[0])];
    let found = find(&lines, &visible, &[strand(&drawn, true)], &anchors, &options()).unwrap();
    assert_eq!(found.sections, 2);
    assert!(found.pairs.len() > 70);
    let worst = found.pairs.iter().map(|p| distance(p.at, p.drawn)).fold(0.0, f64::max);
    assert!(worst < 0.5, "{worst}");
}

#[test]
fn a_section_without_a_way_is_left_out_where_that_is_asked_for() {
    let mesh = [[0.0, 0.0], [10.0, 0.0], [0.0, 90.0], [10.0, 90.0], [20.0, 90.0]];
    let lines = [Strand { first: 0, points: &mesh[..2], closed: false }, Strand { first: 2, points: &mesh[2..], closed: false }];
    let drawn = [[0.0, 0.0], [0.0, 90.0], [20.0, 90.0]];
    let anchors = [anchor(0, drawn[0]), anchor(2, drawn[1]), anchor(4, drawn[2])];
    let found = find(&lines, &[], &[strand(&drawn, false)], &anchors, &Options { missing: Missing::Skip, ..options() }).unwrap();
    assert_eq!((found.sections, found.skipped, found.pairs.len()), (1, 1, 1));
    assert!(find(&lines, &[], &[strand(&drawn, false)], &anchors, &options()).is_err());
}

#[test]
fn the_nearest_spot_is_on_a_segment() {
    let mesh = [[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]];
    let (edges, shares) = vertices(3);
    let lines = [strand(&mesh, false)];
    let own = MeshLines { strands: &lines, visible: &[1, 1, 0], edges: &edges, shares: &shares };
    let (spot, off) = nearest_spot(&own, [40.0, 3.0]).unwrap();
    assert_eq!((spot, off), (Spot { from: 0, to: 1, share: 0.4 }, 3.0));
    assert_eq!(nearest_spot(&MeshLines { visible: &[0; 3], ..own }, [40.0, 3.0]), None);
    assert_eq!(nearest_spot(&own, [f64::NAN, 3.0]), None);
}
