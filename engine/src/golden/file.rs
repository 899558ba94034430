//! The golden file beside a graph: what is compared, how near it has to be and why, and what has to hold.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::de::DeserializeOwned;

use crate::check::{LoadOptions, Place, code};
use crate::clock::Clock;
use crate::diag::{Diagnostic, FileId, Label, Severity, SourceMap, Span};
use crate::graph::Graph;
use crate::job::{FrameSet, FramesError};
use crate::syntax::{FieldRef, NodeKind, NodeRef, Tree, parse_value};

use super::compare::{Invariant, Metric, Tolerance, Tolerances};

/// Fields of a case; those of the file itself are what its cases begin with.
const CASE: [&str; 13] = [
    "doc",
    "params",
    "set",
    "shot",
    "site",
    "library",
    "frames",
    "cut",
    "outputs",
    "tolerances",
    "invariants",
    "same_on_threads",
    "only_check",
];
/// Fields of the file besides.
const FILE: [&str; 2] = ["pegbar", "cases"];
/// Name of the case of a file that names none.
pub const ONLY_CASE: &str = "main";

/// One way to run a graph, and what is expected of it then.
#[derive(Clone, Debug, Default)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// Where it is written.
    pub span: Span,
    /// Values of the graph's parameters, as RON.
    pub params: BTreeMap<String, String>,
    /// Values of inputs, `node.input`, as RON.
    pub set: BTreeMap<String, String>,
    /// Where these are written: `$name` and `node.input`.
    pub places: BTreeMap<String, Place>,
    /// Folder of the shot that the graph is run for.
    pub shot: Option<PathBuf>,
    /// Layer of every show.
    pub site: Option<PathBuf>,
    /// Folders in which graphs that are used are looked for.
    pub library: Vec<PathBuf>,
    /// Frames that are compared; the first, the middle and the last of each output's clock where `None`.
    pub frames: Option<FrameSet>,
    /// Clocks that end earlier, by name: nodes that run over whole sequences take as long as those are.
    pub cut: BTreeMap<String, i64>,
    /// Outputs that are compared, declared ones or `node.port`; all that the graph declares where empty.
    pub outputs: Vec<String>,
    /// Tolerances by output or type.
    pub tolerances: Vec<(String, Tolerance)>,
    /// What has to hold, by output or type, or `*` for all.
    pub invariants: Vec<(String, Invariant)>,
    /// True where it is run again, on another number of threads and without the cache, and has to give the same bits.
    pub same_on_threads: bool,
    /// True for a graph that is made to be used by others, with parameters that have no value of their own: it is checked and not run.
    pub only_check: bool,
}

/// A golden file that was read, with all that is wrong with it.
pub struct GoldenFile {
    /// The file's source, and no other.
    pub sources: SourceMap,
    /// What is wrong.
    pub diagnostics: Vec<Diagnostic>,
    /// The cases, in the order in which they are written.
    pub cases: Vec<Case>,
    /// The source.
    pub file: FileId,
}

/// The golden file of a graph: `hat.golden.ron` beside `hat.ron`.
pub fn golden_of(graph: &Path) -> PathBuf {
    graph.with_extension("golden.ron")
}

/// True for the name of a golden file.
pub fn is_golden(path: &Path) -> bool {
    path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(".golden.ron"))
}

impl GoldenFile {
    /// Reads a golden file; paths in it are held against its folder.
    pub fn read(path: &Path) -> Self {
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(path, &text),
            Err(error) => {
                let wrong = Diagnostic::new(Severity::Error, code::UNREADABLE, format!("{}: {error}", path.display()));
                Self { sources: SourceMap::new(), diagnostics: vec![wrong], cases: Vec::new(), file: FileId::default() }
            }
        }
    }

    /// Reads the text of a golden file as if it stood at `path`.
    pub fn parse(path: &Path, text: &str) -> Self {
        let mut sources = SourceMap::new();
        let file = sources.add(path.display().to_string(), text);
        let tree = Tree::parse(text);
        let diagnostics = tree.errors().iter().map(|e| e.to_diagnostic(file)).collect();
        let mut reader = Reader {
            file,
            name: path.display().to_string(),
            text: Arc::from(text),
            base: path.parent().unwrap_or(Path::new("")),
            diagnostics,
        };
        let cases = tree.value().filter(|_| tree.errors().is_empty()).map(|root| reader.golden(root)).unwrap_or_default();
        crate::diag::sort(&mut reader.diagnostics);
        Self { diagnostics: reader.diagnostics, sources, cases, file }
    }
}

struct Reader<'a> {
    file: FileId,
    name: String,
    text: Arc<str>,
    base: &'a Path,
    diagnostics: Vec<Diagnostic>,
}

