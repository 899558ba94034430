//! Triangles to pixels: clipping, exact edge functions, a depth buffer, and many samples a pixel where asked.
//!
//! Corners are snapped to 1/256 pixel, so that edge functions are exact in `f64` and neighbours share each sample between them: no gap, no pixel
//! twice (Pineda, *A parallel algorithm for polygon rasterization*, 1988). Who is nearest is decided per pixel in the order of triangles, so
//! that bands of rows can be drawn on any number of threads.

use nalgebra::{Vector3, Vector4};

use super::camera::Camera;
use super::surface::Surface;

/// No triangle.
pub const NONE: u32 = u32::MAX;

/// How far out corners may lie, in pixels, before a triangle is cut: 2¹⁷ keeps edge functions exact.
const GUARD: f64 = 131_072.0;

/// Samples of a pixel that is looked at closely.
pub const SAMPLES: usize = 16;

/// Where they lie, in 256ths of a pixel: a (0, 4, 2)-net, each row, column and square of four by four has its share.
pub const OFFSETS: [[f64; 2]; SAMPLES] = offsets();

const fn offsets() -> [[f64; 2]; SAMPLES] {
    let mut out = [[0.0; 2]; SAMPLES];
    let mut i = 0;
    while i < SAMPLES {
        let reversed = ((i & 1) << 3) | ((i & 2) << 1) | ((i & 4) >> 1) | ((i & 8) >> 3);
        out[i] = [(i * 16 + 8) as f64 / 256.0, (reversed * 16 + 8) as f64 / 256.0];
        i += 1;
    }
    out
}

/// A triangle on the screen, or a piece of one that was cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenTriangle {
    /// Columns and rows of the corners, pixels.
    pub corners: [[f64; 2]; 3],
    /// Nearness of the corners: 1 / depth in perspective, −depth in an orthographic view. Both run evenly over the screen.
    pub near: [f64; 3],
    /// The triangle of the surface.
    pub source: u32,
    /// For a piece of a triangle, where its corners lie in [`Projected::pieces`]; [`NONE`] for a whole one.
    pub piece: u32,
}

/// Triangles on the screen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Projected {
    /// In the order of the surface's.
    pub triangles: Vec<ScreenTriangle>,
    /// For pieces, the weights of the whole triangle's corners at each corner of the piece.
    pub pieces: Vec<[[f64; 3]; 3]>,
}

impl ScreenTriangle {
    /// Twice its area on the screen, positive where it is seen from the front (y runs down).
    pub fn area(&self) -> f64 {
        let [a, b, c] = self.corners;
        (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1])
    }
}

/// Depth along the camera's axis from nearness.
pub fn depth_of(near: f64, orthographic: bool) -> f64 {
    if orthographic { -near } else { 1.0 / near }
}

/// The surface's triangles on the screen, as far as they may touch the picture, in their order. Cost: O(n).
pub fn project(surface: &Surface, camera: &Camera) -> Projected {
    let matrix = camera.clip_from_world();
    let projector = Projector::new(camera);
    let vertices: Vec<Vertex> = surface.positions.iter().map(|p| projector.vertex(matrix * Vector4::new(p.x, p.y, p.z, 1.0))).collect();
    let mut out = Projected { triangles: Vec::with_capacity(surface.triangles.len()), pieces: Vec::new() };
    for (t, corners) in surface.triangles.iter().enumerate() {
        projector.push(corners.map(|i| &vertices[i as usize]), t as u32, &mut out);
    }
    out
}

/// A corner of triangles.
struct Vertex {
    clip: Vector4<f64>,
    /// The sides of the picture that it lies beyond: near, left, right, bottom, top.
    beyond: u8,
    /// Pixel and nearness, where nothing need be cut.
    screen: Option<([f64; 2], f64)>,
}

struct Projector<'a> {
    camera: &'a Camera,
    /// Clip coordinates beyond this many w are cut.
    guard: [f64; 2],
    depth: [f64; 2],
    orthographic: bool,
}

