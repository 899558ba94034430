//! Positions, edits and names of files as editors count and write them.

use std::path::{Path, PathBuf};

use pegbar_engine::diag::Span;
use serde::{Deserialize, Serialize};

/// What a column counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Bytes.
    Utf8,
    /// Units of two bytes, as the protocol has it where nothing else is agreed.
    #[default]
    Utf16,
}

impl Encoding {
    /// Its name in the protocol.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Utf8 => "utf-8",
            Self::Utf16 => "utf-16",
        }
    }

    fn len(self, character: char) -> usize {
        match self {
            Self::Utf8 => character.len_utf8(),
            Self::Utf16 => character.len_utf16(),
        }
    }
}

/// A place between two characters; both numbers start at 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
pub(super) struct Position {
    pub(super) line: usize,
    pub(super) character: usize,
}

/// From one position to another, the end excluded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub(super) struct Range {
    pub(super) start: Position,
    pub(super) end: Position,
}

/// Where the lines of a text start. Lines end with `\n`, `\r\n` or `\r`.
#[derive(Clone, Debug)]
pub(super) struct Lines(Vec<usize>);

impl Lines {
    /// O(n).
    pub(super) fn of(text: &str) -> Self {
        let bytes = text.as_bytes();
        let ends = bytes.iter().enumerate().filter(|&(i, &b)| b == b'\n' || b == b'\r' && bytes.get(i + 1) != Some(&b'\n'));
        Self(std::iter::once(0).chain(ends.map(|(i, _)| i + 1)).collect())
    }

    /// The text of a line, without its end.
    fn line<'t>(&self, text: &'t str, line: usize) -> &'t str {
        let start = self.0.get(line).copied().unwrap_or(text.len());
        let end = self.0.get(line + 1).copied().unwrap_or(text.len());
        text.get(start..end).unwrap_or_default().trim_end_matches(['\n', '\r'])
    }

    /// The position of a byte offset, which is clamped to the text and to whole characters.
    pub(super) fn position(&self, text: &str, offset: usize, encoding: Encoding) -> Position {
        let mut offset = offset.min(text.len());
        while !text.is_char_boundary(offset) {
            offset -= 1;
        }
        let line = self.0.partition_point(|&start| start <= offset).saturating_sub(1);
        let start = self.0.get(line).copied().unwrap_or(0);
        Position { line, character: text[start..offset].chars().map(|c| encoding.len(c)).sum() }
    }

    /// The byte offset of a position, clamped to the text, the line and whole characters.
    pub(super) fn offset(&self, text: &str, position: Position, encoding: Encoding) -> usize {
        let Some(&start) = self.0.get(position.line) else { return text.len() };
        let mut units = 0;
        for (at, character) in self.line(text, position.line).char_indices() {
            units += encoding.len(character);
            if units > position.character {
                return start + at;
            }
        }
        start + self.line(text, position.line).len()
    }

    pub(super) fn range(&self, text: &str, span: Span, encoding: Encoding) -> Range {
        Range { start: self.position(text, span.start, encoding), end: self.position(text, span.end, encoding) }
    }
}

/// One change of an open document: a range with what stands there now, or all of the text.
#[derive(Debug, Deserialize)]
pub(super) struct Change {
    #[serde(default)]
    pub(super) range: Option<Range>,
    pub(super) text: String,
}

/// The text after a change.
pub(super) fn changed(text: &str, change: Change, encoding: Encoding) -> String {
    let Some(range) = change.range else { return change.text };
    let lines = Lines::of(text);
    let start = lines.offset(text, range.start, encoding);
    let end = lines.offset(text, range.end, encoding).max(start);
    [&text[..start], &change.text, &text[end..]].concat()
}

/// The smallest single edit between two texts: the bytes that go, and what comes.
pub(super) fn difference<'n>(old: &str, new: &'n str) -> (Span, &'n str) {
    let same = |pair: &(char, char)| pair.0 == pair.1;
    let before: usize = old.chars().zip(new.chars()).take_while(same).map(|(c, _)| c.len_utf8()).sum();
    let after: usize = old[before..].chars().rev().zip(new[before..].chars().rev()).take_while(same).map(|(c, _)| c.len_utf8()).sum();
    (Span::new(before, old.len() - after), &new[before..new.len() - after])
}

/// The path of a `file:` URI; `None` for another.
pub(super) fn path_of(uri: &str) -> Option<PathBuf> {
    let rest = uri.strip_prefix("file://")?;
    // An authority is this machine, or one that is reached by `//server/share`.
    let (authority, path) = rest.split_at(rest.find('/')?);
    let path = String::from_utf8(decoded(path)).ok()?;
    let is_drive = path.as_bytes().get(2) == Some(&b':') && path.as_bytes().get(1).is_some_and(u8::is_ascii_alphabetic);
    let path = if is_drive && cfg!(windows) { &path[1..] } else { &path };
    Some(match authority {
        "" | "localhost" => PathBuf::from(path),
        server => PathBuf::from(format!("//{server}{path}")),
    })
}

