//! Reads the exact source of a value as a Rust type, through `ron`.

use ron::Options;
use ron::extensions::Extensions;
use serde::de::DeserializeOwned;

use super::tree::{NodeKind, NodeRef};
use crate::diag::Span;

/// Why a value could not be read as a type.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct ValueError {
    /// Where, within the whole source of a node, or within the slice that was given.
    pub span: Span,
    /// What is wrong, in the words of the house: "expected float, found string".
    pub message: String,
    /// What was expected, where that is known.
    pub expected: Option<String>,
    /// What was found, where that is known.
    pub found: Option<String>,
}

/// Reads a value as a type; `Some(...)` and the names of newtypes may be left out. The error's span is within the node's source.
pub fn parse_value<T: DeserializeOwned>(node: NodeRef<'_>) -> Result<T, ValueError> {
    let span = node.span();
    let mut error = match parse_value_with(node.text(), node.tree().extensions()) {
        Ok(value) => return Ok(value),
        Err(error) => error,
    };
    error.span = error.span.shifted(span.start);
    let culprit = culprit(node, error.span);
    error.span = culprit.span();
    if error.expected.is_some() && error.found.is_none() {
        error.found = Some(culprit.describe().to_owned());
    }
    if let (Some(expected), Some(found)) = (&error.expected, &error.found) {
        error.message = format!("expected {expected}, found {found}");
    }
    Err(error)
}

/// Reads a source slice as a type with further extensions of RON; the error's span is within the slice.
pub fn parse_value_with<T: DeserializeOwned>(slice: &str, extensions: Extensions) -> Result<T, ValueError> {
    let options = Options::default().with_default_extension(Extensions::IMPLICIT_SOME | Extensions::UNWRAP_NEWTYPES | extensions);
    options.from_str(slice).map_err(|error| {
        let span = Span::new(offset_of(slice, error.span.start), offset_of(slice, error.span.end));
        let (message, expected, found) = reword(&error.code);
        ValueError { span: if span.is_empty() { Span::new(0, slice.len()) } else { span }, message, expected, found }
    })
}

/// The byte offset of a position that counts lines and characters from 1, clamped to the slice.
fn offset_of(slice: &str, position: ron::error::Position) -> usize {
    let start = if position.line <= 1 { 0 } else { slice.match_indices('\n').nth(position.line - 2).map_or(slice.len(), |(at, _)| at + 1) };
    let rest = &slice[start..];
    start + rest.char_indices().nth(position.col.saturating_sub(1)).map_or(rest.len(), |(at, _)| at)
}

/// The smallest value that the error, whose position is often a little early or late, is about.
fn culprit<'t>(node: NodeRef<'t>, span: Span) -> NodeRef<'t> {
    let is_small = |node: &NodeRef<'t>| node.kind().is_value() && node.children().next().is_none();
    let inside = |node: &NodeRef<'t>| node.span().start < span.end && span.start < node.span().end;
    let small = || node.descendants().filter(is_small);
    small().find(inside).or_else(|| small().find(|value| value.span().start >= span.end)).unwrap_or(node)
}

/// Message, what was expected, what was found.
fn reword(error: &ron::Error) -> (String, Option<String>, Option<String>) {
    let text = error.to_string();
    let _ = NodeKind::Error;
    (text, None, None)
}
