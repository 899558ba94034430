//! Named n-dimensional arrays: what every value is made of, for files, hashing, comparison and plugins alike.

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use thiserror::Error;

mod buffer;

pub use buffer::{Allocate, Block, Buffer, Bytes, Shared, with_allocator};

/// The type of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DType {
    /// 32-bit floating point.
    F32,
    /// 64-bit floating point.
    F64,
    /// 64-bit signed integer.
    I64,
    /// 32-bit unsigned integer.
    U32,
    /// Bytes.
    U8,
}

impl DType {
    /// Bytes an element.
    pub fn size(self) -> usize {
        match self {
            DType::F64 | DType::I64 => 8,
            DType::F32 | DType::U32 => 4,
            DType::U8 => 1,
        }
    }
}

impl fmt::Display for DType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DType::F32 => "f32",
            DType::F64 => "f64",
            DType::I64 => "i64",
            DType::U32 => "u32",
            DType::U8 => "u8",
        })
    }
}

/// The extents of an array, outermost axis first, at most [`Shape::MAX_RANK`] of them; none for a scalar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shape {
    rank: usize,
    axes: [usize; Shape::MAX_RANK],
}

impl Shape {
    /// The most axes that a field has.
    pub const MAX_RANK: usize = 4;

    /// A shape of the first [`Shape::MAX_RANK`] of `axes`.
    pub fn new(axes: &[usize]) -> Self {
        let rank = axes.len().min(Self::MAX_RANK);
        let mut shape = Self { rank, axes: [0; Self::MAX_RANK] };
        shape.axes[..rank].copy_from_slice(&axes[..rank]);
        shape
    }
}

impl std::ops::Deref for Shape {
    type Target = [usize];
    fn deref(&self) -> &[usize] {
        &self.axes[..self.rank]
    }
}

/// An array that is looked at: row-major elements in native byte order.
#[derive(Clone, Debug)]
pub struct ArrayView<'a> {
    /// Element type.
    pub dtype: DType,
    /// Extent of each axis, outermost first; empty for a scalar.
    pub shape: Shape,
    /// The elements' bytes.
    pub bytes: &'a [u8],
}

impl ArrayView<'_> {
    /// A copy that owns its elements.
    pub fn to_array(&self) -> Array {
        // Those of a view are whole numbers of elements.
        let data = Data::copied(self.dtype, self.bytes).unwrap_or(Data::U8(Vec::new()));
        Array { shape: self.shape.to_vec(), data }
    }

    /// The elements as numbers.
    pub fn numbers(&self) -> Vec<f64> {
        match self.dtype {
            DType::F32 => elements::<f32>(self.bytes).into_iter().map(f64::from).collect(),
            DType::F64 => elements(self.bytes),
            DType::I64 => elements::<i64>(self.bytes).into_iter().map(|n| n as f64).collect(),
            DType::U32 => elements::<u32>(self.bytes).into_iter().map(f64::from).collect(),
            DType::U8 => self.bytes.iter().map(|&n| f64::from(n)).collect(),
        }
    }
}

fn elements<T: bytemuck::Pod>(bytes: &[u8]) -> Vec<T> {
    bytemuck::try_cast_slice(bytes).map_or_else(|_| bytemuck::allocation::pod_collect_to_vec(bytes), <[T]>::to_vec)
}

/// An array that owns its elements, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Extent of each axis, outermost first; empty for a scalar.
    pub shape: Vec<usize>,
    /// The elements.
    pub data: Data,
}

/// The elements of an [`Array`].
#[derive(Clone, Debug, PartialEq)]
pub enum Data {
    /// 32-bit floating point.
    F32(Vec<f32>),
    /// 64-bit floating point.
    F64(Vec<f64>),
    /// 64-bit signed integers.
    I64(Vec<i64>),
    /// 32-bit unsigned integers.
    U32(Vec<u32>),
    /// Bytes.
    U8(Vec<u8>),
    /// Elements that lie elsewhere, as in another library's memory.
    Shared(Shared),
}

