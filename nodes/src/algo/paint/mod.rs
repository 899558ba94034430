//! Filled and stroked paths with exact area coverage.
//!
//! Paths are `kurbo::BezPath` in pixels, x to the right, y down, the origin at the top left corner of the first pixel. [`coverage`] gives the
//! area of each pixel that a path fills; [`Canvas`] composites a colour through it; [`ink`] and [`stroke`] turn centre lines into outlines;
//! [`text()`] draws labels with a single-stroke font.

use super::color;

mod fill;
mod font;
mod ink;
mod text;

pub use fill::{FLATTEN_TOLERANCE, FillRule, coverage, fill_rows};
pub use ink::{flatten, ink, ink_widths, polygon, stroke};
pub use kurbo::{BezPath, Cap, Join};
pub use text::{text, text_outline, text_width};

/// What can be wrong with drawing data.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PaintError {
    /// SVG path data that does not parse.
    #[error("expected SVG path data, found {found:?} ({reason}); a path looks like \"M0 0 L10 0 L10 10 Z\"")]
    Svg {
        /// The start of the text that was given.
        found: String,
        /// What the parser said.
        reason: String,
    },
    /// A canvas whose sample count is not four a pixel.
    #[error("expected {expected} samples for a {width}x{height} RGBA canvas, found {found}")]
    Canvas {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Samples that the size asks for.
        expected: usize,
        /// Samples that were given.
        found: usize,
    },
}

/// The path of SVG path data, the `d` attribute: all commands of SVG 1.1, section 8.3, absolute and relative.
///
/// # Errors
/// [`PaintError::Svg`] where the text does not parse or a coordinate is not finite.
pub fn svg_path(data: &str) -> Result<BezPath, PaintError> {
    let error = |reason: String| PaintError::Svg { found: data.chars().take(40).collect(), reason };
    let path = BezPath::from_svg(data).map_err(|e| error(e.to_string()))?;
    if path.is_finite() { Ok(path) } else { Err(error("a coordinate is not finite".into())) }
}

/// A picture that is painted on: `height` rows of `width` RGBA pixels, linear light, premultiplied alpha.
#[derive(Debug)]
pub struct Canvas<'a> {
    data: &'a mut [f32],
    width: usize,
    height: usize,
}

impl<'a> Canvas<'a> {
    /// A canvas on `data`.
    ///
    /// # Errors
    /// [`PaintError::Canvas`] where the length is not `4 * width * height`.
    pub fn new(data: &'a mut [f32], width: usize, height: usize) -> Result<Self, PaintError> {
        let expected = width.saturating_mul(height).saturating_mul(4);
        let found = data.len();
        if found == expected { Ok(Self { data, width, height }) } else { Err(PaintError::Canvas { width, height, expected, found }) }
    }

    /// Fills `path` with one colour (linear, premultiplied), over what is there. Cost: that of [`fill_rows`].
    pub fn fill(&mut self, path: &BezPath, rule: FillRule, colour: [f32; 4]) {
        self.fill_with(path, rule, |_, _| colour);
    }

    /// Fills `path` with the colour that `paint` gives for the pixel at column `x`, row `y` (linear, premultiplied), over what is there.
    pub fn fill_with(&mut self, path: &BezPath, rule: FillRule, mut paint: impl FnMut(usize, usize) -> [f32; 4]) {
        let width = self.width;
        let data = &mut *self.data;
        fill_rows(path, rule, width, self.height, |y, x0, row| {
            let start = (y * width + x0) * 4;
            for (i, (pixel, &cover)) in data[start..].chunks_exact_mut(4).zip(row).enumerate() {
                if cover > 0.0 {
                    let colour = paint(x0 + i, y);
                    let keep = 1.0 - colour[3] * cover;
                    for (below, above) in pixel.iter_mut().zip(colour) {
                        *below = *below * keep + above * cover;
                    }
                }
            }
        });
    }

    /// Draws the centre line `path` with a pen of constant `width` pixels, round caps and joins.
    pub fn line(&mut self, path: &BezPath, width: f64, colour: [f32; 4]) {
        self.fill(&stroke(path, width, Cap::Round, Join::Round), FillRule::NonZero, colour);
    }
}

/// Fills `path` by the non-zero rule with one colour on RGBA samples, linear and premultiplied.
///
/// # Errors
/// [`PaintError::Canvas`] where the length is not `4 * width * height`.
pub fn paint(canvas: &mut [f32], width: usize, height: usize, path: &BezPath, colour: [f32; 4]) -> Result<(), PaintError> {
    Canvas::new(canvas, width, height)?.fill(path, FillRule::NonZero, colour);
    Ok(())
}

/// An opaque linear colour from sRGB bytes written 0xRRGGBB, by the exact curve.
pub fn hex(rgb: u32) -> [f32; 4] {
    let channel = |shift: u32| color::linear_from_srgb(f64::from((rgb >> shift) & 255) / 255.0) as f32;
    [channel(16), channel(8), channel(0), 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paint_refuses_a_canvas_of_the_wrong_length() {
        let error = paint(&mut [0.0; 7], 2, 1, &BezPath::new(), hex(0)).unwrap_err();
        assert_eq!(error.to_string(), "expected 8 samples for a 2x1 RGBA canvas, found 7");
    }

    #[test]
    fn paint_svg_reports_what_it_read() {
        assert!(matches!(svg_path("M0 0 L oops"), Err(PaintError::Svg { found, .. }) if found == "M0 0 L oops"));
        assert!(matches!(svg_path("M0 0 L 1e999 0"), Err(PaintError::Svg { .. })));
        assert_eq!(svg_path("M1 1h2v2h-2z").unwrap().elements().len(), 5);
    }

    #[test]
    fn paint_composites_over_in_linear_light() {
        let mut canvas = [0.5, 0.5, 0.5, 1.0];
        let half = svg_path("M0 0h.5v1h-.5z").unwrap();
        paint(&mut canvas, 1, 1, &half, [1.0, 0.0, 0.0, 1.0]).unwrap();
        assert_eq!(canvas, [0.75, 0.25, 0.25, 1.0]);
    }
}
