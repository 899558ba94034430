//! Reads the exact source of a value as a Rust type, through `ron`, with errors that point at the part that is wrong.

use ron::Error as RonError;
use ron::Options;
use serde::de::DeserializeOwned;

use super::Extensions;
use super::tree::{NodeKind, NodeRef, Tree};
use crate::diag::{Diagnostic, FileId, Label, Span, did_you_mean};

/// Why a value could not be read as a type.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct ValueError {
    /// Where: within the source of the node's tree, or within the slice that was given.
    pub span: Span,
    /// What is wrong, in the words of the house: "expected float, found string".
    pub message: String,
    /// What was expected, where that is known.
    pub expected: Option<String>,
    /// What was found, where that is known.
    pub found: Option<String>,
    /// What to do about it.
    pub help: Option<String>,
}

impl ValueError {
    /// The error as a diagnostic of a file.
    pub fn to_diagnostic(&self, code: &'static str, file: FileId) -> Diagnostic {
        let mut diagnostic = Diagnostic::error(code, self.message.clone(), Label::new(file, self.span));
        diagnostic.expected.clone_from(&self.expected);
        diagnostic.found.clone_from(&self.found);
        diagnostic.help.extend(self.help.clone());
        diagnostic
    }
}

/// Reads a value as a type. `Some(...)` may be left out, and newtypes are written as what they hold. The error's span is within the
/// source of the node's tree. O(length of the value).
pub fn parse_value<T: DeserializeOwned>(node: NodeRef<'_>) -> Result<T, ValueError> {
    parse_slice(node.text(), node.tree().extensions()).map_err(|mut error| {
        error.span = error.span.shifted(node.span().start);
        error
    })
}

/// Reads a source slice as a type, as [`parse_value`] does, with further extensions of RON. The error's span is within the slice.
pub fn parse_slice<T: DeserializeOwned>(slice: &str, extensions: Extensions) -> Result<T, ValueError> {
    let options = Options::default().with_default_extension(Extensions::IMPLICIT_SOME | Extensions::UNWRAP_NEWTYPES | extensions);
    options.from_str(slice).map_err(|error| explain(slice, &error))
}

/// `ron` says how far it had come; the tree of the slice says which value that is.
fn explain(slice: &str, error: &ron::error::SpannedError) -> ValueError {
    let tree = Tree::parse(slice);
    if let Some(error) = tree.errors().first() {
        let (message, expected, found) = (error.message.clone(), error.expected.clone(), error.found.clone());
        return ValueError { span: error.span, message, expected, found, help: error.help.clone() };
    }
    let whole = tree.value().unwrap_or(tree.root());
    let reached = offset_of(slice, error.span.end);
    let culprit = culprit(whole, reached, &error.code);
    let span = field_name(whole, reached, &error.code).unwrap_or(culprit.span());
    let mut problem = reword(&error.code, culprit);
    problem.span = span;
    problem
}

/// The byte offset of a position that counts lines and characters from 1, clamped to the slice.
fn offset_of(slice: &str, position: ron::error::Position) -> usize {
    let before = position.line.saturating_sub(1);
    let start = if before == 0 { 0 } else { slice.match_indices('\n').nth(before - 1).map_or(slice.len(), |(at, _)| at + 1) };
    let rest = &slice[start..];
    start + rest.char_indices().nth(position.col.saturating_sub(1)).map_or(rest.len(), |(at, _)| at)
}

/// The value that the error is about, found by how far `ron` had come when it gave up.
fn culprit<'t>(whole: NodeRef<'t>, reached: usize, error: &RonError) -> NodeRef<'t> {
    let values = || whole.descendants().filter(|node| node.kind().is_value());
    let found = match error {
        // It looked at the first character and found it to be of another type.
        _ if what_was_expected(error).is_some() => values().find(|node| node.span().start == reached),
        // It had come to the closing bracket.
        RonError::MissingStructField { .. } | RonError::ExpectedDifferentLength { .. } => {
            values().filter(|node| node.span().start < reached && reached < node.span().end).last()
        }
        // It had read the value, or a part of it. Of values within each other the last listed is the smallest.
        _ => values().filter(|node| node.span().start < reached && reached <= node.span().end).last(),
    };
    let found = found.unwrap_or(whole);
    // A reading that stops behind the first end of a range wanted no range.
    let stopped_early = matches!(error, RonError::TrailingCharacters | RonError::ExpectedComma | RonError::ExpectedStructLikeEnd);
    let range = found.parent().filter(|parent| stopped_early && parent.kind() == NodeKind::Range);
    range.unwrap_or(found)
}

/// Where the name of the field stands that the error is about.
fn field_name(whole: NodeRef<'_>, reached: usize, error: &RonError) -> Option<Span> {
    if !matches!(error, RonError::NoSuchStructField { .. } | RonError::DuplicateStructField { .. }) {
        return None;
    }
    let mut names = whole.descendants().flat_map(NodeRef::fields).map(|field| field.name_span());
    names.find(|span| span.start < reached && reached <= span.end)
}

