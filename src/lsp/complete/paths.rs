//! Files and folders beside a graph, numbered ones as one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pegbar_engine::setting::FileUse;

use super::super::cursor::Cursor;
use super::Asked;
use super::items::{Item, Kind};

/// More names of one folder are not shown.
const MAX_NAMES: usize = 1000;

/// Names in a folder.
struct Listing {
    folders: Vec<String>,
    /// Names, a run of numbered files being one `name.####.png`.
    files: Vec<(String, usize)>,
}

impl Asked<'_, '_> {
    /// Graph files, as `graph:` names them.
    pub(super) fn graph_files(&mut self, typed: &str, cursor: &Cursor<'_>) {
        let folder = split(typed).0;
        let Some(listing) = self.sheet.path.parent().map(|base| list(&base.join(folder))) else { return };
        let own = self.sheet.path.file_name().map(|n| n.to_string_lossy().into_owned());
        for (name, _) in listing.files.iter().filter(|(n, _)| n.ends_with(".ron") && (own.as_ref() != Some(n) || !folder.is_empty())) {
            let item = Item::new(format!("graph:{folder}{name}"), Kind::File).detail("graph").rank(1);
            self.items.push(item.quoted(cursor));
        }
        for name in ["..".to_owned()].iter().chain(&listing.folders) {
            self.items.push(Item::new(format!("graph:{folder}{name}/"), Kind::Folder).rank(2).quoted(cursor));
        }
    }

    /// Files that an input may read, or the folder that it writes to.
    pub(super) fn files(&mut self, used: FileUse, cursor: &Cursor<'_>) {
        let typed = if cursor.word.is_quoted { cursor.word.before } else { "" };
        let folder = split(typed).0;
        let Some(place) = self.place(folder) else { return };
        let listing = list(&place);
        if used == FileUse::Read {
            for (name, count) in &listing.files {
                let detail = if *count > 1 { format!("{count} files") } else { String::new() };
                self.items.push(Item::new(format!("{folder}{name}"), Kind::File).detail(detail).rank(1).quoted(cursor));
            }
        }
        if used == FileUse::Read || folder.starts_with('$') {
            let folders = listing.folders.iter().map(|name| Item::new(format!("{folder}{name}/"), Kind::Folder).rank(2).quoted(cursor));
            self.items.extend(folders);
        }
    }

    /// The folder that the beginning of a path means.
    fn place(&self, folder: &str) -> Option<PathBuf> {
        match folder.strip_prefix("$out/") {
            Some(rest) => Some(self.state.options.out.join(rest)),
            None if folder.starts_with('$') => None,
            None => Some(self.sheet.path.parent()?.join(folder)),
        }
    }
}

/// The folder of what was typed, with its slash, and the rest.
fn split(typed: &str) -> (&str, &str) {
    typed.split_at(typed.rfind('/').map_or(0, |at| at + 1))
}

fn list(folder: &Path) -> Listing {
    let (mut folders, mut files) = (Vec::new(), BTreeMap::<String, Vec<String>>::new());
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        match entry.path().is_dir() {
            _ if name.starts_with('.') => (),
            true => folders.push(name),
            false => files.entry(numbered(&name).unwrap_or_else(|| name.clone())).or_default().push(name),
        }
    }
    folders.sort();
    folders.truncate(MAX_NAMES);
    let shown = |(pattern, names): (String, Vec<String>)| match names.as_slice() {
        [only] => (only.clone(), 1),
        _ => (pattern, names.len()),
    };
    Listing { folders, files: files.into_iter().take(MAX_NAMES).map(shown).collect() }
}

/// `hat.####.png` for `hat.0012.png`: the last number of at least two digits before the extension.
fn numbered(name: &str) -> Option<String> {
    let stem = name.rfind('.')?;
    let end = name[..stem].rfind(|c: char| c.is_ascii_digit())? + 1;
    let digits = name[..end].bytes().rev().take_while(u8::is_ascii_digit).count();
    let is_last = name[end..stem].is_empty();
    (digits >= 2 && is_last).then(|| format!("{}{}{}", &name[..end - digits], "#".repeat(digits), &name[end..]))
}

#[cfg(test)]
mod tests {
    use super::numbered;

    #[test]
    fn numbered_files_are_one() {
        assert_eq!(numbered("hat.0012.png").as_deref(), Some("hat.####.png"));
        assert_eq!(numbered("hat12.png").as_deref(), Some("hat##.png"));
        for name in ["hat.png", "hat1.png", "12hat.png", "12", ".12"] {
            assert_eq!(numbered(name), None, "{name}");
        }
    }
}
