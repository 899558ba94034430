//! The warp where the map shrinks: each target pixel is a weighted mean over the source pixels that it covers.

use super::raster::{Affine, Raster};
use super::warp_affine::{Filter, Outside, Source, WarpOptions};
use super::warp_slant::Slant;
use super::window::Window;
use nalgebra::Matrix2;
use std::sync::OnceLock;

/// Footprints with more taps than this are normalised by the filter's integral, which then equals the sum of its samples to 1e-9.
const COUNTED_TAPS: f64 = 65536.0;
/// Off-diagonal part of a footprint below which it is taken as separable.
const SEPARABLE: f64 = 1e-9;

/// Warps through a widened footprint; `shape` takes offsets in source pixels to filter coordinates.
pub(super) fn warp(source: Source<'_>, m: &Affine, shape: &Matrix2<f64>, options: WarpOptions, target: &mut [f32], window: Window) {
    let channels = source.raster.channels;
    let area = Area { raster: source.raster, filter: options.filter, outside: options.outside, shape: *shape };
    let separable = shape[(0, 1)].abs() < SEPARABLE;
    let tables = if separable && channels == 4 { area.tables() } else { None };
    if tables.is_none()
        && let Some(slant) = Slant::new(source.raster, options.filter, options.outside, shape)
    {
        return slant.warp(source, m, target, window);
    }
    let mut taps = [Taps::default(), Taps::default()];
    let origin = [source.origin[0] as f64 + 0.5, source.origin[1] as f64 + 0.5];
    for (j, out) in target.chunks_exact_mut(window.width * channels).enumerate() {
        let y = window.y.saturating_add(j as i64) as f64 + 0.5;
        let line = [0, 1].map(|r| (m[(r, 0)], m[(r, 1)] * y + (m[(r, 2)] - origin[r])));
        if let Some(tables) = &tables {
            tabled_row(&area, tables, line, window.x, &mut taps, out);
            continue;
        }
        for (i, pixel) in out.chunks_exact_mut(channels).enumerate() {
            let position = position(line, window.x, i);
            if separable {
                area.separable_pixel(position, &mut taps, pixel);
            } else {
                area.slanted_pixel(position, pixel);
            }
        }
    }
}

/// The source position of column `i` of a target row, as sample coordinates.
#[inline(always)]
fn position(line: [(f64, f64); 2], window_x: i64, i: usize) -> [f64; 2] {
    let x = window_x.saturating_add(i as i64) as f64 + 0.5;
    line.map(|(step, start)| step * x + start)
}

/// Phases of a table of weights.
const PHASES: usize = 2048;
/// Widest footprint that has a table; wider ones have few target pixels.
const TABLED_TAPS: usize = 64;

/// The weights of a footprint for every fraction of a position.
struct Table {
    /// A multiple of four, half of them up to the position.
    taps: usize,
    /// `PHASES` + 1 rows of `taps`, each of which sums to one.
    weights: Vec<f32>,
}

impl Table {
    fn new(filter: Filter, scale: f64) -> Option<Self> {
        let half = libm::ceil(filter.radius() / scale / 2.0) as usize * 2;
        let taps = 2 * half;
        if taps > TABLED_TAPS {
            return None;
        }
        let mut weights = Vec::with_capacity((PHASES + 1) * taps);
        for phase in 0..=PHASES {
            let t = phase as f64 / PHASES as f64 + half as f64 - 1.0;
            let raw: [f32; TABLED_TAPS] =
                std::array::from_fn(|k| if k < taps { kernel(filter, ((k as f64 - t) * scale) as f32) } else { 0.0 });
            let sum: f64 = raw.iter().map(|&w| f64::from(w)).sum();
            weights.extend(raw[..taps].iter().map(|&w| (f64::from(w) / sum) as f32));
        }
        Some(Self { taps, weights })
    }

    /// The first sample of the footprint at `centre`, where all of it is inside 0..`side`.
    #[inline(always)]
    fn first(&self, centre: f64, side: usize) -> Option<usize> {
        let half = self.taps / 2;
        let inside = centre >= half as f64 - 1.0 && centre < side as f64 - half as f64;
        inside.then(|| (centre as usize + 1).wrapping_sub(half))
    }

