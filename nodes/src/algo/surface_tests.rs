//! Cubes, spheres, seams and triangles that are none.

use super::*;
use crate::algo::solids::{cube, sphere};

fn surface(positions: &[[f64; 3]], triangles: &[[u32; 3]], hard_deg: f64) -> Surface {
    Surface::new(&[Part { positions, triangles, normals: &[] }], f64::to_radians(hard_deg)).unwrap()
}

#[test]
fn a_cube_has_hard_edges_and_flat_faces() {
    let (positions, triangles) = cube();
    let cube = surface(&positions, &triangles, 30.0);
    assert_eq!((cube.first.len(), cube.edges.len()), (8, 18));
    assert!(cube.edges.iter().all(|e| !e.open && !e.sides.contains(&NONE)));
    assert_eq!(cube.edges.iter().filter(|e| e.bend < 0.5).count(), 12);
    for t in 0..12 {
        let face = cube.area_vector(t).normalize();
        assert!(cube.normal_of[t].iter().all(|&n| (cube.normals[n as usize] - face).norm() < 1e-12));
    }
}

#[test]
fn a_smooth_sphere_has_the_normals_of_the_sphere() {
    let (positions, triangles) = sphere(24, 16);
    let ball = surface(&positions, &triangles, 60.0);
    assert_eq!(ball.normals.len(), ball.first.len());
    for (t, corners) in ball.triangles.iter().enumerate() {
        for k in 0..3 {
            let truth = ball.positions[corners[k] as usize].normalize();
            assert!((ball.normals[ball.normal_of[t][k] as usize] - truth).norm() < 1e-9, "Max's weights are exact on spheres");
        }
    }
}

#[test]
fn vertices_at_the_same_place_are_joined_across_meshes() {
    let (a, b) = ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-0.0, 1.0, 0.0]]);
    let part = |positions| Part { positions, triangles: &[[0, 1, 2]], normals: &[] };
    let both = Surface::new(&[part(&a), part(&b)], 1.0).unwrap();
    assert_eq!(both.joined, [0, 1, 2, 1, 3, 2]);
    assert_eq!(both.part, [0, 1]);
    assert_eq!(both.edges.iter().filter(|e| e.open).count(), 4);
    assert_eq!(both.edges.iter().find(|e| e.ends == [1, 2]).unwrap().sides, [1, 5]);
}

#[test]
fn triangles_without_area_and_three_sheets_make_no_neighbours() {
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
    let fan = surface(&positions, &[[0, 1, 2], [0, 1, 3], [0, 1, 4], [2, 2, 0]], 60.0);
    let spine: Vec<_> = fan.edges.iter().filter(|e| e.ends == [0, 1]).collect();
    assert_eq!(spine.len(), 3);
    assert!(spine.iter().all(|e| !e.open && e.sides.contains(&NONE)));
    assert!(fan.normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-12));
}

#[test]
fn without_edges_there_are_still_normals() {
    let (positions, triangles) = sphere(12, 8);
    let part = Part { positions: &positions, triangles: &triangles, normals: &positions };
    let ball = Surface::without_edges(&[part], 1.0).unwrap();
    assert!(ball.edges.is_empty() && (ball.normals[5] - Vector3::from(positions[5])).norm() < 1e-12);
    assert_eq!(ball.normal_of, triangles);
    let bare = Surface::without_edges(&[Part { normals: &[], ..part }], 1.0).unwrap();
    assert!(!bare.edges.is_empty());
}

#[test]
fn what_is_no_surface_is_told_by_number() {
    let bad = [[0.0; 3], [0.0, f64::NAN, 1.0], [1.0; 3]];
    let error = Surface::new(&[Part { positions: &bad, triangles: &[], normals: &[] }], 1.0).unwrap_err();
    assert_eq!(error.to_string(), "mesh 0: expected finite positions, found vertex 1 at (0, NaN, 1)");
    let error = Surface::new(&[Part { positions: &[[0.0; 3]; 3], triangles: &[[0, 1, 3]], normals: &[] }], 1.0).unwrap_err();
    assert_eq!(error.to_string(), "mesh 0: expected vertices below 3, found triangle 0 of [0, 1, 3]");
    let empty = Surface::new(&[Part::default()], 1.0).unwrap();
    assert!(empty.edges.is_empty() && empty.normals.is_empty());
}
