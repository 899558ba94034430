//! One case of one graph: run, and held against its reference.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use pegbar_engine::check::{Loaded, load};
use pegbar_engine::diag::{Diagnostic, Label, SourceMap};
use pegbar_engine::golden::{
    self, Case, Compared, Difference, GoldenFile, NodeReferences, Reference, Seen, Store, Tolerance, Tolerances, Where, code,
};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::job::{How, Outcome};
use pegbar_engine::registry::Registry;
use pegbar_engine::value::ValueRef;

use super::picture::{self, PixelDifference};
use crate::console::Console;
use crate::resources::Ready;

/// Small pictures by output and frame.
pub(super) type Pictures = BTreeMap<(String, i64), Vec<u8>>;

/// What came of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Verdict {
    Pass,
    /// It left its reference, or has none, or a node failed.
    Left,
    /// The graph or the golden is wrong.
    Wrong,
    Cancelled,
}

/// A frame of an output that is shown beside its reference.
pub(super) struct Shown {
    pub(super) output: String,
    pub(super) frame: i64,
    pub(super) expected: Option<Vec<u8>>,
    pub(super) actual: Vec<u8>,
    pub(super) difference: Option<PixelDifference>,
}

/// One output of a case.
pub(super) struct OutputResult {
    pub(super) name: String,
    pub(super) type_name: String,
    pub(super) frames: Vec<i64>,
    /// By frame, what is not as the reference says, or must not be.
    pub(super) wrong: BTreeMap<i64, Vec<String>>,
    /// Values whose bits differ within the tolerance.
    pub(super) other_bits: usize,
}

/// One case.
pub(super) struct CaseResult {
    pub(super) graph: PathBuf,
    pub(super) case: String,
    pub(super) verdict: Verdict,
    pub(super) outputs: Vec<OutputResult>,
    /// Diagnostics as text.
    pub(super) said: String,
    pub(super) shown: Vec<Shown>,
    pub(super) time: Duration,
    /// True where the reference was written anew.
    pub(super) blessed: bool,
}

/// A case that is to be run.
pub(super) struct Task<'a> {
    pub(super) graph: &'a Path,
    pub(super) golden: &'a GoldenFile,
    pub(super) case: &'a Case,
    pub(super) bless: bool,
}

/// What all cases share.
pub(super) struct Bench<'a> {
    pub(super) registry: &'a Registry,
    pub(super) ready: &'a Ready,
    /// Folder for pictures of what differs.
    pub(super) out: &'a Path,
}

/// A graph that runs, with what its case compares.
struct Subject<'a> {
    task: &'a Task<'a>,
    bench: &'a Bench<'a>,
    sources: &'a SourceMap,
    graph: &'a Graph,
    compared: Vec<Compared>,
    tolerances: Tolerances,
    store: Store,
    golden_path: PathBuf,
}

/// What a run gave.
struct Given {
    outputs: Reference,
    pictures: Pictures,
    outcome: Outcome,
}

pub(super) fn examine(task: &Task, bench: &Bench, console: &mut Console) -> CaseResult {
    let start = Instant::now();
    let mut result = CaseResult {
        graph: task.graph.to_owned(),
        case: task.case.name.clone(),
        verdict: Verdict::Wrong,
        outputs: Vec::new(),
        said: String::new(),
        shown: Vec::new(),
        time: Duration::ZERO,
        blessed: false,
    };
    let base = task.graph.parent().unwrap_or(Path::new(""));
    let mut loaded = load(task.graph, bench.registry, &task.case.load_options(base, PathBuf::from("out")));
    let waits = task.case.only_check && loaded.diagnostics.iter().all(golden::waits_for_values);
    if task.case.only_check && waits {
        result.verdict = Verdict::Pass;
    } else {
        say(&mut result, &loaded.sources, &loaded.diagnostics, console);
        if let Some(graph) = loaded.graph.take().filter(|_| !task.case.only_check) {
            run(task, bench, &loaded, graph, &mut result, console);
        } else {
            let place = task.golden.sources.place(&Label::new(task.golden.file, task.case.span));
            note(&mut result, &format!("the graph is run as case `{}` of {place} says\n", task.case.name), console);
        }
    }
    result.time = start.elapsed();
    result
}

fn run(task: &Task, bench: &Bench, loaded: &Loaded, mut graph: Graph, result: &mut CaseResult, console: &mut Console) {
    task.case.shorten(&mut graph);
    let compared = match golden::compared(&graph, task.case, task.golden.file) {
        Ok(compared) => compared,
        Err(wrong) => return say(result, &task.golden.sources, &[*wrong], console),
    };
    let subject = Subject {
        task,
        bench,
        sources: &loaded.sources,
        graph: &graph,
        compared,
        tolerances: task.case.tolerances(picture::is_picture),
        store: Store::of(task.graph, &task.case.name),
        golden_path: golden::golden_of(task.graph),
    };
    result.verdict = subject.hold(result, console);
}

