//! Values through `.npz` files and back, files that NumPy wrote, and files that are damaged.

use std::io::Cursor;
use std::sync::Arc;

use super::*;
use crate::array::NdArray;

/// A value with arrays of each type, and texts.
#[derive(Clone, Debug, PartialEq, crate::Value)]
struct Mixed {
    /// Singles.
    #[value(shape = "[h, w]")]
    grid: NdArray<f32, 2>,
    /// Doubles.
    #[value(shape = "[n, 2]")]
    points: Vec<[f64; 2]>,
    /// Whole numbers.
    #[value(shape = "[]")]
    count: i64,
    /// Indices.
    #[value(shape = "[k]")]
    indices: Vec<u32>,
    /// Bytes.
    #[value(shape = "[3]")]
    bytes: [u8; 3],
    /// A name.
    #[value(text)]
    name: String,
}

fn mixed(seed: u32, name: &str) -> Mixed {
    let s = seed as f32;
    Mixed {
        grid: NdArray::new([2, 3], (0..6).map(|i| i as f32 + s).collect()).unwrap(),
        points: vec![[f64::from(s), -0.5], [f64::NAN, 1e300]],
        count: i64::MIN + i64::from(seed),
        indices: vec![seed, u32::MAX],
        bytes: [1, 2, 255],
        name: name.to_owned(),
    }
}

fn bytes_of(value: &dyn AnyValue, compress: bool) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    write(value, compress, &mut out).unwrap();
    out.into_inner()
}

fn stream_bytes(frames: &[i64], values: &[Mixed], compress: bool) -> Vec<u8> {
    let values: Vec<ValueRef> = values.iter().map(|v| Arc::new(v.clone()) as ValueRef).collect();
    let mut out = Cursor::new(Vec::new());
    write_stream(frames, |k| Ok::<_, NpzError>(values[k].clone()), compress, &mut out).unwrap();
    out.into_inner()
}

fn open(bytes: &[u8]) -> Result<Archive<Cursor<&[u8]>>, NpzError> {
    Archive::open(Cursor::new(bytes), 1 << 20)
}

fn digests(value: &dyn AnyValue) -> String {
    crate::value::digest(value).to_string()
}

fn read_mixed(bytes: &[u8]) -> Result<ValueRef, NpzError> {
    open(bytes)?.value(&ValueType::of::<Mixed>())
}

#[test]
fn a_value_comes_back_from_its_file_to_the_bit() {
    for compress in [false, true] {
        for name in ["", "hat \u{fc} \"x\""] {
            let value = mixed(3, name);
            let bytes = bytes_of(&value, compress);
            assert_eq!(bytes, bytes_of(&value, compress), "the same value has the same bytes");
            assert_eq!(digests(read_mixed(&bytes).unwrap().as_ref()), digests(&value));
            let mut archive = open(&bytes).unwrap();
            assert_eq!(archive.names().contains(&"meta".to_owned()), !name.is_empty());
            assert_eq!(archive.frames().unwrap(), None);
        }
    }
}

#[test]
fn a_stream_comes_back_frame_by_frame() {
    let frames = [-2, -1, 0];
    for compress in [false, true] {
        for names in [["", "", ""], ["a", "a", "a"], ["a", "b", ""]] {
            let values: Vec<Mixed> = names.iter().enumerate().map(|(i, n)| mixed(i as u32, n)).collect();
            let bytes = stream_bytes(&frames, &values, compress);
            let mut archive = open(&bytes).unwrap();
            assert_eq!(archive.frames().unwrap().unwrap(), frames);
            for (i, value) in values.iter().enumerate() {
                let read = archive.frame(&ValueType::of::<Mixed>(), i, 3).unwrap();
                assert_eq!(digests(read.as_ref()), digests(value));
            }
        }
    }
}

#[test]
fn one_frame_of_a_large_stored_array_is_read_by_itself() {
    let large = |k: u32| Mixed { grid: NdArray::new([512, 1024], (0..1 << 19).map(|i| (i + k) as f32).collect()).unwrap(), ..mixed(k, "") };
    let values: Vec<Mixed> = (0..3).map(large).collect();
    let bytes = stream_bytes(&[1, 2, 3], &values, false);
    // The stack is above the limit, a frame is below it.
    let mut archive = Archive::open(Cursor::new(&bytes[..]), 3 << 20).unwrap();
    let read = archive.frame(&ValueType::of::<Mixed>(), 2, 3).unwrap();
    assert_eq!(digests(read.as_ref()), digests(&values[2]));
}

