//! Running a graph for its golden, and walking up it to where a difference begins.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::check;
use crate::diag::{Diagnostic, FileId, Label};
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::job::{How, Job, Listener, Outcome};
use crate::plan::{Plan, consumers_first, wires};
use crate::setting::FileUse;
use crate::value::ValueRef;

use super::code;
use super::compare::{Difference, Tolerances, compare};
use super::file::{Case, first_middle_last};
use super::reference::{NodeReference, NodeReferences, Reference};
use super::summary::Summary;

/// The most frames of one output of a node that are kept to find where a difference begins.
const MOST_FRAMES: usize = 8;
/// The longest setting that a reference holds in words.
const LONGEST_SETTING: usize = 80;

/// An output that is compared, and at which frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// Its name: as the graph declares it, or `node.port`.
    pub name: String,
    /// Where it comes from.
    pub port: Port,
    /// The frames of its clock.
    pub frames: Vec<i64>,
}

/// Is shown each value that is compared: output, frame, value.
pub type Look = Arc<dyn Fn(&str, i64, &ValueRef) + Send + Sync>;

/// What outputs gave.
pub struct Seen {
    /// Their summaries.
    pub outputs: Reference,
    /// What came of the run.
    pub outcome: Outcome,
}

/// The outputs that a case compares; what is wrong with it points into the golden file.
///
/// # Errors
/// Where the graph has no such output, or its clock no such frames.
pub fn compared(graph: &Graph, case: &Case, file: FileId) -> Result<Vec<Compared>, Box<Diagnostic>> {
    let unfit = |message: String| Box::new(Diagnostic::error(code::UNFIT, message, Label::new(file, case.span)));
    let named = |name: &String| match port(graph, name) {
        Some(port) => Ok((name.clone(), port)),
        None => Err(unknown(graph, name, &unfit)),
    };
    let chosen: Vec<(String, Port)> = match &case.outputs[..] {
        [] => graph.outputs.clone(),
        names => names.iter().map(named).collect::<Result<_, _>>()?,
    };
    if chosen.is_empty() {
        let found = unfit("expected declared `outputs` to compare, found none".to_owned());
        return Err(Box::new(found.help("declare what the graph is for, or name outputs as [\"node.port\"] in the golden")));
    }
    let one = |(name, port): (String, Port)| {
        let clock = &graph.nodes[port.node].clock;
        let frames = if graph.is_single(port) { Ok(vec![clock.first]) } else { case.frames_on(clock) };
        frames.map(|frames| Compared { name: name.clone(), port, frames }).map_err(|e| unfit(format!("output `{name}`: {e}")))
    };
    chosen.into_iter().map(one).collect()
}

fn unknown(graph: &Graph, name: &str, unfit: &impl Fn(String) -> Box<Diagnostic>) -> Box<Diagnostic> {
    let ports =
        (0..graph.nodes.len()).flat_map(|n| (0..graph.nodes[n].ty.schema.outputs.len()).map(move |output| Port { node: n, output }));
    let known: Vec<String> = graph.outputs.iter().map(|(n, _)| n.clone()).chain(ports.map(|p| graph.port_name(p))).collect();
    let found = unfit(format!("expected an output of the graph, found `{name}`")).did_you_mean(name, known.iter().map(String::as_str));
    let declared: Vec<&str> = graph.outputs.iter().map(|(n, _)| n.as_str()).collect();
    Box::new(if found.help.is_empty() { found.help(format!("it declares {}", declared.join(", "))) } else { found })
}

