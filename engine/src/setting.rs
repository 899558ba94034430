//! Settings: inputs that are written in the graph file as RON literals.

use std::fmt::Debug;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::de::DeserializeOwned;

use crate::registry::Types;
use crate::value::{AnyValue, ValueType};

/// Why a literal is not the setting it should be.
#[derive(Clone, Debug, PartialEq)]
pub struct SettingError {
    /// The offending bytes, relative to the literal's text.
    pub span: Range<usize>,
    /// `expected X, found Y`.
    pub message: String,
    /// The valid choices, where there is a list of them.
    pub choices: Vec<String>,
}

impl SettingError {
    /// An error about the whole literal.
    pub fn whole(text: &str, message: impl Into<String>) -> Self {
        Self { span: 0..text.len(), message: message.into(), choices: Vec::new() }
    }
}

/// A Rust type that a graph file gives as a literal.
pub trait Setting: Clone + Debug + Send + Sync + 'static {
    /// Its name for people: `number`, `list of colours`, `bilinear | cubic`.
    fn type_name() -> String;
    /// The valid words, for an enumeration.
    fn choices() -> Vec<Choice> {
        Vec::new()
    }
    /// Reads the literal.
    ///
    /// # Errors
    /// Where the text is not of this type.
    fn parse(text: &str) -> Result<Self, SettingError>;
    /// Numbers inside, to be held against the input's range.
    fn numbers(&self) -> Vec<f64> {
        Vec::new()
    }
    /// The value type that may be wired here instead of a literal.
    const WIRE: Option<&'static str> = None;
    /// The setting from a wired value of that type.
    fn from_wire(_value: &dyn AnyValue) -> Option<Self> {
        None
    }
    /// What files this setting names.
    const FILES: FileUse = FileUse::None;
    /// Lets a path learn where it stands.
    fn bind(self, _place: &Place) -> Self {
        self
    }
}

/// What a setting has to do with files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileUse {
    /// Nothing.
    None,
    /// Names a file, or one a frame, that is read.
    Read,
    /// Names a file, or one a frame, that is written.
    Write,
}

/// One word of an enumeration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Choice {
    /// The word.
    pub name: &'static str,
    /// What it means.
    pub doc: &'static str,
}

/// What a graph file's relative paths and names are held against.
#[derive(Clone, Debug, Default)]
pub struct Place {
    /// Folder of the graph file in which the path is written.
    pub base: PathBuf,
    /// Folder that `$out` stands for; nothing is written outside it.
    pub out: PathBuf,
    /// The value types that a graph may name.
    pub types: Types,
    /// The graph with all that it is run with, as text for the files that it writes.
    pub origin: Option<Arc<str>>,
}

fn read<T: DeserializeOwned>(text: &str) -> Result<T, SettingError> {
    crate::syntax::parse_slice(text, crate::syntax::Extensions::empty()).map_err(|e| SettingError {
        span: e.span.range(),
        message: e.message,
        choices: Vec::new(),
    })
}

macro_rules! setting {
    ($t:ty, $name:literal, |$v:ident| $numbers:expr) => {
        impl Setting for $t {
            fn type_name() -> String {
                $name.to_owned()
            }
            fn parse(text: &str) -> Result<Self, SettingError> {
                read(text)
            }
            fn numbers(&self) -> Vec<f64> {
                let $v = self;
                $numbers
            }
        }
    };
}

