//! A mesh warped in the picture by one free-form deformation for each bone.
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, sections 3.3 and 3.4: bone i owns a warp W_i, fitted to all correspondences, each weighted by how much the bone
//! moves it; a vertex goes to sum_i w_ji W_i(p_j). So parts that cover each other in the picture move by themselves.

use pegbar_engine::Setting;

use super::camera::Camera;
use super::mffd::{Datum, Ffd, FitError, Options};

/// Points of a side at which the least growth of each layer is looked for.
const SCAN: usize = 65;

/// A place of a mesh, and where it is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// The mesh edge that it lies on: two vertices, the same one twice for a vertex.
    pub edge: [u32; 2],
    /// How far along, 0 to 1.
    pub share: f64,
    /// Where it is drawn, pixels.
    pub point: [f64; 2],
    /// How much it counts, 0 or more.
    pub weight: f64,
}

/// A posed mesh, and what moves it.
#[derive(Clone, Copy, Debug)]
pub struct Posed<'a> {
    /// Vertices, world space.
    pub positions: &'a [[f64; 3]],
    /// Vertices of each triangle.
    pub triangles: &'a [[u32; 3]],
    /// Joints and weights a vertex.
    pub influences: usize,
    /// Joints that move each vertex.
    pub joints: &'a [u32],
    /// How much.
    pub weights: &'a [f64],
    /// Parent of each joint, -1 for a root; in any order, without rings.
    pub parents: &'a [i64],
}

/// What a bone does that moves no correspondence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Missing {
    /// What the bone above it does that has a layer, or nothing.
    Parent,
    /// Nothing.
    Identity,
    /// Its share of a vertex goes to the vertex's other bones; nothing where there are none.
    Others,
}

/// How layers are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layering {
    /// One warp for each bone; else one for all.
    pub layers: bool,
    /// What a bone does that moves no correspondence.
    pub missing: Missing,
    /// How much a bone must move a correspondence at the least for it to count in the bone's layer, 0 to 1.
    pub least_weight: f64,
    /// Cells of the first level across the longer side of the picture.
    pub cells: usize,
    /// Of the deformations; their cells are made of `cells`.
    pub fit: Options,
}

/// Why a mesh is not warped.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LayerError {
    /// A vertex that there is not.
    #[error("pair {at}: expected vertices below {n}, found {found:?}")]
    Vertex {
        /// The pair, from 0.
        at: usize,
        /// Number of vertices.
        n: usize,
        /// The edge.
        found: [u32; 2],
    },
    /// A number that is none.
    #[error("pair {at}: expected a share from 0 to 1, a finite point and a weight of at least 0, found {found:?}")]
    Pair {
        /// The pair, from 0.
        at: usize,
        /// What it is.
        found: Pair,
    },
    /// A place that no picture shows.
    #[error("pair {at}: expected a place in front of the camera, found one behind it or none at all")]
    Behind {
        /// The pair, from 0.
        at: usize,
    },
    /// A fit that there is none of.
    #[error("{0}")]
    Fit(#[from] FitError),
}

/// A warped mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layered {
    /// How far each vertex is moved, pixels; nothing where it is behind the camera.
    pub field: Vec<[f64; 2]>,
    /// How far each correspondence is from where it is drawn after that, pixels.
    pub residuals: Vec<f64>,
    /// The least growth of an area by any layer, above 0; 1 without any.
    pub growth: f64,
    /// Triangles that turn over, by their numbers.
    pub folds: Vec<usize>,
}

/// Where vertices are seen; `None` behind the camera.
pub fn projected(positions: &[[f64; 3]], camera: &Camera) -> Vec<Option<[f64; 2]>> {
    let clip = camera.clip_from_world();
    let one = |p: &[f64; 3]| {
        let c = clip * nalgebra::Vector4::new(p[0], p[1], p[2], 1.0);
        let pixel = camera.pixel(&c);
        (c.w > 0.0 && pixel.iter().all(|v| v.is_finite())).then_some(pixel)
    };
    positions.iter().map(one).collect()
}

