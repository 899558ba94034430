//! `render.shapes`: contours, a deforming grid and the axes of a motion, drawn on footage.
//!
//! **Method** fills and pen lines with exact area coverage ([`crate::algo::paint`]); the grid of [`crate::algo::grid`] under the motion.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, figure 3 (the grid that follows a tracked affine motion).
//!
//! **Fails when** a point or the motion is not finite; the error names it.
//!
//! **Cost** O(pixels + length of the outlines).
//!
//! ```ron
//! "overlay": (type: "render.shapes", background: "@plate", motion: "@track.motion", grid: (40.0, 30.0, 200.0, 180.0)),
//! ```

use kurbo::Point;
use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, List, NodeError, PerFrame, Problem};

use super::{Drawing, blank, cycled, drawing, faded, laid, rgba, screen, within};
use crate::algo::grid::{self, ON_FOOTAGE, OverlayError, dot, finite_motion, moved, polyline};
use crate::algo::paint::{BezPath, Canvas, FillRule, hex};
use crate::algo::raster::{Affine, identity};
use crate::algo::window::Window;
use crate::data::{Affine2, Image, Shape};

/// Contours, a deforming grid and the axes of a motion, drawn on footage.
///
/// Colours are given as seen on screen, 0 to 1. Shapes, grid and axes are in reference pixels and go where the motion takes them; widths of
/// lines stay as they are.
#[derive(Node)]
#[node(
    id = "render.shapes",
    version = 1,
    outputs = Drawing,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, fig. 3",
    example = "\"overlay\": (type: \"render.shapes\", background: \"@plate\", motion: \"@track.motion\", grid: (40.0, 30.0, 200.0, 180.0))"
)]
pub(crate) struct RenderShapes {
    /// The contours; the first lies at the bottom.
    shapes: List<Option<In<Shape>>>,
    /// Where shapes, grid and axes go from the reference. Nowhere where it is left out.
    motion: Option<In<Affine2>>,
    /// What is drawn on.
    background: Option<In<Image>>,
    /// Width and height without a background.
    #[input(default = (640, 360), range = 1..=65536, unit = "px")]
    size: [i64; 2],
    /// Red, green, blue and opacity of the ground without a background.
    #[input(default = (0.0, 0.0, 0.0, 0.0), range = 0.0..=1.0)]
    background_color: [f64; 4],
    /// Colours of the shapes in turn. Seven that all kinds of sight tell apart where it is left out.
    #[input(default = [], range = 0.0..=1.0)]
    colors: Vec<[f64; 3]>,
    /// Opacity of the inside of closed shapes. 0 leaves it alone.
    #[input(default = 0.25, range = 0.0..=1.0)]
    fill_opacity: f64,
    /// One colour for the inside of all shapes. Their own where it is left out.
    #[input(default = None, range = 0.0..=1.0)]
    fill_color: Option<[f64; 3]>,
    /// Width of the contours. 0 draws none.
    #[input(default = 2.0, range = 0.0..=1000.0, unit = "px")]
    stroke_width: f64,
    /// Opacity of the contours.
    #[input(default = 1.0, range = 0.0..=1.0)]
    stroke_opacity: f64,
    /// One colour for all contours. Their own where it is left out.
    #[input(default = None, range = 0.0..=1.0)]
    stroke_color: Option<[f64; 3]>,
    /// Diameter of the dots at the points. 0 draws none.
    #[input(default = 0.0, range = 0.0..=1000.0, unit = "px")]
    point_size: f64,
    /// One colour for all dots. That of their shape where it is left out.
    #[input(default = None, range = 0.0..=1.0)]
    point_color: Option<[f64; 3]>,
    /// The box of the grid: left, top, right, bottom, in reference pixels. No grid where it is left out.
    #[input(default = None, unit = "px")]
    grid: Option<[f64; 4]>,
    /// Columns and rows of the grid's cells.
    #[input(default = (6, 6), range = 1..=1000)]
    grid_lines: [i64; 2],
    /// Colour of the grid.
    #[input(default = (0.94, 0.89, 0.26), range = 0.0..=1.0)]
    grid_color: [f64; 3],
    /// Width of the grid's lines.
    #[input(default = 1.5, range = 0.0..=1000.0, unit = "px")]
    grid_width: f64,
    /// Draw the axes of the motion: x in vermilion, y in green.
    #[input(default = false)]
    axes: bool,
    /// Where the axes start, in reference pixels. The middle of the grid, else of the shapes, else of the picture, where it is left out.
    #[input(default = None, unit = "px")]
    axes_at: Option<[f64; 2]>,
    /// Length of the axes at the reference. Fitted to the grid or the picture where it is left out.
    #[input(default = None, range = 0.0..=65536.0, unit = "px")]
    axes_length: Option<f64>,
    /// Width of the axes.
    #[input(default = 2.5, range = 0.0..=1000.0, unit = "px")]
    axes_width: f64,
    /// Opacity of all that is drawn on the background.
    #[input(default = 1.0, range = 0.0..=1.0)]
    opacity: f64,
}

