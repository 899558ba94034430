//! A lossless, error-tolerant syntax tree of RON, the language of graph files.
//!
//! `ron` itself gives no positions after reading, drops the names of structs and stops at the first error; the checker, the formatter
//! and the language server need all three. This tree keeps every byte of the source, finds all errors in one go, and accepts exactly
//! the texts that `ron::from_str::<ron::Value>` accepts (a property test holds the two together), so that the exact source slice of
//! any value can be handed to `ron` to be read as a Rust type ([`parse_value`]).
//!
//! ```
//! use pegbar_engine::syntax::Tree;
//! let tree = Tree::parse(r#"Graph(nodes: { "a": (type: "io.read") })"#);
//! assert!(tree.errors().is_empty());
//! let nodes = tree.value().and_then(|graph| graph.field("nodes")).and_then(|field| field.value());
//! let (name, span) = nodes.and_then(|map| map.entries().next()).and_then(|entry| entry.key())
//!     .and_then(|key| Some((key.as_str()?.value().to_owned(), key.span()))).unwrap_or_default();
//! assert_eq!((name.as_str(), span.range()), ("a", 15..18));
//! ```

mod escape;
mod format;
mod lexer;
mod number;
mod parser;
mod tree;
mod value;

#[cfg(test)]
mod tests;

pub use crate::diag::Span;
pub use escape::StrValue;
pub use format::{canonical, format};
pub use lexer::TokenKind;
pub use tree::{EntryRef, FieldRef, NodeId, NodeKind, NodeRef, TokenRef, Tree};
pub use value::{ValueError, parse_slice, parse_value};

use crate::diag::{Diagnostic, FileId, Label};

/// The extensions of RON that a document may enable; they are bits of one set.
pub type Extensions = ron::extensions::Extensions;

/// The stable codes of syntax errors.
pub mod code {
    /// A character that begins nothing.
    pub const UNEXPECTED_CHARACTER: &str = "PB0001";
    /// `/*` without `*/`.
    pub const UNCLOSED_COMMENT: &str = "PB0002";
    /// A string without its closing quote.
    pub const UNTERMINATED_STRING: &str = "PB0003";
    /// An escape that RON does not know.
    pub const BAD_ESCAPE: &str = "PB0004";
    /// A number that is not one, or does not fit.
    pub const BAD_NUMBER: &str = "PB0005";
    /// A character or byte literal that is not one.
    pub const BAD_CHARACTER: &str = "PB0006";
    /// A raw name or raw string that is neither.
    pub const BAD_IDENTIFIER: &str = "PB0007";
    /// Two items without a comma between.
    pub const MISSING_COMMA: &str = "PB0010";
    /// A field or entry without a colon.
    pub const MISSING_COLON: &str = "PB0011";
    /// A bracket that is never closed.
    pub const UNCLOSED_BRACKET: &str = "PB0012";
    /// A closing bracket that nothing opened.
    pub const STRAY_BRACKET: &str = "PB0013";
    /// Something that cannot stand here.
    pub const UNEXPECTED_TOKEN: &str = "PB0014";
    /// Nothing where a value is needed.
    pub const MISSING_VALUE: &str = "PB0015";
    /// Something that is no field name where a field is needed.
    pub const MISSING_FIELD_NAME: &str = "PB0016";
    /// Text after the document's value.
    pub const TRAILING_TEXT: &str = "PB0017";
    /// A malformed `#![...]`.
    pub const BAD_ATTRIBUTE: &str = "PB0018";
    /// An extension that RON does not know.
    pub const UNKNOWN_EXTENSION: &str = "PB0019";
    /// Brackets nested too deep.
    pub const TOO_DEEP: &str = "PB0020";
    /// A source too large to be a graph file.
    pub const TOO_LARGE: &str = "PB0021";
}

/// What is wrong at one place of a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SyntaxError {
    /// Stable code, one of [`code`].
    pub code: &'static str,
    /// The offending text; empty where something is missing.
    pub span: Span,
    /// What is wrong, in lower case.
    pub message: String,
    /// What should stand there.
    pub expected: Option<String>,
    /// What stands there.
    pub found: Option<String>,
    /// What to do about it.
    pub help: Option<String>,
    /// Another place that belongs to it, such as the bracket that was opened, with what it is.
    pub related: Option<(Span, String)>,
}

impl SyntaxError {
    fn new(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        Self { code, span, message: message.into(), expected: None, found: None, help: None, related: None }
    }

    fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = Some(expected.into());
        self
    }

    fn found(mut self, found: impl Into<String>) -> Self {
        self.found = Some(found.into());
        self
    }

    fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    fn related(mut self, span: Span, text: impl Into<String>) -> Self {
        self.related = Some((span, text.into()));
        self
    }

    /// The error as a diagnostic of a file.
    pub fn to_diagnostic(&self, file: FileId) -> Diagnostic {
        let mut diagnostic = Diagnostic::error(self.code, self.message.clone(), Label::new(file, self.span));
        diagnostic.expected.clone_from(&self.expected);
        diagnostic.found.clone_from(&self.found);
        diagnostic.help.extend(self.help.clone());
        diagnostic.labels.extend(self.related.iter().map(|(span, text)| Label::secondary(file, *span, text.clone())));
        diagnostic
    }
}
