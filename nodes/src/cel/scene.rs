//! `cel.scene`: drawn footage, and the truth about it.
//!
//! **Method** see [`crate::algo::cel`]: vector drawings in ink and flat colours over a painted ground, moved by a known motion.
//!
//! **Source** the examples of Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, figures 3, 6 and 10.
//!
//! **Fails when** a side is not from 1 to 16384 pixels.
//!
//! **Cost** O(pixels) a frame; the ground is painted once.
//!
//! ```ron
//! "plate": (type: "cel.scene", scene: hat, size: (640, 360), grain: 2.0),
//! ```

use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::setting::ClockName;
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use super::{image, matte, scene};
use crate::algo::cel::{CelSpec, SceneKind};
use crate::data::{Affine2, Image, Matte, Shape, Weights};

/// Drawn footage, and the truth about it: matte, motion, outline, key weights.
#[derive(Node)]
#[node(
    id = "cel.scene",
    version = 1,
    kind = source,
    outputs = CelSceneOutputs,
    uses_frame,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, figs. 3, 6, 10",
    example = "\"plate\": (type: \"cel.scene\", scene: hat, size: (640, 360), grain: 2.0)"
)]
pub(crate) struct CelScene {
    /// What is played: the hat is a loop of 48 frames, the ball rests after 72.
    #[input(default = hat)]
    scene: SceneKind,
    /// Width and height of the frame.
    #[input(default = (640, 360), range = 1..=16384, unit = "px")]
    size: [u32; 2],
    /// Chooses the wander of the hand, the paint of the ground and the grain.
    #[input(default = 1)]
    seed: u64,
    /// Standard deviation of the film grain, which is new on every frame, in 1/255 of the display range. 0 is clean.
    #[input(default = 2.0, range = 0.0..=64.0, unit = "1/255")]
    grain: f64,
    /// Film frames that show one drawing: 1 on ones, 2 on twos.
    #[input(default = 2, range = 1..=24, unit = "frames")]
    hold: u32,
    /// How far the ink moves from drawing to drawing; 0 for an exactly affine drawing.
    #[input(default = 0.4, range = 0.0..=10.0)]
    boil: f64,
    /// Width of the outline, on a frame 360 pixels high.
    #[input(default = 2.4, range = 0.1..=20.0, unit = "px")]
    line_width: f64,
    /// How far the hat bends between its key shapes: 0 moves it by affine maps alone.
    #[input(default = 0.0, range = 0.0..=1.0)]
    deform: f64,
    /// A soft shadow on the ground.
    #[input(default = true)]
    shadow: bool,
    /// The cel alone, on nothing.
    #[input(default = false)]
    layer_only: bool,
    /// The clock that it plays on.
    #[input(default = "frames")]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: ClockName,
}

/// Footage and truth.
#[derive(Outputs)]
pub(crate) struct CelSceneOutputs {
    /// The frame.
    image: Image,
    /// Exact coverage of the cel, its ink included.
    matte: Matte,
    /// Frame from reference drawing, pixels.
    motion: Affine2,
    /// The cel's outline, the same points in each frame, pixels.
    contour: Shape,
    /// Weights of the key shapes; they add up to 1.
    weights: Weights,
    /// Number of the drawing that the frame shows, from 1.
    drawing: Curve,
}

impl CelScene {
    fn spec(&self) -> CelSpec {
        CelSpec {
            scene: self.scene,
            width: self.size[0] as usize,
            height: self.size[1] as usize,
            seed: self.seed,
            grain: self.grain,
            hold: self.hold as usize,
            boil: self.boil,
            line_width: self.line_width,
            deform: self.deform,
            shadow: self.shadow,
        }
    }
}

impl PerFrame for CelScene {
    fn run(self, cx: &Context) -> Result<CelSceneOutputs, NodeError> {
        let spec = self.spec();
        let scene = scene(spec)?;
        let frame = cx.clock.index(cx.frame).unwrap_or(0);
        let cel = if self.layer_only { scene.layer(frame) } else { scene.render(frame) };
        Ok(CelSceneOutputs {
            image: image(&spec, cel.image)?,
            matte: matte(&spec, cel.matte)?,
            motion: cel.motion.into(),
            contour: Shape { points: cel.contour, closed: true },
            weights: Weights { weights: cel.key_weights },
            drawing: Curve { value: scene.drawing_of(frame) as f64 + 1.0 },
        })
    }
}
