//! One pyramid level of the template: its pixels, their gradients, and the sums of one Gauss-Newton step.

use multiversion::multiversion;
use nalgebra::Vector2;

use super::options::{Options, Robust};
use super::planes::{Planes, filtered, gaussian_taps};
use super::solve::Sums;
use crate::algo::raster::{Affine, apply};

/// Lanes of every reduction: fixed, so that the bits do not depend on the processor.
pub(super) const LANES: usize = 16;
/// Most pixels that the residual's scale is taken from.
const MOST_PROBES: usize = 1024;
/// Least residual scale, as a share of the template's contrast: clean drawings have none of their own.
pub(super) const LEAST_SCALE: f64 = 0.004;

/// A row of template pixels; its arrays are padded to whole chunks of lanes with pixels of no weight.
#[derive(Clone, Debug)]
struct Row {
    /// Centre of the first pixel, in pixels of the reference.
    x: f64,
    y: f64,
    start: usize,
    len: usize,
}

/// The template at one level.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub(super) step: f64,
    rows: Vec<Row>,
    pub(super) weight: Vec<f32>,
    /// Smoothed samples and their slopes across and down, a channel each.
    pub(super) looks: [Vec<Vec<f32>>; 3],
    /// Sums over the channels of gx gx, gx gy and gy gy.
    tensor: [Vec<f32>; 3],
    probes: Vec<u32>,
    /// Weighted standard deviation of the samples over the region, all channels together.
    pub(super) contrast: f64,
    pub(super) total: f64,
    centre: [f64; 2],
    scale: f64,
}

/// Work space of the iterations, one value a template pixel.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    pub(super) residual: Vec<Vec<f32>>,
    /// Sum over the channels of the squared residual.
    norm: Vec<f32>,
    /// Template weight where the sample lies inside the frame, else zero.
    valid: Vec<f32>,
    pub(super) robust: Vec<f32>,
    probe: Vec<f32>,
}

/// Neighbouring pixels of one row of a crop: its number, the first pixel, the one after the last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub(super) row: usize,
    pub(super) first: usize,
    pub(super) end: usize,
}

/// From the first to the last pixel with a weight, in each row that has one.
fn spans(weight: &[f32], width: usize) -> Vec<Span> {
    let rows = weight.chunks_exact(width.max(1)).enumerate();
    let span = |(row, w): (usize, &[f32])| {
        let first = w.iter().position(|&v| v > 0.0)?;
        Some(Span { row, first, end: w.iter().rposition(|&v| v > 0.0).map_or(first, |i| i + 1) })
    };
    rows.filter_map(span).collect()
}

/// The samples of `plane` in `spans`, times `gain`, each span padded with zeros to whole chunks of lanes.
pub(super) fn packed(plane: &[f32], width: usize, spans: &[Span], gain: f32) -> Vec<f32> {
    let mut out = Vec::new();
    for s in spans {
        out.extend(plane[s.row * width + s.first..s.row * width + s.end].iter().map(|v| v * gain));
        out.resize(out.len().div_ceil(LANES) * LANES, 0.0);
    }
    out
}

/// A picture and its slopes in `spans`, by channel; slopes a pixel of the reference.
pub(super) fn packed_looks(looks: &[Planes; 3], spans: &[Span]) -> [Vec<Vec<f32>>; 3] {
    let per_pixel = (1.0 / looks[0].step) as f32;
    [0, 1, 2].map(|k| {
        let gain = if k == 0 { 1.0 } else { per_pixel };
        looks[k].data.iter().map(|plane| packed(plane, looks[k].width, spans, gain)).collect()
    })
}

/// Smoothed samples of a picture and their slopes across and down, a sample.
pub(super) fn slopes(planes: &Planes, sigma: f64) -> [Planes; 3] {
    let (smooth, derive) = gaussian_taps(sigma);
    let all = [0, 0, planes.width, planes.height];
    let (smooth, derive) = ((&smooth[..], 1.0), (&derive[..], -1.0));
    [filtered(planes, all, smooth, smooth), filtered(planes, all, derive, smooth), filtered(planes, all, smooth, derive)]
}

