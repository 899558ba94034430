//! The registry: which node types and value types there are.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use crate::node::{Node, NodeSchema, Operator, PerFrame, PerFrameOperator, PluginId, Recurrent, RecurrentOperator, Whole, WholeOperator};
use crate::plugin::Isolation;
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
    /// Node types out of plugins: one for each version of the plugin.
    versions: BTreeMap<&'static str, Vec<NodeType>>,
    types: Types,
    is_closed: bool,
    isolation: Isolation,
}

impl Registry {
    /// A registry of the engine's own value types.
    pub fn new() -> Self {
        Self::default().value::<Curve>().value::<TimeMap>().value::<Vector>()
    }

    /// The registry where no code of plugins runs: their nodes are known by their manifests alone.
    #[must_use]
    pub fn without_code(mut self) -> Self {
        self.is_closed = true;
        self
    }

    /// The registry whose plugins, those that are added from here on, run there.
    #[must_use]
    pub fn with_isolation(mut self, isolation: Isolation) -> Self {
        self.isolation = isolation;
        self
    }

    /// Has plugins of these names, those that are added from here on, run in this process.
    pub fn trust(&mut self, names: impl IntoIterator<Item = String>) {
        if let Some(mut workers) = self.isolation.workers() {
            workers.trusted.extend(names);
            self.isolation = Isolation::Workers(Box::new(workers));
        }
    }

    /// Where its plugins run.
    pub fn isolation(&self) -> &Isolation {
        &self.isolation
    }

    /// The registry whose plugins run in this process, whatever was said before: for whoever has them do so in one apart.
    #[must_use]
    pub(crate) fn with_code_here(mut self) -> Self {
        self.is_closed = false;
        self.with_isolation(Isolation::Off)
    }

    /// True where code of plugins may run.
    pub fn runs_code(&self) -> bool {
        !self.is_closed
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

    /// The node type `id`; of a plugin `id@1.2` for the one whose version that is or begins with. None where an id alone could mean several versions.
    pub fn get(&self, id: &str) -> Option<&NodeType> {
        self.nodes.get(id).or_else(|| self.version(id))
    }

    fn version(&self, id: &str) -> Option<&NodeType> {
        let (id, wanted) = id.split_once('@').map_or((id, None), |(id, version)| (id, Some(version)));
        let is_wanted = |node: &&NodeType| {
            let version = node.operator.plugin().map_or("", |p| p.version.as_str());
            wanted.is_none_or(|w| version.strip_prefix(w).is_some_and(|rest| rest.is_empty() || rest.starts_with('.')))
        };
        let mut fitting = self.versions.get(id)?.iter().filter(is_wanted);
        fitting.next().filter(|_| fitting.next().is_none())
    }

    /// The versions of the plugin in which there is the node type `id`, ascending.
    pub fn versions(&self, id: &str) -> Vec<&str> {
        let id = id.split_once('@').map_or(id, |(id, _)| id);
        let all = self.versions.get(id).into_iter().flatten().filter_map(|n| n.operator.plugin());
        all.map(|p| p.version.as_str()).collect()
    }

    /// Every plugin, once for each of its node types.
    pub fn plugins(&self) -> impl Iterator<Item = &PluginId> {
        self.versions.values().flatten().filter_map(|n| n.operator.plugin())
    }

    pub(crate) fn insert_type(&mut self, ty: ValueType) {
        Arc::make_mut(&mut self.types.0).insert(ty.schema.name, ty);
    }

    pub(crate) fn insert_plugin_node(&mut self, node: NodeType) {
        let numbers = |node: &NodeType| -> Vec<u64> {
            node.operator.plugin().into_iter().flat_map(|p| p.version.split('.')).filter_map(|n| n.parse().ok()).collect()
        };
        let versions = self.versions.entry(node.schema.id).or_default();
        versions.push(node);
        versions.sort_by_key(numbers);
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
        let mut all: Vec<&NodeType> = self.nodes.values().chain(self.versions.values().flatten()).collect();
        // Stable, so that versions stay in order.
        all.sort_by_key(|node| node.schema.id);
        all.into_iter()
    }

    /// Every value type, by name.
    pub fn types(&self) -> impl Iterator<Item = &ValueType> {
        self.types.0.values()
    }
}
