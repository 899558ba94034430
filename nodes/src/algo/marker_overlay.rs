//! Labelled markers over a picture: sets of their own colours and shapes, limbs, lines from one set to another, names that keep clear of each other.
//!
//! Every line and mark has a rim, light about dark colours and dark about light ones, so that it shows on any drawing.

use kurbo::{Affine, BezPath, Point, Shape as _, Vec2};
use pegbar_engine::Setting;
use serde::Deserialize;

use super::grid::{dot, polyline};
use super::paint::{Canvas, FillRule, hex, text_outline, text_width};
use super::plot::{dashes, shortened};

/// How a marker looks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MarkerShape {
    /// A disc.
    #[default]
    Dot,
    /// A circle.
    Ring,
    /// Two strokes across each other.
    Cross,
    /// A box.
    Square,
}

/// In turn, for sets of no given shape.
pub const SHAPES: [MarkerShape; 4] = [MarkerShape::Dot, MarkerShape::Ring, MarkerShape::Cross, MarkerShape::Square];

/// Where something small stands in a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Corner {
    /// At the top, to the left.
    #[default]
    TopLeft,
    /// At the top, to the right.
    TopRight,
    /// At the bottom, to the left.
    BottomLeft,
    /// At the bottom, to the right.
    BottomRight,
    /// Nowhere.
    None,
}

/// Markers of one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkerSet {
    /// What the legend calls it; nothing keeps it out of it.
    pub label: String,
    /// Pixels of the canvas; NaN where a marker is not seen.
    pub points: Vec<[f64; 2]>,
    /// A name for each, or none at all.
    pub names: Vec<String>,
    /// Positions of the markers between which limbs are drawn, from and to.
    pub limbs: Vec<[usize; 2]>,
    /// Linear and premultiplied, opaque.
    pub colour: [f32; 4],
    /// How each looks.
    pub shape: MarkerShape,
}

/// Lines from markers of one set to those of another.
#[derive(Clone, Debug, PartialEq)]
pub struct Errors {
    /// Positions of the two sets.
    pub sets: [usize; 2],
    /// Positions of markers that go together.
    pub pairs: Vec<[usize; 2]>,
}

/// All that is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlay {
    /// The first lies at the bottom.
    pub sets: Vec<MarkerSet>,
    /// Lines between sets.
    pub errors: Vec<Errors>,
    /// Positions of set and marker whose names are written.
    pub named: Vec<[usize; 2]>,
    /// Size of a marker, pixels.
    pub size: f64,
    /// Width of limbs; 0 draws none.
    pub limb_width: f64,
    /// Width of the lines between sets.
    pub error_width: f64,
    /// Where the legend stands.
    pub legend: Corner,
    /// Height of a capital.
    pub text: f64,
}

/// The distances along the lines between two sets: mean, largest, and of which pair; `None` where none is seen in both.
pub fn distances(from: &MarkerSet, to: &MarkerSet, pairs: &[[usize; 2]]) -> Option<(f64, f64, usize)> {
    let length = |[a, b]: &[usize; 2]| libm::hypot(to.points[*b][0] - from.points[*a][0], to.points[*b][1] - from.points[*a][1]);
    let seen: Vec<(usize, f64)> = pairs.iter().map(length).enumerate().filter(|(_, d)| d.is_finite()).collect();
    let (at, most) = seen.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    Some((seen.iter().map(|(_, d)| d).sum::<f64>() / seen.len() as f64, most, at))
}

/// The limbs whose outer end is seen, each from the nearest marker above that is seen, and whether one between is not.
pub fn bridged(limbs: &[[usize; 2]], points: &[[f64; 2]]) -> Vec<([usize; 2], bool)> {
    let seen = |k: usize| points.get(k).is_some_and(|p| p.iter().all(|v| v.is_finite()));
    let one = |limb: &[usize; 2]| {
        let [mut from, to] = *limb;
        let mut steps = 0;
        // Limbs in a ring lead nowhere: no way is longer than their number.
        while !seen(from) && steps < limbs.len() {
            from = limbs.iter().find(|l| l[1] == from)?[0];
            steps += 1;
        }
        (seen(from) && seen(to) && from != to).then_some(([from, to], steps > 0))
    };
    limbs.iter().filter_map(one).collect()
}

