//! From paths that somebody names to the node types of a registry. Loads no code.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::PluginError;
use super::call::Transport;
use super::dynamic::{dynamic_type, mismatch};
use super::library::InProcess;
use super::manifest::{Description, ENDING, Manifest};
use super::operator::{Plugin, PluginOperator};
use super::worker::Workers;
use crate::node::PluginId;
use crate::registry::{NodeType, Registry};

/// A manifest that was found.
#[derive(Clone, Debug)]
pub struct Found {
    /// Where it lies.
    pub path: PathBuf,
    /// What it says.
    pub manifest: Arc<Manifest>,
}

/// The manifests at a path: of a manifest, of a library that has one beside it, or of all in a folder, in the order of their names.
///
/// # Errors
/// Where there is none, and for each that cannot be read.
pub fn find(path: &Path) -> Vec<Result<Found, PluginError>> {
    let is_manifest = |path: &Path| path.to_string_lossy().ends_with(ENDING);
    let beside = PathBuf::from(format!("{}{ENDING}", path.display()));
    let paths = match std::fs::read_dir(path) {
        Ok(entries) => {
            let mut paths: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| is_manifest(p)).collect();
            paths.sort();
            paths
        }
        Err(_) if is_manifest(path) => vec![path.to_owned()],
        // `../plugins/blur` stands for `../plugins/blur.plugin.ron`.
        Err(_) if beside.is_file() => vec![beside],
        Err(_) => Vec::new(),
    };
    if paths.is_empty() {
        let message = format!("expected a plugin manifest NAME{ENDING}, or a folder of them, at {}, found none", path.display());
        return vec![Err(PluginError::new(message))];
    }
    let read = |path: PathBuf| Manifest::read(&path).map(|manifest| Found { path, manifest: Arc::new(manifest) });
    paths.into_iter().map(read).collect()
}

/// The manifests at several paths, and what is wrong with them.
pub fn found_in(paths: &[PathBuf]) -> (Vec<Found>, Vec<PluginError>) {
    let (mut found, mut wrong) = (Vec::new(), Vec::new());
    for one in paths.iter().flat_map(|path| find(path)) {
        match one {
            Ok(one) => found.push(one),
            Err(error) => wrong.push(error),
        }
    }
    (found, wrong)
}

impl Found {
    /// What keys and locks call it.
    ///
    /// # Errors
    /// Where it has no library for this platform.
    pub fn id(&self) -> Result<PluginId, PluginError> {
        let plugin = &self.manifest.plugin;
        let (_, digest) = self.manifest.library(self.folder())?;
        Ok(PluginId { name: plugin.name.clone(), version: plugin.version.clone(), digest: digest.to_owned() })
    }

    fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Adds its node types and value types to a registry; nothing where the same plugin is there already.
    ///
    /// # Errors
    /// Where one of its names means something else there, or a value type is another than there.
    pub fn register(&self, registry: &mut Registry) -> Result<(), PluginError> {
        let description = &self.manifest.plugin;
        let id = self.id()?;
        let refused = |why: String| PluginError::plugin(description, format!("{why} ({})", self.path.display()));
        if let Some(other) = registry.plugins().find(|p| p.name == id.name && p.version == id.version) {
            let same = other.digest == id.digest;
            let why = "expected one library of this name and version, found another with another digest";
            return if same { Ok(()) } else { Err(refused(why.to_owned()).help("give one of them another version")) };
        }
        if let Some(node) = description.nodes.iter().find(|n| registry.get(&n.id).is_some_and(|t| t.operator.plugin().is_none())) {
            return Err(refused(format!("expected a node id of its own, found `{}`, which Pegbar has", node.id)));
        }
        for ty in &description.values {
            let schema = ty.schema();
            match registry.get_type(schema.name) {
                Some(known) => {
                    if let Some(why) = mismatch(&known.schema, &schema) {
                        return Err(refused(format!("value type `{}`: {why}", schema.name)));
                    }
                }
                None => registry.insert_type(dynamic_type(schema)),
            }
        }
        let nodes = nodes(description, self, registry, id).map_err(refused)?;
        nodes.into_iter().for_each(|node| registry.insert_plugin_node(node));
        Ok(())
    }
}

/// In workers, unless the plugin is trusted, no code runs, or the program has none.
///
/// # Errors
/// Where there are to be workers and the system has not what they take: in this process a plugin could do what it was not trusted to.
fn transport(found: &Found, registry: &Registry) -> Result<Box<dyn Transport>, String> {
    let (manifest, folder) = (found.manifest.clone(), found.folder().to_owned());
    let name = &manifest.plugin.name;
    let workers = registry.isolation().workers().filter(|w| registry.runs_code() && !w.trusted.contains(name));
    let Some(workers) = workers else { return Ok(Box::new(InProcess::new(manifest, folder, registry.runs_code()))) };
    let refused = || {
        let needs = "expected a system where processes pass their files on (Unix) for a plugin that is not trusted, found another";
        format!("{needs}; to run it in this process: --trust {}", found.manifest.plugin.name)
    };
    isolated(manifest, folder, workers).ok_or_else(refused)
}

#[cfg(unix)]
fn isolated(manifest: Arc<Manifest>, folder: PathBuf, workers: Workers) -> Option<Box<dyn Transport>> {
    Some(Box::new(super::worker::Isolated::new(manifest, folder, workers)))
}

#[cfg(not(unix))]
fn isolated(_: Arc<Manifest>, _: PathBuf, _: Workers) -> Option<Box<dyn Transport>> {
    None
}

fn nodes(description: &Description, found: &Found, registry: &Registry, id: PluginId) -> Result<Vec<NodeType>, String> {
    let transport = transport(found, registry)?;
    let plugin = Arc::new(Plugin { id, description: description.clone(), transport });
    let node = |(i, text): (usize, &super::manifest::NodeText)| {
        let schema = Arc::new(text.schema()?);
        let outputs: Vec<_> = schema.outputs.iter().map(|o| o.ty.and_then(|ty| registry.get_type(ty)).cloned()).collect();
        let state = text.state.as_ref().map(|state| dynamic_type(state.schema()));
        let types = outputs.iter().flatten().chain(&state);
        let names = types.flat_map(|ty| ty.schema.arrays.iter().map(|a| a.name)).collect();
        let operator = PluginOperator {
            plugin: plugin.clone(),
            node: i as u32,
            schema: schema.clone(),
            outputs,
            state,
            names,
            known: Mutex::default(),
        };
        Ok(NodeType { schema, operator: Arc::new(operator) })
    };
    description.nodes.iter().enumerate().map(node).collect()
}
