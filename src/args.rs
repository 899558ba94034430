//! The command line's arguments and their help.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use pegbar_engine::check::LoadOptions;
use pegbar_engine::exec::Policy;
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
  pegbar run hat.ron --trace t.json                when each task ran: open t.json in ui.perfetto.dev
  pegbar run hat.ron --report hat.html             one page to look through: pictures, curves, times, settings, failures
  pegbar run hat.ron --save-failure failed         what failed, to be run alone: pegbar replay failed/NODE@FRAME

Progress goes to stderr, but for --progress json, which goes to stdout.";

const WEDGE_EXAMPLES: &str = "Examples:
  pegbar wedge hat.ron --set track.levels=1,2,4                     a run of each; out/wedge.png shows them, out/wedge.csv compares them
  pegbar wedge hat.ron --set matte.close_gaps=0..12x4 --set track.model=rigid,affine    every combination: 4 x 2 runs
  pegbar wedge hat.ron --set track.levels=2,4 --set track.model=rigid,affine --zip      the first of each, then the second of each
  pegbar wedge hat.ron --set matte.close_gaps=0..12/5 --only comp --frames 12           five values from 0 to 12; one frame of one node
  pegbar wedge hat.ron --var art=witch.png,bowler.png --show overlay --at 1,24,48       another picture, at three frames, on the sheet

Values are lists a,b,c, ranges 1..5 or 1..9x2 (ends included, every second) and 0..1/5 (five, evenly), or several of these. Commas in brackets and
quotes part nothing. A single value holds for all. What variants have in common is made once and taken from the cache by the others.
Each writes below DIR/wedge_NAME=VALUE/.

Exit codes:
  0    every variant is whole
  1    a variant failed; the others are whole
  2    the graph or the command line is wrong
  130  cancelled";

const CHECK_EXAMPLES: &str = "Examples:
  pegbar check hat.ron                           errors with the source underlined, on stderr
  pegbar check hat.ron --format json             for editors: every problem with file, line and column, on stdout
  pegbar check hat.ron --var plate=b.####.png    as `run` would see it with that parameter

Nothing is run and nothing is written. Files that the graph reads must be there.";

const REPLAY_EXAMPLES: &str = "Examples:
  pegbar replay failed/comp@12              runs the node again with what it was given
  pegbar replay failed/comp@12 --out /tmp/o and keeps what it makes once it no longer fails

Exit codes:
  0    the node no longer fails
  1    it fails: as in the run, or otherwise
  2    this is no whole bundle, or one of another version of the node type";

const EXPLAIN_EXAMPLES: &str = "Examples:
  pegbar explain track.affine    its inputs with units, ranges, defaults and choices, its outputs, its source, an example
  pegbar explain Affine2         the arrays that the type is made of, and the nodes that make and take it
  pegbar explain PB0142          what the code means, with a broken and a mended example";

const CACHE_EXAMPLES: &str = "Examples:
  pegbar cache stats                    how much there is, of what types, and how old
  pegbar cache gc --to 2GiB             remove what was not used for longest
  pegbar cache verify                   read everything, and remove what is damaged
  pegbar cache clear --cache /tmp/show  remove everything

The cache is the folder of --cache, else that of the variable PEGBAR_CACHE, else this user's own.
Runs may use it at the same time: what is gone is computed again.

Exit codes:
  0  it is done
  1  verify found damage, gc could not reach its aim, or the folder could not be read
  2  the command line is wrong";

const PLUGIN_EXAMPLES: &str = "Examples:
  pegbar plugin new grain --lang c                    grain/: sources, Makefile, README.md and a graph
  pegbar plugin manifest target/release/libgrain.so   writes target/release/grain.plugin.ron
  pegbar plugin lock shot.ron --plugins plugins       pins what shot.ron uses now
  pegbar nodes --plugins plugins                      lists the node types of plugins too
  pegbar run shot.ron --plugins plugins               runs a graph with them

