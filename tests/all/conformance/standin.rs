//! Values of every type to stand at a node's inputs: ordinary ones, and such as nobody should have made.

use std::collections::BTreeSet;
use std::path::Path;

use pegbar_engine::check::{LoadOptions, Loaded, load_text};
use pegbar_engine::node::{self, Access, InputSchema, InputType, NodeSchema};
use pegbar_engine::npz;
pub(super) use pegbar_engine::plugin::conform::Kind;
use pegbar_engine::registry::Registry;
use pegbar_engine::value::ValueRef;

/// Frames of the graphs.
pub(super) const FRAMES: i64 = 4;

fn name(kind: Kind) -> String {
    format!("{kind:?}").to_lowercase()
}

/// Writes a stream and a single value of a kind for every value type; what a type does not take is left out.
pub(super) fn write_all(folder: &Path, registry: &Registry, kind: Kind) {
    for ty in registry.types() {
        let frames: Vec<i64> = (1..=FRAMES).collect();
        let stream: Option<Vec<ValueRef>> = frames.iter().map(|f| kind.value(ty, kind.sizes(), *f as usize)).collect();
        let file = |what: &str| std::fs::File::create(folder.join(format!("{}.{}.{what}.npz", ty.schema.name, name(kind)))).unwrap();
        if let Some(values) = stream {
            npz::write_stream(&frames, |k| Ok::<_, npz::NpzError>(values[k].clone()), false, file("stream")).unwrap();
            npz::write(values[0].as_ref(), false, file("single")).unwrap();
        }
    }
}

/// The value type that stands at an input; any type will do where it takes any.
pub(super) fn type_at(input: &InputSchema) -> Option<&'static str> {
    match &input.ty {
        InputType::Value(name) => Some(name),
        InputType::Any => Some("Curve"),
        InputType::Setting { .. } => None,
    }
}

/// A reference to the stand-in for an input of values.
pub(super) fn reference(schema: &NodeSchema, input: &InputSchema, kind: Kind) -> Option<String> {
    let reads_one = input.access == Access::Constant || (schema.kind == node::Kind::Whole && !input.access.by_handle());
    let single = if reads_one { "single" } else { "stream" };
    type_at(input).map(|ty| format!("\"@{ty}-{}-{single}\"", name(kind)))
}