setting!(i64, "whole number", |v| vec![*v as f64]);
setting!(u64, "whole number", |v| vec![*v as f64]);
setting!(u32, "whole number", |v| vec![f64::from(*v)]);
setting!(usize, "whole number", |v| vec![*v as f64]);
setting!(bool, "true or false", |_v| Vec::new());
setting!([i64; 2], "pair of whole numbers", |v| v.iter().map(|&x| x as f64).collect());
setting!([u32; 2], "pair of whole numbers", |v| v.iter().map(|&x| f64::from(x)).collect());
setting!([i64; 4], "four whole numbers", |v| v.iter().map(|&x| x as f64).collect());
setting!([f64; 2], "pair of numbers", |v| v.to_vec());
setting!([f64; 3], "three numbers", |v| v.to_vec());
setting!([f64; 4], "four numbers", |v| v.to_vec());
setting!(Vec<f64>, "list of numbers", |v| v.clone());
setting!(Vec<i64>, "list of whole numbers", |v| v.iter().map(|&x| x as f64).collect());
setting!(Vec<[f64; 2]>, "list of pairs of numbers", |v| v.iter().flatten().copied().collect());
setting!(Vec<[f64; 3]>, "list of triples of numbers", |v| v.iter().flatten().copied().collect());
setting!(Vec<[f64; 4]>, "list of four numbers each", |v| v.iter().flatten().copied().collect());
setting!(Vec<Vec<f64>>, "list of lists of numbers", |v| v.concat());
setting!(Vec<String>, "list of texts", |_v| Vec::new());

impl Setting for String {
    fn type_name() -> String {
        "text".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        read(text)
    }
}

impl Setting for f64 {
    fn type_name() -> String {
        "number".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        read(text)
    }
    fn numbers(&self) -> Vec<f64> {
        vec![*self]
    }
    const WIRE: Option<&'static str> = Some("Curve");
    fn from_wire(value: &dyn AnyValue) -> Option<Self> {
        let parts = value.parts();
        let (_, array) = parts.arrays.iter().find(|(name, _)| *name == "value")?;
        bytemuck::try_pod_read_unaligned(array.bytes).ok()
    }
}

/// A setting that may be left out: `None` or nothing at all in the graph file.
impl<T: Setting> Setting for Option<T> {
    fn type_name() -> String {
        T::type_name()
    }
    fn choices() -> Vec<Choice> {
        T::choices()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        if text.trim() == "None" { Ok(None) } else { T::parse(text).map(Some) }
    }
    fn numbers(&self) -> Vec<f64> {
        self.as_ref().map(Setting::numbers).unwrap_or_default()
    }
    const WIRE: Option<&'static str> = T::WIRE;
    fn from_wire(value: &dyn AnyValue) -> Option<Self> {
        T::from_wire(value).map(Some)
    }
    const FILES: FileUse = T::FILES;
    fn bind(self, place: &Place) -> Self {
        self.map(|v| v.bind(place))
    }
}

/// The name of a clock: the one that a node's outputs tick to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClockName(
    /// As in the graph file.
    pub String,
);

impl Setting for ClockName {
    fn type_name() -> String {
        "clock".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        read(text).map(Self)
    }
}

/// The name of a value type, as `"KeyShapes"`: for nodes that make values of a type which their settings decide.
#[derive(Clone)]
pub struct TypeName {
    name: String,
    ty: Option<ValueType>,
}

impl TypeName {
    /// As in the graph file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The type; `None` where there is none of that name, which is found when a graph is checked.
    pub fn get(&self) -> Option<&ValueType> {
        self.ty.as_ref()
    }
}

impl Debug for TypeName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("TypeName").field(&self.name).finish()
    }
}

impl Setting for TypeName {
    fn type_name() -> String {
        "value type".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        Ok(Self { name: read(text)?, ty: None })
    }
    fn bind(self, place: &Place) -> Self {
        Self { ty: place.types.get(&self.name).cloned(), ..self }
    }
}

/// A file to read, or one a frame: `art/hat.png`, `plate/hat.####.png`, `plate/hat.%04d.png`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputPath(Pattern);

/// Files to read, none of them numbered: `"a.svg"` or `["a.svg", "b.svg"]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputPaths(
    /// Each of them, in order.
    pub Vec<InputPath>,
);

/// A file to write, or one a frame, inside the output folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputPath {
    pattern: Pattern,
    root: PathBuf,
    origin: Option<Arc<str>>,
}

/// What a reader does at a frame whose file is not there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Missing {
    /// It is an error, found before anything runs.
    #[default]
    Error,
    /// The nearest earlier frame that is there is shown on.
    Hold,
    /// The nearest frame that is there, earlier or later.
    Nearest,
}