/// What the residuals of one placement say.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Fit {
    /// Share of the region's weight that lies inside the frame.
    pub(super) overlap: f64,
    /// Robust standard deviation of the residual, one channel's worth.
    pub(super) scale: f64,
}

impl Level {
    /// The template pixels of `planes` where `weight` is not zero; `None` where there are none.
    pub(super) fn new(planes: &Planes, weight: &[f32], sigma: f64, centre: [f64; 2], scale: f64) -> Option<Self> {
        Self::on(&slopes(planes, sigma), weight, &spans(weight, planes.width), centre, scale)
    }

    /// The template pixels of a picture with its slopes in `spans`; `None` where they have no weight.
    pub(super) fn on(looks: &[Planes; 3], weight: &[f32], spans: &[Span], centre: [f64; 2], scale: f64) -> Option<Self> {
        let Planes { width, origin, step, .. } = looks[0];
        let centre_of = |i: usize, axis: usize| origin[axis] + (i as f64 + 0.5) * step;
        let mut start = 0;
        let row = |s: &Span| {
            let len = (s.end - s.first).div_ceil(LANES) * LANES;
            start += len;
            Row { x: centre_of(s.first, 0), y: centre_of(s.row, 1), start: start - len, len }
        };
        let mut level = Self {
            step,
            rows: spans.iter().map(row).collect(),
            weight: packed(weight, width, spans, 1.0),
            looks: packed_looks(looks, spans),
            tensor: [Vec::new(), Vec::new(), Vec::new()],
            probes: Vec::new(),
            contrast: 0.0,
            total: 0.0,
            centre,
            scale,
        };
        level.finish();
        (level.total > 0.0).then_some(level)
    }

    /// Fills what follows from the pixels: structure tensor, probes, contrast.
    fn finish(&mut self) {
        self.set_tensor();
        self.total = self.weight.iter().map(|&w| f64::from(w)).sum();
        if self.total <= 0.0 {
            return;
        }
        for v in &self.looks[0] {
            let (mut s, mut ss) = (0.0f64, 0.0f64);
            for (&w, &v) in self.weight.iter().zip(v) {
                s += f64::from(w) * f64::from(v);
                ss += f64::from(w) * f64::from(v) * f64::from(v);
            }
            let mean = s / self.total;
            self.contrast += (ss / self.total - mean * mean).max(0.0);
        }
        self.contrast = libm::sqrt(self.contrast);
        self.choose_probes();
    }

    /// The structure tensor of the slopes as they are.
    pub(super) fn set_tensor(&mut self) {
        let n = self.weight.len();
        let [_, gx, gy] = &self.looks;
        for (to, (a, b)) in self.tensor.iter_mut().zip([(gx, gx), (gx, gy), (gy, gy)]) {
            to.clear();
            to.resize(n, 0.0);
            a.iter().zip(b).for_each(|(a, b)| add_products(to, a, b));
        }
    }

    /// The centred and scaled coordinates of every template pixel: across, down.
    pub(super) fn coordinates(&self) -> [Vec<f32>; 2] {
        let across = |r: &Row| (0..r.len).map(|k| ((r.x - self.centre[0] + k as f64 * self.step) / self.scale) as f32).collect::<Vec<_>>();
        let down = |r: &Row| vec![((r.y - self.centre[1]) / self.scale) as f32; r.len];
        [self.rows.iter().flat_map(across).collect(), self.rows.iter().flat_map(down).collect()]
    }

    /// The scale of the residual matters where there is a gradient: flat pixels fit anywhere and would hide a misfit.
    fn choose_probes(&mut self) {
        let energy = |i: usize| f64::from(self.tensor[0][i] + self.tensor[2][i]);
        let mean = (0..self.weight.len()).map(|i| f64::from(self.weight[i]) * energy(i)).sum::<f64>() / self.total;
        let rich: Vec<u32> =
            (0..self.weight.len()).filter(|&i| self.weight[i] > 0.1 && energy(i) >= 0.5 * mean).map(|i| i as u32).collect();
        let stride = rich.len().div_ceil(MOST_PROBES).max(1);
        self.probes = rich.into_iter().step_by(stride).collect();
    }

