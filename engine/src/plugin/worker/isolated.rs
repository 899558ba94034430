//! Calls of a plugin that runs in workers.
//!
//! A task takes a worker that is idle, or starts one, and gives it back. One whose worker ends is tried again in a new one, unless it had that to itself
//! from the beginning, or hung: what an earlier task broke or leaked is not laid at the door of a later one.

use std::collections::BTreeSet;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::ExitStatus;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::Workers;
#[cfg(target_os = "linux")]
use super::arena;
use super::message::{self, COMPUTE, DONE, FAILED, FETCH, LARGE, LOAD, LOG, NEEDS, TASK};
use super::notes::{Near, STATE_INPUT};
use super::process::{End, Loan, Patience, Process};
use super::wire::{Along, Reader, Writer};
use crate::array::{Array, DType, Data};
use crate::node::{Fault, NodeError};
use crate::plugin::call::{Feed, Made, MadeOf, Port, Request, Response, Settings, Transport};
use crate::plugin::manifest::{Manifest, Threads};
use crate::plugin::suite::{elements, say};
use crate::value::{Meta, OwnedParts, ValueRef};

/// Settings that nodes of graphs have now, and how often that changed.
#[derive(Default)]
struct Living {
    ids: Mutex<BTreeSet<u64>>,
    changes: AtomicU64,
}

/// What is kept for settings: the number that workers know them by.
struct Known {
    id: u64,
    living: Arc<Living>,
}

impl Drop for Known {
    fn drop(&mut self) {
        locked(&self.living.ids).remove(&self.id);
        self.living.changes.fetch_add(1, Ordering::Relaxed);
    }
}

