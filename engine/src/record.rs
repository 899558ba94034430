//! Records: what the keys of a run were made from and what its nodes cost, kept so that `pegbar why` needs no flag set beforehand.
//!
//! A record is one JSON file. Those of a graph lie in a folder of their own, named by a hash of the graph file's path, and the last eight are
//! kept. A record says in words what [`crate::key`] hashes: the facts of each node, which values and files each task reads, the digests of the
//! files. It holds no keys: two records with equal facts stand for equal keys.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::atomic::{self, WriteError};
use crate::diag::{Label, SourceMap};
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::key::{Fact, KEY_VERSION, Mode, facts, hex, paths, reads_numbered};
use crate::plan::{Edge, Plan, PlanError, Reads, wires};
use crate::stamp::Files;

/// Changes with the form of a record; others are ignored.
const VERSION: u32 = 1;
/// Records of a graph that are kept.
const KEPT: usize = 8;
/// Tasks of a node in a record at most: a week of frames.
const MAX_TASKS: i64 = 1 << 24;
/// Bytes of a record at most.
const MAX_BYTES: u64 = 256 << 20;

/// Stands for the digest of a file that nobody read.
pub(crate) const UNREAD: &str = "unread";

/// What a run's keys were made from, and what it cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Form of the record.
    pub version: u32,
    /// What keys are made of: [`KEY_VERSION`] of the Pegbar that wrote it.
    pub keys: String,
    /// When it was made, for display alone: `2002-07-23 14:05 UTC`.
    pub date: String,
    /// True where a plan was made, so that all is known of the tasks that it wanted.
    pub is_planned: bool,
    /// The nodes of the graph, in its order.
    pub nodes: Vec<NodeRecord>,
    /// Files that were read, with the digests of their contents in hexadecimal.
    pub files: Vec<(String, String)>,
    /// What each node cost, by name.
    pub costs: BTreeMap<String, NodeCost>,
}

/// A node of a record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// Its name.
    pub name: String,
    /// `file:line:column` of its name.
    pub place: String,
    /// What is the same in the keys of all its tasks.
    pub facts: Vec<Fact>,
    /// What is written at its inputs.
    pub inputs: Vec<InputRecord>,
    /// What it reads, in the order of its inputs.
    pub wires: Vec<WireRecord>,
    /// Frames whose state each of its tasks starts from; none for a node without a state, or where no plan was made.
    pub previous: Option<Vec<AskedRun>>,
    /// First and last frame of its clock; none for a node that runs once.
    pub frames: Option<(i64, i64)>,
    /// Ranges of the frames that were wanted; frame 0 stands for the one task of a node that runs once.
    pub wanted: Vec<(i64, i64)>,
    /// Files with frame numbers that each wanted task reads, as positions in [`Record::files`].
    pub files: Vec<Vec<u32>>,
}

/// What is written at an input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputRecord {
    /// The input's name.
    pub name: String,
    /// A literal in canonical form, `@node.output`, a list of those, or `nothing`.
    pub text: String,
    /// `file:line:column`.
    pub place: String,
}

/// A wire of a node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WireRecord {
    /// The input's name.
    pub input: String,
    /// The node that is read, as a position in [`Record::nodes`].
    pub node: usize,
    /// The output that is read, as `node.output`.
    pub port: String,
    /// Which of its values each task reads.
    pub mode: Mode,
    /// The frames that each task asks for, where [`Mode::Asked`] and a plan was made.
    pub asked: Option<Vec<AskedRun>>,
}

/// Frames that tasks ask for: at `first` and each of the `count - 1` frames after it, the frame with each of `offsets` added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AskedRun {
    /// First frame.
    pub first: i64,
    /// Number of frames, at least 1.
    pub count: i64,
    /// What is added.
    pub offsets: Vec<i64>,
}

/// What a node cost in a run, or in several.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NodeCost {
    /// Type id and version of its behaviour, as `track.affine 3`; costs of another are of no use.
    pub of: String,
    /// Tasks that were computed.
    pub computed: u64,
    /// Tasks whose results came from the cache.
    pub cached: u64,
    /// Tasks that were wanted by nobody once what reads them was found.
    pub skipped: u64,
    /// Computed tasks whose results were not worth keeping in the cache.
    pub unkept: u64,
    /// Time in its computed tasks, in seconds, on all threads.
    pub seconds: f64,
    /// Bytes of the results of a task, by output; the state is `state`.
    pub results: BTreeMap<String, Bytes>,
    /// Most bytes of scratch that one task took.
    pub scratch: u64,
}

