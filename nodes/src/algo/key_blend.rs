//! Key shapes blended by weights: as they stand, along in-betweens, or as rigidly as possible (Bregler et al. 2002, sections 3.1.3 and 3.4).

use super::arap::{Arap, ArapError, OpenBlend, Options as ArapOptions, sole};
use super::compatible::{Compatible, CompatibleError, Options as MeshOptions, Point, triangulate};

/// What lies between key shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Interpolation {
    /// The weighted sum of the points, B eq. 2: what turns shrinks on the way.
    Linear,
    /// The weighted sum of keys and in-betweens, B eq. 3: what turns keeps its size, and the space stays linear.
    Extended,
    /// As rigid as possible, exactly: what turns, turns.
    Arap,
}

/// Why key shapes cannot be blended.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum KeyBlendError {
    /// They have no common triangulation.
    #[error("key shapes: {0}")]
    Compatible(#[from] CompatibleError),
    /// They do not fit each other.
    #[error("key shapes: {0}")]
    Arap(#[from] ArapError),
    /// Weights of another number.
    #[error("expected {keys} weights, one for each key, or {extended}, one more for each in-between, found {found}")]
    Weights {
        /// Keys.
        keys: usize,
        /// Keys and in-betweens.
        extended: usize,
        /// Weights found.
        found: usize,
    },
    /// NaN or infinity.
    #[error("expected finite weights, found NaN or infinity at weight {at}")]
    NotFinite {
        /// The weight, from 0.
        at: usize,
    },
}

/// How keys are made ready.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// What lies between them.
    pub interpolation: Interpolation,
    /// In-betweens of each pair, for the extended space.
    pub count: usize,
    /// Closed contours, which have an inside; else open curves.
    pub closed: bool,
    /// Also makes the triangles where the interpolation needs none: for pictures.
    pub mesh: bool,
    /// How keys are blended where they have an inside.
    pub arap: ArapOptions,
}

#[derive(Debug)]
enum How {
    Linear,
    Rigid(Box<Rigid>),
    /// For each pair of keys its in-betweens.
    Extended(Vec<Vec<Vec<Point>>>),
}

#[derive(Debug)]
enum Rigid {
    Closed(Arap),
    Open(OpenBlend),
}

impl Rigid {
    fn new(keys: &[&[Point]], triangles: Option<&[[u32; 3]]>, options: ArapOptions) -> Result<Self, KeyBlendError> {
        Ok(match triangles {
            Some(triangles) => Self::Closed(Arap::new(triangles, keys, options)?),
            None => Self::Open(OpenBlend::new(keys, options.gauge)?),
        })
    }

    fn blend(&self, weights: &[&[f64]]) -> Result<Vec<Vec<Point>>, ArapError> {
        match self {
            Self::Closed(arap) => arap.blend(weights),
            Self::Open(open) => weights.iter().map(|w| open.blend(w)).collect(),
        }
    }
}

/// Key shapes, ready to be blended.
#[derive(Debug)]
pub struct KeyBlend {
    keys: Vec<Vec<Point>>,
    triangles: Vec<[u32; 3]>,
    n_contour: usize,
    how: How,
}

impl KeyBlend {
    /// Prepares key shapes of one point order.
    ///
    /// Errors: key shapes that have no compatible triangulation where one is needed, or that do not fit each other.
    pub fn new(keys: &[&[Point]], options: Options) -> Result<Self, KeyBlendError> {
        let needed = options.closed && (options.mesh || options.interpolation != Interpolation::Linear);
        let mesh = if needed { Some(triangulate(keys, MeshOptions::default())?) } else { None };
        Self::with_mesh(keys, mesh, options)
    }

    fn with_mesh(keys: &[&[Point]], mesh: Option<Compatible>, options: Options) -> Result<Self, KeyBlendError> {
        let n_contour = keys.first().map_or(0, |k| k.len());
        let triangles = mesh.as_ref().map(|m| m.triangles.clone());
        let keys = mesh.map_or_else(|| keys.iter().map(|k| k.to_vec()).collect(), |m| m.points);
        let views: Vec<&[Point]> = keys.iter().map(Vec::as_slice).collect();
        let how = match options.interpolation {
            Interpolation::Linear => {
                OpenBlend::new(&views, options.arap.gauge)?;
                How::Linear
            }
            Interpolation::Arap => How::Rigid(Box::new(Rigid::new(&views, triangles.as_deref(), options.arap)?)),
            Interpolation::Extended => How::Extended(chains(&views, triangles.as_deref(), options)?),
        };
        Ok(Self { keys, triangles: triangles.unwrap_or_default(), n_contour, how })
    }

    /// Corners of the triangles, by point; none where no inside was needed.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The points of each key: those of its contour, then those inside.
    pub fn keys(&self) -> &[Vec<Point>] {
        &self.keys
    }

    /// Points of a contour.
    pub fn n_contour(&self) -> usize {
        self.n_contour
    }

