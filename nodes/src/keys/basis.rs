//! `keys.basis`: the linear space that key shapes, or key pictures, span.
//!
//! **Method** principal components ([`crate::algo::pca`]), as few as leave no example off by more than `max_error`. With the in-betweens of
//! `keys.inbetween` any two-way interpolation becomes a linear space of all keys. Pictures are compared pixel by pixel, so that they should stand in
//! one place and be carried by the mesh between keys: a dissolve shows everything twice.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.3, equation 3; section 3.3, equations 14 and 15 (pictures).
//!
//! **Fails when** a point is not finite, or there is not one picture for each key. Keys that differ by an affine motion spend components on it:
//! `align` them.
//!
//! **Cost** O(m² d) for m examples of d coordinates or samples.
//!
//! ```ron
//! "space": (type: "keys.basis", keys: "@all", max_error: 0.25),
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use super::{AlignTo, align, contours, key_shapes};
use crate::algo::pca::{Keep, Space, pca};
use crate::algo::raster::{Affine, Raster};
use crate::algo::track_affine::{Model, Tone, toned};
use crate::algo::warp_affine::{Filter, Outside, Source, WarpOptions, warp_affine};
use crate::algo::window::Window;
use crate::data::{Basis, BasisKind, Image, KeyImages, KeyShapes};

/// Worst error of shapes where nothing is said, pixels.
const SHAPE_ERROR: f64 = 0.25;
/// Worst error of pictures where nothing is said, in sample values.
const IMAGE_ERROR: f64 = 0.01;

/// The linear space that key shapes, or key pictures, span.
///
/// `keys` are L + 1 shapes whose weights add up to 1 (eq. 3): the mean plus each component, then the mean itself. A component is so long that the
/// example farthest along it has weight 1 or -1. Of pictures they are the shapes that go with the components, so that weights of pictures, put
/// on them by `retarget.shapes`, give the contour.
#[derive(Node)]
#[node(
    id = "keys.basis",
    version = 1,
    outputs = KeysBasisOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.3, eq. 3; section 3.3, eqs. 14 and 15",
    example = "\"space\": (type: \"keys.basis\", keys: \"@all\", max_error: 0.25)"
)]
pub(crate) struct KeysBasis {
    /// The examples: keys and in-betweens.
    keys: In<KeyShapes>,
    /// A picture of each. The space is then one of pictures.
    images: Option<In<KeyImages>>,
    /// The worst example may be off by so much, root mean square: over its points in pixels (0.25 where it is left out), of pictures over their
    /// samples in the `tone` (0.01). 0 keeps all components.
    #[input(default = None, range = 0.0..)]
    max_error: Option<f64>,
    /// Number of components, whatever the error. As many as `max_error` needs where it is left out; the paper takes 10 of pictures.
    #[input(default = None, range = 0..=10000)]
    components: Option<u32>,
    /// What keys and their pictures are moved onto before they are compared, so that no component is spent on what a motion can do (eq. 5).
    #[input(default = none)]
    align: AlignTo,
    /// Motions that `align` may use.
    #[input(default = affine)]
    align_model: Model,
    /// How samples of pictures are encoded before they are compared; `track.eigen` takes the footage in the same way.
    #[input(default = encoded)]
    tone: Tone,
}

/// The space, and how well it holds the examples.
#[derive(Outputs)]
pub(crate) struct KeysBasisOutputs {
    /// Mean and orthonormal components: x and y of each point in turn, pixels; or the samples of pictures.
    basis: Basis,
    /// The mean plus each component, then the mean.
    keys: KeyShapes,
    /// Error of the worst example with 0, 1, 2, ... components, root mean square, as in `max_error`.
    errors: Vector,
    /// Share of the variance that 0, 1, 2, ... components hold, up to those that were kept.
    explained: Vector,
    /// Number of components.
    count: Curve,
}

/// What is compared: one row of numbers an example.
struct Examples {
    rows: Vec<Vec<f64>>,
    /// Points or samples that an error is a mean over.
    places: usize,
    max_error: f64,
    /// The space that they span, still without mean and components.
    of: Basis,
}

fn empty() -> Result<Basis, NodeError> {
    let none = NdArray::new([0, 0], Vec::new()).ok_or_else(|| NodeError::internal("no components"))?;
    Ok(Basis::new(Vec::new(), none, Vec::new()))
}

fn of_shapes(shapes: &[Vec<[f64; 2]>]) -> Result<Examples, NodeError> {
    let rows = shapes.iter().map(|s| s.as_flattened().to_vec()).collect();
    let places = shapes.first().map_or(0, Vec::len);
    Ok(Examples { rows, places, max_error: SHAPE_ERROR, of: Basis { kind: BasisKind::Shapes, ..empty()? } })
}

/// Pictures moved with their keys, in their format.
fn moved(images: &KeyImages, motions: &[Affine]) -> Result<KeyImages, NodeError> {
    let [n, h, w, c] = images.pixels.shape();
    if n != motions.len() {
        let help = "`keys.inbetween` makes the pictures of what it puts between keys";
        return Err(NodeError::input(format!("expected {} pictures, one for each key, found {n}", motions.len())).help(help));
    }
    let mut all = images.clone();
    let options = WarpOptions { filter: Filter::Cubic, outside: Outside::Transparent, antialias: true };
    let each = (h * w * c).max(1);
    let pictures = all.pixels.data_mut().chunks_exact_mut(each).zip(images.pixels.data().chunks_exact(each));
    for ((into, data), motion) in pictures.zip(motions) {
        let source = Source::new(Raster { data, width: w, height: h, channels: c }, [0, 0]);
        warp_affine(source, motion, options, into, Window::at_origin(w, h)).map_err(|e| NodeError::input(e.to_string()))?;
    }
    Ok(all)
}