/// Sizes of results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Bytes {
    /// Number of results.
    pub count: u64,
    /// Bytes of all of them.
    pub total: u64,
    /// Bytes of the largest.
    pub max: u64,
}

impl Bytes {
    /// Adds a result.
    pub fn add(&mut self, bytes: u64) {
        self.merge(&Self { count: 1, total: bytes, max: bytes });
    }

    /// Bytes of a result, on average; 0 where there is none.
    pub fn mean(&self) -> u64 {
        self.total / self.count.max(1)
    }

    fn merge(&mut self, other: &Self) {
        self.count = self.count.saturating_add(other.count);
        self.total = self.total.saturating_add(other.total);
        self.max = self.max.max(other.max);
    }
}

impl NodeCost {
    /// The costs of nothing yet, of a node of the graph.
    pub fn new(node: &GraphNode) -> Self {
        Self { of: format!("{} {}", node.ty.schema.id, node.ty.schema.version), ..Self::default() }
    }

    /// Seconds of a computed task, on average; `None` where none was computed.
    pub fn seconds_a_task(&self) -> Option<f64> {
        (self.computed > 0).then(|| self.seconds / self.computed as f64)
    }

    /// Adds the costs of another run.
    pub fn merge(&mut self, other: &Self) {
        self.computed += other.computed;
        self.cached += other.cached;
        self.skipped += other.skipped;
        self.unkept += other.unkept;
        self.seconds += other.seconds;
        self.scratch = self.scratch.max(other.scratch);
        for (output, bytes) in &other.results {
            self.results.entry(output.clone()).or_default().merge(bytes);
        }
    }
}

impl NodeRecord {
    /// The frames that were wanted, ascending.
    pub(crate) fn wanted(&self) -> impl Iterator<Item = i64> + '_ {
        self.wanted.iter().flat_map(|(first, last)| *first..=*last)
    }

    /// True where its numbers lead nowhere beyond the record, so that whoever follows them neither fails nor takes for ever.
    fn is_sound(&self, nodes: usize, files: usize) -> bool {
        let far = |n: i64| n.unsigned_abs() > 1 << 40;
        let runs = self.wires.iter().filter_map(|w| w.asked.as_ref()).chain(&self.previous).flatten();
        let is_fine = |r: &AskedRun| !far(r.first) && !far(r.count) && !r.offsets.iter().any(|o| far(*o));
        let wanted = || self.wanted.iter().all(|(first, last)| !far(*first) && !far(*last) && first <= last);
        wanted()
            && self.wanted.is_sorted_by(|a, b| a.1 < b.0)
            && self.wanted.iter().map(|(first, last)| last - first + 1).fold(0, i64::saturating_add) <= MAX_TASKS
            && runs.into_iter().all(is_fine)
            && self.wires.iter().all(|w| w.node < nodes)
            && self.files.iter().flatten().all(|&f| (f as usize) < files)
    }

    /// The position of a frame among those that were wanted.
    pub(crate) fn position(&self, frame: i64) -> Option<usize> {
        let range = self.wanted.partition_point(|(first, _)| *first <= frame).checked_sub(1)?;
        let (first, last) = self.wanted.get(range)?;
        let before: i64 = self.wanted[..range].iter().map(|(first, last)| last - first + 1).sum();
        (frame <= *last).then(|| (before + frame - first) as usize)
    }
}

