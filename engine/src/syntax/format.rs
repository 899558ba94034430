//! The canonical layout of a document: one text for one tree, with every comment kept.
//!
//! Only blanks, line ends and commas at the ends of items change; every other token stays as it was written. What fits on a line stands on one,
//! but for the document itself and its maps of records, which have a line for each item, so that a change of one item is a change of its lines alone.
//! What does not fit has a line for each item too, but for lists of short values (numbers, points, names), which would be columns of one word.

use super::lexer::TokenKind;
use super::tree::{NodeKind, NodeRef, TokenRef, Tree};

/// The most columns of a line on which several items stand.
const WIDTH: usize = 140;
/// The most columns of a value that shares its line with others of a list that has lines.
const SHORT: usize = 40;
/// How a line with an opening bracket ends.
const OPENED: [&str; 3] = ["(\n", "[\n", "{\n"];
/// Columns of one level.
const STEP: usize = 4;

/// The text of a tree in canonical layout; `None` where the text is no RON, as what is meant is then a guess. Formatting twice changes nothing more.
pub fn format(tree: &Tree) -> Option<String> {
    if !tree.errors().is_empty() {
        return None;
    }
    let mut printer = Printer { out: String::new(), source: tree.text() };
    printer.document(tree);
    Some(printer.out)
}

/// A value without comments, blanks and commas at the ends of items, so that one value has one text in any layout.
pub fn canonical(text: &str) -> String {
    let tree = Tree::parse(text);
    let mut out = String::with_capacity(text.len());
    for token in tree.tokens().filter(|t| !t.kind().is_trivia()) {
        if out.ends_with(',') && matches!(token.kind(), TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace) {
            out.pop();
        }
        out.push_str(token.text());
    }
    out
}

/// A comment with a line of its own.
struct Comment<'t> {
    token: TokenRef<'t>,
    /// True where a blank line stands before it.
    is_apart: bool,
}

/// One item between two brackets, or the document's, with the comments that go with it.
struct Item<'t> {
    node: NodeRef<'t>,
    before: Vec<Comment<'t>>,
    /// On the line on which it ends.
    after: Vec<TokenRef<'t>>,
    /// True where a blank line stands before it.
    is_apart: bool,
}

/// What stands between two brackets.
struct Items<'t> {
    items: Vec<Item<'t>>,
    /// Before the closing bracket.
    last: Vec<Comment<'t>>,
}

struct Printer<'t> {
    out: String,
    source: &'t str,
}

/// True for a node that has brackets with items between them.
fn is_container(node: NodeRef<'_>) -> bool {
    matches!(node.kind(), NodeKind::Struct | NodeKind::Tuple | NodeKind::List | NodeKind::Map | NodeKind::Some)
}

/// True for the value of the document, and for its maps of records; what a graph is compared by is a line where it fits.
fn has_lines(node: NodeRef<'_>) -> bool {
    let is_golden = |node: NodeRef<'_>| node.first_token().is_some_and(|t| t.text() == "Golden");
    let is_value = |node: NodeRef<'_>| node.parent().is_some_and(|p| p.kind() == NodeKind::Document);
    let is_whole = |node: NodeRef<'_>| node.kind() == NodeKind::Struct && is_value(node) && !is_golden(node);
    let field = node.parent().filter(|p| node.kind() == NodeKind::Map && p.kind() == NodeKind::Field);
    let is_named = |field: NodeRef<'_>| field.name().is_some_and(|n| matches!(n.name(), "nodes" | "params"));
    let is_records = field.is_some_and(|f| is_named(f) && f.parent().is_some_and(is_whole));
    node.children().next().is_some() && (is_whole(node) || is_records)
}

/// The comments and items directly inside `node`, of which `open` is the opening bracket; everything for the document.
fn items<'t>(node: NodeRef<'t>, open: Option<TokenRef<'t>>) -> Items<'t> {
    let mut found = Items { items: Vec::new(), last: Vec::new() };
    let mut children = node.children().peekable();
    let from = open.map_or(0, |o| o.span().end);
    let (mut pending, mut lines) = (Vec::new(), 0);
    for token in node.tokens().filter(|t| t.span().start >= from) {
        if found.items.last().is_some_and(|last: &Item<'_>| token.span().start < last.node.span().end) {
            continue;
        }
        if let Some(child) = children.next_if(|c| c.span().start <= token.span().start) {
            // Comments inside a field, around its colon, would break its line: they stand before it.
            pending.extend(stray_comments(child).into_iter().map(|token| Comment { token, is_apart: false }));
            found.items.push(Item { node: child, before: std::mem::take(&mut pending), after: Vec::new(), is_apart: lines > 1 });
            lines = 0;
        } else if token.kind() == TokenKind::Whitespace {
            lines += token.text().matches('\n').count();
        } else if token.kind().is_comment() {
            let is_behind = lines == 0 && pending.is_empty() && ends_line(token);
            match found.items.last_mut().filter(|_| is_behind) {
                Some(item) => item.after.push(token),
                None => pending.push(Comment { token, is_apart: lines > 1 }),
            }
            lines = 0;
        }
    }
    found.last = pending;
    found
}

