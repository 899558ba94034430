//! Merges of premultiplied pictures whose data windows may differ.
//!
//! The formulas are those of Porter and Duff, Compositing digital images, SIGGRAPH 1984, table in section 4.3, and of Nuke's Merge node
//! (Nuke reference guide, Merge operations) for the rest. A, a are a channel and the alpha of the foreground; B, b those of the background.
//! Outside its data window a picture is zero in every channel.

use super::raster::Raster;
use super::warp_affine::Source;
use super::window::Window;

/// How two pictures are merged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, pegbar_engine::Setting)]
pub enum Operation {
    /// A + B (1 − a).
    #[default]
    Over,
    /// A (1 − b) + B.
    Under,
    /// A + B.
    Plus,
    /// A − B.
    Minus,
    /// B − A.
    From,
    /// |A − B|.
    Difference,
    /// A B; 0 where both are negative.
    Multiply,
    /// A + B − A B where both are at most 1, otherwise the larger.
    Screen,
    /// A b.
    In,
    /// A (1 − b).
    Out,
    /// A b + B (1 − a).
    Atop,
    /// A (1 − b) + B (1 − a).
    Xor,
    /// The larger.
    Max,
    /// The smaller.
    Min,
    /// B a.
    Mask,
    /// B (1 − a).
    Stencil,
    /// (A + B) / 2.
    Average,
    /// A + B − 2 A B.
    Exclusion,
    /// √(A² + B²).
    Hypot,
    /// A / B; 0 where B is 0 or both are negative.
    Divide,
    /// A alone.
    Copy,
    /// A + B (1 − a) / b, and A + B where a + b < 1: the two never cover the same part of a pixel.
    DisjointOver,
    /// A + B (1 − a / b), and A where a > b: the smaller one lies wholly within the larger.
    ConjointOver,
    /// A a + B (1 − a): over, for a foreground that is not premultiplied.
    Matte,
}

impl Operation {
    /// Every operation, in the order of declaration.
    pub const ALL: [Self; 24] = [
        Self::Over,
        Self::Under,
        Self::Plus,
        Self::Minus,
        Self::From,
        Self::Difference,
        Self::Multiply,
        Self::Screen,
        Self::In,
        Self::Out,
        Self::Atop,
        Self::Xor,
        Self::Max,
        Self::Min,
        Self::Mask,
        Self::Stencil,
        Self::Average,
        Self::Exclusion,
        Self::Hypot,
        Self::Divide,
        Self::Copy,
        Self::DisjointOver,
        Self::ConjointOver,
        Self::Matte,
    ];

    /// The value of one channel: `fg`, `bg` with alphas `fa`, `ba`.
    #[inline(always)]
    pub fn apply(self, fg: f32, bg: f32, fa: f32, ba: f32) -> f32 {
        match self {
            Self::Over => fg + bg * (1.0 - fa),
            Self::Under => fg * (1.0 - ba) + bg,
            Self::Plus => fg + bg,
            Self::Minus => fg - bg,
            Self::From => bg - fg,
            Self::Difference => (fg - bg).abs(),
            Self::Multiply if fg < 0.0 && bg < 0.0 => 0.0,
            Self::Multiply => fg * bg,
            Self::Screen if fg <= 1.0 && bg <= 1.0 => fg + bg - fg * bg,
            Self::Screen | Self::Max => {
                if fg > bg {
                    fg
                } else {
                    bg
                }
            }
            Self::In => fg * ba,
            Self::Out => fg * (1.0 - ba),
            Self::Atop => fg * ba + bg * (1.0 - fa),
            Self::Xor => fg * (1.0 - ba) + bg * (1.0 - fa),
            Self::Min => {
                if fg < bg {
                    fg
                } else {
                    bg
                }
            }
            Self::Mask => bg * fa,
            Self::Stencil => bg * (1.0 - fa),
            Self::Average => (fg + bg) * 0.5,
            Self::Exclusion => fg + bg - 2.0 * fg * bg,
            Self::Hypot => (fg * fg + bg * bg).sqrt(),
            Self::Divide if bg == 0.0 || (fg < 0.0 && bg < 0.0) => 0.0,
            Self::Divide => fg / bg,
            Self::Copy => fg,
            Self::DisjointOver if fa + ba < 1.0 || ba == 0.0 => fg + bg,
            Self::DisjointOver => fg + bg * ((1.0 - fa) / ba),
            Self::ConjointOver if fa > ba || ba == 0.0 => fg,
            Self::ConjointOver => fg + bg * (1.0 - fa / ba),
            Self::Matte => fg * fa + bg * (1.0 - fa),
        }
    }

    /// The window outside of which the result is zero: both pictures' in general, their common part where one cuts the other.
    pub fn bounds(self, foreground: Window, background: Window, opacity: f32) -> Window {
        let full = match self {
            Self::In | Self::Mask | Self::Multiply => foreground.intersect(&background),
            Self::Out | Self::Copy | Self::Divide => foreground,
            Self::Atop | Self::Stencil => background,
            _ => foreground.union(&background),
        };
        if opacity == 1.0 { full } else { full.union(&background) }
    }

