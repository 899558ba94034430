//! The page: what there is of a run, from the whole to the single node.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use pegbar_engine::check::Loaded;
use pegbar_engine::draw;
use pegbar_engine::exec::NodeStats;
use pegbar_engine::graph::{Binding, Graph, GraphNode, Port};
use pegbar_engine::job::Outcome;
use pegbar_engine::node::Kind;
use pegbar_engine::record::date;

use super::catch::{Catcher, Caught, Wanted};
use super::html::escape;
use super::settings;
use super::values::Values;
use crate::console::count;
use crate::list::summary as first_sentence;
use crate::summary::{bytes, duration, figures};

/// What a page is made of, beside what was caught.
pub(crate) struct Facts<'a> {
    pub(crate) graph_file: &'a Path,
    pub(crate) loaded: &'a Loaded,
    pub(crate) graph: &'a Graph,
    pub(crate) outcome: &'a Outcome,
    pub(crate) threads: usize,
    pub(crate) memory: u64,
}

/// What became of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Failed,
    Unreached,
    Ran,
    Kept,
    Unused,
}

impl State {
    const ALL: [Self; 5] = [Self::Ran, Self::Kept, Self::Failed, Self::Unreached, Self::Unused];

    /// The style sheet's word, and that for people.
    const fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Failed => ("failed", "failed"),
            Self::Unreached => ("unreached", "not reached"),
            Self::Ran => ("ran", "ran"),
            Self::Kept => ("kept", "all from the cache"),
            Self::Unused => ("unused", "not needed"),
        }
    }
}

pub(super) struct Page<'a> {
    facts: &'a Facts<'a>,
    wanted: Vec<Wanted>,
    caught: BTreeMap<Port, Caught>,
    stats: Vec<NodeStats>,
    /// Nodes that read what was not made, directly or not: a later stage of the run, which was not planned, would have run them.
    cut: Vec<bool>,
}

impl<'a> Page<'a> {
    pub(super) fn new(facts: &'a Facts<'a>, catcher: Catcher) -> Self {
        let (wanted, caught) = catcher.end();
        let mut stats = facts.outcome.report.stats.clone();
        stats.resize(facts.graph.nodes.len(), NodeStats::default());
        let mut page = Self { facts, wanted, caught, stats, cut: Vec::new() };
        page.cut = page.cut_off();
        page
    }

    /// Nodes that failed or were not reached, and all that read them.
    fn cut_off(&self) -> Vec<bool> {
        let nodes = &self.facts.graph.nodes;
        let mut cut: Vec<bool> = (0..nodes.len()).map(|n| self.failures(n) > 0 || self.unreached(n) > 0).collect();
        let reads = |node: usize, cut: &[bool]| {
            nodes[node].inputs.iter().any(|binding| match binding {
                Binding::Wire(port) => cut[port.node],
                Binding::List(ports) => ports.iter().any(|port| cut[port.node]),
                _ => false,
            })
        };
        while let Some(node) = (0..nodes.len()).find(|&n| !cut[n] && reads(n, &cut)) {
            cut[node] = true;
        }
        cut
    }

    pub(super) fn title(&self) -> String {
        escape(&self.facts.graph_file.file_name().unwrap_or_default().to_string_lossy())
    }

    fn failures(&self, node: usize) -> usize {
        self.facts.outcome.report.failures.iter().filter(|f| f.node == node).count()
    }

    /// Tasks that were planned and neither ran, nor failed, nor came from the cache.
    fn unreached(&self, node: usize) -> usize {
        let done = self.stats[node].tasks + self.stats[node].skipped;
        let is_whole = self.facts.outcome.report.is_complete();
        if is_whole { 0 } else { self.wanted[node].tasks.saturating_sub(done as usize + self.failures(node)) }
    }

    fn state(&self, node: usize) -> State {
        match &self.stats[node] {
            _ if self.failures(node) > 0 => State::Failed,
            _ if self.unreached(node) > 0 => State::Unreached,
            stats if stats.tasks > 0 => State::Ran,
            stats if stats.skipped > 0 => State::Kept,
            _ if self.cut[node] => State::Unreached,
            _ => State::Unused,
        }
    }

    /// The share of each node in the longest time.
    fn heat(&self, node: usize) -> f64 {
        let most = self.stats.iter().map(|s| s.time).max().unwrap_or_default().as_secs_f64();
        if most > 0.0 { self.stats[node].time.as_secs_f64() / most } else { 0.0 }
    }

