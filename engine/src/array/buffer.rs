//! Elements that lie where somebody else put them: inputs of a plugin in the host's memory, and its outputs.

use std::cell::RefCell;
use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use super::{Array, ArrayError, ArrayField, DType, Data, Element, Shape, describe};

/// Bytes that lie elsewhere and stay as they are for as long as this is held.
pub trait Bytes: Send + Sync {
    /// The bytes.
    fn bytes(&self) -> &[u8];
}

/// Elements that lie elsewhere.
#[derive(Clone)]
pub struct Shared {
    dtype: DType,
    bytes: Arc<dyn Bytes>,
}

impl Shared {
    /// Elements of a type; `None` where the bytes are not aligned for it, or no whole number of elements.
    pub fn new(dtype: DType, bytes: Arc<dyn Bytes>) -> Option<Self> {
        let fits = match dtype {
            DType::F32 => bytemuck::try_cast_slice::<_, f32>(bytes.bytes()).is_ok(),
            DType::F64 => bytemuck::try_cast_slice::<_, f64>(bytes.bytes()).is_ok(),
            DType::I64 => bytemuck::try_cast_slice::<_, i64>(bytes.bytes()).is_ok(),
            DType::U32 => bytemuck::try_cast_slice::<_, u32>(bytes.bytes()).is_ok(),
            DType::U8 => true,
        };
        // Nothing lies nowhere in particular.
        (fits || bytes.bytes().is_empty()).then_some(Self { dtype, bytes })
    }

    /// Element type.
    pub fn dtype(&self) -> DType {
        self.dtype
    }

    /// The elements' bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.bytes()
    }
}

impl fmt::Debug for Shared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes of {}", self.bytes().len(), self.dtype)
    }
}

impl PartialEq for Shared {
    fn eq(&self, other: &Self) -> bool {
        self.dtype == other.dtype && self.bytes() == other.bytes()
    }
}

/// Memory to be written.
pub trait Block: Bytes {
    /// The bytes.
    fn bytes_mut(&mut self) -> &mut [u8];
    /// Gives it back to its maker: what that knows it by. The memory is not freed.
    fn into_handle(self: Box<Self>) -> usize;
}

/// Makes memory for a number of elements, noughts at first; `None` where it has none.
pub type Allocate = fn(DType, usize) -> Option<Box<dyn Block>>;

thread_local! {
    static ALLOCATE: RefCell<Option<Allocate>> = const { RefCell::new(None) };
}

/// Runs `work`; new [`Buffer`]s of this thread lie meanwhile where `allocate` puts them.
pub fn with_allocator<R>(allocate: Allocate, work: impl FnOnce() -> R) -> R {
    struct Restore(Option<Allocate>);
    impl Drop for Restore {
        fn drop(&mut self) {
            ALLOCATE.set(self.0);
        }
    }
    let _restore = Restore(ALLOCATE.replace(Some(allocate)));
    work()
}

/// An array of `D` axes whose elements are read where they lie, and written where the reader wants them: what plugins use for pictures and other large
/// arrays, as nothing is copied. Reads as a slice, row-major.
pub struct Buffer<T: Element, const D: usize> {
    shape: [usize; D],
    store: Store<T>,
}

enum Store<T> {
    Own(Vec<T>),
    Shared(Shared),
    Block(Box<dyn Block>),
}

impl<T: Element, const D: usize> Buffer<T, D> {
    /// Elements in row-major order; `None` where their number is not the product of `shape`.
    pub fn new(shape: [usize; D], data: Vec<T>) -> Option<Self> {
        (product(&shape)? == data.len()).then_some(Self { shape, store: Store::Own(data) })
    }

    /// Noughts, in the memory of whoever will read them where there is one; `None` where there are too many.
    pub fn zeroed(shape: [usize; D]) -> Option<Self> {
        let len = product(&shape)?;
        let block = ALLOCATE.with_borrow(|a| *a).and_then(|allocate| allocate(T::DTYPE, len));
        let store = match block {
            Some(block) if bytemuck::try_cast_slice::<u8, T>(block.bytes()).is_ok_and(|s| s.len() == len) => Store::Block(block),
            _ => Store::Own(bytemuck::allocation::try_zeroed_vec(len).ok()?),
        };
        Some(Self { shape, store })
    }

    /// Extent of each axis.
    pub fn shape(&self) -> [usize; D] {
        self.shape
    }
}

fn product(shape: &[usize]) -> Option<usize> {
    shape.iter().try_fold(1usize, |n, &d| n.checked_mul(d))
}

impl<T: Element, const D: usize> Deref for Buffer<T, D> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        // Alignment and length were seen to when it was made.
        match &self.store {
            Store::Own(data) => data,
            Store::Shared(shared) => bytemuck::try_cast_slice(shared.bytes()).unwrap_or_default(),
            Store::Block(block) => bytemuck::try_cast_slice(block.bytes()).unwrap_or_default(),
        }
    }
}

