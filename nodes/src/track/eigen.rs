//! `track.eigen`: follows a character through the footage, and reads which of its poses it shows.
//!
//! **Method** see [`crate::algo::track_affine::eigen`]: an affine motion and the coefficients of a space of pictures, solved for together, robustly, coarse to fine, all
//! colour channels and the matte together, from the frame before, the matte's moments in several poses, or a search.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, equations 14 and 15; Black and Jepson 1998.
//!
//! **Fails when** the character shows what is not in the space, leaves the frame, or is covered; `status` says so frame by frame.
//!
//! **Cost** O(pixels with detail × components) an iteration. Frames run in order, outwards from `first`.
//!
//! ```ron
//! "bear": (type: "track.eigen", image: "@plate", matte: "@matte", basis: "@space.basis", keys: "@all.keys"),
//! ```

use std::sync::{Arc, OnceLock};

use pegbar_engine::node::{Context, Fault, Frames, In, NodeError, Recurrent};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Value};

use super::affine::{Search, code, outline};
use crate::algo::pose_map::PoseMap;
use crate::algo::raster::{Affine, apply};
use crate::algo::track_affine::eigen::{
    Drawn, DrawnPose, EigenError, EigenOptions, EigenStart, EigenTemplate, EigenTrack, Pictures, placed,
};
use crate::algo::track_affine::{Guess, Model, Options, Robust};
use crate::algo::window::Window;
use crate::data::{Affine2, Basis, BasisKind, Drawing, Image, KeyDrawings, KeyShapes, Matte, Shape, Weights};
use crate::keys::contours;
use crate::render::{Pen, blank};

/// Follows a character through the footage, and reads which of its poses it shows.
///
/// The poses are a space of pictures, made by `keys.inbetween` and `keys.basis`. With the key shapes of the same examples the character's
/// contour comes out too: `solve.key_weights` makes weights of the hand-drawn keys of it.
#[derive(Node)]
#[node(
    id = "track.eigen",
    version = 4,
    kind = recurrent,
    outputs = TrackEigenOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, eqs. 14, 15; Black, Jepson 1998",
    example = "\"bear\": (type: \"track.eigen\", image: \"@plate\", matte: \"@matte\", basis: \"@space.basis\", keys: \"@all.keys\")"
)]
pub(crate) struct TrackEigen {
    /// The footage.
    image: Frames<Image>,
    /// Matte of the character. With it the outline counts and the ground does not; the pictures need an alpha then.
    matte: Option<Frames<Matte>>,
    /// The space of pictures.
    basis: In<Basis>,
    /// The contours of the examples, in the order of the pictures that the space was made of; or those of the components and the mean, as
    /// `keys.basis` gives them. None where no contour is wanted.
    keys: Option<In<KeyShapes>>,
    /// The key drawings that the pictures were made of. With them each pose is drawn anew at the finest levels, which is what makes the
    /// pose exact: pictures span what lies between them badly where they are far apart.
    drawings: Option<In<KeyDrawings>>,
    /// The frame where tracking begins, best one that shows the character well. The clock's first where it is left out.
    #[input(default = None)]
    first: Option<i64>,
    /// Where the pictures are in the frame where tracking begins: frame from pictures. As they stand where it is left out; a matte finds it
    /// by itself.
    place: Option<In<Affine2>>,
    /// Most levels of the pyramid. 1 stays at full size; more see larger motions.
    #[input(default = 6, range = 1..=10)]
    levels: u32,
    /// The level where the work ends: 0 at full size, 1 at half, 2 at a quarter. Half size loses some hundredths of a pixel, and a frame of 1080
    /// lines takes a fraction of the time. For `drawings` it is 0: they are drawn anew at full size.
    #[input(default = 0, range = 0..=9)]
    finest: u32,
    /// Most iterations at the finest level.
    #[input(default = 15, range = 1..=200)]
    iterations: u32,
    /// Standard deviation of the Gaussian and its derivatives, at each level. 0 takes central differences; large is blind to fine texture.
    #[input(default = 0.8, range = 0.0..=8.0, unit = "px")]
    sigma: f64,
    /// How much a pixel that does not fit counts.
    #[input(default = geman_mcclure)]
    robust: Robust,
    /// Bend of the robust weights, in robust standard deviations. Small rejects more, large is closer to least squares.
    #[input(default = 2.0, range = 0.5..=100.0)]
    cut: f64,
    /// Motions that are allowed.
    #[input(default = affine)]
    model: Model,
    /// Where the first guesses come from.
    #[input(default = auto)]
    start: Guess,
    /// Predict at constant velocity from the two motions before.
    #[input(default = true)]
    velocity: bool,
    /// How far around the first guess is looked.
    #[input(default = auto)]
    search: Search,
    /// How far `search: radius` looks each way.
    #[input(default = 32.0, range = 0.0..=100000.0, unit = "px")]
    search_radius: f64,
    /// Poses that each frame starts from, beside that of the frame before. More find a character that jumps from pose to pose.
    #[input(default = 8, range = 1..=64)]
    poses: u32,
    /// How much the spread of the examples holds the pose: 0 not at all, 1 as their probability says.
    #[input(default = 1.0, range = 0.0..=1000000.0)]
    prior: f64,
    /// Most pixels of a level that are looked at, of those with detail. Fewer are quicker, more are surer in grain.
    #[input(default = 8192, range = 1024..=1000000000)]
    pixels: u32,
    /// An iteration that moves no corner by more than this, nor the pose by this share of its spread, is the last. 0 runs all of them.
    #[input(default = 0.01, range = 0.0..=10.0, unit = "px")]
    tolerance: f64,
    /// Fit a gain and an offset a channel, for flicker and fades.
    #[input(default = false)]
    gain: bool,
    /// A frame whose relative residual is above this is unlike the pictures. 0 is a perfect fit; unrelated pictures have about 1.4.
    #[input(default = 0.9, range = 0.0..=10.0)]
    max_dissimilarity: f64,
}