/// The place of each pair on the mesh as it is seen.
///
/// # Errors
/// Where a pair names no vertex, no number or no place in front of the camera.
pub fn places(pairs: &[Pair], positions: &[[f64; 3]], camera: &Camera) -> Result<Vec<[f64; 2]>, LayerError> {
    let n = positions.len();
    let place = |(at, pair): (usize, &Pair)| {
        let Pair { edge, share, point, weight } = *pair;
        let [Some(a), Some(b)] = edge.map(|v| positions.get(v as usize)) else {
            return Err(LayerError::Vertex { at, n, found: edge });
        };
        if !((0.0..=1.0).contains(&share) && point.iter().all(|v| v.abs() < 1e9) && (0.0..1e9).contains(&weight)) {
            return Err(LayerError::Pair { at, found: *pair });
        }
        let p = [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * share);
        projected(&[p], camera)[0].ok_or(LayerError::Behind { at })
    };
    pairs.iter().enumerate().map(place).collect()
}

/// Warps a mesh such that each correspondence comes to where it is drawn, as far as nothing folds within a layer.
///
/// Cost: O(layers · (pairs + vertices) · levels).
///
/// # Errors
/// As of [`places`].
pub fn layered(mesh: &Posed, pairs: &[Pair], camera: &Camera, how: &Layering) -> Result<Layered, LayerError> {
    let layers = Layers::fit(mesh, pairs, camera, how)?;
    let field = layers.field(mesh, camera);
    let from = places(pairs, mesh.positions, camera)?;
    let residuals = residuals(pairs, &from, &field);
    let folds = folds(&projected(mesh.positions, camera), &field, mesh.triangles);
    Ok(Layered { field, residuals, growth: layers.growth, folds })
}

/// The warps of all bones that correspondences ask for.
fn fitted(mesh: &Posed, pairs: &[Pair], camera: &Camera, how: &Layering) -> Result<(Vec<Option<Ffd>>, f64), LayerError> {
    let from = places(pairs, mesh.positions, camera)?;
    let domain = domain(pairs, &from, camera);
    let fit = Options { cells: cells(domain, how.cells), ..how.fit };
    let own = shares(mesh);
    let n_layers = if how.layers { mesh.parents.len() } else { 1 };
    let mut fitted: Vec<Option<Ffd>> = Vec::with_capacity(n_layers);
    let mut growth = 1.0f64;
    for joint in 0..n_layers {
        let weight = |pair: &Pair| if how.layers { moved_by(&own, pair, joint as u32) } else { 1.0 };
        let data: Vec<Datum> = pairs
            .iter()
            .zip(&from)
            .map(|(pair, from)| (weight(pair), pair, from))
            .filter(|(w, pair, _)| *w > 0.0 && *w >= how.least_weight && pair.weight > 0.0)
            .map(|(w, pair, from)| Datum { from: *from, to: pair.point, weight: w * pair.weight })
            .collect();
        let ffd = if data.is_empty() { None } else { Some(Ffd::fit(&data, domain, &fit)?.0) };
        growth = ffd.as_ref().map_or(growth, |f| growth.min(f.least_growth(domain, SCAN)));
        fitted.push(ffd);
    }
    Ok((fitted, growth))
}

/// How far each pair is from where it is drawn when its edge's ends are moved.
pub fn residuals(pairs: &[Pair], from: &[[f64; 2]], field: &[[f64; 2]]) -> Vec<f64> {
    let one = |(pair, from): (&Pair, &[f64; 2])| {
        let [a, b] = pair.edge.map(|v| field[v as usize]);
        let off = [0, 1].map(|k| from[k] + a[k] + (b[k] - a[k]) * pair.share - pair.point[k]);
        libm::hypot(off[0], off[1])
    };
    pairs.iter().zip(from).map(one).collect()
}

/// Triangles that are seen from the other side once their corners are moved, by their numbers.
pub fn folds(seen: &[Option<[f64; 2]>], field: &[[f64; 2]], triangles: &[[u32; 3]]) -> Vec<usize> {
    let area = |[a, b, c]: [[f64; 2]; 3]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let turns = |t: &[u32; 3]| {
        let [Some(a), Some(b), Some(c)] = t.map(|v| seen[v as usize]) else { return false };
        let moved = |p: [f64; 2], v: u32| [p[0] + field[v as usize][0], p[1] + field[v as usize][1]];
        let (before, after) = (area([a, b, c]), area([moved(a, t[0]), moved(b, t[1]), moved(c, t[2])]));
        // A triangle seen edge on has no side to turn.
        before.abs() > 1e-6 && before * after < 0.0
    };
    triangles.iter().enumerate().filter(|(_, t)| turns(t)).map(|(k, _)| k).collect()
}

