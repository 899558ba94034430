//! Where in a graph the cursor is, by the tokens before it alone: what follows is often not written yet.

use pegbar_engine::diag::Span;
use pegbar_engine::syntax::{TokenKind, TokenRef, Tree};

/// A bracket that is open at the cursor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<'t> {
    /// The opening bracket.
    pub(super) open: TokenRef<'t>,
    /// The name before it: `nodes` in `nodes: {`, `hat` in `"hat": (`; empty where there is none.
    pub(super) key: &'t str,
}

/// What is being typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Word<'t> {
    /// What a completion takes the place of.
    pub(super) span: Span,
    /// Its part before the cursor.
    pub(super) before: &'t str,
    /// True between quotes.
    pub(super) is_quoted: bool,
    /// False where the closing quote is still to be written.
    pub(super) is_closed: bool,
}

/// The cursor's place.
#[derive(Debug)]
pub(super) struct Cursor<'t> {
    /// Open brackets, outermost first.
    pub(super) frames: Vec<Frame<'t>>,
    /// The name before the colon, where the cursor is behind one.
    pub(super) key: Option<&'t str>,
    pub(super) word: Word<'t>,
    /// True where the cursor stands right of a value that is whole, and nothing is to be completed.
    pub(super) is_behind_value: bool,
    /// What comes after the word, but for blanks and comments.
    pub(super) next: Option<TokenKind>,
}

/// An item of the innermost bracket, so far.
#[derive(Clone, Copy, Default)]
struct Item<'t> {
    name: Option<&'t str>,
    has_colon: bool,
    has_value: bool,
}

struct Walk<'t> {
    frames: Vec<Frame<'t>>,
    /// The item of each bracket, and of the document.
    items: Vec<Item<'t>>,
}

impl<'t> Cursor<'t> {
    /// `None` inside a comment. O(offset).
    pub(super) fn at(tree: &'t Tree, offset: usize) -> Option<Self> {
        let mut walk = Walk { frames: Vec::new(), items: vec![Item::default()] };
        let mut current = None;
        for token in tree.tokens().take_while(|t| t.span().start < offset) {
            let span = token.span();
            let is_comment = token.kind().is_comment();
            if is_comment && (offset < span.end || (offset == span.end && token.kind() == TokenKind::LineComment)) {
                return None;
            }
            if is_typed(token, offset) {
                current = Some(token);
                break;
            }
            walk.step(token);
        }
        let word = match current {
            Some(token) => word(tree, token, offset),
            None => Word { span: Span::new(offset, offset), before: "", is_quoted: false, is_closed: false },
        };
        if let Some(token) = current {
            walk.begin_line(token);
        }
        let tokens = std::iter::successors(tree.token_at(word.span.end), |t| t.next());
        let next = tokens.filter(|t| t.span().start >= word.span.end && !t.kind().is_trivia()).map(TokenRef::kind).next();
        let item = walk.items.last().copied().unwrap_or_default();
        Some(Self { frames: walk.frames, key: item.name.filter(|_| item.has_colon), word, is_behind_value: item.has_value, next })
    }

    /// The innermost bracket's kind and the names on the way to it, the document's own left out.
    pub(super) fn path(&self) -> (Option<TokenKind>, Vec<&'t str>) {
        (self.frames.last().map(|f| f.open.kind()), self.frames.iter().skip(1).map(|f| f.key).collect())
    }
}

/// True for the token that the cursor is in, or right behind while it may go on.
fn is_typed(token: TokenRef<'_>, offset: usize) -> bool {
    let span = token.span();
    match token.kind() {
        TokenKind::String => offset < span.end || (offset == span.end && !is_closed(token)),
        TokenKind::Ident | TokenKind::RawIdent | TokenKind::Number => offset <= span.end,
        _ => false,
    }
}

fn is_closed(token: TokenRef<'_>) -> bool {
    let text = token.text();
    text.len() > 1 && text.ends_with('"') && !text.ends_with("\\\"")
}

/// What of a token a completion takes the place of.
fn word<'t>(tree: &'t Tree, token: TokenRef<'t>, offset: usize) -> Word<'t> {
    let (text, span) = (tree.text(), token.span());
    if token.kind() != TokenKind::String {
        return Word { span, before: &text[span.start..offset], is_quoted: false, is_closed: false };
    }
    let start = span.start + 1;
    // A quote may be missing, and the text then runs on into what follows: a name ends where its characters do.
    let rest = &text[offset..span.end];
    let inside = if is_closed(token) { &rest[..rest.len() - 1] } else { rest };
    let belongs = |c: char| c.is_alphanumeric() || "_-.@$#/%".contains(c);
    let length = inside.find(|c: char| !belongs(c)).unwrap_or(inside.len());
    let line = text[offset..].lines().next().unwrap_or_default();
    Word { span: Span::new(start, offset + length), before: &text[start..offset], is_quoted: true, is_closed: line.contains('"') }
}

