//! A worker: one plugin, one task after the other, for the host that started it.
//!
//! It is a host itself, by the same code as one that has the plugin in its own process, whose values lie in memory that another wrote.

use std::any::Any;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

#[cfg(target_os = "linux")]
use super::arena::Attached;
use super::link::Link;
use super::message::{self, DONE, FAILED, FETCH, LARGE, LOAD, LOG, NEEDS, QUIT, TASK};
use super::notes::{Near, Notes, STATE_INPUT};
use super::pipe::{self, Pipe};
use super::rooms::{self, Rooms};
use super::sheet::{Sheet, Sheets};
use super::wire::{Along, Reader, Writer};
use super::{ARGUMENT, PIPES, rights};
use crate::array::{Array, ArrayView, Bytes, DType, Data, Shape, Shared};
use crate::node::{Cancel, Fault, NodeError, SequenceRef, Values};
use crate::plugin::call::{Feed, MadeOf, Port, Request, Response, Settings, Transport};
use crate::plugin::library::InProcess;
use crate::plugin::manifest::{Manifest, intern};
use crate::plugin::suite::{self, Outside};
use crate::value::{AnyValue, Meta, Parts, ValueRef};

/// Exit code of a worker that cannot serve.
const EXIT: i32 = 2;

struct Serving {
    link: Mutex<Link>,
    notes: &'static Notes,
    /// The memory that is shared; `None` where all goes over sockets.
    #[cfg(target_os = "linux")]
    arena: Option<Attached>,
    is_piped: bool,
    /// True while a task runs, which is when the host listens.
    runs: AtomicBool,
    /// Blocks that this process has of the host, and those that it has no longer.
    blocks: Mutex<(BTreeSet<u64>, Vec<u64>)>,
    sheets: Sheets,
    rooms: Rooms,
    /// Bytes of memory that this process may take, and whether it was refused some.
    most: AtomicU64,
    is_refused: AtomicBool,
    /// What the host lent, for as long as somebody here holds it.
    lent: Mutex<Vec<(u64, ValueRef)>>,
}

static SERVING: OnceLock<Serving> = OnceLock::new();

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Serves, where this process was started as a worker, and ends it then; else does nothing. To be called before anything else.
pub(super) fn serve_if_asked() {
    let mut args = std::env::args_os().skip(1);
    if args.next().is_none_or(|arg| arg != ARGUMENT) {
        return;
    }
    let host = args.next().and_then(|n| n.to_str()?.parse().ok());
    let pipes = args.next().is_some_and(|arg| arg == PIPES);
    let served = host.filter(|&host| rights::end_with(host)).and_then(|_| serve(pipes));
    if served.is_none() {
        eprintln!("expected to be started by a host of plugins");
    }
    std::process::exit(if served.is_some() { 0 } else { EXIT });
}

/// Serves until the host says that it is enough; `None` where it is none.
fn serve(pipes: bool) -> Option<()> {
    let (messages, other) = super::process::inherited(pipes)?;
    #[cfg(target_os = "linux")]
    let (link, arena) = match pipes {
        true => (Link::Piped(Pipe::attach(messages, other).ok()?), None),
        false => (Link::Shared(super::lane::Lane::attach(&messages).ok()?), Some(Attached::new(&other).ok()?)),
    };
    #[cfg(not(target_os = "linux"))]
    let link = Link::Piped(Pipe::attach(messages, other).ok()?);
    let serving = SERVING.get_or_init(|| Serving {
        notes: link.forever(),
        link: Mutex::new(link),
        #[cfg(target_os = "linux")]
        arena,
        is_piped: pipes,
        runs: AtomicBool::new(false),
        blocks: Mutex::default(),
        sheets: Sheets::default(),
        rooms: Rooms::default(),
        most: AtomicU64::new(u64::MAX),
        is_refused: AtomicBool::new(false),
        lent: Mutex::default(),
    });
    note_signals(serving);
    suite::stand_outside(serving);
    let mut message = Vec::new();
    let mut answer = Writer::default();
    locked(&serving.link).receive(&mut message, usize::MAX, &mut || true).ok()?;
    let mut tasks = load(serving, &mut Reader(&message))?;
    // What says that it is loaded.
    answer.u32(DONE);
    loop {
        {
            let link = locked(&serving.link);
            link.send(&answer, &mut || true).ok()?;
            answer.clear();
            link.receive(&mut message, usize::MAX, &mut || true).ok()?;
        }
        let mut from = Reader(&message);
        match from.u32()? {
            TASK => tasks.run(serving, &mut from, &mut answer)?,
            QUIT => return Some(()),
            _ => return None,
        }
    }
}

