//! The fields of a node struct: values and settings, as they stand when the node runs.

use std::any::Any;
use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;
use std::sync::Arc;

use super::error::NodeError;
use super::schema::{Access, InputType};
use crate::clock::Clock;
use crate::setting::{Choice, FileUse, Place, Setting, SettingError};
use crate::value::{Value, ValueRef, downcast};

/// A literal that has been read: the Rust value of the field, to be cloned for each frame.
pub type Literal = Arc<dyn Any + Send + Sync>;

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

/// Where the values of a sequence lie: in memory, or on disk until they are asked for.
pub trait Values: Send + Sync {
    /// Number of values.
    fn len(&self) -> usize;
    /// True where there is none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// The value at a position, which is held in memory for as long as somebody holds it.
    ///
    /// # Errors
    /// Past the end, or where it does not fit into memory beside what is held already.
    fn get(&self, idx: usize) -> Result<ValueRef, NodeError>;
}

impl Values for Vec<ValueRef> {
    fn len(&self) -> usize {
        self.as_slice().len()
    }
    fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        let past = || NodeError::internal(format!("frame {idx} of a sequence of {} was read", Values::len(self)));
        self.as_slice().get(idx).cloned().ok_or_else(past)
    }
}

/// All frames of a stream, in order, or the one value that a single has.
#[derive(Clone)]
pub struct SequenceRef {
    /// The clock; `None` for a single.
    pub clock: Option<Arc<Clock>>,
    values: Arc<dyn Values>,
}

impl SequenceRef {
    /// A sequence over `clock`, one value a frame, or one value for a single.
    pub fn new(clock: Option<Arc<Clock>>, values: impl Values + 'static) -> Self {
        Self { clock, values: Arc::new(values) }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The value at a position.
    ///
    /// # Errors
    /// As of [`Values::get`].
    pub fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        self.values.get(idx)
    }

    /// As [`SequenceRef::new`], of values that others hold too.
    pub fn shared(clock: Option<Arc<Clock>>, values: Arc<dyn Values>) -> Self {
        Self { clock, values }
    }
}

impl fmt::Debug for SequenceRef {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "sequence of {}", self.values.len())
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
        match arg {
            Arg::None => Ok(In(None)),
            Arg::Literal(l) => l.downcast::<T>().map(|v| In(Some(v))).map_err(|l| mismatch(T::NAME, &Arg::Literal(l))),
            Arg::Value(v) => {
                let found = v.type_name();
                downcast::<T>(v).map(|v| In(Some(v))).ok_or_else(|| NodeError::internal(format!("expected {}, found {found}", T::NAME)))
            }
            other => Err(mismatch(T::NAME, &other)),
        }
    }
}

fn no_literal(text: &str) -> SettingError {
    SettingError::whole(text, "expected a reference as \"@node.port\", found a literal")
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

    /// The value at a position of the sequence, 0 being the clock's first frame. What is not in memory is fetched, so a node that lets go of each
    /// frame before the next can read a sequence of any length.
    ///
    /// # Errors
    /// Past the end, or where it does not fit into memory beside what the node holds already.
    pub fn get(&self, idx: usize) -> Result<Arc<T>, NodeError> {
        downcast::<T>(self.0.values.get(idx)?).ok_or_else(|| NodeError::internal(format!("expected {} values in a sequence", T::NAME)))
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

/// A whole sequence that may be left out.
impl<T: Value> Input for Option<Sequence<T>> {
    fn ty() -> InputType {
        InputType::Value(T::NAME)
    }
    fn access() -> Access {
        Access::Sequence
    }
    const OPTIONAL: bool = true;
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(None),
            arg => <Sequence<T>>::from_arg(arg).map(Some),
        }
    }
}

/// The frames of a sequence that the node asks for, read one by one.
#[derive(Debug)]
pub struct Picked<T>(Sequence<T>);

impl<T: Value> Picked<T> {
    /// The clock; `None` for a single value, which stands at every frame.
    pub fn clock(&self) -> Option<&Clock> {
        self.0.clock()
    }

    /// The value at a position of what was asked for. As [`Sequence::get`].
    ///
    /// # Errors
    /// As there.
    pub fn get(&self, idx: usize) -> Result<Arc<T>, NodeError> {
        self.0.get(if self.clock().is_some() { idx } else { 0 })
    }
}

impl<T: Value> Input for Picked<T> {
    fn ty() -> InputType {
        InputType::Value(T::NAME)
    }
    fn access() -> Access {
        Access::Picked
    }
    fn parse(text: &str, _place: &Place) -> Result<(Literal, Vec<f64>), SettingError> {
        Err(no_literal(text))
    }
    fn from_arg(arg: Arg) -> Result<Self, NodeError> {
        match arg {
            Arg::None => Ok(Picked(Sequence(SequenceRef::new(None, Vec::new()), PhantomData))),
            arg => <Sequence<T>>::from_arg(arg).map(Picked),
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

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.0.values.len()
    }

    /// True where there is no frame.
    pub fn is_empty(&self) -> bool {
        self.0.values.is_empty()
    }

    /// As [`Sequence::get`].
    ///
    /// # Errors
    /// As there.
    pub fn get(&self, idx: usize) -> Result<ValueRef, NodeError> {
        self.0.values.get(idx)
    }

    /// All values, in order, held at once: for small ones alone.
    ///
    /// # Errors
    /// As of [`Sequence::get`].
    pub fn gather(&self) -> Result<Vec<ValueRef>, NodeError> {
        (0..self.len()).map(|idx| self.get(idx)).collect()
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
