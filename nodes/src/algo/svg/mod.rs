//! SVG drawings: outlines with their paint, in the order in which they are drawn, and the groups that they are in.
//!
//! The tree is read by `roxmltree`, which bounds entities; numbers, path data, transforms and colours by `svgtypes`. Paths, rectangles, circles,
//! ellipses, lines, polylines and polygons are read in pixels of the picture's size, under the transforms of their groups and `use`. Flat
//! colours are read from attributes, inline styles and style sheets of simple selectors; a gradient is the mean of its colours, a pattern its fallback.
//! Text, pictures, clips, masks, filters, markers and dashes are not read.
//!
//! **Source** W3C, Scalable Vector Graphics 1.1 (second edition).

mod path;
mod style;
#[cfg(test)]
mod tests;
mod write;

use std::collections::BTreeMap;

use roxmltree::{Document, Node, ParsingOptions};
use svgtypes::{Align, AspectRatio, LengthUnit, NumberListParser, ViewBox};

pub use path::{MOST, Point, Sampling, Segment, Subpath, differs, sampled};
pub use style::Style;
pub use write::{Frame, Outline, Playback, write};

use super::raster::{Affine, compose, identity};
use style::{Sheet, State};

/// Most bytes of one drawing.
pub const MOST_BYTES: usize = 1 << 28;
/// Most elements, with those that `use` shows again.
const MOST_ELEMENTS: usize = 1 << 20;
/// Most elements within each other.
const DEEPEST: usize = 256;
/// Elements whose contents are not shown where they stand.
const HIDDEN: [&str; 8] = ["defs", "clipPath", "mask", "marker", "pattern", "symbol", "linearGradient", "radialGradient"];
const INKSCAPE: &str = "http://www.inkscape.org/namespaces/inkscape";
const XLINK: &str = "http://www.w3.org/1999/xlink";

/// Why a drawing cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SvgError {
    /// It is no XML, or no SVG.
    #[error("expected an SVG drawing, found {0}")]
    Xml(String),
    /// An attribute does not say what it should.
    #[error("line {line}: expected {expected} in `{name}` of `{element}`, found `{found}`")]
    Attribute {
        /// Line of the element, from 1.
        line: usize,
        /// The element's tag.
        element: String,
        /// The attribute or property.
        name: String,
        /// What it should hold.
        expected: &'static str,
        /// What it holds, the beginning of it.
        found: String,
    },
    /// It is too large, or nested too deep.
    #[error("{at}expected at most {most} {what}, found more")]
    Limit {
        /// `line 3: `, or nothing.
        at: String,
        /// How many there may be.
        most: usize,
        /// Of what.
        what: &'static str,
    },
}

/// An element that is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// Its label, else its id; empty where it has neither.
    pub name: String,
    /// Its id; empty where it has none.
    pub id: String,
    /// The innermost group that it is in, by its position in the drawing's list.
    pub group: Option<usize>,
    /// Its place in the drawing: higher ones cover lower ones.
    pub depth: f64,
    /// Its line in the file, from 1.
    pub line: usize,
    /// Its outline, pixels.
    pub lines: Vec<Subpath>,
    /// How it is painted.
    pub style: Style,
    /// Whether it is not displayed, wherever its layer is.
    pub hidden: bool,
}

/// A group of elements.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Its label, else its id; empty where it has neither.
    pub name: String,
    /// Its id; empty where it has none.
    pub id: String,
    /// The group that it is in.
    pub parent: Option<usize>,
    /// Whether it is not displayed.
    pub hidden: bool,
}

/// A drawing as it was read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Width and height, pixels.
    pub size: [f64; 2],
    /// The groups, those outside before those inside.
    pub groups: Vec<Group>,
    /// What is drawn, in its order.
    pub elements: Vec<Element>,
}

impl Scene {
    /// The layers: groups directly in the drawing, or in the one group that holds all of it.
    pub fn layers(&self) -> Vec<usize> {
        let inside = |parent: Option<usize>| (0..self.groups.len()).filter(move |&g| self.groups[g].parent == parent);
        let top: Vec<usize> = inside(None).collect();
        let has_others = self.elements.iter().any(|e| e.group.is_none());
        match top[..] {
            [only] if !has_others && inside(Some(only)).count() > 1 => inside(Some(only)).collect(),
            _ => top,
        }
    }

