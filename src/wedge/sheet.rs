//! The contact sheet: a picture of each variant in a grid, with what sets it apart below.

use std::io;
use std::path::Path;

use pegbar_engine::atomic;
use pegbar_nodes::algo::codec::{CodecError, EncodeOptions, Format, Picture, encode_to_vec};
use pegbar_nodes::algo::paint::{FillRule, coverage, text_outline, text_width};

use crate::report::Thumb;

/// Around cells.
const GAP: usize = 12;
/// Height of a capital, and of a line of text.
const TEXT: f64 = 10.0;
const LINE: usize = 20;
/// Lines of text below a cell.
const LINES: usize = 3;
const GROUND: f32 = 0.87;
const INK: [f32; 3] = [0.02, 0.02, 0.02];
const RED: [f32; 3] = [0.5, 0.01, 0.01];
/// Where a picture would be.
const EMPTY: f32 = 0.72;

/// One variant.
pub(super) struct Cell<'a> {
    /// Pictures, side by side.
    pub(super) pictures: Vec<&'a Thumb>,
    pub(super) label: String,
    /// Why there is none, or not all.
    pub(super) failure: Option<&'a str>,
}

/// A picture that is painted on.
struct Sheet {
    width: usize,
    height: usize,
    rgb: Vec<f32>,
}

impl Sheet {
    fn rectangle(&mut self, [x, y]: [usize; 2], [w, h]: [usize; 2], grey: f32) {
        for row in y..(y + h).min(self.height) {
            self.rgb[(row * self.width + x) * 3..(row * self.width + (x + w).min(self.width)) * 3].fill(grey);
        }
    }

    fn picture(&mut self, [x, y]: [usize; 2], thumb: &Thumb) {
        for (row, pixels) in thumb.rgb.chunks_exact(thumb.width * 3).enumerate() {
            let start = ((y + row) * self.width + x) * 3;
            self.rgb[start..start + pixels.len()].copy_from_slice(pixels);
        }
    }

    /// A line of text in a box of `width` by [`LINE`].
    fn text(&mut self, [x, y]: [usize; 2], width: usize, text: &str, ink: [f32; 3]) {
        // The first line of an outline lies above the origin, and pens are wider than their lines: so the text is made the second line, behind a blank.
        let outline = text_outline(&format!("\n {text}"), TEXT, TEXT / 7.0);
        let x = x.saturating_sub(5);
        let rows = LINE + 4;
        for (i, cover) in coverage(&outline, FillRule::NonZero, width, rows).into_iter().enumerate() {
            let (column, row) = (x + i % width, y + i / width);
            if cover > 0.0 && column < self.width && row < self.height {
                let at = (row * self.width + column) * 3;
                self.rgb[at..at + 3].iter_mut().zip(ink).for_each(|(below, ink)| *below += (ink - *below) * cover);
            }
        }
    }
}

/// A text in lines that are no wider than `width`, broken after commas, spaces and where need be.
fn wrapped(text: &str, width: f64) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_inclusive([' ', ',', '.', '_', '/']) {
        for c in word.chars().collect::<Vec<_>>().chunks(24) {
            let piece: String = c.iter().collect();
            let last = lines.last().cloned().unwrap_or_default();
            if !last.is_empty() && text_width(&format!("{last}{}", piece.trim_end()), TEXT) > width {
                lines.push(String::new());
            }
            if let Some(last) = lines.last_mut() {
                last.push_str(if last.is_empty() { piece.trim_start() } else { &piece });
            }
        }
    }
    if lines.len() > LINES {
        lines.truncate(LINES);
        lines[LINES - 1].push_str("...");
    }
    lines
}

