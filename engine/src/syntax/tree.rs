//! The syntax tree: an arena of nodes in source order over an arena of tokens that cover the source.

use std::sync::Arc;

use super::escape::StrValue;
use super::lexer::{Token, TokenKind};
use super::{Extensions, SyntaxError, parser};
use crate::diag::Span;

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum NodeKind {
    /// The whole file: attributes and one value.
    Document,
    /// `#![enable(...)]`, `#![type = "..."]` or `#![schema = "..."]`.
    Attribute,
    /// `Name(a: 1)` or `(a: 1)`; its children are `Field`s.
    Struct,
    /// `Name(1, 2)`, `Name()` or `(1, 2)`; its children are values.
    Tuple,
    /// `()`.
    Unit,
    /// A bare name that is a value: a unit struct or an enum variant.
    Ident,
    /// `name: value` in a struct.
    Field,
    /// `[1, 2]`; its children are values.
    List,
    /// `{k: v}`; its children are `Entry`s.
    Map,
    /// `key: value` in a map.
    Entry,
    /// `Some(value)`.
    Some,
    /// `None`.
    None,
    /// `true` or `false`.
    Bool,
    /// An integer or a float, `inf` and `NaN` among them.
    Number,
    /// `b'.'`.
    Byte,
    /// `'.'`.
    Char,
    /// A string, raw or not.
    String,
    /// A byte string, raw or not.
    ByteString,
    /// `1..2`, `1..=2`, `1..`, `..2`, `..=2` or `..`; its children are the ends.
    Range,
    /// What the parser could not make sense of, kept as it is.
    Error,
}

impl NodeKind {
    /// Whether the node is a value.
    pub fn is_value(self) -> bool {
        !matches!(self, Self::Document | Self::Attribute | Self::Field | Self::Entry | Self::Error)
    }
}

/// A node in the arena. Nodes lie in the order of their first tokens, each followed by its descendants.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeData {
    pub(super) kind: NodeKind,
    pub(super) parent: u32,
    /// First token, and one past the last.
    pub(super) tokens: (u32, u32),
    /// One past the last descendant.
    pub(super) subtree_end: u32,
}

/// Names a node within its tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub(super) u32);

/// A source text, its tokens, its tree and its errors. The tokens' texts joined are the source, for any source.
#[derive(Clone, Debug)]
pub struct Tree {
    text: Arc<str>,
    tokens: Vec<Token>,
    nodes: Vec<NodeData>,
    errors: Vec<SyntaxError>,
    extensions: Extensions,
}

impl Tree {
    /// Parses a RON text. Never fails: what is wrong is in [`Tree::errors`]. O(n) time and memory.
    pub fn parse(text: impl Into<Arc<str>>) -> Self {
        let text = text.into();
        let parsed = parser::parse(&text);
        Self { tokens: parsed.tokens, nodes: parsed.nodes, errors: parsed.errors, extensions: parsed.extensions, text }
    }

    /// The source text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The source text, shared.
    pub fn shared_text(&self) -> Arc<str> {
        Arc::clone(&self.text)
    }

    /// All that is wrong with the text, by position. Empty exactly when `ron` accepts the text as a `ron::Value`.
    pub fn errors(&self) -> &[SyntaxError] {
        &self.errors
    }

    /// The extensions that the document enables in its attributes.
    pub fn extensions(&self) -> Extensions {
        self.extensions
    }

    /// The document node, which covers the whole text.
    pub fn root(&self) -> NodeRef<'_> {
        NodeRef { tree: self, id: NodeId(0) }
    }

    /// The document's value, if it has one.
    pub fn value(&self) -> Option<NodeRef<'_>> {
        self.root().children().find(|node| node.kind().is_value())
    }

    /// Number of nodes in the tree.
    pub fn n_nodes(&self) -> usize {
        self.nodes.len()
    }

    /// All tokens, blanks and comments among them.
    pub fn tokens(&self) -> impl DoubleEndedIterator<Item = TokenRef<'_>> + ExactSizeIterator {
        (0..self.tokens.len()).map(|index| TokenRef { tree: self, index })
    }

    /// The node of an id that came from this tree.
    pub fn node(&self, id: NodeId) -> Option<NodeRef<'_>> {
        ((id.0 as usize) < self.nodes.len()).then_some(NodeRef { tree: self, id })
    }

    /// The token that holds the byte at `offset`; the last one for the end of the text. O(log n).
    pub fn token_at(&self, offset: usize) -> Option<TokenRef<'_>> {
        let index = self.tokens.partition_point(|token| token.start as usize <= offset).checked_sub(1)?;
        Some(TokenRef { tree: self, index })
    }

    /// The deepest node that holds the byte at `offset` or ends there. O(depth * width).
    pub fn node_at(&self, offset: usize) -> NodeRef<'_> {
        let mut node = self.root();
        while let Some(child) = node.children().find(|child| child.span().touches(offset)) {
            node = child;
        }
        node
    }

    fn data(&self, id: NodeId) -> NodeData {
        self.nodes[id.0 as usize]
    }

    /// Where the token starts; the end of the text for one past the last.
    fn token_start(&self, index: usize) -> usize {
        self.tokens.get(index).map_or(self.text.len(), |token| token.start as usize)
    }
}

