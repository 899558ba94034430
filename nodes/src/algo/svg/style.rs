//! What outlines look like: presentation attributes, inline styles and simple style sheets.
//!
//! **Source** W3C, Scalable Vector Graphics 1.1, chapters 6 (styling) and 11 (painting); Cascading Style Sheets 2.1, chapters 5 and 6.

use std::collections::BTreeMap;

use roxmltree::Node;
use svgtypes::{Color, Paint, PaintFallback};

use super::{Reader, SvgError};
use crate::algo::paint::FillRule;

/// How one outline is painted.
#[derive(Clone, Debug, PartialEq)]
pub struct Style {
    /// Red, green, blue and opacity of its inside, as on screen, 0 to 1; the opacity is 0 where it is not filled.
    pub fill: [f64; 4],
    /// The same of its line.
    pub stroke: [f64; 4],
    /// Width of its line, pixels.
    pub width: f64,
    /// What is inside.
    pub rule: FillRule,
}

/// What an element takes over from those around it.
#[derive(Clone, Debug)]
pub(super) struct State {
    fill: Option<[f64; 4]>,
    stroke: Option<[f64; 4]>,
    colour: [f64; 4],
    fill_opacity: f64,
    stroke_opacity: f64,
    /// The product of the opacities of all groups around.
    opacity: f64,
    width: f64,
    rule: FillRule,
    visible: bool,
    pub(super) displayed: bool,
}

impl Default for State {
    fn default() -> Self {
        let black = [0.0, 0.0, 0.0, 1.0];
        Self {
            fill: Some(black),
            stroke: None,
            colour: black,
            fill_opacity: 1.0,
            stroke_opacity: 1.0,
            opacity: 1.0,
            width: 1.0,
            rule: FillRule::NonZero,
            visible: true,
            displayed: true,
        }
    }
}

fn rgba(c: Color) -> [f64; 4] {
    [c.red, c.green, c.blue, c.alpha].map(|v| f64::from(v) / 255.0)
}

/// The properties that are looked at.
const PROPERTIES: [&str; 11] = [
    "fill",
    "stroke",
    "color",
    "fill-opacity",
    "stroke-opacity",
    "opacity",
    "stroke-width",
    "fill-rule",
    "visibility",
    "display",
    "stop-color",
];

/// `name: value` pairs of a style.
fn declarations(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.split(';').filter_map(|d| d.split_once(':')).map(|(name, value)| (name.trim(), value.trim().trim_end_matches("!important").trim()))
}

/// The rules of a drawing's style sheets: selector and declarations.
#[derive(Debug, Default)]
pub(super) struct Sheet(Vec<(String, String)>);

impl Sheet {
    pub(super) fn add(&mut self, css: &str) {
        let mut plain = String::new();
        for (i, part) in css.split("/*").enumerate() {
            plain += if i == 0 { part } else { part.split_once("*/").map_or("", |(_, rest)| rest) };
        }
        for rule in plain.split('}') {
            let Some((selectors, body)) = rule.split_once('{') else { continue };
            self.0.extend(selectors.split(',').map(|s| (s.trim().to_owned(), body.trim().to_owned())));
        }
    }

    /// The declarations for an element, the weakest first. Selectors are those of one element: a type, classes, an id.
    fn of(&self, node: Node) -> Vec<&str> {
        let mut found: Vec<(u32, &str)> = self.0.iter().filter_map(|(s, body)| Some((strength(s, node)?, body.as_str()))).collect();
        found.sort_by_key(|(strength, _)| *strength);
        found.into_iter().map(|(_, body)| body).collect()
    }
}

