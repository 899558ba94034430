//! How a bone is turned that points in a given direction and keeps a captured turn about itself.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::algo::procrustes::half_turn;

/// How two angles and a turn about the bone become a rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Reading {
    /// The shortest swing from the bone at rest to its direction, after the captured turn about the bone at rest: for any axis of the rig.
    SwingTwist,
    /// The paper's angles: R_x R_y R_z with the bone along z at rest, the first two from the bone's direction, the last one captured.
    Xyz,
}

/// Less than this is none of a direction.
const NONE: f64 = 1e-12;

/// The rotation of a joint that is turned by `rest` at rest, such that `bone` (in the joint's own space, of some length) points along `to` (in its parent's
/// space, of some length) and turns about itself as under the captured rotation `prior`.
///
/// Where the direction leaves angles open (the bone turned over, or at the pole of the paper's angles), they are those of `prior`.
pub fn turned(
    reading: Reading,
    rest: &UnitQuaternion<f64>,
    bone: &Vector3<f64>,
    prior: &UnitQuaternion<f64>,
    to: &Vector3<f64>,
) -> UnitQuaternion<f64> {
    let (axis, to) = ((rest * bone).normalize(), to.normalize());
    let captured = prior * rest.inverse();
    match reading {
        Reading::SwingTwist => {
            let twist = twist(&captured, &axis);
            swing(&axis, &to, &(captured * twist.inverse())) * twist * rest
        }
        Reading::Xyz => {
            let frame = UnitQuaternion::rotation_between(&Vector3::z(), &axis).unwrap_or_else(|| half_turn(&Vector3::z()));
            let own = (frame.inverse() * captured * frame).to_rotation_matrix().into_inner();
            let b = frame.inverse() * to;
            let flat = |x: f64, y: f64| libm::hypot(x, y) < NONE;
            // At the pole x and z turn alike: all of it is taken for x.
            let z = if flat(own[(0, 0)], own[(0, 1)]) { 0.0 } else { libm::atan2(-own[(0, 1)], own[(0, 0)]) };
            let captured_x = || {
                if flat(own[(1, 2)], own[(2, 2)]) { libm::atan2(own[(2, 1)], own[(1, 1)]) } else { libm::atan2(-own[(1, 2)], own[(2, 2)]) }
            };
            let x = if flat(b.y, b.z) { captured_x() } else { libm::atan2(-b.y, b.z) };
            let y = libm::atan2(b.x, libm::hypot(b.y, b.z));
            frame * about(Vector3::x(), x) * about(Vector3::y(), y) * about(Vector3::z(), z) * frame.inverse() * rest
        }
    }
}

fn about(axis: Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::from_parts(libm::cos(angle / 2.0), axis * libm::sin(angle / 2.0)))
}

/// The part of a rotation that turns about `axis` (unit), before the shortest swing of the axis; none where the axis is turned over, which any turn about it does
/// as well.
pub fn twist(rotation: &UnitQuaternion<f64>, axis: &Vector3<f64>) -> UnitQuaternion<f64> {
    let along = rotation.vector().dot(axis);
    let part = Quaternion::from_parts(rotation.scalar(), axis * along);
    UnitQuaternion::try_new(part, NONE).unwrap_or_else(UnitQuaternion::identity)
}

/// The shortest swing from one direction to another, both unit; to the opposite one about the axis of the captured swing.
fn swing(from: &Vector3<f64>, to: &Vector3<f64>, captured: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let shortest = |from: &Vector3<f64>| {
        let half = (from + to).normalize();
        UnitQuaternion::new_normalize(Quaternion::from_parts(from.dot(&half), from.cross(&half)))
    };
    let first = if (from + to).norm() > 1e-8 { shortest(from) } else { half_swing(from, captured) };
    // Near the opposite direction little is left of the sum of both; what that costs is small enough to be made good exactly.
    shortest(&(first * from)) * first
}

/// A half turn of `from` about the axis of the captured swing.
fn half_swing(from: &Vector3<f64>, captured: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let axis = captured.vector() - from * captured.vector().dot(from);
    UnitQuaternion::try_new(Quaternion::from_imag(axis), NONE).unwrap_or_else(|| half_turn(from))
}
