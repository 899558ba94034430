//! `mesh.pin`: holds vertices in place over ranges of frames, and keeps a mesh above the ground.
//!
//! **Method** the whole mesh is shifted, by what brings each vertex to its place while it is pinned, and smoothly from pin to pin
//! ([`crate::algo::pins`]); then it is lifted wherever its lowest vertex is below the ground.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 (global translations as constraints); Fritsch and Carlson 1980 (slopes).
//!
//! **Fails when** a pin names frames that the motion has not, or a vertex that the mesh has not; where pins overlap they share the shift, and `error`
//! says what is left.
//!
//! **Cost** O(frames · (vertices + pins)); one mesh is in memory beside those that come out.
//!
//! ```ron
//! "stood": (type: "mesh.pin", mesh: "@otter.mesh", pins: [(frames: (8, 14), vertex: 211)], ground: 0.0),
//! ```

use nalgebra::Vector3;
use pegbar_engine::node::{Context, NodeError, Problem, Sequence, Stream, Whole};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use super::{Pin, Pins};
use crate::algo::pins::{lifts, miss, shifts};
use crate::data::Mesh;

/// Holds vertices in place over ranges of frames, and keeps a mesh above the ground.
#[derive(Node)]
#[node(
    id = "mesh.pin",
    version = 1,
    kind = whole,
    outputs = MeshPinOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4",
    example = "\"stood\": (type: \"mesh.pin\", mesh: \"@otter.mesh\", pins: [(frames: (8, 14), vertex: 211)], ground: 0.0)"
)]
pub(crate) struct MeshPin {
    /// The moving mesh.
    pub(super) mesh: Sequence<Mesh>,
    /// What stands where: `frames` from first to last; `vertex`, from 0; `at`, its place in metres, where it is left out the one that it has at the first of
    /// the frames.
    #[input(default = [])]
    pub(super) pins: Pins,
    /// Height that no vertex goes below at any frame. None where it is left out.
    #[input(default = None, range = -1000000.0..=1000000.0, unit = "m")]
    pub(super) ground: Option<f64>,
    /// Frames on either side over which a lift above the ground comes and goes. 0 lifts only where it must.
    #[input(default = 0, range = 0..=10000, unit = "frames")]
    pub(super) soften: u32,
    /// Frames over which the shift comes before the first pin and goes after the last. It is held where this is left out; 0 lets go at once.
    #[input(default = None, range = 0.0..=1000000.0, unit = "frames")]
    pub(super) blend: Option<f64>,
}

/// The mesh, and how well the pins hold.
#[derive(Outputs)]
pub(crate) struct MeshPinOutputs {
    /// Shifted.
    pub(super) mesh: Stream<Mesh>,
    /// How far the worst pinned vertex is from its place, metres: more than nothing where pins overlap, or lie below the ground.
    pub(super) error: Stream<Curve>,
}

impl MeshPin {
    fn path(&self, pin: &Pin) -> Result<Vec<Vector3<f64>>, NodeError> {
        let vertex = pin.vertex.ok_or_else(|| NodeError::input("pins: expected a vertex of the mesh, found a joint"))?;
        let at = |k: usize| {
            let mesh = self.mesh.get(k)?;
            let place = mesh.positions.get(vertex).filter(|p| p.iter().all(|v| v.is_finite())).copied();
            let message = || {
                format!("frame {k} from the first: expected a vertex {vertex} at a finite place, found none of {}", mesh.positions.len())
            };
            place.map(Vector3::from).ok_or_else(|| NodeError::input(message()))
        };
        (0..self.mesh.len()).map(at).collect()
    }
}

impl Whole for MeshPin {
    fn check(&self) -> Vec<Problem> {
        self.pins.problems()
    }

    fn run(self, cx: &Context) -> Result<MeshPinOutputs, NodeError> {
        let n = self.mesh.len();
        let pins = self.pins.pinned(self.mesh.clock().unwrap_or(cx.clock), |pin| self.path(pin))?;
        let mut by = shifts(&pins.iter().collect::<Vec<_>>(), n, self.blend);
        if let Some(ground) = self.ground {
            let low = |k: usize| {
                let low =
                    self.mesh.get(k)?.positions.iter().map(|p| p[1]).fold(f64::INFINITY, |a, b| if b.is_nan() { b } else { a.min(b) });
                let message = || format!("frame {k} from the first: expected vertices at finite heights, found the lowest at {low}");
                if low.is_finite() { Ok(low + by[k].y) } else { Err(NodeError::input(message())) }
            };
            let lowest: Vec<f64> = (0..n).map(low).collect::<Result<_, _>>()?;
            by.iter_mut().zip(lifts(&lowest, ground, self.soften as usize)).for_each(|(s, up)| s.y += up);
        }
        let (mut meshes, mut error) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (k, shift) in by.iter().enumerate() {
            cx.check()?;
            let mesh = self.mesh.get(k)?;
            let positions = mesh.positions.iter().map(|p| (Vector3::from(*p) + shift).into()).collect();
            meshes.push(mesh.moved(positions, mesh.normals.clone()));
            let value = miss(pins.iter().filter_map(|p| Some((p, p.path.get(k)? + shift))), k);
            error.push(Curve { value });
        }
        // One mesh stands for every frame of the clock.
        while let (true, Some(mesh)) = (meshes.len() < cx.clock.len(), meshes.last()) {
            meshes.push(mesh.clone());
            error.push(Curve { value: error.last().map_or(0.0, |e: &Curve| e.value) });
        }
        Ok(MeshPinOutputs { mesh: Stream(meshes), error: Stream(error) })
    }
}
