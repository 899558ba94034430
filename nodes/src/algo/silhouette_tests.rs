//! Silhouettes of spheres and cubes, whose truth is known.

use super::*;
use crate::algo::solids::{Solid, cube, sphere};
use crate::algo::surface::Part;

fn surface((positions, triangles): &Solid, hard_deg: f64) -> Surface {
    Surface::new(&[Part { positions, triangles, normals: &[] }], f64::to_radians(hard_deg)).unwrap()
}

fn from(eye: [f64; 3]) -> impl Fn(&Vector3<f64>) -> Vector3<f64> {
    move |p| Vector3::from(eye) - p
}

fn all(surface: &Surface, eye: [f64; 3]) -> Vec<Chain> {
    chains(surface, from(eye), Lines::default(), |_| false)
}

#[test]
fn the_silhouette_of_a_sphere_is_one_circle() {
    let ball = surface(&sphere(32, 20), 60.0);
    let (eye, distance) = ([1.7, 2.2, 3.1], 17.34_f64.sqrt());
    let found = all(&ball, eye);
    assert_eq!(found.len(), 1);
    assert!(found[0].closed && found[0].kind == Kind::Silhouette && found[0].points.len() > 40);
    let axis = Vector3::from(eye) / distance;
    for p in &found[0].points {
        // The circle of tangency lies at 1 / d along the axis, with radius √(1 − 1 / d²).
        let along = p.smooth.dot(&axis);
        let across = (p.smooth - axis * along).norm();
        assert!((along - 1.0 / distance).abs() < 2e-3, "found {along}");
        assert!((across - (1.0 - 1.0 / 17.34_f64).sqrt()).abs() < 8e-4, "found {across}");
        let [a, b] = p.vertices.map(|v| ball.positions[v as usize]);
        assert!((a + (b - a) * p.t - p.position).norm() < 1e-15, "points lie on edges");
    }
}

#[test]
fn the_silhouette_of_a_cube_runs_along_its_edges() {
    let block = surface(&cube(), 30.0);
    let found = all(&block, [4.0, 5.0, 6.0]);
    let outlines: Vec<_> = found.iter().filter(|c| c.kind == Kind::Silhouette).collect();
    assert_eq!(outlines.len(), 1);
    assert!(outlines[0].closed && outlines[0].points.len() == 6, "a hexagon");
    let creases: usize = found.iter().filter(|c| c.kind == Kind::Crease).map(|c| c.points.len() - 1).sum();
    assert_eq!(creases, 6, "of twelve edges six are silhouettes");
}

#[test]
fn where_three_sheets_meet_a_silhouette_has_all_of_them_on_one_side() {
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
    let fan = surface(&(positions, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]), 60.0);
    let lines = Lines { silhouettes: true, borders: false, crease: None, seams: false, intersections: false };
    for (eye, count) in [([0.5, -1.0, 9.0], 1), ([0.5, 9.0, -1.0], 1), ([0.5, -5.0, 9.0], 1), ([0.5, 9.0, 5.0], 0)] {
        let found = chains(&fan, from(eye), lines, |_| false);
        let along = found.iter().filter(|c| c.points.iter().map(|p| p.vertices).eq([[0, 0], [1, 1]])).count();
        assert_eq!(along, count, "from {eye:?}");
    }
}

#[test]
fn borders_and_seams_are_lines_of_their_own() {
    let (a, b) = ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let part = |positions| Part { positions, triangles: &[[0, 1, 2]], normals: &[] };
    let square = Surface::new(&[part(&a), part(&b)], 1.0).unwrap();
    let found = all(&square, [0.5, 0.5, 9.0]);
    let kinds: Vec<_> = found.iter().map(|c| (c.kind, c.closed, c.points.len())).collect();
    assert_eq!(kinds, [(Kind::Border, true, 4), (Kind::Seam, false, 2)]);
}

#[test]
fn silhouettes_of_closed_surfaces_are_closed() {
    // Seven directions, hard and smooth: the boundary of what faces the eye has no end.
    for (solid, hard) in [(sphere(9, 7), 10.0), (sphere(9, 7), 33.0), (sphere(9, 7), 90.0), (cube(), 60.0), (cube(), 120.0)] {
        let solid = surface(&solid, hard);
        for k in 0..7 {
            let angle = f64::from(k) * 0.9 + 0.05;
            let eye = [5.0 * angle.cos(), 3.0 * (angle * 1.7).sin(), 5.0 * angle.sin()];
            let found = chains(
                &solid,
                from(eye),
                Lines { borders: false, crease: None, seams: false, intersections: false, silhouettes: true },
                |_| false,
            );
            assert!(!found.is_empty() && found.iter().all(|c| c.closed), "{hard} from {eye:?}");
        }
    }
}

#[test]
fn nothing_has_no_lines() {
    assert!(all(&Surface::default(), [0.0; 3]).is_empty());
}

#[test]
fn a_bulge_meets_the_circle() {
    let [a, b] = [0.0_f64, 0.5].map(|angle| Vector3::new(angle.cos(), angle.sin(), 0.0));
    for t in [0.0, 0.3, 0.5, 1.0] {
        let radius = (a + (b - a) * t + bulge(a, b, a, b, t)).norm();
        // The chord is 0.031 off; the cubic is within a twentieth of that.
        assert!((radius - 1.0).abs() < 1.6e-3, "found {radius} at {t}");
    }
}
