//! Escapes in strings and characters, and the way back from a string's value to its place in the source.

use std::borrow::Cow;

use crate::diag::Span;

/// Where an escape stands decides what it may say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EscapeIn {
    /// In `"..."`: bytes must build UTF-8, possibly over several escapes.
    Str,
    /// In `b"..."`: any byte, and Unicode escapes.
    ByteStr,
    /// In `'.'`: one ASCII byte or a Unicode escape.
    Char,
    /// In `b'.'`: one byte.
    Byte,
}

/// What one escape stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unescaped {
    /// A character.
    Char(char),
    /// A byte, in byte strings and byte literals alone.
    Byte(u8),
    /// Nothing: a backslash at the end of a line joins it to the next.
    Nothing,
}

/// Reads the escape at the start of `text`, which begins with a backslash: its length in bytes and what it stands for, or how many
/// bytes are wrong and why.
pub(super) fn read_escape(text: &str, place: EscapeIn) -> Result<(usize, Unescaped), (usize, &'static str)> {
    let bytes = text.as_bytes();
    let simple = |character| Ok((2, Unescaped::Char(character)));
    match bytes.get(1) {
        Some(b'\'') => simple('\''),
        Some(b'"') => simple('"'),
        Some(b'\\') => simple('\\'),
        Some(b'n') => simple('\n'),
        Some(b'r') => simple('\r'),
        Some(b't') => simple('\t'),
        Some(b'0') => simple('\0'),
        Some(b'x') if matches!(place, EscapeIn::Byte | EscapeIn::ByteStr) => {
            hex_byte(bytes, 2).map(|byte| (4, Unescaped::Byte(byte))).ok_or((2, "expected two hexadecimal digits after `\\x`"))
        }
        Some(b'x') => read_utf8_bytes(bytes, place),
        Some(b'u') if place == EscapeIn::Byte => Err((2, "expected a byte escape, found a Unicode escape")),
        Some(b'u') => read_unicode(bytes),
        Some(b'\n' | b'\r') if matches!(place, EscapeIn::Str | EscapeIn::ByteStr) => read_line_join(bytes),
        _ => {
            let length = text.chars().nth(1).map_or(1, |character| 1 + character.len_utf8());
            Err((length, "expected one of `\\\\`, `\\\"`, `\\'`, `\\n`, `\\r`, `\\t`, `\\0`, `\\x41`, `\\u{1F600}`"))
        }
    }
}

fn hex_byte(bytes: &[u8], at: usize) -> Option<u8> {
    let digit = |offset: usize| bytes.get(at + offset).and_then(|&byte| char::from(byte).to_digit(16));
    u8::try_from(digit(0)? * 16 + digit(1)?).ok()
}

/// One to four `\x` escapes that are the UTF-8 bytes of one character.
fn read_utf8_bytes(bytes: &[u8], place: EscapeIn) -> Result<(usize, Unescaped), (usize, &'static str)> {
    const WRONG: &str = "expected escaped bytes that are valid UTF-8";
    let mut found = [0_u8; 4];
    let most = if place == EscapeIn::Char { 1 } else { 4 };
    for count in 0..most {
        let at = 4 * count;
        if bytes.get(at..at + 2) != Some(b"\\x") {
            return Err((at, WRONG));
        }
        found[count] = hex_byte(bytes, at + 2).ok_or((at + 2, "expected two hexadecimal digits after `\\x`"))?;
        if let Some(character) = std::str::from_utf8(&found[..=count]).ok().and_then(|text| text.chars().next()) {
            return Ok((at + 4, Unescaped::Char(character)));
        }
    }
    Err((4 * most, WRONG))
}

