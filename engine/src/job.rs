//! A job: what of a graph is to be made, and what came of it, in words that point at the graph file.
//!
//! [`Job::new`] chooses the targets and holds frame ranges against clocks, [`Job::prepare`] sees to it that the output folder can be written
//! before anything runs, and [`Job::run`] runs and turns failures into located [`Diagnostic`]s, one for each node and message.

mod frames;
mod history;
mod tap;

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::atomic;
use crate::diag::{Diagnostic, Label, Severity};
use crate::exec::{CacheUse, Failure, Measure, Observer, Options, Preview, Report, Silent, execute, preview};
use crate::graph::{Graph, Port};
use crate::node::{Cancel, Fault, Kind, NodeError};
use crate::plan::{PlanError, Target};
use crate::stamp::{Files, Memo};

pub use history::Keep;

pub use frames::{FrameRange, FrameSet, FramesError, frame_ranges};
use history::History;
use tap::Tap;
pub use tap::{Each, Listener};

/// The codes of what can go wrong with a job.
pub mod code {
    /// A node failed.
    pub const NODE_FAILED: &str = "PB0500";
    /// A plugin was refused, or broke its contract.
    pub const PLUGIN_CONTRACT: &str = "PB0503";
    /// A plugin ended its process.
    pub const PLUGIN_CRASHED: &str = "PB0504";
    /// A plugin gave no sign of life.
    pub const PLUGIN_HUNG: &str = "PB0505";
    /// A plugin took more memory than it may.
    pub const PLUGIN_MEMORY: &str = "PB0506";
    /// A file that should have been written is not there.
    pub const MISSING_OUTPUT: &str = "PB0501";
    /// Nothing could move any more.
    pub const STUCK: &str = "PB0502";
    /// A frame that the clock does not have, or a frame range that is none.
    pub const BAD_FRAMES: &str = "PB0510";
    /// `--only` names a node or an output that there is not.
    pub const UNKNOWN_TARGET: &str = "PB0511";
    /// The graph has nothing that writes.
    pub const NOTHING_TO_RUN: &str = "PB0512";
    /// The output folder cannot be written.
    pub const BAD_OUTPUT_FOLDER: &str = "PB0513";
}

/// What the caller asks for.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// A node, or one of its outputs as `node.port`; every sink of the graph where `None`.
    pub only: Option<String>,
    /// Frames, of each target's own clock; all of them where `None`.
    pub frames: Option<FrameSet>,
    /// The output folder.
    pub out: PathBuf,
}

/// How a job is run.
pub struct How<'a> {
    /// Threads, at least one.
    pub threads: usize,
    /// The most bytes that results and the scratch of running nodes may have together; `None` for as many as there may be.
    pub memory: Option<u64>,
    /// What has to be asked for so that a run has so many bytes: errors name it.
    pub asked: fn(u64) -> u64,
    /// The folder for what does not fit.
    pub spill: PathBuf,
    /// The cache, and what is kept there.
    pub keep: Option<Keep<'a>>,
    /// Counts what a task allocates.
    pub measure: Option<Measure>,
    /// Ends the run.
    pub cancel: Cancel,
    /// Is told what happens.
    pub observer: &'a dyn Observer,
}

impl Default for How<'_> {
    fn default() -> Self {
        Self {
            threads: 1,
            memory: None,
            asked: |bytes| bytes,
            spill: std::env::temp_dir(),
            keep: None,
            measure: None,
            cancel: Cancel::default(),
            observer: &Silent,
        }
    }
}

/// A graph with its targets.
pub struct Job {
    /// The graph, with a tap at each output that is taken without a sink.
    graph: Graph,
    /// Nodes of the graph as it was given; those behind are taps.
    nodes: usize,
    targets: Vec<Target>,
    taps: Vec<Tap>,
    out: PathBuf,
}

/// What came of a job.
pub struct Outcome {
    /// What went wrong, each pointing at a node of the graph file.
    pub diagnostics: Vec<Diagnostic>,
    /// The executor's report; its statistics are of the graph's own nodes.
    pub report: Report,
    /// Files that were asked for and are there, in the order of the graph and the frames.
    pub written: Vec<PathBuf>,
    /// Distinct frames asked for; 1 where nothing that was asked for changes over time.
    pub frames: usize,
    /// Time from start to end.
    pub wall: Duration,
}

