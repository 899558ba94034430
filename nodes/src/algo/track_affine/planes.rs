//! Pictures as the tracker wants them: planar, cropped to the neighbourhood of the region, in a pyramid, smoothed.

use multiversion::multiversion;

use super::level::LANES;
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

impl Key<'_> {
    /// The matte of `n` pixels of a picture `width` wide.
    fn row(&self, y: usize, x0: usize, width: usize, n: usize) -> &[f32] {
        &self.matte[y * width + x0..][..n]
    }

    fn behind(&self, channel: usize) -> f32 {
        self.behind.get(channel).copied().unwrap_or(0.0)
    }
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

/// Calls `put` with each output sample, its pixel and its place in the row, pixels being `N` samples each.
#[inline(always)]
fn each_pixel<const N: usize>(out: &mut [f32], row: &[f32], put: impl Fn(&mut f32, &[f32; N], usize)) {
    out.iter_mut().zip(row.as_chunks::<N>().0).enumerate().for_each(|(i, (o, px))| put(o, px, i));
}

/// The sample whose tone is `v`.
pub(super) fn untoned(v: f32, tone: Tone) -> f32 {
    match tone {
        Tone::Linear => v,
        Tone::Encoded => {
            let root = v.abs() + TOE_ROOT;
            (root * root - TOE).copysign(v)
        }
    }
}

/// Channel `c` of a row of pixels of `stride` samples, toned.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn tone_row(out: &mut [f32], row: &[f32], [stride, c]: [usize; 2], encoded: bool) {
    let tone = if encoded { Tone::Encoded } else { Tone::Linear };
    match stride {
        1 => each_pixel::<1>(out, row, |o, px, _| *o = toned(px[0], tone)),
        3 => each_pixel::<3>(out, row, |o, px, _| *o = toned(px[c.min(2)], tone)),
        4 => each_pixel::<4>(out, row, |o, px, _| *o = toned(px[c.min(3)], tone)),
        _ => out.iter_mut().zip(row.chunks_exact(stride)).for_each(|(o, px)| *o = toned(px[c], tone)),
    }
}

/// Pixels of a key that are passed over together where none of them is covered.
const RUN: usize = 64;

