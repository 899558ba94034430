//! A worker as its host sees it: a process that is started, asked, watched and ended.

use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::arena::{self, Attached};
use super::lane::{Broken, Lane};
use super::{ARGUMENT, Workers, fail};
use crate::array::{Bytes, Data};
use crate::node::Cancel;
use crate::value::ValueRef;

/// How long a worker may take to end by itself once it is asked to.
const FAREWELL: Duration = Duration::from_millis(500);
/// How long a task may go on once the run is cancelled.
const CANCELLED: Duration = Duration::from_secs(2);

/// What the one who waits for a process shares with those who use it.
struct Watch {
    pid: libc::pid_t,
    is_dead: AtomicBool,
    ended: Mutex<Option<ExitStatus>>,
    ends: Condvar,
    lane: Arc<Lane>,
}

impl Watch {
    /// Waits for the process, whose parent this thread is, and so must stay for as long as it runs.
    fn wait(&self, child: &mut std::process::Child) {
        // SAFETY: the struct is ours; the process stays known by its number until it is reaped below.
        unsafe {
            let mut info: libc::siginfo_t = std::mem::zeroed();
            while libc::waitid(libc::P_PID, self.pid as libc::id_t, &raw mut info, libc::WEXITED | libc::WNOWAIT) != 0
                && fail().kind() == std::io::ErrorKind::Interrupted
            {}
        }
        let mut ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        // What the plugin started goes with it. The number is still the process's.
        self.signal();
        *ended = Some(child.wait().unwrap_or_else(|_| ExitStatus::from_raw(0)));
        self.is_dead.store(true, Ordering::SeqCst);
        self.lane.wake_host();
        self.ends.notify_all();
    }

    fn signal(&self) {
        // SAFETY: the number is that of a process which is not reaped, and of its group.
        unsafe {
            libc::kill(-self.pid, libc::SIGKILL);
            libc::kill(self.pid, libc::SIGKILL);
        }
    }

    fn kill(&self) {
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        if ended.is_none() {
            self.signal();
        }
    }

    fn ended(&self, within: Duration) -> Option<ExitStatus> {
        let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
        let (ended, _) = self.ends.wait_timeout_while(ended, within, |e| e.is_none()).unwrap_or_else(PoisonError::into_inner);
        *ended
    }
}

/// Why a process gave no answer.
#[derive(Debug)]
pub(super) enum End {
    /// It ended.
    Ended { status: Option<ExitStatus>, signal: u32, address: u64, is_input: bool },
    /// What it said is no message.
    Garbage,
    /// It gave no sign of life for so long.
    Hung(Duration),
    /// It took more memory than that.
    Memory(u64),
    /// It went on after the run was cancelled.
    Stopped,
}

/// What was lent to a worker: a value, and copies of its arrays where it does not lie in the memory that is shared.
pub(super) struct Loan {
    pub(super) value: ValueRef,
    /// Held, and looked at there.
    pub(super) _copies: Vec<Arc<dyn Bytes>>,
}

/// A worker.
pub(super) struct Process {
    lane: Arc<Lane>,
    watch: Arc<Watch>,
    thread: Option<std::thread::JoinHandle<()>>,
    /// Tasks that it has done.
    pub(super) tasks: u64,
    /// Settings that it knows.
    pub(super) settings: BTreeSet<u64>,
    /// What it may still be looking at, by number.
    pub(super) lent: BTreeMap<u64, Loan>,
    pub(super) next: u64,
    /// Memory that it has for outputs, by where it lies.
    pub(super) blocks: BTreeMap<u64, Data>,
}

impl Process {
    pub(super) fn start(workers: &Workers) -> std::io::Result<Self> {
        let (lane, file) = Lane::new()?;
        let arrays = arena::file()?;
        let mut command = Command::new(&workers.program);
        // The two files come as its input and output, which it moves elsewhere.
        command.args([ARGUMENT, &std::process::id().to_string()]).stdin(file).stdout(Stdio::from(arrays)).process_group(0);
        let lane = Arc::new(lane);
        let (to, from) = std::sync::mpsc::sync_channel(1);
        let shared = lane.clone();
        // A process that is to end with its parent ends with the thread that started it.
        let thread = std::thread::Builder::new().name("plugin".to_owned()).stack_size(1 << 18).spawn(move || {
            let mut child = match command.spawn() {
                Ok(child) => child,
                Err(error) => return drop(to.send(Err(error))),
            };
            // Its files are not held open here.
            drop(command);
            let pid = libc::pid_t::try_from(child.id()).unwrap_or(-1);
            let watch =
                Arc::new(Watch { pid, is_dead: AtomicBool::new(false), ended: Mutex::default(), ends: Condvar::new(), lane: shared });
            drop(to.send(Ok(watch.clone())));
            watch.wait(&mut child);
        })?;
        let watch = from.recv().unwrap_or_else(|_| Err(std::io::Error::other("the thread that starts it ended")))?;
        let (settings, lent, blocks) = Default::default();
        Ok(Self { lane, watch, thread: Some(thread), tasks: 0, settings, lent, next: 0, blocks })
    }

    pub(super) fn is_alive(&self) -> bool {
        !self.watch.is_dead.load(Ordering::SeqCst)
    }

