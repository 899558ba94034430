//! As-rigid-as-possible blends of key shapes (Alexa, Cohen-Or, Levin, As-rigid-as-possible shape interpolation, SIGGRAPH 2000).
//!
//! Each triangle's map from a reference key to another key is a rotation times a symmetric stretch; angles and stretches are blended by the
//! keys' weights, and the points are those whose triangles are nearest to that, by one sparse factorisation for all blends. With two keys and
//! weights (1 - t, t) this is Alexa's in-between; with more it blends them all at once. Rotations are followed from triangle to triangle, so
//! that they may pass half a turn.

mod angles;
mod open;
mod skyline;
#[cfg(test)]
mod tests;

use crate::algo::compatible::{Point, cross, sub};

pub use open::OpenBlend;
pub(crate) use open::followed;
pub(crate) use skyline::Skyline;

/// What holds a blend in place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gauge {
    /// The centroid goes along the blend of the keys' centroids: no point is special.
    Centroid,
    /// This point goes along the blend of its places, as in the paper.
    Vertex(usize),
}

/// How keys are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Each key is the reference in turn, so that no order of the keys is preferred; else the first is.
    pub symmetric: bool,
    /// Triangles count by their area, so that the blend does not depend on how fine they are; else equally, as in the paper.
    pub area_weights: bool,
    /// What holds a blend in place.
    pub gauge: Gauge,
}

impl Default for Options {
    fn default() -> Self {
        Self { symmetric: true, area_weights: true, gauge: Gauge::Centroid }
    }
}

/// Why keys cannot be blended.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ArapError {
    /// No key, or no triangle.
    #[error("expected at least one key and one triangle, found {keys} keys and {triangles} triangles")]
    Empty {
        /// Keys found.
        keys: usize,
        /// Triangles found.
        triangles: usize,
    },
    /// Keys of different numbers of points.
    #[error("expected {expected} points in key {key} as in key 0, found {found}")]
    Count {
        /// The key, from 0.
        key: usize,
        /// Points of key 0.
        expected: usize,
        /// Points found.
        found: usize,
    },
    /// NaN or infinity.
    #[error("expected finite points, found NaN or infinity in key {key}")]
    NotFinite {
        /// The key, from 0.
        key: usize,
    },
    /// A triangle that has no area or is turned over.
    #[error("expected triangles with area in every key, found triangle {triangle} of key {key} flat or turned over")]
    Flat {
        /// The key, from 0.
        key: usize,
        /// The triangle, from 0.
        triangle: usize,
    },
    /// A triangle that names a point that there is not, or points that hang on no triangle.
    #[error("expected triangles that join points 0 to {last}, found other ones or points apart")]
    Apart {
        /// The last point.
        last: usize,
    },
    /// A point that there is not is to hold the blend in place.
    #[error("expected a point from 0 to {last} as anchor, found {found}")]
    Anchor {
        /// The last point.
        last: usize,
        /// The point asked for.
        found: usize,
    },
    /// A curve whose points all coincide.
    #[error("expected a curve of at least two points that are apart, found none")]
    Short,
    /// Weights of another number.
    #[error("expected {expected} weights, one for each key, found {found}")]
    Weights {
        /// Keys.
        expected: usize,
        /// Weights found.
        found: usize,
    },
}

/// The keys as seen from one of them.
#[derive(Debug)]
struct View {
    /// For each triangle the gradients of its corners' hat functions, times its weight: x of the three, then y.
    gradients: Vec<[f64; 6]>,
    /// For each key and triangle the rotation in radians, and the stretch as xx, xy, yy.
    maps: Vec<Vec<[f64; 4]>>,
}

/// Keys on one triangulation, ready to be blended.
#[derive(Debug)]
pub struct Arap {
    triangles: Vec<[u32; 3]>,
    keys: Vec<Vec<Point>>,
    views: Vec<View>,
    matrix: Skyline,
    /// How much each point counts in what holds the blend in place; they add up to one.
    gauge: Vec<f64>,
}

impl Arap {
    /// Prepares `keys`, all with the same `triangles`, each of positive area in every key.
    ///
    /// Errors: keys that do not fit each other, are not finite, or turn a triangle over.
    /// Cost: one factorisation, O(n b²) with the bandwidth b, about √n for a compact mesh.
    pub fn new(triangles: &[[u32; 3]], keys: &[&[Point]], options: Options) -> Result<Self, ArapError> {
        validate(triangles, keys)?;
        let n = keys[0].len();
        let references = if options.symmetric { keys } else { &keys[..1] };
        let views: Vec<View> = references.iter().map(|from| view(triangles, from, keys, options.area_weights)).collect();
        let mut entries = Vec::with_capacity(9 * triangles.len() * views.len());
        for (view, from) in views.iter().zip(references) {
            stiffness(triangles, view, from, options.area_weights, &mut entries);
        }
        let matrix = Skyline::new(n, &entries).ok_or(ArapError::Apart { last: n - 1 })?;
        let gauge = match options.gauge {
            Gauge::Vertex(v) => held(v, n)?,
            Gauge::Centroid => centroid_weights(triangles, references, n),
        };
        Ok(Self { triangles: triangles.to_vec(), keys: keys.iter().map(|k| k.to_vec()).collect(), views, matrix, gauge })
    }

