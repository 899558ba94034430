//! `keys.inbetween`: shapes between each pair of keys, as rigid as possible.
//!
//! **Method** see [`crate::algo::compatible`] for the triangles that all keys share, [`crate::algo::arap`] for what lies between them: each
//! triangle's rotation and stretch are interpolated, rotations followed across the mesh past half a turn. Open curves turn and stretch edge by
//! edge. Pictures are carried by the mesh, each key's own, and dissolved.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.3; Alexa, Cohen-Or, Levin 2000.
//!
//! **Fails when** a key crosses itself, or keys run opposite ways round: the error names the key and the edges.
//!
//! **Cost** O(n³) once for n points, with a constant of a nanosecond; then O(n √n) an in-between.
//!
//! ```ron
//! "all": (type: "keys.inbetween", keys: "@keys", count: 5),
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, Fault, In, List, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs, Setting};

use super::{contours, key_shapes};
use crate::algo::arap::{Gauge, Options as ArapOptions};
use crate::algo::curve_bend::{CurveBend, Options as BendOptions};
use crate::algo::key_blend::{Interpolation, KeyBlend, Options, inbetweens};
use crate::algo::warp_affine::Filter;
use crate::data::{Image, KeyImages, KeyShapes, LARGEST};
use crate::retarget::{Carried, dissolve, with_alpha};

/// What lies between two keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Method {
    /// As rigid as possible: what turns, turns.
    Arap,
    /// The weighted sum of the points: what turns shrinks on the way.
    Linear,
}

/// Shapes between each pair of keys.
///
/// The keys come first, then for the pairs (0, 1), (0, 2), ... (1, 2), ... `count` shapes each at even steps. Give the key pictures too and
/// they are carried along, for a space of pictures: each pixel goes with the mesh, so that nothing is seen twice.
#[derive(Node)]
#[node(
    id = "keys.inbetween",
    version = 1,
    outputs = KeysInbetweenOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.3; Alexa, Cohen-Or, Levin 2000",
    example = "\"all\": (type: \"keys.inbetween\", keys: \"@keys\", count: 5)"
)]
pub(crate) struct KeysInbetween {
    /// The key shapes: as many points each, in the same order; closed ones run the same way round and do not cross themselves.
    keys: In<KeyShapes>,
    /// A picture for each key, all of one format, on which the key's contour lies. None where only shapes are wanted.
    images: List<Option<In<Image>>>,
    /// In-betweens of each pair. 0 leaves the keys as they are.
    #[input(default = 5, range = 0..=1000)]
    count: u32,
    /// What lies between two keys.
    #[input(default = arap)]
    method: Method,
    /// True gives the same in-betweens whichever key is first; false takes the first as the paper does.
    #[input(default = true)]
    symmetric: bool,
    /// True counts triangles by their area; false equally, as the paper does, so that fine parts weigh more.
    #[input(default = true)]
    area_weights: bool,
    /// The point that goes straight from key to key, as in the paper. The centroid where it is left out.
    #[input(default = None, range = 0..=1000000)]
    anchor: Option<u32>,
}

/// Keys and in-betweens.
#[derive(Outputs)]
pub(crate) struct KeysInbetweenOutputs {
    /// The keys, then the in-betweens.
    keys: KeyShapes,
    /// A picture for each; none where none were given. Premultiplied, with alpha.
    images: KeyImages,
}

/// How far outside its contour a picture is carried, pixels: a pen line runs on both sides of it.
const MARGIN: f64 = 3.0;

fn refused(error: impl std::fmt::Display) -> NodeError {
    NodeError::input(error.to_string()).help("method: linear takes any keys of one point order")
}

/// Pairs of keys, and how far between the two, in the order of the in-betweens.
fn steps(k: usize, count: usize) -> impl Iterator<Item = (usize, usize, f64)> {
    let pairs = (0..k).flat_map(move |i| (i + 1..k).map(move |j| (i, j)));
    pairs.flat_map(move |(i, j)| (1..=count).map(move |m| (i, j, m as f64 / (count + 1) as f64)))
}

impl KeysInbetween {
    fn arap(&self) -> ArapOptions {
        let gauge = self.anchor.map_or(Gauge::Centroid, |v| Gauge::Vertex(v as usize));
        ArapOptions { symmetric: self.symmetric, area_weights: self.area_weights, gauge }
    }

