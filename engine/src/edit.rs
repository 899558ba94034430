//! Changes of graph files that touch no byte but those that they must: for editors, upgrades and scripts.
//!
//! An edit is worked out on the text's own tree and gives replacements of spans. Comments, layout and what the program does not know, node types
//! of plugins that are not there among it, stay as they are.

use thiserror::Error;

use crate::diag::Span;
use crate::syntax::{EntryRef, FieldRef, NodeKind, NodeRef, TokenKind, TokenRef, Tree};

/// One change of a graph.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Edit {
    /// Gives an input of a node, or a parameter's field, another value: `path` is `nodes.track.levels` or `params.gain.default`.
    Set {
        /// Map, name and field with dots between.
        path: [String; 3],
        /// RON text.
        value: String,
    },
    /// Takes an input away, so that its default counts.
    Unset {
        /// As above.
        path: [String; 3],
    },
    /// Gives an input another name; what stands there stays.
    RenameInput {
        /// As above.
        path: [String; 3],
        /// The name that it gets.
        to: String,
    },
    /// Gives a node another name, wherever the file names it.
    RenameNode {
        /// Its name.
        from: String,
        /// The name that it gets.
        to: String,
    },
    /// Gives a parameter another name, wherever the file reads it.
    RenameParam {
        /// Its name.
        from: String,
        /// The name that it gets.
        to: String,
    },
    /// Adds a node at the end.
    AddNode {
        /// Its name.
        name: String,
        /// RON text: `(type: "comp.over", ...)`.
        record: String,
    },
    /// Removes a node that nothing reads.
    RemoveNode {
        /// Its name.
        name: String,
    },
}

/// Why an edit cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum EditError {
    /// The text, or what is to be put into it, is no RON.
    #[error("expected RON, found an error at byte {at}: {message}")]
    Syntax {
        /// Offset in the text.
        at: usize,
        /// What is wrong.
        message: String,
    },
    /// There is nothing of that name.
    #[error("expected `{0}` in the graph, found none")]
    Missing(String),
    /// There is something of that name already.
    #[error("expected a name that is free, found `{0}`, which is taken")]
    Taken(String),
    /// A name that cannot be one.
    #[error("expected a name without `.`, `@`, `$`, `/` and quotes, found `{0}`")]
    BadName(String),
    /// Something reads the node.
    #[error("expected a node that nothing reads, found `{node}`, which `{reader}` reads")]
    Read {
        /// The node.
        node: String,
        /// Who reads it.
        reader: String,
    },
}

/// A span and what stands there afterwards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patch {
    /// What is replaced; empty for what is put in.
    pub span: Span,
    /// What stands there afterwards.
    pub text: String,
}

/// The text after an edit.
///
/// # Errors
/// Where the text or the edit is wrong; nothing is changed then.
pub fn apply(text: &str, edit: &Edit) -> Result<String, EditError> {
    let tree = sound(text)?;
    let mut out = text.to_owned();
    let mut patches = patches(&tree, edit)?;
    patches.sort_by_key(|p| std::cmp::Reverse(p.span.start));
    for patch in patches {
        out.replace_range(patch.span.range(), &patch.text);
    }
    sound(&out)?;
    Ok(out)
}

fn sound(text: &str) -> Result<Tree, EditError> {
    let tree = Tree::parse(text);
    match tree.errors().first() {
        None => Ok(tree),
        Some(error) => Err(EditError::Syntax { at: error.span.start, message: error.message.clone() }),
    }
}

/// The replacements that make up an edit.
///
/// # Errors
/// Where there is nothing of the name, or the edit would break the graph.
pub fn patches(tree: &Tree, edit: &Edit) -> Result<Vec<Patch>, EditError> {
    match edit {
        Edit::Set { path, value } => set(tree, path, value).map(|patch| vec![patch]),
        Edit::Unset { path: [map, name, field] } => {
            let record = record(tree, map, name)?;
            let field = record.field(field).ok_or_else(|| EditError::Missing(format!("{map}.{name}.{field}")))?;
            Ok(vec![removal(tree, field.node())])
        }
        Edit::RenameInput { path: [of, name, field], to } => {
            let record = record(tree, of, name)?;
            let found = record.field(field).ok_or_else(|| EditError::Missing(format!("{of}.{name}.{field}")))?;
            if record.field(to).is_some() {
                return Err(EditError::Taken(to.clone()));
            }
            Ok(vec![Patch { span: found.name_span(), text: word(to)?.to_owned() }])
        }
        Edit::RenameNode { from, to } => rename(tree, "nodes", from, to, '@'),
        Edit::RenameParam { from, to } => rename(tree, "params", from, to, '$'),
        Edit::AddNode { name, record } => add(tree, name, record).map(|patch| vec![patch]),
        Edit::RemoveNode { name } => remove(tree, name).map(|patch| vec![patch]),
    }
}

