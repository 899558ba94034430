//! Why a task runs again: the first fact of its key that differs between two records.
//!
//! The facts of the node itself come first, in the order of its declaration, then those of what it reads, nearest first and in the order of the
//! inputs, at the frames that are really read. Two records are walked side by side, from a node of one to the node of the same name of the other and
//! then along the wires, so that a node that is renamed is not a change. As a key is made of the same facts ([`crate::key`]), none differs where the
//! keys are equal, and one does where they are not.

use std::cell::RefCell;
use std::collections::{HashMap, HashSet, VecDeque};
use std::fmt;

use serde::Serialize;

use crate::diag::SourceMap;
use crate::graph::Graph;
use crate::key::{Fact, FactKind, Mode};
use crate::plan::{Known, PlanError, Planned, Target, plan};
use crate::record::{AskedRun, InputRecord, NodeRecord, Record, UNREAD, WireRecord};
use crate::stamp::Files;

/// Digits of a digest that are shown.
const SHOWN: usize = 12;

/// Why a node runs again, or why it does not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Why {
    /// The node that was asked for.
    pub node: String,
    /// The frame that was asked for.
    pub frame: Option<i64>,
    /// The answer.
    #[serde(flatten)]
    pub verdict: Verdict,
}

/// The answer to why.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "verdict", rename_all = "snake_case")]
pub enum Verdict {
    /// No run of the graph is on record.
    NoRecord,
    /// The node is in no record.
    NewNode {
        /// Where it is written.
        place: String,
    },
    /// The node is on record, but nobody wanted it, or this frame of it.
    NotWanted {
        /// When the last run was.
        last: String,
    },
    /// A fact differs between the last run that wanted it and now: it will run again.
    Changed {
        /// When that run was.
        last: String,
        /// What differs.
        change: Box<Change>,
    },
    /// Nothing has changed since the last run; that one ran it again, as a fact differs from the run before.
    ChangedBefore {
        /// When the last run was.
        last: String,
        /// When the run before was.
        before: String,
        /// What differs.
        change: Box<Change>,
    },
    /// Nothing differs.
    Unchanged {
        /// When the last run was.
        last: String,
        /// What came of the node there.
        outcome: Outcome,
    },
}

/// What came of a node in a run whose facts are those of now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// All its results came from the cache, or were not needed.
    Cached,
    /// It was computed for the first time that is on record.
    First,
    /// It was computed again, as its results had not been worth keeping.
    Unkept,
    /// It was computed again, as the cache did not have its results: they were evicted, or the run before was cut short or had no cache.
    Lost,
    /// The record does not say.
    Unknown,
}

/// A fact that differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Change {
    /// From the node that was asked for to the one whose fact differs, both included.
    pub chain: Vec<String>,
    /// Frame of that node where the fact counts for one frame alone.
    pub frame: Option<i64>,
    /// The input that it is about; none where it is about the node.
    pub input: Option<String>,
    /// What it is, where that is not the input's value: `version`, `last frame of its clock`.
    pub what: Option<String>,
    /// What it was.
    pub was: String,
    /// What it is now.
    pub is: String,
    /// `file:line:column` of what it is now; none where it is written in no graph file.
    pub place: Option<String>,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.chain.len() > 1 {
            write!(f, "{}: ", self.chain.join(" reads "))?;
        }
        write!(f, "{}", self.chain.last().map_or("", String::as_str))?;
        if let Some(input) = &self.input {
            write!(f, ".{input}")?;
        }
        if let Some(frame) = self.frame {
            write!(f, " at frame {frame}")?;
        }
        if let Some(what) = &self.what {
            write!(f, ": {what}")?;
        }
        write!(f, " was {}, is {}", self.was, self.is)?;
        self.place.iter().try_for_each(|place| write!(f, " at {place}"))
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let node = &self.node;
        let name = self.frame.map_or_else(|| node.clone(), |frame| format!("{node}@{frame}"));
        match &self.verdict {
            Verdict::NoRecord => write!(f, "{name} will run: no run of this graph is on record"),
            Verdict::NewNode { place } => write!(f, "{name} will run: no run on record had a node `{node}`, which is written at {place}"),
            Verdict::NotWanted { last } => write!(f, "{name} will run: no run on record wanted it, the last being that of {last}"),
            Verdict::Changed { last, change } => write!(f, "{name} will run again, for a change since the run of {last}:\n  {change}"),
            Verdict::ChangedBefore { last, before, change } => {
                write!(
                    f,
                    "nothing has changed since the run of {last}, which ran {name} again, for a change since that of {before}:\n  {change}"
                )
            }
            Verdict::Unchanged { last, outcome } => {
                let came = match outcome {
                    Outcome::Cached => "its results came from the cache",
                    Outcome::First => "it ran for the first time on record",
                    Outcome::Unkept => "it ran again, as its results had not been worth keeping in the cache",
                    Outcome::Lost => "it ran again, as the cache did not have its results: evicted, cleared, or never made",
                    Outcome::Unknown => "the record does not say what came of it",
                };
                write!(f, "nothing that {name} is made from has changed since the run of {last}; there {came}")
            }
        }
    }
}

