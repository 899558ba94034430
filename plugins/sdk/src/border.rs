//! The plugin's side of the border: tasks in, values out, and no panic across.
#![allow(unsafe_code, reason = "the C ABI of plugins; each block says what it relies on")]

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicPtr, Ordering};

use pegbar_abi::{
    PB_ABI_MAJOR, PB_ABI_MINOR, PB_CANCELLED, PB_FAILED, PB_FAULT_INPUT, PB_FAULT_IO, PB_FAULT_LIMIT, PB_FAULT_NUMERIC,
    PB_FAULT_PARAMETERS, PB_FAULT_PLUGIN, PB_FAULT_UNSUPPORTED, PB_OK, PB_PANICKED, PB_STATE, PB_TASK_SUITE, PB_VALUE_SUITE, PbHost,
    PbPlugin, PbSetting, PbSettings, PbTask, PbTaskSuite, PbText, PbValueSuite,
};
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Arg, Cancel, Context, Fault, InputSchema, InputType, Kind, Literal, NodeError, OutValue};
use pegbar_engine::plugin::{Description, InputText, NodeText, OutputText, Threads, TypeText};
use pegbar_engine::registry::{NodeType, Registry};
use pegbar_engine::setting::Place;
use pegbar_engine::value::ValueType;

mod given;
mod made;

use given::{Live, adopt, given, read_clock, read_text, row};
use made::{put, with_host_memory};

/// What a plugin exports.
pub struct Exports {
    registry: Registry,
    /// In the order of the schema.
    nodes: Vec<NodeType>,
    /// The types of their inputs, and of their states.
    inputs: Vec<Vec<Option<ValueType>>>,
    states: Vec<Option<ValueType>>,
    /// Kept, as `plugin` leads to it.
    _schema: String,
    plugin: PbPlugin,
}

// SAFETY: the pointers lead to the text beside them, which is never written.
unsafe impl Send for Exports {}
// SAFETY: as above.
unsafe impl Sync for Exports {}

/// The suites of the host.
struct Suites {
    values: &'static PbValueSuite,
    tasks: &'static PbTaskSuite,
}

static SUITES: OnceLock<Suites> = OnceLock::new();
static EXPORTS: AtomicPtr<Exports> = AtomicPtr::new(std::ptr::null_mut());

/// The entry point of a plugin.
///
/// # Safety
/// `host` is a host's, which lives as long as the process.
pub unsafe fn entry(host: *const PbHost, exports: &'static OnceLock<Exports>, make: impl FnOnce() -> Exports) -> *const PbPlugin {
    let made = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: as the caller says.
        let suites = unsafe { suites(host) }?;
        SUITES.get_or_init(|| suites);
        Some(exports.get_or_init(make))
    }));
    match made {
        Ok(Some(exports)) => {
            EXPORTS.store(std::ptr::from_ref(exports).cast_mut(), Ordering::Release);
            &raw const exports.plugin
        }
        _ => std::ptr::null(),
    }
}

/// # Safety
/// As of [`entry`].
unsafe fn suites(host: *const PbHost) -> Option<Suites> {
    // SAFETY: as the caller says; nothing is read before its size and version are known.
    unsafe {
        let host = host.as_ref()?;
        if host.abi_major != PB_ABI_MAJOR || (host.struct_size as usize) < size_of::<PbHost>() {
            return None;
        }
        let values = (host.suite)(PbText::new(PB_VALUE_SUITE), 1).cast::<PbValueSuite>().as_ref()?;
        let tasks = (host.suite)(PbText::new(PB_TASK_SUITE), 1).cast::<PbTaskSuite>().as_ref()?;
        let large = values.struct_size as usize >= size_of::<PbValueSuite>() && tasks.struct_size as usize >= size_of::<PbTaskSuite>();
        large.then_some(Suites { values, tasks })
    }
}

