//! Lines over frames as SVG: one pair of axes for each panel, coloured by the page's style sheet.

use std::fmt::Write as _;

use pegbar_nodes::algo::plot::{fitted, ticks};

use super::html::{escape, number, point};

/// Size of a panel, and the room left of and below its axes.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 150.0;
const LEFT: f64 = 62.0;
const BOTTOM: f64 = 22.0;
/// Values of a line at most; beyond that each place shows the lowest and highest of its neighbours.
const MOST: usize = 1200;
/// A line of so few values has a dot at each.
const DOTS: usize = 60;

/// Lines that share their axes.
pub(crate) struct Panel {
    pub(crate) label: String,
    /// Name and values of each line, one a place; where one is not finite the line is broken.
    pub(crate) lines: Vec<(String, Vec<f64>)>,
}

/// Panels over the places `x`, which ascend.
pub(crate) fn plot(panels: &[Panel], x: &[f64], x_label: &str) -> String {
    panels.iter().map(|panel| draw(panel, x, x_label)).collect()
}

fn draw(panel: &Panel, x: &[f64], x_label: &str) -> String {
    let (Some(first), Some(last)) = (x.first(), x.last()) else { return String::new() };
    let [low, high] = fitted(panel.lines.iter().flat_map(|(_, y)| y.iter().copied()));
    let across = |v: f64| LEFT + if last > first { (v - first) / (last - first) } else { 0.5 } * (WIDTH - LEFT - 8.0);
    let up = |v: f64| 8.0 + (high - v) / (high - low) * (HEIGHT - BOTTOM - 8.0);
    let mut out = format!("<figure class=\"plot\"><figcaption>{}{}</figcaption>", escape(&panel.label), legend(panel));
    let _ = write!(out, "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\"><title>{}</title>", escape(&panel.label));
    let rows = ticks(low, high, 4, 0.0);
    for (at, label) in rows.at.iter().zip(&rows.labels) {
        let y = up(*at);
        let _ = write!(out, "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{}\"/>", WIDTH - 8.0);
        let _ = write!(out, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>", LEFT - 6.0, y + 3.5, escape(label));
    }
    let columns = ticks(*first, *last, 10, 1.0);
    for (at, label) in columns.at.iter().zip(&columns.labels) {
        let x = across(*at);
        let _ = write!(out, "<path class=\"grid\" d=\"M{x:.1} 8V{}\"/>", HEIGHT - BOTTOM);
        let _ = write!(out, "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>", HEIGHT - 7.0, escape(label));
    }
    let _ = write!(out, "<text x=\"4\" y=\"{}\">{}</text>", HEIGHT - 7.0, escape(x_label));
    for (i, (name, y)) in panel.lines.iter().enumerate() {
        let points: Vec<[f64; 2]> = thinned(x, y).into_iter().map(|[x, y]| [across(x), up(y)]).collect();
        out.push_str(&line(&points, i, name));
    }
    out + "</svg></figure>\n"
}

fn legend(panel: &Panel) -> String {
    if let [(name, _)] = &panel.lines[..]
        && (name.is_empty() || *name == panel.label)
    {
        return String::new();
    }
    let item = |(i, (name, _)): (usize, &(String, Vec<f64>))| format!(" <span class=\"key s{}\">{}</span>", i % 8, escape(name));
    panel.lines.iter().enumerate().map(item).collect()
}

/// A line through points, broken where one is not finite, with dots where there are few.
fn line(points: &[[f64; 2]], colour: usize, name: &str) -> String {
    let (mut path, mut dots, mut is_down) = (String::new(), String::new(), false);
    for p in points {
        if !p[1].is_finite() {
            is_down = false;
            continue;
        }
        point(&mut path, if is_down { 'L' } else { 'M' }, *p);
        is_down = true;
        if points.len() <= DOTS {
            point(&mut dots, 'M', *p);
            dots.push_str("h0");
        }
    }
    let title = escape(name);
    format!("<g class=\"s{}\"><title>{title}</title><path class=\"line\" d=\"{path}\"/><path class=\"dots\" d=\"{dots}\"/></g>", colour % 8)
}

/// At most about [`MOST`] of the points: of each stretch the lowest and the highest.
fn thinned(x: &[f64], y: &[f64]) -> Vec<[f64; 2]> {
    let points: Vec<[f64; 2]> = x.iter().zip(y).map(|(x, y)| [*x, *y]).collect();
    if points.len() <= MOST {
        return points;
    }
    let stretch = points.len().div_ceil(MOST / 2);
    let ends = |group: &[[f64; 2]]| {
        let low = group.iter().enumerate().min_by(|a, b| a.1[1].total_cmp(&b.1[1])).map_or(0, |(i, _)| i);
        let high = group.iter().enumerate().max_by(|a, b| a.1[1].total_cmp(&b.1[1])).map_or(0, |(i, _)| i);
        [group[low.min(high)], group[low.max(high)]]
    };
    points.chunks(stretch).flat_map(ends).collect()
}

/// A path through pairs of numbers, in axes of their own: `x` across and `y` up.
pub(crate) fn path(pairs: &[[f64; 2]], x_label: &str, y_label: &str) -> String {
    let side = 260.0;
    let [x0, x1] = fitted(pairs.iter().map(|p| p[0]));
    let [y0, y1] = fitted(pairs.iter().map(|p| p[1]));
    let across = |v: f64| 46.0 + (v - x0) / (x1 - x0) * (side - 54.0);
    let up = |v: f64| 8.0 + (y1 - v) / (y1 - y0) * (side - 46.0);
    let mut out =
        format!("<figure class=\"plot square\"><svg viewBox=\"0 0 {side} {side}\" role=\"img\"><title>{}</title>", escape(y_label));
    let columns = ticks(x0, x1, 5, 1.0);
    for (at, label) in columns.at.iter().zip(&columns.labels) {
        let x = across(*at);
        let _ = write!(
            out,
            "<path class=\"grid\" d=\"M{x:.1} 8V{}\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{label}</text>",
            side - 38.0,
            side - 24.0
        );
    }
    let rows = ticks(y0, y1, 5, 1.0);
    for (at, label) in rows.at.iter().zip(&rows.labels) {
        let y = up(*at);
        let _ = write!(
            out,
            "<path class=\"grid\" d=\"M46 {y:.1}H{}\"/><text x=\"40\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            side - 8.0,
            y + 3.5
        );
    }
    let _ = write!(out, "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>", side / 2.0, side - 8.0, escape(x_label));
    let points: Vec<[f64; 2]> = pairs.iter().map(|[x, y]| [across(*x), up(*y)]).collect();
    let _ = writeln!(out, "{}</svg><figcaption>{}</figcaption></figure>", line(&points, 0, ""), escape(y_label));
    out
}

/// The ends and the mean of a line, for people.
pub(crate) fn ends(values: &[f64]) -> String {
    let known: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let Some(low) = known.iter().copied().reduce(f64::min) else { return "no finite value".to_owned() };
    let high = known.iter().copied().fold(low, f64::max);
    let mean = known.iter().sum::<f64>() / known.len() as f64;
    format!("{} to {}, mean {}", number(low), number(high), number(mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_where_nothing_is_known_and_keep_their_extremes() {
        let panel = |y: Vec<f64>| [Panel { label: "v".to_owned(), lines: vec![("v".to_owned(), y)] }];
        let x: Vec<f64> = (1..=4).map(f64::from).collect();
        let svg = plot(&panel(vec![1.0, f64::NAN, 2.0, 3.0]), &x, "frame");
        let d = svg.split("class=\"line\" d=\"").nth(1).unwrap().split('"').next().unwrap();
        assert_eq!((d.matches('M').count(), d.matches('L').count()), (2, 1), "{d}");
        let many: Vec<f64> = (0..100_000).map(|i| if i == 77_777 { 9.0 } else { 0.0 }).collect();
        let places: Vec<f64> = (0..100_000).map(f64::from).collect();
        let thin = thinned(&places, &many);
        assert!(thin.len() <= MOST && thin.contains(&[77_777.0, 9.0]), "{}", thin.len());
        assert_eq!(plot(&panel(Vec::new()), &[], "frame"), "");
        assert_eq!(ends(&[1.0, f64::NAN, 3.0]), "1 to 3, mean 2");
    }
}
