//! `track.affine`: follows a region of the footage with an affine motion.
//!
//! **Method** see [`crate::algo::track_affine`]: robust inverse-compositional registration against the reference frame, coarse to fine, all colour channels
//! together, weighted by the matte, from the motions before, the matte's moments or a search.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, equations 8 to 12; Bergen et al. 1992; Shi and Tomasi 1994.
//!
//! **Fails when** the region has no texture and no outline, leaves the frame, or is covered; `status` says so frame by frame.
//!
//! **Cost** O(pixels of the region × iterations) a frame, whatever the size of the frame. Frames run in order, outwards from the reference.
//!
//! ```ron
//! "track": (type: "track.affine", image: "@plate", matte: "@matte", reference: 1),
//! ```

use std::sync::{Arc, OnceLock};

use pegbar_engine::node::{Context, Frames, NodeError, Problem, Recurrent};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Setting, Value};

use crate::algo::raster::{Affine, apply};
use crate::algo::track_affine::{self as algo, Guess, Model, Options, Region, Robust, Start, Status, Template, Tone, Track, TrackError};
use crate::data::{Affine2, Image, Matte, Shape};

/// How far around the first guess the tracker looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Search {
    /// Only where the guesses do not fit, wider and wider, then turned and scaled too.
    Auto,
    /// Not at all: for small motions.
    None,
    /// `search_radius` each way.
    Radius,
    /// The whole frame.
    Whole,
}

impl Search {
    pub(super) fn within(self, radius: f64) -> algo::Search {
        match self {
            Self::Auto => algo::Search::Auto,
            Self::None => algo::Search::None,
            Self::Radius => algo::Search::Radius(radius),
            Self::Whole => algo::Search::Whole,
        }
    }
}

/// Follows a region of the footage with an affine motion.
///
/// The region is a matte, a box, or the whole picture at the `reference` frame; the motion takes the reference to each frame. Frames before the
/// reference are tracked backwards.
#[derive(Node)]
#[node(
    id = "track.affine",
    version = 1,
    kind = recurrent,
    outputs = TrackAffineOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, eqs. 8-12; Bergen et al. 1992; Shi, Tomasi 1994",
    example = "\"track\": (type: \"track.affine\", image: \"@plate\", matte: \"@matte\", reference: 1)"
)]
pub(crate) struct TrackAffine {
    /// The footage.
    image: Frames<Image>,
    /// Matte of the region. The reference's says which pixels are followed; the others' keep the ground from pulling.
    matte: Option<Frames<Matte>>,
    /// The frame that the others are held against. The clock's first frame where it is left out.
    #[input(default = None)]
    reference: Option<i64>,
    /// The region without a matte: left, top, right, bottom at the reference frame, in pixels from the top left. The whole picture where it is left out.
    #[input(default = None, unit = "px")]
    region: Option<[f64; 4]>,
    /// Most levels of the pyramid. 1 stays at full size; more see larger motions.
    #[input(default = 6, range = 1..=10)]
    levels: u32,
    /// Most iterations at each level.
    #[input(default = 15, range = 1..=200)]
    iterations: u32,
    /// Standard deviation of the Gaussian and its derivatives, at each level. 0 takes central differences; large is blind to fine texture.
    #[input(default = 0.8, range = 0.0..=8.0, unit = "px")]
    sigma: f64,
    /// How much a pixel that does not fit counts.
    #[input(default = geman_mcclure)]
    robust: Robust,
    /// Bend of the robust weights, in robust standard deviations. Small rejects more, large is closer to least squares.
    #[input(default = 4.0, range = 0.5..=100.0)]
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
    /// An iteration that moves no corner of the region by more than this is the last. 0 runs all of them.
    #[input(default = 0.01, range = 0.0..=10.0, unit = "px")]
    tolerance: f64,
    /// What differences are taken of.
    #[input(default = encoded)]
    tone: Tone,
    /// Fit a gain and an offset a channel, for flicker and fades.
    #[input(default = false)]
    gain: bool,
    /// Use mattes as keys, so that the outline counts and the ground does not; else as weights only.
    #[input(default = true)]
    key: bool,
    /// Drift check against the reference: a frame whose relative residual is above this is unlike it. 0 is a perfect fit; unrelated pictures have about 1.4.
    #[input(default = 0.9, range = 0.0..=10.0)]
    max_dissimilarity: f64,
}

/// The motion, and how sure it is.
#[derive(Outputs)]
pub(crate) struct TrackAffineOutputs {
    /// Frame from reference, pixels.
    motion: Affine2,
    /// Robust standard deviation of the residual, in sample values of the tone.
    residual: Curve,
    /// Iterations over all levels.
    iterations: Curve,
    /// 1 where the last step was below the tolerance and the frame fits, else 0.
    converged: Curve,
    /// Largest over least eigenvalue of the Hessian: how much worse the least certain direction is than the most certain.
    condition: Curve,
    /// Residual over the region's own contrast: the drift check.
    dissimilarity: Curve,
    /// Share of the region that is on the frame, 0 to 1.
    overlap: Curve,
    /// 0 converged, 1 unfinished, 2 underdetermined, 3 textureless, 4 off frame, 5 unlike the reference, 6 not finite.
    status: Curve,
    /// The region's box under the motion: four corners, closed.
    outline: Shape,
}

