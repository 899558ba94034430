//! Goldens: what a graph gave when it was right, how near it has to stay and why, and where along the graph it left that.
//!
//! `hat.golden.ron` beside `hat.ron` says what is compared ([`GoldenFile`]). The folder `hat.golden` holds what it gave, a [`Store`] a case: summaries of
//! its outputs for people to read, and brief ones of every node before them. Where an output differs, [`first`] walks up the graph to the first
//! node that left its own reference.

mod compare;
mod file;
mod observe;
mod reference;
mod summary;

pub use compare::{Difference, Invariant, Metric, Tolerance, Tolerances, compare};
pub use file::{Case, GoldenFile, ONLY_CASE, golden_of, is_golden};
pub use observe::{
    Change, Compared, Departure, Look, Seen, Where, compared, first, observe, observe_nodes, same_bits, upstream, waits_for_values,
    where_to_look,
};
pub use reference::{NodeReference, NodeReferences, Reference, Store, differences, from_text, nodes_from_text, nodes_to_text, to_text};
pub use summary::{Digest, Kept, STATISTICS, Summary};

/// The codes of what a golden finds.
pub mod code {
    /// A value left its reference.
    pub const LEFT: &str = "PB0600";
    /// There is no reference to hold a value against.
    pub const NO_REFERENCE: &str = "PB0601";
    /// An invariant does not hold.
    pub const INVARIANT: &str = "PB0602";
    /// A golden that does not fit its graph.
    pub const UNFIT: &str = "PB0603";
}
