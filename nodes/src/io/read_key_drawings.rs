//! `io.read_key_drawings`: key drawings from SVG: a character in several poses.
//!
//! Each file, each layer, or each of several groups is a key. All have the same paths in the same order, of the same nodes, and are painted as the
//! first; on each segment between two nodes all have as many points as the key that needs most.
//!
//! **Source**: W3C, Scalable Vector Graphics 1.1; Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 (output keys drawn by an artist). **Fails when** a
//! file is no SVG, or keys have other paths or nodes: the error says where they differ. **Cost**: O(bytes of the files + points).
//!
//! ```ron
//! Graph(pegbar: 1, nodes: { "bunny": (type: "io.read_key_drawings", path: "bunny.svg", keys_from: layers) }, outputs: { "keys": "@bunny" })
//! ```

use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::setting::InputPaths;
use pegbar_engine::{Node, Outputs};

use super::read_shapes::sampling;
use super::svg::{KeysFrom, drawings, keys, load_all};
use crate::data::KeyDrawings;

/// The key drawings.
#[derive(Outputs)]
pub(crate) struct IoReadKeyDrawingsOutputs {
    /// The same paths each, the first at the bottom; named by their files, layers or groups.
    keys: KeyDrawings,
}

/// Reads key drawings from SVG: a character in several poses.
#[derive(Node)]
#[node(
    id = "io.read_key_drawings",
    version = 1,
    kind = source,
    outputs = IoReadKeyDrawingsOutputs,
    source = "W3C, Scalable Vector Graphics 1.1",
    example = "\"bunny\": (type: \"io.read_key_drawings\", path: \"bunny.svg\", keys_from: layers)"
)]
pub(crate) struct IoReadKeyDrawings {
    /// The file, or a list of files, from the graph's folder.
    path: InputPaths,
    /// Ids or labels of the groups that are read: one for all keys, or one a key. All that is drawn where it is left out.
    #[input(default = [])]
    groups: Vec<String>,
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

impl PerFrame for IoReadKeyDrawings {
    fn run(self, _cx: &Context) -> Result<IoReadKeyDrawingsOutputs, NodeError> {
        let sampling = sampling(self.tolerance, self.per_segment)?;
        let sheets = load_all(&self.path)?;
        let picks = keys(&sheets, &self.groups, self.keys_from)?;
        let drawings = drawings(&picks, sampling)?;
        let names = picks.into_iter().map(|p| p.name).collect();
        let keys = KeyDrawings::new(drawings, names);
        Ok(IoReadKeyDrawingsOutputs { keys: keys.ok_or_else(|| NodeError::internal("keys of other points"))? })
    }
}
