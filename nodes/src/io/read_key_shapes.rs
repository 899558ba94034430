//! `io.read_key_shapes`: key shapes from SVG drawings.
//!
//! Keys are contours of the same nodes: one of each file, each of several paths, or one of each layer. All have the same points: on each segment
//! between two nodes as many even steps as the key that needs most, so that points correspond when the nodes do.
//!
//! **Source**: W3C, Scalable Vector Graphics 1.1; Bregler, Loeb, Chuang, Deshpande 2002, section 1.4 (keys drawn by hand). **Fails when** a file is no
//! SVG, the choice is not one contour a key, or keys have other nodes: the error says where they differ. **Cost**: O(bytes of the files + points).
//!
//! ```ron
//! Graph(pegbar: 1, nodes: { "frog": (type: "io.read_key_shapes", path: ["crouch.svg", "launch.svg", "apex.svg"], ids: ["body"]) }, outputs: { "keys": "@frog" })
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::setting::InputPaths;
use pegbar_engine::{Node, Outputs};

use super::read_shapes::sampling;
use super::svg::{KeysFrom, contours, keys, load_all};
use crate::data::KeyShapes;

/// The key shapes.
#[derive(Outputs)]
pub(crate) struct IoReadKeyShapesOutputs {
    /// As many points each, pixels; named by their files, layers or ids.
    keys: KeyShapes,
}

/// Reads key shapes from SVG drawings.
#[derive(Node)]
#[node(
    id = "io.read_key_shapes",
    version = 1,
    kind = source,
    outputs = IoReadKeyShapesOutputs,
    source = "W3C, Scalable Vector Graphics 1.1",
    example = "\"frog\": (type: \"io.read_key_shapes\", path: [\"crouch.svg\", \"launch.svg\"], ids: [\"body\"])"
)]
pub(crate) struct IoReadKeyShapes {
    /// The file, or a list of files, from the graph's folder.
    path: InputPaths,
    /// Ids or labels of the paths, or of groups that they are in: one for all keys, or one a key. Any where it is left out.
    #[input(default = [])]
    ids: Vec<String>,
    /// Which contour of those that are left, from 1 in the order of the drawing. The only one where it is left out.
    #[input(default = None, range = 1..=1000000)]
    which: Option<u32>,
    /// Where the keys are.
    #[input(default = files)]
    keys_from: KeysFrom,
    /// How far straight lines may be from curves. Small gives more points.
    #[input(default = 0.1, range = 0.0001..=1000.0, unit = "px")]
    tolerance: f64,
    /// Steps on each segment between two nodes, straight ones too. 0 takes as many as the tolerance asks for.
    #[input(default = 0, range = 0..=1000)]
    per_segment: u32,
}

impl PerFrame for IoReadKeyShapes {
    fn run(self, _cx: &Context) -> Result<IoReadKeyShapesOutputs, NodeError> {
        let sampling = sampling(self.tolerance, self.per_segment)?;
        let sheets = load_all(&self.path)?;
        let mut found = Vec::new();
        for key in keys(&sheets, &self.ids, self.keys_from)? {
            let (element, line) = key.contour(self.which)?;
            found.push((key, element, line));
        }
        let points = contours(&found, sampling)?;
        let shape = [points.len(), points.first().map_or(0, Vec::len), 2];
        let flat = points.iter().flatten().flatten().copied().collect();
        let points = NdArray::new(shape, flat).ok_or_else(|| NodeError::internal("keys of other points"))?;
        let closed = found.first().is_some_and(|(_, _, line)| line.closed);
        let names = found.into_iter().map(|(key, _, _)| key.name).collect();
        Ok(IoReadKeyShapesOutputs { keys: KeyShapes { points, names, closed } })
    }
}
