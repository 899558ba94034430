//! The registry: which node types and value types there are.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use crate::node::{Node, NodeSchema, Operator, PerFrame, PerFrameOperator, Recurrent, RecurrentOperator, Whole, WholeOperator};
use crate::value::{Curve, TimeMap, Value, ValueType, Vector};

/// A node type as the registry keeps it.
#[derive(Clone)]
pub struct NodeType {
    /// What it says of itself.
    pub schema: Arc<NodeSchema>,
    /// What it does.
    pub operator: Arc<dyn Operator>,
}

/// Value types by name, shared.
#[derive(Clone, Default)]
pub struct Types(Arc<BTreeMap<&'static str, ValueType>>);

impl Types {
    /// The value type `name`.
    pub fn get(&self, name: &str) -> Option<&ValueType> {
        self.0.get(name)
    }
}

impl fmt::Debug for Types {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.0.keys()).finish()
    }
}

/// Node types and value types by name.
#[derive(Clone, Default)]
pub struct Registry {
    nodes: BTreeMap<&'static str, NodeType>,
    types: Types,
}

impl Registry {
    /// A registry of the engine's own value types.
    pub fn new() -> Self {
        Self::default().value::<Curve>().value::<TimeMap>().value::<Vector>()
    }

    /// With a value type.
    #[must_use]
    pub fn value<T: Value>(mut self) -> Self {
        Arc::make_mut(&mut self.types.0).insert(T::NAME, ValueType::of::<T>());
        self
    }

    /// With a node that makes any frame by itself.
    #[must_use]
    pub fn per_frame<N: PerFrame>(self) -> Self {
        self.node::<N>(Arc::new(PerFrameOperator::<N>(PhantomData)))
    }

    /// With a node that hands a state from frame to frame.
    #[must_use]
    pub fn recurrent<N: Recurrent>(self) -> Self {
        self.node::<N>(Arc::new(RecurrentOperator::<N>(PhantomData)))
    }

    /// With a node that runs once.
    #[must_use]
    pub fn whole<N: Whole>(self) -> Self {
        self.node::<N>(Arc::new(WholeOperator::<N>(PhantomData)))
    }

    fn node<N: Node>(mut self, operator: Arc<dyn Operator>) -> Self {
        let schema = Arc::new(N::schema());
        self.nodes.insert(schema.id, NodeType { schema, operator });
        self
    }

    /// The node type `id`.
    pub fn get(&self, id: &str) -> Option<&NodeType> {
        self.nodes.get(id)
    }

    /// The value type `name`.
    pub fn get_type(&self, name: &str) -> Option<&ValueType> {
        self.types.get(name)
    }

    /// All value types, to be handed on.
    pub fn shared_types(&self) -> &Types {
        &self.types
    }

    /// Every node type, by id.
    pub fn nodes(&self) -> impl Iterator<Item = &NodeType> {
        self.nodes.values()
    }

    /// Every value type, by name.
    pub fn types(&self) -> impl Iterator<Item = &ValueType> {
        self.types.0.values()
    }
}
