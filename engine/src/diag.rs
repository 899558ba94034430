//! Located messages: what is wrong, where, what was expected and found, and what to do about it.
//!
//! Everything that checks a graph adds to one list of [`Diagnostic`]s, which is put in order ([`sort`]) and shown at once: as text with
//! the offending source underlined ([`SourceMap::render`]), one line each for logs ([`SourceMap::line`]), or as JSON
//! ([`SourceMap::to_json`]).

use std::cmp::Ordering;
use std::sync::Arc;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use serde::Serialize;

/// A range of bytes of a source, end excluded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
pub struct Span {
    /// Offset of the first byte.
    pub start: usize,
    /// Offset one past the last byte, at least `start`.
    pub end: usize,
}

impl Span {
    /// A span; an end before the start is raised to it.
    pub fn new(start: usize, end: usize) -> Self {
        Self { start, end: end.max(start) }
    }

    /// The span as a range, to slice with.
    pub fn range(self) -> std::ops::Range<usize> {
        self.start..self.end
    }

    /// Length in bytes.
    pub fn len(self) -> usize {
        self.end - self.start
    }

    /// Whether it holds no byte, as where something is missing.
    pub fn is_empty(self) -> bool {
        self.start == self.end
    }

    /// Whether the offset is inside or at the end.
    pub fn touches(self, offset: usize) -> bool {
        self.start <= offset && offset <= self.end
    }

    /// The span moved towards the end by `offset` bytes.
    pub fn shifted(self, offset: usize) -> Self {
        Self::new(self.start.saturating_add(offset), self.end.saturating_add(offset))
    }
}

/// A file of a [`SourceMap`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FileId(u32);

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The graph cannot run.
    Error,
    /// The graph runs, but most likely not as meant.
    Warning,
    /// Worth knowing.
    Note,
}

impl Severity {
    /// The severity as a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
            Self::Note => "note",
        }
    }
}

/// A place in a source, with what there is to say about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// The file.
    pub file: FileId,
    /// The bytes underlined.
    pub span: Span,
    /// What is said beside the underline; may be empty.
    pub text: String,
    /// Whether this is the place of the problem, rather than one that explains it.
    pub primary: bool,
}

impl Label {
    /// The place of the problem, without a text of its own.
    pub fn new(file: FileId, span: Span) -> Self {
        Self { file, span, text: String::new(), primary: true }
    }

    /// A place that explains the problem.
    pub fn secondary(file: FileId, span: Span, text: impl Into<String>) -> Self {
        Self { file, span, text: text.into(), primary: false }
    }
}

/// One problem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Stable code, such as `PB0102`.
    pub code: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// What is wrong, in lower case, without a full stop.
    pub message: String,
    /// Where; may be empty where a problem has no place in a source.
    pub labels: Vec<Label>,
    /// What was expected: type, unit, range.
    pub expected: Option<String>,
    /// What was found.
    pub found: Option<String>,
    /// What to do about it, one hint each.
    pub help: Vec<String>,
    /// What to write instead of a part of the text at the problem's place, where that is known.
    pub replacement: Option<Replacement>,
}

/// A word of the text at a problem's place, and what was most likely meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Replacement {
    /// As it is written.
    pub word: String,
    /// As it was meant.
    pub by: String,
}

impl Diagnostic {
    /// An error at a place.
    pub fn error(code: &'static str, message: impl Into<String>, label: Label) -> Self {
        Self::new(Severity::Error, code, message).with_label(label)
    }

    /// A warning at a place.
    pub fn warning(code: &'static str, message: impl Into<String>, label: Label) -> Self {
        Self::new(Severity::Warning, code, message).with_label(label)
    }

    /// A problem without a place.
    pub fn new(severity: Severity, code: &'static str, message: impl Into<String>) -> Self {
        Self {
            code,
            severity,
            message: message.into(),
            labels: Vec::new(),
            expected: None,
            found: None,
            help: Vec::new(),
            replacement: None,
        }
    }

    /// With one more label.
    pub fn with_label(mut self, label: Label) -> Self {
        self.labels.push(label);
        self
    }

