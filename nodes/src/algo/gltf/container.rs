//! The bytes of a glTF file: the binary container, and the URIs of what lies outside it.

use super::error::{GltfError, malformed};

const MAGIC: &[u8; 4] = b"glTF";
const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes)
}

/// The JSON of a file, and the binary chunk of a `.glb`.
///
/// # Errors
/// Where a binary container is cut off or its chunks are not a JSON one and at most one of bytes.
pub(super) fn open(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), GltfError> {
    if !bytes.starts_with(MAGIC) {
        return Ok((bytes, None));
    }
    let (Some(version), Some(length)) = (word(bytes, 4), word(bytes, 8)) else {
        return Err(malformed("header", format!("expected 12 bytes, found {}", bytes.len())));
    };
    if version != 2 {
        return Err(malformed("header", format!("expected container version 2, found {version}")));
    }
    let whole = usize::try_from(length).ok().and_then(|n| bytes.get(..n)).filter(|w| w.len() >= 12);
    let whole =
        whole.ok_or_else(|| malformed("header", format!("expected a file of {length} bytes and 12 at least, found {}", bytes.len())))?;
    let (mut at, mut json, mut bin) = (12, None, None);
    while at < whole.len() {
        let (Some(length), Some(kind)) = (word(whole, at), word(whole, at + 4)) else {
            return Err(malformed(
                format!("chunk at byte {at}"),
                "expected a length and a type of 4 bytes each, found the end of the file",
            ));
        };
        let start = at + 8;
        let chunk = usize::try_from(length).ok().and_then(|n| whole.get(start..start.checked_add(n)?));
        let chunk = chunk
            .ok_or_else(|| malformed(format!("chunk at byte {at}"), format!("expected {length} bytes, found {}", whole.len() - start)))?;
        let refuse = |what: &str| Err(malformed(format!("chunk at byte {at}"), what));
        match (kind, json.is_some(), bin.is_some()) {
            (JSON, false, _) => json = Some(chunk),
            (JSON, true, _) => return refuse("expected one JSON chunk, found another"),
            (_, false, _) => return refuse("expected the JSON chunk first, found another type"),
            (BIN, _, false) => bin = Some(chunk),
            (BIN, _, true) => return refuse("expected one binary chunk at most, found another"),
            // Chunks of other types belong to extensions.
            _ => {}
        }
        at = start + chunk.len();
    }
    json.map(|json| (json, bin)).ok_or_else(|| malformed("header", "expected a JSON chunk, found none"))
}

/// A `.glb` of JSON and bytes.
///
/// # Errors
/// Where it would be longer than the 4 GiB that the container can say.
pub(super) fn pack(json: &[u8], bin: &[u8]) -> Result<Vec<u8>, GltfError> {
    let padded = |n: usize| n.next_multiple_of(4);
    let total = 12 + 8 + padded(json.len()) + if bin.is_empty() { 0 } else { 8 + padded(bin.len()) };
    let length = u32::try_from(total).map_err(|_| GltfError::TooLarge {
        at: "header".to_owned(),
        message: format!("expected a file of at most 4 GiB, found {total} bytes"),
    })?;
    let mut out = Vec::with_capacity(total);
    out.extend_from_slice(MAGIC);
    out.extend([2, length].into_iter().flat_map(u32::to_le_bytes));
    for (kind, chunk, fill) in [(JSON, json, b' '), (BIN, bin, 0)] {
        if kind == JSON || !chunk.is_empty() {
            out.extend([padded(chunk.len()) as u32, kind].into_iter().flat_map(u32::to_le_bytes));
            out.extend_from_slice(chunk);
            out.resize(padded(out.len()), fill);
        }
    }
    Ok(out)
}

/// What a URI stands for.
pub(super) enum Uri {
    /// Bytes that it holds itself.
    Data(Vec<u8>),
    /// A file, relative to the glTF file.
    File(String),
}

