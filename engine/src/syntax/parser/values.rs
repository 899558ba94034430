//! Values.

use super::super::lexer::TokenKind;
use super::super::number::is_float_word;
use super::super::tree::NodeKind;
use super::super::{Extensions, SyntaxError, code};
use super::{Items, Open, Parser};

impl Parser<'_> {
    /// Whether a value may begin with the token.
    pub(super) fn starts_value(kind: TokenKind) -> bool {
        use TokenKind::{Byte, ByteString, Char, DotDot, DotDotEq, Ident, LBrace, LBracket, LParen, Number, RawByteString, RawIdent};
        matches!(
            kind,
            Byte | ByteString | Char | DotDot | DotDotEq | Ident | LBrace | LBracket | LParen | Number | RawByteString | RawIdent
        ) || matches!(kind, TokenKind::RawString | TokenKind::String)
    }

    pub(super) fn value(&mut self) {
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

    pub(super) fn missing_value(&mut self) {
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

    /// True where a value may follow what stands there, as `ron` has it once `Some` may be left out.
    fn may_be_some(&self, at: usize) -> bool {
        self.extensions.contains(Extensions::IMPLICIT_SOME) && &self.text[self.token_span(at).range()] == "Some"
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
            Some(TokenKind::Eq | TokenKind::String | TokenKind::Number | TokenKind::LBracket | TokenKind::LBrace)
                if is_name && !self.may_be_some(first) =>
            {
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
