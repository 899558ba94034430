//! What a plugin's code does: it is given every type of value in every form that graphs come to have, and what must hold of any node is held against it.

use std::path::Path;
use std::sync::Arc;

use super::guard::guarded;
use super::literals::usual;
use super::make::{Kind, Sizes};
use super::{Checked, Finding, Stop};
use crate::clock::Clock;
use crate::node::{self, Access, Arg, Cancel, Computed, Context, Fault, InputSchema, InputType, Literal, NodeError, SequenceRef};
use crate::plugin::dynamic::dynamic_type;
use crate::plugin::{Description, Found, LibraryFile, Manifest, PluginError, describe, digest, platform};
use crate::registry::{NodeType, Registry};
use crate::setting::{FileUse, Place};
use crate::value::{Curve, OwnedParts, ValueRef};

/// The checks that run code, in their order: name, and what is checked.
pub const CHECKS: [(&str, &str); 11] = [
    ("ordinary", "ordinary values are taken, and what comes out is what the schema says"),
    ("settings", "every default, both ends of every range, every choice"),
    ("sizes", "pictures of 1x1, 1xN and primes, of nothing and of no channels; nothing beyond the end of an input is read"),
    ("values", "not a number, infinite, huge, all the same: a value or an error"),
    ("frames", "clocks of one frame and below nought, other rates, empty sequences; no frame beyond a clock is asked for"),
    ("same", "the same input gives the same bits, whatever came before"),
    ("rows", "structs of a later version, which are larger, are stepped over by the size that they say"),
    ("threads", "the same bits from many threads at once"),
    ("inputs", "inputs stay as they are, and are left alone once the task is done"),
    ("leaks", "memory and values are given back"),
    ("cancel", "a task that is to stop does so within a second"),
];

/// What to do about a fault of the plugin's own.
const REFUSE: &str = "what the node cannot take it refuses with PB_FAULT_INPUT, PB_FAULT_PARAMETERS or the like, and says what it expected";

/// A plugin whose code is run.
pub struct Probe {
    found: Found,
    host: Registry,
    /// Node, input and literal.
    given: Vec<(String, String, String)>,
    out: tempfile::TempDir,
}

impl Probe {
    /// Loads a library, whose value types are those of `host` where that has them. `given` are settings, as node, input and literal.
    ///
    /// # Errors
    /// Where it is no plugin that this host can use.
    pub fn load(library: &Path, host: &Registry, given: Vec<(String, String, String)>) -> Result<Self, PluginError> {
        let plugin = describe(library)?;
        let file = library.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let libraries = [(platform(), LibraryFile { file, digest: digest(library)? })].into();
        let found = Found { path: library.to_owned(), manifest: Arc::new(Manifest { libraries, plugin }) };
        let out = tempfile::tempdir().map_err(|e| PluginError::new(format!("a folder for what nodes write: {e}")))?;
        let probe = Self { found, host: host.clone().with_code_here(), given, out };
        probe.registry().map(|_| probe)
    }

    /// What the library says of itself.
    pub fn description(&self) -> &Description {
        &self.found.manifest.plugin
    }

    /// Its node types in a registry of their own: all instances end with it.
    fn registry(&self) -> Result<Registry, PluginError> {
        let mut registry = self.host.clone();
        self.found.register(&mut registry).map(|()| registry)
    }

    /// Runs a check on the node type at a position of the description. `say` is told what comes next, as that may be the last of it.
    pub fn check<'a>(&'a self, check: &str, node: usize, say: &'a dyn Fn(&str)) -> Option<Finding> {
        let checks: [fn(&Subject<'a>) -> Checked; CHECKS.len()] = [
            Subject::ordinary,
            Subject::settings,
            Subject::sizes,
            Subject::values,
            Subject::frames,
            Subject::same,
            Subject::rows,
            Subject::threads,
            Subject::untouched,
            Subject::leaks,
            Subject::cancel,
        ];
        let id = &self.description().nodes.get(node)?.id;
        let at = CHECKS.iter().position(|(name, _)| *name == check)?;
        let done = Subject::new(self, id, say).and_then(|subject| checks[at](&subject));
        Some(Finding::of(check, Some(id), done))
    }
}

