//! What was caught of a node's outputs, as elements of the page.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use pegbar_engine::exec::Report;
use pegbar_engine::graph::{Binding, Graph, Port};
use pegbar_nodes::data::{Pose, Skeleton};

use super::catch::{Caught, Wanted, held};
use super::html::{escape, number};
use super::numbers::lines;
use super::plot::{self, Panel, ends};
use super::show::Shown;
use super::sketch::Sketch;

/// Side of a sketch in pixels.
const SIDE: f64 = 260.0;

/// All that is known of outputs.
pub(super) struct Values<'a> {
    pub(super) graph: &'a Graph,
    pub(super) report: &'a Report,
    pub(super) wanted: &'a [Wanted],
    pub(super) caught: &'a BTreeMap<Port, Caught>,
}

impl Values<'_> {
    /// An output: its name and type, and what it gave.
    pub(super) fn output(&self, port: Port) -> String {
        let node = &self.graph.nodes[port.node];
        let name = node.ty.schema.outputs[port.output].name;
        let ty = node.output_types.get(port.output).map_or("", String::as_str);
        let each = if self.graph.is_single(port) { "" } else { ", one a frame" };
        let what = match self.caught.get(&port) {
            Some(caught) if !caught.numbers.is_empty() => self.numbers(ty, caught),
            Some(caught) if !caught.shown.is_empty() => self.shown(port, caught),
            _ => format!("<p class=\"plain\">{}</p>", self.why_not(port.node, None)),
        };
        // Pictures of several frames, and what is large, take the whole width.
        let class = if what.matches("<figure>").count() > 1 || what.contains("<div class=\"wide\">") { " class=\"full\"" } else { "" };
        format!("<div{class}><h4>{} <span class=\"soft\">{}{each}</span></h4>{what}</div>\n", escape(name), escape(ty))
    }

    /// Why there is nothing to show.
    fn why_not(&self, node: usize, frame: Option<i64>) -> &'static str {
        let skipped = self.report.stats.get(node).is_some_and(|s| s.skipped > 0);
        let has_failed = self.report.failures.iter().any(|f| f.node == node && (frame.is_none() || f.frame == frame));
        match () {
            () if has_failed => "failed",
            () if self.wanted.get(node).is_none_or(|w| w.tasks == 0) => "not needed for what was asked for",
            () if skipped => {
                "not made again, as the cache has what hangs on it, and not kept there itself: --keep always keeps it, --no-cache makes it"
            }
            () => "not made",
        }
    }

    fn numbers(&self, ty: &str, caught: &Caught) -> String {
        let n = caught.numbers.values().map(Vec::len).max().unwrap_or(0);
        let lines = lines(ty, n);
        if let Some(one) = caught.numbers.get(&None) {
            let named = lines.iter().zip(one).map(|(line, v)| format!("{} {}", escape(&line.name), number(*v)).trim().to_owned());
            return format!("<p class=\"mono\">{}</p>", named.collect::<Vec<_>>().join(", "));
        }
        let frames: Vec<f64> = caught.numbers.keys().flatten().map(|f| *f as f64).collect();
        let values = |i: usize| -> Vec<f64> { caught.numbers.values().map(|v| v.get(i).copied().unwrap_or(f64::NAN)).collect() };
        if let [line] = &lines[..]
            && let [first, rest @ ..] = &values(0)[..]
            && rest.iter().all(|v| v == first)
        {
            let at = crate::console::count(frames.len(), "frame");
            return format!("<p class=\"mono\">{} {} <span class=\"soft\">at all of {at}</span></p>", escape(&line.name), number(*first));
        }
        let mut panels: Vec<Panel> = Vec::new();
        for (i, line) in lines.iter().enumerate() {
            let series = (line.name.clone(), values(i));
            match panels.last_mut().filter(|p| p.label == line.panel) {
                Some(panel) => panel.lines.push(series),
                None => panels.push(Panel { label: line.panel.to_owned(), lines: vec![series] }),
            }
        }
        for panel in panels.iter_mut().filter(|p| p.lines.len() == 1) {
            panel.label = format!("{}: {}", panel.label, ends(&panel.lines[0].1));
            panel.lines[0].0.clear();
        }
        plot::plot(&panels, &frames, "frame")
    }

    fn shown(&self, port: Port, caught: &Caught) -> String {
        let skeleton = self.skeleton_of(port);
        let sketches: BTreeMap<Option<i64>, Vec<Sketch>> =
            caught.shown.iter().map(|(frame, shown)| (*frame, sketches(shown, skeleton.as_deref()))).collect();
        let view = framed(sketches.values().flatten());
        let mut out = String::from("<div class=\"strip\">");
        for (frame, shown) in self.told(port, caught) {
            let caption = frame.map(|f| format!("<figcaption>frame {f}</figcaption>")).unwrap_or_default();
            let body = match shown {
                Some(Shown::Html(html)) => html.clone(),
                Some(_) => {
                    let own = sketches.get(&frame).map_or(&[][..], Vec::as_slice);
                    own.iter().map(|sketch| draw(sketch, view)).collect::<String>()
                }
                None => format!("<p class=\"plain\">{}</p>", self.why_not(port.node, frame)),
            };
            let _ = write!(out, "<figure>{caption}{body}</figure>");
        }
        out + "</div>"
    }

    /// The frames to show: those that were chosen; and where one of them was not made, what was made instead.
    fn told<'c>(&self, port: Port, caught: &'c Caught) -> Vec<(Option<i64>, Option<&'c Shown>)> {
        if let Some(one) = caught.shown.get(&None) {
            return vec![(None, Some(one))];
        }
        let chosen = self.wanted.get(port.node).map(|w| w.frames.clone()).unwrap_or_default();
        let has_all = chosen.iter().all(|f| caught.shown.contains_key(&Some(*f)));
        let mut frames: Vec<Option<i64>> = chosen.into_iter().map(Some).collect();
        frames.extend(caught.shown.keys().filter(|_| !has_all));
        frames.sort_unstable();
        frames.dedup();
        frames.into_iter().map(|frame| (frame, caught.shown.get(&frame))).collect()
    }

    /// The skeleton that the poses of a port are of: the node's own, or the one that it, or what it reads its poses from, is given.
    fn skeleton_of(&self, port: Port) -> Option<std::sync::Arc<Skeleton>> {
        let mut open = vec![port.node];
        let mut seen = Vec::new();
        while let Some(node) = open.pop() {
            if seen.contains(&node) {
                continue;
            }
            seen.push(node);
            let spec = &self.graph.nodes[node];
            let own = (0..spec.output_types.len()).map(|output| Port { node, output });
            let wires: Vec<Port> =
                spec.inputs.iter().filter_map(|b| if let Binding::Wire(port) = b { Some(*port) } else { None }).collect();
            if let Some(found) = own.chain(wires.iter().copied()).find_map(|port| held(self.caught, port)) {
                return Some(found);
            }
            let ty = |p: &Port| self.graph.nodes[p.node].output_types.get(p.output).map_or("", String::as_str);
            open.extend(wires.iter().filter(|p| ty(p) == <Pose as pegbar_engine::value::Value>::NAME).map(|p| p.node));
        }
        None
    }
}