/// Whether black or white stands out against a colour.
fn rim([r, g, b, _]: [f32; 4]) -> [f32; 4] {
    let light = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    if light > 0.25 { hex(0x10_10_10) } else { hex(0xFF_FF_FF) }.map(|v| v * 0.85)
}

/// Draws all on `data`, `width` by `height` pixels of four channels, linear and premultiplied. Cost: O(length of the lines + named markers squared).
///
/// # Errors
/// Where `data` is of another length.
pub fn draw(overlay: &Overlay, data: &mut [f32], width: usize, height: usize) -> Result<(), super::paint::PaintError> {
    let mut painter = Painter { overlay, canvas: Canvas::new(data, width, height)?, size: [width as f64, height as f64] };
    overlay.sets.iter().for_each(|set| painter.limbs(set));
    overlay.errors.iter().for_each(|errors| painter.errors(errors));
    for set in &overlay.sets {
        let points: Vec<Point> = (0..set.points.len()).filter_map(|k| painter.at(set, k)).collect();
        points.into_iter().for_each(|p| painter.marker(set, p, overlay.size));
    }
    painter.names();
    painter.legend();
    Ok(())
}

struct Painter<'a, 'b> {
    overlay: &'a Overlay,
    canvas: Canvas<'b>,
    size: [f64; 2],
}

impl Painter<'_, '_> {
    /// Where a marker is; what is far out is on no picture, and costs time.
    fn at(&self, set: &MarkerSet, k: usize) -> Option<Point> {
        let [x, y] = set.points[k];
        (x.abs() < 1e5 && y.abs() < 1e5).then_some(Point::new(x, y))
    }

    fn rimmed(&mut self, path: &BezPath, width: f64, colour: [f32; 4]) {
        self.canvas.line(path, width + 1.6, rim(colour).map(|v| v * 0.7));
        self.canvas.line(path, width, colour);
    }

    fn limbs(&mut self, set: &MarkerSet) {
        let width = self.overlay.limb_width;
        for ([from, to], is_bridge) in bridged(&set.limbs, &set.points) {
            if let (Some(a), Some(b), true) = (self.at(set, from), self.at(set, to), width > 0.0) {
                let dash = (2.5 * width).max(3.0);
                let path = if is_bridge { dashes(a, b, dash) } else { polyline(&[a, b], false) };
                self.rimmed(&path, if is_bridge { width * 0.7 } else { width }, set.colour);
            }
        }
    }

    fn errors(&mut self, errors: &Errors) {
        let [from, to] = errors.sets.map(|k| &self.overlay.sets[k]);
        for [a, b] in &errors.pairs {
            if let (Some(p), Some(q)) = (self.at(from, *a), self.at(to, *b)) {
                self.rimmed(&polyline(&[p, q], false), self.overlay.error_width, hex(0xD0_00_50));
            }
        }
    }

