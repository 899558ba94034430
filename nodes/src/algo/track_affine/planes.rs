//! Pictures as the tracker wants them: planar, cropped to the neighbourhood of the region, in a pyramid, smoothed.

use multiversion::multiversion;

use super::options::Tone;
use crate::algo::raster::Raster;

/// Pixels of one pyramid level of a crop, one plane a channel.
///
/// The centre of the sample at column i, row j lies at `origin + step * (i + 1/2, j + 1/2)` of the full picture.
#[derive(Clone, Debug)]
pub(super) struct Planes {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Top left corner, in pixels of the full picture.
    pub(super) origin: [f64; 2],
    /// Pixels of the full picture that one sample spans.
    pub(super) step: f64,
    pub(super) data: Vec<Vec<f32>>,
}

/// A rectangle of whole pixels: left, top, right, bottom; may lie partly off the picture, whose edge is then repeated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    pub(super) x0: i64,
    pub(super) y0: i64,
    pub(super) x1: i64,
    pub(super) y1: i64,
}

impl Window {
    /// The window grown to multiples of `block`, cut to the picture (itself grown to multiples of `block`); `None` where nothing is left.
    pub(super) fn aligned(self, block: i64, width: usize, height: usize) -> Option<Self> {
        let up = |v: i64| (v + block - 1).div_euclid(block) * block;
        let w = Self {
            x0: self.x0.max(0).div_euclid(block) * block,
            y0: self.y0.max(0).div_euclid(block) * block,
            x1: up(self.x1.min(width as i64)),
            y1: up(self.y1.min(height as i64)),
        };
        (w.x1 > w.x0 && w.y1 > w.y0).then_some(w)
    }

    /// True where `inner` lies within this window, but for what is off the picture of `size` pixels.
    pub(super) fn covers(&self, inner: &Window, size: [usize; 2]) -> bool {
        let [w, h] = size.map(|n| n as i64);
        inner.x0.max(0) >= self.x0 && inner.y0.max(0) >= self.y0 && inner.x1.min(w) <= self.x1 && inner.y1.min(h) <= self.y1
    }
}

/// How the background of a picture is replaced where a matte is known.
pub(super) struct Key<'a> {
    pub(super) matte: &'a [f32],
    /// The colour put behind the region, a channel.
    pub(super) behind: &'a [f32],
    /// The amplitude of the matte as a channel of its own.
    pub(super) amplitude: f32,
    /// The matte takes light away before the tone is taken, as it does in premultiplied pictures; else after it.
    pub(super) premultiplied: bool,
}

/// Largest magnitude kept: the largest half float. Larger values, infinities and not-a-numbers become zero.
const LARGEST: f32 = 65504.0;
/// Offset of the encoding curve: its slope at black, 1 / (2 sqrt(0.0016)) = 12.5, is close to that of sRGB (12.92).
const TOE: f32 = 0.0016;
const TOE_ROOT: f32 = 0.04;

/// Matte under which a pixel shows the ground alone.
const FREE: f32 = 0.05;