/// The motion, the pose, and how sure they are.
#[derive(Outputs)]
pub(crate) struct TrackEigenOutputs {
    /// Frame from pictures, pixels.
    motion: Affine2,
    /// How much of each of the L + 1 keys of the space (the mean plus each component, then the mean): they add up to 1.
    weights: Weights,
    /// Robust standard deviation of the residual, in sample values of the tone.
    residual: Curve,
    /// The character's contour in the frame, pixels: all points of the `drawings`, or its own with `keys`, else the box of the pictures.
    shape: Shape,
    /// Iterations over all levels.
    iterations: Curve,
    /// 1 where the last step was below the tolerance and the frame fits, else 0.
    converged: Curve,
    /// Largest over least eigenvalue of the Hessian of the motion, once the pose has taken its share.
    condition: Curve,
    /// Residual over the mean picture's own contrast.
    dissimilarity: Curve,
    /// Share of the pictures that is on the frame, 0 to 1.
    overlap: Curve,
    /// By how much the next best start fitted worse at the coarsest level: 0 is a toss-up, 1 that there was no need of another.
    margin: Curve,
    /// How much of each of the `drawings`: they add up to 1. None without drawings.
    drawn: Weights,
    /// 0 converged, 1 unfinished, 2 underdetermined, 3 textureless, 4 off frame, 5 unlike the pictures, 6 not finite.
    status: Curve,
}

/// The space ready to be found, and the contours that go with it.
#[derive(Debug)]
struct Ready {
    template: EigenTemplate,
    contour: Option<PoseMap>,
    reach: Vec<f64>,
}

/// The last two motions and the last pose.
#[derive(Clone, Debug, Value)]
pub(crate) struct EigenState {
    /// Motion of this frame: frame from pictures, pixels.
    #[value(shape = "[2, 3]")]
    last: [[f64; 3]; 2],
    /// Motion of the frame before it; not finite where there is none.
    #[value(shape = "[2, 3]")]
    before: [[f64; 3]; 2],
    /// Coefficients of this frame.
    #[value(shape = "[l]")]
    coefficients: Vec<f64>,
    /// Weights of the drawings of this frame; none where they were not found.
    #[value(shape = "[k]")]
    drawn: Vec<f64>,
    /// Made again from the space where it is not there.
    #[value(skip)]
    ready: OnceLock<Arc<Ready>>,
}