impl Exports {
    /// A plugin of the nodes and value types of a registry.
    pub fn new(name: &str, version: &str, doc: &str, threads: &str, registry: Registry) -> Self {
        let threads = match threads {
            "instance" => Threads::Instance,
            "one" => Threads::One,
            _ => Threads::Any,
        };
        let nodes: Vec<NodeType> = registry.nodes().cloned().collect();
        let own = ["Curve", "TimeMap", "Vector"];
        let types = registry.types().filter(|ty| !own.contains(&ty.schema.name));
        let description = Description {
            name: name.to_owned(),
            version: version.to_owned(),
            doc: doc.to_owned(),
            abi: (PB_ABI_MAJOR, PB_ABI_MINOR),
            threads,
            nodes: nodes.iter().map(node_text).collect(),
            values: types.map(|ty| TypeText::of(&ty.schema)).collect(),
        };
        let schema = description.to_ron();
        let plugin = PbPlugin {
            struct_size: size_of::<PbPlugin>() as u32,
            abi_major: PB_ABI_MAJOR,
            abi_minor: PB_ABI_MINOR,
            reserved: 0,
            schema: PbText::new(&schema),
            create,
            destroy,
            needs,
            compute,
        };
        let states = nodes.iter().map(|node| node.operator.state_type()).collect();
        let ty = |input: &InputSchema| match input.ty {
            InputType::Value(name) => registry.get_type(name).cloned(),
            _ => None,
        };
        let inputs = nodes.iter().map(|node| node.schema.inputs.iter().map(ty).collect()).collect();
        Self { registry, nodes, inputs, states, _schema: schema, plugin }
    }
}

/// What a node type says of itself, as a manifest has it. An input of any type has none there; the host refuses such a node.
fn node_text(node: &NodeType) -> NodeText {
    let schema = &node.schema;
    let input = |input: &InputSchema| {
        let reads = |text: &str| (input.parse)(text, &Place::default()).is_ok();
        InputText::of(input, reads("None"), !reads("-1") && reads("1"))
    };
    let output = |o: &pegbar_engine::node::OutputSchema| OutputText {
        name: o.name.to_owned(),
        doc: o.doc.to_owned(),
        ty: o.ty.unwrap_or("any").to_owned(),
        stream: o.stream,
        finite: false,
    };
    NodeText {
        id: schema.id.to_owned(),
        version: schema.version,
        kind: schema.kind,
        doc: schema.doc.to_owned(),
        source: schema.source.map(str::to_owned),
        example: schema.example.map(str::to_owned),
        uses_frame: schema.uses_frame,
        asks: schema.inputs.iter().any(|i| i.access.asks() && i.window.is_none()) || chooses_state(node),
        inputs: schema.inputs.iter().filter_map(input).collect(),
        outputs: schema.outputs.iter().map(output).collect(),
        state: node.operator.state_type().map(|ty| TypeText::of(&ty.schema)),
    }
}

/// True where a recurrent node starts from another state than that of the frame before, as far as a clock and its defaults show.
fn chooses_state(node: &NodeType) -> bool {
    const FRAMES: i64 = 48;
    if node.schema.kind != Kind::Recurrent {
        return false;
    }
    let (clock, cancel) = (Clock { name: "frames".to_owned(), first: 1, last: FRAMES, fps: (24, 1) }, Cancel::default());
    let previous = |frame: i64| {
        let default = |input: &InputSchema| match (&input.ty, input.default) {
            (InputType::Setting { .. }, text) => {
                (input.parse)(text.unwrap_or("None"), &Place::default()).map_or(Arg::None, |(literal, _)| Arg::Literal(literal))
            }
            _ if input.list => Arg::List(Vec::new()),
            _ => Arg::None,
        };
        let cx = Context { frame, clock: &clock, input_clocks: &[], cancel: &cancel };
        let args = node.schema.inputs.iter().map(default).collect();
        // One that panics without its inputs shows nothing.
        catch_unwind(AssertUnwindSafe(|| node.operator.needs(args, &[], &cx))).ok()?.ok().map(|needs| needs.previous)
    };
    (2..=FRAMES).any(|frame| previous(frame).is_some_and(|previous| previous != Some(frame - 1)))
}

fn strange(what: &str) -> NodeError {
    NodeError::new(Fault::Plugin, format!("expected {what} from the host, found another"))
}

/// An instance: the settings of a node of a graph.
struct Instance {
    node: usize,
    /// By input; nothing where a port brings what stands there.
    literals: Vec<Option<Literal>>,
}