impl<'t> Walk<'t> {
    fn item(&mut self) -> &mut Item<'t> {
        if self.items.is_empty() {
            self.items.push(Item::default());
        }
        let last = self.items.len() - 1;
        &mut self.items[last]
    }

    fn step(&mut self, token: TokenRef<'t>) {
        match token.kind() {
            kind if kind.is_trivia() => (),
            TokenKind::Comma => *self.item() = Item::default(),
            TokenKind::Colon => {
                let item = self.item();
                (item.has_colon, item.has_value) = (item.name.is_some(), false);
            }
            TokenKind::LParen | TokenKind::LBracket | TokenKind::LBrace => {
                let item = *self.item();
                self.frames.push(Frame { open: token, key: item.name.filter(|_| item.has_colon).unwrap_or_default() });
                self.items.push(Item::default());
            }
            TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace => self.close(token.kind()),
            _ => self.name_or_value(token),
        }
    }

    fn close(&mut self, kind: TokenKind) {
        let opens = |f: &Frame<'_>| {
            matches!(
                (f.open.kind(), kind),
                (TokenKind::LParen, TokenKind::RParen)
                    | (TokenKind::LBracket, TokenKind::RBracket)
                    | (TokenKind::LBrace, TokenKind::RBrace)
            )
        };
        if let Some(at) = self.frames.iter().rposition(opens) {
            self.frames.truncate(at);
            self.items.truncate(at + 1);
            self.item().has_value = true;
        }
    }

    fn name_or_value(&mut self, token: TokenRef<'t>) {
        self.begin_line(token);
        let item = self.item();
        if item.has_colon {
            item.has_value = true;
        } else {
            item.name = Some(token.name());
        }
    }

    /// What begins a line and has a colon behind it is an item of its own, whatever was forgotten before it: a comma, or brackets.
    fn begin_line(&mut self, token: TokenRef<'t>) {
        if !begins_line(token) {
            return;
        }
        if next_kind(token) == Some(TokenKind::Colon) {
            let is_entry = token.kind() == TokenKind::String;
            let home = if is_entry { TokenKind::LBrace } else { TokenKind::LParen };
            let at = self.frames.iter().rposition(|f| f.open.kind() == home);
            let is_elsewhere = self.frames.last().is_some_and(|f| f.open.kind() != home);
            if let Some(at) = at.filter(|_| is_elsewhere) {
                self.frames.truncate(at + 1);
                self.items.truncate(at + 2);
            }
            *self.item() = Item::default();
        } else if self.item().has_value {
            *self.item() = Item::default();
        }
    }
}

fn begins_line(token: TokenRef<'_>) -> bool {
    token.prev().is_some_and(|t| t.kind() == TokenKind::Whitespace && t.text().contains('\n'))
}

/// The kind of the next token that is no blank or comment.
fn next_kind(token: TokenRef<'_>) -> Option<TokenKind> {
    std::iter::successors(token.next(), |t| t.next()).find(|t| !t.kind().is_trivia()).map(TokenRef::kind)
}

/// A field of a record that may be broken.
#[derive(Clone, Copy, Debug)]
pub(super) struct GivenField<'t> {
    pub(super) name: TokenRef<'t>,
    /// The first token of the value.
    pub(super) value: Option<TokenRef<'t>>,
}

