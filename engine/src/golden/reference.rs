//! References as files: what outputs gave, for people to read, and what every node before them gave, to find where a difference begins.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;

use super::compare::{Difference, Tolerances, compare};
use super::summary::Summary;

/// Summaries by output and frame; a value that does not change over time stands at its clock's first frame.
pub type Reference = BTreeMap<String, BTreeMap<i64, Summary>>;

/// What one node was, and gave.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeReference {
    /// Type and version.
    pub of: String,
    /// Literals at its inputs; a long one by its digest.
    pub settings: BTreeMap<String, String>,
    /// What it gave.
    pub outputs: Reference,
}

/// What each node gave, by name.
pub type NodeReferences = BTreeMap<String, NodeReference>;

/// The text of a reference of outputs.
pub fn to_text(graph: &str, reference: &Reference) -> String {
    let mut text = format!("{{\n  \"graph\": {}", Json::from(graph));
    for (output, frames) in reference {
        // Writing into a string cannot fail.
        let _ = write!(text, ",\n  {}: {{", Json::from(output.as_str()));
        for (i, (frame, summary)) in frames.iter().enumerate() {
            let _ = write!(text, "{}\n    \"{frame}\": ", if i > 0 { "," } else { "" });
            summary.write("    ", &mut text);
        }
        text.push_str("\n  }");
    }
    text.push_str("\n}\n");
    text
}

/// A reference of outputs back from its text; `None` where it is none.
pub fn from_text(text: &str) -> Option<Reference> {
    let json: Json = serde_json::from_str(text).ok()?;
    let outputs = json.as_object()?.iter().filter(|(name, _)| *name != "graph");
    outputs.map(|(name, json)| Some((name.clone(), frames(json)?))).collect()
}

fn frames(json: &Json) -> Option<BTreeMap<i64, Summary>> {
    json.as_object()?.iter().map(|(f, s)| Some((f.parse().ok()?, Summary::read(s)?))).collect()
}

/// The text of a reference of nodes, a value a line.
pub fn nodes_to_text(graph: &str, nodes: &NodeReferences) -> String {
    let mut text = format!("{{\n  \"graph\": {},\n  \"nodes\": {{", Json::from(graph));
    for (i, (name, node)) in nodes.iter().enumerate() {
        let settings = Json::from_iter(node.settings.iter().map(|(k, v)| (k.as_str(), v.as_str())));
        let settings = if node.settings.is_empty() { Json::Object(serde_json::Map::new()) } else { settings };
        let _ = write!(text, "{}\n    {}: {{", if i > 0 { "," } else { "" }, Json::from(name.as_str()));
        let _ = write!(text, "\n      \"of\": {},\n      \"settings\": {settings}", Json::from(node.of.as_str()));
        for (output, frames) in &node.outputs {
            let _ = write!(text, ",\n      {}: {{", Json::from(format!(".{output}")));
            for (j, (frame, summary)) in frames.iter().enumerate() {
                let _ = write!(text, "{}\n        \"{frame}\": ", if j > 0 { "," } else { "" });
                summary.write_line(&mut text);
            }
            text.push_str("\n      }");
        }
        text.push_str("\n    }");
    }
    text.push_str("\n  }\n}\n");
    text
}

/// A reference of nodes back from its text; `None` where it is none.
pub fn nodes_from_text(text: &str) -> Option<NodeReferences> {
    let json: Json = serde_json::from_str(text).ok()?;
    let node = |json: &Json| {
        let json = json.as_object()?;
        let settings = json.get("settings")?.as_object()?.iter().map(|(k, v)| Some((k.clone(), v.as_str()?.to_owned())));
        let outputs = json.iter().filter_map(|(k, v)| Some((k.strip_prefix('.')?, v)));
        Some(NodeReference {
            of: json.get("of")?.as_str()?.to_owned(),
            settings: settings.collect::<Option<_>>()?,
            outputs: outputs.map(|(k, v)| Some((k.to_owned(), frames(v)?))).collect::<Option<_>>()?,
        })
    };
    json.get("nodes")?.as_object()?.iter().map(|(name, json)| Some((name.clone(), node(json)?))).collect()
}

/// Each value that is not near enough to its reference, by output and frame.
pub fn differences(golden: &Reference, found: &Reference, tolerances: &Tolerances) -> BTreeMap<(String, i64), Vec<Difference>> {
    let mut wrong = BTreeMap::new();
    let none = BTreeMap::new();
    for output in golden.keys().chain(found.keys().filter(|k| !golden.contains_key(*k))) {
        let (golden, found) = (golden.get(output).unwrap_or(&none), found.get(output).unwrap_or(&none));
        for frame in golden.keys().chain(found.keys().filter(|k| !golden.contains_key(*k))) {
            let told = match (golden.get(frame), found.get(frame)) {
                (Some(golden), Some(found)) => compare(output, golden, found, tolerances),
                (Some(_), None) => vec![Difference::of_value("expected a value, found none")],
                (None, _) => vec![Difference::of_value("expected a value in the reference, found none")],
            };
            if !told.is_empty() {
                wrong.insert((output.clone(), *frame), told);
            }
        }
    }
    wrong
}

/// The files of one case, in the folder beside the graph: `hat.golden/main.json`, `main.nodes.json`, and pictures in `main/`.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
    case: String,
}

impl Store {
    /// The most bytes of a reference of outputs: more is no longer read by anybody who reviews it.
    pub const MOST_BYTES: usize = 128 << 10;
    /// The most bytes of a reference of nodes, which is read by programs alone: what a repository carries without being felt.
    pub const MOST_NODE_BYTES: usize = 2 << 20;

    /// The files of a case of a graph.
    pub fn of(graph: &Path, case: &str) -> Self {
        Self { folder: graph.with_extension("golden"), case: case.to_owned() }
    }

    /// The folder that the cases of the graph share.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What outputs gave.
    pub fn outputs(&self) -> PathBuf {
        self.folder.join(format!("{}.json", self.case))
    }

    /// What nodes gave.
    pub fn nodes(&self) -> PathBuf {
        self.folder.join(format!("{}.nodes.json", self.case))
    }

    /// The folder of the small pictures.
    pub fn pictures(&self) -> PathBuf {
        self.folder.join(&self.case)
    }

    /// The small picture of an output at a frame.
    pub fn picture(&self, output: &str, frame: i64) -> PathBuf {
        let sign = if frame < 0 { "-" } else { "" };
        self.pictures().join(format!("{}.{sign}{:04}.png", output.replace('/', "."), frame.unsigned_abs()))
    }

    /// What outputs gave; `Ok(None)` where there is no reference.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn read(&self) -> Result<Option<Reference>, String> {
        read(&self.outputs(), from_text)
    }

    /// What nodes gave, likewise.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn read_nodes(&self) -> Result<Option<NodeReferences>, String> {
        read(&self.nodes(), nodes_from_text)
    }
}

fn read<T>(path: &Path, parse: impl Fn(&str) -> Option<T>) -> Result<Option<T>, String> {
    match std::fs::read_to_string(path) {
        Ok(text) => match parse(&text) {
            Some(found) => Ok(Some(found)),
            None => Err(format!("expected a reference as --bless writes it at {}, found another text", path.display())),
        },
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(format!("{}: {error}", path.display())),
    }
}