    /// With what was expected.
    pub fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = Some(expected.into());
        self
    }

    /// With what was found.
    pub fn found(mut self, found: impl Into<String>) -> Self {
        self.found = Some(found.into());
        self
    }

    /// With one more hint.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help.push(help.into());
        self
    }

    /// With the hint "did you mean ...?" if one of the candidates is close to the word.
    pub fn did_you_mean<'c>(self, word: &str, candidates: impl IntoIterator<Item = &'c str>) -> Self {
        match did_you_mean(word, candidates) {
            Some(candidate) => self.meant(word, candidate),
            None => self,
        }
    }

    /// With the hint that `by` was meant where `word` is written.
    pub fn meant(mut self, word: &str, by: &str) -> Self {
        self.replacement = Some(Replacement { word: word.to_owned(), by: by.to_owned() });
        self.help(format!("did you mean `{by}`?"))
    }

    /// The place of the problem: the first primary label, else the first label.
    pub fn primary(&self) -> Option<&Label> {
        self.labels.iter().find(|label| label.primary).or_else(|| self.labels.first())
    }

    /// "expected X, found Y", as far as both are known.
    fn expectation(&self) -> Option<String> {
        match (&self.expected, &self.found) {
            (Some(expected), Some(found)) => Some(format!("expected {expected}, found {found}")),
            (Some(expected), None) => Some(format!("expected {expected}")),
            (None, Some(found)) => Some(format!("found {found}")),
            (None, None) => None,
        }
    }
}

/// A position for people: both numbers start at 1, columns count characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct LineColumn {
    /// The line.
    pub line: usize,
    /// The column.
    pub column: usize,
}

#[derive(Clone, Debug)]
struct SourceFile {
    name: String,
    text: Arc<str>,
    /// Offset of the first byte of each line.
    line_starts: Vec<usize>,
}

/// The sources that diagnostics point into.
#[derive(Clone, Debug, Default)]
pub struct SourceMap {
    files: Vec<SourceFile>,
}

impl SourceMap {
    /// No sources yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a source under the name that messages show. O(n).
    pub fn add(&mut self, name: impl Into<String>, text: impl Into<Arc<str>>) -> FileId {
        let text = text.into();
        let line_starts = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        let id = FileId(u32::try_from(self.files.len()).unwrap_or(u32::MAX));
        self.files.push(SourceFile { name: name.into(), text, line_starts });
        id
    }

    /// Every file, in the order in which they were added.
    pub fn files(&self) -> impl Iterator<Item = FileId> + use<> {
        (0..u32::try_from(self.files.len()).unwrap_or(u32::MAX)).map(FileId)
    }

    /// The name of a file; empty for one of another map.
    pub fn name(&self, file: FileId) -> &str {
        self.file(file).map_or("", |file| &file.name)
    }

    /// The text of a file; empty for one of another map.
    pub fn text(&self, file: FileId) -> &str {
        self.file(file).map_or("", |file| &file.text)
    }

    /// The text of a span, clamped to the file and to whole characters.
    pub fn slice(&self, file: FileId, span: Span) -> &str {
        let text = self.text(file);
        &text[clamp(text, span).range()]
    }

    /// Line and column of a byte offset, which is clamped to the file. O(log lines + length of the line).
    pub fn position(&self, file: FileId, offset: usize) -> LineColumn {
        let Some(file) = self.file(file) else { return LineColumn { line: 1, column: 1 } };
        let offset = floor_boundary(&file.text, offset);
        let line = file.line_starts.partition_point(|&start| start <= offset).max(1);
        let start = file.line_starts.get(line - 1).copied().unwrap_or(0);
        LineColumn { line, column: file.text[start..offset].chars().count() + 1 }
    }

    /// The byte offset of a position, clamped to the file and the line. O(length of the line).
    pub fn offset(&self, file: FileId, position: LineColumn) -> usize {
        let Some(file) = self.file(file) else { return 0 };
        let index = position.line.saturating_sub(1);
        let Some(&start) = file.line_starts.get(index) else { return file.text.len() };
        let end = file.line_starts.get(index + 1).map_or(file.text.len(), |next| next - 1);
        let line = &file.text[start..end.max(start)];
        start + line.char_indices().nth(position.column.saturating_sub(1)).map_or(line.len(), |(at, _)| at)
    }

    /// `file:line:column` of a label.
    pub fn place(&self, label: &Label) -> String {
        let LineColumn { line, column } = self.position(label.file, label.span.start);
        format!("{}:{line}:{column}", self.name(label.file))
    }