/// The fields behind an opening bracket, up to its end or to where the next entry begins.
pub(super) fn given_fields<'t>(open: TokenRef<'t>) -> Vec<GivenField<'t>> {
    let mut out = Vec::new();
    let mut depth = 0_usize;
    for token in std::iter::successors(open.next(), |t| t.next()) {
        match token.kind() {
            TokenKind::LParen | TokenKind::LBracket | TokenKind::LBrace => depth += 1,
            TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace if depth == 0 => break,
            TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace => depth -= 1,
            TokenKind::String if begins_line(token) && next_kind(token) == Some(TokenKind::Colon) => break,
            TokenKind::Ident | TokenKind::RawIdent if depth == 0 && next_kind(token) == Some(TokenKind::Colon) => {
                let after = |t: TokenRef<'t>| std::iter::successors(t.next(), |t| t.next()).find(|t| !t.kind().is_trivia());
                out.push(GivenField { name: token, value: after(token).and_then(after) });
            }
            _ => (),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names on the way, the name before the colon, the word before the cursor; the cursor is `|`.
    fn place(text: &str) -> Option<String> {
        let offset = text.find('|').unwrap();
        let tree = Tree::parse(text.replacen('|', "", 1));
        let cursor = Cursor::at(&tree, offset)?;
        let quote = if cursor.word.is_quoted { "\"" } else { "" };
        let behind = if cursor.is_behind_value { " behind" } else { "" };
        Some(format!("{} {:?} {quote}{}{behind}", cursor.path().1.join("/"), cursor.key, cursor.word.before))
    }

    #[test]
    fn the_place_is_told_from_what_stands_before() {
        let inside =
            |record: &str| place(&format!("Graph(\n pegbar: 1,\n nodes: {{\n  \"a\": ({record}),\n  \"b\": (type: \"x.y\"),\n }},\n)"));
        for (record, expected) in [
            ("|", "nodes/a None "),
            ("ty|", "nodes/a None ty"),
            ("type: |", "nodes/a Some(\"type\") "),
            ("type: \"tr|", "nodes/a Some(\"type\") \"tr"),
            ("type: \"tr|ack\"", "nodes/a Some(\"type\") \"tr"),
            ("type: \"x\", |", "nodes/a None "),
            ("type: \"x\", im|, b: 1", "nodes/a None im"),
            ("type: \"x\", a: [\"@b\", \"@|\"]", "nodes/a/a None \"@"),
            ("type: \"x\", filter: cu|", "nodes/a Some(\"filter\") cu"),
            ("type: \"x\"|", "nodes/a Some(\"type\")  behind"),
            ("type: \"x\",\n  image: \"@b\"\n  ma|", "nodes/a None ma"),
            ("type: \"x\", a: (1, 2), |", "nodes/a None "),
            ("type: \"x\", a: 1.|5", "nodes/a Some(\"a\") 1."),
        ] {
            assert_eq!(inside(record).as_deref(), Some(expected), "{record}");
        }
    }

    #[test]
    fn what_was_forgotten_before_does_not_confuse() {
        for (text, expected) in [
            ("Graph(\n nodes: {\n  \"a\": (type: \"x\"\n  \"b\": (ty|", "nodes/b None ty"),
            ("Graph(\n nodes: {\n  \"a\": (type: [1,\n  \"b\": (|", "nodes/b None "),
            ("Graph(\n nodes: {\n  \"a\": (type: \"x\"),\n outputs: {\n  \"o\": \"@|", "outputs Some(\"o\") \"@"),
            ("Graph(\n nodes: {\n  \"a\": (type: \"x\"), ] \n  \"b\": |", "nodes Some(\"b\") "),
            ("|", " None "),
            ("Graph(|", " None "),
            ("Graph(pegbar: 1, frames: (fi|", "frames None fi"),
            ("Graph(nodes: {\"a|", "nodes None \"a"),
        ] {
            assert_eq!(place(text).as_deref(), Some(expected), "{text}");
        }
        assert_eq!(place("Graph( // a |"), None);
        assert_eq!(place("Graph( /* a | */"), None);
        assert_eq!(place("Graph( /* a */|").as_deref(), Some(" None "));
    }

    #[test]
    fn a_word_ends_before_what_follows_a_missing_quote() {
        let text = "(a: \"@pl, b: \"@x\")";
        let tree = Tree::parse(text);
        let word = Cursor::at(&tree, 8).unwrap().word;
        assert_eq!((&text[word.span.range()], word.before, word.is_quoted), ("@pl", "@pl", true));
        let tree = Tree::parse("(a: \"@pl\n");
        let word = Cursor::at(&tree, 8).unwrap().word;
        assert_eq!((word.span.range(), word.is_closed), (5..8, false));
    }

    #[test]
    fn fields_of_a_broken_record_are_found() {
        let names = |text: &str| {
            let tree = Tree::parse(text);
            let open = tree.tokens().find(|t| t.kind() == TokenKind::LParen).unwrap();
            given_fields(open).iter().map(|f| format!("{}={}", f.name.text(), f.value.map_or("", TokenRef::text))).collect::<Vec<_>>()
        };
        assert_eq!(names("(type: \"x\", a: [(b: 1)], c: )"), ["type=\"x\"", "a=[", "c=)"]);
        assert_eq!(names("(type: \"x\", a\n \"n\": (type: \"y\")"), ["type=\"x\""]);
    }
}
