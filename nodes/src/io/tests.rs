//! The file nodes in whole graphs: what is written is read again, and what cannot be is one clear error and no file.

mod capture;
mod drawings;
mod gltf;
mod pictures;
mod values;

use std::path::{Path, PathBuf};

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, Report, execute};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::plan::Target;
use pegbar_engine::value::ValueRef;

/// A folder with a graph's files, and the folder that the graph writes to.
struct Stage {
    folder: tempfile::TempDir,
}

impl Stage {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("out")).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// Names of the files in the output folder, hidden ones too.
    fn written(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.path("out")).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    fn load(&self, frames: (i64, i64), nodes: &str) -> Result<Graph, Vec<String>> {
        let text = format!("Graph(pegbar: 1, frames: (first: {}, last: {}, fps: 24), nodes: {{ {nodes} }})", frames.0, frames.1);
        let options = LoadOptions { out: self.path("out"), ..LoadOptions::default() };
        let loaded = load_text(&self.path("test.ron"), &text, &crate::registry(), &options);
        loaded.graph.ok_or_else(|| loaded.diagnostics.iter().map(|d| d.message.clone()).collect())
    }

    fn graph(&self, frames: (i64, i64), nodes: &str) -> Graph {
        self.load(frames, nodes).unwrap_or_else(|e| panic!("{e:#?}"))
    }

    /// Runs every node without outputs.
    fn run(&self, frames: (i64, i64), nodes: &str) -> Report {
        let graph = self.graph(frames, nodes);
        let sinks = graph.nodes.iter().enumerate().filter(|(_, n)| n.ty.schema.outputs.is_empty());
        let targets: Vec<Target> = sinks.map(|(node, _)| Target { node, frames: None }).collect();
        execute(&graph, &targets, &[], &Options { threads: 2, ..Options::default() }).unwrap()
    }

    /// The values of the first output of `node`, or the one error of the run.
    fn values(&self, frames: (i64, i64), nodes: &str, node: &str) -> Result<Vec<ValueRef>, String> {
        let graph = self.graph(frames, nodes);
        let (name, output) = node.split_once('.').unwrap_or((node, ""));
        let node = graph.find(name).unwrap();
        let output = graph.nodes[node].ty.schema.outputs.iter().position(|o| o.name == output).unwrap_or(0);
        let port = Port { node, output };
        let mut report = execute(&graph, &[], &[port], &Options::default()).unwrap();
        match &report.failures[..] {
            [] => Ok(report.kept.remove(&port).unwrap().into_iter().map(Option::unwrap).collect()),
            [one] => Err(one.error.message.clone()),
            many => panic!("{many:#?}"),
        }
    }
}

/// The one failure of a run, checked to name `path`.
fn only_failure(report: &Report, path: &Path) -> String {
    assert_eq!(report.failures.len(), 1, "{:#?}", report.failures);
    assert!(!report.is_complete());
    let message = report.failures[0].error.message.clone();
    let name = path.file_name().unwrap().to_string_lossy();
    assert!(message.contains(name.as_ref()), "{message}");
    message
}
