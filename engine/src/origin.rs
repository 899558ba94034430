//! What a written file says of its making: the graph, the graphs and layers that it used, and what it was run with.
//!
//! One JSON object, [`Origin`], stands in PNG files (the text chunk `pegbar`), OpenEXR files (the attribute `pegbar`) and glTF files (`asset.extras.pegbar`).
//! It names files as seen from the graph's folder, so that the bytes do not hang on where the graph lies.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::check::LoadOptions;
use crate::diag::SourceMap;

/// The name under which files hold it.
pub const KEY: &str = "pegbar";

/// How a file was made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Version of Pegbar.
    pub pegbar: String,
    /// Name of the graph file among `files`.
    pub graph: String,
    /// Every graph and layer file that was read, by its path from the graph's folder, with its text.
    pub files: BTreeMap<String, String>,
    /// `--var`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub variables: Vec<(String, String)>,
    /// `--set`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub overrides: Vec<(String, String)>,
    /// `--shot`, from the graph's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shot: Option<String>,
    /// `--site`, from the graph's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub site: Option<String>,
    /// `--library`, from the graph's folder.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub library: Vec<String>,
}

/// The origin of what a graph writes, as JSON.
pub(crate) fn text(graph: &Path, sources: &SourceMap, options: &LoadOptions) -> Option<Arc<str>> {
    let folder = absolute(graph).parent().map(Path::to_owned)?;
    let files = sources.files().map(|f| (sources.name(f), sources.text(f))).filter(|(_, text)| !text.is_empty() && !text.starts_with("--"));
    let origin = Origin {
        pegbar: env!("CARGO_PKG_VERSION").to_owned(),
        graph: graph.file_name()?.to_string_lossy().into_owned(),
        files: files.map(|(name, text)| (from(&folder, Path::new(name)), text.to_owned())).collect(),
        variables: options.variables.clone(),
        overrides: options.overrides.clone(),
        shot: options.shot.as_ref().map(|shot| from(&folder, shot)),
        site: options.site.as_ref().map(|site| from(&folder, site)),
        library: options.library.iter().map(|library| from(&folder, library)).collect(),
    };
    serde_json::to_string(&origin).ok().map(Arc::from)
}

fn absolute(path: &Path) -> PathBuf {
    crate::setting::normalise(path)
}

/// `path` as seen from a folder, with `..` for folders above, in words alone.
fn from(folder: &Path, path: &Path) -> String {
    let path = absolute(path);
    let (mut ours, mut theirs) = (folder.components().peekable(), path.components().peekable());
    while ours.peek().is_some() && ours.peek() == theirs.peek() {
        ours.next();
        theirs.next();
    }
    let up = ours.map(|_| Component::ParentDir);
    let path = up.chain(theirs).collect::<PathBuf>().to_string_lossy().replace('\\', "/");
    if path.is_empty() { ".".to_owned() } else { path }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_from_the_folder_of_the_graph() {
        let folder = Path::new("/show/graphs");
        for (path, expected) in [
            ("/show/graphs/a.ron", "a.ron"),
            ("/show/lib/b.ron", "../lib/b.ron"),
            ("/show/graphs/x/../c.ron", "c.ron"),
            ("/d.ron", "../../d.ron"),
            ("/show/graphs", "."),
        ] {
            assert_eq!(from(folder, Path::new(path)), expected);
        }
    }
}
