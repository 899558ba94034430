//! Records of the index as bytes: a mark, the length, a checksum, the body. Whatever is not whole is passed over.

use super::{Digest, Key};

/// Begins each record, so that the one after a damaged record is found again.
const MARK: [u8; 4] = *b"PgR\x01";
/// Mark, length and checksum.
const HEAD: usize = 16;
/// Bodies are below this, so that a damaged length costs little.
const MAX_BODY: usize = 1 << 20;
/// Uses that go into one record.
pub(super) const MAX_USES: usize = 4096;

/// One fact of the index. Generations count the runs of the folder: they stand in for time, which clocks tell wrongly.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Record<'a> {
    /// A key, and where the bytes of its value are.
    Value(Held<'a>),
    /// A further key of a value.
    Link { key: Key, digest: Digest },
    /// A note under a key.
    Note { born: u64, key: Key, text: &'a [u8] },
    /// Values and notes with the generation in which each was last used.
    Used(Vec<([u8; 32], u64)>),
    /// A value that is gone, with all that was stored of it up to a generation.
    Removed { upto: u64, digest: Digest },
}

/// What a record says of a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Held<'a> {
    pub(super) born: u64,
    pub(super) key: Key,
    pub(super) digest: Digest,
    /// Bytes of the value's arrays.
    pub(super) bytes: u64,
    /// Bytes on the disk.
    pub(super) stored: u64,
    /// Where they begin in the data beside the log; `None` for a file of their own.
    pub(super) at: Option<u64>,
    /// The value's type.
    pub(super) ty: &'a str,
}

impl Record<'_> {
    /// Appends the record to `out`; false where it is too long to be one.
    pub(super) fn write(&self, out: &mut Vec<u8>) -> bool {
        let start = out.len();
        out.extend_from_slice(&[0; HEAD]);
        self.write_body(out);
        let length = out.len() - start - HEAD;
        if length > MAX_BODY {
            out.truncate(start);
            return false;
        }
        let sum = checksum(&out[start + HEAD..]);
        out[start..start + 4].copy_from_slice(&MARK);
        out[start + 4..start + 8].copy_from_slice(&(length as u32).to_le_bytes());
        out[start + 8..start + HEAD].copy_from_slice(&sum);
        true
    }

    fn write_body(&self, out: &mut Vec<u8>) {
        match self {
            Record::Value(held) => {
                out.push(1);
                out.extend_from_slice(&held.born.to_le_bytes());
                out.extend_from_slice(&held.key);
                out.extend_from_slice(&held.digest);
                out.extend_from_slice(&held.bytes.to_le_bytes());
                out.extend_from_slice(&held.stored.to_le_bytes());
                out.push(u8::from(held.at.is_some()));
                out.extend_from_slice(&held.at.unwrap_or(0).to_le_bytes());
                out.extend_from_slice(held.ty.as_bytes());
            }
            Record::Link { key, digest } => {
                out.push(2);
                out.extend_from_slice(key);
                out.extend_from_slice(digest);
            }
            Record::Note { born, key, text } => {
                out.push(3);
                out.extend_from_slice(&born.to_le_bytes());
                out.extend_from_slice(key);
                out.extend_from_slice(text);
            }
            Record::Used(uses) => {
                out.push(4);
                for (id, used) in uses {
                    out.extend_from_slice(id);
                    out.extend_from_slice(&used.to_le_bytes());
                }
            }
            Record::Removed { upto, digest } => {
                out.push(5);
                out.extend_from_slice(&upto.to_le_bytes());
                out.extend_from_slice(digest);
            }
        }
    }
}

fn checksum(body: &[u8]) -> [u8; 8] {
    let mut sum = [0; 8];
    sum.copy_from_slice(&blake3::hash(body).as_bytes()[..8]);
    sum
}

/// What is left of a body.
struct Body<'a>(&'a [u8]);

impl<'a> Body<'a> {
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }

    fn number(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// The record; `None` for one of a kind that is not known.
    fn record(mut self) -> Option<Record<'a>> {
        let [kind] = self.array()?;
        match kind {
            1 => self.held().map(Record::Value),
            2 => Some(Record::Link { key: self.array()?, digest: self.array()? }),
            3 => Some(Record::Note { born: self.number()?, key: self.array()?, text: self.0 }),
            4 => {
                let (uses, _) = self.0.as_chunks::<40>();
                uses.iter().map(|u| Body(u)).map(|mut u| Some((u.array()?, u.number()?))).collect::<Option<_>>().map(Record::Used)
            }
            5 => Some(Record::Removed { upto: self.number()?, digest: self.array()? }),
            _ => None,
        }
    }

    fn held(&mut self) -> Option<Held<'a>> {
        let (born, key, digest) = (self.number()?, self.array()?, self.array()?);
        let (bytes, stored) = (self.number()?, self.number()?);
        let [inline] = self.array()?;
        let at = self.number()?;
        let ty = std::str::from_utf8(self.0).ok()?;
        Some(Held { born, key, digest, bytes, stored, at: (inline == 1).then_some(at), ty })
    }
}

/// What was found in some bytes of a log.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Scanned {
    /// Where the last whole record ends. What follows is still being written, or was torn off.
    pub(super) end: usize,
    /// Bytes between whole records that are none.
    pub(super) damaged: usize,
}

/// Reads records one after the other, and hands over each with its length.
pub(super) fn scan<'a>(bytes: &'a [u8], mut each: impl FnMut(Record<'a>, usize)) -> Scanned {
    let mut scanned = Scanned::default();
    let mut at = 0;
    while let Some(found) = bytes[at..].windows(MARK.len()).position(|w| w == MARK) {
        at += found;
        let Some(body) = body(&bytes[at..]) else {
            at += 1;
            continue;
        };
        scanned.damaged += at - scanned.end;
        at += HEAD + body.len();
        scanned.end = at;
        if let Some(record) = Body(body).record() {
            each(record, HEAD + body.len());
        }
    }
    scanned
}

/// The body of the whole record that `bytes` begin with.
fn body(bytes: &[u8]) -> Option<&[u8]> {
    let mut head = Body(bytes);
    let (_mark, length, sum) = (head.array::<4>()?, head.array()?, head.array::<8>()?);
    let length = u32::from_le_bytes(length) as usize;
    let body = head.0.get(..length).filter(|_| length <= MAX_BODY)?;
    (checksum(body) == sum).then_some(body)
}
