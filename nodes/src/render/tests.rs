//! Graphs run for the tests of drawing nodes.

use std::path::Path;
use std::sync::Arc;

use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::value::downcast;

use crate::data::Image;

/// The graph of `nodes` over frames 1 to 4, or what is wrong with it.
pub(crate) fn load(nodes: &str) -> Result<Graph, Vec<String>> {
    let text = format!("Graph(pegbar: 1, frames: (first: 1, last: 4, fps: 24), nodes: {{ {nodes} }})");
    let loaded = load_text(Path::new("test.ron"), &text, &crate::registry(), &LoadOptions::default());
    loaded.graph.ok_or_else(|| loaded.diagnostics.iter().map(|d| d.message.clone()).collect())
}

/// The pictures of the node "out", or the first error of the run.
pub(crate) fn pictures(nodes: &str, threads: usize) -> Result<Vec<Arc<Image>>, String> {
    let graph = load(nodes).map_err(|e| e.join("; "))?;
    let port = Port { node: graph.find("out").unwrap(), output: 0 };
    let mut report = execute(&graph, &[], &[port], &Options { threads, ..Options::default() }).map_err(|e| e.error.message)?;
    match report.failures.first() {
        Some(failure) => Err(failure.error.message.clone()),
        None => Ok(report.kept.remove(&port).unwrap().into_iter().map(|v| downcast::<Image>(v.unwrap()).unwrap()).collect()),
    }
}
