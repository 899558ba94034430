//! Graphs that draw meshes from files.

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::npz;
use pegbar_engine::value::ValueRef;

use super::super::tests::pictures;
use crate::data::{Image, Mesh};

/// A folder with the square from −1 to 1 that faces the eye, as `square.npz`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut mesh = Mesh {
        positions: vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
        triangles: Arc::new(vec![[0, 1, 2], [0, 2, 3]]),
        ..Mesh::default()
    };
    write(folder.path(), "square.npz", &mesh);
    mesh.positions.iter_mut().for_each(|p| *p = [p[0] * 0.5, p[1] * 0.5, 1.0]);
    write(folder.path(), "front.npz", &mesh);
    mesh.positions[2][1] = f64::NAN;
    write(folder.path(), "broken.npz", &mesh);
    write(folder.path(), "empty.npz", &Mesh::default());
    folder
}

fn write(folder: &Path, name: &str, mesh: &Mesh) {
    let value: ValueRef = Arc::new(mesh.clone());
    npz::write(value.as_ref(), false, std::fs::File::create(folder.join(name)).unwrap()).unwrap();
}

/// The picture of `render.toon` with these settings, 10 pixels a metre.
fn toon(folder: &Path, mesh: &str, settings: &str, threads: usize) -> Result<Arc<Image>, String> {
    let read = |name: &str| {
        format!("\"{name}\": (type: \"io.read_value\", path: \"{}\", as: \"Mesh\"), ", folder.join(format!("{name}.npz")).display())
    };
    let readers: String = ["square", "front", "broken", "empty"].map(read).concat();
    let camera = r#""camera": (type: "camera.orthographic", scale: 10.0, size: (40, 30))"#;
    let out = format!(r#""out": (type: "render.toon", mesh: {mesh}, camera: "@camera", {settings})"#);
    pictures(&format!("{readers}{camera}, {out}"), threads).map(|mut p| p.remove(0))
}

fn at(image: &Image, x: usize, y: usize) -> [f32; 4] {
    image.samples()[4 * (y * image.width() + x)..][..4].try_into().unwrap()
}

#[test]
fn meshes_are_drawn_in_their_colours_over_nothing() {
    let folder = folder();
    let flat =
        "colors: [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)], thresholds: [], shades: [(1.0, 1.0, 1.0)], outline_width: 0.0, crease_width: 0.0";
    let found = toon(folder.path(), r#"["@square", "@front"]"#, flat, 1).unwrap();
    assert_eq!((found.width(), found.height()), (40, 30));
    assert_eq!(at(&found, 20, 15), [0.0, 0.0, 1.0, 1.0]);
    assert_eq!(at(&found, 12, 7), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(at(&found, 5, 15), [0.0; 4]);
}

#[test]
fn borders_are_inked_unless_they_are_not_wanted() {
    let folder = folder();
    let dark = |settings: &str| {
        let found = toon(folder.path(), "\"@square\"", &format!("outline_width: 2.0, {settings}"), 1).unwrap();
        at(&found, 10, 15)[0] < 0.1 && at(&found, 9, 15)[3] > 0.9
    };
    assert!(dark("") && !dark("borders: false"));
}

#[test]
fn light_may_stand_still_or_go_with_the_camera() {
    let folder = folder();
    let red =
        |settings: &str| at(&toon(folder.path(), "\"@square\"", &format!("colors: [(1.0, 1.0, 1.0)], {settings}"), 1).unwrap(), 20, 15)[0];
    assert_eq!(red("light: (0.0, 0.0, 1.0)"), 1.0);
    assert!(red("light: (0.0, 0.0, -1.0)") < 0.5);
    assert!(red("light: (0.0, 0.0, -1.0), light_space: camera") < 0.5);
}

#[test]
fn nothing_is_a_picture_of_nothing() {
    let folder = folder();
    let found = toon(folder.path(), "\"@empty\"", "", 1).unwrap();
    assert!(found.samples().iter().all(|&v| v == 0.0) && found.width() == 40);
}

#[test]
fn what_cannot_be_drawn_is_told() {
    let folder = folder();
    let error = toon(folder.path(), r#"["@square", "@broken"]"#, "", 1).unwrap_err();
    assert_eq!(error, "mesh 1: expected finite positions, found vertex 2 at (0.5, NaN, 1)");
    let error = toon(folder.path(), "\"@square\"", "light: (0.0, 0.0, 0.0)", 1).unwrap_err();
    assert_eq!(error, "expected a light from some direction, found (0, 0, 0)");
}

#[test]
fn frames_have_the_same_bits_on_any_number_of_threads() {
    let folder = folder();
    let draw = |threads| toon(folder.path(), r#"["@square", "@front"]"#, "shadow_weight: 0.5", threads).unwrap();
    assert_eq!(draw(1), draw(3));
}
