//! Linear blend skinning: vertices moved by the weighted mean of their joints' motions.
//!
//! **Source** Magnenat-Thalmann, Laperrière, Thalmann 1988; Li, Gleicher, Xu, Shum 2003, equation 1: v' = sum_j w_j M_j v, M_j = world from joint ·
//! joint from mesh at rest. Normals go with the inverse transpose of the blended matrix, so that scaled joints keep them upright.

use multiversion::multiversion;
use nalgebra::Matrix4;

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
    narrow: Narrow,
}

/// The same in 32 bits.
#[derive(Clone, Debug, Default, PartialEq)]
struct Narrow {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    weights: Vec<f32>,
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
        let narrow = Narrow {
            positions: positions.iter().map(|p| p.map(|x| x as f32)).collect(),
            normals: normals.iter().map(|p| p.map(|x| x as f32)).collect(),
            weights: own_weights.iter().map(|w| *w as f32).collect(),
        };
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
        let (mut positions, mut normals) = (Vec::with_capacity(self.positions.len()), Vec::with_capacity(self.normals.len()));
        if narrow {
            let rows: Vec<[[f32; 4]; 4]> = rows.map(|r: [f64; 12]| columns(r.map(|v| v as f32))).collect();
            let (own, n) = (&self.narrow, self.influences);
            let from = [&own.positions[..], &own.normals[..]];
            narrow_blend(&rows, n, &self.joints, &own.weights, from, [&mut positions, &mut normals]);
        } else {
            let rows: Vec<[[f64; 4]; 4]> = rows.map(columns).collect();
            let from = [&self.positions[..], &self.normals[..]];
            blend_f64(&rows, self.influences, &self.joints, &self.weights, from, [&mut positions, &mut normals]);
        }
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

/// Columns of a motion, x, y, z and a lane to spare.
fn columns<T: Copy + Default>(rows: [T; 12]) -> [[T; 4]; 4] {
    std::array::from_fn(|c| std::array::from_fn(|r| if r < 3 { rows[4 * r + c] } else { T::default() }))
}

macro_rules! blend {
    ($name:ident, $own:ident, $turn:ident, $t:ty, $fused:expr) => {
        /// Blends the joints' motions at each vertex and moves it; products and sums are the same, fused where `$fused` says so, on every processor, so the
        /// bits are the same everywhere.
        #[multiversion(targets("x86_64+avx512f+avx512vl+fma", "x86_64+avx2+fma", "x86_64+avx"))]
        fn $name(
            motions: &[[[$t; 4]; 4]],
            influences: usize,
            joints: &[u32],
            weights: &[$t],
            from: [&[[$t; 3]]; 2],
            to: [&mut Vec<[f64; 3]>; 2],
        ) {
            // Of numbers that are known beforehand the blend is a run of lanes without a loop.
            match (influences, from[1].is_empty()) {
                (4, true) => $own::<_, _, false>(motions, joints.as_chunks::<4>().0.iter().zip(weights.as_chunks::<4>().0), from, to),
                (4, false) => $own::<_, _, true>(motions, joints.as_chunks::<4>().0.iter().zip(weights.as_chunks::<4>().0), from, to),
                (n, _) => $own::<_, _, true>(motions, joints.chunks_exact(n).zip(weights.chunks_exact(n)), from, to),
            }
        }

        #[inline(always)]
        fn $own<'a, J: AsRef<[u32]> + ?Sized + 'a, W: AsRef<[$t]> + ?Sized + 'a, const TURN: bool>(
            motions: &[[[$t; 4]; 4]],
            mut bound: impl Iterator<Item = (&'a J, &'a W)>,
            [positions, normals]: [&[[$t; 3]]; 2],
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
                                m[c][r] = $fused(*w, motion[c][r], m[c][r]);
                            }
                        }
                    }
                    for r in 0..4 {
                        at[r] = $fused(m[2][r], p[2], $fused(m[1][r], p[1], m[0][r] * p[0])) + m[3][r];
                    }
                    if TURN && let Some(normal) = normals.get(block * BLOCK + n) {
                        turned.push($turn(&m, *normal));
                    }
                }
                for (at, out) in lanes.iter().zip(&mut out) {
                    *out = [at[0] as f64, at[1] as f64, at[2] as f64];
                }
                moved.extend_from_slice(&out[..positions.len()]);
            }
        }

        /// A normal under the inverse transpose of a motion of three columns.
        #[inline(always)]
        fn $turn(m: &[[$t; 4]; 4], n: [$t; 3]) -> [f64; 3] {
            // The cofactors are the inverse transpose times the determinant, and are there where the matrix has no inverse too.
            let (a, b, c) = ([m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]);
            let cross = |a: [$t; 3], b: [$t; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
            let (x, y, z) = (cross(b, c), cross(c, a), cross(a, b));
            let dot = |a: [$t; 3], b: [$t; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let turned = [dot(x, n), dot(y, n), dot(z, n)];
            let length = dot(turned, turned).sqrt();
            let side = if dot(a, x) < 0.0 { -1.0 } else { 1.0 };
            let over = if length > 0.0 && length.is_finite() { side / length } else { 0.0 };
            [0, 1, 2].map(|r| if over == 0.0 { n[r] as f64 } else { (turned[r] * over) as f64 })
        }
    };
}

