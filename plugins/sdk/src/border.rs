//! The plugin's side of the border: tasks in, values out, and no panic across.
#![allow(unsafe_code, reason = "the C ABI of plugins; each block says what it relies on")]

use std::borrow::Cow;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Arc, OnceLock, PoisonError, RwLock};

use pegbar_abi::{
    PB_ABI_MAJOR, PB_ABI_MINOR, PB_CANCELLED, PB_F32, PB_F64, PB_FAILED, PB_FAULT_INPUT, PB_FAULT_IO, PB_FAULT_LIMIT, PB_FAULT_NUMERIC,
    PB_FAULT_PARAMETERS, PB_FAULT_PLUGIN, PB_FAULT_UNSUPPORTED, PB_I64, PB_OK, PB_PANICKED, PB_PORT_FRAMES, PB_PORT_NUMBER,
    PB_PORT_SEQUENCE, PB_PORT_VALUE, PB_STATE, PB_TASK_SUITE, PB_U8, PB_U32, PB_VALUE_SUITE, PbArray, PbBlock, PbClock, PbHost, PbPlugin,
    PbPort, PbSetting, PbSettings, PbTask, PbTaskSuite, PbText, PbValue, PbValueSuite,
};
use pegbar_engine::array::{Array, ArrayView, Block, Bytes, DType, Data, Shape, Shared, with_allocator};
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Arg, Cancel, Context, Fault, InputSchema, InputType, Kind, Literal, NodeError, OutValue, SequenceRef, Values};
use pegbar_engine::plugin::{Description, InputText, NodeText, OutputText, Threads, TypeText};
use pegbar_engine::registry::{NodeType, Registry};
use pegbar_engine::setting::Place;
use pegbar_engine::value::{Curve, OwnedParts, ValueRef, ValueType, Vector};

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

/// The text that the host hands over.
///
/// # Safety
/// It points at as many bytes as it says.
unsafe fn read_text<'a>(text: &PbText) -> Cow<'a, str> {
    // SAFETY: as the caller says.
    String::from_utf8_lossy(unsafe { bytes_of(text) })
}

/// The bytes of a text.
///
/// # Safety
/// As of [`read_text`].
unsafe fn bytes_of<'a>(text: &PbText) -> &'a [u8] {
    if text.data.is_null() || text.size == 0 {
        return &[];
    }
    // SAFETY: the caller vouches for the bytes.
    unsafe { std::slice::from_raw_parts(text.data, text.size as usize) }
}

/// The structs of a row, each as large as it says.
///
/// # Safety
/// `first` leads to `count` structs that begin with their size.
unsafe fn row<'a, T: 'a>(first: *const T, count: usize) -> impl Iterator<Item = &'a T> {
    // SAFETY: as the caller says.
    let stride = if count == 0 { 0 } else { unsafe { *first.cast::<u32>() as usize } };
    // SAFETY: as the caller says.
    (0..count).map(move |i| unsafe { &*first.byte_add(i * stride) })
}

/// A value of the host, held until this is dropped.
struct HostValue(*const PbValue);

// SAFETY: the host lets values be read, held and released from any thread.
unsafe impl Send for HostValue {}
// SAFETY: as above.
unsafe impl Sync for HostValue {}

impl Drop for HostValue {
    fn drop(&mut self) {
        if let Some(suites) = SUITES.get() {
            // SAFETY: it was held or fetched once for this.
            unsafe { (suites.values.release)(self.0) };
        }
    }
}

impl HostValue {
    /// # Safety
    /// The host's value is held, or there for as long as this call.
    unsafe fn hold(value: *const PbValue) -> Option<Self> {
        // SAFETY: as the caller says.
        SUITES.get().map(|suites| unsafe { (suites.values.hold)(value) }).map(|()| Self(value))
    }
}

/// An array of a host's value.
struct HostArray {
    _value: HostValue,
    data: *const u8,
    len: usize,
}

// SAFETY: the bytes are the host's value's, which is held, and never written.
unsafe impl Send for HostArray {}
// SAFETY: as above.
unsafe impl Sync for HostArray {}

impl Bytes for HostArray {
    fn bytes(&self) -> &[u8] {
        if self.len == 0 {
            return &[];
        }
        // SAFETY: as many bytes lie there as the host says, for as long as the value is held.
        unsafe { std::slice::from_raw_parts(self.data, self.len) }
    }
}

