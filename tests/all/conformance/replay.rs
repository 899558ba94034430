//! Every task of every node can be run again from a failure bundle, bit by bit as in the run: what a bundle holds is all that a node is given.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use pegbar_engine::bundle::{Bundle, Replayed, save};
use pegbar_engine::exec::{Failure, Given, Options, execute};
use pegbar_engine::graph::Graph;
use pegbar_engine::node::{Arg, Cancel, Computed, Context, Needs, NodeError, Operator, OutValue, Problem};
use pegbar_engine::plan::Target;
use pegbar_engine::registry::Registry;
use pegbar_engine::value::{ValueRef, ValueType, digest};
use pegbar_nodes::registry;

use super::keys::pictures;
use super::rough;
use super::standin::{Kind, check, write_all};
use crate::support::collect::complaints;
use crate::support::walk;

/// Digests of all values, or the failure.
type Made = Result<Vec<Vec<String>>, NodeError>;

fn digests(computed: &Computed) -> Vec<Vec<String>> {
    let of = |v: &ValueRef| digest(v.as_ref()).to_string();
    let one = |out: &OutValue| match out {
        OutValue::One(value) => vec![of(value)],
        OutValue::Stream(values) => values.iter().map(of).collect(),
    };
    computed.outputs.iter().map(one).collect()
}

/// Stands in for the node `x`: does its work, and saves each task as if it had failed.
struct Recorder {
    graph: Graph,
    bundles: PathBuf,
    saved: Mutex<Vec<Result<(PathBuf, Made), String>>>,
}

impl Recorder {
    fn node(&self) -> (usize, &dyn Operator) {
        let node = self.graph.find("x").unwrap();
        (node, self.graph.nodes[node].ty.operator.as_ref())
    }
}

impl Operator for Recorder {
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        self.node().1.needs(args, inputs, cx)
    }

    fn compute(&self, args: Vec<Arg>, state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        let (node, operator) = self.node();
        let given = Some(Given { args: args.clone(), state: state.clone() });
        let result = operator.compute(args, state, cx);
        let error = result.as_ref().err().cloned().unwrap_or_else(|| NodeError::internal("it did not fail"));
        let frame = (!self.graph.nodes[node].runs_once()).then_some(cx.frame);
        let failure = Failure { node, frame, error, inputs: Vec::new(), given };
        let saved = save(&self.graph, &failure, &self.bundles)
            .map(|folder| (folder, result.as_ref().map(digests).map_err(Clone::clone)))
            .map_err(|e| e.to_string());
        self.saved.lock().unwrap().push(saved);
        result
    }

    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        self.node().1.check(args)
    }

    fn state_type(&self) -> Option<ValueType> {
        self.node().1.state_type()
    }

    fn is_per_frame(&self, args: Vec<Arg>) -> Result<bool, NodeError> {
        self.node().1.is_per_frame(args)
    }
}

/// Runs the node `x` of a graph; its bundles with what each task made.
fn record(folder: &Path, registry: &Registry, text: &str, bundles: &Path) -> Result<Vec<(PathBuf, Made)>, String> {
    let loaded = check(folder, text, registry);
    let mut graph = loaded.graph.clone().ok_or_else(|| complaints(&loaded))?;
    let recorder = Arc::new(Recorder { graph: graph.clone(), bundles: bundles.to_owned(), saved: Mutex::default() });
    let node = graph.find("x").unwrap();
    graph.nodes[node].ty.operator = recorder.clone();
    execute(&graph, &[Target { node, frames: None }], &[], &Options { threads: 2, ..Options::default() }).map_err(|e| e.error.message)?;
    std::mem::take(&mut *recorder.saved.lock().unwrap()).into_iter().collect()
}

/// Runs a task again; what is not as it was.
fn again(registry: &Registry, bundle: &Path, before: &Made, out: &Path) -> Result<(), String> {
    let replayed = Bundle::open(bundle, registry).and_then(|b| b.replay(Some(out), &Cancel::default())).map_err(|e| e.to_string())?;
    match (before, replayed) {
        (Err(_), Replayed::Same) => Ok(()),
        (Ok(before), Replayed::Fine(computed)) if digests(&computed) == *before => Ok(()),
        (Ok(_), Replayed::Fine(_)) => Err("expected the same bits, found others".to_owned()),
        (Ok(_), Replayed::Other(error)) => Err(format!("expected no failure, found {error}")),
        (before, _) => Err(format!("expected {before:?}, found another outcome")),
    }
}

/// Every file below a folder, by its name from there.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    walk(folder, &mut |path| drop(found.insert(path.strip_prefix(folder).unwrap().to_owned(), std::fs::read(path).unwrap())));
    found
}

#[test]
fn every_task_of_every_node_can_be_run_again_elsewhere() {
    let home = tempfile::tempdir().unwrap();
    let registry = registry();
    let (folder, mut wrong, mut tried) = (home.path().join("shot"), Vec::new(), (0, 0));
    for node in registry.nodes() {
        for optional in [false, true] {
            std::fs::create_dir_all(&folder).unwrap();
            write_all(&folder, &registry, Kind::Ordinary);
            pictures(&folder);
            let at =
                |why: String| format!("{} {}: {why}", node.schema.id, if optional { "with all inputs" } else { "with what it must have" });
            let text = rough::graph(&folder, node, Kind::Ordinary, None, optional).expect("stand-ins for every type");
            let bundles = home.path().join(format!("{}-{optional}", node.schema.id));
            let saved = record(&folder, &registry, &text, &bundles);
            // What a sink wrote is held against what its replay writes; nothing else of the run stays.
            let written = home.path().join(format!("{}-{optional}-out", node.schema.id));
            if folder.join("out").exists() {
                std::fs::rename(folder.join("out"), &written).unwrap();
            }
            std::fs::remove_dir_all(&folder).unwrap();
            match saved {
                Err(why) => wrong.push(at(why)),
                Ok(saved) if saved.is_empty() => wrong.push(at("expected a task, found none".to_owned())),
                Ok(saved) => {
                    tried.0 += saved.len();
                    let out = home.path().join("out");
                    wrong.extend(saved.iter().filter_map(|(bundle, before)| again(&registry, bundle, before, &out).err().map(&at)));
                    tried.1 += contents(&written).len();
                    if written.exists() && contents(&written) != contents(&out) {
                        wrong.push(at("expected the files of the run, found others".to_owned()));
                    }
                    let _ = std::fs::remove_dir_all(&out);
                }
            }
        }
    }
    assert!(tried.0 > 200 && tried.1 > 10, "{} tasks, {} files", tried.0, tried.1);
    super::none(&wrong);
}
