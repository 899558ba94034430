//! `retarget.image`: a drawing or a photograph moved as the capture says, its pixels carried by a mesh.
//!
//! **Method** the keys' contours are filled with one triangulation ([`crate::algo::compatible`]) and blended ([`crate::algo::key_blend`]); every
//! triangle carries its pixels ([`crate::algo::warp_mesh`]). Several pictures, one for each key, are carried to the same place and dissolved. An open
//! curve, a line of action, bends all of the picture around it ([`crate::algo::curve_bend`]).
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 and Figures 12 and 13; Schaefer, McPhail, Warren 2006 (open curves).
//!
//! **Fails when** closed keys cross themselves: the error names the key and the edges.
//!
//! **Cost** once as `keys.inbetween`, then O(pixels inside · pictures) a frame; frames run in parallel once the first is made.
//!
//! ```ron
//! "broom": (type: "retarget.image", image: "@photo", keys: "@keys", weights: "@capture.weights", motion: "@capture.motion"),
//! ```

use pegbar_engine::node::{Context, In, List, NodeError, Recurrent};
use pegbar_engine::{Node, Outputs};

use super::{Carried, Edge, How, Made, Ready, covered, cut, dissolve, moved, placed, ready, refused, with_alpha};
use crate::algo::curve_bend::{CurveBend, Options as BendOptions};
use crate::algo::key_blend::Interpolation;
use crate::algo::raster::{Affine, invert};
use crate::algo::track_affine::Model;
use crate::algo::warp_affine::Filter;
use crate::algo::window::Window;
use crate::data::{Affine2, Image, KeyShapes, Weights};
use crate::keys::AlignTo;

/// A drawing or a photograph moved as the capture says, its pixels carried by a mesh.
///
/// Give one picture, on which the contour of the key `image_key` lies, or one for each key, which are dissolved by the weights. Keys are
/// closed contours in the pictures' pixels, or open curves, such as a line of action, that bend the picture around them.
#[derive(Node)]
#[node(
    id = "retarget.image",
    version = 2,
    kind = recurrent,
    outputs = RetargetImageOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4",
    example = "\"broom\": (type: \"retarget.image\", image: \"@photo\", keys: \"@keys\", weights: \"@capture.weights\", motion: \"@capture.motion\")"
)]
pub(crate) struct RetargetImage {
    /// The picture, or one for each key: linear light, premultiplied.
    image: List<In<Image>>,
    /// The target's key shapes, one for each captured key.
    keys: In<KeyShapes>,
    /// How much of each key.
    weights: In<Weights>,
    /// The captured motion: frame from reference, pixels. None where it is left out.
    motion: Option<In<Affine2>>,
    /// Where the keys are put before the motion: reference from keys, pixels. As drawn where it is left out.
    place: Option<In<Affine2>>,
    /// What lies between the keys.
    #[input(default = arap)]
    interpolation: Interpolation,
    /// In-betweens of each pair for `extended`.
    #[input(default = 5, range = 0..=1000)]
    inbetweens: u32,
    /// True prefers no key for `extended` and `arap`; false takes the first as the paper does.
    #[input(default = true)]
    symmetric: bool,
    /// The point of the contour that goes straight from key to key in `extended` and `arap`, as in the paper: a hip, a hand on a bar. The centroid
    /// where it is left out.
    #[input(default = None, range = 0..=1000000)]
    anchor: Option<u32>,
    /// What the keys are moved onto before they are blended, so that only the captured motion moves them (eq. 5).
    #[input(default = none)]
    align: AlignTo,
    /// Motions that `align` may use.
    #[input(default = affine)]
    align_model: Model,
    /// The key, from 0, whose contour lies on a single picture.
    #[input(default = 0, range = 0..=100000)]
    image_key: u32,
    /// Where the picture ends. Of closed keys; with open ones as its alpha says.
    #[input(default = auto)]
    edge: Edge,
    /// How far outside a closed contour pixels are carried along: the width of a pen line that the contour runs inside of.
    #[input(default = 3.0, range = 0.0..=1000.0, unit = "px")]
    margin: f64,
    /// How fast open keys lose hold of what is away from them. Small spreads a bend wide, large follows the nearest part alone.
    #[input(default = 2.0, range = 1.0..=16.0)]
    falloff: f64,
    /// How much narrower the picture gets where an open key is stretched: 0 not at all, 1 so that areas are kept.
    #[input(default = 0.0, range = 0.0..=2.0)]
    volume: f64,
    /// How the picture is read between its pixels. Cubic is sharper, and slower.
    #[input(default = bilinear)]
    filter: Filter,
    /// Width and height of the result's format. The picture's own where it is left out.
    #[input(default = None, range = 1..=65536, unit = "px")]
    size: Option<[i64; 2]>,
    /// True keeps all of the moved picture; false cuts it at the format.
    #[input(default = false)]
    expand: bool,
}