impl Subject<'_> {
    fn how<'b>(&'b self, console: &Console) -> How<'b> {
        // Records of tests lie beside the golden's name, so that `why` on the graph speaks of runs alone.
        How { cancel: console.cancel.clone(), ..self.bench.ready.how(&self.golden_path, self.sources) }
    }

    fn observe(&self, how: &How) -> Given {
        let pictures: Arc<Mutex<Pictures>> = Arc::default();
        let into = pictures.clone();
        let look = move |output: &str, frame: i64, value: &ValueRef| {
            if let Some(png) = picture::small(value) {
                into.lock().unwrap_or_else(PoisonError::into_inner).insert((output.to_owned(), frame), png);
            }
        };
        let Seen { outputs, outcome } = golden::observe(self.graph, &self.compared, picture::is_picture, how, Some(Arc::new(look)));
        let pictures = std::mem::take(&mut *pictures.lock().unwrap_or_else(PoisonError::into_inner));
        Given { outputs, pictures, outcome }
    }

    /// Runs the case and holds it against its invariants and its reference.
    fn hold(&self, result: &mut CaseResult, console: &mut Console) -> Verdict {
        let given = self.observe(&self.how(console));
        result.outputs = self.compared.iter().map(|c| output_result(c, &given.outputs)).collect();
        if given.outcome.report.cancelled {
            return Verdict::Cancelled;
        }
        if !given.outcome.is_complete() {
            say(result, self.sources, &given.outcome.diagnostics, console);
            return Verdict::Left;
        }
        let mut broken = self.invariants(&given.outputs, result);
        if broken.is_empty() && self.task.case.same_on_threads {
            broken.extend(self.other_threads(&given.outputs, console));
        }
        if !broken.is_empty() {
            say(result, self.sources, &broken, console);
            if self.task.bless {
                note(result, "not blessed: an invariant does not hold\n", console);
            }
            return Verdict::Left;
        }
        match self.store.read() {
            Err(wrong) if !self.task.bless => {
                note(result, &format!("error: {wrong}\n"), console);
                Verdict::Wrong
            }
            Ok(None) if !self.task.bless => self.no_reference(&given, result, console),
            found => self.compare(&found.ok().flatten().unwrap_or_default(), &given, result, console),
        }
    }

    fn compare(&self, reference: &Reference, given: &Given, result: &mut CaseResult, console: &mut Console) -> Verdict {
        let mut wrong = golden::differences(reference, &given.outputs, &self.tolerances);
        self.compare_pictures(reference, given, &mut wrong, result);
        count_other_bits(reference, given, &wrong, &mut result.outputs);
        for ((output, frame), differences) in &wrong {
            if let Some(one) = result.outputs.iter_mut().find(|o| o.name == *output) {
                one.wrong.entry(*frame).or_default().extend(differences.iter().map(ToString::to_string));
            }
        }
        if self.task.bless {
            return self.bless(&wrong, given, result, console);
        }
        if wrong.is_empty() {
            return Verdict::Pass;
        }
        self.find_first(&wrong, result, console);
        for text in super::files::write_pictures(self.bench.out, self.task, &result.shown) {
            note(result, &text, console);
        }
        note(result, &format!("if this was meant: pegbar test {} --bless {}\n", self.task.graph.display(), self.task.case.name), console);
        Verdict::Left
    }

    /// Holds small pictures against those beside the reference, and keeps those that differ to be shown.
    fn compare_pictures(
        &self,
        reference: &Reference,
        given: &Given,
        wrong: &mut BTreeMap<(String, i64), Vec<Difference>>,
        result: &mut CaseResult,
    ) {
        for ((output, frame), actual) in &given.pictures {
            let summary = given.outputs.get(output).and_then(|f| f.get(frame));
            let was = reference.get(output).and_then(|f| f.get(frame));
            let has_same_bits = summary.zip(was).is_some_and(|(a, b)| a.bits.is_some() && a.bits == b.bits);
            if has_same_bits {
                continue;
            }
            let said = self.tolerances.of(output, summary.map_or("", |s| &s.type_name));
            let allowed = said.and_then(|t| t.pixels).unwrap_or(Tolerance::PIXELS);
            let expected = std::fs::read(self.store.picture(output, *frame)).ok();
            let difference = expected.as_ref().and_then(|e| picture::differ(e, actual, allowed));
            if let Some(d) = difference.as_ref().filter(|d| d.beyond.0 > 0) {
                let (worst, x, y) = d.worst;
                let what = format!("picture: {} of {} pixels differ, most of all ({x}, {y}) by {worst:.0} codes", d.beyond.0, d.beyond.1);
                let reason = said.map_or("a code of linear light is up to three of sRGB", |t| t.reason.as_str());
                let allowed = format!("allowed {allowed} of 255 in the small picture ({reason})");
                wrong.entry((output.clone(), *frame)).or_default().push(Difference { allowed, ..Difference::of_value(what) });
            }
            if wrong.contains_key(&(output.clone(), *frame)) {
                result.shown.push(Shown { output: output.clone(), frame: *frame, expected, actual: actual.clone(), difference });
            }
        }
    }

    /// Says where along the graph it began.
    fn find_first(&self, wrong: &BTreeMap<(String, i64), Vec<Difference>>, result: &mut CaseResult, console: &mut Console) {
        let port = |output: &str| self.compared.iter().find(|c| c.name == output).map(|c| c.port);
        let failed: Vec<(Port, i64, Vec<Difference>)> =
            wrong.iter().filter_map(|((output, frame), d)| Some((port(output)?, *frame, d.clone()))).collect();
        let golden = self.store.read_nodes().ok().flatten().unwrap_or_default();
        let (found, _) = golden::observe_nodes(self.graph, &self.recorded(&golden), &self.how(console));
        let Some(departure) = golden::first(self.graph, &failed, &golden, &found, &self.tolerances) else {
            let lines: String = wrong.iter().map(|((o, f), d)| format!("output `{o}` at frame {f}: {}\n", join(d))).collect();
            return note(result, &lines, console);
        };
        let mut diagnostic = departure.to_diagnostic(self.graph);
        for output in result.outputs.iter().filter(|o| !o.wrong.is_empty()) {
            let at_its_own = self.compared.iter().any(|c| c.name == output.name && c.port == departure.port);
            let first = output.wrong.values().next().filter(|_| !at_its_own).map(|w| format!(": {}", w.join("; "))).unwrap_or_default();
            diagnostic = diagnostic.help(format!("output {} left its reference{first}", output.frames_wrong()));
        }
        if golden.is_empty() {
            diagnostic =
                diagnostic.help("there is no reference of nodes, so that nothing is known of what leads there: --bless writes one");
        }
        say(result, self.sources, &[diagnostic], console);
    }

    /// Every port at the frames of its reference, as far as the clock has them; the usual ones where there is none.
    fn recorded(&self, golden: &NodeReferences) -> Vec<Where> {
        let mut places = golden::where_to_look(self.graph, &self.compared, None);
        for place in &mut places {
            let node = &self.graph.nodes[place.port.node];
            let output = node.ty.schema.outputs.get(place.port.output).map_or("", |o| o.name);
            let recorded = golden.get(&node.name).and_then(|n| n.outputs.get(output));
            let frames: Vec<i64> =
                recorded.into_iter().flat_map(|f| f.keys().copied()).filter(|f| node.clock.index(*f).is_some()).collect();
            if !frames.is_empty() {
                place.frames = frames;
            }
        }
        places
    }

    fn bless(
        &self,
        wrong: &BTreeMap<(String, i64), Vec<Difference>>,
        given: &Given,
        result: &mut CaseResult,
        console: &mut Console,
    ) -> Verdict {
        let places = golden::where_to_look(self.graph, &self.compared, given.outcome.report.plan.as_ref());
        let (nodes, outcome) = golden::observe_nodes(self.graph, &places, &self.how(console));
        if !outcome.is_complete() {
            say(result, self.sources, &outcome.diagnostics, console);
            return if outcome.report.cancelled { Verdict::Cancelled } else { Verdict::Left };
        }
        match super::files::write_reference(&self.store, self.task.graph, &given.outputs, &nodes, &given.pictures) {
            Ok(changed) => {
                result.blessed = changed;
                let name = format!("{} {}", self.task.graph.display(), self.task.case.name);
                for ((output, frame), d) in wrong {
                    console.out(&format!("blessed {name}: output `{output}` at frame {frame}: {}\n", join(d)));
                }
                if changed && wrong.is_empty() {
                    console.out(&format!("blessed {name}: nothing beyond its tolerance changed\n"));
                }
                Verdict::Pass
            }
            Err(why) => {
                note(result, &format!("error: {why}\n"), console);
                Verdict::Wrong
            }
        }
    }

    fn no_reference(&self, given: &Given, result: &mut CaseResult, console: &mut Console) -> Verdict {
        for output in &mut result.outputs {
            let none = |f: &i64| (*f, vec!["expected a reference, found none".to_owned()]);
            output.wrong = output.frames.iter().map(none).collect();
        }
        let shown = |((output, frame), actual): (&(String, i64), &Vec<u8>)| Shown {
            output: output.clone(),
            frame: *frame,
            expected: None,
            actual: actual.clone(),
            difference: None,
        };
        result.shown = given.pictures.iter().map(shown).collect();
        let message = format!("expected the reference {}, found none", self.store.outputs().display());
        let wrong = Diagnostic::error(code::NO_REFERENCE, message, Label::new(self.task.golden.file, self.task.case.span));
        let help = format!("look at what it gives, then: pegbar test {} --bless {}", self.task.graph.display(), self.task.case.name);
        say(result, &self.task.golden.sources, &[wrong.help(help)], console);
        Verdict::Left
    }

    fn invariants(&self, found: &Reference, result: &mut CaseResult) -> Vec<Diagnostic> {
        let mut wrong = Vec::new();
        for (compared, output) in self.compared.iter().zip(&mut result.outputs) {
            for (frame, summary) in found.get(&compared.name).into_iter().flatten() {
                let rules = self.task.case.invariants_of(&compared.name, &summary.type_name);
                let broken: Vec<String> = rules.flat_map(|i| i.broken_by(summary)).collect();
                if !broken.is_empty() && output.wrong.is_empty() {
                    wrong.push(self.at_node(compared, *frame, &broken.join("; ")));
                }
                if !broken.is_empty() {
                    output.wrong.entry(*frame).or_default().extend(broken);
                }
            }
        }
        wrong
    }

    fn at_node(&self, compared: &Compared, frame: i64, what: &str) -> Diagnostic {
        let node = &self.graph.nodes[compared.port.node];
        let message = format!("output `{}` at frame {frame}: {what}", compared.name);
        Diagnostic::error(code::INVARIANT, message, Label::new(node.file, node.span))
    }

    /// Runs again on another number of threads, with nothing from the cache.
    fn other_threads(&self, first: &Reference, console: &Console) -> Option<Diagnostic> {
        let threads = if self.bench.ready.threads == 1 { 3 } else { 1 };
        let how = How { threads, keep: None, ..self.how(console) };
        let again = golden::observe(self.graph, &self.compared, picture::is_picture, &how, None);
        let (output, frame) = golden::same_bits(first, &again.outputs)?;
        let compared = self.compared.iter().find(|c| c.name == output)?;
        let what = format!("expected the same bits on {} threads and on {threads}, found others", self.bench.ready.threads);
        Some(self.at_node(compared, frame, &what))
    }
}

