//! What of straight lines a surface hides, exactly: no sample is taken and no pixel looked at.
//!
//! **Source** Appel, *The notion of quantitative invisibility and the machine rendering of solids*, 1967: lines against faces. Over the picture nearness runs
//! evenly along lines and triangles, so that the part of a line behind a triangle is an interval with a closed form.

use nalgebra::Vector3;

use super::camera::Camera;
use super::silhouette::Kind;
use super::surface::Surface;
use super::zbuffer::{Projected, ScreenTriangle};

/// Side of a cell of the grid in which triangles are looked up, pixels.
const CELL: f64 = 8.0;

/// How far inside of a triangle a line runs at the least where that hides it, and the length of what is too short to be told, pixels.
const TOUCH: f64 = 1e-6;
const SPECK: f64 = 0.05;

/// A triangle whose normal is this near to a right angle with the line of sight (cosine) is seen edge-on.
const EDGE_ON: f64 = 0.5;

/// A place in the picture, and its nearness.
pub type Spot = ([f64; 2], f64);

/// What points toward the eye from a place.
type Toward = Box<dyn Fn(&Vector3<f64>) -> Vector3<f64> + Send + Sync>;

/// The triangles of a surface on the screen, by place.
pub struct Hidden<'a> {
    surface: &'a Surface,
    camera: &'a Camera,
    toward: Toward,
    projected: &'a Projected,
    columns: usize,
    rows: usize,
    /// Where the triangles of each cell begin in `of`.
    starts: Vec<usize>,
    of: Vec<u32>,
}

impl<'a> Hidden<'a> {
    /// Of a surface as a camera sees it, and its triangles there. Cost: O(triangles + cells that they touch).
    pub fn new(surface: &'a Surface, camera: &'a Camera, projected: &'a Projected) -> Self {
        let [columns, rows] = camera.size.map(|n| (n as f64 / CELL).ceil().max(1.0) as usize);
        let (toward, starts) = (Box::new(camera.toward()), vec![0; columns * rows + 1]);
        let mut out = Self { surface, camera, toward, projected, columns, rows, starts, of: Vec::new() };
        let cells: Vec<[[usize; 2]; 2]> = out.projected.triangles.iter().map(|t| out.cells(t)).collect();
        let each = |[x, y]: &[[usize; 2]; 2], visit: &mut dyn FnMut(usize)| {
            (y[0]..y[1]).for_each(|row| (x[0]..x[1]).for_each(|column| visit(row * columns + column)));
        };
        cells.iter().for_each(|range| each(range, &mut |cell| out.starts[cell + 1] += 1));
        (0..columns * rows).for_each(|cell| out.starts[cell + 1] += out.starts[cell]);
        let mut next = out.starts.clone();
        out.of = vec![0; out.starts[columns * rows]];
        for (number, range) in cells.iter().enumerate() {
            each(range, &mut |cell| {
                out.of[next[cell]] = number as u32;
                next[cell] += 1;
            });
        }
        out
    }

