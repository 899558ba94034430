//! What a plugin is shown of a task: values, ports and settings as rows of structs, each of which begins with its size.
//!
//! Rows are used again from task to task, as are the structs of values that nobody holds: to ask for memory for each takes as long as a small task.
#![allow(unsafe_code, reason = "the C ABI of plugins; each block says what it relies on")]

use std::cell::Cell;
use std::sync::Arc;

use pegbar_abi::{
    PB_F32, PB_F64, PB_I64, PB_MAX_RANK, PB_PORT_FRAMES, PB_PORT_NUMBER, PB_PORT_SEQUENCE, PB_PORT_VALUE, PB_U8, PB_U32, PbArray, PbClock,
    PbPort, PbSetting, PbSettings, PbText, PbValue,
};

use super::call::{Feed, Port, Settings};
use crate::array::{ArrayView, DType};
use crate::clock::Clock;
use crate::value::ValueRef;

thread_local! {
    static WIDE: Cell<bool> = const { Cell::new(false) };
    /// Empty rows that were used before.
    static ROWS: Cell<Option<Rows>> = const { Cell::new(None) };
}

/// Shows plugins that this thread calls rows of structs that are larger than this version's, as a later one may have.
pub(super) fn with_wide_rows<R>(work: impl FnOnce() -> R) -> R {
    struct Narrow;
    impl Drop for Narrow {
        fn drop(&mut self) {
            WIDE.set(false);
        }
    }
    WIDE.set(true);
    let _narrow = Narrow;
    work()
}

/// The same structs, each with two words of nonsense behind it; nothing where rows are as usual.
fn widened<T: Copy>(rows: &[T]) -> Option<Vec<u64>> {
    const WORDS: usize = 2;
    if !WIDE.get() {
        return None;
    }
    let words = size_of::<T>() / 8;
    let mut wide = vec![u64::from_ne_bytes([0x5a; 8]); rows.len() * (words + WORDS)];
    for (row, to) in rows.iter().zip(wide.chunks_exact_mut(words + WORDS)) {
        // SAFETY: the structs of the ABI are whole words, and begin with their size.
        unsafe {
            std::ptr::copy_nonoverlapping(std::ptr::from_ref(row).cast::<u64>(), to.as_mut_ptr(), words);
            to.as_mut_ptr().cast::<u32>().write(size::<T>() + 8 * WORDS as u32);
        }
    }
    Some(wide)
}

/// Where a row begins: the wide one where there is one.
fn start<T>(rows: &[T], wide: Option<&Vec<u64>>) -> *const T {
    wide.map_or(rows.as_ptr(), |wide| wide.as_ptr().cast())
}

/// The size of a struct as the ABI says it.
pub(super) const fn size<T>() -> u32 {
    size_of::<T>() as u32
}

fn dtype_code(dtype: DType) -> u32 {
    match dtype {
        DType::F32 => PB_F32,
        DType::F64 => PB_F64,
        DType::I64 => PB_I64,
        DType::U32 => PB_U32,
        DType::U8 => PB_U8,
    }
}

/// A value as a plugin sees it; the first field is what it gets a pointer to.
#[repr(C)]
pub(super) struct Held {
    seen: PbValue,
    arrays: Vec<PbArray>,
    wide: Option<Vec<u64>>,
    meta: String,
    /// Always there while a plugin can see this.
    value: Option<ValueRef>,
}

// SAFETY: the pointers lead into the value and the rows beside them, all of which live as long as this does and are not written while others see it.
unsafe impl Send for Held {}
// SAFETY: as above.
unsafe impl Sync for Held {}

impl Held {
    fn empty() -> Arc<Self> {
        let nothing = PbText::new("");
        let seen = PbValue { struct_size: size::<PbValue>(), array_count: 0, arrays: std::ptr::null(), type_name: nothing, meta: nothing };
        Arc::new(Self { seen, arrays: Vec::with_capacity(1), wide: None, meta: String::new(), value: None })
    }

    pub(super) fn new(value: ValueRef) -> Arc<Self> {
        Self::filled(Self::empty(), value)
    }

