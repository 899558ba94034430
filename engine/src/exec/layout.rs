//! Numbers for the tasks of a plan and for the values between them.

use crate::graph::{Graph, Port};
use crate::plan::{Edge, Plan, Reads};

/// The number of each node's first task and of each port's first value.
pub(super) struct Layout {
    tasks: Vec<usize>,
    n_tasks: usize,
    /// For each port of each node, its state being the last port.
    slots: Vec<Vec<usize>>,
    n_slots: usize,
    /// Values of each port.
    lens: Vec<Vec<usize>>,
}

impl Layout {
    pub(super) fn new(graph: &Graph, plan: &Plan) -> Self {
        let mut layout = Self { tasks: Vec::new(), n_tasks: 0, slots: Vec::new(), n_slots: 0, lens: Vec::new() };
        for (node, planned) in graph.nodes.iter().zip(&plan.nodes) {
            layout.tasks.push(layout.n_tasks);
            layout.n_tasks += planned.wanted.len();
            let needed = planned.wanted.contains(&true);
            let len = |port: usize| match (needed, node.is_single(port)) {
                (false, _) => 0,
                (true, true) => 1,
                (true, false) => node.clock.len(),
            };
            let lens: Vec<usize> = (0..=node.ty.schema.outputs.len()).map(len).collect();
            let base = |len: &usize| {
                let base = layout.n_slots;
                layout.n_slots += len;
                base
            };
            layout.slots.push(lens.iter().map(base).collect());
            layout.lens.push(lens);
        }
        layout
    }

    pub(super) fn n_tasks(&self) -> usize {
        self.n_tasks
    }

    pub(super) fn n_slots(&self) -> usize {
        self.n_slots
    }

    pub(super) fn task(&self, node: usize, index: usize) -> usize {
        self.tasks[node] + index
    }

    /// Numbers of the values of a port, one a frame or one.
    pub(super) fn port(&self, port: Port) -> std::ops::Range<usize> {
        let base = self.slots[port.node][port.output];
        base..base + self.lens[port.node][port.output]
    }

    /// Ports of a node, its state being the last.
    pub(super) fn ports(&self, node: usize) -> usize {
        self.slots[node].len()
    }

    /// Numbers of the values that a task makes at a port.
    pub(super) fn made(&self, graph: &Graph, node: usize, output: usize, task: usize) -> std::ops::Range<usize> {
        let all = self.port(Port { node, output });
        if graph.nodes[node].runs_once() || all.is_empty() { all } else { all.start + task..all.start + task + 1 }
    }

    /// Numbers of the values that an edge brings to a task, in order.
    pub(super) fn reads<'a>(&self, edge: &'a Edge, task: usize) -> ReadSlots<'a> {
        let port = self.port(edge.port);
        match &edge.reads {
            Reads::Same => ReadSlots { range: port.start + task..port.start + task + 1, list: None },
            Reads::Held => ReadSlots { range: port.start..port.start + 1, list: None },
            Reads::All => ReadSlots { range: port, list: None },
            Reads::Lists(lists) => ReadSlots { range: port, list: Some(lists.forward[task].iter()) },
        }
    }
}

/// The numbers of the values that a task reads through an edge.
pub(super) struct ReadSlots<'a> {
    range: std::ops::Range<usize>,
    list: Option<std::slice::Iter<'a, u32>>,
}

impl Iterator for ReadSlots<'_> {
    type Item = usize;
    fn next(&mut self) -> Option<usize> {
        match &mut self.list {
            Some(list) => list.next().map(|k| self.range.start + *k as usize),
            None => self.range.next(),
        }
    }
}
