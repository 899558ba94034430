//! The engine with nodes of numbers: small enough that every result is known in closed form.

pub(crate) mod nodes;
mod run;
