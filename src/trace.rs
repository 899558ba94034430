//! `pegbar run --trace`: when each task ran and on which thread, in Chrome's trace format, for ui.perfetto.dev and chrome://tracing.
//!
//! **Source**: Trace Event Format (Google, 2016), the form of a JSON object. Times are microseconds from the start of the run.

use std::io::{self, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use pegbar_engine::atomic::{self, WriteError};
use pegbar_engine::exec::{Done, Observer};
use pegbar_engine::graph::Graph;
use pegbar_engine::plan::Plan;
use serde_json::json;

/// What happened on a thread: 56 bytes, as there may be a million of them.
struct Event {
    node: u32,
    /// `None` for a node that runs once.
    frame: Option<i64>,
    /// Nanoseconds since the start of the run.
    start: u64,
    /// Nanoseconds that it took.
    time: u64,
    /// Bytes of its results.
    bytes: u64,
    live_bytes: u64,
}

/// Aligned so that threads do not share a cache line.
#[derive(Default)]
#[repr(align(128))]
struct Lane(Mutex<Vec<Event>>);

/// Remembers what happened, each thread for itself, until it is written.
pub(crate) struct Trace {
    start: Instant,
    lanes: Vec<Lane>,
    /// Name and type of each node.
    nodes: Mutex<Vec<(String, &'static str)>>,
}

impl Observer for Trace {
    fn planned(&self, graph: &Graph, _plan: &Plan) {
        *lock(&self.nodes) = graph.nodes.iter().map(|n| (n.name.clone(), n.ty.schema.id)).collect();
    }

    fn done(&self, done: &Done) {
        let event = Event {
            node: done.node as u32,
            frame: done.frame,
            start: nanos(done.start.saturating_duration_since(self.start)),
            time: nanos(done.time),
            bytes: done.bytes,
            live_bytes: done.live_bytes,
        };
        self.put(done.thread, event);
    }
}

fn nanos(time: std::time::Duration) -> u64 {
    time.as_nanos() as u64
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Trace {
    /// A trace of a run on `threads` threads, which starts now.
    pub(crate) fn new(threads: usize) -> Self {
        Self { start: Instant::now(), lanes: (0..threads).map(|_| Lane::default()).collect(), nodes: Mutex::default() }
    }

    /// Remembers an event of a thread. Other kinds of events than tasks would come in here.
    fn put(&self, thread: usize, event: Event) {
        if let Some(lane) = self.lanes.get(thread) {
            lock(&lane.0).push(event);
        }
    }

    /// Writes what happened so far.
    pub(crate) fn write(&self, path: &Path) -> Result<(), WriteError<io::Error>> {
        let nodes = lock(&self.nodes);
        // Each name is escaped once.
        let heads: Vec<(String, String)> = nodes.iter().map(|(name, ty)| (quoted(name), quoted(ty))).collect();
        atomic::write(path, |out| {
            writeln!(out, "{{\"displayTimeUnit\":\"ms\",\"traceEvents\":[")?;
            write!(out, "{}", named("process_name", 0, "pegbar"))?;
            for (thread, lane) in self.lanes.iter().enumerate() {
                write!(out, ",\n{}", named("thread_name", thread, &format!("thread {thread}")))?;
                lock(&lane.0).iter().try_for_each(|event| event.write(thread, &heads, out))?;
            }
            writeln!(out, "\n]}}")
        })
    }
}

impl Event {
    fn write(&self, thread: usize, heads: &[(String, String)], out: &mut impl Write) -> io::Result<()> {
        let Some((name, ty)) = heads.get(self.node as usize) else { return Ok(()) };
        // The name is a JSON text already, so that the frame goes in before its closing quote.
        let open = name.strip_suffix('"').unwrap_or(name);
        let (at, frame) = self.frame.map_or((String::new(), String::new()), |f| (format!("@{f}"), format!("\"frame\":{f},")));
        let (start, time, end) = (Micros(self.start), Micros(self.time), Micros(self.start + self.time));
        write!(
            out,
            ",\n{{\"name\":{open}{at}\",\"cat\":{ty},\"ph\":\"X\",\"pid\":1,\"tid\":{thread},\"ts\":{start},\"dur\":{time},\"args\":{{{frame}\"bytes\":{}}}}}",
            self.bytes
        )?;
        write!(
            out,
            ",\n{{\"name\":\"live bytes\",\"ph\":\"C\",\"pid\":1,\"tid\":{thread},\"ts\":{end},\"args\":{{\"bytes\":{}}}}}",
            self.live_bytes
        )
    }
}

/// Nanoseconds, shown as microseconds to the last digit.
struct Micros(u64);

impl std::fmt::Display for Micros {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{:03}", self.0 / 1000, self.0 % 1000)
    }
}

fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

fn named(what: &str, thread: usize, name: &str) -> String {
    json!({"name": what, "ph": "M", "pid": 1, "tid": thread, "args": {"name": name}}).to_string()
}
