//! Builds the tree: recursive descent over the tokens, going on after every error.
//!
//! Where a bracket is missing, the brackets around it and the shape of what follows decide where it should have been, so that one slip
//! gives one error. Nesting is bounded by the same count that `ron` keeps.

use super::code;
use super::lexer::{Lexed, Token, TokenKind, lex, lex_short};
use super::number::is_float_word;
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

/// Values.
impl Parser<'_> {
    /// Whether a value may begin with the token.
    fn starts_value(kind: TokenKind) -> bool {
        use TokenKind::{Byte, ByteString, Char, DotDot, DotDotEq, Ident, LBrace, LBracket, LParen, Number, RawByteString, RawIdent};
        matches!(
            kind,
            Byte | ByteString | Char | DotDot | DotDotEq | Ident | LBrace | LBracket | LParen | Number | RawByteString | RawIdent
        ) || matches!(kind, TokenKind::RawString | TokenKind::String)
    }

    fn value(&mut self) {
        match self.kind() {
            Some(TokenKind::Ident) => self.word(),
            Some(TokenKind::RawIdent) => self.named(),
            Some(TokenKind::Number | TokenKind::Byte) => self.number(),
            Some(TokenKind::DotDot | TokenKind::DotDotEq) => self.range(),
            Some(TokenKind::Char) => self.leaf(NodeKind::Char),
            Some(TokenKind::String | TokenKind::RawString) => self.leaf(NodeKind::String),
            Some(TokenKind::ByteString | TokenKind::RawByteString) => self.leaf(NodeKind::ByteString),
            Some(TokenKind::LParen) => self.named(),
            Some(TokenKind::LBracket) => self.brackets(NodeKind::List, TokenKind::RBracket, Items::Values),
            Some(TokenKind::LBrace) => self.brackets(NodeKind::Map, TokenKind::RBrace, Items::Entries),
            _ => self.missing_value(),
        }
    }

    fn missing_value(&mut self) {
        match self.kind() {
            Some(TokenKind::Unknown) => self.unknown(),
            Some(TokenKind::Hash | TokenKind::Bang | TokenKind::Eq) => {
                let error = SyntaxError::new(code::UNEXPECTED_TOKEN, self.token_span(self.at), "unexpected text");
                self.error(error.expected("a value").found(self.found()));
                self.leaf(NodeKind::Error);
            }
            _ => {
                let error = SyntaxError::new(code::MISSING_VALUE, self.gap(), "a value is missing");
                self.error(error.expected("a value").found(self.found()));
            }
        }
    }

    /// Characters that begin nothing, with what touches them: the lexer has already complained.
    fn unknown(&mut self) {
        let id = self.start(NodeKind::Error);
        self.bump();
        let belongs = |kind| matches!(kind, TokenKind::Ident | TokenKind::Number | TokenKind::Unknown | TokenKind::DotDot);
        while self.at == self.consumed && self.kind().is_some_and(belongs) {
            self.bump();
        }
        self.finish(id);
    }

    /// A name used as a value: a word of the language, a number such as `inf`, a struct or a variant.
    fn word(&mut self) {
        match self.current_text() {
            "true" | "false" => self.leaf(NodeKind::Bool),
            "None" => self.leaf(NodeKind::None),
            "Some" => self.some(),
            word if is_float_word(word) => self.number(),
            _ => self.named(),
        }
    }

    fn is_number_here(&self) -> bool {
        match self.kind() {
            Some(TokenKind::Number | TokenKind::Byte) => true,
            Some(TokenKind::Ident) => is_float_word(self.current_text()),
            _ => false,
        }
    }

    /// A number, or a range that begins with one: a range's parts touch.
    fn number(&mut self) {
        let is_range = matches!(self.kind_at(self.at + 1), Some(TokenKind::DotDot | TokenKind::DotDotEq));
        let kind = if self.is_at(TokenKind::Byte) { NodeKind::Byte } else { NodeKind::Number };
        if !is_range {
            return self.leaf(kind);
        }
        let id = self.start(NodeKind::Range);
        self.leaf(kind);
        self.range_end();
        self.finish(id);
    }

    fn range(&mut self) {
        let id = self.start(NodeKind::Range);
        self.range_end();
        self.finish(id);
    }

    fn range_end(&mut self) {
        let needs_end = self.is_at(TokenKind::DotDotEq);
        self.bump();
        let touches = self.at == self.consumed;
        if touches && self.is_number_here() {
            let kind = if self.is_at(TokenKind::Byte) { NodeKind::Byte } else { NodeKind::Number };
            self.leaf(kind);
        } else if needs_end {
            let error = SyntaxError::new(code::MISSING_VALUE, self.gap(), "`..=` needs an end");
            self.error(error.expected("a number right behind it").found(self.found()));
        }
    }

    /// `Some(value)`, and what the document's extensions make of it.
    fn some(&mut self) {
        let id = self.start(NodeKind::Some);
        self.bump();
        if self.is_at(TokenKind::LParen) {
            self.deeper(Self::some_content);
        } else if self.extensions.contains(Extensions::IMPLICIT_SOME) {
            // `ron` reads `Some 5` as it reads `Some(5)` once `Some` may be left out.
            self.deeper(Self::value);
        } else {
            let error = SyntaxError::new(code::UNEXPECTED_TOKEN, self.gap(), "`Some` needs a value");
            self.error(error.expected("`(` and a value").found(self.found()));
        }
        self.finish(id);
    }

    fn some_content(&mut self) {
        let items = self.items_in_parens();
        if self.extensions.contains(Extensions::UNWRAP_VARIANT_NEWTYPES) {
            if self.next_kind() == Some(TokenKind::RParen) {
                self.bump();
                return self.bump();
            }
            // The brackets of `Some` serve the struct or tuple inside as well.
            if items == Items::Fields || self.has_several_items() {
                return self.deeper(|parser| parser.items(TokenKind::RParen, items));
            }
        }
        let opener = self.at;
        self.bump();
        self.open.push(Open { closer: TokenKind::RParen, items: Items::Values });
        if self.is_at(TokenKind::RParen) {
            self.missing_value();
        } else {
            self.value();
        }
        self.eat(TokenKind::Comma);
        if !self.eat(TokenKind::RParen) {
            self.close_some(opener);
        }
        self.open.pop();
    }

    fn close_some(&mut self, opener: usize) {
        if self.kind().is_some_and(|kind| !Self::is_closer(kind)) {
            let error = SyntaxError::new(code::UNEXPECTED_TOKEN, self.token_span(self.at), "`Some` holds one value");
            self.error(error.expected("`)`").found(self.found()));
            self.skip_to_closer();
            if self.eat(TokenKind::RParen) {
                return;
            }
        }
        self.unclosed(opener, TokenKind::RParen);
    }

    fn skip_to_closer(&mut self) {
        let id = self.start(NodeKind::Error);
        loop {
            self.skip_balanced();
            if !self.eat(TokenKind::Comma) {
                break;
            }
        }
        self.finish(id);
    }

    /// Whether a comma and something more follow the first item of the bracket that opens here. O(length of the item).
    fn has_several_items(&self) -> bool {
        let mut depth = 0_usize;
        let mut at = self.next_index();
        while let Some(kind) = self.kind_at(at) {
            match kind {
                TokenKind::LParen | TokenKind::LBracket | TokenKind::LBrace => depth += 1,
                TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace if depth == 0 => return false,
                TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace => depth -= 1,
                TokenKind::Comma if depth == 0 => return self.kind_at(self.skip_trivia(at + 1)) != Some(TokenKind::RParen),
                _ => (),
            }
            at = self.skip_trivia(at + 1);
        }
        false
    }

    /// A name with or without brackets behind it, or brackets without a name.
    fn named(&mut self) {
        let has_name = !self.is_at(TokenKind::LParen);
        let paren = if has_name { self.next_index() } else { self.at };
        if self.kind_at(paren) != Some(TokenKind::LParen) {
            return self.leaf(NodeKind::Ident);
        }
        if !has_name && self.kind_at(self.at + 1) == Some(TokenKind::RParen) {
            let id = self.start(NodeKind::Unit);
            self.bump();
            self.bump();
            return self.finish(id);
        }
        let before = self.at;
        self.at = paren;
        let items = self.items_in_parens();
        self.at = before;
        let id = self.start(if items == Items::Fields { NodeKind::Struct } else { NodeKind::Tuple });
        if has_name {
            self.bump();
        }
        self.deeper(|parser| parser.items(TokenKind::RParen, items));
        self.finish(id);
    }

    /// What the parentheses that open here hold: fields, when a name and a colon come first.
    fn items_in_parens(&self) -> Items {
        let mut first = self.next_index();
        while self.kind_at(first) == Some(TokenKind::Comma) {
            first = self.skip_trivia(first + 1);
        }
        let second = self.skip_trivia(first + 1);
        let is_name = matches!(self.kind_at(first), Some(TokenKind::Ident | TokenKind::RawIdent));
        match self.kind_at(second) {
            Some(TokenKind::Colon) if is_name || self.kind_at(first) == Some(TokenKind::String) => Items::Fields,
            // A name right before a value or `=` is a field that lacks its colon; it can be nothing else.
            Some(TokenKind::Eq | TokenKind::String | TokenKind::Number | TokenKind::LBracket | TokenKind::LBrace) if is_name => {
                Items::Fields
            }
            _ => Items::Values,
        }
    }

    fn brackets(&mut self, kind: NodeKind, closer: TokenKind, items: Items) {
        let id = self.start(kind);
        self.deeper(|parser| parser.items(closer, items));
        self.finish(id);
    }
}

