//! Labels for plots: a single-stroke font, as an engraver's plotter draws it.

use super::font::{ADVANCE_UNKNOWN, CAP_HEIGHT, GLYPHS, UNKNOWN};
use super::stroke;
use kurbo::{Affine, BezPath, Cap, Join};

/// Space after each letter, in font units.
const GAP: f64 = 2.6;

fn glyph(c: char) -> (f64, &'static str) {
    // The typographic minus and dashes are drawn as the hyphen's longer sister.
    let c = match c {
        '−' | '–' | '—' => '−',
        '’' | '‘' => '\'',
        '“' | '”' => '"',
        other => other,
    };
    match GLYPHS.binary_search_by_key(&c, |g| g.0) {
        Ok(i) => (GLYPHS[i].1, GLYPHS[i].2),
        Err(_) => (ADVANCE_UNKNOWN, UNKNOWN),
    }
}

/// The centre lines of `string` for capitals `size` pixels tall, the baseline's start at the origin, y down; a line feed starts a new line,
/// 1.9 `size` below. Characters that the font lacks are drawn as a small box. Draw it with a pen of about `size / 8`. Cost: O(length).
pub fn text(string: &str, size: f64) -> BezPath {
    let mut out = BezPath::new();
    let scale = size / CAP_HEIGHT;
    let (mut x, mut y) = (0.0, 0.0);
    for c in string.chars() {
        if c == '\n' {
            (x, y) = (0.0, y + 1.9 * CAP_HEIGHT);
            continue;
        }
        let (advance, data) = glyph(c);
        if let Ok(path) = BezPath::from_svg(data) {
            out.extend(Affine::new([scale, 0.0, 0.0, scale, x * scale, y * scale]) * path);
        }
        x += advance + GAP;
    }
    out
}

/// The width of `string`'s longest line in pixels, for capitals `size` pixels tall.
pub fn text_width(string: &str, size: f64) -> f64 {
    let line = |l: &str| l.chars().map(|c| glyph(c).0 + GAP).sum::<f64>() - GAP;
    string.split('\n').map(line).fold(0.0, f64::max) * size / CAP_HEIGHT
}

/// [`text`] as outlines to fill by the non-zero rule: strokes `weight` pixels wide with round ends.
pub fn text_outline(string: &str, size: f64, weight: f64) -> BezPath {
    stroke(&text(string, size), weight, Cap::Round, Join::Round)
}

#[cfg(test)]
mod tests {
    use super::super::{FillRule, coverage};
    use super::*;
    use kurbo::Shape;

    #[test]
    fn text_has_every_printable_ascii_character_and_each_parses() {
        assert!(GLYPHS.windows(2).all(|g| g[0].0 < g[1].0), "the table is searched by halves");
        for c in ' '..='~' {
            assert!(GLYPHS.iter().any(|g| g.0 == c), "{c}");
        }
        for (c, advance, data) in GLYPHS {
            let path = BezPath::from_svg(data).unwrap_or_else(|e| panic!("{c}: {e}"));
            let bounds = path.bounding_box();
            assert!(bounds.x0 >= -1e-9 && bounds.x1 <= *advance + 1e-9 && bounds.y0 >= -11.0 && bounds.y1 <= 4.0, "{c}: {bounds:?}");
        }
    }

    #[test]
    fn text_glyphs_differ() {
        let drawn: Vec<Vec<f32>> = (' '..='~')
            .map(|c| {
                let outline = Affine::translate((2.0, 14.0)) * text_outline(&c.to_string(), 10.0, 1.0);
                coverage(&outline, FillRule::NonZero, 16, 20)
            })
            .collect();
        for (i, a) in drawn.iter().enumerate() {
            for b in &drawn[..i] {
                assert!(a.iter().zip(b).any(|(a, b)| (a - b).abs() > 0.3), "glyph {i}");
            }
        }
    }

    #[test]
    fn text_scales_and_breaks_lines() {
        let (small, large) = (text("Pegbar 24", 5.0).bounding_box(), text("Pegbar 24", 10.0).bounding_box());
        assert!((large.x1 - 2.0 * small.x1).abs() < 1e-9);
        assert!(large.x1 <= text_width("Pegbar 24", 10.0) + 1e-9);
        assert_eq!(text_width("ab\nabc", 7.0), text_width("abc", 7.0));
        assert!((text("a\na", 10.0).bounding_box().y1 - text("a", 10.0).bounding_box().y1 - 19.0).abs() < 1e-9);
    }
}
