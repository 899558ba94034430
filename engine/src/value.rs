//! Values: ordinary structs that can be taken apart into named arrays and put together again.

use std::any::Any;
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

use serde::Serialize;
use thiserror::Error;

use crate::array::{Array, ArrayError, ArrayView, Block, DType, Shape};
use crate::setting::{Setting, SettingError};

/// Text metadata of a value: one JSON object.
pub type Meta = serde_json::Map<String, serde_json::Value>;

/// What a value type is made of, for `pegbar types`, files and editors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TypeSchema {
    /// Name in graph files.
    pub name: &'static str,
    /// What it stands for.
    pub doc: &'static str,
    /// Its arrays.
    pub arrays: Vec<ArraySchema>,
    /// Its text fields.
    pub texts: Vec<TextSchema>,
}

/// One array of a value type.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ArraySchema {
    /// Name in files.
    pub name: &'static str,
    /// Element type.
    pub dtype: DType,
    /// Shape in letters, as `[h, w, c]`.
    pub shape: &'static str,
    /// True where it may be left out of files: it is then empty.
    pub optional: bool,
    /// Meaning and unit.
    pub doc: &'static str,
}

/// One text field of a value type.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextSchema {
    /// Name in the JSON object `meta`.
    pub name: &'static str,
    /// Meaning.
    pub doc: &'static str,
}

/// A value taken apart, borrowed.
pub struct Parts<'a> {
    /// Arrays by name.
    pub arrays: Vec<(&'static str, ArrayView<'a>)>,
    /// Text fields.
    pub meta: Meta,
}

/// A value taken apart, owned: what [`Value::from_parts`] puts together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnedParts {
    /// Arrays by name.
    pub arrays: Vec<(Cow<'static, str>, Array)>,
    /// Text fields.
    pub meta: Meta,
}

impl OwnedParts {
    /// Takes the array `name` out.
    ///
    /// # Errors
    /// Where there is none of that name.
    pub fn take(&mut self, name: &str) -> Result<Array, ValueError> {
        self.take_optional(name).ok_or_else(|| ValueError::MissingArray { name: name.to_owned(), present: self.names() })
    }

    /// Takes the array `name` out; `None` where there is none.
    pub fn take_optional(&mut self, name: &str) -> Option<Array> {
        let at = self.arrays.iter().position(|(n, _)| n == name)?;
        Some(self.arrays.swap_remove(at).1)
    }

    fn names(&self) -> String {
        let names: Vec<&str> = self.arrays.iter().map(|(n, _)| n.as_ref()).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    }
}

/// Why arrays do not make a value.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ValueError {
    /// An array is not there.
    #[error("expected an array `{name}`, found {present}")]
    MissingArray {
        /// The array's name.
        name: String,
        /// Names of the arrays that are there.
        present: String,
    },
    /// An array has the wrong element type or shape.
    #[error("array `{name}`: {source}")]
    Array {
        /// The array's name.
        name: &'static str,
        /// What is wrong with it.
        source: ArrayError,
    },
    /// A text field cannot be read.
    #[error("text `{name}`: {reason}")]
    Text {
        /// The field's name.
        name: &'static str,
        /// Why not.
        reason: String,
    },
    /// The parts are well formed but do not go together.
    #[error("{0}")]
    Invalid(String),
}

/// A type that travels along wires. Derived: `#[derive(Value)]`.
pub trait Value: Send + Sync + Sized + fmt::Debug + 'static {
    /// Its name in graph files.
    const NAME: &'static str;
    /// What it is made of.
    fn schema() -> TypeSchema;
    /// Takes it apart.
    fn parts(&self) -> Parts<'_>;
    /// One of the arrays of [`Value::parts`], without taking all of it apart.
    fn nth_array(&self, at: usize) -> Option<(&'static str, ArrayView<'_>)> {
        self.parts().arrays.into_iter().nth(at)
    }
    /// The text fields of [`Value::parts`].
    fn meta(&self) -> Meta {
        self.parts().meta
    }
    /// Puts it together.
    ///
    /// # Errors
    /// Where arrays are missing, misshapen, or do not go together.
    fn from_parts(parts: OwnedParts) -> Result<Self, ValueError>;
    /// Bytes of its arrays.
    fn size(&self) -> usize;
    /// Extents of its first array, for messages: cheap enough to be asked for at every task.
    fn first_shape(&self) -> Shape;
    /// Takes the elements of an array out where they lie in memory of somebody else's; the array is empty then.
    fn take_block(&mut self, _array: &str) -> Option<Box<dyn Block>> {
        None
    }
    /// Reads it from a literal of a graph file; `None` where the type cannot be written there.
    fn literal() -> Option<LiteralSyntax<Self>> {
        None
    }
}

/// How a value is written inside a graph file.
pub struct LiteralSyntax<T> {
    /// The shape of the text, for messages: `a number`, `[[a, b, tx], [c, d, ty]]`.
    pub form: &'static str,
    /// Reads the text.
    pub parse: fn(&str) -> Result<T, SettingError>,
}

impl<T> Clone for LiteralSyntax<T> {
    fn clone(&self) -> Self {
        Self { form: self.form, parse: self.parse }
    }
}

