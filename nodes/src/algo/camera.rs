//! Cameras as in OpenGL and glTF: they look along −z with y up, and clip space runs from −1 to 1.
//!
//! Pixels follow from clip space by the picture's size: x = (ndc_x + 1) w / 2, y = (1 − ndc_y) h / 2. Formulas: Khronos, *glTF 2.0
//! Specification*, section 3.10 (perspective, orthographic).

use nalgebra::{Matrix4, Vector3, Vector4};

/// What keeps numbers from being a camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A matrix entry that is not a number, or infinite.
    #[error("expected finite {name}, found {value}")]
    NotFinite {
        /// Which matrix or setting.
        name: &'static str,
        /// The number.
        value: f64,
    },
    /// A view that flattens or turns inside out what it sees.
    #[error("expected a view of rotation and translation, found one that squashes space (determinant {determinant})")]
    Flat {
        /// Of its linear part.
        determinant: f64,
    },
    /// A projection that is neither perspective nor orthographic.
    #[error("expected a projection whose last row is (0, 0, p, q), found ({0}, {1}, {2}, {3})")]
    Row(f64, f64, f64, f64),
    /// A picture without a pixel, or larger than any that is made.
    #[error("expected a picture of 1 to 65536 pixels a side, found {width} x {height}")]
    Size {
        /// Columns.
        width: i64,
        /// Rows.
        height: i64,
    },
    /// Settings that make no projection.
    #[error("expected {expected}, found {found}")]
    Setting {
        /// What must hold.
        expected: &'static str,
        /// The numbers that do not.
        found: String,
    },
}

/// A camera and the picture that it makes.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Camera from world.
    pub view: Matrix4<f64>,
    /// Clip space from camera.
    pub projection: Matrix4<f64>,
    /// Columns and rows of the picture.
    pub size: [usize; 2],
}

/// Where a camera stands, about the point that it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// The point in the middle of the picture, world space.
    pub target: [f64; 3],
    /// Angle about the world's y axis, radians: 0 stands on +z of the target, a quarter turn on +x.
    pub azimuth: f64,
    /// Angle above the horizon, radians.
    pub elevation: f64,
    /// Turn of the camera about its own axis, anticlockwise as the camera's bearer sees it, radians.
    pub roll: f64,
    /// From target to camera.
    pub distance: f64,
}

impl Orbit {
    /// Camera from world.
    pub fn view(&self) -> Matrix4<f64> {
        let turned = |axis: Vector3<f64>, angle: f64| {
            let (s, c) = libm::sincos(angle);
            let [x, y, z] = axis.into();
            // Rodrigues' formula for an axis of the frame: one of x, y, z is 1.
            Matrix4::new(
                x + (1.0 - x) * c,
                -z * s,
                y * s,
                0.0,
                z * s,
                y + (1.0 - y) * c,
                -x * s,
                0.0,
                -y * s,
                x * s,
                z + (1.0 - z) * c,
                0.0,
                0.0,
                0.0,
                0.0,
                1.0,
            )
        };
        let turn = turned(Vector3::z(), -self.roll) * turned(Vector3::x(), self.elevation) * turned(Vector3::y(), -self.azimuth);
        let back = Matrix4::new_translation(&Vector3::new(0.0, 0.0, -self.distance));
        back * turn * Matrix4::new_translation(&-Vector3::from(self.target))
    }
}

/// The projection that shows `scale` pixels a unit of length, between the depths `near` and `far`.
pub fn orthographic(scale: f64, size: [usize; 2], near: f64, far: f64) -> Matrix4<f64> {
    let [w, h] = size.map(|n| n as f64);
    let depth = near - far;
    Matrix4::new(
        2.0 * scale / w,
        0.0,
        0.0,
        0.0,
        0.0,
        2.0 * scale / h,
        0.0,
        0.0,
        0.0,
        0.0,
        2.0 / depth,
        (far + near) / depth,
        0.0,
        0.0,
        0.0,
        1.0,
    )
}

