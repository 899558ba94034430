//! The engine with nodes of numbers: small enough that every result is known in closed form.

mod budget;
mod bundle;
mod cached;
mod check;
mod check_nodes;
mod keys;
mod layers;
pub(crate) mod nodes;
mod random;
mod run;
mod why;
