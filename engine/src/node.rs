//! Nodes: what a node's author writes, what it tells of itself, and the two-step contract that the executor knows.

use std::any::Any;
use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::Serialize;
use thiserror::Error;

use crate::clock::Clock;
use crate::setting::{Choice, FileUse, Place, Setting, SettingError};
use crate::value::{AnyValue, Value, ValueRef, downcast};

/// How a node reads time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Access {
    /// The same frame, or the one value that there is.
    Frame,
    /// The frames that the node asks for.
    Frames,
    /// All of them.
    Sequence,
    /// One value for the whole graph, known before frames are asked for.
    Constant,
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
pub type ParseLiteral = fn(&str, &Place) -> Result<(Literal, Vec<f64>), SettingError>;

/// A literal that has been read: the Rust value of the field, to be cloned for each frame.
pub type Literal = Arc<dyn Any + Send + Sync>;

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

/// What stands at an input when a node runs.
#[derive(Clone, Debug)]
pub enum Arg {
    /// Nothing: an optional input left out, or a value that is not there yet.
    None,
    /// A literal.
    Literal(Literal),
    /// A value.
    Value(ValueRef),
    /// Values at the frames asked for, in the order asked.
    Frames(Vec<(i64, ValueRef)>),
    /// A whole sequence.
    Sequence(SequenceRef),
    /// One of these for each reference of a list.
    List(Vec<Arg>),
}

/// All frames of a stream, in order, or the one value that a single has.
#[derive(Clone, Debug)]
pub struct SequenceRef {
    /// The clock; `None` for a single.
    pub clock: Option<Arc<Clock>>,
    values: Arc<[ValueRef]>,
}

impl SequenceRef {
    /// A sequence over `clock`, one value a frame, or one value for a single.
    pub fn new(clock: Option<Arc<Clock>>, values: Vec<ValueRef>) -> Self {
        Self { clock, values: values.into() }
    }
}

/// A field of a node struct: an input or a setting.
pub trait Input: Sized {
    /// What may stand there.
    fn ty() -> InputType;
    /// Frames that are read.
    fn access() -> Access {
        Access::Frame
    }
    /// True for a list of references.
    const LIST: bool = false;
    /// True where nothing may stand there.
    const OPTIONAL: bool = false;
    /// Files named.
    const FILES: FileUse = FileUse::None;
    /// Words of an enumeration.
    fn choices() -> Vec<Choice> {
        Vec::new()
    }
    /// Form of a literal in place of a reference to a value.
    fn literal_form() -> Option<&'static str> {
        None
    }
    /// Reads a literal.
    ///
    /// # Errors
    /// Where the text is none, or no literal may stand here.
    fn parse(text: &str, place: &Place) -> Result<(Literal, Vec<f64>), SettingError>;
    /// The field from what stands at the input.
    ///
    /// # Errors
    /// Where that is of another type: a fault of the engine, as graphs are checked before they run.
    fn from_arg(arg: Arg) -> Result<Self, NodeError>;
}

fn mismatch(expected: &str, found: &Arg) -> NodeError {
    let found = match found {
        Arg::None => "nothing".to_owned(),
        Arg::Literal(_) => "another literal".to_owned(),
        Arg::Value(v) => v.type_name().to_owned(),
        Arg::Frames(_) | Arg::Sequence(_) => "a sequence".to_owned(),
        Arg::List(_) => "a list".to_owned(),
    };
    NodeError::internal(format!("expected {expected}, found {found}"))
}

impl<T: Setting> Input for T {
    fn ty() -> InputType {
        InputType::Setting { name: T::type_name(), wire: T::WIRE }
    }
    const FILES: FileUse = T::FILES;
    fn choices() -> Vec<Choice> {
        T::choices()
    }
    fn parse(text: &str, place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        let value = T::parse(text)?.bind(place);
        let numbers = value.numbers();
        Ok((Arc::new(value), numbers))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match &arg {
            Arg::Literal(l) => l.downcast_ref::<T>().cloned(),
            Arg::Value(v) => T::from_wire(v.as_ref()),
            _ => None,
        }
        .ok_or_else(|| mismatch(&T::type_name(), &arg))
    }
}