impl Reader<'_> {
    fn error(&mut self, code: &'static str, span: Span, message: impl Into<String>) {
        self.diagnostics.push(Diagnostic::error(code, message, Label::new(self.file, span)));
    }

    fn golden(&mut self, root: NodeRef<'_>) -> Vec<Case> {
        let name = root.name().map(|n| n.name().to_owned());
        if root.kind() != NodeKind::Struct || name.as_deref() != Some("Golden") {
            let found = name.map_or(root.describe().to_owned(), |n| format!("{n}(...)"));
            self.error(code::FORM, root.name().map_or(root.span(), |n| n.span()), format!("expected Golden(...), found {found}"));
            return Vec::new();
        }
        self.unknown(root, &[&FILE[..], &CASE[..]].concat(), "a golden");
        match root.field("pegbar").and_then(|f| f.value()) {
            Some(value) if self.value::<i64>(value).is_some_and(|n| n != 1) => {
                self.error(code::FORMAT_VERSION, value.span(), format!("expected format version 1, found {}", value.text()));
            }
            None => self.error(code::MISSING_FIELD, root.span(), "expected `pegbar: 1`, the format version, found none"),
            Some(_) => (),
        }
        let mut all = Case { span: root.name().map_or(root.span(), |n| n.span()), ..Case::default() };
        self.case(root, &mut all);
        let Some(cases) = root.field("cases") else { return vec![Case { name: ONLY_CASE.to_owned(), ..all }] };
        let mut found = Vec::new();
        for (name, span, value) in self.map(cases) {
            if !is_name(&name) {
                self.error(code::BAD_NAME, span, format!("expected a name of letters, digits, `_` and `-`, found `{name}`"));
            }
            let mut case = Case { name, span, ..all.clone() };
            if value.kind() == NodeKind::Struct {
                self.unknown(value, &CASE, "a case");
                self.case(value, &mut case);
            } else if value.kind() != NodeKind::Unit {
                self.error(code::FORM, value.span(), format!("expected a case as (frames: \"1-48\"), found {}", value.describe()));
            }
            found.push(case);
        }
        found
    }

    /// Reads what a record says of a case over what was said before.
    fn case(&mut self, record: NodeRef<'_>, case: &mut Case) {
        let field = |name: &str| record.field(name);
        for (name, span, value) in field("params").map(|f| self.map(f)).unwrap_or_default() {
            case.places.insert(format!("${name}"), self.place(span, value));
            case.params.insert(name, value.text().to_owned());
        }
        for (name, span, value) in field("set").map(|f| self.map(f)).unwrap_or_default() {
            case.places.insert(name.clone(), self.place(span, value));
            case.set.insert(name, value.text().to_owned());
        }
        for (name, into) in [("shot", &mut case.shot), ("site", &mut case.site)] {
            if let Some(path) = self.field::<String>(field(name)) {
                *into = Some(self.base.join(path));
            }
        }
        if let Some(library) = self.field::<Vec<String>>(field("library")) {
            case.library = library.iter().map(|l| self.base.join(l)).collect();
        }
        if let Some(frames) = field("frames") {
            case.frames = self.frames(frames);
        }
        for (name, span, value) in field("cut").map(|f| self.map(f)).unwrap_or_default() {
            if let Some(last) = self.value(value) {
                case.cut.insert(name, last);
            } else if value.kind() == NodeKind::Map {
                self.error(code::FORM, span, "expected the last frame of a clock, found a map");
            }
        }
        if let Some(outputs) = self.field(field("outputs")) {
            case.outputs = outputs;
        }
        let tolerances = self.tolerances(field("tolerances"));
        case.tolerances.extend(tolerances);
        for (name, _, value) in field("invariants").map(|f| self.map(f)).unwrap_or_default() {
            case.invariants.extend(self.value(value).map(|i| (name, i)));
        }
        let flags: [(&str, &mut bool); 2] = [("same_on_threads", &mut case.same_on_threads), ("only_check", &mut case.only_check)];
        for (name, into) in flags {
            *into = self.field(field(name)).unwrap_or(*into);
        }
        self.field::<String>(field("doc"));
    }

    fn tolerances(&mut self, field: Option<FieldRef<'_>>) -> Vec<(String, Tolerance)> {
        let mut found = Vec::new();
        for (name, _, value) in field.map(|f| self.map(f)).unwrap_or_default() {
            let Some(tolerance) = self.value::<Tolerance>(value) else { continue };
            let wrong = match &tolerance {
                t if t.reason.trim().is_empty() => Some("expected a reason for the tolerance, found an empty text"),
                t if [Some(t.at_most), t.pixels].iter().flatten().any(|v| v.is_nan() || *v < 0.0) => {
                    Some("expected a tolerance of at least 0, found less")
                }
                t if t.metric == Metric::Bits && t.at_most > 0.0 => Some("expected no `at_most` where every bit counts, found one"),
                _ => None,
            };
            match wrong {
                Some(wrong) => self.error(code::FORM, value.span(), wrong),
                None => found.push((name, tolerance)),
            }
        }
        found
    }

    fn frames(&mut self, field: FieldRef<'_>) -> Option<FrameSet> {
        let value = field.value()?;
        let text = self.value::<String>(value)?;
        let parsed = text.parse();
        if let Err(error) = &parsed {
            let error: &FramesError = error;
            self.error(code::FORM, value.span(), error.to_string());
        }
        parsed.ok()
    }

    fn field<T: DeserializeOwned>(&mut self, field: Option<FieldRef<'_>>) -> Option<T> {
        let value = field?.value()?;
        self.value(value)
    }

    fn value<T: DeserializeOwned>(&mut self, value: NodeRef<'_>) -> Option<T> {
        match parse_value(value) {
            Ok(value) => Some(value),
            Err(error) => {
                self.diagnostics.push(error.to_diagnostic(code::FORM, self.file));
                None
            }
        }
    }

    fn place(&self, name: Span, value: NodeRef<'_>) -> Place {
        Place { file: self.name.clone(), text: self.text.clone(), name, value: value.span() }
    }

    /// Entries of a map with names for keys.
    fn map<'t>(&mut self, field: FieldRef<'t>) -> Vec<(String, Span, NodeRef<'t>)> {
        let Some(value) = field.value() else { return Vec::new() };
        if value.kind() != NodeKind::Map {
            self.error(code::FORM, value.span(), format!("expected a map as {{ \"name\": ... }}, found {}", value.describe()));
            return Vec::new();
        }
        let mut out: Vec<(String, Span, NodeRef<'t>)> = Vec::new();
        for entry in value.entries() {
            let (Some(key), Some(value)) = (entry.key(), entry.value()) else { continue };
            match key.as_str().map(|s| s.into_value().into_owned()) {
                None => self.error(code::FORM, key.span(), format!("expected a name as \"name\", found {}", key.describe())),
                Some(name) if out.iter().any(|(n, _, _)| *n == name) => {
                    self.error(code::DUPLICATE, key.span(), format!("`{name}` stands twice"));
                }
                Some(name) => out.push((name, key.span(), value)),
            }
        }
        out
    }

    fn unknown(&mut self, record: NodeRef<'_>, known: &[&str], what: &str) {
        let mut seen: Vec<&str> = Vec::new();
        for field in record.fields().filter(|f| !f.name().is_empty()) {
            let (name, span) = (field.name(), field.name_span());
            if !known.contains(&name) {
                let message = format!("expected a field of {what}, found `{name}`");
                let found = Diagnostic::error(code::UNKNOWN_FIELD, message, Label::new(self.file, span));
                let found = found.help(format!("the fields are {}", known.join(", ")));
                self.diagnostics.push(found.did_you_mean(name, known.iter().copied()));
            } else if seen.contains(&name) {
                self.error(code::DUPLICATE, span, format!("field `{name}` stands twice"));
            }
            seen.push(name);
        }
    }
}

