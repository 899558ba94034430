//! The gate and the crew by themselves: jobs of a random graph in place of tasks, with numbers of bytes in place of values, so that the checker gets
//! through many more orders, and both what has to be let in and what has to be refused is known.

#[path = "../../src/exec/crew.rs"]
#[allow(dead_code)]
mod crew;
#[path = "../../src/exec/gate.rs"]
#[allow(dead_code)]
mod gate;

use shuttle::rand::Rng;

use crate::orders::orders;
use crate::sync::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Condvar, Mutex, Ordering::SeqCst, Worker, scope};
use crew::{Crew, Woken};
use gate::{Ask, Gate, Need, Pass};

const LIMIT: u64 = 12;

/// A job.
struct Job {
    /// Bytes that it needs, and bytes that it is thought to need.
    least: u64,
    guess: u64,
    /// Bytes that it asks for when it runs.
    more: u64,
    /// Bytes that it leaves behind, out of those that it needs.
    left: u64,
    /// Those that it reads.
    reads: Vec<usize>,
    /// Who waits for it.
    readers: Vec<usize>,
    /// What it waits for: those that it reads, and admission.
    pending: AtomicU32,
    runs: AtomicU32,
    refusals: AtomicU32,
    idle: Mutex<Idle>,
}

/// What a job left behind, until that is given up, and how many hold it.
#[derive(Default)]
struct Idle {
    bytes: u64,
    pins: u32,
}

/// Jobs, each after those that it reads.
fn jobs(n: usize) -> Vec<Job> {
    let mut rng = shuttle::rand::thread_rng();
    let mut jobs: Vec<Job> = Vec::new();
    for i in 0..n {
        let reads: Vec<usize> = (0..i).filter(|_| rng.gen_ratio(1, 3)).collect();
        reads.iter().for_each(|&read| jobs[read].readers.push(i));
        let least = rng.gen_range(1..LIMIT + 3);
        jobs.push(Job {
            least,
            guess: if rng.gen_range(0..2) == 0 { least } else { least + LIMIT / 2 },
            more: rng.gen_range(0..3),
            left: if rng.gen_ratio(1, 4) { 0 } else { rng.gen_range(1..5u64).min(least) },
            reads: reads.clone(),
            readers: Vec::new(),
            pending: AtomicU32::new(reads.len() as u32 + 1),
            runs: AtomicU32::new(0),
            refusals: AtomicU32::new(0),
            idle: Mutex::default(),
        });
    }
    jobs
}

struct Plant {
    jobs: Vec<Job>,
    gate: Gate<usize>,
    crew: Crew<usize>,
    next: Mutex<usize>,
    bound: usize,
    in_flight: AtomicUsize,
    open: AtomicUsize,
    ends: AtomicBool,
    /// Jobs that run before the end is called.
    last: usize,
    told: AtomicUsize,
    /// What the jobs that run have, and what lies idle.
    inside: AtomicU64,
}

struct Asking<'a> {
    plant: &'a Plant,
    job: usize,
    pins: Vec<usize>,
}

impl Ask for Asking<'_> {
    fn need(&mut self) -> Need {
        let job = &self.plant.jobs[self.job];
        let mut load = 0;
        for &read in &job.reads {
            let read_job = &self.plant.jobs[read];
            let mut idle = read_job.idle.lock().unwrap();
            if idle.bytes > 0 {
                idle.pins += 1;
                self.pins.push(read);
            } else {
                load += read_job.left;
            }
        }
        Need { bytes: job.guess + load, least: job.least + load }
    }

    fn make_room(&mut self, is_alone: bool) -> bool {
        for job in &self.plant.jobs {
            let idle = if is_alone { job.idle.lock().ok() } else { job.idle.try_lock().ok() };
            if let Some(mut idle) = idle
                && idle.bytes > 0
                && idle.pins == 0
            {
                self.plant.gate.release(std::mem::take(&mut idle.bytes));
                return true;
            }
        }
        false
    }

    fn withdraw(&mut self) {
        self.pins.drain(..).for_each(|read| self.plant.jobs[read].idle.lock().unwrap().pins -= 1);
    }
}

