//! Examples and exit codes, as `--help` shows them below the arguments.

pub(super) const EXIT_CODES: &str = "Exit codes:
  0    every output that was asked for exists and is whole
  1    a node failed, or an output is missing
  2    the graph or the command line is wrong
  130  cancelled by Ctrl-C (a second Ctrl-C ends at once)";

pub(super) const CLI_EXAMPLES: &str = "Examples:
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

pub(super) const RUN_EXAMPLES: &str = "Examples:
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

pub(super) const WEDGE_EXAMPLES: &str = "Examples:
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

pub(super) const CHECK_EXAMPLES: &str = "Examples:
  pegbar check hat.ron                           errors with the source underlined, on stderr
  pegbar check hat.ron --format json             for editors: every problem with file, line and column, on stdout
  pegbar check hat.ron --var plate=b.####.png    as `run` would see it with that parameter

Nothing is run and nothing is written. Files that the graph reads must be there.";

pub(super) const REPLAY_EXAMPLES: &str = "Examples:
  pegbar replay failed/comp@12              runs the node again with what it was given
  pegbar replay failed/comp@12 --out /tmp/o and keeps what it makes once it no longer fails

Exit codes:
  0    the node no longer fails
  1    it fails: as in the run, or otherwise
  2    this is no whole bundle, or one of another version of the node type";

pub(super) const EXPLAIN_EXAMPLES: &str = "Examples:
  pegbar explain track.affine    its inputs with units, ranges, defaults and choices, its outputs, its source, an example
  pegbar explain Affine2         the arrays that the type is made of, and the nodes that make and take it
  pegbar explain PB0142          what the code means, with a broken and a mended example";

pub(super) const CACHE_EXAMPLES: &str = "Examples:
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

pub(super) const PLUGIN_EXAMPLES: &str = "Examples:
  pegbar plugin new grain --lang c                    grain/: sources, Makefile, README.md and a graph
  pegbar plugin manifest target/release/libgrain.so   writes target/release/grain.plugin.ron
  pegbar plugin lock shot.ron --plugins plugins       pins what shot.ron uses now
  pegbar nodes --plugins plugins                      lists the node types of plugins too
  pegbar run shot.ron --plugins plugins               runs a graph with them

A graph may name its plugins itself: plugins: [\"../plugins/grain\"].
Plugins run in processes of their own. `pegbar plugin lock shot.ron --trust grain` has `grain` run in that of every run of shot.ron.";

pub(super) const PLUGIN_CHECK_EXAMPLES: &str = "Examples:
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

pub(super) const PLAN_EXAMPLES: &str = "Examples:
  pegbar plan hat.ron                    what `pegbar run hat.ron` would do now
  pegbar plan hat.ron --memory 1GiB      whether it fits, and which node takes most
  pegbar plan hat.ron --format json      the same for programs

Times and sizes are those that earlier runs measured; without one they are not known.";

pub(super) const WHY_EXAMPLES: &str = "Examples:
  pegbar why hat.ron comp            the first thing that changed in what `comp` is made from since it ran
  pegbar why hat.ron comp@12         for frame 12 alone
  pegbar why hat.ron comp --var plate=b.####.png    as `run` would see it with that parameter

Nothing is run. Every run that has a cache leaves a record there, which this looks into; of each graph the last eight are kept.";

pub(super) const NEW_EXAMPLES: &str = "Examples:
  pegbar new show frogs              frogs/show.ron, frogs/graphs/example.ron, frogs/sq010/sh010/shot.ron
  pegbar new shot frogs/sq010/sh020  another shot
  pegbar new graph frogs/graphs/comp.ron
  pegbar new node plugins/grain.soft plugins/grain: a plugin in Rust with the node grain.soft
  pegbar run frogs/graphs/comp.ron --shot frogs/sq010/sh020";

pub(super) const EDIT_EXAMPLES: &str = "Examples:
  pegbar edit hat.ron --set track.levels=4             comments and layout stay as they are
  pegbar edit hat.ron --rename swap=witch              and every \"@swap\" that reads it
  pegbar edit hat.ron --set 'swap.path=\"art/b.png\"'   values are RON: a text has its quotes

The file is written whole or not at all; what cannot be done changes nothing.";

pub(super) const UPGRADE_EXAMPLES: &str = "Examples:
  pegbar upgrade --check shows                        what would change, and why
  pegbar upgrade shows                                changes it; everything else stays byte for byte
  pegbar upgrade shows --migrations studio_nodes.ron  with the migrations of your own nodes

Exit codes:
  0  every graph is up to date
  1  with --check: some are not
  2  a file cannot be read, or is no graph";

pub(super) const WHENCE_EXAMPLES: &str = "Examples:
  pegbar whence out/hat/hat.0012.png                 the command that made it, and the graph
  pegbar whence out/hat/hat.0012.png --extract old   the graph and all that it used, as files
  pegbar diff old/hat.ron hat.ron                    and what has changed since

Exit codes:
  0  it is told
  1  the file does not say how it was made
  2  the file cannot be read";

pub(super) const DIFF_EXAMPLES: &str = "Examples:
  pegbar diff old.ron new.ron                         layout, comments and the order of nodes do not count
  git show HEAD:hat.ron | pegbar diff - hat.ron       since the last commit

Exit codes:
  0  they mean the same
  1  they differ
  2  a file cannot be read, or callers break and the version number does not say so";

pub(super) const WHOSE_EXAMPLES: &str = "Examples:
  pegbar whose hat.ron track.levels                          the default, or what the graph says
  pegbar whose hat.ron track.levels --shot show/sq010/sh020  and what show, sequence and shot say; the first line counts
  pegbar whose hat.ron '$plate' --shot show/sq010/sh020      the same for a parameter
  pegbar whose hat.ron --shot show/sq010/sh020               everything that is set from outside the graph";

pub(super) const TEST_EXAMPLES: &str = "Examples:
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

pub(super) const FMT_EXAMPLES: &str = "Examples:
  pegbar fmt hat.ron             rewrites the file in canonical layout; comments stay, and so does every name and number
  pegbar fmt shows               every .ron file below a folder
  pegbar fmt --check shows       rewrites nothing; exit code 1 where a file is not canonical
  pegbar fmt - < hat.ron         for editors: from the standard input to the standard output

A file that is no RON is left alone, and what is wrong with it is said.";

pub(super) const LSP_EXAMPLES: &str = "Editors start it themselves, and speak the Language Server Protocol with it:
  VS Code    the extension in editors/vscode
  Neovim     vim.lsp.config(\"pegbar\", { cmd = { \"pegbar\", \"lsp\" }, filetypes = { \"pegbar\" } })
  Helix      [language-server.pegbar] command = \"pegbar\", args = [\"lsp\"]

No node is run. Exit code 0 if the editor said goodbye, 1 if it went away.";
