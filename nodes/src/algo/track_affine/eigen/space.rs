//! One pyramid level of a space of pictures: the mean, what each component adds to it, and the sums of a joint step.

use std::ops::Range;

use multiversion::multiversion;
use nalgebra::{DMatrix, DVector, Vector6};

use super::super::level::{LANES, Level, Scratch, Span, packed, packed_looks, slopes};
use super::super::planes::Planes;

/// Pixels that are worked on together, so that what is read again is still in the cache.
const BLOCK: usize = 1024;
/// Share of what can be seen that may be left out.
const SPARED: f64 = 0.01;
/// A level of so few pixels is kept whole.
const FEW: usize = 2048;

/// A level of the space.
#[derive(Clone, Debug)]
pub(super) struct Space {
    /// The mean, in the pixels that say something.
    pub(super) mean: Level,
    /// What each component adds: to the samples and their slopes across and down, by channel.
    parts: Vec<[Vec<Vec<f32>>; 3]>,
    /// Coverage of the mean and what each component adds to it, where pixels are weighed by it; else none.
    cover: Vec<Vec<f32>>,
    /// Centred and scaled coordinates of each pixel.
    at: [Vec<f32>; 2],
    /// Contrast and weight of the mean with the pixels that are left out.
    whole: (f64, f64),
    /// Root of how many pixels each one that is kept stands for.
    kept: f64,
}

/// The pictures of one level.
pub(super) struct Layers<'a> {
    /// The mean, then the components.
    pub(super) pictures: &'a [Planes],
    /// Their coverages, one plane each, where pixels are weighed by them; else none.
    pub(super) cover: &'a [Planes],
    /// Weight of each pixel, 0 outside of the region.
    pub(super) weight: &'a [f32],
    /// Variance along each component.
    pub(super) variances: &'a [f64],
    /// Most pixels that are kept.
    pub(super) most: usize,
}

/// The second derivatives that components have a share in.
#[derive(Clone, Debug)]
pub(super) struct Curvature {
    /// Of each component with the six parameters of the motion.
    pub(super) cross: Vec<Vector6<f64>>,
    /// Of components with each other.
    pub(super) own: DMatrix<f64>,
}

impl Space {
    /// `None` where no pixel has a weight.
    pub(super) fn new(layers: &Layers, sigma: f64, centre: [f64; 2], scale: f64) -> Option<Self> {
        let looks: Vec<[Planes; 3]> = layers.pictures.iter().map(|p| slopes(p, sigma)).collect();
        let width = looks[0][0].width;
        let (spans, kept) = telling(&interest(&looks, layers), layers.weight, width, layers.most);
        let mean = Level::on(&looks[0], layers.weight, &spans, centre, scale)?;
        let whole = contrast(&looks[0][0], layers.weight);
        let cover = layers.cover.iter().map(|c| packed(&c.data[0], width, &spans, 1.0)).collect();
        Some(Self { whole, kept, at: mean.coordinates(), parts: looks[1..].iter().map(|l| packed_looks(l, &spans)).collect(), cover, mean })
    }

    /// Standard deviation of the mean, with the pixels that are left out.
    pub(super) fn contrast(&self) -> f64 {
        self.whole.0
    }

    /// Root mean square of the last residuals of `level` over the contrast; pixels that are left out are taken to fit.
    pub(super) fn dissimilarity(&self, level: &Level, scratch: &Scratch) -> f64 {
        let (contrast, total) = self.whole;
        // The residuals stand for the pixels that are kept: of those that a budget cut, others like them are there.
        let share = self.kept * libm::sqrt(level.total / total);
        level.dissimilarity(scratch) * share * level.contrast / contrast.max(f64::MIN_POSITIVE)
    }

    /// Makes `level`, a copy of the mean, the picture of these coefficients; its slopes too where asked for.
    pub(super) fn place(&self, level: &mut Level, coefficients: &[f64], with_slopes: bool) {
        for k in 0..if with_slopes { 3 } else { 1 } {
            for c in 0..self.mean.looks[k].len() {
                blend(&mut level.looks[k][c], &self.mean.looks[k][c], coefficients, |l| &self.parts[l][k][c]);
            }
        }
        if with_slopes {
            level.set_tensor();
        }
        if let Some((mean, rest)) = self.cover.split_first() {
            blend(&mut level.weight, mean, coefficients, |l| &rest[l]);
            // Half covered pixels show as much of what is behind.
            level.weight.iter_mut().for_each(|w| *w = (2.0 * *w - 1.0).clamp(0.0, 1.0));
            level.total = level.weight.iter().map(|w| f64::from(*w)).sum();
        }
    }