// In 32 bits the processor's speed counts: one that cannot fuse gets the same bits from its library, slowly. In 64 bits it is loads that take the time.
blend!(blend_f32, own_f32, turn_f32, f32, f32::mul_add);
blend!(blend_f64, own_f64, turn_f64, f64, |a: f64, b: f64, c: f64| a * b + c);

/// [`blend_f32`], by hand where the processor has lanes for it: the same operations in the same order, so the same bits.
fn narrow_blend(
    motions: &[[[f32; 4]; 4]],
    influences: usize,
    joints: &[u32],
    weights: &[f32],
    from: [&[[f32; 3]]; 2],
    to: [&mut Vec<[f64; 3]>; 2],
) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx") && std::arch::is_x86_feature_detected!("fma") {
        let halves: Vec<lanes::Halves> = motions.iter().map(|m| bytemuck::cast(*m)).collect();
        #[allow(unsafe_code, reason = "the processor was asked for what the kernel needs")]
        // SAFETY: AVX and FMA are there.
        unsafe {
            lanes::blend(&halves, influences, joints, weights, from, to);
        }
        return;
    }
    blend_f32(motions, influences, joints, weights, from, to);
}

/// The blend of sixteen numbers in two halves of eight lanes: faster than what a compiler makes of [`blend_f32`].
#[cfg(target_arch = "x86_64")]
mod lanes {
    use std::arch::x86_64::{
        __m256, _mm_add_ps, _mm_cvtsd_f64, _mm_fmadd_ps, _mm_mul_ps, _mm_set1_ps, _mm_unpackhi_pd, _mm256_castpd256_pd128,
        _mm256_castps256_ps128, _mm256_cvtps_pd, _mm256_extractf128_pd, _mm256_extractf128_ps, _mm256_fmadd_ps, _mm256_set1_ps,
        _mm256_setzero_ps,
    };

    use super::turn_f32;

    /// Four columns of a motion, two a half.
    pub(super) type Halves = [__m256; 2];

