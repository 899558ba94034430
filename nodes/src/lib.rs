//! The animation nodes of Pegbar: data types at the bottom, `algo` above them (pure functions), one file a node on top.

pub mod algo;
mod basis;
mod camera;
mod capture;
mod cel;
mod comp;
#[cfg(test)]
mod counted;
mod curve;
pub mod data;
mod drawing;
mod eval;
mod field;
#[cfg(test)]
mod footage_tests;
mod image;
mod io;
mod keys;
mod lift;
mod markers;
mod matte;
mod mesh;
mod motion;
mod plot;
mod pose;
mod registry;
mod render;
mod retarget;
mod shape;
mod skin;
mod solve;
mod style;
mod time;
mod track;
mod warp;
mod weights;

pub use registry::registry;