/// The map `nodes` or `params` of the graph.
fn map<'t>(tree: &'t Tree, name: &str) -> Result<NodeRef<'t>, EditError> {
    let value = tree.value().and_then(|root| root.field(name)).and_then(FieldRef::value);
    value.filter(|v| v.kind() == NodeKind::Map).ok_or_else(|| EditError::Missing(name.to_owned()))
}

fn entry<'t>(map: NodeRef<'t>, name: &str) -> Option<EntryRef<'t>> {
    map.entries().find(|e| e.key().and_then(NodeRef::as_str).is_some_and(|k| k.value() == name))
}

/// The record of a node or a parameter.
fn record<'t>(tree: &'t Tree, of: &str, name: &str) -> Result<NodeRef<'t>, EditError> {
    let found = entry(map(tree, of)?, name).and_then(EntryRef::value);
    found.filter(|v| matches!(v.kind(), NodeKind::Struct | NodeKind::Unit)).ok_or_else(|| EditError::Missing(format!("{of}.{name}")))
}

fn set(tree: &Tree, [of, name, field]: &[String; 3], value: &str) -> Result<Patch, EditError> {
    sound(value)?;
    let field = word(field)?;
    let record = record(tree, of, name)?;
    match record.field(field).and_then(FieldRef::value) {
        Some(old) => Ok(Patch { span: old.span(), text: value.to_owned() }),
        None => Ok(insertion(tree, record, &format!("{field}: {value}"))),
    }
}

/// The name of a field, where it can be one.
fn word(name: &str) -> Result<&str, EditError> {
    let is_word = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    if is_word { Ok(name) } else { Err(EditError::BadName(name.to_owned())) }
}

fn add(tree: &Tree, name: &str, record: &str) -> Result<Patch, EditError> {
    sound(record)?;
    let nodes = map(tree, "nodes")?;
    free(nodes, name)?;
    Ok(insertion(tree, nodes, &format!("\"{name}\": {record}")))
}

/// Says where a name cannot be one, or is taken.
fn free(map: NodeRef<'_>, name: &str) -> Result<(), EditError> {
    if name.is_empty() || name.contains(['.', '@', '$', '/', '"', '\\']) || name.chars().any(char::is_control) {
        return Err(EditError::BadName(name.to_owned()));
    }
    if entry(map, name).is_some() { Err(EditError::Taken(name.to_owned())) } else { Ok(()) }
}

/// Puts an item at the end of a container, laid out as the last one is.
fn insertion(tree: &Tree, container: NodeRef<'_>, item: &str) -> Patch {
    let close = container.last_token().map_or(container.span().end, |t| t.span().start);
    let Some(last) = container.children().last() else {
        let has_lines = tree.text()[container.span().range()].contains('\n');
        let room = if container.kind() == NodeKind::Map && !has_lines { " " } else { "" };
        return Patch { span: Span::new(close, close), text: format!("{room}{item}{room}") };
    };
    let end = last.span().end;
    let comma = container.tokens().find(|t| t.kind() == TokenKind::Comma && t.span().start >= end);
    match line_indent(tree.text(), last.span().start) {
        // The last item begins a line of its own, so the new one does as well: behind a comment at the end of that line.
        Some(indent) => {
            let at = last.comment_after().map(|c| c.span().end).into_iter().chain(comma.map(|c| c.span().end)).max().unwrap_or(end);
            let before = if comma.is_some() { String::new() } else { ",".to_owned() };
            let text = format!("\n{indent}{item},");
            // A comma that is missing goes right behind the item, which a comment may part from the line's end.
            match (comma, at == end) {
                (None, false) => Patch { span: Span::new(end, at), text: format!(",{}{text}", &tree.text()[end..at]) },
                _ => Patch { span: Span::new(at, at), text: format!("{before}{text}") },
            }
        }
        None => {
            let at = comma.map_or(end, |c| c.span().end);
            let text = if comma.is_some() { format!(" {item},") } else { format!(", {item}") };
            Patch { span: Span::new(at, at), text }
        }
    }
}