/// Why `node`, at `frame` or at any of its frames, runs again: against `records`, the newest first, and the facts of `now`. `None` where there is no
/// such node now.
pub fn why(records: &[Record], now: &Record, node: &str, frame: Option<i64>) -> Option<Why> {
    let NodeRecord { place, frames, .. } = now.nodes.get(now.find(node)?)?.clone();
    // A node that runs once has no frames.
    let frame = frame.and_then(|f| frames.and(Some(f)));
    let answer = |verdict| Some(Why { node: node.to_owned(), frame, verdict });
    let Some(newest) = records.first() else { return answer(Verdict::NoRecord) };
    if records.iter().all(|r| r.find(node).is_none()) {
        return answer(Verdict::NewNode { place });
    }
    let mut wanting = records.iter().filter(|r| wants(r, node, frame));
    let Some(last) = wanting.next() else { return answer(Verdict::NotWanted { last: newest.date.clone() }) };
    if let Some(change) = difference(last, now, node, frame) {
        return answer(Verdict::Changed { last: last.date.clone(), change: Box::new(change) });
    }
    let before = wanting.next();
    if let Some((before, change)) = before.and_then(|b| Some((b, difference(b, last, node, frame)?))) {
        let change = Box::new(change);
        return answer(Verdict::ChangedBefore { last: last.date.clone(), before: before.date.clone(), change });
    }
    answer(Verdict::Unchanged { last: last.date.clone(), outcome: outcome(last, before, node) })
}

/// What the keys of a node at `frame`, or at all its frames, are made from now: what [`why`] holds records against. Runs nothing; where the plan hangs
/// on a value that is to be computed, the facts are those of the whole graph.
///
/// # Errors
/// Where the frame is not on the node's clock, or a file cannot be read.
pub fn now(graph: &Graph, sources: &SourceMap, node: usize, frame: Option<i64>, files: &Files) -> Result<Record, PlanError> {
    let target = Target { node, frames: frame.map(|frame| vec![frame]) };
    match plan(graph, &[target], &[], Known::new())? {
        Planned::Ready(plan) => Record::of(graph, sources, Some(&plan), files),
        Planned::First(_) => Record::of(graph, sources, None, files),
    }
}

fn wants(record: &Record, node: &str, frame: Option<i64>) -> bool {
    record.find(node).is_some_and(|n| {
        let node = &record.nodes[n];
        match frame.filter(|_| node.frames.is_some()) {
            Some(frame) => node.position(frame).is_some(),
            None => !node.wanted.is_empty(),
        }
    })
}

fn outcome(last: &Record, before: Option<&Record>, node: &str) -> Outcome {
    match (last.costs.get(node), before.map(|b| b.costs.get(node))) {
        (None, _) => Outcome::Unknown,
        (Some(cost), _) if cost.computed == 0 => Outcome::Cached,
        (Some(_), None) => Outcome::First,
        (Some(_), Some(before)) if before.is_some_and(|b| b.unkept > 0) => Outcome::Unkept,
        (Some(_), Some(_)) => Outcome::Lost,
    }
}

/// The first fact that differs between two records in what a node is made from: at one frame, or at all that both wanted. `None` where none does.
pub fn difference(old: &Record, new: &Record, node: &str, frame: Option<i64>) -> Option<Change> {
    let pair = Pair { old: old.find(node)?, new: new.find(node)? };
    if old.keys != new.keys {
        let change = Change { what: Some("what keys are made of".to_owned()), ..change(node, &old.keys, &new.keys) };
        return Some(change);
    }
    let (a, b) = (&old.nodes[pair.old], &new.nodes[pair.new]);
    let frames: Vec<i64> = match (frame, b.frames) {
        (_, None) => vec![0],
        (Some(frame), _) => vec![frame],
        (None, _) => b.wanted().filter(|f| a.position(*f).is_some()).collect(),
    };
    let start: Vec<Task> = frames.into_iter().map(|frame| Task { pair, frame }).collect();
    let walk = |judges_constants| Walk { old, new, judges_constants, same: RefCell::default() };
    // A computed constant that differs has its reason upstream, but for what another stage of the run knew.
    let has_constants = old.nodes.iter().chain(&new.nodes).flat_map(|n| &n.facts).any(|f| f.kind == FactKind::Constant);
    walk(false).search(start.clone()).or_else(|| has_constants.then(|| walk(true).search(start)).flatten())
}

