//! What the host shows of a task, as arguments of a node.

use std::borrow::Cow;
use std::sync::{Arc, PoisonError, RwLock};

use pegbar_abi::{
    PB_F32, PB_F64, PB_I64, PB_PORT_FRAMES, PB_PORT_NUMBER, PB_PORT_SEQUENCE, PB_PORT_VALUE, PB_U8, PB_U32, PbArray, PbClock, PbPort,
    PbTask, PbText, PbValue,
};
use pegbar_engine::array::{Array, Bytes, DType, Data, Shared};
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Arg, NodeError, SequenceRef, Values};
use pegbar_engine::value::{Curve, OwnedParts, ValueRef, ValueType, Vector};

use super::{Exports, Instance, SUITES, Suites, strange};

/// The text that the host hands over.
///
/// # Safety
/// It points at as many bytes as it says.
pub(super) unsafe fn read_text<'a>(text: &PbText) -> Cow<'a, str> {
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
pub(super) unsafe fn row<'a, T: 'a>(first: *const T, count: usize) -> impl Iterator<Item = &'a T> {
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

/// Arrays of fewer bytes are copied, which takes less than to hold them.
const SMALL: usize = 1 << 10;

/// A value of the host as a value of the plugin, which shares its large arrays. It is of the type `ty`, unless another is found.
///
/// # Safety
/// The host's value is there for as long as the call.
pub(super) unsafe fn adopt(at: *const PbValue, exports: &Exports, ty: Option<&ValueType>) -> Result<ValueRef, NodeError> {
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
    let (numbers, rest) = bytes.as_chunks::<8>();
    let mut numbers = numbers.iter().map(|number| f64::from_ne_bytes(*number));
    match (ty, name, array.rank) {
        ("Vector", b"values", 1) if array.shape[0] == numbers.len() as u64 && rest.is_empty() => {
            Some(Arc::new(Vector { values: numbers.collect() }))
        }
        ("Curve", b"value", 0) if bytes.len() == 8 => numbers.next().map(|value| Arc::new(Curve { value }) as ValueRef),
        _ => None,
    }
}

/// A task that may be talked to while it runs, and not after.
#[derive(Clone)]
pub(super) struct Live(Arc<RwLock<*const PbTask>>);

// SAFETY: the pointer is used under the lock alone, while the task runs; the host lets its suites be called from any thread meanwhile.
unsafe impl Send for Live {}
// SAFETY: as above.
unsafe impl Sync for Live {}

impl Default for Live {
    fn default() -> Self {
        #[allow(clippy::arc_with_non_send_sync, reason = "this, around it, may be sent and shared, and says why")]
        Self(Arc::new(RwLock::new(std::ptr::null())))
    }
}

impl Live {
    /// How many there are of it.
    pub(super) fn holders(&self) -> usize {
        Arc::strong_count(&self.0)
    }

    pub(super) fn ask<R>(&self, ask: impl FnOnce(*const PbTask, &Suites) -> R) -> Option<R> {
        let task = self.0.read().unwrap_or_else(PoisonError::into_inner);
        SUITES.get().filter(|_| !task.is_null()).map(|suites| ask(*task, suites))
    }

    pub(super) fn set(&self, task: *const PbTask) {
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

/// Reads a clock over one that was read before, whose name is mostly the same; `None` where there is none.
///
/// # Safety
/// `clock` is the host's, or null.
pub(super) unsafe fn read_clock(clock: *const PbClock, to: &mut Clock) -> Option<()> {
    // SAFETY: as the caller says.
    let clock = unsafe { clock.as_ref() }?;
    // SAFETY: as above.
    let name = unsafe { bytes_of(&clock.name) };
    if to.name.as_bytes() != name {
        to.name = String::from_utf8_lossy(name).into_owned();
    }
    (to.first, to.last, to.fps) = (clock.first, clock.last, (clock.fps_numerator, clock.fps_denominator));
    Some(())
}

/// A clock that is held for longer.
///
/// # Safety
/// As of [`read_clock`].
unsafe fn new_clock(clock: *const PbClock) -> Option<Clock> {
    let mut new = super::no_clock();
    // SAFETY: as the caller says.
    unsafe { read_clock(clock, &mut new) }.map(|()| new)
}

/// What a task's ports and settings are to the node.
pub(super) struct Given {
    pub(super) args: Vec<Arg>,
    pub(super) input_clocks: Vec<(&'static str, Arc<Clock>)>,
}

/// # Safety
/// `task` runs.
pub(super) unsafe fn given(instance: &Instance, task: &PbTask, live: &Live, exports: &'static Exports) -> Result<Given, NodeError> {
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
        let clock = unsafe { new_clock(port.clock) }.map(Arc::new);
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
