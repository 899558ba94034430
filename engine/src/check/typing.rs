//! Types, rates and clocks: what is written, held against what the node types say of themselves.

use std::collections::BTreeMap;
use std::sync::Arc;

use petgraph::graph::{DiGraph, NodeIndex};

use crate::clock::Clock;
use crate::diag::Diagnostic;
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::{Access, Arg, InputSchema, InputType, Kind, Literal, NodeSchema};
use crate::setting::{ClockName, FileUse, InputPath, OutputPath, Place, TypeName};
use crate::syntax::Tree;

use super::document::Given;
use super::resolve::Written;
use super::{At, Checker, code};

/// A node with its bindings looked up, before rates are known.
pub(super) struct Typed {
    pub(super) bindings: Vec<Binding>,
    /// Where each input is written; the node itself for defaults.
    pub(super) places: Vec<At>,
    /// Where each wire of an input is written.
    wires: Vec<(usize, Port, At)>,
    per_frame: bool,
    clock: Option<Arc<Clock>>,
    types: Vec<String>,
}

impl Typed {
    pub(super) fn clock(&self) -> Option<&Arc<Clock>> {
        self.clock.as_ref()
    }

    /// True where a wire brings one value a frame.
    pub(super) fn has_stream_input(&self, checker: &Checker<'_>, typed: &[Typed]) -> bool {
        self.wires.iter().any(|(_, port, _)| !checker.is_single(*port, typed))
    }
}

