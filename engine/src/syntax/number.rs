//! The number literals of RON: where one ends, and whether it is one.
//!
//! The rules are those of `ron` 0.12.3 to the letter, quirks included, because a document that this module accepts is read by `ron`
//! later: underscores, base prefixes, type suffixes with their ranges, and integers too large for 64 bits that count as floats.

/// Why a number literal is not one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumberProblem {
    /// There are no digits where some are needed.
    NoDigits,
    /// A digit does not belong to the base, as in `0b12`.
    BadDigit,
    /// The value does not fit its suffix or 64 bits.
    OutOfRange,
    /// An underscore stands before any digit, or after the point.
    Underscore,
    /// The text is no float, as in `1.2.3`.
    BadFloat,
}

/// Whether a number may begin with the text: a digit, a sign, or a point that is not a range operator.
pub(super) fn starts_number(bytes: &[u8]) -> bool {
    match bytes.first() {
        Some(b'0'..=b'9' | b'+' | b'-') => true,
        Some(b'.') => bytes.get(1) != Some(&b'.'),
        _ => false,
    }
}

/// Whether the word is one of the float names that need no sign.
pub(super) fn is_float_word(word: &str) -> bool {
    matches!(word, "inf" | "inff32" | "inff64" | "NaN" | "NaNf32" | "NaNf64")
}

/// Length in bytes of the number at the start of `text`, which satisfies [`starts_number`]. O(length of the literal).
pub(super) fn scan(text: &str) -> Result<usize, NumberProblem> {
    if looks_like_float(text.as_bytes()) {
        return float(text);
    }
    match integer(text) {
        Ok(length) => Ok(length),
        // An integer that is too large, or that turns out to have an exponent or a float suffix, is read as a float.
        Err((problem, reached)) => match float(text) {
            Ok(length) if length >= reached => Ok(length),
            _ => Err(problem),
        },
    }
}

fn is_float_byte(byte: u8) -> bool {
    byte.is_ascii_digit() || matches!(byte, b'e' | b'E' | b'.' | b'+' | b'-' | b'_')
}

fn is_int_byte(byte: u8) -> bool {
    byte.is_ascii_hexdigit() || byte == b'_'
}

fn run(bytes: &[u8], belongs: fn(u8) -> bool) -> usize {
    bytes.iter().position(|&byte| !belongs(byte)).unwrap_or(bytes.len())
}

/// Length of the run of float characters, cut where a range operator begins.
fn float_run(bytes: &[u8]) -> usize {
    let length = run(bytes, is_float_byte);
    bytes[..length].windows(2).position(|pair| pair == b"..").unwrap_or(length)
}

fn looks_like_float(bytes: &[u8]) -> bool {
    let skip = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    let rest = &bytes[skip..];
    float_run(rest) > run(rest, is_int_byte)
}

/// Whether `text` begins with `word` and the word ends there.
fn has_word(text: &str, word: &str) -> bool {
    text.strip_prefix(word).is_some_and(|rest| !rest.chars().next().is_some_and(unicode_ident::is_xid_continue))
}

fn float(text: &str) -> Result<usize, NumberProblem> {
    for name in ["+inf", "-inf", "+NaN", "-NaN"] {
        if has_word(text, name) {
            return Ok(name.len());
        }
        if text.strip_prefix(name).is_some_and(|rest| has_word(rest, "f32") || has_word(rest, "f64")) {
            return Ok(name.len() + 3);
        }
    }
    let length = float_run(text.as_bytes());
    let (digits, rest) = (&text[..length], &text[length..]);
    if length == 0 || !is_float(digits)? {
        return Err(NumberProblem::BadFloat);
    }
    let suffix = if has_word(rest, "f32") || has_word(rest, "f64") { 3 } else { 0 };
    Ok(length + suffix)
}

/// Whether the digits are a float once the underscores, which must follow a digit or an exponent mark, are left out.
fn is_float(digits: &str) -> Result<bool, NumberProblem> {
    if !digits.contains('_') {
        return Ok(digits.parse::<f64>().is_ok());
    }
    let mut clean = String::with_capacity(digits.len());
    let mut may_underscore = false;
    for character in digits.chars() {
        match character {
            '_' if may_underscore => continue,
            '_' => return Err(NumberProblem::Underscore),
            '0'..='9' | 'e' | 'E' => may_underscore = true,
            '.' => may_underscore = false,
            _ => (),
        }
        clean.push(character);
    }
    Ok(clean.parse::<f64>().is_ok())
}

/// Suffix, largest value, and magnitude of the smallest value.
const SUFFIXES: [(&str, u128, u128); 8] = [
    ("i8", i8::MAX as u128, 1 << 7),
    ("i16", i16::MAX as u128, 1 << 15),
    ("i32", i32::MAX as u128, 1 << 31),
    ("i64", i64::MAX as u128, 1 << 63),
    ("u8", u8::MAX as u128, 0),
    ("u16", u16::MAX as u128, 0),
    ("u32", u32::MAX as u128, 0),
    ("u64", u64::MAX as u128, 0),
];

/// The error carries how far the reading came, which decides whether the float reading counts instead.
fn integer(text: &str) -> Result<usize, (NumberProblem, usize)> {
    let bytes = text.as_bytes();
    let negative = bytes.first() == Some(&b'-');
    let mut start = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    let base = match bytes.get(start..start + 2) {
        Some(b"0b") => 2,
        Some(b"0o") => 8,
        Some(b"0x") => 16,
        _ => 10,
    };
    if base != 10 {
        start += 2;
    }
    let length = run(&bytes[start..], is_int_byte);
    let end = start + length;
    let digits = &bytes[start..end];
    for (suffix, max, min) in SUFFIXES {
        if has_word(&text[end..], suffix) {
            return match check_digits(digits, base, if negative { min } else { max }) {
                Ok(()) => Ok(end + suffix.len()),
                Err((NumberProblem::BadDigit | NumberProblem::Underscore, at)) => Err((NumberProblem::BadDigit, start + at)),
                Err((problem, at)) => Err((problem, start + at + suffix.len())),
            };
        }
    }
    let limit = if negative { 1 << 63 } else { u128::from(u64::MAX) };
    check_digits(digits, base, limit).map(|()| end).map_err(|(problem, at)| (problem, start + at))
}

/// Whether the digits are of the base and their value is at most `limit`, with the offset at which reading stopped.
fn check_digits(digits: &[u8], base: u128, limit: u128) -> Result<(), (NumberProblem, usize)> {
    match digits.first() {
        None => return Err((NumberProblem::NoDigits, 0)),
        Some(b'_') => return Err((NumberProblem::Underscore, 0)),
        Some(_) => (),
    }
    let mut value = 0_u128;
    for (offset, &byte) in digits.iter().enumerate().filter(|(_, byte)| **byte != b'_') {
        // The value never exceeds 64 bits before this line, so that the product fits in 128.
        value *= base;
        if value > limit {
            return Err((NumberProblem::OutOfRange, digits.len()));
        }
        let digit = char::from(byte).to_digit(16).map_or(u128::MAX, u128::from);
        if digit >= base {
            return Err((NumberProblem::BadDigit, offset));
        }
        value += digit;
        if value > limit {
            return Err((NumberProblem::OutOfRange, digits.len()));
        }
    }
    Ok(())
}
