//! A matrix of distances as a picture, with the path through it.
//!
//! Each pixel shows the mean of the matrix over its area, so that a large matrix shrinks without moiré and a small one has sharp cells. Rows come one by one:
//! the matrix itself is never held.

use kurbo::Point;

use super::super::grid::polyline;
use super::super::paint::{BezPath, FillRule, hex, text_width};
use super::draw::PlotError;
use super::sheet::{Align, SPINE, Sheet, shortened};
use super::{Area, Ramp, reduced, ticks};

/// Means of a matrix of `n` rows and `m` columns over the pixels of a picture: rows run to the right, columns upwards.
#[derive(Clone, Debug, PartialEq)]
pub struct Shrunk {
    counts: [usize; 2],
    size: [usize; 2],
    /// Sum of what is finite, and the area of that, of each pixel, column of pixels by column from below.
    sums: Vec<f64>,
    areas: Vec<f64>,
    least: f64,
    greatest: f64,
}

impl Shrunk {
    /// Of a matrix of `counts` rows and columns for a picture of `size`, width and height.
    pub fn new(counts: [usize; 2], size: [usize; 2]) -> Self {
        let pixels = size[0] * size[1];
        Self { counts, size, sums: vec![0.0; pixels], areas: vec![0.0; pixels], least: f64::INFINITY, greatest: f64::NEG_INFINITY }
    }

    /// Adds row `i`, each once; what is not finite counts nothing. Cost: O(m + pixels that the row covers).
    pub fn add(&mut self, i: usize, row: &[f64]) {
        let ([n, m], [width, height]) = (self.counts, self.size);
        let strip: Vec<[f64; 2]> = (0..height).map(|y| strip(row, [y, y + 1].map(|y| (y * m) as f64 / height as f64))).collect();
        for &v in row {
            // Written out: `min` and `max` would look for NaN.
            self.least = if v < self.least && v.is_finite() { v } else { self.least };
            self.greatest = if v > self.greatest && v.is_finite() { v } else { self.greatest };
        }
        let first = (i * width) / n.max(1);
        for x in first..width {
            let ends = [x, x + 1].map(|x| (x * n) as f64 / width as f64);
            let share = ends[1].min((i + 1) as f64) - ends[0].max(i as f64);
            if share <= 0.0 {
                break;
            }
            let pixels = self.sums[x * height..][..height].iter_mut().zip(&mut self.areas[x * height..][..height]);
            pixels.zip(&strip).for_each(|((sum, area), [s, a])| {
                *sum += share * s;
                *area += share * a;
            });
        }
    }

    /// The mean at column `x` and row `y` of pixels, from the top left; NaN where nothing is finite, and outside.
    pub fn at(&self, x: usize, y: usize) -> f64 {
        if x >= self.size[0] || y >= self.size[1] {
            return f64::NAN;
        }
        let at = x * self.size[1] + self.size[1] - 1 - y;
        if self.areas[at] > 0.0 { self.sums[at] / self.areas[at] } else { f64::NAN }
    }

    /// The least and the greatest of all that was added; `None` where nothing was finite.
    pub fn ends(&self) -> Option<[f64; 2]> {
        (self.least <= self.greatest).then_some([self.least, self.greatest])
    }

    fn has_gaps(&self) -> bool {
        self.areas.contains(&0.0)
    }
}

/// Sum and length of what is finite of `row` from `a` to `b`, each number from its position to the next.
fn strip(row: &[f64], [a, b]: [f64; 2]) -> [f64; 2] {
    let (first, last) = ((a as usize).min(row.len()), (libm::ceil(b) as usize).min(row.len()));
    let whole = (libm::ceil(a) as usize).clamp(first, last)..(b as usize).clamp(first, last);
    let mut total = if whole.start < whole.end { sum(&row[whole.clone()]) } else { [0.0; 2] };
    // Of the others there is one at either end, at the most.
    let ends = [first, last.saturating_sub(1).max(first)];
    let parts =
        ends.iter().take(if ends[0] == ends[1] { 1 } else { 2 }).filter(|j| **j < last && !whole.contains(j) && row[**j].is_finite());
    for &j in parts {
        let share = b.min((j + 1) as f64) - a.max(j as f64);
        total[0] += share * row[j];
        total[1] += share;
    }
    total
}

/// Numbers that are added at once.
const LANES: usize = 8;

