//! What a plugin says of itself: as text in the manifest beside its library, and in the same words out of the library.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};

use ron::ser::PrettyConfig;
use serde::{Deserialize, Serialize};

use super::PluginError;
use super::settings::{self, SettingType};
use crate::array::DType;
use crate::node::{Access, InputSchema, InputType, Kind, NodeSchema, OutputSchema};
use crate::setting::{Choice, FileUse, Place};
use crate::value::{ArraySchema, TextSchema, TypeSchema};

/// How the name of a manifest ends.
pub const ENDING: &str = ".plugin.ron";
/// Bytes of a manifest at most.
const LARGEST: u64 = 8 << 20;

/// The manifest `NAME.plugin.ron`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename = "PluginManifest")]
pub struct Manifest {
    /// The library for each platform, as `linux-x86_64`.
    pub libraries: BTreeMap<String, LibraryFile>,
    /// What it holds.
    pub plugin: Description,
}

/// A library file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LibraryFile {
    /// Its name, beside the manifest.
    pub file: String,
    /// BLAKE3 of its content, in hexadecimal.
    pub digest: String,
}

/// Which calls of a plugin may run at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Threads {
    /// All.
    #[default]
    Any,
    /// Those of different instances.
    Instance,
    /// One at a time.
    One,
}

/// What a plugin holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Its name: a lower case word, which the ids of its nodes begin with.
    pub name: String,
    /// Its version: numbers with points between, as `1.2.0`.
    pub version: String,
    /// What it is for.
    pub doc: String,
    /// Major and minor version of the ABI that it was made for.
    pub abi: (u32, u32),
    /// Which calls may run at once.
    #[serde(default)]
    pub threads: Threads,
    /// Its node types.
    pub nodes: Vec<NodeText>,
    /// Every value type that its nodes read and make, its own and others'.
    #[serde(default)]
    pub values: Vec<TypeText>,
}

/// A node type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeText {
    /// Id in graph files: the plugin's name, a point, and a lower case word.
    pub id: String,
    /// Version of its behaviour.
    pub version: u32,
    /// How it reads time.
    pub kind: Kind,
    /// What it does; its first line is the summary.
    pub doc: String,
    /// Where the method comes from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// A graph file that shows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub example: Option<String>,
    /// True where the output differs from frame to frame whatever the inputs.
    #[serde(default, skip_serializing_if = "is_false")]
    pub uses_frame: bool,
    /// True where its code is asked which frames it reads.
    #[serde(default, skip_serializing_if = "is_false")]
    pub asks: bool,
    /// Inputs and settings.
    pub inputs: Vec<InputText>,
    /// Outputs, the first being what `@node` means.
    pub outputs: Vec<OutputText>,
    /// What a recurrent node remembers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<TypeText>,
}

/// What may stand at an input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PortType {
    /// A value of this type.
    Value(String),
    /// A literal of this type, as `number`.
    Setting(String),
}

/// An input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputText {
    /// Name in graph files.
    pub name: String,
    /// Meaning, unit and both ends of the range.
    pub doc: String,
    /// What may stand there.
    #[serde(rename = "type")]
    pub ty: PortType,
    /// Frames that are read.
    #[serde(default = "frame", skip_serializing_if = "is_frame")]
    pub access: Access,
    /// The first and last frame that is read, counted from that which is made, for an input that is read at several frames: whole numbers, or names of
    /// settings with or without a minus sign. Beyond the ends of the clock its last frame stands for all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<(String, String)>,
    /// True for a list of references.
    #[serde(default, skip_serializing_if = "is_false")]
    pub list: bool,
    /// True where it may be left out without a default.
    #[serde(default, skip_serializing_if = "is_false")]
    pub optional: bool,
    /// Default, as RON.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub default: Option<String>,
    /// Unit, as `px`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Least and greatest number allowed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<(f64, f64)>,
    /// Words and what they mean, for an enumeration.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub choices: Vec<(String, String)>,
    /// True for a setting that may be wired to a curve.
    #[serde(default, skip_serializing_if = "is_false")]
    pub wire: bool,
    /// True where its clock may differ from that of the node.
    #[serde(default, skip_serializing_if = "is_false")]
    pub any_clock: bool,
}

