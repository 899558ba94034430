//! Markers in whole graphs.

use std::sync::Arc;

use super::super::tests::{load, pictures};
use super::*;
use crate::algo::paint::hex;

/// Markers at given places as `io.read_value` gives them.
fn file(folder: &tempfile::TempDir, name: &str, points: &[[f64; 2]], names: &[&str]) -> String {
    let markers = Markers2 { points: points.to_vec(), names: names.iter().map(|n| (*n).to_owned()).collect() };
    let path = folder.path().join(format!("{name}.npz"));
    pegbar_engine::npz::write(&markers, false, std::fs::File::create(&path).unwrap()).unwrap();
    format!("\"{name}\": (type: \"io.read_value\", path: \"{}\", as: \"Markers2\"),", path.display())
}

const NAMES: [&str; 3] = ["left_shoulder", "left_elbow", "left_wrist"];
const PLACES: [[f64; 2]; 3] = [[10.5, 10.5], [30.5, 10.5], [30.5, 30.5]];
const NAN: [f64; 2] = [f64::NAN; 2];

/// A name, places and the names of those.
type Set<'a> = (&'a str, &'a [[f64; 2]], &'a [&'a str]);

/// The nodes of a picture of some sets; files are in the folder for as long as it is there.
fn graph(sets: &[Set<'_>], more: &str) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let nodes: String = sets.iter().map(|(name, points, names)| file(&folder, name, points, names)).collect();
    let references: Vec<String> = sets.iter().map(|(name, ..)| format!("\"@{name}\"")).collect();
    let out = format!("\"out\": (type: \"render.markers\", markers: [{}], size: (60, 40) {more})", references.join(", "));
    (folder, format!("{nodes} {out}"))
}

fn run(sets: &[Set<'_>], more: &str) -> Result<Arc<Image>, String> {
    let (_folder, nodes) = graph(sets, more);
    pictures(&nodes, 2).map(|mut p| p.remove(0))
}

fn pixel(image: &Image, x: usize, y: usize) -> [f32; 4] {
    image.samples()[(y * image.width() + x) * 4..][..4].try_into().unwrap()
}

#[test]
fn markers_and_limbs_lie_where_they_are() {
    let image = run(&[("a", &PLACES, &NAMES)], ", colors: [(0.0, 0.0, 1.0)]").unwrap();
    let blue = [0.0, 0.0, 1.0, 1.0];
    assert_eq!((image.width(), image.height()), (60, 40));
    for (x, y) in [(10, 10), (30, 10), (30, 30), (20, 10), (30, 20)] {
        assert_eq!(pixel(&image, x, y), blue, "({x}, {y})");
    }
    assert_eq!(pixel(&image, 20, 20), [0.0; 4]);
    let bare = run(&[("a", &PLACES, &NAMES)], ", limb_width: 0.0, point_size: 4.0").unwrap();
    assert_eq!(pixel(&bare, 20, 10), [0.0; 4]);
    let given = run(&[("a", &PLACES, &NAMES)], ", limbs: [(\"left_shoulder\", \"left_wrist\")], colors: [(0.0, 0.0, 1.0)]").unwrap();
    assert_eq!((pixel(&given, 20, 20), pixel(&given, 20, 10)), (blue, [0.0; 4]));
}

#[test]
fn what_is_not_seen_is_not_drawn() {
    let image = run(&[("a", &[PLACES[0], NAN, PLACES[2]], &NAMES)], "").unwrap();
    assert_eq!(pixel(&image, 30, 10), [0.0; 4]);
    assert!(pixel(&image, 10, 10)[3] > 0.99);
    assert!((12..28).any(|k| pixel(&image, k, k)[3] > 0.5) && (12..28).any(|k| pixel(&image, k, k)[3] < 0.5), "the limb over it is dashed");
    assert!(run(&[("a", &[NAN; 3], &NAMES)], ", names: all").unwrap().samples().iter().all(|v| *v == 0.0));
    assert!(run(&[("a", &[], &[])], "").unwrap().samples().iter().all(|v| *v == 0.0));
}

#[test]
fn sets_differ_in_colour_and_shape_and_are_joined() {
    let moved = PLACES.map(|[x, y]| [x + 15.0, y]);
    let more = r#", labels: ["a", "b"], errors: [("a", "b")], legend: none, limb_width: 0.0, shapes: [dot, ring], error_width: 2.0"#;
    let image = run(&[("a", &PLACES, &NAMES), ("b", &moved, &["left_wrist", "tail", "left_shoulder"])], more).unwrap();
    // The wrist goes to the first, the shoulder to the last of the other's.
    assert!(pixel(&image, 28, 20)[3] > 0.9, "from (30.5, 30.5) to (25.5, 10.5)");
    assert_eq!(pixel(&image, 10, 10)[0], hex(ON_FOOTAGE[0])[0], "the first of the palette");
    assert!(pixel(&image, 25, 10)[3] > 0.9, "the line ends in the middle of the ring");
}

#[test]
fn sets_are_brought_together_by_their_roots() {
    let moved = PLACES.map(|[x, y]| [x + 15.0, y + 3.0]);
    let sets: [Set<'_>; 2] = [("a", &PLACES, &NAMES), ("b", &moved, &NAMES)];
    let bare = r#", shapes: [dot], limb_width: 0.0, colors: [(0.0, 0.0, 1.0)]"#;
    let (apart, one) = (run(&sets, bare).unwrap(), run(&sets[..1], bare).unwrap());
    let together = run(&sets, &format!("{bare}, root: \"left_elbow\"")).unwrap();
    assert!(pixel(&apart, 45, 13)[3] > 0.9 && pixel(&together, 45, 13)[3] == 0.0);
    assert_eq!(pixel(&together, 10, 10), pixel(&one, 10, 10));
    let lost = run(&[("a", &PLACES, &NAMES), ("b", &[moved[0], NAN, moved[2]], &NAMES)], &format!("{bare}, root: \"left_elbow\"")).unwrap();
    assert!(pixel(&lost, 25, 13)[3] > 0.9, "a set that does not see it stays");
    assert_eq!(run(&sets, ", root: \"tail\"").err().unwrap(), "root: set 0: expected a marker \"tail\", found none");
}

#[test]
fn grounds_are_faded_and_drawings_see_through() {
    let (_folder, nodes) = graph(&[("a", &[], &[])], ", background: \"@red\", fade: 0.25");
    let red = r#""red": (type: "image.constant", size: (8, 8), color: (1.0, 0.0, 0.0, 1.0))"#;
    let image = pictures(&format!("{red}, {nodes}"), 1).unwrap().remove(0);
    assert_eq!((image.width(), image.height()), (8, 8));
    assert_eq!(pixel(&image, 3, 3), [1.0, 0.25, 0.25, 1.0]);
    let half = run(&[("a", &PLACES, &NAMES)], ", opacity: 0.5, background_color: (0.0, 0.0, 0.0, 1.0), colors: [(1.0, 1.0, 1.0)]").unwrap();
    assert_eq!(pixel(&half, 10, 10), [0.5, 0.5, 0.5, 1.0]);
}

#[test]
fn names_and_legends_are_written() {
    let dark = |image: &Image| image.samples().chunks_exact(4).filter(|p| p[3] > 0.9 && p[0] < 0.2 && p[1] < 0.2 && p[2] < 0.2).count();
    let plain = dark(&run(&[("a", &PLACES, &NAMES)], ", colors: [(1.0, 1.0, 1.0)], limb_width: 0.0, point_size: 0.5").unwrap());
    for more in [", names: first", ", names: all", ", labels: [\"ab\"]"] {
        let more = format!(", colors: [(1.0, 1.0, 1.0)], limb_width: 0.0, point_size: 0.5, text_size: 6.0 {more}");
        assert!(dark(&run(&[("a", &PLACES, &NAMES)], &more).unwrap()) > plain + 10, "{more}");
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_with_its_place() {
    let fails = |points: &[[f64; 2]], names: &[&str], more: &str| {
        run(&[("a", points, names), ("b", &PLACES, &["x", "y", "z"])], more).err().unwrap()
    };
    let infinite = [PLACES[0], [f64::INFINITY, 2.0], PLACES[2]];
    assert_eq!(
        fails(&infinite, &NAMES, ", labels: [\"drawn\"]"),
        "markers: set `drawn`, marker \"left_elbow\": expected a place, or NaN where it is not seen, found (inf, 2)"
    );
    let errors = ", labels: [\"a\", \"b\"], errors: [(\"a\", \"b\")]";
    assert_eq!(fails(&PLACES, &NAMES, errors), "errors: \"a\" to \"b\": expected markers of the same names in both, found none");
    assert_eq!(
        fails(&PLACES[..2], &[], errors),
        "errors: \"a\" to \"b\": expected as many markers where a set has no names, found 2 and 3"
    );
    assert_eq!(
        fails(&PLACES, &NAMES, ", limbs: [(\"left_shoulder\", \"tail\")]"),
        "limbs: expected a set with markers \"left_shoulder\" and \"tail\", found none"
    );
    assert_eq!(fails(&PLACES, &NAMES, ", labels: [\"a\"], errors: [(\"a\", \"c\")]"), "errors: expected labels of sets, found \"c\"");
    let (_folder, nodes) = graph(&[("a", &PLACES, &NAMES)], r#", labels: ["a", "a"]"#);
    let wrong = load(&nodes).err().unwrap();
    assert!(wrong.iter().any(|e| e.contains("expected one set of each label, found two \"a\"")), "{wrong:?}");
}