/// Reads a URI.
///
/// # Errors
/// Where it is neither data in base64 nor a relative path.
pub(super) fn uri(text: &str, at: &str) -> Result<Uri, GltfError> {
    if let Some(data) = text.strip_prefix("data:") {
        let payload = data.split_once(',').filter(|(head, _)| head.ends_with(";base64")).map(|(_, p)| p);
        let payload = payload.ok_or_else(|| malformed(at, "expected a data URI in base64, found another"))?;
        return from_base64(payload).map(Uri::Data).ok_or_else(|| malformed(at, "expected base64, found other characters or lengths"));
    }
    let path = percent_decoded(text).filter(|p| !p.is_empty() && !p.contains('\0'));
    let is_elsewhere = |p: &String| p.starts_with(['/', '\\']) || p.split(['/', '\\']).next().is_some_and(|first| first.contains(':'));
    match path {
        Some(path) if !is_elsewhere(&path) => Ok(Uri::File(path)),
        _ => Err(malformed(
            at,
            format!("expected data or a path relative to the file, found {:?}", text.chars().take(60).collect::<String>()),
        )),
    }
}

fn percent_decoded(text: &str) -> Option<String> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(byte) = bytes.next() {
        out.push(if byte == b'%' {
            let digit = |b: Option<u8>| b.and_then(|b| char::from(b).to_digit(16));
            (digit(bytes.next())? * 16 + digit(bytes.next())?) as u8
        } else {
            byte
        });
    }
    String::from_utf8(out).ok()
}

const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Bytes in base64.
pub(super) fn to_base64(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0u32, |n, b| n << 8 | u32::from(*b)) << (8 * (3 - group.len()));
        for i in 0..4 {
            let six = (bits >> (18 - 6 * i)) as usize & 63;
            out.push(if i > group.len() { '=' } else { char::from(ALPHABET[six]) });
        }
    }
    out
}

fn from_base64(text: &str) -> Option<Vec<u8>> {
    let digits = text.as_bytes();
    let digits = digits.strip_suffix(b"==").or_else(|| digits.strip_suffix(b"=")).unwrap_or(digits);
    let mut out = Vec::with_capacity(digits.len() / 4 * 3 + 3);
    for group in digits.chunks(4) {
        let mut bits = 0u32;
        for digit in group {
            let six = match digit {
                b'A'..=b'Z' => digit - b'A',
                b'a'..=b'z' => digit - b'a' + 26,
                b'0'..=b'9' => digit - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                _ => return None,
            };
            bits = bits << 6 | u32::from(six);
        }
        bits <<= 6 * (4 - group.len());
        let bytes = bits.to_be_bytes();
        match group.len() {
            1 => return None,
            n => out.extend_from_slice(&bytes[1..n]),
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_rfc_4648() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")] {
            assert_eq!(to_base64(plain.as_bytes()), coded);
            assert_eq!(from_base64(coded).as_deref(), Some(plain.as_bytes()));
        }
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(from_base64(&to_base64(&all)), Some(all));
        assert_eq!((from_base64("A"), from_base64("Zm9 ")), (None, None));
    }

    #[test]
    fn a_container_comes_apart_as_it_was_put_together() {
        for bin in [&b""[..], b"12345"] {
            let file = pack(b"{}", bin).unwrap();
            let (json, found) = open(&file).unwrap();
            assert_eq!((json, found.map(|b| &b[..bin.len()])), (&b"{}  "[..], (!bin.is_empty()).then_some(bin)));
        }
    }

    #[test]
    fn a_uri_leads_nowhere_else() {
        for (text, path) in [("a.bin", "a.bin"), ("a%20b/c.bin", "a b/c.bin"), ("../t.png", "../t.png")] {
            assert!(matches!(uri(text, "x").unwrap(), Uri::File(p) if p == path));
        }
        assert!(matches!(uri("data:application/octet-stream;base64,Zm8=", "x").unwrap(), Uri::Data(d) if d == b"fo"));
        for text in ["/etc/passwd", "http://x/y", "C:\\x", "", "%00", "%zz", "data:,a", "data:;base64,!"] {
            assert!(uri(text, "x").is_err(), "{text}");
        }
    }
}
