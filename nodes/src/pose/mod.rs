//! What joints do: turned to markers, made to stand where they should.

mod align_2d;
mod descriptor;
mod fit;
mod fit_outline;
mod joint_angles;
mod markers;
mod mesh_pin;
mod pin;
mod procrustes;
mod resample;

pub(crate) use align_2d::PoseAlign2d;
pub(crate) use descriptor::PoseDescriptor;
pub(crate) use fit::PoseFit;
pub(crate) use joint_angles::PoseJointAngles;
pub(crate) use mesh_pin::MeshPin;
pub(crate) use pin::PosePin;
pub(crate) use procrustes::PoseProcrustes;
pub(crate) use resample::PoseResample;

use nalgebra::Vector3;
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{NodeError, Problem};
use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use serde::Deserialize;

use crate::algo::pins::Pinned;

/// One pin.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pin {
    frames: [i64; 2],
    #[serde(default)]
    joint: Option<String>,
    #[serde(default)]
    vertex: Option<usize>,
    #[serde(default)]
    at: Option<[f64; 3]>,
}

/// Several pins of joints or vertices.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pins(Vec<Pin>);

impl Setting for Pins {
    fn type_name() -> String {
        "list of pins (frames: (first, last), joint: \"name\" or vertex: n, at: (x, y, z))".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        // A name or a place is written as it is, without `Some`.
        let found: Result<Vec<Pin>, _> = parse_slice(text, Extensions::IMPLICIT_SOME);
        found.map(Self).map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
    fn numbers(&self) -> Vec<f64> {
        self.0.iter().filter_map(|p| p.at).flatten().collect()
    }
}

impl Pins {
    fn problems(&self) -> Vec<Problem> {
        let wrong = |p: &&Pin| p.frames[1] < p.frames[0] || p.joint.is_some() == p.vertex.is_some();
        let message = |p: &Pin| {
            let [first, last] = p.frames;
            format!("expected frames in order and either a joint or a vertex, found frames ({first}, {last})")
        };
        self.0.iter().filter(wrong).map(|p| Problem { input: "pins", message: message(p) }).collect()
    }

    /// Each pin on the path that its point has.
    fn pinned(&self, clock: &Clock, mut path: impl FnMut(&Pin) -> Result<Vec<Vector3<f64>>, NodeError>) -> Result<Vec<Pinned>, NodeError> {
        let at = |frame: i64| {
            let message = || format!("pins: expected frames of the motion, {} to {}, found {frame}", clock.first, clock.last);
            clock.index(frame).ok_or_else(|| NodeError::input(message()))
        };
        let one = |pin: &Pin| {
            Ok(Pinned { first: at(pin.frames[0])?, last: at(pin.frames[1])?, path: path(pin)?, target: pin.at.map(Vector3::from) })
        };
        self.0.iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests;
