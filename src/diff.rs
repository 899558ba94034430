//! `pegbar diff`: what differs between two graphs, by meaning.

use std::fmt::Write as _;
use std::path::Path;

use pegbar_engine::diag::SourceMap;
use pegbar_engine::diff::{Change, diff as compare};
use pegbar_engine::syntax::Tree;

use crate::args::{DiffArgs, Format};
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG};

pub(crate) fn diff(args: &DiffArgs, console: &mut Console) -> u8 {
    let (Some(old), Some(new)) = (read(&args.old, console), read(&args.new, console)) else { return EXIT_WRONG };
    let found = compare(&old, &new);
    let breaks = found.changes.iter().any(|c| c.breaks.is_some());
    match args.format {
        Format::Json => drop(console.json(&found)),
        Format::Text => console.out(&found.changes.iter().fold(String::new(), write)),
    }
    match &found.version {
        Some(trouble) => console.say(&format!("error: {}: {trouble}\n", args.new.display())),
        None if breaks => console.say("graphs that use this one break: lines with `!`\n"),
        None => (),
    }
    match (found.version.is_some(), found.changes.is_empty()) {
        (true, _) => EXIT_WRONG,
        (false, true) => EXIT_OK,
        (false, false) => EXIT_FAILED,
    }
}

fn read(path: &Path, console: &mut Console) -> Option<Tree> {
    let is_piped = path.as_os_str() == "-";
    let text = if is_piped { std::io::read_to_string(std::io::stdin()) } else { std::fs::read_to_string(path) };
    let tree = match text {
        Ok(text) => Tree::parse(text),
        Err(error) => {
            console.say(&format!("error: {}: {error}\n", path.display()));
            return None;
        }
    };
    let mut sources = SourceMap::new();
    let file = sources.add(path.display().to_string(), tree.shared_text());
    let errors: Vec<_> = tree.errors().iter().map(|e| e.to_diagnostic(file)).collect();
    console.diagnostics(&sources, &errors);
    errors.is_empty().then_some(tree)
}

fn write(mut out: String, change: &Change) -> String {
    let path = &change.path;
    let line = match (&change.renamed, &change.before, &change.after) {
        (Some(to), ..) => format!("> {path} is now nodes.{to}"),
        (_, Some(before), Some(after)) => format!("~ {path}: {before} is now {after}"),
        (_, Some(before), None) => format!("- {path}: {before}"),
        (_, _, after) => format!("+ {path}: {}", after.as_deref().unwrap_or_default()),
    };
    let broken = change.breaks.as_ref().map(|why| format!("  ! {why}")).unwrap_or_default();
    let _ = writeln!(out, "{line}{broken}");
    out
}
