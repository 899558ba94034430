//! The shape of a file: its symbols, what may be folded, and its canonical layout.

use pegbar_engine::syntax::{NodeKind, format};
use serde_json::{Value, json};

use super::facts;
use super::sheet::{Decl, Sheet};
use super::state::State;
use super::text::{Encoding, difference};

/// Kinds of symbols, as the protocol numbers them.
const NAMESPACE: u8 = 3;
const PROPERTY: u8 = 7;
const FUNCTION: u8 = 12;
const VARIABLE: u8 = 13;
const EVENT: u8 = 24;

/// Parameters, nodes, outputs and clocks, each below the field that declares it.
pub(super) fn symbols(state: &mut State<'_>, uri: &str) -> Option<Value> {
    let (sheet, encoding) = (state.sheet(uri)?, state.encoding);
    let symbol = |decl: &Decl, kind: u8, detail: &str| {
        let (whole, name) = (sheet.range(decl.whole, encoding), sheet.range(decl.span, encoding));
        let shown = if decl.name.is_empty() { "\"\"" } else { &decl.name };
        json!({ "name": shown, "detail": detail, "kind": kind, "range": whole, "selectionRange": name })
    };
    let fields = sheet.tree.value().into_iter().flat_map(|v| v.fields()).filter(|f| !f.name().is_empty());
    let out = fields.map(|field| {
        let children: Vec<Value> = match field.name() {
            "params" => sheet.params.iter().map(|p| symbol(&p.decl, VARIABLE, &facts::param_facts(p))).collect(),
            "nodes" => sheet.nodes.iter().map(|n| symbol(&n.decl, FUNCTION, &n.ty)).collect(),
            "outputs" => sheet.outputs.iter().map(|o| symbol(&o.decl, PROPERTY, &format!("@{}", o.of))).collect(),
            "clocks" => sheet.clocks.iter().map(|c| symbol(c, EVENT, "clock")).collect(),
            _ => Vec::new(),
        };
        json!({
            "name": field.name(),
            "kind": NAMESPACE,
            "range": sheet.range(field.node().span(), encoding),
            "selectionRange": sheet.range(field.name_span(), encoding),
            "children": children,
        })
    });
    Some(json!(out.collect::<Vec<_>>()))
}

/// Everything between brackets on different lines.
pub(super) fn folds(state: &mut State<'_>, uri: &str) -> Option<Value> {
    let sheet = state.sheet(uri)?;
    let brackets = [NodeKind::Struct, NodeKind::Tuple, NodeKind::List, NodeKind::Map];
    let found = sheet.tree.root().descendants().filter(|n| brackets.contains(&n.kind()));
    let lines = found.map(|n| sheet.range(n.span(), Encoding::Utf8)).map(|r| (r.start.line, r.end.line.saturating_sub(1)));
    let mut last = None;
    let mut out = Vec::new();
    // Of several that begin on one line the outermost counts.
    for (start, end) in lines.filter(|(start, end)| start < end) {
        if last != Some(start) {
            out.push(json!({ "startLine": start, "endLine": end }));
        }
        last = Some(start);
    }
    Some(json!(out))
}

/// The edit that brings a file into canonical layout; none where it is no RON.
pub(super) fn formatting(state: &mut State<'_>, uri: &str) -> Option<Value> {
    let sheet: std::rc::Rc<Sheet> = state.sheet(uri)?;
    let Some(new) = format(&sheet.tree) else { return Some(json!([])) };
    let (span, text) = difference(sheet.text(), &new);
    if span.is_empty() && text.is_empty() {
        return Some(json!([]));
    }
    Some(json!([{ "range": sheet.range(span, state.encoding), "newText": text }]))
}
