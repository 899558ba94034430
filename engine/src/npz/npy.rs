//! One array as NumPy has it in a `.npy` file: a header in Python's words, then the elements.
//!
//! **Source**: NumPy Enhancement Proposal 1 (Kern 2007), format versions 1.0, 2.0 and 3.0.

use std::io::{self, Read, Write};

use crate::array::{Array, DType, Data};

use super::NpzError;

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Headers are below a hundred bytes; this leaves room for many axes and stops at what is none.
const MAX_HEADER: usize = 1 << 16;
/// Axes at most, as NumPy had it.
const MAX_RANK: usize = 32;

/// What a header says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    pub(super) kind: Kind,
    pub(super) big_endian: bool,
    pub(super) fortran_order: bool,
    pub(super) shape: Vec<usize>,
}

/// Element types of NumPy that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Bool,
    Int(usize),
    Uint(usize),
    Float(usize),
}

impl Kind {
    pub(super) fn size(self) -> usize {
        match self {
            Kind::Bool => 1,
            Kind::Int(n) | Kind::Uint(n) | Kind::Float(n) => n,
        }
    }
}

impl Header {
    /// Number of elements, and bytes of them; `None` where either is more than a machine can count.
    pub(super) fn extent(&self) -> Option<(usize, usize)> {
        // Axes of no length must not hide others that are too long.
        let bound = self.shape.iter().filter(|&&d| d > 0).try_fold(self.kind.size(), |n, &d| n.checked_mul(d))?;
        let empty = self.shape.contains(&0);
        (bound <= isize::MAX as usize).then(|| if empty { (0, 0) } else { (bound / self.kind.size(), bound) })
    }
}

/// Writes a header of version 1.0, or 2.0 where it is long; the elements follow at a multiple of 64 bytes.
pub(super) fn write_header(dtype: DType, shape: &[usize], out: &mut impl Write) -> io::Result<()> {
    let order = if cfg!(target_endian = "little") { '<' } else { '>' };
    let descr = match dtype {
        DType::F32 => format!("{order}f4"),
        DType::F64 => format!("{order}f8"),
        DType::I64 => format!("{order}i8"),
        DType::U32 => format!("{order}u4"),
        DType::U8 => "|u1".to_owned(),
    };
    let axes: Vec<String> = shape.iter().map(usize::to_string).collect();
    // A tuple of one has a comma in Python.
    let tuple = if axes.len() == 1 { format!("({},)", axes[0]) } else { format!("({})", axes.join(", ")) };
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {tuple}, }}");
    // Magic, version and length before it, a line feed after it.
    let pad = (64 - (10 + text.len() + 1) % 64) % 64;
    text.extend(std::iter::repeat_n(' ', pad));
    text.push('\n');
    let length = u16::try_from(text.len()).map_err(|_| io::Error::other("an array has too many axes for a npy header"))?;
    out.write_all(MAGIC)?;
    out.write_all(&[1, 0])?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(text.as_bytes())
}

/// Reads a header. `name` is that of the array, for messages.
pub(super) fn read_header(name: &str, from: &mut impl Read) -> Result<Header, NpzError> {
    let corrupt = |found: &str| NpzError::Corrupt { what: format!("array `{name}` {found}") };
    let mut start = [0u8; 8];
    read_exact(name, from, &mut start)?;
    if !start.starts_with(MAGIC) {
        return Err(corrupt("without the npy signature"));
    }
    let length = match start[6] {
        1 => {
            let mut n = [0u8; 2];
            read_exact(name, from, &mut n)?;
            usize::from(u16::from_le_bytes(n))
        }
        2 | 3 => {
            let mut n = [0u8; 4];
            read_exact(name, from, &mut n)?;
            u32::from_le_bytes(n) as usize
        }
        version => return Err(corrupt(&format!("of npy version {version}, which is not known"))),
    };
    if length > MAX_HEADER {
        return Err(corrupt(&format!("with a header of {length} bytes")));
    }
    let mut text = vec![0u8; length];
    read_exact(name, from, &mut text)?;
    let text = std::str::from_utf8(&text).map_err(|_| corrupt("with a header that is no text"))?;
    parse(name, text)
}

pub(super) fn read_exact(name: &str, from: &mut impl Read, bytes: &mut [u8]) -> Result<(), NpzError> {
    from.read_exact(bytes).map_err(|e| NpzError::entry(name, &e))
}