/// Draws the cells in rows of `columns`.
fn drawn(cells: &[Cell<'_>], columns: usize, fallback: [usize; 2]) -> Sheet {
    let row_width = |cell: &Cell| cell.pictures.iter().map(|p| p.width + 2).sum::<usize>().saturating_sub(2);
    let shown = cells.iter().filter(|c| !c.pictures.is_empty());
    let w = shown.clone().map(row_width).max().unwrap_or(fallback[0]).max(160);
    let h = shown.flat_map(|c| &c.pictures).map(|p| p.height).max().unwrap_or(fallback[1] / 2);
    let (step_x, step_y) = (w + GAP, h + LINES * LINE + GAP);
    let columns = columns.clamp(1, cells.len().max(1));
    let (width, height) = (GAP + columns * step_x, GAP + cells.len().div_ceil(columns) * step_y);
    let mut sheet = Sheet { width, height, rgb: vec![GROUND; width * height * 3] };
    for (i, cell) in cells.iter().enumerate() {
        let [x, y] = [GAP + i % columns * step_x, GAP + i / columns * step_y];
        let mut left = x;
        for picture in &cell.pictures {
            sheet.picture([left, y], picture);
            left += picture.width + 2;
        }
        if cell.pictures.is_empty() {
            sheet.rectangle([x, y], [w, h], EMPTY);
        }
        if let Some(failure) = cell.failure {
            sheet.text([x + 8, y + 4], w - 8, "failed", RED);
            for (k, line) in wrapped(failure, (w - 16) as f64).iter().enumerate() {
                sheet.text([x + 8, y + 6 + (k + 1) * LINE], w - 8, line, RED);
            }
        }
        for (k, line) in wrapped(&cell.label, w as f64).iter().enumerate() {
            sheet.text([x, y + h - 2 + k * LINE], w, line, INK);
        }
    }
    sheet
}

/// Writes the sheet as PNG.
pub(super) fn write(path: &Path, cells: &[Cell<'_>], columns: usize, fallback: [usize; 2]) -> Result<(), String> {
    let Sheet { width, height, rgb } = drawn(cells, columns, fallback);
    let picture = Picture::new(rgb, width, height, &["R", "G", "B"]).ok_or("a picture of that size cannot be made")?;
    let bytes = encode_to_vec(&picture, &EncodeOptions::new(Format::Png)).map_err(|e: CodecError| e.to_string())?;
    atomic::write(path, |out| io::Write::write_all(out, &bytes)).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(v: f32) -> Thumb {
        Thumb { width: 200, height: 100, rgb: vec![v; 200 * 100 * 3] }
    }

    #[test]
    fn every_variant_has_its_place_and_its_label() {
        let thumbs = [grey(0.1), grey(0.2), grey(0.3)];
        let mut cells: Vec<Cell> = thumbs.iter().map(|t| Cell { pictures: vec![t], label: "a.b=1".to_owned(), failure: None }).collect();
        cells[2] = Cell { pictures: Vec::new(), label: "a.b=3".to_owned(), failure: Some("expected more") };
        let sheet = drawn(&cells, 2, [320, 240]);
        assert_eq!((sheet.width, sheet.height), (GAP + 2 * (200 + GAP), GAP + 2 * (100 + LINES * LINE + GAP)));
        let at = |x: usize, y: usize| sheet.rgb[(y * sheet.width + x) * 3 + 1];
        assert_eq!((at(GAP, GAP), at(GAP + 212, GAP + 99)), (0.1, 0.2));
        let below = GAP + 172;
        assert_eq!((at(GAP + 150, below + 90), at(GAP + 212 + 50, below + 50)), (EMPTY, GROUND));
        let is_inked = |y: std::ops::Range<usize>, grey: f32| {
            y.flat_map(|y| (GAP..GAP + 200).map(move |x| (x, y))).any(|(x, y)| at(x, y) < grey - 0.3)
        };
        assert!(is_inked(GAP + 100..GAP + 120, GROUND) && is_inked(below..below + 30, EMPTY), "label and failure");
    }

    #[test]
    fn long_labels_are_broken_and_cut() {
        let lines = wrapped("track.levels=4, matte.close_gaps=12", 120.0);
        assert!(lines.len() > 1 && lines.iter().all(|l| text_width(l, TEXT) <= 130.0), "{lines:?}");
        assert_eq!(lines.concat().replace(' ', ""), "track.levels=4,matte.close_gaps=12");
        assert_eq!(wrapped(&"x".repeat(400), 100.0).len(), LINES);
    }
}