    /// The groups that a group is in, from itself outwards.
    fn around(&self, group: Option<usize>) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(group, |&g| self.groups[g].parent)
    }

    /// Names of the groups that an element is in within a layer, from outside; those without a name are left out.
    pub fn groups_of(&self, element: &Element, layer: Option<usize>) -> Vec<String> {
        let groups = self.around(element.group).take_while(|&g| Some(g) != layer);
        let mut names: Vec<String> = groups.map(|g| self.groups[g].name.clone()).filter(|n| !n.is_empty()).collect();
        names.reverse();
        names
    }

    /// What is displayed, of one layer where one is given, and of what has this name: the element itself, or a group that it is in.
    ///
    /// A layer is displayed though the drawing hides it: hidden layers are how drawings keep their poses apart.
    pub fn shown<'a>(&'a self, layer: Option<usize>, name: Option<&'a str>) -> Vec<&'a Element> {
        let is = |wanted: &str, name: &str, id: &str| wanted == name || wanted == id;
        let called = |e: &Element| {
            name.is_none_or(|n| is(n, &e.name, &e.id) || self.around(e.group).any(|g| is(n, &self.groups[g].name, &self.groups[g].id)))
        };
        let seen = |e: &Element| !e.hidden && self.around(e.group).take_while(|&g| Some(g) != layer).all(|g| !self.groups[g].hidden);
        let within = |e: &Element| layer.is_none_or(|l| self.around(e.group).any(|g| g == l));
        self.elements.iter().filter(|e| seen(e) && within(e) && called(e)).collect()
    }

    /// Names of elements and groups, for messages.
    pub fn names(&self) -> Vec<&str> {
        let all = self.elements.iter().map(|e| e.name.as_str()).chain(self.groups.iter().map(|g| g.name.as_str()));
        let mut names: Vec<&str> = all.filter(|n| !n.is_empty()).collect();
        names.sort_unstable();
        names.dedup();
        names
    }
}

/// What is needed of the document while it is read.
struct Reader<'a> {
    text: &'a str,
    ids: BTreeMap<&'a str, Node<'a, 'a>>,
    sheet: Sheet,
    scene: Scene,
    elements: usize,
    segments: usize,
}

/// Where an element stands.
#[derive(Clone)]
struct Place {
    pixels: Affine,
    /// Width and height that percentages are of.
    view: [f64; 2],
    state: State,
    group: Option<usize>,
    hidden: bool,
    depth: usize,
}

fn href<'a>(node: Node<'a, 'a>) -> Option<&'a str> {
    node.attribute("href").or_else(|| node.attribute((XLINK, "href")))?.trim().strip_prefix('#')
}

fn name_of(node: Node) -> String {
    node.attribute((INKSCAPE, "label")).or_else(|| node.attribute("id")).unwrap_or_default().to_owned()
}

/// A drawing from the text of its file.
///
/// # Errors
/// What is no SVG, an attribute that cannot be read, with its line, or more than a drawing can have.
pub fn read(text: &str) -> Result<Scene, SvgError> {
    let limit = |most, what| SvgError::Limit { at: String::new(), most, what };
    if text.len() > MOST_BYTES {
        return Err(limit(MOST_BYTES, "bytes"));
    }
    let parsing = ParsingOptions { allow_dtd: true, nodes_limit: 1 << 22, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, parsing).map_err(|e| match e {
        roxmltree::Error::NodesLimitReached => limit(1 << 22, "nodes"),
        e => SvgError::Xml(e.to_string()),
    })?;
    let root = document.root_element();
    if root.tag_name().name() != "svg" {
        return Err(SvgError::Xml(format!("`{}`", root.tag_name().name())));
    }
    let mut reader = Reader {
        text,
        ids: root.descendants().filter_map(|n| Some((n.attribute("id")?, n))).collect(),
        sheet: Sheet::default(),
        scene: Scene::default(),
        elements: 0,
        segments: 0,
    };
    for style in root.descendants().filter(|n| n.tag_name().name() == "style") {
        style.children().filter_map(|c| c.text()).for_each(|css| reader.sheet.add(css));
    }
    let place = Place { pixels: identity(), view: [300.0, 150.0], state: State::default(), group: None, hidden: false, depth: 0 };
    let (size, inner) = reader.view(root, &place, None)?;
    reader.scene.size = size;
    let state = place.state.inside(&reader, root)?;
    reader.children(root, &Place { state, ..inner })?;
    Ok(reader.scene)
}

impl<'a> Reader<'a> {
    fn line(&self, node: Node) -> usize {
        let before = self.text.as_bytes().get(..node.range().start).unwrap_or_default();
        1 + before.iter().filter(|&&b| b == b'\n').count()
    }

