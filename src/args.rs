//! The command line's arguments and their help.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use pegbar_engine::check::LoadOptions;
use pegbar_engine::job::FrameSet;

const EXIT_CODES: &str = "Exit codes:
  0    every output that was asked for exists and is whole
  1    a node failed, or an output is missing
  2    the graph or the command line is wrong
  130  cancelled by Ctrl-C (a second Ctrl-C ends at once)";

const CLI_EXAMPLES: &str = "Examples:
  pegbar check examples/hat/hat.ron        find everything that is wrong, run nothing
  pegbar run examples/hat/hat.ron          write its pictures under out/
  pegbar nodes                             list the node types
  pegbar explain track.affine              inputs, units, ranges and defaults of one
  pegbar explain PB0142                    what an error code means, and how to mend it

Exit codes:
  0    every output that was asked for exists and is whole
  1    a node failed, or an output is missing
  2    the graph or the command line is wrong
  130  cancelled by Ctrl-C (a second Ctrl-C ends at once)";

const RUN_EXAMPLES: &str = "Examples:
  pegbar run hat.ron                               all frames, written under out/
  pegbar run hat.ron --frames 1-48x2 --out /tmp/t  every second frame, elsewhere
  pegbar run hat.ron --var plate=clips/b.####.png  another value for a parameter of the graph
  pegbar run hat.ron --set track.levels=4          another value for an input of a node
  pegbar run hat.ron --only track.motion           the motion alone, as out/track.motion.npz
  pegbar run hat.ron --progress json | jq .        for a farm: one JSON object a line

Progress goes to stderr, but for --progress json, which goes to stdout.";

const CHECK_EXAMPLES: &str = "Examples:
  pegbar check hat.ron                           errors with the source underlined, on stderr
  pegbar check hat.ron --format json             for editors: every problem with file, line and column, on stdout
  pegbar check hat.ron --var plate=b.####.png    as `run` would see it with that parameter

Nothing is run and nothing is written. Files that the graph reads must be there.";

/// Runs dataflow graphs of animation nodes: capture drawn motion, put it on other drawings, stylise it, lift it to 3D.
#[derive(Debug, Parser)]
#[command(name = "pegbar", version, about, after_help = CLI_EXAMPLES, arg_required_else_help = true, max_term_width = 110)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run a graph: make every file that its sinks write.
    #[command(after_help = RUN_EXAMPLES, after_long_help = format!("{RUN_EXAMPLES}\n\n{EXIT_CODES}"))]
    Run(RunArgs),
    /// Check a graph: report everything that is wrong with it, and run nothing.
    #[command(after_help = CHECK_EXAMPLES)]
    Check(CheckArgs),
    /// Print a completion script for a shell.
    #[command(after_help = "Examples:\n  pegbar completions bash > ~/.local/share/bash-completion/completions/pegbar\n  pegbar completions zsh > ~/.zfunc/_pegbar")]
    Completions(CompletionsArgs),
}

/// A graph, and what is set from outside.
#[derive(Args, Debug)]
pub(crate) struct GraphArgs {
    /// Graph file (.ron).
    #[arg(value_name = "GRAPH")]
    pub(crate) graph: PathBuf,
    /// Folder that `$out` stands for in the graph; made if it is not there. Nothing is written outside it.
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Value of an input of a node, in place of what the graph says: a literal as in the graph file, or a bare word.
    #[arg(long = "set", value_name = "NODE.INPUT=VALUE", value_parser = pair)]
    pub(crate) set: Vec<(String, String)>,
    /// Value of a parameter of the graph.
    #[arg(long = "var", value_name = "NAME=VALUE", value_parser = pair)]
    pub(crate) var: Vec<(String, String)>,
}

impl GraphArgs {
    pub(crate) fn load_options(&self) -> LoadOptions {
        LoadOptions { out: self.out.clone(), variables: self.var.clone(), overrides: self.set.clone() }
    }
}

#[derive(Args, Debug)]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) graph: GraphArgs,
    /// Frames to make: 5, 1-48, 1-48x2 (every second), -10--5, or a list as 1-10,20. All frames of the graph if left out.
    #[arg(long, value_name = "FRAMES", allow_hyphen_values = true)]
    pub(crate) frames: Option<FrameSet>,
    /// Make only this node. A node that writes no file has its outputs written to DIR/NODE.OUTPUT.npz; NODE.OUTPUT takes one of them.
    #[arg(long, value_name = "NODE")]
    pub(crate) only: Option<String>,
    /// Threads; as many as the processor runs at once if left out. The result is the same for any number.
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t = Progress::Auto)]
    pub(crate) progress: Progress,
}

#[derive(Args, Debug)]
pub(crate) struct CheckArgs {
    #[command(flatten)]
    pub(crate) graph: GraphArgs,
    /// Text for people on stderr, or JSON for programs on stdout.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct CompletionsArgs {
    /// Shell.
    #[arg(value_enum)]
    pub(crate) shell: clap_complete::Shell,
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Progress {
    /// A bar on a terminal, else plain lines.
    Auto,
    /// A line when a node starts or is done, and a total every few seconds, on stderr.
    Plain,
    /// JSON objects, one a line, on stdout.
    Json,
    /// Errors alone.
    None,
}

/// The form of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// For people.
    Text,
    /// For programs.
    Json,
}

fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim().to_owned(), value.to_owned())),
        _ => Err(format!("expected NAME=VALUE, found `{text}`")),
    }
}