/// A [`Value`] whose type is known at run time only.
pub trait AnyValue: Send + Sync + fmt::Debug + 'static {
    /// The type's name in graph files.
    fn type_name(&self) -> &'static str;
    /// Takes it apart.
    fn parts(&self) -> Parts<'_>;
    /// As [`Value::nth_array`].
    fn nth_array(&self, at: usize) -> Option<(&'static str, ArrayView<'_>)> {
        self.parts().arrays.into_iter().nth(at)
    }
    /// As [`Value::meta`].
    fn meta(&self) -> Meta {
        self.parts().meta
    }
    /// Bytes of its arrays.
    fn size(&self) -> usize;
    /// Extents of its first array.
    fn first_shape(&self) -> Shape;
    /// As [`Value::take_block`].
    fn take_block(&mut self, _array: &str) -> Option<Box<dyn Block>> {
        None
    }
    /// For downcasting.
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync>;
}

impl<T: Value> AnyValue for T {
    fn type_name(&self) -> &'static str {
        T::NAME
    }
    fn parts(&self) -> Parts<'_> {
        Value::parts(self)
    }
    fn nth_array(&self, at: usize) -> Option<(&'static str, ArrayView<'_>)> {
        Value::nth_array(self, at)
    }
    fn meta(&self) -> Meta {
        Value::meta(self)
    }
    fn size(&self) -> usize {
        Value::size(self)
    }
    fn first_shape(&self) -> Shape {
        Value::first_shape(self)
    }
    fn take_block(&mut self, array: &str) -> Option<Box<dyn Block>> {
        Value::take_block(self, array)
    }
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync> {
        self
    }
}

/// A shared, immutable value of any type.
pub type ValueRef = Arc<dyn AnyValue>;

/// `value` as a `T`, if it is one.
pub fn downcast<T: Value>(value: ValueRef) -> Option<Arc<T>> {
    value.into_any().downcast().ok()
}

/// The content digest of a value: type, arrays, and text. The same for equal values on every machine of one byte order.
pub fn digest(value: &dyn AnyValue) -> blake3::Hash {
    let parts = value.parts();
    let arrays = parts.arrays.iter().map(|(name, array)| (*name, array.clone()));
    digest_parts(value.type_name(), arrays, parts.meta)
}

/// The content digest of the value of the type `name` that is made of these parts, in the order of its type.
pub(crate) fn digest_parts<'a>(name: &str, arrays: impl Iterator<Item = (&'a str, ArrayView<'a>)>, meta: Meta) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    let mut field = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    field(name.as_bytes());
    for (name, array) in arrays {
        field(name.as_bytes());
        field(crate::array::describe(array.dtype, &array.shape).as_bytes());
        field(array.bytes);
    }
    field(serde_json::Value::Object(meta).to_string().as_bytes());
    hasher.finalize()
}

/// A value type as the registry keeps it.
#[derive(Clone)]
pub struct ValueType {
    /// What it is made of.
    pub schema: TypeSchema,
    /// Puts a value of the type together.
    pub from_parts: FromParts,
    /// How it is written inside a graph file; `None` where it cannot be.
    pub literal: Option<LiteralSyntax<ValueRef>>,
}

/// Puts a value together.
pub type FromParts = Arc<dyn Fn(OwnedParts) -> Result<ValueRef, ValueError> + Send + Sync>;

impl ValueType {
    /// The entry of `T`.
    pub fn of<T: Value>() -> Self {
        let literal = T::literal().map(|l| LiteralSyntax { form: l.form, parse: |text| parse_literal::<T>(text) });
        Self { schema: T::schema(), from_parts: Arc::new(|parts| Ok(Arc::new(T::from_parts(parts)?))), literal }
    }
}

fn parse_literal<T: Value>(text: &str) -> Result<ValueRef, SettingError> {
    match T::literal() {
        Some(syntax) => (syntax.parse)(text).map(|value| Arc::new(value) as ValueRef),
        None => Err(SettingError::whole(text, format!("expected a reference to {}, found a literal", T::NAME))),
    }
}

/// Puts a text field among a value's metadata, but for one that is the default.
pub fn put_text<T: Serialize + Default + PartialEq>(meta: &mut Meta, name: &'static str, text: &T) {
    if *text != T::default()
        && let Ok(json) = serde_json::to_value(text)
    {
        meta.insert(name.to_owned(), json);
    }
}

/// Reads a text field out of a value's metadata; the default where it is left out.
///
/// # Errors
/// Where it is of another form.
pub fn take_text<T: serde::de::DeserializeOwned + Default>(meta: &Meta, name: &'static str) -> Result<T, ValueError> {
    match meta.get(name) {
        None => Ok(T::default()),
        Some(json) => T::deserialize(json).map_err(|e| ValueError::Text { name, reason: e.to_string() }),
    }
}

fn curve(text: &str) -> Result<Curve, SettingError> {
    f64::parse(text).map(|value| Curve { value })
}

fn vector(text: &str) -> Result<Vector, SettingError> {
    Vec::<f64>::parse(text).map(|values| Vector { values })
}

/// A number that may change over time.
#[derive(Clone, Debug, PartialEq, crate::Value)]
#[value(literal = "curve", form = "a number")]
pub struct Curve {
    /// The number at this frame, in the unit of the input that it feeds.
    #[value(shape = "[]")]
    pub value: f64,
}

/// Several numbers that belong together: angles, weights, samples.
#[derive(Clone, Debug, PartialEq, crate::Value)]
#[value(literal = "vector", form = "a list of numbers")]
pub struct Vector {
    /// The numbers, in the unit that their maker states.
    #[value(shape = "[k]")]
    pub values: Vec<f64>,
}

/// Which source frame is shown at each frame of a clock: a retime, or the holds of drawings shot on twos.
#[derive(Clone, Debug, PartialEq, crate::Value)]
pub struct TimeMap {
    /// Source frame number for each frame of the target clock, from its first frame on; fractional between frames.
    #[value(shape = "[t]")]
    pub source_frames: Vec<f64>,
}
