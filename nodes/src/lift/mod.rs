//! Hand animation in three dimensions.

mod limbs;
mod linear;
mod sizes;

pub(crate) use limbs::{Chains, Limbs};
pub(crate) use linear::LiftLinear;
pub(crate) use sizes::Sizes;

use nalgebra::Vector3;
use pegbar_engine::node::NodeError;

use crate::algo::lift::{Framing, Stand};
use crate::data::Markers3;
use limbs::position;

/// Where a figure stands.
pub(crate) fn framed(markers: &Markers3, framing: Framing, root: &str, hips: &[String]) -> Result<Stand, NodeError> {
    let points: Vec<Vector3<f64>> = markers.points.iter().copied().map(Vector3::from).collect();
    let at = |name: &str| position(&markers.names, name, "root and hips");
    let [root, left, right] = match (framing, hips) {
        (Framing::World, _) => [0; 3],
        (Framing::Root, _) => [at(root)?; 3],
        (Framing::Heading, [left, right]) => [at(root)?, at(left)?, at(right)?],
        (Framing::Heading, _) => return Err(NodeError::input(format!("hips: expected two markers, left and right, found {}", hips.len()))),
    };
    let known = points.is_empty().then_some(Vector3::zeros());
    let points = if points.is_empty() { known.into_iter().collect() } else { points };
    Stand::new(framing, &points, root, [left, right])
        .ok_or_else(|| NodeError::input("expected finite root and hips, found a marker that is not known"))
}