fn note_signals(serving: &'static Serving) {
    #[cfg(target_os = "linux")]
    if let Some(arena) = &serving.arena {
        rights::set_inputs(0, arena.inputs());
    }
    rights::note_signals(serving.notes);
}

fn load(serving: &Serving, from: &mut Reader) -> Option<Tasks> {
    if from.u32()? != LOAD {
        return None;
    }
    let manifest: Manifest = ron::from_str(from.text()?).ok()?;
    let folder = PathBuf::from(from.text()?);
    let writable = from.list(|from| from.text().map(PathBuf::from))?;
    let most = from.u64()?;
    serving.most.store(most, Ordering::Relaxed);
    rights::limit_memory(most);
    rights::give_up(&writable);
    let types = manifest.plugin.values.iter().chain(manifest.plugin.nodes.iter().filter_map(|node| node.state.as_ref()));
    let names = types.flat_map(|ty| ty.arrays.iter().map(|array| intern(&array.name))).chain(["values", "value"]).collect();
    let manifest = Arc::new(manifest);
    Some(Tasks { plugin: InProcess::new(manifest.clone(), folder, true), manifest, names, settings: BTreeMap::new() })
}

struct Tasks {
    plugin: InProcess,
    manifest: Arc<Manifest>,
    /// Names of arrays, as values of its types have them.
    names: Vec<&'static str>,
    settings: BTreeMap<u64, Arc<Settings>>,
}

impl Tasks {
    /// Reads a task, runs it, and writes what comes of it; `None` where it cannot be read.
    fn run(&mut self, serving: &'static Serving, from: &mut Reader, answer: &mut Writer) -> Option<()> {
        for id in from.list(Reader::u64)? {
            self.settings.remove(&id);
        }
        let (task, what, node, id) = (from.u32()?, from.u32()?, from.u32()?, from.u64()?);
        if let Some(new) = message::read_option(from, message::read_settings)? {
            self.settings.insert(id, new);
        }
        let settings = self.settings.get(&id)?.clone();
        let frame = from.i64()?;
        let clock = message::read_clock(from)?;
        rights::forget_inputs();
        serving.rooms.empty();
        let mut sheet = serving.sheets.take(from.0.len())?;
        let mut take = |bytes: &mut [u8]| locked(&serving.link).read(bytes, &mut || true).ok();
        let ports = from.list(|from| read_port(serving, &mut sheet, &mut take, from))?;
        let state = message::read_option(from, |from| read_value(serving, STATE_INPUT, &mut sheet, &mut take, from))?;
        sheet.seal();
        rights::set_inputs(1, sheet.range());
        let notes = serving.notes;
        let cancel = Cancel::asking(move || notes.cancel.load(Ordering::Relaxed) == task);
        let request = Request { node, settings: &settings, frame, clock: &clock, ports, state, cancel: &cancel, names: &self.names };
        serving.runs.store(true, Ordering::SeqCst);
        rights::forget_errors();
        let result = if what == NEEDS { self.plugin.needs(&request) } else { self.plugin.compute(&request) };
        serving.runs.store(false, Ordering::SeqCst);
        drop(request);
        serving.answer(result, &Maker { manifest: &self.manifest, node, frame }, answer);
        serving.rooms.end((node, frame));
        serving.sheets.put(sheet);
        Some(())
    }
}

/// What made something: a node at a frame.
struct Maker<'a> {
    manifest: &'a Manifest,
    node: u32,
    frame: i64,
}

impl Maker<'_> {
    fn broken(&self, output: u32, why: &str) -> NodeError {
        let plugin = &self.manifest.plugin;
        let output = plugin.nodes.get(self.node as usize).and_then(|node| node.outputs.get(output as usize));
        let output = output.map_or_else(|| "its state".to_owned(), |output| format!("output `{}`", output.name));
        NodeError::new(Fault::Plugin, format!("plugin `{}` {}: {output}: {why}", plugin.name, plugin.version))
    }
}