/// The picture in its new shape.
#[derive(Outputs)]
pub(crate) struct RetargetImageOutputs {
    /// It: linear light, premultiplied, with alpha.
    image: Image,
}

impl RetargetImage {
    /// The pictures, with the key and the share of each.
    fn pictures(&self, k: usize) -> Result<Vec<(usize, f64, &Image)>, NodeError> {
        let weights = &self.weights.weights;
        match self.image.0.len() {
            1 => {
                let key = self.image_key as usize;
                if key >= k {
                    return Err(refused(format!("expected an image_key below {k}, the number of keys, found {key}")));
                }
                Ok(self.image.0.iter().map(|i| (key, 1.0, &**i)).collect())
            }
            n if n == k && weights.len() == k => {
                let each = self.image.0.iter().zip(shares(weights)).enumerate();
                Ok(each.map(|(key, (i, share))| (key, share, &**i)).filter(|(_, share, _)| *share > 0.0).collect())
            }
            n => Err(refused(format!(
                "expected one picture, or {k} with {k} weights, one for each key, found {n} with {} weights",
                weights.len()
            ))),
        }
    }

    /// What carries a key's picture to the points of the blend, and on by the motion.
    fn carried(&self, made: &Made, key: usize, image: &Image, points: &[[f64; 2]], map: &Affine) -> Result<Carried, NodeError> {
        let (blend, motion) = (&made.blend, &made.motions[key]);
        let drawn =
            invert(motion).ok_or_else(|| refused(format!("key {key}: expected points that are not on a line to align, found some")))?;
        let from = moved(&blend.keys()[key], &drawn);
        if self.keys.closed {
            return Ok(Carried::filled(blend.triangles(), blend.n_contour(), &from, &moved(points, map), self.margin.max(1.0)));
        }
        // An open curve has no width: only the blend bends, so that the motion scales and squashes what is around the curve as it does the curve.
        let options = BendOptions { falloff: self.falloff, volume: self.volume };
        let bend = CurveBend::new(&from, points, options).map_err(|e| refused(format!("key {key}: {e}")))?;
        Ok(Carried::bent(image, &bend).moved(map))
    }

    fn draw(&self, made: &Made) -> Result<Image, NodeError> {
        let blend = &made.blend;
        let pictures = self.pictures(blend.keys().len())?;
        let used: Vec<Image> = pictures.iter().map(|(_, _, p)| with_alpha(p)).collect::<Result<_, _>>()?;
        let first = used.first().ok_or_else(|| NodeError::internal("no picture has a weight"))?;
        let (format, channels) = (self.size.map_or(first.display_window(), |[w, h]| Window::from_bounds(0, 0, w, h)), first.n_channels());
        if used.iter().any(|i| i.n_channels() != channels) {
            return Err(refused("expected pictures of the same channels, found others"));
        }
        let map = placed(self.place.as_deref(), self.motion.as_deref())?;
        let points = blend.blend(&self.weights.weights).map_err(refused)?;
        let layer =
            |((key, share, _), image): (&(usize, f64, &Image), _)| Ok((self.carried(made, *key, image, &points, &map)?, image, *share));
        let layers: Vec<(Carried, &Image, f64)> = pictures.iter().zip(&used).map(layer).collect::<Result<_, NodeError>>()?;
        let window = covered(&layers)?;
        let window = if self.expand { window } else { window.intersect(&format) };
        let mut samples = dissolve(&layers, channels, self.filter, window)?;
        let had_alpha = pictures.iter().all(|(_, _, p)| p.alpha().is_some());
        if self.keys.closed && (self.edge == Edge::Cut || self.edge == Edge::Auto && !had_alpha) {
            cut(&mut samples, &moved(&points[..blend.n_contour()], &map), window, channels);
        }
        let image =
            Image::new(window.width, window.height, channels, samples).ok_or_else(|| NodeError::internal("a picture of another size"))?;
        Ok(image.with_channels(first.channels()).with_windows(window, format))
    }
}

/// Weights as shares of a dissolve: none below 0, all together 1.
fn shares(weights: &[f64]) -> Vec<f64> {
    let sum: f64 = weights.iter().map(|w| w.max(0.0)).sum();
    let n = weights.len().max(1) as f64;
    weights.iter().map(|w| if sum > 0.0 { w.max(0.0) / sum } else { 1.0 / n }).collect()
}

impl Recurrent for RetargetImage {
    type State = Ready;

    fn run(self, state: Option<&Ready>, _cx: &Context) -> Result<(RetargetImageOutputs, Ready), NodeError> {
        let how = How {
            interpolation: self.interpolation,
            inbetweens: self.inbetweens,
            symmetric: self.symmetric,
            anchor: self.anchor,
            align: self.align,
            align_model: self.align_model,
            mesh: true,
        };
        let (made, state) = ready(&self.keys, state, how)?;
        Ok((RetargetImageOutputs { image: self.draw(&made)? }, state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        (cx.frame > cx.clock.first).then_some(cx.clock.first)
    }
}

#[cfg(test)]
mod tests;
