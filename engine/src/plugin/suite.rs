//! The host's side of the border: what a plugin may call, and a call of it.
#![allow(unsafe_code, reason = "the C ABI of plugins; each block says what it relies on")]

use std::borrow::Cow;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use pegbar_abi::{
    PB_ABI_MAJOR, PB_ABI_MINOR, PB_CANCELLED, PB_F32, PB_F64, PB_FAILED, PB_FAULT_INPUT, PB_FAULT_IO, PB_FAULT_LIMIT, PB_FAULT_NUMERIC,
    PB_FAULT_PARAMETERS, PB_FAULT_UNSUPPORTED, PB_I64, PB_MAX_RANK, PB_OK, PB_PANICKED, PB_TASK_SUITE, PB_U8, PB_U32, PB_VALUE_SUITE,
    PbBlock, PbHost, PbTask, PbTaskSuite, PbText, PbValue, PbValueSuite,
};

use super::call::{Feed, Made, MadeOf, Request, Response};
use super::shown::{Held, Shown, hold, release, shown_clock, size};
use crate::array::{Array, DType, Data};
use crate::node::{Fault, Meter, NodeError};
use crate::value::{Meta, OwnedParts};

const fn text(text: &str) -> PbText {
    PbText::new(text)
}

/// The text that a plugin hands over, as far as it is one.
///
/// # Safety
/// `text` points at as many bytes as it says, for the length of the call.
pub(super) unsafe fn read_text<'a>(text: PbText) -> Cow<'a, str> {
    if text.data.is_null() || text.size == 0 {
        return Cow::Borrowed("");
    }
    // SAFETY: the caller vouches for the bytes, and null was seen to.
    let bytes = unsafe { std::slice::from_raw_parts(text.data, text.size as usize) };
    std::str::from_utf8(bytes).map_or_else(|_| String::from_utf8_lossy(bytes), Cow::Borrowed)
}

/// A struct of pointers to what lives as long as the process.
struct Forever<T>(T);

// SAFETY: it is never written, and neither is what it leads to.
unsafe impl<T> Sync for Forever<T> {}

/// What every plugin is shown.
pub(super) fn host() -> &'static PbHost {
    &HOST.0
}

static HOST: Forever<PbHost> = Forever(PbHost {
    struct_size: size::<PbHost>(),
    abi_major: PB_ABI_MAJOR,
    abi_minor: PB_ABI_MINOR,
    reserved: 0,
    name: text(concat!("pegbar ", env!("CARGO_PKG_VERSION"))),
    suite,
});

static VALUES: PbValueSuite =
    PbValueSuite { struct_size: size::<PbValueSuite>(), version: 1, alloc, free, put, array, meta, pass, fetch, hold, release };

static TASKS: PbTaskSuite =
    PbTaskSuite { struct_size: size::<PbTaskSuite>(), version: 1, is_cancelled, progress, log, error, need, need_state };

unsafe extern "C" fn suite(name: PbText, version: u32) -> *const u8 {
    // SAFETY: the plugin hands over a text.
    match (unsafe { read_text(name) }.as_ref(), version) {
        (PB_VALUE_SUITE, 1) => (&raw const VALUES).cast(),
        (PB_TASK_SUITE, 1) => (&raw const TASKS).cast(),
        _ => std::ptr::null(),
    }
}

/// What a process does that serves another: its outputs lie there, and what is said is said there.
pub(super) trait Outside: Sync {
    /// True where so many bytes lie in this process rather than there.
    fn lies_here(&self, bytes: usize) -> bool;
    /// Memory of noughts and where it begins; `None` where it is refused.
    fn block(&self, dtype: DType, count: usize) -> Option<(Data, *mut u8)>;
    /// Something for the log.
    fn log(&self, level: u32, message: &str);
    /// A sign of life.
    fn progress(&self, done: f64);
}

static OUTSIDE: OnceLock<&'static dyn Outside> = OnceLock::new();

/// Has this process serve another.
pub(super) fn stand_outside(outside: &'static dyn Outside) {
    OUTSIDE.get_or_init(|| outside);
}

/// Memory of `count` noughts and where it begins; `None` where the type is none, or there is not that much.
fn zeroed(dtype: u32, count: u64) -> Option<(Data, *mut u8)> {
    let count = usize::try_from(count).ok()?;
    let ty = dtype_of(dtype)?;
    if let Some(outside) = OUTSIDE.get().filter(|outside| !outside.lies_here(count.saturating_mul(ty.size()))) {
        return outside.block(ty, count);
    }
    let mut data = Data::zeroed(ty, count)?;
    let start = elements(&mut data).as_mut_ptr();
    Some((data, start))
}