impl Serving {
    /// Asks the host something; `None` while it does not listen, or where the answer cannot be read.
    fn ask<R>(&self, ask: impl FnOnce(&mut Writer), read: impl FnOnce(&mut Reader, &mut Take) -> Option<R>) -> Option<R> {
        if !self.runs.load(Ordering::SeqCst) {
            return None;
        }
        let link = locked(&self.link);
        let mut message = Writer::default();
        ask(&mut message);
        let mut answer = Vec::new();
        let exchanged = link.send(&message, &mut || true).and_then(|()| link.receive(&mut answer, usize::MAX, &mut || true));
        exchanged.ok()?;
        read(&mut Reader(&answer), &mut |bytes| link.read(bytes, &mut || true).ok())
    }

    /// Writes what a task gave.
    fn answer(&self, result: Result<Response, NodeError>, maker: &Maker, to: &mut Writer) {
        let result = result.and_then(|response| self.closed(response, maker));
        let is_refused = self.is_refused.swap(false, Ordering::Relaxed);
        let most = self.most.load(Ordering::Relaxed);
        let result = result.map_err(|e| if is_refused && e.help.is_none() { e.help(super::isolated::memory_help(most)) } else { e });
        to.u32(if result.is_ok() { DONE } else { FAILED });
        match result {
            Ok(response) => self.write_made(response, to),
            Err(error) => message::write_error(to, &error),
        }
        let mut released = Vec::new();
        locked(&self.lent).retain(|(id, value)| {
            let is_held = Arc::strong_count(value) > 1;
            if !is_held {
                released.push(*id);
            }
            is_held
        });
        to.list(&released, |to, id| to.u64(*id));
        // What was put out is the host's again, and not among what is given back.
        to.list(&std::mem::take(&mut locked(&self.blocks).1), |to, at| to.u64(*at));
    }

    /// What was made, as it is from here on; an error where more was written than there is room for.
    fn closed(&self, response: Response, maker: &Maker) -> Result<Response, NodeError> {
        for made in &response.made {
            let MadeOf::Parts(parts) = &made.what else { continue };
            for (name, array) in &parts.arrays {
                if self.close(&array.data, (maker.node, maker.frame)) {
                    let bytes = array.data.bytes().len();
                    let why = format!("array `{name}`: expected {bytes} bytes to be written, found more: it wrote behind the end");
                    return Err(maker.broken(made.output, &why));
                }
            }
        }
        Ok(response)
    }

    /// Ends the writing of an array. True where more was written than it has.
    fn close(&self, data: &Data, made_by: (u32, i64)) -> bool {
        let Data::Shared(shared) = data else { return false };
        #[cfg(target_os = "linux")]
        if let (Some(arena), Some(at)) = (&self.arena, self.block_of(data)) {
            return arena.close(at, shared.bytes(), made_by);
        }
        self.rooms.seal(shared.bytes(), made_by);
        // SAFETY: behind each array of a room lie bytes of the room.
        unsafe { rooms::is_overrun(shared.bytes(), usize::MAX) }
    }

    fn write_made(&self, mut response: Response, to: &mut Writer) {
        to.list(&response.needs, |to, (input, frame)| {
            to.u32(*input);
            to.i64(*frame);
        });
        message::write_option(to, response.previous.as_ref(), |to, frame| to.i64(*frame));
        to.u64(response.made.len() as u64);
        for made in &mut response.made {
            to.u32(made.output);
            to.u64(made.index);
            match &mut made.what {
                MadeOf::Parts(parts) => {
                    to.u32(message::PARTS);
                    let meta = if parts.meta.is_empty() { String::new() } else { serde_json::to_string(&parts.meta).unwrap_or_default() };
                    to.text(&meta);
                    to.u64(parts.arrays.len() as u64);
                    parts.arrays.iter_mut().for_each(|(name, array)| self.write_array(name, array, to));
                }
                MadeOf::Passed(value) => {
                    let lent = locked(&self.lent);
                    let id = lent.iter().find(|(_, known)| Arc::ptr_eq(known, value)).map_or(u64::MAX, |(id, _)| *id);
                    to.u32(message::PASSED);
                    to.u64(id);
                }
            }
        }
    }