    /// Colours of the nodes in the drawing, by time and by state.
    pub(super) fn style(&self) -> String {
        let mut out = String::new();
        for node in 0..self.stats.len() {
            let share = self.heat(node).sqrt() * 92.0;
            let _ = writeln!(out, ".by-time #n{node} > rect {{ fill: color-mix(in srgb, var(--hot) {share:.0}%, var(--card)); }}");
            let _ = writeln!(out, ".by-state #n{node} > rect {{ fill: var(--{}); }}", self.state(node).words().0);
        }
        out
    }

    pub(super) fn body(&self) -> String {
        let written = self.written();
        let parts =
            [self.head(), self.failed(), self.drawn(), self.table(), settings::parameters(self.facts.loaded), self.nodes(), written];
        let version = env!("CARGO_PKG_VERSION");
        format!("{}<footer>Written by pegbar {version}, {}.</footer>", parts.join("\n"), date(SystemTime::now()))
    }

    /// What was run, how it went, and its totals.
    fn head(&self) -> String {
        let (outcome, report) = (self.facts.outcome, &self.facts.outcome.report);
        let state = match () {
            () if report.cancelled => "cancelled",
            () if outcome.is_complete() => "complete",
            () => "failed",
        };
        let mut out =
            format!("<h1>{} <span class=\"state {state}\">{state}</span></h1>", escape(&self.facts.graph_file.display().to_string()));
        let clocks =
            self.facts.graph.clocks.iter().map(|c| format!("{} {}–{} at {} fps", escape(&c.name), c.first, c.last, round(c.rate())));
        let _ = write!(out, "<p class=\"soft\">{}, {}</p>", count(self.stats.len(), "node"), clocks.collect::<Vec<_>>().join(", "));
        let total = |f: fn(&NodeStats) -> u64| self.stats.iter().map(f).sum::<u64>();
        let rate = outcome.frames as f64 / outcome.wall.as_secs_f64().max(1e-9);
        let work: Duration = self.stats.iter().map(|s| s.time).sum();
        let mut tiles = vec![
            (outcome.frames.to_string(), "frames asked for".to_owned()),
            (duration(outcome.wall), format!("from start to end, {} frames/s", figures(rate))),
            (duration(work), format!("of work in nodes, on {}", count(self.facts.threads, "thread"))),
            (total(|s| s.tasks).to_string(), "tasks ran".to_owned()),
            (total(|s| s.skipped).to_string(), "tasks from the cache".to_owned()),
            (bytes(report.peak_bytes), format!("peak memory of results; {} allowed", bytes(self.facts.memory))),
        ];
        if report.spilled.0 > 0 {
            tiles.push((bytes(report.spilled.1), format!("went to disk, in {} values", report.spilled.0)));
        }
        if !report.failures.is_empty() || report.unreached > 0 {
            tiles.push((
                report.failures.len().to_string(),
                format!("tasks failed; {} of the outputs not made", count(report.unreached, "frame")),
            ));
        }
        out.push_str("<div class=\"tiles\">");
        out.extend(tiles.iter().map(|(value, what)| format!("<div><b>{}</b><span>{}</span></div>", escape(value), escape(what))));
        out + "</div>"
    }

    fn failed(&self) -> String {
        let outcome = self.facts.outcome;
        if outcome.diagnostics.is_empty() {
            return String::new();
        }
        let text = self.facts.loaded.sources.render_all(&outcome.diagnostics, false);
        let mut nodes: Vec<usize> = outcome.report.failures.iter().map(|f| f.node).filter(|n| *n < self.stats.len()).collect();
        nodes.dedup();
        let links: Vec<String> = nodes.iter().map(|n| self.link(*n, &self.facts.graph.nodes[*n].name)).collect();
        let links = if links.is_empty() { String::new() } else { format!("<p>In {}</p>", links.join(", ")) };
        format!("<h2 id=\"failures\">What went wrong</h2>{links}<pre>{}</pre>", escape(&text))
    }

    fn link(&self, node: usize, text: &str) -> String {
        format!("<a href=\"#node-{node}\">{}</a>", escape(text))
    }

