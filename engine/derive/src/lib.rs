//! Derive macros for the node and value types of `pegbar-engine`.
