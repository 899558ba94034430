//! What a node type says of itself.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::input::Literal;
use crate::setting::{Choice, FileUse, Place, SettingError};

/// How a node reads time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Any frame by itself, from its inputs at the frames that it asks for.
    PerFrame,
    /// In order: its inputs at a frame, and its own state from another.
    Recurrent,
    /// Once, from whole sequences.
    Whole,
    /// Files in.
    Source,
    /// Files out.
    Sink,
}

/// Which frames of an input a node reads for one of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Access {
    /// The same frame, or the one value that there is.
    Frame,
    /// The frames that the node asks for.
    Frames,
    /// All of them, one by one.
    Sequence,
    /// The frames that the node asks for, one by one.
    Picked,
    /// One value for the whole graph, known before frames are asked for.
    Constant,
}

impl Access {
    /// True where the node is asked which frames it reads.
    pub const fn asks(self) -> bool {
        matches!(self, Self::Frames | Self::Picked)
    }

    /// True where the node is given a handle, by which it fetches one value after the other.
    pub const fn by_handle(self) -> bool {
        matches!(self, Self::Sequence | Self::Picked)
    }
}

/// What may stand at an input.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum InputType {
    /// A value of this type, by reference.
    Value(&'static str),
    /// A value of any type, by reference.
    Any,
    /// A literal; the value type that may be wired instead, if one may.
    Setting {
        /// Name for people.
        name: String,
        /// Type that may be wired.
        wire: Option<&'static str>,
    },
}

/// What a node's declaration says of one input. Made by `#[derive(Node)]`.
#[derive(Clone, Serialize)]
pub struct InputSchema {
    /// Name in graph files.
    pub name: &'static str,
    /// Meaning, unit and both ends of the range.
    pub doc: &'static str,
    /// What may stand there.
    #[serde(rename = "type")]
    pub ty: InputType,
    /// Frames that are read.
    pub access: Access,
    /// The first and last frame that is read, counted from that which is made, for an input of which several are: whole numbers, or names of settings
    /// with or without a minus sign. Beyond the ends of the clock its last frame stands for all. What plugins may say in place of
    /// [`PerFrame::reads`](super::PerFrame::reads), so that their code need not be asked.
    pub window: Option<(&'static str, &'static str)>,
    /// True for a list of references.
    pub list: bool,
    /// True where it may be left out without a default.
    pub optional: bool,
    /// Default, as RON.
    pub default: Option<&'static str>,
    /// Unit, as `px`.
    pub unit: Option<&'static str>,
    /// Least and greatest number allowed.
    pub range: Option<(f64, f64)>,
    /// Words, for an enumeration.
    pub choices: Vec<Choice>,
    /// The form of a literal in place of a reference to a value.
    pub literal: Option<&'static str>,
    /// Files named by this input.
    #[serde(skip)]
    pub files: FileUse,
    /// True where its clock may differ from that of the node.
    pub any_clock: bool,
    /// Reads the literal.
    #[serde(skip)]
    pub parse: ParseLiteral,
}

/// Reads a literal of an input, with the numbers in it that its range holds.
pub type ParseLiteral = Arc<dyn Fn(&str, &Place) -> Result<(Literal, Vec<f64>), SettingError> + Send + Sync>;

/// The files that the contents of a file name, and that whoever reads it reads as well: a scene's buffers and textures. None where it cannot be read.
pub type Beside = fn(&Path) -> Vec<PathBuf>;

/// What a node's declaration says of one output. Made by `#[derive(Outputs)]`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OutputSchema {
    /// Name in graph files.
    pub name: &'static str,
    /// Meaning and unit.
    pub doc: &'static str,
    /// Value type; `None` for any, which the node's settings or inputs decide.
    #[serde(rename = "type")]
    pub ty: Option<&'static str>,
    /// True for one value a frame out of a node that runs once.
    pub stream: bool,
}

/// Everything that a node type says of itself.
#[derive(Clone, Serialize)]
pub struct NodeSchema {
    /// Id in graph files, as `track.affine`.
    pub id: &'static str,
    /// Version of its behaviour: part of every key.
    pub version: u32,
    /// How it reads time.
    pub kind: Kind,
    /// Doc comment of its struct: first line the summary.
    pub doc: &'static str,
    /// Where the method comes from.
    pub source: Option<&'static str>,
    /// A graph file that shows it.
    pub example: Option<&'static str>,
    /// True where the output differs from frame to frame whatever the inputs.
    pub uses_frame: bool,
    /// For files that name others: the files that one names, which the node reads as well.
    #[serde(skip)]
    pub beside: Option<Beside>,
    /// For outputs of any type: the input whose type they have, or the text setting that names it.
    pub type_from: Option<&'static str>,
    /// Inputs and settings, in the order of the struct.
    pub inputs: Vec<InputSchema>,
    /// Outputs, the first being what `@node` means.
    pub outputs: Vec<OutputSchema>,
}

impl NodeSchema {
    /// The input `name` and its position.
    pub fn input(&self, name: &str) -> Option<(usize, &InputSchema)> {
        self.inputs.iter().enumerate().find(|(_, i)| i.name == name)
    }

    /// The output `name` and its position.
    pub fn output(&self, name: &str) -> Option<(usize, &OutputSchema)> {
        self.outputs.iter().enumerate().find(|(_, o)| o.name == name)
    }
}
