//! The outermost outline of a mesh as a camera sees it: where the filled figure ends, in even pieces of the mesh's edges.
//!
//! An edge is a contour where the triangles at it are seen on one side of it alone; a piece of it is outline where nothing is seen on the other side.
//! Neither windings nor normals count, so that open, flat, and inside-out meshes have an outline too.
//!
//! **Source** Appel, *The notion of quantitative invisibility*, 1967 (contour edges); Isenberg and others, *A Developer's Guide to Silhouette Algorithms
//! for Polygonal Models*, 2003.

use nalgebra::{Vector2, Vector4};

use super::camera::Camera;
use super::surface::{NONE, Surface};

/// So far from an edge nothing may be seen, pixels: cracks that are narrower are none to the eye.
const CLEAR: f64 = 0.5;
/// Columns and rows of a tile, pixels.
const TILE: f64 = 8.0;
/// No edge has more pieces: one that ends next to the eye may be a million pixels long.
const MOST: f64 = 10_000.0;

/// A short piece of outline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// The vertices of its edge.
    pub ends: [u32; 2],
    /// Where its middle is on the edge in space: 0 at the first, 1 at the second.
    pub share: f64,
    /// Column and row of its middle.
    pub at: Vector2<f64>,
    /// Out of the figure, of length one.
    pub out: Vector2<f64>,
    /// Its length, pixels.
    pub length: f64,
}

/// Where a vertex is seen, and its distance from the eye's plane; `None` behind the near plane.
type Seen = Option<(Vector2<f64>, f64)>;

/// Triangles by the tiles of the picture that they may cover.
struct Tiles {
    columns: usize,
    rows: usize,
    by_tile: Vec<Vec<[Vector2<f64>; 3]>>,
}

impl Tiles {
    fn new(surface: &Surface, seen: &[Seen], size: [usize; 2]) -> Self {
        let [columns, rows] = size.map(|n| (n as f64 / TILE).ceil() as usize + 1);
        let mut tiles = Self { columns, rows, by_tile: vec![Vec::new(); columns * rows] };
        for t in &surface.triangles {
            // What reaches behind the near plane covers nothing.
            let [Some((a, _)), Some((b, _)), Some((c, _))] = t.map(|v| seen[v as usize]) else { continue };
            let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
            if high.x < 0.0 || high.y < 0.0 || low.x > size[0] as f64 || low.y > size[1] as f64 {
                continue;
            }
            let (first, last) = (tiles.tile(&low), tiles.tile(&high));
            for row in first[1]..=last[1] {
                (first[0]..=last[0]).for_each(|column| tiles.by_tile[row * columns + column].push([a, b, c]));
            }
        }
        tiles
    }

    /// The tile of a place, the nearest one for those outside.
    fn tile(&self, p: &Vector2<f64>) -> [usize; 2] {
        // Casts of floats to integers stay within bounds.
        [((p.x / TILE) as usize).min(self.columns - 1), ((p.y / TILE) as usize).min(self.rows - 1)]
    }

    fn is_covered(&self, p: &Vector2<f64>) -> bool {
        let [column, row] = self.tile(p);
        let within = |[a, b, c]: &[Vector2<f64>; 3]| {
            let sides = [side(a, b, p), side(b, c, p), side(c, a, p)];
            sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0)
        };
        self.by_tile[row * self.columns + column].iter().any(within)
    }
}

/// Twice the area of a triangle: on which side of the line from `a` to `b` a place is.
fn side(a: &Vector2<f64>, b: &Vector2<f64>, p: &Vector2<f64>) -> f64 {
    (b - a).perp(&(p - a))
}