/// The type that `ron` wanted when it refused the first character of a value.
fn what_was_expected(error: &RonError) -> Option<&'static str> {
    match error {
        RonError::ExpectedInteger => Some("integer"),
        RonError::ExpectedFloat => Some("float"),
        RonError::ExpectedBoolean => Some("boolean"),
        RonError::ExpectedChar => Some("character"),
        RonError::ExpectedString => Some("string"),
        RonError::ExpectedByteString => Some("byte string"),
        RonError::ExpectedByteLiteral => Some("byte"),
        RonError::ExpectedArray => Some("list"),
        RonError::ExpectedMap => Some("map"),
        RonError::ExpectedUnit => Some("unit"),
        RonError::ExpectedOption => Some("option"),
        RonError::ExpectedIdentifier => Some("name"),
        RonError::ExpectedStructLike | RonError::ExpectedNamedStructLike(_) => Some("values in round brackets"),
        RonError::ExpectedRangeSyntax => Some("range"),
        _ => None,
    }
}

fn reword(error: &RonError, culprit: NodeRef<'_>) -> ValueError {
    let described = || culprit.describe().to_owned();
    if let Some(expected) = what_was_expected(error) {
        let help = write_it_so(error, culprit);
        return ValueError { help, ..mismatch(expected.to_owned(), described()) };
    }
    match error {
        RonError::InvalidValueForType { expected, found } => mismatch(without_article(expected), without_article(found)),
        RonError::IntegerOutOfBounds => mismatch("integer within the range of its type".to_owned(), format!("`{}`", culprit.text())),
        RonError::ExpectedDifferentLength { expected, found } => mismatch(without_article(expected), format!("{found} elements")),
        RonError::NoSuchEnumVariant { expected, found, .. } => unknown("name", found, expected),
        RonError::NoSuchStructField { expected, found, .. } => unknown("field", found, expected),
        RonError::MissingStructField { field, .. } => plain(format!("missing field `{field}`")),
        RonError::DuplicateStructField { field, .. } => plain(format!("field `{field}` is given twice")),
        RonError::ExpectedDifferentStructName { expected, found } => mismatch(format!("`{expected}(...)`"), format!("`{found}(...)`")),
        // The text is sound RON, so that a reading which stops within a value wanted a simpler one: an integer, or fewer values.
        _ if culprit.kind() == NodeKind::Number => mismatch("integer".to_owned(), described()),
        _ if culprit.kind() == NodeKind::Range => mismatch("number".to_owned(), described()),
        RonError::ExpectedStructLikeEnd => mismatch("fewer values".to_owned(), format!("{} values", culprit.children().count())),
        RonError::Message(message) => plain(message.clone()),
        _ => plain(lower_first(&error.to_string())),
    }
}

/// How to write the value that was meant, where that can be told.
fn write_it_so(error: &RonError, culprit: NodeRef<'_>) -> Option<String> {
    let text = culprit.text();
    match (error, culprit.kind()) {
        (RonError::ExpectedString, NodeKind::Ident | NodeKind::Number) => Some(format!("write it in quotes: `\"{text}\"`")),
        (RonError::ExpectedIdentifier, NodeKind::String) => Some(format!("write it without quotes: `{}`", culprit.as_str()?.value())),
        (RonError::ExpectedInteger | RonError::ExpectedFloat | RonError::ExpectedBoolean, NodeKind::String) => {
            let bare = culprit.as_str()?.into_value().into_owned();
            let inner = Tree::parse(bare.as_str());
            let is_plain = inner.errors().is_empty() && matches!(inner.value()?.kind(), NodeKind::Number | NodeKind::Bool);
            is_plain.then(|| format!("write it without quotes: `{bare}`"))
        }
        (RonError::ExpectedArray, NodeKind::Tuple) => Some("lists are written in square brackets: `[...]`".to_owned()),
        (RonError::ExpectedStructLike | RonError::ExpectedNamedStructLike(_), NodeKind::List) => {
            Some("write it in round brackets: `(...)`".to_owned())
        }
        _ => None,
    }
}

fn plain(message: String) -> ValueError {
    ValueError { span: Span::default(), message, expected: None, found: None, help: None }
}

fn mismatch(expected: String, found: String) -> ValueError {
    ValueError { expected: Some(expected.clone()), found: Some(found.clone()), ..plain(format!("expected {expected}, found {found}")) }
}

fn unknown(what: &str, found: &str, valid: &[&'static str]) -> ValueError {
    let list = valid.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let expected = match valid.len() {
        0 => format!("no {what}"),
        1 => list,
        _ => format!("one of {list}"),
    };
    let help = did_you_mean(found, valid.iter().copied()).map(|name| format!("did you mean `{name}`?"));
    ValueError { expected: Some(expected), found: Some(format!("`{found}`")), help, ..plain(format!("unknown {what} `{found}`")) }
}

fn without_article(text: &str) -> String {
    let bare = ["a ", "an ", "the "].iter().find_map(|article| text.strip_prefix(article));
    bare.unwrap_or(text).to_owned()
}

fn lower_first(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map(|first| first.to_lowercase().chain(characters).collect()).unwrap_or_default()
}
