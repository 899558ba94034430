//! Diagnostics as the protocol has them, which files they go to, and the quick fixes that they suggest.

use std::collections::{BTreeMap, BTreeSet};

use pegbar_engine::check::code;
use pegbar_engine::diag::{Diagnostic, Label, Replacement, Severity, Span, did_you_mean};
use pegbar_engine::syntax::TokenKind;
use serde_json::{Value, json};

use super::sheet::Sheet;
use super::state::{Checked, State};
use super::text::{Lines, Range};
use super::wire::Out;

/// Other places of one diagnostic that are shown.
const MAX_RELATED: usize = 16;

/// What was sent: for each open document, what checking it said of which file.
#[derive(Default)]
pub(super) struct Published(BTreeMap<String, BTreeMap<String, Vec<Value>>>);

impl Published {
    /// Checks what is stale, and sends what changed by it.
    pub(super) fn refresh(&mut self, state: &mut State<'_>, out: &mut Out<'_>) {
        let mut touched = BTreeSet::new();
        for uri in std::mem::take(&mut state.stale) {
            let now = diagnostics(state, &uri);
            let is_open = now.is_some();
            let now = now.unwrap_or_default();
            touched.extend(now.keys().cloned());
            let before = if is_open { self.0.insert(uri.clone(), now) } else { self.0.remove(&uri) };
            touched.extend(before.unwrap_or_default().into_keys());
            touched.insert(uri);
        }
        for uri in touched {
            let mut all: Vec<&Value> = Vec::new();
            for diagnostic in self.0.values().filter_map(|files| files.get(&uri)).flatten() {
                if !all.contains(&diagnostic) {
                    all.push(diagnostic);
                }
            }
            let mut params = json!({ "uri": uri, "diagnostics": all });
            if let Some(document) = state.document(&uri) {
                params["version"] = json!(document.version);
            }
            out.notify("textDocument/publishDiagnostics", params);
        }
    }
}

/// What checking a document says, by the file that it is about; `None` for one that is not open.
fn diagnostics(state: &mut State<'_>, uri: &str) -> Option<BTreeMap<String, Vec<Value>>> {
    let (checked, sheet) = (state.checked(uri)?, state.sheet(uri)?);
    let mut places = Places { state, checked: &checked, main: uri, lines: BTreeMap::new() };
    let mut out: BTreeMap<String, Vec<Value>> = BTreeMap::from([(uri.to_owned(), Vec::new())]);
    for diagnostic in said(&checked, &sheet) {
        let Some((uri, value)) = places.diagnostic(diagnostic, &sheet) else { continue };
        out.entry(uri).or_default().push(value);
    }
    Some(out)
}

/// What is said of a document: of a file that is no graph, only what is wrong with it as RON.
fn said<'c>(checked: &'c Checked, sheet: &Sheet) -> impl Iterator<Item = &'c Diagnostic> + use<'c> {
    let name = sheet.tree.value().and_then(|v| v.name()).map(|n| n.name().to_owned());
    let is_graph = name.is_none_or(|n| n == "Graph" || did_you_mean(&n, ["Graph"]).is_some());
    checked.loaded.diagnostics.iter().filter(move |d| is_graph || d.code < code::UNREADABLE)
}

/// Turns places of sources into those of the protocol.
struct Places<'s, 'r> {
    state: &'s State<'r>,
    checked: &'s Checked,
    /// The document that was checked.
    main: &'s str,
    lines: BTreeMap<String, Lines>,
}

impl Places<'_, '_> {
    fn diagnostic(&mut self, diagnostic: &Diagnostic, sheet: &Sheet) -> Option<(String, Value)> {
        let (uri, range) = match diagnostic.primary() {
            Some(label) => self.place(label)?,
            None => (self.main.to_owned(), Range::default()),
        };
        let labels = diagnostic.labels.iter().filter(|l| !l.primary && !l.text.is_empty()).take(MAX_RELATED);
        let related: Vec<Value> = labels
            .filter_map(|label| {
                let (uri, range) = self.place(label)?;
                Some(json!({ "location": { "uri": uri, "range": range }, "message": label.text }))
            })
            .collect();
        let mut out = json!({
            "range": range,
            "severity": severity(diagnostic, sheet, uri == self.main),
            "code": diagnostic.code,
            "source": "pegbar",
            "message": message(diagnostic),
        });
        if !related.is_empty() {
            out["relatedInformation"] = json!(related);
        }
        if diagnostic.code == code::UNUSED_PARAMETER {
            out["tags"] = json!([1]);
        }
        Some((uri, out))
    }

