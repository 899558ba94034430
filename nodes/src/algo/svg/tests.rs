use std::f64::consts::{FRAC_1_SQRT_2, PI};

use proptest::prelude::*;

use super::*;
use crate::algo::paint::FillRule;

const FINE: Sampling = Sampling { tolerance: 1e-3, per_segment: 0 };

fn svg(body: &str) -> String {
    format!(
        "<svg xmlns='http://www.w3.org/2000/svg' xmlns:xlink='http://www.w3.org/1999/xlink' xmlns:inkscape='{INKSCAPE}' width='100' height='100'>{body}</svg>"
    )
}

fn scene(body: &str) -> Scene {
    read(&svg(body)).unwrap()
}

fn wrong(body: &str) -> String {
    read(&svg(body)).unwrap_err().to_string()
}

/// The points of every contour.
fn contours(body: &str, sampling: Sampling) -> Vec<Vec<Point>> {
    let lines = scene(body).elements.into_iter().flat_map(|e| e.lines);
    lines.map(|l| sampled(&[&l], sampling).unwrap().remove(0)).collect()
}

fn area(points: &[Point]) -> f64 {
    let n = points.len();
    let cross = |i: usize| points[i][0] * points[(i + 1) % n][1] - points[i][1] * points[(i + 1) % n][0];
    (0..n).map(cross).sum::<f64>() / 2.0
}

fn near(a: Point, b: Point, by: f64) -> bool {
    libm::hypot(a[0] - b[0], a[1] - b[1]) <= by
}

#[test]
fn basic_shapes_are_the_outlines_of_chapter_9() {
    let all = contours(
        "<rect x='1' y='2' width='3' height='4'/><polygon points='0,0 1,0 1,1'/><polyline points='0 0 1 0 1 1'/><line x1='1' y1='2' x2='3' y2='4'/>",
        FINE,
    );
    assert_eq!(all[0], [[1.0, 2.0], [4.0, 2.0], [4.0, 6.0], [1.0, 6.0]]);
    assert_eq!(all[1], [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]);
    assert_eq!(all[1], all[2]);
    assert_eq!(all[3], [[1.0, 2.0], [3.0, 4.0]]);
    let closed: Vec<bool> = scene("<rect width='3' height='4'/><line x2='3'/><polyline points='0 0 1 0'/>")
        .elements
        .iter()
        .map(|e| e.lines[0].closed)
        .collect();
    assert_eq!(closed, [true, false, false]);
}

#[test]
fn circles_and_ellipses_are_within_the_tolerance_of_their_area() {
    for tolerance in [0.5, 0.05, 1e-3, 1e-4] {
        let sampling = Sampling { tolerance, per_segment: 0 };
        let circle = &contours("<circle cx='50' cy='40' r='30'/>", sampling)[0];
        // Chords lie inside, nowhere further than the tolerance.
        let (whole, least) = (PI * 900.0, PI * (30.0 - tolerance) * (30.0 - tolerance));
        let found = area(circle);
        assert!(found < whole && found > least, "{tolerance}: {found} of {whole}");
        assert!(circle.iter().all(|p| (libm::hypot(p[0] - 50.0, p[1] - 40.0) - 30.0).abs() < 1e-12));
        // No more than twice as many as an even polygon of that tolerance needs.
        let fewest = PI / libm::acos(1.0 - tolerance / 30.0);
        assert!((circle.len() as f64) < 2.0 * fewest + 4.0, "{tolerance}: {} of {fewest}", circle.len());
    }
    let ellipse = &contours("<ellipse cx='50' cy='40' rx='30' ry='10' transform='rotate(30 50 40)'/>", FINE)[0];
    assert!((area(ellipse) - PI * 300.0).abs() < 0.2);
}

#[test]
fn rounded_rectangles_have_the_area_of_their_formula() {
    let area_of = |attributes: &str| area(&contours(&format!("<rect x='5' y='5' width='40' height='20' {attributes}/>"), FINE)[0]);
    let truth = |rx: f64, ry: f64| 800.0 - (4.0 - PI) * rx * ry;
    assert!((area_of("rx='6' ry='3'") - truth(6.0, 3.0)).abs() < 0.05);
    assert!((area_of("ry='4'") - truth(4.0, 4.0)).abs() < 0.05);
    // Radii of more than half a side are half a side.
    assert!((area_of("rx='100'") - truth(20.0, 10.0)).abs() < 0.05);
}

