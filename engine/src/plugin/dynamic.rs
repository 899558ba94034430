//! Values of types that no Rust struct stands for: those that plugins bring along.

use std::any::Any;
use std::sync::Arc;

use super::manifest::axes;
use crate::array::{Array, ArrayError, ArrayView, DType, Data, Shape, describe};
use crate::value::{AnyValue, ArraySchema, Meta, OwnedParts, Parts, TypeSchema, ValueError, ValueRef, ValueType};

/// A value of a type that is known by its schema alone.
#[derive(Debug)]
pub(super) struct Dynamic {
    schema: Arc<TypeSchema>,
    /// In the order of the schema.
    arrays: Vec<Array>,
    meta: Meta,
}

impl AnyValue for Dynamic {
    fn type_name(&self) -> &'static str {
        self.schema.name
    }
    fn parts(&self) -> Parts<'_> {
        let arrays = self.schema.arrays.iter().zip(&self.arrays).map(|(schema, array)| (schema.name, array.view()));
        Parts { arrays: arrays.collect::<Vec<(&'static str, ArrayView<'_>)>>(), meta: self.meta.clone() }
    }
    fn nth_array(&self, at: usize) -> Option<(&'static str, ArrayView<'_>)> {
        self.schema.arrays.get(at).zip(self.arrays.get(at)).map(|(schema, array)| (schema.name, array.view()))
    }
    fn meta(&self) -> Meta {
        self.meta.clone()
    }
    fn size(&self) -> usize {
        self.arrays.iter().map(|a| a.view().bytes.len()).sum()
    }
    fn first_shape(&self) -> Shape {
        self.arrays.first().map(|a| Shape::new(&a.shape)).unwrap_or_default()
    }
    fn into_any(self: Arc<Self>) -> Arc<dyn Any + Send + Sync> {
        self
    }
}

/// The type of values of a schema.
pub(super) fn dynamic_type(schema: TypeSchema) -> ValueType {
    let shared = Arc::new(schema.clone());
    ValueType { schema, from_parts: Arc::new(move |parts| Ok(Arc::new(build(&shared, parts)?) as ValueRef)), literal: None }
}

fn build(schema: &Arc<TypeSchema>, mut parts: OwnedParts) -> Result<Dynamic, ValueError> {
    let mut arrays = Vec::with_capacity(schema.arrays.len());
    for array in &schema.arrays {
        arrays.push(match parts.take_optional(array.name) {
            Some(found) => fitting(array, found)?,
            None if array.optional => empty(array),
            None => parts.take(array.name)?,
        });
    }
    let Some(strange) = parts.meta.keys().find(|k| !schema.texts.iter().any(|t| t.name == k.as_str())) else {
        return Ok(Dynamic { schema: schema.clone(), arrays, meta: parts.meta });
    };
    let known: Vec<&str> = schema.texts.iter().map(|t| t.name).collect();
    let known = if known.is_empty() { "no text".to_owned() } else { known.join(", ") };
    Err(ValueError::Invalid(format!("expected {known}, found a text `{strange}`")))
}

fn fitting(schema: &ArraySchema, array: Array) -> Result<Array, ValueError> {
    let wanted = axes(schema.shape).unwrap_or_default();
    let fits = wanted.len() == array.shape.len() && wanted.iter().zip(&array.shape).all(|(want, &has)| want.is_none_or(|w| w == has));
    let len = array.shape.iter().try_fold(array.dtype().size(), |n, &d| n.checked_mul(d));
    if array.dtype() == schema.dtype && fits && len == Some(array.view().bytes.len()) {
        return Ok(array);
    }
    let source = ArrayError { expected: format!("{} {}", schema.dtype, schema.shape), found: describe(array.dtype(), &array.shape) };
    Err(ValueError::Array { name: schema.name, source })
}

fn empty(schema: &ArraySchema) -> Array {
    let axes = axes(schema.shape).unwrap_or_default();
    let shape = axes.iter().enumerate().map(|(i, axis)| if i == 0 { 0 } else { axis.unwrap_or(0) }).collect();
    let data = match schema.dtype {
        DType::F32 => Data::F32(Vec::new()),
        DType::F64 => Data::F64(Vec::new()),
        DType::I64 => Data::I64(Vec::new()),
        DType::U32 => Data::U32(Vec::new()),
        DType::U8 => Data::U8(Vec::new()),
    };
    Array { shape, data }
}

/// Why two types of one name are not the same: arrays, element types, fixed extents and texts count, and no words.
pub(super) fn mismatch(ours: &TypeSchema, theirs: &TypeSchema) -> Option<String> {
    let shape = |a: &ArraySchema| (a.name, a.dtype, axes(a.shape), a.optional);
    let listed = |t: &TypeSchema| t.arrays.iter().map(|a| format!("{} {} {}", a.name, a.dtype, a.shape)).collect::<Vec<_>>().join("; ");
    if !ours.arrays.iter().map(shape).eq(theirs.arrays.iter().map(shape)) {
        return Some(format!("expected {}, found {}", listed(ours), listed(theirs)));
    }
    let texts = |t: &TypeSchema| t.texts.iter().map(|x| x.name).collect::<Vec<_>>();
    if texts(ours) != texts(theirs) {
        return Some(format!("expected the texts {:?}, found {:?}", texts(ours), texts(theirs)));
    }
    None
}