    /// Sends a message and receives the answer.
    pub(super) fn exchange(&self, message: &[u8], answer: &mut Vec<u8>, patience: &mut Patience) -> Result<(), End> {
        let most = usize::try_from(patience.workers.memory).unwrap_or(usize::MAX);
        let mut wait = || patience.waits(self);
        let exchanged = self.lane.send(message, &mut wait).and_then(|()| self.lane.receive(answer, most, &mut wait));
        match exchanged {
            _ if !self.is_alive() => Err(self.end(patience.workers.memory)),
            Ok(()) => Ok(()),
            Err(Broken::Garbage) => {
                self.watch.kill();
                Err(End::Garbage)
            }
            Err(Broken::GivenUp) => {
                self.watch.kill();
                Err(patience.why.take().unwrap_or(End::Garbage))
            }
        }
    }

    /// Ends it.
    pub(super) fn kill(&self) {
        self.watch.kill();
    }

    fn end(&self, most: u64) -> End {
        let control = self.lane.control();
        if control.near.load(Ordering::Relaxed) == 2 {
            return End::Memory(most);
        }
        let status = self.watch.ended(FAREWELL);
        End::Ended {
            status,
            signal: control.signal.load(Ordering::Acquire),
            address: control.address.load(Ordering::Relaxed),
            is_input: control.near.load(Ordering::Relaxed) == 1,
        }
    }

    /// Bytes of memory that it has to itself.
    fn memory(&self) -> u64 {
        let text = std::fs::read_to_string(format!("/proc/{}/statm", self.watch.pid)).unwrap_or_default();
        let mut pages = text.split(' ').skip(1).map(|n| n.parse::<u64>().unwrap_or(0));
        let (resident, shared) = (pages.next().unwrap_or(0), pages.next().unwrap_or(0));
        let own = resident.saturating_sub(shared).saturating_mul(page());
        own.saturating_add(self.blocks.values().map(|block| block.bytes().len() as u64).sum())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.is_alive() {
            let mut quit = super::wire::Writer::default();
            quit.u32(super::message::QUIT);
            // One that is in the middle of something does not listen, and is ended.
            let asked = self.tasks > 0 && self.lane.send(&quit.0, &mut || false).is_ok();
            if !asked || self.watch.ended(FAREWELL).is_none() {
                self.watch.kill();
            }
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn page() -> u64 {
    // SAFETY: asks for a number.
    u64::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).unwrap_or(4096)
}

/// How long a task is waited for.
pub(super) struct Patience<'a> {
    workers: &'a Workers,
    cancel: &'a Cancel,
    since: Instant,
    beats: u32,
    cancelled: Option<Instant>,
    why: Option<End>,
}

impl<'a> Patience<'a> {
    pub(super) fn new(workers: &'a Workers, cancel: &'a Cancel) -> Self {
        Self { workers, cancel, since: Instant::now(), beats: 0, cancelled: None, why: None }
    }

    /// It gave a sign of life.
    pub(super) fn renew(&mut self) {
        self.since = Instant::now();
    }

    fn waits(&mut self, process: &Process) -> bool {
        if !process.is_alive() {
            return false;
        }
        let control = process.lane.control();
        let beats = control.beats.load(Ordering::Relaxed);
        if beats != self.beats {
            self.beats = beats;
            self.renew();
        }
        if self.cancel.is_cancelled() {
            control.cancel.store(1, Ordering::Relaxed);
            let since = *self.cancelled.get_or_insert_with(Instant::now);
            if since.elapsed() > CANCELLED {
                self.why = Some(End::Stopped);
                return false;
            }
        }
        if let Some(most) = self.workers.timeout.filter(|most| self.since.elapsed() > *most) {
            self.why = Some(End::Hung(most));
            return false;
        }
        if process.memory() > self.workers.memory {
            self.why = Some(End::Memory(self.workers.memory));
            return false;
        }
        true
    }
}

impl Process {
    /// Before a task: what was asked of the one before is not asked of this.
    pub(super) fn begin(&self) {
        self.lane.control().cancel.store(0, Ordering::Relaxed);
    }
}

/// The files that a worker's host handed over as its input and output, which become what a process without a terminal has.
pub(super) fn inherited() -> Option<(OwnedFd, Attached)> {
    // SAFETY: duplicates of files that are open; what comes back is ours. The input is nothing from here on, and the output goes where errors go.
    let (lane, arrays) = unsafe {
        let lane = libc::fcntl(0, libc::F_DUPFD_CLOEXEC, 3);
        let arrays = libc::fcntl(1, libc::F_DUPFD_CLOEXEC, 3);
        if lane < 0 || arrays < 0 {
            return None;
        }
        let nothing = libc::open(c"/dev/null".as_ptr(), libc::O_RDWR | libc::O_CLOEXEC);
        libc::dup2(nothing, 0);
        libc::close(nothing);
        libc::dup2(2, 1);
        (OwnedFd::from_raw_fd(lane), OwnedFd::from_raw_fd(arrays))
    };
    debug_assert!(lane.as_raw_fd() > 2);
    let arena = Attached::new(&arrays).ok()?;
    Some((lane, arena))
}