    /// The diagnostic as text with the source underlined, ending in a line end.
    pub fn render(&self, diagnostic: &Diagnostic, colour: bool) -> String {
        let level = match diagnostic.severity {
            Severity::Error => Level::ERROR,
            Severity::Warning => Level::WARNING,
            Severity::Note => Level::NOTE,
        };
        let mut group = level.primary_title(diagnostic.message.as_str()).id(diagnostic.code).elements(self.snippets(diagnostic));
        group = diagnostic.help.iter().fold(group, |group, help| group.element(Level::HELP.message(help.as_str())));
        let renderer = if colour { Renderer::styled() } else { Renderer::plain() };
        let report: [Group<'_>; 1] = [group];
        format!("{}\n", renderer.render(&report))
    }

    /// One snippet for each file that has a label, the file of the problem first.
    fn snippets<'s>(&'s self, diagnostic: &Diagnostic) -> Vec<Snippet<'s, annotate_snippets::Annotation<'s>>> {
        let mut labels: Vec<&Label> = diagnostic.primary().into_iter().collect();
        labels.extend(diagnostic.labels.iter().filter(|label| !diagnostic.primary().is_some_and(|primary| std::ptr::eq(primary, *label))));
        let mut files: Vec<FileId> = Vec::new();
        for label in &labels {
            if self.file(label.file).is_some() && !files.contains(&label.file) {
                files.push(label.file);
            }
        }
        let expectation = diagnostic.expectation().unwrap_or_default();
        let text_of = |label: &Label| if label.primary && label.text.is_empty() { expectation.clone() } else { label.text.clone() };
        let snippet = |file: FileId| {
            let (text, here): (&str, Vec<_>) = (self.text(file), labels.iter().filter(|label| label.file == file).collect());
            let window = self.window(file, here.iter().map(|label| clamp(text, label.span)));
            let annotations = here.into_iter().map(|label| {
                let kind = if label.primary { AnnotationKind::Primary } else { AnnotationKind::Context };
                let span = clamp(text, label.span);
                kind.span(span.start - window.start..span.end - window.start).label(text_of(label))
            });
            let first_line = self.position(file, window.start).line;
            let annotations = annotations.collect::<Vec<_>>();
            Snippet::source(&text[window.range()]).line_start(first_line).path(self.name(file)).annotations(annotations)
        };
        files.into_iter().map(snippet).collect()
    }

    /// The whole lines from the first span to the last: the renderer takes time for every line that it is given.
    fn window(&self, file: FileId, spans: impl Iterator<Item = Span>) -> Span {
        let Some(text) = self.file(file).map(|file| &file.text) else { return Span::default() };
        let all = spans.reduce(|all, span| Span::new(all.start.min(span.start), all.end.max(span.end))).unwrap_or_default();
        let start = text[..all.start].rfind('\n').map_or(0, |at| at + 1);
        Span::new(start, text[all.end..].find('\n').map_or(text.len(), |at| all.end + at))
    }

    /// All diagnostics as text, a blank line between.
    pub fn render_all(&self, diagnostics: &[Diagnostic], colour: bool) -> String {
        diagnostics.iter().map(|diagnostic| self.render(diagnostic, colour)).collect::<Vec<_>>().join("\n")
    }

    /// The diagnostic on one line, for logs: `file:line:column: error[PB0102]: message: expected X, found Y; help`.
    pub fn line(&self, diagnostic: &Diagnostic) -> String {
        let place = diagnostic.primary().map(|label| format!("{}: ", self.place(label))).unwrap_or_default();
        let expectation = diagnostic.expectation().map(|text| format!(": {text}")).unwrap_or_default();
        let help = diagnostic.help.iter().map(|help| format!("; {help}")).collect::<String>();
        let text = format!("{place}{}[{}]: {}{expectation}{help}", diagnostic.severity.name(), diagnostic.code, diagnostic.message);
        text.replace(['\n', '\r'], " ")
    }

    /// The diagnostic in the form that becomes JSON.
    pub fn to_json(&self, diagnostic: &Diagnostic) -> JsonDiagnostic {
        // Messages without fields of their own say it in words: "expected X, found Y".
        let in_words = diagnostic.message.split_once("expected ").and_then(|(_, rest)| rest.split_once(", found "));
        let (expected, found) = in_words.unzip();
        JsonDiagnostic {
            code: diagnostic.code,
            severity: diagnostic.severity,
            message: diagnostic.message.clone(),
            place: diagnostic.primary().map(|label| self.json_place(label)),
            expected: diagnostic.expected.clone().or_else(|| expected.map(str::to_owned)),
            found: diagnostic.found.clone().or_else(|| found.map(str::to_owned)),
            help: diagnostic.help.clone(),
            related: diagnostic.labels.iter().filter(|label| !label.primary).map(|label| self.json_place(label)).collect(),
        }
    }

    fn json_place(&self, label: &Label) -> JsonPlace {
        let start = self.position(label.file, label.span.start);
        let end = self.position(label.file, label.span.end);
        JsonPlace {
            file: self.name(label.file).to_owned(),
            line: start.line,
            column: start.column,
            end_line: end.line,
            end_column: end.column,
            text: self.slice(label.file, label.span).to_owned(),
            label: (!label.text.is_empty()).then(|| label.text.clone()),
        }
    }