impl Record {
    /// What the keys of a graph are made from, without costs.
    ///
    /// Without a plan, as where one hangs on a value that is to be computed, every task counts as wanted, and what tasks ask for is not known. So it
    /// is with what the plan does not want because the values that were made of it are known already.
    ///
    /// # Errors
    /// Where a file cannot be read.
    pub fn of(graph: &Graph, sources: &SourceMap, plan: Option<&Plan>, files: &Files) -> Result<Self, PlanError> {
        let mut table = Table::default();
        let mut nodes = Vec::with_capacity(graph.nodes.len());
        let stages = plan.map(|plan| earlier_stages(graph, plan)).unwrap_or_default();
        for (node, spec) in graph.nodes.iter().enumerate() {
            let tasks = if spec.runs_once() { 1 } else { spec.clock.len() };
            let is_wanted = |k: &usize| plan.is_none_or(|p| p.nodes[node].wanted[*k]) || stages.contains(&node);
            let wanted: Vec<usize> = (0..tasks).filter(is_wanted).collect();
            nodes.push(node_record(graph, sources, plan, node, &wanted, files, &mut table)?);
        }
        let date = date(SystemTime::now());
        let keys = KEY_VERSION.to_owned();
        Ok(Self { version: VERSION, keys, date, is_planned: plan.is_some(), nodes, files: table.rows, costs: BTreeMap::new() })
    }

    /// The node called `name`, and its position.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|n| n.name == name)
    }
}

/// Nodes that the plan does not want, and that led to what it knows already.
fn earlier_stages(graph: &Graph, plan: &Plan) -> BTreeSet<usize> {
    let mut out = BTreeSet::new();
    let mut open: Vec<usize> = plan.known.keys().map(|port| port.node).collect();
    let mut seen: BTreeSet<usize> = open.iter().copied().collect();
    while let Some(node) = open.pop() {
        if !plan.nodes[node].wanted.contains(&true) {
            out.insert(node);
        }
        open.extend(wires(&graph.nodes[node].inputs).map(|port| port.node).filter(|n| seen.insert(*n)));
    }
    out
}

/// Files in the order in which they are met.
#[derive(Default)]
struct Table {
    rows: Vec<(String, String)>,
    places: BTreeMap<PathBuf, u32>,
}

impl Table {
    fn place(&mut self, path: PathBuf, digest: &[u8; 32]) -> u32 {
        let next = self.rows.len() as u32;
        if let Some(place) = self.places.get(&path) {
            return *place;
        }
        self.rows.push((path.to_string_lossy().into_owned(), hex(digest)));
        self.places.insert(path, next);
        next
    }
}

fn node_record(
    graph: &Graph,
    sources: &SourceMap,
    plan: Option<&Plan>,
    node: usize,
    wanted: &[usize],
    files: &Files,
    table: &mut Table,
) -> Result<NodeRecord, PlanError> {
    let spec = &graph.nodes[node];
    let first = if spec.runs_once() { 0 } else { spec.clock.first };
    let failed = |error| PlanError { node, frame: None, error };
    let constant = |port| Some(*crate::value::digest(plan?.known.get(&port)?.as_ref()).as_bytes());
    // A node that nobody wants has no key, so that its files need not be there.
    let content = |path: &Path| if wanted.is_empty() { Ok(UNREAD.to_owned()) } else { files.digest(path).map(|d| hex(&d)) };
    let facts = facts(graph, node, constant, content).map_err(failed)?;
    let mut picks = Vec::new();
    for &task in wanted.iter().filter(|_| reads_numbered(spec)) {
        let pick = |path: PathBuf, table: &mut Table| files.digest(&path).map(|digest| table.place(path, &digest));
        let found = paths(spec, task, true).into_iter().map(|path| path.and_then(|p| pick(p, table)));
        picks.push(found.collect::<Result<Vec<u32>, _>>().map_err(failed)?);
    }
    let mut edges = plan.map(|p| p.nodes[node].edges.iter()).unwrap_or_default();
    let wires = wire_records(graph, plan, spec, first, &mut edges);
    Ok(NodeRecord {
        name: spec.name.clone(),
        place: sources.place(&Label::new(spec.file, spec.span)),
        facts,
        inputs: input_records(graph, sources, spec),
        wires,
        previous: edges.next().map(|edge| asked(edge, first, first)),
        frames: (!spec.runs_once()).then_some((spec.clock.first, spec.clock.last)),
        wanted: ranges(wanted.iter().map(|&k| first + k as i64)),
        files: picks,
    })
}