impl Outcome {
    /// True where every output that was asked for exists and is whole.
    pub fn is_complete(&self) -> bool {
        self.report.is_complete() && self.diagnostics.is_empty()
    }
}

/// True for a node whose work is what it leaves behind.
fn is_sink(graph: &Graph, node: usize) -> bool {
    let schema = &graph.nodes[node].ty.schema;
    schema.kind == Kind::Sink || schema.outputs.is_empty()
}

impl Job {
    /// Chooses what is to be made.
    ///
    /// # Errors
    /// Where there is nothing to make, the target is not in the graph, or a frame is not on its clock.
    pub fn new(graph: &Graph, request: &Request) -> Result<Self, Box<Diagnostic>> {
        let mut job =
            Self { graph: graph.clone(), nodes: graph.nodes.len(), targets: Vec::new(), taps: Vec::new(), out: request.out.clone() };
        let nodes = match &request.only {
            Some(name) => job.choose(name)?,
            None => job.sinks()?,
        };
        let mut any_frames = false;
        for node in nodes {
            let spec = &job.graph.nodes[node];
            let frames = match &request.frames {
                Some(set) if !spec.runs_once() => Some(set.on(&spec.clock).map_err(|e| Box::new(bad_frames(&e)))?),
                _ => None,
            };
            any_frames |= frames.is_some();
            job.targets.push(Target { node, frames });
        }
        match &request.frames {
            Some(set) if !any_frames => Err(frames_of_nothing(set).into()),
            _ => Ok(job),
        }
    }

    /// A job that writes nothing: it gives outputs to those who want to look at them, and lets each value go when it was looked at.
    pub fn listening(graph: &Graph, listeners: Vec<Listener>) -> Self {
        let mut job = Self { graph: graph.clone(), nodes: graph.nodes.len(), targets: Vec::new(), taps: Vec::new(), out: PathBuf::new() };
        for Listener { port, frames, each } in listeners {
            let node = tap::ear(graph, port, each);
            let frames = frames.filter(|_| node.per_frame);
            job.targets.push(Target { node: job.graph.nodes.len(), frames });
            job.graph.nodes.push(node);
        }
        job
    }

    fn sinks(&self) -> Result<Vec<usize>, Box<Diagnostic>> {
        let sinks: Vec<usize> = (0..self.nodes).filter(|&n| is_sink(&self.graph, n)).collect();
        if sinks.is_empty() { Err(nothing_to_run(&self.graph).into()) } else { Ok(sinks) }
    }

    /// The node called `name`, if it is a sink; else a tap on each of its outputs, or on the one that is named.
    fn choose(&mut self, name: &str) -> Result<Vec<usize>, Box<Diagnostic>> {
        if let Some(node) = self.graph.find(name) {
            if is_sink(&self.graph, node) {
                return Ok(vec![node]);
            }
            let outputs = self.graph.nodes[node].ty.schema.outputs.len();
            return Ok((0..outputs).map(|output| self.tap(Port { node, output })).collect());
        }
        let port = name.rsplit_once('.').and_then(|(node, port)| {
            let node = self.graph.find(node)?;
            let (output, _) = self.graph.nodes[node].ty.schema.output(port)?;
            Some(Port { node, output })
        });
        let declared = || self.graph.outputs.iter().find(|(n, _)| n == name).map(|(_, p)| *p);
        match port.or_else(declared) {
            Some(port) => Ok(vec![self.tap(port)]),
            None => Err(unknown_target(&self.graph, name).into()),
        }
    }

    fn tap(&mut self, port: Port) -> usize {
        let file = self.out.join(format!("{}.npz", self.graph.port_name(port).replace('/', ".")));
        let (tap, node) = Tap::new(&self.graph, port, file);
        self.taps.push(tap);
        self.graph.nodes.push(node);
        self.graph.nodes.len() - 1
    }

    /// Indices of the nodes that are asked for, with the frames of each; a node at or above [`Job::node_count`] collects an output.
    pub fn targets(&self) -> &[Target] {
        &self.targets
    }

