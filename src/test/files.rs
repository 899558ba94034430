//! What tests write: references, and pictures of what differs.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use pegbar_engine::atomic;
use pegbar_engine::golden::{NodeReferences, Reference, Store, nodes_to_text, to_text};

use super::case::{Pictures, Shown, Task};

/// Writes a file whole or not at all.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    atomic::write(path, |out| out.write_all(bytes)).map_err(|e| e.to_string())
}

/// Writes the reference of a case; true where a file changed.
pub(super) fn write_reference(
    store: &Store,
    graph: &Path,
    outputs: &Reference,
    nodes: &NodeReferences,
    pictures: &Pictures,
) -> Result<bool, String> {
    let name = graph.file_name().unwrap_or_default().to_string_lossy();
    let texts = [
        (store.outputs(), to_text(&name, outputs), Store::MOST_BYTES),
        (store.nodes(), nodes_to_text(&name, nodes), Store::MOST_NODE_BYTES),
    ];
    if let Some((path, text, most)) = texts.iter().find(|(_, text, most)| text.len() > *most) {
        let found = format!("expected a reference of at most {most} bytes at {}, found {}", path.display(), text.len());
        return Err(format!("{found}: compare fewer `outputs` or `frames`"));
    }
    let mut files: Vec<(PathBuf, Vec<u8>)> = texts.into_iter().map(|(path, text, _)| (path, text.into_bytes())).collect();
    files.extend(pictures.iter().map(|((output, frame), png)| (store.picture(output, *frame), png.clone())));
    let mut changed = false;
    for (path, bytes) in &files {
        if std::fs::read(path).ok().as_ref() != Some(bytes) {
            write(path, bytes)?;
            changed = true;
        }
    }
    let kept: BTreeSet<&Path> = files.iter().map(|(path, _)| path.as_path()).collect();
    for entry in std::fs::read_dir(store.pictures()).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.extension().is_some_and(|e| e == "png") && !kept.contains(path.as_path()) {
            std::fs::remove_file(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            changed = true;
        }
    }
    Ok(changed)
}

/// Writes pictures of what differs: expected, actual and difference. What was written or could not be, a line each.
pub(super) fn write_pictures(out: &Path, task: &Task, shown: &[Shown]) -> Vec<String> {
    let stem = task.graph.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let folder = out.join(stem).join(&task.case.name);
    let mut said = Vec::new();
    for one in shown {
        let sign = if one.frame < 0 { "-" } else { "" };
        let name = |what: &str| folder.join(format!("{}.{sign}{:04}.{what}.png", one.output.replace('/', "."), one.frame.unsigned_abs()));
        let difference = one.difference.as_ref().map(|d| &d.amplified);
        let files = [("expected", one.expected.as_ref()), ("actual", Some(&one.actual)), ("difference", difference)];
        let written = files.into_iter().filter_map(|(what, png)| Some(write(&name(what), png?))).collect::<Result<Vec<()>, _>>();
        match written {
            Ok(_) => {
                let gain = one.difference.as_ref().map(|d| format!(" (difference x {:.0})", d.gain)).unwrap_or_default();
                said.push(format!("pictures: {}{gain}\n", name("*").display()));
            }
            Err(why) => said.push(format!("warning: {why}\n")),
        }
    }
    said
}
