//! What the tests share: the command line in this process, graphs from text, and the values of their outputs.

pub(crate) mod collect;
pub(crate) mod plugins;
pub(crate) mod shot;

use std::path::{Path, PathBuf};

/// The folder of the root package.
pub(crate) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Every file below `folder` whose name ends in `ending`, in order, as paths below [`root`] with `/` between; none where there is no such folder.
pub(crate) fn files_below(folder: &str, ending: &str) -> Vec<String> {
    let mut found = Vec::new();
    walk(&root().join(folder), &mut |path| {
        let name = path.strip_prefix(root()).unwrap().components().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/");
        if name.ends_with(ending) {
            found.push(name);
        }
    });
    found.sort();
    found
}

/// Calls `each` with every file below `folder`.
pub(crate) fn walk(folder: &Path, each: &mut impl FnMut(&Path)) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() { walk(&path, each) } else { each(&path) }
    }
}
