//! The contract between nodes and executor, and how each kind of node lowers to it.

use std::marker::PhantomData;

use super::context::{Context, Problem};
use super::error::NodeError;
use super::input::Arg;
use super::output::{OutValue, Outputs};
use super::{PerFrame, Recurrent, Whole};
use crate::value::{ValueRef, ValueType, downcast};
use std::sync::Arc;

/// What one task gives: the ports' values, and the state for the next frame.
pub struct Computed {
    /// In the order of the ports.
    pub outputs: Vec<OutValue>,
    /// For [`Recurrent`] nodes.
    pub state: Option<ValueRef>,
}

/// The two-step contract, and all that the executor knows of a node: which frames it needs, then the frame itself.
pub trait Operator: Send + Sync {
    /// For each input in `inputs`, the frames that `cx.frame` is made from; and the frame whose state it starts from.
    ///
    /// # Errors
    /// Where the settings do not make a node.
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError>;

    /// Makes one frame, or everything.
    ///
    /// # Errors
    /// Whatever keeps it from doing so.
    fn compute(&self, args: Vec<Arg>, state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError>;

    /// Settings that do not go together.
    ///
    /// # Errors
    /// Where the settings do not make a node.
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError>;

    /// The type of its state, for a node that has one.
    fn state_type(&self) -> Option<ValueType> {
        None
    }

    /// For a plugin's recurrent node, whether it is asked which state a frame starts from, and what its code says then, asked or not.
    #[doc(hidden)]
    fn asked_previous(&self, _args: Vec<Arg>, _cx: &Context) -> Option<(bool, Result<Option<i64>, NodeError>)> {
        None
    }

    /// The plugin that it comes from; `None` for what Pegbar comes with.
    fn plugin(&self) -> Option<&PluginId> {
        None
    }

    /// True where the settings by themselves make the output differ from frame to frame.
    ///
    /// # Errors
    /// Where the settings do not make a node.
    fn is_per_frame(&self, _args: Vec<Arg>) -> Result<bool, NodeError> {
        Ok(false)
    }
}

/// A plugin, as keys and locks name it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PluginId {
    /// Its name, which the ids of its nodes begin with.
    pub name: String,
    /// Its version, as `1.2.0`.
    pub version: String,
    /// Digest of its library, in hexadecimal.
    pub digest: String,
}

/// The first step's answer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Needs {
    /// Frames of each input asked about.
    pub frames: Vec<Vec<i64>>,
    /// Frame of the state.
    pub previous: Option<i64>,
}

pub(crate) struct PerFrameOperator<N>(pub(crate) PhantomData<fn() -> N>);
pub(crate) struct RecurrentOperator<N>(pub(crate) PhantomData<fn() -> N>);
pub(crate) struct WholeOperator<N>(pub(crate) PhantomData<fn() -> N>);

impl<N: PerFrame> Operator for PerFrameOperator<N> {
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        let node = N::build(args)?;
        Ok(Needs { frames: inputs.iter().map(|i| node.reads(i, cx)).collect(), previous: None })
    }
    fn compute(&self, args: Vec<Arg>, _state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        Ok(Computed { outputs: N::build(args)?.run(cx)?.into_values(), state: None })
    }
    fn is_per_frame(&self, args: Vec<Arg>) -> Result<bool, NodeError> {
        Ok(N::build(args)?.is_per_frame())
    }
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(N::build(args)?.check())
    }
}

impl<N: Recurrent> Operator for RecurrentOperator<N> {
    fn state_type(&self) -> Option<ValueType> {
        Some(ValueType::of::<N::State>())
    }
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        let node = N::build(args)?;
        Ok(Needs { frames: inputs.iter().map(|i| node.reads(i, cx)).collect(), previous: node.previous(cx) })
    }
    fn compute(&self, args: Vec<Arg>, state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        let state = state.map(|s| downcast::<N::State>(s).ok_or_else(|| NodeError::internal("a state of another type")));
        let (outputs, state) = N::build(args)?.run(state.transpose()?.as_deref(), cx)?;
        Ok(Computed { outputs: outputs.into_values(), state: Some(Arc::new(state)) })
    }
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(N::build(args)?.check())
    }
}

impl<N: Whole> Operator for WholeOperator<N> {
    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        let node = N::build(args)?;
        Ok(Needs { frames: inputs.iter().map(|i| node.reads(i, cx)).collect(), previous: None })
    }
    fn compute(&self, args: Vec<Arg>, _state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        Ok(Computed { outputs: N::build(args)?.run(cx)?.into_values(), state: None })
    }
    fn check(&self, args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(N::build(args)?.check())
    }
}