/// Items between brackets.
impl Parser<'_> {
    fn is_closer(kind: TokenKind) -> bool {
        matches!(kind, TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace)
    }

    /// The opening bracket, the items with their commas, and the closing bracket.
    fn items(&mut self, closer: TokenKind, items: Items) {
        let opener = self.at;
        self.bump();
        self.open.push(Open { closer, items });
        while self.one_item(opener, closer, items) {}
        self.open.pop();
    }

    /// One step of [`items`](Self::items): an item with its comma, an error, or the end (`false`).
    fn one_item(&mut self, opener: usize, closer: TokenKind, items: Items) -> bool {
        match self.kind() {
            None => {
                self.unclosed(opener, closer);
                return false;
            }
            Some(kind) if Self::is_closer(kind) => return self.closing_bracket(opener, closer, kind),
            Some(TokenKind::Comma) => {
                self.stray_comma(items);
                return true;
            }
            Some(_) if self.belongs_to_outer(items) || self.is_outdented(opener, 0) => {
                self.unclosed(opener, closer);
                return false;
            }
            Some(_) => (),
        }
        let before = self.at;
        self.item(items);
        if self.at == before {
            self.unexpected(items);
        }
        self.comma(opener, items);
        true
    }

    /// A closing bracket, this one or another; whether the items go on behind it.
    fn closing_bracket(&mut self, opener: usize, closer: TokenKind, found: TokenKind) -> bool {
        let belongs_outside = self.open.iter().rev().skip(1).any(|open| open.closer == found);
        if found == closer && !(belongs_outside && self.is_outdented(opener, 1)) {
            self.bump();
            return false;
        }
        if belongs_outside && (found == closer || !self.guess.too_many) {
            self.unclosed(opener, closer);
            return false;
        }
        self.stray_bracket(opener, closer);
        self.eat(TokenKind::Comma);
        true
    }

    /// Whether the current token begins a line that is indented less than `less` columns more than the line with the bracket, which
    /// must then have been closed before, if the layout is to be trusted.
    fn is_outdented(&self, opener: usize, less: usize) -> bool {
        if !self.guess.by_layout || !self.starts_line() {
            return false;
        }
        let line_start = |at: usize| self.text[..at].rfind('\n').map_or(0, |end| end + 1);
        let (current, open) = (self.token_span(self.at).start, self.token_span(opener).start);
        let open_line = &self.text[line_start(open)..open];
        let indent = open_line.len() - open_line.trim_start_matches([' ', '\t']).len();
        current - line_start(current) + less <= indent
    }

    fn item(&mut self, items: Items) {
        match items {
            Items::Values => self.deeper(Self::value),
            Items::Fields => self.field(),
            Items::Entries => self.entry(),
        }
    }

    fn comma(&mut self, opener: usize, items: Items) {
        if self.eat(TokenKind::Comma) {
            return;
        }
        let Some(kind) = self.kind() else { return };
        if Self::is_closer(kind) || kind == TokenKind::Unknown || self.belongs_to_outer(items) || self.is_outdented(opener, 0) {
            return;
        }
        if self.unclosed_before == Some(self.at) && self.next_kind() == Some(TokenKind::Colon) {
            return;
        }
        if Self::starts_value(kind) {
            let error = SyntaxError::new(code::MISSING_COMMA, self.gap(), "a comma is missing");
            self.error(error.expected("`,`").found(self.found()));
        } else {
            self.unexpected(items);
        }
    }

    /// Whether what follows can only be an item of the bracket around the current one, which therefore lacks its closing bracket:
    /// `"key":` in a struct within a map, `name:` in a map within a struct, either of them in a list.
    fn belongs_to_outer(&self, items: Items) -> bool {
        let Some(outer) = self.open.len().checked_sub(2).and_then(|index| self.open.get(index)) else { return false };
        if self.next_kind() != Some(TokenKind::Colon) || !(self.starts_line() || self.guess.by_layout) {
            return false;
        }
        match (self.kind(), items, outer.items) {
            (Some(TokenKind::String), Items::Fields | Items::Values, Items::Entries) => true,
            (Some(TokenKind::Ident | TokenKind::RawIdent), Items::Values, Items::Fields) => true,
            _ => false,
        }
    }

    /// Whether only blanks and comments stand before the current token on its line.
    fn starts_line(&self) -> bool {
        let end = self.token_span(self.consumed).start;
        self.text[end..self.token_span(self.at).start].contains('\n')
    }

    fn unexpected(&mut self, items: Items) {
        let what = match items {
            Items::Values => "`,` or a closing bracket",
            Items::Fields => "a field such as `name: value`",
            Items::Entries => "an entry such as `\"name\": value`",
        };
        if !self.is_at(TokenKind::Unknown) {
            let mut error = SyntaxError::new(code::UNEXPECTED_TOKEN, self.token_span(self.at), "unexpected text");
            if self.is_at(TokenKind::Colon) && items == Items::Values {
                error = error.help("either all items have names, as in `(a: 1, b: 2)`, or none; a list `[...]` has none");
            }
            if self.is_at(TokenKind::Hash) {
                error = error.help("a comment is written `// ...` or `/* ... */`");
            }
            self.error(error.expected(what).found(self.found()));
        }
        let id = self.start(NodeKind::Error);
        self.skip_item();
        self.finish(id);
        self.eat(TokenKind::Comma);
    }

    /// Consumes up to the end of the item, or up to the next line that begins an item of its own.
    fn skip_item(&mut self) {
        let mut depth = 0_usize;
        let mut is_first = true;
        while let Some(kind) = self.kind() {
            if depth == 0 && !is_first && self.starts_line() && self.next_kind() == Some(TokenKind::Colon) {
                break;
            }
            match kind {
                TokenKind::LParen | TokenKind::LBracket | TokenKind::LBrace => depth += 1,
                kind if Self::is_closer(kind) && depth == 0 => break,
                kind if Self::is_closer(kind) => depth -= 1,
                TokenKind::Comma if depth == 0 && !is_first => break,
                _ => (),
            }
            is_first = false;
            self.bump();
        }
    }

    fn stray_comma(&mut self, items: Items) {
        let error = SyntaxError::new(code::UNEXPECTED_TOKEN, self.token_span(self.at), "a comma without an item before it");
        let what = match items {
            Items::Values => "a value",
            Items::Fields => "a field such as `name: value`",
            Items::Entries => "an entry such as `\"name\": value`",
        };
        self.error(error.expected(what).found("`,`"));
        self.leaf(NodeKind::Error);
    }

    fn stray_bracket(&mut self, opener: usize, closer: TokenKind) {
        let error = SyntaxError::new(code::STRAY_BRACKET, self.token_span(self.at), "this bracket closes nothing");
        let error = error.expected(format!("`{}`", bracket_text(closer))).found(self.found());
        self.error(error.related(self.token_span(opener), "the bracket that is open here"));
        self.leaf(NodeKind::Error);
    }

    fn unclosed(&mut self, opener: usize, closer: TokenKind) {
        self.unclosed_before = Some(self.at);
        if self.kind().is_none() && std::mem::replace(&mut self.end_reported, true) {
            return;
        }
        let error = SyntaxError::new(code::UNCLOSED_BRACKET, self.token_span(opener), "this bracket is never closed");
        let error = error.expected(format!("`{}`", bracket_text(closer))).found(self.found());
        let place = if self.kind().is_none() { self.gap() } else { self.token_span(self.at) };
        self.error(error.related(place, format!("expected `{}` before this", bracket_text(closer))));
    }

    fn field(&mut self) {
        match self.kind() {
            Some(TokenKind::Ident | TokenKind::RawIdent) => (),
            Some(TokenKind::String) if self.next_kind() == Some(TokenKind::Colon) => {
                let error =
                    SyntaxError::new(code::MISSING_FIELD_NAME, self.token_span(self.at), "a field's name is written without quotes");
                let bare = self.current_text().trim_matches('"');
                self.error(error.expected(format!("`{bare}`")).found(self.found()));
            }
            _ => return self.no_field(),
        }
        let id = self.start(NodeKind::Field);
        let name_at = self.at;
        if self.depth >= MAX_DEPTH {
            self.too_deep();
        } else {
            self.bump();
            self.colon_and_value(name_at, "field");
        }
        self.finish(id);
    }

    fn no_field(&mut self) {
        if self.kind().is_some_and(Self::starts_value) {
            let error = SyntaxError::new(code::MISSING_FIELD_NAME, self.token_span(self.at), "this value has no field name");
            self.error(error.expected("a field such as `name: value`").found(self.found()));
            let id = self.start(NodeKind::Error);
            self.deeper(Self::value);
            self.finish(id);
        }
    }

    fn entry(&mut self) {
        if !self.kind().is_some_and(Self::starts_value) {
            return;
        }
        let id = self.start(NodeKind::Entry);
        let key_at = self.at;
        self.deeper(Self::value);
        self.colon_and_value(key_at, "entry");
        self.finish(id);
    }

    fn colon_and_value(&mut self, name_at: usize, what: &str) {
        let has_colon = self.eat(TokenKind::Colon);
        if !has_colon {
            if self.is_at(TokenKind::Unknown) {
                return;
            }
            let error = SyntaxError::new(code::MISSING_COLON, self.gap(), format!("a colon is missing after the {what}'s name"));
            let error = if self.is_at(TokenKind::Eq) { error.help("names and values are separated by `:`") } else { error };
            let name = self.text[self.token_span(name_at).range()].to_owned();
            self.error(error.expected(format!("`:` and a value after `{name}`")).found(self.found()));
            self.eat(TokenKind::Eq);
        }
        let is_next_item = self.starts_line() && self.next_kind() == Some(TokenKind::Colon);
        if is_next_item || !self.kind().is_some_and(|kind| Self::starts_value(kind) || kind == TokenKind::Unknown) {
            if has_colon {
                self.no_value_after_colon();
            }
            return;
        }
        self.deeper(Self::value);
    }

    fn no_value_after_colon(&mut self) {
        match self.kind() {
            Some(TokenKind::Hash | TokenKind::Bang | TokenKind::Eq) => self.missing_value(),
            _ => {
                let error = SyntaxError::new(code::MISSING_VALUE, self.gap(), "a value is missing");
                self.error(error.expected("a value after `:`").found(self.found()));
            }
        }
    }
}

fn bracket_text(kind: TokenKind) -> &'static str {
    match kind {
        TokenKind::RParen => ")",
        TokenKind::RBracket => "]",
        _ => "}",
    }
}