A graph may name its plugins itself: plugins: [\"../plugins/grain\"].";

const PLUGIN_CHECK_EXAMPLES: &str = "Examples:
  pegbar plugin check target/release/libgrain.so                      a line for each check, with what to do about what failed
  pegbar plugin check grain.plugin.ron --set 'grain.scan.path=\"a.png\"'    with a setting that has no default
  pegbar plugin check libgrain.so --format json                       for a build that is to stop where one failed

Checks:
  library, manifest, schema, docs     it loads, and says the same in its manifest; every port and setting is explained
  ordinary, settings, sizes, values   every type of port is fed: usual, with both ends of ranges, in odd sizes, with NaN and the like
  frames                              one frame, frames below nought, empty sequences; no frame beyond a clock is asked for
  same, threads                       the same bits again, backwards, in a new instance, on many threads at once
  inputs, leaks, cancel               inputs stay as they are and are let go of; memory comes back; a task stops when it is told to

Exit codes:
  0    nothing failed
  1    a check failed
  2    there is no such plugin";

const PLAN_EXAMPLES: &str = "Examples:
  pegbar plan hat.ron                    what `pegbar run hat.ron` would do now
  pegbar plan hat.ron --memory 1GiB      whether it fits, and which node takes most
  pegbar plan hat.ron --format json      the same for programs

Times and sizes are those that earlier runs measured; without one they are not known.";

const WHY_EXAMPLES: &str = "Examples:
  pegbar why hat.ron comp            the first thing that changed in what `comp` is made from since it ran
  pegbar why hat.ron comp@12         for frame 12 alone
  pegbar why hat.ron comp --var plate=b.####.png    as `run` would see it with that parameter

Nothing is run. Every run that has a cache leaves a record there, which this looks into; of each graph the last eight are kept.";

const NEW_EXAMPLES: &str = "Examples:
  pegbar new show frogs              frogs/show.ron, frogs/graphs/example.ron, frogs/sq010/sh010/shot.ron
  pegbar new shot frogs/sq010/sh020  another shot
  pegbar new graph frogs/graphs/comp.ron
  pegbar new node plugins/grain.soft plugins/grain: a plugin in Rust with the node grain.soft
  pegbar run frogs/graphs/comp.ron --shot frogs/sq010/sh020";

const EDIT_EXAMPLES: &str = "Examples:
  pegbar edit hat.ron --set track.levels=4             comments and layout stay as they are
  pegbar edit hat.ron --rename swap=witch              and every \"@swap\" that reads it
  pegbar edit hat.ron --set 'swap.path=\"art/b.png\"'   values are RON: a text has its quotes

The file is written whole or not at all; what cannot be done changes nothing.";

const UPGRADE_EXAMPLES: &str = "Examples:
  pegbar upgrade --check shows                        what would change, and why
  pegbar upgrade shows                                changes it; everything else stays byte for byte
  pegbar upgrade shows --migrations studio_nodes.ron  with the migrations of your own nodes

Exit codes:
  0  every graph is up to date
  1  with --check: some are not
  2  a file cannot be read, or is no graph";

const WHENCE_EXAMPLES: &str = "Examples:
  pegbar whence out/hat/hat.0012.png                 the command that made it, and the graph
  pegbar whence out/hat/hat.0012.png --extract old   the graph and all that it used, as files
  pegbar diff old/hat.ron hat.ron                    and what has changed since

Exit codes:
  0  it is told
  1  the file does not say how it was made
  2  the file cannot be read";

const DIFF_EXAMPLES: &str = "Examples:
  pegbar diff old.ron new.ron                         layout, comments and the order of nodes do not count
  git show HEAD:hat.ron | pegbar diff - hat.ron       since the last commit

Exit codes:
  0  they mean the same
  1  they differ
  2  a file cannot be read, or callers break and the version number does not say so";

const WHOSE_EXAMPLES: &str = "Examples:
  pegbar whose hat.ron track.levels                          the default, or what the graph says
  pegbar whose hat.ron track.levels --shot show/sq010/sh020  and what show, sequence and shot say; the first line counts
  pegbar whose hat.ron '$plate' --shot show/sq010/sh020      the same for a parameter
  pegbar whose hat.ron --shot show/sq010/sh020               everything that is set from outside the graph";

const TEST_EXAMPLES: &str = "Examples:
  pegbar test hat.ron                              holds hat.ron against its reference, as hat.golden.ron beside it says
  pegbar test shows                                every graph below a folder that has a golden file beside it
  pegbar test shows --html review.html             and a page with expected, actual and difference of what changed
  pegbar test shows --junit junit.xml              for Jenkins and GitLab
  pegbar test hat.ron --bless small                what the case `small` gives now is right: keep it as the reference
  pegbar test shows --bless all                    the same of everything; prints what changed

hat.golden.ron, of which every field but `pegbar` may be left out:
  Golden(
      pegbar: 1,
      frames: \"1,12,24\",                      // else first, middle and last
      outputs: [\"image\", \"track.motion\"],   // else all that the graph declares
      params: { \"size\": (320, 180) },         // a small run, as of --var; set: {...} as of --set; shot: \"../sh010\"
      cut: { \"frames\": 24 },                  // a clock that ends earlier
      tolerances: { \"Image\": (at_most: 0.01, pixels: 4, reason: \"grain is seeded anew in each release\") },
      invariants: { \"*\": (finite: true), \"matte\": (within: (0, 1)) },
      same_on_threads: true,
      cases: { \"small\": (), \"sh020\": (shot: \"../show/sq010/sh020\") },
  )
A tolerance is of an output or a type; its metric is absolute, relative, rms or bits. The reference is kept in the folder hat.golden.

Exit codes:
  0    everything is as its reference says
  1    something left its reference, has none, or a node failed
  2    a golden, a graph or the command line is wrong
  130  cancelled by Ctrl-C";

const FMT_EXAMPLES: &str = "Examples:
  pegbar fmt hat.ron             rewrites the file in canonical layout; comments stay, and so does every name and number
  pegbar fmt shows               every .ron file below a folder
  pegbar fmt --check shows       rewrites nothing; exit code 1 where a file is not canonical
  pegbar fmt - < hat.ron         for editors: from the standard input to the standard output

A file that is no RON is left alone, and what is wrong with it is said.";

const LSP_EXAMPLES: &str = "Editors start it themselves, and speak the Language Server Protocol with it:
  VS Code    the extension in editors/vscode
  Neovim     vim.lsp.config(\"pegbar\", { cmd = { \"pegbar\", \"lsp\" }, filetypes = { \"pegbar\" } })
  Helix      [language-server.pegbar] command = \"pegbar\", args = [\"lsp\"]

No node is run. Exit code 0 if the editor said goodbye, 1 if it went away.";

/// Runs dataflow graphs of animation nodes: capture drawn motion, put it on other drawings, stylise it, lift it to 3D.
#[derive(Debug, Parser)]
#[command(name = "pegbar", version, about, after_help = CLI_EXAMPLES, arg_required_else_help = true, max_term_width = 110)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Plugins that may be used: a manifest NAME.plugin.ron, or a folder of them; several times. PEGBAR_PLUGINS names more.
    #[arg(long, value_name = "PATH", global = true)]
    pub(crate) plugins: Vec<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run a graph: make every file that its sinks write.
    #[command(after_help = RUN_EXAMPLES, after_long_help = format!("{RUN_EXAMPLES}\n\n{EXIT_CODES}"))]
    Run(RunArgs),
    /// Run a graph over ranges of its settings: a folder for each variant, a contact sheet and a table to compare them.
    #[command(after_help = WEDGE_EXAMPLES)]
    Wedge(WedgeArgs),
    /// Run one failed task again, alone, from what `run --save-failure` saved.
    #[command(after_help = REPLAY_EXAMPLES)]
    Replay(ReplayArgs),
    /// Check a graph: report everything that is wrong with it, and run nothing.
    #[command(after_help = CHECK_EXAMPLES)]
    Check(CheckArgs),
    /// List the node types, by family.
    #[command(
        after_help = "Examples:\n  pegbar nodes                                      one line each\n  pegbar nodes --format json | jq '.[].id'          everything that is known of them"
    )]
    Nodes(ListArgs),
    /// List the value types that travel along wires.
    #[command(
        after_help = "Examples:\n  pegbar types                 one line each\n  pegbar types --format json   with arrays, element types and shapes"
    )]
    Types(ListArgs),
    /// Explain a node type, a value type or a diagnostic code.
    #[command(after_help = EXPLAIN_EXAMPLES)]
    Explain(ExplainArgs),
    /// Draw a graph: nodes, ports, and wires with their types.
    #[command(
        after_help = "Examples:\n  pegbar graph hat.ron --format svg > hat.svg\n  pegbar graph hat.ron --format dot | dot -Tpdf > hat.pdf\n\nThe same graph is always drawn the same."
    )]
    Graph(DrawArgs),
    /// Lay graph files out in the one canonical way, with every comment kept.
    #[command(after_help = FMT_EXAMPLES)]
    Fmt(FmtArgs),
    /// Hold graphs against their goldens, and say which node left its reference first, at which frame.
    #[command(after_help = TEST_EXAMPLES)]
    Test(TestArgs),
    /// Serve an editor: diagnostics, completion, hover, renaming and the like while a graph is typed.
    #[command(after_help = LSP_EXAMPLES)]
    Lsp(LspArgs),
    /// Look after the cache: what results are kept from run to run.
    #[command(subcommand, after_help = CACHE_EXAMPLES)]
    Cache(CacheCommand),
    /// Say what a run would do: which tasks run and which do not, the memory and the time that it takes. Runs nothing.
    #[command(after_help = PLAN_EXAMPLES)]
    Plan(PlanArgs),
    /// Say why a node runs again: the first fact that differs from the run before, old and new, with file and line.
    #[command(after_help = WHY_EXAMPLES)]
    Why(WhyArgs),
    /// Begin a show, a sequence, a shot, a graph or a node: files to be changed to what you need. Nothing that is there is overwritten.
    #[command(subcommand, after_help = NEW_EXAMPLES)]
    New(NewCommand),
    /// Change a graph file: inputs, names, nodes; no byte changes but those that must.
    #[command(after_help = EDIT_EXAMPLES)]
    Edit(EditArgs),
    /// Bring graphs that were written for older nodes up to date; they mean afterwards what they meant before.
    #[command(after_help = UPGRADE_EXAMPLES)]
    Upgrade(UpgradeArgs),
    /// Say how a written PNG, OpenEXR or glTF file was made: its graph, with all that it was run with.
    #[command(after_help = WHENCE_EXAMPLES)]
    Whence(WhenceArgs),
    /// Say what differs between two graphs, by meaning rather than by line, and whether callers of the second break.
    #[command(after_help = DIFF_EXAMPLES)]
    Diff(DiffArgs),
    /// Say where a setting comes from: every layer that says something of it, with file and line.
    #[command(after_help = WHOSE_EXAMPLES)]
    Whose(WhoseArgs),
    /// Look after plugins: begin one, check it, write its manifest, pin the plugins of a graph.
    #[command(subcommand, after_help = PLUGIN_EXAMPLES)]
    Plugin(PluginCommand),
    /// Print a completion script for a shell.
    #[command(
        after_help = "Examples:\n  pegbar completions bash > ~/.local/share/bash-completion/completions/pegbar\n  pegbar completions zsh > ~/.zfunc/_pegbar"
    )]
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
    /// Folder of the shot: its shot.ron, and the sequence.ron and show.ron above it, set parameters and inputs.
    #[arg(long, value_name = "DIR")]
    pub(crate) shot: Option<PathBuf>,
    /// Folder in which graphs that the graph uses are looked for, besides its own; several times.
    #[arg(long, value_name = "DIR")]
    pub(crate) library: Vec<PathBuf>,
    /// Layer of every show: the weakest, below show.ron.
    #[arg(long, value_name = "FILE", env = "PEGBAR_SITE")]
    pub(crate) site: Option<PathBuf>,
}

