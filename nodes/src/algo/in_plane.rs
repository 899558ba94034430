//! Motions of the picture put on things of the world: a plane of the world stands for the picture.

use nalgebra::{Matrix3, Matrix4, Vector2, Vector3};
use pegbar_engine::Setting;

use super::raster::{Affine, apply};

/// The plane of the world that stands for the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Plane {
    /// x to the right, y up: seen from the front.
    Xy,
    /// z to the right, y up: from the side, where a character that looks along z walks to the right.
    Zy,
    /// x to the right, z down: seen from above.
    Xz,
}

/// What a motion of the picture does to depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum DepthScale {
    /// Nothing, as in the paper.
    One,
    /// It grows and shrinks as the picture does: by the square root of the motion's area.
    SqrtDet,
}

/// Where the picture stands in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InPlane {
    /// The plane.
    pub plane: Plane,
    /// Metres a pixel.
    pub scale: f64,
    /// The pixel that stands for the world's origin.
    pub origin: [f64; 2],
    /// True where the plane's second axis points up and the picture's down.
    pub flip: bool,
    /// What depth does.
    pub depth: DepthScale,
}

impl InPlane {
    /// The world's axes that stand for the picture's x, the picture's y, and depth.
    fn axes(&self) -> Matrix3<f64> {
        let up = if self.flip { -1.0 } else { 1.0 };
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        match self.plane {
            Plane::Xy => Matrix3::from_columns(&[x, y * up, z]),
            Plane::Zy => Matrix3::from_columns(&[z, y * up, x]),
            Plane::Xz => Matrix3::from_columns(&[x, z * -up, y]),
        }
    }

    /// A motion of the picture, pixels, as one of the world, metres.
    pub fn matrix(&self, motion: &Affine) -> Matrix4<f64> {
        let axes = self.axes();
        let depth = match self.depth {
            DepthScale::One => 1.0,
            DepthScale::SqrtDet => (motion[(0, 0)] * motion[(1, 1)] - motion[(0, 1)] * motion[(1, 0)]).abs().sqrt(),
        };
        let flat = Matrix3::new(motion[(0, 0)], motion[(0, 1)], 0.0, motion[(1, 0)], motion[(1, 1)], 0.0, 0.0, 0.0, depth);
        let away = (apply(motion, self.origin.into()) - Vector2::from(self.origin)) * self.scale;
        let mut out = Matrix4::identity();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&(axes * flat * axes.transpose()));
        out.fixed_view_mut::<3, 1>(0, 3).copy_from(&(axes * Vector3::new(away.x, away.y, 0.0)));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::raster::identity;

    const FRONT: InPlane = InPlane { plane: Plane::Xy, scale: 0.01, origin: [50.0, 80.0], flip: true, depth: DepthScale::One };

    fn at(m: &Matrix4<f64>, p: [f64; 3]) -> [f64; 3] {
        let v = m * nalgebra::Vector4::new(p[0], p[1], p[2], 1.0);
        [v.x, v.y, v.z].map(|v| (v * 1e9).round() / 1e9)
    }

    #[test]
    fn what_stands_still_in_the_picture_stands_still_in_the_world() {
        for plane in [Plane::Xy, Plane::Zy, Plane::Xz] {
            for flip in [true, false] {
                assert_eq!(InPlane { plane, flip, ..FRONT }.matrix(&identity()), Matrix4::identity());
            }
        }
    }

    #[test]
    fn down_in_the_picture_is_down_in_the_world() {
        let down = Affine::new(1.0, 0.0, 30.0, 0.0, 1.0, 20.0);
        assert_eq!(at(&FRONT.matrix(&down), [0.0; 3]), [0.3, -0.2, 0.0]);
        assert_eq!(at(&InPlane { plane: Plane::Zy, ..FRONT }.matrix(&down), [0.0; 3]), [0.0, -0.2, 0.3]);
        assert_eq!(at(&InPlane { plane: Plane::Xz, ..FRONT }.matrix(&down), [0.0; 3]), [0.3, 0.0, 0.2]);
        assert_eq!(at(&InPlane { flip: false, ..FRONT }.matrix(&down), [0.0; 3]), [0.3, 0.2, 0.0]);
    }

    #[test]
    fn a_point_of_the_world_goes_where_its_pixel_goes() {
        // Any map, and the pixel of a point: the origin and so many pixels right and up from it.
        let map = Affine::new(0.8, 0.3, 12.0, -0.2, 1.4, -7.0);
        let (p, pixel) = ([0.4, 0.7, 0.25], Vector2::new(50.0 + 40.0, 80.0 - 70.0));
        let there = apply(&map, pixel);
        let truth = [(there.x - 50.0) / 100.0, (80.0 - there.y) / 100.0];
        let moved = at(&FRONT.matrix(&map), p);
        assert!((moved[0] - truth[0]).abs() < 1e-9 && (moved[1] - truth[1]).abs() < 1e-9, "{moved:?} {truth:?}");
        assert_eq!(moved[2], 0.25);
        let area = 0.8 * 1.4 + 0.3 * 0.2;
        let deep = at(&InPlane { depth: DepthScale::SqrtDet, ..FRONT }.matrix(&map), p);
        assert!((deep[2] - 0.25 * f64::sqrt(area)).abs() < 1e-9);
    }
}