fn dtype_of(code: u32) -> Option<DType> {
    match code {
        PB_F32 => Some(DType::F32),
        PB_F64 => Some(DType::F64),
        PB_I64 => Some(DType::I64),
        PB_U32 => Some(DType::U32),
        PB_U8 => Some(DType::U8),
        _ => None,
    }
}

fn code_of(dtype: DType) -> u32 {
    match dtype {
        DType::F32 => PB_F32,
        DType::F64 => PB_F64,
        DType::I64 => PB_I64,
        DType::U32 => PB_U32,
        DType::U8 => PB_U8,
    }
}

fn strange(what: &str) -> NodeError {
    NodeError::new(Fault::Plugin, format!("expected {what} from the host, found another"))
}

/// Arrays of fewer bytes are copied, which takes less than to hold them.
const SMALL: usize = 1 << 10;

/// A value of the host as a value of the plugin, which shares its large arrays. It is of the type `ty`, unless another is found.
///
/// # Safety
/// The host's value is there for as long as the call.
unsafe fn adopt(at: *const PbValue, exports: &Exports, ty: Option<&ValueType>) -> Result<ValueRef, NodeError> {
    // SAFETY: as the caller says.
    let (name, meta, arrays) = unsafe {
        let value = &*at;
        (bytes_of(&value.type_name), bytes_of(&value.meta), row::<PbArray>(value.arrays, value.array_count as usize))
    };
    let found = || String::from_utf8_lossy(name);
    let ty = ty.filter(|ty| ty.schema.name.as_bytes() == name).or_else(|| exports.registry.get_type(&found()));
    let ty = ty.ok_or_else(|| strange(&format!("a value of a type of the plugin, found {}; such a value", found())))?;
    // SAFETY: as the caller says.
    if let (Some(value), 1) = (unsafe { numbers(ty.schema.name, (*at).arrays) }, unsafe { (*at).array_count }) {
        return Ok(value);
    }
    let mut parts = OwnedParts { arrays: Vec::with_capacity(ty.schema.arrays.len()), ..OwnedParts::default() };
    if meta.len() > "{}".len() {
        parts.meta = serde_json::from_slice(meta).map_err(|_| strange("a value whose text is one JSON object"))?;
    }
    for array in arrays {
        let dtype = dtype_of(array.dtype).ok_or_else(|| strange("an element type"))?;
        let len = array.bytes as usize;
        let data = if len < SMALL && !array.data.is_null() {
            // SAFETY: the value has as many bytes there.
            Data::copied(dtype, unsafe { std::slice::from_raw_parts(array.data, len) })
        } else {
            // SAFETY: the value is there.
            let held = unsafe { HostValue::hold(at) }.ok_or_else(|| strange("its suites"))?;
            Shared::new(dtype, Arc::new(HostArray { _value: held, data: array.data, len })).map(Data::Shared)
        };
        let data = data.ok_or_else(|| strange("an array that is aligned"))?;
        let shape = array.shape.iter().take(array.rank as usize).map(|&n| n as usize).collect();
        // SAFETY: the value is there.
        let name = unsafe { bytes_of(&array.name) };
        let known = ty.schema.arrays.iter().find(|a| a.name.as_bytes() == name);
        let name = known.map_or_else(|| Cow::Owned(String::from_utf8_lossy(name).into_owned()), |a| Cow::Borrowed(a.name));
        parts.arrays.push((name, Array { shape, data }));
    }
    (ty.from_parts)(parts).map_err(|e| NodeError::input(format!("a value of {}: {e}", ty.schema.name)))
}

/// The engine's own numbers, which most wires bring, without the detour by parts; `None` where it is another type, or is not as it should be.
///
/// # Safety
/// The array is a host's.
unsafe fn numbers(ty: &str, array: *const PbArray) -> Option<ValueRef> {
    // SAFETY: as the caller says; one without bytes is left to others.
    let array = unsafe { array.as_ref() }.filter(|array| array.dtype == PB_F64 && array.bytes > 0 && array.bytes < SMALL as u64)?;
    // SAFETY: the value has as many bytes there.
    let bytes = unsafe { std::slice::from_raw_parts(array.data, array.bytes as usize) };
    // SAFETY: as the caller says.
    let name = unsafe { bytes_of(&array.name) };
    match (ty, name, array.rank) {
        ("Vector", b"values", 1) if array.shape[0].checked_mul(8) == Some(array.bytes) => match Data::copied(DType::F64, bytes)? {
            Data::F64(values) => Some(Arc::new(Vector { values })),
            _ => None,
        },
        ("Curve", b"value", 0) => Some(Arc::new(Curve { value: f64::from_ne_bytes(bytes.try_into().ok()?) })),
        _ => None,
    }
}