fn dtype_of(code: u32) -> Option<DType> {
    Some(match code {
        PB_F32 => DType::F32,
        PB_F64 => DType::F64,
        PB_I64 => DType::I64,
        PB_U32 => DType::U32,
        PB_U8 => DType::U8,
        _ => return None,
    })
}

/// The bytes of elements that are one's own, to be written; none of others.
pub(super) fn elements(data: &mut Data) -> &mut [u8] {
    match data {
        Data::F32(v) => bytemuck::cast_slice_mut(v),
        Data::F64(v) => bytemuck::cast_slice_mut(v),
        Data::I64(v) => bytemuck::cast_slice_mut(v),
        Data::U32(v) => bytemuck::cast_slice_mut(v),
        Data::U8(v) => v,
        Data::Shared(_) => &mut [],
    }
}

/// A block and the memory that it shows. The plugin sees the first field.
#[repr(C)]
struct Owned {
    seen: PbBlock,
    data: Data,
}

unsafe extern "C" fn alloc(dtype: u32, count: u64) -> *mut PbBlock {
    let Some((data, start)) = zeroed(dtype, count) else { return std::ptr::null_mut() };
    let bytes = data.bytes().len() as u64;
    let seen = PbBlock { struct_size: size::<PbBlock>(), dtype, data: start, bytes };
    Box::into_raw(Box::new(Owned { seen, data })).cast()
}

/// # Safety
/// `block` came from [`alloc`], and was neither freed nor put.
unsafe fn take(block: *mut PbBlock) -> Option<Data> {
    // SAFETY: as the caller says, so it is the box that `alloc` made.
    (!block.is_null()).then(|| unsafe { Box::from_raw(block.cast::<Owned>()) }.data)
}

unsafe extern "C" fn free(block: *mut PbBlock) {
    // SAFETY: the plugin frees what it got, once.
    drop(unsafe { take(block) });
}

struct Answer {
    /// Ascending by output and position, as most plugins put them out.
    made: Vec<Made>,
    needs: Vec<(u32, i64)>,
    previous: Option<i64>,
    error: Option<NodeError>,
}

impl Answer {
    /// The value that is being put out there.
    fn made(&mut self, output: u32, index: u64) -> &mut MadeOf {
        let at = match self.made.binary_search_by_key(&(output, index), |made| (made.output, made.index)) {
            Ok(at) => at,
            Err(at) => {
                // Most nodes put out one.
                if self.made.is_empty() {
                    self.made.reserve_exact(1);
                }
                self.made.insert(at, Made { output, index, what: MadeOf::Parts(OwnedParts::default()) });
                at
            }
        };
        &mut self.made[at].what
    }

    /// The parts of the value that is being put out there; `None` where it is another that was passed on.
    fn parts(&mut self, output: u32, index: u64) -> Option<&mut OwnedParts> {
        match self.made(output, index) {
            MadeOf::Parts(parts) => Some(parts),
            MadeOf::Passed(_) => None,
        }
    }
}

/// One call of a plugin: what it is shown, and what it answers.
pub(super) struct Call<'a> {
    request: &'a Request<'a>,
    plugin: &'a str,
    answer: Mutex<Answer>,
    /// Where somebody looks how much is done.
    meter: Option<Arc<Meter>>,
}

impl<'a> Call<'a> {
    pub(super) fn new(request: &'a Request<'a>, plugin: &'a str) -> Self {
        let answer = Mutex::new(Answer { made: Vec::new(), needs: Vec::new(), previous: None, error: None });
        Self { request, plugin, answer, meter: Meter::current() }
    }

    fn answer(&self) -> MutexGuard<'_, Answer> {
        self.answer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn refuse(&self, why: String) {
        let error = NodeError::new(Fault::Plugin, format!("{}: {why}", self.plugin));
        self.answer().error.get_or_insert(error);
    }

    /// Shows the plugin the task while `run` calls it.
    pub(super) fn show(&self, run: impl FnOnce(*const PbTask) -> u32) -> u32 {
        let shown = Shown::new(&self.request.ports);
        let (port_count, ports) = shown.ports();
        let state = self.request.state.clone().map(Held::new);
        let clock = shown_clock(self.request.clock);
        let task = PbTask {
            struct_size: size::<PbTask>(),
            port_count,
            frame: self.request.frame,
            clock: &raw const clock,
            ports,
            state: state.as_ref().map_or(std::ptr::null(), Held::shown),
            host: (&raw const *self).cast(),
        };
        run(&raw const task)
    }

