//! Messages: numbers and texts one after the other. Whoever reads them takes nothing for granted.

use crate::array::Data;
use crate::value::ValueRef;

/// A message that is being written, and the arrays that go behind it.
#[derive(Default)]
pub(super) struct Writer {
    pub(super) bytes: Vec<u8>,
    pub(super) along: Vec<Along>,
}

/// An array that goes behind a message, as it lies.
pub(super) enum Along {
    /// One of the arrays of a value.
    Of(ValueRef, usize),
    Data(Data),
}

impl Along {
    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            Self::Of(value, at) => value.nth_array(*at).map_or(&[], |(_, view)| view.bytes),
            Self::Data(data) => data.bytes(),
        }
    }
}

impl Writer {
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.along.clear();
    }

    pub(super) fn u32(&mut self, number: u32) {
        self.bytes.extend(number.to_ne_bytes());
    }

    pub(super) fn u64(&mut self, number: u64) {
        self.bytes.extend(number.to_ne_bytes());
    }

    pub(super) fn i64(&mut self, number: i64) {
        self.bytes.extend(number.to_ne_bytes());
    }

    pub(super) fn f64(&mut self, number: f64) {
        self.bytes.extend(number.to_ne_bytes());
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        self.u64(bytes.len() as u64);
        self.bytes.extend_from_slice(bytes);
    }

    pub(super) fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
    }

    /// A count, and as many of something.
    pub(super) fn list<T>(&mut self, items: &[T], mut one: impl FnMut(&mut Self, &T)) {
        self.u64(items.len() as u64);
        items.iter().for_each(|item| one(self, item));
    }
}

/// A message that is being read; `None` from where it is not what it should be.
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

impl<'a> Reader<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*taken)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_ne_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_ne_bytes)
    }

    pub(super) fn i64(&mut self) -> Option<i64> {
        self.take().map(i64::from_ne_bytes)
    }

    pub(super) fn f64(&mut self) -> Option<f64> {
        self.take().map(f64::from_ne_bytes)
    }

    pub(super) fn size(&mut self) -> Option<usize> {
        usize::try_from(self.u64()?).ok()
    }

    pub(super) fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.size()?;
        let (taken, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(taken)
    }

    pub(super) fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }

    /// What [`Writer::list`] wrote.
    pub(super) fn list<T>(&mut self, mut one: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count = self.size()?;
        // Each takes a byte at least; a count that lies is found out where the message ends.
        let mut items = Vec::with_capacity(count.min(self.0.len()));
        for _ in 0..count {
            items.push(one(self)?);
        }
        Some(items)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_lies_are_found_out() {
        let mut to = Writer::default();
        to.u32(7);
        to.i64(-3);
        to.f64(0.5);
        to.list(&["a", "", "bc"], |to, text| to.text(text));
        let mut from = Reader(&to.bytes);
        assert_eq!((from.u32(), from.i64(), from.f64()), (Some(7), Some(-3), Some(0.5)));
        assert_eq!(from.list(Reader::text), Some(vec!["a", "", "bc"]));
        assert!(from.0.is_empty() && from.u32().is_none());
        for end in 0..to.bytes.len() {
            let mut from = Reader(&to.bytes[..end]);
            let all = (|| Some((from.u32()?, from.i64()?, from.f64()?, from.list(Reader::text)?)))();
            assert_eq!(all, None, "{end}");
        }
        assert_eq!(Reader(&u64::MAX.to_ne_bytes()).bytes(), None);
        assert_eq!(Reader(&u64::MAX.to_ne_bytes()).list(Reader::u32), None);
    }
}