/// A reader of the few words of Python that a header has.
struct Scan<'a>(&'a str);

impl<'a> Scan<'a> {
    fn eat(&mut self, word: &str) -> bool {
        self.0 = self.0.trim_start();
        match self.0.strip_prefix(word) {
            Some(rest) => {
                self.0 = rest;
                true
            }
            None => false,
        }
    }

    fn string(&mut self) -> Option<&'a str> {
        let quote = if self.eat("'") {
            '\''
        } else if self.eat("\"") {
            '"'
        } else {
            return None;
        };
        let (text, rest) = self.0.split_once(quote)?;
        self.0 = rest;
        Some(text)
    }

    fn bool(&mut self) -> Option<bool> {
        if self.eat("True") { Some(true) } else { self.eat("False").then_some(false) }
    }

    fn number(&mut self) -> Option<usize> {
        self.0 = self.0.trim_start();
        let end = self.0.bytes().take_while(u8::is_ascii_digit).count();
        let (digits, rest) = self.0.split_at(end);
        // Python 2 wrote long integers with an L.
        self.0 = rest.strip_prefix('L').unwrap_or(rest);
        digits.parse().ok()
    }

    fn tuple(&mut self) -> Option<Vec<usize>> {
        let mut axes = Vec::new();
        if !self.eat("(") {
            return None;
        }
        while !self.eat(")") {
            axes.push(self.number()?);
            if !self.eat(",") && !self.0.trim_start().starts_with(')') {
                return None;
            }
        }
        Some(axes)
    }
}

fn parse(name: &str, text: &str) -> Result<Header, NpzError> {
    let corrupt =
        || NpzError::Corrupt { what: format!("array `{name}` with the header {:?}", text.trim_end().chars().take(80).collect::<String>()) };
    let mut scan = Scan(text);
    let (mut descr, mut order, mut shape) = (None, None, None);
    if !scan.eat("{") {
        return Err(corrupt());
    }
    while !scan.eat("}") {
        let key = scan.string().ok_or_else(corrupt)?;
        if !scan.eat(":") {
            return Err(corrupt());
        }
        match key {
            "descr" if scan.0.trim_start().starts_with('[') => return Err(NpzError::unsupported(name, "records of several fields")),
            "descr" => descr = Some(scan.string().ok_or_else(corrupt)?),
            "fortran_order" => order = Some(scan.bool().ok_or_else(corrupt)?),
            "shape" => shape = Some(scan.tuple().ok_or_else(corrupt)?),
            _ => return Err(corrupt()),
        }
        if !scan.eat(",") && !scan.0.trim_start().starts_with('}') {
            return Err(corrupt());
        }
    }
    let (Some(descr), Some(fortran_order), Some(shape)) = (descr, order, shape) else { return Err(corrupt()) };
    if shape.len() > MAX_RANK {
        return Err(corrupt());
    }
    let (kind, big_endian) = kind(name, descr)?;
    Ok(Header { kind, big_endian, fortran_order, shape })
}

/// `<f4` and its like: the element type, and whether its bytes are in big-endian order.
fn kind(name: &str, descr: &str) -> Result<(Kind, bool), NpzError> {
    let (order, word) = match descr.as_bytes() {
        [order @ (b'<' | b'>' | b'|' | b'='), ..] => (*order, &descr[1..]),
        _ => (b'=', descr),
    };
    let kind = match word {
        "b1" | "?" => Kind::Bool,
        "i1" => Kind::Int(1),
        "i2" => Kind::Int(2),
        "i4" => Kind::Int(4),
        "i8" => Kind::Int(8),
        "u1" => Kind::Uint(1),
        "u2" => Kind::Uint(2),
        "u4" => Kind::Uint(4),
        "u8" => Kind::Uint(8),
        "f2" => Kind::Float(2),
        "f4" => Kind::Float(4),
        "f8" => Kind::Float(8),
        _ => {
            let what = match word.as_bytes().first() {
                Some(b'O') => "Python objects".to_owned(),
                Some(b'U' | b'S') => "text".to_owned(),
                Some(b'c') => "complex numbers".to_owned(),
                _ => format!("elements of the type {:?}", descr.chars().take(20).collect::<String>()),
            };
            return Err(NpzError::unsupported(name, &what));
        }
    };
    Ok((kind, order == b'>' || (order != b'<' && cfg!(target_endian = "big"))))
}