impl Setting for Missing {
    fn type_name() -> String {
        "error | hold | nearest".to_owned()
    }
    fn choices() -> Vec<Choice> {
        vec![
            Choice { name: "error", doc: "A missing frame is an error, found before anything runs." },
            Choice { name: "hold", doc: "The nearest earlier frame that is there is shown on." },
            Choice { name: "nearest", doc: "The nearest frame that is there, earlier or later." },
        ]
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        match choose(text, &Self::choices())? {
            0 => Ok(Missing::Error),
            1 => Ok(Missing::Hold),
            _ => Ok(Missing::Nearest),
        }
    }
}

/// The position of the word `text`, bare or quoted, among `choices`.
///
/// # Errors
/// Where it is none of them.
pub fn choose(text: &str, choices: &[Choice]) -> Result<usize, SettingError> {
    let word = text.trim().trim_matches('"');
    choices.iter().position(|c| c.name == word).ok_or_else(|| {
        let names: Vec<String> = choices.iter().map(|c| c.name.to_owned()).collect();
        SettingError {
            message: format!("expected one of {}, found {}", names.join(", "), text.trim()),
            choices: names,
            span: 0..text.len(),
        }
    })
}

/// A path with at most one frame number in it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Pattern {
    before: String,
    digits: Option<usize>,
    after: String,
}

impl Pattern {
    /// Splits at `####` or `%04d`; only the file name may hold the number.
    fn parse(path: &str) -> Result<Self, String> {
        let plain = || Self { before: path.to_owned(), digits: None, after: String::new() };
        let (start, end, digits) = if let Some(start) = path.find('#') {
            let n = path[start..].bytes().take_while(|&b| b == b'#').count();
            (start, start + n, n)
        } else if let Some((start, n, width)) = printf(path) {
            (start, start + n, width)
        } else {
            return Ok(plain());
        };
        let (before, after) = (path[..start].to_owned(), path[end..].to_owned());
        if after.contains('#') || printf(&after).is_some() {
            return Err("expected one frame number in the path, found two".to_owned());
        }
        if after.contains('/') {
            return Err("expected the frame number in the file's name, found it in a folder's".to_owned());
        }
        Ok(Self { before, digits: Some(digits), after })
    }

    fn under(self, base: &Path) -> Self {
        let before = base.join(&self.before).to_string_lossy().into_owned();
        Self { before, ..self }
    }

    fn at(&self, frame: i64) -> PathBuf {
        match self.digits {
            None => PathBuf::from(&self.before),
            Some(n) => {
                let sign = if frame < 0 { "-" } else { "" };
                PathBuf::from(format!("{}{sign}{:0n$}{}", self.before, frame.unsigned_abs(), self.after))
            }
        }
    }

    /// The path with its frame number as `####`.
    fn text(&self) -> String {
        format!("{}{}{}", self.before, "#".repeat(self.digits.unwrap_or(0)), self.after)
    }

    /// The frame number in `name`, where it is a file of this pattern.
    fn frame_of(&self, path: &str) -> Option<i64> {
        let middle = path.strip_prefix(self.before.as_str())?.strip_suffix(self.after.as_str())?;
        let number: i64 = middle.parse().ok()?;
        (self.at(number).to_string_lossy() == path).then_some(number)
    }
}

fn printf(path: &str) -> Option<(usize, usize, usize)> {
    let start = path.find('%')?;
    let rest = &path[start + 1..];
    let n = rest.bytes().take_while(u8::is_ascii_digit).count();
    rest[n..].starts_with('d').then(|| (start, n + 2, rest[..n].parse().unwrap_or(1).clamp(1, 16)))
}

impl InputPath {
    /// True where the path has a frame number in it.
    pub fn is_sequence(&self) -> bool {
        self.0.digits.is_some()
    }

    /// The file of a frame.
    pub fn at(&self, frame: i64) -> PathBuf {
        self.0.at(frame)
    }

    /// The path as written, below the graph's folder.
    pub fn pattern(&self) -> String {
        self.0.text()
    }

