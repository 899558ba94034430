//! What is told a plugin and what it answers, whatever way it goes.

use std::any::Any;
use std::sync::{Arc, OnceLock};

use super::settings::SettingData;
use crate::clock::Clock;
use crate::node::{Cancel, Literal, NodeError, SequenceRef};
use crate::value::{OwnedParts, ValueRef};

/// One task as a plugin is told of it.
pub(super) struct Request<'a> {
    /// Position of the node type in the plugin's schema.
    pub(super) node: u32,
    pub(super) settings: &'a Arc<Settings>,
    pub(super) frame: i64,
    pub(super) clock: &'a Clock,
    pub(super) ports: Vec<Port>,
    /// For a recurrent node, the state that it starts from.
    pub(super) state: Option<ValueRef>,
    pub(super) cancel: &'a Cancel,
    /// Names of the arrays that its outputs can have.
    pub(super) names: &'a [&'static str],
}

/// What one reference at an input brings.
pub(super) struct Port {
    pub(super) input: u32,
    pub(super) feed: Feed,
    /// The clock of what is wired here; `None` for one value.
    pub(super) clock: Option<Arc<Clock>>,
}

/// The values of a port.
pub(super) enum Feed {
    Value(ValueRef),
    Frames(Vec<(i64, ValueRef)>),
    Sequence(SequenceRef),
    Number(f64),
}

/// The settings of one node of a graph, which are those of all its tasks.
pub(super) struct Settings {
    /// Input and setting.
    pub(super) items: Vec<(u32, SettingData)>,
    /// What tells them from others: the literals themselves, which are held so that no other comes to lie where they do.
    pub(super) literals: Vec<(usize, Literal)>,
    /// What the transport keeps for them; dropped with them.
    pub(super) kept: OnceLock<Box<dyn Any + Send + Sync>>,
}

/// One value that a plugin made.
pub(super) struct Made {
    /// Position of the output; [`pegbar_abi::PB_STATE`] for the state.
    pub(super) output: u32,
    /// Position in a stream.
    pub(super) index: u64,
    pub(super) what: MadeOf,
}

/// What a made value is made of.
pub(super) enum MadeOf {
    Parts(OwnedParts),
    Passed(ValueRef),
}

/// What a task gave.
#[derive(Default)]
pub(super) struct Response {
    /// Ascending by output and position.
    pub(super) made: Vec<Made>,
    /// From `needs`: input and frame.
    pub(super) needs: Vec<(u32, i64)>,
    /// From `needs`: the frame of the state.
    pub(super) previous: Option<i64>,
}

/// The way of a request to the plugin's code and back.
pub(super) trait Transport: Send + Sync {
    /// Makes the frame, or everything.
    fn compute(&self, request: &Request) -> Result<Response, NodeError>;
    /// Which frames it is made from.
    fn needs(&self, request: &Request) -> Result<Response, NodeError>;
}