    fn write_array(&self, name: &str, array: &mut Array, to: &mut Writer) {
        to.text(name);
        message::write_dtype(to, array.dtype());
        message::write_shape(to, &array.shape);
        let bytes = array.data.bytes();
        match self.block_of(&array.data) {
            Some(at) if locked(&self.blocks).0.remove(&at) => {
                to.u32(message::THERE);
                to.u64(at);
            }
            None if self.is_piped && bytes.len() >= LARGE => {
                to.u32(message::ALONG);
                to.u64(bytes.len() as u64);
                to.along.push(Along::Data(std::mem::replace(&mut array.data, Data::U8(Vec::new()))));
            }
            _ => {
                to.u32(message::HERE);
                to.bytes(bytes);
            }
        }
    }
}

#[cfg(target_os = "linux")]
impl Serving {
    /// The host's block that elements lie in; `None` where they lie elsewhere.
    fn block_of(&self, data: &Data) -> Option<u64> {
        let Data::Shared(shared) = data else { return None };
        self.arena.as_ref()?.output_at(shared.bytes())
    }

    /// Asks the host for memory.
    fn host_block(&self, dtype: DType, count: usize) -> Option<(Data, *mut u8)> {
        let bytes = count.checked_mul(dtype.size())?;
        let ask = |to: &mut Writer| {
            to.u32(message::ALLOC);
            message::write_dtype(to, dtype);
            to.u64(count as u64);
        };
        let at = self.ask(ask, |from, _| message::read_option(from, Reader::u64))??;
        let start = self.arena.as_ref()?.output(at, bytes)?;
        locked(&self.blocks).0.insert(at);
        let block = Block { serving: SERVING.get()?, at, start: start as usize, bytes };
        Some((Data::Shared(Shared::new(dtype, Arc::new(block))?), start))
    }
}

#[cfg(not(target_os = "linux"))]
impl Serving {
    fn block_of(&self, _: &Data) -> Option<u64> {
        None
    }

    fn host_block(&self, _: DType, _: usize) -> Option<(Data, *mut u8)> {
        None
    }
}

impl Outside for Serving {
    fn lies_here(&self, bytes: usize) -> bool {
        bytes == 0 || !self.runs.load(Ordering::SeqCst)
    }

    fn block(&self, dtype: DType, count: usize) -> Option<(Data, *mut u8)> {
        let is_large = count.checked_mul(dtype.size()).is_none_or(|bytes| bytes >= LARGE);
        let block = if is_large && !self.is_piped { self.host_block(dtype, count) } else { self.rooms.array(dtype, count) };
        if block.is_none() {
            self.is_refused.store(true, Ordering::Relaxed);
        }
        block
    }

    fn log(&self, level: u32, message: &str) {
        let ask = |to: &mut Writer| {
            to.u32(LOG);
            to.u32(level);
            to.text(message);
        };
        self.ask(ask, |_, _| Some(()));
    }

    fn progress(&self, done: f64) {
        self.notes.beat(done);
        pipe::send_notes(self.notes);
    }
}

/// A block of the host's that is written here.
#[cfg(target_os = "linux")]
struct Block {
    serving: &'static Serving,
    at: u64,
    start: usize,
    bytes: usize,
}

#[cfg(target_os = "linux")]
impl Bytes for Block {
    #[allow(unsafe_code, reason = "the host gave this memory, for as long as this process has the block")]
    fn bytes(&self) -> &[u8] {
        // SAFETY: it is mapped, as long as it says, and stays so.
        unsafe { std::slice::from_raw_parts(self.start as *const u8, self.bytes) }
    }
}

#[cfg(target_os = "linux")]
impl Drop for Block {
    fn drop(&mut self) {
        let mut blocks = locked(&self.serving.blocks);
        if blocks.0.remove(&self.at) {
            blocks.1.push(self.at);
        }
    }
}