    fn marker(&mut self, set: &MarkerSet, p: Point, size: f64) {
        let (half, pen) = (size / 2.0, (size * 0.2).max(1.2));
        let line = |a: Vec2| polyline(&[p - a, p + a], false);
        match set.shape {
            MarkerShape::Dot | MarkerShape::Square => {
                let shape = |half: f64| match set.shape {
                    MarkerShape::Dot => dot(p, 2.0 * half),
                    _ => kurbo::Rect::from_center_size(p, (2.0 * half, 2.0 * half)).to_path(1e-3),
                };
                // A square of the same area as the disc.
                let half = if set.shape == MarkerShape::Dot { half } else { half * 0.886 };
                self.canvas.fill(&shape(half + 1.0), FillRule::NonZero, rim(set.colour));
                self.canvas.fill(&shape(half), FillRule::NonZero, set.colour);
            }
            // As large as a disc with its rim, so that what lies in it is seen.
            MarkerShape::Ring => self.rimmed(&dot(p, size * 1.2), pen, set.colour),
            MarkerShape::Cross => {
                let mut cross = line(Vec2::new(half, half) * 0.8);
                cross.extend(line(Vec2::new(half, -half) * 0.8).iter());
                self.rimmed(&cross, pen, set.colour);
            }
        }
    }

    fn write(&mut self, text: &str, at: Point, has_halo: bool) {
        let t = self.overlay.text;
        let place = Affine::translate((at.x, at.y));
        if has_halo {
            self.canvas.fill(&(place * text_outline(text, t, t * 0.5)), FillRule::NonZero, [0.88; 4]);
        }
        self.canvas.fill(&(place * text_outline(text, t, t / 7.0)), FillRule::NonZero, hex(0x14_14_14));
    }

    fn names(&mut self) {
        let (overlay, t) = (self.overlay, self.overlay.text);
        let is_in = |p: &Point| p.x >= 0.0 && p.y >= 0.0 && p.x <= self.size[0] && p.y <= self.size[1];
        let named = |[set, k]: &[usize; 2]| {
            let set = &overlay.sets[*set];
            Some((self.at(set, *k).filter(is_in)?, set.names.get(*k)?.clone()))
        };
        let named: Vec<(Point, String)> = overlay.named.iter().filter_map(named).collect();
        let all = overlay.sets.iter().flat_map(|s| (0..s.points.len()).filter_map(|k| self.at(s, k)));
        let marks: Vec<Point> = all.collect();
        let wide: Vec<(Point, f64)> = named.iter().map(|(p, name)| (*p, text_width(name, t))).collect();
        let places = placed(&wide, &marks, t, overlay.size, self.size);
        for ((p, _), [left, top]) in named.iter().zip(&places) {
            let width = wide.iter().find(|w| w.0 == *p).map_or(0.0, |w| w.1);
            let near = Point::new(p.x.clamp(*left, left + width), p.y.clamp(*top, top + t));
            if near.distance(*p) > overlay.size + t {
                self.canvas.line(&polyline(&[*p, near], false), 1.0, hex(0x40_40_40));
            }
        }
        for ((_, name), [left, top]) in named.iter().zip(&places) {
            self.write(name, Point::new(*left, top + t), true);
        }
    }

    /// How long the lines between two sets are; what each set is called, and what is missing of it.
    fn entries(&self) -> Vec<(Option<usize>, String)> {
        let sets = &self.overlay.sets;
        let mut out = Vec::new();
        // The longest stand at the edge.
        for errors in &self.overlay.errors {
            let [from, to] = errors.sets.map(|k| &sets[k]);
            let found = distances(from, to, &errors.pairs);
            let said = found.map_or("none seen in both".to_owned(), |(mean, most, at)| {
                let name = from.names.get(errors.pairs[at][0]).map_or(String::new(), |n| format!(" ({n})"));
                format!("mean {mean:.1} px, largest {most:.1} px{name}")
            });
            out.push((None, format!("{} to {}: {said}", from.label, to.label)));
        }
        for (k, set) in sets.iter().enumerate().filter(|(_, s)| !s.label.is_empty()) {
            let missing = set.points.iter().filter(|p| p.iter().any(|v| !v.is_finite())).count();
            let outside = |p: &&[f64; 2]| (0..2).all(|i| p[i].is_finite()) && (0..2).any(|i| !(0.0..=self.size[i]).contains(&p[i]));
            let outside = set.points.iter().filter(outside).count();
            let said = |n: usize, what: &str| if n > 0 { format!(", {n} {what}") } else { String::new() };
            out.push((Some(k), format!("{}{}{}", set.label, said(missing, "not seen"), said(outside, "outside"))));
        }
        out
    }