fn decoded(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        let hex = text.get(at + 1..at + 3).filter(|_| byte == b'%').and_then(|h| u8::from_str_radix(h, 16).ok());
        out.push(hex.unwrap_or(byte));
        at += if hex.is_some() { 3 } else { 1 };
    }
    out
}

/// The `file:` URI of an absolute path.
pub(super) fn uri_of(path: &Path) -> String {
    let path = path.to_string_lossy().replace(std::path::MAIN_SEPARATOR, "/");
    let mut out = String::from(if path.starts_with('/') { "file://" } else { "file:///" });
    for byte in path.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => out.push(char::from(byte)),
            _ => out.push_str(&format!("%{byte:02X}")),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "a𝄞é\r\n\rb\n";

    fn at(line: usize, character: usize) -> Position {
        Position { line, character }
    }

    #[test]
    fn columns_count_units_of_what_was_agreed() {
        let lines = Lines::of(TEXT);
        let there = |encoding| [0, 1, 5, 7, 9, 10, 11, 12].map(|o| lines.position(TEXT, o, encoding));
        assert_eq!(there(Encoding::Utf16), [at(0, 0), at(0, 1), at(0, 3), at(0, 4), at(1, 0), at(2, 0), at(2, 1), at(3, 0)]);
        assert_eq!(there(Encoding::Utf8), [at(0, 0), at(0, 1), at(0, 5), at(0, 7), at(1, 0), at(2, 0), at(2, 1), at(3, 0)]);
        for encoding in [Encoding::Utf8, Encoding::Utf16] {
            for (offset, _) in TEXT.char_indices().filter(|(o, _)| *o != 8) {
                assert_eq!(lines.offset(TEXT, lines.position(TEXT, offset, encoding), encoding), offset, "{encoding:?}");
            }
        }
    }

    #[test]
    fn positions_beyond_the_text_are_clamped() {
        let lines = Lines::of(TEXT);
        let offset = |line, character| lines.offset(TEXT, at(line, character), Encoding::Utf16);
        assert_eq!([offset(0, 99), offset(0, 2), offset(9, 0), offset(3, 5)], [7, 1, 12, 12], "inside a character is before it");
        assert_eq!(lines.position(TEXT, 99, Encoding::Utf16), at(3, 0));
        assert_eq!(lines.position(TEXT, 3, Encoding::Utf16), at(0, 1));
    }

    #[test]
    fn changes_are_applied_at_their_place() {
        let change = |a: Position, b: Position, text: &str| Change { range: Some(Range { start: a, end: b }), text: text.to_owned() };
        assert_eq!(changed(TEXT, change(at(0, 1), at(0, 3), "x"), Encoding::Utf16), "axé\r\n\rb\n");
        assert_eq!(changed(TEXT, change(at(0, 1), at(0, 5), "x"), Encoding::Utf8), "axé\r\n\rb\n");
        assert_eq!(changed(TEXT, change(at(2, 1), at(0, 0), "x"), Encoding::Utf16), "a𝄞é\r\n\rbx\n", "an end before its start");
        assert_eq!(changed(TEXT, Change { range: None, text: "new".to_owned() }, Encoding::Utf16), "new");
    }

    #[test]
    fn a_difference_is_small_and_whole() {
        for (old, new, expected) in [
            ("abc", "abc", (3..3, "")),
            ("abc", "axc", (1..2, "x")),
            ("aa", "aaa", (2..2, "a")),
            ("é", "è", (0..2, "è")),
            ("", "x", (0..0, "x")),
        ] {
            let (span, text) = difference(old, new);
            assert_eq!((span.range(), text), expected, "{old} {new}");
            assert_eq!([&old[..span.start], text, &old[span.end..]].concat(), new);
        }
    }

    #[cfg(unix)]
    #[test]
    fn names_of_files_go_both_ways() {
        for path in ["/show/hat.ron", "/a b/ö%#?.ron", "/"] {
            assert_eq!(path_of(&uri_of(Path::new(path))), Some(PathBuf::from(path)), "{}", uri_of(Path::new(path)));
        }
        assert_eq!(uri_of(Path::new("/a b/é.ron")), "file:///a%20b/%C3%A9.ron");
        assert_eq!(path_of("file://localhost/x%2fy"), Some(PathBuf::from("/x/y")));
        assert_eq!(path_of("file:///100%"), Some(PathBuf::from("/100%")));
        assert_eq!((path_of("untitled:Untitled-1"), path_of("file://nowhere")), (None, None));
    }
}
