//! Words of a text file, and where they stand: what readers of line-based formats share.

use thiserror::Error;

/// What is wrong with a text, and where.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("line {line}, column {column}: expected {expected}, found {found}")]
pub struct TextError {
    /// The line, from 1.
    pub line: usize,
    /// The character of the line, from 1.
    pub column: usize,
    /// What should stand there.
    pub expected: String,
    /// What does.
    pub found: String,
}

/// A word of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word<'a> {
    /// Its characters; none at the end of the text.
    pub text: &'a str,
    /// The line that it stands in, from 1.
    pub line: usize,
    /// Its first character, in bytes from the start of the text.
    at: usize,
    /// The start of its line, in bytes from the start of the text.
    line_start: usize,
}

impl<'a> Word<'a> {
    /// Its parts between white space.
    pub fn split(self) -> impl Iterator<Item = Self> {
        let text = self.text;
        // Each part lies within the text, so that its place is the difference of their starts.
        let part = move |p: &'a str| Self { text: p, at: self.at + (p.as_ptr() as usize - text.as_ptr() as usize), ..self };
        text.split_whitespace().map(part)
    }

    /// Its last `length` bytes, where they start.
    #[must_use]
    pub fn end(self, length: usize) -> Self {
        let start = self.text.len().saturating_sub(length);
        Self { text: self.text.get(start..).unwrap_or_default(), at: self.at + start, ..self }
    }

    /// True past the end of the text.
    pub fn is_end(&self) -> bool {
        self.text.is_empty()
    }

    /// True where it is `word`, in capitals or not.
    pub fn is(&self, word: &str) -> bool {
        self.text.eq_ignore_ascii_case(word)
    }
}

/// Reads a text word by word. Words are parted by white space, and marks stand for themselves; lines end in LF, CR LF or CR.
#[derive(Clone, Debug)]
pub struct Words<'a> {
    text: &'a str,
    marks: &'static [char],
    at: usize,
    line: usize,
    line_start: usize,
}

impl<'a> Words<'a> {
    /// The words of `text`; each of `marks` is a word of its own, wherever it stands.
    pub fn new(text: &'a str, marks: &'static [char]) -> Self {
        // A byte order mark is no word.
        let at = if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 };
        Self { text, marks, at, line: 1, line_start: at }
    }

    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or_default()
    }

    /// Goes on to the next word, over the ends of lines too where `lines`.
    fn skip(&mut self, lines: bool) {
        while let Some(c) = self.rest().chars().next().filter(|c| c.is_whitespace() && (lines || !matches!(c, '\n' | '\r'))) {
            self.at += c.len_utf8();
            if c == '\n' || c == '\r' && !self.rest().starts_with('\n') {
                self.line += 1;
                self.line_start = self.at;
            }
        }
    }

    fn word(&self, text: &'a str) -> Word<'a> {
        Word { text, line: self.line, at: self.at, line_start: self.line_start }
    }

    fn take(&mut self, length: usize) -> Word<'a> {
        let word = self.word(self.rest().get(..length).unwrap_or_default());
        self.at += word.text.len();
        word
    }

    /// The next word, in whichever line; an empty one at the end of the text.
    pub fn next_word(&mut self) -> Word<'a> {
        self.skip(true);
        let rest = self.rest();
        let mark = rest.chars().next().filter(|c| self.marks.contains(c));
        let end = rest.find(|c: char| c.is_whitespace() || self.marks.contains(&c)).unwrap_or(rest.len());
        self.take(mark.map_or(end, char::len_utf8))
    }

    /// What [`Words::next_word`] will give.
    pub fn peek(&self) -> Word<'a> {
        self.clone().next_word()
    }

    /// What is left of the line, without white space at its ends, up to the first mark.
    pub fn rest_of_line(&mut self) -> Word<'a> {
        self.skip(false);
        let rest = self.rest();
        let end = rest.find(|c: char| matches!(c, '\n' | '\r') || self.marks.contains(&c)).unwrap_or(rest.len());
        self.take(rest[..end].trim_end().len())
    }

    /// The next line that is not blank, without white space at its ends, up to the first mark.
    pub fn line(&mut self) -> Word<'a> {
        self.skip(true);
        self.rest_of_line()
    }

    /// The next word where it is a finite number.
    ///
    /// # Errors
    /// Where it is none.
    pub fn number(&mut self) -> Result<f64, TextError> {
        let word = self.next_word();
        self.parsed(word)
    }

    /// A word as a finite number.
    ///
    /// # Errors
    /// Where it is none.
    pub fn parsed(&self, word: Word) -> Result<f64, TextError> {
        word.text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| self.error(word, "a number"))
    }

    /// The error that `word` stands where something else should.
    pub fn error(&self, word: Word, expected: impl Into<String>) -> TextError {
        let found = if word.is_end() && word.at >= self.text.len() { "the end of the file".to_owned() } else { shown(word.text) };
        self.error_at(word, expected, found)
    }

    /// An error at `word`.
    pub fn error_at(&self, word: Word, expected: impl Into<String>, found: impl Into<String>) -> TextError {
        let before = self.text.get(word.line_start..word.at).unwrap_or_default();
        TextError { line: word.line, column: before.chars().count() + 1, expected: expected.into(), found: found.into() }
    }
}

/// A word in quotes, cut where it is long.
fn shown(text: &str) -> String {
    let short: String = text.chars().take(40).collect();
    if text.is_empty() {
        "the end of the line".to_owned()
    } else if short.len() < text.len() {
        format!("`{short}...`")
    } else {
        format!("`{short}`")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_stand_where_they_stand() {
        let mut words = Words::new("\u{feff}a  b{c\r\n\té 1.5\rlast one \n", &['{', '}']);
        let at = |words: &Words, w: Word| {
            let e = words.error(w, "x");
            (w.text.to_owned(), e.line, e.column)
        };
        for truth in [("a", 1, 1), ("b", 1, 4), ("{", 1, 5), ("c", 1, 6), ("é", 2, 2)] {
            let word = words.next_word();
            let (text, line, column) = at(&words, word);
            assert_eq!((text.as_str(), line, column), truth);
        }
        assert_eq!(words.number(), Ok(1.5));
        assert_eq!(words.rest_of_line().text, "");
        assert_eq!(words.peek().text, "last");
        assert_eq!(words.next_word().line, 3);
        assert_eq!(words.rest_of_line().text, "one");
        let end = words.next_word();
        assert!(end.is_end());
        assert_eq!(words.error(end, "more").to_string(), "line 4, column 1: expected more, found the end of the file");
    }

    #[test]
    fn what_is_no_number_is_said() {
        for text in ["nan", "inf", "1e999", "1,5", "x"] {
            let error = Words::new(text, &[]).number().unwrap_err();
            assert_eq!(error.to_string(), format!("line 1, column 1: expected a number, found `{text}`"));
        }
        assert!(Words::new(&"9x".repeat(99), &[]).number().unwrap_err().to_string().ends_with("9x...`"));
    }
}
