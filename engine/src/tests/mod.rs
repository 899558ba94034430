//! The engine with nodes of numbers: small enough that every result is known in closed form.

mod nodes;
mod run;