    fn legend(&mut self) {
        let (t, entries) = (self.overlay.text, self.entries());
        let corner = self.overlay.legend;
        if entries.is_empty() || corner == Corner::None {
            return;
        }
        let [width, height] = self.size;
        let room = (width - 7.0 * t).max(0.0);
        let is_left = matches!(corner, Corner::TopLeft | Corner::BottomLeft);
        let is_top = matches!(corner, Corner::TopLeft | Corner::TopRight);
        for (i, (set, text)) in entries.iter().enumerate() {
            let text = shortened(text, room, t);
            let wide = text_width(&text, t) + 5.0 * t;
            let left = if is_left { t } else { width - t - wide };
            // Rows count from the edge, so that the picture's middle is left to the short ones.
            let y = if is_top { (2.0 + 2.0 * i as f64) * t } else { height - (2.0 + 2.0 * i as f64) * t };
            let ground = kurbo::Rect::new(left, y - t, left + wide, y + t).to_path(1e-3);
            self.canvas.fill(&ground, FillRule::NonZero, [0.85; 4]);
            let line = polyline(&[Point::new(left + 0.8 * t, y), Point::new(left + 3.2 * t, y)], false);
            match set {
                Some(k) => {
                    let set = &self.overlay.sets[*k];
                    if self.overlay.limb_width > 0.0 && !set.limbs.is_empty() {
                        self.rimmed(&line, self.overlay.limb_width.min(0.5 * t), set.colour);
                    }
                    self.marker(set, Point::new(left + 2.0 * t, y), self.overlay.size.min(1.2 * t));
                }
                None => self.rimmed(&line, self.overlay.error_width.min(0.5 * t), hex(0xD0_00_50)),
            }
            self.write(&text, Point::new(left + 4.2 * t, y + t / 2.0), false);
        }
    }
}

/// How much two boxes of left, top, right, bottom have in common.
fn common(a: [f64; 4], b: [f64; 4]) -> f64 {
    (a[2].min(b[2]) - a[0].max(b[0])).max(0.0) * (a[3].min(b[3]) - a[1].max(b[1])).max(0.0)
}

