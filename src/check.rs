//! `pegbar check`: everything that is wrong with a graph, at once.

use pegbar_engine::check::{Loaded, load};
use pegbar_engine::diag::JsonDiagnostic;
use pegbar_engine::registry::Registry;
use serde::Serialize;

use crate::args::{CheckArgs, Format};
use crate::console::{Console, EXIT_OK, EXIT_WRONG, count};

#[derive(Serialize)]
struct Report {
    graph: String,
    ok: bool,
    errors: usize,
    warnings: usize,
    nodes: Option<usize>,
    diagnostics: Vec<JsonDiagnostic>,
}

pub(crate) fn check(args: &CheckArgs, registry: &Registry, console: &mut Console) -> u8 {
    let loaded = load(&args.graph.graph, registry, &args.graph.load_options());
    let graph = args.graph.graph.display().to_string();
    let fine = loaded.graph.is_some();
    match args.format {
        Format::Json => {
            console.json(&report(graph, &loaded));
        }
        Format::Text => {
            console.diagnostics(&loaded.sources, &loaded.diagnostics);
            match &loaded.graph {
                Some(g) => console.out(&format!("{graph}: fine, {}{}\n", count(g.nodes.len(), "node"), clocks(g))),
                None => say_total(&graph, &loaded, console),
            }
        }
    }
    if fine { EXIT_OK } else { EXIT_WRONG }
}

/// How many errors there were, with a way to learn more of the first.
pub(crate) fn say_total(graph: &str, loaded: &Loaded, console: &mut Console) {
    let errors = loaded.errors();
    let warnings = loaded.diagnostics.len() - errors;
    let and = if warnings > 0 { format!(" and {}", count(warnings, "warning")) } else { String::new() };
    let more = loaded.diagnostics.first().map(|d| format!("; `pegbar explain {}` says more", d.code)).unwrap_or_default();
    console.say(&format!("\n{graph}: {}{and}{more}\n", count(errors, "error")));
}

fn clocks(graph: &pegbar_engine::graph::Graph) -> String {
    graph.clocks.iter().map(|c| format!(", {} {}-{} at {:.5} fps", c.name, c.first, c.last, c.rate()).replace(".00000", "")).collect()
}

fn report(graph: String, loaded: &Loaded) -> Report {
    let errors = loaded.errors();
    Report {
        graph,
        ok: loaded.graph.is_some(),
        errors,
        warnings: loaded.diagnostics.len() - errors,
        nodes: loaded.graph.as_ref().map(|g| g.nodes.len()),
        diagnostics: loaded.diagnostics.iter().map(|d| loaded.sources.to_json(d)).collect(),
    }
}