    #[target_feature(enable = "avx,fma")]
    pub(super) fn blend(
        motions: &[Halves],
        influences: usize,
        joints: &[u32],
        weights: &[f32],
        [positions, normals]: [&[[f32; 3]]; 2],
        [moved, turned]: [&mut Vec<[f64; 3]>; 2],
    ) {
        let n = positions.len().min(joints.len() / influences).min(weights.len() / influences);
        moved.reserve(n);
        let (is_turned, mut normals, zero) = (!normals.is_empty(), normals.iter(), _mm256_setzero_ps());
        let mut turn = |m: Halves| turned.extend(normals.next().map(|normal| turn_f32(&bytemuck::cast(m), *normal)));
        let places = moved.spare_capacity_mut().iter_mut().zip(&positions[..n]);
        if influences == 4 {
            // Neighbours mostly hang on the same four joints, which then stay in registers.
            let mut last = [0; 4];
            let [mut a, mut b, mut c, mut d] = last.map(|j| motions[j as usize]);
            for ((out, p), (joints, weights)) in places.zip(joints.as_chunks::<4>().0.iter().zip(weights.as_chunks::<4>().0)) {
                if *joints != last {
                    last = *joints;
                    [a, b, c, d] = last.map(|j| motions[j as usize]);
                }
                let w = weights.map(|w| _mm256_set1_ps(w));
                let sum = |k: usize| _mm256_fmadd_ps(w[2], c[k], _mm256_fmadd_ps(w[1], b[k], _mm256_fmadd_ps(w[0], a[k], zero)));
                let m = [0, 1].map(|k| _mm256_fmadd_ps(w[3], d[k], sum(k)));
                out.write(place(m, p));
                if is_turned {
                    turn(m);
                }
            }
        } else {
            for ((out, p), (joints, weights)) in places.zip(joints.chunks_exact(influences).zip(weights.chunks_exact(influences))) {
                let mut m = [zero; 2];
                for (j, w) in joints.iter().zip(weights) {
                    let (motion, w) = (motions[*j as usize], _mm256_set1_ps(*w));
                    m = [0, 1].map(|k| _mm256_fmadd_ps(w, motion[k], m[k]));
                }
                out.write(place(m, p));
                if is_turned {
                    turn(m);
                }
            }
        }
        #[allow(unsafe_code, reason = "what is written at once need not be filled before")]
        // SAFETY: each of the n places after those that were there has been written: there are n positions, joints and weights.
        unsafe {
            moved.set_len(moved.len() + n);
        }
    }

    /// Where a motion takes a place.
    #[inline]
    #[target_feature(enable = "avx,fma")]
    fn place([low, high]: Halves, p: &[f32; 3]) -> [f64; 3] {
        let (x, y) = (_mm256_castps256_ps128(low), _mm256_extractf128_ps::<1>(low));
        let (z, at) = (_mm256_castps256_ps128(high), _mm256_extractf128_ps::<1>(high));
        let [px, py, pz] = p.map(|p| _mm_set1_ps(p));
        let wide = _mm256_cvtps_pd(_mm_add_ps(_mm_fmadd_ps(z, pz, _mm_fmadd_ps(y, py, _mm_mul_ps(x, px))), at));
        let (first, last) = (_mm256_castpd256_pd128(wide), _mm256_extractf128_pd::<1>(wide));
        [_mm_cvtsd_f64(first), _mm_cvtsd_f64(_mm_unpackhi_pd(first, first)), _mm_cvtsd_f64(last)]
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

    type Blend = fn(&[[[f32; 4]; 4]], usize, &[u32], &[f32], [&[[f32; 3]]; 2], [&mut Vec<[f64; 3]>; 2]);

    #[test]
    fn lanes_by_hand_have_the_bits_of_the_plain_blend() {
        let (mut state, n) = (1_u32, 100);
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state as f32 / u32::MAX as f32 - 0.3
        };
        let motions: Vec<[[f32; 4]; 4]> = (0..7).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| next()))).collect();
        let (p, q): (Vec<_>, Vec<_>) = (0..n).map(|_| ([next(), next(), next()], [next(), next(), next()])).unzip();
        let weights: Vec<f32> = (0..n * 5).map(|_| next()).collect();
        // Three vertices in a row have the same joints.
        for (influences, normals) in [(4, &q[..]), (4, &[]), (5, &q), (5, &[]), (1, &[])] {
            let joints: Vec<u32> = (0..n * influences).map(|k| ((k / influences / 3 * 2 + k % influences) % 7) as u32).collect();
            let made = |by: Blend| {
                let (mut a, mut b) = (Vec::new(), Vec::new());
                by(&motions, influences, &joints, &weights[..n * influences], [&p, normals], [&mut a, &mut b]);
                (a, b)
            };
            let plain = made(blend_f32);
            assert_eq!((plain.0.len(), plain.1.len()), (n, normals.len()));
            assert_eq!(made(narrow_blend), plain, "{influences}");
        }
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