    /// Sum of the weights, in samples of this level.
    pub(super) fn total(&self) -> f64 {
        self.total
    }

    /// Samples `frame` at the template's pixels moved by `motion`; leaves the residuals in `scratch` and returns the share inside the frame.
    pub(super) fn sample(&self, frame: &Planes, size: [usize; 2], motion: &Affine, scratch: &mut Scratch) -> f64 {
        let n = self.weight.len();
        scratch.residual.resize(self.looks[0].len(), Vec::new());
        scratch.residual.iter_mut().for_each(|r| r.resize(n, 0.0));
        scratch.norm.resize(n, 0.0);
        scratch.valid.resize(n, 0.0);
        scratch.robust.resize(n, 0.0);
        if frame.width < 2 || frame.height < 2 || frame.data.len() != self.looks[0].len() {
            scratch.norm.fill(0.0);
            scratch.valid.fill(0.0);
            return 0.0;
        }
        let bounds = bounds_of(frame, size);
        let per = self.step / frame.step;
        let slope = [(motion[(0, 0)] * per) as f32, (motion[(1, 0)] * per) as f32];
        let mut inside = 0.0f64;
        for row in &self.rows {
            let p = apply(motion, Vector2::new(row.x, row.y));
            let start = [(p.x - frame.origin[0]) / frame.step - 0.5, (p.y - frame.origin[1]) / frame.step - 0.5];
            let range = row.start..row.start + row.len;
            let line = Line { start: [start[0] as f32, start[1] as f32], slope, bounds };
            inside += f64::from(sample_row(&line, frame, &self.weight[range.clone()], &self.looks[0], range, scratch));
        }
        inside / self.total
    }

    /// Fits gain and offset a channel of the frame to the template and removes them from the residuals.
    pub(super) fn remove_gain(&self, scratch: &mut Scratch) {
        let cut = (0.5 * self.contrast) * (0.5 * self.contrast);
        for round in 0..2 {
            let weights: Vec<f64> = scratch
                .valid
                .iter()
                .zip(&scratch.norm)
                .map(|(&w, &n)| f64::from(w) * if round == 0 { 1.0 } else { gm(f64::from(n), cut) })
                .collect();
            scratch.norm.fill(0.0);
            for (value, residual) in self.looks[0].iter().zip(&mut scratch.residual) {
                let (gain, offset) = gain_of(value, residual, &weights);
                for ((r, &v), n) in residual.iter_mut().zip(value).zip(&mut scratch.norm) {
                    *r = ((f64::from(*r) + f64::from(v) - offset) / gain) as f32 - v;
                    *n += *r * *r;
                }
            }
        }
    }

    /// The robust scale of the last sampled residuals: the median magnitude where there are gradients, as a standard deviation.
    pub(super) fn fit(&self, overlap: f64, scratch: &mut Scratch) -> Fit {
        scratch.probe.clear();
        for &p in &self.probes {
            if scratch.valid[p as usize] > 0.0 {
                scratch.probe.push(scratch.norm[p as usize]);
            }
        }
        let n = scratch.probe.len();
        if n == 0 {
            return Fit { overlap, scale: 0.0 };
        }
        let (_, median, _) = scratch.probe.select_nth_unstable_by(n / 2, f32::total_cmp);
        Fit { overlap, scale: libm::sqrt(f64::from(*median)) / 0.6745 }
    }