const X_AXIS: u32 = 0xD55E00;
const Y_AXIS: u32 = 0x009E73;

fn refused(error: OverlayError) -> NodeError {
    NodeError::input(error.to_string())
}

fn line(canvas: &mut Canvas<'_>, path: &BezPath, width: f64, colour: [f32; 4]) {
    if width > 0.0 && colour[3] > 0.0 {
        canvas.line(path, width, colour);
    }
}

impl RenderShapes {
    /// The window that is drawn in: all that the background fills or shows.
    fn windows(&self) -> (Window, Window) {
        match &self.background {
            Some(image) => (image.data_window().union(&image.display_window()), image.display_window()),
            None => {
                let window = Window::from_bounds(0, 0, self.size[0], self.size[1]);
                (window, window)
            }
        }
    }

    fn ground(&self, window: Window) -> Result<Vec<f32>, NodeError> {
        if let Some(image) = &self.background {
            return rgba(image, window);
        }
        let [r, g, b, a] = self.background_color;
        let colour = faded(screen([r, g, b]), a);
        let mut samples = blank(window)?;
        samples.chunks_exact_mut(4).for_each(|pixel| pixel.copy_from_slice(&colour));
        Ok(samples)
    }

    fn check_numbers(&self) -> Result<(), NodeError> {
        within("fill_opacity", self.fill_opacity, 0.0, 1.0)?;
        within("stroke_opacity", self.stroke_opacity, 0.0, 1.0)?;
        within("opacity", self.opacity, 0.0, 1.0)?;
        within("stroke_width", self.stroke_width, 0.0, 1000.0)?;
        within("point_size", self.point_size, 0.0, 1000.0)?;
        within("grid_width", self.grid_width, 0.0, 1000.0)?;
        within("axes_width", self.axes_width, 0.0, 1000.0)?;
        within("axes_length", self.axes_length.unwrap_or(0.0), 0.0, 65536.0)?;
        Ok(())
    }

    fn draw_shape(&self, canvas: &mut Canvas<'_>, i: usize, points: &[Point], closed: bool) {
        let own = cycled(&self.colors, &ON_FOOTAGE, i);
        let colour = |given: Option<[f64; 3]>| given.map_or(own, screen);
        let path = polyline(points, closed);
        if closed && self.fill_opacity > 0.0 {
            canvas.fill(&path, FillRule::NonZero, faded(colour(self.fill_color), self.fill_opacity));
        }
        line(canvas, &path, self.stroke_width, faded(colour(self.stroke_color), self.stroke_opacity));
        if self.point_size > 0.0 {
            for &p in points {
                canvas.fill(&dot(p, self.point_size), FillRule::NonZero, colour(self.point_color));
            }
        }
    }

