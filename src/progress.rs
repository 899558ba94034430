//! How far a run is: counters that the executor's threads raise, and one thread that looks at them now and then and shows them.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pegbar_engine::diag::SourceMap;
use pegbar_engine::exec::{Done, Failure, Observer};
use pegbar_engine::graph::Graph;
use pegbar_engine::job::{Job, Outcome};
use pegbar_engine::node::Meter;
use pegbar_engine::plan::Plan;
use serde_json::json;

use crate::console::{Console, count};
use crate::summary::{duration, figures};

/// How often the counters are looked at.
const TICK: Duration = Duration::from_millis(100);
/// How often a plain log gets a total.
const TOTAL_EVERY: Duration = Duration::from_secs(5);

/// A run in which no task ends for so long says what it waits for; again after twice as long, and so on.
const QUIET: Duration = Duration::from_secs(10);
/// Tasks named in such a line at most.
const MOST_NAMED: usize = 4;

/// What is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Style {
    Bar,
    Plain,
    Json,
    Silent,
}

#[derive(Default)]
struct Counter {
    planned: AtomicUsize,
    done: AtomicUsize,
    failed: AtomicUsize,
    nanos: AtomicU64,
}

/// What a thread is at, with the number of tasks that it began.
#[derive(Clone, Copy, Default)]
struct Lane {
    begun: u64,
    task: Option<(usize, Option<i64>)>,
}

/// A task that runs, and for how long.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Running {
    node: usize,
    frame: Option<i64>,
    thread: usize,
    time: Duration,
}

/// Notices that nothing is done.
struct Watch {
    done: usize,
    /// When the last task ended, as far as was seen.
    since: Instant,
    /// How long it has to be quiet before that is said.
    next: Duration,
    /// For each thread the task that was seen last, and when first.
    seen: Vec<(u64, Instant)>,
}

impl Watch {
    fn new(now: Instant, threads: usize) -> Self {
        Self { done: 0, since: now, next: QUIET, seen: vec![(0, now); threads] }
    }

    /// How long no task has ended, and whether it is time to say so; and what runs, the longest first. To be asked often.
    fn look(&mut self, now: Instant, done: usize, lanes: &[Lane]) -> (Duration, bool, Vec<Running>) {
        if done != self.done {
            (self.done, self.since, self.next) = (done, now, QUIET);
        }
        let mut running = Vec::new();
        for (thread, (lane, seen)) in lanes.iter().zip(&mut self.seen).enumerate() {
            if seen.0 != lane.begun {
                *seen = (lane.begun, now);
            }
            running.extend(lane.task.map(|(node, frame)| Running { node, frame, thread, time: now.saturating_duration_since(seen.1) }));
        }
        running.sort_by_key(|r| std::cmp::Reverse(r.time));
        let quiet = now.saturating_duration_since(self.since);
        let says = quiet >= self.next;
        while says && self.next <= quiet {
            self.next *= 2;
        }
        (quiet, says, running)
    }
}

/// Counts what is done; the executor's observer.
pub(crate) struct Reporter<'a> {
    graph: &'a Graph,
    style: Style,
    nodes: Vec<Counter>,
    is_target: Vec<bool>,
    frames: usize,
    start: Instant,
    plans: AtomicUsize,
    /// One for each thread.
    lanes: Vec<Mutex<Lane>>,
    /// How much of its task each thread has done, where that says.
    meters: Vec<Arc<Meter>>,
    /// Failures not shown yet.
    failures: Mutex<Vec<(String, Option<i64>, String)>>,
    ended: AtomicBool,
    lock: Mutex<()>,
    wake: Condvar,
}