/// An output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputText {
    /// Name in graph files.
    pub name: String,
    /// Meaning and unit.
    pub doc: String,
    /// Value type.
    #[serde(rename = "type")]
    pub ty: String,
    /// True for one value a frame out of a node that runs once.
    #[serde(default, skip_serializing_if = "is_false")]
    pub stream: bool,
    /// True where no number in its arrays may be NaN or infinite, which the host sees to.
    #[serde(default, skip_serializing_if = "is_false")]
    pub finite: bool,
}

/// A value type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TypeText {
    /// Name in graph files.
    pub name: String,
    /// What it stands for.
    pub doc: String,
    /// Its arrays.
    pub arrays: Vec<ArrayText>,
    /// Its text fields.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<TextText>,
}

/// An array of a value type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArrayText {
    /// Name in files.
    pub name: String,
    /// Element type.
    pub dtype: DType,
    /// Shape in letters and numbers, as `[n, 2]`.
    pub shape: String,
    /// True where it may be left out: it is then empty.
    #[serde(default, skip_serializing_if = "is_false")]
    pub optional: bool,
    /// Meaning and unit.
    pub doc: String,
}

/// A text field of a value type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TextText {
    /// Name in the JSON object.
    pub name: String,
    /// Meaning.
    pub doc: String,
}

fn is_false(flag: &bool) -> bool {
    !flag
}

fn frame() -> Access {
    Access::Frame
}

fn is_frame(access: &Access) -> bool {
    *access == Access::Frame
}

/// The text as one that lives as long as the process. Each distinct text is kept once, so that reading a manifest again takes no more memory.
pub(super) fn intern(text: &str) -> &'static str {
    static TEXTS: LazyLock<Mutex<HashSet<&'static str>>> = LazyLock::new(Mutex::default);
    let mut texts = TEXTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = texts.get(text) {
        return known;
    }
    let leaked: &'static str = Box::leak(text.to_owned().into_boxed_str());
    texts.insert(leaked);
    leaked
}

/// What this system is called in manifests.
pub fn platform() -> String {
    format!("{}-{}", std::env::consts::OS, std::env::consts::ARCH)
}

impl Manifest {
    /// Reads a manifest. Loads no code.
    ///
    /// # Errors
    /// Where it cannot be read, or does not hold together.
    pub fn read(path: &Path) -> Result<Self, PluginError> {
        let unreadable = |why: String| PluginError::manifest(path, why);
        let size = std::fs::metadata(path).map_err(|e| unreadable(e.to_string()))?.len();
        if size > LARGEST {
            return Err(unreadable(format!("expected at most {LARGEST} bytes, found {size}")));
        }
        let text = std::fs::read_to_string(path).map_err(|e| unreadable(e.to_string()))?;
        let manifest: Self = crate::syntax::parse_slice(&text, crate::syntax::Extensions::empty()).map_err(|e| {
            let line = text[..e.span.start.min(text.len())].lines().count().max(1);
            unreadable(format!("line {line}: {}", e.message))
        })?;
        manifest.plugin.validate().map_err(unreadable)?;
        Ok(manifest)
    }

    /// Writes the manifest.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), PluginError> {
        write_ron(path, self).map_err(|why| PluginError::manifest(path, why))
    }

    /// The library of this platform.
    ///
    /// # Errors
    /// Where there is none for it.
    pub fn library(&self, folder: &Path) -> Result<(PathBuf, &str), PluginError> {
        let here = platform();
        let found = self.libraries.get(&here).ok_or_else(|| {
            let others: Vec<&str> = self.libraries.keys().map(String::as_str).collect();
            PluginError::plugin(&self.plugin, format!("expected a library for {here}, found {}", or_none(&others)))
        })?;
        Ok((folder.join(&found.file), &found.digest))
    }
}

/// Writes a record as a file of RON, whole or not at all.
pub(super) fn write_ron(path: &Path, record: &impl Serialize) -> Result<(), String> {
    let text = ron::ser::to_string_pretty(record, PrettyConfig::new().struct_names(true)).map_err(|e| e.to_string())? + "\n";
    crate::atomic::write(path, |to| std::io::Write::write_all(to, text.as_bytes())).map_err(|e| e.to_string())
}

