//! What a run may use: threads, memory, and the cache with what earlier runs left there.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pegbar_engine::cache::{Cache, DEFAULT_LIMIT};
use pegbar_engine::diag::SourceMap;
use pegbar_engine::exec::Policy;
use pegbar_engine::job::{How, Keep};
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

use crate::args::Resources;
use crate::cache::chosen;
use crate::console::Console;
use crate::pool;

/// What was asked for, made ready.
pub(crate) struct Ready {
    pub(crate) threads: usize,
    memory: u64,
    folder: Option<PathBuf>,
    cache: Option<Arc<Cache>>,
    policy: Policy,
    policies: Vec<(String, Policy)>,
}

impl Ready {
    /// Opens the cache. One that cannot be opened is told, and done without.
    pub(crate) fn new(args: &Resources, console: &mut Console) -> Self {
        let threads = args.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
        let mut folder = chosen(&args.folder);
        let mut cache = None;
        if let Some(named) = folder.as_ref().filter(|_| !args.no_cache) {
            match Cache::open(named, DEFAULT_LIMIT) {
                Ok(open) => cache = Some(Arc::new(open)),
                Err(error) => {
                    console.say(&format!("warning: {error}; nothing is taken from the cache or kept there\n"));
                    // What does not fit into memory goes elsewhere too.
                    folder = None;
                }
            }
        }
        let memory = args.memory.unwrap_or_else(half_of_memory);
        pool::keep_at_most(usize::try_from(pooled(memory)).unwrap_or(usize::MAX));
        let policy = args.kept.iter().rev().find(|(node, _)| node.is_none()).map_or(Policy::Auto, |(_, policy)| *policy);
        let policies = args.kept.iter().filter_map(|(node, policy)| Some((node.clone()?, *policy))).collect();
        Self { threads, memory, folder, cache, policy, policies }
    }

    /// How a job on `graph_file` is run.
    pub(crate) fn how<'a>(&'a self, graph_file: &'a Path, sources: &'a SourceMap) -> How<'a> {
        self.how_with(graph_file, sources, &self.policies)
    }

    /// What is kept of single nodes: what was asked for, before `others`.
    pub(crate) fn policies_with(&self, others: &[(String, Policy)]) -> Vec<(String, Policy)> {
        others.iter().chain(&self.policies).cloned().collect()
    }

    /// As [`Ready::how`], with what is kept of single nodes.
    pub(crate) fn how_with<'a>(&'a self, graph_file: &'a Path, sources: &'a SourceMap, policies: &'a [(String, Policy)]) -> How<'a> {
        let keep = self.cache.clone().zip(self.folder.as_deref()).map(|(cache, folder)| Keep {
            cache,
            folder,
            graph_file,
            sources,
            policy: self.policy,
            policies,
        });
        let spill = self.folder.as_ref().map_or_else(std::env::temp_dir, |folder| folder.join("v1").join("spill"));
        How {
            threads: self.threads,
            memory: Some(left_by_pool(self.memory)),
            asked: with_pool,
            spill,
            keep,
            measure: Some(pool::measure),
            ..How::default()
        }
    }

    /// Nodes for which something is asked though the graph does not have them.
    pub(crate) fn strangers<'a>(&'a self, mut has: impl FnMut(&str) -> bool + 'a) -> impl Iterator<Item = &'a str> {
        self.policies.iter().map(|(node, _)| node.as_str()).filter(move |node| !has(node))
    }

    /// What went wrong with the cache.
    pub(crate) fn say_trouble(&self, console: &mut Console) {
        if let Some(cache) = &self.cache {
            cache.trouble().iter().for_each(|t| console.say(&format!("warning: {t}\n")));
        }
    }

    pub(crate) fn memory(&self) -> u64 {
        self.memory
    }
}

/// The part of a budget that free blocks may have.
fn pooled(memory: u64) -> u64 {
    (memory / 8).min(512 << 20)
}

/// What of a budget is for the run.
fn left_by_pool(memory: u64) -> u64 {
    memory - pooled(memory)
}

/// The budget that leaves a run so many bytes.
fn with_pool(bytes: u64) -> u64 {
    bytes.saturating_add(bytes.div_ceil(7).min(512 << 20))
}

/// Half of the memory of the machine, or of the control group that the process is in; 2 GiB where nobody says how much that is.
fn half_of_memory() -> u64 {
    let ram = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    let Ok(system) = System::new_with_specifics(ram) else { return 2 << 30 };
    let group = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
    system.total_memory().min(group) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_error_says_to_ask_for_is_enough() {
        for bytes in [0, 1, 6, 7, 8, 1000, (7 << 29) - 1, 7 << 29, (7 << 29) + 1, 1 << 40] {
            assert!(left_by_pool(with_pool(bytes)) >= bytes, "{bytes}");
            assert!(bytes == 0 || left_by_pool(with_pool(bytes) - 2) < bytes, "{bytes}: and no more than that");
        }
    }
}
