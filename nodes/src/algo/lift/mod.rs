//! The lift of drawn markers into space. Jain, Sheikh, Hodgins 2009, section 3.5, equations 5 to 16.
//!
//! Every frame minimises e_p + λ1 e_l + λ2 e_r (eq. 5): markers lie where they are drawn (eq. 6), limbs keep their lengths (eq. 8, linearised), and the figure
//! stays near the capture (eq. 9). Limbs tie markers in a tree, so that a frame costs O(markers) ([`tree`]). Beyond the paper: linearised again until
//! lengths are kept, perspective, depth from foreshortening, second differences over time, a soft subspace, and how sure each marker is.

mod linear;
mod stand;
mod subspace;
mod temporal;
#[cfg(test)]
mod tests;
mod tree;
#[cfg(test)]
mod walk_tests;

pub use linear::{Frame, Lift, Lifted};
pub use stand::{Framing, Stand};
pub use subspace::Subspace;
pub use tree::Tree;

use pegbar_engine::Setting;

use crate::algo::smoothness::Smoothing;

/// How the weights of equation 5 enter the rows of equation 11.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Weighting {
    /// By their roots, so that (5) holds as it is written.
    #[default]
    Sqrt,
    /// As they are: squared norms count by their squares.
    Literal,
}

/// How the rows of limbs are scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum LimbRows {
    /// By 1 / 2L: rows are lengths, and λ1 has no unit.
    #[default]
    Scaled,
    /// As equation 8 has them, squared metres.
    Unscaled,
}

/// What a linear space of poses does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum BasisMode {
    /// Poses lie in it (eqs. 13 to 16).
    #[default]
    Hard,
    /// Poses are drawn towards it.
    Soft,
    /// Nothing.
    Off,
}

/// Weights and rounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// λ1, of limb lengths; infinite keeps them exactly.
    pub length_weight: f64,
    /// λ2, of the capture.
    pub prior_weight: f64,
    /// How much the depth counts that a drawn limb's foreshortening tells.
    pub depth_weight: f64,
    /// How much second differences over time count, of what the lift adds to the capture.
    pub smooth_weight: f64,
    /// Second differences that are so many times the usual ones are accents, which are left: contacts, snaps. 0 prices all alike.
    pub accents: f64,
    /// How much a soft subspace counts.
    pub basis_weight: f64,
    /// Roots, or literally.
    pub weighting: Weighting,
    /// Rows of limbs.
    pub rows: LimbRows,
    /// How often lengths and perspective are linearised again, at most.
    pub relinearize: usize,
    /// Share of a drawn limb's change of length that the figure takes: 0 none, 1 all.
    pub stretch: f64,
}

impl Options {
    /// The paper's own: λ1 = 0.001, λ2 = 0.1, rows as they are.
    pub const PAPER: Self = Self {
        length_weight: 0.001,
        prior_weight: 0.1,
        depth_weight: 0.0,
        smooth_weight: 0.0,
        accents: 0.0,
        basis_weight: 0.0,
        weighting: Weighting::Sqrt,
        rows: LimbRows::Unscaled,
        relinearize: 0,
        stretch: 0.0,
    };

    /// The price of second differences.
    fn smoothing(&self) -> Smoothing {
        Smoothing { strength: self.squared(self.smooth_weight), accents: self.accents }
    }

    /// Of a squared norm.
    fn squared(&self, weight: f64) -> f64 {
        if self.weighting == Weighting::Literal { weight * weight } else { weight }
    }
}

/// Why there is no lift.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LiftError {
    /// Lists of different lengths.
    #[error("expected {expected} {what}, found {found}")]
    Count {
        /// Of what.
        what: &'static str,
        /// As many as there should be.
        expected: usize,
        /// As many as there are.
        found: usize,
    },
    /// Capture that is not known.
    #[error("expected finite markers of the capture below 1e6 m, found {found:?} as marker {marker}")]
    Prior {
        /// The marker.
        marker: usize,
        /// Where it is.
        found: [f64; 3],
    },
    /// A limb's length that is none.
    #[error("expected lengths of limbs from 0 to 1e6 m, found {found} for limb {limb}")]
    Length {
        /// The limb.
        limb: usize,
        /// Its length.
        found: f64,
    },
    /// Nothing says where a marker is.
    #[error("expected a place for every marker, found one that neither the drawing nor the capture tells: raise `prior_weight` above 0")]
    Undetermined,
    /// A marker that no camera sees.
    #[error("expected markers in front of the camera, found marker {marker} of the capture beside or behind it")]
    Behind {
        /// The marker.
        marker: usize,
    },
    /// Exact lengths in a hard subspace.
    #[error("expected a finite `length_weight`, and no `smooth_weight`, with a hard basis, found others: a subspace has no room for them")]
    Overdetermined,
}
