//! Completion: what may stand at the cursor, what fits best first.

mod items;
mod paths;
mod values;

use std::rc::Rc;

use pegbar_engine::node::NodeSchema;
use pegbar_engine::syntax::TokenKind;
use serde_json::Value;

use super::cursor::{Cursor, Frame, GivenField, given_fields};
use super::facts;
use super::sheet::Sheet;
use super::state::{Checked, State};
use super::text::Position;
use items::{Item, Kind, as_json};

/// What all that completes looks at.
pub(super) struct Asked<'a, 'r> {
    state: &'a mut State<'r>,
    sheet: Rc<Sheet>,
    checked: Rc<Checked>,
    items: Vec<Item>,
}

/// The completions at a position.
pub(super) fn complete(state: &mut State<'_>, uri: &str, position: Position) -> Option<Value> {
    let (sheet, checked) = (state.sheet(uri)?, state.checked(uri)?);
    let offset = sheet.offset(position, state.encoding);
    let Some(cursor) = Cursor::at(&sheet.tree, offset).filter(|c| !c.is_behind_value) else { return Some(as_json(&[], &sheet, state)) };
    let mut asked = Asked { state, sheet: Rc::clone(&sheet), checked, items: Vec::new() };
    asked.at(&cursor);
    Some(as_json(&asked.items, &sheet, state))
}

impl Asked<'_, '_> {
    fn at(&mut self, cursor: &Cursor<'_>) {
        let (bracket, path) = cursor.path();
        let Some(innermost) = cursor.frames.last().copied() else { return self.document(cursor) };
        let in_record = bracket == Some(TokenKind::LParen);
        match (path.as_slice(), cursor.key) {
            ([], None) if in_record => self.fields(&facts::GRAPH_FIELDS, innermost, cursor),
            (["frames"] | ["clocks", _], None) if in_record => self.fields(&facts::CLOCK_FIELDS, innermost, cursor),
            (["frames"] | ["clocks", _], Some(_)) => self.clock_value(cursor),
            (["params", _], None) if in_record => self.fields(&facts::PARAM_FIELDS, innermost, cursor),
            (["params", _], Some("type")) => self.param_types(cursor),
            (["params", name], Some("default")) => self.param_default(name, innermost, cursor),
            (["nodes"], None) => self.new_node(cursor),
            (["nodes", _], None) if in_record => self.inputs(innermost, cursor),
            (["nodes", _], Some("type")) => self.types(cursor),
            (["nodes", node], Some(input)) => self.input_value(node, innermost, input, cursor),
            // An element of a list that stands at an input.
            (["nodes", node, input], None) if bracket == Some(TokenKind::LBracket) => {
                let record = cursor.frames[cursor.frames.len() - 2];
                self.input_value(node, record, input, cursor);
            }
            (["outputs"], Some(_)) => self.output_value(cursor),
            _ => (),
        }
    }

    /// An empty file.
    fn document(&mut self, cursor: &Cursor<'_>) {
        let body =
            "Graph(\n    pegbar: 1,\n    frames: (first: ${1:1}, last: ${2:48}, fps: ${3:24}),\n    nodes: {\n        $0\n    },\n)\n";
        let item = Item::new("Graph", Kind::Snippet).detail("a graph").snippet(body);
        self.items.extend(item.bare(cursor));
    }