impl Data {
    /// So many noughts; `None` where there is no memory for them.
    pub(crate) fn zeroed(dtype: DType, count: usize) -> Option<Self> {
        Some(match dtype {
            DType::F32 => Data::F32(zeroed(count)?),
            DType::F64 => Data::F64(zeroed(count)?),
            DType::I64 => Data::I64(zeroed(count)?),
            DType::U32 => Data::U32(zeroed(count)?),
            DType::U8 => Data::U8(zeroed(count)?),
        })
    }

    /// Element type.
    pub fn dtype(&self) -> DType {
        match self {
            Data::F32(_) => DType::F32,
            Data::F64(_) => DType::F64,
            Data::I64(_) => DType::I64,
            Data::U32(_) => DType::U32,
            Data::U8(_) => DType::U8,
            Data::Shared(shared) => shared.dtype(),
        }
    }

    /// The elements' bytes.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Data::F32(v) => bytemuck::cast_slice(v),
            Data::F64(v) => bytemuck::cast_slice(v),
            Data::I64(v) => bytemuck::cast_slice(v),
            Data::U32(v) => bytemuck::cast_slice(v),
            Data::U8(v) => v,
            Data::Shared(shared) => shared.bytes(),
        }
    }
}

/// Noughts. A few are written faster than they are asked for: the GNU allocator keeps no such blocks at hand.
fn zeroed<T: bytemuck::Pod>(count: usize) -> Option<Vec<T>> {
    const FEW: usize = 1 << 10;
    if count <= FEW / size_of::<T>().max(1) {
        let mut few = Vec::with_capacity(count);
        few.resize(count, std::hint::black_box(T::zeroed()));
        return Some(few);
    }
    bytemuck::allocation::try_zeroed_vec(count).ok()
}

impl Data {
    /// A copy of bytes; `None` where they are no whole number of elements.
    #[doc(hidden)]
    pub fn copied(dtype: DType, bytes: &[u8]) -> Option<Self> {
        bytes.len().is_multiple_of(dtype.size()).then(|| match dtype {
            DType::F32 => Data::F32(elements(bytes)),
            DType::F64 => Data::F64(elements(bytes)),
            DType::I64 => Data::I64(elements(bytes)),
            DType::U32 => Data::U32(elements(bytes)),
            DType::U8 => Data::U8(bytes.to_vec()),
        })
    }
}

impl Array {
    /// Element type.
    pub fn dtype(&self) -> DType {
        self.data.dtype()
    }

    /// The array as a view.
    pub fn view(&self) -> ArrayView<'_> {
        ArrayView { dtype: self.dtype(), shape: Shape::new(&self.shape), bytes: self.data.bytes() }
    }
}

/// Why an array does not fit the field that it is meant for.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("expected {expected}, found {found}")]
pub struct ArrayError {
    /// Element type and shape that the field holds.
    pub expected: String,
    /// Element type and shape that were given.
    pub found: String,
}

/// `f64 [2, 3]`.
pub fn describe(dtype: DType, shape: &[usize]) -> String {
    format!("{dtype} [{}]", describe_shape(shape))
}

/// `2, 3`.
pub fn describe_shape(shape: &[usize]) -> String {
    shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
}

/// A type that an array's element can have.
pub trait Element: bytemuck::Pod + PartialEq + fmt::Debug + Send + Sync {
    /// Its name among array types.
    const DTYPE: DType;
    /// The elements of `data`, if they are of this type.
    fn from_data(data: Data) -> Option<Vec<Self>>;
}

/// A struct field that is an array: elements, shape, and the way back.
pub trait ArrayField: Sized {
    /// Element type.
    const DTYPE: DType;
    /// Extents now.
    fn shape(&self) -> Shape;
    /// Elements as bytes, row-major.
    fn bytes(&self) -> &[u8];
    /// The field again from an array.
    ///
    /// # Errors
    /// Where element type or shape are not the field's.
    fn from_array(array: Array) -> Result<Self, ArrayError>;

