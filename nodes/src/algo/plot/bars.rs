//! Horizontal bars with names: several series side by side, with whiskers, means and numbers.

use kurbo::Point;

use super::super::paint::{hex, text_width};
use super::draw::PlotError;
use super::sheet::{Align, GRID, SPINE, Sheet, shortened};
use super::{Area, LARGEST, ticks};

/// Bars of one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct BarSeries {
    /// What the legend calls it.
    pub name: String,
    /// Its colour, linear and premultiplied.
    pub colour: [f32; 4],
    /// How long each bar is; what is not finite has none.
    pub lengths: Vec<f64>,
    /// How far the whisker of each goes; what is not finite has none.
    pub whiskers: Vec<f64>,
}

/// All that a plot of bars shows.
#[derive(Clone, Debug, PartialEq)]
pub struct BarPlot {
    /// Above it all.
    pub title: String,
    /// Below the axis.
    pub x_label: String,
    /// Name of each row, from the top.
    pub rows: Vec<String>,
    /// Each with a bar a row.
    pub series: Vec<BarSeries>,
    /// The ends of the axis; fitted to bars and whiskers where it is left out.
    pub range: Option<[f64; 2]>,
    /// Whether the mean of each series is drawn and written.
    pub mean: bool,
    /// Whether numbers are written beside the bars.
    pub values: bool,
    /// Height of a capital in pixels.
    pub text: f64,
}

/// Where everything is, in pixels.
struct Layout {
    /// The rectangle of all bars.
    area: Area,
    row: f64,
    /// Height of a bar.
    thick: f64,
    range: [f64; 2],
    /// Width of a column of numbers.
    column: f64,
    decimals: usize,
}

impl BarPlot {
    fn is_named(&self) -> bool {
        self.series.iter().any(|s| !s.name.is_empty())
    }

    fn feet(&self) -> f64 {
        if self.mean { 2.2 * self.text } else { 0.0 }
    }

    /// Room above and below the bars.
    fn margins(&self) -> [f64; 2] {
        let t = self.text;
        let top = if self.title.is_empty() { 1.4 * t } else { 3.9 * t } + if self.is_named() { 2.4 * t } else { 0.0 };
        let columns = if self.values && self.series.len() > 1 { 1.2 * t } else { 0.0 };
        [top + columns, self.feet() + if self.x_label.is_empty() { 2.8 * t } else { 5.0 * t }]
    }

    /// The height that shows all rows with ease.
    pub fn height(&self) -> usize {
        let [top, bottom] = self.margins();
        let row = (1.9 * self.text).max((0.75 * self.series.len() as f64 + 0.6) * self.text);
        libm::ceil(top + bottom + row * self.rows.len() as f64) as usize
    }

    /// The mean of a series' bars; NaN without one.
    fn mean_of(series: &BarSeries) -> f64 {
        let known: Vec<f64> = series.lengths.iter().copied().filter(|v| v.abs() < LARGEST).collect();
        if known.is_empty() { f64::NAN } else { known.iter().sum::<f64>() / known.len() as f64 }
    }

    fn lay_out(&self, width: usize, height: usize) -> Result<Layout, PlotError> {
        let t = self.text;
        let range = self.ends();
        let largest = range[0].abs().max(range[1].abs());
        let decimals = (2.0 - libm::floor(libm::log10(largest))).clamp(0.0, 9.0) as usize;
        let all = self.series.iter().flat_map(|s| &s.lengths);
        let widest = all.map(|v| text_width(&number(*v, decimals), t)).fold(text_width("0.0", t), f64::max);
        let column = if self.values { widest + 1.2 * t } else { 0.0 };
        let names = self.rows.iter().map(|n| text_width(n, t)).fold(text_width("mean", t), f64::max).min(width as f64 / 3.0);
        let (left, right) = (names + 2.2 * t, (column * self.series.len() as f64).max(0.6 * t) + 1.4 * t);
        let [top, bottom] = self.margins();
        let least = (1.4 * t).max(2.0 * self.series.len() as f64 + 2.0);
        let (least_width, least_height) = (left + right + 6.0 * t, top + bottom + least * self.rows.len() as f64);
        if (width as f64) < least_width || (height as f64) < least_height {
            let (least_width, least_height) = (libm::ceil(least_width) as usize, libm::ceil(least_height) as usize);
            return Err(PlotError::TooSmall { width, height, least_width, least_height });
        }
        let row = (height as f64 - top - bottom) / self.rows.len().max(1) as f64;
        // Bars of a row touch; rows stay apart.
        let thick = (row - (0.25 * row).clamp(1.0, 1.2 * t)) / self.series.len().max(1) as f64;
        let area = [libm::round(left), top, libm::round(width as f64 - right), height as f64 - bottom];
        Ok(Layout { area, row, thick: thick.min(1.6 * t), range, column, decimals })
    }

