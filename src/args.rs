//! The command line's arguments and their help.

mod help;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use pegbar_engine::check::LoadOptions;
use pegbar_engine::exec::Policy;
use pegbar_engine::job::FrameSet;

use help::*;

/// Runs dataflow graphs of animation nodes: capture drawn motion, put it on other drawings, stylise it, lift it to 3D.
#[derive(Debug, Parser)]
#[command(name = "pegbar", version, about, after_help = CLI_EXAMPLES, arg_required_else_help = true, max_term_width = 110)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Plugins that may be used: a manifest NAME.plugin.ron, or a folder of them; several times. PEGBAR_PLUGINS names more.
    #[arg(long, value_name = "PATH", global = true)]
    pub(crate) plugins: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) isolation: IsolationArgs,
}

/// Where plugins run.
#[derive(Args, Debug)]
#[command(next_help_heading = "Plugins")]
pub(crate) struct IsolationArgs {
    /// Name of a plugin that runs in this process; several times. Others run in processes of their own, which cannot take this one down with them, use no
    /// network, and write to the output folder alone. What pegbar.lock names as `trusted` is trusted too.
    #[arg(long, value_name = "NAME", global = true)]
    pub(crate) trust: Vec<String>,
    /// Longest time in seconds that a task of a plugin may give no sign of life, 0 for ever; 600 if left out.
    #[arg(long, value_name = "SECONDS", global = true, value_parser = seconds)]
    pub(crate) plugin_timeout: Option<std::time::Duration>,
    /// Most memory for each process of a plugin, as 4GiB; half of what there is if left out.
    #[arg(long, value_name = "SIZE", global = true, value_parser = size)]
    pub(crate) plugin_memory: Option<u64>,
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
    /// How the progress of each variant is shown, as of `run`.
    #[arg(long, value_enum, default_value_t = Progress::Auto)]
    pub(crate) progress: Progress,
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

/// A time in seconds.
fn seconds(text: &str) -> Result<std::time::Duration, String> {
    let seconds = text.parse::<f64>().ok().and_then(|s| std::time::Duration::try_from_secs_f64(s).ok());
    seconds.ok_or_else(|| format!("expected a number of seconds, found `{text}`"))
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