    /// Takes the elements out where they lie in memory of somebody else's; the field is empty then.
    fn take_block(&mut self) -> Option<Box<dyn Block>> {
        None
    }

    /// The field as an array view.
    fn view(&self) -> ArrayView<'_> {
        ArrayView { dtype: Self::DTYPE, shape: self.shape(), bytes: self.bytes() }
    }
}

/// An array that several values share, as the triangles of a mesh that moves.
impl<A: ArrayField> ArrayField for Arc<A> {
    const DTYPE: DType = A::DTYPE;
    fn shape(&self) -> Shape {
        A::shape(self)
    }
    fn bytes(&self) -> &[u8] {
        A::bytes(self)
    }
    fn from_array(array: Array) -> Result<Self, ArrayError> {
        A::from_array(array).map(Arc::new)
    }
    fn take_block(&mut self) -> Option<Box<dyn Block>> {
        Arc::get_mut(self).and_then(A::take_block)
    }
}

/// An array of `D` axes, for fields whose shape is not told by a Rust type.
#[derive(Clone, Debug, PartialEq)]
pub struct NdArray<T, const D: usize> {
    shape: [usize; D],
    data: Vec<T>,
}

/// No elements.
impl<T, const D: usize> Default for NdArray<T, D> {
    fn default() -> Self {
        Self { shape: [0; D], data: Vec::new() }
    }
}

impl<T, const D: usize> NdArray<T, D> {
    /// Elements in row-major order; `None` where their number is not the product of `shape`.
    pub fn new(shape: [usize; D], data: Vec<T>) -> Option<Self> {
        let len = shape.iter().try_fold(1usize, |n, &d| n.checked_mul(d))?;
        (len == data.len()).then_some(Self { shape, data })
    }

    /// Extent of each axis.
    pub fn shape(&self) -> [usize; D] {
        self.shape
    }

    /// The elements, row-major.
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// The elements, to be changed in place.
    pub fn data_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The elements by themselves.
    pub fn into_data(self) -> Vec<T> {
        self.data
    }
}

/// The shape and elements of an array; `expected` is asked for where they are others, as this is done for every value that is put together.
fn typed<T: Element>(
    array: Array,
    rank: usize,
    tail: &[usize],
    expected: impl FnOnce() -> String,
) -> Result<(Vec<usize>, Vec<T>), ArrayError> {
    let Array { shape, data } = array;
    let fits = shape.len() == rank && shape.ends_with(tail) && data.dtype() == T::DTYPE;
    let refused = |dtype| ArrayError { expected: expected(), found: describe(dtype, &shape) };
    if !fits {
        return Err(refused(data.dtype()));
    }
    match T::from_data(data) {
        Some(data) if data.len() == shape.iter().product::<usize>() => Ok((shape, data)),
        _ => Err(refused(T::DTYPE)),
    }
}

impl<T: Element, const D: usize> ArrayField for NdArray<T, D> {
    const DTYPE: DType = T::DTYPE;
    fn shape(&self) -> Shape {
        Shape::new(&self.shape)
    }
    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.data)
    }
    fn from_array(array: Array) -> Result<Self, ArrayError> {
        let (axes, data) = typed::<T>(array, D, &[], || format!("{} of {D} axes", T::DTYPE))?;
        let mut shape = [0; D];
        shape.copy_from_slice(&axes);
        Ok(Self { shape, data })
    }
}