impl GraphArgs {
    pub(crate) fn load_options(&self) -> LoadOptions {
        LoadOptions {
            out: self.out.clone(),
            variables: self.var.clone(),
            overrides: self.set.clone(),
            shot: self.shot.clone(),
            site: self.site.clone(),
            library: self.library.clone(),
            ..LoadOptions::default()
        }
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
    #[command(flatten)]
    pub(crate) resources: Resources,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t = Progress::Auto)]
    pub(crate) progress: Progress,
    /// Write when each task ran, on which thread, and the memory of results, for ui.perfetto.dev or chrome://tracing.
    #[arg(long, value_name = "FILE")]
    pub(crate) trace: Option<PathBuf>,
    /// Write a page that shows the run: the graph with what each node cost, what came out of each node, settings and who made them, failures, files.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) report: Option<PathBuf>,
    /// Save the first failure of each node, 8 at most, with all that the node was given, as DIR/NODE@FRAME for `pegbar replay`.
    #[arg(long, value_name = "DIR")]
    pub(crate) save_failure: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(crate) struct WedgeArgs {
    #[command(flatten)]
    pub(crate) graph: GraphArgs,
    /// The first value of each --set and --var that has several, then the second of each, and so on, rather than every combination.
    #[arg(long)]
    pub(crate) zip: bool,
    /// Output on the contact sheet, as NODE.OUTPUT; if left out that of --only, the first picture that the graph declares, or the first that it writes.
    #[arg(long, value_name = "NODE.OUTPUT")]
    pub(crate) show: Option<String>,
    /// Frames on the contact sheet, side by side; the one in the middle if left out.
    #[arg(long, value_name = "FRAMES", allow_hyphen_values = true)]
    pub(crate) at: Option<FrameSet>,
    /// Frames, as of `run`.
    #[arg(long, value_name = "FRAMES", allow_hyphen_values = true)]
    pub(crate) frames: Option<FrameSet>,
    /// A node or an output, as of `run`.
    #[arg(long, value_name = "NODE")]
    pub(crate) only: Option<String>,
    #[command(flatten)]
    pub(crate) resources: Resources,
}