/// True where no other item follows on the line.
fn ends_line(token: TokenRef<'_>) -> bool {
    let mut next = token.next();
    while let Some(token) = next {
        match token.kind() {
            TokenKind::Whitespace if token.text().contains('\n') => return true,
            TokenKind::Whitespace | TokenKind::Comma | TokenKind::BlockComment => next = token.next(),
            kind => return matches!(kind, TokenKind::LineComment | TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace),
        }
    }
    true
}

/// The opening bracket of a container.
fn opening<'t>(node: NodeRef<'t>) -> Option<TokenRef<'t>> {
    node.tokens().find(|t| matches!(t.kind(), TokenKind::LParen | TokenKind::LBracket | TokenKind::LBrace))
}

/// Comments inside an item that stand at no item of a container in it: around a colon, or between a name and its bracket.
fn stray_comments<'t>(node: NodeRef<'t>) -> Vec<TokenRef<'t>> {
    let mut strays = Vec::new();
    let mut children = node.children();
    let mut next = children.next();
    let inside = if is_container(node) { opening(node).map(|o| o.span().start) } else { None };
    for token in node.tokens() {
        while next.is_some_and(|c| c.span().end <= token.span().start) {
            next = children.next();
        }
        let in_child = next.is_some_and(|c| c.span().start <= token.span().start);
        let in_brackets = inside.is_some_and(|open| token.span().start > open);
        if token.kind().is_comment() && !in_child && !in_brackets {
            strays.push(token);
        }
    }
    if inside.is_none() {
        strays.extend(node.children().flat_map(stray_comments));
    }
    strays
}

impl<'t> Printer<'t> {
    fn document(&mut self, tree: &'t Tree) {
        let found = items(tree.root(), None);
        for item in &found.items {
            self.item(item, 0, "");
        }
        found.last.iter().for_each(|comment| self.comment(comment, 0));
    }

    /// An item on lines of its own, with its comments.
    fn item(&mut self, item: &Item<'t>, indent: usize, comma: &str) {
        item.before.iter().for_each(|comment| self.comment(comment, indent));
        self.apart(item.is_apart);
        self.indent(indent);
        self.value(item.node, indent, comma.len());
        self.out.push_str(comma);
        for comment in &item.after {
            self.out.push(' ');
            self.out.push_str(comment.text().trim_end());
        }
        self.out.push('\n');
    }

    /// A blank line, but for one at the start or right behind an opening bracket.
    fn apart(&mut self, is_apart: bool) {
        if is_apart && !self.out.is_empty() && !OPENED.iter().any(|opened| self.out.ends_with(opened)) {
            self.out.push('\n');
        }
    }

    fn comment(&mut self, comment: &Comment<'t>, indent: usize) {
        self.apart(comment.is_apart);
        self.indent(indent);
        self.out.push_str(comment.token.text().trim_end());
        self.out.push('\n');
    }

    fn indent(&mut self, indent: usize) {
        self.out.extend(std::iter::repeat_n(' ', indent));
    }

    /// The column at which the next character goes.
    fn column(&self) -> usize {
        self.out.len() - self.out.rfind('\n').map_or(0, |at| at + 1)
    }

    /// A value, field or entry from here on, with `behind` columns to follow on its last line.
    fn value(&mut self, node: NodeRef<'t>, indent: usize, behind: usize) {
        if let Some(flat) = self.flat(node).filter(|flat| self.column() + flat.chars().count() + behind <= WIDTH || !breaks(node)) {
            self.out.push_str(&flat);
        } else if is_container(node) {
            self.lines(node, indent);
        } else {
            self.pair(node, indent, behind);
        }
    }

    /// A field or an entry whose value has lines.
    fn pair(&mut self, node: NodeRef<'t>, indent: usize, behind: usize) {
        let mut children: Vec<_> = node.children().collect();
        let value = children.pop();
        match (node.kind(), children.pop()) {
            (NodeKind::Field, _) => self.out.push_str(node.name().map_or("", TokenRef::text)),
            (_, Some(key)) => self.value(key, indent, 1),
            _ => (),
        }
        self.out.push_str(": ");
        if let Some(value) = value {
            self.value(value, indent, behind);
        }
    }

