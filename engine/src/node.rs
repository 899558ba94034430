//! Nodes: what a node's author writes, what it tells of itself, and the two-step contract that the executor knows.

mod context;
mod error;
mod input;
mod meter;
mod operator;
mod output;
mod schema;

pub use context::{Cancel, Context, Problem};
pub use error::{Fault, NodeError};
pub use input::{AnyFrames, AnySequence, Arg, Frames, In, Input, List, Literal, Picked, Sequence, SequenceRef, Values};
pub use meter::Meter;
pub use operator::{Computed, Needs, Operator, PluginId};
pub(crate) use operator::{PerFrameOperator, RecurrentOperator, WholeOperator};
pub use output::{AnyStream, OutValue, Output, Outputs, Stream};
pub use schema::{Access, Beside, InputSchema, InputType, Kind, NodeSchema, OutputSchema, ParseLiteral};

use crate::value::Value;

/// What `#[derive(Node)]` makes of a struct of inputs and settings.
pub trait Node: Sized + Send + 'static {
    /// Its outputs.
    type Outputs: Outputs;
    /// What it says of itself.
    fn schema() -> NodeSchema;
    /// The struct, from what stands at each input, in the order of the schema.
    ///
    /// # Errors
    /// Where something of another type stands there.
    fn build(args: Vec<Arg>) -> Result<Self, NodeError>;
}

/// A node that makes any frame by itself.
pub trait PerFrame: Node {
    /// Makes one frame.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn run(self, cx: &Context) -> Result<Self::Outputs, NodeError>;

    /// True where the settings by themselves make the output differ from frame to frame: a file that holds a stream. Asked of sources alone, when a
    /// graph is checked; only settings may be looked at.
    fn is_per_frame(&self) -> bool {
        false
    }

    /// The frames of a [`Frames`] input that the frame of `cx` is made from. Only settings and constants may be looked at.
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![cx.frame]
    }

    /// Settings that do not go together.
    fn check(&self) -> Vec<Problem> {
        Vec::new()
    }
}

/// A node that hands a state from frame to frame.
pub trait Recurrent: Node {
    /// What it remembers.
    type State: Value;

    /// Makes one frame from the state of the frame before, `None` at the start of the chain.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn run(self, state: Option<&Self::State>, cx: &Context) -> Result<(Self::Outputs, Self::State), NodeError>;

    /// The frame whose state this one starts from: one nearer to where the chain starts; `None` there.
    fn previous(&self, cx: &Context) -> Option<i64> {
        (cx.frame > cx.clock.first).then(|| cx.frame - 1)
    }

    /// As [`PerFrame::reads`].
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![cx.frame]
    }

    /// Settings that do not go together.
    fn check(&self) -> Vec<Problem> {
        Vec::new()
    }
}

/// A node that runs once, over whole sequences.
pub trait Whole: Node {
    /// Makes everything.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn run(self, cx: &Context) -> Result<Self::Outputs, NodeError>;

    /// The frames of a [`Frames`] or [`Picked`] input that are read; a [`Sequence`] is read whole. Only settings and constants may be looked at.
    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        vec![cx.frame]
    }

    /// Settings that do not go together.
    fn check(&self) -> Vec<Problem> {
        Vec::new()
    }
}
