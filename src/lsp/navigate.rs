//! From a name to where it is declared, to everywhere that it is used, and to another name.

use std::collections::BTreeMap;
use std::rc::Rc;

use pegbar_engine::diag::Span;
use serde_json::{Value, json};

use super::sheet::{Mention, Sheet, What};
use super::state::State;
use super::text::{Position, Range};
use super::wire::{Failure, INVALID_PARAMS, REQUEST_FAILED};

/// Something that is declared in a graph file under a name.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Thing {
    Node(String),
    Param(String),
    Output(String),
}

impl Thing {
    fn name(&self) -> &str {
        match self {
            Self::Node(name) | Self::Param(name) | Self::Output(name) => name,
        }
    }

    /// Where it is declared.
    fn declared(&self, home: &Sheet) -> Option<Span> {
        let decl = match self {
            Self::Node(name) => home.find_node(name).map(|n| &n.decl),
            Self::Param(name) => home.find_param(name).map(|p| &p.decl),
            Self::Output(name) => home.find_output(Some(name)).map(|o| &o.decl),
        };
        decl.map(|d| d.span)
    }
}

/// The name at a position, and what it stands for with the file that declares that.
struct Named {
    sheet: Rc<Sheet>,
    mention: Mention,
    home: Rc<Sheet>,
    thing: Thing,
}

fn mention(state: &mut State<'_>, uri: &str, position: Position) -> Option<(Rc<Sheet>, Mention)> {
    let sheet = state.sheet(uri)?;
    let mention = sheet.mention_at(sheet.offset(position, state.encoding))?.clone();
    Some((sheet, mention))
}

fn named(state: &mut State<'_>, uri: &str, position: Position) -> Option<Named> {
    let (sheet, mention) = mention(state, uri, position)?;
    let (home, thing) = match &mention.what {
        What::Node(name) => (Rc::clone(&sheet), Thing::Node(name.clone())),
        What::Param(name) => (Rc::clone(&sheet), Thing::Param(name.clone())),
        What::Output(name) => (Rc::clone(&sheet), Thing::Output(name.clone())),
        What::Port { node, port } => (state.sheet_at(&sheet, sheet.find_node(node)?.graph()?)?, Thing::Output(port.clone())),
        What::Input { node, input } => (state.sheet_at(&sheet, sheet.nodes.get(*node)?.graph()?)?, Thing::Param(input.clone())),
        What::Type(_) | What::Value { .. } | What::ParamType(_) | What::Field(_) => return None,
    };
    Some(Named { sheet, mention, home, thing })
}

/// Where the name at a position is declared.
pub(super) fn definition(state: &mut State<'_>, uri: &str, position: Position) -> Option<Value> {
    if let Some(named) = named(state, uri, position)
        && let Some(span) = named.thing.declared(&named.home)
    {
        return Some(json!({ "uri": named.home.uri, "range": named.home.range(span, state.encoding) }));
    }
    let (sheet, mention) = mention(state, uri, position)?;
    match &mention.what {
        What::Type(node) => {
            let inner = state.sheet_at(&sheet, sheet.nodes.get(*node)?.graph()?)?;
            Some(json!({ "uri": inner.uri, "range": Range::default() }))
        }
        // An output of a node that is no graph stands nowhere but at the node.
        What::Port { node, .. } => {
            let span = sheet.find_node(node)?.decl.span;
            Some(json!({ "uri": sheet.uri, "range": sheet.range(span, state.encoding) }))
        }
        _ => None,
    }
}

/// Every place that means the thing: in its own file, and in open files that use this as a graph.
fn uses(state: &mut State<'_>, home: &Rc<Sheet>, thing: &Thing) -> Vec<(Rc<Sheet>, Vec<Span>)> {
    let is_meant = |m: &&Mention| match (&m.what, thing) {
        (What::Node(a), Thing::Node(b)) | (What::Param(a), Thing::Param(b)) | (What::Output(a), Thing::Output(b)) => a == b,
        _ => false,
    };
    let own = home.mentions.iter().filter(is_meant).map(|m| m.span).collect();
    let mut out = vec![(Rc::clone(home), own)];
    let others: Vec<String> = state.documents().filter(|d| d.uri != home.uri).map(|d| d.uri.clone()).collect();
    for uri in others {
        let Some(sheet) = state.sheet(&uri) else { continue };
        let spans = calls(state, &sheet, home, thing);
        if !spans.is_empty() {
            out.push((sheet, spans));
        }
    }
    out
}

