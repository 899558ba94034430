//! What is written at each input, held against what the node type says of it; and what comes of it all: a graph.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;

use crate::clock::Clock;
use crate::graph::{Binding, Graph, GraphNode, Port};
use crate::node::{Arg, InputSchema, InputType, NodeError, NodeSchema, SequenceRef};
use crate::registry::NodeType;
use crate::setting::{Place, SettingError};
use crate::syntax::{NodeKind, Tree, canonical};

use super::document::Given;
use super::params::resembles;
use super::resolve::Written;
use super::words::{describe_input, describe_range, refusal};
use super::{At, Checker, code};

/// A node with its bindings looked up; its rate, clock and types follow from those.
pub(super) struct Typed {
    pub(super) bindings: Vec<Binding>,
    /// Where each input is written; the node itself for defaults.
    pub(super) places: Vec<At>,
    /// Where each wire of an input is written.
    pub(super) wires: Vec<(usize, Port, At)>,
    pub(super) per_frame: bool,
    pub(super) clock: Option<Arc<Clock>>,
    pub(super) types: Vec<String>,
    /// True where something that it hangs on is wrong, so that neither its rate nor its clock is certain.
    pub(super) doubtful: bool,
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
        let mut outputs = Vec::new();
        for scope in 0..self.scopes.len() {
            let declared = self.declared_outputs(scope);
            if scope == main {
                outputs = declared;
            }
        }
        let order = self.order(&typed);
        for &node in &order {
            self.infer(node, &mut typed);
        }
        self.inferred = self.conclude(&typed);
        self.no_frames();
        self.check_files(&typed);
        self.check_settings(&typed);
        self.unused_params();
        self.assemble(main, typed, outputs)
    }

    /// Looks up what stands at each input of a node.
    fn bind(&mut self, node: usize) -> Typed {
        let said = self.diagnostics.len();
        let (mut bindings, mut places, mut wires) = (Vec::new(), Vec::new(), Vec::new());
        let given: BTreeMap<String, Given> = self.nodes[node].given.iter().map(|(k, (g, _))| (k.clone(), g.clone())).collect();
        match self.nodes[node].ty.clone() {
            None => given.into_values().for_each(|g| self.look_up(g)),
            Some(ty) => {
                let misspelt = self.unknown_inputs(node, &ty.schema);
                for (i, input) in ty.schema.inputs.iter().enumerate() {
                    places.push(given.get(input.name).map_or(self.nodes[node].at, |g| g.at));
                    bindings.push(match given.get(input.name) {
                        Some(g) => self.binding(i, input, g.clone(), &mut wires),
                        None => self.default(node, input, &misspelt),
                    });
                }
            }
        }
        // A broken value may have been said elsewhere, once for all who use it.
        let lost = |(input, binding): (&InputSchema, &Binding)| given_lost(input, binding);
        let schema = self.nodes[node].ty.as_ref().map(|t| t.schema.clone());
        let lost = schema.is_none_or(|s| s.inputs.iter().zip(&bindings).any(lost));
        let doubtful = lost || self.diagnostics.len() > said;
        Typed { bindings, places, wires, per_frame: false, clock: None, types: Vec::new(), doubtful }
    }

    /// Follows what stands at an input of a node whose type is not known.
    fn look_up(&mut self, given: Given) {
        match self.written(given) {
            Written::Reference(reference) => {
                self.port(&reference);
            }
            Written::References(references) => {
                for reference in &references {
                    self.port(reference);
                }
            }
            Written::Literal(_) | Written::Broken => {}
        }
    }

    /// Says which inputs the type does not have; their names.
    fn unknown_inputs(&mut self, node: usize, schema: &NodeSchema) -> Vec<String> {
        let given = self.nodes[node].given.iter().filter(|(name, _)| schema.input(name).is_none());
        let unknown: Vec<(String, At)> = given.map(|(name, (g, span))| (name.clone(), At::new(g.at.file, *span))).collect();
        let known: Vec<&str> = schema.inputs.iter().map(|i| i.name).collect();
        let list = if known.is_empty() { "it has no inputs".to_owned() } else { format!("its inputs are {}", known.join(", ")) };
        for (name, at) in &unknown {
            let found = at.error(code::UNKNOWN_INPUT, format!("expected an input of {}, found `{name}`", schema.id));
            self.push(found.did_you_mean(name, known.iter().copied()).help(list.clone()));
        }
        unknown.into_iter().map(|(name, _)| name).collect()
    }

    fn default(&mut self, node: usize, input: &InputSchema, misspelt: &[String]) -> Binding {
        let (at, scope) = (self.nodes[node].at, self.nodes[node].scope);
        let base = self.scopes[scope].base.clone();
        match input.default {
            Some(text) => return self.literal(input, &Given { scope, text: text.to_owned(), at, base }),
            None if input.optional => return Binding::None,
            None => {}
        }
        // A setting that may be left out reads `None`.
        let place = self.place(base);
        if let Ok((value, _)) = (input.parse)("None", &place) {
            return Binding::Literal { value, text: "None".to_owned() };
        }
        if !misspelt.iter().any(|name| resembles(name, input.name)) {
            let message = format!("expected input `{}` of node `{}`, found none", input.name, self.nodes[node].name);
            self.push(at.error(code::MISSING_INPUT, message).expected(describe_input(input)));
        }
        Binding::None
    }

    fn binding(&mut self, i: usize, input: &InputSchema, given: Given, wires: &mut Vec<(usize, Port, At)>) -> Binding {
        let at = given.at;
        match self.written(given) {
            Written::Literal(given) if input.list && canonical(&given.text) == "[]" => self.empty_list(input, &given),
            Written::Literal(given) => self.literal(input, &given),
            Written::Reference(reference) => {
                let Some(port) = self.port(&reference) else { return Binding::None };
                wires.push((i, port, reference.at));
                if input.list { Binding::List(vec![port]) } else { Binding::Wire(port) }
            }
            Written::References(references) if input.list => {
                let ports: Vec<(Port, At)> = references.iter().filter_map(|r| Some((self.port(r)?, r.at))).collect();
                wires.extend(ports.iter().map(|(port, at)| (i, *port, *at)));
                Binding::List(ports.into_iter().map(|(port, _)| port).collect())
            }
            Written::References(references) => {
                let message = format!("input `{}`: expected one reference, found a list of {}", input.name, references.len());
                self.error(code::FORM, at, message);
                Binding::None
            }
            Written::Broken => Binding::None,
        }
    }

    fn place(&self, base: PathBuf) -> Place {
        Place { base, out: self.options.out.clone(), types: self.registry.shared_types().clone(), origin: self.origin.clone() }
    }

    fn empty_list(&mut self, input: &InputSchema, given: &Given) -> Binding {
        if !input.optional {
            let message = format!("input `{}`: expected one reference at least, found an empty list", input.name);
            self.push(given.at.error(code::MISSING_INPUT, message).expected(describe_input(input)));
        }
        Binding::List(Vec::new())
    }

    fn literal(&mut self, input: &InputSchema, given: &Given) -> Binding {
        if input.optional && given.text.trim() == "None" {
            return Binding::None;
        }
        let place = self.place(given.base.clone());
        match (input.parse)(&given.text, &place) {
            Ok((value, numbers)) if self.range(input, &numbers, given) => Binding::Literal { value, text: canonical(&given.text) },
            Ok(_) => Binding::None,
            Err(error) => {
                self.bad_literal(input, given, &error);
                Binding::None
            }
        }
    }

    fn bad_literal(&mut self, input: &InputSchema, given: &Given, error: &SettingError) {
        let at = if self.is_verbatim(given.at, &given.text) {
            let part = crate::diag::Span::new(error.span.start, error.span.end.min(given.text.len()));
            At { span: part.shifted(given.at.span.start), ..given.at }
        } else {
            given.at
        };
        let is_value = !matches!(input.ty, InputType::Setting { .. }) && input.literal.is_none();
        let message = match is_value {
            true => format!("input `{}`: expected a reference as \"@node.port\", found {}", input.name, given.text.trim()),
            false => format!("input `{}`: {}", input.name, refusal(error, &given.text)),
        };
        let mut found = at.error(code::BAD_LITERAL, message).expected(describe_input(input));
        let word = given.text.trim();
        if !error.choices.is_empty() {
            found = found.did_you_mean(word.trim_matches('"'), error.choices.iter().map(String::as_str));
        } else if error.message.starts_with("expected string") && !word.starts_with(['[', '(', '{']) {
            found = found.help(format!("write it in quotes: \"{word}\""));
        }
        let name = word.trim_matches('"');
        if is_value && self.scopes[given.scope].entries.contains_key(name) {
            found = found.meant(word, &format!("\"@{name}\""));
        }
        self.push(found);
    }

    /// False where a number is outside the input's range, which is said.
    fn range(&mut self, input: &InputSchema, numbers: &[f64], given: &Given) -> bool {
        let (least, greatest) = input.range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        let Some(i) = numbers.iter().position(|n| input.range.is_some() && !(least..=greatest).contains(n)) else { return true };
        let at = self.number_at(given, i, numbers.len());
        let message = format!("input `{}`: expected {}, found {}", input.name, describe_range(least, greatest), numbers[i]);
        self.push(at.error(code::OUT_OF_RANGE, message).expected(describe_input(input)));
        false
    }

    /// The place of one number of a literal of `count` numbers.
    fn number_at(&self, given: &Given, index: usize, count: usize) -> At {
        let tree = Tree::parse(given.text.clone());
        let numbers: Vec<_> = tree.root().descendants().filter(|n| n.kind() == NodeKind::Number).map(|n| n.span()).collect();
        match numbers.get(index) {
            Some(span) if numbers.len() == count && self.is_verbatim(given.at, &given.text) => {
                At { span: span.shifted(given.at.span.start), ..given.at }
            }
            _ => given.at,
        }
    }

    fn declared_outputs(&mut self, scope: usize) -> Vec<(String, Port)> {
        let given = |o: &super::document::Output| Given { scope, text: o.text.clone(), at: o.at, base: PathBuf::new() };
        let list: Vec<(String, Given)> = self.scopes[scope].outputs.iter().map(|o| (o.name.clone(), given(o))).collect();
        let mut out = Vec::new();
        for (name, given) in list {
            let (at, text) = (given.at, given.text.clone());
            match self.written(given) {
                Written::Reference(reference) => out.extend(self.port(&reference).map(|p| (name, p))),
                Written::Broken => {}
                _ => {
                    self.error(code::FORM, at, format!("expected a reference as \"@node.port\", found {text}"));
                }
            }
        }
        out
    }

    /// Lets each node look at its own settings.
    fn check_settings(&mut self, typed: &[Typed]) {
        for node in 0..typed.len() {
            let Some(ty) = self.nodes[node].ty.clone() else { continue };
            let Some(args) = settings(&ty.schema, &typed[node].bindings) else { continue };
            match checked(&ty, args) {
                Ok(problems) => {
                    for problem in problems {
                        let at = ty.schema.input(problem.input).map_or(self.nodes[node].at, |(i, _)| typed[node].places[i]);
                        self.error(code::SETTINGS, at, problem.message);
                    }
                }
                Err(error) => {
                    let at = self.nodes[node].at;
                    self.error(code::SETTINGS, at, format!("{} cannot be used as it is set: {}", ty.schema.id, error.message));
                }
            }
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
        let mut nodes = Vec::with_capacity(typed.len());
        let input_clocks: Vec<_> = (0..typed.len()).map(|node| self.input_clocks(node, &typed)).collect();
        for ((source, t), input_clocks) in self.nodes.iter().zip(typed).zip(input_clocks) {
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
                places: t.places.iter().map(|at| (at.file, at.span)).collect(),
            });
        }
        let mut clocks: Vec<Arc<Clock>> = self.scopes[main].clocks.values().cloned().collect();
        clocks.sort_by_key(|c| c.name != "frames");
        Some(Graph { clocks, nodes, outputs, types: self.registry.shared_types().clone() })
    }
}