fn input_records(graph: &Graph, sources: &SourceMap, spec: &GraphNode) -> Vec<InputRecord> {
    let reference = |port: &Port| format!("@{}", graph.port_name(*port));
    let inputs = spec.inputs.iter().zip(&spec.ty.schema.inputs).enumerate();
    inputs
        .map(|(i, (binding, input))| {
            let text = match binding {
                Binding::None => "nothing".to_owned(),
                Binding::Literal { text, .. } => text.clone(),
                Binding::Wire(port) => reference(port),
                Binding::List(ports) => format!("[{}]", ports.iter().map(reference).collect::<Vec<_>>().join(", ")),
            };
            let (file, span) = spec.places.get(i).copied().unwrap_or((spec.file, spec.span));
            InputRecord { name: input.name.to_owned(), text, place: sources.place(&Label::new(file, span)) }
        })
        .collect()
}

/// The wires of a node; takes the edges that stand for them.
fn wire_records<'p>(
    graph: &Graph,
    plan: Option<&Plan>,
    spec: &GraphNode,
    first: i64,
    edges: &mut impl Iterator<Item = &'p Edge>,
) -> Vec<WireRecord> {
    let mut out = Vec::new();
    for (binding, input) in spec.inputs.iter().zip(&spec.ty.schema.inputs) {
        for port in wires(std::slice::from_ref(binding)) {
            let mode = Mode::of(graph, spec, input, port);
            // What is known before the plan has no edge.
            let edge = if plan.is_some_and(|p| p.known.contains_key(&port)) { None } else { edges.next() };
            let asked = edge.filter(|_| mode == Mode::Asked).map(|e| asked(e, first, graph.nodes[port.node].clock.first));
            out.push(WireRecord { input: input.name.to_owned(), node: port.node, port: graph.port_name(port), mode, asked });
        }
    }
    out
}

/// What the tasks of a node ask for; `first` is the frame of its first task, `producer` that of what it reads.
fn asked(edge: &Edge, first: i64, producer: i64) -> Vec<AskedRun> {
    let mut out: Vec<AskedRun> = Vec::new();
    let Reads::Lists(lists) = &edge.reads else { return out };
    for (task, list) in lists.forward.iter().enumerate() {
        let frame = first + task as i64;
        let offsets: Vec<i64> = list.iter().map(|&i| producer + i64::from(i) - frame).collect();
        match out.last_mut() {
            Some(run) if run.offsets == offsets => run.count += 1,
            _ => out.push(AskedRun { first: frame, count: 1, offsets }),
        }
    }
    out
}

/// Ascending frames as ranges.
fn ranges(frames: impl Iterator<Item = i64>) -> Vec<(i64, i64)> {
    let mut out: Vec<(i64, i64)> = Vec::new();
    for frame in frames {
        match out.last_mut() {
            Some((_, last)) if *last + 1 == frame => *last = frame,
            _ => out.push((frame, frame)),
        }
    }
    out
}

/// `2002-07-23 14:05 UTC`.
pub fn date(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let (days, minutes) = ((seconds / 86_400) as i64, seconds / 60 % 1440);
    // Days to a date, counting years from March (Howard Hinnant, "chrono-compatible low-level date algorithms", civil_from_days).
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted.div_euclid(146_097), shifted.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02} UTC", minutes / 60, minutes % 60)
}

/// The records of one graph.
#[derive(Clone, Debug)]
pub struct Records {
    folder: PathBuf,
}

impl Records {
    /// Those of the graph file `graph` in the cache directory `cache`. Nothing is made.
    pub fn of(cache: &Path, graph: &Path) -> Self {
        let path = graph.canonicalize().or_else(|_| std::path::absolute(graph)).unwrap_or_else(|_| graph.to_owned());
        let name = blake3::hash(path.as_os_str().as_encoded_bytes()).to_hex();
        Self { folder: cache.join("v1").join("runs").join(&name[..32]) }
    }

    /// Where they lie.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// All that can be read, the newest first; and a note on each that cannot, which is as if it were not there.
    pub fn load(&self) -> (Vec<Record>, Vec<String>) {
        let (mut records, mut notes) = (Vec::new(), Vec::new());
        for (_, path) in self.numbered().into_iter().rev() {
            match read(&path) {
                Ok(record) => records.push(record),
                Err(why) => notes.push(format!("{}: {why}; the record is ignored", path.display())),
            }
        }
        (records, notes)
    }