#[test]
fn frames_of_several_shapes_are_refused_with_what_to_do() {
    let mut other = mixed(1, "");
    other.points.push([0.0, 0.0]);
    let values: Vec<ValueRef> = vec![Arc::new(mixed(0, "")), Arc::new(other)];
    let error = write_stream(&[7, 8], |k| Ok::<_, NpzError>(values[k].clone()), false, Cursor::new(Vec::new())).unwrap_err().to_string();
    assert_eq!(
        error,
        "expected `points` as f64 [2, 2] at every frame, found `points` as f64 [3, 2] at frame 8; write one file a frame, with #### in the path"
    );
}

#[test]
fn arrays_that_do_not_make_the_value_are_named() {
    let bytes = bytes_of(&crate::value::Curve { value: 1.0 }, false);
    assert_eq!(read_mixed(&bytes).unwrap_err().to_string(), "expected an array `grid`, found value");
    let bytes = bytes_of(&crate::value::Vector { values: vec![1.0, 2.0] }, false);
    let error = open(&bytes).unwrap().value(&ValueType::of::<crate::value::TimeMap>()).unwrap_err().to_string();
    assert_eq!(error, "expected an array `source_frames`, found values");
    /// As [`crate::value::Vector`], of two axes.
    #[derive(Debug, crate::Value)]
    struct Table {
        /// Rows of two.
        #[value(shape = "[k, 2]")]
        values: Vec<[f64; 2]>,
    }
    let error = open(&bytes).unwrap().value(&ValueType::of::<Table>()).unwrap_err().to_string();
    assert_eq!(error, "Table: array `values`: expected f64 [n, 2], found f64 [2]; the file has values");
}

/// numpy 2: `numpy.savez(f, a=numpy.arange(6, dtype='>f8').reshape(2, 3), b=numpy.asfortranarray(numpy.arange(6, dtype='<i4').reshape(2, 3)),
/// c=numpy.array(2.5, dtype='<f2'), d=numpy.array([True, False]), e=numpy.array([1, 2**40], dtype='<u8'))`, and the same compressed.
const NUMPY: &[u8] = include_bytes!("testdata/savez.npz");
const NUMPY_COMPRESSED: &[u8] = include_bytes!("testdata/savez_compressed.npz");
/// numpy 2: `numpy.savez(f, s=numpy.array(['text']), v=numpy.array([1.0, 2.0]))`.
const NUMPY_TEXT: &[u8] = include_bytes!("testdata/text.npz");

#[test]
fn what_numpy_wrote_is_read() {
    for bytes in [NUMPY, NUMPY_COMPRESSED] {
        let mut parts = open(bytes).unwrap().parts().unwrap();
        let mut take = |name: &str| parts.take(name).unwrap();
        assert_eq!(take("a"), Array { shape: vec![2, 3], data: Data::F64(vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0]) });
        assert_eq!(take("b"), Array { shape: vec![2, 3], data: Data::I64(vec![0, 1, 2, 3, 4, 5]) });
        assert_eq!(take("c"), Array { shape: vec![], data: Data::F32(vec![2.5]) });
        assert_eq!(take("d"), Array { shape: vec![2], data: Data::U8(vec![1, 0]) });
        assert_eq!(take("e"), Array { shape: vec![2], data: Data::I64(vec![1, 1 << 40]) });
    }
}

#[test]
fn an_array_is_written_as_numpy_writes_it() {
    let entry = |bytes: &[u8], name: &str| {
        let mut out = Vec::new();
        zip::ZipArchive::new(Cursor::new(bytes)).unwrap().by_name(name).unwrap().read_to_end(&mut out).unwrap();
        out
    };
    let ours = bytes_of(&crate::value::Vector { values: vec![1.0, 2.0] }, false);
    assert_eq!(entry(&ours, "values.npy"), entry(NUMPY_TEXT, "v.npy"));
}

