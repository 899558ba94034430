//! `retarget.drawings`: captured weights and motion put on a vector character of many paths.
//!
//! **Method** the keys are blended by the weights, then moved by the captured motion. `linear` blends every point by itself. `extended` and `arap` blend
//! the contour of one path, `outline`, with triangles inside ([`crate::algo::key_blend`]), and each other point goes where the triangle that it lies in
//! takes it, outside where those around it do: from its place in each key, these places blended by the weights, so that keys come out exactly.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 and equations 2 and 3; Alexa, Cohen-Or, Levin 2000.
//!
//! **Fails when** there is not one weight for each key, points are not finite, or the outline is no path of one closed contour that does not cross itself.
//!
//! **Cost** O(k n) a frame; `extended` and `arap` once as `keys.inbetween` and O(k n t) for t triangles, then
//! O(k n) a frame for points inside the outline and O(k n v) for those outside, v vertices.
//!
//! ```ron
//! "bunny": (type: "retarget.drawings", keys: "@bunny_keys", weights: "@capture.weights", motion: "@capture.motion", interpolation: arap, outline: "body"),
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, In, NodeError, Recurrent};
use pegbar_engine::{Node, Outputs};

use super::{How, Made, Ready, expect_weights, moved, placed, ready, refused};
use crate::algo::key_blend::Interpolation;
use crate::algo::raster::{Affine, apply};
use crate::algo::track_affine::Model;
use crate::data::{Affine2, Drawing, KeyDrawings, KeyShapes, Weights};
use crate::keys::AlignTo;

/// Captured weights and motion put on a vector character of many paths.
///
/// Each target key corresponds to the captured key at the same position: where one is more extreme, the other must be more so in the same way.
#[derive(Node)]
#[node(
    id = "retarget.drawings",
    version = 2,
    kind = recurrent,
    outputs = RetargetDrawingsOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4, eqs. 2 and 3",
    example = "\"bunny\": (type: \"retarget.drawings\", keys: \"@keys\", weights: \"@capture.weights\", motion: \"@capture.motion\")"
)]
pub(crate) struct RetargetDrawings {
    /// The target's key drawings, one for each captured key.
    keys: In<KeyDrawings>,
    /// How much of each key.
    weights: In<Weights>,
    /// The captured motion: frame from reference, pixels. None where it is left out.
    motion: Option<In<Affine2>>,
    /// Where the keys are put before the motion: reference from keys, pixels. As drawn where it is left out.
    place: Option<In<Affine2>>,
    /// What lies between the keys.
    #[input(default = linear)]
    interpolation: Interpolation,
    /// Name of the path whose inside carries the others, for `extended` and `arap`: one closed contour around all that bends. The path of the
    /// largest area where it is left out.
    #[input(default = None)]
    outline: Option<String>,
    /// In-betweens of each pair for `extended`.
    #[input(default = 5, range = 0..=1000)]
    inbetweens: u32,
    /// True prefers no key for `extended` and `arap`; false takes the first as the paper does.
    #[input(default = true)]
    symmetric: bool,
    /// The point of the outline that goes straight from key to key in `extended` and `arap`. The centroid where it is left out.
    #[input(default = None, range = 0..=1000000)]
    anchor: Option<u32>,
    /// What the keys are moved onto before they are blended, so that only the captured motion moves them (eq. 5): by all points, or by the outline
    /// for `extended` and `arap`.
    #[input(default = none)]
    align: AlignTo,
    /// Motions that `align` may use.
    #[input(default = affine)]
    align_model: Model,
}

/// The target's drawing.
#[derive(Outputs)]
pub(crate) struct RetargetDrawingsOutputs {
    /// Its paths as in the keys, pixels.
    drawing: Drawing,
}

/// The points of some part of each key.
fn part(keys: &KeyDrawings, first: usize, n: usize, closed: bool) -> Result<KeyShapes, NodeError> {
    let flat: Vec<f64> = (0..keys.len()).flat_map(|k| keys.key(k)[first..first + n].as_flattened()).copied().collect();
    let points = NdArray::new([keys.len(), n, 2], flat).ok_or_else(|| NodeError::internal("keys of other points"))?;
    Ok(KeyShapes { points, names: keys.keys.clone(), closed })
}

impl RetargetDrawings {
    /// First point and number of points of the outline.
    fn outline(&self) -> Result<(usize, usize), NodeError> {
        let template = self.keys.drawing(self.keys.key(0).to_vec());
        let outlines = template.outlines();
        let Some(name) = &self.outline else {
            let closed = outlines.iter().filter_map(|o| if let [only] = o[..] { Some(only) } else { None }).filter(|c| c.closed);
            let largest = closed.max_by(|a, b| area(a.points).total_cmp(&area(b.points)));
            return largest.map(|c| (c.first, c.points.len())).ok_or_else(|| refused("expected a path of one closed contour, found none"));
        };
        let Some(path) = self.keys.names.iter().position(|n| n == name) else {
            let names: Vec<&str> = self.keys.names.iter().map(String::as_str).filter(|n| !n.is_empty()).collect();
            let message = format!("expected a path `{name}` for the outline, found none");
            return Err(refused(message).help(format!("the paths are {}", names.join(", "))));
        };
        match outlines[path][..] {
            [contour] if contour.closed => Ok((contour.first, contour.points.len())),
            [_] => Err(refused(format!("path `{name}`: expected a closed outline, found an open one"))),
            ref other => Err(refused(format!("path `{name}`: expected an outline of one contour, found {}", other.len()))),
        }
    }

