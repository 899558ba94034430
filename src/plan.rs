//! `pegbar plan`: what a run would do.

use std::fmt::Write as _;
use std::time::Duration;

use pegbar_engine::check::load;
use pegbar_engine::exec::{Expected, Preview};
use pegbar_engine::graph::Graph;
use pegbar_engine::job::{Job, Request};
use pegbar_engine::registry::Registry;
use serde::Serialize;

use crate::args::{Format, PlanArgs};
use crate::check::say_total;
use crate::console::{Console, EXIT_OK, EXIT_WRONG, count};
use crate::resources::Ready;
use crate::summary::{bytes, duration, table};

/// What `pegbar plan --format json` prints. Bytes, seconds; nothing where no run has measured it.
#[derive(Serialize)]
struct Shown {
    nodes: Vec<Row>,
    first: Vec<String>,
    memory: u64,
    least_memory: u64,
    least_memory_at: Option<String>,
    peak_memory: u64,
    peak_memory_more_a_target: u64,
    cached_bytes: u64,
    written_bytes: Option<u64>,
    seconds: Option<f64>,
    unknown: Vec<String>,
}

#[derive(Serialize)]
struct Row {
    node: String,
    #[serde(rename = "type")]
    ty: &'static str,
    runs: u64,
    skipped: u64,
    seconds: Option<f64>,
    result_bytes: Option<u64>,
    scratch_bytes: Option<u64>,
    alive_at_once: u64,
}

pub(crate) fn plan(args: &PlanArgs, registry: &Registry, console: &mut Console) -> u8 {
    let loaded = load(&args.graph.graph, registry, &args.graph.load_options());
    console.diagnostics(&loaded.sources, &loaded.diagnostics);
    let Some(graph) = &loaded.graph else {
        say_total(&args.graph.graph.display().to_string(), &loaded, console);
        return EXIT_WRONG;
    };
    let request = Request { only: args.only.clone(), frames: args.frames.clone(), out: args.graph.out.clone() };
    let ready = Ready::new(&args.resources, console);
    let how = ready.how(&args.graph.graph, &loaded.sources);
    let preview = Job::new(graph, &request).and_then(|job| job.preview(&how));
    ready.say_trouble(console);
    match preview {
        Err(wrong) => {
            console.diagnostics(&loaded.sources, &[*wrong]);
            EXIT_WRONG
        }
        Ok(preview) => {
            let shown = shown(graph, &preview, ready.memory());
            if args.format == Format::Json {
                return console.json(&shown);
            }
            console.out(&text(&shown, ready.threads));
            EXIT_OK
        }
    }
}

fn shown(graph: &Graph, preview: &Preview, memory: u64) -> Shown {
    let row = |(i, node): (usize, &pegbar_engine::graph::GraphNode)| {
        let size: Option<Expected> = preview.sizes[i];
        Row {
            node: node.name.clone(),
            ty: node.ty.schema.id,
            runs: preview.runs[i],
            skipped: preview.skipped[i],
            seconds: size.map(|s| s.seconds * preview.runs[i] as f64),
            result_bytes: size.map(|s| s.bytes),
            scratch_bytes: size.map(|s| s.scratch),
            alive_at_once: preview.footprint.alive[i],
        }
    };
    let nodes: Vec<Row> = graph.nodes.iter().enumerate().map(row).collect();
    let name = |(node, frame): (usize, i64)| match graph.nodes.get(node) {
        Some(node) if node.runs_once() => node.name.clone(),
        Some(node) => format!("{}@{frame}", node.name),
        None => String::new(),
    };
    let running = || nodes.iter().filter(|row| row.runs > 0);
    Shown {
        first: preview.first.iter().map(|port| graph.port_name(*port)).collect(),
        memory,
        least_memory: preview.footprint.least,
        least_memory_at: preview.footprint.least_at.map(name),
        peak_memory: preview.footprint.peak,
        peak_memory_more_a_target: preview.footprint.path,
        cached_bytes: preview.cached_bytes,
        written_bytes: running().map(|row| row.result_bytes.map(|b| b * row.runs)).sum(),
        seconds: running().map(|row| row.seconds).sum(),
        unknown: preview.unknown.iter().filter_map(|&i| graph.nodes.get(i)).map(|node| node.name.clone()).collect(),
        nodes,
    }
}

fn text(shown: &Shown, threads: usize) -> String {
    let head = ["node", "type", "runs", "skipped", "time", "result", "scratch", "at once"].map(str::to_owned).to_vec();
    let known = |value: Option<u64>| value.map_or_else(|| "?".to_owned(), bytes);
    let row = |row: &Row| {
        let time = row.seconds.map_or_else(|| "?".to_owned(), |s| duration(Duration::from_secs_f64(s)));
        let numbers = [
            row.runs.to_string(),
            row.skipped.to_string(),
            time,
            known(row.result_bytes),
            known(row.scratch_bytes),
            row.alive_at_once.to_string(),
        ];
        [row.node.clone(), row.ty.to_owned()].into_iter().chain(numbers).collect::<Vec<_>>()
    };
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(shown.nodes.iter().filter(|r| r.runs + r.skipped > 0).map(row)).collect();
    let mut out = format!("{}\n", table(&rows));
    let total = |f: fn(&Row) -> u64| shown.nodes.iter().map(f).sum::<u64>();
    // Writing into a string cannot fail.
    let _ = writeln!(out, "{} to run, {} to skip", counted(total(|r| r.runs), "task"), counted(total(|r| r.skipped), "task"));
    if !shown.first.is_empty() {
        let _ = writeln!(out, "this is what leads to {}; the rest is planned when that is known", shown.first.join(", "));
    }
    if shown.unknown.is_empty() {
        let at = shown.least_memory_at.as_deref().map(|at| format!(", for {at}")).unwrap_or_default();
        let _ = writeln!(
            out,
            "memory: {} at least{at}; {} expected, {} with {}; the budget is {}",
            bytes(shown.least_memory),
            bytes(shown.peak_memory),
            bytes(shown.peak_memory + shown.peak_memory_more_a_target * (threads as u64 * 2 - 1)),
            count(threads * 2, "target") + " in flight",
            bytes(shown.memory)
        );
    } else {
        let _ = writeln!(out, "memory and time: no run has measured {}; the budget is {}", shown.unknown.join(", "), bytes(shown.memory));
    }
    let _ =
        writeln!(out, "disk: {} to be read from the cache, {} of results at most", bytes(shown.cached_bytes), known(shown.written_bytes));
    if let Some(seconds) = shown.seconds {
        let _ =
            writeln!(out, "time: {} of work by earlier runs, on {}", duration(Duration::from_secs_f64(seconds)), count(threads, "thread"));
    }
    out
}

fn counted(n: u64, what: &str) -> String {
    count(usize::try_from(n).unwrap_or(usize::MAX), what)
}
