//! What the nodes of vector drawings share: files read, what is chosen in them, and what it becomes.

use std::path::Path;

use pegbar_engine::Setting;
use pegbar_engine::node::{Fault, NodeError};
use pegbar_engine::setting::InputPaths;

use super::file;
use crate::algo::paint::FillRule;
use crate::algo::svg::{self, Element, MOST, MOST_BYTES, Point, Sampling, Scene, Subpath, SvgError, differs, sampled};
use crate::data::Drawing;

/// A drawing, and the file that it is from.
pub(super) struct Sheet {
    file: String,
    pub(super) scene: Scene,
}

/// What is chosen of a drawing.
#[derive(Clone)]
pub(super) struct Pick<'a> {
    pub(super) sheet: &'a Sheet,
    /// The layer, by its group.
    pub(super) layer: Option<usize>,
    /// A path or a group, by label or id.
    pub(super) id: Option<&'a str>,
    /// What it is called among keys.
    pub(super) name: String,
}

/// Reads a file.
pub(super) fn load(path: &Path) -> Result<Sheet, NodeError> {
    let file = path.display().to_string();
    let size = file::open(path)?.metadata().map_err(|e| NodeError::io(path, e))?.len();
    if size > MOST_BYTES as u64 {
        return Err(NodeError::new(Fault::Limit, format!("{file}: expected at most {MOST_BYTES} bytes, found {size}")));
    }
    let text = String::from_utf8(file::read(path)?).map_err(|e| {
        let line = 1 + e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        NodeError::input(format!("{file}: line {line}: expected text in UTF-8, found other bytes"))
            .help("save it as plain SVG: `.svgz` is packed, and other encodings are not read")
    })?;
    let scene = svg::read(text.trim_start_matches('\u{FEFF}')).map_err(|e| {
        let fault = if matches!(e, SvgError::Limit { .. }) { Fault::Limit } else { Fault::Input };
        NodeError::new(fault, format!("{file}: {e}"))
    })?;
    Ok(Sheet { file, scene })
}

/// The first names of a list, for messages.
fn few(names: &[&str]) -> String {
    let more = if names.len() > 12 { ", ..." } else { "" };
    if names.is_empty() { "none has a name".to_owned() } else { format!("there are {}{more}", names[..names.len().min(12)].join(", ")) }
}

impl Sheet {
    /// The layer at a position, from 0.
    pub(super) fn layer(&self, at: i64) -> Result<usize, NodeError> {
        let layers = self.scene.layers();
        let found = usize::try_from(at).ok().and_then(|i| layers.get(i)).copied();
        found.ok_or_else(|| {
            let message = format!("{}: expected a layer {}, found {} layers", self.file, at + 1, layers.len());
            NodeError::input(message).help("the first layer is the clock's first frame")
        })
    }
}

impl<'a> Pick<'a> {
    /// What is chosen; at least one element.
    pub(super) fn elements(&self) -> Result<Vec<&'a Element>, NodeError> {
        let Sheet { file, scene } = self.sheet;
        let found = scene.shown(self.layer, self.id);
        if !found.is_empty() {
            return Ok(found);
        }
        let place = self.layer.map_or_else(String::new, |l| format!(" in layer `{}`", scene.groups[l].name));
        Err(match self.id {
            Some(id) if self.layer.is_none() && scene.names().contains(&id) => {
                NodeError::input(format!("{file}: expected a path or group `{id}` that is drawn, found it hidden"))
                    .help("show it, or read layers (`layers`, `keys_from: layers`), hidden ones too")
            }
            Some(id) => NodeError::input(format!("{file}: expected a path or group `{id}`{place}, found none")).help(few(&scene.names())),
            None => NodeError::input(format!("{file}: expected a path{place}, found nothing that is drawn"))
                .help("paths, rectangles, circles, ellipses, lines, polylines and polygons are read; turn text into paths"),
        })
    }

    /// One contour: number `which` of those that are chosen, from 1, or the only one.
    pub(super) fn contour(&self, which: Option<u32>) -> Result<(&'a Element, &'a Subpath), NodeError> {
        let elements = self.elements()?;
        let all: Vec<(&Element, &Subpath)> = elements.iter().flat_map(|e| e.lines.iter().map(move |l| (*e, l))).collect();
        let at = |message: String| NodeError::input(format!("{}: {message}", self.sheet.file));
        match (which, &all[..]) {
            (None, [one]) => Ok(*one),
            (None, all) => {
                let of = self.id.map_or_else(String::new, |id| format!(" of `{id}`"));
                let names: Vec<&str> = elements.iter().map(|e| e.name.as_str()).filter(|n| !n.is_empty()).collect();
                let help = format!("choose by `id` or by `which`, from 1; {}", few(&names));
                Err(at(format!("expected one contour{of}, found {}", all.len())).help(help))
            }
            (Some(n), all) => (n as usize)
                .checked_sub(1)
                .and_then(|i| all.get(i))
                .copied()
                .ok_or_else(|| at(format!("expected `which` from 1 to {}, the number of contours, found {n}", all.len()))),
        }
    }

    fn line(&self, element: &Element) -> String {
        format!("{}: line {}", self.sheet.file, element.line)
    }
}

