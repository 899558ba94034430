//! Spheres and cylinders that become rounder, cubes that stay.

use super::*;
use crate::algo::camera::{Orbit, orthographic};
use crate::algo::solids::{cube, cylinder, sphere};
use crate::algo::surface::Part;

fn camera() -> Camera {
    let orbit = Orbit { target: [0.0; 3], azimuth: 0.5, elevation: 0.3, roll: 0.0, distance: 10.0 };
    Camera::new(orbit.view(), orthographic(100.0, [256, 256], 0.1, 100.0), [256, 256]).unwrap()
}

fn refined((positions, triangles): &(Vec<[f64; 3]>, Vec<[u32; 3]>)) -> (Surface, usize, Vec<[u32; 2]>) {
    let mut surface = Surface::new(&[Part { positions, triangles, normals: &[] }], 1.0).unwrap();
    let before = surface.positions.len();
    let between = refine(&mut surface, &camera(), 0.05);
    (surface, before, between)
}

/// No edge has a side missing, and none is met from the same side twice.
fn is_closed(surface: &Surface) -> bool {
    surface.edges.iter().all(|e| !e.open && !e.sides.contains(&NONE))
}

#[test]
fn a_sphere_becomes_rounder_near_its_silhouette_without_cracks() {
    let (ball, before, between) = refined(&sphere(16, 10));
    assert_eq!(between.len(), ball.positions.len() - before);
    assert!(!between.is_empty() && is_closed(&ball));
    for p in &ball.positions {
        assert!((p.norm() - 1.0).abs() < 0.003, "found {}", p.norm());
    }
    assert_eq!((ball.joined.len(), ball.normal_of.len()), (ball.positions.len(), ball.triangles.len()));
    for (t, corners) in ball.triangles.iter().enumerate() {
        for k in 0..3 {
            let truth = ball.positions[corners[k] as usize].normalize();
            assert!((ball.normals[ball.normal_of[t][k] as usize] - truth).norm() < 0.05);
        }
    }
}

#[test]
fn the_rims_of_a_cylinder_become_circles() {
    let (drum, _, between) = refined(&cylinder(12));
    assert!(!between.is_empty() && is_closed(&drum));
    for p in &drum.positions {
        let radius = libm::hypot(p.x, p.z);
        assert!(radius < 1e-12 || (radius - 1.0).abs() < 0.004, "found {radius}");
        assert!(radius < 1e-12 || (p.y.abs() - 1.0).abs() < 1e-12 || p.y.abs() < 1.0);
    }
}

#[test]
fn a_cube_stays_as_it_is() {
    assert!(refined(&cube()).2.is_empty());
}