    /// Whether a background stays as it is where there is no foreground.
    fn keeps_background(self) -> bool {
        use Operation::*;
        matches!(self, Over | Under | Plus | From | Atop | Xor | Stencil | DisjointOver | Matte | Exclusion)
    }
}

/// Why two pictures could not be merged.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// The pictures have different channels.
    #[error("expected a foreground of {expected} channels as the background has, found {found}")]
    Channels {
        /// Channels of the background.
        expected: usize,
        /// Channels of the foreground.
        found: usize,
    },
    /// The alpha channel does not exist.
    #[error("expected an alpha channel below {channels}, found {found}")]
    Alpha {
        /// Channels of the pictures.
        channels: usize,
        /// Channel asked for.
        found: usize,
    },
    /// The slice does not fit the window.
    #[error("expected {expected} samples for the window, found {found}")]
    Length {
        /// Samples that the window has.
        expected: usize,
        /// Samples given.
        found: usize,
    },
    /// The opacity is not a fraction.
    #[error("expected an opacity from 0 to 1, found {found}")]
    Opacity {
        /// Opacity given.
        found: f32,
    },
}

/// How to merge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MergeOptions {
    /// The formula.
    pub operation: Operation,
    /// Weight of the result against the untouched background, 0 to 1. For `Over` it is the foreground's opacity.
    pub opacity: f32,
    /// Which channel is alpha; `None` takes both pictures as opaque inside their windows.
    pub alpha: Option<usize>,
}

impl MergeOptions {
    /// `operation` at full strength, with the last of four channels as alpha.
    pub fn new(operation: Operation) -> Self {
        Self { operation, opacity: 1.0, alpha: Some(3) }
    }
}

/// Merges `foreground` with `background` into `target`, which holds `window`.
///
/// Errors: channels that differ, an alpha that does not exist, a target of the wrong length, an opacity outside 0 to 1.
/// Cost: O(target samples), one pass over memory.
pub fn merge(
    foreground: Source<'_>,
    background: Source<'_>,
    options: MergeOptions,
    target: &mut [f32],
    window: Window,
) -> Result<(), MergeError> {
    let channels = background.raster.channels;
    check(foreground, channels, options, target.len(), window)?;
    for (j, row) in target.chunks_exact_mut((window.width * channels).max(1)).enumerate() {
        let y = window.y.saturating_add(j as i64);
        let covered = place(background, y, window, row);
        merge_row(foreground, options, y, window, covered, row);
    }
    Ok(())
}

/// Merges `foreground` into `background`, which holds `window` and keeps it: what the foreground has outside is cut off.
///
/// Errors and cost as [`merge`].
pub fn merge_in_place(
    foreground: Source<'_>,
    background: &mut [f32],
    channels: usize,
    window: Window,
    options: MergeOptions,
) -> Result<(), MergeError> {
    check(foreground, channels, options, background.len(), window)?;
    for (j, row) in background.chunks_exact_mut((window.width * channels).max(1)).enumerate() {
        merge_row(foreground, options, window.y.saturating_add(j as i64), window, (0, window.width), row);
    }
    Ok(())
}

/// Merges `foreground`, which holds `window`, with `background` into itself: what the background has outside is cut off.
///
/// Errors and cost as [`merge`].
pub fn merge_into_foreground(
    foreground: &mut [f32],
    background: Source<'_>,
    options: MergeOptions,
    window: Window,
) -> Result<(), MergeError> {
    let channels = background.raster.channels;
    let whole = Raster { data: foreground, width: window.width, height: window.height, channels };
    check(Source::new(whole, [window.x, window.y]), channels, options, foreground.len(), window)?;
    let len = (window.width * channels).max(1);
    let mut merged = vec![0.0; window.width * channels];
    for (j, row) in foreground.chunks_exact_mut(len).enumerate() {
        let y = window.y.saturating_add(j as i64);
        let raster = Raster { data: row, width: window.width, height: 1, channels };
        let own = Source::new(raster, [window.x, y]);
        let covered = place(background, y, window, &mut merged);
        merge_row(own, options, y, window, covered, &mut merged);
        row.copy_from_slice(&merged);
    }
    Ok(())
}

/// Refuses what cannot be merged.
fn check(foreground: Source<'_>, channels: usize, options: MergeOptions, len: usize, window: Window) -> Result<(), MergeError> {
    if foreground.raster.channels != channels {
        return Err(MergeError::Channels { expected: channels, found: foreground.raster.channels });
    }
    if let Some(found) = options.alpha.filter(|&a| a >= channels) {
        return Err(MergeError::Alpha { channels, found });
    }
    let expected = window.samples(channels).unwrap_or(usize::MAX);
    if len != expected {
        return Err(MergeError::Length { expected, found: len });
    }
    if !(0.0..=1.0).contains(&options.opacity) {
        return Err(MergeError::Opacity { found: options.opacity });
    }
    Ok(())
}

/// The columns of `window` that `source` has in row `y`, from 0; empty where it has none.
fn columns(source: Source<'_>, y: i64, window: Window) -> (usize, usize) {
    let common = Window::new(window.x, y, window.width, 1).intersect(&source.window());
    if common.is_empty() {
        return (0, 0);
    }
    let first = (common.x - window.x) as usize;
    (first, first + common.width)
}