/// The last two motions, and the reference ready to be found again.
#[derive(Clone, Debug, Value)]
pub(crate) struct TrackState {
    /// Motion of this frame: frame from reference, pixels.
    #[value(shape = "[2, 3]")]
    last: [[f64; 3]; 2],
    /// Motion of the frame before it; not finite where there is none.
    #[value(shape = "[2, 3]")]
    before: [[f64; 3]; 2],
    /// Made again from the reference frame where it is not there.
    #[value(skip)]
    template: OnceLock<Arc<Template>>,
}

fn refused(error: TrackError) -> NodeError {
    NodeError::input(error.to_string())
}

pub(super) fn code(status: Status) -> f64 {
    match status {
        Status::Converged => 0.0,
        Status::Unfinished => 1.0,
        Status::Underdetermined => 2.0,
        Status::Textureless => 3.0,
        Status::OffFrame => 4.0,
        Status::Unlike => 5.0,
        Status::NotFinite => 6.0,
    }
}

impl TrackAffine {
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
            tone: self.tone,
            gain: self.gain,
            key: self.key,
            max_dissimilarity: self.max_dissimilarity,
        }
    }

    fn reference(&self, cx: &Context) -> i64 {
        self.reference.unwrap_or(cx.clock.first)
    }

    fn template(&self, cx: &Context) -> Result<Arc<Template>, NodeError> {
        let frame = self.reference(cx);
        let matte = self.matte.as_ref().map(|m| m.at(frame)).transpose()?;
        let region = match (matte, self.region) {
            (Some(matte), _) => Region::Matte(matte.alpha()),
            (None, Some(corners)) => Region::Box(corners),
            (None, None) => Region::Whole,
        };
        Template::new(self.image.at(frame)?.in_display()?.raster(), region, &self.options()).map(Arc::new).map_err(refused)
    }
}

/// A box under a motion.
pub(super) fn outline([left, top, right, bottom]: [f64; 4], motion: &Affine) -> Shape {
    let corners = [[left, top], [right, top], [right, bottom], [left, bottom]];
    Shape { points: corners.map(|c| apply(motion, c.into()).into()).to_vec(), closed: true }
}

fn outputs(template: &Template, track: &Track) -> TrackAffineOutputs {
    let curve = |value| Curve { value };
    TrackAffineOutputs {
        motion: track.motion.into(),
        residual: curve(track.residual),
        iterations: curve(track.iterations as f64),
        converged: curve(f64::from(u8::from(track.is_converged()))),
        condition: curve(track.condition),
        dissimilarity: curve(track.dissimilarity),
        overlap: curve(track.overlap),
        status: curve(code(track.status)),
        outline: outline(template.bounds(), &track.motion),
    }
}

impl Recurrent for TrackAffine {
    type State = TrackState;

    fn run(self, state: Option<&TrackState>, cx: &Context) -> Result<(TrackAffineOutputs, TrackState), NodeError> {
        let template = match state.and_then(|s| s.template.get()) {
            Some(template) => template.clone(),
            None => self.template(cx)?,
        };
        let affine = |m: &[[f64; 3]; 2]| Affine::from(&Affine2 { matrix: *m });
        let start = state.map_or_else(Start::default, |s| {
            let before = s.before.as_flattened().iter().all(|v| v.is_finite()).then(|| affine(&s.before));
            Start { last: affine(&s.last), before }
        });
        let matte = self.matte.as_ref().map(|m| m.at(cx.frame)).transpose()?;
        let track = template.track(self.image.at(cx.frame)?.in_display()?.raster(), matte.map(|m| m.alpha()), &start).map_err(refused)?;
        let before = state.map_or([[f64::NAN; 3]; 2], |s| s.last);
        let state = TrackState { last: Affine2::from(track.motion).matrix, before, template: OnceLock::from(template.clone()) };
        Ok((outputs(&template, &track), state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        let reference = self.reference(cx);
        // A chain cannot start outside the clock: the read of that frame says so.
        cx.clock.index(reference)?;
        match cx.frame.cmp(&reference) {
            std::cmp::Ordering::Less => Some(cx.frame + 1),
            std::cmp::Ordering::Equal => None,
            std::cmp::Ordering::Greater => Some(cx.frame - 1),
        }
    }

    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        // The reference is asked for at every frame, as a chain may be taken up again in the middle.
        if cx.frame == self.reference(cx) { vec![cx.frame] } else { vec![cx.frame, self.reference(cx)] }
    }

    fn check(&self) -> Vec<Problem> {
        match self.region {
            Some([left, top, right, bottom]) if !(left < right && top < bottom) => {
                vec![Problem { input: "region", message: "expected left < right and top < bottom, found a box without pixels".to_owned() }]
            }
            _ => Vec::new(),
        }
    }
}