impl<'a> Projector<'a> {
    fn new(camera: &'a Camera) -> Self {
        let guard = camera.size.map(|n| GUARD * 2.0 / n as f64 - 1.0);
        Self { camera, guard, depth: camera.depth_of_clip(), orthographic: camera.is_orthographic() }
    }

    /// Distances to the planes that cut: near first, then left, right, bottom, top; positive inside.
    fn planes(&self, v: &Vector4<f64>) -> [f64; 5] {
        let [gx, gy] = self.guard;
        [v.z + v.w, v.x + gx * v.w, gx * v.w - v.x, v.y + gy * v.w, gy * v.w - v.y]
    }

    fn vertex(&self, clip: Vector4<f64>) -> Vertex {
        let v = &clip;
        let sides = [v.z < -v.w, v.x < -v.w, v.x > v.w, v.y < -v.w, v.y > v.w];
        let beyond = sides.iter().enumerate().map(|(i, beyond)| u8::from(*beyond) << i).sum();
        let whole = v.w > 0.0 && self.planes(v).iter().all(|d| *d >= 0.0);
        Vertex { clip, beyond, screen: whole.then(|| self.screen(v)) }
    }

    fn screen(&self, v: &Vector4<f64>) -> ([f64; 2], f64) {
        let [a, b] = self.depth;
        (self.camera.pixel(v), if self.orthographic { -(a * v.z + b) } else { 1.0 / (a * v.w + b) })
    }

    fn push(&self, corners: [&Vertex; 3], source: u32, out: &mut Projected) {
        let [a, b, c] = corners;
        if a.beyond & b.beyond & c.beyond != 0 {
            return;
        }
        if let (Some(a), Some(b), Some(c)) = (a.screen, b.screen, c.screen) {
            return out.triangles.push(ScreenTriangle { corners: [a.0, b.0, c.0], near: [a.1, b.1, c.1], source, piece: NONE });
        }
        let weights = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut polygon: Vec<Corner> = corners.map(|v| v.clip).into_iter().zip(weights).collect();
        for plane in 0..5 {
            polygon = cut(&polygon, |v| self.planes(v)[plane]);
        }
        // What is left in the plane of the eye has no place on the screen.
        if polygon.iter().any(|v| v.0.w <= 0.0) {
            return;
        }
        for i in 2..polygon.len() {
            let piece = [polygon[0], polygon[i - 1], polygon[i]];
            let [a, b, c] = piece.map(|c| self.screen(&c.0));
            let triangle = ScreenTriangle { corners: [a.0, b.0, c.0], near: [a.1, b.1, c.1], source, piece: out.pieces.len() as u32 };
            out.triangles.push(triangle);
            out.pieces.push(piece.map(|c| c.1.into()));
        }
    }
}

/// A corner in clip space, and its weights of the triangle's corners.
type Corner = (Vector4<f64>, Vector3<f64>);

/// The part of a convex polygon where `inside` is not negative: Sutherland and Hodgman, *Reentrant polygon clipping*, 1974.
fn cut(polygon: &[Corner], inside: impl Fn(&Vector4<f64>) -> f64) -> Vec<Corner> {
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (i, b) in polygon.iter().enumerate() {
        let a = &polygon[(i + polygon.len() - 1) % polygon.len()];
        let (da, db) = (inside(&a.0), inside(&b.0));
        if (da >= 0.0) != (db >= 0.0) {
            // From the inner end, so that both triangles at an edge cut it at the same point.
            let (p, q, dp, dq) = if da >= 0.0 { (a, b, da, db) } else { (b, a, db, da) };
            let t = dp / (dp - dq);
            out.push((p.0 + (q.0 - p.0) * t, p.1 + (q.1 - p.1) * t));
        }
        if db >= 0.0 {
            out.push(*b);
        }
    }
    out
}

/// A triangle with its edge functions: not negative inside, e = a x + b y + c at pixel coordinates.
struct Setup {
    edges: [[f64; 3]; 3],
    near: [f64; 3],
}