    /// Weighted residuals against each component: the right side of the normal equations. Leaves the weighted residuals in `pulled`.
    pub(super) fn right(&self, scratch: &Scratch, pulled: &mut Vec<Vec<f32>>) -> DVector<f64> {
        pulled.resize(scratch.residual.len(), Vec::new());
        for (p, r) in pulled.iter_mut().zip(&scratch.residual) {
            p.clear();
            p.extend(r.iter().zip(&scratch.robust).map(|(r, w)| r * w));
        }
        let (n, pixels) = (self.parts.len(), scratch.robust.len());
        let mut out = DVector::zeros(n);
        for start in (0..pixels).step_by(BLOCK) {
            let r = start..pixels.min(start + BLOCK);
            for l in (0..n).step_by(4) {
                let sums = self.with_four(l, n - 1, pulled.iter().map(|p| &p[r.clone()]), r.clone());
                (l..n.min(l + 4)).for_each(|k| out[k] += sums[k - l]);
            }
        }
        out
    }

    /// Inner products of some pixels, a row a channel, with the components from `l` on, at most the one of number `last`. Four at a time, so that what they are
    /// multiplied with is read once for them.
    fn with_four<'a>(&self, l: usize, last: usize, pixels: impl Iterator<Item = &'a [f32]>, r: Range<usize>) -> [f64; 4] {
        let four = [0, 1, 2, 3].map(|k| &self.parts[(l + k).min(last)][0]);
        let mut sums = [0.0; 4];
        for (c, p) in pixels.enumerate() {
            let products = dots(p, four.map(|e| &e[c][r.clone()]));
            sums.iter_mut().zip(products).for_each(|(s, p)| *s += f64::from(p));
        }
        sums
    }

    /// The components' share of the Gauss-Newton matrix under the robust weights, the slopes being those of `level`.
    pub(super) fn curvature(&self, level: &Level, scratch: &Scratch) -> Curvature {
        let (n, pixels) = (self.parts.len(), scratch.robust.len());
        let mut found = Curvature { cross: vec![Vector6::zeros(); n], own: DMatrix::zeros(n, n) };
        let mut weighed = vec![vec![0.0f32; BLOCK]; self.mean.looks[0].len()];
        for start in (0..pixels).step_by(BLOCK) {
            let r = start..pixels.min(start + BLOCK);
            for l in 0..n {
                for (to, e) in weighed.iter_mut().zip(&self.parts[l][0]) {
                    to.clear();
                    to.extend(e[r.clone()].iter().zip(&scratch.robust[r.clone()]).map(|(e, w)| e * w));
                }
                for m in (0..=l).step_by(4) {
                    let sums = self.with_four(m, l, weighed.iter().map(Vec::as_slice), r.clone());
                    (m..=l.min(m + 3)).for_each(|k| found.own[(l, k)] += sums[k - m]);
                }
                found.cross[l] += self.cross(level, &weighed, r.clone());
            }
        }
        found.own.fill_upper_triangle_with_lower_triangle();
        found
    }

    /// Sums of a weighted component with the six steepest descent pictures, over some pixels.
    fn cross(&self, level: &Level, weighed: &[Vec<f32>], r: Range<usize>) -> Vector6<f64> {
        let at = self.at.each_ref().map(|c| &c[r.clone()]);
        Vector6::from(cross(weighed, &level.looks[1], &level.looks[2], at, r.start).map(f64::from))
    }
}

/// What each pixel says about a step of one sample or a deviation of the pose: squared slopes and squared changes.
fn interest(looks: &[[Planes; 3]], layers: &Layers) -> Vec<f32> {
    let mut out = vec![0.0f32; layers.weight.len()];
    for (i, [value, dx, dy]) in looks.iter().enumerate() {
        let gain = if i == 0 { 1.0 } else { layers.variances[i - 1] as f32 };
        let of: &[&Planes] = if i == 0 { &[dx, dy] } else { &[value, dx, dy] };
        for plane in of.iter().flat_map(|p| &p.data) {
            out.iter_mut().zip(plane).for_each(|(o, v)| *o += gain * v * v);
        }
    }
    out.iter_mut().zip(layers.weight).for_each(|(o, w)| *o *= w);
    out
}

/// Weighted standard deviation of a picture, all channels together, and the sum of the weights.
fn contrast(picture: &Planes, weight: &[f32]) -> (f64, f64) {
    let total: f64 = weight.iter().map(|w| f64::from(*w)).sum();
    let variance = |plane: &Vec<f32>| {
        let sums = plane.iter().zip(weight).fold([0.0, 0.0], |[s, ss], (v, w)| {
            let (v, w) = (f64::from(*v), f64::from(*w));
            [s + w * v, ss + w * v * v]
        });
        (sums[1] / total - sums[0] * sums[0] / (total * total)).max(0.0)
    };
    (libm::sqrt(picture.data.iter().map(variance).sum()), total)
}