fn output_result(compared: &Compared, found: &Reference) -> OutputResult {
    let values = found.get(&compared.name);
    let type_name = values.and_then(|v| v.values().next()).map(|s| s.type_name.clone()).unwrap_or_default();
    OutputResult { name: compared.name.clone(), type_name, frames: compared.frames.clone(), wrong: BTreeMap::new(), other_bits: 0 }
}

fn count_other_bits(reference: &Reference, given: &Given, wrong: &BTreeMap<(String, i64), Vec<Difference>>, outputs: &mut [OutputResult]) {
    for output in outputs {
        let values = given.outputs.get(&output.name).into_iter().flatten();
        let was = |frame: &i64| reference.get(&output.name).and_then(|f| f.get(frame)).and_then(|s| s.bits.as_ref());
        let others =
            values.filter(|(f, s)| was(f).is_some_and(|b| s.bits.as_ref() != Some(b)) && !wrong.contains_key(&(output.name.clone(), **f)));
        output.other_bits = others.count();
    }
}

impl OutputResult {
    /// `image at frames 1, 8`.
    pub(super) fn frames_wrong(&self) -> String {
        let frames: Vec<i64> = self.wrong.keys().copied().collect();
        let s = if frames.len() == 1 { "" } else { "s" };
        format!("{} at frame{s} {}", self.name, pegbar_engine::job::frame_ranges(&frames))
    }
}

fn join(differences: &[Difference]) -> String {
    differences.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

fn say(result: &mut CaseResult, sources: &SourceMap, diagnostics: &[Diagnostic], console: &mut Console) {
    console.diagnostics(sources, diagnostics);
    result.said.push_str(&sources.render_all(diagnostics, false));
}

fn note(result: &mut CaseResult, text: &str, console: &mut Console) {
    console.say(text);
    result.said.push_str(text);
}
