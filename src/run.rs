//! `pegbar run`: makes what a graph writes.

use std::fmt::Display;
use std::path::Path;

use pegbar_engine::check::{Loaded, load};
use pegbar_engine::diag::Diagnostic;
use pegbar_engine::exec::Observer;
use pegbar_engine::graph::Graph;
use pegbar_engine::job::{How, Job, Outcome, Request};
use pegbar_engine::registry::Registry;

use crate::args::{Progress, RunArgs};
use crate::check::say_total;
use crate::console::{Console, EXIT_CANCELLED, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};
use crate::observers::Observers;
use crate::progress::{Reporter, Style, finished_line};
use crate::replay::Saver;
use crate::report::{self, Catcher, Facts};
use crate::resources::Ready;
use crate::summary::summary;
use crate::trace::Trace;

pub(crate) fn run(args: &RunArgs, registry: &Registry, console: &mut Console) -> u8 {
    let loaded = load(&args.graph.graph, registry, &args.graph.load_options());
    console.diagnostics(&loaded.sources, &loaded.diagnostics);
    let Some(graph) = &loaded.graph else {
        say_total(&args.graph.graph.display().to_string(), &loaded, console);
        return EXIT_WRONG;
    };
    let request = Request { only: args.only.clone(), frames: args.frames.clone(), out: args.graph.out.clone() };
    let job = match Job::new(graph, &request).and_then(|job| job.prepare().map(|()| job)) {
        Ok(job) => job,
        Err(wrong) => return refuse(&loaded, *wrong, console),
    };
    let ready = Ready::new(&args.resources, console);
    let threads = ready.threads;
    if let Some(stranger) = ready.strangers(|name| graph.find(name).is_some()).next() {
        console.say(&format!("error: expected a node of the graph in --keep, found `{stranger}`\n"));
        return EXIT_WRONG;
    }
    let saver = args.save_failure.as_deref().map(Saver::new);
    let trace = args.trace.as_deref().map(|path| (path, Trace::new(threads)));
    let catcher = args.report.as_ref().map(|_| Catcher::new(graph.nodes.len()));
    let unended = args.report.as_deref().map_or(Ok(()), |path| report::write_unended(path, &args.graph.graph));
    if !write_trace(trace.as_ref(), console) || !told("report", unended, console) {
        return EXIT_WRONG;
    }
    let how = ready.how(&args.graph.graph, &loaded.sources);
    let others = [saver.as_ref().map(observer), trace.as_ref().map(|(_, t)| observer(t)), catcher.as_ref().map(observer)];
    let others: Vec<&dyn Observer> = others.into_iter().flatten().collect();
    let outcome = watched(args.progress, graph, &job, &others, how, console);
    ready.say_trouble(console);
    let code = conclude(args, &loaded, graph, &outcome, console);
    say_saved(saver, console);
    let facts = Facts { graph_file: &args.graph.graph, loaded: &loaded, graph, outcome: &outcome, threads, memory: ready.memory() };
    let reported = args.report.as_deref().zip(catcher).map_or(Ok(()), |(path, catcher)| report::write(path, &facts, catcher));
    if write_trace(trace.as_ref(), console) & told("report", reported, console) { code } else { code.max(EXIT_FAILED) }
}

/// Writes the trace, if one was asked for: before the run too, so that a path that cannot be written is known from the start.
fn write_trace(trace: Option<&(&Path, Trace)>, console: &mut Console) -> bool {
    told("trace", trace.map_or(Ok(()), |(path, trace)| trace.write(path)), console)
}

/// Says that something beside the outputs could not be written; true where it could.
fn told<E: Display>(what: &str, written: Result<(), E>, console: &mut Console) -> bool {
    if let Err(error) = &written {
        console.say(&format!("error: the {what} cannot be written: {error}\n"));
    }
    written.is_ok()
}

fn observer<T: Observer>(one: &T) -> &dyn Observer {
    one
}

/// Where the bundles of failures are. Trouble with them is no trouble of the run.
fn say_saved(saver: Option<Saver>, console: &mut Console) {
    for saved in saver.into_iter().flat_map(Saver::end) {
        match saved {
            Ok(folder) => console.say(&format!("saved: `pegbar replay {}` runs it alone\n", folder.display())),
            Err(why) => console.say(&format!("warning: {why}\n")),
        }
    }
}

fn refuse(loaded: &Loaded, wrong: Diagnostic, console: &mut Console) -> u8 {
    console.diagnostics(&loaded.sources, &[wrong]);
    EXIT_WRONG
}

/// Runs the job while another thread shows how far it is.
pub(crate) fn watched(progress: Progress, graph: &Graph, job: &Job, others: &[&dyn Observer], how: How, console: &mut Console) -> Outcome {
    let style = match progress {
        Progress::Auto if console.is_terminal => Style::Bar,
        Progress::Auto | Progress::Plain => Style::Plain,
        Progress::Json => Style::Json,
        Progress::None => Style::Silent,
    };
    let cancel = console.cancel.clone();
    let reporter = Reporter::new(graph, job, style, how.threads);
    let observers = Observers(std::iter::once(observer(&reporter)).chain(others.iter().copied()).collect());
    std::thread::scope(|scope| {
        let ticker = (style != Style::Silent).then(|| scope.spawn(|| reporter.tick(console)));
        let outcome = job.run(&How { cancel, observer: &observers, ..how });
        reporter.end();
        if let Some(ticker) = ticker {
            // The ticker only writes; were it to panic, the outcome still stands.
            let _ = ticker.join();
        }
        outcome
    })
}

fn conclude(args: &RunArgs, loaded: &Loaded, graph: &Graph, outcome: &Outcome, console: &mut Console) -> u8 {
    let shows_summary = matches!(args.progress, Progress::Auto | Progress::Plain);
    if shows_summary {
        console.say(&format!("\n{}", summary(graph, outcome)));
    }
    if args.progress == Progress::Json {
        console.out(&finished_line(&loaded.sources, graph, outcome));
    }
    if shows_summary && !outcome.diagnostics.is_empty() {
        console.say("\n");
    }
    console.diagnostics(&loaded.sources, &outcome.diagnostics);
    if outcome.report.cancelled {
        console.say("cancelled: files that are there are whole\n");
        return EXIT_CANCELLED;
    }
    if outcome.is_complete() {
        return EXIT_OK;
    }
    let failed = outcome.report.failures.len();
    let unreached = match outcome.report.unreached {
        0 => String::new(),
        n => format!("; {} of the outputs not made", count(n, "frame")),
    };
    console.say(&format!(
        "\nfailed: {}{unreached}\n",
        if failed > 0 { count(failed, "task") } else { count(outcome.diagnostics.len(), "error") }
    ));
    EXIT_FAILED
}
