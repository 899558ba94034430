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

use super::message::{self, ALLOC, COMPUTE, DONE, FAILED, FETCH, LARGE, LOAD, LOG, NEEDS, TASK};
use super::process::{End, Loan, Patience, Process};
use super::wire::{Reader, Writer};
use super::{Workers, arena};
use crate::array::{Array, Data};
use crate::node::{Fault, NodeError};
use crate::plugin::call::{Feed, Made, MadeOf, Port, Request, Response, Settings, Transport};
use crate::plugin::manifest::{Manifest, Threads};
use crate::plugin::suite::say;
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
    idle: Mutex<Vec<Process>>,
    /// For a plugin of which one call at a time may run.
    turn: Mutex<()>,
    living: Arc<Living>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Isolated {
    /// `None` where this system lacks what workers take.
    pub(in crate::plugin) fn new(manifest: Arc<Manifest>, folder: PathBuf, workers: Workers) -> Option<Self> {
        let name = format!("plugin `{}` {}", manifest.plugin.name, manifest.plugin.version);
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        let (idle, turn, living) = Default::default();
        arena::start().then_some(Self { manifest, folder, name, workers, idle, turn, living })
    }

    fn broken(&self, why: String) -> NodeError {
        NodeError::new(Fault::Plugin, format!("{}: {why}", self.name))
    }

    fn call(&self, what: u32, request: &Request) -> Result<Response, NodeError> {
        let _turn = (self.manifest.plugin.threads == Threads::One).then(|| locked(&self.turn));
        let mut process = match self.idle() {
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
                    let is_own = process.tasks == 0 || matches!(end, End::Hung(_) | End::Stopped);
                    if is_own || request.cancel.is_cancelled() {
                        return Err(self.told(&end));
                    }
                    process = self.start(request)?;
                }
            }
        }
    }

    /// A worker that nobody uses: the one that was used last, as what it looks at is nearest. What ended meanwhile is let go of.
    fn idle(&self) -> Option<Process> {
        let mut ended = Vec::new();
        let mut idle = locked(&self.idle);
        while let Some(process) = idle.pop() {
            if process.is_alive() {
                return Some(process);
            }
            ended.push(process);
        }
        // Those that ended are waited for by nobody who waits for this.
        drop(idle);
        None
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
        let process = Process::start(&self.workers)
            .map_err(|e| self.broken(format!("expected to start a process for it, of {program}: {e}")).help(help))?;
        let mut answer = Vec::new();
        let mut patience = Patience::new(&self.workers, request.cancel);
        match process.exchange(&load.0, &mut answer, &mut patience) {
            Ok(()) if Reader(&answer).u32() == Some(DONE) => Ok(process),
            Ok(()) => Err(self.broken(format!("expected {program} to serve plugins, found another program")).help(help)),
            Err(End::Stopped) => Err(NodeError::stopped()),
            Err(end) => Err(self.broken(format!("expected {program} to serve plugins; {}", what_happened(&end))).help(help)),
        }
    }

    /// Runs a task in a worker.
    fn task(&self, process: &mut Process, what: u32, request: &Request) -> Result<Result<Response, NodeError>, End> {
        let mut message = Writer::default();
        self.write_task(process, what, request, &mut message);
        let mut patience = Patience::new(&self.workers, request.cancel);
        let mut answer = Vec::new();
        let mut is_refused = false;
        process.begin();
        loop {
            process.exchange(&message.0, &mut answer, &mut patience)?;
            patience.renew();
            let mut from = Reader(&answer);
            message.0.clear();
            match from.u32() {
                Some(DONE | FAILED) => {
                    let result = read_end(process, &answer).ok_or(End::Garbage)?;
                    let most = size(self.workers.memory);
                    let limit = || format!("the plugin's process may take {most} of memory: `--plugin-memory SIZE` lets it take more");
                    return Ok(result.map_err(|e| if is_refused && e.help.is_none() { e.help(limit()) } else { e }));
                }
                Some(ALLOC) => self.alloc(process, &mut from, &mut message).map(|given| is_refused |= !given),
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

    /// Gives memory for an output, as far as the limit goes; false where it does not.
    fn alloc(&self, process: &mut Process, from: &mut Reader, to: &mut Writer) -> Option<bool> {
        let (dtype, count) = (message::read_dtype(from)?, from.size()?);
        let has: u64 = process.blocks.values().map(|block| block.bytes().len() as u64).sum();
        let bytes = (count as u64).saturating_mul(dtype.size() as u64).saturating_add(has);
        let block = (bytes <= self.workers.memory).then(|| arena::output(dtype, count)).flatten();
        let at = block.map(|(data, at)| {
            process.blocks.insert(at, data);
            at
        });
        message::write_option(to, at.as_ref(), |to, at| to.u64(*at));
        Some(at.is_some())
    }

    fn log(&self, frame: i64, from: &mut Reader) -> Option<()> {
        let level = from.u32()?;
        say(&self.name, frame, level, from.text()?);
        Some(())
    }

    fn told(&self, end: &End) -> NodeError {
        if matches!(end, End::Stopped) {
            return NodeError::stopped();
        }
        let error = self.broken(what_happened(end));
        match end {
            End::Hung(_) => error
                .help("`--plugin-timeout SECONDS` has it wait longer; the plugin may tell of its progress, which counts as a sign of life"),
            End::Memory(_) => error.help("`--plugin-memory SIZE` lets it take more"),
            _ => {
                let most = size(self.workers.memory);
                error.help(format!(
                    "this is a fault of the plugin's code, unless it needs more than {most} of memory (--plugin-memory): please tell its makers, with the graph and the inputs"
                ))
            }
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

/// `512 MiB`.
fn size(bytes: u64) -> String {
    match bytes {
        0..0x4000_0000 => format!("{} MiB", bytes >> 20),
        _ => format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30)),
    }
}

fn what_happened(end: &End) -> String {
    match end {
        End::Ended { is_input: true, signal, .. } => {
            format!("expected inputs to be left as they are, found one written to ({} in its process)", signal_name(*signal as i32))
        }
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

/// Lends a value: what lies in the memory that is shared is told of, what is large is copied there, and what is small goes along.
fn write_value(process: &mut Process, value: &ValueRef, to: &mut Writer) {
    let id = process.next;
    process.next += 1;
    let parts = value.parts();
    let mut copies = Vec::new();
    to.u64(id);
    to.text(value.type_name());
    let meta = if parts.meta.is_empty() { String::new() } else { serde_json::Value::Object(parts.meta).to_string() };
    to.text(&meta);
    to.list(&parts.arrays, |to, (name, view)| {
        to.text(name);
        message::write_dtype(to, view.dtype);
        message::write_shape(to, &view.shape);
        let there = arena::offset(view.bytes.as_ptr(), view.bytes.len()).or_else(|| {
            let (copy, at) = (view.bytes.len() >= LARGE).then(|| arena::copy(view.bytes)).flatten()?;
            copies.push(copy);
            Some(at)
        });
        match there.filter(|_| !view.bytes.is_empty()) {
            Some(at) => {
                to.u32(message::THERE);
                to.u64(at);
                to.u64(view.bytes.len() as u64);
            }
            None => {
                to.u32(message::HERE);
                to.bytes(view.bytes);
            }
        }
    });
    process.lent.insert(id, Loan { value: value.clone(), _copies: copies });
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
fn read_end(process: &mut Process, answer: &[u8]) -> Option<Result<Response, NodeError>> {
    let mut from = Reader(answer);
    let is_done = from.u32()? == DONE;
    let released = from.list(Reader::u64)?;
    let freed = from.list(Reader::u64)?;
    let result = if is_done { Ok(read_response(process, &mut from)?) } else { Err(message::read_error(&mut from)?) };
    released.iter().for_each(|id| drop(process.lent.remove(id)));
    freed.iter().for_each(|at| drop(process.blocks.remove(at)));
    Some(result)
}

fn read_response(process: &mut Process, from: &mut Reader) -> Option<Response> {
    let needs = from.list(|from| Some((from.u32()?, from.i64()?)))?;
    let previous = message::read_option(from, Reader::i64)?;
    let made = from.list(|from| {
        let (output, index) = (from.u32()?, from.u64()?);
        let what = match from.u32()? {
            message::PARTS => MadeOf::Parts(read_parts(process, from)?),
            message::PASSED => MadeOf::Passed(process.lent.get(&from.u64()?)?.value.clone()),
            _ => return None,
        };
        Some(Made { output, index, what })
    })?;
    Some(Response { made, needs, previous })
}

fn read_parts(process: &mut Process, from: &mut Reader) -> Option<OwnedParts> {
    let meta = match from.text()? {
        "" => Meta::default(),
        text => serde_json::from_str(text).ok()?,
    };
    let arrays = from.list(|from| {
        let name = from.text()?.to_owned().into();
        let dtype = message::read_dtype(from)?;
        let shape = message::read_shape(from)?;
        let data: Data = match from.u32()? {
            message::HERE => Data::copied(dtype, from.bytes()?)?,
            message::THERE => process.blocks.remove(&from.u64()?)?,
            _ => return None,
        };
        let fits = data.dtype() == dtype && message::bytes_of(dtype, &shape) == Some(data.bytes().len());
        fits.then_some((name, Array { shape, data }))
    })?;
    Some(OwnedParts { arrays, meta })
}
