//! Builds the tree: recursive descent over the tokens, going on after every error.
//!
//! Where a bracket is missing, the brackets around it and the shape of what follows decide where it should have been, so that one slip
//! gives one error. Nesting is bounded by the same count that `ron` keeps.

mod items;
mod values;

use super::code;
use super::lexer::{Lexed, Token, TokenKind, lex, lex_short};
use super::tree::{NodeData, NodeKind};
use super::{Extensions, SyntaxError};
use crate::diag::Span;

/// Nested reads that `ron` allows by default: a list in a list costs two, a struct in a map costs two.
const MAX_DEPTH: u32 = 128;

/// The largest source that is read, 1 GiB: offsets are kept in 32 bits.
const MAX_SOURCE_BYTES: usize = 1 << 30;

/// What [`parse`] gives.
pub(super) struct Parsed {
    pub(super) tokens: Vec<Token>,
    pub(super) nodes: Vec<NodeData>,
    pub(super) errors: Vec<SyntaxError>,
    pub(super) extensions: Extensions,
}

/// Parses a whole text. O(n) time and memory.
pub(super) fn parse(text: &str) -> Parsed {
    if text.len() > MAX_SOURCE_BYTES {
        return refuse_large();
    }
    let lexed = lex(text);
    // A quote that was left out makes every later string start where one should end, until the last one has no end. The culprit is
    // either that last one or the first that runs over a line's end: whichever leaves fewer errors when it ends with its line.
    let suspects = lexed.unterminated.map(|last| [Some(last), lexed.first_long_string]);
    let readings = suspects.into_iter().flatten().flatten().map(|from| read_tokens(text, lex_short(text, from)));
    match readings.min_by_key(|reading| reading.errors.len()) {
        Some(reading) => reading,
        None => read_tokens(text, lexed),
    }
}

/// Builds the tree of a text's tokens.
fn read_tokens(text: &str, lexed: Lexed) -> Parsed {
    let Lexed { tokens, mut errors, .. } = lexed;
    let mut best = Parser::read(text, &tokens, Guess::default());
    // A sound text has one reading. In one with errors, which bracket is missing or too many is a guess, and the guess that explains
    // the text with the fewest errors is the best. Among equals the layout is to be trusted.
    if !best.errors.is_empty() {
        for (guess, wins_ties) in GUESSES {
            let other = Parser::read(text, &tokens, guess);
            if other.errors.len() < best.errors.len() + usize::from(wins_ties) {
                best = other;
            }
        }
    }
    let Parser { nodes, extensions, errors: mut parse_errors, .. } = best;
    // What the lexer says about a place is the cause of what the parser says about it.
    parse_errors.retain(|parse_error| errors.binary_search_by_key(&parse_error.span.start, |error| error.span.start).is_err());
    errors.extend(parse_errors);
    errors.sort_by_key(|error| (error.span.start, error.span.end));
    Parsed { tokens, nodes, errors, extensions }
}

/// How to read a text whose brackets do not match.
#[derive(Clone, Copy, Default)]
struct Guess {
    /// Indentation and the shape of items tell where a closing bracket is missing.
    by_layout: bool,
    /// A closing bracket that does not match is one too many, rather than the sign of one that is missing.
    too_many: bool,
}

/// The guesses besides the plain one, and whether they are preferred among equals.
const GUESSES: [(Guess, bool); 3] = [
    (Guess { by_layout: true, too_many: false }, true),
    (Guess { by_layout: false, too_many: true }, false),
    (Guess { by_layout: true, too_many: true }, false),
];

fn refuse_large() -> Parsed {
    let error = SyntaxError::new(code::TOO_LARGE, Span::new(0, 0), "the source is too large for a graph file");
    Parsed {
        tokens: vec![Token { kind: TokenKind::Unknown, start: 0 }],
        nodes: vec![NodeData { kind: NodeKind::Document, parent: 0, tokens: (0, 1), subtree_end: 1 }],
        errors: vec![error.expected("at most 1 GiB")],
        extensions: Extensions::empty(),
    }
}

/// What the items between two brackets are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Items {
    Values,
    Fields,
    Entries,
}

/// A bracket that is open.
#[derive(Clone, Copy)]
struct Open {
    closer: TokenKind,
    items: Items,
}

struct Parser<'t> {
    text: &'t str,
    tokens: &'t [Token],
    /// The next token that is no trivia, or the number of tokens.
    at: usize,
    /// One past the last token that was consumed.
    consumed: usize,
    nodes: Vec<NodeData>,
    parent: u32,
    open: Vec<Open>,
    depth: u32,
    errors: Vec<SyntaxError>,
    extensions: Extensions,
    /// The end of the text came too early and was reported; once is enough.
    end_reported: bool,
    guess: Guess,
    /// The token before which a missing bracket was last reported; the comma before it went with the bracket.
    unclosed_before: Option<usize>,
}

