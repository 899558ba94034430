//! Surfaces rounded where they are seen to be coarse: edges near silhouettes are split until their chords lie close enough to the smooth
//! surface that the mesh stands for.
//!
//! New vertices lie on the boundary curves of PN triangles (Vlachos, Peters, Boyd and Mitchell, *Curved PN triangles*, 2001); on a hard edge the curve
//! leaves its ends along the common direction of both sides, so that no gap opens. Flat faces and straight edges stay as they are.

use nalgebra::Vector3;

use super::camera::Camera;
use super::silhouette::bulge;
use super::surface::{Edge, NONE, Surface};

/// How often an edge is halved at the most.
const ROUNDS: usize = 4;

/// Triangles at which refinement ends.
const MOST: usize = 1 << 21;

/// Edges with n · v of less than this at an end, both of length one, are near a silhouette.
const GRAZING: f64 = 0.45;

/// Splits edges near silhouettes while their chords lie more than `tolerance` pixels off. New vertices come after the old ones; the result lists, for
/// each of them, the two vertices that it lies between. Cost: O(edges) a round.
pub fn refine(surface: &mut Surface, camera: &Camera, tolerance: f64) -> Vec<[u32; 2]> {
    let mut between = Vec::new();
    for _ in 0..ROUNDS {
        let middles = wanted(surface, camera, tolerance);
        if middles.iter().all(Option::is_none) || surface.triangles.len() > MOST {
            break;
        }
        between.extend(split(surface, &middles));
    }
    between
}

/// How far the middle of the smooth surface's edge lies from the middle of the chord.
fn rise(surface: &Surface, e: &Edge) -> Vector3<f64> {
    let [a, b] = e.ends.map(|v| surface.positions[surface.first[v as usize] as usize]);
    let normals = |half: u32| surface.end_normals(half).map(|n| surface.normals[n as usize]);
    match e.sides {
        [NONE, NONE] => Vector3::zeros(),
        [half, NONE] => {
            let [na, nb] = normals(half);
            bulge(a, b, na, nb, 0.5)
        }
        [NONE, half] => {
            let [nb, na] = normals(half);
            bulge(a, b, na, nb, 0.5)
        }
        [up, down] => {
            let ([na, nb], [mb, ma]) = (normals(up), normals(down));
            if na == ma && nb == mb { bulge(a, b, na, nb, 0.5) } else { crease_rise(a, b, [na, ma], [nb, mb]) }
        }
    }
}

/// The same for an edge with other normals at both its sides: its curve leaves each end along both sides at once.
fn crease_rise(a: Vector3<f64>, b: Vector3<f64>, at_a: [Vector3<f64>; 2], at_b: [Vector3<f64>; 2]) -> Vector3<f64> {
    let edge = b - a;
    let handle = |n: [Vector3<f64>; 2]| {
        let along = n[0].cross(&n[1]);
        let length_sq = along.norm_squared();
        // Sides that are nearly one surface have no common direction: their mean normal has.
        if length_sq > 1e-3 {
            along * (edge.dot(&along) / length_sq)
        } else {
            let mean = (n[0] + n[1]).try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
            edge - mean * edge.dot(&mean)
        }
    };
    let rise = (handle(at_a) - handle(at_b)) / 8.0;
    let most = edge.norm() / 4.0;
    if rise.norm() > most { rise * (most / rise.norm()) } else { rise }
}

/// The new point of each edge that is to be split.
fn wanted(surface: &Surface, camera: &Camera, tolerance: f64) -> Vec<Option<Vector3<f64>>> {
    let toward = camera.toward();
    let grazing = |half: u32| {
        half != NONE && {
            let (vertices, normals) = (surface.ends(half), surface.end_normals(half));
            let g = [0, 1].map(|k| {
                let sight = toward(&surface.positions[vertices[k] as usize]);
                surface.normals[normals[k] as usize].dot(&sight) / sight.norm().max(f64::MIN_POSITIVE)
            });
            g[0].abs().min(g[1].abs()) < GRAZING || (g[0] >= 0.0) != (g[1] >= 0.0)
        }
    };
    let turned = |e: &Edge| e.sides.contains(&NONE) || e.bend < 0.9;
    let place = |e: &Edge| {
        if !(e.sides.into_iter().any(grazing) || turned(e)) {
            return None;
        }
        let [a, b] = e.ends.map(|v| surface.positions[surface.first[v as usize] as usize]);
        let (middle, rise) = ((a + b) / 2.0, rise(surface, e));
        let ([x0, y0, d0], [x1, y1, d1]) = (camera.project(middle.into()), camera.project((middle + rise).into()));
        let off = libm::hypot(x1 - x0, y1 - y0);
        let seen = camera.is_orthographic() || (d0 > 0.0 && d1 > 0.0);
        (seen && off > tolerance && off.is_finite()).then_some(middle + rise)
    };
    surface.edges.iter().map(place).collect()
}