/// The blanks before `at` where nothing else stands on its line.
fn line_indent(text: &str, at: usize) -> Option<&str> {
    let start = text[..at].rfind('\n').map(|n| n + 1)?;
    let before = &text[start..at];
    before.chars().all(|c| c == ' ' || c == '\t').then_some(before)
}

/// Takes an item away with its comma: with its lines and the comments on and right above them where it has lines of its own.
fn removal(tree: &Tree, item: NodeRef<'_>) -> Patch {
    let text = tree.text();
    let behind = |from: usize| item.parent().and_then(|p| p.tokens().find(|t| t.kind() == TokenKind::Comma && t.span().start >= from));
    let span = item.span();
    let comma = behind(span.end).filter(|c| text[span.end..c.span().start].trim().is_empty());
    let end = comma.map_or(span.end, |c| c.span().end);
    if line_indent(text, span.start).is_some() {
        let from = item.comments_before().first().map_or(span.start, |c| c.span().start);
        let line_start = text[..from].rfind('\n').map_or(0, |n| n + 1);
        let line_end = text[end..].find('\n').map_or(text.len(), |n| end + n + 1);
        let rest = text[end..line_end].trim();
        if rest.is_empty() || rest.starts_with("//") {
            return Patch { span: Span::new(line_start, line_end), text: String::new() };
        }
    }
    if comma.is_some() {
        let blanks = text[end..].len() - text[end..].trim_start_matches([' ', '\t']).len();
        return Patch { span: Span::new(span.start, end + blanks), text: String::new() };
    }
    // The last item of a line: the comma before it goes.
    let before = text[..span.start].trim_end();
    let start = if before.ends_with(',') { before.len() - 1 } else { span.start };
    Patch { span: Span::new(start, span.end), text: String::new() }
}

/// The tokens in which a name may stand: `"@name..."` or `"...$name..."`.
fn strings(tree: &Tree) -> impl Iterator<Item = TokenRef<'_>> {
    tree.tokens().filter(|t| t.kind() == TokenKind::String)
}

/// Where `sign` and the name stand in a text, without the sign.
fn uses(token: TokenRef<'_>, sign: char, name: &str) -> Vec<Span> {
    let text = token.text();
    let start = token.span().start;
    if sign == '@' {
        let rest = text.strip_prefix("\"@").and_then(|t| t.strip_prefix(name));
        let is_whole = rest.is_some_and(|r| r.starts_with(['.', '"']));
        return is_whole.then(|| Span::new(start + 2, start + 2 + name.len())).into_iter().collect();
    }
    let plain = text.replace("$$", "  ");
    let at = plain.match_indices('$').map(|(at, _)| at + 1);
    let ends = |at: usize| !text[at + name.len()..].starts_with(|c: char| c.is_ascii_alphanumeric() || c == '_');
    at.filter(|&at| text[at..].starts_with(name) && ends(at)).map(|at| Span::new(start + at, start + at + name.len())).collect()
}

fn rename(tree: &Tree, of: &str, from: &str, to: &str, sign: char) -> Result<Vec<Patch>, EditError> {
    let map = map(tree, of)?;
    let key = entry(map, from).and_then(EntryRef::key).ok_or_else(|| EditError::Missing(format!("{of}.{from}")))?;
    free(map, to)?;
    if sign == '$' && !to.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') {
        return Err(EditError::BadName(to.to_owned()));
    }
    let uses = strings(tree).flat_map(|token| uses(token, sign, from));
    let mut patches: Vec<Patch> = uses.map(|span| Patch { span, text: to.to_owned() }).collect();
    patches.push(Patch { span: key.span(), text: format!("\"{to}\"") });
    Ok(patches)
}

fn remove(tree: &Tree, name: &str) -> Result<Patch, EditError> {
    let nodes = map(tree, "nodes")?;
    let found = entry(nodes, name).ok_or_else(|| EditError::Missing(format!("nodes.{name}")))?;
    let own = found.node().span();
    let is_outside = |t: &TokenRef<'_>| t.span().start < own.start || own.end < t.span().end;
    let reader = strings(tree).find(|t| is_outside(t) && !uses(*t, '@', name).is_empty());
    if let Some(reader) = reader {
        let mut around = Some(tree.node_at(reader.span().start));
        while let Some(node) = around.filter(|n| n.kind() != NodeKind::Entry) {
            around = node.parent();
        }
        let reader = around.and_then(|n| n.children().next()).map_or("the graph", NodeRef::text).trim_matches('"').to_owned();
        return Err(EditError::Read { node: name.to_owned(), reader });
    }
    Ok(removal(tree, found.node()))
}

#[cfg(test)]
mod tests;