/// Where a file that uses the graph `home` names a thing of it.
fn calls(state: &State<'_>, sheet: &Sheet, home: &Sheet, thing: &Thing) -> Vec<Span> {
    let is_home = |path: &str| state.graph_path(sheet, path).is_some_and(|path| path == home.path);
    let callers: Vec<usize> = (0..sheet.nodes.len()).filter(|n| sheet.nodes[*n].graph().is_some_and(is_home)).collect();
    let is_caller = |name: &str| callers.iter().any(|n| sheet.nodes[*n].decl.name == name);
    let is_meant = |m: &&Mention| match (&m.what, thing) {
        (What::Input { node, input }, Thing::Param(name)) => input == name && callers.contains(node),
        (What::Port { node, port }, Thing::Output(name)) => port == name && is_caller(node),
        _ => false,
    };
    if callers.is_empty() { Vec::new() } else { sheet.mentions.iter().filter(is_meant).map(|m| m.span).collect() }
}

/// Every place that means what the name at a position means.
pub(super) fn references(state: &mut State<'_>, uri: &str, position: Position, with_declaration: bool) -> Option<Value> {
    let named = named(state, uri, position)?;
    let declared = named.thing.declared(&named.home);
    let mut out = Vec::new();
    for (sheet, spans) in uses(state, &named.home, &named.thing) {
        let is_declaration = |span: &Span| sheet.uri == named.home.uri && Some(*span) == declared;
        let spans = spans.into_iter().filter(|s| with_declaration || !is_declaration(s));
        out.extend(spans.map(|s| json!({ "uri": sheet.uri, "range": sheet.range(s, state.encoding) })));
    }
    Some(json!(out))
}

/// The places in the file itself.
pub(super) fn highlights(state: &mut State<'_>, uri: &str, position: Position) -> Option<Value> {
    let named = named(state, uri, position)?;
    let uses = uses(state, &named.home, &named.thing);
    let (sheet, spans) = uses.into_iter().find(|(sheet, _)| sheet.uri == uri)?;
    Some(json!(spans.into_iter().map(|s| json!({ "range": sheet.range(s, state.encoding) })).collect::<Vec<_>>()))
}

/// What would be renamed.
pub(super) fn prepare_rename(state: &mut State<'_>, uri: &str, position: Position) -> Option<Value> {
    let named = named(state, uri, position)?;
    named.thing.declared(&named.home)?;
    Some(json!({ "range": named.sheet.range(named.mention.span, state.encoding), "placeholder": named.thing.name() }))
}

/// The edits that give a thing another name, and what the user should know of them.
pub(super) fn rename(state: &mut State<'_>, uri: &str, position: Position, name: &str) -> Result<(Value, Option<String>), Failure> {
    let found = named(state, uri, position).filter(|n| n.thing.declared(&n.home).is_some());
    let refused = |text: &str| Failure::new(REQUEST_FAILED, text);
    let named = found.ok_or_else(|| refused("expected a node, a parameter or an output of a graph, found another name"))?;
    let name = name.trim().trim_start_matches(['@', '$']);
    allowed(name, &named.thing, &named.home)?;
    let mut changes: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    for (sheet, spans) in uses(state, &named.home, &named.thing) {
        let edits = spans.into_iter().map(|s| json!({ "range": sheet.range(s, state.encoding), "newText": name }));
        changes.entry(sheet.uri.clone()).or_default().extend(edits);
    }
    let old = named.thing.name();
    let notice = match &named.thing {
        Thing::Node(_) => None,
        Thing::Param(_) => Some(format!("graphs that are not open and give `{old}` keep the old name: `pegbar check` says which")),
        Thing::Output(_) => Some(format!("graphs that are not open and take `{old}` keep the old name: `pegbar check` says which")),
    };
    Ok((json!({ "changes": changes }), notice))
}

fn allowed(name: &str, thing: &Thing, home: &Sheet) -> Result<(), Failure> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let problem = match thing {
        _ if name.is_empty() => "expected a name, found none".to_owned(),
        Thing::Param(_) if !name.chars().all(is_word) => format!("expected letters, digits and `_`, as in `$name`, found `{name}`"),
        Thing::Param(_) if name == "out" => "expected another name, found `out`, which is the output folder".to_owned(),
        _ if name.contains(['.', '@', '$', '/', '"', '\\']) => format!("expected a name without `.`, `@`, `$` and `/`, found `{name}`"),
        _ => {
            let other = match thing {
                Thing::Node(_) => Thing::Node(name.to_owned()),
                Thing::Param(_) => Thing::Param(name.to_owned()),
                Thing::Output(_) => Thing::Output(name.to_owned()),
            };
            if other == *thing || other.declared(home).is_none() {
                return Ok(());
            }
            format!("expected a name that is not there yet, found `{name}`")
        }
    };
    Err(Failure::new(INVALID_PARAMS, problem))
}