impl Plant {
    fn new(jobs: Vec<Job>, workers: &[Worker<usize>]) -> Self {
        let n = jobs.len();
        Self {
            gate: Gate::new(Some(LIMIT)),
            crew: Crew::new(workers),
            next: Mutex::new(0),
            bound: shuttle::rand::thread_rng().gen_range(1..n + 1),
            in_flight: AtomicUsize::new(0),
            open: AtomicUsize::new(n),
            ends: AtomicBool::new(false),
            last: usize::MAX,
            told: AtomicUsize::new(0),
            inside: AtomicU64::new(0),
            jobs,
        }
    }

    fn run(&self, workers: Vec<Worker<usize>>) {
        scope(|scope| {
            for worker in workers {
                scope.spawn(move || self.work(&worker));
            }
        });
        assert!(self.gate.peak() <= LIMIT);
        assert_eq!(self.inside.load(SeqCst), 0);
        let idle: u64 = self.jobs.iter().map(|job| job.idle.lock().unwrap().bytes).sum();
        assert_eq!(self.gate.used(), idle, "what is counted is there");
        let most = self.jobs.iter().map(|job| job.runs.load(SeqCst) + job.refusals.load(SeqCst)).max();
        assert!(most <= Some(1), "no job twice");
    }

    fn work(&self, own: &Worker<usize>) {
        let ends = || self.ends.load(SeqCst);
        loop {
            if self.crew.is_stopped() {
                return;
            }
            if ends() {
                return self.crew.stop();
            }
            match self.crew.find(own) {
                Some(job) => self.perform(job, own),
                None if self.admit() => {}
                None => {
                    if self.crew.sleep(|| self.may_admit(), ends) == Woken::Stuck {
                        self.told.fetch_add(1, SeqCst);
                        self.crew.stop();
                    }
                }
            }
        }
    }

    fn admit(&self) -> bool {
        let mut next = self.next.lock().unwrap();
        if *next == self.jobs.len() || self.in_flight.load(SeqCst) >= self.bound {
            return false;
        }
        let job = *next;
        *next += 1;
        self.in_flight.fetch_add(1, SeqCst);
        if self.jobs[job].pending.fetch_sub(1, SeqCst) == 1 {
            self.crew.push_root(job);
        }
        self.crew.rouse();
        true
    }

    fn may_admit(&self) -> bool {
        *self.next.lock().unwrap() < self.jobs.len() && self.in_flight.load(SeqCst) < self.bound
    }

    fn enter(&self, ask: &mut Asking) -> Pass {
        let job = &self.jobs[ask.job];
        let left = |&read: &usize| if self.jobs[read].idle.lock().unwrap().bytes > 0 { 0 } else { self.jobs[read].left };
        let bytes = job.guess + job.reads.iter().map(left).sum::<u64>();
        if self.gate.enter(bytes) {
            if ask.need().bytes <= bytes {
                return Pass::Go(bytes);
            }
            // Something was given up meanwhile.
            ask.withdraw();
            self.crew.hand_back(self.gate.leave(bytes));
        }
        self.gate.enter_or_wait(ask.job, ask)
    }

    fn perform(&self, i: usize, own: &Worker<usize>) {
        let job = &self.jobs[i];
        let mut ask = Asking { plant: self, job: i, pins: Vec::new() };
        match self.enter(&mut ask) {
            Pass::Wait => return,
            Pass::Never(_) => _ = job.refusals.fetch_add(1, SeqCst),
            Pass::Go(bytes) => self.inside(job, bytes, &mut ask),
        }
        for &reader in &job.readers {
            if self.jobs[reader].pending.fetch_sub(1, SeqCst) == 1 {
                own.push(reader);
                self.crew.rouse();
            }
        }
        self.in_flight.fetch_sub(1, SeqCst);
        let open = self.open.fetch_sub(1, SeqCst) - 1;
        if open == 0 {
            self.crew.stop();
        } else {
            self.ends.fetch_or(open == self.last, SeqCst);
            self.crew.rouse();
        }
    }

    /// Runs a job that was let in.
    fn inside(&self, job: &Job, mut bytes: u64, ask: &mut Asking) {
        assert!(bytes >= job.least);
        job.runs.fetch_add(1, SeqCst);
        self.has(bytes, 0);
        if job.more > 0 && self.gate.reserve_with(job.more, || ask.make_room(false)) {
            self.has(job.more, 0);
            bytes += job.more;
        }
        self.has(0, bytes);
        job.idle.lock().unwrap().bytes = job.left;
        ask.withdraw();
        self.crew.hand_back(self.gate.leave(bytes - job.left));
    }