/// A token of a tree.
#[derive(Clone, Copy)]
pub struct TokenRef<'t> {
    tree: &'t Tree,
    index: usize,
}

impl std::fmt::Debug for TokenRef<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{:?} {:?} {:?}", self.kind(), self.span().range(), self.text())
    }
}

impl<'t> TokenRef<'t> {
    /// What the token is.
    pub fn kind(self) -> TokenKind {
        self.tree.tokens.get(self.index).map_or(TokenKind::Unknown, |token| token.kind)
    }

    /// Where it stands in the source.
    pub fn span(self) -> Span {
        Span::new(self.tree.token_start(self.index), self.tree.token_start(self.index + 1))
    }

    /// Its text.
    pub fn text(self) -> &'t str {
        &self.tree.text[self.span().range()]
    }

    /// The name that an identifier, or a string in its place, stands for: `a` for `a`, `r#a` and `"a"`.
    pub fn name(self) -> &'t str {
        let text = self.text();
        match self.kind() {
            TokenKind::RawIdent => text.strip_prefix("r#").unwrap_or(text),
            TokenKind::String => text.trim_matches('"'),
            _ => text,
        }
    }

    /// The token after this one.
    pub fn next(self) -> Option<Self> {
        (self.index + 1 < self.tree.tokens.len()).then_some(Self { index: self.index + 1, ..self })
    }

    /// The token before this one.
    pub fn prev(self) -> Option<Self> {
        self.index.checked_sub(1).map(|index| Self { index, ..self })
    }
}

/// A node of a tree. Its span runs from its first token that is no blank or comment to its last such token.
#[derive(Clone, Copy)]
pub struct NodeRef<'t> {
    tree: &'t Tree,
    id: NodeId,
}

impl std::fmt::Debug for NodeRef<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{:?} {:?} {:?}", self.kind(), self.span().range(), self.text())
    }
}

impl PartialEq for NodeRef<'_> {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self.tree, other.tree) && self.id == other.id
    }
}

impl<'t> NodeRef<'t> {
    /// The node's id, which outlives the borrow of the tree.
    pub fn id(self) -> NodeId {
        self.id
    }