    /// Numbers of the frames whose files are there, ascending.
    ///
    /// # Errors
    /// Where the folder cannot be listed.
    pub fn frames(&self) -> std::io::Result<Vec<i64>> {
        let any = self.at(0);
        let folder = any.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let any_name = any.file_name().unwrap_or_default().to_string_lossy().len();
        // Before the names stands what the pattern has there: a listing of `.` would begin with `./`.
        let whole = any.to_string_lossy();
        let before = whole.get(..whole.len().saturating_sub(any_name)).unwrap_or_default();
        let mut frames = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let name = entry?.file_name();
            frames.extend(self.0.frame_of(&format!("{before}{}", name.to_string_lossy())));
        }
        frames.sort_unstable();
        Ok(frames)
    }

    /// The file that a reader opens for `frame` under a policy for missing frames; `None` where there is none.
    pub fn resolve(&self, frame: i64, missing: Missing) -> Option<PathBuf> {
        let own = self.at(frame);
        if missing == Missing::Error || !self.is_sequence() || own.exists() {
            return Some(own);
        }
        let frames = self.frames().ok()?;
        let split = frames.partition_point(|&f| f <= frame);
        let earlier = split.checked_sub(1).and_then(|i| frames.get(i)).copied();
        let later = frames.get(split).copied();
        let pick = match (missing, earlier, later) {
            (Missing::Nearest, Some(a), Some(b)) => Some(if frame - a <= b - frame { a } else { b }),
            (Missing::Nearest, None, b) => b,
            (_, a, _) => a,
        };
        pick.map(|f| self.at(f))
    }
}

impl Setting for InputPath {
    fn type_name() -> String {
        "path to read".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        let path: String = read(text)?;
        if path.is_empty() {
            return Err(SettingError::whole(text, "expected a path, found an empty text"));
        }
        Pattern::parse(&path).map(Self).map_err(|m| SettingError::whole(text, m))
    }
    const FILES: FileUse = FileUse::Read;
    fn bind(self, place: &Place) -> Self {
        Self(self.0.under(&place.base))
    }
}

impl Setting for InputPaths {
    fn type_name() -> String {
        "path or list of paths to read".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        if !text.trim_start().starts_with('[') {
            return Self::plain(text, vec![InputPath::parse(text)?]);
        }
        let paths: Vec<String> = read(text)?;
        if paths.is_empty() {
            return Err(SettingError::whole(text, "expected a path, found an empty list"));
        }
        let each = |path: String| match path.as_str() {
            "" => Err(SettingError::whole(text, "expected a path, found an empty text")),
            path => Pattern::parse(path).map(InputPath).map_err(|m| SettingError::whole(text, m)),
        };
        Self::plain(text, paths.into_iter().map(each).collect::<Result<_, _>>()?)
    }
    const FILES: FileUse = FileUse::Read;
    fn bind(self, place: &Place) -> Self {
        Self(self.0.into_iter().map(|path| path.bind(place)).collect())
    }
}

impl InputPaths {
    fn plain(text: &str, paths: Vec<InputPath>) -> Result<Self, SettingError> {
        match paths.iter().find(|p| p.is_sequence()) {
            Some(path) => Err(SettingError::whole(text, format!("expected paths without frame numbers, found {}", path.pattern()))),
            None => Ok(Self(paths)),
        }
    }
}

impl OutputPath {
    /// True where the path has a frame number in it.
    pub fn is_sequence(&self) -> bool {
        self.pattern.digits.is_some()
    }

    /// The file of a frame.
    pub fn at(&self, frame: i64) -> PathBuf {
        self.pattern.at(frame)
    }

    /// The path as written, below the output folder.
    pub fn pattern(&self) -> String {
        self.pattern.text()
    }

    /// The graph and its settings, for a file that can hold a text beside what it is for; see [`crate::origin`].
    pub fn origin(&self) -> Option<&Arc<str>> {
        self.origin.as_ref()
    }

    /// The output folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// True where the path, with its `..` followed, stays inside the output folder.
    pub fn is_inside(&self) -> bool {
        let normal = normalise(&self.at(0));
        normal.starts_with(normalise(&self.root))
    }
}

/// `path` with `.` and `..` followed in words alone, as the file need not be there.
pub(crate) fn normalise(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut out = PathBuf::new();
    for part in absolute.components() {
        match part {
            std::path::Component::ParentDir => {
                out.pop();
            }
            std::path::Component::CurDir => {}
            part => out.push(part),
        }
    }
    out
}

