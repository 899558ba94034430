//! What of a line on a surface is seen, by the depth buffer.

use nalgebra::{Matrix4, Vector3, Vector4};

use super::camera::Camera;
use super::silhouette::Kind;
use super::surface::Surface;
use super::zbuffer::{NONE, Projected, Rows, depth_of, project};

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Area {
    /// Column and row of the first pixel.
    pub origin: [usize; 2],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Area {
    /// The pixels of a picture that triangles may touch.
    pub fn of(projected: &Projected, size: [usize; 2]) -> Self {
        let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for corner in projected.triangles.iter().flat_map(|t| t.corners) {
            for k in 0..2 {
                range[k] = [range[k][0].min(corner[k]), range[k][1].max(corner[k])];
            }
        }
        let [x, y] = [0, 1].map(|k| {
            let low = (range[k][0] - 1.0).clamp(0.0, size[k] as f64) as usize;
            (low, ((range[k][1] + 2.0).clamp(0.0, size[k] as f64) as usize).saturating_sub(low))
        });
        Self { origin: [x.0, y.0], width: x.1, height: y.1 }
    }
}

/// The middle of all nearness, so that `f32` holds the differences.
pub fn reference_of(projected: &Projected) -> f64 {
    let all = projected.triangles.iter().flat_map(|t| t.near);
    let [low, high] = all.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], q| [a.min(q), b.max(q)]);
    if low <= high { (low + high) / 2.0 } else { 0.0 }
}

/// A depth buffer of one sample a pixel.
#[derive(Clone, Debug, Default)]
pub struct DepthBuffer {
    near: Vec<f32>,
    reference: f64,
    area: Area,
}

impl DepthBuffer {
    /// Draws a surface as a camera sees it. Cost: O(triangles + pixels that they cover).
    pub fn new(surface: &Surface, camera: &Camera) -> Self {
        Self::of(&project(surface, camera), camera.size)
    }

    /// Draws triangles in a picture of so many columns and rows. Cost: O(triangles + pixels that they cover).
    pub fn of(projected: &Projected, size: [usize; 2]) -> Self {
        let (area, reference) = (Area::of(projected, size), reference_of(projected));
        let n = area.width * area.height;
        let (mut near, mut id) = (vec![f32::NEG_INFINITY; n], vec![NONE; n]);
        let all: Vec<u32> = (0..projected.triangles.len() as u32).collect();
        Rows { origin: area.origin, width: area.width, near: &mut near, id: &mut id, reference }.draw(&projected.triangles, &all);
        Self { near, reference, area }
    }

    /// It, to be asked.
    pub fn depths(&self) -> Depths<'_> {
        Depths { near: &self.near, reference: self.reference, area: self.area }
    }
}

/// A depth buffer, wherever it lies.
#[derive(Clone, Copy, Debug)]
pub struct Depths<'a> {
    /// Nearness less `reference`, row by row of `area`; −∞ where nothing is drawn.
    pub near: &'a [f32],
    /// Subtracted from nearness.
    pub reference: f64,
    /// The pixels that it has.
    pub area: Area,
}

/// What the depth buffer says of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// Nothing is before it.
    Yes,
    /// Hidden by the surface that it is on: it turns away there.
    Turned,
    /// By something well before it.
    Covered,
}

impl Depths<'_> {
    /// Nearness of a pixel; of one outside, that of nothing.
    fn at(&self, x: i64, y: i64) -> f64 {
        let (x, y) = (x - self.area.origin[0] as i64, y - self.area.origin[1] as i64);
        if x < 0 || y < 0 || x >= self.area.width as i64 || y >= self.area.height as i64 {
            return f64::NEG_INFINITY;
        }
        f64::from(self.near[y as usize * self.area.width + x as usize]) + self.reference
    }

    /// The least nearness of the nine pixels around a place; −∞ next to where nothing is drawn.
    pub fn least_around(&self, at: [f64; 2]) -> f64 {
        let [x, y] = at.map(|v| v.floor() as i64);
        let around = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j)));
        around.map(|(i, j)| self.at(x.saturating_add(i), y.saturating_add(j))).fold(f64::INFINITY, f64::min)
    }
}

/// A camera that looks at a surface, and what it can see of it.
pub struct Sight<'a> {
    camera: &'a Camera,
    depths: Depths<'a>,
    matrix: Matrix4<f64>,
    depth: [f64; 2],
    orthographic: bool,
    /// A thousandth of the surface's extent.
    pub small: f64,
    /// By how much one thing must be nearer to hide another: a millionth of the extent.
    pub least: f64,
    /// Depth of the surface's middle.
    pub middle: f64,
}

impl<'a> Sight<'a> {
    /// The sight of a surface whose depths are these.
    pub fn new(surface: &Surface, camera: &'a Camera, depths: Depths<'a>) -> Self {
        let ends = surface.positions.iter().fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], p| {
            [[0, 1, 2].map(|k| low[k].min(p[k])), [0, 1, 2].map(|k| high[k].max(p[k]))]
        });
        let extent = [0, 1, 2].map(|k| ends[1][k] - ends[0][k]).into_iter().fold(0.0, f64::max);
        let middle = camera.project([0, 1, 2].map(|k| (ends[0][k] + ends[1][k]) / 2.0))[2];
        Self {
            camera,
            depths,
            matrix: camera.clip_from_world(),
            depth: camera.depth_of_clip(),
            orthographic: camera.is_orthographic(),
            small: extent * 1e-3,
            least: extent * 1e-6,
            middle: middle.max(extent * 1e-3),
        }
    }

    /// Column and row of a point of the world, and its nearness; `None` behind the near plane.
    pub fn place(&self, p: &Vector3<f64>) -> Option<([f64; 2], f64)> {
        let clip = self.matrix * Vector4::new(p.x, p.y, p.z, 1.0);
        if clip.w <= 0.0 || clip.z < -clip.w {
            return None;
        }
        let [a, b] = self.depth;
        let near = if self.orthographic { -(a * clip.z + b) } else { 1.0 / (a * clip.w + b) };
        Some((self.camera.pixel(&clip), near))
    }

    /// What runs evenly over the picture, by which shares of an edge are weighted: nearness in perspective, 1 in an orthographic view.
    pub fn evenly(&self, near: f64) -> f64 {
        if self.orthographic { 1.0 } else { near }
    }

    /// Depth along the camera's axis.
    pub fn depth(&self, near: f64) -> f64 {
        depth_of(near, self.orthographic)
    }

    /// What is seen of a point of a line. A line lies where depths jump: it is seen where any of the nine pixels around it is not before it.
    pub fn seen(&self, at: [f64; 2], near: f64, kind: Kind) -> Seen {
        // A silhouette may lie a little behind the mesh that hides its smooth surface; the others lie on it.
        let slack = if kind == Kind::Silhouette { 5.0 } else { 3.0 };
        let slope = self.camera.slope(near);
        match self.depths.least_around(at) - near {
            d if d <= slack * self.small * slope => Seen::Yes,
            d if d <= 40.0 * self.small * slope => Seen::Turned,
            _ => Seen::Covered,
        }
    }

    /// True where a place is next to nothing at all: on the outermost outline.
    pub fn is_outline(&self, at: [f64; 2]) -> bool {
        self.depths.least_around(at) == f64::NEG_INFINITY
    }
}
