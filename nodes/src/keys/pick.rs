//! `keys.pick`: drawings of a sequence as its keys.
//!
//! **Method** the contours of the named frames, each moved onto the first as far as `align` can ([`crate::algo::fit_affine`]); no others
//! are made.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 1.4 (key-shapes that the user picks from the source) and 3.2.2
//! (affine-aligned).
//!
//! **Fails when** the contours have other numbers of points.
//!
//! **Cost** O(points of the keys).
//!
//! ```ron
//! "keys": (type: "keys.pick", shape: "@points", frames: [1, 5, 9]),
//! ```

use pegbar_engine::node::{Context, Frames, NodeError, Whole};
use pegbar_engine::{Node, Outputs, Setting};

use super::{alike, named};
use crate::algo::fit_affine::aligned;
use crate::algo::track_affine::Model;
use crate::data::{KeyShapes, Shape};

/// How keys are moved onto the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Align {
    /// Not at all.
    None,
    /// Shifted.
    Translation,
    /// Turned and shifted: their sizes and squashes stay the keys'.
    Rigid,
    /// Scaled as well.
    Similarity,
    /// By all that an affine motion can do.
    Affine,
}

/// Drawings of a sequence as its keys.
#[derive(Node)]
#[node(
    id = "keys.pick",
    version = 1,
    kind = whole,
    outputs = KeysPickOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 1.4",
    example = "\"keys\": (type: \"keys.pick\", shape: \"@points\", frames: [1, 5, 9])"
)]
pub(crate) struct KeysPick {
    /// The contours: as many points in one order at each picked frame.
    shape: Frames<Shape>,
    /// The frames, in the order of the keys. The first alone where none are named.
    #[input(default = [])]
    frames: Vec<i64>,
    /// How keys are moved onto the first, so that what motion does is left to the motion. No more than the capture's `affine_model` can
    /// give back.
    #[input(default = rigid)]
    align: Align,
}

/// The keys.
#[derive(Outputs)]
pub(crate) struct KeysPickOutputs {
    /// Named by their frames.
    keys: KeyShapes,
}

impl Whole for KeysPick {
    fn reads(&self, input: &str, cx: &Context) -> Vec<i64> {
        if self.frames.is_empty() { vec![cx.input_clock(input).first] } else { self.frames.clone() }
    }

    fn run(self, cx: &Context) -> Result<KeysPickOutputs, NodeError> {
        let frames = self.reads("shape", cx);
        let shapes = frames.iter().map(|f| self.shape.at(*f).map(|s| (*f, &**s))).collect::<Result<Vec<_>, _>>()?;
        alike(shapes.iter().copied())?;
        let Some((_, first)) = shapes.first() else { return Err(NodeError::input("expected at least one key, found none")) };
        let model = match self.align {
            Align::None => None,
            Align::Translation => Some(Model::Translation),
            Align::Rigid => Some(Model::Rigid),
            Align::Similarity => Some(Model::Similarity),
            Align::Affine => Some(Model::Affine),
        };
        let mut points = first.points.clone();
        for (_, shape) in &shapes[1..] {
            match model {
                Some(model) if !first.points.is_empty() => points.extend(aligned(&shape.points, &first.points, model)),
                _ => points.extend_from_slice(&shape.points),
            }
        }
        Ok(KeysPickOutputs { keys: named(&frames, &points, first.closed)? })
    }
}