/// `\u{...}` with one to six hexadecimal digits.
fn read_unicode(bytes: &[u8]) -> Result<(usize, Unescaped), (usize, &'static str)> {
    if bytes.get(2) != Some(&b'{') {
        return Err((2, "expected `{` after `\\u`"));
    }
    let digits = bytes[3..].iter().take(6).take_while(|byte| byte.is_ascii_hexdigit()).count();
    if digits == 0 {
        return Err((3, "expected one to six hexadecimal digits"));
    }
    let end = 3 + digits;
    if bytes.get(end) != Some(&b'}') {
        return Err((end, "expected `}` after one to six hexadecimal digits"));
    }
    let code = bytes[3..end].iter().fold(0, |code, &byte| code * 16 + char::from(byte).to_digit(16).unwrap_or(0));
    char::from_u32(code).map(|character| (end + 1, Unescaped::Char(character))).ok_or((end + 1, "expected a Unicode character"))
}

/// A backslash before a line's end takes away the end and all blanks that follow.
fn read_line_join(bytes: &[u8]) -> Result<(usize, Unescaped), (usize, &'static str)> {
    let line_end = match (bytes.get(1), bytes.get(2)) {
        (Some(b'\n'), _) => 2,
        (Some(b'\r'), Some(b'\n')) => 3,
        _ => return Err((2, "expected a line feed after the carriage return")),
    };
    let blanks = bytes[line_end..].iter().take_while(|byte| matches!(byte, b' ' | b'\t' | b'\n' | b'\r')).count();
    Ok((line_end + blanks, Unescaped::Nothing))
}

/// The value of a string literal, and where each of its bytes stands in the source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StrValue<'t> {
    value: Cow<'t, str>,
    /// Pairs of (offset in the value, offset in the source), ascending; between two pairs both offsets grow alike.
    anchors: Vec<(usize, usize)>,
    source_end: usize,
}

impl<'t> StrValue<'t> {
    /// The value with its escapes resolved; borrowed from the source where it has none.
    pub fn value(&self) -> &str {
        &self.value
    }

    /// The value, taken out.
    pub fn into_value(self) -> Cow<'t, str> {
        self.value
    }

    /// Byte offset in the source of the byte at `offset` in the value. Offsets past the end give the source's closing quote.
    /// O(log n) in the number of escapes.
    pub fn source_offset(&self, offset: usize) -> usize {
        if offset >= self.value.len() {
            return self.source_end;
        }
        let after = self.anchors.partition_point(|anchor| anchor.0 <= offset);
        let (value_at, source_at) = self.anchors.get(after.saturating_sub(1)).copied().unwrap_or((0, 0));
        (source_at + offset - value_at).min(self.source_end)
    }

    /// The source span of a byte range of the value, such as a reference inside a longer text.
    pub fn source_span(&self, range: std::ops::Range<usize>) -> Span {
        let start = self.source_offset(range.start);
        Span::new(start, self.source_offset(range.end.max(range.start)).max(start))
    }

    /// A raw string, or one without escapes, whose content starts at `start` in the source.
    pub(super) fn plain(content: &'t str, start: usize) -> Self {
        Self { value: Cow::Borrowed(content), anchors: vec![(0, start)], source_end: start + content.len() }
    }

    /// Resolves the escapes of a string's content that starts at `start` in the source. Wrong escapes are kept as written.
    pub(super) fn unescape(content: &'t str, start: usize) -> Self {
        if !content.contains('\\') {
            return Self::plain(content, start);
        }
        let mut value = String::with_capacity(content.len());
        let mut anchors = vec![(0, start)];
        let mut at = 0;
        while let Some(found) = content[at..].find('\\') {
            value.push_str(&content[at..at + found]);
            at += found;
            anchors.push((value.len(), start + at));
            let (length, unescaped) = read_escape(&content[at..], EscapeIn::Str).unwrap_or((1, Unescaped::Char('\\')));
            if let Unescaped::Char(character) = unescaped {
                value.push(character);
            }
            at += length;
            anchors.push((value.len(), start + at));
        }
        value.push_str(&content[at..]);
        Self { value: Cow::Owned(value), anchors, source_end: start + content.len() }
    }
}