/// Key drawings as the tracker draws them.
struct Drawer<'a> {
    keys: &'a KeyDrawings,
    /// A drawing without points and names, which take longer to copy than to draw.
    paint: Drawing,
}

impl<'a> Drawer<'a> {
    fn new(keys: &'a KeyDrawings) -> Self {
        Self { keys, paint: Drawing { names: Vec::new(), groups: Vec::new(), ..keys.drawing(Vec::new()) } }
    }
}

impl Drawn for Drawer<'_> {
    fn n_keys(&self) -> usize {
        self.keys.len()
    }

    fn key(&self, k: usize) -> &[[f64; 2]] {
        self.keys.key(k)
    }

    fn draw(&self, weights: &[f64], place: &Affine, line: f64, size: [usize; 2]) -> Option<Vec<f32>> {
        let points = placed(self, &DrawnPose { motion: *place, weights: weights.to_vec() });
        let width = self.paint.width.iter().map(|w| w * line).collect();
        let window = Window::at_origin(size[0], size[1]);
        let mut picture = blank(window).ok()?;
        Pen::default().draw(&Drawing { points, width, ..self.paint.clone() }, &mut picture, window).ok()?;
        Some(picture)
    }
}

fn refused(error: EigenError) -> NodeError {
    NodeError::input(error.to_string())
}

impl TrackEigen {
    fn options(&self) -> Options {
        Options {
            levels: self.levels as usize,
            iterations: self.iterations as usize,
            sigma: self.sigma,
            robust: self.robust,
            cut: self.cut,
            model: self.model,
            guess: self.start,
            velocity: self.velocity,
            search: self.search.within(self.search_radius),
            tolerance: self.tolerance,
            gain: self.gain,
            max_dissimilarity: self.max_dissimilarity,
            ..Options::default()
        }
    }

    fn ready(&self) -> Result<Arc<Ready>, NodeError> {
        let basis = &self.basis;
        let window = basis.window.filter(|_| basis.kind == BasisKind::Images).ok_or_else(|| {
            let help = "give `keys.basis` the pictures of the keys: images: \"@all.images\"";
            NodeError::new(Fault::Input, "basis: expected a space of pictures, found one of other values").help(help)
        })?;
        let pictures = Pictures {
            mean: &basis.mean,
            components: basis.components.data(),
            variances: &basis.variances,
            examples: &basis.coordinates,
            window,
            channels: basis.channels.len(),
            alpha: basis.channels.iter().position(|c| c == "A"),
            tone: basis.tone,
        };
        if self.finest > 0 && self.drawings.is_some() {
            let why = format!("finest: expected 0 with `drawings`, which are drawn anew at full size, found {}", self.finest);
            return Err(NodeError::new(Fault::Parameters, why).help("leave `finest` or `drawings` out"));
        }
        let (pixels, poses, finest) = (self.pixels as usize, self.poses as usize, self.finest as usize);
        let how = EigenOptions { prior: self.prior, pixels, poses, finest };
        let template = EigenTemplate::new(&pictures, &self.options(), &how).map_err(refused)?;
        Ok(Arc::new(Ready { template, contour: self.contour()?, reach: basis.reach() }))
    }

    /// The contour as a function of the pose.
    fn contour(&self) -> Result<Option<PoseMap>, NodeError> {
        let Some(keys) = &self.keys else { return Ok(None) };
        let shapes = contours(keys);
        let (l, m) = (self.basis.variances.len(), self.basis.coordinates.len());
        let examples: Vec<Vec<f64>> = if shapes.len() == m {
            self.basis.coordinates.clone()
        } else if shapes.len() == l + 1 {
            let reach = self.basis.reach();
            let unit = |i: usize| (0..l).map(|k| if k == i { reach[k] } else { 0.0 }).collect();
            (0..=l).map(unit).collect()
        } else {
            let found = shapes.len();
            return Err(NodeError::input(format!(
                "keys: expected {m} contours, one for each picture, or the {} of the space, found {found}",
                l + 1
            )));
        };
        let views: Vec<&[f64]> = shapes.iter().map(|s| s.as_flattened()).collect();
        PoseMap::new(&examples, &views).map(Some).map_err(|e| NodeError::input(format!("keys: {e}")))
    }

