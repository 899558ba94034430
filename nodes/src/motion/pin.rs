//! `motion.pin`: holds points in place over ranges of frames: feet that stand, a hand on a rail.
//!
//! **Method** see [`crate::algo::motion::pin`]: the whole motion is shifted, by what brings each point to its place while it is pinned, and smoothly from pin to pin.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.4 (global translations as constraints); Fritsch and Carlson 1980 (slopes).
//!
//! **Fails when** a pin names frames that the motion has not, no point, or a point that the contour has not; where pins overlap they share the shift, and `error` says what is left.
//!
//! **Cost** O(frames · pins).
//!
//! ```ron
//! "stood": (type: "motion.pin", motion: "@track.motion", pins: [(frames: (8, 14), point: (120, 310))], ground: 320),
//! ```

use std::sync::Arc;

use pegbar_engine::node::{AnySequence, AnyStream, Context, NodeError, Problem, Stream, Whole};
use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use pegbar_engine::value::{Curve, Value, ValueRef};
use pegbar_engine::{Node, Outputs};
use serde::Deserialize;

use super::{all, refused};
use crate::algo::motion::pin::{Pinned, Pinning, misses, shifts};
use crate::algo::raster::{Affine, apply};
use crate::data::{Affine2, Shape};

/// One pin.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Pin {
    frames: [i64; 2],
    #[serde(default)]
    point: Option<[f64; 2]>,
    #[serde(default)]
    index: Option<usize>,
    #[serde(default)]
    at: Option<[f64; 2]>,
}

/// Several pins.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pins(Vec<Pin>);

impl Setting for Pins {
    fn type_name() -> String {
        "list of pins".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        let found: Result<Vec<Pin>, _> = parse_slice(text, Extensions::empty());
        found.map(Self).map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
    fn numbers(&self) -> Vec<f64> {
        self.0.iter().flat_map(|p| p.point.into_iter().chain(p.at)).flatten().collect()
    }
}

/// Holds points in place over ranges of frames.
///
/// The motion is an affine motion, whose pins name points of the reference, or contours, whose pins name points by their index.
#[derive(Node)]
#[node(
    id = "motion.pin",
    version = 2,
    kind = whole,
    outputs = MotionPinOutputs,
    type_from = "motion",
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.4",
    example = "\"stood\": (type: \"motion.pin\", motion: \"@track.motion\", pins: [(frames: (8, 14), point: (120, 310))], ground: 320)"
)]
pub(crate) struct MotionPin {
    /// The motion.
    motion: AnySequence,
    /// What stands where: `frames` from first to last; `point`, in pixels of the reference of an affine motion, or `index`, from 0, of a contour; `at`, its place in the
    /// frame, where it is left out the one that it has at the first of the frames.
    pins: Pins,
    /// Height, y from the top, that no pinned point goes below at any frame. None where it is left out.
    #[input(default = None, range = -1000000.0..=1000000.0, unit = "px")]
    ground: Option<f64>,
    /// Frames over which the shift comes before the first pin and goes after the last. It is held where this is left out; 0 lets go at once.
    #[input(default = None, range = 0.0..=1000000.0, unit = "frames")]
    blend: Option<f64>,
}

/// The motion, and how well the pins hold.
#[derive(Outputs)]
pub(crate) struct MotionPinOutputs {
    /// Of the same type as the motion that came in.
    motion: AnyStream,
    /// How far the worst pinned point is from its place, pixels: more than nothing where pins overlap, or the ground is above a pin.
    error: Stream<Curve>,
}

/// A motion as maps or as contours.
enum Given {
    Maps(Vec<Affine>),
    Shapes(Vec<Shape>),
}