#[test]
fn an_array_of_words_is_refused_where_it_is_wanted_and_passed_over_where_not() {
    let error = open(NUMPY_TEXT).unwrap().parts().unwrap_err().to_string();
    assert!(error.starts_with("array `s`: expected numbers, found text"), "{error}");
    /// Its numbers alone.
    #[derive(Debug, crate::Value)]
    struct Numbers {
        /// They.
        #[value(shape = "[n]")]
        v: Vec<f64>,
    }
    let read = open(NUMPY_TEXT).unwrap().value(&ValueType::of::<Numbers>()).unwrap();
    assert_eq!(crate::value::downcast::<Numbers>(read).unwrap().v, [1.0, 2.0]);
}

#[test]
fn every_file_that_is_cut_short_is_one_error() {
    for bytes in [bytes_of(&mixed(1, "name"), false), bytes_of(&mixed(1, "name"), true), NUMPY_COMPRESSED.to_vec()] {
        for cut in 0..bytes.len() {
            let error = open(&bytes[..cut]).and_then(|mut a| a.parts().map(drop));
            assert!(matches!(error, Err(NpzError::Corrupt { .. })), "{cut} of {}: {error:?}", bytes.len());
        }
    }
}

#[test]
fn a_byte_that_was_flipped_is_an_error_or_changes_nothing() {
    for compress in [false, true] {
        let value = mixed(1, "name");
        let bytes = bytes_of(&value, compress);
        // An archive's table of names has no checksum, so the entry of the texts, which may be left out, can lose its name.
        let nameless = digests(&Mixed { name: String::new(), ..value.clone() });
        let mut refused = 0;
        for at in 0..bytes.len() {
            for flip in [0x01, 0x10, 0xff] {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                match read_mixed(&damaged) {
                    // Bytes that say nothing of the arrays: times, permissions, versions.
                    Ok(read) => {
                        assert!([&digests(&value), &nameless].contains(&&digests(read.as_ref())), "byte {at} flipped by {flip:02x}")
                    }
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(refused > bytes.len(), "{refused} of {}", 3 * bytes.len());
    }
}

/// An archive of one entry with a header of the npy format's own, and the bytes after it.
fn forged(header: &str, data: &[u8], compress: bool) -> Vec<u8> {
    let method = if compress { CompressionMethod::Deflated } else { CompressionMethod::Stored };
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file("value.npy", SimpleFileOptions::default().compression_method(method)).unwrap();
    zip.write_all(b"\x93NUMPY\x01\x00").unwrap();
    zip.write_all(&u16::try_from(header.len()).unwrap().to_le_bytes()).unwrap();
    zip.write_all(header.as_bytes()).unwrap();
    zip.write_all(data).unwrap();
    zip.finish().unwrap().into_inner()
}

#[test]
fn sizes_that_cannot_be_are_refused_before_they_are_allocated() {
    let read = |shape: &str, data: &[u8]| {
        let bytes = forged(&format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n"), data, true);
        open(&bytes).unwrap().parts().unwrap_err().to_string()
    };
    let error = read("(100000, 100000, 3)", &[0; 16]);
    assert_eq!(error, "expected at most 1048576 bytes in the arrays of one value, found array `value` of 100000, 100000, 3");
    assert!(read("(99999999999, 99999999999, 99999999999)", &[]).contains("expected at most"));
    assert!(read("(0, 99999999999, 99999999999)", &[]).contains("expected at most"));
    assert!(read("(1000,)", &[0; 16]).contains("in place of 4000"), "{}", read("(1000,)", &[0; 16]));
    assert!(read("(1,)", &[0; 16]).contains("more than 4 bytes"));
    // A small file of many noughts.
    let bomb = forged("{'descr': '|u1', 'fortran_order': False, 'shape': (4000000,), }\n", &vec![0; 4_000_000], true);
    assert!(bomb.len() < 8192);
    assert!(matches!(open(&bomb).unwrap().parts(), Err(NpzError::TooLarge { .. })));
}

#[test]
fn texts_that_are_no_object_are_refused() {
    #[derive(Debug, crate::Value)]
    /// Bytes called as the texts are.
    struct Fake {
        /// Bytes.
        #[value(shape = "[n]")]
        meta: Vec<u8>,
    }
    for text in ["[1, 2]", "{", "\u{0}", "7"] {
        let bytes = bytes_of(&Fake { meta: text.as_bytes().to_vec() }, false);
        assert!(matches!(open(&bytes).unwrap().parts(), Err(NpzError::Corrupt { .. })), "{text}");
    }
}