/// Where the keys of a set are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum KeysFrom {
    /// Each file is a key; of one file with several `ids`, each of these.
    Files,
    /// Each layer of each file is a key, hidden ones too: groups directly in the drawing, or in the one group that holds all of it.
    Layers,
}

/// Reads files of keys, each once.
pub(super) fn load_all(paths: &InputPaths) -> Result<Vec<Sheet>, NodeError> {
    paths.0.iter().map(|path| load(&path.at(0))).collect()
}

fn stem(file: &str) -> String {
    Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The keys of a set.
pub(super) fn keys<'a>(sheets: &'a [Sheet], ids: &'a [String], from: KeysFrom) -> Result<Vec<Pick<'a>>, NodeError> {
    let refused = |message: String| Err(NodeError::new(Fault::Parameters, message));
    if from == KeysFrom::Layers {
        if ids.len() > 1 {
            return refused(format!("expected one id at most where each layer is a key, found {}", ids.len()));
        }
        let id = ids.first().map(String::as_str);
        let of = |sheet: &'a Sheet| {
            let layers = sheet.scene.layers();
            layers.into_iter().map(move |l| Pick { sheet, layer: Some(l), id, name: sheet.scene.groups[l].name.clone() })
        };
        let keys: Vec<Pick> = sheets.iter().flat_map(of).collect();
        let files = || sheets.iter().map(|s| s.file.as_str()).collect::<Vec<_>>().join(", ");
        return if keys.is_empty() { Err(NodeError::input(format!("{}: expected layers, found no group", files()))) } else { Ok(keys) };
    }
    let pick = |sheet: &'a Sheet, id: Option<&'a str>, name: String| Pick { sheet, layer: None, id, name };
    let own = |sheet: &'a Sheet, id: Option<&'a str>| pick(sheet, id, stem(&sheet.file));
    match (sheets, ids) {
        (_, []) => Ok(sheets.iter().map(|s| own(s, None)).collect()),
        ([sheet], ids) => Ok(ids.iter().map(|id| pick(sheet, Some(id), id.clone())).collect()),
        (_, [id]) => Ok(sheets.iter().map(|s| own(s, Some(id))).collect()),
        (sheets, ids) if sheets.len() == ids.len() => Ok(sheets.iter().zip(ids).map(|(s, id)| own(s, Some(id))).collect()),
        _ => refused(format!("expected one id, or one for each of {} files, found {}", sheets.len(), ids.len())),
    }
}

fn too_many(file: &str) -> NodeError {
    NodeError::new(Fault::Limit, format!("{file}: expected at most {MOST} points, found more")).help("raise the tolerance")
}