/// The output called `name`, `node.port`, or the first of `node`.
fn port(graph: &Graph, name: &str) -> Option<Port> {
    if let Some((_, port)) = graph.outputs.iter().find(|(n, _)| n == name) {
        return Some(*port);
    }
    let first = |node: usize| (!graph.nodes[node].ty.schema.outputs.is_empty()).then_some(Port { node, output: 0 });
    graph.find(name).and_then(first).or_else(|| {
        let (node, port) = name.rsplit_once('.')?;
        let node = graph.find(node)?;
        Some(Port { node, output: graph.nodes[node].ty.schema.output(port)?.0 })
    })
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs what the outputs need and no more; each value is shown to `look`, summed up and let go.
pub fn observe(graph: &Graph, compared: &[Compared], is_picture: fn(&str) -> bool, how: &How, look: Option<Look>) -> Seen {
    let seen = Arc::new(Mutex::new(Reference::new()));
    let listener = |one: &Compared| {
        let (into, name, look) = (seen.clone(), one.name.clone(), look.clone());
        let each = move |frame: i64, value: &ValueRef| {
            let summary = Summary::new(value.as_ref(), is_picture(value.type_name()));
            if let Some(look) = &look {
                look(&name, frame, value);
            }
            lock(&into).entry(name.clone()).or_default().insert(frame, summary);
        };
        Listener { port: one.port, frames: Some(one.frames.clone()), each: Arc::new(each) }
    };
    let outcome = Job::listening(graph, compared.iter().map(listener).collect()).run(how);
    Seen { outputs: std::mem::take(&mut *lock(&seen)), outcome }
}

/// The first output and frame whose bits are not the same in two runs.
pub fn same_bits(one: &Reference, other: &Reference) -> Option<(String, i64)> {
    let bits = |of: &Reference| -> Vec<(String, i64, Option<String>)> {
        of.iter().flat_map(|(n, frames)| frames.iter().map(|(f, s)| (n.clone(), *f, s.bits.clone()))).collect()
    };
    let (one, other) = (bits(one), bits(other));
    one.iter().zip(&other).find(|(a, b)| a != b).map(|(a, _)| (a.0.clone(), a.1))
}

/// All nodes that lead to `ports`, those that make before those that read.
pub fn upstream(graph: &Graph, ports: &[Port]) -> Vec<usize> {
    let mut found: BTreeSet<usize> = BTreeSet::new();
    let mut open: Vec<usize> = ports.iter().map(|p| p.node).collect();
    while let Some(node) = open.pop() {
        if found.insert(node) {
            open.extend(wires(&graph.nodes[node].inputs).map(|p| p.node));
        }
    }
    let mut order = consumers_first(graph);
    order.reverse();
    order.retain(|n| found.contains(n));
    order
}

/// A port, and the frames at which it is looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Where {
    /// The output of a node.
    pub port: Port,
    /// Frames of its clock.
    pub frames: Vec<i64>,
}

/// Every port before the outputs, at the frames that are compared as far as the run makes them, else at some that it makes.
pub fn where_to_look(graph: &Graph, compared: &[Compared], plan: Option<&Plan>) -> Vec<Where> {
    let ports: Vec<Port> = compared.iter().map(|c| c.port).collect();
    let nodes = upstream(graph, &ports);
    let read: BTreeSet<Port> = nodes.iter().flat_map(|n| wires(&graph.nodes[*n].inputs)).chain(ports).collect();
    let of_clock = |name: &str| -> BTreeSet<i64> {
        compared.iter().filter(|c| graph.nodes[c.port.node].clock.name == name).flat_map(|c| c.frames.iter().copied()).collect()
    };
    read.into_iter()
        .map(|port| Where { port, frames: frames_of(graph, port, plan, &of_clock(&graph.nodes[port.node].clock.name)) })
        .collect()
}

fn frames_of(graph: &Graph, port: Port, plan: Option<&Plan>, compared: &BTreeSet<i64>) -> Vec<i64> {
    let node = &graph.nodes[port.node];
    if graph.is_single(port) {
        return vec![node.clock.first];
    }
    let wanted = plan.and_then(|p| p.nodes.get(port.node)).map(|n| &n.wanted).filter(|w| !node.runs_once() && w.contains(&true));
    let made: Vec<i64> = match wanted {
        Some(wanted) => node.clock.frames().zip(wanted).filter(|(_, w)| **w).map(|(f, _)| f).collect(),
        None => node.clock.frames().collect(),
    };
    let common: Vec<i64> = made.iter().copied().filter(|f| compared.contains(f)).collect();
    match common.len() {
        0 => first_middle_last(&made),
        n if n > MOST_FRAMES => (0..MOST_FRAMES).map(|k| common[k * (n - 1) / (MOST_FRAMES - 1)]).collect(),
        _ => common,
    }
}

/// What nodes are and give.
pub fn observe_nodes(graph: &Graph, places: &[Where], how: &How) -> (NodeReferences, Outcome) {
    let mut found = NodeReferences::new();
    for place in places {
        let node = &graph.nodes[place.port.node];
        found.entry(node.name.clone()).or_insert_with(|| NodeReference {
            of: format!("{} {}", node.ty.schema.id, node.ty.schema.version),
            settings: settings(graph, node).into_iter().map(|(_, name, text)| (name, text)).collect(),
            outputs: Reference::new(),
        });
    }
    let found = Arc::new(Mutex::new(found));
    let listener = |place: &Where| {
        let (into, port) = (found.clone(), place.port);
        let node = &graph.nodes[port.node];
        let name = node.name.clone();
        let output = node.ty.schema.outputs.get(port.output).map_or("", |o| o.name).to_owned();
        let each = move |frame: i64, value: &ValueRef| {
            let summary = Summary::brief(value.as_ref());
            if let Some(node) = lock(&into).get_mut(&name) {
                node.outputs.entry(output.clone()).or_default().insert(frame, summary);
            }
        };
        Listener { port, frames: Some(place.frames.clone()), each: Arc::new(each) }
    };
    let outcome = Job::listening(graph, places.iter().map(listener).collect()).run(how);
    (std::mem::take(&mut *lock(&found)), outcome)
}