/// To the next 1/256: the sum leaves no bits for finer ones.
fn snap(v: f64) -> f64 {
    const MAGIC: f64 = 1.5 * (1_u64 << 44) as f64;
    (v + MAGIC) - MAGIC
}

/// The corners of a triangle, snapped. (`map` on arrays is a call of its own, without the wider instructions of the caller.)
#[inline(always)]
fn snapped(triangle: &ScreenTriangle) -> [[f64; 2]; 3] {
    let [a, b, c] = triangle.corners;
    [[snap(a[0]), snap(a[1])], [snap(b[0]), snap(b[1])], [snap(c[0]), snap(c[1])]]
}

/// The least and the greatest of three corners' columns (0) or rows (1).
#[inline(always)]
fn range([a, b, c]: &[[f64; 2]; 3], k: usize) -> [f64; 2] {
    [a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k])]
}

impl Setup {
    /// Of a triangle whose corners are snapped already; `None` where nothing is left of it.
    #[inline(always)]
    fn new(mut p: [[f64; 2]; 3], near: [f64; 3]) -> Option<Self> {
        let mut q = near;
        let area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
        if area == 0.0 {
            return None;
        }
        if area < 0.0 {
            p.swap(1, 2);
            q.swap(1, 2);
        }
        let edges = [edge(p[0], p[1]), edge(p[1], p[2]), edge(p[2], p[0])];
        // The weight of a corner is the function of the edge opposite, over the area.
        let plane = |k: usize| (edges[1][k] * q[0] + edges[2][k] * q[1] + edges[0][k] * q[2]) / area.abs();
        // From a corner, as far-off origins would cost digits.
        let (nx, ny) = (plane(0), plane(1));
        let near = [nx, ny, q[0] - nx * p[0][0] - ny * p[0][1]];
        Some(Self { edges, near })
    }

    /// The edges' functions at a place.
    #[inline(always)]
    fn at(&self, x: f64, y: f64) -> [f64; 3] {
        let [d, e, f] = &self.edges;
        [d[0] * x + d[1] * y + d[2], e[0] * x + e[1] * y + e[2], f[0] * x + f[1] * y + f[2]]
    }
}

/// The function of the edge from p to q. Samples on the edge belong to one of both sides: the other one's function is half a step lower.
#[inline(always)]
fn edge(p: [f64; 2], q: [f64; 2]) -> [f64; 3] {
    let (a, b) = (p[1] - q[1], q[0] - p[0]);
    let owns = a > 0.0 || (a == 0.0 && b > 0.0);
    let c = -(a * p[0] + b * p[1]);
    [a, b, if owns { c } else { c - 1.0 / 131_072.0 }]
}

/// The rows of a picture that one thread draws.
pub struct Rows<'a> {
    /// Column and row of the first pixel.
    pub origin: [usize; 2],
    /// Columns.
    pub width: usize,
    /// Nearness less `reference`, row by row; −∞ where nothing is drawn.
    pub near: &'a mut [f32],
    /// Numbers of screen triangles; [`NONE`] where nothing is drawn.
    pub id: &'a mut [u32],
    /// Subtracted from nearness, so that `f32` holds it.
    pub reference: f64,
}

