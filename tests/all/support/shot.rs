//! A temporary folder with a graph in it, and the command line run on that.

use std::path::{Path, PathBuf};

use pegbar::{Console, run_cli};
use pegbar_engine::node::Cancel;
use pegbar_engine::plugin::{Isolation, Workers};

/// What a command left behind.
pub(crate) struct Ran {
    pub(crate) code: u8,
    pub(crate) out: String,
    pub(crate) err: String,
}

/// Runs `pegbar ARGS` in this process, plugins too.
pub(crate) fn cli(args: &[&str]) -> Ran {
    cli_in(&Isolation::Off, args)
}

/// Plugins in workers of the program.
pub(crate) fn workers() -> Workers {
    Workers::new(env!("CARGO_BIN_EXE_pegbar"))
}

/// Runs `pegbar ARGS` in this process, and plugins there.
pub(crate) fn cli_in(isolation: &Isolation, args: &[&str]) -> Ran {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let mut console = Console { stdout: &mut out, stderr: &mut err, is_terminal: false, colour: false, cancel: Cancel::default() };
    let code = run_cli(
        std::iter::once("pegbar").chain(args.iter().copied()),
        &pegbar_nodes::registry().with_isolation(isolation.clone()),
        &mut console,
    );
    Ran { code, out: String::from_utf8(out).unwrap(), err: String::from_utf8(err).unwrap() }
}

/// A folder with the graph `g.ron`.
pub(crate) struct Shot(tempfile::TempDir);

impl Shot {
    /// A graph of `frames` frames with these nodes.
    pub(crate) fn new(frames: i64, nodes: &str) -> Self {
        let shot = Self(tempfile::tempdir().unwrap());
        shot.graph(frames, nodes);
        shot
    }

    /// Writes the graph anew.
    pub(crate) fn graph(&self, frames: i64, nodes: &str) {
        let text = format!(
            "Graph(\n    pegbar: 1,\n    frames: (first: 1, last: {frames}, fps: 24),\n    nodes: {{\n        {nodes}\n    }},\n)\n"
        );
        self.put("g.ron", text.as_bytes());
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    pub(crate) fn get(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    /// `pegbar run g.ron --out FOLDER --progress none`, in this process.
    pub(crate) fn run_to(&self, out: &Path) -> Ran {
        let graph = self.path("g.ron");
        cli(&["run", graph.to_str().unwrap(), "--out", out.to_str().unwrap(), "--progress", "none"])
    }

    /// The same into the folder `out` beside the graph.
    pub(crate) fn run(&self) -> Ran {
        self.run_to(&self.path("out"))
    }

    /// Names of the files in a folder beside the graph; none where it is not there.
    pub(crate) fn names(&self, folder: &str) -> Vec<String> {
        names(&self.path(folder))
    }
}

/// Names of what is in a folder, hidden files too.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}
