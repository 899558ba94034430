//! Anchors: places of a mesh and of a drawing that belong together.

use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use serde::Deserialize;

/// One anchor as it is written.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Anchor {
    /// A pixel of the render: the nearest point of a line that is seen.
    #[serde(default)]
    pub(crate) render: Option<[f64; 2]>,
    /// A vertex of the mesh.
    #[serde(default)]
    pub(crate) vertex: Option<u32>,
    /// A pixel of the drawing.
    pub(crate) drawn: [f64; 2],
}

/// Several anchors, in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Anchors(pub(crate) Vec<Anchor>);

impl Setting for Anchors {
    fn type_name() -> String {
        "list of anchors (render: (x, y) or vertex: n, drawn: (x, y))".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        // A place or a number is written as it is, without `Some`.
        let found: Result<Vec<Anchor>, _> = parse_slice(text, Extensions::IMPLICIT_SOME);
        found.map(Self).map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
    fn numbers(&self) -> Vec<f64> {
        self.0.iter().flat_map(|a| a.render.into_iter().flatten().chain(a.drawn)).collect()
    }
}

impl Anchors {
    /// What is wrong with them.
    pub(crate) fn problems(&self) -> Vec<String> {
        let message = |(i, a): (usize, &Anchor)| {
            (a.render.is_some() == a.vertex.is_some()).then(|| format!("anchor {}: expected either `render` or `vertex`", i + 1))
        };
        self.0.iter().enumerate().filter_map(message).collect()
    }
}