    /// Number of keys.
    pub fn n_keys(&self) -> usize {
        self.keys.len()
    }

    /// A blend for each set of weights; where one key has all the weight, that key itself.
    ///
    /// Weights add up to 1; those outside 0 to 1 exaggerate. Errors: another number of weights than of keys.
    /// Cost: O(triangles · keys + n b) a blend.
    pub fn blend(&self, weights: &[&[f64]]) -> Result<Vec<Vec<Point>>, ArapError> {
        let expected = self.keys.len();
        if let Some(found) = weights.iter().map(|w| w.len()).find(|n| *n != expected) {
            return Err(ArapError::Weights { expected, found });
        }
        let (n, f) = (self.keys[0].len(), weights.len());
        let mut columns = vec![0.0; n * 2 * f];
        for view in &self.views {
            view.add_target(&self.triangles, weights, &mut columns);
        }
        self.matrix.solve(&mut columns, 2 * f);
        Ok((0..f).map(|k| self.placed(weights[k], k, f, &columns)).collect())
    }

    /// In-betweens of the first key and the second at each `t`, 0 to 1.
    ///
    /// Errors: where there are not just two keys.
    pub fn between(&self, t: &[f64]) -> Result<Vec<Vec<Point>>, ArapError> {
        let weights: Vec<[f64; 2]> = t.iter().map(|t| [1.0 - t, *t]).collect();
        self.blend(&weights.iter().map(|w| w.as_slice()).collect::<Vec<_>>())
    }

    /// Blend `k` of `f`, moved to where the gauge holds it.
    fn placed(&self, weights: &[f64], k: usize, f: usize, columns: &[f64]) -> Vec<Point> {
        if let Some(key) = sole(weights) {
            return self.keys[key].clone();
        }
        let at = |i: usize| [columns[2 * f * i + k], columns[2 * f * i + f + k]];
        let mut shift = [0.0; 2];
        for (i, g) in self.gauge.iter().enumerate().filter(|(_, g)| **g != 0.0) {
            let p = at(i);
            for c in 0..2 {
                let held: f64 = self.keys.iter().zip(weights).map(|(key, w)| w * key[i][c]).sum();
                shift[c] += g * (held - p[c]);
            }
        }
        (0..self.gauge.len()).map(at).map(|p| [p[0] + shift[0], p[1] + shift[1]]).collect()
    }
}

/// All of the gauge at one point.
fn held(v: usize, n: usize) -> Result<Vec<f64>, ArapError> {
    if v >= n {
        return Err(ArapError::Anchor { last: n - 1, found: v });
    }
    Ok((0..n).map(|i| f64::from(u8::from(i == v))).collect())
}

/// The key that has all of the weight.
pub(crate) fn sole(weights: &[f64]) -> Option<usize> {
    let key = weights.iter().position(|w| *w == 1.0)?;
    weights.iter().enumerate().all(|(k, w)| k == key || *w == 0.0).then_some(key)
}

fn corners(t: &[u32; 3], points: &[Point]) -> [Point; 3] {
    t.map(|i| points[i as usize])
}

fn double_area([a, b, c]: [Point; 3]) -> f64 {
    cross(sub(b, a), sub(c, a))
}

fn validate(triangles: &[[u32; 3]], keys: &[&[Point]]) -> Result<(), ArapError> {
    let expected = match keys.first() {
        Some(first) if !triangles.is_empty() => first.len(),
        _ => return Err(ArapError::Empty { keys: keys.len(), triangles: triangles.len() }),
    };
    if triangles.iter().flatten().any(|i| *i as usize >= expected) {
        return Err(ArapError::Apart { last: expected.saturating_sub(1) });
    }
    for (key, points) in keys.iter().enumerate() {
        if points.len() != expected {
            return Err(ArapError::Count { key, expected, found: points.len() });
        }
        if !points.iter().flatten().all(|v| v.is_finite()) {
            return Err(ArapError::NotFinite { key });
        }
        // A comparison that NaN fails too, for areas beyond the range of numbers.
        let upright = |t: &[u32; 3]| double_area(corners(t, points)) > 0.0;
        if let Some(triangle) = triangles.iter().position(|t| !upright(t)) {
            return Err(ArapError::Flat { key, triangle });
        }
    }
    Ok(())
}