    /// Number of nodes of the graph as it was given.
    pub fn node_count(&self) -> usize {
        self.nodes
    }

    /// Distinct frames asked for; 1 where nothing changes over time.
    pub fn frame_count(&self) -> usize {
        let mut frames: Vec<i64> = self.targets.iter().flat_map(|t| self.frames_of(t)).collect();
        frames.sort_unstable();
        frames.dedup();
        frames.len().max(1)
    }

    fn frames_of(&self, target: &Target) -> Vec<i64> {
        let node = &self.graph.nodes[target.node];
        match &target.frames {
            Some(frames) => frames.clone(),
            None if node.runs_once() => vec![node.clock.first],
            None => node.clock.frames().collect(),
        }
    }

    /// Makes the output folder and tries to write into it, so that a run does not end in an error that was there from the start; and removes what
    /// killed runs left there half written.
    ///
    /// # Errors
    /// Where the folder cannot be made or written.
    pub fn prepare(&self) -> Result<(), Box<Diagnostic>> {
        let files = self.files();
        if self.taps.is_empty() && files.is_empty() {
            return Ok(());
        }
        atomic::sweep(files.iter().map(|(_, file)| file.as_path()));
        let made = std::fs::create_dir_all(&self.out).and_then(|()| tempfile::tempfile_in(&self.out).map(drop));
        made.map_err(|error| {
            let message = format!("expected an output folder that can be written at {}, found: {error}", self.out.display());
            Diagnostic::new(Severity::Error, code::BAD_OUTPUT_FOLDER, message)
                .help("choose another folder with --out, or free this one")
                .into()
        })
    }

    /// Runs the graph. A failing node stops what hangs on it and nothing else.
    pub fn run(&self, how: &How) -> Outcome {
        let start = Instant::now();
        let ran = self.with_options(how, |options, history| {
            let ran = execute(&self.graph, &self.targets, &[], options);
            if let (Ok(report), Some(history)) = (&ran, history) {
                history.save(&self.graph, report);
            }
            ran
        });
        let (mut report, mut diagnostics) = match ran {
            Ok(report) => (report, Vec::new()),
            Err(error) => (Report { unreached: self.targets.len(), ..Report::default() }, vec![self.plan_failed(&error)]),
        };
        diagnostics.extend(self.failures(&report.failures));
        diagnostics.extend(report.stuck.iter().map(|who| stuck(who)));
        if report.failures.is_empty() && !report.cancelled && diagnostics.is_empty() {
            diagnostics.extend(self.write_taps());
        }
        let written = if diagnostics.is_empty() && report.is_complete() { self.look_for_files(&mut diagnostics) } else { self.present() };
        report.stats.truncate(self.nodes);
        Outcome { diagnostics, report, written, frames: self.frame_count(), wall: start.elapsed() }
    }

    /// Finds what a run would do, and runs nothing.
    ///
    /// # Errors
    /// Where a node asks for a frame that there is not, or a file cannot be read.
    pub fn preview(&self, how: &How) -> Result<Preview, Box<Diagnostic>> {
        self.with_options(how, |options, _| preview(&self.graph, &self.targets, options))
            .map_err(|error| Box::new(self.plan_failed(&error)))
    }

    /// Sets up what earlier runs left behind.
    fn with_options<T>(&self, how: &How, work: impl FnOnce(&Options, Option<&History>) -> T) -> T {
        let memo = how.keep.as_ref().map(|keep| keep.cache.as_ref() as &dyn Memo);
        let files = Files::new(memo);
        let history = how.keep.as_ref().map(|keep| History::new(keep, &files));
        let expected = history.as_ref().map(|h| h.expected(&self.graph)).unwrap_or_default();
        let policies = how.keep.as_ref().map(|keep| keep.policies(&self.graph)).unwrap_or_default();
        let cache = how.keep.as_ref().map(|keep| CacheUse { cache: keep.cache.clone(), files: &files, policies: &policies });
        let options = Options {
            threads: how.threads,
            in_flight: 0,
            memory: how.memory,
            asked: how.asked,
            spill: how.spill.clone(),
            cache,
            expected: &expected,
            measure: how.measure,
            cancel: how.cancel.clone(),
            observer: how.observer,
        };
        work(&options, history.as_ref())
    }