impl Checker<'_> {
    pub(super) fn resolve_all(&mut self, main: usize) -> Option<Graph> {
        let mut typed: Vec<Typed> = (0..self.nodes.len()).map(|i| self.bind(i)).collect();
        let outputs = self.declared_outputs(main);
        let order = self.order(&typed);
        for &node in &order {
            self.infer(node, &mut typed);
        }
        self.check_files(&typed);
        self.check_settings(&typed);
        self.unused_params();
        self.assemble(main, typed, outputs)
    }

    /// Looks up what stands at each input of a node.
    fn bind(&mut self, node: usize) -> Typed {
        let Some(ty) = self.nodes[node].ty.clone() else {
            return Typed { bindings: Vec::new(), places: Vec::new(), wires: Vec::new(), per_frame: false, clock: None, types: Vec::new() };
        };
        let schema = ty.schema;
        let at = self.nodes[node].at;
        self.unknown_inputs(node, &schema);
        let given: BTreeMap<String, Given> = self.nodes[node].given.iter().map(|(k, (g, _))| (k.clone(), g.clone())).collect();
        let (mut bindings, mut places, mut wires) = (Vec::new(), Vec::new(), Vec::new());
        for (i, input) in schema.inputs.iter().enumerate() {
            let place = given.get(input.name).map_or(at, |g| g.at);
            let binding = match given.get(input.name) {
                Some(g) => self.binding(i, input, g.clone(), &mut wires),
                None => self.default(node, input),
            };
            bindings.push(binding);
            places.push(place);
        }
        Typed { bindings, places, wires, per_frame: false, clock: None, types: Vec::new() }
    }

    fn unknown_inputs(&mut self, node: usize, schema: &NodeSchema) {
        let unknown: Vec<(String, At)> = self.nodes[node]
            .given
            .iter()
            .filter(|(name, _)| schema.input(name).is_none())
            .map(|(name, (g, span))| (name.clone(), At { file: g.at.file, span: *span }))
            .collect();
        for (name, at) in unknown {
            let known: Vec<&str> = schema.inputs.iter().map(|i| i.name).collect();
            let found = Diagnostic::error(code::UNKNOWN_INPUT, format!("expected an input of {}, found `{name}`", schema.id), at.label());
            self.push(found.did_you_mean(&name, known.iter().copied()).help(format!("its inputs are {}", known.join(", "))));
        }
    }

    fn default(&mut self, node: usize, input: &InputSchema) -> Binding {
        let at = self.nodes[node].at;
        match input.default {
            Some(text) => {
                let scope = self.nodes[node].scope;
                let base = self.scopes[scope].base.clone();
                let given = Given { scope, text: text.to_owned(), at, base };
                self.literal(input, &given)
            }
            None if input.optional => Binding::None,
            None => {
                let message = format!("expected input `{}` of node `{}`, found none", input.name, self.nodes[node].name);
                let found = Diagnostic::error(code::MISSING_INPUT, message, at.label()).expected(describe_input(input));
                self.push(found);
                Binding::None
            }
        }
    }

    fn binding(&mut self, i: usize, input: &InputSchema, given: Given, wires: &mut Vec<(usize, Port, At)>) -> Binding {
        match self.written(given) {
            Written::Literal(given) => self.literal(input, &given),
            Written::Reference(reference) => {
                let Some(port) = self.port(&reference) else { return Binding::None };
                wires.push((i, port, reference.at));
                if input.list { Binding::List(vec![port]) } else { Binding::Wire(port) }
            }
            Written::References(references) if input.list => {
                let mut ports = Vec::new();
                for reference in references {
                    if let Some(port) = self.port(&reference) {
                        wires.push((i, port, reference.at));
                        ports.push(port);
                    }
                }
                Binding::List(ports)
            }
            Written::References(references) => {
                let at = references.first().map_or_else(|| self.nodes[0].at, |r| r.at);
                self.error(code::FORM, at, format!("expected one reference at `{}`, found a list", input.name));
                Binding::None
            }
            Written::Broken => Binding::None,
        }
    }

    fn literal(&mut self, input: &InputSchema, given: &Given) -> Binding {
        let place = Place { base: given.base.clone(), out: self.options.out.clone(), types: self.registry.shared_types().clone() };
        match (input.parse)(&given.text, &place) {
            Ok((value, numbers)) => {
                self.range(input, &numbers, given);
                Binding::Literal { value, text: canonical(&given.text) }
            }
            Err(error) => {
                let exact = given.at.span.len() == given.text.len();
                let part = crate::diag::Span::new(error.span.start, error.span.end.max(error.span.start)).shifted(given.at.span.start);
                let at = if exact { At { span: part, ..given.at } } else { given.at };
                let message = format!("input `{}`: {}", input.name, error.message);
                let mut found = Diagnostic::error(code::BAD_LITERAL, message, at.label()).expected(describe_input(input));
                if !error.choices.is_empty() {
                    found = found.did_you_mean(given.text.trim().trim_matches('"'), error.choices.iter().map(String::as_str));
                }
                self.push(found);
                Binding::None
            }
        }
    }

    fn range(&mut self, input: &InputSchema, numbers: &[f64], given: &Given) {
        let (least, greatest) = input.range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        if let Some(n) = numbers.iter().find(|n| !(least..=greatest).contains(*n)) {
            let message = format!("input `{}`: expected {}, found {n}", input.name, describe_range(least, greatest));
            let found =
                Diagnostic::error(code::OUT_OF_RANGE, message, given.at.label()).expected(describe_input(input)).found(n.to_string());
            self.push(found);
        }
    }

    fn declared_outputs(&mut self, main: usize) -> Vec<(String, Port)> {
        let list: Vec<(String, Given)> = self.scopes[main]
            .outputs
            .iter()
            .map(|o| (o.name.clone(), Given { scope: main, text: o.text.clone(), at: o.at, base: std::path::PathBuf::new() }))
            .collect();
        let mut out = Vec::new();
        for (name, given) in list {
            let at = given.at;
            match self.written(given) {
                Written::Reference(reference) => out.extend(self.port(&reference).map(|p| (name, p))),
                Written::Broken => {}
                _ => {
                    self.error(code::FORM, at, "expected a reference as \"@node.port\", found a literal");
                }
            }
        }
        out
    }

    /// Nodes such that each comes after what it reads; says which wait for each other.
    fn order(&mut self, typed: &[Typed]) -> Vec<usize> {
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
                names.join(", "),
                if names.len() == 1 { "itself" } else { "each other" }
            );
            let mut found = Diagnostic::error(code::CYCLE, message, places.first().map_or(self.nodes[first].at, |a| *a).label());
            for at in places.iter().skip(1) {
                found = found.with_label(at.note("and here"));
            }
            self.push(found);
        }
        order
    }

    /// Types of a node's outputs, its rate and its clock, those of its inputs being known.
    fn infer(&mut self, node: usize, typed: &mut [Typed]) {
        let Some(schema) = self.nodes[node].ty.as_ref().map(|t| t.schema.clone()) else { return };
        let named = self.named_clock(node, &schema, &typed[node]);
        self.wire_types(node, &schema, typed);
        let mut per_frame =
            schema.uses_frame || has_sequence_path(&schema, &typed[node]) || self.source_streams(node, &schema, &typed[node]);
        let mut clock = named.clone();
        for (i, port, at) in typed[node].wires.clone() {
            let input = &schema.inputs[i];
            let single = self.is_single(port, typed);
            if single {
                continue;
            }
            match (input.access, schema.kind) {
                (Access::Constant, _) | (Access::Frame | Access::Frames, Kind::Whole) => self.rate_mismatch(input, port, at),
                (Access::Sequence, _) => {}
                _ => per_frame = true,
            }
            let other = typed[port.node].clock.clone();
            if input.any_clock || (input.access == Access::Sequence && named.is_some()) {
                continue;
            }
            match (&clock, other) {
                (Some(own), Some(other)) if own.name != other.name && input.access != Access::Sequence => {
                    self.clock_mismatch(input, own, &other, at)
                }
                (None, other) => clock = other,
                _ => {}
            }
        }
        let main = self.nodes[node].scope;
        let clock = clock.or_else(|| self.scopes[main].clocks.get("frames").cloned());
        if clock.is_none() && (per_frame || schema.kind == Kind::Whole && schema.outputs.iter().any(|o| o.stream)) {
            let at = self.nodes[node].at;
            let message = format!("expected `frames`, as node `{}` has one value a frame, found none", self.nodes[node].name);
            self.error(code::FRAMES, at, message).help.push("write `frames: (first: 1, last: 48, fps: 24)` in the graph".to_owned());
        }
        let types = self.output_types(node, &schema, typed);
        typed[node].per_frame = per_frame;
        typed[node].clock = clock;
        typed[node].types = types;
    }

    /// True where a source says that what it reads is a stream.
    fn source_streams(&self, node: usize, schema: &NodeSchema, typed: &Typed) -> bool {
        let Some(ty) = self.nodes[node].ty.as_ref().filter(|_| schema.kind == Kind::Source) else { return false };
        setting_args(schema, typed).is_some_and(|args| ty.operator.is_per_frame(args).unwrap_or(false))
    }

    fn is_single(&self, port: Port, typed: &[Typed]) -> bool {
        let kind = self.nodes[port.node].ty.as_ref().map(|t| t.schema.kind);
        match kind {
            Some(Kind::Whole) => {
                !self.nodes[port.node].ty.as_ref().is_some_and(|t| t.schema.outputs.get(port.output).is_some_and(|o| o.stream))
            }
            _ => !typed[port.node].per_frame,
        }
    }

    fn named_clock(&mut self, node: usize, schema: &NodeSchema, typed: &Typed) -> Option<Arc<Clock>> {
        for (i, _) in schema.inputs.iter().enumerate() {
            let Some(Binding::Literal { value, .. }) = typed.bindings.get(i) else { continue };
            let name = value.downcast_ref::<ClockName>().cloned().or_else(|| value.downcast_ref::<Option<ClockName>>().cloned().flatten());
            if let Some(name) = name {
                let scope = self.nodes[node].scope;
                let found = self.scopes[scope].clocks.get(&name.0).cloned();
                if found.is_none() {
                    let known: Vec<String> = self.scopes[scope].clocks.keys().cloned().collect();
                    let message = format!("expected a clock of the graph, found `{}`", name.0);
                    let error = Diagnostic::error(code::UNKNOWN_CLOCK, message, typed.places[i].label());
                    self.push(
                        error.did_you_mean(&name.0, known.iter().map(String::as_str)).help(format!("the clocks are {}", known.join(", "))),
                    );
                }
                return found;
            }
        }
        None
    }

    fn wire_types(&mut self, node: usize, schema: &NodeSchema, typed: &[Typed]) {
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
            let found = Diagnostic::error(code::TYPE_MISMATCH, message, at.label()).expected(describe_input(input)).found(found.clone());
            self.push(found.with_label(note));
        }
    }

    fn rate_mismatch(&mut self, input: &InputSchema, port: Port, at: At) {
        let source = &self.nodes[port.node];
        let note = source.at.note("this has one value a frame");
        let message = format!("input `{}`: expected one value for the whole graph, found one a frame", input.name);
        self.push(Diagnostic::error(code::RATE_MISMATCH, message, at.label()).with_label(note));
    }

    fn clock_mismatch(&mut self, input: &InputSchema, own: &Clock, other: &Clock, at: At) {
        let message = format!("input `{}`: expected the clock `{}`, found `{}`", input.name, own.name, other.name);
        let found = Diagnostic::error(code::CLOCK_MISMATCH, message, at.label());
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
        let found = Diagnostic::error(code::UNKNOWN_VALUE_TYPE, format!("expected a value type, found `{name}`"), at.label());
        self.push(found.did_you_mean(&name, known).help("`pegbar types` lists the value types"));
        None
    }

    /// Lets each node look at its own settings.
    fn check_settings(&mut self, typed: &[Typed]) {
        for node in 0..typed.len() {
            let Some(ty) = self.nodes[node].ty.clone() else { continue };
            let Some(args) = setting_args(&ty.schema, &typed[node]) else { continue };
            for problem in ty.operator.check(args).unwrap_or_default() {
                let at = ty.schema.input(problem.input).map_or(self.nodes[node].at, |(i, _)| typed[node].places[i]);
                self.error(code::SETTINGS, at, problem.message);
            }
        }
    }

    fn unused_params(&mut self) {
        let Some(main) = self.scopes.first() else { return };
        let unused: Vec<(String, At)> = main.params.iter().filter(|(_, p)| !p.read).map(|(n, p)| (n.clone(), p.at)).collect();
        for (name, at) in unused {
            let message = format!("parameter `{name}` is never read");
            self.push(Diagnostic::warning(code::UNUSED_PARAMETER, message, at.label()));
        }
    }

    /// The clock of each input of a node that is wired to a stream.
    fn input_clocks(&self, node: usize, typed: &[Typed]) -> Vec<(&'static str, Arc<Clock>)> {
        let Some(ty) = &self.nodes[node].ty else { return Vec::new() };
        let streams = typed[node].wires.iter().filter(|(_, port, _)| !self.is_single(*port, typed));
        streams.filter_map(|(i, port, _)| Some((ty.schema.inputs[*i].name, typed[port.node].clock.clone()?))).collect()
    }

    fn assemble(&mut self, main: usize, typed: Vec<Typed>, outputs: Vec<(String, Port)>) -> Option<Graph> {
        let fallback = Arc::new(Clock { name: "frames".to_owned(), first: 1, last: 1, fps: (24, 1) });
        let mut input_clocks: Vec<_> = (0..typed.len()).map(|node| self.input_clocks(node, &typed)).collect();
        let mut nodes = Vec::with_capacity(typed.len());
        for ((source, t), input_clocks) in self.nodes.iter().zip(typed).zip(input_clocks.drain(..)) {
            nodes.push(GraphNode {
                name: source.name.clone(),
                ty: source.ty.clone()?,
                inputs: t.bindings,
                per_frame: t.per_frame,
                clock: t.clock.unwrap_or_else(|| fallback.clone()),
                input_clocks,
                output_types: t.types,
                file: source.at.file,
                span: source.at.span,
            });
        }
        let mut clocks: Vec<Arc<Clock>> = self.scopes[main].clocks.values().cloned().collect();
        clocks.sort_by_key(|c| c.name != "frames");
        Some(Graph { clocks, nodes, outputs })
    }
}