    /// Whether the footprint at `centre` is wholly outside 0..`side`.
    #[inline(always)]
    fn misses(&self, centre: f64, side: usize) -> bool {
        let half = (self.taps / 2) as f64;
        centre <= -half || centre >= side as f64 - 1.0 + half
    }

    /// Writes the weights at `centre`, interpolated between two phases.
    #[inline(always)]
    fn lookup(&self, centre: f64, weights: &mut [f32]) {
        let at = ((centre - (centre as u32) as f64) * PHASES as f64) as f32;
        let phase = (at as usize).min(PHASES - 1);
        let f = at - phase as f32;
        let (a, b) = self.weights[phase * self.taps..(phase + 2) * self.taps].split_at(self.taps);
        for ((w, a), b) in weights.iter_mut().zip(a).zip(b) {
            *w = a + (b - a) * f;
        }
    }
}

/// One row of four channels through tables; pixels at the edges the slow way.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn tabled_row(area: &Area<'_>, tables: &[Table; 2], line: [(f64, f64); 2], window_x: i64, taps: &mut [Taps; 2], out: &mut [f32]) {
    let [across, down] = tables;
    let raster = area.raster;
    let (mut wx, mut wy) = ([0.0_f32; TABLED_TAPS], [0.0_f32; TABLED_TAPS]);
    for (i, pixel) in out.chunks_exact_mut(4).enumerate() {
        let at = position(line, window_x, i);
        let (Some(x), Some(y)) = (across.first(at[0], raster.width), down.first(at[1], raster.height)) else {
            if area.outside == Outside::Transparent && (across.misses(at[0], raster.width) || down.misses(at[1], raster.height)) {
                pixel.fill(0.0);
            } else {
                area.separable_pixel(at, taps, pixel);
            }
            continue;
        };
        across.lookup(at[0], &mut wx[..across.taps]);
        down.lookup(at[1], &mut wy[..down.taps]);
        let stride = raster.width * 4;
        let start = y * stride + x * 4;
        let mut total = [0.0_f32; 16];
        for (j, &weight) in wy[..down.taps].iter().enumerate() {
            let row = &raster.data[start + j * stride..][..across.taps * 4];
            for (four, w) in row.chunks_exact(16).zip(wx.chunks_exact(4)) {
                for k in 0..16 {
                    total[k] += four[k] * (w[k / 4] * weight);
                }
            }
        }
        for c in 0..4 {
            pixel[c] = (total[c] + total[4 + c]) + (total[8 + c] + total[12 + c]);
        }
    }
}

/// What every pixel needs.
struct Area<'a> {
    raster: Raster<'a>,
    filter: Filter,
    outside: Outside,
    shape: Matrix2<f64>,
}

/// Weights of consecutive samples along one axis.
#[derive(Default)]
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl Taps {
    /// The weights of the samples 0..`side` around `centre`, where one sample is `scale` of the filter's unit.
    /// What falls outside counts as zero, or to the outermost sample.
    fn fill(&mut self, filter: Filter, outside: Outside, centre: f64, scale: f64, side: usize) {
        self.weights.clear();
        let last = side as f64 - 1.0;
        let reach = filter.radius() / scale;
        let centre = if outside == Outside::Clamp { centre.clamp(-reach - 1.0, last + reach + 1.0) } else { centre };
        let (low, high) = (libm::ceil(centre - reach), libm::floor(centre + reach));
        if outside == Outside::Transparent && (high < 0.0 || low > last) {
            return;
        }
        let counted = high - low < COUNTED_TAPS;
        let (low, high) = if counted { (low, high) } else { (low.max(0.0), high.min(last)) };
        self.first = low.clamp(0.0, last) as usize;
        let end = high.clamp(0.0, last) as usize + 1;
        self.weights.resize(end - self.first, 0.0);
        let mut sum = 0.0;
        let mut at = low;
        while at <= high {
            let weight = kernel(filter, ((at - centre) * scale) as f32);
            sum += f64::from(weight);
            let inside = at.clamp(0.0, last);
            if inside == at || outside == Outside::Clamp {
                self.weights[inside as usize - self.first] += weight;
            }
            at += 1.0;
        }
        let total = if counted || outside == Outside::Clamp { sum } else { 1.0 / scale };
        let gain = if total > 0.0 { (1.0 / total) as f32 } else { 0.0 };
        self.weights.iter_mut().for_each(|w| *w *= gain);
    }
}