/// Sum and number of what is finite.
fn sum(values: &[f64]) -> [f64; 2] {
    let (mut sums, mut counts) = ([0.0; LANES], [0.0; LANES]);
    let (groups, rest) = values.as_chunks::<LANES>();
    for group in groups {
        for k in 0..LANES {
            let is_finite = group[k].is_finite();
            sums[k] += if is_finite { group[k] } else { 0.0 };
            counts[k] += if is_finite { 1.0 } else { 0.0 };
        }
    }
    let rest = rest.iter().filter(|v| v.is_finite()).fold([0.0, 0.0], |[s, n], v| [s + v, n + 1.0]);
    [sums.iter().sum::<f64>() + rest[0], counts.iter().sum::<f64>() + rest[1]]
}

/// All that stands about and on a matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct MatrixPlot {
    /// Above it all.
    pub title: String,
    /// Below the horizontal and along the vertical axis.
    pub labels: [String; 2],
    /// Along the scale of colours.
    pub unit: String,
    /// Below the horizontal axis's label.
    pub caption: String,
    /// Numbers of the first row, to the left, and of the first column, below.
    pub first: [i64; 2],
    /// The colours.
    pub ramp: Ramp,
    /// What the ends of the ramp stand for; the ends of the matrix where it is left out.
    pub range: Option<[f64; 2]>,
    /// Pairs of row and column, from 0, in the order of time: the path.
    pub path: Vec<[f64; 2]>,
    /// The column of each row, from 0, held for a row: a second line. None where it is empty.
    pub map: Vec<f64>,
    /// Pairs that are marked.
    pub pins: Vec<[f64; 2]>,
    /// First and last column of each row that a path may run through; none where it is empty.
    pub window: Vec<[usize; 2]>,
    /// Height of a capital in pixels.
    pub text: f64,
    /// Width of the lines in pixels.
    pub width: f64,
}

/// The retime's line, and pins.
const MAP: u32 = 0xE69F00;
const PIN: u32 = 0xFF2D6F;
const DARK: u32 = 0x141414;
const WHITE: u32 = 0xFF_FF_FF;

/// The rectangle of whole pixels that the matrix fills: make [`Shrunk`] of its size.
///
/// # Errors
/// Where the picture is too small for the texts.
pub fn matrix_area(plot: &MatrixPlot, counts: [usize; 2], width: usize, height: usize) -> Result<Area, PlotError> {
    let t = plot.text;
    let last = counts.map(|c| c.saturating_sub(1) as i64);
    let widest = [plot.first[1], plot.first[1].saturating_add(last[1])].iter().map(|v| text_width(&v.to_string(), t)).fold(0.0, f64::max);
    let left = t + if plot.labels[1].is_empty() { 0.0 } else { 2.4 * t } + widest + 1.2 * t;
    let right = 3.9 * t + text_width("00.000", t) + if plot.unit.is_empty() { 0.0 } else { 2.6 * t };
    let top = if plot.title.is_empty() { 1.4 * t } else { 3.9 * t } + if plot.key(false).is_empty() { 0.0 } else { 2.4 * t };
    let bottom = 2.8 * t + if plot.labels[0].is_empty() { 0.0 } else { 2.2 * t } + if plot.caption.is_empty() { 0.0 } else { 2.2 * t };
    let (least_width, least_height) = (libm::ceil(left + right + 8.0 * t) as usize, libm::ceil(top + bottom + 8.0 * t) as usize);
    if width < least_width || height < least_height {
        return Err(PlotError::TooSmall { width, height, least_width, least_height });
    }
    Ok([left, top, width as f64 - right, height as f64 - bottom].map(libm::round))
}

/// Paints the plot on `data`, `width` by `height` pixels of four channels. Cost: O(pixels + path + window).
///
/// # Errors
/// Where the picture is too small for the texts, or `data` is of another length.
pub fn draw_matrix(plot: &MatrixPlot, values: &Shrunk, data: &mut [f32], width: usize, height: usize) -> Result<Area, PlotError> {
    let area = matrix_area(plot, values.counts, width, height)?;
    let range = plot.range.or(values.ends()).map_or([0.0, 1.0], |[a, b]| if b > a { [a, b] } else { [a - 0.5, a + 0.5] });
    let mut painter = Painter { plot, area, counts: values.counts, range, sheet: Sheet::new(data, width, height)? };
    painter.field(values);
    painter.shut();
    painter.lines();
    painter.axes();
    painter.scale();
    painter.key(values.has_gaps());
    Ok(area)
}

/// An entry of the key above a matrix.
#[derive(Clone, Copy, PartialEq)]
enum Key {
    Path,
    Map,
    Pins,
    Shut,
    Gaps,
}