/// The samples of row `y` of `source` in the columns `first..last` of `window`.
fn samples<'a>(source: Source<'a>, y: i64, window: Window, (first, last): (usize, usize)) -> &'a [f32] {
    if last <= first {
        return &[];
    }
    let channels = source.raster.channels;
    let from = (window.x + first as i64 - source.origin[0]) as usize;
    &source.raster.row((y - source.origin[1]) as usize)[from * channels..(from + last - first) * channels]
}

/// Copies row `y` of the background into the target's row, zero elsewhere; gives the columns that it covers.
fn place(background: Source<'_>, y: i64, window: Window, row: &mut [f32]) -> (usize, usize) {
    let channels = background.raster.channels;
    let covered = columns(background, y, window);
    row[..covered.0 * channels].fill(0.0);
    row[covered.0 * channels..covered.1 * channels].copy_from_slice(samples(background, y, window, covered));
    row[covered.1 * channels..].fill(0.0);
    covered
}

/// Merges one row of the foreground into `row`, of which the background covers the columns `covered`.
fn merge_row(foreground: Source<'_>, options: MergeOptions, y: i64, window: Window, covered: (usize, usize), row: &mut [f32]) {
    let channels = foreground.raster.channels;
    let own = columns(foreground, y, window);
    let data = samples(foreground, y, window, own);
    // The row is cut where either picture begins or ends, so that each part has one of the four cases.
    let mut cuts = [0, own.0, own.1, covered.0, covered.1, window.width];
    cuts.sort_unstable();
    for pair in cuts.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        if to <= from {
            continue;
        }
        let within = |span: (usize, usize)| span.0 <= from && to <= span.1;
        let (has_fg, has_bg) = (within(own), within(covered));
        let part = &mut row[from * channels..to * channels];
        // A picture without alpha is opaque where it is at all.
        let opaque = |has: bool| if has { 1.0 } else { 0.0 };
        if has_fg {
            let fg = &data[(from - own.0) * channels..(to - own.0) * channels];
            merge_samples(options, channels, opaque(has_bg), fg, part);
        } else if has_bg && !options.operation.keeps_background() {
            merge_alone(options, channels, part);
        }
    }
}

/// A background where there is no foreground.
fn merge_alone(options: MergeOptions, channels: usize, part: &mut [f32]) {
    for pixel in part.chunks_exact_mut(channels) {
        let ba = options.alpha.map_or(1.0, |a| pixel[a]);
        for b in pixel {
            *b = mixed(options.operation.apply(0.0, *b, 0.0, ba), *b, options.opacity);
        }
    }
}

#[inline(always)]
fn mixed(value: f32, background: f32, opacity: f32) -> f32 {
    if opacity == 1.0 { value } else { background + opacity * (value - background) }
}

/// Merges samples of both pictures; the match is outside the loop so that each operation has a loop of its own.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn merge_samples(options: MergeOptions, channels: usize, opaque_bg: f32, fg: &[f32], bg: &mut [f32]) {
    macro_rules! each {
        ($($name:ident)*) => {
            match options.operation {
                $(Operation::$name => merge_pixels(Operation::$name, options, channels, opaque_bg, fg, bg),)*
            }
        };
    }
    each!(Over Under Plus Minus From Difference Multiply Screen In Out Atop Xor Max Min Mask Stencil Average Exclusion Hypot Divide Copy
        DisjointOver ConjointOver Matte);
}

#[inline(always)]
fn merge_pixels(operation: Operation, options: MergeOptions, channels: usize, opaque_bg: f32, fg: &[f32], bg: &mut [f32]) {
    let opacity = options.opacity;
    if channels == 4 && options.alpha == Some(3) {
        for (f, b) in fg.chunks_exact(4).zip(bg.chunks_exact_mut(4)) {
            let (fa, ba) = (f[3], b[3]);
            for c in 0..4 {
                b[c] = mixed(operation.apply(f[c], b[c], fa, ba), b[c], opacity);
            }
        }
        return;
    }
    for (f, b) in fg.chunks_exact(channels).zip(bg.chunks_exact_mut(channels)) {
        let (fa, ba) = options.alpha.map_or((1.0, opaque_bg), |a| (f[a], b[a]));
        for c in 0..channels {
            b[c] = mixed(operation.apply(f[c], b[c], fa, ba), b[c], opacity);
        }
    }
}

/// `foreground` over `background`, both premultiplied with alpha last and in the same window, into `background`: B ← A + B (1 − a).
///
/// Samples beyond the shorter slice are left alone. Cost: one pass.
pub fn over_in_place(foreground: &[f32], background: &mut [f32], channels: usize) {
    let options = MergeOptions { operation: Operation::Over, opacity: 1.0, alpha: channels.checked_sub(1) };
    if channels > 0 {
        merge_samples(options, channels, 1.0, foreground, background);
    }
}

#[cfg(test)]
#[path = "merge_tests.rs"]
mod tests;
