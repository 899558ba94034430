//! Types, rates and clocks: what flows along the wires, from what each node reads to what it makes.

use std::sync::Arc;

use petgraph::graph::{DiGraph, NodeIndex};

use crate::clock::Clock;
use crate::graph::{Binding, Port};
use crate::node::{Access, InputSchema, InputType, Kind, Literal, NodeSchema};
use crate::setting::{ClockName, FileUse, InputPath, OutputPath, TypeName};

use super::typing::{Typed, settings};
use super::words::{describe_clock, describe_input, with_article};
use super::{At, Checker, code};

/// Names and places of a ring that a message shows.
const SHOWN: usize = 8;

/// The clock that a node names.
enum Named {
    /// None.
    No,
    /// This one.
    Clock(Arc<Clock>),
    /// One that there is not.
    Unknown,
}

impl Checker<'_> {
    /// Nodes such that each comes after what it reads; says which wait for each other.
    pub(super) fn order(&mut self, typed: &[Typed]) -> Vec<usize> {
        let mut net = DiGraph::<usize, ()>::new();
        let ids: Vec<NodeIndex> = (0..typed.len()).map(|i| net.add_node(i)).collect();
        for (i, node) in typed.iter().enumerate() {
            for (_, port, _) in &node.wires {
                net.add_edge(ids[port.node], ids[i], ());
            }
        }
        let mut order = Vec::new();
        // Components come with consumers first, so the other way round is the order that is wanted.
        for component in petgraph::algo::tarjan_scc(&net).into_iter().rev() {
            let mut members: Vec<usize> = component.iter().map(|n| net[*n]).collect();
            members.sort_unstable();
            let first = members[0];
            if members.len() == 1 && !net.contains_edge(component[0], component[0]) {
                order.push(first);
                continue;
            }
            let names: Vec<String> = members.iter().map(|&m| format!("`{}`", self.nodes[m].name)).collect();
            let inside = |m: usize| typed[m].wires.iter().find(|(_, p, _)| members.contains(&p.node));
            let places: Vec<At> = members.iter().filter_map(|&m| inside(m).map(|(_, _, at)| *at)).collect();
            let message = format!(
                "expected a graph without a ring, found {} waiting for {}",
                names.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", "),
                if names.len() == 1 { "itself" } else { "each other" }
            );
            let mut found = places.first().map_or(self.nodes[first].at, |a| *a).error(code::CYCLE, message);
            for at in places.iter().take(SHOWN).skip(1) {
                found = found.with_label(at.note("and here"));
            }
            self.push(found);
        }
        order
    }

    /// Types of a node's outputs, its rate and its clock, those of its inputs being known.
    pub(super) fn infer(&mut self, node: usize, typed: &mut [Typed]) {
        let Some(schema) = self.nodes[node].ty.as_ref().map(|t| t.schema.clone()) else { return };
        let named = self.named_clock(node, &schema, &typed[node]);
        let mismatched = self.wire_types(node, &schema, typed);
        let doubtful = typed[node].doubtful
            || matches!(named, Named::Unknown)
            || typed[node].wires.iter().any(|(i, p, _)| typed[p.node].doubtful && !schema.inputs[*i].any_clock);
        let named = if let Named::Clock(clock) = named { Some(clock) } else { None };
        let declared = schema.uses_frame || has_sequence_path(&schema, &typed[node]);
        let mut per_frame = declared || self.source_streams(node, &schema, &typed[node]);
        let mut clock = named.clone();
        for (i, port, at) in typed[node].wires.clone() {
            let input = &schema.inputs[i];
            if self.is_single(port, typed) {
                continue;
            }
            match (input.access, schema.kind) {
                // A wire of the wrong type is wrong at any rate.
                (Access::Constant, _) | (Access::Frame, Kind::Whole) if mismatched.contains(&(i, port)) => {}
                (Access::Constant, _) | (Access::Frame, Kind::Whole) => self.rate_mismatch(input, port, at),
                (access, _) if access.by_handle() => {}
                _ => per_frame = true,
            }
            if input.any_clock || (input.access.by_handle() && named.is_some()) {
                continue;
            }
            match (&clock, typed[port.node].clock.clone()) {
                (Some(own), Some(other)) if **own != *other && !input.access.by_handle() && !doubtful => {
                    self.clock_mismatch(input, own, &other, port, at);
                }
                (None, other) => clock = other,
                _ => {}
            }
        }
        let scope = self.nodes[node].scope;
        let clock = clock.or_else(|| self.scopes[scope].clocks.get("frames").cloned());
        if clock.is_none() && (per_frame || schema.kind == Kind::Whole && schema.outputs.iter().any(|o| o.stream)) {
            self.frameless.push((self.nodes[node].name.clone(), self.nodes[node].at));
        }
        let types = self.output_types(node, &schema, typed);
        let broken_clock = clock.as_ref().is_some_and(|c| self.broken_clocks.contains(&c.name));
        let typed = &mut typed[node];
        (typed.per_frame, typed.clock, typed.types, typed.doubtful) = (per_frame, clock, types, doubtful || broken_clock);
    }

    /// Says once for all nodes that there are no frames.
    pub(super) fn no_frames(&mut self) {
        self.frameless.sort_by_key(|(_, at)| (at.file, at.span));
        let Some(((name, at), more)) = self.frameless.split_first() else { return };
        let others = match more.len() {
            0 => String::new(),
            1 => ", and another".to_owned(),
            n => format!(", and {n} others"),
        };
        let message = format!("expected `frames` in the graph, as node `{name}` has one value a frame{others}; found none");
        let found = at.error(code::FRAMES, message).help("write `frames: (first: 1, last: 48, fps: 24)` in the graph");
        self.push(found);
    }

    /// True where a source says that what it reads is a stream.
    fn source_streams(&self, node: usize, schema: &NodeSchema, typed: &Typed) -> bool {
        let Some(ty) = self.nodes[node].ty.as_ref().filter(|_| schema.kind == Kind::Source) else { return false };
        settings(schema, &typed.bindings).is_some_and(|args| ty.operator.is_per_frame(args).unwrap_or(false))
    }

    pub(super) fn is_single(&self, port: Port, typed: &[Typed]) -> bool {
        let kind = self.nodes[port.node].ty.as_ref().map(|t| t.schema.kind);
        match kind {
            Some(Kind::Whole) => {
                !self.nodes[port.node].ty.as_ref().is_some_and(|t| t.schema.outputs.get(port.output).is_some_and(|o| o.stream))
            }
            _ => !typed[port.node].per_frame,
        }
    }

    fn named_clock(&mut self, node: usize, schema: &NodeSchema, typed: &Typed) -> Named {
        let name = |b: &Binding| match b {
            Binding::Literal { value, .. } => {
                value.downcast_ref::<ClockName>().cloned().or_else(|| value.downcast_ref::<Option<ClockName>>().cloned().flatten())
            }
            _ => None,
        };
        let Some((i, name)) = typed.bindings.iter().enumerate().find_map(|(i, b)| Some((i, name(b)?))) else { return Named::No };
        let scope = self.nodes[node].scope;
        if let Some(clock) = self.scopes[scope].clocks.get(&name.0) {
            return Named::Clock(clock.clone());
        }
        // A graph without frames is told so once, not at each node whose default they are.
        if !self.nodes[node].given.contains_key(schema.inputs[i].name) {
            return Named::No;
        }
        let known: Vec<String> = self.scopes[scope].clocks.keys().cloned().collect();
        let list = if known.is_empty() { "the graph has no clocks".to_owned() } else { format!("the clocks are {}", known.join(", ")) };
        let error = typed.places[i].error(code::UNKNOWN_CLOCK, format!("expected a clock of the graph, found `{}`", name.0));
        self.push(error.did_you_mean(&name.0, known.iter().map(String::as_str)).help(list));
        Named::Unknown
    }

    /// Says which wires are of another type than their inputs; those.
    fn wire_types(&mut self, node: usize, schema: &NodeSchema, typed: &[Typed]) -> Vec<(usize, Port)> {
        let mut mismatched = Vec::new();
        for (i, port, at) in &typed[node].wires {
            let input = &schema.inputs[*i];
            let Some(found) = typed[port.node].types.get(port.output).filter(|t| !t.is_empty()) else { continue };
            let expected = match &input.ty {
                InputType::Any => continue,
                InputType::Value(name) => Some(*name),
                InputType::Setting { wire, .. } => *wire,
            };
            if expected == Some(found.as_str()) {
                continue;
            }
            let source = &self.nodes[port.node];
            let output = source.ty.as_ref().and_then(|t| t.schema.outputs.get(port.output)).map_or("", |o| o.name);
            let message = match expected {
                Some(expected) => format!("input `{}`: expected {expected}, found {found}", input.name),
                None => format!("input `{}`: expected a literal, found a reference", input.name),
            };
            let note = source.at.note(format!("`{}.{output}` is {}", source.name, with_article(found)));
            let found = at.error(code::TYPE_MISMATCH, message).expected(describe_input(input)).found(found.clone());
            self.push(found.with_label(note));
            mismatched.push((*i, *port));
        }
        mismatched
    }

    fn rate_mismatch(&mut self, input: &InputSchema, port: Port, at: At) {
        let source = &self.nodes[port.node];
        let note = source.at.note(format!("`{}` has one value a frame", source.name));
        let message = format!("input `{}`: expected one value for the whole graph, found one a frame", input.name);
        let found = at.error(code::RATE_MISMATCH, message).with_label(note);
        self.push(found.help("wire a value that does not change over time, or a node that makes one value of a whole sequence"));
    }

    fn clock_mismatch(&mut self, input: &InputSchema, own: &Clock, other: &Clock, port: Port, at: At) {
        let message = format!("input `{}`: expected the clock {}, found {}", input.name, describe_clock(own), describe_clock(other));
        let source = &self.nodes[port.node];
        let note = source.at.note(format!("`{}` is on the clock `{}`", source.name, other.name));
        let found = at.error(code::CLOCK_MISMATCH, message).with_label(note);
        self.push(found.help("a node that changes time goes between: time.hold, time.resample or retime.apply"));
    }

    fn output_types(&mut self, node: usize, schema: &NodeSchema, typed: &[Typed]) -> Vec<String> {
        let from = schema.type_from.and_then(|name| schema.input(name));
        let any = match from {
            Some((i, _)) => match typed[node].bindings.get(i) {
                Some(Binding::Wire(port)) => typed[port.node].types.get(port.output).cloned(),
                Some(Binding::Literal { value, .. }) => self.type_named(value, typed[node].places[i]),
                _ => None,
            },
            None => None,
        };
        schema.outputs.iter().map(|o| o.ty.map(str::to_owned).or_else(|| any.clone()).unwrap_or_default()).collect()
    }

    fn type_named(&mut self, literal: &Literal, at: At) -> Option<String> {
        let name = match literal.downcast_ref::<TypeName>() {
            Some(ty) => ty.name().to_owned(),
            None => literal.downcast_ref::<String>()?.clone(),
        };
        if self.registry.get_type(&name).is_some() {
            return Some(name);
        }
        let known: Vec<&str> = self.registry.types().map(|t| t.schema.name).collect();
        let found = at.error(code::UNKNOWN_VALUE_TYPE, format!("expected a value type, found `{name}`"));
        self.push(found.did_you_mean(&name, known).help("`pegbar types` lists the value types"));
        None
    }
}

fn has_sequence_path(schema: &NodeSchema, typed: &Typed) -> bool {
    schema.inputs.iter().zip(&typed.bindings).any(|(input, binding)| match (input.files, binding) {
        (FileUse::Read, Binding::Literal { value, .. }) => value.downcast_ref::<InputPath>().is_some_and(InputPath::is_sequence),
        (FileUse::Write, Binding::Literal { value, .. }) => value.downcast_ref::<OutputPath>().is_some_and(OutputPath::is_sequence),
        _ => false,
    })
}