/// The perspective projection with a vertical field of view of `fov_y` radians, between the depths `near` and `far`.
pub fn perspective(fov_y: f64, size: [usize; 2], near: f64, far: f64) -> Matrix4<f64> {
    let [w, h] = size.map(|n| n as f64);
    let f = 1.0 / libm::tan(fov_y / 2.0);
    let depth = near - far;
    Matrix4::new(f * h / w, 0.0, 0.0, 0.0, 0.0, f, 0.0, 0.0, 0.0, 0.0, (far + near) / depth, 2.0 * far * near / depth, 0.0, 0.0, -1.0, 0.0)
}

impl Camera {
    /// A camera of these matrices.
    ///
    /// # Errors
    /// Where a number is not finite, the view is singular, the projection is of no known kind, or the picture has no pixel.
    pub fn new(view: Matrix4<f64>, projection: Matrix4<f64>, size: [i64; 2]) -> Result<Self, CameraError> {
        for (name, m) in [("view", &view), ("projection", &projection)] {
            if let Some(&value) = m.iter().find(|v| !v.is_finite()) {
                return Err(CameraError::NotFinite { name, value });
            }
        }
        let determinant = view.fixed_view::<3, 3>(0, 0).determinant();
        if determinant.abs() < 1e-12 {
            return Err(CameraError::Flat { determinant });
        }
        let row = [0, 1, 2, 3].map(|k| projection[(3, k)]);
        if row[0] != 0.0 || row[1] != 0.0 || (row[2] == 0.0) == (row[3] == 0.0) {
            return Err(CameraError::Row(row[0], row[1], row[2], row[3]));
        }
        match size {
            [w @ 1..=65536, h @ 1..=65536] => Ok(Self { view, projection, size: [w as usize, h as usize] }),
            [width, height] => Err(CameraError::Size { width, height }),
        }
    }

    /// True where lines of sight are parallel.
    pub fn is_orthographic(&self) -> bool {
        self.projection[(3, 2)] == 0.0
    }

    /// Clip space from world.
    pub fn clip_from_world(&self) -> Matrix4<f64> {
        self.projection * self.view
    }

    /// World from camera.
    pub fn world_from_camera(&self) -> Matrix4<f64> {
        // The view was held against being singular when the camera was made.
        self.view.try_inverse().unwrap_or_else(Matrix4::identity)
    }

    /// From a point towards the camera, world space, not normalised: the eye less the point, or one direction for all in an orthographic view.
    pub fn toward(&self) -> impl Fn(&Vector3<f64>) -> Vector3<f64> + Copy + use<> {
        let world = self.world_from_camera();
        let (eye, back) = (world.column(3).xyz(), world.column(2).xyz());
        let orthographic = self.is_orthographic();
        move |p| if orthographic { back } else { eye - p }
    }

    /// Column and row of a point of clip space; infinite where it lies in the plane of the eye.
    pub fn pixel(&self, clip: &Vector4<f64>) -> [f64; 2] {
        let [w, h] = self.size.map(|n| n as f64);
        [(clip.x / clip.w + 1.0) * w / 2.0, (1.0 - clip.y / clip.w) * h / 2.0]
    }

    /// How much nearness ([`super::zbuffer::ScreenTriangle`]) changes with depth: by its own square in perspective.
    pub fn slope(&self, near: f64) -> f64 {
        if self.is_orthographic() { 1.0 } else { near * near }
    }

    /// Column, row, and depth along the camera's axis of a point of the world.
    pub fn project(&self, world: [f64; 3]) -> [f64; 3] {
        let camera = self.view * Vector4::new(world[0], world[1], world[2], 1.0);
        let [x, y] = self.pixel(&(self.projection * camera));
        [x, y, -camera.z]
    }

    /// Depth along the camera's axis of a point of an orthographic view, as `a z + b` of clip space; of a perspective one, as `a w + b`.
    pub fn depth_of_clip(&self) -> [f64; 2] {
        let p = &self.projection;
        if self.is_orthographic() { [-1.0 / p[(2, 2)], p[(2, 3)] / p[(2, 2)]] } else { [-1.0 / p[(3, 2)], p[(3, 3)] / p[(3, 2)]] }
    }
}

#[cfg(test)]
#[path = "camera_tests.rs"]
mod tests;
