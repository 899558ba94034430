//! Pegbar as a library: the node registry of the command line, and its parts.