fn to_u32(index: usize) -> u32 {
    // The caps on the source's size make this exact.
    u32::try_from(index).unwrap_or(u32::MAX)
}

/// Looking at tokens, and consuming them.
impl<'t> Parser<'t> {
    fn read(text: &'t str, tokens: &'t [Token], guess: Guess) -> Self {
        let mut parser = Self::new(text, tokens, guess);
        parser.document();
        parser
    }

    fn new(text: &'t str, tokens: &'t [Token], guess: Guess) -> Self {
        let mut parser = Self {
            text,
            tokens,
            at: 0,
            consumed: 0,
            nodes: Vec::with_capacity(tokens.len() / 3 + 1),
            parent: 0,
            open: Vec::new(),
            depth: 0,
            errors: Vec::new(),
            extensions: Extensions::empty(),
            end_reported: false,
            guess,
            unclosed_before: None,
        };
        parser.at = parser.skip_trivia(0);
        parser
    }

    fn skip_trivia(&self, from: usize) -> usize {
        let mut at = from;
        while self.tokens.get(at).is_some_and(|token| token.kind.is_trivia()) {
            at += 1;
        }
        at
    }

    fn kind_at(&self, index: usize) -> Option<TokenKind> {
        self.tokens.get(index).map(|token| token.kind)
    }

    fn kind(&self) -> Option<TokenKind> {
        self.kind_at(self.at)
    }

    fn is_at(&self, kind: TokenKind) -> bool {
        self.kind() == Some(kind)
    }

    /// The index of the token after the current one that is no trivia.
    fn next_index(&self) -> usize {
        self.skip_trivia(self.at + 1)
    }

    fn next_kind(&self) -> Option<TokenKind> {
        self.kind_at(self.next_index())
    }

    fn bump(&mut self) {
        if self.at < self.tokens.len() {
            self.consumed = self.at + 1;
            self.at = self.skip_trivia(self.at + 1);
        }
    }

    fn eat(&mut self, kind: TokenKind) -> bool {
        let is_there = self.is_at(kind);
        if is_there {
            self.bump();
        }
        is_there
    }

    fn token_span(&self, index: usize) -> Span {
        let offset = |index: usize| self.tokens.get(index).map_or(self.text.len(), |token| token.start as usize);
        Span::new(offset(index), offset(index + 1))
    }

    fn current_text(&self) -> &'t str {
        &self.text[self.token_span(self.at).range()]
    }

    /// The empty span right behind what was consumed.
    fn gap(&self) -> Span {
        let end = self.token_span(self.consumed).start;
        Span::new(end, end)
    }

    /// What stands here, in words.
    fn found(&self) -> String {
        let text = self.current_text();
        match self.kind() {
            None => "the end of the file".to_owned(),
            Some(TokenKind::String | TokenKind::RawString) if text.len() > 40 || text.contains('\n') => "a string".to_owned(),
            Some(TokenKind::String | TokenKind::RawString) => format!("the string {text}"),
            Some(_) => format!("`{text}`"),
        }
    }

    fn error(&mut self, error: SyntaxError) {
        // One place, one error: the first is the cause, the others follow from it.
        if self.errors.last().is_none_or(|last| last.span.start != error.span.start) {
            self.errors.push(error);
        }
    }

    fn start(&mut self, kind: NodeKind) -> u32 {
        let id = to_u32(self.nodes.len());
        let first = to_u32(self.at);
        self.nodes.push(NodeData { kind, parent: self.parent, tokens: (first, first), subtree_end: id + 1 });
        self.parent = id;
        id
    }

    fn finish(&mut self, id: u32) {
        let (end, subtree_end) = (to_u32(self.consumed), to_u32(self.nodes.len()));
        if let Some(node) = self.nodes.get_mut(id as usize) {
            node.tokens.1 = end.max(node.tokens.0);
            node.subtree_end = subtree_end;
            self.parent = node.parent;
        }
    }

    fn leaf(&mut self, kind: NodeKind) {
        let id = self.start(kind);
        self.bump();
        self.finish(id);
    }

    /// Goes one level deeper, or reports that it is too deep and consumes the value that is.
    fn deeper(&mut self, parse: impl FnOnce(&mut Self)) {
        if self.depth >= MAX_DEPTH {
            return self.too_deep();
        }
        self.depth += 1;
        parse(self);
        self.depth -= 1;
    }

    fn too_deep(&mut self) {
        let error = SyntaxError::new(code::TOO_DEEP, self.token_span(self.at), "nested too deep");
        self.error(error.expected(format!("at most {MAX_DEPTH} levels")));
        let id = self.start(NodeKind::Error);
        self.skip_balanced();
        self.finish(id);
    }

    /// Consumes tokens up to a comma or a closing bracket that was open before, without recursion.
    fn skip_balanced(&mut self) {
        let mut depth = 0_usize;
        while let Some(kind) = self.kind() {
            match kind {
                TokenKind::LParen | TokenKind::LBracket | TokenKind::LBrace => depth += 1,
                TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace if depth == 0 => break,
                TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace => depth -= 1,
                TokenKind::Comma if depth == 0 => break,
                _ => (),
            }
            self.bump();
        }
    }
}