/// What a run may use, and what it leaves for the next.
#[derive(Args, Debug)]
pub(crate) struct Resources {
    /// Threads; as many as the processor runs at once if left out. The result is the same for any number.
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Most memory for results and for what nodes work with, as 4GiB or 800MB; half of what there is if left out. What does not fit goes to the folder
    /// of the cache and comes back.
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub(crate) memory: Option<u64>,
    #[command(flatten)]
    pub(crate) folder: CacheFolder,
    /// Take nothing from the cache, and put nothing there.
    #[arg(long)]
    pub(crate) no_cache: bool,
    /// What is kept in the cache: auto (what costs more to make than to keep), always, never; or NODE=WHAT for one node, several times.
    #[arg(long = "keep", value_name = "WHAT", value_parser = kept)]
    pub(crate) kept: Vec<(Option<String>, Policy)>,
}

#[derive(Args, Debug)]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub(crate) graph: GraphArgs,
    /// Frames, as of `run`.
    #[arg(long, value_name = "FRAMES", allow_hyphen_values = true)]
    pub(crate) frames: Option<FrameSet>,
    /// A node, as of `run`.
    #[arg(long, value_name = "NODE")]
    pub(crate) only: Option<String>,
    #[command(flatten)]
    pub(crate) resources: Resources,
    /// Text for people, or JSON for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct ReplayArgs {
    /// Folder of one failure, as DIR/NODE@FRAME.
    #[arg(value_name = "BUNDLE")]
    pub(crate) bundle: PathBuf,
    /// Folder for what the node makes: OUTPUT.npz, and what it writes itself; made if it is not there.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) out: Option<PathBuf>,
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
pub(crate) struct FmtArgs {
    /// Graph files, or folders of them; `-` for the standard input.
    #[arg(value_name = "PATH", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Change nothing; say which files would change.
    #[arg(long)]
    pub(crate) check: bool,
}