    /// What came of the call.
    pub(super) fn end(self, status: u32) -> Result<Response, NodeError> {
        let plugin = self.plugin;
        let broken = |why: String| NodeError::new(Fault::Plugin, format!("{plugin}: {why}"));
        let is_cancelled = self.request.cancel.is_cancelled();
        let answer = self.answer.into_inner().unwrap_or_else(PoisonError::into_inner);
        match (status, answer.error) {
            (PB_CANCELLED, _) if is_cancelled => return Err(NodeError::stopped()),
            (PB_PANICKED, Some(error)) => {
                let help = "this is a fault of the plugin's code: please tell its makers, with the graph and the inputs";
                return Err(broken(format!("panicked: {}", error.message)).help(help));
            }
            (_, Some(error)) => return Err(error),
            (PB_OK, None) => {}
            (PB_CANCELLED, None) => return Err(broken("expected it to stop only when asked, found it stopped".to_owned())),
            (status, None) => return Err(broken(format!("expected a reason for its failure, found status {status} alone"))),
        }
        Ok(Response { made: answer.made, needs: answer.needs, previous: answer.previous })
    }

    fn put(&self, output: u32, index: u64, name: Cow<'static, str>, shape: Option<Vec<usize>>, data: Option<Data>) -> Result<(), String> {
        let data = data.ok_or_else(|| format!("array `{name}`: expected memory for it, found none"))?;
        let shape = shape.ok_or_else(|| format!("array `{name}`: expected at most {PB_MAX_RANK} axes that fit into memory"))?;
        let array = Array { shape, data };
        let (needs, has) = (array.shape.iter().try_fold(array.dtype().size(), |n, &d| n.checked_mul(d)), array.view().bytes.len());
        if needs != Some(has) {
            let described = crate::array::describe(array.dtype(), &array.shape);
            return Err(format!("array `{name}`: expected {described}, found {has} bytes"));
        }
        let mut answer = self.answer();
        let parts = answer.parts(output, index).filter(|parts| parts.arrays.iter().all(|(n, _)| *n != name));
        let parts = parts.ok_or_else(|| format!("array `{name}` of output {output}: expected it once, found it put out twice"))?;
        if parts.arrays.is_empty() {
            parts.arrays.reserve_exact(1);
        }
        parts.arrays.push((name, array));
        Ok(())
    }

    /// The name of an array: that of the schemas, where there is one.
    fn name(&self, name: PbText) -> Cow<'static, str> {
        // SAFETY: the plugin hands over a text.
        let name = unsafe { read_text(name) };
        match self.request.names.iter().find(|known| **known == name) {
            Some(known) => Cow::Borrowed(known),
            None => Cow::Owned(name.into_owned()),
        }
    }
}