#[test]
fn arcs_end_where_they_say_on_the_ellipse_that_they_say() {
    // A quarter of a circle of 10 about (10, 0), each way round.
    let ends = |d: &str| {
        let points = contours(&format!("<path d='{d}'/>"), Sampling { tolerance: 1.0, per_segment: 2 }).remove(0);
        (points[0], points[1], points[2])
    };
    let half = 10.0 * FRAC_1_SQRT_2;
    let (start, middle, end) = ends("M0 0A10 10 0 0 1 10 -10");
    assert!(start == [0.0, 0.0] && end == [10.0, -10.0] && near(middle, [10.0 - half, -half], 1e-9), "{middle:?}");
    let (_, middle, end) = ends("M0 0a10 10 0 0 0 10 -10");
    assert!(end == [10.0, -10.0] && near(middle, [half, -10.0 + half], 1e-9), "{middle:?}");
    let (_, middle, _) = ends("M0 0A10 10 0 1 1 10 -10");
    assert!(near(middle, [-half, -10.0 - half], 1e-9), "{middle:?}");
    // Radii that do not reach are made to: half a circle of 5.
    let (_, middle, end) = ends("M0 0A1 1 0 0 1 10 0");
    assert!(end == [10.0, 0.0] && near(middle, [5.0, -5.0], 1e-9), "{middle:?}");
    // No radius is a straight line.
    assert_eq!(contours("<path d='M0 0A0 5 0 0 1 10 0'/>", FINE)[0], [[0.0, 0.0], [10.0, 0.0]]);
}

#[test]
fn all_commands_are_read_absolute_and_relative() {
    let pairs = [
        ("M1 2L3 4", "m1 2l2 2"),
        ("M1 2H5V9", "m1 2h4v7"),
        ("M1 2C3 4 5 6 7 9S9 1 2 2", "m1 2c2 2 4 4 6 7s2-8-5-7"),
        ("M1 2Q3 4 7 9T9 1", "m1 2q2 2 6 7t2-8"),
        ("M1 2A3 4 20 1 0 7 9", "m1 2a3 4 20 1 0 6 7"),
        ("M1 2L3 4Z L5 5", "m1 2l2 2zl4 3"),
        ("M1 2 3 4 5 1", "m1 2 2 2 2-3"),
    ];
    for (absolute, relative) in pairs {
        let [a, b] = [absolute, relative].map(|d| contours(&format!("<path d='{d}'/>"), FINE));
        assert_eq!(a.len(), b.len());
        a.iter().flatten().zip(b.iter().flatten()).for_each(|(p, q)| assert!(near(*p, *q, 1e-9), "{absolute}: {p:?} {q:?}"));
    }
    // What goes on smoothly after no curve starts straight.
    assert_eq!(scene("<path d='M0 0S5 5 9 9'/>").elements[0].lines[0].segments, [Segment::Cubic([0.0; 2], [5.0; 2], [9.0; 2])]);
    assert_eq!(scene("<path d='M0 0C0 0 1 2 3 3T9 9'/>").elements[0].lines[0].segments[1], Segment::Quad([3.0; 2], [9.0; 2]));
}

#[test]
fn a_line_that_comes_back_and_is_closed_has_its_first_point_once() {
    assert_eq!(contours("<path d='M0 0L5 0L5 5L0 0Z'/>", FINE)[0].len(), 3);
    assert_eq!(contours("<path d='M0 0L5 0L5 5L0 0'/>", FINE)[0].len(), 4);
    assert_eq!(contours("<path d='M0 0L5 0L5 5L1e-7 0Z'/>", FINE)[0].len(), 3);
    // A key that comes back beside one that does not keeps the point, so that both have as many.
    let lines: Vec<Subpath> =
        scene("<path d='M0 0L5 0L5 5L0 0Z'/><path d='M0 0L5 0L5 5L0 5Z'/>").elements.iter().map(|e| e.lines[0].clone()).collect();
    let both = sampled(&[&lines[0], &lines[1]], FINE).unwrap();
    assert_eq!([both[0].len(), both[1].len()], [4, 4]);
}

