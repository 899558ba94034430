//! A plot laid out and painted.

use kurbo::Point;

use super::super::grid::{dot, polyline};
use super::super::paint::{FillRule, PaintError, hex, text_width};
use super::line::Mask;
use super::sheet::{Align, GRID, SPINE, Sheet, shortened, wrapped};
use super::{Area, LARGEST, Panel, Plot, Series, Ticks, fitted, ticks};

const BAND: u32 = 0xEEF2F7;
/// Height of a line of a label along a vertical axis, and the most lines of one.
const LINE: f64 = 1.7;
const LINES: usize = 3;

/// Why a plot cannot be drawn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlotError {
    /// Less room than its texts need.
    #[error("expected a plot of at least {least_width} x {least_height} pixels for its texts, found {width} x {height}")]
    TooSmall {
        /// Columns that there are.
        width: usize,
        /// Rows that there are.
        height: usize,
        /// Columns that are needed.
        least_width: usize,
        /// Rows that are needed.
        least_height: usize,
    },
    /// The canvas is of another size.
    #[error(transparent)]
    Canvas(#[from] PaintError),
}

/// Where everything is.
struct Layout {
    panels: Vec<PanelLayout>,
    across: Ticks,
    legend_left: f64,
}

struct PanelLayout {
    /// What stands along its vertical axis, in lines.
    label: Vec<String>,
    area: Area,
    range: [f64; 2],
    down: Ticks,
}

/// Paints `plot` on `data`, `width` by `height` pixels of four channels, and gives the rectangle that its panels fill together.
///
/// Cost: O(values + pixels of the panels × lines).
///
/// # Errors
/// [`PlotError`] where the picture is too small for the texts or `data` is of another length.
pub fn draw(plot: &Plot, data: &mut [f32], width: usize, height: usize) -> Result<Area, PlotError> {
    let layout = lay_out(plot, width, height)?;
    let mut painter = Painter { plot, mask: Mask::new(width, height), sheet: Sheet::new(data, width, height)? };
    for (panel, place) in plot.panels.iter().zip(&layout.panels) {
        painter.ground(place, &layout.across);
        for series in &panel.series {
            painter.series(series, place);
        }
        painter.frame(place);
        if plot.legend {
            painter.legend(panel, place, layout.legend_left);
        }
    }
    painter.outside(&layout);
    let (first, last) = (layout.panels.first(), layout.panels.last());
    Ok(first.zip(last).map_or([0.0; 4], |(a, b)| [a.area[0], a.area[1], a.area[2], b.area[3]]))
}

/// Room that is left around and between, as multiples of a capital's height.
fn lay_out(plot: &Plot, width: usize, height: usize) -> Result<Layout, PlotError> {
    let (t, n) = (plot.text, plot.panels.len().max(1));
    let top = if plot.title.is_empty() { 1.4 * t } else { 3.9 * t };
    let bottom = if plot.x_label.is_empty() { 2.8 * t } else { 5.0 * t };
    let gap = 2.0 * t;
    let least_height = top + bottom + gap * (n - 1) as f64 + 3.0 * t * n as f64;
    let each = (height as f64 - top - bottom - gap * (n - 1) as f64) / n as f64;
    let most = (each / (2.6 * t)).clamp(2.0, 8.0) as usize;
    let ranges: Vec<[f64; 2]> = plot.panels.iter().map(range_of).collect();
    let down: Vec<Ticks> = ranges.iter().map(|r| numbers(*r, most)).collect();
    let widest = down.iter().flat_map(|d| &d.labels).map(|l| text_width(l, t)).fold(0.0, f64::max);
    // A label may reach into the gaps, but not into its neighbours'.
    let room = each + 0.6 * gap;
    let labels: Vec<Vec<String>> = plot.panels.iter().map(|p| wrapped(&p.label, room, t, LINES)).collect();
    let lines = labels.iter().map(Vec::len).max().unwrap_or(0);
    let left = t + if lines > 0 { (0.7 + LINE * lines as f64) * t } else { 0.0 } + widest + 1.2 * t;
    let names = || plot.panels.iter().filter(|_| plot.legend).flat_map(Panel::named);
    let legend = names().map(|s| text_width(&s.name, t)).fold(0.0, f64::max).min(width as f64 / 3.0);
    let right = if names().next().is_some() { legend + 5.2 * t } else { 2.0 * t };
    let least_width = left + right + 6.0 * t;
    if (width as f64) < least_width || (height as f64) < least_height {
        let (least_width, least_height) = (libm::ceil(least_width) as usize, libm::ceil(least_height) as usize);
        return Err(PlotError::TooSmall { width, height, least_width, least_height });
    }
    let sides = [libm::round(left), libm::round(width as f64 - right)];
    let panels = ranges.into_iter().zip(down).zip(labels).enumerate().map(|(i, ((range, down), label))| {
        let y = top + (each + gap) * i as f64;
        PanelLayout { label, area: [sides[0], libm::round(y), sides[1], libm::round(y + each)], range, down }
    });
    let room = ((sides[1] - sides[0]) / (5.0 * t)).clamp(2.0, 12.0) as usize;
    let across = ticks(plot.span[0], plot.span[1], room, plot.x_step);
    Ok(Layout { panels: panels.collect(), across, legend_left: sides[1] + 1.4 * t })
}