    /// The reference point where the axes start.
    fn axes_origin(&self, display: Window) -> [f64; 2] {
        if let Some(at) = self.axes_at {
            return at;
        }
        if let Some([left, top, right, bottom]) = self.grid {
            return [(left + right) / 2.0, (top + bottom) / 2.0];
        }
        let points = || self.shapes.0.iter().flatten().flat_map(|s| s.points.iter());
        let ends = |k: usize| points().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        match points().next() {
            Some(_) => [0, 1].map(|k| ends(k).iter().sum::<f64>() / 2.0),
            None => [display.x as f64 + display.width as f64 / 2.0, display.y as f64 + display.height as f64 / 2.0],
        }
    }

    fn draw_axes(&self, canvas: &mut Canvas<'_>, motion: &Affine, origin: [f64; 2], display: Window) {
        let fitted = match self.grid {
            Some([left, top, right, bottom]) => (right - left).min(bottom - top) / 2.0,
            None => display.width.min(display.height) as f64 / 6.0,
        };
        let [o, x, y] = grid::axes(self.axes_origin(display), self.axes_length.unwrap_or(fitted), motion, origin);
        for (tip, colour) in [(x, X_AXIS), (y, Y_AXIS)] {
            let (shaft, head) = grid::arrow(o, tip, self.axes_width);
            // A dark rim keeps the arrow apart from footage of its own colour.
            let mut rim = head.clone();
            rim.extend(shaft.iter());
            line(canvas, &rim, self.axes_width + 2.0, [0.0, 0.0, 0.0, 0.6]);
            line(canvas, &shaft, self.axes_width, hex(colour));
            canvas.fill(&head, FillRule::NonZero, hex(colour));
        }
        canvas.fill(&dot(o, self.axes_width * 2.4), FillRule::NonZero, hex(0xFF_FF_FF));
    }

    fn draw(&self, samples: &mut [f32], window: Window, display: Window) -> Result<(), NodeError> {
        let mut canvas = Canvas::new(samples, window.width, window.height).map_err(|e| NodeError::internal(e.to_string()))?;
        let origin = [window.x as f64, window.y as f64];
        let motion = match &self.motion {
            Some(motion) => finite_motion(Affine::from(&**motion)).map_err(refused)?,
            None => identity(),
        };
        for (i, shape) in self.shapes.0.iter().flatten().enumerate() {
            let points = moved(&shape.points, &motion, origin).map_err(|e| NodeError::input(format!("shape {i}: {e}")))?;
            self.draw_shape(&mut canvas, i, &points, shape.closed);
        }
        if let Some(bounds) = self.grid {
            let cells = self.grid_lines.map(|n| usize::try_from(n).unwrap_or(1));
            let path = grid::grid(bounds, cells, &motion, origin);
            // A dark rim shows the grid on light footage.
            let rim = if self.grid_width > 0.0 { self.grid_width + 1.5 } else { 0.0 };
            line(&mut canvas, &path, rim, [0.0, 0.0, 0.0, 0.35]);
            line(&mut canvas, &path, self.grid_width, screen(self.grid_color));
        }
        if self.axes {
            self.draw_axes(&mut canvas, &motion, origin, display);
        }
        Ok(())
    }
}

impl PerFrame for RenderShapes {
    fn run(self, _cx: &Context) -> Result<Drawing, NodeError> {
        self.check_numbers()?;
        let (window, display) = self.windows();
        let mut samples = self.ground(window)?;
        if self.opacity >= 1.0 {
            self.draw(&mut samples, window, display)?;
            return drawing(window, display, samples);
        }
        // What overlaps in the drawing must not show through itself, so that it is made by itself first.
        let mut layer = blank(window)?;
        self.draw(&mut layer, window, display)?;
        laid(&mut samples, &layer, self.opacity);
        drawing(window, display, samples)
    }

    fn check(&self) -> Vec<Problem> {
        match self.grid {
            Some([left, top, right, bottom]) if !(left < right && top < bottom) => {
                vec![Problem { input: "grid", message: "expected left < right and top < bottom, found a box without an inside".to_owned() }]
            }
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests;