    /// One that nobody else has, for a value.
    fn filled(mut this: Arc<Self>, value: ValueRef) -> Arc<Self> {
        if let Some(held) = Arc::get_mut(&mut this) {
            held.fill(value);
        }
        this
    }

    fn fill(&mut self, value: ValueRef) {
        self.arrays.clear();
        while let Some((name, view)) = &value.nth_array(self.arrays.len()) {
            // Written where it stays: what is written in words and moved at once takes longer than all of it.
            self.arrays.push(NO_ARRAY);
            if let Some(shown) = self.arrays.last_mut() {
                show_array(shown, name, view);
            }
        }
        let meta = value.meta();
        self.meta = if meta.is_empty() { String::new() } else { serde_json::Value::Object(meta).to_string() };
        self.wide = widened(&self.arrays);
        self.seen.array_count = self.arrays.len() as u32;
        self.seen.arrays = start(&self.arrays, self.wide.as_ref());
        self.seen.type_name = PbText::new(value.type_name());
        self.seen.meta = PbText::new(if self.meta.is_empty() { "{}" } else { &self.meta });
        self.value = Some(value);
    }

    pub(super) fn value(&self) -> Option<&ValueRef> {
        self.value.as_ref()
    }

    /// What a plugin sees, for as long as this is held.
    pub(super) fn shown(this: &Arc<Self>) -> *const PbValue {
        Arc::as_ptr(this).cast()
    }

    /// What a plugin sees until it lets go of it by [`release`].
    pub(super) fn lent(this: Arc<Self>) -> *const PbValue {
        Arc::into_raw(this).cast()
    }
}

const NO_ARRAY: PbArray = PbArray {
    struct_size: size::<PbArray>(),
    dtype: 0,
    rank: 0,
    reserved: 0,
    name: PbText::new(""),
    shape: [0; PB_MAX_RANK as usize],
    data: std::ptr::null(),
    bytes: 0,
};

fn show_array(to: &mut PbArray, name: &'static str, view: &ArrayView<'_>) {
    to.dtype = dtype_code(view.dtype);
    to.rank = view.shape.len() as u32;
    to.name = PbText::new(name);
    to.shape.iter_mut().zip(view.shape.iter()).for_each(|(to, &from)| *to = from as u64);
    to.data = view.bytes.as_ptr();
    to.bytes = view.bytes.len() as u64;
}

pub(super) unsafe extern "C" fn hold(value: *const PbValue) {
    if !value.is_null() {
        // SAFETY: every value that a plugin sees is the first field of a `Held` within an `Arc`, alive while it may be looked at.
        unsafe { Arc::increment_strong_count(value.cast::<Held>()) };
    }
}

pub(super) unsafe extern "C" fn release(value: *const PbValue) {
    if !value.is_null() {
        // SAFETY: as in `hold`; the plugin lets go of what it held or fetched, once each time.
        unsafe { Arc::decrement_strong_count(value.cast::<Held>()) };
    }
}

pub(super) fn shown_clock(clock: &Clock) -> PbClock {
    PbClock {
        struct_size: size::<PbClock>(),
        fps_numerator: clock.fps.0,
        fps_denominator: clock.fps.1,
        reserved: 0,
        first: clock.first,
        last: clock.last,
        name: PbText::new(&clock.name),
    }
}

/// The ports as a plugin sees them, and what their pointers lead to.
#[derive(Default)]
struct Rows {
    ports: Vec<PbPort>,
    wide: Option<Vec<u64>>,
    values: Vec<*const PbValue>,
    frames: Vec<i64>,
    clocks: Vec<PbClock>,
    /// Empty structs for values.
    spare: Vec<Arc<Held>>,
}

/// The ports of a task. Holds each of the values in them.
pub(super) struct Shown(Rows);