    fn first(&self, cx: &Context) -> i64 {
        self.first.unwrap_or(cx.clock.first)
    }

    fn shape(&self, ready: &Ready, track: &EigenTrack, pose: Option<&DrawnPose>) -> Shape {
        if let (Some(drawings), Some(pose)) = (&self.drawings, pose) {
            return Shape { points: placed(&Drawer::new(drawings), pose), closed: false };
        }
        let (Some(map), Some(keys)) = (&ready.contour, &self.keys) else { return outline(ready.template.bounds(), &track.motion) };
        let points = map.at(&track.coefficients);
        let moved = points.as_chunks().0.iter().map(|p: &[f64; 2]| apply(&track.motion, (*p).into()).into()).collect();
        Shape { points: moved, closed: keys.closed }
    }

    fn outputs(&self, ready: &Ready, track: &EigenTrack, pose: Option<&DrawnPose>) -> TrackEigenOutputs {
        let curve = |value| Curve { value };
        let shares = track.coefficients.iter().zip(&ready.reach).map(|(c, r)| if *r > 0.0 { c / r } else { 0.0 });
        let mut weights: Vec<f64> = shares.collect();
        weights.push(1.0 - weights.iter().sum::<f64>());
        TrackEigenOutputs {
            motion: track.motion.into(),
            weights: Weights { weights },
            residual: curve(track.residual),
            shape: self.shape(ready, track, pose),
            iterations: curve(track.iterations as f64),
            converged: curve(f64::from(u8::from(track.is_converged()))),
            condition: curve(track.condition),
            dissimilarity: curve(track.dissimilarity),
            overlap: curve(track.overlap),
            margin: curve(track.margin),
            drawn: Weights { weights: pose.map_or_else(Vec::new, |p| p.weights.clone()) },
            status: curve(code(track.status)),
        }
    }
}

impl Recurrent for TrackEigen {
    type State = EigenState;

    fn run(self, state: Option<&EigenState>, cx: &Context) -> Result<(TrackEigenOutputs, EigenState), NodeError> {
        let ready = match state.and_then(|s| s.ready.get()) {
            Some(ready) => ready.clone(),
            None => self.ready()?,
        };
        let affine = |m: &[[f64; 3]; 2]| Affine::from(&Affine2 { matrix: *m });
        let begin =
            || EigenStart { last: self.place.as_deref().map_or_else(crate::algo::raster::identity, Affine::from), ..EigenStart::default() };
        let start = state.map_or_else(begin, |s| {
            let before = s.before.as_flattened().iter().all(|v| v.is_finite()).then(|| affine(&s.before));
            EigenStart { last: affine(&s.last), before, coefficients: s.coefficients.clone() }
        });
        let matte = self.matte.as_ref().map(|m| m.at(cx.frame)).transpose()?;
        let frame = self.image.at(cx.frame)?.in_display()?;
        let matte = matte.map(|m| m.alpha());
        let (track, pose) = match &self.drawings {
            None => (ready.template.track(frame.raster(), matte, &start).map_err(refused)?, None),
            Some(drawings) => {
                let last = state.map(|s| DrawnPose { motion: affine(&s.last), weights: s.drawn.clone() });
                let contour = |c: &[f64]| ready.contour.as_ref().map(|map| map.at(c).as_chunks().0.to_vec());
                ready
                    .template
                    .track_drawn(frame.raster(), matte, &start, &Drawer::new(drawings), last.as_ref(), contour)
                    .map_err(refused)?
            }
        };
        let state = EigenState {
            last: Affine2::from(track.motion).matrix,
            before: state.map_or([[f64::NAN; 3]; 2], |s| s.last),
            coefficients: track.coefficients.clone(),
            drawn: pose.as_ref().map_or_else(Vec::new, |p| p.weights.clone()),
            ready: OnceLock::from(ready.clone()),
        };
        Ok((self.outputs(&ready, &track, pose.as_ref()), state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        let first = self.first(cx);
        cx.clock.index(first)?;
        match cx.frame.cmp(&first) {
            std::cmp::Ordering::Less => Some(cx.frame + 1),
            std::cmp::Ordering::Equal => None,
            std::cmp::Ordering::Greater => Some(cx.frame - 1),
        }
    }
}
