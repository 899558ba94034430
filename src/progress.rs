//! How far a run is: counters that the executor's threads raise, and one thread that looks at them now and then and shows them.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pegbar_engine::diag::SourceMap;
use pegbar_engine::exec::{Done, Failure, Observer};
use pegbar_engine::graph::Graph;
use pegbar_engine::job::{Job, Outcome};
use pegbar_engine::plan::Plan;
use serde_json::json;

use crate::console::{Console, count};
use crate::summary::{duration, figures};

/// How often the counters are looked at.
const TICK: Duration = Duration::from_millis(100);
/// How often a plain log gets a total.
const TOTAL_EVERY: Duration = Duration::from_secs(5);

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

/// Counts what is done; the executor's observer.
pub(crate) struct Reporter<'a> {
    graph: &'a Graph,
    style: Style,
    nodes: Vec<Counter>,
    is_target: Vec<bool>,
    frames: usize,
    start: Instant,
    plans: AtomicUsize,
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

    fn done(&self, done: &Done) {
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
    pub(crate) fn new(graph: &'a Graph, job: &Job, style: Style) -> Self {
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
        loop {
            let ended = self.ended.load(Ordering::Acquire);
            let now = self.plans.load(Ordering::Relaxed);
            if now > plans {
                plans = now;
                self.show_planned(console);
            }
            self.show_nodes(&mut shown, console);
            self.show_failures(bar.as_ref(), console);
            if let Some(bar) = &bar {
                self.show_bar(bar);
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
                    "total:   {nodes_done}/{nodes} nodes, {frames_done}/{frames} frames, {tasks_done}/{tasks} tasks, {} frames/s{to_go}\n",
                    figures(rate)
                ));
            }
            Style::Json => line(
                console,
                &json!({"event": "progress", "nodes_done": nodes_done, "nodes": nodes, "frames_done": frames_done, "frames": frames, "tasks_done": tasks_done, "tasks": tasks,
                    "frames_per_second": rate, "seconds_to_go": self.to_go().map(|t| t.as_secs_f64())}),
            ),
            _ => {}
        }
    }

    fn show_bar(&self, bar: &ProgressBar) {
        let (done, planned) = self.tasks();
        let (nodes_done, nodes) = self.nodes_done();
        bar.set_length(planned as u64);
        bar.set_position(done as u64);
        let to_go = self.to_go().map(|t| format!(", {} to go", duration(t))).unwrap_or_default();
        bar.set_message(format!(
            "nodes {nodes_done}/{nodes}, frames {}/{}, {} frames/s{to_go}",
            self.frames_done(),
            self.frames,
            figures(self.rate())
        ));
    }
}

fn new_bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
    match ProgressStyle::with_template("{bar:30} {percent:>3} %  {msg}") {
        Ok(style) => bar.with_style(style.progress_chars("=> ")),
        Err(_) => bar,
    }
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