/// A value at the frame that is being made. Reads like the value itself.
#[derive(Debug)]
pub struct In<T>(Option<Arc<T>>);

impl<T: Value> In<T> {
    /// The shared value.
    ///
    /// # Errors
    /// Before the inputs are there, while a node says which frames it needs.
    pub fn shared(self) -> Result<Arc<T>, NodeError> {
        self.0.ok_or_else(|| NodeError::internal("an input was read before it was there"))
    }

    /// An input made by hand, for tests and for callers of a node as a library.
    pub fn new(value: T) -> Self {
        Self(Some(Arc::new(value)))
    }
}

impl<T: Value + Clone> In<T> {
    /// The value to be changed: without a copy where nobody else reads it.
    ///
    /// # Errors
    /// As [`In::shared`].
    pub fn into_owned(self) -> Result<T, NodeError> {
        Ok(Arc::unwrap_or_clone(self.shared()?))
    }
}

impl<T: Value> Deref for In<T> {
    type Target = T;
    #[allow(
        clippy::expect_used,
        reason = "only a node that reads an input while saying which frames it needs gets here; the executor reports it as that node's error"
    )]
    fn deref(&self) -> &T {
        self.0.as_deref().expect("an input was read before it was there")
    }
}

impl<T: Value> Input for In<T> {
    fn ty() -> InputType {
        InputType::Value(T::NAME)
    }
    fn literal_form() -> Option<&'static str> {
        T::literal().map(|l| l.form)
    }
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        match T::literal() {
            Some(l) => Ok((Arc::new((l.parse)(text)?), Vec::new())),
            None => Err(SettingError::whole(text, format!("expected a reference to {}, found a literal", T::NAME))),
        }
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        let shown = arg.clone();
        match arg {
            Arg::None => Ok(In(None)),
            Arg::Literal(l) => l.downcast::<T>().map(|v| In(Some(v))).map_err(|_| mismatch(T::NAME, &shown)),
            Arg::Value(v) => downcast::<T>(v).map(|v| In(Some(v))).ok_or_else(|| mismatch(T::NAME, &shown)),
            _ => Err(mismatch(T::NAME, &shown)),
        }
    }
}

/// A value of any type at the frame that is being made.
#[derive(Debug)]
pub struct Any1(Option<ValueRef>);

impl Any1 {
    /// The value.
    ///
    /// # Errors
    /// Before the inputs are there.
    pub fn value(&self) -> Result<&ValueRef, NodeError> {
        self.0.as_ref().ok_or_else(|| NodeError::internal("an input was read before it was there"))
    }
}

fn no_literal(text: &str) -> SettingError {
    SettingError::whole(text, "expected a reference as \"@node.port\", found a literal")
}

impl Input for Any1 {
    fn ty() -> InputType {
        InputType::Any
    }
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(Any1(None)),
            Arg::Value(v) => Ok(Any1(Some(v))),
            other => Err(mismatch("a value", &other)),
        }
    }
}

/// An input that may be left out.
impl<T: Value> Input for Option<In<T>> {
    fn ty() -> InputType {
        <In<T>>::ty()
    }
    const OPTIONAL: bool = true;
    fn literal_form() -> Option<&'static str> {
        <In<T>>::literal_form()
    }
    fn parse(text: &str, place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        <In<T>>::parse(text, place)
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(None),
            arg => <In<T>>::from_arg(arg).map(Some),
        }
    }
}

/// Values of one input at the frames that the node asks for; a single value stands at every frame.
#[derive(Debug)]
pub enum Frames<T> {
    /// One value for the whole graph.
    Held(Arc<T>),
    /// Frames and values, in the order asked for.
    Each(Vec<(i64, Arc<T>)>),
}