/// What is given to a node.
#[derive(Clone)]
pub(super) struct Setup {
    pub(super) clock: Arc<Clock>,
    pub(super) kind: Kind,
    pub(super) sizes: Sizes,
    /// The only input with values of `kind`; all of them if there is none.
    pub(super) at: Option<usize>,
    /// Optional inputs have something, too.
    pub(super) full: bool,
    /// Values lie where they may only be read, and nothing lies behind them.
    pub(super) guarded: bool,
    /// The same values at all frames.
    pub(super) still: bool,
    /// Sequences and lists have nothing in them.
    pub(super) empty: bool,
    /// What stands at settings; nothing where a value is wired.
    pub(super) literals: Vec<Option<Literal>>,
    /// A number that is wired, by input.
    pub(super) wired: Option<(usize, f64)>,
    pub(super) cancel: Cancel,
}

/// A node type that is looked at.
pub(super) struct Subject<'a> {
    pub(super) probe: &'a Probe,
    pub(super) registry: Registry,
    pub(super) node: NodeType,
    pub(super) say: &'a dyn Fn(&str),
}

pub(super) fn clock(first: i64, last: i64, fps: (u32, u32)) -> Arc<Clock> {
    Arc::new(Clock { name: "frames".to_owned(), first, last, fps })
}

/// What a node answers to input that it need not take: a value, or an error that is not its own fault.
pub(super) fn answered(done: Result<Computed, NodeError>, at: &str) -> Result<Result<Computed, NodeError>, Stop> {
    let own = |error: &NodeError| error.cancelled || matches!(error.fault, Fault::Plugin | Fault::Internal);
    let Some(error) = done.as_ref().err().filter(|error| own(error)) else { return Ok(done) };
    let found = Stop::failed(format!("{at}: {}", error.message));
    // A broken contract says what to do; a fault of the node's code does not.
    Err(if error.message.starts_with("plugin `") && !error.message.contains("panicked") { found } else { found.help(REFUSE) })
}

impl<'a> Subject<'a> {
    pub(super) fn new(probe: &'a Probe, id: &str, say: &'a dyn Fn(&str)) -> Result<Self, Stop> {
        let registry = probe.registry().map_err(|e| Stop::failed(e.message))?;
        let version = &probe.description().version;
        let node = registry.get(&format!("{id}@{version}")).cloned();
        let node = node.ok_or_else(|| Stop::failed(format!("expected `{id}` among its nodes, found none")))?;
        Ok(Self { probe, registry, node, say })
    }

    pub(super) fn inputs(&self) -> &[InputSchema] {
        &self.node.schema.inputs
    }

    pub(super) fn say(&self, what: impl Into<String>) -> String {
        let what = what.into();
        (self.say)(&what);
        what
    }

    /// The positions of inputs that take values, with their types.
    pub(super) fn ports(&self) -> impl Iterator<Item = (usize, &'static str)> {
        self.inputs().iter().enumerate().filter_map(|(i, input)| match input.ty {
            InputType::Value(name) => Some((i, name)),
            InputType::Any => Some((i, "Curve")),
            InputType::Setting { .. } => None,
        })
    }

    pub(super) fn parse(&self, input: &InputSchema, text: &str) -> Result<Literal, String> {
        let place =
            Place { base: ".".into(), out: self.probe.out.path().to_owned(), types: self.registry.shared_types().clone(), origin: None };
        (input.parse)(text, &place).map(|(literal, _)| literal).map_err(|e| e.message)
    }

    /// What stands at a setting if nothing else is said.
    pub(super) fn literal(&self, input: &InputSchema) -> Result<Literal, Stop> {
        let InputType::Setting { name, .. } = &input.ty else { return Err(Stop::not_tried("no setting")) };
        let given = self.probe.given.iter().find(|(node, i, _)| node == self.node.schema.id && i == input.name);
        if let Some((_, _, text)) = given {
            return self.parse(input, text).map_err(|e| Stop::not_tried(format!("input `{}` = {text}: {e}", input.name)));
        }
        let usual = usual(name, input);
        let texts = input.default.map(str::to_owned).into_iter().chain(["None".to_owned()]).chain(usual);
        let mut read = texts.filter_map(|text| self.parse(input, &text).ok());
        read.next()
            .filter(|_| input.default.is_some() || input.files != FileUse::Read || input.optional || self.reads_none(input))
            .ok_or_else(|| {
                let help = format!("say one: --set {}.{}=VALUE", self.node.schema.id, input.name);
                Stop::not_tried(format!("input `{}`: expected a {name} to try it with, found none", input.name)).help(help)
            })
    }

    pub(super) fn reads_none(&self, input: &InputSchema) -> bool {
        self.parse(input, "None").is_ok()
    }