    /// The graph, with what each node cost at its foot.
    fn drawn(&self) -> String {
        let notes: Vec<Vec<String>> = (0..self.stats.len()).map(|node| self.notes(node)).collect();
        let svg = draw::svg_noted(self.facts.graph, &notes);
        let swatch = |state: State| format!("<i style=\"background:var(--{})\"></i>{}", state.words().0, state.words().1);
        let states: String = State::ALL.into_iter().map(swatch).collect();
        format!(
            "<h2 id=\"graph\">Graph</h2><div class=\"tools\"><span>Coloured by</span>\
             <button data-colour=\"time\" aria-pressed=\"true\">time</button><button data-colour=\"state\" aria-pressed=\"false\">cache</button>\
             <span class=\"legend\" data-of=\"time\">the more of the longest node's time, the redder</span>\
             <span class=\"legend\" data-of=\"state\" hidden>{states}</span>\
             <button data-zoom=\"in\">+</button><button data-zoom=\"out\">−</button><button data-zoom=\"fit\">whole</button>\
             <span>drag to move, Ctrl and wheel to zoom; a click leads to the node</span></div>\
             <div class=\"graph by-time\">{svg}</div>"
        )
    }

    fn notes(&self, node: usize) -> Vec<String> {
        let (spec, stats) = (&self.facts.graph.nodes[node], &self.stats[node]);
        let mut lines = vec![rate(spec)];
        let failed = self.failures(node);
        match self.state(node) {
            State::Unused => lines.push("not needed".to_owned()),
            _ => {
                let parts = [
                    (stats.tasks as usize, "ran"),
                    (stats.skipped as usize, "cached"),
                    (failed, "failed"),
                    (self.unreached(node), "not reached"),
                ];
                let told: Vec<String> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
                lines.push(if told.is_empty() { "not reached".to_owned() } else { told.join(", ") });
                if stats.tasks > 0 {
                    lines.push(format!("{}, {}", duration(stats.time), bytes(stats.peak_bytes)));
                }
            }
        }
        lines
    }

    /// All nodes, the longest first.
    fn table(&self) -> String {
        let mut order: Vec<usize> = (0..self.stats.len()).collect();
        order.sort_by_key(|n| std::cmp::Reverse(self.stats[*n].time));
        let total: f64 = self.stats.iter().map(|s| s.time.as_secs_f64()).sum();
        let mut out = String::from(
            "<h2 id=\"costs\">What each node cost</h2><div class=\"wide\"><table class=\"list\"><thead><tr>\
             <th data-sort=\"rises\">node</th><th data-sort=\"rises\">type</th><th>rate</th><th data-sort=\"falls\" class=\"n\">ran</th>\
             <th data-sort=\"falls\" class=\"n\">cached</th><th data-sort=\"falls\" class=\"n\">failed</th><th data-sort=\"falls\" class=\"n\">time</th>\
             <th>share</th><th data-sort=\"falls\" class=\"n\">peak memory</th><th data-sort=\"falls\" class=\"n\">scratch</th></tr></thead><tbody>\n",
        );
        for node in order {
            let (spec, stats) = (&self.facts.graph.nodes[node], &self.stats[node]);
            let share = if total > 0.0 { stats.time.as_secs_f64() / total } else { 0.0 };
            let cell = |n: f64, text: String| format!("<td class=\"n\" data-n=\"{n}\">{text}</td>");
            let bar = if share > 0.0 {
                format!("<span class=\"bar\" style=\"width:{:.1}px\"></span> {:.1} %", share * 110.0, share * 100.0)
            } else {
                String::new()
            };
            let _ = writeln!(
                out,
                "<tr><td>{}</td><td class=\"soft\">{}</td><td class=\"soft\">{}</td>{}{}{}{}<td>{bar}</td>{}{}</tr>",
                self.link(node, &spec.name),
                spec.ty.schema.id,
                escape(&rate(spec)),
                cell(stats.tasks as f64, stats.tasks.to_string()),
                cell(stats.skipped as f64, stats.skipped.to_string()),
                cell(self.failures(node) as f64, self.failures(node).to_string()),
                cell(stats.time.as_secs_f64(), duration(stats.time)),
                cell(stats.peak_bytes as f64, bytes(stats.peak_bytes)),
                cell(stats.scratch_bytes as f64, bytes(stats.scratch_bytes)),
            );
        }
        out + "</tbody></table></div>"
    }

    fn nodes(&self) -> String {
        let (graph, report) = (self.facts.graph, &self.facts.outcome.report);
        let values = Values { graph, report, wanted: &self.wanted, caught: &self.caught };
        let cards: String = (0..self.stats.len()).map(|node| self.card(node, &values)).collect();
        format!("<h2 id=\"nodes\">Nodes</h2>{cards}")
    }