    /// The sums of equation (12) over the last sampled residuals, with robust weights.
    pub(super) fn sums(&self, fit: &Fit, how: &Options, scratch: &mut Scratch) -> Sums {
        let cut = how.cut * fit.scale.max(LEAST_SCALE * self.contrast);
        weigh(&mut scratch.robust, &scratch.valid, &scratch.norm, how.robust, cut as f32);
        let mut sums = Sums::default();
        for row in &self.rows {
            let y = (row.y - self.centre[1]) / self.scale;
            let x = [((row.x - self.centre[0]) / self.scale) as f32, (self.step / self.scale) as f32];
            let s = self.row_sums(row, x, scratch);
            for t in 0..3 {
                let [m, mx, mxx] = [f64::from(s[3 * t]), f64::from(s[3 * t + 1]), f64::from(s[3 * t + 2])];
                for (to, v) in sums.tensor[t].iter_mut().zip([m, mx, m * y, mxx, mx * y, m * y * y]) {
                    *to += v;
                }
            }
            for t in 0..2 {
                let [m, mx] = [f64::from(s[9 + 2 * t]), f64::from(s[10 + 2 * t])];
                for (to, v) in sums.right[t].iter_mut().zip([m, mx, m * y]) {
                    *to += v;
                }
            }
        }
        sums
    }

    fn row_sums(&self, row: &Row, x: [f32; 2], scratch: &Scratch) -> [f32; 13] {
        let r = row.start..row.start + row.len;
        let tensor = [&self.tensor[0][r.clone()], &self.tensor[1][r.clone()], &self.tensor[2][r.clone()]];
        row_sums(x, &scratch.robust[r.clone()], tensor, &scratch.residual, &self.looks[1], &self.looks[2], r)
    }

    /// How badly the last sampled residuals fit: 0 for a perfect fit, 1 where nothing fits; what lies off the frame does not fit.
    pub(super) fn cost(&self, scratch: &Scratch) -> f64 {
        let cut = (0.5 * self.contrast) * (0.5 * self.contrast) + 1e-12;
        let mut good = 0.0f64;
        for (&w, &n) in scratch.valid.iter().zip(&scratch.norm) {
            good += f64::from(w) * (cut / (cut + f64::from(n)));
        }
        1.0 - good / self.total
    }