/// Channel `c` of a row under a premultiplied key, as if no pixel were covered in part; `behind` is the colour behind.
fn key_row(out: &mut [f32], row: &[f32], [stride, c]: [usize; 2], matte: &[f32], behind: f32, tone: Tone) {
    let free = toned(0.0, tone) + behind;
    for ((out, row), matte) in out.chunks_mut(RUN).zip(row.chunks(RUN * stride)).zip(matte.chunks(RUN)) {
        if matte.iter().fold(false, |any, m| any | (*m > 0.0)) {
            key_run(out, row, [stride, c], matte, behind, tone == Tone::Encoded);
        } else {
            out.fill(free);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn key_run(out: &mut [f32], row: &[f32], [stride, c]: [usize; 2], matte: &[f32], behind: f32, encoded: bool) {
    let tone = if encoded { Tone::Encoded } else { Tone::Linear };
    let keyed = |v: f32, m: f32| toned(unit(m) * v, tone) + (1.0 - unit(m)) * behind;
    match stride {
        3 => each_pixel::<3>(out, row, |o, px, i| *o = keyed(px[c.min(2)], matte[i])),
        4 => each_pixel::<4>(out, row, |o, px, i| *o = keyed(px[c.min(3)], matte[i])),
        _ => out.iter_mut().zip(row.chunks_exact(stride)).zip(matte).for_each(|((o, px), &m)| *o = keyed(px[c], m)),
    }
}

/// The channels `channels` of `picture` inside `window` (already aligned), toned, keyed where a key is given; beyond the picture its edge is repeated. O(pixels).
pub(super) fn crop(picture: Raster, channels: &[usize], window: Window, tone: Tone, key: Option<&Key>) -> Planes {
    let (pw, ph, stride) = (picture.width, picture.height, picture.channels);
    let (width, height) = ((window.x1 - window.x0) as usize, (window.y1 - window.y0) as usize);
    // `aligned` gives 0 <= x0 < width, so at least one column comes from the picture.
    let x0 = (window.x0.max(0) as usize).min(pw.saturating_sub(1));
    let n = width.min(pw - x0);
    let planes = channels.len() + usize::from(key.is_some());
    let mut data: Vec<Vec<f32>> = (0..planes).map(|_| vec![0.0; width * height]).collect();
    let mut own = Vec::new();
    for j in 0..height {
        let y = (window.y0.max(0) as usize + j).min(ph.saturating_sub(1));
        let row = &picture.row(y)[x0 * stride..(x0 + n) * stride];
        let at = j * width..j * width + n;
        for (plane, &c) in data.iter_mut().zip(channels) {
            let out = &mut plane[at.clone()];
            match key {
                Some(key) if key.premultiplied => key_row(out, row, [stride, c], key.row(y, x0, pw, n), key.behind(c), tone),
                _ => tone_row(out, row, [stride, c], tone == Tone::Encoded),
            }
        }
        if let Some(key) = key {
            let matte = key.row(y, x0, pw, n);
            let partly = |m: f32| (m > 0.0) & (m < 1.0);
            let runs =
                matte.chunks(RUN).enumerate().filter(|(_, run)| key.premultiplied && run.iter().fold(false, |any, m| any | partly(*m)));
            let rim = runs.flat_map(|(at, run)| (at * RUN..).zip(run)).filter(|(_, m)| partly(**m));
            for (i, m) in rim {
                covered(&picture, key.matte, channels, [x0 + i, y], &mut own);
                for ((plane, &c), v) in data.iter_mut().zip(channels).zip(&own) {
                    plane[at.start + i] = toned(*v, tone) + (1.0 - m) * key.behind(c);
                }
            }
            for (plane, &c) in data.iter_mut().zip(channels).filter(|_| !key.premultiplied) {
                let behind = key.behind(c);
                plane[at.clone()].iter_mut().zip(matte).for_each(|(o, &m)| *o = behind + unit(m) * (*o - behind));
            }
            data[channels.len()][at.clone()].iter_mut().zip(matte).for_each(|(o, &m)| *o = key.amplitude * unit(m));
        }
        for plane in &mut data {
            let edge = plane[at.end - 1];
            plane[at.end..(j + 1) * width].fill(edge);
        }
    }
    Planes { width, height, origin: [window.x0 as f64, window.y0 as f64], step: 1.0, data }
}

/// What the layer itself has of a pixel that it covers in part, by channel: the pixel less its share of the ground, which is taken from the free pixels around it.
///
/// Where none is free, as in the inside of a soft matte, the pixel is taken to be all the layer's.
fn covered(picture: &Raster, matte: &[f32], channels: &[usize], [x, y]: [usize; 2], own: &mut Vec<f32>) {
    own.clear();
    own.resize(channels.len(), 0.0);
    let mut n = 0.0f32;
    for v in y.saturating_sub(2)..(y + 3).min(picture.height) {
        let row = v * picture.width + x.saturating_sub(2)..v * picture.width + (x + 3).min(picture.width);
        let pixels = picture.data[row.start * picture.channels..].chunks_exact(picture.channels);
        for (_, px) in matte[row].iter().zip(pixels).filter(|(m, _)| unit(**m) < FREE) {
            own.iter_mut().zip(channels).for_each(|(sum, &c)| *sum += px[c]);
            n += 1.0;
        }
    }
    let (m, px) = (matte[y * picture.width + x], &picture.data[(y * picture.width + x) * picture.channels..]);
    for (own, &c) in own.iter_mut().zip(channels) {
        *own = if n > 0.0 { (px[c] - (1.0 - m) * *own / n).max(0.0) } else { m * px[c] };
    }
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

/// Most taps of half a kernel: see [`gaussian_taps`].
const MOST_TAPS: usize = 25;

/// `out` = the middle samples times the first tap, plus those before and after times the others; a `sign` of -1 takes those before away.
fn filter_lines(out: &mut [f32], mid: &[f32], pairs: &[(&[f32], &[f32])], taps: &[f32], sign: f32) {
    let Some((three, rest)) = pairs.split_first_chunk::<3>() else {
        add_pairs(out, Some((mid, taps[0])), [], [], sign);
        pairs.iter().zip(&taps[1..]).for_each(|(pair, tap)| add_pairs(out, None, [*pair], [*tap], sign));
        return;
    };
    add_pairs(out, Some((mid, taps[0])), *three, [taps[1], taps[2], taps[3]], sign);
    rest.iter().zip(&taps[4..]).for_each(|(pair, tap)| add_pairs(out, None, [*pair], [*tap], sign));
}

/// Symmetric (`sign` = 1) or antisymmetric (`sign` = -1) vertical filter of one row; edges repeat.
fn filter_column(out: &mut [f32], plane: &[f32], w: usize, h: usize, at: (usize, usize), taps: &[f32], sign: f32) {
    let (x0, y) = at;
    let n = out.len();
    let row = |y: usize| &plane[y * w + x0..y * w + x0 + n];
    let mut pairs: [(&[f32], &[f32]); MOST_TAPS] = [(&[], &[]); MOST_TAPS];
    let rest = taps.len() - 1;
    pairs[..rest].iter_mut().enumerate().for_each(|(i, p)| *p = (row(y.saturating_sub(i + 1)), row((y + i + 1).min(h - 1))));
    filter_lines(out, row(y), &pairs[..rest], taps, sign);
}

/// Horizontal filter of a row that has `taps.len() - 1` samples of apron on either side.
fn filter_row(out: &mut [f32], line: &[f32], taps: &[f32], sign: f32) {
    let (n, r) = (out.len(), taps.len() - 1);
    let mut pairs: [(&[f32], &[f32]); MOST_TAPS] = [(&[], &[]); MOST_TAPS];
    pairs[..r].iter_mut().enumerate().for_each(|(i, p)| *p = (&line[r - i - 1..][..n], &line[r + i + 1..][..n]));
    filter_lines(out, &line[r..], &pairs[..r], taps, sign);
}

/// Adds pairs of samples times their taps to `mid` times its own, or to what is there.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn add_pairs<const N: usize>(out: &mut [f32], mid: Option<(&[f32], f32)>, pairs: [(&[f32], &[f32]); N], taps: [f32; N], sign: f32) {
    let n = out.len();
    let pairs = pairs.map(|(lo, hi)| (&lo[..n], &hi[..n]));
    let mut x = 0;
    // Whole chunks stay in registers.
    while x + LANES <= n {
        let mut sum = [0.0f32; LANES];
        match mid {
            Some((mid, tap)) => {
                let mid = &mid[x..x + LANES];
                (0..LANES).for_each(|k| sum[k] = tap * mid[k]);
            }
            None => sum.copy_from_slice(&out[x..x + LANES]),
        }
        for ((lo, hi), tap) in pairs.iter().zip(taps) {
            let (lo, hi) = (&lo[x..x + LANES], &hi[x..x + LANES]);
            (0..LANES).for_each(|k| sum[k] += tap * (hi[k] + sign * lo[k]));
        }
        out[x..x + LANES].copy_from_slice(&sum);
        x += LANES;
    }
    for i in x..n {
        let start = mid.map_or(out[i], |(mid, tap)| tap * mid[i]);
        out[i] = pairs.iter().zip(taps).fold(start, |sum, ((lo, hi), tap)| sum + tap * (hi[i] + sign * lo[i]));
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