impl Area<'_> {
    /// Tables for both axes, where the footprint is narrow enough.
    fn tables(&self) -> Option<[Table; 2]> {
        Some([Table::new(self.filter, self.shape[(0, 0)])?, Table::new(self.filter, self.shape[(1, 1)])?])
    }

    /// A pixel whose footprint has its sides along the source's rows and columns.
    fn separable_pixel(&self, position: [f64; 2], [across, down]: &mut [Taps; 2], out: &mut [f32]) {
        across.fill(self.filter, self.outside, position[0], self.shape[(0, 0)], self.raster.width);
        if across.weights.is_empty() {
            return out.fill(0.0);
        }
        down.fill(self.filter, self.outside, position[1], self.shape[(1, 1)], self.raster.height);
        separable_sum(self.raster, across, down, out);
    }

    /// A pixel whose footprint is a parallelogram: its rows are cut to the columns that the parallelogram covers.
    fn slanted_pixel(&self, position: [f64; 2], out: &mut [f32]) {
        let (w, h) = (self.raster.width as f64 - 1.0, self.raster.height as f64 - 1.0);
        let s = &self.shape;
        let radius = self.filter.radius();
        let det = s.determinant();
        let reach_y = radius * (s[(0, 0)].abs() + s[(1, 0)].abs()) / det;
        let reach_x = radius * (s[(1, 1)].abs() + s[(0, 1)].abs()) / det;
        let centre = match self.outside {
            Outside::Transparent => position,
            Outside::Clamp => [position[0].clamp(-reach_x - 1.0, w + reach_x + 1.0), position[1].clamp(-reach_y - 1.0, h + reach_y + 1.0)],
        };
        out.fill(0.0);
        let (top, bottom) = (libm::ceil(centre[1] - reach_y), libm::floor(centre[1] + reach_y));
        let counted = 4.0 * radius * radius / det < COUNTED_TAPS || self.outside == Outside::Clamp;
        let (top, bottom) = if counted { (top, bottom) } else { (top.max(0.0), bottom.min(h)) };
        if self.outside == Outside::Transparent && (bottom < 0.0 || top > h || centre[0] + reach_x < 0.0 || centre[0] - reach_x > w) {
            return;
        }
        let mut sums = vec![0.0_f64; out.len()];
        let mut total = 0.0;
        let mut y = top;
        while y <= bottom {
            total += self.slanted_row(centre, y, counted, &mut sums);
            y += 1.0;
        }
        let total = if counted { total } else { 1.0 / det };
        if total > 0.0 {
            for (value, sum) in out.iter_mut().zip(&sums) {
                *value = (sum / total) as f32;
            }
        }
    }

    /// Adds one row of a parallelogram to `sums`, and returns its weight.
    fn slanted_row(&self, centre: [f64; 2], y: f64, counted: bool, sums: &mut [f64]) -> f64 {
        let (last_x, last_y) = (self.raster.width as f64 - 1.0, self.raster.height as f64 - 1.0);
        let channels = self.raster.channels;
        let dy = y - centre[1];
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for r in 0..2 {
            // |a dx + b| < radius.
            let (a, b) = (self.shape[(r, 0)], self.shape[(r, 1)] * dy);
            let (p, q) = ((-self.filter.radius() - b) / a, (self.filter.radius() - b) / a);
            if a != 0.0 {
                low = low.max(p.min(q));
                high = high.min(p.max(q));
            } else if b.abs() >= self.filter.radius() {
                return 0.0;
            }
        }
        let (low, high) = (libm::ceil(centre[0] + low), libm::floor(centre[0] + high));
        let (low, high) = if counted { (low, high) } else { (low.max(0.0), high.min(last_x)) };
        let row = y.clamp(0.0, last_y);
        let row_counts = row == y || self.outside == Outside::Clamp;
        let data = self.raster.row(row as usize);
        let mut total = 0.0;
        let mut x = low;
        while x <= high {
            let dx = x - centre[0];
            let weight = kernel(self.filter, (self.shape[(0, 0)] * dx + self.shape[(0, 1)] * dy) as f32)
                * kernel(self.filter, (self.shape[(1, 0)] * dx + self.shape[(1, 1)] * dy) as f32);
            total += f64::from(weight);
            let column = x.clamp(0.0, last_x);
            if row_counts && (column == x || self.outside == Outside::Clamp) {
                let pixel = &data[column as usize * channels..][..channels];
                for (sum, v) in sums.iter_mut().zip(pixel) {
                    *sum += f64::from(v * weight);
                }
            }
            x += 1.0;
        }
        total
    }
}