impl<T: Value> Frames<T> {
    /// The value at `frame`.
    ///
    /// # Errors
    /// Where the node did not ask for that frame.
    pub fn at(&self, frame: i64) -> Result<&Arc<T>, NodeError> {
        let found = match self {
            Frames::Held(value) => Some(value),
            Frames::Each(list) => list.iter().find(|(f, _)| *f == frame).map(|(_, v)| v),
        };
        found.ok_or_else(|| NodeError::internal(format!("frame {frame} was read without having been asked for")))
    }
}

impl<T: Value> Input for Frames<T> {
    fn ty() -> InputType {
        InputType::Value(T::NAME)
    }
    fn access() -> Access {
        Access::Frames
    }
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(Frames::Each(Vec::new())),
            Arg::Value(v) => downcast::<T>(v).map(Frames::Held).ok_or_else(|| NodeError::internal(format!("expected {}", T::NAME))),
            Arg::Frames(list) => {
                let typed = list.into_iter().map(|(f, v)| downcast::<T>(v).map(|v| (f, v)));
                typed.collect::<Option<_>>().map(Frames::Each).ok_or_else(|| NodeError::internal(format!("expected {} values", T::NAME)))
            }
            other => Err(mismatch(T::NAME, &other)),
        }
    }
}

/// An input of several frames that may be left out.
impl<T: Value> Input for Option<Frames<T>> {
    fn ty() -> InputType {
        InputType::Value(T::NAME)
    }
    fn access() -> Access {
        Access::Frames
    }
    const OPTIONAL: bool = true;
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(None),
            arg => <Frames<T>>::from_arg(arg).map(Some),
        }
    }
}

/// Values of any type at the frames that the node asks for.
#[derive(Debug)]
pub struct AnyFrames(Vec<(i64, ValueRef)>);

impl AnyFrames {
    /// The value at `frame`.
    ///
    /// # Errors
    /// Where the node did not ask for that frame.
    pub fn at(&self, frame: i64) -> Result<&ValueRef, NodeError> {
        let found = self.0.iter().find(|(f, _)| *f == frame || *f == HELD).map(|(_, v)| v);
        found.ok_or_else(|| NodeError::internal(format!("frame {frame} was read without having been asked for")))
    }
}

/// Stands for every frame, where one value does.
const HELD: i64 = i64::MIN;

impl Input for AnyFrames {
    fn ty() -> InputType {
        InputType::Any
    }
    fn access() -> Access {
        Access::Frames
    }
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(AnyFrames(Vec::new())),
            Arg::Value(v) => Ok(AnyFrames(vec![(HELD, v)])),
            Arg::Frames(list) => Ok(AnyFrames(list)),
            other => Err(mismatch("values", &other)),
        }
    }
}

/// A whole sequence, read by frame.
#[derive(Debug)]
pub struct Sequence<T>(SequenceRef, PhantomData<T>);

impl<T: Value> Sequence<T> {
    /// The clock; `None` for a single value.
    pub fn clock(&self) -> Option<&Clock> {
        self.0.clock.as_deref()
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.0.values.len()
    }

    /// True where there is no frame.
    pub fn is_empty(&self) -> bool {
        self.0.values.is_empty()
    }

    /// The value at a position of the sequence, 0 being the clock's first frame.
    ///
    /// # Errors
    /// Past the end.
    pub fn get(&self, idx: usize) -> Result<Arc<T>, NodeError> {
        let value = self.0.values.get(idx).cloned().and_then(downcast::<T>);
        value.ok_or_else(|| NodeError::internal(format!("frame {idx} of a sequence of {} was read", self.len())))
    }
}

impl<T: Value> Input for Sequence<T> {
    fn ty() -> InputType {
        InputType::Value(T::NAME)
    }
    fn access() -> Access {
        Access::Sequence
    }
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::Sequence(s) => Ok(Sequence(s, PhantomData)),
            other => Err(mismatch("a sequence", &other)),
        }
    }
}

/// A whole sequence of values of any type.
#[derive(Debug)]
pub struct AnySequence(SequenceRef);