/// The document and its attributes.
impl Parser<'_> {
    fn document(&mut self) {
        let id = self.start(NodeKind::Document);
        while self.is_at(TokenKind::Hash) {
            self.attribute();
        }
        if self.kind().is_none() {
            let error = SyntaxError::new(code::MISSING_VALUE, self.gap(), "the file holds no value");
            self.error(error.expected("a value such as `Graph(...)`").found("the end of the file"));
        } else {
            self.value();
        }
        if self.kind().is_some() {
            self.trailing();
        }
        self.finish(id);
        if let Some(document) = self.nodes.first_mut() {
            document.tokens = (0, to_u32(self.tokens.len()));
        }
    }

    fn trailing(&mut self) {
        // The lexer has already complained about a token that is unknown.
        if !self.is_at(TokenKind::Unknown) {
            let error = SyntaxError::new(code::TRAILING_TEXT, self.token_span(self.at), "text after the end of the document's value");
            self.error(error.expected("the end of the file").found(self.found()).help("is there a closing bracket too many before this?"));
        }
        let id = self.start(NodeKind::Error);
        while self.kind().is_some() {
            self.bump();
        }
        self.finish(id);
    }

    fn attribute(&mut self) {
        let id = self.start(NodeKind::Attribute);
        if let Err(expected) = self.attribute_parts() {
            let error = SyntaxError::new(code::BAD_ATTRIBUTE, self.token_span(self.at), "malformed attribute");
            self.error(error.expected(expected).found(self.found()).help("attributes look like `#![enable(implicit_some)]`"));
            while self.kind().is_some_and(|kind| !matches!(kind, TokenKind::RBracket | TokenKind::Hash | TokenKind::LBrace)) {
                self.bump();
            }
            self.eat(TokenKind::RBracket);
        }
        self.finish(id);
    }

    fn expect(&mut self, kind: TokenKind, expected: &'static str) -> Result<(), &'static str> {
        if self.eat(kind) { Ok(()) } else { Err(expected) }
    }

    fn attribute_parts(&mut self) -> Result<(), &'static str> {
        self.expect(TokenKind::Hash, "`#`")?;
        self.expect(TokenKind::Bang, "`!`")?;
        self.expect(TokenKind::LBracket, "`[`")?;
        match (self.kind(), self.current_text()) {
            (Some(TokenKind::Ident), "enable") => {
                self.bump();
                self.expect(TokenKind::LParen, "`(`")?;
                self.extension_list()?;
                self.expect(TokenKind::RParen, "`)`")?;
            }
            (Some(TokenKind::Ident), "type" | "schema") => {
                self.bump();
                self.expect(TokenKind::Eq, "`=`")?;
                if !matches!(self.kind(), Some(TokenKind::String | TokenKind::RawString)) {
                    return Err("a string");
                }
                self.bump();
            }
            _ => return Err("`enable`, `type` or `schema`"),
        }
        self.expect(TokenKind::RBracket, "`]`")
    }

    fn extension_list(&mut self) -> Result<(), &'static str> {
        loop {
            if !matches!(self.kind(), Some(TokenKind::Ident | TokenKind::RawIdent)) {
                return Err("the name of an extension");
            }
            let word = self.current_text();
            match Extensions::from_ident(word.strip_prefix("r#").unwrap_or(word)) {
                Some(extension) => self.extensions |= extension,
                None => self.unknown_extension(),
            }
            self.bump();
            if !self.eat(TokenKind::Comma) || self.is_at(TokenKind::RParen) {
                return Ok(());
            }
        }
    }

    fn unknown_extension(&mut self) {
        let error = SyntaxError::new(code::UNKNOWN_EXTENSION, self.token_span(self.at), "unknown extension of RON");
        let known = "`implicit_some`, `unwrap_newtypes`, `unwrap_variant_newtypes` or `explicit_struct_names`";
        self.error(error.expected(known).found(self.found()));
    }
}