fn or_none(words: &[&str]) -> String {
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

fn is_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_lowercase()) && text.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

fn is_version(text: &str) -> bool {
    let parts: Vec<&str> = text.split('.').collect();
    parts.len() <= 3 && parts.iter().all(|p| !p.is_empty() && p.bytes().all(|b| b.is_ascii_digit()))
}

impl Description {
    /// Reads what a library says of itself.
    ///
    /// # Errors
    /// Where the text is none, or does not hold together; in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let description: Self = crate::syntax::parse_slice(text, crate::syntax::Extensions::empty()).map_err(|e| e.message)?;
        description.validate().map(|()| description)
    }

    /// The text that [`Description::parse`] reads.
    pub fn to_ron(&self) -> String {
        ron::to_string(self).unwrap_or_default()
    }

    /// Holds its parts together.
    ///
    /// # Errors
    /// The first thing that is wrong, in words.
    pub fn validate(&self) -> Result<(), String> {
        if !is_word(&self.name) {
            return Err(format!("expected a lower case word as the plugin's name, found `{}`", self.name));
        }
        if !is_version(&self.version) {
            return Err(format!("expected a version as 1.2.0, found `{}`", self.version));
        }
        let mut ids = BTreeSet::new();
        for node in &self.nodes {
            let tail = node.id.strip_prefix(&self.name).and_then(|t| t.strip_prefix('.'));
            if !tail.is_some_and(is_word) {
                return Err(format!("expected a node id as {}.word, found `{}`", self.name, node.id));
            }
            if !ids.insert(&node.id) {
                return Err(format!("expected each node id once, found `{}` twice", node.id));
            }
            self.validate_node(node).map_err(|why| format!("node `{}`: {why}", node.id))?;
        }
        self.values.iter().chain(self.nodes.iter().filter_map(|n| n.state.as_ref())).try_for_each(validate_type)
    }

    fn validate_node(&self, node: &NodeText) -> Result<(), String> {
        if (node.kind == Kind::Recurrent) != node.state.is_some() {
            return Err("expected a state of recurrent nodes, and of no others".to_owned());
        }
        let names: BTreeSet<&str> = node.inputs.iter().map(|i| i.name.as_str()).collect();
        if names.len() < node.inputs.len() {
            return Err("expected each input once, found one twice".to_owned());
        }
        for input in &node.inputs {
            self.validate_input(node, input).map_err(|why| format!("input `{}`: {why}", input.name))?;
        }
        for output in &node.outputs {
            self.is_known(&output.ty).map_err(|why| format!("output `{}`: {why}", output.name))?;
            if output.stream && node.kind != Kind::Whole {
                return Err(format!("output `{}`: expected a stream of whole nodes alone", output.name));
            }
        }
        Ok(())
    }

    fn validate_input(&self, node: &NodeText, input: &InputText) -> Result<(), String> {
        if !is_word(&input.name) || input.name == "type" {
            return Err("expected a lower case word other than `type` as its name".to_owned());
        }
        match &input.ty {
            PortType::Value(ty) => self.is_known(ty)?,
            PortType::Setting(name) => {
                let ty = SettingType::of(name, &input.choices, input.optional)?;
                if let Some(default) = &input.default {
                    (ty.parse)(default, &Place::default()).map_err(|e| format!("default {default}: {}", e.message))?;
                }
                if input.wire && name != "number" {
                    return Err(format!("expected a number where a curve may be wired, found {name}"));
                }
            }
        }
        let is_setting = matches!(input.ty, PortType::Setting(_));
        if is_setting && (input.list || !matches!(input.access, Access::Frame | Access::Constant)) {
            return Err("expected a setting to be read once, at its frame".to_owned());
        }
        match (&input.window, input.access.asks(), node.asks) {
            (None, true, false) => Err("expected a `window`, or `asks: true` of the node, as it is read at several frames".to_owned()),
            (Some(_), false, _) => Err("expected a window of inputs alone that are read at `frames` or `picked`".to_owned()),
            (Some(window), true, _) => [&window.0, &window.1].into_iter().try_for_each(|end| known_end(end, node)),
            _ => Ok(()),
        }
    }

    fn is_known(&self, ty: &str) -> Result<(), String> {
        let own = ["Curve", "TimeMap", "Vector"];
        if own.contains(&ty) || self.values.iter().any(|v| v.name == ty) {
            return Ok(());
        }
        Err(format!("expected a value type among `values`, found `{ty}`"))
    }

    /// The first part in which two descriptions differ, and what each says.
    pub fn difference(&self, other: &Self) -> Option<(String, String, String)> {
        let plain = [
            ("name", self.name.clone(), other.name.clone()),
            ("version", self.version.clone(), other.version.clone()),
            ("abi", format!("{}.{}", self.abi.0, self.abi.1), format!("{}.{}", other.abi.0, other.abi.1)),
            ("threads", format!("{:?}", self.threads), format!("{:?}", other.threads)),
            ("doc", self.doc.clone(), other.doc.clone()),
        ];
        if let Some((what, a, b)) = plain.into_iter().find(|(_, a, b)| a != b) {
            return Some((what.to_owned(), a, b));
        }
        differing("nodes", &self.nodes, &other.nodes, |n| &n.id).or_else(|| differing("values", &self.values, &other.values, |v| &v.name))
    }
}