#[derive(Args, Debug)]
pub(crate) struct TestArgs {
    /// Graphs with a golden file beside them, or folders of such.
    #[arg(value_name = "PATH", required = true)]
    pub(crate) paths: Vec<PathBuf>,
    /// Keep what a graph or a case gives now as its reference: `all`, a graph, a case, or GRAPH:CASE; several times. Runs no other.
    #[arg(long, value_name = "NAME")]
    pub(crate) bless: Vec<String>,
    /// Folder for pictures of what differs: expected, actual, and the difference.
    #[arg(long, value_name = "DIR", default_value = "out/golden")]
    pub(crate) out: PathBuf,
    /// Write a page to review what changed: one file, with all pictures in it.
    #[arg(long, value_name = "FILE")]
    pub(crate) html: Option<PathBuf>,
    /// Write the results as JUnit XML.
    #[arg(long, value_name = "FILE")]
    pub(crate) junit: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) resources: Resources,
}

#[derive(Args, Debug)]
pub(crate) struct ListArgs {
    /// One line each for people, or JSON with everything for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct ExplainArgs {
    /// Node type (track.affine), value type (Affine2) or code (PB0142).
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    /// Text for people, or JSON for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct DrawArgs {
    #[command(flatten)]
    pub(crate) graph: GraphArgs,
    /// Graphviz source, or a picture laid out by Pegbar itself.
    #[arg(long, value_enum, default_value_t = Drawing::Svg)]
    pub(crate) format: Drawing,
}