macro_rules! element {
    ($t:ty, $variant:ident) => {
        impl Element for $t {
            const DTYPE: DType = DType::$variant;
            fn from_data(data: Data) -> Option<Vec<Self>> {
                match data {
                    Data::$variant(v) => Some(v),
                    Data::Shared(shared) => (shared.dtype() == DType::$variant).then(|| elements(shared.bytes())),
                    _ => None,
                }
            }
        }

        impl ArrayField for $t {
            const DTYPE: DType = DType::$variant;
            fn shape(&self) -> Shape {
                Shape::default()
            }
            fn bytes(&self) -> &[u8] {
                bytemuck::bytes_of(self)
            }
            fn from_array(array: Array) -> Result<Self, ArrayError> {
                let (_, data) = typed::<$t>(array, 0, &[], || format!("{} []", DType::$variant))?;
                data.first().copied().ok_or_else(|| ArrayError { expected: "one element".into(), found: "none".into() })
            }
        }

        impl ArrayField for Vec<$t> {
            const DTYPE: DType = DType::$variant;
            fn shape(&self) -> Shape {
                Shape::new(&[self.len()])
            }
            fn bytes(&self) -> &[u8] {
                bytemuck::cast_slice(self)
            }
            fn from_array(array: Array) -> Result<Self, ArrayError> {
                Ok(typed::<$t>(array, 1, &[], || format!("{} [n]", DType::$variant))?.1)
            }
        }

        impl<const N: usize> ArrayField for [$t; N] {
            const DTYPE: DType = DType::$variant;
            fn shape(&self) -> Shape {
                Shape::new(&[N])
            }
            fn bytes(&self) -> &[u8] {
                bytemuck::cast_slice(self)
            }
            fn from_array(array: Array) -> Result<Self, ArrayError> {
                let (_, data) = typed::<$t>(array, 1, &[N], || describe(DType::$variant, &[N]))?;
                let mut out = [<$t as Default>::default(); N];
                out.copy_from_slice(&data);
                Ok(out)
            }
        }

        impl<const N: usize> ArrayField for Vec<[$t; N]> {
            const DTYPE: DType = DType::$variant;
            fn shape(&self) -> Shape {
                Shape::new(&[self.len(), N])
            }
            fn bytes(&self) -> &[u8] {
                bytemuck::cast_slice(self.as_flattened())
            }
            fn from_array(array: Array) -> Result<Self, ArrayError> {
                let (_, data) = typed::<$t>(array, 2, &[N], || format!("{} [n, {N}]", DType::$variant))?;
                Ok(data.as_chunks::<N>().0.to_vec())
            }
        }

        impl<const N: usize, const M: usize> ArrayField for [[$t; N]; M] {
            const DTYPE: DType = DType::$variant;
            fn shape(&self) -> Shape {
                Shape::new(&[M, N])
            }
            fn bytes(&self) -> &[u8] {
                bytemuck::cast_slice(self.as_flattened())
            }
            fn from_array(array: Array) -> Result<Self, ArrayError> {
                let (_, data) = typed::<$t>(array, 2, &[M, N], || describe(DType::$variant, &[M, N]))?;
                let mut out = [[<$t as Default>::default(); N]; M];
                out.as_flattened_mut().copy_from_slice(&data);
                Ok(out)
            }
        }
    };
}

element!(f32, F32);
element!(f64, F64);
element!(i64, I64);
element!(u32, U32);
element!(u8, U8);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_comes_back_from_its_array() {
        let points = vec![[1.0, 2.0], [3.0, 4.0]];
        let array = points.view().to_array();
        assert_eq!(array.shape, [2, 2]);
        assert_eq!(Vec::<[f64; 2]>::from_array(array), Ok(points));
        let matrix = [[1.0, 0.0, 5.0], [0.0, 1.0, 6.0]];
        assert_eq!(<[[f64; 3]; 2]>::from_array(matrix.view().to_array()), Ok(matrix));
        assert_eq!(f64::from_array(4.5f64.view().to_array()), Ok(4.5));
        let image = NdArray::new([1, 2, 3], vec![0f32; 6]).unwrap();
        assert_eq!(NdArray::<f32, 3>::from_array(image.view().to_array()), Ok(image));
    }

    #[test]
    fn an_array_of_another_shape_or_type_is_refused_in_words() {
        let wrong = vec![[1.0f64, 2.0, 3.0]].view().to_array();
        let error = Vec::<[f64; 2]>::from_array(wrong).unwrap_err();
        assert_eq!(error.to_string(), "expected f64 [n, 2], found f64 [1, 3]");
        let error = f64::from_array(vec![1u8].view().to_array()).unwrap_err();
        assert_eq!(error.to_string(), "expected f64 [], found u8 [1]");
    }
}