    /// The ends of the axis: nought is always there, unless the ends are given.
    fn ends(&self) -> [f64; 2] {
        if let Some([low, high]) = self.range.filter(|r| r[1] > r[0] && (r[1] - r[0]).is_finite()) {
            return [low, high];
        }
        let all = self.series.iter().flat_map(|s| s.lengths.iter().chain(&s.whiskers)).filter(|v| v.abs() < LARGEST);
        let [low, high] = all.fold([0.0_f64, 0.0], |[a, b], v| [a.min(*v), b.max(*v)]);
        if low == high {
            return [0.0, 1.0];
        }
        // Whiskers stop short of the edge, and nought is the edge itself.
        let margin = 0.03 * (high - low);
        [if low < 0.0 { low - margin } else { 0.0 }, if high > 0.0 { high + margin } else { 0.0 }]
    }
}

/// A number of a table: NaN is a dash.
fn number(value: f64, decimals: usize) -> String {
    if value.is_nan() {
        return "−".to_owned();
    }
    let text = if value != 0.0 && value.abs() < LARGEST && !(1e-3..1e6).contains(&value.abs()) {
        format!("{value:.2e}")
    } else {
        format!("{value:.decimals$}")
    };
    text.replace('-', "−")
}

/// Paints the plot on `data`, `width` by `height` pixels of four channels, and gives the rectangle of its bars. Cost: O(pixels + bars).
///
/// # Errors
/// Where the picture is too small for the texts, or `data` is of another length.
pub fn draw_bars(plot: &BarPlot, data: &mut [f32], width: usize, height: usize) -> Result<Area, PlotError> {
    let layout = plot.lay_out(width, height)?;
    let mut painter = Painter { plot, sheet: Sheet::new(data, width, height)?, layout };
    painter.ground();
    for row in 0..plot.rows.len() {
        painter.row(row);
    }
    painter.means();
    painter.outside();
    Ok(painter.layout.area)
}

struct Painter<'a, 'b> {
    plot: &'a BarPlot,
    sheet: Sheet<'b>,
    layout: Layout,
}

impl Painter<'_, '_> {
    fn x_at(&self, value: f64) -> f64 {
        let ([left, _, right, _], [low, high]) = (self.layout.area, self.layout.range);
        left + (right - left) * ((value - low) / (high - low)).clamp(0.0, 1.0)
    }

    /// Where the numbers of a series end.
    fn column(&self, k: usize) -> f64 {
        self.layout.area[2] + 0.6 * self.plot.text + self.layout.column * (k + 1) as f64 - 0.4 * self.plot.text
    }

    fn ground(&mut self) {
        let ([left, top, right, bottom], t) = (self.layout.area, self.plot.text);
        // Every second row is shaded to its number, so that the eye stays on it.
        for row in (1..self.plot.rows.len()).step_by(2) {
            let y = top + self.layout.row * row as f64;
            self.sheet.rectangle([0.4 * t, y, self.sheet.width - 0.4 * t, y + self.layout.row], hex(0xF4_F5_F7));
        }
        let [low, high] = self.layout.range;
        let numbers = ticks(low, high, ((right - left) / (6.0 * t)).clamp(2.0, 10.0) as usize, 0.0);
        let axis = bottom + self.plot.feet();
        for (&v, label) in numbers.at.iter().zip(&numbers.labels) {
            let x = libm::floor(self.x_at(v));
            self.sheet.rectangle([x, top, x + 1.0, bottom], hex(GRID));
            self.sheet.rectangle([x, axis, x + 1.0, axis + t * 0.4], hex(SPINE));
            self.sheet.text(label, [x + 0.5, axis + 2.0 * t], t, Align::Middle, false);
        }
    }