    fn wrong(&self, node: Node, name: &str, expected: &'static str, found: &str) -> SvgError {
        let mut found: String = found.chars().take(41).collect();
        if found.chars().count() > 40 {
            found = format!("{}...", found.chars().take(37).collect::<String>());
        }
        let element = node.tag_name().name().to_owned();
        SvgError::Attribute { line: self.line(node), element, name: name.to_owned(), expected, found }
    }

    /// A length in pixels, percentages being of `whole`.
    fn pixels(&self, node: Node, name: &str, text: &str, whole: f64) -> Result<f64, SvgError> {
        let wrong = || self.wrong(node, name, "a length in px, in, cm, mm, pt, pc or %", text);
        let length: svgtypes::Length = text.trim().parse().map_err(|_| wrong())?;
        let scale = match length.unit {
            LengthUnit::None | LengthUnit::Px => 1.0,
            LengthUnit::In => 96.0,
            LengthUnit::Cm => 96.0 / 2.54,
            LengthUnit::Mm => 96.0 / 25.4,
            LengthUnit::Pt => 4.0 / 3.0,
            LengthUnit::Pc => 16.0,
            LengthUnit::Percent => whole / 100.0,
            LengthUnit::Em | LengthUnit::Ex => return Err(wrong()),
        };
        let pixels = length.number * scale;
        if pixels.is_finite() { Ok(pixels) } else { Err(wrong()) }
    }

    fn length(&self, node: Node, name: &str, whole: f64) -> Result<Option<f64>, SvgError> {
        node.attribute(name).filter(|text| *text != "auto").map(|text| self.pixels(node, name, text, whole)).transpose()
    }

    fn width(&self, node: Node, name: &str, text: &str) -> Result<f64, SvgError> {
        let [w, h] = self.scene.size;
        let width = self.pixels(node, name, text, diagonal([w, h]))?;
        if width >= 0.0 { Ok(width) } else { Err(self.wrong(node, name, "a width of at least 0", text)) }
    }

    fn transform(&self, node: Node) -> Result<Affine, SvgError> {
        let Some(text) = node.attribute("transform") else { return Ok(identity()) };
        let wrong = || self.wrong(node, "transform", "a transform as `translate(10 20)`", text);
        let t: svgtypes::Transform = text.parse().map_err(|_| wrong())?;
        let map = Affine::new(t.a, t.c, t.e, t.b, t.d, t.f);
        if map.iter().all(|v| v.is_finite()) { Ok(map) } else { Err(wrong()) }
    }

    /// The size of a view, and what is inside of it: the drawing itself, a drawing in a drawing, or a symbol of the size that is wanted.
    fn view(&self, node: Node, place: &Place, wanted: Option<[Option<f64>; 2]>) -> Result<([f64; 2], Place), SvgError> {
        let is_root = place.depth == 0;
        let parse = |text: &str| {
            let finite = |v: &ViewBox| [v.x, v.y, v.w, v.h].iter().all(|n| n.is_finite());
            let view: Option<ViewBox> = text.parse().ok().filter(finite);
            view.ok_or_else(|| self.wrong(node, "viewBox", "four numbers, the last two above 0", text))
        };
        let view = node.attribute("viewBox").map(parse).transpose()?;
        let mut size = [0.0; 2];
        for (k, name) in ["width", "height"].into_iter().enumerate() {
            let is_share = node.attribute(name).is_some_and(|text| text.trim().ends_with('%'));
            // What the whole drawing is a share of is the page that it will stand on, which nobody knows.
            let given = if is_root && is_share { None } else { self.length(node, name, place.view[k])? };
            let given = wanted.and_then(|w| w[k]).or(given);
            size[k] = given.or(view.map(|v| [v.w, v.h][k])).unwrap_or(place.view[k]);
            if size[k].is_nan() || size[k] < 0.0 || (is_root && size[k] == 0.0) {
                return Err(self.wrong(node, name, "a size above 0", node.attribute(name).unwrap_or_default()));
            }
        }
        let mut inner = Place { depth: place.depth + 1, view: view.map_or(size, |v| [v.w, v.h]), ..place.clone() };
        let at = |k, name| if is_root { Ok(0.0) } else { Ok(self.length(node, name, place.view[k])?.unwrap_or(0.0)) };
        let corner = Affine::new(1.0, 0.0, at(0, "x")?, 0.0, 1.0, at(1, "y")?);
        let fit = match view {
            Some(view) => fitted(view, size, self.aspect(node)?),
            None => identity(),
        };
        inner.pixels = compose(&place.pixels, &compose(&corner, &fit));
        Ok((size, inner))
    }

