//! Pegbar's executor, its very sources, on a model checker's primitives: every lock, atomic and queue that two threads share is a point where the
//! checker may let another thread go on. A run is repeated under thousands of such orders, by fixed seeds; what hangs, it reports.
#![cfg(test)]
#![allow(clippy::duplicate_mod, reason = "the gate and the crew are seen by themselves too, without a run around them")]

mod sync;

/// What is checked, and what of the engine knows its types.
#[path = "../../src"]
#[allow(dead_code, unreachable_pub, unused_imports)]
mod engine {
    pub(crate) mod exec;
    pub(crate) mod key;
    pub(crate) mod plan;
}
pub(crate) use engine::{exec, key, plan};
pub(crate) use pegbar_engine::{array, cache, clock, graph, node, registry, setting, stamp, syntax, value};

mod orders;
mod parts;
mod runs;
