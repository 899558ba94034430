//! Cameras: where one stands, and how it projects.

mod calibrate;
mod orthographic;
mod perspective;
#[cfg(test)]
mod tests;

pub(crate) use calibrate::CameraCalibrate;
pub(crate) use orthographic::CameraOrthographic;
pub(crate) use perspective::CameraPerspective;

use nalgebra::Matrix4;
use pegbar_engine::Outputs;
use pegbar_engine::node::{Fault, NodeError};

use crate::algo::camera::{Camera, CameraError, Orbit};
use crate::data;

/// The camera.
#[derive(Outputs)]
pub(crate) struct Made {
    /// It: view, projection and the picture's size.
    camera: data::Camera,
}

fn refused(error: CameraError) -> NodeError {
    NodeError::new(Fault::Parameters, error.to_string())
}

fn setting(expected: &'static str, found: String) -> NodeError {
    refused(CameraError::Setting { expected, found })
}

fn size_of(size: [i64; 2]) -> [usize; 2] {
    size.map(|n| usize::try_from(n).unwrap_or(0))
}

/// A camera on its orbit, if every number of it is finite.
fn made(orbit: Orbit, projection: Matrix4<f64>, size: [i64; 2]) -> Result<Made, NodeError> {
    let numbers = [orbit.azimuth, orbit.elevation, orbit.roll, orbit.distance].into_iter().chain(orbit.target);
    if let Some(found) = numbers.into_iter().find(|v| !v.is_finite()) {
        return Err(setting("finite angles, target and distance", found.to_string()));
    }
    let camera = Camera::new(orbit.view(), projection, size).map_err(refused)?;
    Ok(Made { camera: data::Camera::from(&camera) })
}

/// The depths that are seen, if they make a range.
fn depths(near: f64, far: f64, least: f64) -> Result<(), NodeError> {
    if near >= least && near < far && far.is_finite() {
        return Ok(());
    }
    Err(setting("`near` below `far`, both finite, `near` above 0 in perspective", format!("near {near}, far {far}")))
}
