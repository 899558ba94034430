//! Plugins: node types and value types out of shared libraries, by one C ABI (`pegbar-abi`).
//!
//! [`Manifest`] is what the host knows of a plugin before it runs: listing, checking and drawing read it alone. `operator` makes an
//! [`Operator`](crate::node::Operator) of a node type in it: each task becomes a `Request`, which says everything that the plugin is told, goes through a
//! `Transport`, and comes back as a `Response`, which is held against the schema and becomes values. There are two transports: `library` calls in this
//! process, and `worker` in others, which do so there. A library is loaded when the first task asks for it, and never before its digest, ABI and schema
//! are those of the manifest.

mod call;
pub mod conform;
mod dynamic;
mod find;
mod library;
mod lock;
mod manifest;
mod operator;
mod settings;
mod shown;
mod suite;
mod worker;

use std::path::Path;

pub use find::{Found, find, found_in};
pub use library::{describe, digest};
pub use lock::{LOCK, Lock};
pub use manifest::{
    ArrayText, Description, ENDING, InputText, LibraryFile, Manifest, NodeText, OutputText, PortType, TextText, Threads, TypeText, platform,
};
pub use settings::SettingData;
#[cfg(target_os = "linux")]
pub use worker::arena;
pub use worker::{Isolation, Workers, own_program, serve_if_asked};

use crate::node::{Fault, NodeError};

/// Why a plugin is not there or cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct PluginError {
    /// `expected X, found Y`, with the plugin or its manifest.
    pub message: String,
    /// What to do.
    pub help: Option<String>,
}

impl PluginError {
    fn new(message: String) -> Self {
        Self { message, help: None }
    }

    fn manifest(path: &Path, why: impl std::fmt::Display) -> Self {
        Self::new(format!("plugin manifest {}: {why}", path.display()))
    }

    fn plugin(plugin: &Description, why: impl std::fmt::Display) -> Self {
        Self::new(format!("plugin `{}` {}: {why}", plugin.name, plugin.version))
    }

    fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl From<PluginError> for NodeError {
    fn from(error: PluginError) -> Self {
        let failed = NodeError::new(Fault::Plugin, error.message);
        match error.help {
            Some(help) => failed.help(help),
            None => failed,
        }
    }
}