/// Elements as they stand in a file, as an array: every type becomes the narrowest of ours that holds all its values.
///
/// `bytes` are exactly the header's extent. `None` where unsigned numbers of 64 bits are beyond the signed.
pub(super) fn decode(header: &Header, mut bytes: Vec<u8>) -> Option<Array> {
    let size = header.kind.size();
    if header.big_endian != cfg!(target_endian = "big") && size > 1 {
        bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }
    if header.fortran_order && header.shape.len() > 1 {
        bytes = row_major(&bytes, &header.shape, size);
    }
    let data = match header.kind {
        Kind::Bool => Data::U8(bytes.into_iter().map(|b| u8::from(b != 0)).collect()),
        Kind::Uint(1) => Data::U8(bytes),
        Kind::Uint(2) => Data::U32(items(&bytes, |b| u32::from(u16::from_ne_bytes(b)))),
        Kind::Uint(4) => Data::U32(items(&bytes, u32::from_ne_bytes)),
        Kind::Uint(_) => Data::I64(items(&bytes, |b| i64::try_from(u64::from_ne_bytes(b)).ok()).into_iter().collect::<Option<_>>()?),
        Kind::Int(1) => Data::I64(bytes.iter().map(|&b| i64::from(b as i8)).collect()),
        Kind::Int(2) => Data::I64(items(&bytes, |b| i64::from(i16::from_ne_bytes(b)))),
        Kind::Int(4) => Data::I64(items(&bytes, |b| i64::from(i32::from_ne_bytes(b)))),
        Kind::Int(_) => Data::I64(items(&bytes, i64::from_ne_bytes)),
        Kind::Float(2) => Data::F32(items(&bytes, |b| half(u16::from_ne_bytes(b)))),
        Kind::Float(4) => Data::F32(items(&bytes, f32::from_ne_bytes)),
        Kind::Float(_) => Data::F64(items(&bytes, f64::from_ne_bytes)),
    };
    Some(Array { shape: header.shape.clone(), data })
}

fn items<const N: usize, T>(bytes: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|b| read(*b)).collect()
}

/// A 16-bit float (IEEE 754 binary16), widened without change.
fn half(bits: u16) -> f32 {
    let sign = u32::from(bits >> 15) << 31;
    let (exponent, fraction) = (u32::from(bits >> 10 & 31), u32::from(bits & 1023));
    match exponent {
        // Below the least normal number they are multiples of 2^-24, which a float of 32 bits holds exactly.
        0 => f32::from_bits((fraction as f32 / 16_777_216.0).to_bits() | sign),
        31 => f32::from_bits(sign | 0x7f80_0000 | fraction << 13),
        _ => f32::from_bits(sign | (exponent + 112) << 23 | fraction << 13),
    }
}

/// Elements in the order of rows from elements in the order of columns.
fn row_major(bytes: &[u8], shape: &[usize], size: usize) -> Vec<u8> {
    let mut strides = Vec::with_capacity(shape.len());
    let mut stride = size;
    for &axis in shape {
        strides.push(stride);
        stride *= axis;
    }
    let mut out = Vec::with_capacity(bytes.len());
    let mut index = vec![0; shape.len()];
    let mut at = 0;
    while out.len() < bytes.len() {
        out.extend_from_slice(&bytes[at..at + size]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            at += strides[axis];
            if index[axis] < shape[axis] {
                break;
            }
            at -= strides[axis] * shape[axis];
            index[axis] = 0;
        }
    }
    out
}

/// The array with elements of the type `wanted`, where not one of them changes its value; else the array as it was.
///
/// Floats of 32 bits become 64; whole numbers become any type that holds each of them.
pub(super) fn convert(array: Array, wanted: DType) -> Array {
    let data = match (&array.data, wanted) {
        (Data::F32(v), DType::F64) => Some(Data::F64(v.iter().map(|&x| f64::from(x)).collect())),
        (Data::I64(v), _) => from_whole(v.iter().copied(), wanted),
        (Data::U32(v), _) if wanted != DType::U32 => from_whole(v.iter().map(|&x| i64::from(x)), wanted),
        (Data::U8(v), _) if wanted != DType::U8 => from_whole(v.iter().map(|&x| i64::from(x)), wanted),
        _ => None,
    };
    match data {
        Some(data) => Array { data, ..array },
        None => array,
    }
}