#[test]
fn keys_of_the_same_nodes_have_points_at_the_same_parameters() {
    let body = "<path d='M0 0C10 0 20 10 20 20L0 20Z'/><path d='M0 0C90 0 90 90 20 20L0 20Z'/>";
    let lines: Vec<Subpath> = scene(body).elements.iter().map(|e| e.lines[0].clone()).collect();
    let keys = sampled(&[&lines[0], &lines[1]], Sampling { tolerance: 0.1, per_segment: 0 }).unwrap();
    assert_eq!(keys[0].len(), keys[1].len());
    // As many as the one that bends more needs, and no fewer: its ends are nodes.
    let alone = sampled(&[&lines[1]], Sampling { tolerance: 0.1, per_segment: 0 }).unwrap();
    assert_eq!(keys[1], alone[0]);
    let n = keys[0].len() - 2;
    assert_eq!((keys[0][n], keys[1][n]), ([20.0, 20.0], [20.0, 20.0]));
    let evenly = sampled(&[&lines[0]], Sampling { tolerance: 0.1, per_segment: 5 }).unwrap();
    assert_eq!((evenly[0].len(), evenly[0][5], evenly[0][10]), (15, [20.0, 20.0], [0.0, 20.0]));
}

#[test]
fn what_differs_between_keys_is_said() {
    let lines = |d: &str| scene(&format!("<path d='{d}'/>")).elements.remove(0).lines;
    let said = |a: &str, b: &str| differs(&lines(a), &lines(b));
    assert_eq!(said("M0 0L5 5L9 0Z", "M0 0C1 1 2 2 5 5L9 0Z"), None);
    assert_eq!(said("M0 0L5 5L9 0Z", "M0 0L5 5Z").unwrap(), "2 segments in one and 1 in the other");
    assert_eq!(said("M0 0L5 5Z", "M0 0L5 5").unwrap(), "closed in one and open in the other");
    assert_eq!(said("M0 0L5 5M1 1L2 2", "M0 0L5 5").unwrap(), "2 lines in one and 1 in the other");
    assert_eq!(said("M0 0L5 5M1 1L2 2", "M0 0L5 5M1 1L2 2L3 3").unwrap(), "1 segments in one and 2 in the other in line 2");
}

#[test]
fn transforms_of_groups_add_up() {
    let body = "<g transform='translate(10 20)'><g transform='scale(2)'><polygon points='0,0 1,0 1,1'/></g></g>";
    assert_eq!(contours(body, FINE), [vec![[10.0, 20.0], [12.0, 20.0], [12.0, 22.0]]]);
    let turned = contours("<path transform='rotate(90 10 10)' d='M10 0L20 10'/>", FINE);
    assert!(near(turned[0][0], [20.0, 10.0], 1e-12) && near(turned[0][1], [10.0, 20.0], 1e-12));
    let skewed = contours("<path transform='skewX(45) matrix(1 2 3 4 5 6)' d='M1 1L0 0'/>", FINE);
    assert!(near(skewed[0][0], [9.0 + 12.0, 12.0], 1e-12));
    // The width of a line grows with the root of the area.
    assert_eq!(scene("<path transform='scale(2 8)' stroke='red' stroke-width='3' d='M0 0L1 1'/>").elements[0].style.width, 12.0);
}

#[test]
fn view_boxes_are_brought_to_pixels() {
    let points = |root: &str| {
        let scene = read(&format!("<svg xmlns='http://www.w3.org/2000/svg' {root}><path d='M10 10L60 60'/></svg>")).unwrap();
        (scene.size, sampled(&[&scene.elements[0].lines[0]], FINE).unwrap().remove(0))
    };
    assert_eq!(points("width='200px' height='100' viewBox='10 10 50 50'"), ([200.0, 100.0], vec![[50.0, 0.0], [150.0, 100.0]]));
    let stretched = "width='200' height='100' viewBox='10 10 50 50' preserveAspectRatio='none'";
    assert_eq!(points(stretched).1, [[0.0, 0.0], [200.0, 100.0]]);
    let cut = "width='200' height='100' viewBox='10 10 50 50' preserveAspectRatio='xMinYMax slice'";
    assert_eq!(points(cut).1, [[0.0, -100.0], [200.0, 100.0]]);
    assert_eq!(points("viewBox='10 10 50 40'"), ([50.0, 40.0], vec![[0.0, 0.0], [50.0, 50.0]]));
    assert_eq!(points("width='100%' height='100%' viewBox='0 0 50 40'").0, [50.0, 40.0]);
    assert_eq!(points("width='1in' height='25.4mm'").0, [96.0, 96.0]);
    assert_eq!(points("").0, [300.0, 150.0]);
}

