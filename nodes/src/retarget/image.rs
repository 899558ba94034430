//! `retarget.image`: a drawing or a photograph moved as the capture says, its pixels carried by a mesh.
//!
//! **Method** the keys' contours are filled with one triangulation ([`crate::algo::compatible`]) and blended ([`crate::algo::key_blend`]); every
//! triangle carries its pixels ([`crate::algo::warp_mesh`]). Several pictures, one for each key, are carried to the same place and dissolved.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4.
//!
//! **Fails when** keys are open curves, or cross themselves: the error names the key and the edges.
//!
//! **Cost** once as `keys.inbetween`, then O(pixels inside · pictures) a frame; frames run in parallel once the first is made.
//!
//! ```ron
//! "broom": (type: "retarget.image", image: "@photo", keys: "@keys", weights: "@capture.weights", motion: "@capture.motion"),
//! ```

use kurbo::Point;
use pegbar_engine::node::{Context, Fault, In, List, NodeError, Recurrent};
use pegbar_engine::{Node, Outputs, Setting};

use super::{Carried, How, Ready, moved, placed, ready, refused, with_alpha};
use crate::algo::key_blend::{Interpolation, KeyBlend};
use crate::algo::paint::{FillRule, coverage, polygon};
use crate::algo::warp_affine::Filter;
use crate::algo::window::Window;
use crate::data::{Affine2, Image, KeyShapes, Weights};

/// Where the picture ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Edge {
    /// As its alpha says where it has one, else at the contour.
    Auto,
    /// As its alpha says, up to the margin outside the contour.
    Margin,
    /// At the contour.
    Cut,
}

/// A drawing or a photograph moved as the capture says, its pixels carried by a mesh.
///
/// Give one picture, on which the contour of the key `image_key` lies, or one for each key, which are dissolved by the weights. Keys are closed
/// contours in the pictures' pixels.
#[derive(Node)]
#[node(
    id = "retarget.image",
    version = 1,
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
    /// The key, from 0, whose contour lies on a single picture.
    #[input(default = 0, range = 0..=100000)]
    image_key: u32,
    /// Where the picture ends.
    #[input(default = auto)]
    edge: Edge,
    /// How far outside the contour pixels are carried along: the width of a pen line that the contour runs inside of.
    #[input(default = 3.0, range = 0.0..=1000.0, unit = "px")]
    margin: f64,
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
    /// The pictures, and how much of each.
    fn pictures(&self, blend: &KeyBlend) -> Result<(Vec<Option<&Image>>, Vec<f64>), NodeError> {
        let k = blend.keys().len();
        let weights = &self.weights.weights;
        match self.image.0.len() {
            1 => {
                let key = self.image_key as usize;
                if key >= k {
                    return Err(refused(format!("expected an image_key below {k}, the number of keys, found {key}")));
                }
                let image = self.image.0.first().map(|i| &**i);
                Ok(((0..k).map(|i| image.filter(|_| i == key)).collect(), (0..k).map(|i| f64::from(u8::from(i == key))).collect()))
            }
            n if n == k && weights.len() == k => Ok((self.image.0.iter().map(|i| Some(&**i)).collect(), shares(weights))),
            n => Err(refused(format!(
                "expected one picture, or {k} with {k} weights, one for each key, found {n} with {} weights",
                weights.len()
            ))),
        }
    }

    fn draw(&self, blend: &KeyBlend) -> Result<Image, NodeError> {
        let (pictures, shares) = self.pictures(blend)?;
        let used: Vec<Option<Image>> =
            pictures.iter().zip(&shares).map(|(p, w)| p.filter(|_| *w > 0.0).map(with_alpha).transpose()).collect::<Result<_, _>>()?;
        let first = used.iter().flatten().next().ok_or_else(|| NodeError::internal("no picture has a weight"))?;
        let (format, channels) = (self.size.map_or(first.display_window(), |[w, h]| Window::from_bounds(0, 0, w, h)), first.n_channels());
        if used.iter().flatten().any(|i| i.n_channels() != channels) {
            return Err(refused("expected pictures of the same channels, found others"));
        }
        let had_alpha = pictures.iter().zip(&shares).filter(|(_, w)| **w > 0.0).all(|(p, _)| p.is_none_or(|p| p.alpha().is_some()));
        let map = placed(self.place.as_deref(), self.motion.as_deref())?;
        let points = moved(&blend.blend(&self.weights.weights).map_err(refused)?, &map);
        let carried = Carried { blend, margin: self.margin.max(1.0), filter: self.filter };
        let window = carried.bounds(&points).ok_or_else(|| refused("expected a shape within the range of pixels, found one beyond it"))?;
        let window = if self.expand { window } else { window.intersect(&format) };
        let views: Vec<Option<&Image>> = used.iter().map(Option::as_ref).collect();
        let mut samples = carried.dissolve_some(&views, &shares, &points, window, channels)?;
        if self.edge == Edge::Cut || self.edge == Edge::Auto && !had_alpha {
            cut(&mut samples, &points[..blend.n_contour()], window, channels);
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

/// Leaves what is inside a contour, with soft pixels along it.
fn cut(samples: &mut [f32], contour: &[[f64; 2]], window: Window, channels: usize) {
    let own: Vec<Point> = contour.iter().map(|p| Point::new(p[0] - window.x as f64, p[1] - window.y as f64)).collect();
    let inside = coverage(&polygon(&own), FillRule::NonZero, window.width, window.height);
    for (pixel, share) in samples.chunks_exact_mut(channels).zip(inside) {
        pixel.iter_mut().for_each(|v| *v *= share);
    }
}

impl Recurrent for RetargetImage {
    type State = Ready;

    fn run(self, state: Option<&Ready>, _cx: &Context) -> Result<(RetargetImageOutputs, Ready), NodeError> {
        if !self.keys.closed {
            let error = NodeError::new(Fault::Input, "expected closed key shapes, which have an inside, found open ones");
            return Err(error.help("close them, or draw the outline of what the curve moves"));
        }
        let how = How {
            interpolation: self.interpolation,
            inbetweens: self.inbetweens,
            symmetric: self.symmetric,
            anchor: self.anchor,
            mesh: true,
        };
        let (blend, state) = ready(&self.keys, state, how)?;
        Ok((RetargetImageOutputs { image: self.draw(&blend)? }, state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        (cx.frame > cx.clock.first).then_some(cx.clock.first)
    }
}

#[cfg(test)]
mod tests;