fn from_whole(values: impl Iterator<Item = i64>, wanted: DType) -> Option<Data> {
    // Every whole number up to these is a float of its own.
    const F32: u64 = 1 << 24;
    const F64: u64 = 1 << 53;
    Some(match wanted {
        DType::F32 => Data::F32(values.map(|v| (v.unsigned_abs() <= F32).then_some(v as f32)).collect::<Option<_>>()?),
        DType::F64 => Data::F64(values.map(|v| (v.unsigned_abs() <= F64).then_some(v as f64)).collect::<Option<_>>()?),
        DType::I64 => Data::I64(values.collect()),
        DType::U32 => Data::U32(values.map(|v| u32::try_from(v).ok()).collect::<Option<_>>()?),
        DType::U8 => Data::U8(values.map(|v| u8::try_from(v).ok()).collect::<Option<_>>()?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(text: &str) -> Result<Header, NpzError> {
        parse("a", text)
    }

    #[test]
    fn headers_are_read_as_numpy_writes_them() {
        let read = header("{'descr': '>f8', 'fortran_order': True, 'shape': (3, 2L), }  \n").unwrap();
        assert_eq!(read, Header { kind: Kind::Float(8), big_endian: true, fortran_order: true, shape: vec![3, 2] });
        assert_eq!(header("{'shape':(),'fortran_order':False,'descr':'|b1'}").unwrap().shape, Vec::<usize>::new());
        assert_eq!(header("{'shape': (7,), 'fortran_order': False, 'descr': '<i2', }").unwrap().shape, [7]);
    }

    #[test]
    fn headers_that_are_none_are_refused() {
        for text in [
            "",
            "{",
            "{'descr': '<f8'}",
            "{'descr': '<f8', 'fortran_order': 0, 'shape': ()}",
            "{'descr' '<f8'}",
            "{'shape': (-1,)}",
            "{'shape': (1",
        ] {
            assert!(matches!(header(text), Err(NpzError::Corrupt { .. })), "{text}");
        }
        let huge = header("{'descr': '<f8', 'fortran_order': False, 'shape': (0, 9999999999, 9999999999)}").unwrap();
        assert_eq!(huge.extent(), None);
        for (descr, what) in
            [("|O", "Python objects"), ("<U5", "text"), ("<c16", "complex numbers"), ("<M8[s]", "elements of the type \"<M8[s]\"")]
        {
            let error = header(&format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ()}}")).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        }
    }

    #[test]
    fn halves_widen_exactly() {
        let cases = [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0400, 2f32.powi(-14)),
            (0x0001, 2f32.powi(-24)),
            (0x83ff, -1023.0 * 2f32.powi(-24)),
            (0x7c00, f32::INFINITY),
        ];
        for (bits, value) in cases {
            assert_eq!(half(bits), value, "{bits:04x}");
        }
        assert!(half(0x7e00).is_nan() && half(0x8000).is_sign_negative());
    }

    #[test]
    fn numbers_change_their_type_only_where_none_changes_its_value() {
        let array = |data| Array { shape: vec![2], data };
        assert_eq!(convert(array(Data::I64(vec![1, -2])), DType::F64).data, Data::F64(vec![1.0, -2.0]));
        assert_eq!(convert(array(Data::I64(vec![1, 255])), DType::U8).data, Data::U8(vec![1, 255]));
        assert_eq!(convert(array(Data::I64(vec![1, -2])), DType::U32).dtype(), DType::I64);
        assert_eq!(convert(array(Data::I64(vec![1, (1 << 24) + 1])), DType::F32).dtype(), DType::I64);
        assert_eq!(convert(array(Data::F32(vec![0.1, 2.0])), DType::F64).data, Data::F64(vec![f64::from(0.1f32), 2.0]));
        assert_eq!(convert(array(Data::F64(vec![1.0, 2.0])), DType::F32).dtype(), DType::F64);
        assert_eq!(convert(array(Data::F32(vec![1.0, 2.0])), DType::I64).dtype(), DType::F32);
    }
}