/// The form of a drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Drawing {
    /// Source for Graphviz.
    Dot,
    /// A picture.
    Svg,
}

/// What to do with the cache.
#[derive(Debug, Subcommand)]
pub(crate) enum CacheCommand {
    /// Say what is in it.
    Stats {
        #[command(flatten)]
        folder: CacheFolder,
        /// Text for people, or JSON for programs.
        #[arg(long, value_enum, default_value_t = Format::Text)]
        format: Format,
    },
    /// Remove what was not used for longest, and what killed runs left behind.
    Gc {
        #[command(flatten)]
        folder: CacheFolder,
        /// Bytes to be left at most, as 500MB or 2GiB.
        #[arg(long, value_name = "SIZE", value_parser = size)]
        to: u64,
    },
    /// Read every value, and remove those that are damaged.
    Verify {
        #[command(flatten)]
        folder: CacheFolder,
    },
    /// Remove everything.
    Clear {
        #[command(flatten)]
        folder: CacheFolder,
    },
}

/// What to do with plugins.
#[derive(Debug, Subcommand)]
pub(crate) enum PluginCommand {
    /// Load a library and write its manifest NAME.plugin.ron beside it, or update it. Runs code of the library.
    Manifest {
        /// Library of the plugin.
        #[arg(value_name = "LIBRARY")]
        library: PathBuf,
    },
    /// Begin a plugin: sources of one node, how they are built, and a graph that uses it. Nothing that is there is overwritten.
    New {
        /// Folder; its name is that of the plugin, a lower case word.
        #[arg(value_name = "DIR")]
        path: PathBuf,
        /// Language.
        #[arg(long, value_enum, default_value_t = Language::Rust)]
        lang: Language,
        /// Folder of Pegbar's source, for Rust; looked for above DIR and above this program if left out.
        #[arg(long, value_name = "DIR")]
        sdk: Option<PathBuf>,
    },
    /// Hold a plugin against its contract: manifest, docs, odd sizes, broken values, many threads, leaks. Runs its code in a process of its own.
    #[command(after_help = PLUGIN_CHECK_EXAMPLES)]
    Check(PluginCheckArgs),
    /// The process with a plugin's code that `check` starts.
    #[command(hide = true)]
    Probe(PluginProbeArgs),
    /// Pin the plugins that a graph uses: writes their digests to pegbar.lock beside it. Loads none of them.
    Lock(GraphArgs),
}

#[derive(Args, Debug)]
pub(crate) struct PluginCheckArgs {
    /// Library of the plugin, or its manifest.
    #[arg(value_name = "LIBRARY")]
    pub(crate) path: PathBuf,
    /// What stands at a setting while the node is tried, in place of its default: for paths that are read, and others that have none.
    #[arg(long, value_name = "NODE.INPUT=VALUE", value_parser = pair)]
    pub(crate) set: Vec<(String, String)>,
    /// Seconds that one check may take.
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub(crate) timeout: u64,
    /// Text for people, or JSON for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct PluginProbeArgs {
    #[arg(value_name = "LIBRARY")]
    pub(crate) library: PathBuf,
    #[arg(long, value_parser = pair)]
    pub(crate) set: Vec<(String, String)>,
    #[arg(long, default_value_t = 0)]
    pub(crate) from: usize,
}