/// A task that may be talked to while it runs, and not after.
#[derive(Clone)]
struct Live(Arc<RwLock<*const PbTask>>);

// SAFETY: the pointer is used under the lock alone, while the task runs; the host lets its suites be called from any thread meanwhile.
unsafe impl Send for Live {}
// SAFETY: as above.
unsafe impl Sync for Live {}

impl Live {
    fn ask<R>(&self, ask: impl FnOnce(*const PbTask, &Suites) -> R) -> Option<R> {
        let task = self.0.read().unwrap_or_else(PoisonError::into_inner);
        SUITES.get().filter(|_| !task.is_null()).map(|suites| ask(*task, suites))
    }

    fn set(&self, task: *const PbTask) {
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = task;
    }
}

/// A sequence that is fetched value by value.
struct HostSequence {
    live: Live,
    port: u32,
    len: usize,
    exports: &'static Exports,
}

impl Values for HostSequence {
    fn len(&self) -> usize {
        self.len
    }

    fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        // SAFETY: the task runs.
        let fetched = self.live.ask(|task, suites| unsafe { (suites.values.fetch)(task, self.port, idx as u64) });
        match fetched {
            Some(value) if !value.is_null() => {
                let held = HostValue(value);
                // SAFETY: it is held.
                unsafe { adopt(held.0, self.exports, None) }
            }
            _ => Err(NodeError::input(format!("value {idx} of a sequence of {} cannot be had", self.len))),
        }
    }
}

