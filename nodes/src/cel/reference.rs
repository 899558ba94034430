//! `cel.reference`: the reference drawing of a scene, with its outline and key shapes.
//!
//! **Method** see [`crate::algo::cel`].
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, equations 1 and 2.
//!
//! **Fails when** a side is not from 1 to 16384 pixels.
//!
//! **Cost** O(pixels).
//!
//! ```ron
//! "keys": (type: "cel.reference", scene: hat, size: (640, 360)),
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::{image, matte, scene};
use crate::algo::cel::{CelSpec, SceneKind};
use crate::data::{Image, KeyShapes, Matte, Shape};

/// The reference drawing of a scene, with its outline and key shapes.
#[derive(Node)]
#[node(
    id = "cel.reference",
    version = 1,
    kind = source,
    outputs = CelReferenceOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, eqs. 1, 2",
    example = "\"keys\": (type: \"cel.reference\", scene: hat, size: (640, 360))"
)]
pub(crate) struct CelReference {
    /// Whose reference.
    #[input(default = hat)]
    scene: SceneKind,
    /// Width and height of the frame.
    #[input(default = (640, 360), range = 1..=16384, unit = "px")]
    size: [u32; 2],
    /// Chooses the wander of the hand.
    #[input(default = 1)]
    seed: u64,
}

/// The reference.
#[derive(Outputs)]
pub(crate) struct CelReferenceOutputs {
    /// The drawing, on nothing.
    image: Image,
    /// Its coverage.
    matte: Matte,
    /// Its outline.
    contour: Shape,
    /// The key shapes, the first being the outline.
    keys: KeyShapes,
}

impl PerFrame for CelReference {
    fn run(self, _cx: &Context) -> Result<CelReferenceOutputs, NodeError> {
        let (width, height) = (self.size[0] as usize, self.size[1] as usize);
        let spec = CelSpec { scene: self.scene, width, height, seed: self.seed, ..CelSpec::default() };
        let scene = scene(spec)?;
        let (samples, alpha) = scene.reference();
        let keys = scene.key_contours();
        let (k, n) = (keys.len(), keys.first().map_or(0, Vec::len));
        let points = NdArray::new([k, n, 2], keys.iter().flatten().flatten().copied().collect());
        let points = points.ok_or_else(|| NodeError::internal("key shapes of different numbers of points"))?;
        Ok(CelReferenceOutputs {
            image: image(&spec, samples)?,
            matte: matte(&spec, alpha)?,
            contour: Shape { points: scene.reference_contour(), closed: true },
            keys: KeyShapes { points, names: Vec::new(), closed: true },
        })
    }
}