/// True for what can be part of a file's name everywhere.
fn is_name(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '_' || c == '-')
}

impl Case {
    /// How the graph is loaded: what the case sets, and `out` for what it writes. `base` is the folder that paths are held against.
    pub fn load_options(&self, base: &Path, out: PathBuf) -> LoadOptions {
        let pairs = |map: &BTreeMap<String, String>| map.iter().map(|(k, v)| (k.clone(), v.clone())).collect();
        LoadOptions {
            out,
            variables: pairs(&self.params),
            overrides: pairs(&self.set),
            shot: self.shot.clone(),
            site: self.site.clone(),
            library: self.library.clone(),
            places: self.places.clone(),
            base: base.to_owned(),
            ..LoadOptions::default()
        }
    }

    /// The frames of `clock` that are compared.
    ///
    /// # Errors
    /// Where the clock does not have them.
    pub fn frames_on(&self, clock: &Clock) -> Result<Vec<i64>, FramesError> {
        match &self.frames {
            Some(set) => set.on(clock),
            None => Ok(first_middle_last(&clock.frames().collect::<Vec<_>>())),
        }
    }

    /// Ends the clocks of a graph where the case says.
    pub fn shorten(&self, graph: &mut Graph) {
        let cut = |clock: &mut Arc<Clock>| {
            if let Some(last) = self.cut.get(&clock.name) {
                *clock = Arc::new(Clock { last: (*last).clamp(clock.first, clock.last), ..(**clock).clone() });
            }
        };
        graph.clocks.iter_mut().for_each(cut);
        for node in &mut graph.nodes {
            cut(&mut node.clock);
            node.input_clocks.iter_mut().for_each(|(_, clock)| cut(clock));
        }
    }