/// What stands at each input, with its index and name, but for files, which speak by their contents.
fn settings(graph: &Graph, node: &GraphNode) -> Vec<(usize, String, String)> {
    let written = node.inputs.iter().zip(&node.ty.schema.inputs).enumerate();
    let said = written.filter(|(_, (_, schema))| schema.files == FileUse::None);
    let text = |binding: &Binding| match binding {
        Binding::None => None,
        Binding::Literal { text, .. } if text.len() > LONGEST_SETTING => {
            Some(format!("digest {}", blake3::hash(text.as_bytes()).to_hex().chars().take(16).collect::<String>()))
        }
        Binding::Literal { text, .. } => Some(text.clone()),
        Binding::Wire(port) => Some(format!("@{}", graph.port_name(*port))),
        Binding::List(ports) => Some(ports.iter().map(|p| format!("@{}", graph.port_name(*p))).collect::<Vec<_>>().join(", ")),
    };
    said.filter_map(|(i, (binding, schema))| Some((i, schema.name.to_owned(), text(binding)?))).collect()
}

/// What is otherwise about a node than when its reference was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Index of the input; `None` where the node itself is new or of another type.
    pub input: Option<usize>,
    /// In words: `gain was 2.0, is 3.0`.
    pub what: String,
}

/// Where a graph left its reference.
#[derive(Clone, Debug)]
pub struct Departure {
    /// The output of the first node that did.
    pub port: Port,
    /// The first frame at which it did.
    pub frame: i64,
    /// In what.
    pub differences: Vec<Difference>,
    /// What is otherwise about that node.
    pub changes: Vec<Change>,
    /// A node before it whose bits differ too, though they are within the tolerance.
    pub before: Option<(Port, i64)>,
}

/// What is known of one node.
#[derive(Default)]
struct State {
    changes: Vec<Change>,
    /// Beyond its tolerance.
    beyond: Option<(Port, i64, Vec<Difference>)>,
    /// Of other bits.
    bits: Option<(Port, i64)>,
    is_new: bool,
}

/// The first node along the graph that left its reference, where the outputs in `failed` did.
///
/// That is the first whose value is beyond its tolerance; or one before it that is set otherwise than it was and gives other bits, as what is set
/// otherwise there is then the cause of what is seen further on.
pub fn first(
    graph: &Graph,
    failed: &[(Port, i64, Vec<Difference>)],
    golden: &NodeReferences,
    found: &NodeReferences,
    tolerances: &Tolerances,
) -> Option<Departure> {
    let ports: Vec<Port> = failed.iter().map(|f| f.0).collect();
    let order = upstream(graph, &ports);
    let states: BTreeMap<usize, State> = order.iter().map(|n| (*n, state(graph, *n, failed, golden, found, tolerances))).collect();
    let (port, frame, differences) = order.iter().find_map(|n| states[n].beyond.clone())?;
    let before = upstream(graph, &[port]);
    let is_cause = |s: &State| !s.changes.is_empty() && (s.bits.is_some() || s.is_new);
    if let Some(cause) = before.iter().find(|n| states.get(*n).is_some_and(is_cause)) {
        let state = &states[cause];
        let (at, frame, differences) = match (&state.beyond, state.bits) {
            (Some((p, f, d)), _) => (*p, *f, d.clone()),
            (None, Some((p, f))) => {
                (p, f, vec![Difference::of_value("other bits, within the tolerance here; what reads it is beyond its own")])
            }
            (None, None) => {
                (Port { node: *cause, output: 0 }, frame, vec![Difference::of_value("a node that the reference does not have")])
            }
        };
        return Some(Departure { port: at, frame, differences, changes: state.changes.clone(), before: None });
    }
    let bits = before.iter().filter(|n| **n != port.node).find_map(|n| states.get(n)?.bits);
    Some(Departure { port, frame, differences, changes: Vec::new(), before: bits })
}

