//! `render.strip`: a sheet of frames, rows of footage above each other.
//!
//! **Method** each frame's display window is scaled by a Catmull-Rom filter widened to the scale ([`crate::algo::filter`]) and laid on the ground.
//!
//! **Source** usual practice.
//!
//! **Fails when** a frame is listed that the footage does not have; the error names it.
//!
//! **Cost** O(samples of the frames that are shown); others are not asked for. One of them is in memory, and the sheet.
//!
//! ```ron
//! "sheet": (type: "render.strip", images: ["@plate", "@overlay"], labels: ["footage", "tracked"], count: 6),
//! ```

use kurbo::Affine;
use pegbar_engine::Node;
use pegbar_engine::node::{Context, Fault, List, NodeError, Picked, Whole};

use super::{Drawing, blank, drawing, rgba, screen, within};
use crate::algo::filter::{ResizeFilter, resize};
use crate::algo::paint::{Canvas, FillRule, text_outline, text_width};
use crate::algo::raster::Raster;
use crate::algo::warp_affine::Source;
use crate::algo::window::Window;
use crate::data::Image;

/// A sheet of frames, rows of footage above each other.
#[derive(Node)]
#[node(
    id = "render.strip",
    version = 1,
    kind = whole,
    outputs = Drawing,
    example = "\"sheet\": (type: \"render.strip\", images: [\"@plate\", \"@overlay\"], labels: [\"footage\", \"tracked\"], count: 6)"
)]
pub(crate) struct RenderStrip {
    /// Footage, one row each. A single picture stands at every frame.
    #[input(any_clock)]
    images: List<Picked<Image>>,
    /// The frames that are shown, from the left. Evenly spaced where there are none.
    #[input(default = [])]
    frames: Vec<i64>,
    /// How many frames are shown where they are not listed: the first, the last, and others between.
    #[input(default = 6, range = 1..=1000)]
    count: i64,
    /// Width of each picture; its height follows from its shape.
    #[input(default = 240, range = 1..=16384, unit = "px")]
    width: i64,
    /// Space between pictures and around them.
    #[input(default = 8, range = 0..=4096, unit = "px")]
    gap: i64,
    /// A name for each row, in their order.
    #[input(default = [])]
    labels: Vec<String>,
    /// Write the frame above each column.
    #[input(default = true)]
    numbers: bool,
    /// Red, green, blue of the ground, as seen on screen. The texts are black or white, whichever is further from it.
    #[input(default = (1.0, 1.0, 1.0), range = 0.0..=1.0)]
    background: [f64; 3],
    /// Height of a capital.
    #[input(default = 9.0, range = 4.0..=200.0, unit = "px")]
    text_size: f64,
}

/// One row of pictures, all scaled to the shape of the first.
struct Row<'a> {
    images: &'a Picked<Image>,
    top: usize,
    height: usize,
}

/// `count` whole numbers from `first` to `last`, evenly spaced, each once.
fn spaced(first: i64, last: i64, count: i64) -> Vec<i64> {
    let steps = (count - 1).clamp(0, last - first);
    let at = |i: i64| if steps == 0 { first } else { first + ((last - first) * i * 2 + steps) / (steps * 2) };
    (0..=steps).map(at).collect()
}

impl RenderStrip {
    fn shown(&self, cx: &Context) -> Vec<i64> {
        if !self.frames.is_empty() {
            return self.frames.clone();
        }
        let clocks = || cx.input_clocks.iter().filter(|(input, _)| *input == "images").map(|(_, clock)| clock);
        match (clocks().map(|c| c.first).max(), clocks().map(|c| c.last).min()) {
            (Some(first), Some(last)) => spaced(first, last.max(first), self.count),
            _ => vec![cx.clock.first],
        }
    }

    fn rows(&self, top: usize, width: usize, gap: usize) -> Result<Vec<Row<'_>>, NodeError> {
        let mut rows: Vec<Row> = Vec::new();
        for images in &self.images.0 {
            let shape = images.get(0)?.display_window();
            if shape.is_empty() {
                return Err(NodeError::input(format!("expected pictures, found one of {} x {} pixels", shape.width, shape.height)));
            }
            let height = libm::round(width as f64 * shape.height as f64 / shape.width as f64).clamp(1.0, 65536.0) as usize;
            let top = rows.last().map_or(top, |r| r.top + r.height + gap);
            rows.push(Row { images, top, height });
        }
        Ok(rows)
    }

    /// Black or white, whichever is further from the ground.
    fn ink(&self) -> [f32; 4] {
        let [r, g, b] = self.background;
        let light = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        screen(if light > 0.5 { [0.1; 3] } else { [0.95; 3] })
    }

    /// A text with its baseline at `y`, `share` of it to the left of `x`.
    fn write(&self, canvas: &mut Canvas<'_>, text: &str, [x, y]: [f64; 2], share: f64) {
        let start = x - text_width(text, self.text_size) * share;
        let outline = Affine::translate((start, y)) * text_outline(text, self.text_size, self.text_size / 7.0);
        canvas.fill(&outline, FillRule::NonZero, self.ink());
    }
}

