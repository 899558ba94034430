//! The fields of an outputs struct.

use std::sync::Arc;

use super::schema::OutputSchema;
use crate::value::{Value, ValueRef};

/// What one output port gives.
#[derive(Debug)]
pub enum OutValue {
    /// One value: at this frame, or for the whole graph.
    One(ValueRef),
    /// One value for each frame of the node's clock.
    Stream(Vec<ValueRef>),
}

/// A field of an outputs struct.
pub trait Output {
    /// Value type; `None` for any.
    const TYPE: Option<&'static str>;
    /// One value a frame out of a node that runs once.
    const STREAM: bool = false;
    /// The value on its way out.
    fn into_out(self) -> OutValue;
}

impl<T: Value> Output for T {
    const TYPE: Option<&'static str> = Some(T::NAME);
    fn into_out(self) -> OutValue {
        OutValue::One(Arc::new(self))
    }
}

impl<T: Value> Output for Arc<T> {
    const TYPE: Option<&'static str> = Some(T::NAME);
    fn into_out(self) -> OutValue {
        OutValue::One(self)
    }
}

impl Output for ValueRef {
    const TYPE: Option<&'static str> = None;
    fn into_out(self) -> OutValue {
        OutValue::One(self)
    }
}

/// One value for each frame of the node's clock, out of a node that runs once.
#[derive(Debug)]
pub struct Stream<T>(
    /// In order of frames.
    pub Vec<T>,
);

impl<T: Value> Output for Stream<T> {
    const TYPE: Option<&'static str> = Some(T::NAME);
    const STREAM: bool = true;
    fn into_out(self) -> OutValue {
        OutValue::Stream(self.0.into_iter().map(|v| Arc::new(v) as ValueRef).collect())
    }
}

/// As [`Stream`], of the type that the node's input has.
#[derive(Debug)]
pub struct AnyStream(
    /// In order of frames.
    pub Vec<ValueRef>,
);

impl Output for AnyStream {
    const TYPE: Option<&'static str> = None;
    const STREAM: bool = true;
    fn into_out(self) -> OutValue {
        OutValue::Stream(self.0)
    }
}

/// The outputs of a node: `#[derive(Outputs)]` on a struct of [`Output`] fields.
pub trait Outputs {
    /// What it says of its ports.
    fn schema() -> Vec<OutputSchema>;
    /// Its values, in the order of the ports.
    fn into_values(self) -> Vec<OutValue>;
}

impl Outputs for () {
    fn schema() -> Vec<OutputSchema> {
        Vec::new()
    }
    fn into_values(self) -> Vec<OutValue> {
        Vec::new()
    }
}
