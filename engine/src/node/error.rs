//! Why a node could not make a frame.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Whose fault a failure is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// A setting's.
    Parameters,
    /// An input value's.
    Input,
    /// The numbers': singular, not converging, not finite.
    Numeric,
    /// A limit's: too large.
    Limit,
    /// Not supported.
    Unsupported,
    /// The file system's.
    Io,
    /// A plugin's: it is missing, refused, or breaks its contract.
    Plugin,
    /// A plugin's, which ended its process.
    PluginCrash,
    /// A plugin's, which gave no sign of life.
    PluginHang,
    /// A plugin's, which took more memory than it may.
    PluginMemory,
    /// Pegbar's own.
    Internal,
}

/// Why a node could not make a frame.
#[derive(Clone, Debug, PartialEq, Error, Deserialize, Serialize)]
#[error("{message}")]
pub struct NodeError {
    /// Whose fault it is.
    pub fault: Fault,
    /// What was expected and what was found.
    pub message: String,
    /// What to do.
    pub help: Option<String>,
    /// True where the run was cancelled rather than failing.
    pub cancelled: bool,
}

impl NodeError {
    /// A failure laid at `fault`.
    pub fn new(fault: Fault, message: impl Into<String>) -> Self {
        Self { fault, message: message.into(), help: None, cancelled: false }
    }

    /// An input value that cannot be used.
    pub fn input(message: impl Into<String>) -> Self {
        Self::new(Fault::Input, message)
    }

    /// A file that cannot be read or written.
    pub fn io(path: &std::path::Path, error: impl fmt::Display) -> Self {
        Self::new(Fault::Io, format!("{}: {error}", path.display()))
    }

    /// A fault of Pegbar's own.
    pub fn internal(message: impl Into<String>) -> Self {
        Self::new(Fault::Internal, message)
    }

    /// The run was asked to stop.
    pub fn stopped() -> Self {
        Self { cancelled: true, ..Self::new(Fault::Internal, "cancelled") }
    }

    /// With what to do about it.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}