/// Points of contours that correspond, one for each key.
pub(super) fn contours(keys: &[(Pick, &Element, &Subpath)], sampling: Sampling) -> Result<Vec<Vec<Point>>, NodeError> {
    let Some((first, element, line)) = keys.first() else { return Ok(Vec::new()) };
    for (other, e, l) in keys {
        corresponds((first, element, std::slice::from_ref(line)), (other, e, std::slice::from_ref(l)))?;
    }
    let lines: Vec<&Subpath> = keys.iter().map(|k| k.2).collect();
    sampled(&lines, sampling).ok_or_else(|| too_many(&first.sheet.file))
}

fn corresponds(a: (&Pick, &Element, &[Subpath]), b: (&Pick, &Element, &[Subpath])) -> Result<(), NodeError> {
    let Some(what) = differs(a.2, b.2) else { return Ok(()) };
    let name = if b.1.name.is_empty() { String::new() } else { format!("`{}` ", b.1.name) };
    let message = format!("{}: expected a path {name}of the same nodes as {}, found {what}", b.0.line(b.1), a.0.line(a.1));
    Err(NodeError::input(message)
        .help("draw each key from a copy of the first; or read shapes one by one and bring them together by `shape.resample`"))
}

/// Drawings of the same paths, one for each key; of one key, any drawing.
pub(super) fn drawings(keys: &[Pick], sampling: Sampling) -> Result<Vec<Drawing>, NodeError> {
    let all: Vec<Vec<&Element>> = keys.iter().map(Pick::elements).collect::<Result<_, _>>()?;
    let Some(first) = all.first() else { return Ok(Vec::new()) };
    for (key, elements) in keys.iter().zip(&all) {
        if elements.len() != first.len() {
            let (a, b) = (&keys[0], key);
            let message = format!("{}: expected {} paths as in {}", b.sheet.file, first.len(), a.sheet.file);
            let names = |p: &Pick| p.layer.map_or_else(String::new, |_| format!(" `{}`", p.name));
            let message = format!("{message}{}, found {}{}", names(a), elements.len(), names(b));
            return Err(NodeError::input(message)
                .help("draw each key from a copy of the first; hide what a pose does not show inside of another part"));
        }
    }
    let mut out: Vec<Drawing> = keys.iter().map(|k| Drawing { size: k.sheet.scene.size, ..Drawing::default() }).collect();
    let mut points = 0;
    for i in 0..first.len() {
        let element = first[i];
        for (key, elements) in keys.iter().zip(&all) {
            corresponds((&keys[0], element, &element.lines), (key, elements[i], &elements[i].lines))?;
        }
        for line in 0..element.lines.len() {
            let lines: Vec<&Subpath> = all.iter().map(|e| &e[i].lines[line]).collect();
            let sampled = sampled(&lines, sampling).ok_or_else(|| too_many(&keys[0].sheet.file))?;
            points += sampled.iter().map(Vec::len).sum::<usize>();
            if points > MOST {
                return Err(too_many(&keys[0].sheet.file));
            }
            for (drawing, contour) in out.iter_mut().zip(sampled) {
                drawing.contours.push(contour.len() as u32);
                drawing.closed.push(u8::from(element.lines[line].closed));
                drawing.points.extend(contour);
            }
        }
        for ((drawing, key), elements) in out.iter_mut().zip(keys).zip(&all) {
            paint(drawing, key, elements[i]);
        }
    }
    out.iter_mut().for_each(tidy);
    Ok(out)
}

fn paint(drawing: &mut Drawing, key: &Pick, element: &Element) {
    let style = &element.style;
    drawing.paths.push(element.lines.len() as u32);
    drawing.fill.push(style.fill);
    drawing.stroke.push(style.stroke);
    drawing.width.push(style.width);
    drawing.rule.push(u8::from(style.rule == FillRule::EvenOdd));
    drawing.depth.push(element.depth);
    drawing.names.push(element.name.clone());
    drawing.groups.push(key.sheet.scene.groups_of(element, key.layer));
}

/// Names that say nothing are left out.
fn tidy(drawing: &mut Drawing) {
    if drawing.names.iter().all(String::is_empty) {
        drawing.names.clear();
    }
    if drawing.groups.iter().all(Vec::is_empty) {
        drawing.groups.clear();
    }
}
