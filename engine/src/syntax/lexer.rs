//! Cuts a RON text into tokens that cover every byte of it, whatever it holds.

use super::SyntaxError;
use super::code;
use super::escape::{EscapeIn, Unescaped, read_escape};
use super::number::{self, NumberProblem};
use crate::diag::Span;

/// What a token is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum TokenKind {
    /// Blanks and line ends.
    Whitespace,
    /// `// ...` without its line end.
    LineComment,
    /// `/* ... */`, nested.
    BlockComment,
    /// A name; `true`, `Some` and `inf` are names too until they are used as values.
    Ident,
    /// `r#name`, which may hold `.`, `+` and `-`.
    RawIdent,
    /// An integer or a float, with its sign and suffix.
    Number,
    /// `b'.'`.
    Byte,
    /// `'.'`.
    Char,
    /// `"..."`.
    String,
    /// `r"..."` or `r#"..."#`.
    RawString,
    /// `b"..."`.
    ByteString,
    /// `br"..."` or `br#"..."#`.
    RawByteString,
    /// `(`.
    LParen,
    /// `)`.
    RParen,
    /// `[`.
    LBracket,
    /// `]`.
    RBracket,
    /// `{`.
    LBrace,
    /// `}`.
    RBrace,
    /// `,`.
    Comma,
    /// `:`.
    Colon,
    /// `..`.
    DotDot,
    /// `..=`.
    DotDotEq,
    /// `#`.
    Hash,
    /// `!`.
    Bang,
    /// `=`.
    Eq,
    /// Characters that begin nothing.
    Unknown,
}

impl TokenKind {
    /// Whether the token is a blank or a comment.
    pub fn is_trivia(self) -> bool {
        matches!(self, Self::Whitespace | Self::LineComment | Self::BlockComment)
    }

    /// Whether the token is a comment.
    pub fn is_comment(self) -> bool {
        matches!(self, Self::LineComment | Self::BlockComment)
    }
}

/// A token; it ends where the next one starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Token {
    pub(super) kind: TokenKind,
    pub(super) start: u32,
}

/// The tokens of a text, and what is wrong with them.
pub(super) struct Lexed {
    pub(super) tokens: Vec<Token>,
    pub(super) errors: Vec<SyntaxError>,
    /// Where a string without an end starts.
    pub(super) unterminated: Option<usize>,
    /// The first plain string over several lines.
    pub(super) first_long_string: Option<usize>,
}

/// Cuts `text`, which is shorter than 4 GiB, into tokens. O(n).
pub(super) fn lex(text: &str) -> Lexed {
    lex_short(text, usize::MAX)
}

/// As [`lex`], but a string that starts at `short_strings_from` or later ends with its line, as when its closing quote is missing.
pub(super) fn lex_short(text: &str, short_strings_from: usize) -> Lexed {
    let mut lexer = Lexer::new(text, short_strings_from);
    lexer.run();
    let Lexer { tokens, errors, unterminated, first_long_string, .. } = lexer;
    Lexed { tokens, errors, unterminated, first_long_string }
}

struct Lexer<'t> {
    text: &'t str,
    at: usize,
    tokens: Vec<Token>,
    errors: Vec<SyntaxError>,
    /// Where a string without an end starts.
    unterminated: Option<usize>,
    /// The first plain string over several lines.
    first_long_string: Option<usize>,
    /// From this offset on, a string may not run over a line's end.
    short_strings_from: usize,
}

impl<'t> Lexer<'t> {
    fn new(text: &'t str, short_strings_from: usize) -> Self {
        let tokens = Vec::with_capacity(text.len() / 4 + 1);
        Self { text, at: 0, tokens, errors: Vec::new(), unterminated: None, first_long_string: None, short_strings_from }
    }

    fn run(&mut self) {
        while self.at < self.text.len() {
            let start = self.at;
            let kind = self.next_kind();
            // Progress is certain: every branch below consumes at least one byte, and this line makes it so.
            self.at = self.at.clamp(start + 1, self.text.len());
            while !self.text.is_char_boundary(self.at) {
                self.at += 1;
            }
            let merges = kind == TokenKind::Unknown && self.tokens.last().is_some_and(|last| last.kind == kind);
            if merges {
                self.extend_unknown_error();
            } else {
                self.tokens.push(Token { kind, start: u32::try_from(start).unwrap_or(u32::MAX) });
                if kind == TokenKind::Unknown {
                    self.report_unknown(start);
                }
            }
        }
    }