/// Left and top of each name, given by its marker and its width, near the marker: where it covers least of names before it, then of markers, then lies nearest.
///
/// Cost: O(names · (names + marks)).
fn placed(names: &[(Point, f64)], marks: &[Point], t: f64, size: f64, picture: [f64; 2]) -> Vec<[f64; 2]> {
    const ROUND: [[f64; 2]; 8] = [[1.0, 0.0], [-1.0, 0.0], [1.0, -1.0], [-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [0.0, -1.0], [0.0, 1.0]];
    let mut taken: Vec<[f64; 4]> = Vec::new();
    for (p, wide) in names {
        let candidate = |k: usize| {
            let ([x, y], gap) = (ROUND[k % 8], size / 2.0 + 3.0 + (k / 8) as f64 * 1.6 * t);
            let left = p.x + x * gap - wide * (1.0 - x) / 2.0;
            let top = p.y + y * gap - t * (1.0 - y) / 2.0;
            // Nothing is written beyond the edge of the picture.
            let inside = |v: f64, extent: f64, most: f64| v.min(most - extent - 1.0).max(1.0);
            let (left, top) = (inside(left, *wide, picture[0]), inside(top, t, picture[1]));
            [left, top, left + wide, top + t]
        };
        let price = |b: [f64; 4]| {
            let wider = [b[0] - 0.4 * t, b[1] - 0.4 * t, b[2] + 0.4 * t, b[3] + 0.4 * t];
            let names: f64 = taken.iter().map(|o| common(wider, *o)).sum();
            let half = size / 2.0 + 1.0;
            let marks: f64 = marks.iter().map(|m| common(b, [m.x - half, m.y - half, m.x + half, m.y + half])).sum();
            10.0 * names + 2.0 * marks
        };
        let far = |k: usize| (k / 8) as f64 * 2.0 * t + (k % 8) as f64 * 0.1;
        let best = (0..40).map(|k| (price(candidate(k)) + far(k), k)).fold((f64::INFINITY, 0), |a, b| if b.0 < a.0 { b } else { a });
        taken.push(candidate(best.1));
    }
    taken.iter().map(|b| [b[0], b[1]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: [f64; 2] = [f64::NAN; 2];

    fn set(points: &[[f64; 2]], shape: MarkerShape) -> MarkerSet {
        let names = (0..points.len()).map(|k| format!("m{k}")).collect();
        MarkerSet { label: String::new(), points: points.to_vec(), names, limbs: Vec::new(), colour: hex(0x0072B2), shape }
    }

    fn overlay(sets: Vec<MarkerSet>) -> Overlay {
        Overlay {
            sets,
            errors: Vec::new(),
            named: Vec::new(),
            size: 8.0,
            limb_width: 2.0,
            error_width: 2.0,
            legend: Corner::None,
            text: 8.0,
        }
    }

    const SIZE: [usize; 2] = [80, 60];

    fn drawn(overlay: &Overlay) -> Vec<f32> {
        let mut data = vec![0.0; SIZE[0] * SIZE[1] * 4];
        draw(overlay, &mut data, SIZE[0], SIZE[1]).unwrap();
        data
    }

    fn pixel(data: &[f32], x: usize, y: usize) -> [f32; 4] {
        data[(y * SIZE[0] + x) * 4..][..4].try_into().unwrap()
    }

    #[test]
    fn markers_lie_at_their_places() {
        let blue = hex(0x0072B2);
        for shape in SHAPES {
            let data = drawn(&overlay(vec![set(&[[20.5, 30.5], NAN, [1e300, 0.0]], shape)]));
            let is_open = shape == MarkerShape::Ring;
            assert_eq!(pixel(&data, 20, 30), if is_open { [0.0; 4] } else { blue }, "{shape:?}");
            // Mean of all that is drawn: shapes and rims are even about their middles.
            let cover = |k: usize| f64::from(data[4 * k + 3]);
            let total: f64 = (0..SIZE[0] * SIZE[1]).map(cover).sum();
            let x = (0..SIZE[0] * SIZE[1]).map(|k| cover(k) * ((k % SIZE[0]) as f64 + 0.5)).sum::<f64>() / total;
            let y = (0..SIZE[0] * SIZE[1]).map(|k| cover(k) * ((k / SIZE[0]) as f64 + 0.5)).sum::<f64>() / total;
            assert!((x - 20.5).abs() < 0.01 && (y - 30.5).abs() < 0.01, "{shape:?}: found {x}, {y}");
        }
    }

    #[test]
    fn limbs_reach_over_what_is_not_seen() {
        let limbs = [[0, 1], [1, 2], [2, 3]];
        let at = |k: usize| [10.0 * k as f64, 5.0];
        assert_eq!(bridged(&limbs, &[at(0), at(1), at(2), at(3)]), [([0, 1], false), ([1, 2], false), ([2, 3], false)]);
        assert_eq!(bridged(&limbs, &[at(0), NAN, NAN, at(3)]), [([0, 3], true)]);
        assert_eq!(bridged(&limbs, &[NAN, at(1), at(2), NAN]), [([1, 2], false)]);
        assert_eq!(bridged(&[[0, 1], [1, 0]], &[NAN, at(1)]), [], "a ring ends");
        assert_eq!(bridged(&[[0, 7]], &[at(0)]), []);
    }

    #[test]
    fn a_bridge_is_dashed_and_a_limb_is_whole() {
        let line = |points: &[[f64; 2]]| {
            let mut set = set(points, MarkerShape::Dot);
            set.limbs = vec![[0, 1], [1, 2]];
            let data = drawn(&Overlay { size: 1.0, ..overlay(vec![set]) });
            (14..66).map(|x| pixel(&data, x, 30)[3]).collect::<Vec<f32>>()
        };
        assert!(line(&[[10.0, 30.5], [40.0, 30.5], [70.0, 30.5]]).iter().all(|a| *a > 0.99));
        let dashed = line(&[[10.0, 30.5], NAN, [70.0, 30.5]]);
        assert!(dashed.iter().any(|a| *a < 0.01) && dashed.iter().any(|a| *a > 0.9));
    }

    #[test]
    fn lines_between_sets_are_measured() {
        let (a, b) =
            (set(&[[0.0, 0.0], [10.0, 0.0], NAN], MarkerShape::Dot), set(&[[3.0, 4.0], [10.0, 11.0], [1.0, 1.0]], MarkerShape::Ring));
        assert_eq!(distances(&a, &b, &[[0, 0], [1, 1], [2, 2]]), Some((8.0, 11.0, 1)));
        assert_eq!(distances(&a, &b, &[[2, 2]]), None);
        let line = Overlay {
            errors: vec![Errors { sets: [0, 1], pairs: vec![[0, 0]] }],
            ..overlay(vec![set(&[[10.0, 30.5]], MarkerShape::Dot), set(&[[70.0, 30.5]], MarkerShape::Dot)])
        };
        assert_eq!(pixel(&drawn(&line), 40, 30), hex(0xD0_00_50));
    }

    #[test]
    fn names_keep_clear_of_each_other_and_stay_in_the_picture() {
        let names: Vec<(Point, f64)> =
            (0..12).map(|k| (Point::new(100.0 + 6.0 * f64::from(k % 4), 100.0 + 6.0 * f64::from(k / 4)), 50.0)).collect();
        let marks: Vec<Point> = names.iter().map(|n| n.0).collect();
        let places = placed(&names, &marks, 8.0, 6.0, [300.0, 240.0]);
        let boxes: Vec<[f64; 4]> = places.iter().map(|[x, y]| [*x, *y, x + 50.0, y + 8.0]).collect();
        for (i, a) in boxes.iter().enumerate() {
            assert!(boxes[..i].iter().all(|b| common(*a, *b) == 0.0), "name {i} covers another");
            assert!(a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= 300.0 && a[3] <= 240.0);
        }
        let edge = placed(&[(Point::new(299.0, 1.0), 50.0)], &[], 8.0, 6.0, [300.0, 240.0]);
        assert!(edge[0][0] + 50.0 <= 300.0 && edge[0][1] >= 0.0);
    }

    #[test]
    fn the_legend_says_what_is_missing() {
        let mut labelled = set(&[[1.0, 1.0], NAN, [-5.0, 3.0]], MarkerShape::Dot);
        labelled.label = "drawn".to_owned();
        let mut other = set(&[[4.0, 5.0]], MarkerShape::Ring);
        other.label = "lifted".to_owned();
        let overlay = Overlay {
            errors: vec![Errors { sets: [0, 1], pairs: vec![[0, 0]] }],
            legend: Corner::TopLeft,
            ..overlay(vec![labelled, other])
        };
        let mut data = vec![0.0; 400];
        let painter = Painter { overlay: &overlay, canvas: Canvas::new(&mut data, 10, 10).unwrap(), size: [10.0, 10.0] };
        let texts: Vec<String> = painter.entries().into_iter().map(|e| e.1).collect();
        assert_eq!(texts, ["drawn to lifted: mean 5.0 px, largest 5.0 px (m0)", "drawn, 1 not seen, 1 outside", "lifted"]);
        assert!(drawn(&overlay).iter().all(|v| v.is_finite()));
    }
}