fn sketches(shown: &Shown, skeleton: Option<&Skeleton>) -> Vec<Sketch> {
    match shown {
        Shown::Sketches(sketches) => sketches.clone(),
        Shown::Skeleton(skeleton) => Sketch::pose(skeleton, None).into_iter().collect(),
        Shown::Pose(pose) => {
            let roots = || Sketch::points_3d(&pose.translations);
            vec![skeleton.and_then(|s| Sketch::pose(s, Some(pose))).unwrap_or_else(roots)]
        }
        _ => Vec::new(),
    }
}

/// The bounds of all sketches with a margin.
fn framed<'s>(sketches: impl Iterator<Item = &'s Sketch>) -> [f64; 4] {
    let all = sketches.filter_map(|s| s.bounds);
    let [l, t, r, b] = all.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]).unwrap_or([0.0, 0.0, 1.0, 1.0]);
    let margin = ((r - l).max(b - t) * 0.05).max(1e-6);
    [l - margin, t - margin, r - l + 2.0 * margin, b - t + 2.0 * margin]
}

fn draw(sketch: &Sketch, [x, y, w, h]: [f64; 4]) -> String {
    if sketch.bounds.is_none() {
        return "<p class=\"plain\">nothing to be seen</p>".to_owned();
    }
    let scale = (SIDE / w).min(SIDE / h);
    let (width, height) = ((w * scale).max(40.0), (h * scale).max(40.0));
    let view = [x, y, w, h].map(|v| format!("{v:.3}")).join(" ");
    format!("<svg class=\"sketch\" viewBox=\"{view}\" width=\"{width:.0}\" height=\"{height:.0}\">{}</svg>", sketch.body)
}