impl AnySequence {
    /// The clock; `None` for a single value.
    pub fn clock(&self) -> Option<&Clock> {
        self.0.clock.as_deref()
    }

    /// The values, in order.
    pub fn values(&self) -> &[ValueRef] {
        &self.0.values
    }
}

impl Input for AnySequence {
    fn ty() -> InputType {
        InputType::Any
    }
    fn access() -> Access {
        Access::Sequence
    }
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::Sequence(s) => Ok(AnySequence(s)),
            other => Err(mismatch("a sequence", &other)),
        }
    }
}

/// Several references at one input: `["@a", "@b.port"]`, or one.
#[derive(Debug)]
pub struct List<I>(
    /// One for each reference, in order.
    pub Vec<I>,
);

impl<I: Input> Input for List<I> {
    fn ty() -> InputType {
        I::ty()
    }
    fn access() -> Access {
        I::access()
    }
    const LIST: bool = true;
    const OPTIONAL: bool = I::OPTIONAL;
    fn parse(text: &str, place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        I::parse(text, place)
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(List(Vec::new())),
            Arg::List(args) => args.into_iter().map(I::from_arg).collect::<Result<_, _>>().map(List),
            arg => I::from_arg(arg).map(|one| List(vec![one])),
        }
    }
}

/// What one output port gives.
#[derive(Debug)]
pub enum OutValue {
    /// One value: at this frame, or for the whole graph.
    One(ValueRef),
    /// One value for each frame of the node's clock.
    Stream(Vec<ValueRef>),
}

/// A field of an outputs struct.
pub trait Output {
    /// Value type; `None` for any.
    const TYPE: Option<&'static str>;
    /// One value a frame out of a node that runs once.
    const STREAM: bool = false;
    /// The value on its way out.
    fn into_out(self) -> OutValue;
}

impl<T: Value> Output for T {
    const TYPE: Option<&'static str> = Some(T::NAME);
    fn into_out(self) -> OutValue {
        OutValue::One(Arc::new(self))
    }
}

impl<T: Value> Output for Arc<T> {
    const TYPE: Option<&'static str> = Some(T::NAME);
    fn into_out(self) -> OutValue {
        OutValue::One(self)
    }
}

impl Output for ValueRef {
    const TYPE: Option<&'static str> = None;
    fn into_out(self) -> OutValue {
        OutValue::One(self)
    }
}

/// One value for each frame of the node's clock, out of a node that runs once.
#[derive(Debug)]
pub struct Stream<T>(
    /// In order of frames.
    pub Vec<T>,
);

impl<T: Value> Output for Stream<T> {
    const TYPE: Option<&'static str> = Some(T::NAME);
    const STREAM: bool = true;
    fn into_out(self) -> OutValue {
        OutValue::Stream(self.0.into_iter().map(|v| Arc::new(v) as ValueRef).collect())
    }
}

/// The outputs of a node: `#[derive(Outputs)]` on a struct of [`Output`] fields.
pub trait Outputs {
    /// What it says of its ports.
    fn schema() -> Vec<OutputSchema>;
    /// Its values, in the order of the ports.
    fn into_values(self) -> Vec<OutValue>;
}

impl Outputs for () {
    fn schema() -> Vec<OutputSchema> {
        Vec::new()
    }
    fn into_values(self) -> Vec<OutValue> {
        Vec::new()
    }
}

/// Whose fault a failure is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// A setting's.
    Parameters,
    /// An input value's.
    Input,
    /// The numbers': singular, not converging, not finite.
    Numeric,
    /// A limit's: too large.
    Limit,
    /// Not supported.
    Unsupported,
    /// The file system's.
    Io,
    /// Pegbar's own.
    Internal,
}

/// Why a node could not make a frame.
#[derive(Clone, Debug, PartialEq, Error, Serialize)]
#[error("{message}")]
pub struct NodeError {
    /// Whose fault it is.
    pub fault: Fault,
    /// What was expected and what was found.
    pub message: String,
    /// What to do.
    pub help: Option<String>,
    /// True where the run was cancelled rather than failing.
    pub cancelled: bool,
}

