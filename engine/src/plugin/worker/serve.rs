//! A worker: one plugin, one task after the other, for the host that started it.
//!
//! It is a host itself, by the same code as one that has the plugin in its own process, whose values lie in memory that another wrote.

use std::any::Any;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use super::arena::Attached;
use super::lane::{Broken, Control, Lane};
use super::message::{self, ALLOC, DONE, FAILED, FETCH, LARGE, LOAD, LOG, NEEDS, QUIT, TASK};
use super::sheet::{Sheet, Sheets};
use super::wire::{Reader, Writer};
use super::{ARGUMENT, rights};
use crate::array::{Array, ArrayView, Bytes, DType, Data, Shape, Shared};
use crate::node::{Cancel, NodeError, SequenceRef, Values};
use crate::plugin::call::{Feed, MadeOf, Port, Request, Response, Settings, Transport};
use crate::plugin::library::InProcess;
use crate::plugin::manifest::{Manifest, intern};
use crate::plugin::suite::{self, Outside};
use crate::value::{AnyValue, Meta, Parts, ValueRef};

/// Exit code of a worker that cannot serve.
const EXIT: i32 = 2;

struct Serving {
    lane: Mutex<Lane>,
    control: &'static Control,
    arena: Attached,
    /// True while a task runs, which is when the host listens.
    runs: AtomicBool,
    /// Blocks that this process has of the host, and those that it has no longer.
    blocks: Mutex<(BTreeSet<u64>, Vec<u64>)>,
    sheets: Sheets,
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
    let served = host.filter(|&host| rights::end_with(host)).and_then(|_| serve());
    if served.is_none() {
        eprintln!("expected to be started by a host of plugins");
    }
    std::process::exit(if served.is_some() { 0 } else { EXIT });
}

/// Serves until the host says that it is enough; `None` where it is none.
fn serve() -> Option<()> {
    let (lane, arena) = super::process::inherited()?;
    let lane = Lane::attach(&lane).ok()?;
    let serving = SERVING.get_or_init(|| Serving {
        control: lane.forever(),
        lane: Mutex::new(lane),
        arena,
        runs: AtomicBool::new(false),
        blocks: Mutex::default(),
        sheets: Sheets::default(),
        lent: Mutex::default(),
    });
    note_signals(serving);
    suite::stand_outside(serving);
    let mut message = Vec::new();
    let mut answer = Writer::default();
    locked(&serving.lane).receive(&mut message, usize::MAX, &mut || true).ok()?;
    let mut tasks = load(&mut Reader(&message))?;
    // What says that it is loaded.
    answer.u32(DONE);
    loop {
        {
            let lane = locked(&serving.lane);
            lane.send(&answer.0, &mut || true).ok()?;
            lane.receive(&mut message, usize::MAX, &mut || true).ok()?;
        }
        answer.0.clear();
        let mut from = Reader(&message);
        match from.u32()? {
            TASK => tasks.run(serving, &mut from, &mut answer)?,
            QUIT => return Some(()),
            _ => return None,
        }
    }
}

fn note_signals(serving: &'static Serving) {
    let inputs = serving.arena.inputs();
    rights::INPUTS[0].store(inputs.start, Ordering::Relaxed);
    rights::INPUTS[1].store(inputs.end, Ordering::Relaxed);
    rights::note_signals(serving.control);
}

fn load(from: &mut Reader) -> Option<Tasks> {
    if from.u32()? != LOAD {
        return None;
    }
    let manifest: Manifest = ron::from_str(from.text()?).ok()?;
    let folder = PathBuf::from(from.text()?);
    let writable = from.list(|from| from.text().map(PathBuf::from))?;
    let most = from.u64()?;
    rights::limit_memory(most);
    rights::give_up(&writable);
    let types = manifest.plugin.values.iter().chain(manifest.plugin.nodes.iter().filter_map(|node| node.state.as_ref()));
    let names = types.flat_map(|ty| ty.arrays.iter().map(|array| intern(&array.name))).chain(["values", "value"]).collect();
    Some(Tasks { plugin: InProcess::new(Arc::new(manifest), folder, true), names, settings: BTreeMap::new() })
}

