//! Files: those that are read are there, those that are written stay in their folder and do not meet.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::diag::Diagnostic;
use crate::graph::Binding;
use crate::node::{Kind, Literal};
use crate::setting::{FileUse, InputPath, InputPaths, Missing, OutputPath, normalise};

use super::typing::Typed;
use super::{At, Checker, code};

impl Checker<'_> {
    pub(super) fn check_files(&mut self, typed: &[Typed]) {
        let mut written: BTreeMap<PathBuf, At> = BTreeMap::new();
        for node in 0..typed.len() {
            let Some(ty) = self.nodes[node].ty.clone() else { continue };
            let missing = missing_policy(&typed[node].bindings);
            for (i, input) in ty.schema.inputs.iter().enumerate() {
                let (Some(Binding::Literal { value, .. }), Some(at)) = (typed[node].bindings.get(i), typed[node].places.get(i)) else {
                    continue;
                };
                match input.files {
                    FileUse::None => {}
                    FileUse::Read => self.check_read(value, *at, missing, &typed[node]),
                    FileUse::Write => self.check_written(value, *at, typed, node, &mut written),
                }
            }
        }
    }

    fn check_read(&mut self, value: &Literal, at: At, missing: Option<Missing>, typed: &Typed) {
        if let Some(paths) = value.downcast_ref::<InputPaths>() {
            return paths.0.iter().for_each(|path| self.check_file(&path.at(0), at));
        }
        let path = value.downcast_ref::<InputPath>().cloned().or_else(|| value.downcast_ref::<Option<InputPath>>().cloned().flatten());
        let Some(path) = path else { return };
        if !path.is_sequence() {
            self.check_file(&path.at(0), at);
            return;
        }
        let present = path.frames().unwrap_or_default();
        if present.is_empty() {
            self.no_frame_files(&path, at);
            return;
        }
        let Some(clock) = typed.clock().filter(|_| !typed.doubtful) else { return };
        let absent: Vec<i64> = match missing.unwrap_or_default() {
            Missing::Error => clock.frames().filter(|f| present.binary_search(f).is_err()).collect(),
            Missing::Hold => clock.frames().take_while(|f| present.first().is_none_or(|p| p > f)).collect(),
            Missing::Nearest => Vec::new(),
        };
        if absent.is_empty() {
            return;
        }
        let message = format!("expected frames {} to {} of {}, found no {}", clock.first, clock.last, path.pattern(), ranges(&absent));
        let found = at.error(code::FRAME_HOLES, message).found(format!("frames {}", ranges(&present)));
        self.push(found.help(match missing {
            None => "change `frames` of the graph, or put the files there",
            Some(Missing::Hold) => {
                "nothing goes before the first file to be held: change `frames` of the graph, or write `missing: nearest`"
            }
            Some(_) => "change `frames` of the graph, or say what stands for a missing frame: `missing: hold` or `missing: nearest`",
        }));
    }

    fn check_file(&mut self, file: &Path, at: At) {
        if file.is_file() {
            return;
        }
        let found = if file.is_dir() { "a folder" } else { "none" };
        let found = at.error(code::MISSING_FILE, format!("expected a file at {}, found {found}", file.display()));
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let near = neighbours(file);
        let found = found.did_you_mean(&name, near.iter().map(String::as_str));
        self.push(with_missing_folder(found, file));
    }

    fn no_frame_files(&mut self, path: &InputPath, at: At) {
        let found = at.error(code::MISSING_FILE, format!("expected files as {}, found none", path.pattern()));
        self.push(with_missing_folder(found, &path.at(0)));
    }

    fn check_written(&mut self, value: &Literal, at: At, typed: &[Typed], node: usize, written: &mut BTreeMap<PathBuf, At>) {
        let path = value.downcast_ref::<OutputPath>().cloned().or_else(|| value.downcast_ref::<Option<OutputPath>>().cloned().flatten());
        let Some(path) = path else { return };
        let clock = typed[node].clock();
        let first = clock.map_or(0, |c| c.first);
        if !path.is_inside() {
            let message = format!("expected a path inside the output folder {}, found {}", path.root().display(), path.at(first).display());
            self.error(code::OUTSIDE_OUTPUT, at, message).help.push("write `$out/...`, and choose the folder with --out".to_owned());
            return;
        }
        let runs_once = self.nodes[node].ty.as_ref().is_some_and(|t| t.schema.kind == Kind::Whole);
        if !runs_once && !path.is_sequence() && typed[node].has_stream_input(self, typed) {
            let message = format!("expected a frame number in the path, found {}", path.at(first).display());
            let found = self.error(code::NO_FRAME_NUMBER, at, message);
            found.help.push("write #### where the frame number goes, so that each frame has a file of its own".to_owned());
            return;
        }
        // Of a very long clock both ends stand for all of it.
        let frames: Vec<i64> = match clock {
            Some(c) if path.is_sequence() && c.len() <= 10_000 => c.frames().collect(),
            Some(c) if path.is_sequence() => vec![c.first, c.last],
            _ => vec![first],
        };
        let files: Vec<PathBuf> = frames.into_iter().map(|f| normalise(&path.at(f))).collect();
        if let Some((file, other)) = files.iter().find_map(|f| Some((f, *written.get(f)?))) {
            let name = file.strip_prefix(normalise(path.root())).unwrap_or(file).display();
            let found = at.error(code::WRITTEN_TWICE, format!("expected a file of its own, found {name} written twice"));
            self.push(found.with_label(other.note("written here too")));
            return;
        }
        written.extend(files.into_iter().map(|f| (f, at)));
    }
}

/// Says where the trouble is a folder that is not there.
fn with_missing_folder(found: Diagnostic, file: &Path) -> Diagnostic {
    match file.parent().filter(|p| !p.as_os_str().is_empty() && !p.is_dir()) {
        Some(folder) => found.help(format!("there is no folder {}", folder.display())),
        None => found,
    }
}

/// What a reader does at a frame that is not there; `None` where it has no say in it.
fn missing_policy(bindings: &[Binding]) -> Option<Missing> {
    bindings.iter().find_map(|b| match b {
        Binding::Literal { value, .. } => value.downcast_ref::<Missing>().copied(),
        _ => None,
    })
}

/// Names of the files beside one that is not there.
pub(super) fn neighbours(file: &Path) -> Vec<String> {
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