    /// Ordinary values over four frames.
    pub(super) fn usual(&self, full: bool) -> Result<Setup, Stop> {
        let literal = |input: &InputSchema| match &input.ty {
            InputType::Setting { .. } => self.literal(input).map(Some),
            _ => Ok(None),
        };
        Ok(Setup {
            clock: clock(1, 4, (24, 1)),
            kind: Kind::Ordinary,
            sizes: Sizes::ORDINARY,
            at: None,
            full,
            guarded: false,
            still: false,
            empty: false,
            literals: self.inputs().iter().map(literal).collect::<Result<_, _>>()?,
            wired: None,
            cancel: Cancel::default(),
        })
    }

    /// As [`Subject::usual`], with optional inputs where the node runs with them.
    pub(super) fn good(&self) -> Result<Setup, Stop> {
        let mut refused = None;
        for full in [true, false] {
            let setup = self.usual(full)?;
            match self.run_all(&setup, "ordinary values")?.into_iter().find_map(Result::err) {
                None => return Ok(setup),
                Some(error) => refused = refused.or(Some(error)),
            }
        }
        let why = refused.map(|e| e.message).unwrap_or_default();
        let help = "say settings with which it takes any values: --set NODE.INPUT=VALUE";
        Err(Stop::not_tried(format!("expected it to take ordinary values, found it to refuse them: {why}")).help(help))
    }

    /// Every frame of what was taken before.
    pub(super) fn again(&self, good: &Setup) -> Result<Vec<Computed>, Stop> {
        let done: Result<Vec<Computed>, NodeError> = self.run_all(good, "ordinary values")?.into_iter().collect();
        done.map_err(|e| Stop::failed(format!("expected what it took before to be taken again, found it refused: {}", e.message)))
    }

    /// A value for an input; nothing where the type has none of this kind.
    pub(super) fn value(&self, setup: &Setup, input: usize, type_name: &str, frame: i64) -> Option<ValueRef> {
        let ty = self.registry.get_type(type_name)?;
        let is_other = setup.at.is_some_and(|at| at != input);
        let (kind, sizes) = if is_other { (Kind::Ordinary, Sizes::ORDINARY) } else { (setup.kind, setup.sizes) };
        let offset = if setup.still { 1 } else { frame.rem_euclid(97) as usize };
        let value = kind.value(ty, sizes, offset)?;
        if !setup.guarded {
            return Some(value);
        }
        // The host's own type would keep its arrays where it wants to.
        let parts = value.parts();
        let arrays = parts.arrays.iter().map(|(name, view)| Some(((*name).into(), guarded(view.to_array())?)));
        let parts = OwnedParts { arrays: arrays.collect::<Option<_>>()?, meta: parts.meta };
        (dynamic_type(ty.schema.clone()).from_parts)(parts).ok()
    }

    /// The frames that each input that asks is read at, held against the clock.
    pub(super) fn needs(&self, setup: &Setup, cx: &Context) -> Result<Vec<(&'static str, Vec<i64>)>, Stop> {
        let asking: Vec<&'static str> = self.inputs().iter().filter(|i| i.access.asks()).map(|i| i.name).collect();
        if asking.is_empty() {
            return Ok(Vec::new());
        }
        let args = self.inputs().iter().zip(&setup.literals).enumerate().map(|(i, (input, literal))| match literal {
            // What is wired is not known yet; the planner has the default stand there.
            None if setup.wired.is_some_and(|(at, _)| at == i) => {
                self.parse(input, input.default.unwrap_or("0.0")).map_or(Arg::None, Arg::Literal)
            }
            literal => literal.clone().map_or(Arg::None, Arg::Literal),
        });
        let needs = self.node.operator.needs(args.collect(), &asking, cx);
        let needs = needs.map_err(|e| Stop::failed(format!("asked for its frames: {}", e.message)))?;
        for (name, frames) in asking.iter().zip(&needs.frames) {
            if let Some(beyond) = frames.iter().find(|&&f| cx.clock.index(f).is_none()) {
                let (first, last) = (cx.clock.first, cx.clock.last);
                let why = format!("at frame {}: expected frames {first} to {last} of `{name}` to be asked for, found {beyond}", cx.frame);
                return Err(Stop::failed(why).help("the ends of the input's clock stand for what is beyond: clamp what is asked for"));
            }
        }
        if let Some(previous) = needs.previous.filter(|&p| cx.clock.index(p).is_none() || p == cx.frame) {
            return Err(Stop::failed(format!("at frame {}: expected the state of another frame of the clock, found {previous}", cx.frame)));
        }
        Ok(asking.into_iter().zip(needs.frames).collect())
    }

