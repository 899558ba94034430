//! `pegbar fmt`: graph files in canonical layout.

use std::io::Write;
use std::path::{Path, PathBuf};

use pegbar_engine::atomic;
use pegbar_engine::diag::SourceMap;
use pegbar_engine::syntax::{Tree, format};

use crate::args::FmtArgs;
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};

/// What became of one text.
enum Formatted {
    /// It is canonical already.
    Same,
    /// It is not; this is.
    Other(String),
    /// It is no RON.
    Broken,
}

pub(crate) fn fmt(args: &FmtArgs, console: &mut Console) -> u8 {
    if args.files.iter().any(|f| f.as_os_str() == "-") {
        return pipe(args, console);
    }
    let mut files = Vec::new();
    for path in &args.files {
        if let Err(error) = graph_files(path, &mut files) {
            console.say(&format!("error: {}: {error}\n", path.display()));
            return EXIT_WRONG;
        }
    }
    let (mut changed, mut broken) = (0, 0);
    for file in &files {
        match one(file, args.check, console) {
            Ok(Formatted::Same) => (),
            Ok(Formatted::Other(_)) => changed += 1,
            Ok(Formatted::Broken) => broken += 1,
            Err(error) => {
                console.say(&format!("error: {}: {error}\n", file.display()));
                broken += 1;
            }
        }
    }
    let what = if args.check { "not canonical" } else { "rewritten" };
    console.say(&format!("{}, {changed} {what}, {broken} left alone because of errors\n", count(files.len(), "file")));
    match (broken, args.check && changed > 0) {
        (0, false) => EXIT_OK,
        (0, true) => EXIT_FAILED,
        _ => EXIT_WRONG,
    }
}

/// From the standard input to the standard output, for editors.
fn pipe(args: &FmtArgs, console: &mut Console) -> u8 {
    let text = match std::io::read_to_string(std::io::stdin()) {
        Ok(text) => text,
        Err(error) => {
            console.say(&format!("error: the standard input cannot be read: {error}\n"));
            return EXIT_WRONG;
        }
    };
    match (formatted("standard input", &text, console), args.check) {
        (Formatted::Broken, _) => EXIT_WRONG,
        (Formatted::Same, true) => EXIT_OK,
        (Formatted::Other(_), true) => EXIT_FAILED,
        (Formatted::Same, false) => {
            console.out(&text);
            EXIT_OK
        }
        (Formatted::Other(new), false) => {
            console.out(&new);
            EXIT_OK
        }
    }
}

fn one(file: &Path, only_check: bool, console: &mut Console) -> std::io::Result<Formatted> {
    let found = formatted(&file.display().to_string(), &std::fs::read_to_string(file)?, console);
    if let Formatted::Other(new) = &found {
        console.out(&format!("{}\n", file.display()));
        if !only_check {
            atomic::write(file, |out| out.write_all(new.as_bytes())).map_err(std::io::Error::other)?;
        }
    }
    Ok(found)
}

fn formatted(name: &str, text: &str, console: &mut Console) -> Formatted {
    let tree = Tree::parse(text);
    match format(&tree) {
        Some(new) if new == text => Formatted::Same,
        Some(new) => Formatted::Other(new),
        None => {
            let mut sources = SourceMap::new();
            let file = sources.add(name, text);
            let errors: Vec<_> = tree.errors().iter().map(|e| e.to_diagnostic(file)).collect();
            console.diagnostics(&sources, &errors);
            Formatted::Broken
        }
    }
}

/// The file at `path`, or every `.ron` file below it, by name; folders whose names begin with a dot are passed over.
pub(crate) fn graph_files(path: &Path, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if !std::fs::metadata(path)?.is_dir() {
        found.push(path.to_owned());
        return Ok(());
    }
    let mut entries = std::fs::read_dir(path)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let is_hidden = entry.file_name().as_encoded_bytes().starts_with(b".");
        let is_graph = entry.path().extension().is_some_and(|e| e == "ron");
        if entry.file_type()?.is_dir() && !is_hidden || is_graph {
            graph_files(&entry.path(), found)?;
        }
    }
    Ok(())
}