    /// The blend by weights that add up to 1: contour, then inside.
    ///
    /// The extended space also takes one weight for each key and in-between, in the order of [`inbetweens`].
    /// Errors: another number of weights, weights that are not finite.
    pub fn blend(&self, weights: &[f64]) -> Result<Vec<Point>, KeyBlendError> {
        if let Some(at) = weights.iter().position(|w| !w.is_finite()) {
            return Err(KeyBlendError::NotFinite { at });
        }
        let (k, extra) = (self.keys.len(), self.n_between());
        let found = weights.len();
        if found != k && (found != k + extra || extra == 0) {
            return Err(KeyBlendError::Weights { keys: k, extended: k + extra, found });
        }
        match &self.how {
            How::Rigid(rigid) => Ok(rigid.blend(&[weights])?.pop().unwrap_or_default()),
            How::Linear => Ok(weighted(self.keys.iter().zip(weights))),
            How::Extended(chains) if found == k => Ok(self.along(chains, weights)),
            How::Extended(chains) => Ok(weighted(self.keys.iter().chain(chains.iter().flatten()).zip(weights))),
        }
    }

    fn n_between(&self) -> usize {
        match &self.how {
            How::Extended(chains) => chains.iter().map(Vec::len).sum(),
            _ => 0,
        }
    }

    /// The weighted sum of the keys, and for each pair what its chain of in-betweens bulges out of the line between the two.
    ///
    /// With two weights that are not zero this is the place on their chain; it is continuous in all weights, and beyond the keys goes on straight.
    fn along(&self, chains: &[Vec<Vec<Point>>], weights: &[f64]) -> Vec<Point> {
        let mut sum = weighted(self.keys.iter().zip(weights));
        for ((i, j), chain) in pairs(self.keys.len()).zip(chains) {
            let both = weights[i] + weights[j];
            let t = weights[j] / both;
            if both == 0.0 || !(t > 0.0 && t < 1.0) {
                continue;
            }
            let at = t * (chain.len() + 1) as f64;
            let k = (at as usize).min(chain.len());
            let (low, high) = (node(&self.keys, chain, (i, j), k), node(&self.keys, chain, (i, j), k + 1));
            let f = at - k as f64;
            for (p, point) in sum.iter_mut().enumerate() {
                for c in 0..2 {
                    let straight = self.keys[i][p][c] + (self.keys[j][p][c] - self.keys[i][p][c]) * t;
                    point[c] += both * (low[p][c] + (high[p][c] - low[p][c]) * f - straight);
                }
            }
        }
        sum
    }
}

/// Shape `k` on the way from one key over a chain to another.
fn node<'a>(keys: &'a [Vec<Point>], chain: &'a [Vec<Point>], (i, j): (usize, usize), k: usize) -> &'a [Point] {
    match k {
        0 => &keys[i],
        k => chain.get(k - 1).unwrap_or(&keys[j]),
    }
}

/// Pairs of `k` keys: (0, 1), (0, 2), ... (1, 2), ...
fn pairs(k: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..k).flat_map(move |i| (i + 1..k).map(move |j| (i, j)))
}

/// A weighted sum of points; one shape that has all the weight comes out as it is.
fn weighted<'a>(shapes: impl Iterator<Item = (&'a Vec<Point>, &'a f64)> + Clone) -> Vec<Point> {
    let all: Vec<f64> = shapes.clone().map(|(_, w)| *w).collect();
    if let Some(only) = sole(&all) {
        return shapes.clone().nth(only).map(|(s, _)| s.clone()).unwrap_or_default();
    }
    let mut sum = vec![[0.0; 2]; shapes.clone().next().map_or(0, |(s, _)| s.len())];
    for (shape, w) in shapes {
        for (a, b) in sum.iter_mut().zip(shape) {
            (0..2).for_each(|c| a[c] += w * b[c]);
        }
    }
    sum
}

/// For each pair its in-betweens, at even steps.
fn chains(keys: &[&[Point]], triangles: Option<&[[u32; 3]]>, options: Options) -> Result<Vec<Vec<Vec<Point>>>, KeyBlendError> {
    let t: Vec<[f64; 2]> = (1..=options.count).map(|m| m as f64 / (options.count + 1) as f64).map(|t| [1.0 - t, t]).collect();
    let weights: Vec<&[f64]> = t.iter().map(|w| w.as_slice()).collect();
    let chain = |(i, j): (usize, usize)| Ok(Rigid::new(&[keys[i], keys[j]], triangles, options.arap)?.blend(&weights)?);
    pairs(keys.len()).map(chain).collect()
}

/// In-betweens of each pair of keys, `count` of them at even steps: pairs (0, 1), (0, 2), ... (1, 2), ... one after the other.
///
/// Errors: as [`KeyBlend::new`].
pub fn inbetweens(keys: &[&[Point]], options: Options) -> Result<Vec<Vec<Point>>, KeyBlendError> {
    let blend = KeyBlend::new(keys, Options { interpolation: Interpolation::Extended, ..options })?;
    let How::Extended(chains) = blend.how else { return Ok(Vec::new()) };
    Ok(chains
        .into_iter()
        .flatten()
        .map(|mut shape| {
            shape.truncate(blend.n_contour);
            shape
        })
        .collect())
}

#[cfg(test)]
mod tests;