    /// Root mean square of the residual over the region's contrast (the dissimilarity of Shi and Tomasi, made relative).
    pub(super) fn dissimilarity(&self, scratch: &Scratch) -> f64 {
        let (mut ss, mut s) = (0.0f64, 0.0f64);
        for (&w, &n) in scratch.valid.iter().zip(&scratch.norm) {
            ss += f64::from(w) * f64::from(n);
            s += f64::from(w);
        }
        if s > 0.0 && self.contrast > 0.0 { libm::sqrt(ss / s) / self.contrast } else { f64::INFINITY }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn add_products(to: &mut [f32], a: &[f32], b: &[f32]) {
    let n = to.len();
    let (a, b) = (&a[..n], &b[..n]);
    for i in 0..n {
        to[i] += a[i] * b[i];
    }
}

fn gm(n: f64, cut: f64) -> f64 {
    let q = cut / (cut + n);
    if cut > 0.0 { q * q } else { 1.0 }
}

/// Weighted least squares of frame = gain * template + offset; (1, 0) where it cannot be told.
fn gain_of(value: &[f32], residual: &[f32], weights: &[f64]) -> (f64, f64) {
    let (mut s, mut st, mut stt, mut si, mut sti) = (0.0f64, 0.0, 0.0, 0.0, 0.0);
    for ((&v, &r), &w) in value.iter().zip(residual).zip(weights) {
        let (t, i) = (f64::from(v), f64::from(r) + f64::from(v));
        s += w;
        st += w * t;
        stt += w * t * t;
        si += w * i;
        sti += w * t * i;
    }
    let det = s * stt - st * st;
    if det.is_nan() || det <= 1e-9 * s * stt {
        return (1.0, if s > 0.0 { (si - st) / s } else { 0.0 });
    }
    let gain = ((s * sti - st * si) / det).clamp(0.1, 10.0);
    (gain, (si - gain * st) / s)
}

/// The sampling line of one template row: sample coordinates of its first pixel, their change a pixel, and the bounds of the frame.
struct Line {
    start: [f32; 2],
    slope: [f32; 2],
    bounds: [f32; 4],
}

/// Least and greatest sample coordinates (x, y) that lie on `frame` and on the picture of `size` pixels it was cut from.
fn bounds_of(frame: &Planes, size: [usize; 2]) -> [f32; 4] {
    let low = |axis: usize| ((-frame.origin[axis]) / frame.step - 0.5).max(-0.5) as f32;
    let high = |axis: usize, n: usize| ((size[axis] as f64 - frame.origin[axis]) / frame.step - 0.5).min(n as f64 - 0.5) as f32;
    [low(0), low(1), high(0, frame.width), high(1, frame.height)]
}

/// Pixels of a row that are sampled together: enough that what is gathered has left the store buffer before it is read as vectors.
const BLOCK: usize = 64;

/// Where the pixels of a block fall in the frame: index of the upper left of four samples, and the shares of the right and lower ones.
struct Places {
    index: [u32; BLOCK],
    fx: [f32; BLOCK],
    fy: [f32; BLOCK],
}

/// 2^23: a float of this size has no fraction bits, so adding it rounds and leaves the integer in the mantissa.
const ROUNDER: f32 = 8_388_608.0;

/// The whole part of `x` (rounded down, or exactly one less at whole numbers), at most `last`; `x` must not be negative.
#[inline(always)]
fn whole(x: f32, last: u32) -> u32 {
    (((x - 0.5).max(0.0) + ROUNDER).to_bits() & 0x7f_ffff).min(last)
}

/// Fills `places` and `valid` for `n` pixels from number `first` on.
#[inline(always)]
fn place(line: &Line, first: usize, weight: &[f32], valid: &mut [f32], size: [usize; 2], places: &mut Places) {
    // The frame is at least 2x2, so both are at least 0; the mask keeps every index below 2^23 each way.
    let (last_x, last_y) = ((size[0] - 2) as u32, (size[1] - 2) as u32);
    let (edge_x, edge_y) = ((size[0] - 1) as f32, (size[1] - 1) as f32);
    let [lo_x, lo_y, hi_x, hi_y] = line.bounds;
    let stride = size[0] as u32;
    for k in 0..weight.len().min(valid.len()).min(BLOCK) {
        let i = (first + k) as f32;
        let (u, v) = (line.start[0] + i * line.slope[0], line.start[1] + i * line.slope[1]);
        let ok = (u >= lo_x) & (u <= hi_x) & (v >= lo_y) & (v <= hi_y);
        valid[k] = if ok { weight[k] } else { 0.0 };
        // Clamped in this order, a coordinate that is not a number becomes zero.
        let (u, v) = (u.max(0.0).min(edge_x), v.max(0.0).min(edge_y));
        let (iu, iv) = (whole(u, last_x), whole(v, last_y));
        places.fx[k] = u - iu as i32 as f32;
        places.fy[k] = v - iv as i32 as f32;
        places.index[k] = iv.wrapping_mul(stride).wrapping_add(iu);
    }
}

/// Samples one row of the template in the frame; returns the weight that lies inside.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn sample_row(
    line: &Line,
    frame: &Planes,
    weight: &[f32],
    value: &[Vec<f32>],
    range: std::ops::Range<usize>,
    scratch: &mut Scratch,
) -> f32 {
    let w = frame.width;
    let mut places = Places { index: [0; BLOCK], fx: [0.0; BLOCK], fy: [0.0; BLOCK] };
    let mut inside = [0.0f32; LANES];
    for (block, weight) in weight.chunks(BLOCK).enumerate() {
        let n = weight.len();
        let at = range.start + block * BLOCK;
        let valid = &mut scratch.valid[at..at + n];
        place(line, block * BLOCK, weight, valid, [frame.width, frame.height], &mut places);
        for v in valid.chunks_exact(LANES) {
            (0..LANES).for_each(|k| inside[k] += v[k]);
        }
        let norm = &mut scratch.norm[at..at + n];
        norm.fill(0.0);
        for ((plane, value), residual) in frame.data.iter().zip(value).zip(&mut scratch.residual) {
            let (mut top, mut bottom) = ([[0.0f32; 2]; BLOCK], [[0.0f32; 2]; BLOCK]);
            for k in 0..n {
                let i = places.index[k] as usize;
                let q = &plane[i..i + w + 2];
                top[k] = [q[0], q[1]];
                bottom[k] = [q[w], q[w + 1]];
            }
            let (value, residual) = (&value[at..at + n], &mut residual[at..at + n]);
            for k in 0..n {
                let upper = top[k][0] + places.fx[k] * (top[k][1] - top[k][0]);
                let lower = bottom[k][0] + places.fx[k] * (bottom[k][1] - bottom[k][0]);
                let r = upper + places.fy[k] * (lower - upper) - value[k];
                residual[k] = r;
                norm[k] += r * r;
            }
        }
    }
    sum_lanes(inside)
}

/// Robust weights times the template's: Geman-McClure 1/(1 + r^2/c^2)^2, Huber min(1, c/|r|), or none.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn weigh(out: &mut [f32], valid: &[f32], norm: &[f32], robust: Robust, cut: f32) {
    let n = out.len();
    let (valid, norm) = (&valid[..n], &norm[..n]);
    let cut_sq = cut * cut + f32::MIN_POSITIVE;
    match robust {
        Robust::None => out.copy_from_slice(valid),
        Robust::Huber => {
            for i in 0..n {
                let r = norm[i].sqrt();
                out[i] = valid[i] * if r > cut { cut / r } else { 1.0 };
            }
        }
        Robust::GemanMcclure => {
            for i in 0..n {
                let q = cut_sq / (cut_sq + norm[i]);
                out[i] = valid[i] * q * q;
            }
        }
    }
}