/// The call that a task belongs to.
///
/// # Safety
/// `task` is what [`Call::show`] shows, and its call runs.
unsafe fn call<'a>(task: *const PbTask) -> Option<&'a Call<'a>> {
    // SAFETY: as the caller says, `host` leads to the call, which lives as long as the task is shown.
    unsafe { task.as_ref().and_then(|task| task.host.cast::<Call<'a>>().as_ref()) }
}

/// # Safety
/// `shape` leads to `rank` extents.
unsafe fn read_shape(rank: u32, shape: *const u64) -> Option<Vec<usize>> {
    if rank > PB_MAX_RANK || (rank > 0 && shape.is_null()) {
        return None;
    }
    // SAFETY: as the caller says, and of rank nought nothing is read.
    (0..rank as usize).map(|i| usize::try_from(unsafe { *shape.add(i) }).ok()).collect()
}

fn status(call: &Call, result: Result<(), String>) -> u32 {
    match result {
        Ok(()) => PB_OK,
        Err(why) => {
            call.refuse(why);
            PB_FAILED
        }
    }
}

unsafe extern "C" fn put(
    task: *const PbTask,
    output: u32,
    index: u64,
    name: PbText,
    rank: u32,
    shape: *const u64,
    block: *mut PbBlock,
) -> u32 {
    // SAFETY: the plugin hands over the task that it was shown, a text, `rank` extents, and a block of its own.
    let (call, shape, data) = unsafe { (call(task), read_shape(rank, shape), take(block)) };
    call.map_or(PB_FAILED, |call| status(call, call.put(output, index, call.name(name), shape, data)))
}

unsafe extern "C" fn array(
    task: *const PbTask,
    output: u32,
    index: u64,
    name: PbText,
    dtype: u32,
    rank: u32,
    shape: *const u64,
) -> *mut u8 {
    // SAFETY: the plugin hands over the task that it was shown, a text, and `rank` extents.
    let (call, shape) = unsafe { (call(task), read_shape(rank, shape)) };
    let Some(call) = call else { return std::ptr::null_mut() };
    let count = shape.as_ref().and_then(|s| s.iter().try_fold(1u64, |n, &d| n.checked_mul(d as u64)));
    let (data, start) = count.and_then(|count| zeroed(dtype, count)).unzip();
    match (call.put(output, index, call.name(name), shape, data), start) {
        (Ok(()), Some(start)) => start,
        (Ok(()), None) => std::ptr::null_mut(),
        (Err(why), _) => {
            call.refuse(why);
            std::ptr::null_mut()
        }
    }
}

unsafe extern "C" fn meta(task: *const PbTask, output: u32, index: u64, json: PbText) -> u32 {
    // SAFETY: the plugin hands over the task that it was shown, and a text.
    let (call, json) = unsafe { (call(task), read_text(json)) };
    let Some(call) = call else { return PB_FAILED };
    let read = serde_json::from_str::<Meta>(&json).map_err(|e| format!("text of output {output}: expected one JSON object: {e}"));
    let mut answer = call.answer();
    if let (Ok(meta), Some(parts)) = (&read, answer.parts(output, index)) {
        parts.meta = meta.clone();
    }
    drop(answer);
    status(call, read.map(|_| ()))
}

unsafe extern "C" fn pass(task: *const PbTask, output: u32, index: u64, value: *const PbValue) -> u32 {
    // SAFETY: the plugin hands over the task that it was shown, and a value that it may look at, which is the first field of a `Held`.
    let (call, value) = unsafe { (call(task), value.cast::<Held>().as_ref()) };
    let (Some(call), Some(value)) = (call, value.and_then(Held::value)) else { return PB_FAILED };
    *call.answer().made(output, index) = MadeOf::Passed(value.clone());
    PB_OK
}

unsafe extern "C" fn fetch(task: *const PbTask, port: u32, index: u64) -> *const PbValue {
    // SAFETY: the plugin hands over the task that it was shown.
    let Some(call) = (unsafe { call(task) }) else { return std::ptr::null() };
    let Some(Feed::Sequence(values)) = call.request.ports.get(port as usize).map(|p| &p.feed) else {
        call.refuse(format!("expected a sequence to fetch from, found port {port}"));
        return std::ptr::null();
    };
    match values.get(usize::try_from(index).unwrap_or(usize::MAX)) {
        Ok(value) => Held::lent(Held::new(value)),
        Err(error) => {
            call.answer().error.get_or_insert(error);
            std::ptr::null()
        }
    }
}

unsafe extern "C" fn is_cancelled(task: *const PbTask) -> u32 {
    // SAFETY: the plugin hands over the task that it was shown.
    u32::from(unsafe { call(task) }.is_some_and(|call| call.request.cancel.is_cancelled()))
}

unsafe extern "C" fn progress(task: *const PbTask, done: f64) {
    if let Some(outside) = OUTSIDE.get() {
        outside.progress(done);
    }
    // SAFETY: the plugin hands over the task that it was shown.
    if let Some(meter) = unsafe { call(task) }.and_then(|call| call.meter.as_ref()) {
        meter.set(done);
    }
}

unsafe extern "C" fn log(task: *const PbTask, level: u32, message: PbText) {
    // SAFETY: the plugin hands over the task that it was shown, and a text.
    let (call, message) = unsafe { (call(task), read_text(message)) };
    match (call, OUTSIDE.get()) {
        (Some(_), Some(outside)) => outside.log(level, &message),
        (Some(call), None) => say(call.plugin, call.request.frame, level, &message),
        (None, _) => {}
    }
}

/// What a plugin says.
pub(super) fn say(plugin: &str, frame: i64, level: u32, message: &str) {
    if level >= pegbar_abi::PB_LOG_WARNING {
        eprintln!("{plugin} at frame {frame}: {message}");
    }
}

unsafe extern "C" fn error(task: *const PbTask, fault: u32, message: PbText, help: PbText) {
    // SAFETY: the plugin hands over the task that it was shown, and texts.
    let (call, message, help) = unsafe { (call(task), read_text(message), read_text(help)) };
    let Some(call) = call else { return };
    let fault = match fault {
        PB_FAULT_PARAMETERS => Fault::Parameters,
        PB_FAULT_INPUT => Fault::Input,
        PB_FAULT_NUMERIC => Fault::Numeric,
        PB_FAULT_LIMIT => Fault::Limit,
        PB_FAULT_UNSUPPORTED => Fault::Unsupported,
        PB_FAULT_IO => Fault::Io,
        _ => Fault::Plugin,
    };
    let failed = NodeError::new(fault, message.into_owned());
    call.answer().error.get_or_insert(if help.is_empty() { failed } else { failed.help(help.into_owned()) });
}

unsafe extern "C" fn need(task: *const PbTask, input: u32, frame: i64) -> u32 {
    // SAFETY: the plugin hands over the task that it was shown.
    unsafe { call(task) }.map_or(PB_FAILED, |call| {
        call.answer().needs.push((input, frame));
        PB_OK
    })
}

unsafe extern "C" fn need_state(task: *const PbTask, frame: i64) -> u32 {
    // SAFETY: the plugin hands over the task that it was shown.
    unsafe { call(task) }.map_or(PB_FAILED, |call| {
        call.answer().previous = Some(frame);
        PB_OK
    })
}