    /// One diagnostic for each node and message, in the order of the graph; messages that differ in the frame's number alone are one, told by its
    /// first; and limits that differ in what was found are one, told by the largest.
    fn failures(&self, failures: &[Failure]) -> Vec<Diagnostic> {
        let mut groups: BTreeMap<(usize, String), Vec<&Failure>> = BTreeMap::new();
        for failure in failures.iter().filter(|f| !f.error.cancelled) {
            groups.entry((failure.node, gist(failure))).or_default().push(failure);
        }
        let told = |((node, _), mut group): ((usize, String), Vec<&Failure>)| {
            // Of two numbers the larger is the longer, or comes later in the alphabet.
            group.sort_by_key(|f| (f.error.fault == Fault::Limit).then(|| Reverse((f.error.message.len(), f.error.message.clone()))));
            Some(self.failed(node, group.iter().filter_map(|f| f.frame).collect(), &group.first()?.error, &group.first()?.inputs))
        };
        groups.into_iter().filter_map(told).collect()
    }

    fn failed(&self, node: usize, mut frames: Vec<i64>, error: &NodeError, inputs: &[String]) -> Diagnostic {
        frames.sort_unstable();
        let spec = &self.graph.nodes[node];
        let when = match frames.len() {
            0 => String::new(),
            1 => format!(" at frame {}", frame_ranges(&frames)),
            _ => format!(" at frames {}", frame_ranges(&frames)),
        };
        let mut label = Label::new(spec.file, spec.span);
        label.text = spec.ty.schema.id.to_owned();
        if !inputs.is_empty() {
            // Writing into a string cannot fail.
            let _ = write!(label.text, " with {}", inputs.join(", "));
        }
        let code = match error.fault {
            Fault::Plugin => code::PLUGIN_CONTRACT,
            Fault::PluginCrash => code::PLUGIN_CRASHED,
            Fault::PluginHang => code::PLUGIN_HUNG,
            Fault::PluginMemory => code::PLUGIN_MEMORY,
            _ => code::NODE_FAILED,
        };
        let failed = Diagnostic::error(code, format!("node `{}` failed{when}: {}", spec.name, error.message), label);
        error.help.iter().fold(failed, |d, help| d.help(help.clone()))
    }

    fn plan_failed(&self, error: &PlanError) -> Diagnostic {
        self.failed(error.node, error.frame.into_iter().collect(), &error.error, &[])
    }

    /// Writes what the taps collected, a file each.
    fn write_taps(&self) -> Vec<Diagnostic> {
        let failed = |tap: &Tap| tap.write().err().map(|error| self.failed(tap.port.node, Vec::new(), &error, &[]));
        self.taps.iter().filter_map(failed).collect()
    }

    /// Every file that the targets write, with the node that does.
    fn files(&self) -> Vec<(usize, PathBuf)> {
        let mut files: Vec<(usize, PathBuf)> = self.taps.iter().flat_map(|t| t.files().into_iter().map(|f| (t.port.node, f))).collect();
        for target in &self.targets {
            for path in self.graph.nodes[target.node].written_paths() {
                let node = &self.graph.nodes[target.node];
                let frames = match (path.is_sequence(), node.ty.schema.kind) {
                    (false, _) => vec![0],
                    // A node that runs once over a stream writes a file for each of its frames.
                    (true, Kind::Whole) => node.clock.frames().collect(),
                    (true, _) => self.frames_of(target),
                };
                files.extend(frames.into_iter().map(|f| (target.node, path.at(f))));
            }
        }
        files
    }

    fn present(&self) -> Vec<PathBuf> {
        self.files().into_iter().map(|(_, path)| path).filter(|p| is_whole(p)).collect()
    }

