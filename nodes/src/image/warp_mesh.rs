//! `image.warp_mesh`: moves a picture so that a contour on it becomes another.
//!
//! **Method** the contour is filled with triangles once; its inside follows as rigidly as it can ([`crate::algo::mesh_deform`]), and every triangle
//! carries its pixels ([`crate::algo::warp_mesh`]). An open curve bends all of the picture around it ([`crate::algo::curve_bend`]).
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 (photographs); Sorkine, Alexa 2007; Schaefer, McPhail, Warren 2006 (open curves).
//!
//! **Fails when** the contours have other numbers of points, or a closed `from` crosses itself: the error names the edges.
//!
//! **Cost** O(n³) once for n points, with a constant of a nanosecond; then O(n √n + pixels inside) a frame; frames run in parallel once the first
//! is made.
//!
//! ```ron
//! "broom": (type: "image.warp_mesh", image: "@photo", from: "@outline", to: "@moved"),
//! ```

use std::sync::{Arc, OnceLock};

use pegbar_engine::node::{Context, In, NodeError, Recurrent};
use pegbar_engine::{Node, Value};

use super::{Picture, refused};
use crate::algo::curve_bend::{CurveBend, Options as BendOptions};
use crate::algo::mesh_deform::MeshDeform;
use crate::algo::warp_affine::Filter;
use crate::data::{Image, Shape};
use crate::retarget::{Carried, Edge, covered, cut, dissolve, with_alpha};

/// Moves a picture so that a contour on it becomes another.
///
/// Both have the same points in the same order: closed, the picture's inside goes along; open, such as a line of action, the picture bends around it.
#[derive(Node)]
#[node(
    id = "image.warp_mesh",
    version = 1,
    kind = recurrent,
    outputs = Picture,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4",
    example = "\"broom\": (type: \"image.warp_mesh\", image: \"@photo\", from: \"@outline\", to: \"@moved\")"
)]
pub(crate) struct ImageWarpMesh {
    /// The picture: linear light, premultiplied.
    image: In<Image>,
    /// The contour on it, pixels.
    from: In<Shape>,
    /// What the contour becomes, pixels.
    to: In<Shape>,
    /// Control points inside a closed contour: an eye, a knee, pixels.
    from_points: Option<In<Shape>>,
    /// Where the control points go, pixels. They stay where this is left out.
    to_points: Option<In<Shape>>,
    /// Where the picture ends. Of closed contours; with open ones as its alpha says.
    #[input(default = auto)]
    edge: Edge,
    /// How far outside a closed contour pixels are carried along: the width of a pen line that the contour runs inside of.
    #[input(default = 3.0, range = 0.0..=1000.0, unit = "px")]
    margin: f64,
    /// How fast an open curve loses hold of what is away from it. Small spreads a bend wide, large follows the nearest part alone.
    #[input(default = 2.0, range = 1.0..=16.0)]
    falloff: f64,
    /// How much narrower the picture gets where an open curve is stretched: 0 not at all, 1 so that areas are kept.
    #[input(default = 0.0, range = 0.0..=2.0)]
    volume: f64,
    /// How the picture is read between its pixels; where it shrinks, several places are averaged, so that nothing crawls.
    #[input(default = bilinear)]
    filter: Filter,
    /// True keeps all of the moved picture; false cuts it at the picture's own display window.
    #[input(default = true)]
    expand: bool,
}

/// A contour filled once for all frames.
#[derive(Clone, Debug, Value)]
pub(crate) struct Filled {
    /// The contour that it was made of.
    #[value(shape = "[n, 2]")]
    contour: Vec<[f64; 2]>,
    /// Control points that it was made with.
    #[value(shape = "[c, 2]")]
    controls: Vec<[f64; 2]>,
    /// Made again where it is not there.
    #[value(skip)]
    deform: OnceLock<Arc<MeshDeform>>,
}

impl ImageWarpMesh {
    fn controls(&self) -> &[[f64; 2]] {
        self.from_points.as_ref().map_or(&[], |s| &s.points)
    }

    fn filled(&self, before: Option<&Filled>) -> Result<Arc<MeshDeform>, NodeError> {
        let same = |b: &&Filled| b.contour == self.from.points && b.controls == self.controls();
        if let Some(kept) = before.filter(same).and_then(|b| b.deform.get()) {
            return Ok(kept.clone());
        }
        MeshDeform::new(&self.from.points, self.controls()).map(Arc::new).map_err(|e| refused(format!("from: {e}")))
    }

    /// What carries the picture, and the mesh to be kept.
    fn carried(&self, image: &Image, before: Option<&Filled>) -> Result<(Carried, Option<Arc<MeshDeform>>), NodeError> {
        if !self.from.closed {
            let options = BendOptions { falloff: self.falloff, volume: self.volume };
            let bend = CurveBend::new(&self.from.points, &self.to.points, options).map_err(refused)?;
            return Ok((Carried::bent(image, &bend), None));
        }
        let deform = self.filled(before)?;
        let targets = self.to_points.as_ref().map_or_else(|| self.controls(), |s| &s.points);
        let to = deform.deform(&self.to.points, targets).map_err(|e| refused(format!("to: {e}")))?;
        Ok((Carried::filled(deform.triangles(), deform.n_contour(), deform.points(), &to, self.margin.max(1.0)), Some(deform)))
    }

    fn draw(&self, image: &Image, carried: Carried) -> Result<Picture, NodeError> {
        let (channels, display) = (image.n_channels(), image.display_window());
        let layers = [(carried, image, 1.0)];
        let window = covered(&layers)?;
        let window = if self.expand { window } else { window.intersect(&display) };
        let mut samples = dissolve(&layers, channels, self.filter, window)?;
        if self.from.closed && (self.edge == Edge::Cut || self.edge == Edge::Auto && self.image.alpha().is_none()) {
            cut(&mut samples, &self.to.points, window, channels);
        }
        super::picture(image, window, display, samples)
    }
}

impl Recurrent for ImageWarpMesh {
    type State = Filled;

    fn run(self, state: Option<&Filled>, _cx: &Context) -> Result<(Picture, Filled), NodeError> {
        if self.from.closed != self.to.closed {
            let kind = |closed| if closed { "closed" } else { "open" };
            return Err(refused(format!(
                "expected from and to both closed or both open, found {} and {}",
                kind(self.from.closed),
                kind(self.to.closed)
            )));
        }
        if self.to_points.is_some() && self.from_points.is_none() || !self.from.closed && self.from_points.is_some() {
            return Err(refused("expected from_points on a closed contour before to_points, found none"));
        }
        let image = with_alpha(&self.image)?;
        let (carried, deform) = self.carried(&image, state)?;
        let picture = self.draw(&image, carried)?;
        let deform = deform.map_or_else(OnceLock::new, OnceLock::from);
        Ok((picture, Filled { contour: self.from.points.clone(), controls: self.controls().to_vec(), deform }))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        // All frames start from the first, which fills the contour, so that they need not wait for each other.
        (cx.frame > cx.clock.first).then_some(cx.clock.first)
    }
}

#[cfg(test)]
mod tests;