    /// Puts a record beside the others, and removes those beyond the last eight. Of two runs that end in the same moment one may be kept.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn save(&self, record: &Record) -> Result<(), WriteError<std::io::Error>> {
        let mut there = self.numbered();
        let next = there.last().map_or(1, |(n, _)| n.saturating_add(1));
        let path = self.folder.join(format!("{next:04}.json"));
        atomic::write(&path, |out| {
            serde_json::to_writer(&mut *out, record)?;
            out.flush()
        })?;
        atomic::sweep_folder(&self.folder, |_| true);
        there.truncate((there.len() + 1).saturating_sub(KEPT));
        // One that stays is removed the next time.
        there.into_iter().for_each(|(_, old)| drop(std::fs::remove_file(old)));
        Ok(())
    }

    /// What the nodes cost in the runs that are kept, by name; where a node's type or version changed, those of the newest alone.
    pub fn costs(&self) -> BTreeMap<String, NodeCost> {
        let mut out: BTreeMap<String, NodeCost> = BTreeMap::new();
        for (name, cost) in self.load().0.into_iter().flat_map(|r| r.costs) {
            match out.get_mut(&name) {
                Some(sum) if sum.of == cost.of => sum.merge(&cost),
                Some(_) => {}
                None => drop(out.insert(name, cost)),
            }
        }
        out
    }

    /// Files of records with their numbers, ascending.
    fn numbered(&self) -> Vec<(u64, PathBuf)> {
        let entries = std::fs::read_dir(&self.folder).into_iter().flatten().flatten().map(|e| e.path());
        let number = |path: &Path| path.file_name()?.to_str()?.strip_suffix(".json")?.parse::<u64>().ok();
        let mut out: Vec<(u64, PathBuf)> = entries.filter_map(|path| Some((number(&path)?, path))).collect();
        out.sort_unstable();
        out
    }
}

