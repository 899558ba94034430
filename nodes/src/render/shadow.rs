//! `render.shadow`: the shadow of meshes on the ground, as a camera sees it.
//!
//! **Method** every vertex goes along the light to the ground; the exact union of the triangles there is one flat shadow, blurred where it is to
//! be soft (Blinn, *Me and my (fake) shadow*, 1988).
//!
//! **Source** usual practice.
//!
//! **Fails when** the light comes from below the ground or along it, or a position or the camera is not finite.
//!
//! **Cost** O(triangles + pixels × softness).
//!
//! ```ron
//! "shadow": (type: "render.shadow", mesh: "@skin", camera: "@camera", light: (0.4, 0.8, 0.5), softness: 4.0),
//! "ground": (type: "comp.over", fg: "@shadow", bg: "@plate"),
//! ```

use nalgebra::Vector3;
use pegbar_engine::Node;
use pegbar_engine::node::{Context, Fault, In, List, NodeError, PerFrame};

use super::scene::{seen_by, surface_of, toward_light};
use super::{Drawing, blank, drawing, faded, screen, within};
use crate::algo::filter::gaussian_blur;
use crate::algo::raster::Raster;
use crate::algo::surface::Surface;
use crate::algo::toon::coverage;
use crate::algo::warp_affine::{Outside, Source};
use crate::algo::window::Window;
use crate::data::{Camera, Mesh};

/// The shadow of meshes on the ground, as a camera sees it.
///
/// The shadow of what lies below the ground is not told apart from that of what lies above it.
#[derive(Node)]
#[node(
    id = "render.shadow",
    version = 1,
    outputs = Drawing,
    source = "Blinn 1988",
    example = "\"shadow\": (type: \"render.shadow\", mesh: \"@skin\", camera: \"@camera\", light: (0.4, 0.8, 0.5), softness: 4.0)"
)]
pub(crate) struct RenderShadow {
    /// The meshes that cast it, one or a list.
    mesh: List<In<Mesh>>,
    /// Where it is seen from, and how large the picture is.
    camera: In<Camera>,
    /// Towards the light, world space.
    #[input(default = (0.4, 0.8, 0.5))]
    light: [f64; 3],
    /// A point of the ground.
    #[input(default = (0.0, 0.0, 0.0), unit = "m")]
    ground: [f64; 3],
    /// The direction that is up from the ground.
    #[input(default = (0.0, 1.0, 0.0))]
    normal: [f64; 3],
    /// Colour, as seen on screen.
    #[input(default = (0.05, 0.04, 0.12), range = 0.0..=1.0)]
    color: [f64; 3],
    /// Opacity.
    #[input(default = 0.35, range = 0.0..=1.0)]
    opacity: f64,
    /// Standard deviation of the blur. 0 leaves a sharp edge.
    #[input(default = 0.0, range = 0.0..=1000.0, unit = "px")]
    softness: f64,
}

impl RenderShadow {
    /// Moves vertices along the light to the ground.
    fn cast(&self, surface: &mut Surface) -> Result<(), NodeError> {
        let wrong = |message: String| NodeError::new(Fault::Parameters, message);
        let [x, y, z] = self.normal;
        let up = Vector3::from(self.normal).try_normalize(1e-12).filter(|n| n.iter().all(|v| v.is_finite()));
        let up = up.ok_or_else(|| wrong(format!("expected a ground with a direction that is up, found ({x}, {y}, {z})")))?;
        let light = toward_light(self.light)?;
        let fall = light.dot(&up);
        if fall < 1e-3 {
            let [x, y, z] = self.light;
            return Err(
                wrong(format!("expected a light from above the ground, found ({x}, {y}, {z})")).help("turn `light` up, or `normal`")
            );
        }
        let ground = Vector3::from(self.ground);
        if !ground.iter().all(|v| v.is_finite()) {
            return Err(wrong(format!("expected a finite ground, found {:?}", self.ground)));
        }
        for p in &mut surface.positions {
            *p -= light * ((*p - ground).dot(&up) / fall);
        }
        Ok(())
    }
}

impl PerFrame for RenderShadow {
    fn run(self, _cx: &Context) -> Result<Drawing, NodeError> {
        within("opacity", self.opacity, 0.0, 1.0)?;
        within("softness", self.softness, 0.0, 1000.0)?;
        let camera = seen_by(&self.camera)?;
        let [width, height] = camera.size;
        let window = Window::new(0, 0, width, height);
        let mut samples = blank(window)?;
        let mut surface = surface_of(&self.mesh.0, 180.0, true)?;
        self.cast(&mut surface)?;
        let mut cover = coverage(&surface, &camera);
        if self.softness > 0.0 {
            let sharp = cover.clone();
            let source = Source::new(Raster { data: &sharp, width, height, channels: 1 }, [0, 0]);
            gaussian_blur(source, [self.softness; 2], Outside::Clamp, &mut cover, window)
                .map_err(|e| NodeError::internal(e.to_string()))?;
        }
        let colour = faded(screen(self.color), self.opacity);
        for (pixel, cover) in samples.chunks_exact_mut(4).zip(cover).filter(|(_, c)| *c > 0.0) {
            pixel.copy_from_slice(&colour.map(|c| c * cover));
        }
        drawing(window, window, samples)
    }
}

#[cfg(test)]
#[path = "shadow_tests.rs"]
mod tests;
