//! Pictures made from nothing: constants, checkerboards and gradients.