impl Shown {
    pub(super) fn new(from: &[Port]) -> Self {
        let each = |feed: &Feed| match feed {
            Feed::Value(_) => (1, 0),
            Feed::Frames(list) => (list.len(), list.len()),
            Feed::Sequence(_) | Feed::Number(_) => (0, 0),
        };
        let (values, frames) = from.iter().map(|port| each(&port.feed)).fold((0, 0), |(v, f), (a, b)| (v + a, f + b));
        let mut rows = ROWS.take().unwrap_or_default();
        // None of them grows beyond this, so that what is in them stays where it is.
        rows.ports.reserve(from.len());
        rows.values.reserve(values);
        rows.frames.reserve(frames);
        rows.clocks.reserve(from.len());
        let mut shown = Self(rows);
        for port in from {
            shown.0.add(port);
        }
        shown.0.wide = widened(&shown.0.ports);
        shown
    }

    /// How many they are, and the first.
    pub(super) fn ports(&self) -> (u32, *const PbPort) {
        (self.0.ports.len() as u32, start(&self.0.ports, self.0.wide.as_ref()))
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        /// Longer rows are not kept.
        const MANY: usize = 256;
        let mut rows = std::mem::take(&mut self.0);
        for value in rows.values.drain(..) {
            // SAFETY: each came of an `Arc`, and is let go of once.
            let mut held = unsafe { Arc::from_raw(value.cast::<Held>()) };
            // One that the plugin holds goes when that lets go of it.
            if let Some(alone) = Arc::get_mut(&mut held) {
                alone.value = None;
                rows.spare.push(held);
            }
        }
        if rows.spare.capacity().max(rows.ports.capacity()) <= MANY {
            rows.ports.clear();
            rows.frames.clear();
            rows.clocks.clear();
            // A thread that is being taken down keeps none.
            let _ = ROWS.try_with(|kept| kept.set(Some(rows)));
        }
    }
}

impl Rows {
    fn add(&mut self, port: &Port) {
        let Self { values, frames, clocks, spare, .. } = self;
        let mut show = |value: &ValueRef| values.push(Held::lent(Held::filled(spare.pop().unwrap_or_else(Held::empty), value.clone())));
        let (kind, count, number) = match &port.feed {
            Feed::Value(value) => {
                show(value);
                (PB_PORT_VALUE, 1, 0.0)
            }
            Feed::Frames(list) => {
                list.iter().for_each(|(_, value)| show(value));
                frames.extend(list.iter().map(|(frame, _)| *frame));
                (PB_PORT_FRAMES, list.len(), 0.0)
            }
            Feed::Sequence(values) => (PB_PORT_SEQUENCE, values.len(), 0.0),
            Feed::Number(number) => (PB_PORT_NUMBER, 0, *number),
        };
        let is_frames = kind == PB_PORT_FRAMES;
        let own = if is_frames || kind == PB_PORT_VALUE { count } else { 0 };
        let clock = port.clock.as_deref().map(|clock| {
            clocks.push(shown_clock(clock));
            std::ptr::from_ref(&clocks[clocks.len() - 1])
        });
        self.ports.push(PbPort {
            struct_size: size::<PbPort>(),
            input: port.input,
            kind,
            reserved: 0,
            count: count as u64,
            values: values[values.len() - own..].as_ptr(),
            frames: frames[frames.len() - if is_frames { count } else { 0 }..].as_ptr(),
            number,
            clock: clock.unwrap_or(std::ptr::null()),
        });
    }
}

/// Shows the plugin settings while `run` calls it.
pub(super) fn show_settings<R>(settings: &Settings, run: impl FnOnce(*const PbSettings) -> R) -> R {
    let one = |(input, data): &(u32, super::settings::SettingData)| PbSetting {
        struct_size: size::<PbSetting>(),
        input: *input,
        ron: PbText::new(&data.ron),
        text: PbText::new(&data.text),
        numbers: data.numbers.as_ptr(),
        wholes: data.wholes.as_ptr(),
        count: data.numbers.len() as u64,
    };
    let rows: Vec<PbSetting> = settings.items.iter().map(one).collect();
    let wide = widened(&rows);
    run(&PbSettings { struct_size: size::<PbSettings>(), count: rows.len() as u32, settings: start(&rows, wide.as_ref()) })
}
