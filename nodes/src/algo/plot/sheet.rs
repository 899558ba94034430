//! What all plots are painted with: rectangles and texts on a white ground.

use kurbo::{Affine, BezPath, Point};

use super::super::grid::polyline;
use super::super::paint::{Canvas, FillRule, PaintError, hex, text_outline, text_width};
use super::Area;

/// Colour of texts.
const INK: u32 = 0x262626;
/// Colour of axes.
pub(super) const SPINE: u32 = 0x5A5A5A;
/// Colour of the lines behind values.
pub(super) const GRID: u32 = 0xE4E4E4;

/// How a text stands to its position.
#[derive(Clone, Copy)]
pub(super) enum Align {
    Left,
    Middle,
    Right,
}

/// A plot's canvas.
pub(super) struct Sheet<'a> {
    pub(super) canvas: Canvas<'a>,
    pub(super) width: f64,
}

impl<'a> Sheet<'a> {
    /// A white one on `data`.
    pub(super) fn new(data: &'a mut [f32], width: usize, height: usize) -> Result<Self, PaintError> {
        let mut sheet = Self { canvas: Canvas::new(data, width, height)?, width: width as f64 };
        sheet.rectangle([0.0, 0.0, width as f64, height as f64], hex(0xFF_FF_FF));
        Ok(sheet)
    }

    pub(super) fn rectangle(&mut self, [left, top, right, bottom]: Area, colour: [f32; 4]) {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)].map(|(x, y)| Point::new(x, y));
        self.canvas.fill(&polyline(&corners, true), FillRule::NonZero, colour);
    }

    /// A text whose baseline passes through (`x`, `y`), turned up where it stands along a vertical axis.
    pub(super) fn text(&mut self, string: &str, [x, y]: [f64; 2], size: f64, align: Align, upright: bool) {
        let width = text_width(string, size);
        let start = match align {
            Align::Left => 0.0,
            Align::Middle => -width / 2.0,
            Align::Right => -width,
        };
        let turn = if upright { Affine::new([0.0, -1.0, 1.0, 0.0, 0.0, 0.0]) } else { Affine::IDENTITY };
        let outline = Affine::translate((x, y)) * turn * Affine::translate((start, 0.0)) * text_outline(string, size, size / 7.0);
        self.canvas.fill(&outline, FillRule::NonZero, hex(INK));
    }

    /// Dashes of `pen` pixels along a line, as long as the gaps between them.
    pub(super) fn dashed(&mut self, from: Point, to: Point, pen: f64, dash: f64, colour: [f32; 4]) {
        self.canvas.line(&dashes(from, to, dash), pen, colour);
    }

    /// A title above the middle of `span`, shortened to the sheet.
    pub(super) fn title(&mut self, title: &str, span: [f64; 2], t: f64) {
        let title = shortened(title, self.width - 2.0 * t, 1.25 * t);
        let half = text_width(&title, 1.25 * t) / 2.0;
        let x = ((span[0] + span[1]) / 2.0).min(self.width - t - half).max(t + half);
        self.text(&title, [x, 2.5 * t], 1.25 * t, Align::Middle, false);
    }
}

/// A line cut into dashes with gaps of the same length. Cost: O(dashes).
pub fn dashes(from: Point, to: Point, dash: f64) -> BezPath {
    let d = to - from;
    let length = libm::hypot(d.x, d.y);
    let mut path = BezPath::new();
    // More than some thousands are no dashes any more.
    let count = if dash > 0.0 && length.is_finite() { (libm::ceil(length / (2.0 * dash))).min(1e4) as usize } else { 0 };
    for k in 0..count {
        let [a, b] = [2.0 * k as f64, 2.0 * k as f64 + 1.0].map(|s| (s * dash / length).min(1.0));
        path.move_to(from + d * a);
        path.line_to(from + d * b);
    }
    path
}

/// The first line of `string`, cut where it is wider than `room`.
pub fn shortened(string: &str, room: f64, size: f64) -> String {
    let line = string.lines().next().unwrap_or("");
    if text_width(line, size) <= room {
        return line.to_owned();
    }
    let mut kept: String = line.chars().take(400).collect();
    while kept.pop().is_some() {
        let cut = format!("{}...", kept.trim_end());
        if text_width(&cut, size) <= room {
            return cut;
        }
    }
    String::new()
}

/// `string` in at most `most` lines no wider than `room`, broken at spaces; what is too wide for a line is shortened.
pub fn wrapped(string: &str, room: f64, size: f64, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in string.split_whitespace() {
        let longer = lines.last().map(|line| format!("{line} {word}"));
        match (longer, lines.len()) {
            (Some(longer), n) if n == most || text_width(&longer, size) <= room => lines[n - 1] = longer,
            _ => lines.push(word.to_owned()),
        }
    }
    lines.iter().map(|line| shortened(line, room, size)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_broken_at_spaces_and_shortened() {
        let size = 9.0;
        let room = text_width("translation,", size);
        assert_eq!(wrapped("translation, px", room, size, 2), ["translation,", "px"]);
        assert_eq!(wrapped("linear part", 1000.0, size, 2), ["linear part"]);
        assert_eq!(wrapped("", room, size, 2), Vec::<String>::new());
        let cut = wrapped("one two three four", text_width("three...", size), size, 2);
        assert_eq!(cut.len(), 2);
        assert!(cut.iter().all(|l| text_width(l, size) <= text_width("three...", size)), "{cut:?}");
    }

    #[test]
    fn half_of_a_dashed_line_is_drawn() {
        use kurbo::Shape as _;
        let path = dashes(Point::new(0.0, 0.0), Point::new(30.0, 40.0), 5.0);
        assert!((path.perimeter(1e-6) - 25.0).abs() < 1e-9);
        assert!(dashes(Point::ZERO, Point::new(f64::NAN, 0.0), 5.0).elements().is_empty());
        assert!(dashes(Point::ZERO, Point::new(1.0, 0.0), 0.0).elements().is_empty());
    }
}
