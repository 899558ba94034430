//! The C ABI of Pegbar's plugins. This file is the whole specification: `plugins/include/pegbar_plugin.h` is generated from it, so that the two cannot
//! drift.
//!
//! A plugin is a shared library with one symbol, [`ENTRY`]. The host calls it once with a [`PbHost`] and gets a [`PbPlugin`] that lives as long as the
//! process; a library is never unloaded. What the plugin holds it says as text, in the same words as the manifest beside it, which the host compares.
//!
//! Rules that hold for every struct and function:
//!
//! - Every struct begins with `struct_size`, the size that its maker knew. Fields are only ever added at the end, and with them the minor version of the
//!   ABI; whoever reads a field that the first minor version did not have looks at `struct_size` first. A change of any other kind is a new major version.
//! - A row of structs is a pointer to the first and a count; the next one is `struct_size` bytes behind (`PB_AT`).
//! - Text is UTF-8, pointer and length, with no nought at its end. It and every other pointer that is handed over is valid until the call returns, where
//!   nothing else is said.
//! - Arrays are row-major and packed, in native byte order, aligned for their elements. What comes in is read-only, and shared with others.
//! - No exception, panic or `longjmp` crosses the border.

/// Name of the one symbol that a plugin exports.
pub const ENTRY: &str = "pb_plugin_entry";
/// Must be equal on both sides.
pub const PB_ABI_MAJOR: u32 = 1;
/// Grows when something is added at the end of a struct, or a suite or a version of one.
pub const PB_ABI_MINOR: u32 = 0;
/// Most axes of an array.
pub const PB_MAX_RANK: u32 = 8;

/// Name of [`PbValueSuite`].
pub const PB_VALUE_SUITE: &str = "pegbar.value";
/// Name of [`PbTaskSuite`].
pub const PB_TASK_SUITE: &str = "pegbar.task";

/// All went well.
pub const PB_OK: u32 = 0;
/// It failed; why was told by [`PbTaskSuite::error`].
pub const PB_FAILED: u32 = 1;
/// It stopped because it was asked to.
pub const PB_CANCELLED: u32 = 2;
/// The plugin's code panicked or threw, which was caught at the border.
pub const PB_PANICKED: u32 = 3;

/// 32-bit floating point.
pub const PB_F32: u32 = 1;
/// 64-bit floating point.
pub const PB_F64: u32 = 2;
/// 64-bit signed integers.
pub const PB_I64: u32 = 3;
/// 32-bit unsigned integers.
pub const PB_U32: u32 = 4;
/// Bytes.
pub const PB_U8: u32 = 5;

/// A port that brings one value: that of this frame, or the one that there is.
pub const PB_PORT_VALUE: u32 = 1;
/// A port that brings the values of the frames that were asked for, in that order.
pub const PB_PORT_FRAMES: u32 = 2;
/// A port that brings a sequence, whose values are fetched one by one: [`PbValueSuite::fetch`].
pub const PB_PORT_SEQUENCE: u32 = 3;
/// A setting that is wired: its number at this frame.
pub const PB_PORT_NUMBER: u32 = 4;

/// Stands for the state among the outputs of a recurrent node.
pub const PB_STATE: u32 = 0xffff_ffff;

/// A setting is at fault.
pub const PB_FAULT_PARAMETERS: u32 = 1;
/// An input value is at fault.
pub const PB_FAULT_INPUT: u32 = 2;
/// The numbers are at fault: singular, not converging, not finite.
pub const PB_FAULT_NUMERIC: u32 = 3;
/// A limit is: too large.
pub const PB_FAULT_LIMIT: u32 = 4;
/// It is not supported.
pub const PB_FAULT_UNSUPPORTED: u32 = 5;
/// The file system is at fault.
pub const PB_FAULT_IO: u32 = 6;
/// The plugin itself is at fault.
pub const PB_FAULT_PLUGIN: u32 = 7;

/// Something for people who look for a fault.
pub const PB_LOG_DEBUG: u32 = 1;
/// Something worth knowing.
pub const PB_LOG_INFO: u32 = 2;
/// Something that may be wrong.
pub const PB_LOG_WARNING: u32 = 3;

/// Text: UTF-8, without a nought at its end. The one struct without `struct_size`; it never changes.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbText {
    /// First byte; may be null where `size` is nought.
    pub data: *const u8,
    /// Bytes.
    pub size: u64,
}

/// A named array that is looked at.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbArray {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// `PB_F32` ... `PB_U8`.
    pub dtype: u32,
    /// Number of axes; nought for a scalar.
    pub rank: u32,
    /// Nought.
    pub reserved: u32,
    /// Name among the arrays of its value.
    pub name: PbText,
    /// Extent of each axis, outermost first.
    pub shape: [u64; 8],
    /// The elements.
    pub data: *const u8,
    /// Bytes of the elements.
    pub bytes: u64,
}