impl NodeError {
    /// A failure laid at `fault`.
    pub fn new(fault: Fault, message: impl Into<String>) -> Self {
        Self { fault, message: message.into(), help: None, cancelled: false }
    }

    /// An input value that cannot be used.
    pub fn input(message: impl Into<String>) -> Self {
        Self::new(Fault::Input, message)
    }

    /// A file that cannot be read or written.
    pub fn io(path: &std::path::Path, error: impl fmt::Display) -> Self {
        Self::new(Fault::Io, format!("{}: {error}", path.display()))
    }

    /// A fault of Pegbar's own.
    pub fn internal(message: impl Into<String>) -> Self {
        Self::new(Fault::Internal, message)
    }

    /// The run was asked to stop.
    pub fn stopped() -> Self {
        Self { cancelled: true, ..Self::new(Fault::Internal, "cancelled") }
    }

    /// With what to do about it.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// A wish to stop, shared by the run and whoever may end it.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks the run to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// True once asked.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// What a node knows of its surroundings while it runs.
#[derive(Clone, Debug)]
pub struct Context<'a> {
    /// The frame that is being made; the clock's first for a node that runs once.
    pub frame: i64,
    /// The clock of the node's outputs.
    pub clock: &'a Clock,
    /// The clock of each input that is wired to a stream.
    pub input_clocks: &'a [(&'static str, Arc<Clock>)],
    /// To be asked now and then by whatever takes long.
    pub cancel: &'a Cancel,
}

impl Context<'_> {
    /// The clock of what is wired to `input`; the node's own where that is a single value.
    pub fn input_clock(&self, input: &str) -> &Clock {
        self.input_clocks.iter().find(|(name, _)| *name == input).map_or(self.clock, |(_, clock)| clock)
    }

    /// To be called now and then by whatever takes long.
    ///
    /// # Errors
    /// Once the run is asked to stop.
    pub fn check(&self) -> Result<(), NodeError> {
        if self.cancel.is_cancelled() { Err(NodeError::stopped()) } else { Ok(()) }
    }
}

/// A wrong combination of settings, found before anything runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// The input that is to be changed.
    pub input: &'static str,
    /// `expected X, found Y`.
    pub message: String,
}

/// What `#[derive(Node)]` makes of a struct of inputs and settings.
pub trait Node: Sized + Send + 'static {
    /// Its outputs.
    type Outputs: Outputs;
    /// What it says of itself.
    fn schema() -> NodeSchema;
    /// The struct, from what stands at each input, in the order of the schema.
    ///
    /// # Errors
    /// Where something of another type stands there.
    fn build(args: Vec<Arg>) -> Result<Self, NodeError>;
}

/// A node that makes any frame by itself.
pub trait PerFrame: Node {
    /// Makes one frame.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn run(self, cx: &Context) -> Result<Self::Outputs, NodeError>;

    /// True where the settings by themselves make the output differ from frame to frame: a file that holds a stream. Asked of sources alone, when a
    /// graph is checked; only settings may be looked at.
    fn is_per_frame(&self) -> bool {
        false
    }

    /// The frames of a [`Frames`] input that the frame of `cx` is made from. Only settings and constants may be looked at.
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![cx.frame]
    }

    /// Settings that do not go together.
    fn check(&self) -> Vec<Problem> {
        Vec::new()
    }
}

/// A node that hands a state from frame to frame.
pub trait Recurrent: Node {
    /// What it remembers.
    type State: Value;

    /// Makes one frame from the state of the frame before, `None` at the start of the chain.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn run(self, state: Option<&Self::State>, cx: &Context) -> Result<(Self::Outputs, Self::State), NodeError>;

    /// The frame whose state this one starts from: one nearer to where the chain starts; `None` there.
    fn previous(&self, cx: &Context) -> Option<i64> {
        (cx.frame > cx.clock.first).then(|| cx.frame - 1)
    }