/// What stands at each input as far as settings go; `None` where a setting is not there.
fn setting_args(schema: &NodeSchema, typed: &Typed) -> Option<Vec<Arg>> {
    let one = |(input, binding): (&InputSchema, &Binding)| match binding {
        Binding::Literal { value, .. } => Some(Arg::Literal(value.clone())),
        Binding::Wire(_) if matches!(input.ty, InputType::Setting { .. }) => Some(crate::plan::placeholder(input)),
        _ if matches!(input.ty, InputType::Setting { .. }) => None,
        _ if input.access == Access::Sequence && !input.list => Some(Arg::Sequence(crate::node::SequenceRef::new(None, Vec::new()))),
        _ => Some(Arg::None),
    };
    schema.inputs.iter().zip(&typed.bindings).map(one).collect()
}

fn has_sequence_path(schema: &NodeSchema, typed: &Typed) -> bool {
    schema.inputs.iter().zip(&typed.bindings).any(|(input, binding)| match (input.files, binding) {
        (FileUse::Read, Binding::Literal { value, .. }) => value.downcast_ref::<InputPath>().is_some_and(InputPath::is_sequence),
        (FileUse::Write, Binding::Literal { value, .. }) => value.downcast_ref::<OutputPath>().is_some_and(OutputPath::is_sequence),
        _ => false,
    })
}

