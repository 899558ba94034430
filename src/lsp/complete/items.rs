//! One completion, and how the protocol writes it.

use pegbar_engine::diag::Span;
use serde_json::{Value, json};

use super::super::cursor::Cursor;
use super::super::sheet::Sheet;
use super::super::state::State;

/// What a completion is, as the protocol numbers it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Function = 3,
    Field = 5,
    Variable = 6,
    Type = 7,
    Module = 9,
    Value = 12,
    Snippet = 15,
    File = 17,
    Reference = 18,
    Folder = 19,
    Choice = 20,
}

#[derive(Clone, Debug)]
pub(super) struct Item {
    label: String,
    kind: Kind,
    detail: String,
    doc: String,
    /// What is written; where it is a snippet with `$1` and the like in it.
    text: String,
    is_snippet: bool,
    filter: String,
    rank: u8,
    span: Span,
}

impl Item {
    /// A completion that writes its label.
    pub(super) fn new(label: impl Into<String>, kind: Kind) -> Self {
        let label = label.into();
        let (text, filter) = (label.clone(), label.clone());
        Self { label, kind, detail: String::new(), doc: String::new(), text, is_snippet: false, filter, rank: 0, span: Span::default() }
    }

    pub(super) fn label(&self) -> &str {
        &self.label
    }

    pub(super) fn detail(self, detail: impl Into<String>) -> Self {
        Self { detail: detail.into(), ..self }
    }

    pub(super) fn doc(self, doc: impl Into<String>) -> Self {
        Self { doc: doc.into(), ..self }
    }

    pub(super) fn text(self, text: impl Into<String>) -> Self {
        Self { text: text.into(), ..self }
    }

    pub(super) fn snippet(self, text: impl Into<String>) -> Self {
        Self { text: text.into(), is_snippet: true, ..self }
    }

    /// The less, the earlier in the list.
    pub(super) fn rank(self, rank: u8) -> Self {
        Self { rank, ..self }
    }

    /// In place of the word at the cursor; nothing where that is between quotes.
    pub(super) fn bare(self, cursor: &Cursor<'_>) -> Option<Self> {
        (!cursor.word.is_quoted).then_some(Self { span: cursor.word.span, ..self })
    }

    /// In place of the text at the cursor, with such quotes as are not there.
    pub(super) fn quoted(self, cursor: &Cursor<'_>) -> Self {
        let content = self.text.replace('\\', "\\\\").replace('"', "\\\"");
        let (text, filter) = match (cursor.word.is_quoted, cursor.word.is_closed) {
            (true, true) => (content.clone(), content),
            (true, false) => (format!("{content}\""), content),
            (false, _) => (format!("\"{content}\""), content.trim_start_matches(['@', '$']).to_owned()),
        };
        Self { text, filter, span: cursor.word.span, ..self }
    }

    /// In place of the end of the text at the cursor, from byte `from` of it on.
    pub(super) fn ending(self, from: usize, cursor: &Cursor<'_>) -> Self {
        let item = self.quoted(cursor);
        Self { span: Span::new(item.span.start + from, item.span.end), ..item }
    }

    fn to_json(&self, index: usize, sheet: &Sheet, state: &State<'_>) -> Value {
        let plain = if state.has_snippets || !self.is_snippet { None } else { Some(without_stops(&self.text)) };
        let mut out = json!({
            "label": self.label,
            "kind": self.kind as u8,
            "textEdit": { "range": sheet.range(self.span, state.encoding), "newText": plain.as_ref().unwrap_or(&self.text) },
            "filterText": self.filter,
            "sortText": format!("{}{index:05}", self.rank),
            "insertTextFormat": if self.is_snippet && plain.is_none() { 2 } else { 1 },
        });
        if !self.detail.is_empty() {
            out["detail"] = json!(self.detail);
        }
        if !self.doc.is_empty() {
            out["documentation"] = json!({ "kind": "markdown", "value": self.doc });
        }
        out
    }
}

/// A snippet as plain text: `${1:x}` reads `x`, `$1` nothing.
fn without_stops(snippet: &str) -> String {
    let mut out = String::new();
    let mut rest = snippet;
    while let Some(at) = rest.find(['$', '\\']) {
        out.push_str(&rest[..at]);
        let escaped = rest[at..].starts_with('\\');
        rest = &rest[at + 1..];
        if escaped {
            let n = rest.chars().next().map_or(0, char::len_utf8);
            out.push_str(&rest[..n]);
            rest = &rest[n..];
        } else if let Some((stop, after)) = rest.strip_prefix('{').and_then(|r| r.split_once('}')) {
            out.push_str(stop.split_once(':').map_or("", |(_, default)| default));
            rest = after;
        } else {
            rest = rest.trim_start_matches(|c: char| c.is_ascii_digit());
        }
    }
    out + rest
}

/// Plain text inside a snippet.
pub(super) fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('$', "\\$").replace('}', "\\}")
}

/// The list as the protocol has it.
pub(super) fn as_json(items: &[Item], sheet: &Sheet, state: &State<'_>) -> Value {
    let mut order: Vec<&Item> = items.iter().collect();
    order.sort_by_key(|item| item.rank);
    let items: Vec<Value> = order.iter().enumerate().map(|(i, item)| item.to_json(i, sheet, state)).collect();
    json!({ "isIncomplete": false, "items": items })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_editor_without_snippets_gets_plain_text() {
        assert_eq!(without_stops("a: ${1:(0.5, 1.0)}, \"@$2\"$0"), "a: (0.5, 1.0), \"@\"");
        assert_eq!(without_stops(&escaped("a$b}c\\")), "a$b}c\\");
    }
}