fn read(path: &Path) -> Result<Record, String> {
    let mut text = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| e.to_string())?;
    file.take(MAX_BYTES + 1).read_to_end(&mut text).map_err(|e| e.to_string())?;
    if text.len() as u64 > MAX_BYTES {
        return Err(format!("expected a record of at most {MAX_BYTES} bytes, found a longer file"));
    }
    #[derive(Deserialize)]
    struct Form {
        version: u32,
    }
    let form = |e: serde_json::Error| format!("expected a record of a run, found another or a damaged file: {e}");
    let version = serde_json::from_slice::<Form>(&text).map_err(form)?.version;
    if version != VERSION {
        return Err(format!("expected a record of version {VERSION}, found version {version}"));
    }
    let record: Record = serde_json::from_slice(&text).map_err(form)?;
    let is_sound = record.nodes.iter().all(|n| n.is_sound(record.nodes.len(), record.files.len()));
    if is_sound { Ok(record) } else { Err("expected a sound record, found one whose numbers lead beyond its ends".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(date: &str) -> Record {
        let asked = vec![AskedRun { first: 1, count: 2, offsets: vec![-1, 0] }];
        let wire = WireRecord { input: "a".to_owned(), node: 0, port: "n.value".to_owned(), mode: Mode::Asked, asked: Some(asked) };
        let node = NodeRecord {
            name: "n".to_owned(),
            place: "g.ron:1:2".to_owned(),
            facts: Vec::new(),
            inputs: vec![InputRecord { name: "a".to_owned(), text: "@n.value".to_owned(), place: "g.ron:1:9".to_owned() }],
            wires: vec![wire],
            previous: None,
            frames: Some((1, 9)),
            wanted: vec![(1, 2), (5, 7)],
            files: vec![vec![0]; 5],
        };
        let mut cost = NodeCost { of: "t 1".to_owned(), computed: 2, cached: 1, seconds: 0.5, scratch: 7, ..NodeCost::default() };
        cost.results.entry("value".to_owned()).or_default().add(10);
        cost.results.entry("value".to_owned()).or_default().add(20);
        let costs = BTreeMap::from([("n".to_owned(), cost)]);
        let files = vec![("p.png".to_owned(), "00".to_owned())];
        Record { version: VERSION, keys: KEY_VERSION.to_owned(), date: date.to_owned(), is_planned: true, nodes: vec![node], files, costs }
    }

    #[test]
    fn the_last_eight_records_are_kept_newest_first() {
        let folder = tempfile::tempdir().unwrap();
        let records = Records::of(folder.path(), Path::new("g.ron"));
        assert_eq!(records.load(), (Vec::new(), Vec::new()));
        for run in 1..=11 {
            records.save(&record(&run.to_string())).unwrap();
        }
        let (found, notes) = records.load();
        assert_eq!(found, (4..=11).rev().map(|run| record(&run.to_string())).collect::<Vec<_>>());
        assert!(notes.is_empty(), "{notes:?}");
        assert_ne!(Records::of(folder.path(), Path::new("h.ron")).folder(), records.folder());
    }

    #[test]
    fn a_record_that_cannot_be_read_is_noted_and_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let records = Records::of(folder.path(), Path::new("g.ron"));
        (1..=3).for_each(|run| records.save(&record(&run.to_string())).unwrap());
        let whole = std::fs::read(records.folder().join("0002.json")).unwrap();
        for cut in [0, 1, whole.len() / 2, whole.len() - 1] {
            std::fs::write(records.folder().join("0002.json"), &whole[..cut]).unwrap();
            let (found, notes) = records.load();
            assert_eq!(found, [record("3"), record("1")]);
            assert!(notes.len() == 1 && notes[0].contains("0002.json: expected a record of a run"), "{notes:?}");
        }
        let text = String::from_utf8(whole).unwrap();
        let cases = [
            ("\"version\":1", "\"version\":2", "expected a record of version 1, found version 2"),
            ("\"node\":0", "\"node\":1", "beyond its ends"),
            ("[[1,2],[5,7]]", "[[1,2],[2,7]]", "beyond its ends"),
            ("[[1,2],[5,7]]", "[[-9223372036854775808,9223372036854775807]]", "beyond its ends"),
            ("\"count\":2", "\"count\":9223372036854775807", "beyond its ends"),
        ];
        for (from, to, why) in cases {
            assert!(text.contains(from), "{from}");
            std::fs::write(records.folder().join("0002.json"), text.replace(from, to)).unwrap();
            let (found, notes) = records.load();
            assert_eq!((found.len(), notes.len()), (2, 1), "{to}");
            assert!(notes[0].contains(why), "{notes:?}");
        }
    }

    #[test]
    fn costs_of_runs_are_added_up_while_the_node_is_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let records = Records::of(folder.path(), Path::new("g.ron"));
        let mut other = record("1");
        other.costs.values_mut().for_each(|c| c.of = "t 2".to_owned());
        [other, record("2"), record("3")].iter().for_each(|r| records.save(r).unwrap());
        let cost = &records.costs()["n"];
        assert_eq!((cost.of.as_str(), cost.computed, cost.cached, cost.seconds, cost.scratch), ("t 1", 4, 2, 1.0, 7));
        assert_eq!((cost.results["value"].mean(), cost.results["value"].max, cost.results["value"].count), (15, 20, 4));
        assert_eq!((cost.seconds_a_task(), NodeCost::default().seconds_a_task()), (Some(0.25), None));
    }

    #[test]
    fn frames_are_found_among_those_that_were_wanted() {
        let node = &record("1").nodes[0];
        assert_eq!(node.wanted().collect::<Vec<_>>(), [1, 2, 5, 6, 7]);
        let positions: Vec<Option<usize>> = (0..9).map(|f| node.position(f)).collect();
        assert_eq!(positions, [None, Some(0), Some(1), None, None, Some(2), Some(3), Some(4), None]);
        assert_eq!(ranges([1, 2, 5, 6, 7].into_iter()), node.wanted);
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        let at = |seconds: u64| date(UNIX_EPOCH + std::time::Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01 00:00 UTC");
        assert_eq!(at(951_782_399), "2000-02-28 23:59 UTC");
        assert_eq!(at(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(at(1_027_433_100), "2002-07-23 14:05 UTC");
        assert_eq!(at(4_107_542_400), "2100-03-01 00:00 UTC");
    }
}