/// How specific a selector is; `None` where it is not of this element, or of a kind that is not read.
fn strength(selector: &str, node: Node) -> Option<u32> {
    if selector.is_empty() || selector.contains([' ', '>', '+', '~', ':', '[', '@']) {
        return None;
    }
    let starts = |i: usize| i == 0 || selector[i..].starts_with(['.', '#']);
    let cuts: Vec<usize> = selector.char_indices().map(|(i, _)| i).filter(|&i| starts(i)).collect();
    let ends = cuts.iter().skip(1).copied().chain([selector.len()]);
    let mut sum = 0;
    for (from, to) in cuts.iter().copied().zip(ends) {
        let part = &selector[from..to];
        sum += match (part.strip_prefix('.'), part.strip_prefix('#')) {
            (Some(class), _) => node.attribute("class")?.split_whitespace().any(|c| c == class).then_some(100)?,
            (_, Some(id)) => (node.attribute("id")? == id).then_some(10_000)?,
            _ if part == "*" => 0,
            _ => (node.tag_name().name() == part).then_some(1)?,
        };
    }
    Some(sum)
}

/// What an element says of each property, the strongest last: attributes, sheets, its own style.
pub(super) fn said<'a>(reader: &'a Reader, node: Node<'a, 'a>) -> Vec<(&'a str, &'a str)> {
    let attributes = PROPERTIES.iter().filter_map(|name| Some((*name, node.attribute(*name)?)));
    let sheets = reader.sheet.of(node).into_iter().flat_map(declarations);
    attributes.chain(sheets).chain(declarations(node.attribute("style").unwrap_or_default())).collect()
}

impl State {
    /// The state inside an element.
    pub(super) fn inside(&self, reader: &Reader, node: Node) -> Result<State, SvgError> {
        // Whether it is displayed is told by the element, not by what is around it.
        let mut own = State { displayed: true, ..self.clone() };
        let mut opacity = 1.0;
        let all = said(reader, node);
        // A colour of its own is what `currentColor` means in the element already.
        let colours = all.iter().filter(|(name, _)| *name == "color");
        for (name, value) in colours.chain(all.iter().filter(|(name, _)| *name != "color")) {
            let share = || reader.share(node, name, value);
            match *name {
                _ if *value == "inherit" => {}
                "color" => own.colour = reader.paint(node, name, value, self.colour)?.unwrap_or(self.colour),
                "fill" => own.fill = reader.paint(node, name, value, own.colour)?,
                "stroke" => own.stroke = reader.paint(node, name, value, own.colour)?,
                "fill-opacity" => own.fill_opacity = share()?,
                "stroke-opacity" => own.stroke_opacity = share()?,
                "opacity" => opacity = share()?,
                "stroke-width" => own.width = reader.width(node, name, value)?,
                "fill-rule" => own.rule = if *value == "evenodd" { FillRule::EvenOdd } else { FillRule::NonZero },
                "visibility" => own.visible = *value == "visible",
                "display" => own.displayed = *value != "none",
                _ => {}
            }
        }
        own.opacity *= opacity;
        Ok(own)
    }

    /// How an outline is painted, its line `scale` times as wide; `None` where it is not seen.
    pub(super) fn style(&self, scale: f64) -> Option<Style> {
        let paint = |colour: Option<[f64; 4]>, opacity: f64| {
            let seen = colour.map(|[r, g, b, a]| [r, g, b, a * opacity * self.opacity]);
            seen.filter(|c| c[3] > 0.0).unwrap_or_default()
        };
        let (fill, stroke) = (paint(self.fill, self.fill_opacity), paint(self.stroke, self.stroke_opacity));
        let width = if stroke[3] > 0.0 { self.width * scale } else { 0.0 };
        self.visible.then_some(Style { fill, stroke, width, rule: self.rule })
    }
}

