//! Linear blend skinning in 32 bits, of eight vertices at a time that hang on the same joints: each number of a motion is read once for all of them.

use std::collections::HashMap;
use std::mem::MaybeUninit;

use super::Moved;

/// Vertices that are moved together.
const EIGHT: usize = 8;
/// A number of each.
type Lanes = [f32; EIGHT];

/// A surface as eights of vertices that hang on the same joints, in the same order; where there are fewer, the last stands for those that lack.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Eights {
    /// Vertices in all.
    n: usize,
    influences: usize,
    eights: Vec<Eight>,
    /// Of each eight as many as there are influences.
    joints: Vec<u32>,
    weights: Vec<Lanes>,
    /// Of each eight, where there are any.
    normals: Vec<[Lanes; 3]>,
}

#[derive(Clone, Debug, PartialEq)]
struct Eight {
    vertices: [u32; EIGHT],
    positions: [Lanes; 3],
}

/// What is to be written at each vertex.
type Spare<'a> = &'a mut [MaybeUninit<[f64; 3]>];

impl Eights {
    /// A surface whose vertices have the same number of joints and weights each.
    pub(super) fn new(positions: &[[f64; 3]], normals: &[[f64; 3]], joints: &[u32], weights: &[f64]) -> Self {
        let n = positions.len();
        let influences = joints.len().checked_div(n).unwrap_or(1);
        let mut bound: HashMap<&[u32], Vec<u32>> = HashMap::new();
        for (v, joints) in joints.chunks_exact(influences).enumerate() {
            bound.entry(joints).or_default().push(v as u32);
        }
        let mut together: Vec<&[u32]> = bound.values().flat_map(|vertices| vertices.chunks(EIGHT)).collect();
        // As vertices lie in memory.
        together.sort_unstable_by_key(|vertices| vertices[0]);
        let mut made = Self { n, influences, ..Self::default() };
        for few in together {
            let vertices: [u32; EIGHT] = std::array::from_fn(|l| few[l.min(few.len() - 1)]);
            let lanes = |of: &[[f64; 3]]| std::array::from_fn(|axis| vertices.map(|v| of[v as usize][axis] as f32));
            made.eights.push(Eight { vertices, positions: lanes(positions) });
            made.joints.extend_from_slice(&joints[vertices[0] as usize * influences..][..influences]);
            made.weights.extend((0..influences).map(|k| vertices.map(|v| weights[v as usize * influences + k] as f32)));
            if !normals.is_empty() {
                made.normals.push(lanes(normals));
            }
        }
        made
    }