#[test]
fn what_is_used_again_is_shown_where_it_is_used() {
    let body = "<defs><path id='a' d='M0 0L1 1'/><symbol id='s' viewBox='0 0 2 2'><use href='#a'/></symbol></defs>
        <use xlink:href='#a' x='5' y='6' transform='scale(2)'/><use href='#s' width='20' height='20'/><g id='never'><use href='#never'/></g>";
    let error = read(&svg(body)).unwrap_err().to_string();
    assert!(error.starts_with("line 2: expected at most 256 elements within each other"), "{error}");
    let found = contours(&body.replace("<use href='#never'/>", ""), FINE);
    assert_eq!(found, [[[10.0, 12.0], [12.0, 14.0]], [[0.0, 0.0], [10.0, 10.0]]]);
    assert!(wrong("<use href='#none'/>").contains("expected the id of an element"));
    // Nested drawings are at their place.
    assert_eq!(
        contours("<svg x='10' y='10' width='50' height='50' viewBox='0 0 5 5'><path d='M0 0L5 5'/></svg>", FINE)[0],
        [[10.0; 2], [60.0; 2]]
    );
}

#[test]
fn paint_is_inherited_and_the_nearest_word_counts() {
    let style = |body: &str| scene(body).elements.remove(0).style;
    let line = "<path d='M0 0L1 1'";
    assert_eq!(style(&format!("{line}/>")), Style { fill: [0.0, 0.0, 0.0, 1.0], stroke: [0.0; 4], width: 0.0, rule: FillRule::NonZero });
    let group = style(&format!(
        "<g fill='#ff0000' stroke='rgb(0,255,0)' stroke-width='3' fill-rule='evenodd' opacity='.5'>{line} fill-opacity='50%'/></g>"
    ));
    assert_eq!(group, Style { fill: [1.0, 0.0, 0.0, 0.25], stroke: [0.0, 1.0, 0.0, 0.5], width: 3.0, rule: FillRule::EvenOdd });
    // Attribute, then sheet by how specific, then the element's own style.
    let sheet = "<style>/* old */ path { fill: red } .b, .c { fill: lime } #p { fill: blue } g path { fill: black }</style>";
    let red = |s: &Style| [s.fill[0], s.fill[1], s.fill[2]];
    assert_eq!(red(&style(&format!("{sheet}{line} fill='white'/>"))), [1.0, 0.0, 0.0]);
    assert_eq!(red(&style(&format!("{sheet}{line} class='a b' fill='white'/>"))), [0.0, 1.0, 0.0]);
    assert_eq!(red(&style(&format!("{sheet}{line} class='b' id='p'/>"))), [0.0, 0.0, 1.0]);
    assert_eq!(red(&style(&format!("{sheet}{line} class='b' id='p' style='fill:#fff !important'/>"))), [1.0; 3]);
    assert_eq!(red(&style(&format!("<g color='red'>{line} fill='currentColor'/></g>"))), [1.0, 0.0, 0.0]);
    assert_eq!(style(&format!("{line} fill='none' stroke='none'/>")).fill, [0.0; 4]);
    let gradient =
        "<defs><linearGradient id='a'><stop offset='0' stop-color='#fff'/><stop offset='100%' style='stop-color:#000'/></linearGradient>
        <radialGradient id='b' xlink:href='#a'/><linearGradient id='r' href='#r'/></defs>";
    assert_eq!(style(&format!("{gradient}{line} fill='url(#b)'/>")).fill, [0.5, 0.5, 0.5, 1.0]);
    assert_eq!(style(&format!("{gradient}{line} fill='url(#gone) red'/>")).fill, [1.0, 0.0, 0.0, 1.0]);
    assert!(wrong(&format!("{gradient}{line} fill='url(#r)'/>")).contains("expected a gradient of the drawing"));
}

#[test]
fn what_is_not_seen_is_not_shown() {
    let line = "<path d='M0 0L1 1'/>";
    let body = format!(
        "<defs>{line}</defs><clipPath>{line}</clipPath><g display='none'>{line}</g><path style='display: none' d='M0 0L1 1'/><g visibility='hidden'>{line}</g><text>x</text>"
    );
    assert!(scene(&body).shown(None, None).is_empty());
    // A layer is shown though the drawing hides it, but not what is hidden in it.
    let body = format!("<g id='one'>{line}</g><g id='two' style='display:none'>{line}<g display='none'>{line}</g></g>");
    let scene = scene(&body);
    assert_eq!(scene.layers(), [0, 1]);
    assert_eq!((scene.shown(None, None).len(), scene.shown(Some(1), None).len(), scene.shown(None, Some("one")).len()), (1, 1, 1));
}