/// One sample as the tracker sees it.
#[inline(always)]
pub(crate) fn toned(x: f32, tone: Tone) -> f32 {
    let x = if x.abs() <= LARGEST { x } else { 0.0 };
    match tone {
        Tone::Linear => x,
        Tone::Encoded => ((x.abs() + TOE).sqrt() - TOE_ROOT).copysign(x),
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn tone_row(out: &mut [f32], row: &[f32], stride: usize, encoded: bool) {
    if stride == 1 {
        if encoded {
            out.iter_mut().zip(row).for_each(|(o, &x)| *o = toned(x, Tone::Encoded));
        } else {
            out.iter_mut().zip(row).for_each(|(o, &x)| *o = toned(x, Tone::Linear));
        }
        return;
    }
    let tone = if encoded { Tone::Encoded } else { Tone::Linear };
    for (o, px) in out.iter_mut().zip(row.chunks(stride)) {
        *o = toned(px[0], tone);
    }
}

/// Calls `fill` with each output row and its source row (clamped to the picture), then repeats the edge columns.
fn fill_rows(window: Window, width: usize, height: usize, mut fill: impl FnMut(&mut [f32], usize, usize)) -> Vec<f32> {
    let (w, h) = ((window.x1 - window.x0) as usize, (window.y1 - window.y0) as usize);
    let mut plane = vec![0.0f32; w * h];
    // `aligned` gives 0 <= x0 < width, so at least one column comes from the picture.
    let x0 = (window.x0.max(0) as usize).min(width.saturating_sub(1));
    let n = w.min(width - x0);
    for (j, out) in plane.chunks_exact_mut(w).enumerate() {
        let y = (window.y0.max(0) as usize + j).min(height.saturating_sub(1));
        fill(&mut out[..n], x0, y);
        let edge = out[n - 1];
        out[n..].fill(edge);
    }
    plane
}

/// The channels `channels` of `picture` inside `window` (already aligned), toned, keyed where a key is given. O(pixels).
pub(super) fn crop(picture: Raster, channels: &[usize], window: Window, tone: Tone, key: Option<&Key>) -> Planes {
    let (pw, ph, stride) = (picture.width, picture.height, picture.channels);
    let mut data = Vec::with_capacity(channels.len() + 1);
    for &c in channels {
        data.push(fill_rows(window, pw, ph, |out, x0, y| {
            let row = &picture.row(y)[x0 * stride + c..];
            if let Some(key) = key.filter(|k| k.premultiplied) {
                let behind = key.behind.get(c).copied().unwrap_or(0.0);
                let matte = &key.matte[y * pw + x0..y * pw + x0 + out.len()];
                key_row(out, row, stride, matte, [behind, f32::from(u8::from(tone == Tone::Encoded))]);
                for (i, (o, &m)) in out.iter_mut().zip(matte).enumerate().filter(|(_, (_, m))| **m > 0.0 && **m < 1.0) {
                    *o = toned(covered(&picture, key.matte, c, [x0 + i, y], m), tone) + (1.0 - m) * behind;
                }
                return;
            }
            tone_row(out, row, stride, tone == Tone::Encoded);
            if let Some(key) = key {
                let behind = key.behind.get(c).copied().unwrap_or(0.0);
                for (o, &m) in out.iter_mut().zip(&key.matte[y * pw + x0..]) {
                    *o = behind + unit(m) * (*o - behind);
                }
            }
        }));
    }
    if let Some(key) = key {
        data.push(fill_rows(window, pw, ph, |out, x0, y| {
            for (o, &m) in out.iter_mut().zip(&key.matte[y * pw + x0..]) {
                *o = key.amplitude * unit(m);
            }
        }));
    }
    let (width, height) = ((window.x1 - window.x0) as usize, (window.y1 - window.y0) as usize);
    Planes { width, height, origin: [window.x0 as f64, window.y0 as f64], step: 1.0, data }
}

/// A row of a premultiplied key as if no pixel were covered in part; `how` is the colour behind, and 1 where tones are encoded.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn key_row(out: &mut [f32], row: &[f32], stride: usize, matte: &[f32], how: [f32; 2]) {
    let tone = if how[1] > 0.0 { Tone::Encoded } else { Tone::Linear };
    for ((o, px), &m) in out.iter_mut().zip(row.chunks(stride)).zip(matte) {
        *o = toned(unit(m) * px[0], tone) + (1.0 - unit(m)) * how[0];
    }
}

/// What the layer itself has of a pixel that it covers by `m`: the pixel less its share of the ground, which is taken from the free pixels around it.
///
/// Where none is free, as in the inside of a soft matte, the pixel is taken to be all the layer's.
fn covered(picture: &Raster, matte: &[f32], c: usize, [x, y]: [usize; 2], m: f32) -> f32 {
    let (mut sum, mut n) = (0.0f32, 0.0f32);
    for v in y.saturating_sub(2)..(y + 3).min(picture.height) {
        for u in x.saturating_sub(2)..(x + 3).min(picture.width) {
            if unit(matte[v * picture.width + u]) < FREE {
                sum += picture.data[(v * picture.width + u) * picture.channels + c];
                n += 1.0;
            }
        }
    }
    let own = picture.data[(y * picture.width + x) * picture.channels + c];
    if n > 0.0 { (own - (1.0 - m) * sum / n).max(0.0) } else { m * own }
}

/// A matte sample cut to 0..=1; not-a-number counts as outside.
#[inline(always)]
pub(super) fn unit(m: f32) -> f32 {
    if m > 0.0 { m.min(1.0) } else { 0.0 }
}

/// The next coarser level: each sample is the binomial (1 3 3 1)/8 mean, each way, around 2x2 samples. Sizes must be even.
pub(super) fn halve(fine: &Planes) -> Planes {
    let (width, height) = (fine.width / 2, fine.height / 2);
    let data = fine.data.iter().map(|p| halve_plane(p, fine.width, fine.height)).collect();
    Planes { width, height, origin: fine.origin, step: fine.step * 2.0, data }
}

fn halve_plane(plane: &[f32], w: usize, h: usize) -> Vec<f32> {
    let mut out = vec![0.0f32; (w / 2) * (h / 2)];
    let mut line = vec![0.0f32; w];
    for (j, out) in out.chunks_exact_mut((w / 2).max(1)).enumerate() {
        let row = |y: usize| &plane[y * w..(y + 1) * w];
        let rows = [row((2 * j).saturating_sub(1)), row(2 * j), row(2 * j + 1), row((2 * j + 2).min(h - 1))];
        halve_row(out, &mut line, rows);
    }
    out
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn halve_row(out: &mut [f32], line: &mut [f32], rows: [&[f32]; 4]) {
    let n = line.len();
    let [a, b, c, d] = rows.map(|r| &r[..n]);
    for x in 0..n {
        line[x] = ((a[x] + d[x]) + 3.0 * (b[x] + c[x])) * (1.0 / 64.0);
    }
    let half = n / 2;
    let out = &mut out[..half];
    if half == 0 {
        return;
    }
    out[0] = (line[0] + line[2.min(n - 1)]) + 3.0 * (line[0] + line[1]);
    for x in 1..half.saturating_sub(1) {
        out[x] = (line[2 * x - 1] + line[2 * x + 2]) + 3.0 * (line[2 * x] + line[2 * x + 1]);
    }
    if half > 1 {
        let x = half - 1;
        out[x] = (line[2 * x - 1] + line[2 * x + 1]) + 3.0 * (line[2 * x] + line[2 * x + 1]);
    }
}

/// The crop and its coarser levels, finest first.
pub(super) fn pyramid(crop: Planes, levels: usize) -> Vec<Planes> {
    let mut all = vec![crop];
    while all.len() < levels {
        let next = halve(&all[all.len() - 1]);
        all.push(next);
    }
    all
}

/// The positive half of the taps of a Gaussian and of its derivative, for a deviation of `sigma` samples.
///
/// The smoothing taps sum to one and the derivative taps measure the slope of a ramp exactly.
pub(super) fn gaussian_taps(sigma: f64) -> (Vec<f32>, Vec<f32>) {
    if sigma < 0.1 {
        return (vec![1.0], vec![0.0, 0.5]);
    }
    let radius = libm::ceil(3.0 * sigma).clamp(1.0, 24.0) as usize;
    let g: Vec<f64> = (0..=radius).map(|i| libm::exp(-0.5 * (i * i) as f64 / (sigma * sigma))).collect();
    let sum = g[0] + 2.0 * g[1..].iter().sum::<f64>();
    let slope = 2.0 * g.iter().enumerate().map(|(i, v)| (i * i) as f64 * v).sum::<f64>();
    let smooth = g.iter().map(|v| (v / sum) as f32).collect();
    let derive = g.iter().enumerate().map(|(i, v)| (i as f64 * v / slope) as f32).collect();
    (smooth, derive)
}

/// Symmetric (`sign` = 1) or antisymmetric (`sign` = -1) vertical filter of one row; edges repeat.
fn filter_column(out: &mut [f32], plane: &[f32], w: usize, h: usize, at: (usize, usize), taps: &[f32], sign: f32) {
    let (x0, y) = at;
    let n = out.len();
    let row = |y: usize| &plane[y * w + x0..y * w + x0 + n];
    let mid = row(y);
    let first = taps[0];
    out.iter_mut().zip(mid).for_each(|(o, &v)| *o = first * v);
    for (i, &t) in taps.iter().enumerate().skip(1) {
        let (lo, hi) = (row(y.saturating_sub(i)), row((y + i).min(h - 1)));
        add_pair(out, lo, hi, t, sign);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn add_pair(out: &mut [f32], lo: &[f32], hi: &[f32], tap: f32, sign: f32) {
    let n = out.len();
    let (lo, hi) = (&lo[..n], &hi[..n]);
    for x in 0..n {
        out[x] += tap * (hi[x] + sign * lo[x]);
    }
}

/// Horizontal filter of a row that has `taps.len() - 1` samples of apron on either side.
fn filter_row(out: &mut [f32], line: &[f32], taps: &[f32], sign: f32) {
    let (n, r) = (out.len(), taps.len() - 1);
    let first = taps[0];
    out.iter_mut().zip(&line[r..]).for_each(|(o, &v)| *o = first * v);
    for (i, &t) in taps.iter().enumerate().skip(1) {
        add_pair(out, &line[r - i..r - i + n], &line[r + i..r + i + n], t, sign);
    }
}

/// Separable filter of the sub-rectangle `rect` (x0, y0, x1, y1 in samples, inside the planes) of every plane.
///
/// `across` and `down` are half kernels; a sign of -1 makes a kernel antisymmetric. O(pixels times taps).
pub(super) fn filtered(src: &Planes, rect: [usize; 4], across: (&[f32], f32), down: (&[f32], f32)) -> Planes {
    let [x0, y0, x1, y1] = rect;
    let (w, h, r) = (x1 - x0, y1 - y0, across.0.len() - 1);
    // Columns read from the source; beyond its edges the last sample repeats.
    let (sx0, sx1) = (x0.saturating_sub(r), (x1 + r).min(src.width));
    let (pad_left, pad_right) = (r - (x0 - sx0), r - (sx1 - x1));
    let mut line = vec![0.0f32; w + 2 * r];
    let mut data = Vec::with_capacity(src.data.len());
    for plane in &src.data {
        let mut out = vec![0.0f32; w * h];
        for (j, out) in out.chunks_exact_mut(w.max(1)).enumerate() {
            let end = line.len() - pad_right;
            filter_column(&mut line[pad_left..end], plane, src.width, src.height, (sx0, y0 + j), down.0, down.1);
            let (first, last) = (line[pad_left], line[end - 1]);
            line[..pad_left].fill(first);
            line[end..].fill(last);
            filter_row(out, &line, across.0, across.1);
        }
        data.push(out);
    }
    let origin = [src.origin[0] + x0 as f64 * src.step, src.origin[1] + y0 as f64 * src.step];
    Planes { width: w, height: h, origin, step: src.step, data }
}

/// The part of `src` that covers `window` (pixels of the full picture), smoothed; at least 2x2 samples where `src` has them.
pub(super) fn smoothed(src: &Planes, window: Window, taps: &[f32]) -> Planes {
    let span = |lo: i64, hi: i64, origin: f64, n: usize| {
        let first = libm::floor((lo as f64 - origin) / src.step).clamp(0.0, n.saturating_sub(2) as f64) as usize;
        let last = libm::ceil((hi as f64 - origin) / src.step).clamp(0.0, n as f64) as usize;
        (first, last.max(first + 2).min(n))
    };
    let (x0, x1) = span(window.x0, window.x1, src.origin[0], src.width);
    let (y0, y1) = span(window.y0, window.y1, src.origin[1], src.height);
    filtered(src, [x0, y0, x1, y1], (taps, 1.0), (taps, 1.0))
}
