//! Items between brackets, and what to make of brackets, commas and colons that are missing or too many.

use super::super::SyntaxError;
use super::super::code;
use super::super::lexer::TokenKind;
use super::super::tree::NodeKind;
use super::{Items, MAX_DEPTH, Open, Parser};

impl Parser<'_> {
    pub(super) fn is_closer(kind: TokenKind) -> bool {
        matches!(kind, TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace)
    }

    /// The opening bracket, the items with their commas, and the closing bracket.
    pub(super) fn items(&mut self, closer: TokenKind, items: Items) {
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
        let is_key = self.is_at(TokenKind::String) && items != Items::Entries && outer.items == Items::Entries;
        let is_name = matches!(self.kind(), Some(TokenKind::Ident | TokenKind::RawIdent));
        is_key || (is_name && items == Items::Values && outer.items == Items::Fields)
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

    pub(super) fn unclosed(&mut self, opener: usize, closer: TokenKind) {
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