struct Tasks {
    plugin: InProcess,
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
        let (what, node, id) = (from.u32()?, from.u32()?, from.u64()?);
        if let Some(new) = message::read_option(from, message::read_settings)? {
            self.settings.insert(id, new);
        }
        let settings = self.settings.get(&id)?.clone();
        let frame = from.i64()?;
        let clock = message::read_clock(from)?;
        let mut sheet = serving.sheets.take(from.0.len())?;
        let ports = from.list(|from| read_port(serving, &mut sheet, from))?;
        let state = message::read_option(from, |from| read_value(serving, &mut sheet, from))?;
        sheet.seal();
        rights::INPUTS[2].store(sheet.range().start, Ordering::Relaxed);
        rights::INPUTS[3].store(sheet.range().end, Ordering::Relaxed);
        let control = serving.control;
        let cancel = Cancel::asking(move || control.cancel.load(Ordering::Relaxed) != 0);
        let request = Request { node, settings: &settings, frame, clock: &clock, ports, state, cancel: &cancel, names: &self.names };
        serving.runs.store(true, Ordering::SeqCst);
        let result = if what == NEEDS { self.plugin.needs(&request) } else { self.plugin.compute(&request) };
        serving.runs.store(false, Ordering::SeqCst);
        drop(request);
        serving.answer(result, answer);
        serving.sheets.put(sheet);
        Some(())
    }
}

impl Serving {
    /// Asks the host something; `None` while it does not listen, or where the answer cannot be read.
    fn ask<R>(&self, ask: impl FnOnce(&mut Writer), read: impl FnOnce(&mut Reader) -> Option<R>) -> Option<R> {
        if !self.runs.load(Ordering::SeqCst) {
            return None;
        }
        let lane = locked(&self.lane);
        let mut message = Writer::default();
        ask(&mut message);
        let mut answer = Vec::new();
        let exchanged: Result<(), Broken> =
            lane.send(&message.0, &mut || true).and_then(|()| lane.receive(&mut answer, usize::MAX, &mut || true));
        exchanged.ok()?;
        read(&mut Reader(&answer))
    }

    /// Writes what a task gave.
    fn answer(&self, result: Result<Response, NodeError>, to: &mut Writer) {
        let mut made = Writer::default();
        match &result {
            Ok(response) => self.write_made(response, &mut made),
            Err(error) => message::write_error(&mut made, error),
        }
        to.u32(if result.is_ok() { DONE } else { FAILED });
        // What was put out is the host's again, and not to be given back.
        drop(result);
        let mut released = Vec::new();
        locked(&self.lent).retain(|(id, value)| {
            let is_held = Arc::strong_count(value) > 1;
            if !is_held {
                released.push(*id);
            }
            is_held
        });
        to.list(&released, |to, id| to.u64(*id));
        to.list(&std::mem::take(&mut locked(&self.blocks).1), |to, at| to.u64(*at));
        to.0.extend(made.0);
    }

    fn write_made(&self, response: &Response, to: &mut Writer) {
        to.list(&response.needs, |to, (input, frame)| {
            to.u32(*input);
            to.i64(*frame);
        });
        message::write_option(to, response.previous.as_ref(), |to, frame| to.i64(*frame));
        to.list(&response.made, |to, made| {
            to.u32(made.output);
            to.u64(made.index);
            match &made.what {
                MadeOf::Parts(parts) => {
                    to.u32(message::PARTS);
                    let meta = if parts.meta.is_empty() { String::new() } else { serde_json::to_string(&parts.meta).unwrap_or_default() };
                    to.text(&meta);
                    to.list(&parts.arrays, |to, (name, array)| self.write_array(name, array, to));
                }
                MadeOf::Passed(value) => {
                    let lent = locked(&self.lent);
                    let id = lent.iter().find(|(_, known)| Arc::ptr_eq(known, value)).map_or(u64::MAX, |(id, _)| *id);
                    to.u32(message::PASSED);
                    to.u64(id);
                }
            }
        });
    }

