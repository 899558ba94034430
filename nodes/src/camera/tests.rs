//! Camera nodes in graphs.

use std::path::Path;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::value::downcast;

use crate::algo::camera::Camera;
use crate::data;

/// The camera of `node`, or what is wrong with it.
fn camera(node: &str) -> Result<Camera, String> {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: 1, fps: 24), nodes: {{ \"out\": {node} }})");
    let loaded = load_text(Path::new("test.ron"), &text, &crate::registry(), &LoadOptions::default());
    let graph = loaded.graph.ok_or_else(|| loaded.diagnostics.iter().map(|d| d.message.clone()).collect::<String>())?;
    let port = Port { node: graph.find("out").unwrap(), output: 0 };
    let mut report = execute(&graph, &[], &[port], &Options::default()).unwrap();
    if let Some(failure) = report.failures.first() {
        return Err(failure.error.message.clone());
    }
    let value = report.kept.remove(&port).unwrap().remove(0).unwrap();
    Camera::try_from(&*downcast::<data::Camera>(value).unwrap()).map_err(|e| e.to_string())
}

#[test]
fn an_orthographic_camera_shows_its_scale() {
    let found =
        camera(r#"(type: "camera.orthographic", azimuth_deg: 90.0, scale: 50.0, size: (200, 100), target: (1.0, 2.0, 3.0))"#).unwrap();
    let [x, y, depth] = found.project([1.0, 3.0, 2.0]);
    assert!((x - 150.0).abs() < 1e-9 && (y - 0.0).abs() < 1e-9 && (depth - 10.0).abs() < 1e-9, "found {x}, {y}, {depth}");
}

#[test]
fn a_perspective_camera_shows_its_field_of_view_from_top_to_bottom() {
    let found = camera(r#"(type: "camera.perspective", fov_deg: 90.0, distance: 2.0, size: (200, 100))"#).unwrap();
    let [x, y, depth] = found.project([1.0, 2.0, 0.0]);
    assert!((x - 125.0).abs() < 1e-9 && y.abs() < 1e-9 && (depth - 2.0).abs() < 1e-9, "found {x}, {y}, {depth}");
}

#[test]
fn a_camera_comes_back_from_its_arrays() {
    let found = camera(r#"(type: "camera.perspective", azimuth_deg: 20.0, elevation_deg: 5.0, roll_deg: 3.0)"#).unwrap();
    assert_eq!(Camera::try_from(&data::Camera::from(&found)), Ok(found));
}

#[test]
fn settings_that_make_no_camera_are_refused() {
    let error = camera(r#"(type: "camera.perspective", near: 3.0, far: 2.0)"#).unwrap_err();
    assert_eq!(error, "expected `near` below `far`, both finite, `near` above 0 in perspective, found near 3, far 2");
    assert_eq!(camera(r#"(type: "camera.orthographic", scale: 0.0)"#).unwrap_err(), "expected a scale above 0, found 0");
    assert!(camera(r#"(type: "camera.orthographic", size: (0, 4))"#).is_err());
}
