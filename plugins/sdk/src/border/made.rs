//! What a node makes, as the host takes it.

use std::cell::Cell;
use std::sync::Arc;

use pegbar_abi::{PB_F32, PB_F64, PB_I64, PB_U8, PB_U32, PbBlock, PbTask, PbText};
use pegbar_engine::array::{ArrayView, Block, Bytes, DType, Shape, with_allocator};
use pegbar_engine::node::NodeError;
use pegbar_engine::value::ValueRef;

use super::{SUITES, strange};

thread_local! {
    /// True once a task of this thread has made memory of the host.
    static HAS_BLOCKS: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work`; new buffers lie meanwhile in the host's memory.
pub(super) fn with_host_memory<R>(work: impl FnOnce() -> R) -> R {
    HAS_BLOCKS.set(false);
    with_allocator(allocate, work)
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
pub(super) fn put(task: *const PbTask, output: u32, index: u64, mut value: ValueRef) -> Result<(), NodeError> {
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