    fn rest(&self) -> &'t str {
        &self.text[self.at..]
    }

    fn byte(&self, ahead: usize) -> Option<u8> {
        self.text.as_bytes().get(self.at + ahead).copied()
    }

    fn error(&mut self, error: SyntaxError) {
        self.errors.push(error);
    }

    fn next_kind(&mut self) -> TokenKind {
        let Some(byte) = self.byte(0) else { return TokenKind::Unknown };
        match byte {
            b' ' | b'\t' | b'\n' | b'\r' | 0x0B | 0x0C => self.whitespace(),
            b'"' => self.string(1, EscapeIn::Str, TokenKind::String),
            b'\'' => self.character(1, EscapeIn::Char, TokenKind::Char),
            b'/' => self.comment(),
            b'(' => self.punctuation(1, TokenKind::LParen),
            b')' => self.punctuation(1, TokenKind::RParen),
            b'[' => self.punctuation(1, TokenKind::LBracket),
            b']' => self.punctuation(1, TokenKind::RBracket),
            b'{' => self.punctuation(1, TokenKind::LBrace),
            b'}' => self.punctuation(1, TokenKind::RBrace),
            b',' => self.punctuation(1, TokenKind::Comma),
            b':' => self.punctuation(1, TokenKind::Colon),
            b'#' => self.punctuation(1, TokenKind::Hash),
            b'!' => self.punctuation(1, TokenKind::Bang),
            b'=' => self.punctuation(1, TokenKind::Eq),
            b'.' if self.byte(1) == Some(b'.') && self.byte(2) == Some(b'=') => self.punctuation(3, TokenKind::DotDotEq),
            b'.' if self.byte(1) == Some(b'.') => self.punctuation(2, TokenKind::DotDot),
            _ if number::starts_number(self.rest().as_bytes()) => self.number(),
            b'b' | b'r' => self.prefixed(),
            _ => self.word_or_other(),
        }
    }

    fn punctuation(&mut self, length: usize, kind: TokenKind) -> TokenKind {
        self.at += length;
        kind
    }

    fn whitespace(&mut self) -> TokenKind {
        let blank = |character: char| {
            matches!(character, ' ' | '\t' | '\n' | '\r' | '\x0B' | '\x0C' | '\u{85}' | '\u{200E}' | '\u{200F}' | '\u{2028}' | '\u{2029}')
        };
        let rest = self.rest();
        self.at += rest.find(|character| !blank(character)).unwrap_or(rest.len());
        TokenKind::Whitespace
    }

    fn comment(&mut self) -> TokenKind {
        match self.byte(1) {
            Some(b'/') => {
                self.at += self.rest().find('\n').unwrap_or(self.rest().len());
                TokenKind::LineComment
            }
            Some(b'*') => self.block_comment(),
            _ => self.punctuation(1, TokenKind::Unknown),
        }
    }

    fn block_comment(&mut self) -> TokenKind {
        let start = self.at;
        let bytes = self.text.as_bytes();
        let mut depth = 1_usize;
        self.at += 2;
        while depth > 0 {
            match bytes.get(self.at..self.at + 2) {
                Some(b"/*") => (depth, self.at) = (depth + 1, self.at + 2),
                Some(b"*/") => (depth, self.at) = (depth - 1, self.at + 2),
                Some(_) => self.at += 1,
                None => {
                    self.at = self.text.len();
                    let span = Span::new(start, start + 2);
                    let error = SyntaxError::new(code::UNCLOSED_COMMENT, span, "unclosed block comment");
                    self.error(error.expected("`*/`").found("the end of the file"));
                    break;
                }
            }
        }
        TokenKind::BlockComment
    }

    /// Names, and the literals that begin with `b` or `r`.
    fn prefixed(&mut self) -> TokenKind {
        let bytes = self.rest().as_bytes();
        match (bytes[0], bytes.get(1), bytes.get(2)) {
            (b'b', Some(b'"'), _) => self.string(2, EscapeIn::ByteStr, TokenKind::ByteString),
            (b'b', Some(b'\''), _) => self.character(2, EscapeIn::Byte, TokenKind::Byte),
            (b'b', Some(b'r'), Some(b'"' | b'#')) => self.raw_string(2, TokenKind::RawByteString),
            (b'r', Some(b'"'), _) | (b'r', Some(b'#'), Some(b'"' | b'#')) => self.raw_string(1, TokenKind::RawString),
            (b'r', Some(b'#'), _) => self.raw_ident(),
            _ => self.word_or_other(),
        }
    }

    fn raw_ident(&mut self) -> TokenKind {
        let name = &self.rest()[2..];
        let belongs = |character: char| matches!(character, '.' | '+' | '-') || unicode_ident::is_xid_continue(character);
        let length = name.find(|character| !belongs(character)).unwrap_or(name.len());
        self.at += 2 + length;
        if length == 0 {
            let span = Span::new(self.at - 2, self.at);
            let error = SyntaxError::new(code::BAD_IDENTIFIER, span, "`r#` begins neither a name nor a string");
            self.error(error.expected("a name or `\"`"));
        }
        TokenKind::RawIdent
    }

    fn word_or_other(&mut self) -> TokenKind {
        let rest = self.rest();
        let first = rest.chars().next().unwrap_or('\0');
        if first == '_' || unicode_ident::is_xid_start(first) {
            self.at += rest.find(|character| !unicode_ident::is_xid_continue(character)).unwrap_or(rest.len());
            return TokenKind::Ident;
        }
        let before = self.at;
        self.whitespace();
        if self.at > before {
            return TokenKind::Whitespace;
        }
        self.punctuation(first.len_utf8(), TokenKind::Unknown)
    }

    fn report_unknown(&mut self, start: usize) {
        let found = self.text[start..self.at].chars().next().unwrap_or('\0');
        let message = format!("unexpected character {found:?}");
        let mut error = SyntaxError::new(code::UNEXPECTED_CHARACTER, Span::new(start, self.at), message);
        error = match found {
            '/' => error.help("a comment is written `// ...` or `/* ... */`"),
            '\u{FEFF}' => error.help("remove the byte order mark; graph files are UTF-8 without it"),
            '\u{201C}' | '\u{201D}' | '\u{201E}' => error.help("strings are written with straight quotes, `\"`"),
            ';' => error.help("fields and entries are separated by `,`"),
            '@' | '$' => error.help("references are written in quotes, as in `\"@node.port\"`"),
            _ => error,
        };
        self.error(error);
    }

    /// Characters that begin nothing are one token, so that a run of them is one error.
    fn extend_unknown_error(&mut self) {
        let end = self.at;
        if let Some(error) = self.errors.last_mut() {
            error.span.end = end;
        }
    }

    fn number(&mut self) -> TokenKind {
        let start = self.at;
        let problem = match number::scan(self.rest()) {
            Ok(length) => {
                self.at += length;
                let glued = self.rest().chars().next().is_some_and(unicode_ident::is_xid_continue);
                glued.then_some(NumberProblem::BadDigit)
            }
            Err(problem) => Some(problem),
        };
        if let Some(problem) = problem {
            self.at = start + number_like_length(&self.text[start..]);
            self.report_number(Span::new(start, self.at), problem);
        }
        TokenKind::Number
    }

    fn report_number(&mut self, span: Span, problem: NumberProblem) {
        let found = &self.text[span.range()];
        let message = match problem {
            NumberProblem::OutOfRange => "the number does not fit its type",
            NumberProblem::Underscore => "an underscore may only follow a digit",
            NumberProblem::NoDigits | NumberProblem::BadDigit | NumberProblem::BadFloat => "this is not a number",
        };
        let error = SyntaxError::new(code::BAD_NUMBER, span, message);
        self.error(error.expected("a number such as `12`, `-0.5`, `1e-3` or `0xff`").found(format!("`{found}`")));
    }

    fn character(&mut self, prefix: usize, place: EscapeIn, kind: TokenKind) -> TokenKind {
        let start = self.at;
        match self.scan_character(prefix, place) {
            Ok(length) => self.at += length,
            Err(message) => {
                self.at += prefix + self.character_guess(prefix);
                let error = SyntaxError::new(code::BAD_CHARACTER, Span::new(start, self.at), message);
                self.error(error.help("text of more than one character is a string, written with `\"`"));
            }
        }
        kind
    }

    fn scan_character(&self, prefix: usize, place: EscapeIn) -> Result<usize, &'static str> {
        let content = &self.rest()[prefix..];
        let length = match content.chars().next() {
            None => return Err("unterminated character literal"),
            Some('\\') => match read_escape(content, place) {
                Ok((length, unescaped)) if unescaped != Unescaped::Nothing => length,
                Ok(_) => return Err("a character literal stays on its line"),
                Err((_, message)) => return Err(message),
            },
            Some(character) if place == EscapeIn::Byte && !character.is_ascii() => return Err("a byte literal holds one ASCII character"),
            Some(character) => character.len_utf8(),
        };
        match content.as_bytes().get(length) {
            Some(b'\'') => Ok(prefix + length + 1),
            _ => Err("a character literal holds exactly one character"),
        }
    }

    /// How much of a wrong character literal to take: up to a quote on the same line, or what looks like a word.
    fn character_guess(&self, prefix: usize) -> usize {
        let content = &self.rest()[prefix..];
        let line = &content[..content.find('\n').unwrap_or(content.len())];
        match line.find('\'') {
            Some(quote) => quote + 1,
            None => line.find(|character| !unicode_ident::is_xid_continue(character)).unwrap_or(line.len()),
        }
    }

    fn raw_string(&mut self, prefix: usize, kind: TokenKind) -> TokenKind {
        let start = self.at;
        let rest = &self.rest()[prefix..];
        let hashes = rest.bytes().take_while(|&byte| byte == b'#').count();
        let Some(content) = rest[hashes..].strip_prefix('"') else {
            self.at += prefix + hashes;
            let error = SyntaxError::new(code::BAD_IDENTIFIER, Span::new(start, self.at), "a raw string needs a quote after its `#`");
            self.error(error.expected("`\"`"));
            return kind;
        };
        let ending = format!("\"{}", &rest[..hashes]);
        match content.find(&ending) {
            Some(length) => self.at += prefix + hashes + 1 + length + ending.len(),
            None => {
                let span = Span::new(start, start + prefix + hashes + 1);
                self.at = self.text.len();
                let error = SyntaxError::new(code::UNTERMINATED_STRING, span, "unterminated raw string");
                self.error(error.expected(format!("`{ending}`")).found("the end of the file"));
            }
        }
        kind
    }

    fn string(&mut self, prefix: usize, place: EscapeIn, kind: TokenKind) -> TokenKind {
        let start = self.at;
        let n_errors = self.errors.len();
        self.at += prefix;
        let bytes = self.text.as_bytes();
        let mut is_long = false;
        loop {
            match bytes.get(self.at) {
                Some(b'"') => {
                    self.at += 1;
                    break;
                }
                Some(b'\\') => self.string_escape(place),
                Some(b'\n') if start >= self.short_strings_from => {
                    self.errors.truncate(n_errors);
                    self.unterminated_line(start);
                    break;
                }
                Some(&byte) => {
                    is_long |= byte == b'\n';
                    self.at += 1;
                }
                None => {
                    self.errors.truncate(n_errors);
                    self.report_unterminated(Span::new(start, start + prefix));
                    break;
                }
            }
        }
        if is_long && self.first_long_string.is_none() {
            self.first_long_string = Some(start);
        }
        kind
    }

    fn string_escape(&mut self, place: EscapeIn) {
        match read_escape(self.rest(), place) {
            Ok((length, _)) => self.at += length,
            Err((length, message)) => {
                let after = self.rest().chars().nth(1).map_or(1, |character| 1 + character.len_utf8());
                let end = floor_boundary(self.text, self.at + length.max(1)).max(self.at + after.min(2));
                let span = Span::new(self.at, floor_boundary(self.text, end));
                self.at += after;
                let error = SyntaxError::new(code::BAD_ESCAPE, span, "unknown or incomplete escape");
                self.error(
                    error.expected(message.trim_start_matches("expected ")).help("write a backslash as `\\\\`, or use `/` in paths"),
                );
            }
        }
    }

    fn report_unterminated(&mut self, span: Span) {
        // Only the first is reported: what follows a missing quote is read inside out.
        if self.unterminated.is_none() {
            self.unterminated = Some(span.start);
            let error = SyntaxError::new(code::UNTERMINATED_STRING, span, "unterminated string");
            self.error(error.expected("`\"`"));
        }
    }

    /// Ends a string at its line's end, leaving out the punctuation that most likely came after the missing quote.
    fn unterminated_line(&mut self, start: usize) {
        let line = &self.text[start + 1..self.at];
        let content = line.trim_end_matches(|character: char| character.is_whitespace() || matches!(character, ',' | ')' | ']' | '}'));
        self.at = start + 1 + content.len();
        self.report_unterminated(Span::new(start, self.at));
    }
}

fn floor_boundary(text: &str, offset: usize) -> usize {
    let mut at = offset.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// The run of characters that someone who meant a number may have typed.
fn number_like_length(text: &str) -> usize {
    let run = text
        .find(|character: char| !matches!(character, '.' | '+' | '-') && !unicode_ident::is_xid_continue(character))
        .unwrap_or(text.len());
    // A range's operator is not part of its first number, unless nothing comes before it.
    text[..run].find("..").filter(|&at| at > 0).unwrap_or(run).max(1)
}