    /// Places and normals under the motions of the joints, four columns each. Products and sums are fused on every processor, so the bits are the same
    /// everywhere: one that cannot fuse takes them from its library, slowly.
    pub(super) fn pose(&self, motions: &[[[f32; 3]; 4]]) -> Moved {
        let (mut moved, mut turned) = (Vec::with_capacity(self.n), Vec::with_capacity(if self.normals.is_empty() { 0 } else { self.n }));
        let (places, normals) = (&mut moved.spare_capacity_mut()[..self.n], turned.spare_capacity_mut());
        #[cfg(target_arch = "x86_64")]
        let is_wide = std::arch::is_x86_feature_detected!("avx") && std::arch::is_x86_feature_detected!("fma");
        #[cfg(not(target_arch = "x86_64"))]
        let is_wide = false;
        if is_wide {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code, reason = "the processor was asked for what the kernel needs")]
            // SAFETY: AVX and FMA are there.
            unsafe {
                lanes::blend(self, motions, places, normals);
            }
        } else {
            self.blend(motions, places, normals, blended);
        }
        #[allow(unsafe_code, reason = "what is written at once need not be filled before")]
        // SAFETY: each vertex is in an eight, and all that are in one have been written, normals where each eight has some.
        unsafe {
            moved.set_len(self.n);
            turned.set_len(if self.normals.is_empty() { 0 } else { self.n });
        }
        (moved, turned)
    }

    /// Writes places and normals, by what blends the motions of an eight and moves it.
    #[inline(always)]
    fn blend(
        &self,
        motions: &[[[f32; 3]; 4]],
        places: Spare,
        normals: Spare,
        blended: impl Fn(&[[[f32; 3]; 4]], &[u32], &[Lanes], &[Lanes; 3]) -> ([[Lanes; 3]; 3], [[f64; EIGHT]; 3]),
    ) {
        let bound = self.joints.chunks_exact(self.influences).zip(self.weights.chunks_exact(self.influences));
        for (i, (eight, (joints, weights))) in self.eights.iter().zip(bound).enumerate() {
            let (m, at) = blended(motions, joints, weights, &eight.positions);
            for (l, v) in eight.vertices.iter().enumerate() {
                places[*v as usize].write([at[0][l], at[1][l], at[2][l]]);
            }
            if let Some(rest) = self.normals.get(i) {
                let mut turned = [[0.0; 3]; EIGHT];
                for l in 0..EIGHT {
                    turned[l] = turn!(f32, [0, 1, 2].map(|r| [m[0][r][l], m[1][r][l], m[2][r][l]]), [rest[0][l], rest[1][l], rest[2][l]]);
                }
                for (l, v) in eight.vertices.iter().enumerate() {
                    normals[*v as usize].write(turned[l]);
                }
            }
        }
    }
}

/// Columns of the blended motion, and the places under it.
fn blended(motions: &[[[f32; 3]; 4]], joints: &[u32], weights: &[Lanes], p: &[Lanes; 3]) -> ([[Lanes; 3]; 3], [[f64; EIGHT]; 3]) {
    let mut m = [[[0.0_f32; EIGHT]; 3]; 4];
    for (j, w) in joints.iter().zip(weights) {
        let motion = &motions[*j as usize];
        for (c, r) in (0..4).flat_map(|c| [(c, 0), (c, 1), (c, 2)]) {
            m[c][r] = std::array::from_fn(|l| w[l].mul_add(motion[c][r], m[c][r][l]));
        }
    }
    let [x, y, z, at] = m;
    let place = |r: usize, l: usize| z[r][l].mul_add(p[2][l], y[r][l].mul_add(p[1][l], x[r][l] * p[0][l])) + at[r][l];
    ([x, y, z], std::array::from_fn(|r| std::array::from_fn(|l| f64::from(place(r, l)))))
}

/// The same by hand where the processor has lanes for it, faster than what a compiler makes of it: the same operations in the same order, so the same bits.
#[cfg(target_arch = "x86_64")]
mod lanes {
    use std::arch::x86_64::{
        __m256d, _mm256_add_ps, _mm256_castps256_ps128, _mm256_cvtps_pd, _mm256_extractf128_ps, _mm256_fmadd_ps, _mm256_mul_ps,
        _mm256_set1_ps, _mm256_setzero_ps,
    };

    use bytemuck::cast;

    use super::{EIGHT, Eights, Lanes, Spare};

    #[target_feature(enable = "avx,fma")]
    pub(super) fn blend(eights: &Eights, motions: &[[[f32; 3]; 4]], places: Spare, normals: Spare) {
        eights.blend(motions, places, normals, |motions, joints, weights, positions| blended(motions, joints, weights, positions));
    }