fn change(node: &str, was: impl Into<String>, is: impl Into<String>) -> Change {
    Change { chain: vec![node.to_owned()], frame: None, input: None, what: None, was: was.into(), is: is.into(), place: None }
}

/// A node of the old record, and what stands in its place in the new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Pair {
    old: usize,
    new: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Task {
    pair: Pair,
    frame: i64,
}

/// Two records, walked side by side.
struct Walk<'a> {
    old: &'a Record,
    new: &'a Record,
    /// True where the content of a constant counts as a fact of whoever reads it.
    judges_constants: bool,
    /// Tasks in whose keys nothing differs.
    same: RefCell<HashSet<Task>>,
}

impl<'a> Walk<'a> {
    /// The first difference from `start` upstream, nearest first.
    fn search(&self, start: Vec<Task>) -> Option<Change> {
        let mut led: HashMap<Task, Option<Task>> = start.iter().map(|t| (*t, None)).collect();
        let mut queue: VecDeque<Task> = start.into();
        // What is the same for all tasks of a pair is looked at once.
        let mut pairs: HashSet<Pair> = HashSet::new();
        let mut wholes: HashSet<Pair> = HashSet::new();
        while let Some(task) = queue.pop_front() {
            if self.same.borrow().contains(&task) {
                continue;
            }
            let found = if pairs.insert(task.pair) { self.node_change(task.pair) } else { None };
            if let Some(change) = found.or_else(|| self.task_change(task)) {
                return Some(Change { chain: self.chain(task, &led), ..change });
            }
            for next in self.reads(task, &mut wholes) {
                led.entry(next).or_insert_with(|| {
                    queue.push_back(next);
                    Some(task)
                });
            }
        }
        self.same.borrow_mut().extend(led.into_keys());
        None
    }

    /// The names of the nodes that lead to a task.
    fn chain(&self, task: Task, led: &HashMap<Task, Option<Task>>) -> Vec<String> {
        let mut names = Vec::new();
        let mut at = Some(task);
        while let Some(task) = at {
            names.push(self.new.nodes[task.pair.new].name.clone());
            at = led.get(&task).copied().flatten();
        }
        names.reverse();
        // A chain of states is one node.
        names.dedup();
        names
    }

    fn nodes(&self, pair: Pair) -> (&'a NodeRecord, &'a NodeRecord) {
        (&self.old.nodes[pair.old], &self.new.nodes[pair.new])
    }

    /// A fact that differs for all tasks of a node.
    fn node_change(&self, pair: Pair) -> Option<Change> {
        let (old, new) = self.nodes(pair);
        let of = |node: &'a NodeRecord, input: &str| node.facts.iter().filter(|f| f.input == input).collect::<Vec<&Fact>>();
        let names = std::iter::once("").chain(new.inputs.iter().map(|i| i.name.as_str()));
        names.into_iter().find_map(|input| self.fact_change(old, new, &of(old, input), &of(new, input)))
    }

    /// The first of two rows of facts that differs.
    fn fact_change(&self, old: &NodeRecord, new: &NodeRecord, was: &[&Fact], is: &[&Fact]) -> Option<Change> {
        let same = |a: &Fact, b: &Fact| a == b || is_unknown(a, b) || (is_constant(a, b) && !self.judges(a, b));
        let i = (0..was.len().max(is.len())).find(|&i| !was.get(i).zip(is.get(i)).is_some_and(|(a, b)| same(a, b)))?;
        let (was, is) = (was.get(i).copied(), is.get(i).copied());
        let fact = is.or(was)?;
        let plain = |f: Option<&Fact>| f.map_or("none".to_owned(), |f| f.text.clone());
        let about = |what: &str| Change { what: Some(what.to_owned()), ..change(&new.name, plain(was), plain(is)) };
        let input = new.inputs.iter().find(|i| i.name == fact.input);
        let of_clock = |what: &str| Some(Change { input: input.map(|i| i.name.clone()), ..about(what) });
        let here = |change: Change| Some(Change { place: Some(new.place.clone()), ..change });
        match fact.kind {
            FactKind::Type => here(about("its type")),
            FactKind::Version => here(about(&format!("the version of {}", new.facts.first().map_or("its type", |f| &f.text)))),
            FactKind::Rate => of_clock("frames a second of the clock"),
            FactKind::First => of_clock("first frame of the clock"),
            FactKind::Last => of_clock("last frame of the clock"),
            _ => Some(at_input(input?, change(&new.name, written(old, &fact.input, was), written(new, &fact.input, is)))),
        }
    }

