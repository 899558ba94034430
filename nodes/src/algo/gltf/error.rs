//! Why a glTF file is not what it should be.

use thiserror::Error;

/// Why a glTF file is not what it should be: where in it, what was expected, and what was found.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum GltfError {
    /// The file is damaged, or breaks the specification.
    #[error("{at}: {message}")]
    Malformed {
        /// Place in the file, as `accessors[3]`.
        at: String,
        /// `expected X, found Y`.
        message: String,
    },
    /// The file asks for what is not supported.
    #[error("{at}: {message}")]
    Unsupported {
        /// Place in the file.
        at: String,
        /// `expected X, found Y`.
        message: String,
    },
    /// The file asks for more memory than it may.
    #[error("{at}: {message}")]
    TooLarge {
        /// Place in the file.
        at: String,
        /// `expected X, found Y`.
        message: String,
    },
    /// What was asked for is not in the file.
    #[error("{0}")]
    NoSuch(String),
    /// A file beside it cannot be read.
    #[error("{0}")]
    File(String),
}

/// The file is damaged at `at`.
pub(super) fn malformed(at: impl ToString, message: impl Into<String>) -> GltfError {
    GltfError::Malformed { at: at.to_string(), message: message.into() }
}

/// The item `index` of the list `name`.
pub(super) fn item<'a, T>(list: &'a [T], name: &str, index: usize, at: &str) -> Result<&'a T, GltfError> {
    list.get(index).ok_or_else(|| malformed(at, format!("expected one of {} {name}, found number {index}", list.len())))
}