impl Given {
    fn read(values: &AnySequence) -> Result<Self, NodeError> {
        let values = values.gather()?;
        match values.first().map(|v| v.type_name()) {
            Some(kind) if kind == Affine2::NAME => {
                let maps: Vec<Affine> = all::<Affine2>(&values)?.iter().map(|a| Affine::from(&**a)).collect();
                Ok(Self::Maps(maps))
            }
            Some(kind) if kind == Shape::NAME => Ok(Self::Shapes(all::<Shape>(&values)?.iter().map(|s| (**s).clone()).collect())),
            Some(kind) => Err(refused(format!("expected a motion of Affine2 or Shape, found {kind}"))),
            None => Err(refused("expected a motion of at least one frame, found none")),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Maps(m) => m.len(),
            Self::Shapes(s) => s.len(),
        }
    }

    /// Where a pin's point is at each frame.
    fn path(&self, pin: &Pin) -> Result<Vec<[f64; 2]>, NodeError> {
        match (self, pin.point, pin.index) {
            (Self::Maps(maps), Some(p), None) => Ok(maps.iter().map(|m| apply(m, p.into()).into()).collect()),
            (Self::Shapes(shapes), None, Some(i)) => {
                let at = |s: &Shape| s.points.get(i).copied();
                let found: Option<Vec<[f64; 2]>> = shapes.iter().map(at).collect();
                found.ok_or_else(|| refused(format!("pins: expected an index below the number of points, found {i}")))
            }
            (Self::Maps(_), ..) => Err(refused("pins: expected a point for an affine motion, found none, or an index")),
            (Self::Shapes(_), ..) => Err(refused("pins: expected an index for a contour, found none, or a point")),
        }
    }

    fn shifted(self, by: &[[f64; 2]]) -> Vec<ValueRef> {
        match self {
            Self::Maps(maps) => {
                let shift = |(mut m, d): (Affine, &[f64; 2])| {
                    m[(0, 2)] += d[0];
                    m[(1, 2)] += d[1];
                    Arc::new(Affine2::from(m)) as ValueRef
                };
                maps.into_iter().zip(by).map(shift).collect()
            }
            Self::Shapes(shapes) => {
                let shift = |(mut s, d): (Shape, &[f64; 2])| {
                    s.points.iter_mut().for_each(|p| *p = [p[0] + d[0], p[1] + d[1]]);
                    Arc::new(s) as ValueRef
                };
                shapes.into_iter().zip(by).map(shift).collect()
            }
        }
    }
}

impl Whole for MotionPin {
    fn run(self, cx: &Context) -> Result<MotionPinOutputs, NodeError> {
        let given = Given::read(&self.motion)?;
        let n = given.len();
        let at = |frame: i64| {
            let k = usize::try_from(frame - cx.clock.first).ok().filter(|k| *k < n);
            k.ok_or_else(|| refused(format!("pins: expected frames of the motion, {} to {}, found {frame}", cx.clock.first, cx.clock.last)))
        };
        let mut pins = Vec::with_capacity(self.pins.0.len());
        for pin in &self.pins.0 {
            let path = given.path(pin)?;
            if let Some(k) = path.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
                return Err(refused(format!("frame {}: expected a finite motion, found NaN or infinity", cx.clock.first + k as i64)));
            }
            pins.push(Pinned { first: at(pin.frames[0])?, last: at(pin.frames[1])?, path, target: pin.at });
        }
        let by = shifts(&pins, n, &Pinning { blend: self.blend, ground: self.ground });
        let error = misses(&pins, &by).into_iter().map(|value| Curve { value }).collect();
        Ok(MotionPinOutputs { motion: AnyStream(given.shifted(&by)), error: Stream(error) })
    }

    fn check(&self) -> Vec<Problem> {
        let wrong = |p: &&Pin| p.frames[1] < p.frames[0] || p.point.is_some() == p.index.is_some();
        let message = |p: &Pin| {
            let [first, last] = p.frames;
            format!("expected frames in order and either a point or an index, found frames ({first}, {last})")
        };
        self.pins.0.iter().filter(wrong).map(|p| Problem { input: "pins", message: message(p) }).collect()
    }
}