    /// True where the content of a constant counts; where no plan was made it is not known.
    fn judges(&self, a: &Fact, b: &Fact) -> bool {
        self.judges_constants && (a.kind == b.kind || (self.old.is_planned && self.new.is_planned))
    }

    /// What differs for one task: what it is wired to, a file that it reads, the frames that it asks for.
    fn task_change(&self, task: Task) -> Option<Change> {
        let (old, new) = self.nodes(task.pair);
        let rewired = || wires(old, new).find_map(|(a, b)| self.rewired(task, a, b));
        let asked = || wires(old, new).find_map(|(a, b)| asked_change(old, new, Some(b), &a.asked, &b.asked, task.frame));
        let state = || asked_change(old, new, None, &old.previous, &new.previous, task.frame);
        rewired().or_else(|| self.file_change(task)).or_else(asked).or_else(state)
    }

    /// An input that is wired to another node, where that one gives something else.
    fn rewired(&self, task: Task, was: &WireRecord, is: &WireRecord) -> Option<Change> {
        let (old, new) = self.nodes(task.pair);
        let (before, after) = (&self.old.nodes[was.node].name, &self.new.nodes[is.node].name);
        let is_renamed = self.old.find(after).is_none() && self.new.find(before).is_none();
        if before == after || is_renamed || constant_is_same(old, new, is) || self.search(self.reads_by(task, was, is)).is_none() {
            return None;
        }
        let input = new.inputs.iter().find(|i| i.name == is.input)?;
        Some(at_input(input, change(&new.name, format!("@{}", was.port), format!("@{}", is.port))))
    }

    /// A file of one frame that differs.
    fn file_change(&self, task: Task) -> Option<Change> {
        let (old, new) = self.nodes(task.pair);
        let files = |record: &'a Record, node: &'a NodeRecord| -> Option<Vec<&'a (String, String)>> {
            let picks = node.files.get(node.position(task.frame)?)?;
            Some(picks.iter().filter_map(|&i| record.files.get(i as usize)).collect())
        };
        let (was, is) = (files(self.old, old)?, files(self.new, new)?);
        let i = (0..was.len().max(is.len())).find(|&i| was.get(i).map(|f| &f.1) != is.get(i).map(|f| &f.1))?;
        let show = |file: Option<&&(String, String)>| file.map_or("no file".to_owned(), |(path, digest)| content(path, digest));
        let change = Change { frame: new.frames.and(Some(task.frame)), ..change(&new.name, show(was.get(i)), show(is.get(i))) };
        // A task of a stream reads one file for each such input, in their order.
        let mut numbered = new.facts.iter().filter(|f| f.kind == FactKind::Files);
        let fact = if new.frames.is_some() { numbered.nth(i) } else { numbered.next() };
        let input = fact.and_then(|f| new.inputs.iter().find(|n| n.name == f.input));
        Some(input.map_or(change.clone(), |input| at_input(input, change)))
    }

    /// The tasks that a task reads, in the order of the inputs, its own state last; a whole sequence for the first alone of those who read it.
    fn reads(&self, task: Task, wholes: &mut HashSet<Pair>) -> Vec<Task> {
        let (old, new) = self.nodes(task.pair);
        let is_new = |a: &WireRecord, b: &WireRecord, wholes: &mut HashSet<Pair>| {
            b.mode != Mode::All || wholes.insert(Pair { old: a.node, new: b.node })
        };
        let wires = wires(old, new).filter(|(a, b)| !constant_is_same(old, new, b) && is_new(a, b, wholes));
        let values = wires.flat_map(|(a, b)| self.reads_by(task, a, b));
        let previous = frames_asked(new.previous.as_deref().or(old.previous.as_deref()), task.frame);
        values.chain(previous.into_iter().map(|frame| Task { frame, ..task })).collect()
    }

    /// The tasks that a task reads by one wire.
    fn reads_by(&self, task: Task, was: &WireRecord, is: &WireRecord) -> Vec<Task> {
        let producer = &self.new.nodes[is.node];
        let frames: Vec<i64> = match is.mode {
            _ if producer.frames.is_none() => vec![0],
            Mode::Same => vec![task.frame],
            Mode::Held => producer.wanted().take(1).collect(),
            Mode::Asked => frames_asked(is.asked.as_deref().or(was.asked.as_deref()), task.frame),
            Mode::All => producer.wanted().collect(),
        };
        let pair = Pair { old: was.node, new: is.node };
        frames.into_iter().map(|frame| Task { pair, frame }).collect()
    }
}

