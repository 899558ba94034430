//! The plugins that a graph names, and the lock that pins them.

use std::path::Path;

use crate::diag::{Diagnostic, Severity};
use crate::plugin::{Found, Lock, PluginError, find};
use crate::registry::NodeType;
use crate::syntax::{FieldRef, NodeKind};

use super::{At, Checker, code};

impl Checker<'_> {
    /// Reads the lock beside the main graph.
    pub(super) fn read_lock(&mut self, graph: &Path) {
        if self.options.unlocked {
            return;
        }
        match Lock::read(graph.parent().unwrap_or(Path::new(""))) {
            Ok(lock) => {
                if let Some(trusted) = lock.as_ref().map(|lock| &lock.trusted).filter(|trusted| !trusted.is_empty()) {
                    self.registry.to_mut().trust(trusted.iter().cloned());
                }
                self.lock = lock;
            }
            Err(error) => self.push(diagnostic(code::PLUGIN_LOCK, error, None)),
        }
    }

    /// Reads the manifests that a graph names, relative to its file.
    pub(super) fn read_plugins(&mut self, scope: usize, field: FieldRef<'_>) {
        let file = self.scopes[scope].file;
        let Some(value) = field.value() else { return };
        if value.kind() != NodeKind::List {
            let found = value.describe();
            self.error(code::FORM, At::new(file, value.span()), format!("expected paths as [\"../plugins/blur\"], found {found}"));
            return;
        }
        for item in value.elements() {
            let at = At::new(file, item.span());
            match item.as_str() {
                Some(path) => {
                    let path = self.scopes[scope].base.join(path.into_value().as_ref());
                    self.use_plugins(&path, at);
                }
                None => {
                    self.error(code::FORM, at, format!("expected a path in quotes, found {}", item.describe()));
                }
            }
        }
    }

    fn use_plugins(&mut self, path: &Path, at: At) {
        for found in find(path) {
            let used = found.and_then(|found: Found| found.register(self.registry.to_mut()));
            if let Err(error) = used {
                self.push(diagnostic(code::PLUGIN, error, Some(at)));
            }
        }
    }

    /// Says where a node type's plugin is not the one that the lock pins.
    pub(super) fn pinned(&mut self, ty: &NodeType, at: At) {
        let (Some(lock), Some(id)) = (&self.lock, ty.operator.plugin()) else { return };
        if let Some(why) = lock.refusal(id) {
            let help = "`pegbar plugin lock GRAPH` pins what is there now, if that is what you want";
            self.push(at.error(code::PLUGIN_LOCK, why).help(help));
        }
    }

    /// What is wrong with the id of a node type that there is not.
    pub(super) fn unknown_type(&self, id: &str, at: At) -> Diagnostic {
        let versions = self.registry.versions(id);
        if !versions.is_empty() {
            let bare = id.split('@').next().unwrap_or(id);
            let listed = versions.join(", ");
            let message = match id.contains('@') {
                true => format!("expected one version of the plugin of `{bare}`, found `{id}`"),
                false => format!("expected the version of the plugin of `{id}`, as there are several, found none"),
            };
            let newest = versions.last().copied().unwrap_or_default();
            return at.error(code::PLUGIN_VERSION, message).help(format!("write \"{bare}@{newest}\"; there are {listed}"));
        }
        let known: Vec<&str> = self.registry.nodes().map(|n| n.schema.id).collect();
        let family = |id: &str| id.split('.').next().unwrap_or_default().to_owned();
        let is_strange = id.contains('.') && !known.iter().any(|k| family(k) == family(id));
        let found = at.error(code::UNKNOWN_TYPE, format!("expected a node type, found `{id}`")).did_you_mean(id, known);
        let found = found.help("`pegbar nodes` lists the node types");
        if !is_strange {
            return found;
        }
        let family = family(id);
        found.help(format!("if it is of a plugin `{family}`: name that with --plugins, with PEGBAR_PLUGINS, or in the graph's `plugins`"))
    }
}

fn diagnostic(code: &'static str, error: PluginError, at: Option<At>) -> Diagnostic {
    let found = match at {
        Some(at) => at.error(code, error.message),
        None => Diagnostic::new(Severity::Error, code, error.message),
    };
    match error.help {
        Some(help) => found.help(help),
        None => found,
    }
}
