//! The exact part of each pixel that a surface covers.
//!
//! All triangles are taken anticlockwise on the screen, so that the winding number counts layers. Where two neighbours are turned the same way
//! their common edge cancels; what is left are closed lines, few beside the triangles, whose non-zero fill is the union of all of them.

use kurbo::{BezPath, Point};
use nalgebra::Vector4;

use crate::algo::camera::Camera;
use crate::algo::surface::{NONE, Surface};
use crate::algo::zbuffer::{self, Projected};

/// Closed lines around all that is covered, pixels. Cost: O(n log n) for the lines, O(edges) to find them.
pub(super) fn outline(surface: &Surface, projected: &Projected, camera: &Camera) -> Vec<Vec<Point>> {
    let mut turn = vec![0_i8; surface.triangles.len()];
    for t in projected.triangles.iter().filter(|t| t.piece == zbuffer::NONE) {
        let area = t.area();
        turn[t.source as usize] = i8::from(area > 0.0) - i8::from(area < 0.0);
    }
    let mut directed: Vec<[u32; 2]> = Vec::new();
    for e in &surface.edges {
        let [up, down] = e.sides.map(|h| if h == NONE { 0 } else { turn[h as usize / 3] });
        let net = up - down;
        let edge = if net > 0 { e.ends } else { [e.ends[1], e.ends[0]] };
        (0..net.abs()).for_each(|_| directed.push(edge));
    }
    let matrix = camera.clip_from_world();
    let place = |joined: u32| {
        let p = surface.positions[surface.first[joined as usize] as usize];
        Point::from(<(f64, f64)>::from(camera.pixel(&(matrix * Vector4::new(p.x, p.y, p.z, 1.0)))))
    };
    let mut loops: Vec<Vec<Point>> = rings(directed).into_iter().map(|ring| ring.into_iter().map(place).collect()).collect();
    for t in projected.triangles.iter().filter(|t| t.piece != zbuffer::NONE) {
        let mut corners = t.corners.map(|c| Point::new(c[0], c[1])).to_vec();
        if t.area() < 0.0 {
            corners.reverse();
        }
        loops.push(corners);
    }
    loops
}

/// Rings of edges, each vertex of which as many run to as from.
fn rings(mut edges: Vec<[u32; 2]>) -> Vec<Vec<u32>> {
    edges.sort_unstable();
    let mut used = vec![false; edges.len()];
    let mut out = Vec::new();
    for start in 0..edges.len() {
        let mut ring = Vec::new();
        let mut at = start;
        while !std::mem::replace(&mut used[at], true) {
            ring.push(edges[at][0]);
            let to = edges[at][1];
            let mut next = edges.partition_point(|e| e[0] < to);
            while next < edges.len() && edges[next][0] == to && used[next] {
                next += 1;
            }
            if next == edges.len() || edges[next][0] != to {
                break;
            }
            at = next;
        }
        if ring.len() > 2 {
            out.push(ring);
        }
    }
    out
}

/// The path of closed lines, measured from `origin`.
pub(super) fn path(loops: &[Vec<Point>], origin: [usize; 2]) -> BezPath {
    let mut path = BezPath::with_capacity(loops.iter().map(|l| l.len() + 1).sum());
    for line in loops {
        for (i, p) in line.iter().enumerate() {
            let p = Point::new(p.x - origin[0] as f64, p.y - origin[1] as f64);
            if i == 0 { path.move_to(p) } else { path.line_to(p) }
        }
        path.close_path();
    }
    path
}

/// Calls `mark(row, first column, last column)` for the pixels that a line from a to b touches, in the rows from `top` on, so many of them.
pub(super) fn touched(a: Point, b: Point, top: usize, rows: usize, mut mark: impl FnMut(usize, f64, f64)) {
    let (upper, lower) = if a.y <= b.y { (a, b) } else { (b, a) };
    let (first, end) = (top as f64, (top + rows) as f64);
    if lower.y < first || upper.y >= end {
        return;
    }
    let slope = if lower.y > upper.y { (lower.x - upper.x) / (lower.y - upper.y) } else { 0.0 };
    let (from, to) = (upper.y.max(first).floor() as usize, lower.y.min(end - 1.0).floor() as usize);
    for y in from..=to {
        let at = |v: f64| upper.x + slope * (v - upper.y);
        let (x0, x1) =
            if lower.y > upper.y { (at((y as f64).max(upper.y)), at((y as f64 + 1.0).min(lower.y))) } else { (upper.x, lower.x) };
        mark(y, x0.min(x1), x0.max(x1));
    }
}
