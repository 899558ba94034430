//! Captured motion put on other keys: shapes, drawings, photographs, meshes and articulated figures.

mod carry;
mod drawings;
mod image;
mod joint_angles;
mod meshes;
mod shapes;

pub(crate) use carry::{Carried, Edge, covered, cut, dissolve, with_alpha};
pub(crate) use drawings::RetargetDrawings;
pub(crate) use image::RetargetImage;
pub(crate) use joint_angles::RetargetJointAngles;
pub(crate) use meshes::RetargetMeshes;
pub(crate) use shapes::RetargetShapes;

use std::sync::{Arc, OnceLock};

use nalgebra::Matrix4;
use pegbar_engine::Value;
use pegbar_engine::array::NdArray;
use pegbar_engine::node::NodeError;

use crate::algo::arap::{Gauge, Options as ArapOptions};
use crate::algo::in_plane::{DepthScale, InPlane, Plane};
use crate::algo::key_blend::{Interpolation, KeyBlend, Options};
use crate::algo::raster::{Affine, apply, compose, identity};
use crate::algo::track_affine::Model;
use crate::data::{Affine2, KeyShapes};
use crate::keys::{AlignTo, align, contours};

/// Keys made ready to be blended, once for all frames.
#[derive(Clone, Debug, Value)]
pub(crate) struct Ready {
    /// The keys that it was made of.
    #[value(shape = "[k, n, 2]")]
    points: NdArray<f64, 3>,
    /// Made again where it is not there.
    #[value(skip)]
    made: OnceLock<Arc<Made>>,
}

/// Keys ready to be blended, and what moved each onto the others.
#[derive(Debug)]
struct Made {
    blend: KeyBlend,
    /// Blended from drawn, for each key.
    motions: Vec<Affine>,
    /// What carries the points of key drawings.
    hung: OnceLock<drawings::Hung>,
}

fn refused(error: impl std::fmt::Display) -> NodeError {
    NodeError::input(error.to_string())
}

/// How keys are blended, and the in-betweens of each pair.
#[derive(Clone, Copy)]
struct How {
    interpolation: Interpolation,
    inbetweens: u32,
    symmetric: bool,
    anchor: Option<u32>,
    align: AlignTo,
    align_model: Model,
    mesh: bool,
}

/// The keys ready to be blended: as they were before, where they are the same.
fn ready(keys: &KeyShapes, before: Option<&Ready>, how: How) -> Result<(Arc<Made>, Ready), NodeError> {
    let kept = before.filter(|b| b.points == keys.points).and_then(|b| b.made.get().cloned());
    let made = match kept {
        Some(made) => made,
        None => {
            let mut shapes = contours(keys);
            let motions = align(&mut shapes, how.align, how.align_model)?;
            let options = Options {
                interpolation: how.interpolation,
                count: how.inbetweens as usize,
                closed: keys.closed,
                mesh: how.mesh,
                arap: ArapOptions {
                    symmetric: how.symmetric,
                    gauge: how.anchor.map_or(Gauge::Centroid, |v| Gauge::Vertex(v as usize)),
                    ..ArapOptions::default()
                },
            };
            let views: Vec<&[[f64; 2]]> = shapes.iter().map(Vec::as_slice).collect();
            let help = "interpolation: linear takes any keys of one point order";
            Arc::new(Made { blend: KeyBlend::new(&views, options).map_err(|e| refused(e).help(help))?, motions, hung: OnceLock::new() })
        }
    };
    let state = Ready { points: keys.points.clone(), made: OnceLock::from(made.clone()) };
    Ok((made, state))
}

/// The motion after the placement.
fn placed(place: Option<&Affine2>, motion: Option<&Affine2>) -> Result<Affine, NodeError> {
    let each = |name: &str, given: Option<&Affine2>| {
        let map = given.map_or_else(identity, Affine::from);
        if map.iter().all(|v| v.is_finite()) {
            Ok(map)
        } else {
            Err(refused(format!("{name}: expected a finite affine map, found NaN or infinity")))
        }
    };
    Ok(compose(&each("motion", motion)?, &each("place", place)?))
}

fn moved(points: &[[f64; 2]], map: &Affine) -> Vec<[f64; 2]> {
    points.iter().map(|p| apply(map, (*p).into()).into()).collect()
}

/// Weights of the keys, as many as there are and finite.
fn expect_weights(weights: &[f64], keys: usize) -> Result<(), NodeError> {
    if weights.len() != keys {
        let message = format!("weights: expected {keys}, one for each key, found {}", weights.len());
        return Err(NodeError::input(message).help("give a target key for each captured key, in the same order"));
    }
    match weights.iter().position(|w| !w.is_finite()) {
        Some(k) => Err(NodeError::input(format!("weights: expected finite numbers, found {} at {k}", weights[k]))),
        None => Ok(()),
    }
}

/// A captured motion as one of the world; none where there is none.
fn in_world(
    motion: Option<&Affine2>,
    (plane, scale, origin): (Plane, f64, [f64; 2]),
    flip: bool,
    depth: DepthScale,
) -> Result<Matrix4<f64>, NodeError> {
    let Some(motion) = motion else { return Ok(Matrix4::identity()) };
    let map = Affine::from(motion);
    if map.iter().all(|v| v.is_finite()) {
        Ok(InPlane { plane, scale, origin, flip, depth }.matrix(&map))
    } else {
        Err(NodeError::input("motion: expected a finite affine map, found NaN or infinity"))
    }
}

#[cfg(test)]
mod tests;