    pub(super) fn input_clocks(&self, setup: &Setup) -> Vec<(&'static str, Arc<Clock>)> {
        let ports = self.ports().filter(|_| !setup.still);
        ports.map(|(i, _)| (self.inputs()[i].name, setup.clock.clone())).collect()
    }

    /// What stands at the inputs at a frame; nothing where no value of this kind is to be had.
    pub(super) fn args(&self, setup: &Setup, frame: i64) -> Result<Option<Vec<Arg>>, Stop> {
        let input_clocks = self.input_clocks(setup);
        let cx = Context { frame, clock: &setup.clock, input_clocks: &input_clocks, cancel: &setup.cancel };
        let needs = self.needs(setup, &cx)?;
        let mut args = Vec::with_capacity(self.inputs().len());
        for (i, input) in self.inputs().iter().enumerate() {
            args.push(match (&input.ty, &setup.literals[i]) {
                _ if setup.wired.is_some_and(|(at, _)| at == i) => {
                    Arg::Value(Arc::new(Curve { value: setup.wired.map_or(0.0, |(_, number)| number) }))
                }
                (_, Some(literal)) => Arg::Literal(literal.clone()),
                _ if input.optional && !setup.full && input.list => Arg::List(Vec::new()),
                _ if input.optional && !setup.full => Arg::None,
                _ => match self.port(setup, i, frame, &needs) {
                    Some(arg) => arg,
                    None => return Ok(None),
                },
            });
        }
        Ok(Some(args))
    }

    pub(super) fn port(&self, setup: &Setup, i: usize, frame: i64, needs: &[(&'static str, Vec<i64>)]) -> Option<Arg> {
        let input = &self.inputs()[i];
        let (_, ty) = self.ports().find(|(at, _)| *at == i)?;
        let value = |frame: i64| self.value(setup, i, ty, frame);
        let one = || {
            let asked = || needs.iter().find(|(name, _)| *name == input.name).map(|(_, frames)| frames.clone()).unwrap_or_default();
            let clock = (!setup.still).then(|| setup.clock.clone());
            Some(match input.access {
                Access::Frame | Access::Constant => Arg::Value(value(frame)?),
                Access::Frames => Arg::Frames(asked().into_iter().map(|f| Some((f, value(f)?))).collect::<Option<_>>()?),
                Access::Sequence | Access::Picked => {
                    let frames = match input.access {
                        _ if setup.empty => Vec::new(),
                        Access::Picked => asked(),
                        _ if setup.still => vec![frame],
                        _ => setup.clock.frames().collect(),
                    };
                    Arg::Sequence(SequenceRef::new(clock, frames.into_iter().map(value).collect::<Option<Vec<_>>>()?))
                }
            })
        };
        match (input.list, setup.empty) {
            (true, true) => Some(Arg::List(Vec::new())),
            (true, false) => Some(Arg::List(vec![one()?, one()?])),
            (false, _) => one(),
        }
    }

    pub(super) fn compute(&self, setup: &Setup, args: Vec<Arg>, frame: i64, state: Option<ValueRef>) -> Result<Computed, NodeError> {
        let input_clocks = self.input_clocks(setup);
        let cx = Context { frame, clock: &setup.clock, input_clocks: &input_clocks, cancel: &setup.cancel };
        self.node.operator.compute(args, state, &cx)
    }

    /// The frames that are made one by one.
    pub(super) fn frames_of(&self, setup: &Setup) -> Vec<i64> {
        if self.node.schema.kind == node::Kind::Whole { vec![setup.clock.first] } else { setup.clock.frames().collect() }
    }

    /// Every frame, each from the state of the one before; as many as there are values for. What is the plugin's own fault ends it.
    pub(super) fn run_all(&self, setup: &Setup, at: &str) -> Result<Vec<Result<Computed, NodeError>>, Stop> {
        let (mut done, mut state) = (Vec::new(), None);
        for frame in self.frames_of(setup) {
            let Some(args) = self.args(setup, frame)? else { break };
            self.say(format!("{at}, frame {frame}"));
            let computed = self.compute(setup, args, frame, state.take());
            if let Ok(computed) = &computed {
                state = computed.state.clone();
            }
            done.push(answered(computed, &format!("{at}, frame {frame}"))?);
            if done.last().is_some_and(Result::is_err) {
                break;
            }
        }
        Ok(done)
    }
}
