//! Pegbar's command line as a library: [`run_cli`] takes arguments, a registry of nodes and a [`Console`], and gives an exit code.
//!
//! The engine is `pegbar_engine`, the nodes are `pegbar_nodes`; what is here reads arguments and shows results. One file a subcommand.

mod args;
mod cache;
mod check;
mod codes;
mod completions;
mod console;
mod diff;
mod edit;
mod explain;
mod fmt;
mod graph;
mod leave;
mod list;
mod lsp;
mod new;
mod observers;
mod plan;
mod plugin;
mod pool;
mod progress;
mod replay;
mod report;
mod resources;
mod run;
mod summary;
mod test;
mod trace;
mod upgrade;
mod wedge;
mod whence;
mod whose;
mod why;

use std::ffi::OsString;

use clap::Parser;
use pegbar_engine::registry::Registry;

pub use leave::leave;
pub use pool::Pool;

pub use console::{Console, EXIT_CANCELLED, EXIT_FAILED, EXIT_OK, EXIT_WRONG};

/// Runs one command.
///
/// Exit codes: 0 every output that was asked for exists and is whole; 1 a node failed or an output is missing; 2 the graph or the command
/// line is wrong; 130 cancelled.
pub fn run_cli<I, T>(args: I, registry: &Registry, console: &mut Console) -> u8
where
    I: IntoIterator<Item = T>,
    T: Into<OsString> + Clone,
{
    let cli = match args::Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => return console.clap(&error),
    };
    let registry = &match plugin::registry(registry, &cli, console) {
        Ok(registry) => registry,
        Err(code) => return code,
    };
    match cli.command {
        args::Command::Run(args) => run::run(&args, registry, console),
        args::Command::Wedge(args) => wedge::wedge(&args, registry, console),
        args::Command::Replay(args) => replay::replay(&args, registry, console),
        args::Command::Check(args) => check::check(&args, registry, console),
        args::Command::Nodes(args) => list::nodes(&args, registry, console),
        args::Command::Types(args) => list::types(&args, registry, console),
        args::Command::Explain(args) => explain::explain(&args, registry, console),
        args::Command::Graph(args) => graph::graph(&args, registry, console),
        args::Command::Fmt(args) => fmt::fmt(&args, console),
        args::Command::Test(args) => test::test(&args, registry, console),
        args::Command::Lsp(args) => lsp::lsp(&args, registry, console),
        args::Command::Cache(command) => cache::cache(&command, console),
        args::Command::Plan(args) => plan::plan(&args, registry, console),
        args::Command::Plugin(command) => plugin::plugin(&command, &cli.isolation.trust, registry, console),
        args::Command::Why(args) => why::why(&args, registry, console),
        args::Command::New(command) => new::new(&command, console),
        args::Command::Edit(args) => edit::edit(&args, console),
        args::Command::Upgrade(args) => upgrade::upgrade(&args, console),
        args::Command::Whence(args) => whence::whence(&args, console),
        args::Command::Diff(args) => diff::diff(&args, console),
        args::Command::Whose(args) => whose::whose(&args, registry, console),
        args::Command::Completions(args) => completions::completions(&args, console),
    }
}

#[cfg(test)]
mod tests;