/// Which cache.
#[derive(Args, Debug)]
pub(crate) struct CacheFolder {
    /// Folder of the cache; PEGBAR_CACHE or this user's own if left out.
    #[arg(long, value_name = "DIR")]
    pub(crate) cache: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(crate) struct WhyArgs {
    #[command(flatten)]
    pub(crate) graph: GraphArgs,
    /// Node, and one of its frames if need be: comp@12.
    #[arg(value_name = "NODE[@FRAME]", value_parser = node_at)]
    pub(crate) node: (String, Option<i64>),
    #[command(flatten)]
    pub(crate) folder: CacheFolder,
    /// Text for people, or JSON for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

/// The language of a plugin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Language {
    /// Rust, with the SDK.
    Rust,
    /// C11, with the header.
    C,
    /// C++17, with the header and its skeleton.
    Cpp,
}

/// What is begun.
#[derive(Debug, Subcommand)]
pub(crate) enum NewCommand {
    /// A show: a folder with its layer, a graph, a sequence and a shot.
    Show {
        /// Folder; made if it is not there.
        #[arg(value_name = "DIR")]
        path: PathBuf,
    },
    /// A sequence: a folder in a show's.
    Sequence {
        /// Folder; made if it is not there.
        #[arg(value_name = "DIR")]
        path: PathBuf,
    },
    /// A shot: a folder in a sequence's or a show's.
    Shot {
        /// Folder; made if it is not there.
        #[arg(value_name = "DIR")]
        path: PathBuf,
    },
    /// A node type in Rust: a plugin of its own, or a file more in the plugin that is there.
    Node {
        /// Its id, PLUGIN.WORD, in the folder where the plugin PLUGIN is or is to be.
        #[arg(value_name = "PLUGIN.WORD")]
        path: PathBuf,
        /// Folder of Pegbar's source; looked for above the plugin and above this program if left out.
        #[arg(long, value_name = "DIR")]
        sdk: Option<PathBuf>,
    },
    /// A graph that runs as it is.
    Graph {
        /// File (.ron).
        #[arg(value_name = "FILE")]
        path: PathBuf,
    },
}

#[derive(Args, Debug)]
pub(crate) struct EditArgs {
    /// Graph file (.ron).
    #[arg(value_name = "GRAPH")]
    pub(crate) graph: PathBuf,
    /// Give an input a value, in RON: NODE.INPUT=VALUE. Edits are made in the order of this list: set, unset, rename, rename-param, add, remove.
    #[arg(long, value_name = "NODE.INPUT=VALUE", value_parser = pair)]
    pub(crate) set: Vec<(String, String)>,
    /// Take an input away, so that its default counts.
    #[arg(long, value_name = "NODE.INPUT")]
    pub(crate) unset: Vec<String>,
    /// Rename a node, with all that reads it.
    #[arg(long, value_name = "OLD=NEW", value_parser = pair)]
    pub(crate) rename: Vec<(String, String)>,
    /// Rename a parameter, with all that reads it.
    #[arg(long, value_name = "OLD=NEW", value_parser = pair)]
    pub(crate) rename_param: Vec<(String, String)>,
    /// Add a node: NAME=(type: "...", ...).
    #[arg(long, value_name = "NAME=RECORD", value_parser = pair)]
    pub(crate) add: Vec<(String, String)>,
    /// Remove a node that nothing reads.
    #[arg(long, value_name = "NODE")]
    pub(crate) remove: Vec<String>,
    /// Print the result and leave the file alone.
    #[arg(long)]
    pub(crate) print: bool,
}

#[derive(Args, Debug)]
pub(crate) struct UpgradeArgs {
    /// Graph files, or folders of them.
    #[arg(value_name = "PATH", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// More migrations, of plugins or of your own: RON files of records (node: "old.id", to: "new.id", inputs: {...}, set: {...}, note: "...").
    #[arg(long, value_name = "FILE")]
    pub(crate) migrations: Vec<PathBuf>,
    /// Change nothing; say what would change.
    #[arg(long)]
    pub(crate) check: bool,
}

#[derive(Args, Debug)]
pub(crate) struct WhenceArgs {
    /// A picture or a character that a graph wrote.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Write the graph, and the graphs and layers that it used, below this folder.
    #[arg(long, value_name = "DIR")]
    pub(crate) extract: Option<PathBuf>,
    /// Text for people, or JSON for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct DiffArgs {
    /// Graph file as it was; `-` for the standard input.
    #[arg(value_name = "OLD")]
    pub(crate) old: PathBuf,
    /// Graph file as it is.
    #[arg(value_name = "NEW")]
    pub(crate) new: PathBuf,
    /// Text for people, or JSON for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct WhoseArgs {
    #[command(flatten)]
    pub(crate) graph: GraphArgs,
    /// Input as NODE.INPUT, parameter as $NAME, all of a node as NODE; everything that is said from outside the graph if left out.
    #[arg(value_name = "NODE.INPUT")]
    pub(crate) name: Option<String>,
    /// Text for people, or JSON for programs.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args, Debug)]
pub(crate) struct LspArgs {
    /// Over the standard input and output: the only way, and the default.
    #[arg(long)]
    pub(crate) stdio: bool,
    /// Folder that `$out` stands for; `out` in the folder that the editor has open if left out.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Folder of a shot, for which graphs are then checked.
    #[arg(long, value_name = "DIR")]
    pub(crate) shot: Option<PathBuf>,
    /// Folder in which graphs that a graph uses are looked for, besides its own; several times.
    #[arg(long, value_name = "DIR")]
    pub(crate) library: Vec<PathBuf>,
    /// Layer of every show.
    #[arg(long, value_name = "FILE", env = "PEGBAR_SITE")]
    pub(crate) site: Option<PathBuf>,
}

impl LspArgs {
    pub(crate) fn load_options(&self) -> LoadOptions {
        let (shot, site, library) = (self.shot.clone(), self.site.clone(), self.library.clone());
        LoadOptions { out: self.out.clone().unwrap_or_default(), shot, site, library, ..LoadOptions::default() }
    }
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

/// `always`, or `NODE=always`.
fn kept(text: &str) -> Result<(Option<String>, Policy), String> {
    let (node, what) = text.rsplit_once('=').map_or((None, text), |(node, what)| (Some(node.to_owned()), what));
    let policy = match what {
        "auto" => Policy::Auto,
        "always" => Policy::Always,
        "never" => Policy::Never,
        _ => return Err(format!("expected auto, always or never, found `{what}`")),
    };
    Ok((node, policy))
}

/// Bytes: a number, and a unit if it is not bytes.
pub(crate) fn size(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, u64); 9] = [
        ("", 1),
        ("B", 1),
        ("kB", 1000),
        ("MB", 1_000_000),
        ("GB", 1_000_000_000),
        ("TB", 1_000_000_000_000),
        ("KiB", 1 << 10),
        ("MiB", 1 << 20),
        ("GiB", 1 << 30),
    ];
    let digits = text.bytes().take_while(|b| b.is_ascii_digit() || *b == b'.').count();
    let (number, unit) = text.split_at(digits);
    let unit = UNITS.iter().find(|(name, _)| name.eq_ignore_ascii_case(unit.trim_start())).map(|(_, bytes)| *bytes);
    let bytes = number.parse::<f64>().ok().zip(unit).map(|(n, unit)| n * unit as f64);
    match bytes {
        Some(bytes) if bytes < 2f64.powi(63) => Ok(bytes as u64),
        _ => Err(format!("expected a size as 500MB, 1.5GiB or 1000000, found `{text}`")),
    }
}

fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim().to_owned(), value.to_owned())),
        _ => Err(format!("expected NAME=VALUE, found `{text}`")),
    }
}

fn node_at(text: &str) -> Result<(String, Option<i64>), String> {
    // References are written `@node`, so that one may well stand here.
    let text = text.strip_prefix('@').unwrap_or(text);
    match text.rsplit_once('@') {
        None => Ok((text.to_owned(), None)),
        Some((node, frame)) => match frame.parse() {
            Ok(frame) => Ok((node.to_owned(), Some(frame))),
            Err(_) => Err(format!("expected a frame number after `@`, found `{frame}`")),
        },
    }
}