/// The outline within the picture, in pieces of at most `step` pixels, in the order of the edges. Triangles that reach behind the near plane are left out.
/// Cost: O(n + pieces · triangles of a tile).
///
/// `positions` are those of the surface's vertices by now: its edges are found once, at rest.
pub fn outline(surface: &Surface, positions: &[[f64; 3]], camera: &Camera, step: f64) -> Vec<Piece> {
    let matrix = camera.clip_from_world();
    let look = |p: &[f64; 3]| -> Seen {
        let clip = matrix * Vector4::new(p[0], p[1], p[2], 1.0);
        (clip.w > 0.0 && clip.z >= -clip.w).then(|| (Vector2::from(camera.pixel(&clip)), clip.w))
    };
    let seen: Vec<Seen> = positions.iter().map(look).collect();
    let tiles = Tiles::new(surface, &seen, camera.size);
    let [width, height] = camera.size.map(|n| n as f64);
    let mut out = Vec::new();
    for edge in &surface.edges {
        let Some(half) = edge.sides.into_iter().find(|h| *h != NONE) else { continue };
        let ends = surface.ends(half);
        let [Some((a, wa)), Some((b, wb))] = ends.map(|v| seen[v as usize]) else { continue };
        // On which side of the edge its triangles are: one of no area, seen edge on, is on neither.
        let opposite = |half: u32| {
            let third = surface.triangles[half as usize / 3][(half as usize % 3 + 2) % 3];
            seen[third as usize].map_or(0.0, |(c, _)| side(&a, &b, &c))
        };
        let sides = edge.sides.map(|h| if h == NONE { 0.0 } else { opposite(h) });
        let Some(normal) = Vector2::new(b.y - a.y, a.x - b.x).try_normalize(1e-9) else { continue };
        if sides[0] * sides[1] < 0.0 || sides == [0.0; 2] {
            continue;
        }
        // The normal points to where a triangle would have a negative area.
        let normal = normal * (sides[0] + sides[1]).signum();
        let length = (b - a).norm();
        let count = (length / step).ceil().clamp(1.0, MOST);
        for k in 0..count as usize {
            let t = (k as f64 + 0.5) / count;
            let at = a + (b - a) * t;
            let within = at.x > 1.0 && at.y > 1.0 && at.x < width - 1.0 && at.y < height - 1.0;
            if within && !tiles.is_covered(&(at + normal * CLEAR)) {
                // What is even on the screen is not so in space where one end is further away.
                let share = t * wa / ((1.0 - t) * wb + t * wa);
                out.push(Piece { ends, share, at, out: normal, length: length / count });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::super::camera::{Orbit, orthographic, perspective};
    use super::super::surface::Part;
    use super::*;

    const BOX: [[u32; 4]; 6] = [[0, 1, 3, 2], [5, 4, 6, 7], [4, 0, 2, 6], [1, 5, 7, 3], [2, 3, 7, 6], [4, 5, 1, 0]];

    /// Corners of a box about a point, half as wide, high and deep as `half`.
    fn corners(middle: [f64; 3], half: [f64; 3]) -> Vec<[f64; 3]> {
        (0..8).map(|i: usize| [0, 1, 2].map(|k| middle[k] + if i >> k & 1 == 0 { -half[k] } else { half[k] })).collect()
    }

    fn boxes(n: u32, turned: bool) -> Vec<[u32; 3]> {
        let quads = (0..n).flat_map(|b| BOX.map(|q| q.map(|v| v + 8 * b)));
        let triangles = quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        triangles.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }).collect()
    }

    fn seen(azimuth: f64, projection: nalgebra::Matrix4<f64>) -> Camera {
        let orbit = Orbit { target: [0.0; 3], azimuth, elevation: 0.0, roll: 0.0, distance: 5.0 };
        Camera::new(orbit.view(), projection, [300, 200]).unwrap()
    }

    fn found(positions: &[[f64; 3]], triangles: &[[u32; 3]], camera: &Camera, step: f64) -> Vec<Piece> {
        let surface = Surface::new(&[Part { positions, triangles, normals: &[] }], PI).unwrap();
        outline(&surface, positions, camera, step)
    }

    #[test]
    fn a_box_has_the_sides_of_its_picture_in_even_pieces_whichever_way_it_is_wound() {
        let orbit = Orbit { target: [0.0; 3], azimuth: 0.3, elevation: 0.25, roll: 0.0, distance: 5.0 };
        let camera = Camera::new(orbit.view(), orthographic(50.0, [300, 200], 0.1, 100.0), [300, 200]).unwrap();
        let positions = corners([0.0; 3], [1.0, 0.8, 0.5]);
        let at = |i: usize| Vector2::from_fn(|k, _| camera.project(positions[i])[k]);
        // The picture of a box has each of its three edges twice.
        let around: f64 = [1, 2, 4].map(|i| 2.0 * (at(i) - at(0)).norm()).iter().sum();
        for turned in [false, true] {
            let pieces = found(&positions, &boxes(1, turned), &camera, 2.0);
            let whole: f64 = pieces.iter().map(|p| p.length).sum();
            assert!((whole - around).abs() < 1e-9, "{whole} {around}");
            for p in &pieces {
                assert!(p.length <= 2.0 && p.length > 1.7, "{p:?}");
                let beyond = (0..8).map(|i| (at(i) - p.at).dot(&p.out)).fold(f64::NEG_INFINITY, f64::max);
                assert!(beyond.abs() < 1e-9, "no corner is outside, and two are level with it: {beyond}");
            }
        }
    }

    #[test]
    fn a_piece_is_seen_where_its_share_of_the_edge_is() {
        let camera = seen(0.9, perspective(1.0, [300, 200], 0.1, 100.0));
        let positions = corners([0.2, 0.1, 0.0], [1.0, 0.3, 1.4]);
        let pieces = found(&positions, &boxes(1, false), &camera, 3.0);
        assert!(pieces.len() > 60);
        for p in &pieces {
            let [a, b] = p.ends.map(|v| positions[v as usize]);
            let [x, y, _] = camera.project([0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * p.share));
            assert!((p.at - Vector2::new(x, y)).norm() < 1e-9, "{p:?}");
        }
    }

    #[test]
    fn what_lies_within_the_figure_is_no_outline_and_a_sheet_has_one() {
        let camera = seen(0.0, orthographic(50.0, [300, 200], 0.1, 100.0));
        // A small box before a large one, and one that sticks out of it by half its width of 0.8.
        let mut positions = corners([0.0; 3], [1.0, 1.0, 0.5]);
        positions.extend(corners([0.0, 0.0, 1.0], [0.3; 3]));
        positions.extend(corners([1.0, 0.0, -1.0], [0.4; 3]));
        let whole: f64 = found(&positions, &boxes(3, false), &camera, 1.0).iter().map(|p| p.length).sum();
        // Box edges seen end on, front and back, lie on each other.
        assert!((whole - 2.0 * (400.0 + 40.0)).abs() < 5.0, "{whole}");
        let sheet = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        let whole: f64 = found(&sheet, &[[0, 1, 2], [0, 2, 3]], &camera, 1.0).iter().map(|p| p.length).sum();
        assert!((whole - 400.0).abs() < 1e-9, "{whole}");
        let edge_on = seen(FRAC_PI_2, orthographic(50.0, [300, 200], 0.1, 100.0));
        assert!(found(&sheet, &[[0, 1, 2], [0, 2, 3]], &edge_on, 1.0).iter().all(|p| p.at.iter().all(|v| v.is_finite())));
        // Out of the picture, and behind the eye.
        assert!(found(&corners([9.0, 0.0, 0.0], [1.0; 3]), &boxes(1, false), &camera, 1.0).is_empty());
        let near = seen(0.0, perspective(1.0, [300, 200], 0.1, 100.0));
        assert!(found(&corners([0.0, 0.0, 9.0], [1.0; 3]), &boxes(1, false), &near, 1.0).is_empty());
    }
}