/// True where something is written at an input but was refused, so that nothing stands there.
fn given_lost(input: &InputSchema, binding: &Binding) -> bool {
    matches!(binding, Binding::None) && !input.optional
}

/// What a node looks at to judge its settings; `None` where one of them is refused already.
pub(super) fn settings(schema: &NodeSchema, bindings: &[Binding]) -> Option<Vec<Arg>> {
    let args = schema.inputs.iter().zip(bindings).map(|(input, binding)| match (binding, &input.ty) {
        (Binding::Literal { value, .. }, _) => Some(Arg::Literal(value.clone())),
        (Binding::Wire(_), InputType::Setting { .. }) => Some(crate::plan::placeholder(input)),
        (_, InputType::Setting { .. }) => None,
        _ if input.access.by_handle() && !input.list => Some(Arg::Sequence(SequenceRef::new(None, Vec::<crate::value::ValueRef>::new()))),
        _ => Some(Arg::None),
    });
    args.collect()
}

/// The node's own judgement. A node that reads an input while it judges its settings panics; that is its author's fault, and said.
fn checked(ty: &NodeType, args: Vec<Arg>) -> Result<Vec<crate::node::Problem>, NodeError> {
    let panicked = |_| Err(NodeError::internal("its check of the settings panicked"));
    catch_unwind(AssertUnwindSafe(|| ty.operator.check(args))).unwrap_or_else(panicked)
}