    fn aspect(&self, node: Node) -> Result<AspectRatio, SvgError> {
        let Some(text) = node.attribute("preserveAspectRatio") else {
            return Ok(AspectRatio { defer: false, align: Align::XMidYMid, slice: false });
        };
        text.parse().map_err(|_| self.wrong(node, "preserveAspectRatio", "as `xMidYMid meet`", text))
    }

    fn children(&mut self, node: Node<'a, 'a>, place: &Place) -> Result<(), SvgError> {
        node.children().filter(Node::is_element).try_for_each(|child| self.element(child, place))
    }

    fn element(&mut self, node: Node<'a, 'a>, place: &Place) -> Result<(), SvgError> {
        self.elements += 1;
        let limit = |reader: &Self, most, what| SvgError::Limit { at: format!("line {}: ", reader.line(node)), most, what };
        if self.elements > MOST_ELEMENTS {
            return Err(limit(self, MOST_ELEMENTS, "elements, with those that `use` shows again"));
        }
        if place.depth > DEEPEST {
            return Err(limit(self, DEEPEST, "elements within each other"));
        }
        let tag = node.tag_name().name();
        if HIDDEN.contains(&tag) {
            return Ok(());
        }
        let state = place.state.inside(self, node)?;
        let pixels = compose(&place.pixels, &self.transform(node)?);
        let mut own = Place { pixels, state, depth: place.depth + 1, ..place.clone() };
        match tag {
            "g" | "a" | "switch" => {
                own.group = Some(self.group(node, &own));
                self.children(node, &own)
            }
            "svg" => {
                own.hidden |= !own.state.displayed;
                let inner = self.view(node, &own, None)?.1;
                self.children(node, &inner)
            }
            "use" => self.again(node, own),
            _ => self.outline(node, &own),
        }
    }

    fn group(&mut self, node: Node, place: &Place) -> usize {
        let id = node.attribute("id").unwrap_or_default().to_owned();
        self.scene.groups.push(Group { name: name_of(node), id, parent: place.group, hidden: !place.state.displayed });
        self.scene.groups.len() - 1
    }

    /// What a `use` element shows.
    fn again(&mut self, node: Node<'a, 'a>, mut place: Place) -> Result<(), SvgError> {
        let target = href(node).and_then(|id| self.ids.get(id).copied());
        let target = target.ok_or_else(|| self.wrong(node, "href", "the id of an element as `#id`", ""))?;
        let [x, y] = [self.length(node, "x", place.view[0])?, self.length(node, "y", place.view[1])?].map(Option::unwrap_or_default);
        place.pixels = compose(&place.pixels, &Affine::new(1.0, 0.0, x, 0.0, 1.0, y));
        place.group = Some(self.group(node, &place));
        if target.tag_name().name() != "symbol" {
            return self.element(target, &place);
        }
        let size = [self.length(node, "width", place.view[0])?, self.length(node, "height", place.view[1])?];
        place.state = place.state.inside(self, target)?;
        let inner = self.view(target, &place, Some(size))?.1;
        self.children(target, &inner)
    }

    fn outline(&mut self, node: Node, place: &Place) -> Result<(), SvgError> {
        let Some(lines) = self.lines(node, place)? else { return Ok(()) };
        self.segments += lines.iter().map(|l| l.segments.len() + 1).sum::<usize>();
        if self.segments > MOST {
            return Err(SvgError::Limit { at: format!("line {}: ", self.line(node)), most: MOST, what: "segments" });
        }
        let linear = place.pixels.fixed_view::<2, 2>(0, 0).determinant();
        let Some(style) = place.state.style(libm::sqrt(linear.abs())) else { return Ok(()) };
        let lines: Vec<Subpath> = lines.iter().map(|l| l.moved(&place.pixels)).collect();
        if !lines.iter().all(Subpath::is_finite) {
            return Err(self.wrong(node, "transform", "a place within the range of numbers", ""));
        }
        let count = self.scene.elements.len() as f64;
        let depth = match node.attribute("data-depth") {
            Some(text) => text.parse::<svgtypes::Number>().map_err(|_| self.wrong(node, "data-depth", "a number", text))?.0,
            None => count,
        };
        self.scene.elements.push(Element {
            name: name_of(node),
            id: node.attribute("id").unwrap_or_default().to_owned(),
            group: place.group,
            depth,
            line: self.line(node),
            lines,
            style,
            hidden: place.hidden || !place.state.displayed,
        });
        Ok(())
    }