impl Rows<'_> {
    fn height(&self) -> usize {
        self.near.len() / self.width.max(1)
    }

    /// First and last pixel whose centres lie in a range, among so many.
    #[inline(always)]
    fn centres(range: [f64; 2], origin: usize, len: usize) -> (usize, usize) {
        let low = (range[0] - 0.5 - origin as f64).max(0.0);
        let high = (range[1] + 0.5 - origin as f64).max(0.0).min(len as f64);
        // Casts cut towards nought, so that adding nearly one rounds up.
        ((low as usize) + usize::from(low > (low as usize) as f64), high as usize)
    }

    /// Draws those triangles of all whose numbers are given, ascending, one sample at each pixel's centre. Cost: O(numbers + pixels that they cover).
    pub fn draw(&mut self, triangles: &[ScreenTriangle], numbers: &[u32]) {
        draw_rows(self, triangles, numbers);
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn draw_rows(rows: &mut Rows<'_>, triangles: &[ScreenTriangle], numbers: &[u32]) {
    let height = rows.height();
    for &id in numbers {
        let corners = snapped(&triangles[id as usize]);
        let columns = Rows::centres(range(&corners, 0), rows.origin[0], rows.width);
        let lines = Rows::centres(range(&corners, 1), rows.origin[1], height);
        // Many a small triangle lies between the centres.
        if columns.0 < columns.1
            && lines.0 < lines.1
            && let Some(setup) = Setup::new(corners, triangles[id as usize].near)
        {
            draw_one(rows, &setup, columns, lines, id);
        }
    }
}

/// Pixels that are tried at once.
const LANES: usize = 8;

#[inline(always)]
fn draw_one(rows: &mut Rows<'_>, setup: &Setup, (left, right): (usize, usize), (y0, y1): (usize, usize), id: u32) {
    let width = rows.width;
    // Small triangles are most: pixels beyond their columns are outside of an edge, so that a fixed number can be tried.
    let small = right <= left + LANES && left + LANES <= width;
    for y in y0..y1 {
        let py = (y + rows.origin[1]) as f64 + 0.5;
        let (x0, x1) = if right > left + 32 { span(setup, py, rows.origin[0], left, right) } else { (left, right) };
        let px = (x0 + rows.origin[0]) as f64 + 0.5;
        let e = setup.at(px, py);
        let q = setup.near[0] * px + setup.near[1] * py + setup.near[2] - rows.reference;
        let (near, ids) = (&mut rows.near[y * width..][x0..], &mut rows.id[y * width..][x0..]);
        if small && let (Some((near, _)), Some((ids, _))) = (near.split_first_chunk_mut(), ids.split_first_chunk_mut()) {
            let (near, ids): (&mut [f32; LANES], &mut [u32; LANES]) = (near, ids);
            draw_lanes(setup, e, q, id, near, ids);
        } else {
            let n = x1.max(x0) - x0;
            draw_run(setup, e, q, id, &mut near[..n], &mut ids[..n]);
        }
    }
}

/// As [`draw_run`], all at once.
#[inline(always)]
fn draw_lanes(setup: &Setup, e: [f64; 3], q: f64, id: u32, near: &mut [f32; LANES], ids: &mut [u32; LANES]) {
    const STEPS: [f64; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    let lower = |a: f64, b: f64| if a < b { a } else { b };
    let mut values = [0.0; LANES];
    let mut inside = [0; LANES];
    for i in 0..LANES {
        let at = |k: usize| e[k] + setup.edges[k][0] * STEPS[i];
        values[i] = (q + setup.near[0] * STEPS[i]) as f32;
        inside[i] = if lower(lower(at(0), at(1)), at(2)) >= 0.0 { u32::MAX } else { 0 };
    }
    let (before, drawn) = (*near, *ids);
    for i in 0..LANES {
        let wins = (inside[i] != 0) & (values[i] > before[i]);
        near[i] = if wins { values[i] } else { before[i] };
        ids[i] = if wins { id } else { drawn[i] };
    }
}

/// Tries pixels of a row, from one on where the edges' functions are `e` and the nearness `q`.
#[inline(always)]
fn draw_run(setup: &Setup, e: [f64; 3], q: f64, id: u32, near: &mut [f32], ids: &mut [u32]) {
    for (i, (near, slot)) in near.iter_mut().zip(ids).enumerate() {
        let i = i as i32 as f64;
        let inside = |k: usize| e[k] + setup.edges[k][0] * i >= 0.0;
        let value = (q + setup.near[0] * i) as f32;
        let wins = inside(0) & inside(1) & inside(2) & (value > *near);
        *near = if wins { value } else { *near };
        *slot = if wins { id } else { *slot };
    }
}

/// The columns of a row that a wide triangle may cover, a pixel more at both sides.
#[inline(always)]
fn span(setup: &Setup, py: f64, origin: usize, left: usize, right: usize) -> (usize, usize) {
    let (mut low, mut high) = (left as f64, right as f64);
    for [a, b, c] in setup.edges {
        let root = -(b * py + c) / a - origin as f64;
        if a > 0.0 {
            low = low.max(root - 2.0);
        } else if a < 0.0 {
            high = high.min(root + 2.0);
        }
    }
    let high = (high.max(0.0) as usize).min(right);
    ((low as usize).min(high), high)
}

/// The samples of pixels that are looked at closely.
#[derive(Clone, Debug, PartialEq)]
pub struct Close {
    /// Nearness less the reference of each sample.
    pub near: [f32; SAMPLES],
    /// The screen triangle of each sample, or [`NONE`].
    pub id: [u32; SAMPLES],
    /// A triangle that touches the pixel's square, for slivers that no sample meets.
    pub touching: u32,
}

impl Default for Close {
    fn default() -> Self {
        Self { near: [f32::NEG_INFINITY; SAMPLES], id: [NONE; SAMPLES], touching: NONE }
    }
}

/// Draws triangles once more, as [`Rows::draw`], on those pixels of `rows` whose `slot` is not [`NONE`], with many samples. Cost: O(numbers + close
/// pixels × layers).
pub fn draw_close(rows: &Rows<'_>, slot: &[u32], close: &mut [Close], triangles: &[ScreenTriangle], numbers: &[u32]) {
    close_rows(rows, slot, close, triangles, numbers);
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn close_rows(rows: &Rows<'_>, slot: &[u32], close: &mut [Close], triangles: &[ScreenTriangle], numbers: &[u32]) {
    for &id in numbers {
        let corners = snapped(&triangles[id as usize]);
        let squares = |range: [f64; 2], origin: usize, len: usize| {
            let low = (range[0] - origin as f64).max(0.0) as usize;
            (low, ((range[1] - origin as f64).max(-1.0) + 1.0).min(len as f64) as usize)
        };
        let (y0, y1) = squares(range(&corners, 1), rows.origin[1], rows.height());
        let (x0, x1) = squares(range(&corners, 0), rows.origin[0], rows.width);
        let row = |y: usize| &slot[y * rows.width..][x0..x1.max(x0)];
        // Most triangles touch no pixel that is looked at.
        if !(y0..y1).any(|y| row(y).iter().any(|at| *at != NONE)) {
            continue;
        }
        let Some(setup) = Setup::new(corners, triangles[id as usize].near) else { continue };
        for y in y0..y1 {
            for (i, &at) in row(y).iter().enumerate().filter(|(_, at)| **at != NONE) {
                close_one(&mut close[at as usize], &setup, [x0 + i + rows.origin[0], y + rows.origin[1]], rows.reference, id);
            }
        }
    }
}

#[inline(always)]
fn close_one(close: &mut Close, setup: &Setup, pixel: [usize; 2], reference: f64, id: u32) {
    let (x, y) = (pixel[0] as f64, pixel[1] as f64);
    let e = setup.at(x, y);
    let q = setup.near[0] * x + setup.near[1] * y + setup.near[2] - reference;
    for s in 0..SAMPLES {
        let [dx, dy] = OFFSETS[s];
        let inside = |k: usize| e[k] + (setup.edges[k][0] * dx + setup.edges[k][1] * dy) >= 0.0;
        let value = (q + (setup.near[0] * dx + setup.near[1] * dy)) as f32;
        let wins = inside(0) & inside(1) & inside(2) & (value > close.near[s]);
        close.near[s] = if wins { value } else { close.near[s] };
        close.id[s] = if wins { id } else { close.id[s] };
    }
    // The square is touched where no edge has all of it on its outer side.
    let touches = setup.edges.iter().zip(e).all(|(k, e)| e + k[0].max(0.0) + k[1].max(0.0) >= 0.0);
    if touches && close.touching == NONE {
        close.touching = id;
    }
}

#[cfg(test)]
#[path = "zbuffer_tests.rs"]
mod tests;
