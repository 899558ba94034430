//! `pegbar graph`: a picture of a graph.

use pegbar_engine::check::load;
use pegbar_engine::draw;
use pegbar_engine::registry::Registry;

use crate::args::{DrawArgs, Drawing};
use crate::check::say_total;
use crate::console::{Console, EXIT_OK, EXIT_WRONG};

pub(crate) fn graph(args: &DrawArgs, registry: &Registry, console: &mut Console) -> u8 {
    let loaded = load(&args.graph.graph, registry, &args.graph.load_options());
    console.diagnostics(&loaded.sources, &loaded.diagnostics);
    match &loaded.graph {
        Some(graph) => {
            let text = match args.format {
                Drawing::Dot => draw::dot(graph),
                Drawing::Svg => draw::svg(graph),
            };
            console.out(&text);
            EXIT_OK
        }
        None => {
            say_total(&args.graph.graph.display().to_string(), &loaded, console);
            EXIT_WRONG
        }
    }
}