impl MatrixPlot {
    fn key(&self, has_gaps: bool) -> Vec<(Key, &'static str)> {
        let all = [
            (!self.path.is_empty(), (Key::Path, "path")),
            (!self.map.is_empty(), (Key::Map, "retime")),
            (!self.pins.is_empty(), (Key::Pins, "pinned")),
            (!self.window.is_empty(), (Key::Shut, "shut")),
            (has_gaps, (Key::Gaps, "not comparable")),
        ];
        all.into_iter().filter_map(|(is, entry)| is.then_some(entry)).collect()
    }
}

struct Painter<'a, 'b> {
    plot: &'a MatrixPlot,
    area: Area,
    counts: [usize; 2],
    range: [f64; 2],
    sheet: Sheet<'b>,
}

impl Painter<'_, '_> {
    /// Where row `i` and column `j` are; the middle of a cell is at half a number more.
    fn at(&self, i: f64, j: f64) -> Point {
        let [left, top, right, bottom] = self.area;
        let [n, m] = self.counts.map(|c| c.max(1) as f64);
        Point::new(left + (right - left) * (i / n).clamp(0.0, 1.0), bottom - (bottom - top) * (j / m).clamp(0.0, 1.0))
    }

    fn field(&mut self, values: &Shrunk) {
        let ([left, top, ..], [low, high], ramp) = (self.area, self.range, self.plot.ramp);
        let inside = outline(self.area);
        let (left, top) = (left as usize, top as usize);
        self.sheet.canvas.fill_with(&inside, FillRule::NonZero, |x, y| ramp.at((values.at(x - left, y - top) - low) / (high - low)));
    }

    /// What a window shuts out is veiled, with dashes along its edges.
    fn shut(&mut self) {
        if self.plot.window.is_empty() {
            return;
        }
        let veil = hex(0xE8_E8_E8).map(|v| v * 0.6);
        let m = self.counts[1] as f64;
        for (far, k) in [(0.0, 0), (m, 1)] {
            // Rows in which everything is shut have their last column before their first.
            let edge = |r: &[usize; 2]| if r[0] > r[1] { m } else { [r[0] as f64, (r[1] + 1) as f64][k] };
            let steps = |(i, r): (usize, &[usize; 2])| [(i as f64, edge(r)), ((i + 1) as f64, edge(r))];
            let points: Vec<Point> = self.plot.window.iter().enumerate().flat_map(steps).map(|(i, j)| self.at(i, j)).collect();
            let points = reduced(&points);
            let mut closed = points.clone();
            closed.extend([self.at(self.counts[0] as f64, far), self.at(0.0, far)]);
            self.sheet.canvas.fill(&polyline(&closed, true), FillRule::NonZero, veil);
            let border = self.at(0.0, far).y;
            for pair in points.windows(2).filter(|p| p.iter().any(|p| p.y != border)) {
                self.sheet.canvas.line(&polyline(pair, false), 1.0, hex(WHITE));
            }
        }
    }

    fn stroke(&mut self, path: &BezPath, colour: u32, width: f64) {
        // A dark rim keeps the line apart from the bright end of the ramp.
        self.sheet.canvas.line(path, width + 2.0, hex(DARK));
        self.sheet.canvas.line(path, width, hex(colour));
    }

    fn lines(&mut self) {
        let middle = |p: &[f64; 2]| self.at(p[0] + 0.5, p[1] + 0.5);
        let path = reduced(&self.plot.path.iter().map(middle).collect::<Vec<_>>());
        // A retime holds its column for as long as the row lasts.
        let steps = |(i, j): (usize, &f64)| [self.at(i as f64, j + 0.5), self.at((i + 1) as f64, j + 0.5)];
        let map = reduced(&self.plot.map.iter().enumerate().flat_map(steps).collect::<Vec<_>>());
        let pins: Vec<Point> = self.plot.pins.iter().map(middle).collect();
        let width = self.plot.width;
        if !map.is_empty() {
            self.stroke(&polyline(&map, false), MAP, width * 1.2);
        }
        self.stroke(&polyline(&path, false), WHITE, width);
        for p in pins {
            self.pin(p);
        }
    }

    fn pin(&mut self, p: Point) {
        let r = self.plot.text * 0.55;
        let square = outline([p.x - r, p.y - r, p.x + r, p.y + r]);
        self.sheet.canvas.line(&square, 4.0, hex(DARK));
        self.sheet.canvas.line(&square, 2.0, hex(PIN));
    }