impl Setting for OutputPath {
    fn type_name() -> String {
        "path to write".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        let path: String = read(text)?;
        if path.is_empty() {
            return Err(SettingError::whole(text, "expected a path, found an empty text"));
        }
        let pattern = Pattern::parse(&path).map_err(|m| SettingError::whole(text, m))?;
        Ok(Self { pattern, root: PathBuf::new(), origin: None })
    }
    const FILES: FileUse = FileUse::Write;
    fn bind(self, place: &Place) -> Self {
        Self { pattern: self.pattern.under(&place.out), root: place.out.clone(), origin: place.origin.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_hold_one_frame_number() {
        let path = |text: &str| InputPath::parse(&format!("{text:?}"));
        assert_eq!(path("a/b.####.png").unwrap().at(12), PathBuf::from("a/b.0012.png"));
        assert_eq!(path("a/b.%04d.png").unwrap().at(12), PathBuf::from("a/b.0012.png"));
        assert_eq!(path("b.#.png").unwrap().at(-3), PathBuf::from("b.-3.png"));
        assert_eq!(path("b.png").unwrap().at(7), PathBuf::from("b.png"));
        assert!(path("a##/b##.png").is_err());
        assert!(path("a##/b.png").is_err());
        let hash = path("b.##.png").unwrap();
        assert_eq!(hash.0.frame_of("b.07.png"), Some(7));
        assert_eq!(hash.0.frame_of("b.7.png"), None);
        assert_eq!(hash.0.frame_of("b.123.png"), Some(123));
    }

    #[test]
    fn one_path_or_a_list_of_paths() {
        let files = |text: &str| InputPaths::parse(text).map(|p| p.0.iter().map(|p| p.at(0)).collect::<Vec<_>>()).map_err(|e| e.message);
        assert_eq!(files("\"a.svg\"").unwrap(), [PathBuf::from("a.svg")]);
        assert_eq!(files(" [\"a.svg\", \"b.svg\"]").unwrap(), [PathBuf::from("a.svg"), PathBuf::from("b.svg")]);
        assert_eq!(files("[]").unwrap_err(), "expected a path, found an empty list");
        assert_eq!(files("[\"a.svg\", \"\"]").unwrap_err(), "expected a path, found an empty text");
        assert_eq!(files("[\"a.##.svg\"]").unwrap_err(), "expected paths without frame numbers, found a.##.svg");
    }

    #[test]
    fn missing_frames_are_held_or_taken_from_the_nearest() {
        let folder = tempfile::tempdir().unwrap();
        for n in [2, 3, 9] {
            std::fs::write(folder.path().join(format!("p.{n:02}.png")), b"").unwrap();
        }
        let place = Place { base: folder.path().to_owned(), out: PathBuf::new(), ..Place::default() };
        let path = InputPath::parse("\"p.##.png\"").unwrap().bind(&place);
        assert_eq!(path.frames().unwrap(), [2, 3, 9]);
        let name = |f, m| path.resolve(f, m).map(|p| p.file_name().unwrap().to_string_lossy().into_owned());
        assert_eq!(name(5, Missing::Hold).as_deref(), Some("p.03.png"));
        assert_eq!(name(7, Missing::Nearest).as_deref(), Some("p.09.png"));
        assert_eq!(name(1, Missing::Hold), None);
        assert_eq!(name(1, Missing::Nearest).as_deref(), Some("p.02.png"));
        assert_eq!(name(5, Missing::Error).as_deref(), Some("p.05.png"));
    }

    #[test]
    fn a_path_out_of_the_output_folder_is_seen() {
        let place = Place { base: PathBuf::new(), out: PathBuf::from("out"), ..Place::default() };
        let inside = |text: &str| OutputPath::parse(text).unwrap().bind(&place).is_inside();
        assert!(inside("\"a/b.png\""));
        assert!(inside("\"a/../b.png\""));
        assert!(!inside("\"../b.png\""));
        assert!(!inside("\"/tmp/b.png\""));
    }
}
