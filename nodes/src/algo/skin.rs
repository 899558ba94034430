//! Linear blend skinning: vertices moved by the weighted mean of their joints' motions.
//!
//! **Source** Magnenat-Thalmann, Laperrière, Thalmann 1988; Li, Gleicher, Xu, Shum 2003, equation 1: v' = sum_j w_j M_j v, M_j = world from joint ·
//! joint from mesh at rest. Normals go with the inverse transpose of the blended matrix, so that scaled joints keep them upright.

use multiversion::multiversion;
use nalgebra::Matrix4;

/// A normal `n` under the inverse transpose of a motion of three rows; as it was where the motion makes it nothing.
macro_rules! turn {
    ($t:ty, $rows:expr, $normal:expr) => {{
        // The cofactors are the inverse transpose times the determinant, and are there where the matrix has no inverse too.
        let ([a, b, c], n): ([[$t; 3]; 3], [$t; 3]) = ($rows, $normal);
        let cross = |a: [$t; 3], b: [$t; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let (x, y, z) = (cross(b, c), cross(c, a), cross(a, b));
        let dot = |a: [$t; 3], b: [$t; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let turned = [dot(x, n), dot(y, n), dot(z, n)];
        let length = dot(turned, turned).sqrt();
        let side = if dot(a, x) < 0.0 { -1.0 } else { 1.0 };
        let over = if length > 0.0 && length.is_finite() { side / length } else { 0.0 };
        [0, 1, 2].map(|r| if over == 0.0 { n[r] as f64 } else { (turned[r] * over) as f64 })
    }};
}

mod eights;

use eights::Eights;

/// Positions and normals.
pub type Moved = (Vec<[f64; 3]>, Vec<[f64; 3]>);

/// A surface made ready to be skinned: weights add up to 1, vertices that nothing moves stay where they are.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    positions: Vec<[f64; 3]>,
    normals: Vec<[f64; 3]>,
    influences: usize,
    joints: Vec<u32>,
    weights: Vec<f64>,
    n_joints: usize,
    /// The same in 32 bits.
    narrow: Eights,
}

impl Skin {
    /// A surface of `influences` joints and weights a vertex, numbers below `n_joints`.
    ///
    /// # Errors
    /// Where a vertex, a normal or a weight is not finite, a joint is none, or weights of a vertex add up to less than nought.
    pub fn new(
        positions: &[[f64; 3]],
        normals: &[[f64; 3]],
        influences: usize,
        joints: &[u32],
        weights: &[f64],
        n_joints: usize,
    ) -> Result<Self, String> {
        let n = positions.len();
        if joints.len() != n * influences || weights.len() != n * influences || (!normals.is_empty() && normals.len() != n) {
            return Err(format!("expected {influences} joints and weights for each of {n} vertices, found {}", joints.len()));
        }
        let finite = |v: &[f64; 3]| v.iter().all(|x| x.is_finite());
        if let Some(v) = positions.iter().position(|p| !finite(p)).or_else(|| normals.iter().position(|p| !finite(p))) {
            return Err(format!("vertex {v}: expected a finite position and normal, found {:?}", positions[v]));
        }
        // One joint more stands for those that nothing moves.
        let (mut own_joints, mut own_weights) = (joints.to_vec(), weights.to_vec());
        let width = influences.max(1);
        if influences == 0 {
            (own_joints, own_weights) = (vec![n_joints as u32; n], vec![1.0; n]);
        }
        for (v, (joints, weights)) in own_joints.chunks_exact_mut(width).zip(own_weights.chunks_exact_mut(width)).enumerate() {
            normalise(v, joints, weights, n_joints)?;
        }
        let narrow = Eights::new(positions, normals, &own_joints, &own_weights);
        let (positions, normals) = (positions.to_vec(), normals.to_vec());
        Ok(Self { positions, normals, influences: width, joints: own_joints, weights: own_weights, n_joints, narrow })
    }

    /// Joints that it may be moved by.
    pub fn n_joints(&self) -> usize {
        self.n_joints
    }

    /// Positions and normals under the motion of each joint, world from mesh at rest, in 32 bits or in 64.
    ///
    /// # Errors
    /// Where there is another number of joints, or a motion is not finite.
    pub fn pose(&self, motions: &[Matrix4<f64>], narrow: bool) -> Result<Moved, String> {
        if motions.len() != self.n_joints {
            return Err(format!("expected {} joints, found {}", self.n_joints, motions.len()));
        }
        if let Some(j) = motions.iter().position(|m| m.iter().any(|v| !v.is_finite())) {
            return Err(format!("joint {j}: expected a finite motion, found NaN or infinity"));
        }
        let identity = Matrix4::identity();
        let rows = motions.iter().chain([&identity]).map(|m| std::array::from_fn(|i| m[(i / 4, i % 4)]));
        if narrow {
            let rows: Vec<[[f32; 3]; 4]> = rows.map(|r: [f64; 12]| columns(r.map(|v| v as f32))).collect();
            return Ok(self.narrow.pose(&rows));
        }
        let rows: Vec<[[f64; 4]; 4]> = rows.map(columns).collect();
        let (mut positions, mut normals) = (Vec::with_capacity(self.positions.len()), Vec::with_capacity(self.normals.len()));
        let from = [&self.positions[..], &self.normals[..]];
        blend(&rows, self.influences, &self.joints, &self.weights, from, [&mut positions, &mut normals]);
        Ok((positions, normals))
    }
}

/// Makes the weights of a vertex add up to 1.
fn normalise(vertex: usize, joints: &mut [u32], weights: &mut [f64], n_joints: usize) -> Result<(), String> {
    let sum: f64 = weights.iter().sum();
    if !sum.is_finite() || sum < 0.0 {
        return Err(format!("vertex {vertex}: expected weights that add up to 0 or more, found {weights:?}"));
    }
    if let Some(far) = joints.iter().find(|j| **j as usize > n_joints) {
        return Err(format!("vertex {vertex}: expected joints below {n_joints}, found {far}"));
    }
    if sum > 0.0 {
        weights.iter_mut().for_each(|w| *w /= sum);
    } else {
        weights.fill(0.0);
        (joints[0], weights[0]) = (n_joints as u32, 1.0);
    }
    Ok(())
}

/// Vertices that are written together, so that what they are written to need not be filled before.
const BLOCK: usize = 32;

/// Columns of a motion, x, y, z and lanes to spare.
fn columns<T: Copy + Default, const LANES: usize>(rows: [T; 12]) -> [[T; LANES]; 4] {
    std::array::from_fn(|c| std::array::from_fn(|r| if r < 3 { rows[4 * r + c] } else { T::default() }))
}

/// Blends the joints' motions at each vertex and moves it. Nothing is fused, so the bits are the same on every processor.
#[multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "x86_64+avx"))]
fn blend(
    motions: &[[[f64; 4]; 4]],
    influences: usize,
    joints: &[u32],
    weights: &[f64],
    from: [&[[f64; 3]]; 2],
    to: [&mut Vec<[f64; 3]>; 2],
) {
    // Of numbers that are known beforehand the blend is a run of lanes without a loop.
    match (influences, from[1].is_empty()) {
        (4, true) => blend_bound::<_, _, false>(motions, joints.as_chunks::<4>().0.iter().zip(weights.as_chunks::<4>().0), from, to),
        (4, false) => blend_bound::<_, _, true>(motions, joints.as_chunks::<4>().0.iter().zip(weights.as_chunks::<4>().0), from, to),
        (n, _) => blend_bound::<_, _, true>(motions, joints.chunks_exact(n).zip(weights.chunks_exact(n)), from, to),
    }
}

#[inline(always)]
fn blend_bound<'a, J: AsRef<[u32]> + ?Sized + 'a, W: AsRef<[f64]> + ?Sized + 'a, const TURN: bool>(
    motions: &[[[f64; 4]; 4]],
    mut bound: impl Iterator<Item = (&'a J, &'a W)>,
    [positions, normals]: [&[[f64; 3]]; 2],
    [moved, turned]: [&mut Vec<[f64; 3]>; 2],
) {
    for (block, positions) in positions.chunks(BLOCK).enumerate() {
        let (mut lanes, mut out) = ([[0.0; 4]; BLOCK], [[0.0; 3]; BLOCK]);
        for (n, (p, at)) in positions.iter().zip(&mut lanes).enumerate() {
            let Some((joints, weights)) = bound.next() else { return };
            let mut m = [[0.0; 4]; 4];
            for (j, w) in joints.as_ref().iter().zip(weights.as_ref()) {
                let motion = &motions[*j as usize];
                for c in 0..4 {
                    for r in 0..4 {
                        m[c][r] += *w * motion[c][r];
                    }
                }
            }
            for r in 0..4 {
                at[r] = m[2][r] * p[2] + (m[1][r] * p[1] + m[0][r] * p[0]) + m[3][r];
            }
            if TURN && let Some(normal) = normals.get(block * BLOCK + n) {
                turned.push(turn!(f64, [0, 1, 2].map(|r| [m[0][r], m[1][r], m[2][r]]), *normal));
            }
        }
        for (at, out) in lanes.iter().zip(&mut out) {
            *out = [at[0], at[1], at[2]];
        }
        moved.extend_from_slice(&out[..positions.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

    fn moved(m: &Matrix4<f64>, p: [f64; 3]) -> [f64; 3] {
        let v = m * nalgebra::Vector4::new(p[0], p[1], p[2], 1.0);
        [v.x, v.y, v.z]
    }

    fn close(a: &[[f64; 3]], b: &[[f64; 3]], tolerance: f64) {
        let worst = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(a.len() == b.len() && worst <= tolerance, "{worst}: {a:?} {b:?}");
    }

    /// Two joints, the second turned and scaled, and three vertices: of the first, of the second, of both by halves.
    fn bend() -> (Skin, [Matrix4<f64>; 2], Vec<[f64; 3]>) {
        let p = vec![[0.5, 0.1, 0.2], [1.5, -0.3, 0.1], [1.0, 0.2, -0.4]];
        let n = vec![[0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]];
        let skin = Skin::new(&p, &n, 2, &[0, 1, 1, 0, 0, 1], &[1.0, 0.0, 3.0, 0.0, 0.2, 0.2], 2).unwrap();
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.7).to_homogeneous();
        let scale = Matrix4::new_nonuniform_scaling(&Vector3::new(1.0, 2.0, 0.5));
        let pivot = Vector3::new(1.0, 0.0, 0.0);
        let second = Matrix4::new_translation(&pivot) * turn * scale * Matrix4::new_translation(&-pivot);
        (skin, [Matrix4::new_translation(&Vector3::new(0.0, 3.0, 0.0)), second], p)
    }

    #[test]
    fn vertices_go_with_the_mean_of_their_joints() {
        let (skin, motions, p) = bend();
        let (a, b) = (moved(&motions[0], p[2]), moved(&motions[1], p[2]));
        let both = std::array::from_fn(|i| (a[i] + b[i]) / 2.0);
        let truth = [moved(&motions[0], p[0]), moved(&motions[1], p[1]), both];
        close(&skin.pose(&motions, false).unwrap().0, &truth, 1e-14);
        close(&skin.pose(&motions, true).unwrap().0, &truth, 2e-6);
    }

    #[test]
    fn normals_stay_upright_on_what_is_scaled_and_mirrored() {
        let (skin, mut motions, _) = bend();
        for _ in 0..2 {
            let inverse = motions[1].fixed_view::<3, 3>(0, 0).try_inverse().unwrap().transpose();
            let truth = (inverse * Vector3::new(0.6, 0.8, 0.0)).normalize();
            close(&skin.pose(&motions, false).unwrap().1[1..2], &[truth.into()], 1e-14);
            close(&skin.pose(&motions, true).unwrap().1[1..2], &[truth.into()], 2e-6);
            motions[1] *= Matrix4::new_nonuniform_scaling(&Vector3::new(-1.0, 1.0, 1.0));
        }
        // Flattened to nothing a normal stays as it was at rest.
        motions[1] = Matrix4::zeros();
        assert_eq!(skin.pose(&motions, false).unwrap().1[1], [0.6, 0.8, 0.0]);
    }

    #[test]
    fn what_nothing_moves_stays() {
        let p = [[1.0, 2.0, 3.0]];
        let away = [Matrix4::new_translation(&Vector3::new(9.0, 9.0, 9.0))];
        for skin in [Skin::new(&p, &[], 0, &[], &[], 1), Skin::new(&p, &[], 1, &[0], &[0.0], 1)] {
            assert_eq!(skin.unwrap().pose(&away, false).unwrap().0, p);
        }
        assert_eq!(Skin::new(&[], &[], 4, &[], &[], 0).unwrap().pose(&[], true).unwrap().0, Vec::<[f64; 3]>::new());
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_vertex_and_joint() {
        let p = [[0.0; 3]; 2];
        let refused = |p: &[[f64; 3]], joints: &[u32], weights: &[f64]| Skin::new(p, &[], 1, joints, weights, 1).unwrap_err();
        assert!(refused(&p, &[0, 0], &[1.0, f64::NAN]).starts_with("vertex 1: expected weights"));
        assert!(refused(&p, &[0, 0], &[-1.0, 1.0]).starts_with("vertex 0: expected weights"));
        assert_eq!(refused(&p, &[0, 7], &[1.0, 1.0]), "vertex 1: expected joints below 1, found 7");
        assert!(refused(&[[0.0; 3], [0.0, f64::INFINITY, 0.0]], &[0, 0], &[1.0; 2]).starts_with("vertex 1: expected a finite"));
        let skin = Skin::new(&p, &[], 1, &[0, 0], &[1.0; 2], 1).unwrap();
        assert_eq!(skin.pose(&[], true).unwrap_err(), "expected 1 joints, found 0");
        let broken = [Matrix4::from_element(f64::NAN)];
        assert_eq!(skin.pose(&broken, true).unwrap_err(), "joint 0: expected a finite motion, found NaN or infinity");
    }
}