    /// Fields of a record that are not given yet.
    fn fields(&mut self, known: &[(&'static str, &'static str, &'static str)], open: Frame<'_>, cursor: &Cursor<'_>) {
        let given = given(open, cursor);
        for (name, doc, value) in known.iter().filter(|(name, _, _)| !given.iter().any(|g| g.name.name() == *name)) {
            let item = Item::new(*name, Kind::Field).doc(*doc).snippet(field(name, value, cursor));
            self.items.extend(item.bare(cursor));
        }
    }

    fn new_node(&mut self, cursor: &Cursor<'_>) {
        if !cursor.word.is_quoted {
            let item = Item::new("node", Kind::Snippet).detail("a new node").snippet("\"${1:name}\": (type: \"$2\"),");
            self.items.extend(item.bare(cursor));
        }
    }

    /// Inputs of the node that are not given yet: first those that must be.
    fn inputs(&mut self, open: Frame<'_>, cursor: &Cursor<'_>) {
        let given = given(open, cursor);
        let is_given = |name: &str| given.iter().any(|g| g.name.name() == name);
        let Some(ty) = type_of(&given) else {
            if !is_given("type") {
                let item =
                    Item::new("type", Kind::Field).doc("The type of the node, or graph:FILE.").snippet(field("type", "\"$1\"", cursor));
                self.items.extend(item.bare(cursor));
            }
            return;
        };
        if let Some(path) = ty.strip_prefix("graph:") {
            return self.graph_inputs(path, &is_given, cursor);
        }
        let Some(schema) = self.state.registry().get(ty).map(|t| t.schema.clone()) else { return };
        for input in schema.inputs.iter().filter(|i| !is_given(i.name)) {
            let must = input.default.is_none() && !input.optional;
            let value = values::template(input);
            let item = Item::new(input.name, Kind::Field).detail(facts::facts(input)).doc(facts::input(input, &schema));
            self.items.extend(item.rank(u8::from(!must)).snippet(field(input.name, &value, cursor)).bare(cursor));
        }
    }

    fn graph_inputs(&mut self, path: &str, is_given: &dyn Fn(&str) -> bool, cursor: &Cursor<'_>) {
        let Some(inner) = self.state.sheet_at(&self.sheet, path) else { return };
        for param in inner.params.iter().filter(|p| !is_given(&p.decl.name)) {
            let value = values::param_template(&param.ty);
            let item = Item::new(param.decl.name.as_str(), Kind::Field).detail(facts::param_facts(param)).doc(facts::param(param));
            let item = item.rank(u8::from(param.default.is_some())).snippet(field(&param.decl.name, value, cursor));
            self.items.extend(item.bare(cursor));
        }
    }

    /// Node types, and graph files.
    fn types(&mut self, cursor: &Cursor<'_>) {
        if let Some(path) = cursor.word.before.strip_prefix("graph:").filter(|_| cursor.word.is_quoted) {
            return self.graph_files(path, cursor);
        }
        let types: Vec<_> = self.state.registry().nodes().map(|n| n.schema.clone()).collect();
        for schema in types {
            let schema: &NodeSchema = &schema;
            let item = Item::new(schema.id, Kind::Function).detail(facts::signature(schema)).doc(facts::node(schema));
            self.items.push(item.text(schema.id).quoted(cursor));
        }
        let item = Item::new("graph:", Kind::Module).detail("a graph file as a node").rank(1).text("graph:");
        self.items.push(item.quoted(cursor));
        self.graph_files("", cursor);
    }

    fn param_types(&mut self, cursor: &Cursor<'_>) {
        for (name, doc) in facts::PARAM_TYPES {
            self.items.push(Item::new(name, Kind::Type).doc(doc).text(name).quoted(cursor));
        }
        let types: Vec<_> = self.state.registry().types().map(|t| (t.schema.name, t.schema.doc)).collect();
        for (name, doc) in types {
            self.items.push(Item::new(name, Kind::Type).doc(doc).rank(1).text(name).quoted(cursor));
        }
    }
}

/// The fields of the record, but for one whose name is being typed.
fn given<'t>(open: Frame<'t>, cursor: &Cursor<'t>) -> Vec<GivenField<'t>> {
    let is_typed = |g: &GivenField<'_>| g.name.span() == cursor.word.span && !cursor.word.is_quoted;
    given_fields(open.open).into_iter().filter(|g| !is_typed(g)).collect()
}

/// The node type in a record's fields.
fn type_of<'t>(given: &[GivenField<'t>]) -> Option<&'t str> {
    let value = given.iter().find(|g| g.name.name() == "type")?.value?;
    (value.kind() == TokenKind::String).then(|| value.name())
}

/// `name: value`, as far as it is not there yet.
fn field(name: &str, value: &str, cursor: &Cursor<'_>) -> String {
    let comma = match cursor.next {
        Some(TokenKind::Colon) => return name.to_owned(),
        Some(TokenKind::Ident | TokenKind::RawIdent) => ",",
        _ => "",
    };
    format!("{name}: {value}{comma}")
}