    /// File and range of a label; `None` for what stands in no file.
    fn place(&mut self, label: &Label) -> Option<(String, Range)> {
        let path = self.checked.path(label.file)?;
        let is_main = self.state.document(self.main).is_some_and(|d| d.path == path);
        // What is no file has no absolute path: a value of the command line.
        let file = || path.is_absolute().then(|| self.state.uri(path));
        let uri = if is_main { self.main.to_owned() } else { file()? };
        let text = self.checked.loaded.sources.text(label.file);
        let lines = self.lines.entry(uri.clone()).or_insert_with(|| Lines::of(text));
        Some((uri, lines.range(text, label.span, self.state.encoding)))
    }
}

/// What a graph that is made for others lacks by itself is worth knowing, no more.
fn severity(diagnostic: &Diagnostic, sheet: &Sheet, is_main: bool) -> u8 {
    let span = diagnostic.primary().map(|l| l.span).unwrap_or_default();
    let is_param = |span: Span| sheet.params.iter().any(|p| p.decl.span.start == span.start + 1);
    let lacks = match diagnostic.code {
        code::MISSING_INPUT => is_param(span),
        code::FRAMES => !sheet.has_frames,
        _ => false,
    };
    match diagnostic.severity {
        Severity::Error if is_main && lacks && sheet.is_for_others() => 3,
        Severity::Error => 1,
        Severity::Warning => 2,
        Severity::Note => 3,
    }
}

/// All that is said beside the places, and where to read more.
fn message(diagnostic: &Diagnostic) -> String {
    let mut out = diagnostic.message.clone();
    let expected = diagnostic.expected.as_deref().map(|e| ("expected", e));
    let found = diagnostic.found.as_deref().map(|f| ("found", f));
    for (word, text) in expected.into_iter().chain(found).filter(|(_, text)| !diagnostic.message.contains(*text)) {
        out.push_str(&format!("\n{word}: {text}"));
    }
    diagnostic.help.iter().for_each(|help| out.push_str(&format!("\nhelp: {help}")));
    out.push_str(&format!("\npegbar explain {} says more", diagnostic.code));
    out
}

/// The quick fixes for what is wrong within a range.
pub(super) fn fixes(state: &mut State<'_>, uri: &str, range: Range) -> Option<Value> {
    let (sheet, checked) = (state.sheet(uri)?, state.checked(uri)?);
    let (start, end) = (sheet.offset(range.start, state.encoding), sheet.offset(range.end, state.encoding));
    let mut places = Places { state, checked: &checked, main: uri, lines: BTreeMap::new() };
    let mut actions = Vec::new();
    for diagnostic in said(&checked, &sheet) {
        let Some(label) = diagnostic.primary().filter(|l| l.span.start <= end && start <= l.span.end) else { continue };
        let Some((span, text)) = fix(diagnostic, &sheet, label.span) else { continue };
        let Some((_, value)) = places.diagnostic(diagnostic, &sheet).filter(|(file, _)| file == uri) else { continue };
        let edit = json!({ "range": sheet.range(span, places.state.encoding), "newText": text });
        actions.push(json!({
            "title": title(diagnostic, &text),
            "kind": "quickfix",
            "diagnostics": [value],
            "isPreferred": true,
            "edit": { "changes": { uri: [edit] } },
        }));
    }
    Some(json!(actions))
}

fn title(diagnostic: &Diagnostic, text: &str) -> String {
    match &diagnostic.replacement {
        Some(replacement) => format!("write `{}` instead of `{}`", replacement.by, replacement.word),
        None => format!("write `{text}`"),
    }
}

/// What to write where.
fn fix(diagnostic: &Diagnostic, sheet: &Sheet, span: Span) -> Option<(Span, String)> {
    if let Some(replacement) = &diagnostic.replacement {
        return Some((word_in(sheet, diagnostic.code, span, replacement)?, replacement.by.clone()));
    }
    let missing = match diagnostic.code {
        pegbar_engine::syntax::code::MISSING_COMMA => ",",
        _ => return None,
    };
    Some((span, missing.to_owned()))
}

/// Where the word stands in the marked text, as a whole word: the first of its kind for a node, as outputs come behind, else the last.
fn word_in(sheet: &Sheet, code: &str, span: Span, replacement: &Replacement) -> Option<Span> {
    let text = sheet.text();
    let marked = text.get(span.range())?;
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let is_whole = |at: usize| {
        let ends = replacement.word.starts_with(|c| !is_part(c)) || !marked[..at].ends_with(is_part);
        ends && !marked[at + replacement.word.len()..].starts_with(is_part)
    };
    let mut found = marked.match_indices(replacement.word.as_str()).map(|(at, _)| at).filter(|at| is_whole(*at));
    let at = if code == self::code::UNKNOWN_NODE { found.next() } else { found.last() }?;
    let span = Span::new(span.start + at, span.start + at + replacement.word.len());
    // Inside a text with escapes what is written is not what is meant.
    let token = sheet.tree.token_at(span.start)?;
    let is_plain = token.kind() != TokenKind::String || !token.text().contains('\\');
    is_plain.then_some(span)
}
