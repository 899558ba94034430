//! One graph file as it is written: what it declares, and every place where a name of it is mentioned.

use std::path::PathBuf;
use std::sync::Arc;

use pegbar_engine::diag::Span;
use pegbar_engine::syntax::{EntryRef, FieldRef, NodeId, NodeKind, NodeRef, StrValue, Tree};

use super::text::{Encoding, Lines, Range};

/// A file, read and taken apart.
pub(super) struct Sheet {
    /// Where it stands, canonical if it is on disk.
    pub(super) path: PathBuf,
    /// The name by which the editor knows it.
    pub(super) uri: String,
    pub(super) tree: Tree,
    lines: Lines,
    pub(super) nodes: Vec<NodeDecl>,
    pub(super) params: Vec<ParamDecl>,
    pub(super) outputs: Vec<OutputDecl>,
    pub(super) clocks: Vec<Decl>,
    /// The graph's own `doc`.
    pub(super) doc: String,
    pub(super) has_frames: bool,
    /// Every mention of a name, in the order of the text but for those inside each other.
    pub(super) mentions: Vec<Mention>,
}

/// A name that is declared.
#[derive(Clone, Debug)]
pub(super) struct Decl {
    pub(super) name: String,
    /// The name, without quotes.
    pub(super) span: Span,
    /// All of the entry.
    pub(super) whole: Span,
}

/// A node.
#[derive(Clone, Debug)]
pub(super) struct NodeDecl {
    pub(super) decl: Decl,
    /// Its type as it is written; empty where there is none.
    pub(super) ty: String,
    /// Comments above it.
    pub(super) doc: String,
    /// Its record, if it has one.
    record: Option<NodeId>,
}

impl NodeDecl {
    /// The path in `graph:path`.
    pub(super) fn graph(&self) -> Option<&str> {
        self.ty.strip_prefix("graph:")
    }
}

/// A parameter.
#[derive(Clone, Debug)]
pub(super) struct ParamDecl {
    pub(super) decl: Decl,
    /// Its type as it is written; empty where there is none.
    pub(super) ty: String,
    pub(super) doc: String,
    /// Its default as it is written.
    pub(super) default: Option<String>,
}

/// An output of the graph.
#[derive(Clone, Debug)]
pub(super) struct OutputDecl {
    pub(super) decl: Decl,
    /// The reference, without its `@`.
    pub(super) of: String,
}

/// A name, where it stands.
#[derive(Clone, Debug)]
pub(super) struct Mention {
    pub(super) span: Span,
    pub(super) what: What,
}

/// What a name means.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum What {
    /// A node: its declaration, or the first part of a reference.
    Node(String),
    /// The output in `@node.port`.
    Port { node: String, port: String },
    /// A parameter: its declaration, or a variable.
    Param(String),
    /// An output of the graph, where it is declared.
    Output(String),
    /// The type of a node, by the position of the node.
    Type(usize),
    /// The name of an input of a node.
    Input { node: usize, input: String },
    /// What stands at an input of a node.
    Value { node: usize, input: String },
    /// The type of a parameter.
    ParamType(String),
    /// A field of the graph.
    Field(String),
}

/// `@node.port` taken apart; what stands before the point, and behind it.
pub(super) fn reference(text: &str) -> Option<(&str, Option<&str>)> {
    let rest = text.strip_prefix('@')?;
    Some(rest.split_once('.').map_or((rest, None), |(node, port)| (node, Some(port))))
}

impl Sheet {
    pub(super) fn read(path: PathBuf, uri: String, text: Arc<str>) -> Self {
        let (tree, lines) = (Tree::parse(Arc::clone(&text)), Lines::of(&text));
        let mut sheet = Self {
            path,
            uri,
            lines,
            nodes: Vec::new(),
            params: Vec::new(),
            outputs: Vec::new(),
            clocks: Vec::new(),
            doc: String::new(),
            has_frames: false,
            mentions: Vec::new(),
            tree: Tree::parse(""),
        };
        for field in tree.value().into_iter().flat_map(NodeRef::fields) {
            sheet.mention(field.name_span(), What::Field(field.name().to_owned()));
            match field.name() {
                "params" => entries(field).for_each(|(decl, entry)| sheet.param(decl, entry)),
                "nodes" => entries(field).for_each(|(decl, entry)| sheet.node(decl, entry)),
                "outputs" => entries(field).for_each(|(decl, entry)| sheet.output(decl, entry)),
                "clocks" => {
                    sheet.clocks.extend(entries(field).map(|(decl, _)| decl));
                    field.value().into_iter().for_each(|v| sheet.strings(v));
                }
                "doc" => sheet.doc = text_of(field.value()),
                "frames" => {
                    sheet.has_frames = true;
                    field.value().into_iter().for_each(|v| sheet.strings(v));
                }
                _ => (),
            }
        }
        sheet.tree = tree;
        sheet
    }

    pub(super) fn text(&self) -> &str {
        self.tree.text()
    }

    pub(super) fn range(&self, span: Span, encoding: Encoding) -> Range {
        self.lines.range(self.text(), span, encoding)
    }

    pub(super) fn offset(&self, position: super::text::Position, encoding: Encoding) -> usize {
        self.lines.offset(self.text(), position, encoding)
    }

    /// The name at an offset: of those around it the shortest.
    pub(super) fn mention_at(&self, offset: usize) -> Option<&Mention> {
        self.mentions.iter().filter(|m| m.span.touches(offset)).min_by_key(|m| m.span.len())
    }

