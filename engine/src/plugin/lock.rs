//! `pegbar.lock`: which library of each plugin a graph was made with.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::PluginError;
use crate::node::PluginId;

/// Its name, beside the graph.
pub const LOCK: &str = "pegbar.lock";

/// The plugins of the graphs of a folder: digests of libraries by name, version and platform.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename = "Lock")]
pub struct Lock {
    /// By name, then by version, then by platform.
    pub plugins: BTreeMap<String, BTreeMap<String, BTreeMap<String, String>>>,
    /// Names of those that run in the host's process rather than in their own.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub trusted: BTreeSet<String>,
}

impl Lock {
    /// The lock of a folder; `None` where it has none.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn read(folder: &Path) -> Result<Option<Self>, PluginError> {
        let path = folder.join(LOCK);
        let refused = |why: String| PluginError::new(format!("lock {}: {why}", path.display()));
        match std::fs::read_to_string(&path) {
            Ok(text) => ron::from_str(&text).map(Some).map_err(|e| refused(e.to_string())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(refused(error.to_string())),
        }
    }

    /// Writes the lock of a folder.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), PluginError> {
        let path = folder.join(LOCK);
        super::manifest::write_ron(&path, self).map_err(|why| PluginError::new(format!("lock {}: {why}", path.display())))
    }

    /// Pins a plugin, in place of what was pinned for its name and version on this platform.
    pub fn pin(&mut self, id: &PluginId) {
        let versions = self.plugins.entry(id.name.clone()).or_default();
        versions.entry(id.version.clone()).or_default().insert(super::platform(), id.digest.clone());
    }

    /// Why a plugin is not the one that is pinned.
    pub fn refusal(&self, id: &PluginId) -> Option<String> {
        let short = super::library::short;
        let what = format!("plugin `{}` {}", id.name, id.version);
        let pinned = self.plugins.get(&id.name).and_then(|versions| versions.get(&id.version)).and_then(|p| p.get(&super::platform()));
        match pinned {
            None => Some(format!("expected {what} among what {LOCK} pins for this platform, found none")),
            Some(digest) if *digest != id.digest => {
                Some(format!("expected {what} of digest {}, as {LOCK} pins it, found {}", short(digest), short(&id.digest)))
            }
            Some(_) => None,
        }
    }
}
