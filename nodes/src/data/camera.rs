//! Cameras.

use nalgebra::Matrix4;
use pegbar_engine::Value;

use crate::algo::camera::{self, CameraError};

/// A camera as in OpenGL and glTF: it looks along −z, y up, clip space from −1 to 1.
#[derive(Clone, Debug, PartialEq, Value)]
pub struct Camera {
    /// Camera from world, rows of a matrix for columns.
    #[value(shape = "[4, 4]")]
    pub view: [[f64; 4]; 4],
    /// Clip space from camera, rows of a matrix for columns.
    #[value(shape = "[4, 4]")]
    pub projection: [[f64; 4]; 4],
    /// Columns and rows of the picture: x = (ndc_x + 1) w / 2, y = (1 − ndc_y) h / 2.
    #[value(shape = "[2]")]
    pub size: [i64; 2],
}

fn rows(m: &Matrix4<f64>) -> [[f64; 4]; 4] {
    (*m).transpose().into()
}

fn matrix(rows: &[[f64; 4]; 4]) -> Matrix4<f64> {
    Matrix4::from(*rows).transpose()
}

impl From<&camera::Camera> for Camera {
    fn from(camera: &camera::Camera) -> Self {
        Self { view: rows(&camera.view), projection: rows(&camera.projection), size: camera.size.map(|n| n as i64) }
    }
}

impl TryFrom<&Camera> for camera::Camera {
    type Error = CameraError;

    fn try_from(camera: &Camera) -> Result<Self, CameraError> {
        camera::Camera::new(matrix(&camera.view), matrix(&camera.projection), camera.size)
    }
}