impl Reader<'_> {
    fn share(&self, node: Node, name: &str, value: &str) -> Result<f64, SvgError> {
        let (text, scale) = value.strip_suffix('%').map_or((value, 1.0), |v| (v, 0.01));
        let number = text.trim().parse::<svgtypes::Number>().map_err(|_| self.wrong(node, name, "a number from 0 to 1", value))?;
        Ok((number.0 * scale).clamp(0.0, 1.0))
    }

    /// A colour; `None` for none at all. A gradient is the mean of its colours, which flat paint comes nearest to it with.
    fn paint(&self, node: Node, name: &str, value: &str, current: [f64; 4]) -> Result<Option<[f64; 4]>, SvgError> {
        let paint = Paint::from_str(value).map_err(|_| self.wrong(node, name, "a colour, `none` or `url(#id)`", value))?;
        Ok(match paint {
            Paint::None => None,
            Paint::Color(colour) => Some(rgba(colour)),
            Paint::FuncIRI(id, fallback) => match (self.gradient(id)?, fallback) {
                (Some(colour), _) => Some(colour),
                (None, Some(PaintFallback::Color(colour))) => Some(rgba(colour)),
                (None, Some(PaintFallback::CurrentColor)) => Some(current),
                (None, Some(PaintFallback::None)) => None,
                (None, None) => {
                    return Err(self.wrong(node, name, "a gradient of the drawing with at least one stop", value));
                }
            },
            Paint::Inherit | Paint::CurrentColor | Paint::ContextFill | Paint::ContextStroke => Some(current),
        })
    }

    /// The mean colour of a gradient over its length; `None` where there is none of that name, or it has no stops.
    fn gradient(&self, id: &str) -> Result<Option<[f64; 4]>, SvgError> {
        let mut at = self.ids.get(id).copied();
        // Gradients take their stops from others, in chains that a file may close to a ring.
        for _ in 0..16 {
            let Some(node) = at else { return Ok(None) };
            let stops = self.stops(node)?;
            if !stops.is_empty() {
                return Ok(Some(mean(&stops)));
            }
            at = super::href(node).and_then(|id| self.ids.get(id).copied());
        }
        Ok(None)
    }

    fn stops(&self, gradient: Node) -> Result<Vec<(f64, [f64; 4])>, SvgError> {
        let mut stops: Vec<(f64, [f64; 4])> = Vec::new();
        for node in gradient.children().filter(|c| c.tag_name().name() == "stop") {
            let all: BTreeMap<&str, &str> = said(self, node).into_iter().collect();
            let value = |name: &str| all.get(name).copied().or_else(|| node.attribute(name));
            let share = |name: &str, default: f64| value(name).map_or(Ok(default), |v| self.share(node, name, v));
            let colour = value("stop-color").unwrap_or("black");
            let black = [0.0, 0.0, 0.0, 1.0];
            let [r, g, b, a] = self.paint_plain(node, colour)?.unwrap_or(black);
            let from = stops.last().map_or(0.0, |s| s.0);
            stops.push((share("offset", 0.0)?.max(from), [r, g, b, a * share("stop-opacity", 1.0)?]));
        }
        Ok(stops)
    }

    fn paint_plain(&self, node: Node, value: &str) -> Result<Option<[f64; 4]>, SvgError> {
        match Paint::from_str(value) {
            Ok(Paint::Color(colour)) => Ok(Some(rgba(colour))),
            Ok(Paint::Inherit | Paint::CurrentColor) => Ok(None),
            _ => Err(self.wrong(node, "stop-color", "a colour", value)),
        }
    }
}

/// The mean over the length of a gradient, of colours weighed by their opacity.
fn mean(stops: &[(f64, [f64; 4])]) -> [f64; 4] {
    let (Some(first), Some(last)) = (stops.first(), stops.last()) else { return [0.0; 4] };
    let mut sum = [0.0; 4];
    let mut add = |length: f64, [r, g, b, a]: [f64; 4]| {
        sum.iter_mut().zip([r * a, g * a, b * a, a]).for_each(|(s, v)| *s += length * v);
    };
    add(first.0, first.1);
    for pair in stops.windows(2) {
        let length = (pair[1].0 - pair[0].0) / 2.0;
        add(length, pair[0].1);
        add(length, pair[1].1);
    }
    add(1.0 - last.0, last.1);
    let [r, g, b, a] = sum;
    let part = |v: f64| if a > 0.0 { v / a } else { 0.0 };
    [part(r), part(g), part(b), a]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gradient_is_its_mean() {
        let (white, black) = ([1.0; 4], [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(mean(&[(0.0, white), (1.0, black)]), [0.5, 0.5, 0.5, 1.0]);
        assert_eq!(mean(&[(0.5, white), (0.5, black)]), [0.5, 0.5, 0.5, 1.0]);
        assert_eq!(mean(&[(0.0, [1.0, 0.0, 0.0, 1.0]), (1.0, [0.0; 4])]), [1.0, 0.0, 0.0, 0.5]);
    }
}