    fn row(&mut self, row: usize) {
        let (t, thick) = (self.plot.text, self.layout.thick);
        let [left, top, ..] = self.layout.area;
        let middle = top + self.layout.row * (row as f64 + 0.5);
        let name = shortened(&self.plot.rows[row], left - 1.6 * t, t);
        self.sheet.text(&name, [left - 0.8 * t, middle + t / 2.0], t, Align::Right, false);
        let first = middle - thick * self.plot.series.len() as f64 / 2.0;
        let nought = self.x_at(0.0);
        for (k, series) in self.plot.series.iter().enumerate() {
            let y = first + thick * k as f64;
            let value = |list: &[f64]| list.get(row).copied().filter(|v| v.abs() < LARGEST);
            let bar = value(&series.lengths);
            if let Some(v) = bar {
                let x = self.x_at(v);
                // A hair apart from its neighbour.
                self.sheet.rectangle([nought.min(x), y + 0.25, nought.max(x), y + thick - 0.25], series.colour);
            }
            if let (Some(bar), Some(end)) = (bar, value(&series.whiskers)) {
                let ([a, b], y) = ([self.x_at(bar), self.x_at(end)], y + thick / 2.0);
                let (cap, pen) = ((0.32 * thick).min(0.5 * t), 0.6);
                self.sheet.rectangle([a.min(b), y - pen, a.max(b), y + pen], hex(SPINE));
                self.sheet.rectangle([b - pen, y - cap, b + pen, y + cap], hex(SPINE));
            }
            if self.plot.values {
                let text = number(series.lengths.get(row).copied().unwrap_or(f64::NAN), self.layout.decimals);
                self.sheet.text(&text, [self.column(k), middle + t / 2.0], t, Align::Right, false);
            }
        }
    }

    /// A dashed line at the mean of each series, and its number below the bars.
    fn means(&mut self) {
        let ([left, top, _, bottom], t) = (self.layout.area, self.plot.text);
        if !self.plot.mean {
            return;
        }
        let baseline = bottom + 1.6 * t;
        self.sheet.text("mean", [left - 0.8 * t, baseline], t, Align::Right, false);
        for (k, series) in self.plot.series.iter().enumerate() {
            let mean = BarPlot::mean_of(series);
            if mean.is_finite() {
                let x = self.x_at(mean);
                let [from, to] = [top, bottom + self.plot.feet()].map(|y| Point::new(x, y));
                // Darker than its bars, so that it shows on them.
                self.sheet.dashed(from, to, 1.4, 4.0, darker(series.colour));
            }
            if self.plot.values {
                self.sheet.text(&number(mean, self.layout.decimals), [self.column(k), baseline], t, Align::Right, false);
            }
        }
    }

    /// Axes, legend, title.
    fn outside(&mut self) {
        let ([left, top, right, bottom], t) = (self.layout.area, self.plot.text);
        let axis = bottom + self.plot.feet();
        let nought = libm::floor(self.x_at(0.0));
        self.sheet.rectangle([nought - 1.0, top, nought, axis], hex(SPINE));
        self.sheet.rectangle([left - 1.0, axis, right, axis + 1.0], hex(SPINE));
        if self.plot.mean {
            self.sheet.rectangle([0.4 * t, bottom, self.sheet.width - 0.4 * t, bottom + 1.0], hex(GRID));
        }
        let label = shortened(&self.plot.x_label, right - left, t);
        self.sheet.text(&label, [(left + right) / 2.0, axis + 4.2 * t], t, Align::Middle, false);
        self.sheet.title(&self.plot.title, [left, right], t);
        let several = self.plot.values && self.plot.series.len() > 1;
        if several {
            // A dash of its colour heads each column of numbers.
            for (k, series) in self.plot.series.iter().enumerate() {
                let (x, y) = (self.column(k), top - 0.9 * t);
                self.sheet.rectangle([x - 1.8 * t, y, x, y + 0.4 * t], series.colour);
            }
        }
        let mut x = left;
        let y = top - if several { 2.4 * t } else { 1.2 * t };
        for series in self.plot.series.iter().filter(|s| !s.name.is_empty()) {
            let name = shortened(&series.name, self.sheet.width - x - 3.0 * t, t);
            self.sheet.rectangle([x, y - 0.45 * t, x + 1.8 * t, y + 0.45 * t], series.colour);
            self.sheet.text(&name, [x + 2.4 * t, y + t / 2.0], t, Align::Left, false);
            x += 4.4 * t + text_width(&name, t);
        }
    }
}