/// Numbers along a vertical axis: two at the least, which tell its scale.
fn numbers([low, high]: [f64; 2], most: usize) -> Ticks {
    let mut found = ticks(low, high, most, 0.0);
    for more in 1..4 {
        if found.at.len() > 1 {
            break;
        }
        found = ticks(low, high, most + more, 0.0);
    }
    found
}

fn range_of(panel: &Panel) -> [f64; 2] {
    match panel.range {
        Some([low, high]) if high > low && (high - low).is_finite() => [low, high],
        _ => fitted(panel.series.iter().flat_map(|s| s.y.iter().copied())),
    }
}

struct Painter<'a, 'b> {
    plot: &'a Plot,
    mask: Mask,
    sheet: Sheet<'b>,
}

impl Painter<'_, '_> {
    fn x_at(&self, area: Area, x: f64) -> f64 {
        let [first, last] = self.plot.span;
        area[0] + (area[2] - area[0]) * ((x - first) / (last - first).max(f64::MIN_POSITIVE))
    }

    /// Bands and grid of a panel. Lines of one pixel lie on whole pixels.
    fn ground(&mut self, place: &PanelLayout, across: &Ticks) {
        let area = place.area;
        for &[from, to] in &self.plot.bands {
            let (left, right) = (self.x_at(area, from).clamp(area[0], area[2]), self.x_at(area, to).clamp(area[0], area[2]));
            self.sheet.rectangle([left, area[1], right, area[3]], hex(BAND));
        }
        for &x in &across.at {
            let x = libm::floor(self.x_at(area, x));
            self.sheet.rectangle([x, area[1], x + 1.0, area[3]], hex(GRID));
        }
        for &y in &place.down.at {
            let y = libm::floor(y_at(place, y));
            self.sheet.rectangle([area[0], y, area[2], y + 1.0], hex(GRID));
        }
    }

    fn series(&mut self, series: &Series, place: &PanelLayout) {
        let points = series.x.iter().zip(&series.y).map(|(&x, &y)| {
            // Far beyond the axis a line only has to leave the picture.
            let [low, high] = place.range;
            let far = 50.0 * (high - low);
            (y.abs() < LARGEST && x.is_finite()).then(|| Point::new(self.x_at(place.area, x), y_at(place, y.clamp(low - far, high + far))))
        });
        let points: Vec<Option<Point>> = points.collect();
        self.mask.clear();
        for run in points.split(Option::is_none) {
            let run: Vec<Point> = run.iter().flatten().copied().collect();
            self.mask.line(&run, self.plot.width);
            if self.plot.dots > 0.0 {
                run.iter().for_each(|&p| self.mask.unite(&dot(p, self.plot.dots)));
            }
        }
        let [left, top, right, bottom] = place.area;
        // A pen may reach over the sides by its half, but not over the ends of a range that was asked for.
        let pen = self.plot.width.max(self.plot.dots) / 2.0 + 1.0;
        let inside = polyline(&[(left - pen, top), (right + pen, top), (right + pen, bottom), (left - pen, bottom)].map(Point::from), true);
        let (mask, colour) = (&self.mask, series.colour);
        self.sheet.canvas.fill_with(&inside, FillRule::NonZero, |x, y| colour.map(|c| c * mask.cover[y * mask.width + x]));
    }