    fn axes(&mut self) {
        let ([left, top, right, bottom], t) = (self.area, self.plot.text);
        for edge in [[left - 1.0, top, left, bottom + 1.0], [left - 1.0, bottom, right, bottom + 1.0]] {
            self.sheet.rectangle(edge, hex(SPINE));
        }
        let span = |k: usize| [self.plot.first[k] as f64, self.plot.first[k] as f64 + self.counts[k].saturating_sub(1) as f64];
        let ends = [0, 1].map(span);
        // Of a single frame there is one number.
        let numbers = |[low, high]: [f64; 2], most: f64| {
            if high > low { ticks(low, high, most.clamp(2.0, 12.0) as usize, 1.0) } else { ticks(low - 0.25, low + 0.25, 1, 1.0) }
        };
        let across = numbers(ends[0], (right - left) / (5.0 * t));
        for (&v, label) in across.at.iter().zip(&across.labels) {
            let x = self.at(v - ends[0][0] + 0.5, 0.0).x;
            self.sheet.rectangle([libm::floor(x), bottom + 1.0, libm::floor(x) + 1.0, bottom + 1.0 + t * 0.4], hex(SPINE));
            self.sheet.text(label, [x, bottom + 2.0 * t], t, Align::Middle, false);
        }
        let down = numbers(ends[1], (bottom - top) / (3.2 * t));
        for (&v, label) in down.at.iter().zip(&down.labels) {
            let y = self.at(0.0, v - ends[1][0] + 0.5).y;
            self.sheet.rectangle([left - 1.0 - t * 0.4, libm::floor(y), left - 1.0, libm::floor(y) + 1.0], hex(SPINE));
            self.sheet.text(label, [left - t, y + t / 2.0], t, Align::Right, false);
        }
        let label = shortened(&self.plot.labels[0], right - left, t);
        self.sheet.text(&label, [(left + right) / 2.0, bottom + 4.2 * t], t, Align::Middle, false);
        let label = shortened(&self.plot.labels[1], bottom - top, t);
        self.sheet.text(&label, [2.0 * t, (top + bottom) / 2.0], t, Align::Middle, true);
        let below = if self.plot.labels[0].is_empty() { 4.2 } else { 6.4 };
        let caption = shortened(&self.plot.caption, self.sheet.width - left - t, t);
        self.sheet.text(&caption, [left, bottom + below * t], t, Align::Left, false);
        self.sheet.title(&self.plot.title, [left, right], t);
    }

    /// The ramp with its numbers.
    fn scale(&mut self) {
        let ([_, top, right, bottom], t, [low, high]) = (self.area, self.plot.text, self.range);
        let (left, wide, ramp) = (libm::round(right + 1.4 * t), libm::round(1.2 * t), self.plot.ramp);
        let bar = outline([left, top, left + wide, bottom]);
        self.sheet.canvas.fill_with(&bar, FillRule::NonZero, |_, y| ramp.at((bottom - y as f64 - 0.5) / (bottom - top)));
        let numbers = ticks(low, high, ((bottom - top) / (4.0 * t)).clamp(2.0, 8.0) as usize, 0.0);
        let mut widest = 0.0_f64;
        for (&v, label) in numbers.at.iter().zip(&numbers.labels) {
            let y = bottom - (bottom - top) * (v - low) / (high - low);
            self.sheet.rectangle([left + wide, libm::floor(y), left + wide + t * 0.4, libm::floor(y) + 1.0], hex(SPINE));
            let label = shortened(label, text_width("00.000", t) + 0.6 * t, t);
            self.sheet.text(&label, [left + wide + 0.8 * t, y + t / 2.0], t, Align::Left, false);
            widest = widest.max(text_width(&label, t));
        }
        let unit = shortened(&self.plot.unit, bottom - top, t);
        self.sheet.text(&unit, [left + wide + widest + 2.8 * t, (top + bottom) / 2.0], t, Align::Middle, true);
    }