#[test]
fn layers_are_the_groups_of_the_drawing_or_of_the_one_that_holds_all() {
    let line = "<path id='p' d='M0 0L1 1'/>";
    let names = |body: &str| {
        let scene = scene(body);
        scene.layers().into_iter().map(|l| scene.groups[l].name.clone()).collect::<Vec<_>>()
    };
    let two = format!("<g inkscape:label='crouch'>{line}</g><g id='launch'>{line}</g>");
    assert_eq!(names(&two), ["crouch", "launch"]);
    assert_eq!(names(&format!("<g id='all'>{two}</g>")), ["crouch", "launch"]);
    assert_eq!(names(&format!("<g id='all'>{two}</g>{line}")), ["all"]);
    let nested = scene(&format!("<g id='frog'><g><g id='head'>{line}</g></g></g>"));
    assert_eq!(nested.groups_of(&nested.elements[0], None), ["frog", "head"]);
    assert_eq!(nested.groups_of(&nested.elements[0], Some(0)), ["head"]);
}

#[test]
fn mistakes_are_said_with_their_line() {
    assert!(read("not xml").unwrap_err().to_string().starts_with("expected an SVG drawing, found "));
    assert_eq!(read("<html/>").unwrap_err().to_string(), "expected an SVG drawing, found `html`");
    assert!(matches!(read("<svg xmlns='http://www.w3.org/2000/svg'><path d='M0 0L1"), Err(SvgError::Xml(_))));
    let cases = [
        ("<path d='M 0 0 L 1 x'/>", "line 2: expected path data as `M0 0 L10 0 L10 10 Z` in `d` of `path`, found `M 0 0 L 1 x`"),
        ("<path d='L1 1'/>", "line 2: expected path data as `M0 0 L10 0 L10 10 Z` in `d` of `path`, found `L1 1`"),
        ("<path d='M0 0L1e400 0'/>", "line 2: expected path data as `M0 0 L10 0 L10 10 Z` in `d` of `path`, found `M0 0L1e400 0`"),
        ("<path d='M0 0LNaN 0'/>", "line 2: expected path data as `M0 0 L10 0 L10 10 Z` in `d` of `path`, found `M0 0LNaN 0`"),
        ("<g transform='turn(3)'/>", "line 2: expected a transform as `translate(10 20)` in `transform` of `g`, found `turn(3)`"),
        ("<circle r='-1'/>", "line 2: expected a size of at least 0 in `r` of `circle`, found `-1`"),
        ("<circle r='1em'/>", "line 2: expected a length in px, in, cm, mm, pt, pc or % in `r` of `circle`, found `1em`"),
        ("<polygon points='0 0 1'/>", "line 2: expected pairs of numbers in `points` of `polygon`, found `0 0 1`"),
        ("<path fill='reddish' d='M0 0'/>", "line 2: expected a colour, `none` or `url(#id)` in `fill` of `path`, found `reddish`"),
        ("<path stroke-width='-2' d='M0 0'/>", "line 2: expected a width of at least 0 in `stroke-width` of `path`, found `-2`"),
        ("<path opacity='x' d='M0 0'/>", "line 2: expected a number from 0 to 1 in `opacity` of `path`, found `x`"),
    ];
    for (body, expected) in cases {
        assert_eq!(wrong(&format!("\n{body}")), expected);
    }
    let view = read("<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 0 5'/>").unwrap_err().to_string();
    assert_eq!(view, "line 1: expected four numbers, the last two above 0 in `viewBox` of `svg`, found `0 0 0 5`");
}

#[test]
fn what_grows_without_end_is_refused() {
    let entities: String = (1..30).map(|i| format!("<!ENTITY e{i} '{}'>", format!("&e{};", i - 1).repeat(10))).collect();
    let bomb = format!("<!DOCTYPE svg [<!ENTITY e0 'M0 0'>{entities}]><svg xmlns='http://www.w3.org/2000/svg'><path d='&e29;'/></svg>");
    assert!(matches!(read(&bomb), Err(SvgError::Xml(_))));
    let uses: String = (1..40).map(|i| format!("<g id='g{i}'><use href='#g{0}'/><use href='#g{0}'/></g>", i - 1)).collect();
    let error = wrong(&format!("<defs><path id='g0' d='M0 0'/>{uses}</defs><use href='#g39'/>"));
    assert!(error.contains("expected at most 1048576 elements"), "{error}");
    let error = wrong(&("<g>".repeat(300) + &"</g>".repeat(300)));
    assert!(error.contains("expected at most 256 elements within each other"), "{error}");
    let long = format!("<path d='M0 0{}'/>", "h1".repeat(10_000_000));
    assert_eq!(
        wrong(&long),
        format!("line 1: expected at most 4194304 segments in `d` of `path`, found `M0 0{}...`", "h1".repeat(16) + "h")
    );
    // A curve that needs more points than there may be.
    let wide = scene("<path d='M0 0C1e300 0 0 1e300 5 5'/>").elements.remove(0).lines;
    assert_eq!(sampled(&[&wide[0]], FINE), None);
}

