//! `pegbar new`: files to begin with.

pub(crate) mod plugin;

use std::io::Write;
use std::path::{Path, PathBuf};

use pegbar_engine::atomic;

use crate::args::NewCommand;
use crate::console::{Console, EXIT_OK, EXIT_WRONG};

const SHOW: &str = include_str!("new/show.ron");
const SEQUENCE: &str = include_str!("new/sequence.ron");
const SHOT: &str = include_str!("new/shot.ron");
const GRAPH: &str = include_str!("new/graph.ron");

pub(crate) fn new(command: &NewCommand, console: &mut Console) -> u8 {
    let files = match command {
        NewCommand::Show { path } => vec![
            (path.join("show.ron"), SHOW),
            (path.join("graphs/example.ron"), GRAPH),
            (path.join("sq010/sequence.ron"), SEQUENCE),
            (path.join("sq010/sh010/shot.ron"), SHOT),
        ],
        NewCommand::Sequence { path } => vec![(path.join("sequence.ron"), SEQUENCE)],
        NewCommand::Shot { path } => vec![(path.join("shot.ron"), SHOT)],
        NewCommand::Graph { path } => vec![(path.clone(), GRAPH)],
        NewCommand::Node { path, sdk } => return plugin::node(path, sdk.as_deref(), console),
    };
    let filled: Vec<(PathBuf, String)> = files.into_iter().map(|(path, template)| (path.clone(), fill(&path, template))).collect();
    if write_new(&filled, console) != EXIT_OK {
        return EXIT_WRONG;
    }
    if let NewCommand::Show { path } = command {
        let show = path.display();
        console.say(&format!("run it: pegbar run {show}/graphs/example.ron --shot {show}/sq010/sh010\n"));
    }
    if let NewCommand::Shot { path } | NewCommand::Sequence { path } = command
        && !path.ancestors().skip(1).any(|folder| folder.join("show.ron").exists())
    {
        console.say("warning: expected a show.ron in a folder above, found none: `pegbar new show DIR` makes one\n");
    }
    EXIT_OK
}

/// Writes files where there are none; all or nothing as far as that can be known beforehand.
fn write_new(files: &[(PathBuf, String)], console: &mut Console) -> u8 {
    if let Some((there, _)) = files.iter().find(|(path, _)| path.exists()) {
        console.say(&format!("error: expected nothing at {}, found a file: nothing was written\n", there.display()));
        return EXIT_WRONG;
    }
    for (path, text) in files {
        if let Err(error) = write(path, text) {
            console.say(&format!("error: {}: {error}\n", path.display()));
            return EXIT_WRONG;
        }
        console.out(&format!("{}\n", path.display()));
    }
    EXIT_OK
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    let absolute = std::path::absolute(path).map_err(|e| e.to_string())?;
    if let Some(folder) = absolute.parent() {
        std::fs::create_dir_all(folder).map_err(|e| e.to_string())?;
    }
    atomic::write(path, |out| out.write_all(text.as_bytes())).map_err(|e| e.to_string())
}

/// A template with the names of its file and of what it belongs to.
fn fill(path: &Path, template: &str) -> String {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let stem = absolute.file_stem().unwrap_or_default().to_string_lossy();
    let folder = absolute.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let name = if template == GRAPH { &stem } else { &folder };
    // The name stands inside texts of the template.
    let quoted = name.replace('\\', "/").replace('"', "'");
    template.replace("{name}", &quoted).replace("{file}", &path.display().to_string().replace('\n', " "))
}