/// The keys as seen from `from`: B equations of Alexa 2000, section 2: A = R S, then blended as R(Σ w θ) Σ w S.
fn view(triangles: &[[u32; 3]], from: &[Point], keys: &[&[Point]], area_weights: bool) -> View {
    let areas: Vec<f64> = triangles.iter().map(|t| double_area(corners(t, from)) / 2.0).collect();
    let plain: Vec<[f64; 6]> = triangles.iter().map(|t| hat_gradients(corners(t, from))).collect();
    let sides = angles::neighbours(triangles);
    let maps = keys
        .iter()
        .map(|to| {
            let mut maps: Vec<[f64; 4]> = triangles.iter().zip(&plain).map(|(t, g)| polar(linear(g, corners(t, to)))).collect();
            angles::unwrap(&mut maps, &sides, &areas);
            maps
        })
        .collect();
    let weighted = |(g, area): (&[f64; 6], &f64)| if area_weights { g.map(|v| v * area) } else { *g };
    View { gradients: plain.iter().zip(&areas).map(weighted).collect(), maps }
}

/// Gradients of the functions that are 1 at one corner and 0 at the others: x of the three, then y.
fn hat_gradients([a, b, c]: [Point; 3]) -> [f64; 6] {
    let (u, v) = (sub(b, a), sub(c, a));
    let area = cross(u, v);
    let (bx, by, cx, cy) = (v[1] / area, -v[0] / area, -u[1] / area, u[0] / area);
    [-bx - cx, bx, cx, -by - cy, by, cy]
}

/// The linear map of a triangle to its image: rows by target coordinate.
fn linear(g: &[f64; 6], to: [Point; 3]) -> [f64; 4] {
    let entry = |c: usize, d: usize| (0..3).map(|i| to[i][c] * g[3 * d + i]).sum();
    [entry(0, 0), entry(0, 1), entry(1, 0), entry(1, 1)]
}

/// Rotation and stretch of a map that keeps orientation: angle, xx, xy, yy. In the plane the polar decomposition is closed.
fn polar([a, b, c, d]: [f64; 4]) -> [f64; 4] {
    let angle = libm::atan2(c - b, a + d);
    let (sin, cos) = libm::sincos(angle);
    // RᵀA is symmetric but for rounding; the mean of its two sides is.
    [angle, cos * a + sin * c, ((cos * b + sin * d) + (cos * c - sin * a)) / 2.0, cos * d - sin * b]
}

/// The matrix of Σ weight |J(V)|² over the triangles.
fn stiffness(triangles: &[[u32; 3]], view: &View, from: &[Point], area_weights: bool, entries: &mut Vec<(u32, u32, f64)>) {
    for (t, g) in triangles.iter().zip(&view.gradients) {
        let weight = if area_weights { double_area(corners(t, from)) / 2.0 } else { 1.0 };
        for i in 0..3 {
            for j in 0..3 {
                if t[i] >= t[j] {
                    entries.push((t[i], t[j], (g[i] * g[j] + g[3 + i] * g[3 + j]) / weight));
                }
            }
        }
    }
}

/// Share of each point in the area of the references.
fn centroid_weights(triangles: &[[u32; 3]], references: &[&[Point]], n: usize) -> Vec<f64> {
    let mut share = vec![0.0; n];
    for points in references {
        for t in triangles {
            let area = double_area(corners(t, points));
            t.iter().for_each(|&i| share[i as usize] += area);
        }
    }
    let sum: f64 = share.iter().sum();
    share.iter().map(|s| s / sum).collect()
}

impl View {
    /// Adds the divergence of the blended maps to `columns`: for each point the x of all blends, then the y.
    fn add_target(&self, triangles: &[[u32; 3]], weights: &[&[f64]], columns: &mut [f64]) {
        let f = weights.len();
        let mut blended = vec![[0.0; 4]; f];
        let mut rows = vec![0.0; 4 * f];
        for (e, (t, g)) in triangles.iter().zip(&self.gradients).enumerate() {
            for (m, w) in blended.iter_mut().zip(weights) {
                *m = [0.0; 4];
                for (maps, w) in self.maps.iter().zip(*w) {
                    (0..4).for_each(|i| m[i] += w * maps[e][i]);
                }
            }
            let (top, bottom) = rows.split_at_mut(2 * f);
            let ((xx, xy), (yx, yy)) = (top.split_at_mut(f), bottom.split_at_mut(f));
            for (k, [angle, a, b, d]) in blended.iter().enumerate() {
                let (sin, cos) = angles::sin_cos(*angle);
                xx[k] = cos * a - sin * b;
                xy[k] = cos * b - sin * d;
                yx[k] = sin * a + cos * b;
                yy[k] = sin * b + cos * d;
            }
            for i in 0..3 {
                let at = 2 * f * t[i] as usize;
                let (x, y) = columns[at..at + 2 * f].split_at_mut(f);
                for k in 0..f {
                    x[k] += g[i] * xx[k] + g[3 + i] * xy[k];
                    y[k] += g[i] * yx[k] + g[3 + i] * yy[k];
                }
            }
        }
    }
}
