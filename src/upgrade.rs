//! `pegbar upgrade`: graphs of older nodes, up to date.

use std::io::Write;
use std::path::Path;

use pegbar_engine::atomic;
use pegbar_engine::upgrade::{Done, Migration, read, upgrade as apply};

use crate::args::UpgradeArgs;
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};
use crate::fmt::graph_files;

/// What became of Pegbar's own nodes, release by release. None has changed its name or its meaning since the first.
const OWN: &str = include_str!("migrations.ron");

pub(crate) fn upgrade(args: &UpgradeArgs, console: &mut Console) -> u8 {
    let (migrations, files) = match (migrations(args), files(args)) {
        (Ok(migrations), Ok(files)) => (migrations, files),
        (Err(error), _) | (_, Err(error)) => {
            console.say(&format!("error: {error}\n"));
            return EXIT_WRONG;
        }
    };
    let (mut changed, mut wrong) = (0, 0);
    for file in &files {
        match one(file, &migrations, args.check, console) {
            Ok(is_changed) => changed += usize::from(is_changed),
            Err(error) => {
                console.say(&format!("error: {}: {error}\n", file.display()));
                wrong += 1;
            }
        }
    }
    let what = if args.check { "to be upgraded" } else { "upgraded" };
    console.say(&format!("{}, {changed} {what}\n", count(files.len(), "file")));
    match (wrong, args.check && changed > 0) {
        (0, false) => EXIT_OK,
        (0, true) => EXIT_FAILED,
        _ => EXIT_WRONG,
    }
}

fn migrations(args: &UpgradeArgs) -> Result<Vec<Migration>, String> {
    let mut all = read(OWN)?;
    for path in &args.migrations {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        all.extend(read(&text).map_err(|e| format!("{}: expected a list of migrations, found {e}", path.display()))?);
    }
    Ok(all)
}

fn files(args: &UpgradeArgs) -> Result<Vec<std::path::PathBuf>, String> {
    let mut files = Vec::new();
    for path in &args.files {
        graph_files(path, &mut files).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    Ok(files)
}

/// Upgrades one file; true where it changed, or would.
fn one(file: &Path, migrations: &[Migration], only_check: bool, console: &mut Console) -> Result<bool, String> {
    let text = std::fs::read_to_string(file).map_err(|e| e.to_string())?;
    let (after, done) = apply(&text, migrations).map_err(|e| e.to_string())?;
    for Done { node, changes, note } in &done {
        let note = if note.is_empty() { String::new() } else { format!(" ({note})") };
        console.out(&format!("{}: node `{node}`: {}{note}\n", file.display(), changes.join("; ")));
    }
    if !only_check && !done.is_empty() {
        atomic::write(file, |out| out.write_all(after.as_bytes())).map_err(|e| e.to_string())?;
    }
    Ok(!done.is_empty())
}