/// Literals that an input of settings may take, the most usual first.
pub(super) fn literals(schema: &NodeSchema, input: &InputSchema) -> Vec<String> {
    let texts = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
    if !input.choices.is_empty() {
        return input.choices.iter().map(|c| c.name.to_owned()).collect();
    }
    let InputType::Setting { name, .. } = &input.ty else { return Vec::new() };
    match (name.as_str(), schema.id) {
        ("number", _) => texts(&["0.25", "0.75", "1.5", "3.0", "40.0", "-0.25"]),
        ("whole number", _) => texts(&["1", "2", "3", "7", "100", "5000"]),
        ("true or false", _) => texts(&["true", "false"]),
        ("pair of whole numbers", _) => texts(&["(16, 12)", "(3, 5)", "(300, 200)"]),
        ("four whole numbers", _) => texts(&["(0, 0, 4, 4)", "(1, 1, 3, 3)"]),
        ("pair of numbers", _) => texts(&["(0.25, 0.75)", "(1.0, 3.0)", "(20.0, 40.0)", "(-0.25, 1.25)"]),
        ("three numbers", _) => texts(&["(0.25, 0.5, 0.75)", "(0.5, 0.5, 0.5)"]),
        ("four numbers", _) => texts(&["(0.25, 0.5, 0.75, 1.0)", "(1.0, 2.0, 3.0, 4.0)", "(0.5, 0.5, 0.5, 0.5)"]),
        ("list of numbers", _) => texts(&["[0.5, 0.25]", "[1.0]"]),
        ("list of whole numbers", _) => texts(&["[1, 2]", "[2]"]),
        ("list of pairs of numbers", _) => texts(&["[(0.0, 1.0), (1.0, 0.5)]", "[(1.0, 2.0)]"]),
        ("list of triples of numbers", _) => texts(&["[(0.4, 0.5, 0.6)]", "[(0.1, 0.2, 0.3)]"]),
        ("list of four numbers each", _) => texts(&["[(0.4, 0.5, 0.6, 1.0)]", "[(0.1, 0.2, 0.3, 1.0)]"]),
        ("list of lists of numbers", _) => texts(&["[[1.0, 0.0], [0.25, 0.75]]", "[[1.0], [1.0]]"]),
        ("list of pins", _) => texts(&["[(frames: (1, 2), point: (0.25, 0.75))]", "[(frames: (2, 3), point: (0.5, 0.5), at: (1.0, 1.0))]"]),
        ("list of texts", _) => texts(&["[\"R\"]", "[\"G\"]"]),
        ("text", _) => texts(&["\"a\"", "\"b\""]),
        ("clock", _) => texts(&["\"frames\"", "\"other\""]),
        ("value type", _) => texts(&["\"Curve\"", "\"Vector\""]),
        ("name, number, or list of them", _) => texts(&["\"a\"", "1"]),
        (list, _) if list.starts_with("list of pins") && list.contains("joint") => {
            texts(&["[(frames: (1, 2), joint: \"a\")]", "[(frames: (2, 3), vertex: 0)]"])
        }
        (map, _) if map.starts_with("joints by the names") => texts(&["{ \"a\": \"joint_0\" }", "{ \"b\": \"joint_0\" }"]),
        ("path to read", "io.read_amc") if input.name == "skeleton" => texts(&["\"a.asf\"", "\"b.asf\""]),
        ("path to read", "io.read_amc") => texts(&["\"a.amc\"", "\"b.amc\""]),
        ("path to read", "io.read_bvh") => texts(&["\"a.bvh\"", "\"b.bvh\""]),
        (list, _) if list.starts_with("list of limbs") => texts(&["[(\"a\", \"b\")]", "[(\"b\", \"a\")]"]),
        (list, _) if list.starts_with("list of marker shapes") => texts(&["[cross]", "[square, dot]"]),
        (list, _) if list.starts_with("list of pairs of sets") => texts(&["[(\"a\", \"b\")]", "[(\"b\", \"a\")]"]),
        (list, _) if list.starts_with("list of chains") => texts(&["[[\"a\", \"b\"]]", "[[\"b\", \"a\"]]"]),
        (list, _) if list.starts_with("list of edits") => texts(&["[(frame: 2, before: 1, shows: 2.5)]", "[(frame: 3, after: 2)]"]),
        (list, _) if list.starts_with("list of curves") => texts(&["[(vertices: [0, 1])]", "[(vertices: [1, 2], closed: true)]"]),
        (list, _) if list.starts_with("list of examples") => texts(&["[(frame: 2)]", "[(frame: 3, before: 1)]"]),
        ("path to read", "io.read_gltf") => texts(&["\"a.gltf\"", "\"b.gltf\""]),
        ("path to read", "io.read_image") => texts(&["\"a.0001.png\"", "\"b.0001.png\""]),
        ("path to read", "io.read_images") => texts(&["\"a.####.png\"", "\"b.####.png\""]),
        ("path to read", "io.read_markers") => texts(&["\"a.csv\"", "\"b.csv\""]),
        ("path to read", "io.read_value") => texts(&["\"Curve.ordinary.stream.npz\"", "\"Curve.other.stream.npz\""]),
        ("path to read", "io.read_shapes" | "io.read_drawings") => texts(&["\"a.svg\"", "\"b.svg\""]),
        (list, _) if list.starts_with("list of anchors") => {
            texts(&["[(vertex: 0, drawn: (1.0, 2.0))]", "[(render: (3.0, 4.0), drawn: (1.0, 2.0))]"])
        }
        ("path or list of paths to read", "io.search_bvh") => texts(&["[\"a.bvh\", \"b.bvh\"]", "[\"b.bvh\", \"a.bvh\"]"]),
        ("path or list of paths to read", _) => texts(&["[\"a.svg\", \"b.svg\"]", "[\"b.svg\", \"a.svg\"]"]),
        ("path to write", "io.write_bvh") => texts(&["\"$out/a.bvh\"", "\"$out/b.bvh\""]),
        ("path to write", "io.write_drawings") => texts(&["\"$out/a.svg\"", "\"$out/b.svg\""]),
        ("path to write", "io.write_gltf") => texts(&["\"$out/a.glb\"", "\"$out/b.glb\""]),
        ("path to write", "io.write_images") => texts(&["\"$out/a.####.png\"", "\"$out/b.####.png\""]),
        ("path to write", "io.write_markers" | "io.write_table") => texts(&["\"$out/a.csv\"", "\"$out/b.csv\""]),
        ("path to write", "io.write_value") => texts(&["\"$out/a.npz\"", "\"$out/b.npz\""]),
        // A type or a file format that this test knows nothing of yet: every literal of the inputs around it, then the default's own form.
        _ => input.default.map(str::to_owned).into_iter().collect(),
    }
}

/// True for an input that must be given.
pub(super) fn is_required(input: &InputSchema) -> bool {
    !input.optional && input.default.is_none()
}

/// The graph of a node under the name `x` with these fields, and stand-ins for what they refer to.
pub(super) fn text(id: &str, fields: &[(String, String)]) -> String {
    let given: String = fields.iter().map(|(name, value)| format!(", {name}: {value}")).collect();
    let mut nodes = format!("\"x\": (type: \"{id}\"{given})");
    let references: BTreeSet<&str> = given.split('"').filter_map(|t| t.strip_prefix('@')).collect();
    for name in references {
        let ty = name.split('-').next().unwrap_or_default();
        let file = name.replace('-', ".");
        nodes += &format!(",\n\"{name}\": (type: \"io.read_value\", path: \"{file}.npz\", as: \"{ty}\")");
    }
    format!(
        "Graph(pegbar: 1, frames: (first: 1, last: {FRAMES}, fps: 24), clocks: {{ \"other\": (first: 1, last: {FRAMES}, fps: 12) }}, nodes: {{ {nodes} }})"
    )
}

/// Checks a graph as if it stood in `folder`.
pub(super) fn check(folder: &Path, text: &str, registry: &Registry) -> Loaded {
    load_text(&folder.join("x.ron"), text, registry, &LoadOptions { out: folder.join("out"), ..LoadOptions::default() })
}

/// Fields that make the node run, with values of `kind` at the inputs for which `is_kind` holds.
pub(super) fn fields(schema: &NodeSchema, kind: impl Fn(&InputSchema) -> Kind) -> Vec<(String, String)> {
    let required = schema.inputs.iter().filter(|i| is_required(i));
    let one = |input: &InputSchema| reference(schema, input, kind(input)).or_else(|| literals(schema, input).into_iter().next());
    required.filter_map(|i| Some((i.name.to_owned(), one(i)?))).collect()
}