    fn card(&self, node: usize, values: &Values<'_>) -> String {
        let (spec, stats) = (&self.facts.graph.nodes[node], &self.stats[node]);
        let word = self.state(node).words().1;
        let mut chips = vec![format!("<b>{word}</b>"), escape(&rate(spec))];
        if self.wanted[node].tasks > 0 {
            let (ran, kept, all) = (stats.tasks, stats.skipped, self.wanted[node].tasks);
            let in_stages = if ran + kept > all as u64 { ", run again in a later stage" } else { "" };
            chips.push(format!("<b>{ran}</b> ran, <b>{kept}</b> cached, of {}{in_stages}", count(all, "task")));
        }
        if stats.tasks > 0 {
            let each = stats.time / u32::try_from(stats.tasks).unwrap_or(u32::MAX);
            chips.push(format!("<b>{}</b>, {} a task", duration(stats.time), duration(each)));
            chips.push(format!("results <b>{}</b> at once, {} in all", bytes(stats.peak_bytes), bytes(stats.bytes)));
            chips.push(format!("scratch {}", bytes(stats.scratch_bytes)));
        }
        let doc = escape(&first_sentence(spec.ty.schema.doc));
        let mut out = format!(
            "<section class=\"node-card\" id=\"node-{node}\"><header><h3>{}</h3><span class=\"soft\">{}</span></header><p class=\"plain\">{doc}</p>\
             <div class=\"chips\">{}</div>\n",
            escape(&spec.name),
            spec.ty.schema.id,
            chips.iter().map(|chip| format!("<span>{chip}</span>")).collect::<String>()
        );
        let failures = self.facts.outcome.report.failures.iter().filter(|f| f.node == node);
        for failure in failures.take(3) {
            let at = failure.frame.map(|f| format!("frame {f}: ")).unwrap_or_default();
            let _ = write!(out, "<p class=\"failed\">{at}{}</p>", escape(&failure.error.message));
        }
        out.push_str("<div class=\"outputs\">");
        (0..spec.ty.schema.outputs.len()).for_each(|output| out.push_str(&values.output(Port { node, output })));
        out.push_str("</div>");
        out.push_str(&settings::of_node(self.facts.loaded, self.facts.graph, spec, |n| format!("<a href=\"#node-{n}\">{{}}</a>")));
        out + "</section>\n"
    }

    /// The files that are there, those of one sequence together.
    fn written(&self) -> String {
        let mut groups: Vec<(String, Vec<&PathBuf>)> = Vec::new();
        for file in &self.facts.outcome.written {
            let name: String = file.to_string_lossy().chars().map(|c| if c.is_ascii_digit() { '#' } else { c }).collect();
            match groups.last_mut().filter(|(last, _)| *last == name) {
                Some((_, files)) => files.push(file),
                None => groups.push((name, vec![file])),
            }
        }
        if groups.is_empty() {
            return "<h2 id=\"files\">Files</h2><p class=\"plain\">none is there</p>".to_owned();
        }
        let mut rows = String::new();
        for (_, files) in &groups {
            let size: u64 = files.iter().filter_map(|f| std::fs::metadata(f).ok()).map(|m| m.len()).sum();
            let name = |f: Option<&&PathBuf>| f.map(|f| escape(&f.display().to_string())).unwrap_or_default();
            let to = if files.len() > 1 { format!(" … {}", name(files.last())) } else { String::new() };
            let _ = write!(
                rows,
                "<tr><td class=\"value\">{}{to}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
                name(files.first()),
                count(files.len(), "file"),
                bytes(size)
            );
        }
        format!("<h2 id=\"files\">Files</h2><div class=\"wide\"><table class=\"list\">{rows}</table></div>")
    }
}

/// How often a node gives a value, and on which clock.
fn rate(node: &GraphNode) -> String {
    let clock = &node.clock;
    let range = format!("{} {}–{}, {} fps", clock.name, clock.first, clock.last, round(clock.rate()));
    match node.ty.schema.kind {
        Kind::Whole => format!("once over {range}"),
        _ if node.per_frame => format!("each of {range}"),
        _ => "once".to_owned(),
    }
}

fn round(rate: f64) -> f64 {
    (rate * 1000.0).round() / 1000.0
}