/// What the plugin is asked for within one call of the host; panics end here.
fn guarded(task: *const PbTask, work: impl FnOnce(&'static Exports) -> Result<(), NodeError>) -> u32 {
    // SAFETY: it was stored by `entry`, and lives as long as the process.
    let Some(exports) = (unsafe { EXPORTS.load(Ordering::Acquire).as_ref() }) else { return PB_FAILED };
    match catch_unwind(AssertUnwindSafe(|| work(exports))) {
        Ok(Ok(())) => PB_OK,
        Ok(Err(error)) if error.cancelled => PB_CANCELLED,
        Ok(Err(error)) => {
            tell(task, &error);
            PB_FAILED
        }
        Err(payload) => {
            let text = payload.downcast_ref::<&str>().map(|s| (*s).to_owned()).or_else(|| payload.downcast_ref::<String>().cloned());
            tell(task, &NodeError::new(Fault::Plugin, text.unwrap_or_else(|| "no message".to_owned())));
            PB_PANICKED
        }
    }
}

fn tell(task: *const PbTask, error: &NodeError) {
    let fault = match error.fault {
        Fault::Parameters => PB_FAULT_PARAMETERS,
        Fault::Input => PB_FAULT_INPUT,
        Fault::Numeric => PB_FAULT_NUMERIC,
        Fault::Limit => PB_FAULT_LIMIT,
        Fault::Unsupported => PB_FAULT_UNSUPPORTED,
        Fault::Io => PB_FAULT_IO,
        Fault::Plugin | Fault::PluginCrash | Fault::PluginHang | Fault::PluginMemory | Fault::Internal => PB_FAULT_PLUGIN,
    };
    if let Some(suites) = SUITES.get() {
        let help = error.help.as_deref().unwrap_or_default();
        // SAFETY: the task is the one that the host is waiting for, and the texts live through the call.
        unsafe { (suites.tasks.error)(task, fault, PbText::new(&error.message), PbText::new(help)) };
    }
}

unsafe extern "C" fn create(node: u32, task: *const PbTask, settings: *const PbSettings, instance: *mut *mut u8) -> u32 {
    guarded(task, |exports| {
        let node = node as usize;
        let ty = exports.nodes.get(node).ok_or_else(|| strange("a node of the schema"))?;
        let mut literals = vec![None; ty.schema.inputs.len()];
        // SAFETY: the host hands over its settings for the length of the call.
        for setting in unsafe { row::<PbSetting>((*settings).settings, (*settings).count as usize) } {
            let input = ty.schema.inputs.get(setting.input as usize).ok_or_else(|| strange("an input of the schema"))?;
            // SAFETY: as above.
            let text = unsafe { read_text(&setting.ron) };
            let (literal, _) = (input.parse)(&text, &Place::default())
                .map_err(|e| NodeError::new(Fault::Parameters, format!("input `{}`: {}", input.name, e.message)))?;
            literals[setting.input as usize] = Some(literal);
        }
        let made = Box::into_raw(Box::new(Instance { node, literals }));
        // SAFETY: the host has a place for it.
        unsafe { *instance = made.cast() };
        Ok(())
    })
}

unsafe extern "C" fn destroy(instance: *mut u8) {
    if !instance.is_null() {
        // A setting whose drop panics is left alone.
        // SAFETY: `create` made it, and the host ends it once.
        let _ = catch_unwind(AssertUnwindSafe(|| drop(unsafe { Box::from_raw(instance.cast::<Instance>()) })));
    }
}

unsafe extern "C" fn needs(instance: *mut u8, task: *const PbTask) -> u32 {
    // SAFETY: the host keeps to the ABI.
    guarded(task, |exports| unsafe {
        let (instance, task) = (&*instance.cast::<Instance>(), &*task);
        with_talk(task, |talk| {
            let given = given(instance, task, &talk.live, exports)?;
            let node = &exports.nodes[instance.node];
            let asking: Vec<(u32, &'static str)> =
                node.schema.inputs.iter().enumerate().filter(|(_, i)| i.access.asks()).map(|(i, s)| (i as u32, s.name)).collect();
            let names: Vec<&'static str> = asking.iter().map(|(_, name)| *name).collect();
            let cx = Context { frame: task.frame, clock: &talk.clock, input_clocks: &given.input_clocks, cancel: &talk.cancel };
            let args = with_placeholders(given.args, &node.schema.inputs);
            let needs = node.operator.needs(args, &names, &cx)?;
            let suites = SUITES.get().ok_or_else(|| strange("its suites"))?;
            for ((input, _), frames) in asking.iter().zip(needs.frames) {
                frames.into_iter().for_each(|frame| {
                    (suites.tasks.need)(task, *input, frame);
                });
            }
            if let Some(frame) = needs.previous {
                (suites.tasks.need_state)(task, frame);
            }
            Ok(())
        })
    })
}

/// Stands a number in for each wired setting, which is not known while frames are asked for.
fn with_placeholders(args: Vec<Arg>, inputs: &[InputSchema]) -> Vec<Arg> {
    let one = |(arg, input): (Arg, &InputSchema)| match (&arg, &input.ty) {
        (Arg::None, InputType::Setting { .. }) => {
            (input.parse)(input.default.unwrap_or("0.0"), &Place::default()).map_or(Arg::None, |(literal, _)| Arg::Literal(literal))
        }
        _ => arg,
    };
    args.into_iter().zip(inputs).map(one).collect()
}

/// What a thread needs to talk to the host while a task runs; kept from task to task.
struct Talk {
    live: Live,
    cancel: Cancel,
    clock: Clock,
}

fn no_clock() -> Clock {
    Clock { name: String::new(), first: 0, last: 0, fps: (0, 0) }
}

impl Talk {
    fn new() -> Self {
        let live = Live::default();
        let asked = live.clone();
        // SAFETY: the task runs while it may be asked.
        let cancel = Cancel::asking(move || asked.ask(|task, suites| unsafe { (suites.tasks.is_cancelled)(task) } != 0).unwrap_or(true));
        Self { live, cancel, clock: no_clock() }
    }

    /// True where no thread that a task began could still ask by it: it and what it asks are all there is.
    fn is_own(&self) -> bool {
        self.cancel.is_unshared() && self.live.holders() == 2
    }
}

thread_local! {
    static TALK: Cell<Option<Box<Talk>>> = const { Cell::new(None) };
}

/// Lets the host be talked to about a task while `work` runs.
fn with_talk<R>(task: &PbTask, work: impl FnOnce(&Talk) -> Result<R, NodeError>) -> Result<R, NodeError> {
    struct Talking(Option<Box<Talk>>);
    impl Drop for Talking {
        fn drop(&mut self) {
            if let Some(talk) = self.0.take() {
                talk.live.set(std::ptr::null());
                if talk.is_own() {
                    let _ = TALK.try_with(|kept| kept.set(Some(talk)));
                }
            }
        }
    }
    let mut talking = Talking(TALK.take());
    let talk = talking.0.get_or_insert_with(|| Box::new(Talk::new()));
    // SAFETY: the task runs.
    unsafe { read_clock(task.clock, &mut talk.clock) }.ok_or_else(|| strange("a clock"))?;
    talk.live.set(task);
    work(talk)
}

unsafe extern "C" fn compute(instance: *mut u8, task: *const PbTask) -> u32 {
    // SAFETY: the host keeps to the ABI.
    guarded(task, |exports| unsafe {
        let (instance, task) = (&*instance.cast::<Instance>(), &*task);
        with_talk(task, |talk| {
            let given = given(instance, task, &talk.live, exports)?;
            let node = &exports.nodes[instance.node];
            let cx = Context { frame: task.frame, clock: &talk.clock, input_clocks: &given.input_clocks, cancel: &talk.cancel };
            let state = match (node.schema.kind, task.state.is_null()) {
                (Kind::Recurrent, false) => Some(adopt(task.state, exports, exports.states[instance.node].as_ref())?),
                _ => None,
            };
            with_host_memory(|| {
                let computed = node.operator.compute(given.args, state, &cx)?;
                for (p, out) in computed.outputs.into_iter().enumerate() {
                    match out {
                        OutValue::One(value) => put(task, p as u32, 0, value)?,
                        OutValue::Stream(values) => {
                            values.into_iter().enumerate().try_for_each(|(i, value)| put(task, p as u32, i as u64, value))?;
                        }
                    }
                }
                computed.state.map_or(Ok(()), |state| put(task, PB_STATE, 0, state))
            })
        })
    })
}
