//! Accessors: the numbers of a glTF file, wherever and however they are stored.

use super::error::{GltfError, item, malformed};
use super::{Document, json};

/// Component types of what is measured: floats, and integers that stand for them.
pub(super) const REAL: &[u32] = &[5120, 5121, 5122, 5123, 5126];
/// Component types of what must not be rounded.
pub(super) const FLOAT: &[u32] = &[5126];
/// Component types of numbers of vertices and elements.
pub(super) const INDEX: &[u32] = &[5121, 5123, 5125];
/// Component types of numbers of joints.
pub(super) const JOINT: &[u32] = &[5121, 5123];

/// Holds a component type against those that may be.
fn allowed(kind: u32, kinds: &[u32], at: &str) -> Result<(), GltfError> {
    let listed = || kinds.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
    if kinds.contains(&kind) { Ok(()) } else { Err(malformed(at, format!("expected a componentType of {}, found {kind}", listed()))) }
}

/// Bytes of a component.
fn component_size(kind: u32, at: &str) -> Result<usize, GltfError> {
    match kind {
        5120 | 5121 => Ok(1),
        5122 | 5123 => Ok(2),
        5125 | 5126 => Ok(4),
        _ => Err(malformed(at, format!("expected a componentType of 5120 to 5126 but 5124, found {kind}"))),
    }
}

fn width(shape: &str, at: &str) -> Result<usize, GltfError> {
    match shape {
        "SCALAR" => Ok(1),
        "VEC2" => Ok(2),
        "VEC3" => Ok(3),
        "VEC4" => Ok(4),
        "MAT4" => Ok(16),
        // Smaller matrices are padded, and nothing that is read has any.
        _ => Err(malformed(at, format!("expected a type SCALAR, VEC2, VEC3, VEC4 or MAT4, found {shape:?}"))),
    }
}

/// One component as a number.
fn component(kind: u32, normalized: bool, bytes: &[u8]) -> f64 {
    let scaled = |v: f64, largest: f64| if normalized { (v / largest).max(-1.0) } else { v };
    match (kind, bytes) {
        (5120, [a]) => scaled(f64::from(*a as i8), 127.0),
        (5121, [a]) => scaled(f64::from(*a), 255.0),
        (5122, [a, b]) => scaled(f64::from(i16::from_le_bytes([*a, *b])), 32767.0),
        (5123, [a, b]) => scaled(f64::from(u16::from_le_bytes([*a, *b])), 65535.0),
        (5125, [a, b, c, d]) => f64::from(u32::from_le_bytes([*a, *b, *c, *d])),
        (_, [a, b, c, d]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
        _ => f64::NAN,
    }
}

/// Elements in a buffer view: where they start, how far apart they are, what each is made of.
struct Layout<'a> {
    bytes: &'a [u8],
    stride: usize,
    /// Bytes of a component.
    each: usize,
    kind: u32,
    width: usize,
    normalized: bool,
}

impl Layout<'_> {
    fn put(&self, element: usize, out: &mut [f64]) {
        let (start, each) = (element * self.stride, self.each);
        for (c, v) in out.iter_mut().enumerate().take(self.width) {
            *v = component(self.kind, self.normalized, self.bytes.get(start + c * each..start + (c + 1) * each).unwrap_or_default());
        }
    }
}

impl Document {
    /// The bytes of a buffer view.
    pub(super) fn view(&self, index: usize, at: &str) -> Result<(&[u8], Option<usize>), GltfError> {
        let view = item(&self.root.buffer_views, "bufferViews", index, at)?;
        let at = format!("bufferViews[{index}]");
        let buffer = item(&self.buffers, "buffers", view.buffer, &at)?;
        let bytes = view.byte_offset.checked_add(view.byte_length).and_then(|end| buffer.get(view.byte_offset..end));
        let bytes = bytes.ok_or_else(|| {
            let message =
                format!("expected bytes within a buffer of {}, found {} from {}", buffer.len(), view.byte_length, view.byte_offset);
            malformed(&at, message)
        })?;
        Ok((bytes, view.byte_stride))
    }