    pub(super) fn find_node(&self, name: &str) -> Option<&NodeDecl> {
        self.nodes.iter().find(|n| n.decl.name == name)
    }

    pub(super) fn find_param(&self, name: &str) -> Option<&ParamDecl> {
        self.params.iter().find(|p| p.decl.name == name)
    }

    pub(super) fn find_output(&self, name: Option<&str>) -> Option<&OutputDecl> {
        self.outputs.iter().find(|o| name.is_none_or(|name| o.decl.name == name))
    }

    /// What stands at an input of a node.
    pub(super) fn value(&self, node: usize, input: &str) -> Option<NodeRef<'_>> {
        self.tree.node(self.nodes.get(node)?.record?)?.field(input)?.value()
    }

    /// True for a graph that is made to be used by others: by itself it lacks what they give it.
    pub(super) fn is_for_others(&self) -> bool {
        self.params.iter().any(|p| p.default.is_none()) || (!self.has_frames && !self.outputs.is_empty())
    }

    fn mention(&mut self, span: Span, what: What) {
        self.mentions.push(Mention { span, what });
    }

    fn param(&mut self, decl: Decl, entry: EntryRef<'_>) {
        self.mention(decl.span, What::Param(decl.name.clone()));
        let field = |name: &str| entry.value().and_then(|v| v.field(name)).and_then(FieldRef::value);
        let ty = text_of(field("type"));
        if let Some(value) = field("type").and_then(NodeRef::as_str) {
            self.mention(content(&value), What::ParamType(ty.clone()));
        }
        let default = field("default");
        default.into_iter().for_each(|d| self.strings(d));
        let doc = Some(text_of(field("doc"))).filter(|d| !d.is_empty()).unwrap_or_else(|| entry.node().doc());
        self.params.push(ParamDecl { decl, ty, doc, default: default.map(|d| d.text().to_owned()) });
    }

    fn node(&mut self, decl: Decl, entry: EntryRef<'_>) {
        let node = self.nodes.len();
        self.mention(decl.span, What::Node(decl.name.clone()));
        let record = entry.value().filter(|v| v.kind() == NodeKind::Struct);
        let mut ty = String::new();
        for field in record.into_iter().flat_map(NodeRef::fields) {
            match (field.name(), field.value()) {
                ("type", value) => {
                    ty = text_of(value);
                    let span = value.map(|v| v.as_str().map_or(v.span(), |s| content(&s)));
                    span.into_iter().for_each(|span| self.mention(span, What::Type(node)));
                }
                (input, value) => {
                    let input = input.to_owned();
                    self.mention(field.name_span(), What::Input { node, input: input.clone() });
                    if let Some(value) = value {
                        self.mention(value.span(), What::Value { node, input });
                        self.strings(value);
                    }
                }
            }
        }
        self.nodes.push(NodeDecl { decl, ty, doc: entry.node().doc(), record: record.map(NodeRef::id) });
    }

    fn output(&mut self, decl: Decl, entry: EntryRef<'_>) {
        self.mention(decl.span, What::Output(decl.name.clone()));
        entry.value().into_iter().for_each(|v| self.strings(v));
        let of = text_of(entry.value()).trim_start_matches('@').to_owned();
        self.outputs.push(OutputDecl { decl, of });
    }

    /// The references and variables in all texts of a value.
    fn strings(&mut self, value: NodeRef<'_>) {
        for text in value.descendants().filter_map(NodeRef::as_str) {
            match reference(text.value()) {
                Some((node, port)) => {
                    self.mention(text.source_span(1..1 + node.len()), What::Node(node.to_owned()));
                    let from = 2 + node.len();
                    let named = port.map(|p| (text.source_span(from..from + p.len()), p.to_owned()));
                    named.into_iter().for_each(|(span, port)| self.mention(span, What::Port { node: node.to_owned(), port }));
                }
                None => self.variables(&text),
            }
        }
    }

    /// Each `$name` of a text; `$$` is a plain dollar sign.
    fn variables(&mut self, text: &StrValue<'_>) {
        let value = text.value();
        let mut at = 0;
        while let Some(dollar) = value[at..].find('$').map(|d| at + d) {
            let n = value[dollar + 1..].bytes().take_while(|b| b.is_ascii_alphanumeric() || *b == b'_').count();
            if n > 0 {
                let name = value[dollar + 1..dollar + 1 + n].to_owned();
                self.mention(text.source_span(dollar + 1..dollar + 1 + n), What::Param(name));
            }
            at = dollar + 1 + n.max(usize::from(value[dollar + 1..].starts_with('$')));
        }
    }
}

/// Where the text between the quotes stands.
fn content(text: &StrValue<'_>) -> Span {
    text.source_span(0..text.value().len())
}

/// A text's value, or a bare word.
fn text_of(value: Option<NodeRef<'_>>) -> String {
    let text = |v: NodeRef<'_>| v.as_str().map_or_else(|| v.text().to_owned(), |s| s.into_value().into_owned());
    value.map(text).unwrap_or_default()
}

/// The entries of a map, with their names.
fn entries<'t>(field: FieldRef<'t>) -> impl Iterator<Item = (Decl, EntryRef<'t>)> {
    let entries = field.value().filter(|v| v.kind() == NodeKind::Map).into_iter().flat_map(NodeRef::entries);
    entries.filter_map(|entry| {
        let key = entry.key()?.as_str()?;
        let span = content(&key);
        Some((Decl { name: key.into_value().into_owned(), span, whole: entry.node().span() }, entry))
    })
}