/// The wires of two nodes, side by side. Where their numbers differ a fact does too.
fn wires<'a>(old: &'a NodeRecord, new: &'a NodeRecord) -> impl Iterator<Item = (&'a WireRecord, &'a WireRecord)> {
    old.wires.iter().zip(&new.wires)
}

/// True where one of two facts is the content of a constant, whose reason is upstream, and the other one what is read in its place.
fn is_constant(a: &Fact, b: &Fact) -> bool {
    let is_read = |f: &Fact| matches!(f.kind, FactKind::Wire | FactKind::Constant);
    is_read(a) && is_read(b) && (a.kind == FactKind::Constant || b.kind == FactKind::Constant)
}

/// True where the content of a file was not looked at, as nobody wanted the node.
fn is_unknown(a: &Fact, b: &Fact) -> bool {
    a.kind == FactKind::File && b.kind == FactKind::File && (a.text.ends_with(UNREAD) || b.text.ends_with(UNREAD))
}

/// True where both records know the content of the value at a wire, and it is the same.
fn constant_is_same(old: &NodeRecord, new: &NodeRecord, wire: &WireRecord) -> bool {
    fn digests<'a>(node: &'a NodeRecord, input: &'a str) -> impl Iterator<Item = &'a str> {
        node.facts.iter().filter(move |f| f.kind == FactKind::Constant && f.input == input).map(|f| f.text.as_str())
    }
    digests(new, &wire.input).next().is_some() && digests(old, &wire.input).eq(digests(new, &wire.input))
}

/// What is written at an input, with the content of the file or constant that it stands for.
fn written(node: &NodeRecord, input: &str, fact: Option<&Fact>) -> String {
    let text = node.inputs.iter().find(|i| i.name == input).map_or("nothing", |i| i.text.as_str());
    match fact {
        Some(Fact { kind: FactKind::File | FactKind::Constant, text: digest, .. }) => {
            content(text, digest.rsplit(' ').next().unwrap_or_default())
        }
        _ => text.to_owned(),
    }
}

fn content(name: &str, digest: &str) -> String {
    format!("{name} (content {})", digest.get(..SHOWN).unwrap_or(digest))
}

fn at_input(input: &InputRecord, change: Change) -> Change {
    Change { input: Some(input.name.clone()), place: Some(input.place.clone()), ..change }
}

/// Frames asked for at `frame` that are others than before; where the clock was changed, that is why.
fn asked_change(
    old: &NodeRecord,
    new: &NodeRecord,
    wire: Option<&WireRecord>,
    was: &Option<Vec<AskedRun>>,
    is: &Option<Vec<AskedRun>>,
    frame: i64,
) -> Option<Change> {
    let was = frames_asked(Some(was.as_deref()?), frame);
    let is = is.as_deref().map(|runs| frames_asked(Some(runs), frame));
    if is.as_ref() == Some(&was) {
        return None;
    }
    let about = |what: &str, was: String, is: String| Some(Change { what: Some(what.to_owned()), ..change(&new.name, was, is) });
    let (before, after) = old.frames.zip(new.frames)?;
    if before.0 != after.0 {
        return about("first frame of the clock", before.0.to_string(), after.0.to_string());
    }
    if before.1 != after.1 {
        return about("last frame of the clock", before.1.to_string(), after.1.to_string());
    }
    let list = |frames: Vec<i64>| {
        let shown: Vec<String> = frames.iter().take(8).map(ToString::to_string).collect();
        if frames.is_empty() { "none".to_owned() } else { shown.join(", ") + if frames.len() > 8 { ", ..." } else { "" } }
    };
    let change =
        about(if wire.is_some() { "the frames that it reads" } else { "the frame whose state it starts from" }, list(was), list(is?))?;
    let change = Change { frame: Some(frame), ..change };
    let input = wire.and_then(|w| new.inputs.iter().find(|i| i.name == w.input));
    Some(input.map_or(change.clone(), |input| at_input(input, change)))
}

fn frames_asked(runs: Option<&[AskedRun]>, frame: i64) -> Vec<i64> {
    let runs = runs.unwrap_or_default();
    let run = runs.partition_point(|r| r.first <= frame).checked_sub(1).and_then(|i| runs.get(i));
    let run = run.filter(|r| frame - r.first < r.count);
    run.map_or_else(Vec::new, |r| r.offsets.iter().map(|offset| frame.saturating_add(*offset)).collect())
}