    /// As [`PerFrame::reads`].
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![cx.frame]
    }

    /// Settings that do not go together.
    fn check(&self) -> Vec<Problem> {
        Vec::new()
    }
}

/// A node that runs once, over whole sequences.
pub trait Whole: Node {
    /// Makes everything.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn run(self, cx: &Context) -> Result<Self::Outputs, NodeError>;

    /// The frames of a [`Frames`] input that are read; a [`Sequence`] is read whole.
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![cx.frame]
    }

    /// Settings that do not go together.
    fn check(&self) -> Vec<Problem> {
        Vec::new()
    }
}

/// What one task gives: the ports' values, and the state for the next frame.
pub struct Computed {
    /// In the order of the ports.
    pub outputs: Vec<OutValue>,
    /// For [`Recurrent`] nodes.
    pub state: Option<ValueRef>,
}

/// The two-step contract, and all that the executor knows of a node: which frames it needs, then the frame itself.
pub trait Operator: Send + Sync {
    /// For each input in `inputs`, the frames that `cx.frame` is made from; and the frame whose state it starts from.
    ///
    /// # Errors
    /// Where the settings do not make a node.
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError>;

    /// Makes one frame, or everything.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn compute(&self, args: Vec<Arg>, state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError>;

    /// Settings that do not go together.
    ///
    /// # Errors
    /// Where the settings do not make a node.
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError>;

    /// True where the settings by themselves make the output differ from frame to frame.
    ///
    /// # Errors
    /// Where the settings do not make a node.
    fn is_per_frame(&self, _args: Vec<Arg>) -> Result<bool, NodeError> {
        Ok(false)
    }
}

/// The first step's answer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Needs {
    /// Frames of each input asked about.
    pub frames: Vec<Vec<i64>>,
    /// Frame of the state.
    pub previous: Option<i64>,
}

pub(crate) struct PerFrameOperator<N>(pub(crate) PhantomData<fn() -> N>);
pub(crate) struct RecurrentOperator<N>(pub(crate) PhantomData<fn() -> N>);
pub(crate) struct WholeOperator<N>(pub(crate) PhantomData<fn() -> N>);

impl<N: PerFrame> Operator for PerFrameOperator<N> {
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        let node = N::build(args)?;
        Ok(Needs { frames: inputs.iter().map(|i| node.reads(i, cx)).collect(), previous: None })
    }
    fn compute(&self, args: Vec<Arg>, _state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        Ok(Computed { outputs: N::build(args)?.run(cx)?.into_values(), state: None })
    }
    fn is_per_frame(&self, args: Vec<Arg>) -> Result<bool, NodeError> {
        Ok(N::build(args)?.is_per_frame())
    }
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(N::build(args)?.check())
    }
}

impl<N: Recurrent> Operator for RecurrentOperator<N> {
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        let node = N::build(args)?;
        Ok(Needs { frames: inputs.iter().map(|i| node.reads(i, cx)).collect(), previous: node.previous(cx) })
    }
    fn compute(&self, args: Vec<Arg>, state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        let state = state.map(|s| downcast::<N::State>(s).ok_or_else(|| NodeError::internal("a state of another type")));
        let (outputs, state) = N::build(args)?.run(state.transpose()?.as_deref(), cx)?;
        Ok(Computed { outputs: outputs.into_values(), state: Some(Arc::new(state)) })
    }
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(N::build(args)?.check())
    }
}

impl<N: Whole> Operator for WholeOperator<N> {
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        let node = N::build(args)?;
        Ok(Needs { frames: inputs.iter().map(|i| node.reads(i, cx)).collect(), previous: None })
    }
    fn compute(&self, args: Vec<Arg>, _state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        Ok(Computed { outputs: N::build(args)?.run(cx)?.into_values(), state: None })
    }
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(N::build(args)?.check())
    }
}

/// A value under its own name in messages.
pub fn type_of(value: &ValueRef) -> &'static str {
    AnyValue::type_name(value.as_ref())
}
