//! What a plan will need of memory: it is walked through task by task, as one thread would run it, with sizes in place of values.

use super::layout::Layout;
use super::memory::LEAST;
use super::sizes::Expected;
use crate::graph::Graph;
use crate::plan::{Edge, Plan, Reads};

/// What a plan needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Footprint {
    /// The least budget: what the most demanding task needs at once, all else being on disk.
    pub least: u64,
    /// Node and frame of that task.
    pub least_at: Option<(usize, i64)>,
    /// Most bytes alive at once where one thread runs it and nothing goes to disk.
    pub peak: u64,
    /// What one more target in flight adds to that.
    pub path: u64,
    /// For each node, the most of its results that are alive at once.
    pub alive: Vec<u64>,
}

struct Walk<'a> {
    graph: &'a Graph,
    plan: &'a Plan,
    layout: &'a Layout,
    sizes: &'a [Expected],
    /// Reads of each task's results still to come.
    readers: Vec<u32>,
    is_done: Vec<bool>,
    alive: Vec<u64>,
    live: u64,
    /// What of it is too small to leave memory.
    small: u64,
    found: Footprint,
}

/// Walks through the first `targets` of `plan`. Cost: O(reads).
pub(super) fn footprint(graph: &Graph, plan: &Plan, layout: &Layout, sizes: &[Expected], targets: usize) -> Footprint {
    let mut walk = Walk {
        graph,
        plan,
        layout,
        sizes,
        readers: vec![0; layout.n_tasks()],
        is_done: vec![false; layout.n_tasks()],
        alive: vec![0; graph.nodes.len()],
        live: 0,
        small: 0,
        found: Footprint { alive: vec![0; graph.nodes.len()], ..Footprint::default() },
    };
    for (node, planned) in plan.nodes.iter().enumerate() {
        for task in (0..planned.wanted.len()).filter(|&k| planned.wanted[k]) {
            walk.each_read(node, task, |walk, producer, index| walk.readers[walk.layout.task(producer, index)] += 1);
        }
    }
    for &(node, task) in plan.targets.iter().take(targets) {
        let before = walk.live;
        let peak = walk.reach(node as usize, task as usize);
        walk.found.path = walk.found.path.max(peak.saturating_sub(before));
    }
    walk.found
}

impl<'a> Walk<'a> {
    fn each_read(&mut self, node: usize, task: usize, mut each: impl FnMut(&mut Self, usize, usize)) {
        let (graph, plan) = (self.graph, self.plan);
        for edge in &plan.nodes[node].edges {
            let producer = edge.port.node;
            let once = graph.nodes[producer].runs_once();
            match &edge.reads {
                _ if once => each(self, producer, 0),
                Reads::Same => each(self, producer, task),
                Reads::Held => each(self, producer, 0),
                Reads::All => (0..graph.nodes[producer].clock.len()).for_each(|k| each(self, producer, k)),
                Reads::Lists(lists) => lists.forward[task].iter().for_each(|&k| each(self, producer, k as usize)),
            }
        }
    }

    /// Runs a target and what it reads; gives the most bytes alive meanwhile.
    fn reach(&mut self, node: usize, task: usize) -> u64 {
        let mut peak = self.live;
        let mut stack = vec![(node, task, false)];
        while let Some((node, task, is_ready)) = stack.pop() {
            if self.is_done[self.layout.task(node, task)] {
                continue;
            }
            if is_ready {
                peak = peak.max(self.run(node, task));
                continue;
            }
            stack.push((node, task, true));
            let mut reads = Vec::new();
            self.each_read(node, task, |walk, producer, index| {
                let is_open = walk.plan.nodes[producer].wanted[index] && !walk.is_done[walk.layout.task(producer, index)];
                if is_open && (producer, index) != (node, task) {
                    reads.push((producer, index, false));
                }
            });
            stack.extend(reads.into_iter().rev());
        }
        self.found.peak = self.found.peak.max(peak);
        peak
    }

    fn run(&mut self, node: usize, task: usize) -> u64 {
        let own = self.layout.task(node, task);
        self.is_done[own] = true;
        let size = self.sizes[node];
        self.live += size.bytes;
        let least = size.bytes + size.scratch + self.inputs(node, task) + self.small;
        self.small += self.small(node);
        self.alive[node] += 1;
        self.found.alive[node] = self.found.alive[node].max(self.alive[node]);
        let peak = self.live + size.scratch;
        if least > self.found.least {
            self.found.least = least;
            self.found.least_at = Some((node, self.graph.nodes[node].clock.first + task as i64));
        }
        self.each_read(node, task, |walk, producer, index| {
            let read = walk.layout.task(producer, index);
            walk.readers[read] -= 1;
            if walk.readers[read] == 0 && walk.is_done[read] {
                walk.drop_one(producer);
            }
        });
        if self.readers[own] == 0 {
            self.drop_one(node);
        }
        peak
    }

    /// Bytes of a task's results that may stay in memory whatever happens, as each value by itself is too small to leave.
    fn small(&self, node: usize) -> u64 {
        let values: usize = (0..self.layout.ports(node)).map(|output| self.layout.made(self.graph, node, output, 0).len()).sum();
        self.sizes[node].bytes.min(LEAST * values as u64)
    }

    fn drop_one(&mut self, node: usize) {
        self.live -= self.sizes[node].bytes;
        self.small -= self.small(node);
        self.alive[node] -= 1;
    }

    /// Bytes that a task reads and holds at once: of a sequence one frame.
    fn inputs(&self, node: usize, task: usize) -> u64 {
        let bytes = |edge: &Edge| {
            let producer = edge.port.node;
            let all = self.sizes[producer].bytes;
            let each = if self.graph.nodes[producer].runs_once() && !self.graph.is_single(edge.port) {
                all / self.graph.nodes[producer].clock.len().max(1) as u64
            } else {
                all
            };
            match &edge.reads {
                Reads::Lists(lists) if !edge.by_handle => each * lists.forward[task].len() as u64,
                _ => each,
            }
        };
        self.plan.nodes[node].edges.iter().map(bytes).sum()
    }
}