#[test]
fn a_drawing_that_breaks_off_anywhere_is_refused() {
    let whole = svg(
        "<style>.a{fill:red}</style><g transform='rotate(3)'><path class='a' d='M0 0a1 2 3 0 1 4 5zL1 1'/><use href='#x'/></g><rect id='x' width='1'/>",
    );
    assert!(read(&whole).is_ok());
    (0..whole.len()).for_each(|n| assert!(read(&whole[..n]).is_err(), "{n}"));
}

proptest! {
    /// Whatever stands in the attributes, there is a drawing or an error.
    #[test]
    fn rough_attributes_are_read_or_refused(d in "[MmLlHhVvCcSsQqTtAaZz0-9 .,eE+-]{0,60}", t in "(translate|scale|rotate|skewX|matrix)\\([0-9eE., +-]{0,20}\\)", v in "[0-9eE. -]{0,20}", s in "[a-z:;#0-9().% -]{0,40}") {
        let body = format!("<svg viewBox='{v}'><g transform='{t}' style='{s}'><path d='{d}'/><polygon points='{v}'/><circle r='{v}'/></g></svg>");
        if let Ok(scene) = read(&svg(&body)) {
            for line in scene.elements.iter().flat_map(|e| &e.lines) {
                prop_assert!(line.is_finite());
                if let Some(points) = sampled(&[line], Sampling { tolerance: 1.0, per_segment: 0 }) {
                    prop_assert!(points[0].iter().flatten().all(|v| v.is_finite()));
                }
            }
        }
    }

    /// Chords are within the tolerance of the curve, which is looked at in many places.
    #[test]
    fn chords_are_within_the_tolerance(points in prop::collection::vec((-100.0..100.0f64, -100.0..100.0f64), 4), tolerance in 0.001..5.0f64) {
        let p: Vec<Point> = points.into_iter().map(|(x, y)| [x, y]).collect();
        for segment in [Segment::Cubic(p[1], p[2], p[3]), Segment::Quad(p[1], p[2])] {
            let line = Subpath { start: p[0], segments: vec![segment], closed: false };
            let chords = sampled(&[&line], Sampling { tolerance, per_segment: 0 }).unwrap().remove(0);
            for k in 0..=2000 {
                let at = segment.at(p[0], f64::from(k) / 2000.0);
                let nearest = chords.windows(2).map(|c| distance(at, c[0], c[1])).fold(f64::INFINITY, f64::min);
                prop_assert!(nearest <= tolerance * (1.0 + 1e-9), "{nearest} of {tolerance}");
            }
        }
    }

    /// Kurbo reads the same path data to the same places.
    #[test]
    fn paths_are_where_kurbo_has_them(numbers in prop::collection::vec(-50.0..50.0f64, 14), large: bool, sweep: bool) {
        let n: Vec<String> = numbers.iter().map(f64::to_string).collect();
        let d = format!(
            "M{} {}c{} {} {} {} {} {}A{} {} {} {} {} {} {}T9 9z",
            n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], u8::from(large), u8::from(sweep), n[11], n[12]
        );
        let ours = contours(&format!("<path d='{d}'/>"), FINE).remove(0);
        let theirs = kurbo::BezPath::from_svg(&d).unwrap();
        for p in ours {
            let nearest = kurbo::segments(theirs.iter())
                .map(|s| kurbo::ParamCurveNearest::nearest(&s, kurbo::Point::new(p[0], p[1]), 1e-6).distance_sq)
                .fold(f64::INFINITY, f64::min);
            // Kurbo's arcs are cubics within a tenth.
            prop_assert!(nearest.sqrt() < 0.15, "{p:?} is {} away in {d}", nearest.sqrt());
        }
    }
}

fn distance(p: Point, a: Point, b: Point) -> f64 {
    let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let square = d[0] * d[0] + d[1] * d[1];
    let t = if square > 0.0 { ((d[0] * e[0] + d[1] * e[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
    libm::hypot(e[0] - t * d[0], e[1] - t * d[1])
}