/// A value: named arrays and text. It stays as it is for as long as it is held.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbValue {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Number of arrays.
    pub array_count: u32,
    /// The arrays, in the order of the value's type.
    pub arrays: *const PbArray,
    /// Name of its type, as `Image`.
    pub type_name: PbText,
    /// Text fields: one JSON object.
    pub meta: PbText,
}

/// A clock: a frame range and a rate.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbClock {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Frames a second are `fps_numerator / fps_denominator`.
    pub fps_numerator: u32,
    /// See above.
    pub fps_denominator: u32,
    /// Nought.
    pub reserved: u32,
    /// First frame.
    pub first: i64,
    /// Last frame, at least `first`.
    pub last: i64,
    /// Its name.
    pub name: PbText,
}

/// What one reference at an input brings. An input with a list of references has a port for each, one with nothing has none.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbPort {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// The input, counted from nought in the order of the node's schema.
    pub input: u32,
    /// `PB_PORT_VALUE` ... `PB_PORT_NUMBER`.
    pub kind: u32,
    /// Nought.
    pub reserved: u32,
    /// Number of values; of a sequence, how many there are to fetch; nought for a number.
    pub count: u64,
    /// The values, for `PB_PORT_VALUE` and `PB_PORT_FRAMES`: `count` pointers.
    pub values: *const *const PbValue,
    /// Their frames, for `PB_PORT_FRAMES`: `count` of them.
    pub frames: *const i64,
    /// The number, for `PB_PORT_NUMBER`.
    pub number: f64,
    /// The clock of what is wired here; null where that is one value for the whole graph.
    pub clock: *const PbClock,
}

/// A setting as it stands in the graph, for a node's instance.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbSetting {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// The input, counted from nought in the order of the node's schema.
    pub input: u32,
    /// The setting as RON, relative paths resolved; `None` where it is left out.
    pub ron: PbText,
    /// The text of a text, a path or a word of an enumeration; empty for all else.
    pub text: PbText,
    /// The numbers in it, in the order in which they stand; `true` counts as 1 and `false` as 0.
    pub numbers: *const f64,
    /// The same as whole numbers, rounded towards nought.
    pub wholes: *const i64,
    /// Number of numbers.
    pub count: u64,
}

/// The settings of a node of a graph: those that are no wires. A wired one comes with each task, as a port.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbSettings {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Number of settings.
    pub count: u32,
    /// The settings, in the order of the inputs.
    pub settings: *const PbSetting,
}

/// One task: one frame of one node, or everything of a node that runs once.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbTask {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Number of ports.
    pub port_count: u32,
    /// The frame that is being made; the clock's first for a node that runs once.
    pub frame: i64,
    /// The clock of the node's outputs.
    pub clock: *const PbClock,
    /// The ports, in the order of the inputs.
    pub ports: *const PbPort,
    /// For a recurrent node, the state that it starts from; null at the start of a chain.
    pub state: *const PbValue,
    /// The host's own.
    pub host: *const u8,
}

/// Memory of the host for the elements of an array that is to be put out: noughts at first. It belongs to the plugin until it is put or freed.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbBlock {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// `PB_F32` ... `PB_U8`.
    pub dtype: u32,
    /// The elements, to be written.
    pub data: *mut u8,
    /// Bytes of the elements.
    pub bytes: u64,
}

/// Values in and out. What a call refuses is told as the task's error, too, whatever the plugin does about it.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbValueSuite {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Version of the suite.
    pub version: u32,
    /// Memory for `count` elements; null where there is none. From any thread.
    pub alloc: unsafe extern "C" fn(dtype: u32, count: u64) -> *mut PbBlock,
    /// Frees a block that is not put. From any thread.
    pub free: unsafe extern "C" fn(block: *mut PbBlock),
    /// Puts a block out as an array of the value at `index` of an output, without a copy, and takes it from the plugin in any case. `index` counts the frames
    /// of a stream from the clock's first, and is nought for one value; the output is `PB_STATE` for the state.
    pub put: unsafe extern "C" fn(
        task: *const PbTask,
        output: u32,
        index: u64,
        name: PbText,
        rank: u32,
        shape: *const u64,
        block: *mut PbBlock,
    ) -> u32,
    /// `alloc` and `put` in one: memory of the array, to be written before the task returns; null where it is refused.
    pub array: unsafe extern "C" fn(
        task: *const PbTask,
        output: u32,
        index: u64,
        name: PbText,
        dtype: u32,
        rank: u32,
        shape: *const u64,
    ) -> *mut u8,
    /// Sets the text fields of the value at `index` of an output: one JSON object.
    pub meta: unsafe extern "C" fn(task: *const PbTask, output: u32, index: u64, json: PbText) -> u32,
    /// Hands a value on as an output, as it is and without a copy.
    pub pass: unsafe extern "C" fn(task: *const PbTask, output: u32, index: u64, value: *const PbValue) -> u32,
    /// The value at a position of a sequence, to be released; null where it cannot be had, which ends the task.
    pub fetch: unsafe extern "C" fn(task: *const PbTask, port: u32, index: u64) -> *const PbValue,
    /// Holds a value beyond the call, until it is released as often as it was held. From any thread.
    pub hold: unsafe extern "C" fn(value: *const PbValue),
    /// Lets go of a value that was held or fetched. From any thread.
    pub release: unsafe extern "C" fn(value: *const PbValue),
}