/// What others read is copied first.
impl<T: Element, const D: usize> DerefMut for Buffer<T, D> {
    fn deref_mut(&mut self) -> &mut [T] {
        if let Store::Shared(_) = self.store {
            *self = self.clone();
        }
        match &mut self.store {
            Store::Own(data) => data,
            Store::Block(block) => bytemuck::try_cast_slice_mut(block.bytes_mut()).unwrap_or_default(),
            Store::Shared(_) => &mut [],
        }
    }
}

/// A copy lies where a new buffer does.
impl<T: Element, const D: usize> Clone for Buffer<T, D> {
    fn clone(&self) -> Self {
        match Self::zeroed(self.shape) {
            Some(mut copy) => {
                copy.copy_from_slice(self);
                copy
            }
            None => Self { shape: self.shape, store: Store::Own(self.to_vec()) },
        }
    }
}

impl<T: Element, const D: usize> Default for Buffer<T, D> {
    fn default() -> Self {
        Self { shape: [0; D], store: Store::Own(Vec::new()) }
    }
}

impl<T: Element, const D: usize> fmt::Debug for Buffer<T, D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&describe(T::DTYPE, &self.shape))
    }
}

impl<T: Element, const D: usize> PartialEq for Buffer<T, D> {
    fn eq(&self, other: &Self) -> bool {
        self.shape == other.shape && **self == **other
    }
}

impl<T: Element, const D: usize> ArrayField for Buffer<T, D> {
    const DTYPE: DType = T::DTYPE;
    fn shape(&self) -> Shape {
        Shape::new(&self.shape)
    }
    fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(self)
    }
    fn take_block(&mut self) -> Option<Box<dyn Block>> {
        match std::mem::take(self) {
            Self { store: Store::Block(block), .. } => Some(block),
            kept => {
                *self = kept;
                None
            }
        }
    }
    fn from_array(array: Array) -> Result<Self, ArrayError> {
        let found = (array.dtype(), Shape::new(&array.shape));
        let refused = || ArrayError { expected: format!("{} of {D} axes", T::DTYPE), found: describe(found.0, &found.1) };
        let shape = <[usize; D]>::try_from(array.shape.as_slice()).map_err(|_| refused())?;
        let store = match array.data {
            Data::Shared(shared) if shared.dtype() == T::DTYPE => Store::Shared(shared),
            data => Store::Own(T::from_data(data).ok_or_else(refused)?),
        };
        let buffer = Self { shape, store };
        if product(&shape) == Some(buffer.len()) { Ok(buffer) } else { Err(refused()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Lent(Vec<u64>);

    impl Bytes for Lent {
        fn bytes(&self) -> &[u8] {
            bytemuck::cast_slice(&self.0)
        }
    }

    impl Block for Lent {
        fn bytes_mut(&mut self) -> &mut [u8] {
            bytemuck::cast_slice_mut(&mut self.0)
        }
        fn into_handle(self: Box<Self>) -> usize {
            7
        }
    }

    #[test]
    fn what_is_shared_is_read_where_it_lies_and_copied_before_it_is_changed() {
        let lent = Arc::new(Lent(vec![1.0f64.to_bits(), 2.0f64.to_bits()]));
        let shared = Shared::new(DType::F64, lent.clone()).unwrap();
        let array = Array { shape: vec![1, 2], data: Data::Shared(shared) };
        assert_eq!(<Vec<[f64; 2]>>::from_array(array.clone()), Ok(vec![[1.0, 2.0]]));
        let mut buffer = Buffer::<f64, 2>::from_array(array.clone()).unwrap();
        assert_eq!(buffer.as_ptr().cast(), lent.0.as_ptr());
        buffer[0] = 5.0;
        assert_eq!((&buffer[..], lent.0[0]), (&[5.0, 2.0][..], 1.0f64.to_bits()));
        let error = Buffer::<f32, 2>::from_array(array).unwrap_err();
        assert_eq!(error.to_string(), "expected f32 of 2 axes, found f64 [1, 2]");
        assert!(Shared::new(DType::F64, Arc::new(Lent(vec![0]))).is_some());
    }

    #[test]
    fn a_buffer_lies_where_the_allocator_puts_it() {
        let allocate: Allocate = |dtype, len| Some(Box::new(Lent(vec![0; (dtype.size() * len).div_ceil(8)])));
        let made = with_allocator(allocate, || Buffer::<f32, 2>::zeroed([2, 3]).unwrap());
        assert_eq!((made.len(), made.shape()), (6, [2, 3]));
        let mut made = made;
        assert_eq!(made.take_block().map(|b| b.into_handle()), Some(7));
        assert!(made.take_block().is_none() && made.is_empty());
        assert!(matches!(Buffer::<f32, 2>::zeroed([2, 3]).unwrap().store, Store::Own(_)));
        assert!(Buffer::<f32, 2>::zeroed([usize::MAX, 3]).is_none());
    }
}