/// Darker, of the same hue.
fn darker([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    [0.4 * r, 0.4 * g, 0.4 * b, a]
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];

    fn plot(lengths: &[f64]) -> BarPlot {
        BarPlot {
            title: String::new(),
            x_label: String::new(),
            rows: (0..lengths.len()).map(|i| format!("row {i}")).collect(),
            series: vec![BarSeries { name: String::new(), colour: RED, lengths: lengths.to_vec(), whiskers: Vec::new() }],
            range: Some([0.0, 10.0]),
            mean: false,
            values: false,
            text: 8.0,
        }
    }

    const SIZE: [usize; 2] = [320, 160];

    /// How much of the picture's rows between two heights is red, and the area of the bars.
    fn red(plot: &BarPlot, from: f64, to: f64) -> (f64, Area, Layout) {
        let mut data = vec![0.0; SIZE[0] * SIZE[1] * 4];
        let area = draw_bars(plot, &mut data, SIZE[0], SIZE[1]).unwrap();
        let rows = data.chunks_exact(SIZE[0] * 4).enumerate().filter(|(y, _)| *y as f64 >= from && (*y as f64) < to);
        let sum = rows.flat_map(|(_, row)| row.chunks_exact(4)).map(|p| f64::from((p[0] - p[1]).max(0.0))).sum();
        (sum, area, plot.lay_out(SIZE[0], SIZE[1]).unwrap())
    }

    #[test]
    fn bars_are_as_long_as_their_values() {
        for value in [0.0, 2.5, 7.31, 10.0] {
            let (found, area, layout) = red(&plot(&[value]), 0.0, 160.0);
            // The axis takes the pixel left of nought, which no bar is on; a grid line below a bar is covered by it.
            let truth = value / 10.0 * (area[2] - area[0]) * (layout.thick - 0.5);
            assert!((found - truth).abs() < 0.01 * truth + 0.5, "{value}: expected {truth}, found {found}");
        }
    }

    #[test]
    fn each_row_has_its_bar_and_what_is_missing_has_none() {
        let many = plot(&[1.0, f64::NAN, 4.0, f64::INFINITY]);
        let (_, area, layout) = red(&many, 0.0, 160.0);
        let row = |k: usize| red(&many, libm::round(area[1] + layout.row * k as f64), libm::round(area[1] + layout.row * (k + 1) as f64)).0;
        assert!((row(2) / row(0) - 4.0).abs() < 0.1, "found {} and {}", row(0), row(2));
        assert_eq!((row(1), row(3)), (0.0, 0.0));
    }

    #[test]
    fn whiskers_reach_their_ends_and_negative_bars_go_left() {
        let mut plot = plot(&[4.0]);
        plot.series[0].whiskers = vec![8.0];
        let mut data = vec![0.0; SIZE[0] * SIZE[1] * 4];
        let area = draw_bars(&plot, &mut data, SIZE[0], SIZE[1]).unwrap();
        let y = ((area[1] + area[3]) / 2.0) as usize;
        let dark = |v: f64| data[(y * SIZE[0] + (area[0] + (area[2] - area[0]) * v / 10.0) as usize) * 4] < 0.7;
        assert_eq!([5.0, 7.9, 8.4, 9.5].map(dark), [true, true, false, false]);
        let left = BarPlot { range: None, ..self::plot(&[-3.0, 1.0]) };
        assert_eq!(left.ends().map(|v| (v * 100.0).round() / 100.0), [-3.12, 1.12]);
        assert!(red(&left, 0.0, 160.0).0 > 100.0);
    }

    #[test]
    fn means_leave_out_what_is_missing() {
        let plot = plot(&[1.0, f64::NAN, 4.0, f64::INFINITY]);
        assert_eq!(BarPlot::mean_of(&plot.series[0]), 2.5);
        assert!(BarPlot::mean_of(&self::plot(&[f64::NAN]).series[0]).is_nan());
        assert_eq!(BarPlot { range: None, ..self::plot(&[f64::NAN]) }.ends(), [0.0, 1.0]);
    }

    #[test]
    fn numbers_are_short() {
        let texts = [(0.0714, 3), (-2.5, 1), (f64::NAN, 3), (1.5e-7, 3), (0.0, 2)].map(|(v, d)| number(v, d));
        assert_eq!(texts, ["0.071", "−2.5", "−", "1.50e−7", "0.00"]);
    }

    #[test]
    fn the_fitted_height_is_enough() {
        let plot = plot(&[1.0; 24]);
        let height = plot.height();
        assert!(draw_bars(&plot, &mut vec![0.0; 400 * height * 4], 400, height).is_ok());
        assert!(matches!(draw_bars(&plot, &mut [0.0; 4 * 40 * 40], 40, 40), Err(PlotError::TooSmall { .. })));
    }
}