/// Calls in workers.
pub(in crate::plugin) struct Isolated {
    manifest: Arc<Manifest>,
    folder: PathBuf,
    /// As errors name it.
    name: String,
    workers: Workers,
    /// True where messages and arrays go over sockets.
    pipes: bool,
    idle: Mutex<Vec<Process>>,
    /// For a plugin of which one call at a time may run.
    turn: Mutex<()>,
    living: Arc<Living>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Isolated {
    pub(in crate::plugin) fn new(manifest: Arc<Manifest>, folder: PathBuf, workers: Workers) -> Self {
        let name = format!("plugin `{}` {}", manifest.plugin.name, manifest.plugin.version);
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        let (idle, turn, living) = Default::default();
        let pipes = workers.pipes || !has_shared_memory();
        Self { manifest, folder, name, workers, pipes, idle, turn, living }
    }

    fn broken(&self, why: String) -> NodeError {
        NodeError::new(Fault::Plugin, format!("{}: {why}", self.name))
    }

    fn call(&self, what: u32, request: &Request) -> Result<Response, NodeError> {
        let _turn = (self.manifest.plugin.threads == Threads::One).then(|| locked(&self.turn));
        let mut process = match self.idle().map_err(|end| self.told(&end, request))? {
            Some(process) => process,
            None => self.start(request)?,
        };
        loop {
            match self.task(&mut process, what, request) {
                Ok(result) => {
                    process.tasks += 1;
                    locked(&self.idle).push(process);
                    return result;
                }
                Err(end) => {
                    process.kill();
                    let is_own = process.tasks == 0 || is_late(&end) || matches!(end, End::Hung(_) | End::Stopped);
                    if is_own || request.cancel.is_cancelled() {
                        return Err(self.told(&end, request));
                    }
                    process = self.start(request)?;
                }
            }
        }
    }

    /// A worker that nobody uses: the one that was used last, as what it looks at is nearest. What ended meanwhile is let go of.
    ///
    /// # Errors
    /// Where one of those wrote to what it had put out: what that was made into is not to be trusted.
    fn idle(&self) -> Result<Option<Process>, End> {
        let mut ended = Vec::new();
        let mut idle = locked(&self.idle);
        let mut found = None;
        while let (None, Some(process)) = (&found, idle.pop()) {
            if process.is_alive() {
                found = Some(process);
            } else {
                ended.push(process);
            }
        }
        // Those that ended are waited for by nobody who waits for this.
        drop(idle);
        let mut ends = ended.iter().map(|process| process.end(self.workers.memory));
        match ends.find(is_late) {
            Some(end) => Err(end),
            None => Ok(found),
        }
    }

    fn start(&self, request: &Request) -> Result<Process, NodeError> {
        for folder in &self.workers.writable {
            // Where it cannot be made nothing can be written, which whoever writes there says.
            let _ = std::fs::create_dir_all(folder);
        }
        let mut load = Writer::default();
        load.u32(LOAD);
        load.text(&ron::to_string(&*self.manifest).map_err(|e| self.broken(e.to_string()))?);
        load.text(&self.folder.to_string_lossy());
        load.list(&self.workers.writable, |to, folder| to.text(&folder.to_string_lossy()));
        load.u64(self.workers.memory);
        let program = self.workers.program.display();
        let help = "plugins run in processes of their own; `--trust NAME` has one run in this one";
        let process = Process::start(&self.workers, self.pipes)
            .map_err(|e| self.broken(format!("expected to start a process for it, of {program}: {e}")).help(help))?;
        let mut answer = Vec::new();
        let mut patience = Patience::new(&self.workers, request.cancel, &process);
        match process.exchange(&load, &mut answer, &mut patience) {
            Ok(()) if Reader(&answer).u32() == Some(DONE) => Ok(process),
            Ok(()) => Err(self.broken(format!("expected {program} to serve plugins, found another program")).help(help)),
            Err(End::Stopped) => Err(NodeError::stopped()),
            Err(end) => Err(self.broken(format!("expected {program} to serve plugins; {}", what_happened(&end))).help(help)),
        }
    }

    /// Runs a task in a worker.
    fn task(&self, process: &mut Process, what: u32, request: &Request) -> Result<Result<Response, NodeError>, End> {
        // Both are kept from task to task.
        let (mut message, mut answer) = std::mem::take(&mut process.buffers);
        message.clear();
        process.task = process.task.wrapping_add(1).max(1);
        self.write_task(process, what, request, &mut message);
        let mut patience = Patience::new(&self.workers, request.cancel, process);
        loop {
            process.exchange(&message, &mut answer, &mut patience)?;
            patience.renew();
            let mut from = Reader(&answer);
            message.clear();
            match from.u32() {
                Some(DONE | FAILED) => {
                    let result = read_end(process, &answer, &mut patience)?.ok_or(End::Garbage)?;
                    process.buffers = (message, answer);
                    return Ok(result);
                }
                #[cfg(target_os = "linux")]
                Some(message::ALLOC) => self.alloc(process, &mut from, &mut message),
                Some(FETCH) => fetch(process, request, &mut from, &mut message),
                Some(LOG) => self.log(request.frame, &mut from),
                _ => None,
            }
            .ok_or(End::Garbage)?;
        }
    }

    fn write_task(&self, process: &mut Process, what: u32, request: &Request, to: &mut Writer) {
        to.u32(TASK);
        let gone: Vec<u64> = match self.living.changes.load(Ordering::Relaxed) {
            0 => Vec::new(),
            _ => process.settings.difference(&locked(&self.living.ids)).copied().collect(),
        };
        to.list(&gone, |to, id| to.u64(*id));
        process.settings.retain(|id| !gone.contains(id));
        let id = self.id_of(request.settings);
        to.u32(process.task);
        to.u32(what);
        to.u32(request.node);
        to.u64(id);
        let unknown = process.settings.insert(id).then_some(&**request.settings);
        message::write_option(to, unknown, |to, settings: &Settings| message::write_settings(to, settings));
        to.i64(request.frame);
        message::write_clock(to, request.clock);
        let mut place = 0;
        to.list(&request.ports, |to, port| {
            write_port(process, port, place, to);
            place += 1;
        });
        message::write_option(to, request.state.as_ref(), |to, state| write_value(process, state, to));
    }

    fn id_of(&self, settings: &Settings) -> u64 {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let known = settings.kept.get_or_init(|| {
            let id = NEXT.fetch_add(1, Ordering::Relaxed);
            locked(&self.living.ids).insert(id);
            Box::new(Known { id, living: self.living.clone() })
        });
        known.downcast_ref::<Known>().map_or(u64::MAX, |known| known.id)
    }

    #[cfg(target_os = "linux")]
    /// Gives memory for an output, as far as the limit goes.
    fn alloc(&self, process: &mut Process, from: &mut Reader, to: &mut Writer) -> Option<()> {
        let (dtype, count) = (message::read_dtype(from)?, from.size()?);
        let has: u64 = process.blocks.values().map(|block| block.bytes().len() as u64).sum();
        let bytes = (count as u64).saturating_mul(dtype.size() as u64).saturating_add(has);
        let block = (bytes <= self.workers.memory).then(|| arena::output(dtype, count)).flatten();
        let at = block.map(|(data, at)| {
            process.blocks.insert(at, data);
            at
        });
        message::write_option(to, at.as_ref(), |to, at| to.u64(*at));
        Some(())
    }

    fn log(&self, frame: i64, from: &mut Reader) -> Option<()> {
        let level = from.u32()?;
        say(&self.name, frame, level, from.text()?);
        Some(())
    }

    fn told(&self, end: &End, request: &Request) -> NodeError {
        if matches!(end, End::Stopped) {
            return NodeError::stopped();
        }
        let fault = match end {
            End::Hung(_) => Fault::PluginHang,
            End::Memory(_) | End::Ended { near: Near::Refused, .. } => Fault::PluginMemory,
            End::Ended { near: Near::Input(_) | Near::Late(..), .. } | End::Garbage | End::Closed | End::Stopped => Fault::Plugin,
            End::Ended { .. } => Fault::PluginCrash,
        };
        let error = NodeError { fault, ..self.broken(self.what_happened(end, request)) };
        match end {
            End::Hung(_) => error
                .help("`--plugin-timeout SECONDS` has it wait longer; the plugin may tell of its progress, which counts as a sign of life"),
            End::Memory(_) | End::Ended { near: Near::Refused, .. } => error.help("`--plugin-memory SIZE` lets it take more"),
            _ => {
                let most = size(self.workers.memory);
                error.help(format!(
                    "this is a fault of the plugin's code, unless it needs more than {most} of memory (--plugin-memory): please tell its makers, with the graph and the inputs"
                ))
            }
        }
    }

    /// What a process gave in place of an answer.
    fn what_happened(&self, end: &End, request: &Request) -> String {
        let node = |node: u32| self.manifest.plugin.nodes.get(node as usize);
        match end {
            End::Ended { near: Near::Input(which), signal, .. } => {
                let input = which.and_then(|i| node(request.node)?.inputs.get(i as usize)).map(|input| format!("input `{}`", input.name));
                let what = match which {
                    Some(STATE_INPUT) => "its state".to_owned(),
                    _ => input.unwrap_or_else(|| "inputs".to_owned()),
                };
                format!("expected {what} to be left as it is, found it written to ({} in its process)", signal_name(*signal as i32))
            }
            End::Ended { near: Near::Refused, status, .. } => {
                let (most, ended) = (size(self.workers.memory), status.map_or_else(|| "ended".to_owned(), ended));
                format!("expected its process to take at most {most} of memory, found it asking for more, and going on without: it {ended}")
            }
            End::Ended { near: Near::Late(which, frame), signal, .. } => {
                let node = node(*which).map_or("?", |node| node.id.as_str());
                let signal = signal_name(*signal as i32);
                format!(
                    "expected what `{node}` made at frame {frame} to be left as it was put out, found it written to later ({signal} in its process)"
                )
            }
            _ => what_happened(end),
        }
    }
}

impl Transport for Isolated {
    fn compute(&self, request: &Request) -> Result<Response, NodeError> {
        self.call(COMPUTE, request)
    }

