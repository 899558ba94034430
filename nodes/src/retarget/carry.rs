//! Pictures carried by the mesh of their keys.

use pegbar_engine::node::{Fault, NodeError};

use crate::algo::key_blend::KeyBlend;
use crate::algo::warp_affine::{Filter, Source};
use crate::algo::warp_mesh::{MeshWarp, band, band_triangles};
use crate::algo::window::Window;
use crate::data::{Image, LARGEST};

/// Pixels further out than this are not drawn.
const FARTHEST: f64 = 4_194_304.0;

/// Key shapes whose pictures go with them.
pub(crate) struct Carried<'a> {
    /// The keys, with triangles.
    pub(crate) blend: &'a KeyBlend,
    /// How far outside its contour a picture is carried, pixels.
    pub(crate) margin: f64,
    /// How pictures are read between their pixels.
    pub(crate) filter: Filter,
}

impl Carried<'_> {
    /// Points of the mesh, then those of the band around it.
    fn banded(&self, points: &[[f64; 2]], width: f64) -> Vec<[f64; 2]> {
        points.iter().copied().chain(band(&points[..self.blend.n_contour()], width)).collect()
    }

    /// What the shape covers, with its band; `None` where that is out of the range of pixels.
    pub(crate) fn bounds(&self, points: &[[f64; 2]]) -> Option<Window> {
        let all = self.banded(points, self.margin);
        let ends = |k: usize| all.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        let ([left, right], [top, bottom]) = (ends(0), ends(1));
        let near = all.iter().flatten().all(|v| v.abs() < FARTHEST);
        let whole = |v: f64| libm::floor(v) as i64;
        near.then(|| Window::from_bounds(whole(left), whole(top), whole(right) + 1, whole(bottom) + 1))
    }

    /// Each key's picture carried to `points` and added up by weight, in `window`.
    pub(crate) fn dissolve(&self, images: &[&Image], weights: &[f64], points: &[[f64; 2]], window: Window) -> Result<Vec<f32>, NodeError> {
        let all: Vec<Option<&Image>> = images.iter().map(|i| Some(*i)).collect();
        self.dissolve_some(&all, weights, points, window, images.first().map_or(0, |i| i.n_channels()))
    }

    /// The same where some keys have no picture.
    pub(crate) fn dissolve_some(
        &self,
        images: &[Option<&Image>],
        weights: &[f64],
        points: &[[f64; 2]],
        window: Window,
        channels: usize,
    ) -> Result<Vec<f32>, NodeError> {
        let len = window.samples(channels).filter(|n| *n <= LARGEST);
        let len = len.ok_or_else(|| {
            NodeError::new(Fault::Limit, "expected a picture of at most 16 GiB, found a larger one").help("set expand: false")
        })?;
        // The band lies below, so that where the contour is hollow it does not hide the inside.
        let mut triangles = band_triangles(self.blend.n_contour(), points.len());
        triangles.extend_from_slice(self.blend.triangles());
        let to = self.banded(points, self.margin);
        let mut sum = vec![0.0; len];
        let mut layer = Vec::new();
        for ((image, key), weight) in images.iter().zip(self.blend.keys()).zip(weights) {
            let Some(image) = image.filter(|_| *weight > 0.0) else { continue };
            let from = self.banded(key, self.margin);
            let own = image.data_window();
            let source = Source::new(image.raster(), [own.x, own.y]);
            let warp = MeshWarp { source, triangles: &triangles, from: &from, to: &to, filter: self.filter };
            if *weight == 1.0 {
                warp.draw(&mut sum, window);
                continue;
            }
            layer.clear();
            layer.resize(len, 0.0);
            warp.draw(&mut layer, window);
            sum.iter_mut().zip(&layer).for_each(|(s, l)| *s += *weight as f32 * l);
        }
        Ok(sum)
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
