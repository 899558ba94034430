//! `render.drawings`: vector drawings as pictures.
//!
//! **Method** paths are filled and inked with exact area coverage ([`crate::algo::paint`]), the first at the bottom, over each other in linear light.
//! Lines have round joins and caps. Ink may taper to points at the ends of open lines, and swell on closed lines where they face away from the light.
//!
//! **Source** W3C, Scalable Vector Graphics 1.1, chapter 11 (painting). **Fails when** a point, a width or a colour is not finite; the error names it.
//!
//! **Cost** O(pixels inside + length of the outlines).
//!
//! ```ron
//! "cel": (type: "render.drawings", drawing: "@frog", background: "@plate", taper: 0.3),
//! ```

use kurbo::Point;
use pegbar_engine::Node;
use pegbar_engine::node::{Context, In, NodeError, PerFrame};

use super::{blank, drawing, faded, laid, rgba, screen, within};
use crate::algo::grid::{dot, polyline};
use crate::algo::paint::{BezPath, Canvas, Cap, FillRule, Join, ink_widths, stroke};
use crate::algo::window::Window;
use crate::data::{Contour, Drawing, Image};

/// Vector drawings as pictures.
#[derive(Node)]
#[node(
    id = "render.drawings",
    version = 1,
    outputs = super::Drawing,
    source = "W3C, Scalable Vector Graphics 1.1, chapter 11",
    example = "\"cel\": (type: \"render.drawings\", drawing: \"@frog\", background: \"@plate\", taper: 0.3)"
)]
pub(crate) struct RenderDrawings {
    /// The drawing.
    drawing: In<Drawing>,
    /// What it is drawn on.
    background: Option<In<Image>>,
    /// Width and height without a background. The drawing's own, in whole pixels, where it is left out.
    #[input(default = None, range = 1..=65536, unit = "px")]
    size: Option<[i64; 2]>,
    /// Red, green, blue and opacity of the ground without a background, as seen on screen.
    #[input(default = (0.0, 0.0, 0.0, 0.0), range = 0.0..=1.0)]
    background_color: [f64; 4],
    /// How wide lines are, times as they were drawn. 0 draws none.
    #[input(default = 1.0, range = 0.0..=100.0)]
    line_scale: f64,
    /// The share of an open line over which its ink thins to a point at each end. 0 leaves it as wide as it is; 0.5 thins all of it.
    #[input(default = 0.0, range = 0.0..=0.5)]
    taper: f64,
    /// How much wider, and thinner, closed lines are where they face away from the light, and towards it. 0 leaves them as they are; 1 makes
    /// them twice as wide, and nothing.
    #[input(default = 0.0, range = 0.0..=1.0)]
    swell: f64,
    /// Where the light comes from: 0 from the right, 90 from above, 135 from the upper left.
    #[input(default = 135.0, range = -360.0..=360.0, unit = "deg")]
    light_deg: f64,
    /// Opacity of all of the drawing.
    #[input(default = 1.0, range = 0.0..=1.0)]
    opacity: f64,
}

impl RenderDrawings {
    fn check_numbers(&self) -> Result<(), NodeError> {
        within("line_scale", self.line_scale, 0.0, 100.0)?;
        within("taper", self.taper, 0.0, 0.5)?;
        within("swell", self.swell, 0.0, 1.0)?;
        within("light_deg", self.light_deg, -360.0, 360.0)?;
        within("opacity", self.opacity, 0.0, 1.0)?;
        Ok(())
    }

    /// The window that is drawn in, and the format.
    fn windows(&self) -> Result<(Window, Window), NodeError> {
        if let Some(image) = &self.background {
            return Ok((image.data_window().union(&image.display_window()), image.display_window()));
        }
        let own = || -> Result<[i64; 2], NodeError> {
            let side = |name, v: f64| within(name, v, f64::MIN_POSITIVE, 65536.0).map(|v| libm::round(v).max(1.0) as i64);
            Ok([side("the drawing's width", self.drawing.size[0])?, side("the drawing's height", self.drawing.size[1])?])
        };
        let [w, h] = self.size.map_or_else(own, Ok)?;
        let window = Window::from_bounds(0, 0, w, h);
        Ok((window, window))
    }
}

/// How lines are drawn: the settings of [`RenderDrawings`] of these names.
pub(crate) struct Pen {
    line_scale: f64,
    taper: f64,
    swell: f64,
    light_deg: f64,
}

impl Default for Pen {
    fn default() -> Self {
        Self { line_scale: 1.0, taper: 0.0, swell: 0.0, light_deg: 135.0 }
    }
}

impl Pen {
    /// The outline of the ink of a line.
    fn ink(&self, contour: &Contour, path: &BezPath, points: &[Point], width: f64) -> BezPath {
        // A line without a length is a dot, as round caps say.
        if let Some(first) = points.first().filter(|p| points.iter().all(|q| q == *p)) {
            return dot(*first, width);
        }
        match (contour.closed, self.taper > 0.0, self.swell > 0.0) {
            (false, true, _) if points.len() > 1 => ink_widths(points, &tapered(points, width, self.taper), false),
            (true, _, true) if points.len() > 2 => {
                let (sin, cos) = libm::sincos(self.light_deg.to_radians());
                ink_widths(points, &swollen(points, width, self.swell, [-cos, sin]), true)
            }
            _ => stroke(path, width, Cap::Round, Join::Round),
        }
    }