    fn needs(&self, request: &Request) -> Result<Response, NodeError> {
        self.call(NEEDS, request)
    }
}

/// True where a worker was ended by a write to what it had put out before.
fn is_late(end: &End) -> bool {
    matches!(end, End::Ended { near: Near::Late(..), .. })
}

/// What to do where a worker was refused memory.
pub(super) fn memory_help(most: u64) -> String {
    format!("the plugin's process may take {} of memory: `--plugin-memory SIZE` lets it take more", size(most))
}

/// `512 MiB`.
fn size(bytes: u64) -> String {
    match bytes {
        0..0x4000_0000 => format!("{} MiB", bytes >> 20),
        _ => format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30)),
    }
}

fn what_happened(end: &End) -> String {
    match end {
        End::Ended { status, signal, address, .. } => {
            let at = if *signal == libc::SIGSEGV as u32 || *signal == libc::SIGBUS as u32 {
                format!(" at address {address:#x}")
            } else {
                String::new()
            };
            format!("its process {}{at}", status.map_or_else(|| "ended".to_owned(), ended))
        }
        End::Garbage => "expected an answer of its process, found what is none: it wrote where it must not".to_owned(),
        End::Hung(time) => format!("expected a sign of life within {} s, found none: its process was ended", time.as_secs_f64()),
        End::Memory(most) => format!("expected its process to take at most {} of memory, found more: it was ended", size(*most)),
        End::Closed => "expected its process to stay in touch, found it closing what leads to its host: it was ended".to_owned(),
        End::Stopped => "cancelled".to_owned(),
    }
}