/// The picture, and what lies beyond it: left, top, right, bottom.
fn domain(pairs: &[Pair], from: &[[f64; 2]], camera: &Camera) -> [f64; 4] {
    let [w, h] = camera.size.map(|n| n as f64);
    let points = pairs.iter().map(|p| &p.point).chain(from);
    points.fold([0.0, 0.0, w, h], |d, p| [d[0].min(p[0]), d[1].min(p[1]), d[2].max(p[0]), d[3].max(p[1])])
}

/// Cells of a rectangle, as square as may be.
fn cells([left, top, right, bottom]: [f64; 4], longer: usize) -> [usize; 2] {
    let extent = [right - left, bottom - top];
    let size = extent[0].max(extent[1]) / longer.max(1) as f64;
    extent.map(|e| (libm::ceil(e / size - 1e-9) as usize).max(1))
}

/// Joints and weights of each vertex, which add up to 1 where there are any.
fn shares(mesh: &Posed) -> Vec<Vec<(u32, f64)>> {
    if mesh.influences == 0 {
        return vec![Vec::new(); mesh.positions.len()];
    }
    let one = |(joints, weights): (&[u32], &[f64])| {
        let sum: f64 = weights.iter().sum();
        let fine = sum > 0.0 && sum.is_finite();
        joints.iter().zip(weights).filter(|(_, w)| fine && **w != 0.0).map(|(j, w)| (*j, w / sum)).collect()
    };
    mesh.joints.chunks_exact(mesh.influences).zip(mesh.weights.chunks_exact(mesh.influences)).map(one).collect()
}

/// How much a joint moves the place of a pair.
fn moved_by(own: &[Vec<(u32, f64)>], pair: &Pair, joint: u32) -> f64 {
    let of = |v: u32| own[v as usize].iter().filter(|(j, _)| *j == joint).map(|(_, w)| w).sum::<f64>();
    let [a, b] = pair.edge.map(of);
    a + (b - a) * pair.share
}

/// The layer of each joint.
fn layer_of(fitted: &[Option<Ffd>], parents: &[i64], how: &Layering) -> Vec<Option<usize>> {
    let above = |joint: usize| {
        let mut at = Some(joint);
        // As many steps as joints lead to a root, whatever the parents are.
        for _ in 0..parents.len() {
            match at {
                Some(j) if fitted.get(j).is_some_and(Option::is_some) => return at,
                Some(j) if how.missing == Missing::Parent => at = usize::try_from(*parents.get(j)?).ok(),
                _ => return None,
            }
        }
        None
    };
    (0..parents.len()).map(|j| if how.layers { above(j) } else { Some(0) }).collect()
}

/// All layers, as they are fitted to pairs: a function of the picture, for any mesh that the same joints move.
pub struct Layers {
    fitted: Vec<Option<Ffd>>,
    layer_of: Vec<Option<usize>>,
    how: Layering,
    growth: f64,
}

impl Layers {
    /// Fits them. Cost: O(layers · pairs · levels).
    ///
    /// # Errors
    /// As of [`places`].
    pub fn fit(mesh: &Posed, pairs: &[Pair], camera: &Camera, how: &Layering) -> Result<Self, LayerError> {
        let (fitted, growth) = fitted(mesh, pairs, camera, how)?;
        Ok(Self { layer_of: layer_of(&fitted, mesh.parents, how), fitted, how: *how, growth })
    }

    /// How far each vertex is moved, pixels; nothing where it is behind the camera. Cost: O(vertices · influences · levels).
    pub fn field(&self, mesh: &Posed, camera: &Camera) -> Vec<[f64; 2]> {
        let seen = projected(mesh.positions, camera);
        seen.iter().zip(shares(mesh)).map(|(p, own)| p.map_or([0.0; 2], |p| self.displacement(p, &own))).collect()
    }

