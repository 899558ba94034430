//! Files: those that are read are there, those that are written stay in their folder and do not meet.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::diag::Diagnostic;
use crate::graph::Binding;
use crate::node::{InputSchema, Literal};
use crate::setting::{FileUse, InputPath, Missing, OutputPath};

use super::typing::Typed;
use super::{At, Checker, code};

impl Checker<'_> {
    pub(super) fn check_files(&mut self, typed: &[Typed]) {
        let mut written: BTreeMap<PathBuf, At> = BTreeMap::new();
        for node in 0..typed.len() {
            let Some(ty) = self.nodes[node].ty.clone() else { continue };
            let missing = missing_policy(&ty.schema.inputs, &typed[node].bindings);
            for (i, input) in ty.schema.inputs.iter().enumerate() {
                let (Some(Binding::Literal { value, .. }), Some(at)) = (typed[node].bindings.get(i), typed[node].places.get(i)) else {
                    continue;
                };
                match input.files {
                    FileUse::None => {}
                    FileUse::Read => self.check_read(value, *at, missing, typed, node),
                    FileUse::Write => self.check_written(value, *at, typed, node, &mut written),
                }
            }
        }
    }

    fn check_read(&mut self, value: &Literal, at: At, missing: Missing, typed: &[Typed], node: usize) {
        let path = value.downcast_ref::<InputPath>().cloned().or_else(|| value.downcast_ref::<Option<InputPath>>().cloned().flatten());
        let Some(path) = path else { return };
        if !path.is_sequence() {
            let file = path.at(0);
            if !file.is_file() {
                let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let near = neighbours(&file);
                let found = Diagnostic::error(code::MISSING_FILE, format!("expected a file at {}, found none", file.display()), at.label());
                self.push(found.did_you_mean(&name, near.iter().map(String::as_str)));
            }
            return;
        }
        let present = path.frames().unwrap_or_default();
        let Some(clock) = typed[node].clock() else { return };
        let wanted: Vec<i64> = match missing {
            Missing::Error => clock.frames().filter(|f| present.binary_search(f).is_err()).collect(),
            Missing::Hold => clock.frames().take_while(|f| present.first().is_none_or(|p| p > f)).collect(),
            Missing::Nearest => clock.frames().take_while(|_| present.is_empty()).collect(),
        };
        if present.is_empty() {
            self.error(code::MISSING_FILE, at, format!("expected files as {}, found none", path.pattern()));
        } else if !wanted.is_empty() {
            let message = format!("expected frames {} to {} of {}, found no {}", clock.first, clock.last, path.pattern(), ranges(&wanted));
            let found = Diagnostic::error(code::FRAME_HOLES, message, at.label()).found(format!("frames {}", ranges(&present)));
            self.push(found.help("change `frames`, or say what stands for a missing frame: `missing: hold` or `missing: nearest`"));
        }
    }

    fn check_written(&mut self, value: &Literal, at: At, typed: &[Typed], node: usize, written: &mut BTreeMap<PathBuf, At>) {
        let path = value.downcast_ref::<OutputPath>().cloned().or_else(|| value.downcast_ref::<Option<OutputPath>>().cloned().flatten());
        let Some(path) = path else { return };
        let first = typed[node].clock().map_or(0, |c| c.first);
        if !path.is_inside() {
            let message = format!("expected a path inside the output folder {}, found {}", path.root().display(), path.at(first).display());
            self.error(code::OUTSIDE_OUTPUT, at, message).help.push("write `$out/...`, and choose the folder with --out".to_owned());
            return;
        }
        if typed[node].has_stream_input(self, typed)
            && !path.is_sequence()
            && self.nodes[node].ty.as_ref().is_some_and(|t| t.schema.kind != crate::node::Kind::Whole)
        {
            let found =
                self.error(code::NO_FRAME_NUMBER, at, format!("expected a frame number in the path, found {}", path.at(first).display()));
            found.help.push("write #### where the frame number goes, so that each frame has a file of its own".to_owned());
            return;
        }
        if let Some(other) = written.insert(path.at(first), at) {
            let message = format!("expected a file of its own, found {} written twice", path.at(first).display());
            self.push(Diagnostic::error(code::WRITTEN_TWICE, message, at.label()).with_label(other.note("written here too")));
        }
    }
}

fn missing_policy(inputs: &[InputSchema], bindings: &[Binding]) -> Missing {
    let literal = |b: &Binding| match b {
        Binding::Literal { value, .. } => value.downcast_ref::<Missing>().copied(),
        _ => None,
    };
    inputs.iter().zip(bindings).find_map(|(_, b)| literal(b)).unwrap_or_default()
}

/// Names of the files beside one that is not there.
fn neighbours(file: &Path) -> Vec<String> {
    let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or_else(|| Path::new("."));
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// `1-3, 7`.
pub(crate) fn ranges(frames: &[i64]) -> String {
    let mut out: Vec<(i64, i64)> = Vec::new();
    for &f in frames {
        match out.last_mut() {
            Some((_, last)) if *last + 1 == f => *last = f,
            _ => out.push((f, f)),
        }
    }
    let parts: Vec<String> = out.iter().map(|&(a, b)| if a == b { a.to_string() } else { format!("{a}-{b}") }).collect();
    let shown = parts.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
    if parts.len() > 8 { format!("{shown} and {} more", parts.len() - 8) } else { shown }
}