fn ended(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) => format!("was ended by {}", signal_name(signal)),
        (None, Some(code)) => format!("ended itself with exit code {code}"),
        (None, None) => "ended".to_owned(),
    }
}

fn signal_name(signal: i32) -> String {
    let known = match signal {
        libc::SIGSEGV => "SIGSEGV (memory that is not there or not its own)",
        libc::SIGBUS => "SIGBUS (memory that is not there)",
        libc::SIGABRT => "SIGABRT (it gave up)",
        libc::SIGFPE => "SIGFPE (a division by nought)",
        libc::SIGILL => "SIGILL (an instruction that is none, or not of this processor)",
        libc::SIGKILL => "SIGKILL (by somebody else, as the system where memory runs out)",
        libc::SIGTERM => "SIGTERM",
        libc::SIGPIPE => "SIGPIPE",
        _ => return format!("signal {signal}"),
    };
    known.to_owned()
}

fn write_port(process: &mut Process, port: &Port, place: u32, to: &mut Writer) {
    to.u32(port.input);
    message::write_option(to, port.clock.as_deref(), message::write_clock);
    match &port.feed {
        Feed::Value(value) => {
            to.u32(message::VALUE);
            write_value(process, value, to);
        }
        Feed::Frames(values) => {
            to.u32(message::FRAMES);
            to.list(values, |to, (frame, value)| {
                to.i64(*frame);
                write_value(process, value, to);
            });
        }
        Feed::Sequence(values) => {
            to.u32(message::SEQUENCE);
            to.u32(place);
            to.u64(values.len() as u64);
        }
        Feed::Number(number) => {
            to.u32(message::NUMBER);
            to.f64(*number);
        }
    }
}

/// Lends a value: what lies in the memory that is shared is told of, and what does not is copied there.
fn write_value(process: &mut Process, value: &ValueRef, to: &mut Writer) {
    let id = process.next;
    process.next += 1;
    let parts = value.parts();
    #[allow(unused_mut, reason = "there are none where all goes over sockets")]
    let mut copies = Vec::new();
    let mut at = 0;
    to.u64(id);
    to.text(value.type_name());
    let meta = if parts.meta.is_empty() { String::new() } else { serde_json::Value::Object(parts.meta).to_string() };
    to.text(&meta);
    to.list(&parts.arrays, |to, (name, view)| {
        to.text(name);
        message::write_dtype(to, view.dtype);
        message::write_shape(to, &view.shape);
        if process.link.is_piped() {
            if view.bytes.len() >= LARGE {
                to.u32(message::ALONG);
                to.u64(view.bytes.len() as u64);
                to.along.push(Along::Of(value.clone(), at));
            } else {
                to.u32(message::HERE);
                to.bytes(view.bytes);
            }
            at += 1;
            return;
        }
        #[cfg(target_os = "linux")]
        write_shared(view.bytes, to, &mut process.small, &mut copies);
    });
    process.lent.insert(id, Loan { value: value.clone(), _copies: copies });
}

