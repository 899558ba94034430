//! What stands beside a golden: how its graph is run small.

use std::collections::BTreeMap;
use std::sync::Arc;

use pegbar_engine::clock::Clock;
use pegbar_engine::graph::Graph;
use pegbar_engine::job::FrameSet;
use serde::Deserialize;

use crate::support::root;

/// `tests/golden/<path of the graph>.ron`; every field may be left out.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Sidecar {
    /// Frames that are compared, as of `--frames`; the first, the middle and the last of each output's clock where empty.
    pub(super) frames: String,
    /// Values of the graph's parameters, as of `--var`.
    pub(super) variables: BTreeMap<String, String>,
    /// Values of inputs, as of `--set`.
    pub(super) set: BTreeMap<String, String>,
    /// The outputs that are compared; all that the graph declares where empty.
    pub(super) outputs: Vec<String>,
    /// Clocks that end earlier, by name: nodes that run over whole sequences take as long as those are.
    pub(super) cut: BTreeMap<String, i64>,
    /// True for a graph that is made to be used by others, with parameters that have no value of their own.
    pub(super) only_check: bool,
}

impl Sidecar {
    /// The sidecar of a graph, the usual one where it has none.
    pub(super) fn of(graph: &str) -> Self {
        let path = root().join(path_of(graph));
        match std::fs::read_to_string(&path) {
            Ok(text) => ron::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display())),
            Err(_) => Self::default(),
        }
    }

    /// The frames of `clock` that are compared.
    pub(super) fn frames(&self, clock: &Clock) -> Vec<i64> {
        if self.frames.is_empty() {
            let mut frames = vec![clock.first, clock.first + (clock.last - clock.first) / 2, clock.last];
            frames.dedup();
            return frames;
        }
        let set: FrameSet = self.frames.parse().unwrap_or_else(|e| panic!("{e}"));
        set.on(clock).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Ends the clocks of a graph where the sidecar says.
    pub(super) fn shorten(&self, graph: &mut Graph) {
        let cut = |clock: &mut Arc<Clock>| {
            if let Some(last) = self.cut.get(&clock.name) {
                *clock = Arc::new(Clock { last: (*last).clamp(clock.first, clock.last), ..(**clock).clone() });
            }
        };
        graph.clocks.iter_mut().for_each(cut);
        for node in &mut graph.nodes {
            cut(&mut node.clock);
            node.input_clocks.iter_mut().for_each(|(_, clock)| cut(clock));
        }
    }
}

/// Where the sidecar of a graph is, below the root.
pub(super) fn path_of(graph: &str) -> String {
    format!("tests/golden/{graph}")
}