/// The samples of pictures where any of them has some.
fn of_images(images: &KeyImages, tone: Tone) -> Result<Examples, NodeError> {
    let [n, h, w, c] = images.pixels.shape();
    let window = filled(images);
    if window.is_empty() {
        return Err(NodeError::input("expected pictures with something on them, found none that is not empty"));
    }
    let display = Window::at_origin(w, h);
    let blank = Image::new(0, 0, c, Vec::new()).ok_or_else(|| NodeError::internal("no picture"))?;
    let row = |k: usize| {
        let lines = (0..window.height).map(|y| ((k * h + window.y as usize + y) * w + window.x as usize) * c);
        let samples = lines.flat_map(|at| images.pixels.data()[at..at + window.width * c].iter().enumerate());
        samples.map(|(i, v)| f64::from(if Some(i % c) == blank.alpha() { *v } else { toned(*v, tone) })).collect()
    };
    let of = Basis {
        kind: BasisKind::Images,
        window: Some(window),
        display_window: Some(display),
        channels: blank.channels(),
        tone,
        ..empty()?
    };
    Ok(Examples { rows: (0..n).map(row).collect(), places: window.width * window.height * c, max_error: IMAGE_ERROR, of })
}

/// The least rectangle outside of which all pictures are empty.
fn filled(images: &KeyImages) -> Window {
    let [n, h, w, c] = images.pixels.shape();
    let mut bounds: Option<[usize; 4]> = None;
    for (line, samples) in images.pixels.data().chunks_exact((w * c).max(1)).enumerate().take(n * h) {
        let full = |p: &[f32]| p.iter().any(|v| *v != 0.0);
        let Some(left) = samples.chunks_exact(c).position(full) else { continue };
        let right = samples.chunks_exact(c).rposition(full).map_or(left, |r| r) + 1;
        let y = line % h;
        let [x0, y0, x1, y1] = bounds.unwrap_or([left, y, right, y + 1]);
        bounds = Some([x0.min(left), y0.min(y), x1.max(right), y1.max(y + 1)]);
    }
    bounds.map_or_else(Window::default, |[x0, y0, x1, y1]| Window::new(x0 as i64, y0 as i64, x1 - x0, y1 - y0))
}

/// The shapes of equation 3: those that change as the examples' coordinates do, by least squares; of shapes, the components themselves.
fn spanning(shapes: &[Vec<[f64; 2]>], basis: &Basis, closed: bool) -> Result<KeyShapes, NodeError> {
    let m = shapes.len() as f64;
    let n = shapes.first().map_or(0, Vec::len);
    let mean: Vec<[f64; 2]> = (0..n).map(|i| [0, 1].map(|c| shapes.iter().map(|s| s[i][c]).sum::<f64>() / m)).collect();
    let along = |(l, (reach, variance)): (usize, (f64, &f64))| -> Vec<[f64; 2]> {
        // Coordinates along different components are not correlated, so that each stands alone.
        let mut shape = mean.clone();
        for (s, c) in shapes.iter().zip(&basis.coordinates) {
            let share = reach * c[l] / (m * variance);
            for (p, (a, b)) in shape.iter_mut().zip(s.iter().zip(&mean)) {
                (0..2).for_each(|k| p[k] += share * (a[k] - b[k]));
            }
        }
        shape
    };
    let mut all: Vec<Vec<[f64; 2]>> = basis.reach().into_iter().zip(&basis.variances).enumerate().map(along).collect();
    let names = (1..=all.len()).map(|l| format!("component {l}")).chain(["mean".to_owned()]).collect();
    all.push(mean);
    key_shapes(&all, names, closed)
}

fn explained(space: &Space, examples: &[&[f64]]) -> Vec<f64> {
    let squares = |e: &&[f64]| e.iter().zip(&space.mean).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    let total = examples.iter().map(squares).sum::<f64>() / examples.len() as f64;
    let mut sum = 0.0;
    let mut shares = vec![if total > 0.0 { 0.0 } else { 1.0 }];
    for v in &space.variances {
        sum += v;
        shares.push((sum / total).min(1.0));
    }
    shares
}

impl PerFrame for KeysBasis {
    fn run(self, _cx: &Context) -> Result<KeysBasisOutputs, NodeError> {
        let mut shapes = contours(&self.keys);
        if let Some(key) = shapes.iter().position(|s| !s.as_flattened().iter().all(|v| v.is_finite())) {
            return Err(NodeError::input(format!("expected finite points, found NaN or infinity in key {key}")));
        }
        let motions = align(&mut shapes, self.align, self.align_model)?;
        let examples = match &self.images {
            Some(images) => of_images(&moved(images, &motions)?, self.tone)?,
            None => of_shapes(&shapes)?,
        };
        let rows: Vec<&[f64]> = examples.rows.iter().map(Vec::as_slice).collect();
        let keep = self.components.map_or(Keep::MaxError(self.max_error.unwrap_or(examples.max_error)), |n| Keep::Components(n as usize));
        let space = pca(&rows, examples.places, keep).map_err(|e| NodeError::input(e.to_string()))?;
        let (l, d) = (space.components.len(), space.mean.len());
        let explained = Vector { values: explained(&space, &rows) };
        let components =
            NdArray::new([l, d], space.components.concat()).ok_or_else(|| NodeError::internal("components of another length"))?;
        let basis = Basis { mean: space.mean, components, variances: space.variances, coordinates: space.coordinates, ..examples.of };
        Ok(KeysBasisOutputs {
            keys: spanning(&shapes, &basis, self.keys.closed)?,
            explained,
            count: Curve { value: l as f64 },
            errors: Vector { values: space.errors },
            basis,
        })
    }
}

#[cfg(test)]
mod tests;