    fn file(&self, file: FileId) -> Option<&SourceFile> {
        self.files.get(file.0 as usize)
    }
}

/// A diagnostic as JSON shows it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct JsonDiagnostic {
    /// Stable code.
    pub code: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// What is wrong.
    pub message: String,
    /// Where; its fields stand beside the others.
    #[serde(flatten)]
    pub place: Option<JsonPlace>,
    /// What was expected.
    pub expected: Option<String>,
    /// What was found.
    pub found: Option<String>,
    /// What to do about it.
    pub help: Vec<String>,
    /// Other places that explain it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub related: Vec<JsonPlace>,
}

/// A place as JSON shows it; lines and columns start at 1, columns count characters, the end is excluded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct JsonPlace {
    /// Name of the file.
    pub file: String,
    /// Line of the first character.
    pub line: usize,
    /// Column of the first character.
    pub column: usize,
    /// Line of the end.
    pub end_line: usize,
    /// Column of the end.
    pub end_column: usize,
    /// The source text in between.
    pub text: String,
    /// What is said about the place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

/// Puts diagnostics in order, by file, then position, then severity, and removes those that say the same twice. Stable; O(n log n).
pub fn sort(diagnostics: &mut Vec<Diagnostic>) {
    diagnostics.sort_by(compare);
    diagnostics.dedup();
}

/// Those without a place come last: what has a place is easier to act on.
fn compare(left: &Diagnostic, right: &Diagnostic) -> Ordering {
    let key = |diagnostic: &Diagnostic| diagnostic.primary().map_or((true, FileId(0), Span::default()), |at| (false, at.file, at.span));
    key(left).cmp(&key(right)).then(left.severity.cmp(&right.severity)).then(left.code.cmp(right.code)).then_with(|| {
        (&left.message, &left.expected, &left.found, &left.help).cmp(&(&right.message, &right.expected, &right.found, &right.help))
    })
}

/// The candidate closest to the word, if it is close enough to be meant: within a third of the longer length, at least one edit.
/// Among equals the first wins. Distance is Damerau-Levenshtein (insertions, deletions, substitutions, swaps of neighbours; F. J.
/// Damerau, "A technique for computer detection and correction of spelling errors", CACM 7(3), 1964), with case and the choice between `_`, `-` and `.` not counted
/// but for ties. O(length squared) for each candidate.
pub fn did_you_mean<'c>(word: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<&'c str> {
    let normal = |text: &str| text.chars().flat_map(char::to_lowercase).map(|c| if matches!(c, '-' | '.') { '_' } else { c }).collect();
    let word_chars: Vec<char> = normal(word);
    let mut best: Option<((usize, usize), &str)> = None;
    for candidate in candidates {
        let chars: Vec<char> = normal(candidate);
        let limit = (word_chars.len().max(chars.len()) / 3).max(1);
        if chars.len().abs_diff(word_chars.len()) > limit || word_chars.len() > MAX_WORD_CHARS {
            continue;
        }
        let rank = (distance(&word_chars, &chars), usize::from(candidate != word));
        let is_plausible = rank.0 <= limit && rank.0 < word_chars.len().max(chars.len());
        if is_plausible && candidate != word && best.is_none_or(|(least, _)| rank < least) {
            best = Some((rank, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

/// Longer words are not names that someone mistyped.
const MAX_WORD_CHARS: usize = 200;

/// Damerau-Levenshtein distance in its form of optimal string alignment: no part is edited twice.
fn distance(left: &[char], right: &[char]) -> usize {
    let mut before: Vec<usize> = vec![0; right.len() + 1];
    let mut previous: Vec<usize> = (0..=right.len()).collect();
    let mut current = previous.clone();
    for row in 1..=left.len() {
        current[0] = row;
        for column in 1..=right.len() {
            let substitution = usize::from(left[row - 1] != right[column - 1]);
            let mut cost = (previous[column] + 1).min(current[column - 1] + 1).min(previous[column - 1] + substitution);
            let swapped = row > 1 && column > 1 && left[row - 1] == right[column - 2] && left[row - 2] == right[column - 1];
            if swapped {
                cost = cost.min(before[column - 2] + 1);
            }
            current[column] = cost;
        }
        std::mem::swap(&mut before, &mut previous);
        std::mem::swap(&mut previous, &mut current);
    }
    previous[right.len()]
}

fn floor_boundary(text: &str, offset: usize) -> usize {
    let mut at = offset.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

fn clamp(text: &str, span: Span) -> Span {
    Span::new(floor_boundary(text, span.start), floor_boundary(text, span.end))
}

#[cfg(test)]
mod tests;