    /// The columns and rows of cells that a triangle's box touches.
    fn cells(&self, triangle: &ScreenTriangle) -> [[usize; 2]; 2] {
        let [a, b, c] = triangle.corners;
        [0, 1].map(|k| span([a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k])], [self.columns, self.rows][k]))
    }

    /// What is hidden of a line on the surface itself, whose ends lie on `edges`, by what is nearer by more than `slack`, scene units. See [`Hidden::along`].
    ///
    /// Along an edge the triangles at it hide nothing. Across a triangle the line stands for where the smooth surface turns: its neighbours stand before it
    /// by as much as they are flat and hide nothing, nor do others that are seen edge-on, up to the triangle's size.
    fn on_surface(&self, edges: [[u32; 2]; 2], line: [Spot; 2], slack: f64) -> Vec<[f64; 2]> {
        let mut ends = [edges[0][0], edges[0][1], edges[1][0], edges[1][1]];
        ends.sort_unstable_by_key(|v| self.surface.joined[*v as usize]);
        let joined = ends.map(|v| self.surface.joined[v as usize]);
        let has = |triangle: usize, v: &u32| self.surface.corners(triangle).contains(v);
        if joined.windows(2).filter(|w| w[0] != w[1]).count() < 2 {
            return self.along(line, |t| (!joined.iter().all(|v| has(t, v))).then_some(slack));
        }
        let at = |v: u32| self.surface.positions[v as usize];
        let size = (0..4).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| (at(ends[i]) - at(ends[j])).norm()).fold(0.0, f64::max);
        let toward = (self.toward)(&at(ends[0]));
        let edge_on = |t: usize| {
            let normal = self.surface.area_vector(t);
            normal.dot(&toward).abs() < EDGE_ON * normal.norm() * toward.norm()
        };
        self.along(line, |t| (!joined.iter().any(|v| has(t, v))).then(|| if edge_on(t) { slack.max(size) } else { slack }))
    }

    /// What is hidden of a line of some kind on the surface. One where parts run through each other lies within triangles, and all others may hide it; for
    /// the rest see [`Hidden::on_surface`].
    pub fn of_kind(&self, kind: Kind, edges: [[u32; 2]; 2], line: [Spot; 2], slack: f64) -> Vec<[f64; 2]> {
        if kind == Kind::Intersection { self.along(line, |_| Some(slack)) } else { self.on_surface(edges, line, slack) }
    }

    /// The parts of a line that triangles hide, as shares of its length on the screen: apart from each other, in their order. `slack` tells by how much a
    /// triangle of the surface must be nearer to do so, scene units; `None` for never. Cost: O(triangles in the cells that it crosses).
    pub fn along(&self, [from, to]: [Spot; 2], slack: impl Fn(usize) -> Option<f64>) -> Vec<[f64; 2]> {
        let mut near = Vec::new();
        let [top, bottom] = span([from.0[1].min(to.0[1]), from.0[1].max(to.0[1])], self.rows);
        for row in top..bottom {
            let Some([low, high]) = within([from.0[1], to.0[1]], [row as f64 * CELL, (row + 1) as f64 * CELL]) else { continue };
            let [a, b] = [low, high].map(|t| from.0[0] + (to.0[0] - from.0[0]) * t);
            let [first, end] = span([a.min(b), a.max(b)], self.columns);
            if first < end {
                let (first, end) = (row * self.columns + first, row * self.columns + end);
                near.extend_from_slice(&self.of[self.starts[first]..self.starts[end]]);
            }
        }
        near.sort_unstable();
        near.dedup();
        let length = (to.0[0] - from.0[0]).hypot(to.0[1] - from.0[1]);
        // A speck on the side that two triangles share is behind both, a line along it behind neither.
        let least = if length < SPECK { -TOUCH } else { TOUCH };
        let farther = from.1.min(to.1);
        let part = |t: &ScreenTriangle| {
            if t.near.iter().all(|near| *near <= farther) {
                return None;
            }
            let slack = slack(t.source as usize)?;
            behind(t, [from.0, to.0], [from, to].map(|(_, near)| near + slack * self.camera.slope(near)), least)
        };
        let mut parts: Vec<[f64; 2]> = near.into_iter().filter_map(|i| part(&self.projected.triangles[i as usize])).collect();
        parts.sort_by(|a, b| a[0].total_cmp(&b[0]));
        match parts[..] {
            [] => parts,
            _ if length < SPECK => vec![[0.0, 1.0]],
            _ => joined(parts, SPECK / length),
        }
    }
}

/// The cells that a range of pixels touches, of so many.
fn span(range: [f64; 2], n: usize) -> [usize; 2] {
    let low = (range[0] / CELL).floor().clamp(0.0, n as f64);
    let high = ((range[1] / CELL).floor() + 1.0).clamp(0.0, n as f64);
    [low as usize, high as usize]
}

/// The shares of the way from one number to another that lie in a range.
fn within([a, b]: [f64; 2], [low, high]: [f64; 2]) -> Option<[f64; 2]> {
    if a.max(b) < low || a.min(b) > high {
        return None;
    }
    let at = |v: f64| if a == b { 0.0 } else { ((v - a) / (b - a)).clamp(0.0, 1.0) };
    let (s, t) = if a == b { (0.0, 1.0) } else { (at(low), at(high)) };
    Some([s.min(t), s.max(t)])
}

/// The part of a line of given nearness at its ends that lies behind a triangle, and inside of it by `least` pixels.
fn behind(triangle: &ScreenTriangle, line: [[f64; 2]; 2], near: [f64; 2], least: f64) -> Option<[f64; 2]> {
    let area = triangle.area();
    if area == 0.0 {
        return None;
    }
    let p = triangle.corners;
    // Of each corner the weights at both ends: the distance from the side opposite, over the triangle's height.
    let mut weights = [[0.0; 2]; 3];
    let mut part = [0.0_f64, 1.0];
    for (i, weight) in weights.iter_mut().enumerate() {
        let (u, v) = (p[(i + 1) % 3], p[(i + 2) % 3]);
        let [a, b] = line.map(|q| ((v[1] - u[1]) * (q[0] - u[0]) - (v[0] - u[0]) * (q[1] - u[1])) / area);
        let least = least * (v[0] - u[0]).hypot(v[1] - u[1]) / area.abs();
        part = above([a - least, b - least], part)?;
        *weight = [a, b];
    }
    let mix = |[a, b]: [f64; 2], t: f64| a + (b - a) * t;
    // At the ends of what is inside: far outside of a slim triangle its plane says nothing.
    let over = |t: f64| (0..3).map(|i| mix(weights[i], t) * triangle.near[i]).sum::<f64>() - mix(near, t);
    let [low, high] = above(part.map(over), [0.0, 1.0])?;
    Some([mix(part, low), mix(part, high)])
}