/// The first item that is not in both lists the same.
fn differing<T: PartialEq + Serialize>(what: &str, a: &[T], b: &[T], name: impl Fn(&T) -> &String) -> Option<(String, String, String)> {
    let text = |item: Option<&T>| item.map_or("none".to_owned(), |i| ron::to_string(i).unwrap_or_default());
    let at = (0..a.len().max(b.len())).find(|&i| a.get(i) != b.get(i))?;
    let of = a.get(at).or(b.get(at)).map(|i| name(i).clone()).unwrap_or_default();
    let (a, b) = (text(a.get(at)), text(b.get(at)));
    // What both begin with says nothing.
    let same = a.char_indices().zip(b.chars()).take_while(|((_, x), y)| x == y).last().map_or(0, |((i, _), _)| i);
    let start = a[..same].rfind([',', '(']).map_or(0, |i| i + 1);
    let short = |text: &str| text.chars().skip(a[..start].chars().count()).take(60).collect::<String>();
    Some((format!("{what} `{of}`"), short(&a), short(&b)))
}

fn known_end(end: &str, node: &NodeText) -> Result<(), String> {
    let name = end.strip_prefix('-').unwrap_or(end);
    let is_setting = |i: &InputText| i.name == name && i.ty == PortType::Setting("whole number".to_owned()) && !i.wire;
    match name.parse::<u32>().is_ok() || node.inputs.iter().any(is_setting) {
        true => Ok(()),
        false => Err(format!("expected a whole number or a setting of that type at an end of the window, found `{end}`")),
    }
}

fn validate_type(ty: &TypeText) -> Result<(), String> {
    let names: BTreeSet<&str> = ty.arrays.iter().map(|a| a.name.as_str()).collect();
    if ty.name.is_empty() || names.len() < ty.arrays.len() {
        return Err(format!("value type `{}`: expected a name, and each array once", ty.name));
    }
    match ty.arrays.iter().find(|a| axes(&a.shape).is_none()) {
        Some(array) => Err(format!("value type `{}`: expected a shape as [n, 2] of at most 4 axes, found {}", ty.name, array.shape)),
        None => Ok(()),
    }
}

/// The axes of a shape in letters: a number where it is fixed.
pub(super) fn axes(shape: &str) -> Option<Vec<Option<usize>>> {
    let inner = shape.trim().strip_prefix('[')?.strip_suffix(']')?.trim();
    if inner.is_empty() {
        return Some(Vec::new());
    }
    let axes: Vec<Option<usize>> = inner.split(',').map(|axis| axis.trim().parse().ok()).collect();
    (axes.len() <= crate::array::Shape::MAX_RANK).then_some(axes)
}

impl TypeText {
    /// As the registry keeps it.
    pub fn schema(&self) -> TypeSchema {
        let array = |a: &ArrayText| ArraySchema {
            name: intern(&a.name),
            dtype: a.dtype,
            shape: intern(&a.shape),
            optional: a.optional,
            doc: intern(&a.doc),
        };
        TypeSchema {
            name: intern(&self.name),
            doc: intern(&self.doc),
            arrays: self.arrays.iter().map(array).collect(),
            texts: self.texts.iter().map(|t| TextSchema { name: intern(&t.name), doc: intern(&t.doc) }).collect(),
        }
    }