impl Observer for Reporter<'_> {
    fn planned(&self, _graph: &Graph, plan: &Plan) {
        for (node, counter) in self.nodes.iter().enumerate() {
            counter.planned.fetch_add(plan.tasks_of(node), Ordering::Relaxed);
        }
        self.plans.fetch_add(1, Ordering::Relaxed);
    }

    fn started(&self, node: usize, frame: Option<i64>, thread: usize) {
        if let Some(lane) = self.lanes.get(thread) {
            let mut lane = lane.lock().unwrap_or_else(PoisonError::into_inner);
            *lane = Lane { begun: lane.begun + 1, task: Some((node, frame)) };
            self.meters[thread].reset();
        }
    }

    fn meter(&self, thread: usize) -> Option<Arc<Meter>> {
        self.meters.get(thread).cloned()
    }

    fn done(&self, done: &Done) {
        if let Some(lane) = self.lanes.get(done.thread) {
            lane.lock().unwrap_or_else(PoisonError::into_inner).task = None;
            self.meters[done.thread].reset();
        }
        if let Some(counter) = self.nodes.get(done.node) {
            counter.nanos.fetch_add(done.time.as_nanos() as u64, Ordering::Relaxed);
            counter.done.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn failed(&self, graph: &Graph, failure: &Failure) {
        if failure.error.cancelled {
            return;
        }
        if let Some(counter) = self.nodes.get(failure.node) {
            counter.failed.fetch_add(1, Ordering::Relaxed);
        }
        let name = graph.nodes[failure.node].name.clone();
        let entry = (name, failure.frame, failure.error.message.clone());
        self.failures.lock().unwrap_or_else(PoisonError::into_inner).push(entry);
    }
}

/// What the ticker has shown already of a node.
#[derive(Clone, Copy, Default)]
struct Shown {
    started: bool,
    done: bool,
}

impl<'a> Reporter<'a> {
    /// A reporter for one run.
    pub(crate) fn new(graph: &'a Graph, job: &Job, style: Style, threads: usize) -> Self {
        let count = job.targets().iter().map(|t| t.node + 1).max().unwrap_or(0).max(graph.nodes.len());
        let mut is_target = vec![false; count];
        job.targets().iter().for_each(|t| is_target[t.node] = true);
        Self {
            graph,
            style,
            nodes: (0..count).map(|_| Counter::default()).collect(),
            is_target,
            frames: job.frame_count(),
            start: Instant::now(),
            plans: AtomicUsize::new(0),
            lanes: (0..threads).map(|_| Mutex::default()).collect(),
            meters: (0..threads).map(|_| Arc::default()).collect(),
            failures: Mutex::default(),
            ended: AtomicBool::new(false),
            lock: Mutex::new(()),
            wake: Condvar::new(),
        }
    }

    /// Shows progress until [`Reporter::end`].
    pub(crate) fn tick(&self, console: &mut Console) {
        let bar = (self.style == Style::Bar).then(new_bar);
        let mut shown = vec![Shown::default(); self.graph.nodes.len()];
        let (mut plans, mut last_total) = (0, Instant::now());
        let mut watch = Watch::new(last_total, self.lanes.len());
        loop {
            let ended = self.ended.load(Ordering::Acquire);
            let now = self.plans.load(Ordering::Relaxed);
            if now > plans {
                plans = now;
                self.show_planned(console);
            }
            self.show_nodes(&mut shown, console);
            self.show_failures(bar.as_ref(), console);
            let waiting = self.show_waiting(&mut watch, Instant::now(), console);
            if let Some(bar) = &bar {
                self.show_bar(bar, waiting);
            }
            if ended {
                break;
            }
            if last_total.elapsed() >= TOTAL_EVERY {
                last_total = Instant::now();
                self.show_total(console);
            }
            let guard = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
            drop(self.wake.wait_timeout_while(guard, TICK, |()| !self.ended.load(Ordering::Acquire)));
        }
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
    }

    /// Lets the ticker show the last of it and return.
    pub(crate) fn end(&self) {
        let _guard = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        self.ended.store(true, Ordering::Release);
        self.wake.notify_all();
    }

    fn tasks(&self) -> (usize, usize) {
        self.nodes
            .iter()
            .fold((0, 0), |(done, planned), c| (done + c.done.load(Ordering::Relaxed), planned + c.planned.load(Ordering::Relaxed)))
    }

    fn nodes_done(&self) -> (usize, usize) {
        let busy = self.nodes[..self.graph.nodes.len()].iter().filter(|c| c.planned.load(Ordering::Relaxed) > 0);
        busy.fold((0, 0), |(done, all), c| {
            (done + usize::from(c.done.load(Ordering::Relaxed) >= c.planned.load(Ordering::Relaxed)), all + 1)
        })
    }

    /// Frames of which all that is asked for is made; where several nodes are asked for, by the share of their tasks.
    fn frames_done(&self) -> usize {
        let targets = self.nodes.iter().zip(&self.is_target).filter(|(_, t)| **t);
        let (done, planned) =
            targets.fold((0, 0), |(d, p), (c, _)| (d + c.done.load(Ordering::Relaxed), p + c.planned.load(Ordering::Relaxed)));
        (self.frames * done).checked_div(planned).unwrap_or(0)
    }

    /// How much of its task a thread has done, as far as that says.
    fn done_of(&self, thread: usize) -> Option<f64> {
        self.meters.get(thread)?.done()
    }

    /// Tasks that say how much of them is done, and how much that is.
    fn partly_done(&self) -> Vec<(&str, Option<i64>, f64)> {
        let one = |(lane, meter): (&Mutex<Lane>, &Arc<Meter>)| {
            let (node, frame) = lane.lock().unwrap_or_else(PoisonError::into_inner).task?;
            Some((self.graph.nodes.get(node)?.name.as_str(), frame, meter.done()?))
        };
        self.lanes.iter().zip(&self.meters).filter_map(one).collect()
    }

    /// The same in words, after what else is said; nothing where none says it.
    fn partly_done_text(&self) -> String {
        let one = |(node, frame, done): &(&str, Option<i64>, f64)| {
            let frame = frame.map(|f| format!("@{f}")).unwrap_or_default();
            format!("{node}{frame} {}", percent(*done))
        };
        let tasks = self.partly_done();
        let more = if tasks.len() > MOST_NAMED { format!(" and {} more", tasks.len() - MOST_NAMED) } else { String::new() };
        let named: Vec<String> = tasks.iter().take(MOST_NAMED).map(one).collect();
        if named.is_empty() { String::new() } else { format!(", {}{more}", named.join(", ")) }
    }

    fn rate(&self) -> f64 {
        self.frames_done() as f64 / self.start.elapsed().as_secs_f64().max(1e-9)
    }

    /// Time to go, if the tasks to come take as long as those before.
    fn to_go(&self) -> Option<Duration> {
        let (done, planned) = self.tasks();
        (done > 0).then(|| self.start.elapsed().mul_f64((planned.saturating_sub(done)) as f64 / done as f64))
    }

    fn show_planned(&self, console: &mut Console) {
        let (_, tasks) = self.tasks();
        let (_, nodes) = self.nodes_done();
        match self.style {
            Style::Plain => {
                console.say(&format!("planned: {}, {}, {}\n", count(nodes, "node"), count(self.frames, "frame"), count(tasks, "task")))
            }
            Style::Json => line(console, &json!({"event": "planned", "nodes": nodes, "frames": self.frames, "tasks": tasks})),
            _ => {}
        }
    }

    fn show_nodes(&self, shown: &mut [Shown], console: &mut Console) {
        for ((counter, node), shown) in self.nodes.iter().zip(&self.graph.nodes).zip(shown) {
            let (done, planned) = (counter.done.load(Ordering::Relaxed), counter.planned.load(Ordering::Relaxed));
            // A node of which more is planned at a later stage starts again.
            if done < planned {
                shown.done = false;
            }
            if shown.done || done == 0 {
                continue;
            }
            let time = Duration::from_nanos(counter.nanos.load(Ordering::Relaxed));
            if done >= planned {
                (shown.started, shown.done) = (true, true);
                match self.style {
                    Style::Plain => console.say(&format!("done:    {} ({}, {})\n", node.name, count(done, "task"), duration(time))),
                    Style::Json => line(
                        console,
                        &json!({"event": "node_done", "node": node.name, "type": node.ty.schema.id, "tasks": done, "seconds": time.as_secs_f64()}),
                    ),
                    _ => {}
                }
            } else if !shown.started {
                shown.started = true;
                if self.style == Style::Plain {
                    console.say(&format!("started: {} ({})\n", node.name, count(planned, "task")));
                }
            }
        }
    }

    fn show_failures(&self, bar: Option<&ProgressBar>, console: &mut Console) {
        let failures = std::mem::take(&mut *self.failures.lock().unwrap_or_else(PoisonError::into_inner));
        // The diagnostics at the end say it all and fold what repeats; here only the first few are worth their lines.
        for (node, frame, message) in &failures {
            let at = frame.map(|f| format!(" at frame {f}")).unwrap_or_default();
            match (self.style, bar) {
                (Style::Json, _) => line(console, &json!({"event": "failed", "node": node, "frame": frame, "message": message})),
                (_, Some(bar)) => bar.println(format!("failed:  {node}{at}: {message}")),
                (Style::Plain, None) => console.say(&format!("failed:  {node}{at}: {message}\n")),
                _ => {}
            }
        }
    }

    fn show_total(&self, console: &mut Console) {
        let (tasks_done, tasks) = self.tasks();
        let (nodes_done, nodes) = self.nodes_done();
        let (frames_done, frames, rate) = (self.frames_done(), self.frames, self.rate());
        match self.style {
            Style::Plain => {
                let to_go = self.to_go().map(|t| format!(", {} to go", duration(t))).unwrap_or_default();
                console.say(&format!(
                    "total:   {nodes_done}/{nodes} nodes, {frames_done}/{frames} frames, {tasks_done}/{tasks} tasks, {} frames/s{to_go}{}\n",
                    figures(rate),
                    self.partly_done_text()
                ));
            }
            Style::Json => line(
                console,
                &json!({"event": "progress", "nodes_done": nodes_done, "nodes": nodes, "frames_done": frames_done, "frames": frames, "tasks_done": tasks_done, "tasks": tasks,
                    "frames_per_second": rate, "seconds_to_go": self.to_go().map(|t| t.as_secs_f64()),
                    "partly_done": self.partly_done().iter().map(|(node, frame, done)| json!({"node": node, "frame": frame, "done": done})).collect::<Vec<_>>()}),
            ),
            _ => {}
        }
    }

    /// Says now and then what runs while no task ends; gives that text for a bar for as long as none does.
    fn show_waiting(&self, watch: &mut Watch, now: Instant, console: &mut Console) -> Option<String> {
        let lanes: Vec<Lane> = self.lanes.iter().map(|l| *l.lock().unwrap_or_else(PoisonError::into_inner)).collect();
        let (quiet, says, running) = watch.look(now, self.tasks().0, &lanes);
        let name = |node: usize| self.graph.nodes.get(node).map_or("an output", |n| n.name.as_str());
        let text = || match running.len() {
            0 => format!("no task runs, and none has ended for {}", duration(quiet)),
            n => {
                let one = |r: &Running| {
                    let frame = r.frame.map(|f| format!("@{f}")).unwrap_or_default();
                    let done = self.done_of(r.thread).map(|done| format!(", {}", percent(done))).unwrap_or_default();
                    format!("{}{frame} for {} on thread {}{done}", name(r.node), duration(r.time), r.thread)
                };
                let named: Vec<String> = running.iter().take(MOST_NAMED).map(one).collect();
                let more = if n > MOST_NAMED { format!(" and {} more", n - MOST_NAMED) } else { String::new() };
                format!("still running: {}{more}", named.join(", "))
            }
        };
        match self.style {
            Style::Plain if says => console.say(&format!("{}\n", text())),
            Style::Json if says => {
                let task = |r: &Running| {
                    let mut task = json!({"node": name(r.node), "frame": r.frame, "seconds": r.time.as_secs_f64(), "thread": r.thread});
                    if let Some(done) = self.done_of(r.thread) {
                        task["done"] = json!(done);
                    }
                    task
                };
                let tasks = running.iter().map(task);
                line(console, &json!({"event": "waiting", "seconds": quiet.as_secs_f64(), "running": tasks.collect::<Vec<_>>()}));
            }
            _ => {}
        }
        (self.style == Style::Bar && quiet >= QUIET).then(text)
    }

    fn show_bar(&self, bar: &ProgressBar, waiting: Option<String>) {
        let (done, planned) = self.tasks();
        let (nodes_done, nodes) = self.nodes_done();
        bar.set_length(planned as u64);
        bar.set_position(done as u64);
        let to_go = || self.to_go().map(|t| format!(", {} to go", duration(t))).unwrap_or_default();
        let (frames, all) = (self.frames_done(), self.frames);
        bar.set_message(waiting.unwrap_or_else(|| {
            format!(
                "nodes {nodes_done}/{nodes}, frames {frames}/{all}, {} frames/s{}{}",
                figures(self.rate()),
                to_go(),
                self.partly_done_text()
            )
        }));
    }
}

fn new_bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
    match ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}") {
        Ok(style) => bar.with_style(style.progress_chars("=> ")),
        Err(_) => bar,
    }
}