/// Bytes that lie in the memory that is shared, or are copied there, or go along where there is none left.
#[cfg(target_os = "linux")]
fn write_shared(bytes: &[u8], to: &mut Writer, small: &mut arena::Packed, copies: &mut Vec<Arc<dyn crate::array::Bytes>>) {
    let there = arena::offset(bytes.as_ptr(), bytes.len()).or_else(|| {
        let (copy, at) = if bytes.len() < LARGE { small.copy(bytes) } else { arena::copy(bytes) }?;
        copies.push(copy);
        Some(at)
    });
    match there.filter(|_| !bytes.is_empty()) {
        Some(at) => {
            to.u32(message::THERE);
            to.u64(at);
            to.u64(bytes.len() as u64);
        }
        None => {
            to.u32(message::HERE);
            to.bytes(bytes);
        }
    }
}

#[cfg(target_os = "linux")]
fn has_shared_memory() -> bool {
    arena::start()
}

#[cfg(not(target_os = "linux"))]
fn has_shared_memory() -> bool {
    false
}

fn fetch(process: &mut Process, request: &Request, from: &mut Reader, to: &mut Writer) -> Option<()> {
    let (port, index) = (from.u32()?, from.size()?);
    let Feed::Sequence(values) = &request.ports.get(port as usize)?.feed else { return None };
    match values.get(index) {
        Ok(value) => {
            to.u32(1);
            write_value(process, &value, to);
        }
        Err(error) => {
            to.u32(0);
            message::write_error(to, &error);
        }
    }
    Some(())
}

/// What came of a task; `None` where it cannot be read.
fn read_end(process: &mut Process, answer: &[u8], patience: &mut Patience) -> Result<Option<Result<Response, NodeError>>, End> {
    let mut end = None;
    let read = (|| {
        let mut from = Reader(answer);
        let is_done = from.u32()? == DONE;
        let mut left = patience.most();
        let mut fill = |process: &Process, dtype: DType, bytes: usize| {
            // A worker can put out no more than it may have.
            left = left.checked_sub(bytes as u64)?;
            let mut data = Data::zeroed(dtype, bytes / dtype.size())?;
            process.read(elements(&mut data), patience).map_err(|e| end = Some(e)).ok().map(|()| data)
        };
        let result = if is_done { Ok(read_response(process, &mut from, &mut fill)?) } else { Err(message::read_error(&mut from)?) };
        let (released, freed) = (from.list(Reader::u64)?, from.list(Reader::u64)?);
        released.iter().for_each(|id| drop(process.lent.remove(id)));
        freed.iter().for_each(|at| drop(process.blocks.remove(at)));
        Some(result)
    })();
    end.map_or(Ok(read), Err)
}

/// Reads an array of so many bytes, which goes behind the answer.
type Fill<'a> = dyn FnMut(&Process, DType, usize) -> Option<Data> + 'a;

fn read_response(process: &mut Process, from: &mut Reader, fill: &mut Fill) -> Option<Response> {
    let needs = from.list(|from| Some((from.u32()?, from.i64()?)))?;
    let previous = message::read_option(from, Reader::i64)?;
    let made = from.list(|from| {
        let (output, index) = (from.u32()?, from.u64()?);
        let what = match from.u32()? {
            message::PARTS => MadeOf::Parts(read_parts(process, from, fill)?),
            message::PASSED => MadeOf::Passed(process.lent.get(&from.u64()?)?.value.clone()),
            _ => return None,
        };
        Some(Made { output, index, what })
    })?;
    Some(Response { made, needs, previous })
}

fn read_parts(process: &mut Process, from: &mut Reader, fill: &mut Fill) -> Option<OwnedParts> {
    let meta = match from.text()? {
        "" => Meta::default(),
        text => serde_json::from_str(text).ok()?,
    };
    let arrays = from.list(|from| {
        let name = from.text()?.to_owned().into();
        let dtype = message::read_dtype(from)?;
        let shape = message::read_shape(from)?;
        let bytes = message::bytes_of(dtype, &shape)?;
        let data: Data = match from.u32()? {
            message::HERE => Data::copied(dtype, from.bytes()?)?,
            message::THERE => process.blocks.remove(&from.u64()?)?,
            message::ALONG if from.size()? == bytes => fill(process, dtype, bytes)?,
            _ => return None,
        };
        let fits = data.dtype() == dtype && bytes == data.bytes().len();
        fits.then_some((name, Array { shape, data }))
    })?;
    Some(OwnedParts { arrays, meta })
}