    /// What a type says of itself.
    pub fn of(schema: &TypeSchema) -> Self {
        let array = |a: &ArraySchema| ArrayText {
            name: a.name.to_owned(),
            dtype: a.dtype,
            shape: a.shape.to_owned(),
            optional: a.optional,
            doc: a.doc.to_owned(),
        };
        Self {
            name: schema.name.to_owned(),
            doc: schema.doc.to_owned(),
            arrays: schema.arrays.iter().map(array).collect(),
            texts: schema.texts.iter().map(|t| TextText { name: t.name.to_owned(), doc: t.doc.to_owned() }).collect(),
        }
    }
}

impl NodeText {
    /// As the registry keeps it. The text was validated.
    pub(super) fn schema(&self) -> Result<NodeSchema, String> {
        let option = |text: &Option<String>| text.as_deref().map(intern);
        Ok(NodeSchema {
            id: intern(&self.id),
            version: self.version,
            kind: self.kind,
            doc: intern(&self.doc),
            source: option(&self.source),
            example: option(&self.example),
            uses_frame: self.uses_frame,
            beside: None,
            type_from: None,
            inputs: self.inputs.iter().map(InputText::schema).collect::<Result<_, _>>()?,
            outputs: self.outputs.iter().map(OutputText::schema).collect(),
        })
    }
}

impl OutputText {
    fn schema(&self) -> OutputSchema {
        OutputSchema { name: intern(&self.name), doc: intern(&self.doc), ty: Some(intern(&self.ty)), stream: self.stream }
    }
}

impl InputText {
    pub(super) fn schema(&self) -> Result<InputSchema, String> {
        let (ty, parse, files) = match &self.ty {
            PortType::Value(name) => (InputType::Value(intern(name)), settings::value_literal(intern(name)), FileUse::None),
            PortType::Setting(name) => {
                let setting = SettingType::of(name, &self.choices, self.optional)?;
                (InputType::Setting { name: setting.name, wire: self.wire.then_some("Curve") }, setting.parse, setting.files)
            }
        };
        Ok(InputSchema {
            name: intern(&self.name),
            doc: intern(&self.doc),
            access: self.access,
            window: self.window.as_ref().map(|(first, last)| (intern(first), intern(last))),
            list: self.list,
            // A setting that may be left out is read as `None`.
            optional: self.optional && matches!(self.ty, PortType::Value(_)),
            default: self.default.as_deref().map(intern),
            unit: self.unit.as_deref().map(intern),
            range: self.range,
            choices: self.choices.iter().map(|(name, doc)| Choice { name: intern(name), doc: intern(doc) }).collect(),
            literal: None,
            files,
            any_clock: self.any_clock,
            ty,
            parse,
        })
    }

    /// What an input says of itself; `unsigned` for a whole number that cannot be below nought.
    pub fn of(input: &InputSchema, may_be_left_out: bool, is_unsigned: bool) -> Option<Self> {
        let (ty, wire) = match &input.ty {
            InputType::Value(name) => (PortType::Value((*name).to_owned()), false),
            InputType::Setting { name, wire } => (PortType::Setting(name.clone()), wire.is_some()),
            InputType::Any => return None,
        };
        let is_setting = matches!(ty, PortType::Setting(_));
        Some(Self {
            name: input.name.to_owned(),
            doc: input.doc.to_owned(),
            ty,
            access: input.access,
            window: input.window.map(|(first, last)| (first.to_owned(), last.to_owned())),
            list: input.list,
            optional: if is_setting { may_be_left_out } else { input.optional },
            default: input.default.map(str::to_owned),
            unit: input.unit.map(str::to_owned),
            range: input.range.or(is_unsigned.then_some((0.0, f64::from(u32::MAX)))),
            choices: input.choices.iter().map(|c| (c.name.to_owned(), c.doc.to_owned())).collect(),
            wire,
            any_clock: input.any_clock,
        })
    }
}
