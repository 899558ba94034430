//! Nodes that stand for what the nodes of numbers have no use for: files, words, optional settings and inputs, types that a setting names.

use std::sync::Arc;

use crate::node::{Context, In, NodeError, PerFrame, Problem};
use crate::registry::Registry;
use crate::setting::{InputPath, Missing, OutputPath};
use crate::value::{Curve, ValueRef};
use crate::{Node, Setting};

use super::nodes::{Number, Same};

/// Reads the length of a file.
#[derive(Node)]
#[node(id = "test.read", version = 1, kind = source, outputs = Number)]
pub(super) struct Read {
    /// The file.
    path: InputPath,
    /// What stands for a frame that is not there.
    #[input(default = "error")]
    missing: Missing,
}

impl PerFrame for Read {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        let path = self.path.resolve(cx.frame, self.missing).ok_or_else(|| NodeError::input("no file"))?;
        let value = std::fs::metadata(&path).map_err(|e| NodeError::io(&path, e))?.len() as f64;
        Ok(Number { value: Curve { value } })
    }
}

/// Writes a number.
#[derive(Node)]
#[node(id = "test.write", version = 1, kind = sink)]
pub(super) struct Write {
    /// The number.
    value: In<Curve>,
    /// The file.
    path: OutputPath,
}

impl PerFrame for Write {
    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let path = self.path.at(cx.frame);
        std::fs::write(&path, self.value.value.to_string()).map_err(|e| NodeError::io(&path, e))
    }
}

/// How to go between two numbers.
#[derive(Clone, Copy, Debug, Setting)]
pub(super) enum Mode {
    /// Straight.
    Linear,
    /// Through a cubic.
    CatmullRom,
}

/// A number between two others.
#[derive(Node)]
#[node(id = "test.blend", version = 1, outputs = Number)]
pub(super) struct Blend {
    /// How.
    mode: Mode,
    /// The least number.
    #[input(default = 0.0)]
    least: f64,
    /// The greatest number, at least the least.
    #[input(default = 1.0)]
    greatest: f64,
    /// A limit.
    limit: Option<f64>,
    /// Knots.
    #[input(default = [])]
    knots: Vec<[f64; 2]>,
    /// A text.
    #[input(default = "plain")]
    label: String,
    /// What is added, if anything.
    more: Option<In<Curve>>,
}

impl PerFrame for Blend {
    fn run(self, _cx: &Context) -> Result<Number, NodeError> {
        let scale = match self.mode {
            Mode::Linear => 1.0,
            Mode::CatmullRom => 2.0,
        };
        let knots: f64 = self.knots.iter().flatten().sum();
        let more = self.more.map_or(0.0, |m| m.value);
        let value = scale * (self.least + self.greatest) + self.limit.unwrap_or(0.0) + knots + more + self.label.len() as f64;
        Ok(Number { value: Curve { value } })
    }
    fn check(&self) -> Vec<Problem> {
        let message = format!("expected `greatest` of at least `least`, {}, found {}", self.least, self.greatest);
        if self.greatest < self.least { vec![Problem { input: "greatest", message }] } else { Vec::new() }
    }
}

/// A value of a type that a setting names.
#[derive(Node)]
#[node(id = "test.load", version = 1, kind = source, outputs = Same, type_from = "of")]
pub(super) struct Load {
    /// The type.
    #[allow(dead_code, reason = "read by the checker")]
    of: String,
}

impl PerFrame for Load {
    fn run(self, _cx: &Context) -> Result<Same, NodeError> {
        let value: ValueRef = Arc::new(Curve { value: 0.0 });
        Ok(Same { value })
    }
}

/// A number that nobody may change over time.
#[derive(Node)]
#[node(id = "test.fixed", version = 1, outputs = Number)]
pub(super) struct Fixed {
    /// The number.
    #[input(constant)]
    value: In<Curve>,
}

impl PerFrame for Fixed {
    fn run(self, _cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { value: Curve { value: self.value.value } })
    }
}

/// The nodes of numbers and these.
pub(super) fn registry() -> Registry {
    super::nodes::registry().per_frame::<Read>().per_frame::<Write>().per_frame::<Blend>().per_frame::<Load>().per_frame::<Fixed>()
}