    /// Axes, numbers and the label of a panel.
    fn frame(&mut self, place: &PanelLayout) {
        let ([left, top, right, bottom], t) = (place.area, self.plot.text);
        self.sheet.rectangle([left - 1.0, top, left, bottom + 1.0], hex(SPINE));
        self.sheet.rectangle([left - 1.0, bottom, right, bottom + 1.0], hex(SPINE));
        for (&value, label) in place.down.at.iter().zip(&place.down.labels) {
            let y = libm::floor(y_at(place, value));
            self.sheet.rectangle([left - 1.0 - t * 0.4, y, left - 1.0, y + 1.0], hex(SPINE));
            self.sheet.text(label, [left - t, y + 0.5 + t / 2.0], t, Align::Right, false);
        }
        for (i, line) in place.label.iter().enumerate() {
            self.sheet.text(line, [(2.0 + LINE * i as f64) * t, (top + bottom) / 2.0], t, Align::Middle, true);
        }
    }

    fn legend(&mut self, panel: &Panel, place: &PanelLayout, left: f64) {
        let (t, [_, top, _, bottom]) = (self.plot.text, place.area);
        let named = panel.named();
        let room = ((bottom - top) / (1.9 * t)).max(1.0) as usize;
        let shown = if named.len() > room { room - 1 } else { named.len() };
        for (i, series) in named.iter().take(shown).enumerate() {
            let y = top + t * (0.6 + 1.9 * i as f64);
            self.sheet.canvas.line(
                &polyline(&[Point::new(left, y), Point::new(left + 1.8 * t, y)], false),
                self.plot.width * 1.2,
                series.colour,
            );
            self.sheet.text(&shortened(&series.name, self.canvas_right(left), t), [left + 2.6 * t, y + t / 2.0], t, Align::Left, false);
        }
        if shown < named.len() {
            let y = top + t * (1.1 + 1.9 * shown as f64);
            self.sheet.text(&format!("and {} more", named.len() - shown), [left + 2.6 * t, y], t, Align::Left, false);
        }
    }

    /// Columns that are left for a name.
    fn canvas_right(&self, left: f64) -> f64 {
        self.mask.width as f64 - left - 3.0 * self.plot.text
    }

    /// The title, and what stands below the lowest panel.
    fn outside(&mut self, layout: &Layout) {
        let Some(last) = layout.panels.last() else { return };
        let ([left, _, right, bottom], t) = (last.area, self.plot.text);
        for (&x, label) in layout.across.at.iter().zip(&layout.across.labels) {
            let x = libm::floor(self.x_at(last.area, x));
            self.sheet.rectangle([x, bottom + 1.0, x + 1.0, bottom + 1.0 + t * 0.4], hex(SPINE));
            self.sheet.text(label, [x + 0.5, bottom + 2.0 * t], t, Align::Middle, false);
        }
        let middle = (left + right) / 2.0;
        let x_label = shortened(&self.plot.x_label, right - left, t);
        self.sheet.text(&x_label, [middle, bottom + 4.2 * t], t, Align::Middle, false);
        self.sheet.title(&self.plot.title, [left, right], t);
    }
}

fn y_at(place: &PanelLayout, y: f64) -> f64 {
    let ([_, top, _, bottom], [low, high]) = (place.area, place.range);
    bottom - (bottom - top) * ((y - low) / (high - low))
}