    /// The tree that it is part of.
    pub fn tree(self) -> &'t Tree {
        self.tree
    }

    /// What the node is.
    pub fn kind(self) -> NodeKind {
        self.tree.data(self.id).kind
    }

    /// Where it stands in the source, without the blanks and comments around it.
    pub fn span(self) -> Span {
        let (first, end) = self.tree.data(self.id).tokens;
        let start = self.tree.token_start(first as usize);
        Span::new(start, self.tree.token_start(end as usize).max(start))
    }

    /// Its text, comments inside it included.
    pub fn text(self) -> &'t str {
        &self.tree.text[self.span().range()]
    }

    /// The node around it; none for the document.
    pub fn parent(self) -> Option<Self> {
        let parent = self.tree.data(self.id).parent;
        (self.id.0 != 0).then_some(Self { id: NodeId(parent), ..self })
    }

    /// The nodes directly inside it, in order.
    pub fn children(self) -> impl Iterator<Item = NodeRef<'t>> + use<'t> {
        let end = self.tree.data(self.id).subtree_end;
        let mut next = self.id.0 + 1;
        std::iter::from_fn(move || {
            let child = (next < end).then_some(Self { id: NodeId(next), ..self })?;
            next = self.tree.data(child.id).subtree_end.max(next + 1);
            Some(child)
        })
    }

    /// The node itself and all nodes inside it, in order.
    pub fn descendants(self) -> impl Iterator<Item = NodeRef<'t>> + use<'t> {
        (self.id.0..self.tree.data(self.id).subtree_end).map(move |id| Self { id: NodeId(id), ..self })
    }

    /// Its tokens, blanks and comments and those of the nodes inside it included.
    pub fn tokens(self) -> impl DoubleEndedIterator<Item = TokenRef<'t>> + ExactSizeIterator + use<'t> {
        let (first, end) = self.tree.data(self.id).tokens;
        (first as usize..end as usize).map(move |index| TokenRef { tree: self.tree, index })
    }

    /// Its first token.
    pub fn first_token(self) -> Option<TokenRef<'t>> {
        self.tokens().next()
    }

    /// Its last token.
    pub fn last_token(self) -> Option<TokenRef<'t>> {
        self.tokens().next_back()
    }

    /// The name of a struct, tuple or bare name; the field's name of a field.
    pub fn name(self) -> Option<TokenRef<'t>> {
        let named = matches!(self.kind(), NodeKind::Struct | NodeKind::Tuple | NodeKind::Ident | NodeKind::Field);
        let is_name = |token: &TokenRef<'_>| matches!(token.kind(), TokenKind::Ident | TokenKind::RawIdent | TokenKind::String);
        if named { self.first_token().filter(is_name) } else { None }
    }

    /// The fields of a struct, in order, doubled ones included.
    pub fn fields(self) -> impl Iterator<Item = FieldRef<'t>> + use<'t> {
        self.children().filter(|node| node.kind() == NodeKind::Field).map(FieldRef)
    }

    /// The first field of that name. O(fields).
    pub fn field(self, name: &str) -> Option<FieldRef<'t>> {
        self.fields().find(|field| field.name() == name)
    }

    /// The entries of a map, in order, doubled ones included.
    pub fn entries(self) -> impl Iterator<Item = EntryRef<'t>> + use<'t> {
        self.children().filter(|node| node.kind() == NodeKind::Entry).map(EntryRef)
    }

    /// The values directly inside it: the elements of a list or tuple, the ends of a range, what is in `Some`, a field's value.
    pub fn elements(self) -> impl Iterator<Item = NodeRef<'t>> + use<'t> {
        self.children().filter(|node| node.kind().is_value())
    }

    /// The value in `Some(value)`; for all else the node itself.
    pub fn unwrap_some(self) -> Self {
        let mut node = self;
        while let (NodeKind::Some, Some(inner)) = (node.kind(), node.elements().next()) {
            node = inner;
        }
        node
    }

    /// The value of a string that is whole, with its escapes resolved and a way back to the source.
    pub fn as_str(self) -> Option<StrValue<'t>> {
        if self.kind() != NodeKind::String {
            return None;
        }
        let token = self.first_token()?;
        let (text, start) = (token.text(), token.span().start);
        if token.kind() == TokenKind::RawString {
            let open = text.find('"')? + 1;
            // The opening is `r`, the hashes and the quote; the closing is as long but for the `r`.
            let content = text.get(open..text.len().checked_sub(open - 1)?)?;
            return Some(StrValue::plain(content, start + open));
        }
        let content = text.strip_prefix('"')?;
        let content = if text.len() > 1 { content.strip_suffix('"').unwrap_or(content) } else { content };
        Some(StrValue::unescape(content, start + 1))
    }

    /// The value of `true` or `false`.
    pub fn as_bool(self) -> Option<bool> {
        (self.kind() == NodeKind::Bool).then(|| self.text() == "true")
    }

    /// In words, what the node is, for messages: `string`, `integer`, `list` and the like.
    pub fn describe(self) -> &'static str {
        match self.kind() {
            NodeKind::Document => "document",
            NodeKind::Attribute => "attribute",
            NodeKind::Struct => "struct",
            NodeKind::Tuple => "tuple",
            NodeKind::Unit => "unit",
            NodeKind::Ident => "name",
            NodeKind::Field => "field",
            NodeKind::List => "list",
            NodeKind::Map => "map",
            NodeKind::Entry => "entry",
            NodeKind::Some | NodeKind::None => "option",
            NodeKind::Bool => "boolean",
            NodeKind::Number if is_float_text(self.text()) => "float",
            NodeKind::Number => "integer",
            NodeKind::Byte => "byte",
            NodeKind::Char => "character",
            NodeKind::String => "string",
            NodeKind::ByteString => "byte string",
            NodeKind::Range => "range",
            NodeKind::Error => "text with errors",
        }
    }

    /// The comments that belong to what starts here: those on the lines right above, up to a blank line or other code, and those
    /// before it on its own line. For the value of a field or entry, ask the field or entry.
    pub fn comments_before(self) -> Vec<TokenRef<'t>> {
        let mut comments = Vec::new();
        let mut token = self.first_token().and_then(TokenRef::prev);
        while let Some(current) = token.filter(|token| token.kind().is_trivia()) {
            let line_ends = current.text().matches('\n').count();
            if current.kind() == TokenKind::Whitespace && line_ends > 1 {
                break;
            }
            if current.kind().is_comment() {
                comments.push(current);
            }
            token = current.prev();
        }
        comments.reverse();
        // A comment on the line on which other code ends belongs to that code.
        let is_behind_code = |comment: &TokenRef<'_>| {
            let before = comment.prev().filter(|token| token.kind() == TokenKind::Whitespace && !token.text().contains('\n'));
            before.and_then(TokenRef::prev).or(comment.prev()).is_some_and(|token| !token.kind().is_trivia())
        };
        let starts_same_line = |comment: &TokenRef<'_>| !self.tree.text[comment.span().start..self.span().start].contains('\n');
        if comments.first().is_some_and(|first| is_behind_code(first) && !starts_same_line(first)) {
            comments.remove(0);
        }
        comments
    }

    /// The comment behind it on the line on which it ends, past a comma.
    pub fn comment_after(self) -> Option<TokenRef<'t>> {
        let mut token = self.last_token()?.next()?;
        loop {
            match token.kind() {
                kind if kind.is_comment() => return Some(token),
                TokenKind::Whitespace if !token.text().contains('\n') => (),
                TokenKind::Comma => (),
                _ => return None,
            }
            token = token.next()?;
        }
    }

    /// The text of [`comments_before`](Self::comments_before) without the comment marks, a line for each line.
    pub fn doc(self) -> String {
        let lines = self.comments_before().into_iter().flat_map(|comment| {
            let text = comment.text();
            let text = text.strip_prefix("/*").map_or(text, |inner| inner.strip_suffix("*/").unwrap_or(inner));
            text.lines().map(|line| line.trim().trim_start_matches(['/', '*']).trim())
        });
        lines.collect::<Vec<_>>().join("\n").trim().to_owned()
    }
}