fn state(
    graph: &Graph,
    node: usize,
    failed: &[(Port, i64, Vec<Difference>)],
    golden: &NodeReferences,
    found: &NodeReferences,
    tolerances: &Tolerances,
) -> State {
    let spec = &graph.nodes[node];
    let own = failed.iter().filter(|f| f.0.node == node).min_by_key(|f| f.1).cloned();
    let Some(is) = found.get(&spec.name) else { return State { beyond: own, ..State::default() } };
    let Some(was) = golden.get(&spec.name) else {
        // Without any reference of nodes none of them is new.
        let changes = if golden.is_empty() { Vec::new() } else { vec![Change { input: None, what: "is new".to_owned() }] };
        return State { is_new: !changes.is_empty(), changes, beyond: own, bits: None };
    };
    let mut state = State { changes: changes(graph, spec, was, is), beyond: own, ..State::default() };
    for (i, output) in spec.ty.schema.outputs.iter().enumerate() {
        let port = Port { node, output: i };
        let (Some(was), Some(is)) = (was.outputs.get(output.name), is.outputs.get(output.name)) else { continue };
        for (frame, golden, found) in was.iter().filter_map(|(f, s)| Some((*f, s, is.get(f)?))) {
            if golden.bits != found.bits && state.bits.is_none_or(|(_, f)| frame < f) {
                state.bits = Some((port, frame));
            }
            let wrong = if golden.bits == found.bits { Vec::new() } else { compare(&graph.port_name(port), golden, found, tolerances) };
            if !wrong.is_empty() && state.beyond.as_ref().is_none_or(|(_, f, _)| frame < *f) {
                state.beyond = Some((port, frame, wrong));
            }
        }
    }
    state
}

fn changes(graph: &Graph, node: &GraphNode, was: &NodeReference, is: &NodeReference) -> Vec<Change> {
    let mut changes = Vec::new();
    if was.of != is.of {
        changes.push(Change { input: None, what: format!("was {}, is {}", was.of, is.of) });
    }
    let now = settings(graph, node);
    for (input, name, text) in &now {
        match was.settings.get(name) {
            Some(old) if old == text => (),
            Some(old) => changes.push(Change { input: Some(*input), what: format!("{name} was {old}, is {text}") }),
            None => changes.push(Change { input: Some(*input), what: format!("{name} was not given, is {text}") }),
        }
    }
    let gone = was.settings.iter().filter(|(name, _)| !now.iter().any(|(_, n, _)| n == *name));
    changes.extend(gone.map(|(name, old)| Change { input: None, what: format!("{name} was {old}, is not given") }));
    changes
}

impl Departure {
    /// In words, at the node's place in the graph file.
    pub fn to_diagnostic(&self, graph: &Graph) -> Diagnostic {
        let node = &graph.nodes[self.port.node];
        let output = node.ty.schema.outputs.get(self.port.output).map_or("", |o| o.name);
        let at = if graph.is_single(self.port) { String::new() } else { format!(" at frame {}", self.frame) };
        let told: Vec<String> = self.differences.iter().map(ToString::to_string).collect();
        let message = format!("node `{}` left its reference first, in output `{output}`{at}: {}", node.name, told.join("; "));
        let mut label = Label::new(node.file, node.span);
        label.text = node.ty.schema.id.to_owned();
        let mut found = Diagnostic::error(code::LEFT, message, label);
        for change in &self.changes {
            match change.input.and_then(|i| node.places.get(i)) {
                Some((file, span)) => found = found.with_label(Label::secondary(*file, *span, change.what.clone())),
                None => found = found.help(format!("node `{}`: {}", node.name, change.what)),
            }
        }
        if let Some((port, frame)) = self.before {
            let (before, at) = (&graph.nodes[port.node], if graph.is_single(port) { String::new() } else { format!(" at frame {frame}") });
            let text = format!("its bits differ already{at}, within the tolerance");
            found = found.with_label(Label::secondary(before.file, before.span, text));
        }
        found
    }
}

/// True for what is wrong with a graph only because it is made to be used by others: parameters that wait for their values, and frames.
pub fn waits_for_values(diagnostic: &Diagnostic) -> bool {
    match diagnostic.code {
        check::code::MISSING_INPUT => diagnostic.message.starts_with("expected a value for parameter"),
        // The frames are those of the graph that uses it.
        check::code::FRAMES => diagnostic.message.starts_with("expected `frames` in the graph"),
        _ => false,
    }
}