    /// All points as the mesh inside the outline takes them.
    fn carried(&self, made: &Made) -> Result<Vec<[f64; 2]>, NodeError> {
        let weights = &self.weights.weights;
        expect_weights(weights, self.keys.len())?;
        let to = made.blend.blend(weights).map_err(refused)?;
        let anew;
        let hung = match made.hung.get_or_init(|| Hung::new(&self.keys, made)) {
            kept if kept.points == self.keys.points => kept,
            // Keys that change over time may keep their outline.
            _ => {
                anew = Hung::new(&self.keys, made);
                &anew
            }
        };
        let mut sum = vec![[0.0; 2]; self.keys.key(0).len()];
        for (shares, &weight) in hung.shares.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
            for (shares, out) in shares.iter().zip(&mut sum) {
                for &(vertex, share) in shares {
                    (0..2).for_each(|c| out[c] += weight * share * to[vertex as usize][c]);
                }
            }
        }
        Ok(sum)
    }
}

/// What the points of key drawings hang on: made once, as a search among all triangles costs more than what is left for a frame.
#[derive(Debug)]
pub(super) struct Hung {
    /// The keys that it was made of.
    points: NdArray<f64, 3>,
    /// For each key and point, vertices of the mesh and the point's share of each.
    shares: Vec<Vec<Vec<(u32, f64)>>>,
}

impl Hung {
    fn new(keys: &KeyDrawings, made: &Made) -> Self {
        let meshes = made.blend.keys().iter().zip(&made.motions).enumerate();
        let of = |(k, (mesh, motion)): (usize, (&Vec<[f64; 2]>, &Affine))| {
            keys.key(k).iter().map(|p| hang(made.blend.triangles(), mesh, apply(motion, (*p).into()).into())).collect()
        };
        Self { points: keys.points.clone(), shares: meshes.map(of).collect() }
    }
}

/// The shares of a point among the vertices of a mesh, adding up to 1: those of the triangle that it lies in; outside, of all triangles, the near and
/// large ones most, so that what sticks out does not tear where the nearest one changes.
fn hang(triangles: &[[u32; 3]], mesh: &[[f64; 2]], p: [f64; 2]) -> Vec<(u32, f64)> {
    let (mut sum, mut total) = (vec![0.0; mesh.len()], 0.0);
    for t in triangles {
        let [a, b, c] = t.map(|i| mesh[i as usize]);
        let cross = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let area = cross(a, b, c);
        let shares = [cross(p, b, c) / area, cross(p, c, a) / area, cross(p, a, b) / area];
        let away = [(a, b), (b, c), (c, a)].map(|(a, b)| distance(p, a, b)).into_iter().fold(f64::INFINITY, f64::min);
        if away == 0.0 || shares.iter().all(|s| *s >= 0.0) {
            return t.iter().copied().zip(shares).collect();
        }
        // The fourth power falls off faster than the number of triangles at a distance grows.
        let near = area.abs() / (away * away * away * away);
        if near.is_finite() && shares.iter().all(|s| s.is_finite()) {
            t.iter().zip(shares).for_each(|(i, s)| sum[*i as usize] += near * s);
            total += near;
        }
    }
    (0..).zip(sum).filter(|(_, s)| *s != 0.0).map(|(i, s)| (i, s / total)).collect()
}

fn area(points: &[[f64; 2]]) -> f64 {
    let n = points.len();
    let cross = |i: usize| points[i][0] * points[(i + 1) % n][1] - points[i][1] * points[(i + 1) % n][0];
    (0..n).map(cross).sum::<f64>().abs() / 2.0
}

/// How far a point is from a line between two others.
fn distance(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let square = d[0] * d[0] + d[1] * d[1];
    let t = if square > 0.0 { ((d[0] * e[0] + d[1] * e[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
    libm::hypot(e[0] - t * d[0], e[1] - t * d[1])
}

impl Recurrent for RetargetDrawings {
    type State = Ready;

    fn run(self, state: Option<&Ready>, _cx: &Context) -> Result<(RetargetDrawingsOutputs, Ready), NodeError> {
        if self.keys.is_empty() {
            return Err(refused("expected at least one key, found none"));
        }
        if let Some(found) = self.keys.points.data().iter().find(|v| !v.is_finite()) {
            return Err(refused(format!("expected key drawings of finite points, found {found}")));
        }
        let mesh = self.interpolation != Interpolation::Linear;
        let n = self.keys.key(0).len();
        let (first, count) = if mesh { self.outline()? } else { (0, n) };
        let how = How {
            interpolation: self.interpolation,
            inbetweens: self.inbetweens,
            symmetric: self.symmetric,
            anchor: self.anchor.filter(|_| mesh),
            align: self.align,
            align_model: self.align_model,
            mesh,
        };
        let (made, state) = ready(&part(&self.keys, first, count, mesh)?, state, how)?;
        let points = if mesh { self.carried(&made)? } else { made.blend.blend(&self.weights.weights).map_err(refused)? };
        let map = placed(self.place.as_deref(), self.motion.as_deref())?;
        Ok((RetargetDrawingsOutputs { drawing: self.keys.drawing(moved(&points, &map)) }, state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        // All frames start from the first, which makes the keys ready, so that they need not wait for each other.
        (cx.frame > cx.clock.first).then_some(cx.clock.first)
    }
}

#[cfg(test)]
mod tests;