/// A value of the host's.
#[derive(Debug)]
struct Lent {
    name: &'static str,
    arrays: Vec<(&'static str, Array)>,
    meta: Meta,
}

impl AnyValue for Lent {
    fn type_name(&self) -> &'static str {
        self.name
    }
    fn parts(&self) -> Parts<'_> {
        Parts {
            arrays: self.arrays.iter().map(|(name, array)| (*name, array.view())).collect::<Vec<(&str, ArrayView<'_>)>>(),
            meta: self.meta.clone(),
        }
    }
    fn nth_array(&self, at: usize) -> Option<(&'static str, ArrayView<'_>)> {
        self.arrays.get(at).map(|(name, array)| (*name, array.view()))
    }
    fn meta(&self) -> Meta {
        self.meta.clone()
    }
    fn size(&self) -> usize {
        self.arrays.iter().map(|(_, array)| array.data.bytes().len()).sum()
    }
    fn first_shape(&self) -> Shape {
        self.arrays.first().map(|(_, array)| Shape::new(&array.shape)).unwrap_or_default()
    }
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync> {
        self
    }
}

/// Reads an array that goes behind a message.
type Take<'a> = dyn FnMut(&mut [u8]) -> Option<()> + 'a;

fn read_port(serving: &'static Serving, sheet: &mut Sheet, take: &mut Take, from: &mut Reader) -> Option<Port> {
    let input = from.u32()?;
    let clock = message::read_option(from, message::read_clock)?.map(Arc::new);
    let feed = match from.u32()? {
        message::VALUE => Feed::Value(read_value(serving, input, sheet, take, from)?),
        message::FRAMES => Feed::Frames(from.list(|from| Some((from.i64()?, read_value(serving, input, sheet, take, from)?)))?),
        message::SEQUENCE => {
            let sequence = Sequence { serving, input, port: from.u32()?, len: from.size()? };
            Feed::Sequence(SequenceRef::new(clock.clone(), sequence))
        }
        message::NUMBER => Feed::Number(from.f64()?),
        _ => return None,
    };
    Some(Port { input, feed, clock })
}

fn read_value(serving: &Serving, input: u32, sheet: &mut Sheet, take: &mut Take, from: &mut Reader) -> Option<ValueRef> {
    let id = from.u64()?;
    let name = intern(from.text()?);
    let meta = match from.text()? {
        "" => Meta::default(),
        text => serde_json::from_str(text).ok()?,
    };
    let arrays = from.list(|from| {
        let name = intern(from.text()?);
        let dtype = message::read_dtype(from)?;
        let shape = message::read_shape(from)?;
        let bytes: Arc<dyn Bytes> = match from.u32()? {
            message::HERE => sheet.add(from.bytes()?)?,
            #[cfg(target_os = "linux")]
            message::THERE => {
                let (at, length) = (from.u64()?, from.size()?);
                Arc::new(serving.arena.as_ref()?.input(at, length)?)
            }
            message::ALONG => {
                let Some(mut own) = Sheet::new(from.size()?) else {
                    // The host hears of it by the end of this process.
                    serving.notes.set_near(Near::Memory);
                    pipe::send_notes(serving.notes);
                    return None;
                };
                take(own.bytes_mut())?;
                own.whole()
            }
            _ => return None,
        };
        rights::add_input(bytes.bytes(), input);
        Some((name, Array { shape, data: Data::Shared(Shared::new(dtype, bytes)?) }))
    })?;
    let value: ValueRef = Arc::new(Lent { name, arrays, meta });
    locked(&serving.lent).push((id, value.clone()));
    Some(value)
}

/// A sequence of the host's, fetched value by value.
struct Sequence {
    serving: &'static Serving,
    input: u32,
    port: u32,
    len: usize,
}

impl Values for Sequence {
    fn len(&self) -> usize {
        self.len
    }

    fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        let ask = |to: &mut Writer| {
            to.u32(FETCH);
            to.u32(self.port);
            to.u64(idx as u64);
        };
        let read = |from: &mut Reader, take: &mut Take| {
            Some(match from.u32()? {
                1 => {
                    let mut sheet = self.serving.sheets.take(from.0.len())?;
                    let value = read_value(self.serving, self.input, &mut sheet, take, from)?;
                    sheet.seal();
                    self.serving.sheets.put(sheet);
                    Ok(value)
                }
                _ => Err(message::read_error(from)?),
            })
        };
        let fetched = self.serving.ask(ask, read);
        fetched.unwrap_or_else(|| Err(NodeError::internal(format!("value {idx} of a sequence could not be had of the host"))))
    }
}
