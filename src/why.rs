//! `pegbar why`: the first fact that differs from the run before.

use pegbar_engine::check::load;
use pegbar_engine::diag::{SourceMap, did_you_mean};
use pegbar_engine::graph::Graph;
use pegbar_engine::plan::PlanError;
use pegbar_engine::record::Records;
use pegbar_engine::registry::Registry;
use pegbar_engine::stamp::{Files, Memo};
use pegbar_engine::why::{Why, now, why as explain};
use serde::Serialize;

use crate::args::{Format, WhyArgs};
use crate::cache::{chosen, open};
use crate::check::say_total;
use crate::console::{Console, EXIT_OK, EXIT_WRONG};

#[derive(Serialize)]
struct Answer {
    graph: String,
    #[serde(flatten)]
    why: Why,
    text: String,
}

pub(crate) fn why(args: &WhyArgs, registry: &Registry, console: &mut Console) -> u8 {
    let loaded = load(&args.graph.graph, registry, &args.graph.load_options());
    console.diagnostics(&loaded.sources, &loaded.diagnostics);
    let name = args.graph.graph.display().to_string();
    let Some(graph) = &loaded.graph else {
        say_total(&name, &loaded, console);
        return EXIT_WRONG;
    };
    let why = match answer(args, graph, &loaded.sources, console) {
        Ok(why) => why,
        Err(wrong) => {
            console.say(&format!("error: {wrong}\n"));
            return EXIT_WRONG;
        }
    };
    match args.format {
        Format::Json => console.json(&Answer { graph: name, text: why.to_string(), why }),
        Format::Text => {
            console.out(&format!("{why}\n"));
            EXIT_OK
        }
    }
}

/// The answer, or what is wrong with the question.
fn answer(args: &WhyArgs, graph: &Graph, sources: &SourceMap, console: &mut Console) -> Result<Why, String> {
    let (node, frame) = &args.node;
    let unknown = || {
        let near = did_you_mean(node, graph.nodes.iter().map(|n| n.name.as_str()));
        let help = near.map(|n| format!("\n  help: did you mean `{n}`?")).unwrap_or_default();
        format!("expected a node of the graph, found `{node}`{help}")
    };
    let index = graph.find(node).ok_or_else(unknown)?;
    let no_cache = "expected a cache, which holds the records of runs, found none\n  help: name its folder with --cache DIR";
    let dir = chosen(&args.folder).ok_or(no_cache)?;
    let (records, notes) = Records::of(&dir, &args.graph.graph).load();
    notes.iter().for_each(|note| console.say(&format!("note: {note}\n")));
    let failed = |wrong: PlanError| format!("node `{}`: {}", graph.nodes[wrong.node].name, wrong.error);
    // Without a cache each file is read; there is no more to it.
    let cache = open(&dir).ok().flatten();
    let files = Files::new(cache.as_ref().map(|cache| cache as &dyn Memo));
    let now = now(graph, sources, index, *frame, &files).map_err(failed)?;
    explain(&records, &now, node, *frame).ok_or_else(unknown)
}