    /// Paints a drawing on samples that fill `window`.
    pub(crate) fn draw(&self, art: &Drawing, samples: &mut [f32], window: Window) -> Result<(), NodeError> {
        let mut canvas = Canvas::new(samples, window.width, window.height).map_err(|e| NodeError::internal(e.to_string()))?;
        for (i, contours) in art.outlines().iter().enumerate() {
            let width = art.width[i] * self.line_scale;
            finite(art, i, contours, width)?;
            let (mut inside, mut line) = (BezPath::new(), BezPath::new());
            for contour in contours {
                let to = |p: &[f64; 2]| Point::new(p[0] - window.x as f64, p[1] - window.y as f64);
                let points: Vec<Point> = contour.points.iter().map(to).collect();
                let path = polyline(&points, contour.closed);
                if art.stroke[i][3] > 0.0 && width > 0.0 {
                    line.extend(self.ink(contour, &path, &points, width));
                }
                inside.extend(path);
            }
            let rule = if art.rule[i] == 1 { FillRule::EvenOdd } else { FillRule::NonZero };
            let colour = |[r, g, b, a]: [f64; 4]| faded(screen([r, g, b].map(|v| v.clamp(0.0, 1.0))), a.clamp(0.0, 1.0));
            if art.fill[i][3] > 0.0 {
                canvas.fill(&inside, rule, colour(art.fill[i]));
            }
            canvas.fill(&line, FillRule::NonZero, colour(art.stroke[i]));
        }
        Ok(())
    }
}

/// Widths that thin to points over a share of the line's length at each end, as a pen that is set down and lifted.
fn tapered(points: &[Point], width: f64, share: f64) -> Vec<f64> {
    let mut along = vec![0.0];
    let mut sum = 0.0;
    for pair in points.windows(2) {
        sum += (pair[1] - pair[0]).hypot();
        along.push(sum);
    }
    let rise = |s: f64| libm::sin((s / (share * sum.max(f64::MIN_POSITIVE))).min(1.0) * std::f64::consts::FRAC_PI_2);
    along.iter().map(|s| width * rise(s.min(sum - s).max(0.0))).collect()
}

/// Widths of a closed line that grow with how much it faces along `away`.
fn swollen(points: &[Point], width: f64, by: f64, away: [f64; 2]) -> Vec<f64> {
    let n = points.len();
    let at = |i: usize| points[i % n];
    let area: f64 = (0..n).map(|i| at(i).to_vec2().cross(at(i + 1).to_vec2())).sum();
    let side = if area < 0.0 { -1.0 } else { 1.0 };
    let faces = |i: usize| {
        let d = at(i + 1) - at(i + n - 1);
        // For y down and a line that runs clockwise as drawn, what is left of it is outside.
        side * (d.y * away[0] - d.x * away[1]) / d.hypot().max(f64::MIN_POSITIVE)
    };
    let mut facing: Vec<f64> = (0..n).map(faces).collect();
    // Corners would make steps in the ink.
    for _ in 0..4 {
        let mean = |i: usize| 0.25 * facing[(i + n - 1) % n] + 0.5 * facing[i] + 0.25 * facing[(i + 1) % n];
        facing = (0..n).map(mean).collect();
    }
    facing.into_iter().map(|f| width * (1.0 + by * f)).collect()
}

fn finite(art: &Drawing, i: usize, contours: &[Contour], width: f64) -> Result<(), NodeError> {
    let points = contours.iter().flat_map(|c| c.points).flatten();
    if let Some(found) = points.chain(&art.fill[i]).chain(&art.stroke[i]).chain([&width]).find(|v| !v.is_finite()) {
        return Err(NodeError::input(format!("{}: expected finite points, colours and widths, found {found}", art.name(i))));
    }
    Ok(())
}

impl PerFrame for RenderDrawings {
    fn run(self, _cx: &Context) -> Result<super::Drawing, NodeError> {
        self.check_numbers()?;
        let (window, display) = self.windows()?;
        let mut samples = match &self.background {
            Some(image) => rgba(image, window)?,
            None => blank(window)?,
        };
        if self.background.is_none() {
            let [r, g, b, a] = self.background_color;
            let colour = faded(screen([r, g, b]), a);
            samples.chunks_exact_mut(4).for_each(|pixel| pixel.copy_from_slice(&colour));
        }
        let pen = Pen { line_scale: self.line_scale, taper: self.taper, swell: self.swell, light_deg: self.light_deg };
        if self.opacity >= 1.0 {
            pen.draw(&self.drawing, &mut samples, window)?;
            return drawing(window, display, samples);
        }
        let mut layer = blank(window)?;
        pen.draw(&self.drawing, &mut layer, window)?;
        laid(&mut samples, &layer, self.opacity);
        drawing(window, display, samples)
    }
}

#[cfg(test)]
mod tests;