    /// Where `count` elements lie.
    fn layout(
        &self,
        view: usize,
        offset: usize,
        count: usize,
        (kind, width, normalized): (u32, usize, bool),
        at: &str,
    ) -> Result<Layout<'_>, GltfError> {
        let (bytes, stride) = self.view(view, at)?;
        let each = component_size(kind, at)?;
        let size = each * width;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(malformed(at, format!("expected a byteStride of {size} at least, found {stride}")));
        }
        let end = count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(size)).and_then(|n| n.checked_add(offset));
        let bytes = end.and_then(|end| bytes.get(offset..end)).ok_or_else(|| {
            malformed(at, format!("expected {count} elements of {size} bytes, found a buffer view of {} bytes", bytes.len()))
        })?;
        Ok(Layout { bytes, stride, each, kind, width, normalized })
    }

    /// All numbers of an accessor whose type is one of `shapes` and whose component type one of `kinds`, element by element; integers that stand for
    /// fractions as fractions.
    ///
    /// # Errors
    /// Where there is no such accessor, it is of another type, or it reaches beyond its bytes.
    pub(super) fn numbers(&self, index: usize, shapes: &[&str], kinds: &[u32], at: &str) -> Result<Vec<f64>, GltfError> {
        let accessor = item(&self.root.accessors, "accessors", index, at)?;
        let at = format!("accessors[{index}]");
        if !shapes.contains(&accessor.shape.as_str()) {
            return Err(malformed(&at, format!("expected the type {}, found {:?}", shapes.join(" or "), accessor.shape)));
        }
        let what = (accessor.component_type, width(&accessor.shape, &at)?, accessor.normalized);
        allowed(what.0, kinds, &at)?;
        let count = accessor.count;
        let dense = accessor.buffer_view.map(|view| self.layout(view, accessor.byte_offset, count, what, &at)).transpose()?;
        self.spend(count.saturating_mul(what.1), &at)?;
        let mut out = vec![0.0; count * what.1];
        if let Some(layout) = dense {
            out.chunks_exact_mut(what.1).enumerate().for_each(|(i, v)| layout.put(i, v));
        }
        if let Some(sparse) = &accessor.sparse {
            self.put_sparse(sparse, count, what, &mut out, &at)?;
        }
        Ok(out)
    }

    fn put_sparse(
        &self,
        sparse: &json::Sparse,
        count: usize,
        what: (u32, usize, bool),
        out: &mut [f64],
        at: &str,
    ) -> Result<(), GltfError> {
        let at = format!("{at}.sparse");
        if sparse.count > count {
            return Err(malformed(&at, format!("expected at most {count} elements, found {}", sparse.count)));
        }
        let (i, v) = (&sparse.indices, &sparse.values);
        allowed(i.component_type, INDEX, &format!("{at}.indices"))?;
        let indices = self.layout(i.buffer_view, i.byte_offset, sparse.count, (i.component_type, 1, false), &at)?;
        let values = self.layout(v.buffer_view, v.byte_offset, sparse.count, what, &at)?;
        let mut last = -1.0;
        for element in 0..sparse.count {
            let mut place = [0.0];
            indices.put(element, &mut place);
            if place[0] <= last {
                return Err(malformed(format!("{at}.indices"), format!("expected indices that ascend, found {} after {last}", place[0])));
            }
            last = place[0];
            let to = place[0] as usize;
            let slot = (place[0] >= 0.0 && to < count).then(|| out.get_mut(to * what.1..(to + 1) * what.1)).flatten();
            let slot = slot.ok_or_else(|| malformed(&at, format!("expected an element below {count}, found {}", place[0])))?;
            values.put(element, slot);
        }
        Ok(())
    }

    /// As [`Document::numbers`] of finite numbers, in vectors of `N`.
    pub(super) fn vectors<const N: usize>(
        &self,
        index: usize,
        shapes: &[&str],
        kinds: &[u32],
        at: &str,
    ) -> Result<Vec<[f64; N]>, GltfError> {
        let numbers = self.numbers(index, shapes, kinds, at)?;
        match numbers.iter().position(|v| !v.is_finite()) {
            Some(i) => {
                Err(malformed(format!("accessors[{index}]"), format!("element {}: expected finite numbers, found {}", i / N, numbers[i])))
            }
            None => Ok(numbers.as_chunks::<N>().0.to_vec()),
        }
    }
}