pub(super) fn sum_lanes(v: [f32; LANES]) -> f32 {
    let mut v = v;
    for half in [8, 4, 2, 1] {
        for k in 0..half {
            v[k] += v[k + half];
        }
    }
    v[0]
}

/// The thirteen sums of one row: w gxx, w gxy, w gyy, each with 1, x, x x; then w r gx and w r gy, each with 1, x.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn row_sums(
    x: [f32; 2],
    weight: &[f32],
    tensor: [&[f32]; 3],
    residual: &[Vec<f32>],
    gx: &[Vec<f32>],
    gy: &[Vec<f32>],
    range: std::ops::Range<usize>,
) -> [f32; 13] {
    let mut acc = [[0.0f32; LANES]; 13];
    for (chunk, weight) in weight.chunks_exact(LANES).enumerate() {
        let local = chunk * LANES;
        let at = range.start + local;
        let (mut rx, mut ry) = ([0.0f32; LANES], [0.0f32; LANES]);
        for ((r, gx), gy) in residual.iter().zip(gx).zip(gy) {
            let (r, gx, gy) = (&r[at..at + LANES], &gx[at..at + LANES], &gy[at..at + LANES]);
            for k in 0..LANES {
                rx[k] += r[k] * gx[k];
                ry[k] += r[k] * gy[k];
            }
        }
        let [txx, txy, tyy] = [&tensor[0][local..local + LANES], &tensor[1][local..local + LANES], &tensor[2][local..local + LANES]];
        for k in 0..LANES {
            let px = x[0] + (local + k) as f32 * x[1];
            let (xx, xy, yy) = (weight[k] * txx[k], weight[k] * txy[k], weight[k] * tyy[k]);
            acc[0][k] += xx;
            acc[1][k] += xx * px;
            acc[2][k] += xx * px * px;
            acc[3][k] += xy;
            acc[4][k] += xy * px;
            acc[5][k] += xy * px * px;
            acc[6][k] += yy;
            acc[7][k] += yy * px;
            acc[8][k] += yy * px * px;
            let (bx, by) = (weight[k] * rx[k], weight[k] * ry[k]);
            acc[9][k] += bx;
            acc[10][k] += bx * px;
            acc[11][k] += by;
            acc[12][k] += by * px;
        }
    }
    acc.map(sum_lanes)
}