    /// A container with lines between its brackets.
    fn lines(&mut self, node: NodeRef<'t>, indent: usize) {
        let (Some(open), Some(close)) = (opening(node), node.last_token()) else { return };
        self.out.push_str(node.first_token().filter(|t| t.span() != open.span()).map_or("", TokenRef::text));
        self.out.push_str(open.text());
        let found = items(node, Some(open));
        let inner = indent + STEP;
        self.out.push('\n');
        if let Some(texts) = self.short(&found) {
            self.fill(&texts, inner);
        } else {
            // What `Some` holds is one value, behind which RON has no comma.
            let is_bare = node.kind() == NodeKind::Some && found.items.len() == 1 && found.items.iter().all(|i| i.node.kind().is_value());
            let comma = if is_bare { "" } else { "," };
            found.items.iter().for_each(|item| self.item(item, inner, comma));
        }
        found.last.iter().for_each(|comment| self.comment(comment, inner));
        self.indent(indent);
        self.out.push_str(close.text());
    }

    /// The texts of several items that are short values and have no comments.
    fn short(&self, found: &Items<'t>) -> Option<Vec<String>> {
        let is_plain = found.items.len() > 1 && found.items.iter().all(|i| is_short(i.node) && i.before.is_empty() && i.after.is_empty());
        let texts: Option<Vec<_>> = found.items.iter().map(|i| self.flat(i.node).filter(|text| text.chars().count() <= SHORT)).collect();
        texts.filter(|_| is_plain)
    }

    /// Short values, as many on a line as there is room for.
    fn fill(&mut self, texts: &[String], indent: usize) {
        self.indent(indent);
        for (i, text) in texts.iter().enumerate() {
            if i > 0 && self.column() + text.chars().count() + 2 > WIDTH {
                self.out.push('\n');
                self.indent(indent);
            } else if i > 0 {
                self.out.push(' ');
            }
            self.out.push_str(text);
            self.out.push(',');
        }
        self.out.push('\n');
    }

    /// The text on one line; `None` where it cannot stand on one.
    fn flat(&self, node: NodeRef<'t>) -> Option<String> {
        if has_lines(node) {
            return None;
        }
        if is_container(node) {
            return self.flat_container(node);
        }
        match node.kind() {
            NodeKind::Field => Some(format!("{}: {}", node.name()?.text(), self.flat(node.children().last()?)?)),
            NodeKind::Entry => {
                let mut children = node.children();
                Some(format!("{}: {}", self.flat(children.next()?)?, self.flat(children.next()?)?))
            }
            NodeKind::Attribute => Some(joined(node)),
            _ if node.children().next().is_none() && !node.tokens().any(|t| t.kind().is_trivia()) => {
                Some(self.source[node.span().range()].to_owned())
            }
            _ => Some(joined(node)),
        }
    }

    fn flat_container(&self, node: NodeRef<'t>) -> Option<String> {
        let open = opening(node)?;
        let found = items(node, Some(open));
        if !found.last.is_empty() || found.items.iter().any(|i| !i.before.is_empty() || !i.after.is_empty()) {
            return None;
        }
        let parts: Option<Vec<String>> = found.items.iter().map(|i| self.flat(i.node)).collect();
        let inner = parts?.join(", ");
        let name = node.first_token().filter(|t| t.span() != open.span()).map_or("", TokenRef::text);
        let room = if node.kind() == NodeKind::Map && !inner.is_empty() { " " } else { "" };
        // A tuple of one without a name keeps its comma, without which it is a value in brackets.
        let comma = if node.kind() == NodeKind::Tuple && name.is_empty() && found.items.len() == 1 && has_comma(node) { "," } else { "" };
        Some(format!("{name}{}{room}{inner}{comma}{room}{}", open.text(), node.last_token()?.text()))
    }
}

/// True where lines help: inside a container that has items.
fn breaks(node: NodeRef<'_>) -> bool {
    node.descendants().any(|n| is_container(n) && n.children().next().is_some())
}

/// True for a value without a record, list or map in it.
fn is_short(node: NodeRef<'_>) -> bool {
    let is_deep = |kind| matches!(kind, NodeKind::Struct | NodeKind::List | NodeKind::Map);
    node.kind().is_value() && !node.descendants().any(|n| is_deep(n.kind()))
}

/// True where a comma stands directly inside a tuple of one.
fn has_comma(node: NodeRef<'_>) -> bool {
    let end = node.children().last().map_or(0, |c| c.span().end);
    node.tokens().any(|t| t.kind() == TokenKind::Comma && t.span().start >= end)
}

/// The tokens of a node that is no container, without blanks but where a comma or an equals sign has one.
fn joined(node: NodeRef<'_>) -> String {
    let mut out = String::new();
    for token in node.tokens().filter(|t| !t.kind().is_trivia()) {
        match token.kind() {
            TokenKind::Comma => out.push_str(", "),
            TokenKind::Eq => out.push_str(" = "),
            _ => out.push_str(token.text()),
        }
    }
    out.replace(", )", ")")
}
