//! `pegbar run --save-failure`: what failed tasks were given, saved; and `pegbar replay`: one of them, run alone.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use pegbar_engine::bundle::{Bundle, BundleError, Replayed, save};
use pegbar_engine::exec::{Failure, Observer};
use pegbar_engine::graph::Graph;
use pegbar_engine::node::NodeError;
use pegbar_engine::registry::Registry;

use crate::args::ReplayArgs;
use crate::console::{Console, EXIT_CANCELLED, EXIT_FAILED, EXIT_OK, EXIT_WRONG};

/// Bundles of one run at most: what fails often fails everywhere.
const MOST: usize = 8;

/// Saves failures as they happen: the first of each node.
pub(crate) struct Saver<'a> {
    folder: &'a Path,
    /// Nodes of which a failure is saved.
    nodes: Mutex<Vec<usize>>,
    saved: Mutex<Vec<Result<PathBuf, String>>>,
}

impl<'a> Saver<'a> {
    pub(crate) fn new(folder: &'a Path) -> Self {
        Self { folder, nodes: Mutex::default(), saved: Mutex::default() }
    }

    /// True for a failure that is to be saved.
    fn takes(&self, node: usize) -> bool {
        let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        let is_new = nodes.len() < MOST && !nodes.contains(&node);
        if is_new {
            nodes.push(node);
        }
        is_new
    }

    /// The bundles that were saved, and why others were not.
    pub(crate) fn end(self) -> Vec<Result<PathBuf, String>> {
        self.saved.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Saver<'_> {
    fn failed(&self, graph: &Graph, failure: &Failure) {
        if !failure.error.cancelled && self.takes(failure.node) {
            let name = &graph.nodes[failure.node].name;
            let saved = save(graph, failure, self.folder).map_err(|e| format!("the failure of node `{name}` is not saved: {e}"));
            self.saved.lock().unwrap_or_else(PoisonError::into_inner).push(saved);
        }
    }

    fn keeps_inputs(&self) -> bool {
        true
    }
}

pub(crate) fn replay(args: &ReplayArgs, registry: &Registry, console: &mut Console) -> u8 {
    let result = Bundle::open(&args.bundle, registry).and_then(|bundle| {
        let replayed = bundle.replay(args.out.as_deref(), &console.cancel)?;
        conclude(&bundle, replayed, args.out.as_deref(), console)
    });
    result.unwrap_or_else(|error| {
        console.say(&format!("error: {error}\n"));
        EXIT_WRONG
    })
}

fn conclude(bundle: &Bundle, replayed: Replayed, out: Option<&Path>, console: &mut Console) -> Result<u8, BundleError> {
    let at = bundle.frame().map(|f| format!(" at frame {f}")).unwrap_or_default();
    let node = bundle.node();
    match replayed {
        Replayed::Same => {
            console.say(&format!("error: node `{node}` failed{at}: {}", told(bundle.error())));
            let inputs = if bundle.shapes().is_empty() { String::new() } else { format!(" with {}", bundle.shapes().join(", ")) };
            console.say(&format!("  = note: {}{inputs}\n\nthe failure is reproduced\n", bundle.node_type().schema.id));
            Ok(EXIT_FAILED)
        }
        Replayed::Other(error) if error.cancelled => {
            console.say("cancelled\n");
            Ok(EXIT_CANCELLED)
        }
        Replayed::Other(error) => {
            console.say(&format!("error: node `{node}` failed{at}: {}", told(&error)));
            console.say(&format!("\nfails otherwise; in the run it failed: {}", told(bundle.error())));
            Ok(EXIT_FAILED)
        }
        Replayed::Fine(computed) => {
            let files = out.map(|out| bundle.write_outputs(&computed, out)).transpose()?.unwrap_or_default();
            console.say(&format!("node `{node}`{at} no longer fails; in the run it failed: {}", told(bundle.error())));
            files.iter().for_each(|file| console.say(&format!("wrote {}\n", file.display())));
            Ok(EXIT_OK)
        }
    }
}

/// Message and help, a line each.
fn told(error: &NodeError) -> String {
    let help = error.help.as_ref().map(|h| format!("  = help: {h}\n")).unwrap_or_default();
    format!("{}\n{help}", error.message)
}