    fn write_array(&self, name: &str, array: &Array, to: &mut Writer) {
        to.text(name);
        message::write_dtype(to, array.dtype());
        message::write_shape(to, &array.shape);
        let bytes = array.data.bytes();
        let block = matches!(array.data, Data::Shared(_)).then(|| self.arena.output_at(bytes)).flatten();
        match block {
            Some(at) if locked(&self.blocks).0.remove(&at) => {
                to.u32(message::THERE);
                to.u64(at);
            }
            _ => {
                to.u32(message::HERE);
                to.bytes(bytes);
            }
        }
    }
}

impl Outside for Serving {
    fn lies_here(&self, bytes: usize) -> bool {
        bytes < LARGE || !self.runs.load(Ordering::SeqCst)
    }

    fn block(&self, dtype: DType, count: usize) -> Option<(Data, *mut u8)> {
        let bytes = count.checked_mul(dtype.size())?;
        let ask = |to: &mut Writer| {
            to.u32(ALLOC);
            message::write_dtype(to, dtype);
            to.u64(count as u64);
        };
        let at = self.ask(ask, |from| message::read_option(from, Reader::u64))??;
        let start = self.arena.output(at, bytes)?;
        locked(&self.blocks).0.insert(at);
        let block = Block { serving: SERVING.get()?, at, start: start as usize, bytes };
        Some((Data::Shared(Shared::new(dtype, Arc::new(block))?), start))
    }

    fn log(&self, level: u32, message: &str) {
        let ask = |to: &mut Writer| {
            to.u32(LOG);
            to.u32(level);
            to.text(message);
        };
        self.ask(ask, |_| Some(()));
    }

    fn progress(&self, _done: f64) {
        self.control.beats.fetch_add(1, Ordering::Relaxed);
    }
}

/// A block of the host's that is written here.
struct Block {
    serving: &'static Serving,
    at: u64,
    start: usize,
    bytes: usize,
}

impl Bytes for Block {
    #[allow(unsafe_code, reason = "the host gave this memory, for as long as this process has the block")]
    fn bytes(&self) -> &[u8] {
        // SAFETY: it is mapped, as long as it says, and stays so.
        unsafe { std::slice::from_raw_parts(self.start as *const u8, self.bytes) }
    }
}

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

fn read_port(serving: &'static Serving, sheet: &mut Sheet, from: &mut Reader) -> Option<Port> {
    let input = from.u32()?;
    let clock = message::read_option(from, message::read_clock)?.map(Arc::new);
    let feed = match from.u32()? {
        message::VALUE => Feed::Value(read_value(serving, sheet, from)?),
        message::FRAMES => Feed::Frames(from.list(|from| Some((from.i64()?, read_value(serving, sheet, from)?)))?),
        message::SEQUENCE => {
            let sequence = Sequence { serving, port: from.u32()?, len: from.size()? };
            Feed::Sequence(SequenceRef::new(clock.clone(), sequence))
        }
        message::NUMBER => Feed::Number(from.f64()?),
        _ => return None,
    };
    Some(Port { input, feed, clock })
}

fn read_value(serving: &Serving, sheet: &mut Sheet, from: &mut Reader) -> Option<ValueRef> {
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
            message::THERE => {
                let (at, length) = (from.u64()?, from.size()?);
                Arc::new(serving.arena.input(at, length)?)
            }
            _ => return None,
        };
        Some((name, Array { shape, data: Data::Shared(Shared::new(dtype, bytes)?) }))
    })?;
    let value: ValueRef = Arc::new(Lent { name, arrays, meta });
    locked(&serving.lent).push((id, value.clone()));
    Some(value)
}

/// A sequence of the host's, fetched value by value.
struct Sequence {
    serving: &'static Serving,
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
        let read = |from: &mut Reader| {
            Some(match from.u32()? {
                1 => {
                    let mut sheet = self.serving.sheets.take(from.0.len())?;
                    let value = read_value(self.serving, &mut sheet, from)?;
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