/// The pieces of a triangle whose sides k → k + 1 get a vertex in the middle where there is one.
fn pieces(t: [u32; 3], m: [Option<u32>; 3]) -> ([[u32; 3]; 4], usize) {
    let [a, b, c] = t;
    match m {
        [None, None, None] => ([t; 4], 1),
        [Some(p), None, None] => ([[a, p, c], [p, b, c], t, t], 2),
        [None, Some(p), None] => ([[b, p, a], [p, c, a], t, t], 2),
        [None, None, Some(p)] => ([[c, p, b], [p, a, b], t, t], 2),
        [Some(p), Some(q), None] => ([[a, p, c], [p, q, c], [p, b, q], t], 3),
        [None, Some(p), Some(q)] => ([[b, p, a], [p, q, a], [p, c, q], t], 3),
        [Some(q), None, Some(p)] => ([[c, p, b], [p, q, b], [p, a, q], t], 3),
        [Some(p), Some(q), Some(r)] => ([[a, p, r], [p, b, q], [r, q, c], [p, q, r]], 4),
    }
}

/// Splits edges at their new points, one or none for each. Lists what the new vertices lie between. Cost: O(n).
pub fn split(surface: &mut Surface, middles: &[Option<Vector3<f64>>]) -> Vec<[u32; 2]> {
    let halves = 3 * surface.triangles.len();
    let (mut vertex_of, mut normal_of) = (vec![NONE; halves], vec![NONE; halves]);
    let mut between: Vec<[u32; 2]> = Vec::new();
    let old = surface.edges.clone();
    for (e, middle) in surface.edges.iter().zip(middles) {
        let Some(middle) = middle else { continue };
        let joined = surface.first.len() as u32;
        surface.first.push(surface.positions.len() as u32);
        let mut last: Option<([u32; 2], u32)> = None;
        let mut last_normal: Option<([u32; 2], u32)> = None;
        for (side, half) in e.sides.into_iter().enumerate().filter(|(_, h)| *h != NONE) {
            let (t, k) = (half as usize / 3, half as usize % 3);
            // Both sides count from the same end, so that what they share is found again.
            let from = |ends: [u32; 2]| if side == 0 { ends } else { [ends[1], ends[0]] };
            let vertices = from([surface.triangles[t][k], surface.triangles[t][(k + 1) % 3]]);
            let normals = from([surface.normal_of[t][k], surface.normal_of[t][(k + 1) % 3]]);
            vertex_of[half as usize] = match last.filter(|l| l.0 == vertices) {
                Some((_, vertex)) => vertex,
                None => {
                    surface.positions.push(*middle);
                    surface.joined.push(joined);
                    between.push(vertices);
                    surface.positions.len() as u32 - 1
                }
            };
            last = Some((vertices, vertex_of[half as usize]));
            normal_of[half as usize] = match last_normal.filter(|l| l.0 == normals) {
                Some((_, normal)) => normal,
                None => {
                    let [a, b] = normals.map(|n| surface.normals[n as usize]);
                    surface.normals.push((a + b).try_normalize(1e-12).unwrap_or(a));
                    surface.normals.len() as u32 - 1
                }
            };
            last_normal = Some((normals, normal_of[half as usize]));
        }
    }
    let ends: Vec<[u32; 2]> = surface.edges.iter().zip(middles).filter(|(_, m)| m.is_some()).map(|(e, _)| e.ends).collect();
    rebuild(surface, &vertex_of, &normal_of);
    inherit(surface, &old, &ends);
    between
}

/// Pieces of an edge are bent as it was, and edges within a triangle not at all: slivers have no direction to tell it by. `ends` lists what the new
/// joined vertices lie between.
fn inherit(surface: &mut Surface, old: &[Edge], ends: &[[u32; 2]]) {
    let before = (surface.first.len() - ends.len()) as u32;
    let bend = |ends: [u32; 2]| old.get(old.partition_point(|e| e.ends < ends)).filter(|e| e.ends == ends).map_or(1.0, |e| e.bend);
    for e in &mut surface.edges {
        let [a, b] = e.ends;
        e.bend = match b.checked_sub(before).map(|i| ends[i as usize]) {
            None => bend(e.ends),
            Some(parent) if parent.contains(&a) => bend(parent),
            Some(_) => 1.0,
        };
    }
}

fn rebuild(surface: &mut Surface, vertex_of: &[u32], new_normal: &[u32]) {
    let n = surface.triangles.len();
    let (mut triangles, mut part, mut normals) = (Vec::with_capacity(2 * n), Vec::with_capacity(2 * n), Vec::with_capacity(2 * n));
    for t in 0..n {
        let middle = |of: &[u32]| [0, 1, 2].map(|k| Some(of[3 * t + k]).filter(|&v| v != NONE));
        let (corners, count) = pieces(surface.triangles[t], middle(vertex_of));
        let (bent, _) = pieces(surface.normal_of[t], middle(new_normal));
        triangles.extend_from_slice(&corners[..count]);
        normals.extend_from_slice(&bent[..count]);
        part.resize(triangles.len(), surface.part[t]);
    }
    (surface.triangles, surface.part, surface.normal_of) = (triangles, part, normals);
    surface.edges = surface.find_edges();
}

#[cfg(test)]
#[path = "refine_tests.rs"]
mod tests;
