//! Pictures carried by meshes: of filled contours, and of curves that bend.

use pegbar_engine::Setting;
use pegbar_engine::node::{Fault, NodeError};

use crate::algo::compatible::Point;
use crate::algo::curve_bend::CurveBend;
use crate::algo::paint::{FillRule, coverage, polygon};
use crate::algo::raster::Affine;
use crate::algo::warp_affine::{Filter, Source};
use crate::algo::warp_mesh::{MeshWarp, band, band_triangles};
use crate::algo::window::Window;
use crate::data::{Image, LARGEST};

/// Pixels further out than this are not drawn.
const FARTHEST: f64 = 4_194_304.0;
/// Cells along the longer side of a picture that a curve bends, at the most.
const CELLS: usize = 128;
/// Pixels beyond what is drawn that are carried too, so that edges stay soft.
const RIM: usize = 2;

/// A mesh that carries a picture.
#[derive(Clone, Debug)]
pub(crate) struct Carried {
    /// Corners, by point; those that come later lie above.
    triangles: Vec<[u32; 3]>,
    /// Points in the picture.
    from: Vec<Point>,
    /// Points in the result.
    to: Vec<Point>,
}

impl Carried {
    /// A filled contour, with a band of `margin` around it: points of the mesh in the picture and in the result, those of the contour first.
    pub(crate) fn filled(triangles: &[[u32; 3]], n_contour: usize, from: &[Point], to: &[Point], margin: f64) -> Self {
        let banded = |points: &[Point]| points.iter().copied().chain(band(&points[..n_contour], margin)).collect();
        // The band lies below, so that where the contour is hollow it does not hide the inside.
        let mut all = band_triangles(n_contour, from.len());
        all.extend_from_slice(triangles);
        Self { triangles: all, from: banded(from), to: banded(to) }
    }

    /// What is drawn on a picture, in cells that a curve carries along as it bends.
    pub(crate) fn bent(image: &Image, bend: &CurveBend) -> Self {
        let own = image.data_window();
        let cell = (own.width.max(own.height).div_ceil(CELLS)).max(4);
        let (nx, ny) = (own.width.div_ceil(cell) + 2, own.height.div_ceil(cell) + 2);
        let drawn = drawn_cells(image, cell, nx, ny);
        let mut made = Self { triangles: Vec::new(), from: Vec::new(), to: Vec::new() };
        let mut at = vec![None; (nx + 1) * (ny + 1)];
        let mut corner = |i: usize, j: usize, made: &mut Self| {
            *at[j * (nx + 1) + i].get_or_insert_with(|| {
                // One cell more on each side of the picture.
                let place = |k: usize, first: i64| (k as f64 - 1.0) * cell as f64 + first as f64;
                let p = [place(i, own.x), place(j, own.y)];
                made.from.push(p);
                made.to.push(bend.at(p));
                (made.from.len() - 1) as u32
            })
        };
        for (k, _) in drawn.iter().enumerate().filter(|(_, d)| **d) {
            let (i, j) = (k % nx, k / nx);
            let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| corner(i, j, &mut made));
            made.triangles.extend([[a, b, c], [a, c, d]]);
        }
        made
    }

    /// The same, moved on by a map.
    pub(crate) fn moved(mut self, map: &Affine) -> Self {
        self.to = super::moved(&self.to, map);
        self
    }

    /// What the mesh covers in the result; `None` where that is out of the range of pixels.
    pub(crate) fn bounds(&self) -> Option<Window> {
        if self.to.is_empty() {
            return Some(Window::default());
        }
        let ends = |k: usize| self.to.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        let ([left, right], [top, bottom]) = (ends(0), ends(1));
        let near = self.to.iter().flatten().all(|v| v.abs() < FARTHEST);
        let whole = |v: f64| libm::floor(v) as i64;
        near.then(|| Window::from_bounds(whole(left), whole(top), whole(right) + 1, whole(bottom) + 1))
    }

    fn draw(&self, image: &Image, filter: Filter, target: &mut [f32], window: Window) {
        let own = image.data_window();
        let source = Source::new(image.raster(), [own.x, own.y]);
        MeshWarp { source, triangles: &self.triangles, from: &self.from, to: &self.to, filter }.draw(target, window);
    }
}