    fn has(&self, more: u64, less: u64) {
        let inside = self.inside.fetch_add(more.wrapping_sub(less), SeqCst).wrapping_add(more.wrapping_sub(less));
        assert!(inside <= LIMIT, "{inside} in use at once");
    }
}

fn workers() -> Vec<Worker<usize>> {
    (0..shuttle::rand::thread_rng().gen_range(2..4)).map(|_| Worker::new_lifo()).collect()
}

#[test]
fn each_job_runs_once_unless_it_never_fits() {
    orders(1500, || {
        let workers = workers();
        let plant = Plant::new(jobs(6), &workers);
        plant.run(workers);
        assert_eq!(plant.told.load(SeqCst), 0, "nothing is stuck");
        for job in &plant.jobs {
            let inputs: u64 = job.reads.iter().map(|&read| plant.jobs[read].left).sum();
            let fits = u32::from(job.least + inputs <= LIMIT);
            assert_eq!((job.runs.load(SeqCst), job.refusals.load(SeqCst)), (fits, 1 - fits));
        }
    });
}

#[test]
fn a_job_that_can_never_run_is_told_once_all_else_is_done() {
    orders(300, || {
        let workers = workers();
        let jobs = jobs(6);
        let broken = shuttle::rand::thread_rng().gen_range(0..jobs.len());
        jobs[broken].pending.fetch_add(1, SeqCst);
        let mut plant = Plant::new(jobs, &workers);
        plant.bound = plant.jobs.len();
        plant.run(workers);
        // By one thread, or by one more that was woken for something that was done already.
        assert!(plant.told.load(SeqCst) > 0);
        let mut waits = vec![false; plant.jobs.len()];
        waits[broken] = true;
        for i in 0..waits.len() {
            let job = &plant.jobs[i];
            assert_eq!(job.runs.load(SeqCst) + job.refusals.load(SeqCst), u32::from(!waits[i]));
            if waits[i] {
                job.readers.iter().for_each(|&reader| waits[reader] = true);
            }
        }
    });
}

#[test]
fn an_end_from_outside_sends_everybody_home() {
    orders(300, || {
        let workers = workers();
        let mut plant = Plant::new(jobs(6), &workers);
        plant.last = shuttle::rand::thread_rng().gen_range(1..6);
        plant.run(workers);
        assert_eq!(plant.told.load(SeqCst), 0);
    });
}

/// Calls three jobs, in one of the ways that there are.
fn call(crew: &Crew<bool>, own: &Worker<bool>) {
    match shuttle::rand::thread_rng().gen_range(0..3) {
        0 => crew.hand_back(vec![false; 3]),
        1 => (0..3).for_each(|_| {
            own.push(false);
            crew.rouse();
        }),
        _ => {
            (0..3).for_each(|_| crew.push_root(false));
            crew.rouse();
        }
    }
}

#[test]
fn whoever_sleeps_is_called() {
    orders(500, || {
        let workers: Vec<Worker<bool>> = (0..3).map(|_| Worker::new_lifo()).collect();
        let crew = Crew::new(&workers);
        // The three jobs go on only together, each on a thread of its own.
        let (met, all) = (Mutex::new(0), Condvar::new());
        let meet = || {
            let mut met = met.lock().unwrap();
            *met += 1;
            if *met == 3 {
                crew.stop();
                all.notify_all();
            }
            drop(all.wait_while(met, |met| *met < 3).unwrap());
        };
        let work = |own: Worker<bool>| {
            while !crew.is_stopped() {
                match crew.find(&own) {
                    Some(true) => call(&crew, &own),
                    Some(false) => meet(),
                    None => assert_eq!(crew.sleep(|| false, || false), Woken::Called),
                }
            }
        };
        crew.push_root(true);
        scope(|scope| workers.into_iter().for_each(|own| _ = scope.spawn(|| work(own))));
    });
}

/// Who watches for lost wake-ups must not be woken by the time.
#[test]
#[should_panic(expected = "deadlock")]
fn a_wait_never_ends_by_itself() {
    orders(1, || {
        let (mutex, condvar) = (Mutex::new(()), Condvar::new());
        drop(crate::sync::wait(&condvar, mutex.lock().unwrap(), std::time::Duration::ZERO));
    });
}