    /// How far a place is moved of which joints have these shares.
    fn displacement(&self, p: [f64; 2], own: &[(u32, f64)]) -> [f64; 2] {
        if !self.how.layers {
            return self.moved(p, Some(0));
        }
        let layer = |joint: u32| self.layer_of.get(joint as usize).copied().flatten();
        let (mut sum, mut whole) = ([0.0; 2], 0.0);
        for (joint, share) in own {
            let layer = layer(*joint);
            if layer.is_none() && self.how.missing == Missing::Others {
                continue;
            }
            let by = self.moved(p, layer);
            (0..2).for_each(|k| sum[k] += share * by[k]);
            whole += share;
        }
        if whole > 0.0 { sum.map(|v| v / whole) } else { [0.0; 2] }
    }

    fn moved(&self, p: [f64; 2], layer: Option<usize>) -> [f64; 2] {
        let Some(ffd) = layer.and_then(|l| self.fitted.get(l)).and_then(Option::as_ref) else { return [0.0; 2] };
        let q = ffd.warp(p);
        [q[0] - p[0], q[1] - p[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::camera::{Orbit, orthographic};

    /// 256 pixels a side, 64 pixels a metre, the origin in its middle.
    fn camera() -> Camera {
        let orbit = Orbit { target: [0.0; 3], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 10.0 };
        Camera::new(orbit.view(), orthographic(64.0, [256, 256], 0.1, 100.0), [256, 256]).unwrap()
    }

    /// A bar of `n` by 3 vertices about the height `y`, and its triangles.
    fn bar(n: u32, y: f64, z: f64, first: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let at = |i: u32, k: u32| [-1.5 + 3.0 * f64::from(i) / f64::from(n - 1), y + 0.2 * f64::from(k) - 0.2, z];
        let positions = (0..n).flat_map(|i| (0..3).map(move |k| at(i, k))).collect();
        let quad = |i: u32, k: u32| [first + 3 * i + k, first + 3 * i + 3 + k, first + 3 * i + 4 + k, first + 3 * i + 1 + k];
        let both = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        (positions, (0..n - 1).flat_map(|i| (0..2).flat_map(move |k| both(quad(i, k)))).collect())
    }

    /// Two limbs that cross in the picture, one before the other: joint 1 moves the first, joint 2 the second, joint 0 both by nothing.
    struct Scene {
        positions: Vec<[f64; 3]>,
        triangles: Vec<[u32; 3]>,
        joints: Vec<u32>,
        pairs: Vec<Pair>,
    }

    fn scene() -> Scene {
        let (mut positions, mut triangles) = bar(31, 0.0, 1.0, 0);
        let (behind, more) = bar(31, 0.05, -1.0, 93);
        positions.extend(behind);
        triangles.extend(more);
        let joints = (0..186).map(|v| 1 + u32::from(v >= 93)).collect();
        // The upper outline of the first limb is drawn bent by up to 24 pixels.
        let pair = |i: u32| {
            let v = 3 * i + 2;
            let p = positions[v as usize];
            let bend = 24.0 * libm::sin(f64::from(i) / 30.0 * std::f64::consts::PI);
            Pair { edge: [v, v], share: 0.0, point: [128.0 + 64.0 * p[0], 128.0 - 64.0 * p[1] - bend], weight: 1.0 }
        };
        let pairs = (0..31).map(pair).collect();
        Scene { positions, triangles, joints, pairs }
    }

    fn how(layers: bool) -> Layering {
        Layering { layers, missing: Missing::Parent, least_weight: 0.05, cells: 4, fit: Options::default() }
    }

    fn bound<'a>(scene: &'a Scene, weights: &'a [f64]) -> Posed<'a> {
        Posed {
            positions: &scene.positions,
            triangles: &scene.triangles,
            influences: 1,
            joints: &scene.joints,
            weights,
            parents: &[-1, 0, 0],
        }
    }

    fn warped(scene: &Scene, how: &Layering) -> Layered {
        layered(&bound(scene, &vec![1.0; scene.joints.len()]), &scene.pairs, &camera(), how).unwrap()
    }

    #[test]
    fn one_fit_serves_denser_meshes_too() {
        let (coarse, mut dense) = (scene(), scene());
        // A vertex more in the middle of an edge of each triangle, on the same joint.
        for t in &coarse.triangles {
            let [a, b] = [t[0], t[1]].map(|v| coarse.positions[v as usize]);
            dense.positions.push([0, 1, 2].map(|k| (a[k] + b[k]) / 2.0));
            dense.joints.push(coarse.joints[t[0] as usize]);
        }
        let weights = vec![1.0; dense.joints.len()];
        let n = coarse.positions.len();
        let layers = Layers::fit(&bound(&coarse, &weights[..n]), &coarse.pairs, &camera(), &how(true)).unwrap();
        let field = layers.field(&bound(&dense, &weights), &camera());
        assert_eq!(field, warped(&dense, &how(true)).field, "as if it were fitted to the denser mesh");
        assert_eq!(field[..n], warped(&coarse, &how(true)).field);
        assert!(field[n..].iter().any(|d| d[1] < -12.0));
    }

    fn most(field: &[[f64; 2]]) -> f64 {
        field.iter().map(|v| libm::hypot(v[0], v[1])).fold(0.0, f64::max)
    }

    #[test]
    fn a_limb_behind_stays_where_layers_are_and_leaks_where_they_are_not() {
        let scene = scene();
        let with = warped(&scene, &how(true));
        let without = warped(&scene, &how(false));
        assert!(most(&with.field[93..]) < 0.5, "{}", most(&with.field[93..]));
        assert!(most(&without.field[93..]) > 5.0, "{}", most(&without.field[93..]));
        for found in [&with, &without] {
            assert!(found.residuals.iter().all(|r| *r < 1e-6), "{:?}", found.residuals);
            assert!(found.growth > 0.0 && found.folds.is_empty(), "{} {:?}", found.growth, found.folds);
        }
    }

    #[test]
    fn bones_without_a_pair_follow_the_one_above_or_stay_or_leave_their_share() {
        let mut scene = scene();
        // The far half of the first limb belongs to joint 2, which moves no pair then.
        scene.joints = (0..186).map(|v| if v < 93 { 1 + u32::from(v >= 48) } else { 0 }).collect();
        scene.pairs.truncate(16);
        let run = |missing: Missing| {
            let weights = vec![1.0; scene.joints.len()];
            let mesh = Posed {
                positions: &scene.positions,
                triangles: &scene.triangles,
                influences: 1,
                joints: &scene.joints,
                weights: &weights,
                parents: &[-1, 0, 1],
            };
            layered(&mesh, &scene.pairs, &camera(), &Layering { missing, ..how(true) }).unwrap()
        };
        let (parent, identity, others) = (run(Missing::Parent), run(Missing::Identity), run(Missing::Others));
        assert!(most(&parent.field[48..60]) > 5.0);
        assert_eq!((most(&identity.field[48..]), most(&others.field[48..])), (0.0, 0.0));
        assert_eq!(identity.field[..48], parent.field[..48]);
    }

    #[test]
    fn triangles_that_turn_over_are_told() {
        let seen = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0]].map(Some);
        let field = [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [-12.0, -12.0]];
        assert_eq!(folds(&seen, &field, &[[0, 1, 2], [1, 3, 2]]), [1]);
        assert_eq!(folds(&seen, &[[5.0, 1.0]; 4], &[[0, 1, 2], [1, 3, 2]]), Vec::<usize>::new());
    }

    #[test]
    fn pairs_that_are_none_are_refused_by_number() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let pair = Pair { edge: [0, 1], share: 0.5, point: [1.0, 2.0], weight: 1.0 };
        let refused = |found: Pair| places(&[pair, found], &p, &camera()).unwrap_err().to_string();
        assert_eq!(refused(Pair { edge: [0, 2], ..pair }), "pair 1: expected vertices below 2, found [0, 2]");
        for found in [Pair { share: 1.5, ..pair }, Pair { point: [f64::NAN, 0.0], ..pair }, Pair { weight: -1.0, ..pair }] {
            assert!(refused(found).starts_with("pair 1: expected a share from 0 to 1"));
        }
        assert_eq!(places(&[pair], &p, &camera()).unwrap(), [[160.0, 128.0]]);
    }
}