/// The display window of `image` scaled to `width` by `height`, laid over the ground at (`x`, `y`) of a sheet of `stride` columns.
fn lay(image: &Image, [width, height]: [usize; 2], sheet: &mut [f32], stride: usize, [x, y]: [usize; 2]) -> Result<(), NodeError> {
    let display = image.display_window();
    let samples = rgba(image, display)?;
    let raster = Raster::new(&samples, display.width, display.height, 4).ok_or_else(|| NodeError::internal("a picture of another size"))?;
    let mut scaled = blank(Window::at_origin(width, height))?;
    resize(Source::new(raster, [0, 0]), ResizeFilter::CatmullRom, &mut scaled, width, height)
        .map_err(|e| NodeError::input(e.to_string()))?;
    for (row, pixels) in scaled.chunks_exact(width * 4).enumerate() {
        let start = ((y + row) * stride + x) * 4;
        for (below, above) in sheet[start..start + width * 4].chunks_exact_mut(4).zip(pixels.chunks_exact(4)) {
            let keep = 1.0 - above[3].clamp(0.0, 1.0);
            below.iter_mut().zip(above).for_each(|(b, a)| *b = *b * keep + a);
        }
    }
    Ok(())
}

impl Whole for RenderStrip {
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        self.shown(cx)
    }

    fn run(self, cx: &Context) -> Result<Drawing, NodeError> {
        if self.images.0.is_empty() {
            return Err(NodeError::input("expected at least one row of pictures, found none"));
        }
        if self.labels.len() > self.images.0.len() {
            let found = format!("expected at most one label for each of {} rows, found {}", self.images.0.len(), self.labels.len());
            return Err(NodeError::new(Fault::Parameters, found));
        }
        let text = within("text_size", self.text_size, 4.0, 200.0)?;
        let [width, gap] = [self.width, self.gap].map(|n| usize::try_from(n).unwrap_or(0));
        let frames = self.shown(cx);
        let named = self.labels.iter().map(|l| text_width(l, text)).fold(0.0, f64::max).min(4096.0);
        let left = gap + if named > 0.0 { libm::ceil(named + text * 1.4) as usize } else { 0 };
        let top = gap + if self.numbers { libm::ceil(text * 2.0) as usize } else { 0 };
        let rows = self.rows(top, width, gap)?;
        let bottom = rows.last().map_or(top, |r| r.top + r.height + gap);
        let window = Window::at_origin(left + frames.len().saturating_mul(width + gap), bottom);
        let mut sheet = blank(window)?;
        let ground = screen(self.background);
        sheet.chunks_exact_mut(4).for_each(|p| p.copy_from_slice(&ground));
        for row in &rows {
            for i in 0..frames.len() {
                cx.check()?;
                lay(row.images.get(i)?.as_ref(), [width, row.height], &mut sheet, window.width, [left + i * (width + gap), row.top])?;
            }
        }
        let mut canvas = Canvas::new(&mut sheet, window.width, window.height).map_err(|e| NodeError::internal(e.to_string()))?;
        for (row, label) in rows.iter().zip(&self.labels) {
            self.write(&mut canvas, label, [left as f64 - text, row.top as f64 + (row.height as f64 + text) / 2.0], 1.0);
        }
        for (i, frame) in frames.iter().enumerate().filter(|_| self.numbers) {
            let middle = (left + i * (width + gap)) as f64 + width as f64 / 2.0;
            self.write(&mut canvas, &frame.to_string(), [middle, top as f64 - text * 0.6], 0.5);
        }
        drawing(window, window, sheet)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{load, pictures};
    use super::*;
    use crate::counted::{clock, counted};
    use pegbar_engine::node::Cancel;

    #[test]
    fn frames_are_spread_from_the_first_to_the_last() {
        assert_eq!(spaced(1, 24, 4), [1, 9, 16, 24]);
        assert_eq!(spaced(1, 3, 9), [1, 2, 3]);
        assert_eq!(spaced(5, 5, 4), [5]);
        assert_eq!(spaced(-4, 4, 3), [-4, 0, 4]);
        assert_eq!(spaced(1, 9, 1), [1]);
    }

    #[test]
    fn each_cell_is_its_frame_and_the_ground_lies_between() {
        let nodes = r#""red": (type: "image.constant", size: (8, 4), color: (0.5, 0.0, 0.0, 1.0)),
            "blue": (type: "image.constant", size: (8, 8), color: (0.0, 0.0, 0.25, 0.5)),
            "out": (type: "render.strip", images: ["@red", "@blue"], frames: [1, 3, 4], width: 4, gap: 2, numbers: false)"#;
        let sheet = pictures(nodes, 1).unwrap().remove(0);
        assert_eq!((sheet.width(), sheet.height()), (2 + 3 * 6, 2 + 2 + 2 + 4 + 2));
        let pixel = |x: usize, y: usize| sheet.samples()[(y * 20 + x) * 4..][..4].to_vec();
        assert_eq!(pixel(0, 0), [1.0; 4]);
        assert_eq!(pixel(6, 3), [1.0; 4]);
        for x in [2, 5, 8, 17] {
            let (red, blue) = (pixel(x, 2), pixel(x, 8));
            assert!((red[0] - 0.5).abs() < 1e-6 && red[1].abs() < 1e-6, "{red:?}");
            assert!((blue[0] - 0.5).abs() < 1e-6 && (blue[2] - 0.625).abs() < 1e-6 && (blue[3] - 1.0).abs() < 1e-6, "{blue:?}");
        }
    }

    #[test]
    fn texts_take_room_of_their_own() {
        let nodes = |more: &str| {
            let text = format!(
                r#""red": (type: "image.constant", size: (8, 4), color: (1.0, 1.0, 1.0, 1.0)),
                "out": (type: "render.strip", images: "@red", width: 40 {more})"#
            );
            pictures(&text, 2).unwrap().remove(0)
        };
        let (plain, named) = (nodes(", numbers: false"), nodes(r#", labels: ["row"]"#));
        assert!(plain.samples().iter().all(|v| *v > 0.999));
        assert!(named.width() > plain.width() && named.height() > plain.height());
        let dark = |image: &Image, x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
            y.flat_map(|y| x.clone().map(move |x| (x, y))).filter(|&(x, y)| image.samples()[(y * image.width() + x) * 4] < 0.5).count()
        };
        let left = named.width() - 48;
        assert!(dark(&named, 0..left, 0..named.height()) > 20, "the label");
        assert!(dark(&named, left..named.width(), 0..named.height()) > 3, "the number");
    }

    #[test]
    fn what_cannot_be_laid_out_is_refused() {
        let fails = |more: &str| {
            pictures(&format!(r#""red": (type: "image.constant", size: (8, 4)), "out": (type: "render.strip", {more})"#), 1).err().unwrap()
        };
        assert_eq!(fails(r#"images: "@red", labels: ["a", "b"]"#), "expected at most one label for each of 1 rows, found 2");
        assert!(load(r#""out": (type: "render.strip")"#).is_err());
        assert!(fails("images: []").contains("expected"));
    }

    /// A line that moves ten pixels to the right a frame: its middle is at column 10 of frame 1.
    const MOVING: &str = r#""white": (type: "image.constant", size: (80, 20), color: (1.0, 1.0, 1.0, 1.0)),
        "now": (type: "plot.playhead", image: "@white", axes: [0.0, 0.0, 80.0, 20.0, 0.0, 8.0, 1.0], width: 2.0),"#;

    #[test]
    fn cells_show_the_frames_that_are_listed() {
        let out = r#""out": (type: "render.strip", images: "@now", frames: [4, 2], width: 80, gap: 0, numbers: false)"#;
        let sheets: Vec<_> = [1, 2].map(|threads| pictures(&format!("{MOVING} {out}"), threads).unwrap().remove(0)).into();
        assert!(sheets[0].samples() == sheets[1].samples());
        let row = &sheets[0].samples()[15 * 160 * 4..16 * 160 * 4];
        let dark: Vec<usize> = row.chunks_exact(4).enumerate().filter(|(_, p)| p[1] < 0.5).map(|(x, _)| x).collect();
        assert_eq!(dark, [39, 40, 80 + 19, 80 + 20]);
    }

    #[test]
    fn one_frame_is_held_at_a_time() {
        let (images, count) = counted(3, |k| Image::new(4, 2, 1, vec![k as f32; 8]).unwrap());
        let node = RenderStrip {
            images: List(vec![images]),
            frames: vec![3, 50, 98],
            count: 6,
            width: 4,
            gap: 0,
            labels: Vec::new(),
            numbers: false,
            background: [1.0; 3],
            text_size: 9.0,
        };
        let (clock, cancel) = (clock(100), Cancel::default());
        let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel };
        let sheet = node.run(&cx).unwrap().image;
        assert_eq!([0, 4, 8].map(|x| sheet.samples()[x * 4].round()), [0.0, 1.0, 2.0]);
        // The first is read once more, for its shape.
        assert_eq!((count.peak(), count.reads()), (1, 4));
    }

    #[test]
    fn a_frame_that_is_not_there_is_refused() {
        let out = r#""out": (type: "render.strip", images: "@now", frames: [2, 9])"#;
        assert_eq!(
            pictures(&format!("{MOVING} {out}"), 1).err().unwrap(),
            "expected frames 1 to 4 of the clock `frames`, asked for frame 9"
        );
    }
}