/// What of a part lies where a number that changes evenly, from the first to the second over the whole way, is above nought.
fn above([a, b]: [f64; 2], [low, high]: [f64; 2]) -> Option<[f64; 2]> {
    let root = || a / (a - b);
    let (low, high) = match (a > 0.0, b > 0.0) {
        (true, true) => (low, high),
        (true, false) => (low, high.min(root())),
        (false, true) => (low.max(root()), high),
        (false, false) => return None,
    };
    (low < high).then_some([low, high])
}

/// Parts put together where less than `speck` is between them, without those that are less than that.
fn joined(parts: Vec<[f64; 2]>, speck: f64) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = Vec::new();
    for part in parts {
        match out.last_mut() {
            Some(last) if part[0] <= last[1] + speck => last[1] = last[1].max(part[1]),
            _ => out.push(part),
        }
    }
    out.retain(|p| p[1] - p[0] > speck);
    out.iter_mut().for_each(|p| {
        if p[0] < speck {
            p[0] = 0.0;
        }
        if p[1] > 1.0 - speck {
            p[1] = 1.0;
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::camera::{Orbit, orthographic};
    use crate::algo::surface::Part;
    use crate::algo::zbuffer::project;

    /// What is hidden of a line from one place of the world to another by triangles, 100 pixels a unit, the middle at (256, 256), the eye at z = 5.
    fn hidden(triangles: &[[[f64; 3]; 3]], line: [[f64; 3]; 2], slack: f64) -> Vec<[f64; 2]> {
        let positions: Vec<[f64; 3]> = triangles.iter().flatten().copied().collect();
        let corners: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let surface = Surface::new(&[Part { positions: &positions, triangles: &corners, normals: &[] }], 1.0).unwrap();
        let orbit = Orbit { target: [0.0; 3], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 5.0 };
        let camera = Camera::new(orbit.view(), orthographic(100.0, [512, 512], 0.1, 100.0), [512, 512]).unwrap();
        let line = line.map(|p| {
            let [x, y, depth] = camera.project(p);
            ([x, y], -depth)
        });
        Hidden::new(&surface, &camera, &project(&surface, &camera)).along(line, |_| Some(slack))
    }

    fn close(found: &[[f64; 2]], truth: &[[f64; 2]]) {
        let apart = found.iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(found.len() == truth.len() && apart < 1e-6, "{found:?}, expected {truth:?}");
    }

    /// Both halves of a square of the plane at a depth.
    fn square(x: [f64; 2], y: [f64; 2], z: f64) -> [[[f64; 3]; 3]; 2] {
        let [a, b, c, d] = [[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]];
        [[a, b, c], [a, c, d]]
    }

    const ALONG: [[f64; 3]; 2] = [[-2.0, 0.3, 0.0], [2.0, 0.3, 0.0]];

    #[test]
    fn a_line_is_hidden_just_as_far_as_something_is_before_it() {
        let before = square([-1.0, 1.5], [-1.0, 1.0], 1.0);
        close(&hidden(&before, ALONG, 0.0), &[[0.25, 0.875]]);
        close(&hidden(&before, [ALONG[1], ALONG[0]], 0.0), &[[0.125, 0.75]]);
        close(&hidden(&square([-1.0, 1.5], [-1.0, 1.0], -1.0), ALONG, 0.0), &[]);
        close(&hidden(&before, [[0.0, 0.3, 0.0], [0.5, 0.5, 0.0]], 0.0), &[[0.0, 1.0]]);
        let two: Vec<_> = before.into_iter().chain(square([-1.8, -1.6], [0.0, 1.0], 0.1)).collect();
        close(&hidden(&two, ALONG, 0.0), &[[0.05, 0.1], [0.25, 0.875]]);
    }

    #[test]
    fn a_line_through_a_triangle_goes_in_where_both_are_as_near() {
        // The plane z = x: the line at z = 0 is behind it from x = 0 on.
        let slope = [[[-1.0, -1.0, -1.0], [1.0, -1.0, 1.0], [1.0, 2.0, 1.0]], [[-1.0, -1.0, -1.0], [1.0, 2.0, 1.0], [-1.0, 2.0, -1.0]]];
        close(&hidden(&slope, ALONG, 0.0), &[[0.5, 0.75]]);
        close(&hidden(&slope, ALONG, 0.5), &[[0.625, 0.75]]);
    }

    #[test]
    fn what_is_touched_edge_on_or_out_of_the_picture_hides_nothing() {
        let before = square([-1.0, 1.5], [0.3, 1.0], 1.0);
        close(&hidden(&before, ALONG, 0.0), &[]);
        let edge_on = [[[-1.0, 0.3, 1.0], [1.0, 0.3, 1.0], [1.0, 0.3, 2.0]]];
        close(&hidden(&edge_on, ALONG, 0.0), &[]);
        close(&hidden(&square([7.0, 9.0], [-1.0, 1.0], 1.0), [[6.0, 0.0, 0.0], [10.0, 0.0, 0.0]], 0.0), &[]);
    }
}