    fn shapes(&self, keys: &[&[[f64; 2]]]) -> Result<Vec<Vec<[f64; 2]>>, NodeError> {
        let count = self.count as usize;
        let options = |interpolation| Options { interpolation, count, closed: self.keys.closed, mesh: false, arap: self.arap() };
        if self.method == Method::Arap {
            return inbetweens(keys, options(Interpolation::Extended)).map_err(refused);
        }
        let blend = KeyBlend::new(keys, options(Interpolation::Linear)).map_err(refused)?;
        steps(keys.len(), count).map(|(i, j, t)| blend.blend(&pair(keys.len(), i, j, t)).map_err(refused)).collect()
    }

    fn names(&self) -> Vec<String> {
        let own = &self.keys.names;
        if own.len() != self.keys.points.shape()[0] {
            return Vec::new();
        }
        let between = steps(own.len(), self.count as usize).map(|(i, j, t)| step_name(&own[i], &own[j], t));
        own.iter().cloned().chain(between).collect()
    }

    /// The key pictures, and those carried between them.
    fn pictures(&self, cx: &Context, keys: &[&[[f64; 2]]]) -> Result<KeyImages, NodeError> {
        let images: Vec<Image> = self.images.0.iter().flatten().map(|i| with_alpha(i)).collect::<Result<_, _>>()?;
        let Some(first) = images.first() else {
            return Ok(KeyImages {
                pixels: NdArray::new([0; 4], Vec::new()).ok_or_else(|| NodeError::internal("no pictures"))?,
                names: Vec::new(),
            });
        };
        let interpolation = if self.method == Method::Arap { Interpolation::Arap } else { Interpolation::Linear };
        let window = first.display_window();
        let k = keys.len();
        let n = k + steps(k, self.count as usize).count();
        let each = window.samples(first.n_channels()).and_then(|s| s.checked_mul(n)).filter(|s| *s <= LARGEST);
        let each = each.ok_or_else(|| {
            NodeError::new(
                Fault::Limit,
                format!("expected pictures of at most 16 GiB in all, found {n} of {} x {}", window.width, window.height),
            )
        })?;
        let mut all = Vec::with_capacity(each);
        for image in &images {
            if image.display_window() != window || image.n_channels() != first.n_channels() || images.len() != k {
                return Err(NodeError::input(format!(
                    "expected {k} pictures of one format, one for each key, found {} or other formats",
                    images.len()
                )));
            }
            all.extend_from_slice(image.in_display()?.samples());
        }
        for (i, j, t) in steps(k, self.count as usize) {
            cx.check()?;
            let options = Options { interpolation, count: 0, closed: self.keys.closed, mesh: true, arap: self.arap() };
            let blend = KeyBlend::new(&[keys[i], keys[j]], options).map_err(refused)?;
            let points = blend.blend(&[1.0 - t, t]).map_err(refused)?;
            let carried = |key: usize, image: &Image| -> Result<Carried, NodeError> {
                let from = &blend.keys()[key];
                if self.keys.closed {
                    return Ok(Carried::filled(blend.triangles(), blend.n_contour(), from, &points, MARGIN));
                }
                Ok(Carried::bent(image, &CurveBend::new(from, &points, BendOptions::default()).map_err(refused)?))
            };
            let layers = [(carried(0, &images[i])?, &images[i], 1.0 - t), (carried(1, &images[j])?, &images[j], t)];
            all.extend(dissolve(&layers, first.n_channels(), Filter::Cubic, window)?);
        }
        let pixels = NdArray::new([n, window.height, window.width, first.n_channels()], all);
        Ok(KeyImages { pixels: pixels.ok_or_else(|| NodeError::internal("pictures of another size"))?, names: self.names() })
    }
}

/// Name of a place between two keys.
pub(super) fn step_name(a: &str, b: &str, t: f64) -> String {
    format!("{a} to {b} at {t:.3}")
}

/// Weights of a place between two of `k` keys.
pub(super) fn pair(k: usize, i: usize, j: usize, t: f64) -> Vec<f64> {
    (0..k).map(|n| if n == i { 1.0 - t } else { 0.0 } + if n == j { t } else { 0.0 }).collect()
}

impl PerFrame for KeysInbetween {
    fn run(self, cx: &Context) -> Result<KeysInbetweenOutputs, NodeError> {
        let mut all = contours(&self.keys);
        let views: Vec<&[[f64; 2]]> = all.iter().map(Vec::as_slice).collect();
        let between = self.shapes(&views)?;
        let images = self.pictures(cx, &views)?;
        all.extend(between);
        Ok(KeysInbetweenOutputs { keys: key_shapes(&all, self.names(), self.keys.closed)?, images })
    }
}

#[cfg(test)]
mod tests;
