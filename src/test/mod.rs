//! `pegbar test`: graphs held against their goldens.

mod case;
mod files;
mod html;
mod junit;
mod picture;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use pegbar_engine::golden::{GoldenFile, Store, golden_of, is_golden};
use pegbar_engine::registry::Registry;

use crate::args::TestArgs;
use crate::console::{Console, EXIT_CANCELLED, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};
use crate::fmt::graph_files;
use crate::resources::Ready;
use crate::summary::duration;
use case::{Bench, CaseResult, Task, Verdict, examine};

pub(crate) fn test(args: &TestArgs, registry: &Registry, console: &mut Console) -> u8 {
    let graphs = match graphs(&args.paths) {
        Ok(graphs) => graphs,
        Err(why) => {
            console.say(&format!("error: {why}\n"));
            return EXIT_WRONG;
        }
    };
    let ready = Ready::new(&args.resources, console);
    let bench = Bench { registry, ready: &ready, out: &args.out };
    let goldens: Vec<(PathBuf, GoldenFile)> = graphs.into_iter().map(|g| (g.clone(), GoldenFile::read(&golden_of(&g)))).collect();
    let mut unread = 0;
    for (graph, golden) in &goldens {
        console.diagnostics(&golden.sources, &golden.diagnostics);
        unread += usize::from(!golden.diagnostics.is_empty());
        strays(graph, golden, console);
    }
    if let Some(name) =
        args.bless.iter().find(|name| !goldens.iter().any(|(graph, golden)| golden.cases.iter().any(|c| is_named(name, graph, &c.name))))
    {
        console.say(&format!("error: expected `all`, a graph or a case in --bless, found `{name}`; {}\n", names(&goldens)));
        return EXIT_WRONG;
    }
    let mut results = Vec::new();
    for (graph, golden) in goldens.iter().filter(|(_, g)| g.diagnostics.is_empty()) {
        for case in &golden.cases {
            let bless = args.bless.iter().any(|name| is_named(name, graph, &case.name));
            // Blessing one leaves the others alone.
            if (bless || args.bless.is_empty()) && !console.cancel.is_cancelled() {
                let result = examine(&Task { graph, golden, case, bless }, &bench, console);
                console.out(&line(&result));
                results.push(result);
            }
        }
    }
    ready.say_trouble(console);
    conclude(args, &results, unread, console)
}

fn conclude(args: &TestArgs, results: &[CaseResult], unread: usize, console: &mut Console) -> u8 {
    let of = |verdict: Verdict| results.iter().filter(|r| r.verdict == verdict).count();
    let mut total = format!("{}: {} pass", count(results.len(), "case"), of(Verdict::Pass));
    for (n, what) in [(of(Verdict::Left), "failed"), (of(Verdict::Wrong), "with errors"), (of(Verdict::Cancelled), "cancelled")] {
        if n > 0 {
            total.push_str(&format!(", {n} {what}"));
        }
    }
    if unread > 0 {
        total.push_str(&format!("; {} cannot be read", count(unread, "golden")));
    }
    console.say(&format!("{total}\n"));
    let mut code = match results.iter().map(|r| r.verdict).max() {
        Some(Verdict::Cancelled) => EXIT_CANCELLED,
        Some(Verdict::Wrong) => EXIT_WRONG,
        _ if console.cancel.is_cancelled() => EXIT_CANCELLED,
        _ if unread > 0 => EXIT_WRONG,
        Some(Verdict::Left) => EXIT_FAILED,
        Some(Verdict::Pass) | None => EXIT_OK,
    };
    let files = [(&args.junit, junit::junit(results)), (&args.html, html::page(results, &total))];
    for (path, text) in files.iter().filter_map(|(path, text)| Some((path.as_deref()?, text))) {
        if let Err(why) = files::write(path, text.as_bytes()) {
            console.say(&format!("error: {why}\n"));
            code = code.max(EXIT_FAILED);
        }
    }
    code
}