fn percent(done: f64) -> String {
    format!("{:.0} %", 100.0 * done)
}

fn line(console: &mut Console, value: &serde_json::Value) {
    console.out(&format!("{value}\n"));
}

/// The last line of `--progress json`: the whole outcome.
pub(crate) fn finished_line(sources: &SourceMap, graph: &Graph, outcome: &Outcome) -> String {
    let nodes: Vec<serde_json::Value> = graph
        .nodes
        .iter()
        .zip(&outcome.report.stats)
        .filter(|(_, s)| s.tasks > 0)
        .map(|(n, s)| json!({"node": n.name, "type": n.ty.schema.id, "tasks": s.tasks, "seconds": s.time.as_secs_f64(), "peak_bytes": s.peak_bytes}))
        .collect();
    let secs = outcome.wall.as_secs_f64();
    let status = if outcome.report.cancelled {
        "cancelled"
    } else if outcome.is_complete() {
        "complete"
    } else {
        "failed"
    };
    let diagnostics: Vec<_> = outcome.diagnostics.iter().map(|d| sources.to_json(d)).collect();
    let files: Vec<String> = outcome.written.iter().map(|p| p.display().to_string()).collect();
    let value = json!({"event": "finished", "status": status, "frames": outcome.frames, "seconds": secs, "frames_per_second": outcome.frames as f64 / secs.max(1e-9),
        "failed_tasks": outcome.report.failures.len(), "outputs_not_made": outcome.report.unreached, "peak_bytes": outcome.report.peak_bytes,
        "files": files, "nodes": nodes, "diagnostics": diagnostics});
    format!("{value}\n")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use pegbar_engine::check::{LoadOptions, load_text};
    use pegbar_engine::job::Request;

    use super::*;

    const fn running(node: usize, frame: Option<i64>, thread: usize, secs: u64) -> Running {
        Running { node, frame, thread, time: Duration::from_secs(secs) }
    }

    #[test]
    fn a_run_that_stalls_says_what_it_waits_for_at_growing_intervals() {
        let start = Instant::now();
        let mut watch = Watch::new(start, 2);
        let lane = |begun, task| Lane { begun, task };
        let slow = lane(1, Some((7, Some(12))));
        let mut look = |secs: u64, done: usize, other: Lane| {
            let (quiet, says, running) = watch.look(start + Duration::from_secs(secs), done, &[slow, other]);
            (quiet.as_secs(), says, running)
        };
        // A thread that ends one task after the other keeps the run from being quiet, however long the other takes.
        for secs in 0..30 {
            let (quiet, says, _) = look(secs, secs as usize, lane(secs, Some((3, None))));
            assert!(quiet == 0 && !says, "at {secs} s");
        }
        let last = lane(29, None);
        let said: Vec<u64> = (30..200).filter(|&secs| look(secs, 29, last).1).collect();
        assert_eq!(said, [39, 49, 69, 109, 189], "10, 20, 40, 80, 160 s after the last task ended");
        assert_eq!(look(200, 29, last), (171, false, vec![running(7, Some(12), 0, 200)]));
        // What is done starts the count anew; the task that is still running has its own.
        assert_eq!(look(201, 30, lane(30, Some((3, None)))), (0, false, vec![running(7, Some(12), 0, 201), running(3, None, 1, 0)]));
        let said: Vec<u64> = (202..230).filter(|&secs| look(secs, 30, last).1).collect();
        assert_eq!(said, [211, 221]);
    }

    /// What a reporter says when the first task that began, of frame 3, has run for `secs` on the second of two threads.
    fn said(style: Style, secs: u64) -> (String, String) {
        let text = "Graph(pegbar: 1, frames: (first: 1, last: 8, fps: 24), nodes: { \"slow\": (type: \"test.frame\") })";
        let loaded = load_text(Path::new("g.ron"), text, &crate::tests::registry(), &LoadOptions::default());
        let graph = loaded.graph.unwrap();
        let job = Job::new(&graph, &Request { only: Some("slow".to_owned()), ..Request::default() }).map_err(|d| d.message).unwrap();
        let reporter = Reporter::new(&graph, &job, style, 2);
        let start = Instant::now();
        let mut watch = Watch::new(start, 2);
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let cancel = pegbar_engine::node::Cancel::default();
        let mut console = Console { stdout: &mut out, stderr: &mut err, is_terminal: false, colour: false, cancel };
        reporter.started(0, Some(3), 1);
        assert_eq!(reporter.show_waiting(&mut watch, start, &mut console), None);
        let bar = reporter.show_waiting(&mut watch, start + Duration::from_secs(secs), &mut console);
        assert_eq!(bar.is_some(), style == Style::Bar);
        (String::from_utf8(out).unwrap(), bar.unwrap_or_default() + &String::from_utf8(err).unwrap())
    }

    #[test]
    fn what_is_waited_for_is_named_with_its_frame_time_and_thread() {
        let text = "still running: slow@3 for 34.0 s on thread 1";
        assert_eq!(said(Style::Plain, 34), (String::new(), format!("{text}\n")));
        assert_eq!(said(Style::Bar, 34), (String::new(), text.to_owned()));
        assert_eq!(said(Style::Plain, 9), (String::new(), String::new()));
        let (out, err) = said(Style::Json, 34);
        let event: serde_json::Value = serde_json::from_str(&out).unwrap();
        let running = json!([{"node": "slow", "frame": 3, "seconds": 34.0, "thread": 1}]);
        assert_eq!((event, err.as_str()), (json!({"event": "waiting", "seconds": 34.0, "running": running}), ""));
    }

    /// What a reporter says of two threads, one of which has a task that says how much of it is done.
    fn said_of_a_part(style: Style, done: f64) -> (String, String) {
        let text = "Graph(pegbar: 1, frames: (first: 1, last: 8, fps: 24), nodes: { \"slow\": (type: \"test.frame\") })";
        let loaded = load_text(Path::new("g.ron"), text, &crate::tests::registry(), &LoadOptions::default());
        let graph = loaded.graph.unwrap();
        let job = Job::new(&graph, &Request { only: Some("slow".to_owned()), ..Request::default() }).map_err(|d| d.message).unwrap();
        let reporter = Reporter::new(&graph, &job, style, 2);
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let cancel = pegbar_engine::node::Cancel::default();
        let mut console = Console { stdout: &mut out, stderr: &mut err, is_terminal: false, colour: false, cancel };
        reporter.started(0, Some(2), 0);
        reporter.started(0, Some(3), 1);
        reporter.meter(1).unwrap().set(done);
        reporter.show_total(&mut console);
        let start = Instant::now();
        let mut watch = Watch::new(start, 2);
        assert_eq!(reporter.show_waiting(&mut watch, start, &mut console), None);
        reporter.show_waiting(&mut watch, start + Duration::from_secs(34), &mut console);
        // What comes next says nothing yet.
        reporter.started(0, Some(4), 1);
        assert_eq!(reporter.partly_done(), []);
        (String::from_utf8(out).unwrap(), String::from_utf8(err).unwrap())
    }

    #[test]
    fn a_task_that_says_how_much_of_it_is_done_is_named_with_that() {
        let (_, err) = said_of_a_part(Style::Plain, 0.42);
        let lines: Vec<&str> = err.lines().collect();
        assert!(lines[0].starts_with("total:   ") && lines[0].ends_with(" frames/s, slow@3 42 %"), "{err}");
        assert_eq!(lines[1], "still running: slow@2 for 34.0 s on thread 0, slow@3 for 34.0 s on thread 1, 42 %");
        let (out, _) = said_of_a_part(Style::Json, 1.5);
        let events: Vec<serde_json::Value> = out.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(events[0]["partly_done"], json!([{"node": "slow", "frame": 3, "done": 1.0}]));
        assert_eq!((&events[1]["running"][0]["done"], &events[1]["running"][1]["done"]), (&serde_json::Value::Null, &json!(1.0)));
    }

    #[test]
    fn a_long_silence_is_broken_once() {
        let start = Instant::now();
        let mut watch = Watch::new(start, 1);
        let mut says = |secs: u64| watch.look(start + Duration::from_secs(secs), 0, &[Lane::default()]).1;
        assert_eq!([300, 301, 319, 320, 639, 640].map(&mut says), [true, false, false, true, false, true]);
    }
}