/// The chunks of pixels that say nearly all that can be said, as flat paint says where nothing is; of more than `most` pixels an even choice. And the root of how
/// many chunks each of them stands for.
fn telling(interest: &[f32], weight: &[f32], width: usize, most: usize) -> (Vec<Span>, f64) {
    let mut chunks: Vec<(f64, Span)> = Vec::new();
    for (row, (w, e)) in weight.chunks_exact(width).zip(interest.chunks_exact(width)).enumerate() {
        let Some(left) = w.iter().position(|&v| v > 0.0) else { continue };
        let right = w.iter().rposition(|&v| v > 0.0).map_or(left, |i| i + 1);
        for first in (left..right).step_by(LANES) {
            let end = right.min(first + LANES);
            chunks.push((e[first..end].iter().map(|v| f64::from(*v)).sum(), Span { row, first, end }));
        }
    }
    let total: f64 = chunks.iter().map(|c| c.0).sum();
    // A stable sort: equal chunks stay in the order of the picture.
    chunks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (mut said, mut kept) = (0.0, 0);
    while kept < chunks.len() && (kept < FEW / LANES || said < (1.0 - SPARED) * total) {
        said += chunks[kept].0;
        kept += 1;
    }
    chunks.truncate(kept);
    let mut spans: Vec<Span> = chunks.into_iter().map(|c| c.1).collect();
    spans.sort_by_key(|s| (s.row, s.first));
    let room = (most / LANES).max(1);
    let stands_for = (kept as f64 / room as f64).max(1.0);
    if kept > room {
        spans = (0..room).map(|i| spans[i * kept / room]).collect();
    }
    spans.dedup_by(|b, a| {
        let joined = a.row == b.row && a.end == b.first && (a.end - a.first).is_multiple_of(LANES);
        if joined {
            a.end = b.end;
        }
        joined
    });
    (spans, libm::sqrt(stands_for))
}

/// `out` = `mean` + the parts times their coefficients, four at a time.
fn blend<'a>(out: &mut [f32], mean: &[f32], coefficients: &[f64], part: impl Fn(usize) -> &'a Vec<f32>) {
    let last = coefficients.len().saturating_sub(1);
    for start in (0..out.len()).step_by(BLOCK) {
        let r = start..out.len().min(start + BLOCK);
        out[r.clone()].copy_from_slice(&mean[r.clone()]);
        for l in (0..coefficients.len()).step_by(4) {
            let gains = [0, 1, 2, 3].map(|k| coefficients.get(l + k).map_or(0.0, |c| *c as f32));
            add_scaled(&mut out[r.clone()], [0, 1, 2, 3].map(|k| &part((l + k).min(last))[r.clone()]), gains);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn add_scaled(to: &mut [f32], from: [&[f32]; 4], gains: [f32; 4]) {
    let n = to.len();
    let [a, b, c, d] = from.map(|f| &f[..n]);
    for i in 0..n {
        to[i] = to[i] + gains[0] * a[i] + gains[1] * b[i] + gains[2] * c[i] + gains[3] * d[i];
    }
}

/// Sums of a picture with the six steepest descent pictures, which are the slopes `gx` and `gy` times the coordinates `at` or one, from pixel `start` on.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn cross(picture: &[Vec<f32>], gx: &[Vec<f32>], gy: &[Vec<f32>], at: [&[f32]; 2], start: usize) -> [f32; 6] {
    let mut acc = [[0.0f32; LANES]; 6];
    let [across, down] = at;
    for (chunk, (x, y)) in across.as_chunks::<LANES>().0.iter().zip(down.as_chunks::<LANES>().0).enumerate() {
        let (mut u, mut v) = ([0.0f32; LANES], [0.0f32; LANES]);
        for ((p, gx), gy) in picture.iter().zip(gx).zip(gy) {
            let (p, r) = (&p[chunk * LANES..][..LANES], start + chunk * LANES..start + (chunk + 1) * LANES);
            let (gx, gy) = (&gx[r.clone()], &gy[r]);
            for k in 0..LANES {
                u[k] += p[k] * gx[k];
                v[k] += p[k] * gy[k];
            }
        }
        for k in 0..LANES {
            for (a, s) in acc.iter_mut().zip([u[k] * x[k], u[k] * y[k], v[k] * x[k], v[k] * y[k], u[k], v[k]]) {
                a[k] += s;
            }
        }
    }
    acc.map(super::super::level::sum_lanes)
}

/// Inner products of one row of numbers with four, each as many as it, a multiple of the lanes.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn dots(a: &[f32], b: [&[f32]; 4]) -> [f32; 4] {
    let mut acc = [[0.0f32; LANES]; 4];
    let n = a.len() / LANES * LANES;
    let b = b.map(|b| &b[..n]);
    for start in (0..n).step_by(LANES) {
        let own = &a[start..start + LANES];
        for (acc, b) in acc.iter_mut().zip(&b) {
            let b = &b[start..start + LANES];
            (0..LANES).for_each(|k| acc[k] += own[k] * b[k]);
        }
    }
    acc.map(super::super::level::sum_lanes)
}
