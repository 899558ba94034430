//! SVG drawings written: straight outlines with their paint, in groups; one drawing, or one layer a frame.

use std::fmt::Write as _;

use super::{Point, Style};
use crate::algo::paint::FillRule;

/// One outline to be written.
#[derive(Clone, Debug)]
pub struct Outline<'a> {
    /// Its name; empty for none.
    pub name: &'a str,
    /// Names of the groups that it is in, from outside.
    pub groups: &'a [String],
    /// Its place among all outlines.
    pub depth: f64,
    /// Points of each line, and whether it is closed.
    pub lines: Vec<(&'a [Point], bool)>,
    /// How it is painted.
    pub style: Style,
}

/// What one layer shows.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    /// Name of the layer; `None` for a drawing without layers.
    pub layer: Option<String>,
    /// Outlines, the first at the bottom.
    pub outlines: Vec<Outline<'a>>,
}

/// How layers are shown one after the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// Frames a second.
    pub fps: f64,
}

/// Text that may stand in an attribute.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\n' | '\r' | '\t' => drop(write!(out, "&#{};", u32::from(c))),
            // XML has no way to say other control characters.
            c if c < ' ' || matches!(c, '\u{FFFE}' | '\u{FFFF}') => out.push('\u{FFFD}'),
            c => out.push(c),
        }
    }
    out
}

/// A colour in eight bits a channel, and its opacity.
fn colour(name: &str, [r, g, b, a]: [f64; 4]) -> String {
    if a <= 0.0 {
        return format!(" {name}=\"none\"");
    }
    let byte = |v: f64| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let opacity = if a < 1.0 { format!(" {name}-opacity=\"{a}\"") } else { String::new() };
    format!(" {name}=\"#{:02x}{:02x}{:02x}\"{opacity}", byte(r), byte(g), byte(b))
}

fn path_data(lines: &[(&[Point], bool)]) -> String {
    let mut data = String::new();
    for (points, closed) in lines.iter().filter(|(points, _)| !points.is_empty()) {
        for (i, [x, y]) in points.iter().enumerate() {
            let _ = write!(data, "{}{x} {y}", ["L", "M"][usize::from(i == 0)]);
        }
        if *closed {
            // A last point that lies on the first would be taken for the closing line's, were it not for one more.
            let near = |a: f64, b: f64| (a - b).abs() < 1e-4;
            if let ([[x, y], .., last], true) = (points, points.len() > 1)
                && near(*x, last[0])
                && near(*y, last[1])
            {
                let _ = write!(data, "L{x} {y}");
            }
            data.push('Z');
        }
    }
    data
}

fn outline(out: &mut String, o: &Outline, idx: usize, indent: usize) {
    let name = if o.name.is_empty() { String::new() } else { format!(" inkscape:label=\"{}\"", escaped(o.name)) };
    let depth = if o.depth == idx as f64 { String::new() } else { format!(" data-depth=\"{}\"", o.depth) };
    let rule = if o.style.rule == FillRule::EvenOdd { " fill-rule=\"evenodd\"" } else { "" };
    let mut line = String::new();
    if o.style.stroke[3] > 0.0 {
        line = format!(" stroke-width=\"{}\" stroke-linecap=\"round\" stroke-linejoin=\"round\"", o.style.width);
    }
    let (fill, stroke) = (colour("fill", o.style.fill), colour("stroke", o.style.stroke));
    let data = path_data(&o.lines);
    let _ = writeln!(out, "{:indent$}<path{name}{depth}{fill}{rule}{stroke}{line} d=\"{data}\"/>", "");
}

/// Outlines within their groups. Neighbours share the groups that they have in common.
fn outlines(out: &mut String, all: &[Outline], mut idx: usize, indent: usize) -> usize {
    let mut open: &[String] = &[];
    for o in all {
        let common = open.iter().zip(o.groups).take_while(|(a, b)| a == b).count();
        for k in (common..open.len()).rev() {
            let _ = writeln!(out, "{:1$}</g>", "", indent + 2 * k);
        }
        for (k, group) in o.groups.iter().enumerate().skip(common) {
            let _ = writeln!(out, "{:2$}<g inkscape:label=\"{1}\">", "", escaped(group), indent + 2 * k);
        }
        open = o.groups;
        outline(out, o, idx, indent + 2 * open.len());
        idx += 1;
    }
    for k in (0..open.len()).rev() {
        let _ = writeln!(out, "{:1$}</g>", "", indent + 2 * k);
    }
    idx
}

/// A drawing of this size, in one layer a frame where they have names. With `playback` the layers are shown in turn, again and again.
pub fn write([w, h]: [f64; 2], frames: &[Frame], playback: Option<Playback>) -> String {
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\"");
    let _ = writeln!(
        out,
        " xmlns:inkscape=\"http://www.inkscape.org/namespaces/inkscape\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">"
    );
    let mut idx = 0;
    for (k, frame) in frames.iter().enumerate() {
        let Some(layer) = &frame.layer else {
            idx = outlines(&mut out, &frame.outlines, idx, 2);
            continue;
        };
        let display = if k == 0 { "inline" } else { "none" };
        let _ = writeln!(out, "  <g inkscape:groupmode=\"layer\" inkscape:label=\"{}\" display=\"{display}\">", escaped(layer));
        if let Some(Playback { fps }) = playback {
            out += &animation(k, frames.len(), fps);
        }
        idx = outlines(&mut out, &frame.outlines, idx, 4);
        out += "  </g>\n";
    }
    out + "</svg>\n"
}

/// What shows layer `k` of `n` for its frame alone.
fn animation(k: usize, n: usize, fps: f64) -> String {
    let at = |k: usize| k as f64 / n as f64;
    let (mut values, mut times) = (String::from("none"), String::from("0"));
    if k == 0 {
        values = "inline".to_owned();
    } else {
        let _ = (write!(values, ";inline"), write!(times, ";{}", at(k)));
    }
    if k + 1 < n {
        let _ = (write!(values, ";none"), write!(times, ";{}", at(k + 1)));
    }
    let seconds = n as f64 / fps;
    format!(
        "    <animate attributeName=\"display\" calcMode=\"discrete\" dur=\"{seconds}s\" repeatCount=\"indefinite\" values=\"{values}\" keyTimes=\"{times}\"/>\n"
    )
}