/// The literal without comments and blanks, so that keys do not change with the layout.
pub(super) fn canonical(text: &str) -> String {
    Tree::parse(text.to_owned()).tokens().filter(|t| !t.kind().is_trivia()).map(|t| t.text()).collect()
}

fn with_article(name: &str) -> String {
    let article = if name.starts_with(['A', 'E', 'I', 'O', 'U']) { "an" } else { "a" };
    format!("{article} {name}")
}

/// Type, unit and range of an input, for messages.
pub(super) fn describe_input(input: &InputSchema) -> String {
    let mut out = match &input.ty {
        InputType::Any => "a reference to any value".to_owned(),
        InputType::Value(name) => match input.literal {
            Some(form) => format!("a reference to {}, or {form}", with_article(name)),
            None => format!("a reference to {}", with_article(name)),
        },
        InputType::Setting { name, wire } => match wire {
            Some(wire) => format!("{name}, or a reference to {}", with_article(wire)),
            None => name.clone(),
        },
    };
    if let Some(unit) = input.unit {
        out.push_str(&format!(", in {unit}"));
    }
    if let Some((least, greatest)) = input.range {
        out.push_str(&format!(", {}", describe_range(least, greatest)));
    }
    out
}

fn describe_range(least: f64, greatest: f64) -> String {
    match (least.is_finite(), greatest.is_finite()) {
        (true, true) => format!("from {least} to {greatest}"),
        (true, false) => format!("at least {least}"),
        (false, true) => format!("at most {greatest}"),
        (false, false) => "any number".to_owned(),
    }
}