    /// What the lines are, above the matrix.
    fn key(&mut self, has_gaps: bool) {
        let ([left, top, ..], t) = (self.area, self.plot.text);
        let (mut x, y) = (left, top - 1.1 * t);
        let ramp = self.plot.ramp;
        for (key, name) in self.plot.key(has_gaps) {
            let middle = Point::new(x + 1.1 * t, y);
            let line = polyline(&[Point::new(x + 0.3 * t, y), Point::new(x + 1.9 * t, y)], false);
            match key {
                Key::Path => self.stroke(&line, WHITE, self.plot.width),
                Key::Map => self.stroke(&line, MAP, self.plot.width * 1.2),
                Key::Pins => self.pin(middle),
                Key::Shut => {
                    self.sheet.rectangle([x, y - 0.6 * t, x + 2.2 * t, y + 0.6 * t], ramp.at(0.4));
                    self.sheet.rectangle([x, y - 0.6 * t, x + 2.2 * t, y + 0.6 * t], hex(0xE8_E8_E8).map(|v| v * 0.6));
                }
                Key::Gaps => self.sheet.rectangle([x, y - 0.6 * t, x + 2.2 * t, y + 0.6 * t], ramp.nothing()),
            }
            self.sheet.text(name, [x + 2.8 * t, y + t / 2.0], t, Align::Left, false);
            x += 4.6 * t + text_width(name, t);
        }
    }
}