/// A clock; that which was read before where the name is the same.
///
/// # Safety
/// `clock` is the host's, or null.
unsafe fn read_clock(clock: *const PbClock, before: Option<Clock>) -> Option<Clock> {
    // SAFETY: as the caller says.
    let clock = unsafe { clock.as_ref() }?;
    // SAFETY: as above.
    let name = unsafe { bytes_of(&clock.name) };
    let before = before.map(|before| before.name).filter(|before| before.as_bytes() == name);
    let name = before.unwrap_or_else(|| String::from_utf8_lossy(name).into_owned());
    Some(Clock { name, first: clock.first, last: clock.last, fps: (clock.fps_numerator, clock.fps_denominator) })
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

/// What a task's ports and settings are to the node.
struct Given {
    args: Vec<Arg>,
    input_clocks: Vec<(&'static str, Arc<Clock>)>,
}

/// # Safety
/// `task` runs.
unsafe fn given(instance: &Instance, task: &PbTask, live: &Live, exports: &'static Exports) -> Result<Given, NodeError> {
    let inputs = &exports.nodes[instance.node].schema.inputs;
    let mut input_clocks: Vec<(&'static str, Arc<Clock>)> = Vec::new();
    let mut args: Vec<Arg> = (instance.literals.iter().zip(inputs))
        .map(|(literal, input)| match literal {
            Some(literal) => Arg::Literal(literal.clone()),
            None if input.list => Arg::List(Vec::new()),
            None if input.access.by_handle() && !input.optional => Arg::Sequence(SequenceRef::new(None, Vec::<ValueRef>::new())),
            None => Arg::None,
        })
        .collect();
    // SAFETY: as the caller says.
    for (i, port) in unsafe { row::<PbPort>(task.ports, task.port_count as usize) }.enumerate() {
        // SAFETY: as the caller says.
        let clock = unsafe { read_clock(port.clock, None) }.map(Arc::new);
        let name = inputs.get(port.input as usize).ok_or_else(|| strange("an input of the schema"))?.name;
        if let Some(clock) = &clock {
            input_clocks.push((name, clock.clone()));
        }
        let ty = exports.inputs[instance.node][port.input as usize].as_ref();
        // SAFETY: as the caller says.
        let arg = unsafe { arg(i as u32, port, (clock, ty), live, exports) }?;
        match &mut args[port.input as usize] {
            Arg::List(list) => list.push(arg),
            place => *place = arg,
        }
    }
    Ok(Given { args, input_clocks })
}

/// # Safety
/// The task whose port it is runs.
unsafe fn arg(
    index: u32,
    port: &PbPort,
    (clock, ty): (Option<Arc<Clock>>, Option<&ValueType>),
    live: &Live,
    exports: &'static Exports,
) -> Result<Arg, NodeError> {
    let value = |i: usize| {
        // SAFETY: there are `count` values, for as long as the task runs.
        unsafe { adopt(*port.values.add(i), exports, ty) }
    };
    let count = port.count as usize;
    Ok(match port.kind {
        PB_PORT_VALUE if count == 1 => Arg::Value(value(0)?),
        PB_PORT_FRAMES => {
            // SAFETY: there are `count` frames beside the values.
            let frame = |i: usize| unsafe { *port.frames.add(i) };
            Arg::Frames((0..count).map(|i| Ok((frame(i), value(i)?))).collect::<Result<_, NodeError>>()?)
        }
        PB_PORT_SEQUENCE => Arg::Sequence(SequenceRef::new(clock, HostSequence { live: live.clone(), port: index, len: count, exports })),
        PB_PORT_NUMBER => Arg::Value(Arc::new(Curve { value: port.number })),
        _ => return Err(strange("a port")),
    })
}

unsafe extern "C" fn needs(instance: *mut u8, task: *const PbTask) -> u32 {
    // SAFETY: the host keeps to the ABI.
    guarded(task, |exports| unsafe {
        let (instance, task) = (&*instance.cast::<Instance>(), &*task);
        with_talk(task, |talk, clock| {
            let given = given(instance, task, &talk.live, exports)?;
            let node = &exports.nodes[instance.node];
            let asking: Vec<(u32, &'static str)> =
                node.schema.inputs.iter().enumerate().filter(|(_, i)| i.access.asks()).map(|(i, s)| (i as u32, s.name)).collect();
            let names: Vec<&'static str> = asking.iter().map(|(_, name)| *name).collect();
            let cx = Context { frame: task.frame, clock, input_clocks: &given.input_clocks, cancel: &talk.cancel };
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
}

impl Talk {
    fn new() -> Self {
        #[allow(clippy::arc_with_non_send_sync, reason = "`Live`, around it, may be sent and shared, and says why")]
        let live = Live(Arc::new(RwLock::new(std::ptr::null())));
        let asked = live.clone();
        // SAFETY: the task runs while it may be asked.
        let cancel = Cancel::asking(move || asked.ask(|task, suites| unsafe { (suites.tasks.is_cancelled)(task) } != 0).unwrap_or(true));
        Self { live, cancel }
    }

    /// True where no thread that a task began could still ask by it: it and what it asks are all there is.
    fn is_own(&self) -> bool {
        self.cancel.is_unshared() && Arc::strong_count(&self.live.0) == 2
    }
}

thread_local! {
    static TALK: Cell<Option<(Talk, Option<Clock>)>> = const { Cell::new(None) };
    /// True once a task of this thread has made memory of the host.
    static HAS_BLOCKS: Cell<bool> = const { Cell::new(false) };
}

/// Lets the host be talked to about a task while `work` runs.
fn with_talk<R>(task: &PbTask, work: impl FnOnce(&Talk, &Clock) -> Result<R, NodeError>) -> Result<R, NodeError> {
    struct End(Option<(Talk, Option<Clock>)>);
    impl Drop for End {
        fn drop(&mut self) {
            if let Some((talk, clock)) = self.0.take() {
                talk.live.set(std::ptr::null());
                if talk.is_own() {
                    let _ = TALK.try_with(|kept| kept.set(Some((talk, clock))));
                }
            }
        }
    }
    let (talk, before) = TALK.take().unwrap_or_else(|| (Talk::new(), None));
    // SAFETY: the task runs.
    let clock = unsafe { read_clock(task.clock, before) };
    talk.live.set(task);
    let end = End(Some((talk, clock)));
    match &end.0 {
        Some((talk, Some(clock))) => work(talk, clock),
        _ => Err(strange("a clock")),
    }
}

unsafe extern "C" fn compute(instance: *mut u8, task: *const PbTask) -> u32 {
    // SAFETY: the host keeps to the ABI.
    guarded(task, |exports| unsafe {
        let (instance, task) = (&*instance.cast::<Instance>(), &*task);
        with_talk(task, |talk, clock| {
            let given = given(instance, task, &talk.live, exports)?;
            let node = &exports.nodes[instance.node];
            let cx = Context { frame: task.frame, clock, input_clocks: &given.input_clocks, cancel: &talk.cancel };
            let state = match (node.schema.kind, task.state.is_null()) {
                (Kind::Recurrent, false) => Some(adopt(task.state, exports, exports.states[instance.node].as_ref())?),
                _ => None,
            };
            HAS_BLOCKS.set(false);
            with_allocator(allocate, || {
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

/// Memory of the host.
struct HostBlock(*mut PbBlock);

// SAFETY: the block is the plugin's until it is put or freed, from any thread.
unsafe impl Send for HostBlock {}
// SAFETY: shared, it is read alone.
unsafe impl Sync for HostBlock {}

impl Bytes for HostBlock {
    fn bytes(&self) -> &[u8] {
        // SAFETY: the block is owned; of one without bytes the host's pointer is dangling but aligned.
        unsafe { std::slice::from_raw_parts((*self.0).data, (*self.0).bytes as usize) }
    }
}

impl Block for HostBlock {
    fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: as above, and nobody else has it.
        unsafe { std::slice::from_raw_parts_mut((*self.0).data, (*self.0).bytes as usize) }
    }

    fn into_handle(mut self: Box<Self>) -> usize {
        std::mem::replace(&mut self.0, std::ptr::null_mut()).expose_provenance()
    }
}

impl Drop for HostBlock {
    fn drop(&mut self) {
        if let Some(suites) = SUITES.get().filter(|_| !self.0.is_null()) {
            // SAFETY: it is owned, and freed once.
            unsafe { (suites.values.free)(self.0) };
        }
    }
}

fn allocate(dtype: DType, count: usize) -> Option<Box<dyn Block>> {
    let suites = SUITES.get()?;
    // SAFETY: the host may be asked for memory at any time.
    let block = unsafe { (suites.values.alloc)(code_of(dtype), count as u64) };
    HAS_BLOCKS.set(true);
    (!block.is_null()).then(|| Box::new(HostBlock(block)) as Box<dyn Block>)
}

/// Puts a value out, array by array: without a copy where an array lies in the host's memory and nobody else has the value.
fn put(task: *const PbTask, output: u32, index: u64, mut value: ValueRef) -> Result<(), NodeError> {
    let suites = SUITES.get().ok_or_else(|| strange("its suites"))?;
    let meta = value.meta();
    if !meta.is_empty() {
        let json = serde_json::Value::Object(meta).to_string();
        // SAFETY: the task runs, and the text lives through the call.
        unsafe { (suites.values.meta)(task, output, index, PbText::new(&json)) };
    }
    let copy = |(name, view): (&'static str, ArrayView<'_>)| {
        let (name, (rank, shape)) = (PbText::new(name), shape_of(&view.shape));
        // SAFETY: the task runs, and name and shape live through the call.
        let to = unsafe { (suites.values.array)(task, output, index, name, code_of(view.dtype), rank, shape.as_ptr()) };
        if to.is_null() {
            return Err(strange("memory for an output"));
        }
        // SAFETY: the host gave memory for as many elements as the shape says, and nobody else has it.
        unsafe { std::ptr::copy_nonoverlapping(view.bytes.as_ptr(), to, view.bytes.len()) };
        Ok(())
    };
    if !HAS_BLOCKS.get() {
        return (0..).map_while(|at| value.nth_array(at)).try_for_each(copy);
    }
    let mut at = 0;
    while let Some((name, ArrayView { shape, .. })) = value.nth_array(at) {
        // A host's block is taken out of a value that this alone has.
        if let Some(block) = Arc::get_mut(&mut value).and_then(|value| value.take_block(name)) {
            let handle = std::ptr::with_exposed_provenance_mut(block.into_handle());
            let (rank, shape) = shape_of(&shape);
            // SAFETY: the block is the host's, whose it is again; the task runs, and name and shape live through the call.
            unsafe { (suites.values.put)(task, output, index, PbText::new(name), rank, shape.as_ptr(), handle) };
        } else {
            value.nth_array(at).map_or(Ok(()), copy)?;
        }
        at += 1;
    }
    Ok(())
}

fn shape_of(shape: &Shape) -> (u32, [u64; Shape::MAX_RANK]) {
    let mut axes = [0; Shape::MAX_RANK];
    axes.iter_mut().zip(shape.iter()).for_each(|(to, &n)| *to = n as u64);
    (shape.len() as u32, axes)
}
