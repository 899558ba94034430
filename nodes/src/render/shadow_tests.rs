//! Shadows of a square, whose place is known.

use std::sync::Arc;

use pegbar_engine::npz;
use pegbar_engine::value::ValueRef;

use super::super::tests::pictures;
use crate::data::{Image, Mesh};

/// The shadow of the level square of side 2 that floats a metre above the ground, seen from straight above, 10 pixels a metre.
fn shadow(settings: &str) -> Result<Arc<Image>, String> {
    let folder = tempfile::tempdir().unwrap();
    let mesh = Mesh {
        positions: vec![[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]],
        triangles: Arc::new(vec![[0, 1, 2], [0, 2, 3]]),
        ..Mesh::default()
    };
    let value: ValueRef = Arc::new(mesh);
    let path = folder.path().join("mesh.npz");
    npz::write(value.as_ref(), false, std::fs::File::create(&path).unwrap()).unwrap();
    let nodes = format!(
        r#""mesh": (type: "io.read_value", path: "{}", as: "Mesh"),
        "camera": (type: "camera.orthographic", elevation_deg: 90.0, scale: 10.0, size: (60, 40)),
        "out": (type: "render.shadow", mesh: "@mesh", camera: "@camera", color: (0.0, 0.0, 0.0), opacity: 0.5, {settings})"#,
        path.display()
    );
    pictures(&nodes, 1).map(|mut p| p.remove(0))
}

/// The rectangle of pixels that are half covered, [left, top, right, bottom], and the sum of their opacities.
fn seen(image: &Image) -> ([usize; 4], f32) {
    let (mut bounds, mut sum) = ([usize::MAX, usize::MAX, 0, 0], 0.0);
    for (i, p) in image.samples().chunks_exact(4).enumerate() {
        let (x, y) = (i % image.width(), i / image.width());
        sum += p[3];
        if p[3] > 0.25 {
            bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x + 1), bounds[3].max(y + 1)];
        }
    }
    (bounds, sum)
}

#[test]
fn a_shadow_lies_where_the_light_throws_it() {
    let (bounds, sum) = seen(&shadow("light: (0.0, 1.0, 0.0)").unwrap());
    assert_eq!(bounds, [20, 10, 40, 30]);
    assert!((sum - 200.0).abs() < 1e-3);
    // A light from the right throws it a metre to the left.
    assert_eq!(seen(&shadow("light: (1.0, 1.0, 0.0)").unwrap()).0, [10, 10, 30, 30]);
    // A ground two metres lower, twice that.
    assert_eq!(seen(&shadow("light: (0.5, 1.0, 0.0), ground: (0.0, -1.0, 0.0)").unwrap()).0, [10, 10, 30, 30]);
}

#[test]
fn a_soft_shadow_is_as_dark_in_all() {
    let (bounds, sum) = seen(&shadow("light: (0.0, 1.0, 0.0), softness: 1.5").unwrap());
    assert_eq!(bounds, [20, 10, 40, 30]);
    assert!((sum - 200.0).abs() < 0.1, "found {sum}");
}

#[test]
fn light_from_below_is_told() {
    let error = shadow("light: (1.0, -0.5, 0.0)").unwrap_err();
    assert_eq!(error, "expected a light from above the ground, found (1, -0.5, 0)");
    assert_eq!(shadow("normal: (0.0, 0.0, 0.0)").unwrap_err(), "expected a ground with a direction that is up, found (0, 0, 0)");
}