/// The sum of `down` × `across` over the picture.
fn separable_sum(raster: Raster<'_>, across: &Taps, down: &Taps, out: &mut [f32]) {
    if raster.channels == 4 {
        let out4: &mut [f32] = out;
        return separable_sum4(raster, across, down, out4);
    }
    out.fill(0.0);
    let channels = raster.channels;
    for (j, wy) in down.weights.iter().enumerate() {
        let row = &raster.row(down.first + j)[across.first * channels..];
        for (c, value) in out.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (pixel, wx) in row.chunks_exact(channels).zip(&across.weights) {
                sum += pixel[c] * wx;
            }
            *value += sum * wy;
        }
    }
}

/// [`separable_sum`] of four channels, in four running sums.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn separable_sum4(raster: Raster<'_>, across: &Taps, down: &Taps, out: &mut [f32]) {
    let n = across.weights.len();
    let mut total = [0.0_f32; 4];
    for (j, wy) in down.weights.iter().enumerate() {
        let row = &raster.row(down.first + j)[across.first * 4..][..n * 4];
        let mut sums = [0.0_f32; 16];
        let mut pixels = row.chunks_exact(16);
        let mut weights = across.weights.chunks_exact(4);
        for (four, w) in (&mut pixels).zip(&mut weights) {
            for k in 0..16 {
                sums[k] += four[k] * w[k / 4];
            }
        }
        for (k, (pixel, w)) in pixels.remainder().chunks_exact(4).zip(weights.remainder()).enumerate() {
            for c in 0..4 {
                sums[(k % 4) * 4 + c] += pixel[c] * w;
            }
        }
        for c in 0..4 {
            total[c] += ((sums[c] + sums[4 + c]) + (sums[8 + c] + sums[12 + c])) * wy;
        }
    }
    out.copy_from_slice(&total);
}

/// Samples of the tabulated Lanczos filter per unit.
const PER_UNIT: usize = 4096;

/// The filter at `x`; Lanczos from a table, within 1e-7.
#[inline]
fn kernel(filter: Filter, x: f32) -> f32 {
    let x = x.abs();
    match filter {
        Filter::Nearest => f32::from(u8::from(x <= 0.5)),
        Filter::Bilinear => (1.0 - x).max(0.0),
        Filter::Cubic if x < 1.0 => 1.0 + x * x * (1.5 * x - 2.5),
        Filter::Cubic if x < 2.0 => -0.5 * (2.0 - x) * (2.0 - x) * (x - 1.0),
        Filter::Mitchell if x < 1.0 => 8.0 / 9.0 + x * x * (7.0 / 6.0 * x - 2.0),
        Filter::Mitchell if x < 2.0 => (2.0 - x) * (2.0 - x) * (7.0 * (2.0 - x) - 6.0) / 18.0,
        Filter::Lanczos3 if x < 3.0 => {
            let table = lanczos_table();
            let at = x * PER_UNIT as f32;
            let index = (at as usize).min(3 * PER_UNIT - 1);
            table[index] + (table[index + 1] - table[index]) * (at - index as f32)
        }
        _ => 0.0,
    }
}

/// The Lanczos filter at multiples of 1 / `PER_UNIT`.
fn lanczos_table() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| (0..=3 * PER_UNIT).map(|i| Filter::Lanczos3.at(i as f64 / PER_UNIT as f64) as f32).collect())
}