    /// The files that are there, and a diagnostic for each node of which some are not.
    fn look_for_files(&self, diagnostics: &mut Vec<Diagnostic>) -> Vec<PathBuf> {
        let (present, absent): (Vec<_>, Vec<_>) = self.files().into_iter().partition(|(_, p)| is_whole(p));
        let mut by_node: BTreeMap<usize, Vec<PathBuf>> = BTreeMap::new();
        for (node, path) in absent {
            by_node.entry(node).or_default().push(path);
        }
        for (node, paths) in by_node {
            let spec = &self.graph.nodes[node];
            let first = paths.first().map(|p| p.display().to_string()).unwrap_or_default();
            let more = if paths.len() > 1 { format!(" and {} more", paths.len() - 1) } else { String::new() };
            let message = format!("expected a file at {first}{more} from node `{}`, found none", spec.name);
            diagnostics.push(Diagnostic::error(code::MISSING_OUTPUT, message, Label::new(spec.file, spec.span)));
        }
        present.into_iter().map(|(_, path)| path).collect()
    }
}

fn is_whole(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| m.is_file() && m.len() > 0)
}

fn bad_frames(error: &FramesError) -> Diagnostic {
    let help = "frames are numbers and ranges of the graph's clock, as 5, 1-48, 1-48x2 or 1-10,20";
    Diagnostic::new(Severity::Error, code::BAD_FRAMES, error.to_string()).help(help)
}

fn frames_of_nothing(set: &FrameSet) -> Diagnostic {
    let message = format!("expected a target with a value a frame for frames {set}, found only targets that run once");
    Diagnostic::new(Severity::Error, code::BAD_FRAMES, message).help("leave --frames out")
}

fn unknown_target(graph: &Graph, name: &str) -> Diagnostic {
    let mut known: Vec<String> = graph.nodes.iter().map(|n| n.name.clone()).collect();
    for (i, node) in graph.nodes.iter().enumerate() {
        known.extend((0..node.ty.schema.outputs.len()).map(|output| graph.port_name(Port { node: i, output })));
    }
    let found = Diagnostic::new(Severity::Error, code::UNKNOWN_TARGET, format!("expected a node of the graph, found `{name}`"));
    let hinted = found.did_you_mean(name, known.iter().map(String::as_str));
    if !hinted.help.is_empty() {
        return hinted;
    }
    let names: Vec<&str> = graph.nodes.iter().map(|n| n.name.as_str()).take(12).collect();
    let more = if graph.nodes.len() > names.len() { ", ..." } else { "" };
    hinted.help(format!("the nodes are {}{more}", names.join(", ")))
}

fn stuck(who: &str) -> Diagnostic {
    let message = format!("expected a task that can run, found none that can move: {who}");
    Diagnostic::new(Severity::Error, code::STUCK, message).help("this is a fault of Pegbar: please report it with the graph")
}

fn nothing_to_run(graph: &Graph) -> Diagnostic {
    let found = Diagnostic::new(Severity::Error, code::NOTHING_TO_RUN, "expected a node that writes files, found none in the graph");
    let found = found.help("add one, such as \"out\": (type: \"io.write_images\", image: \"@comp\", path: \"$out/comp.####.exr\")");
    let takes: Vec<String> = graph.outputs.iter().map(|(_, port)| graph.port_name(*port)).collect();
    let example = takes.first().cloned().or_else(|| graph.nodes.last().map(|n| n.name.clone()));
    match example {
        Some(name) => found.help(format!("or write the values of a node as .npz with --only, such as --only {name}")),
        None => found,
    }
}

/// What failures that are told as one have in common: the message with the frame's number, however padded, left open; of a limit with every number.
fn gist(failure: &Failure) -> String {
    let message = &failure.error.message;
    match failure.frame {
        _ if failure.error.fault == Fault::Limit => without(message, |_| true),
        Some(frame) => without(message, |number| number.parse() == Ok(frame.unsigned_abs())),
        None => message.clone(),
    }
}

fn without(message: &str, is_open: impl Fn(&str) -> bool) -> String {
    let mut out = String::with_capacity(message.len());
    let mut rest = message;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let digits = rest[start..].bytes().take_while(u8::is_ascii_digit).count();
        let (before, number) = (&rest[..start], &rest[start..start + digits]);
        out.push_str(before);
        out.push_str(if is_open(number) { "#" } else { number });
        rest = &rest[start + digits..];
    }
    out + rest
}