/// What a task tells the host and asks of it.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbTaskSuite {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// Version of the suite.
    pub version: u32,
    /// 1 once the run is asked to stop: to be asked now and then by whatever takes long. From any thread while the task runs.
    pub is_cancelled: unsafe extern "C" fn(task: *const PbTask) -> u32,
    /// How far the task is, from 0 to 1.
    pub progress: unsafe extern "C" fn(task: *const PbTask, done: f64),
    /// Something for the log, `PB_LOG_DEBUG` ... `PB_LOG_WARNING`.
    pub log: unsafe extern "C" fn(task: *const PbTask, level: u32, message: PbText),
    /// Why the task fails: whose fault it is (`PB_FAULT_PARAMETERS` ...), "expected X, found Y", and what to do, which may be empty. The first counts.
    pub error: unsafe extern "C" fn(task: *const PbTask, fault: u32, message: PbText, help: PbText),
    /// From [`PbPlugin::needs`] alone: a frame of an input that the task is made from.
    pub need: unsafe extern "C" fn(task: *const PbTask, input: u32, frame: i64) -> u32,
    /// From [`PbPlugin::needs`] alone, for a recurrent node: the frame whose state the task starts from. Without it the chain starts there.
    pub need_state: unsafe extern "C" fn(task: *const PbTask, frame: i64) -> u32,
}

/// What the host is. It lives as long as the process.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbHost {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// `PB_ABI_MAJOR` of the host.
    pub abi_major: u32,
    /// `PB_ABI_MINOR` of the host.
    pub abi_minor: u32,
    /// Nought.
    pub reserved: u32,
    /// Name and version of the host, as `pegbar 0.1.0`.
    pub name: PbText,
    /// The suite of a name and version, which lives as long as the process; null where the host has none.
    pub suite: unsafe extern "C" fn(name: PbText, version: u32) -> *const u8,
}

/// What a plugin is. It lives as long as the process, and its functions may be called from any thread, as its schema says: at once (`threads: any`),
/// of one instance one after the other (`threads: instance`), or of the whole plugin one after the other (`threads: one`).
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PbPlugin {
    /// Bytes of this struct.
    pub struct_size: u32,
    /// `PB_ABI_MAJOR` that the plugin was made for.
    pub abi_major: u32,
    /// `PB_ABI_MINOR` that it was made for.
    pub abi_minor: u32,
    /// Nought.
    pub reserved: u32,
    /// What the plugin holds, as RON: what its manifest has at `plugin`.
    pub schema: PbText,
    /// Makes an instance of the node type at a position of the schema, with settings that are those of all its tasks. The task is there for errors alone.
    pub create: unsafe extern "C" fn(node: u32, task: *const PbTask, settings: *const PbSettings, instance: *mut *mut u8) -> u32,
    /// Ends an instance.
    pub destroy: unsafe extern "C" fn(instance: *mut u8),
    /// Which frames the task is made from, told by [`PbTaskSuite::need`]. Called for nodes alone whose schema says `asks: true`.
    pub needs: unsafe extern "C" fn(instance: *mut u8, task: *const PbTask) -> u32,
    /// Makes the frame, or everything.
    pub compute: unsafe extern "C" fn(instance: *mut u8, task: *const PbTask) -> u32,
}

/// The one symbol that a plugin exports; null where it will not work with this host.
pub type PbPluginEntry = unsafe extern "C" fn(host: *const PbHost) -> *const PbPlugin;

impl PbText {
    /// A text that is looked at for as long as the other side may.
    pub const fn new(text: &str) -> Self {
        Self { data: text.as_ptr(), size: text.len() as u64 }
    }
}
