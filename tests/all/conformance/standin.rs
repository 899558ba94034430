//! Values of every type to stand at a node's inputs: ordinary ones, and such as nobody should have made.

use std::collections::BTreeSet;
use std::path::Path;

use pegbar_engine::array::{Array, DType, Data};
use pegbar_engine::check::{LoadOptions, Loaded, load_text};
use pegbar_engine::node::{self, Access, InputSchema, InputType, NodeSchema};
use pegbar_engine::npz;
use pegbar_engine::registry::Registry;
use pegbar_engine::value::{OwnedParts, ValueRef, ValueType};

/// Frames of the graphs.
pub(super) const FRAMES: i64 = 4;

/// What values are like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Small, finite, as everywhere.
    Ordinary,
    /// Others of the same sizes.
    Other,
    /// No rows, no points.
    Empty,
    /// One row, one column, one point.
    One,
    /// Pictures of no channels.
    NoChannels,
    /// No number is one.
    Nan,
    /// Infinities of both signs.
    Infinite,
    /// As large as f32 goes.
    Huge,
    /// All the same: nothing to hold on to.
    Constant,
    /// Pictures that fill a part of what is shown, and reach beyond it.
    Shifted,
    /// Pictures in a frame larger than any memory.
    Vast,
}

impl Kind {
    pub(super) const WRONG: [Self; 9] =
        [Self::Empty, Self::One, Self::NoChannels, Self::Nan, Self::Infinite, Self::Huge, Self::Constant, Self::Shifted, Self::Vast];

    fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Extent of an axis that the type's schema calls by this letter or number.
    fn extent(self, axis: &str) -> usize {
        match (axis.parse(), self, axis) {
            (Ok(number), _, _) => number,
            (_, _, "t") => FRAMES as usize,
            (_, Kind::NoChannels, "c") => 0,
            (_, _, "c") => 4,
            (_, Kind::Empty, _) => 0,
            (_, Kind::One, _) => 1,
            (_, _, "h") => 9,
            (_, _, "w") => 12,
            _ => 6,
        }
    }

    fn sample(self, i: usize) -> f64 {
        // Neither sorted nor random: neighbours differ, and every run has the same.
        let mixed = |by: usize| ((i * by + 3) % 17) as f64 / 17.0;
        match self {
            Kind::Nan => f64::NAN,
            Kind::Infinite if i.is_multiple_of(2) => f64::INFINITY,
            Kind::Infinite => f64::NEG_INFINITY,
            Kind::Huge if i.is_multiple_of(2) => 3e38,
            Kind::Huge => -3e38,
            Kind::Constant => 0.5,
            Kind::Other => mixed(11),
            _ => mixed(7),
        }
    }

    fn array(self, dtype: DType, shape: &str, offset: usize) -> Array {
        let axes = shape.trim_matches(['[', ']']).split(',').map(str::trim).filter(|a| !a.is_empty());
        let shape: Vec<usize> = axes.map(|a| self.extent(a)).collect();
        let n: usize = shape.iter().product();
        let whole = |i: usize| (i + offset + usize::from(self == Kind::Other)) % 3;
        let data = match dtype {
            DType::F32 => Data::F32((0..n).map(|i| self.sample(i + offset) as f32).collect()),
            DType::F64 => Data::F64((0..n).map(|i| self.sample(i + offset)).collect()),
            DType::I64 => Data::I64((0..n).map(|i| whole(i) as i64).collect()),
            DType::U32 => Data::U32((0..n).map(|i| whole(i) as u32).collect()),
            DType::U8 => Data::U8((0..n).map(|i| whole(i) as u8).collect()),
        };
        Array { shape, data }
    }

    /// A value of this kind; `None` where the type does not take it.
    fn value(self, ty: &ValueType, offset: usize) -> Option<ValueRef> {
        let arrays = ty.schema.arrays.iter().map(|a| (a.name.to_owned(), self.array(a.dtype, a.shape, offset)));
        let mut parts = OwnedParts { arrays: arrays.collect(), ..OwnedParts::default() };
        // Any numbers make no tree; a chain is one.
        if let Some((_, Array { data: Data::I64(parents), .. })) = parts.arrays.iter_mut().find(|(name, _)| name == "parents") {
            parents.iter_mut().zip(-1..).for_each(|(p, before)| *p = before);
        }
        // Any numbers make no camera; these see what lies before the origin.
        if ty.schema.name == "Camera" && matches!(self, Kind::Ordinary | Kind::Other) {
            for (_, array) in &mut parts.arrays {
                match &mut array.data {
                    Data::F64(m) => m[12..].copy_from_slice(&[0.0, 0.0, 0.0, 1.0]),
                    Data::I64(size) => *size = vec![12, 9],
                    _ => {}
                }
            }
        }
        // Nor any lengths curves: these have all points between them.
        if ty.schema.name == "Curves" {
            let n = parts.arrays.iter().find(|(name, _)| name == "points").map_or(0, |(_, a)| a.shape[0]);
            if let Some((_, Array { data: Data::U32(lengths), .. })) = parts.arrays.iter_mut().find(|(name, _)| name == "lengths") {
                let count = lengths.len();
                lengths.iter_mut().enumerate().for_each(|(i, l)| *l = (n * (i + 1) / count - n * i / count) as u32);
            }
        }
        let windows = match self {
            Kind::Shifted => Some(([-3, 4, 9, 13], [0, 0, 12, 9])),
            Kind::Vast => Some(([0, 0, 12, 9], [-1_000_000, -1_000_000, 1_000_000, 1_000_000])),
            _ => None,
        };
        if let Some((data, display)) = windows.filter(|_| ty.schema.texts.iter().any(|t| t.name == "data_window")) {
            parts.meta.insert("data_window".to_owned(), data.as_slice().into());
            parts.meta.insert("display_window".to_owned(), display.as_slice().into());
        }
        (ty.from_parts)(parts).ok()
    }
}

/// Writes a stream and a single value of a kind for every value type; what a type does not take is left out.
pub(super) fn write_all(folder: &Path, registry: &Registry, kind: Kind) {
    for ty in registry.types() {
        let frames: Vec<i64> = (1..=FRAMES).collect();
        let stream: Option<Vec<ValueRef>> = frames.iter().map(|f| kind.value(ty, *f as usize)).collect();
        let file = |what: &str| std::fs::File::create(folder.join(format!("{}.{}.{what}.npz", ty.schema.name, kind.name()))).unwrap();
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
    type_at(input).map(|ty| format!("\"@{ty}-{}-{single}\"", kind.name()))
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
