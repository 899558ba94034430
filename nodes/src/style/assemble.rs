//! `style.assemble`: an animated mesh that passes through its drawings.
//!
//! **Method** the field of each example is added to the mesh by a curve that is 1 at the example's frame and 0 outside of its range, level at all three
//! ([`crate::algo::motion_warp`]). Where ranges overlap fields are added up, or shared out so that each drawing is met at its frame. Frames outside of all
//! ranges stay as they are, to the bit. Normals turn as the surface does.
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, section 3.7.
//!
//! **Fails when** there is not one example for each field, a field is of another mesh, or overlapping examples cannot all be met.
//!
//! **Cost** O(vertices · examples) a frame; frames run in parallel.
//!
//! ```ron
//! "styled": (type: "style.assemble", mesh: "@posed", fields: ["@left", "@right"], examples: [(frame: 12), (frame: 20, before: 4, after: 8)]),
//! ```

use pegbar_engine::node::{Context, Fault, In, List, NodeError, PerFrame, Problem};
use pegbar_engine::setting::{Setting as SettingTrait, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use pegbar_engine::value::Vector;
use pegbar_engine::{Node, Outputs, Setting};
use serde::Deserialize;

use crate::algo::field::{displaced, turned_normals};
use crate::algo::motion_warp::{Span, Spans};
use crate::data::{Field3, Mesh};
use crate::field::expect_vertices;

/// One example as it is written.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Example {
    frame: f64,
    #[serde(default)]
    before: Option<f64>,
    #[serde(default)]
    after: Option<f64>,
}

/// Several examples.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Examples(Vec<Example>);

impl SettingTrait for Examples {
    fn type_name() -> String {
        "list of examples (frame: n, before: n, after: n)".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        // A range is written as it is, without `Some`.
        let found: Result<Vec<Example>, _> = parse_slice(text, Extensions::IMPLICIT_SOME);
        found.map(Self).map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
    fn numbers(&self) -> Vec<f64> {
        self.0.iter().map(|e| e.frame).collect()
    }
}

/// What becomes of examples whose ranges overlap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Overlap {
    /// They are shared out so that each is met at its frame.
    Meet,
    /// They are added up, as the paper does.
    Add,
}

/// What becomes of normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Normals {
    /// They turn as the surface around them does.
    Turn,
    /// They stay as they were: light sees the shape without its drawings.
    Keep,
}

/// An animated mesh that passes through its drawings.
#[derive(Node)]
#[node(
    id = "style.assemble",
    version = 1,
    outputs = StyleAssembleOutputs,
    uses_frame,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.7",
    example = "\"styled\": (type: \"style.assemble\", mesh: \"@posed\", fields: [\"@left\", \"@right\"], examples: [(frame: 12), (frame: 20, before: 4, after: 8)])"
)]
pub(crate) struct StyleAssemble {
    /// The mesh in its motion, as edited for the examples.
    mesh: In<Mesh>,
    /// How far each vertex is moved for each example, along the motion.
    fields: List<In<Field3>>,
    /// The `frame` of each field's example, and over how many frames `before` and `after` it that comes and goes (`inf`: all along).
    examples: Examples,
    /// Frames before and after an example where it does not say.
    #[input(default = 6.0, range = 0.0..=1000000.0, unit = "frames")]
    transition: f64,
    /// What becomes of examples whose ranges overlap.
    #[input(default = meet)]
    overlap: Overlap,
    /// How much of all of them: 0 is the mesh as it came, 1 is what was drawn, more exaggerates it.
    #[input(default = 1.0, range = -100.0..=100.0)]
    amount: f64,
    /// What becomes of normals.
    #[input(default = turn)]
    normals: Normals,
    /// How much of each example there is to be elsewhere too, in the fields' order, as `style.find` says.
    elsewhere: Option<In<Vector>>,
}

/// The mesh, and how it came about.
#[derive(Outputs)]
pub(crate) struct StyleAssembleOutputs {
    /// Metres, Y up.
    mesh: Mesh,
    /// How much of each example there is: 1 at its own frame.
    amounts: Vector,
}

fn refused(message: String) -> NodeError {
    NodeError::new(Fault::Parameters, message)
}

impl StyleAssemble {
    fn spans(&self) -> Result<Spans, String> {
        let own = |v: Option<f64>| v.unwrap_or(self.transition);
        let spans = self.examples.0.iter().map(|e| Span { frame: e.frame, before: own(e.before), after: own(e.after) });
        Spans::new(spans.collect(), self.overlap == Overlap::Meet).map_err(|e| e.to_string())
    }
}

impl PerFrame for StyleAssemble {
    fn check(&self) -> Vec<Problem> {
        self.spans().err().map(|message| Problem { input: "examples", message }).into_iter().collect()
    }

    fn run(self, cx: &Context) -> Result<StyleAssembleOutputs, NodeError> {
        let (fields, examples) = (self.fields.0.len(), self.examples.0.len());
        if fields != examples {
            return Err(refused(format!("examples: expected one for each of {fields} fields, found {examples}")));
        }
        let spans = self.spans().map_err(|e| refused(format!("examples: {e}")))?;
        let elsewhere = self.elsewhere.as_ref().map_or(&[][..], |e| &e.values);
        if self.elsewhere.is_some() && (elsewhere.len() != fields || elsewhere.iter().any(|v| !v.is_finite())) {
            return Err(NodeError::input(format!("elsewhere: expected a finite number for each of {fields} fields, found {elsewhere:?}")));
        }
        let mut values = spans.amounts_with(cx.frame as f64, elsewhere);
        values.iter_mut().for_each(|v| *v *= self.amount);
        let mesh = &*self.mesh;
        for field in &self.fields.0 {
            expect_vertices(field.vectors.len(), mesh.positions.len())?;
        }
        let parts: Vec<_> = values.iter().zip(&self.fields.0).map(|(v, f)| (*v, &f.vectors[..])).collect();
        let positions = displaced(&mesh.positions, &parts);
        if let Some(v) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(NodeError::input(format!("vertex {v}: expected finite fields and positions, found {:?}", positions[v])));
        }
        mesh.validate().map_err(|e| NodeError::input(format!("mesh: {e}")))?;
        let normals = match self.normals {
            Normals::Turn if !mesh.normals.is_empty() && positions != mesh.positions => {
                turned_normals(&mesh.normals, &mesh.positions, &positions, &mesh.triangles)
            }
            _ => mesh.normals.clone(),
        };
        Ok(StyleAssembleOutputs { mesh: mesh.moved(positions, normals), amounts: Vector { values } })
    }
}