/// Whether the text of a number is that of a float rather than of an integer.
fn is_float_text(text: &str) -> bool {
    let digits = text.trim_start_matches(['+', '-']);
    !digits.starts_with("0x") && digits.contains(['.', 'e', 'E', 'f', 'N'])
}

/// `name: value` in a struct.
#[derive(Clone, Copy, Debug)]
pub struct FieldRef<'t>(NodeRef<'t>);

impl<'t> FieldRef<'t> {
    /// The whole field.
    pub fn node(self) -> NodeRef<'t> {
        self.0
    }

    /// The field's name; empty where it is missing.
    pub fn name(self) -> &'t str {
        self.0.name().map_or("", TokenRef::name)
    }

    /// Where the name stands.
    pub fn name_span(self) -> Span {
        self.0.name().map_or(Span::new(self.0.span().start, self.0.span().start), TokenRef::span)
    }

    /// The field's value; none where it is missing.
    pub fn value(self) -> Option<NodeRef<'t>> {
        self.0.elements().next()
    }
}

/// `key: value` in a map.
#[derive(Clone, Copy, Debug)]
pub struct EntryRef<'t>(NodeRef<'t>);

impl<'t> EntryRef<'t> {
    /// The whole entry.
    pub fn node(self) -> NodeRef<'t> {
        self.0
    }

    /// The key; none where it is missing.
    pub fn key(self) -> Option<NodeRef<'t>> {
        self.0.elements().next().filter(|key| self.colon().is_none_or(|colon| key.span().end <= colon))
    }

    /// The value; none where it is missing.
    pub fn value(self) -> Option<NodeRef<'t>> {
        self.0.elements().nth(usize::from(self.key().is_some()))
    }

    /// Where the colon stands: the first of the entry's own.
    fn colon(self) -> Option<usize> {
        let first = self.0.children().next().map_or(self.0.span().start, |child| child.span().end);
        let colon = self.0.tokens().find(|token| token.kind() == TokenKind::Colon && token.span().start >= first);
        colon.map(|token| token.span().start)
    }
}