/// Cells of a picture in which, or near which, there is something.
fn drawn_cells(image: &Image, cell: usize, nx: usize, ny: usize) -> Vec<bool> {
    let (width, c) = (image.width(), image.n_channels());
    let mut drawn = vec![false; nx * ny];
    for (k, _) in image.samples().chunks_exact(c.max(1)).enumerate().filter(|(_, p)| p.iter().any(|v| *v != 0.0)) {
        let [columns, rows] = [k % width, k / width].map(|at| (at + cell - RIM.min(cell)) / cell..=(at + cell + RIM) / cell);
        for j in rows {
            columns.clone().for_each(|i| drawn[j.min(ny - 1) * nx + i.min(nx - 1)] = true);
        }
    }
    drawn
}

/// Pictures carried to one place and added up by weight, in `window`.
pub(crate) fn dissolve(layers: &[(Carried, &Image, f64)], channels: usize, filter: Filter, window: Window) -> Result<Vec<f32>, NodeError> {
    let len = window.samples(channels).filter(|n| *n <= LARGEST);
    let len = len.ok_or_else(|| {
        NodeError::new(Fault::Limit, "expected a picture of at most 16 GiB, found a larger one").help("set expand: false")
    })?;
    let mut sum = vec![0.0; len];
    let mut layer = Vec::new();
    for (carried, image, weight) in layers.iter().filter(|(_, _, w)| *w > 0.0) {
        if *weight == 1.0 {
            carried.draw(image, filter, &mut sum, window);
            continue;
        }
        layer.clear();
        layer.resize(len, 0.0);
        carried.draw(image, filter, &mut layer, window);
        sum.iter_mut().zip(&layer).for_each(|(s, l)| *s += *weight as f32 * l);
    }
    Ok(sum)
}

/// What all of the meshes cover.
pub(crate) fn covered(layers: &[(Carried, &Image, f64)]) -> Result<Window, NodeError> {
    let mut all = Window::default();
    for (carried, ..) in layers {
        let own = carried.bounds().ok_or_else(|| NodeError::input("expected a shape within the range of pixels, found one beyond it"))?;
        all = if all.is_empty() {
            own
        } else {
            let (left, top) = (all.x.min(own.x), all.y.min(own.y));
            Window::from_bounds(left, top, all.right().max(own.right()), all.bottom().max(own.bottom()))
        };
    }
    Ok(all)
}

/// Where the picture ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Edge {
    /// As its alpha says where it has one, else at the contour.
    Auto,
    /// As its alpha says, up to the margin outside the contour.
    Margin,
    /// At the contour.
    Cut,
}

/// Leaves what is inside a contour, with soft pixels along it.
pub(crate) fn cut(samples: &mut [f32], contour: &[Point], window: Window, channels: usize) {
    let own: Vec<kurbo::Point> = contour.iter().map(|p| kurbo::Point::new(p[0] - window.x as f64, p[1] - window.y as f64)).collect();
    let inside = coverage(&polygon(&own), FillRule::NonZero, window.width, window.height);
    for (pixel, share) in samples.chunks_exact_mut(channels).zip(inside) {
        pixel.iter_mut().for_each(|v| *v *= share);
    }
}

/// The picture with an alpha: of 1 where it has none.
pub(crate) fn with_alpha(image: &Image) -> Result<Image, NodeError> {
    let c = image.n_channels();
    if image.alpha().is_some() || c == 0 {
        return Ok(image.clone());
    }
    let samples = image.samples().chunks_exact(c).flat_map(|p| p.iter().copied().chain([1.0])).collect();
    let made = Image::new(image.width(), image.height(), c + 1, samples).ok_or_else(|| NodeError::internal("a picture of another size"))?;
    let names = image.channels().into_iter().chain(["A".to_owned()]).collect();
    Ok(made.with_channels(names).with_windows(image.data_window(), image.display_window()))
}