    /// The outline of an element that has one.
    fn lines(&self, node: Node, place: &Place) -> Result<Option<Vec<Subpath>>, SvgError> {
        let [w, h] = place.view;
        let number = |name: &str, whole: f64| Ok(self.length(node, name, whole)?.unwrap_or(0.0));
        let size = |name: &str, whole: f64| {
            let size = number(name, whole)?;
            let found = || self.wrong(node, name, "a size of at least 0", node.attribute(name).unwrap_or_default());
            if size >= 0.0 { Ok(size) } else { Err(found()) }
        };
        let one = |line: Subpath| Ok(Some(vec![line]));
        match node.tag_name().name() {
            "path" => {
                let data = node.attribute("d").filter(|d| d.trim() != "none").unwrap_or_default();
                path::parse(data).map(Some).map_err(|expected| self.wrong(node, "d", expected, data))
            }
            "polygon" | "polyline" => {
                let points = self.corners(node)?;
                Ok(path::polyline(&points, node.tag_name().name() == "polygon").map(|l| vec![l]))
            }
            "line" => {
                let (a, b) = ([number("x1", w)?, number("y1", h)?], [number("x2", w)?, number("y2", h)?]);
                one(Subpath { start: a, segments: vec![Segment::Line(b)], closed: false })
            }
            "rect" => {
                let (corner, sides) = ([number("x", w)?, number("y", h)?], [size("width", w)?, size("height", h)?]);
                // Of two radii one that is left out is as the other.
                let given = |name: &str, whole: f64| node.attribute(name).filter(|t| *t != "auto").map(|_| size(name, whole)).transpose();
                let (rx, ry) = (given("rx", w)?, given("ry", h)?);
                one(path::rectangle(corner, sides, [rx.or(ry).unwrap_or(0.0), ry.or(rx).unwrap_or(0.0)]))
            }
            "circle" => one(path::ellipse([number("cx", w)?, number("cy", h)?], [size("r", diagonal(place.view))?; 2])),
            "ellipse" => one(path::ellipse([number("cx", w)?, number("cy", h)?], [size("rx", w)?, size("ry", h)?])),
            _ => Ok(None),
        }
    }

    fn corners(&self, node: Node) -> Result<Vec<Point>, SvgError> {
        let text = node.attribute("points").unwrap_or_default();
        let wrong = || self.wrong(node, "points", "pairs of numbers", text);
        let numbers: Vec<f64> = NumberListParser::from(text).take(2 * MOST + 2).collect::<Result<_, _>>().map_err(|_| wrong())?;
        let (points, rest) = numbers.as_chunks::<2>();
        if rest.is_empty() && numbers.iter().all(|v| v.is_finite()) { Ok(points.to_vec()) } else { Err(wrong()) }
    }
}

/// What percentages without a direction are of: chapter 7.10.
fn diagonal([w, h]: [f64; 2]) -> f64 {
    libm::hypot(w, h) / std::f64::consts::SQRT_2
}

/// The map that fits a view box into a size: chapter 7.8.
fn fitted(view: ViewBox, size: [f64; 2], aspect: AspectRatio) -> Affine {
    let [sx, sy] = [size[0] / view.w, size[1] / view.h];
    let [sx, sy] = match (aspect.align, aspect.slice) {
        (Align::None, _) => [sx, sy],
        (_, true) => [sx.max(sy); 2],
        (_, false) => [sx.min(sy); 2],
    };
    let share = match aspect.align {
        Align::None | Align::XMinYMin => [0.0, 0.0],
        Align::XMidYMin => [0.5, 0.0],
        Align::XMaxYMin => [1.0, 0.0],
        Align::XMinYMid => [0.0, 0.5],
        Align::XMidYMid => [0.5, 0.5],
        Align::XMaxYMid => [1.0, 0.5],
        Align::XMinYMax => [0.0, 1.0],
        Align::XMidYMax => [0.5, 1.0],
        Align::XMaxYMax => [1.0, 1.0],
    };
    let dx = share[0] * (size[0] - sx * view.w) - sx * view.x;
    let dy = share[1] * (size[1] - sy * view.h) - sy * view.y;
    Affine::new(sx, 0.0, dx, 0.0, sy, dy)
}