/// Graphs with a golden: those that are named, and those in folders.
fn graphs(paths: &[PathBuf]) -> Result<Vec<PathBuf>, String> {
    let mut found = BTreeSet::new();
    for path in paths {
        let mut files = Vec::new();
        graph_files(path, &mut files).map_err(|e| format!("{}: {e}", path.display()))?;
        let is_folder = path.is_dir();
        if is_folder {
            files.retain(|f| is_golden(f));
        }
        if files.is_empty() {
            return Err(format!("expected a graph with a golden file beside it in {}, found none; {HOW}", path.display()));
        }
        for file in files {
            let graph = graph_of(&file);
            let missing = if graph.is_file() { golden_of(&graph) } else { graph.clone() };
            if !missing.is_file() {
                return Err(format!("expected {} beside {}, found none; {HOW}", missing.display(), file.display()));
            }
            found.insert(graph);
        }
    }
    Ok(found.into_iter().collect())
}

const HOW: &str = "the least golden file, hat.golden.ron beside hat.ron, is `Golden(pegbar: 1)`";

/// The graph of a golden file; any other file itself.
fn graph_of(file: &Path) -> PathBuf {
    // `hat.golden.ron` without `.ron`, and `.golden` made `.ron` again.
    if is_golden(file) { file.with_extension("").with_extension("ron") } else { file.to_owned() }
}

/// True where `--bless NAME` means this case: all, a case, a graph by path or name, or one case of it as `graph:case`.
fn is_named(name: &str, graph: &Path, case: &str) -> bool {
    let is_graph = |name: &str| {
        let stem = graph.file_stem().is_some_and(|s| s.to_string_lossy() == name);
        stem || graph == Path::new(name) || graph.file_name().is_some_and(|f| f.to_string_lossy() == name)
    };
    name == "all" || name == case || is_graph(name) || name.rsplit_once(':').is_some_and(|(graph, of)| of == case && is_graph(graph))
}

fn names(goldens: &[(PathBuf, GoldenFile)]) -> String {
    let of = |(graph, golden): &(PathBuf, GoldenFile)| {
        let stem = graph.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        golden.cases.iter().map(move |c| format!("{stem}:{}", c.name)).collect::<Vec<_>>()
    };
    let names: Vec<String> = goldens.iter().flat_map(of).collect();
    let more = if names.len() > 12 { ", ..." } else { "" };
    format!("there are {}{more}", names[..names.len().min(12)].join(", "))
}

/// Warns of references whose case is no more.
fn strays(graph: &Path, golden: &GoldenFile, console: &mut Console) {
    if !golden.diagnostics.is_empty() {
        return;
    }
    let folder = Store::of(graph, "").folder().to_owned();
    for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let case = name.strip_suffix(".json").map_or(name.as_str(), |n| n.strip_suffix(".nodes").unwrap_or(n));
        if !case.starts_with('.') && !golden.cases.iter().any(|c| c.name == case) {
            console.say(&format!("warning: expected a case `{case}` for {}, found none; remove it\n", entry.path().display()));
        }
    }
}

/// One line of what came of a case.
fn line(result: &CaseResult) -> String {
    let word = match (result.verdict, result.blessed) {
        (Verdict::Pass, true) => "blessed",
        (Verdict::Pass, false) => "pass",
        (Verdict::Left, _) => "FAILED",
        (Verdict::Wrong, _) => "ERROR",
        (Verdict::Cancelled, _) => "cancelled",
    };
    let wrong: Vec<String> = result.outputs.iter().filter(|o| !o.wrong.is_empty()).map(case::OutputResult::frames_wrong).collect();
    let what = if result.verdict == Verdict::Pass || wrong.is_empty() {
        let values: usize = result.outputs.iter().map(|o| o.frames.len()).sum();
        let others: usize = result.outputs.iter().map(|o| o.other_bits).sum();
        let others = if others > 0 && !result.blessed { format!(", {others} of other bits within their tolerance") } else { String::new() };
        format!("{}, {}{others}", count(result.outputs.len(), "output"), count(values, "value"))
    } else {
        wrong.join("; ")
    };
    format!("{word:<9} {} {}  {what}, {}\n", result.graph.display(), result.case, duration(result.time))
}