    #[inline]
    #[target_feature(enable = "avx,fma")]
    fn blended(motions: &[[[f32; 3]; 4]], joints: &[u32], weights: &[Lanes], p: &[Lanes; 3]) -> ([[Lanes; 3]; 3], [[f64; EIGHT]; 3]) {
        let mut m = [[_mm256_setzero_ps(); 3]; 4];
        for (j, w) in joints.iter().zip(weights) {
            let (motion, w) = (&motions[*j as usize], cast(*w));
            for c in 0..4 {
                for r in 0..3 {
                    m[c][r] = _mm256_fmadd_ps(w, _mm256_set1_ps(motion[c][r]), m[c][r]);
                }
            }
        }
        let [x, y, z, at] = m;
        let [px, py, pz] = p.map(cast);
        let places = [0, 1, 2].map(|r| {
            let place = _mm256_add_ps(_mm256_fmadd_ps(z[r], pz, _mm256_fmadd_ps(y[r], py, _mm256_mul_ps(x[r], px))), at[r]);
            let (low, high) = (_mm256_castps256_ps128(place), _mm256_extractf128_ps::<1>(place));
            cast::<[__m256d; 2], [f64; EIGHT]>([_mm256_cvtps_pd(low), _mm256_cvtps_pd(high)])
        });
        ([x, y, z].map(|column| column.map(cast)), places)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Vertex by vertex.
    fn plain(motions: &[[[f32; 3]; 4]], influences: usize, joints: &[u32], weights: &[f64], from: [&[[f64; 3]]; 2]) -> Moved {
        let [p, normals] = from.map(|of| of.iter().map(|p| p.map(|x| x as f32)).collect::<Vec<_>>());
        let blend = |v: usize| {
            let mut m = [[0.0_f32; 3]; 4];
            for k in v * influences..(v + 1) * influences {
                let motion = motions[joints[k] as usize];
                m = std::array::from_fn(|c| std::array::from_fn(|r| (weights[k] as f32).mul_add(motion[c][r], m[c][r])));
            }
            m
        };
        let place = |(v, p): (usize, &[f32; 3])| {
            let m = blend(v);
            std::array::from_fn(|r| f64::from(m[2][r].mul_add(p[2], m[1][r].mul_add(p[1], m[0][r] * p[0])) + m[3][r]))
        };
        let turn = |(v, n): (usize, &[f32; 3])| {
            let m = blend(v);
            turn!(f32, [0, 1, 2].map(|r| [m[0][r], m[1][r], m[2][r]]), *n)
        };
        (p.iter().enumerate().map(place).collect(), normals.iter().enumerate().map(turn).collect())
    }

    #[test]
    fn eights_have_the_bits_of_vertices_alone_with_lanes_by_hand_and_without() {
        let (mut state, n) = (1_u32, 203);
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state as f32 / u32::MAX as f32 - 0.3
        };
        let motions: Vec<[[f32; 3]; 4]> = (0..7).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| next()))).collect();
        let mut three = || [next(), next(), next()].map(f64::from);
        let (p, q): (Vec<_>, Vec<_>) = (0..n).map(|_| (three(), three())).unzip();
        let weights: Vec<f64> = (0..n * 5).map(|_| f64::from(next())).collect();
        for (influences, normals) in [(4, &q[..]), (4, &[]), (5, &q), (5, &[]), (1, &[])] {
            // Neighbours mostly hang on other joints; some eights are full, some not.
            let joints: Vec<u32> = (0..n * influences).map(|k| ((k / influences * 3 % 5 + k % influences) % 7) as u32).collect();
            let weights = &weights[..n * influences];
            let eights = Eights::new(&p, normals, &joints, weights);
            let truth = plain(&motions, influences, &joints, weights, [&p, normals]);
            assert_eq!(eights.pose(&motions), truth, "{influences}");
            let (mut places, mut turned) = (vec![[0.0; 3]; n], vec![[0.0; 3]; normals.len()]);
            eights.blend(&motions, as_spare(&mut places), as_spare(&mut turned), blended);
            assert_eq!((places, turned), truth, "{influences}");
        }
    }

    fn as_spare(places: &mut [[f64; 3]]) -> Spare<'_> {
        #[allow(unsafe_code, reason = "what is written may be written again")]
        // SAFETY: the same size, and only whole values are written through it.
        unsafe {
            &mut *(std::ptr::from_mut(places) as *mut [MaybeUninit<[f64; 3]>])
        }
    }
}