    /// How near values have to be.
    pub fn tolerances(&self, is_picture: fn(&str) -> bool) -> Tolerances {
        Tolerances { rules: self.tolerances.clone(), is_picture }
    }

    /// What has to hold of an output of a type.
    pub fn invariants_of<'a>(&'a self, output: &'a str, type_name: &'a str) -> impl Iterator<Item = &'a Invariant> {
        self.invariants.iter().filter(move |(n, _)| n == "*" || n == output || n == type_name).map(|(_, i)| i)
    }
}

/// The ends and the middle of a list, as far as they are not the same.
pub(super) fn first_middle_last(frames: &[i64]) -> Vec<i64> {
    let n = frames.len();
    let mut picked: Vec<i64> = if n == 0 { Vec::new() } else { vec![frames[0], frames[(n - 1) / 2], frames[n - 1]] };
    picked.dedup();
    picked
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> GoldenFile {
        GoldenFile::parse(Path::new("show/hat.golden.ron"), text)
    }

    #[test]
    fn cases_begin_with_what_the_file_says() {
        let text = r#"Golden(pegbar: 1, params: {"size": (192, 192)}, frames: "1-9x4", tolerances: {"Image": (at_most: 0.1, reason: "a")},
            cases: { "small": (), "big": (params: {"size": (9, 9), "art": "b.png"}, shot: "../sh", frames: "5", same_on_threads: true,
            tolerances: {"image": (metric: rms, at_most: 0.2, reason: "b")}, invariants: {"*": (finite: true, within: (0, 1))}) })"#;
        let found = read(text);
        assert!(found.diagnostics.is_empty(), "{}", found.sources.render_all(&found.diagnostics, false));
        let [small, big] = &found.cases[..] else { panic!("expected two cases, found {}", found.cases.len()) };
        assert_eq!((small.params["size"].as_str(), small.frames.as_ref().map(ToString::to_string)), ("(192, 192)", Some("1-9x4".into())));
        assert_eq!((big.params["size"].as_str(), big.params["art"].as_str()), ("(9, 9)", "\"b.png\""));
        assert_eq!((big.shot.as_deref(), big.same_on_threads), (Some(Path::new("show/../sh")), true));
        let of = |output: &str| big.tolerances(|_| true).of(output, "Image").map(|t| t.at_most);
        assert_eq!((of("image"), of("other")), (Some(0.2), Some(0.1)));
        assert_eq!(big.invariants_of("x", "y").next().and_then(|i| i.within), Some((0.0, 1.0)));
        assert_eq!(read("Golden(pegbar: 1)").cases[0].name, ONLY_CASE);
    }

    #[test]
    fn all_that_is_wrong_is_said_at_its_place() {
        let text = "Golden(\n    pegbar: 1,\n    frame: \"1\",\n    frames: \"9-1\",\n    outputs: \"image\",\n    same_on_threads: 1,\n    \
            tolerances: {\"Image\": (at_most: 0.1), \"Matte\": (at_mots: 1, reason: \"x\"), \"Curve\": (reason: \" \")},\n    cases: {\"a/b\": ()},\n)";
        let found = read(text);
        let said: Vec<String> = found.diagnostics.iter().map(|d| found.sources.line(d)).collect();
        let expected = [
            "show/hat.golden.ron:3:5: error[PB0101]: expected a field of a golden, found `frame`",
            "show/hat.golden.ron:4:13: error[PB0103]: expected a range that goes up, found `9-1`",
            "show/hat.golden.ron:5:14: error[PB0103]: expected list, found ",
            "show/hat.golden.ron:6:22: error[PB0103]: expected boolean, found ",
            "show/hat.golden.ron:7:27: error[PB0103]: missing field `reason`",
            "show/hat.golden.ron:7:53: error[PB0103]: unknown field `at_mots`",
            "show/hat.golden.ron:7:88: error[PB0103]: expected a reason for the tolerance, found an empty text",
            "show/hat.golden.ron:8:13: error[PB0111]: expected a name",
        ];
        assert_eq!(said.len(), expected.len(), "{said:#?}");
        for (said, expected) in said.iter().zip(expected) {
            assert!(said.starts_with(expected), "{said}\n{expected}");
        }
        assert!(read("Graph(pegbar: 1)").diagnostics[0].message.starts_with("expected Golden(...), found Graph(...)"));
        assert!(read("Golden(").cases.is_empty());
    }
}