fn outline([left, top, right, bottom]: Area) -> BezPath {
    polyline(&[(left, top), (right, top), (right, bottom), (left, bottom)].map(Point::from), true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shrunk(rows: &[&[f64]], size: [usize; 2]) -> Shrunk {
        let mut out = Shrunk::new([rows.len(), rows[0].len()], size);
        rows.iter().enumerate().for_each(|(i, row)| out.add(i, row));
        out
    }

    fn picture(of: &Shrunk) -> Vec<Vec<f64>> {
        (0..of.size[1]).map(|y| (0..of.size[0]).map(|x| of.at(x, y)).collect()).collect()
    }

    #[test]
    fn rows_run_to_the_right_and_columns_upwards() {
        let found = shrunk(&[&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0]], [2, 3]);
        assert_eq!(picture(&found), [[3.0, 6.0], [2.0, 5.0], [1.0, 4.0]]);
        assert_eq!(found.ends(), Some([1.0, 6.0]));
    }

    #[test]
    fn pixels_are_means_over_their_areas() {
        // Of three by three numbers each of two by two pixels has one, two halves and a quarter.
        let found = shrunk(&[&[0.0, 3.0, 6.0], &[9.0, 12.0, 15.0], &[18.0, 21.0, 24.0]], [2, 2]);
        let mean = |a: f64, b: f64, c: f64, d: f64| (a + b / 2.0 + c / 2.0 + d / 4.0) / 2.25;
        let truth = [[mean(6.0, 3.0, 15.0, 12.0), mean(24.0, 15.0, 21.0, 12.0)], [mean(0.0, 3.0, 9.0, 12.0), mean(18.0, 21.0, 9.0, 12.0)]];
        for (found, truth) in picture(&found).iter().flatten().zip(truth.iter().flatten()) {
            assert!((found - truth).abs() < 1e-12, "expected {truth}, found {found}");
        }
        assert_eq!(picture(&shrunk(&[&[1.0, 3.0]], [1, 1])), [[2.0]]);
        // One number fills all pixels, however many.
        assert!(picture(&shrunk(&[&[7.0]], [5, 3])).iter().flatten().all(|v| (*v - 7.0).abs() < 1e-12));
    }

    #[test]
    fn long_rows_are_summed_whole() {
        // Of a hundred numbers in three pixels each has a third, whatever they are grouped in.
        let row: Vec<f64> = (0..100).map(|j| if j % 7 == 3 { f64::NAN } else { f64::from(j * j % 31) }).collect();
        let found = shrunk(&[&row], [1, 3]);
        for k in 0..3 {
            let [a, b] = [k, k + 1].map(|k| f64::from(k) * 100.0 / 3.0);
            let share = |j: usize| (b.min((j + 1) as f64) - a.max(j as f64)).max(0.0);
            let known = || row.iter().enumerate().filter(|(_, v)| v.is_finite());
            let truth = known().map(|(j, v)| share(j) * v).sum::<f64>() / known().map(|(j, _)| share(j)).sum::<f64>();
            assert!((found.at(0, 2 - k as usize) - truth).abs() < 1e-12, "pixel {k}");
        }
    }

    #[test]
    fn what_is_not_finite_counts_nothing() {
        let found = shrunk(&[&[1.0, f64::INFINITY], &[3.0, f64::NAN]], [1, 2]);
        assert!(found.at(0, 0).is_nan() && found.at(0, 1) == 2.0 && found.has_gaps());
        assert!(found.at(1, 0).is_nan() && found.at(0, 2).is_nan());
        assert_eq!(shrunk(&[&[f64::NAN]], [1, 1]).ends(), None);
    }

    fn plot() -> MatrixPlot {
        MatrixPlot {
            title: String::new(),
            labels: [String::new(), String::new()],
            unit: String::new(),
            caption: String::new(),
            first: [1, 1],
            ramp: Ramp::Gray,
            range: Some([0.0, 10.0]),
            path: Vec::new(),
            map: Vec::new(),
            pins: Vec::new(),
            window: Vec::new(),
            text: 8.0,
            width: 2.0,
        }
    }

    /// Red, green, blue at a cell's place, (0.5, 0.5) its middle.
    fn drawn(plot: &MatrixPlot, rows: &[&[f64]]) -> impl Fn(f64, f64) -> [f32; 3] + use<> {
        let (width, height) = (240, 200);
        let area = matrix_area(plot, [rows.len(), rows[0].len()], width, height).unwrap();
        let values = shrunk(rows, [(area[2] - area[0]) as usize, (area[3] - area[1]) as usize]);
        let mut data = vec![0.0; width * height * 4];
        draw_matrix(plot, &values, &mut data, width, height).unwrap();
        let (n, m) = (rows.len() as f64, rows[0].len() as f64);
        move |i, j| {
            let x = (area[0] + (area[2] - area[0]) * i / n) as usize;
            let y = (area[3] - (area[3] - area[1]) * j / m) as usize;
            data[(y * width + x) * 4..][..3].try_into().unwrap()
        }
    }

    const ROWS: [&[f64]; 3] = [&[0.0, 5.0, 10.0, 2.0], &[4.0, 1.0, 3.0, 8.0], &[9.0, 7.0, 6.0, 0.5]];

    #[test]
    fn cells_have_the_colours_of_their_values() {
        let at = drawn(&plot(), &ROWS);
        for (i, row) in ROWS.iter().enumerate() {
            for (j, v) in row.iter().enumerate() {
                let truth = Ramp::Gray.at(v / 10.0)[0];
                assert!((at(i as f64 + 0.3, j as f64 + 0.3)[0] - truth).abs() < 1e-6, "({i}, {j})");
            }
        }
    }

    #[test]
    fn the_path_runs_through_the_middles_of_its_cells() {
        let black = [[0.0; 4].as_slice(); 3];
        let with = MatrixPlot { path: vec![[0.0, 0.0], [1.0, 1.0], [1.0, 2.0], [2.0, 3.0]], ..plot() };
        let at = drawn(&with, &black);
        for [i, j] in with.path {
            assert!(at(i + 0.5, j + 0.5)[0] > 0.9, "({i}, {j})");
        }
        assert!(at(1.5, 2.0)[0] > 0.9 && at(0.5, 3.5)[0] == 0.0 && at(2.5, 0.5)[0] == 0.0);
    }

    #[test]
    fn retime_pins_and_what_is_shut_are_drawn() {
        let black = [[0.0; 4].as_slice(); 3];
        let map = drawn(&MatrixPlot { map: vec![2.0, 2.0, 0.5], ..plot() }, &black);
        let orange = hex(MAP);
        assert!((map(0.25, 2.5)[1] - orange[1]).abs() < 0.01 && (map(1.75, 2.5)[1] - orange[1]).abs() < 0.01);
        assert!((map(2.5, 1.0)[1] - orange[1]).abs() < 0.01);
        let shut = drawn(&MatrixPlot { window: vec![[0, 1], [1, 2], [1, 0]], ..plot() }, &black);
        let veil = |i: f64, j: f64| shut(i + 0.5, j + 0.5)[0] > 0.1;
        assert_eq!([veil(0.0, 0.0), veil(0.0, 2.0), veil(1.0, 0.0), veil(1.0, 1.0), veil(1.0, 3.0)], [false, true, true, false, true]);
        assert!((0..4).all(|j| veil(2.0, f64::from(j))), "nothing gets through the last row");
        let pinned = MatrixPlot { pins: vec![[1.0, 2.0]], ..plot() };
        let (pins, none) = (drawn(&pinned, &black), drawn(&plot(), &black));
        assert!(pins(1.5, 2.5) == none(1.5, 2.5), "a pin is open in its middle");
    }

    #[test]
    fn a_plot_that_is_too_small_says_how_large_it_must_be() {
        let error = matrix_area(&plot(), [3, 3], 20, 20).unwrap_err();
        let PlotError::TooSmall { least_width, least_height, .. } = error else { panic!("{error}") };
        assert!(matrix_area(&plot(), [3, 3], least_width, least_height).is_ok());
    }
}
