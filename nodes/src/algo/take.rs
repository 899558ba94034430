//! Takes of motion capture: the rate of their frames, poses between them, and the space that they stand in.

use nalgebra::{UnitQuaternion, Vector3};
use pegbar_engine::Setting;

use super::rotation::{exp, slerp};
use super::skeleton::Joint;

/// Which of a file's axes points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Up {
    /// y: BVH and Acclaim as they are meant.
    #[default]
    Y,
    /// z, as Blender and many studios export; x stays.
    Z,
    /// x; z stays.
    X,
}

/// From a file's space to the world's: metres, Y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Space {
    /// Metres a unit of the file.
    pub scale: f64,
    /// World from file.
    pub turn: UnitQuaternion<f64>,
}

impl Space {
    /// The space of a file whose axis `up` points up, and whose unit is `scale` metres.
    pub fn new(up: Up, scale: f64) -> Self {
        let quarter = std::f64::consts::FRAC_PI_4;
        let turn = match up {
            Up::Y => UnitQuaternion::identity(),
            Up::Z => exp(&Vector3::new(-quarter, 0.0, 0.0)),
            Up::X => exp(&Vector3::new(0.0, 0.0, quarter)),
        };
        Self { scale, turn }
    }

    /// A joint of the file in the world; every joint's own axes turn with it, so that what is not turned in the file is not turned in the world.
    pub fn joint(&self, joint: &Joint) -> Joint {
        if self.turn == UnitQuaternion::identity() {
            return Joint { translation: joint.translation * self.scale, ..*joint };
        }
        let rotation = self.turn * joint.rotation * self.turn.inverse();
        Joint { translation: self.turn * joint.translation * self.scale, rotation, ..*joint }
    }
}

/// A joint `t` of the way from `a` to `b`: straight for places and scales, by the shorter way at constant speed for rotations.
pub fn between(a: &Joint, b: &Joint, t: f64) -> Joint {
    Joint {
        translation: a.translation + (b.translation - a.translation) * t,
        rotation: slerp(&a.rotation, &b.rotation, t),
        scale: a.scale + (b.scale - a.scale) * t,
    }
}

/// The pose at frame `at` (from 0, between frames too) of a take of `n` frames, held before the first and after the last. A time within a millionth of a
/// frame is that frame, so that rounding does not blend two. `n` must not be 0.
pub fn sampled<E>(n: usize, at: f64, pose: impl Fn(usize) -> Result<Vec<Joint>, E>) -> Result<Vec<Joint>, E> {
    let last = n.saturating_sub(1);
    let at = if at.is_nan() { 0.0 } else { at.clamp(0.0, last as f64) };
    let whole = at.round();
    if (at - whole).abs() < 1e-6 {
        return pose(whole as usize);
    }
    let first = at.floor();
    let (a, b) = (pose(first as usize)?, pose((first as usize + 1).min(last))?);
    Ok(a.iter().zip(&b).map(|(a, b)| between(a, b, at - first)).collect())
}

/// Frames a second from the seconds of one as a file writes them, which are rounded: the whole number of frames, else the rate of American television
/// (n · 1000 / 1001), that they can be the rounding of; else what they say.
pub fn rate(seconds: f64, digits: usize) -> f64 {
    let rate = 1.0 / seconds;
    // Some programs cut digits off instead of rounding, so that a whole unit of the last may be missing.
    let off = 1.01 * libm::pow(10.0, -(digits.min(300) as f64));
    let may_be = |fps: f64| fps >= 1.0 && (1.0 / fps - seconds).abs() <= off.min(1e-3 * seconds);
    let television = (rate * 1.001).round() * 1000.0 / 1001.0;
    [rate.round(), television].into_iter().find(|fps| may_be(*fps)).unwrap_or(rate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounded_frame_times_give_the_rates_that_were_meant() {
        let cases = [
            (".0083333", 7, 120.0),
            ("0.008333", 6, 120.0),
            ("0.0333333", 7, 30.0),
            ("0.033333333", 9, 30.0),
            ("0.03333", 5, 30.0),
            ("0.010000", 6, 100.0),
            ("0.01", 2, 100.0),
            ("0.0416667", 7, 24.0),
            ("0.0417083", 7, 24_000.0 / 1001.0),
            ("0.008342", 6, 120_000.0 / 1001.0),
            ("0.033366667", 9, 30_000.0 / 1001.0),
            ("1", 0, 1.0),
            ("0.0372", 4, 1.0 / 0.0372),
            ("2.5", 1, 0.4),
        ];
        for (text, digits, fps) in cases {
            let found = rate(text.parse().unwrap(), digits);
            assert!((found - fps).abs() < 1e-12 * fps, "{text}: {found}");
        }
    }

    #[test]
    fn frames_are_met_and_poses_between_them_are_turned_the_short_way() {
        let joint = |angle: f64| Joint {
            translation: Vector3::new(angle, 0.0, 0.0),
            rotation: exp(&Vector3::new(0.0, angle / 2.0, 0.0)),
            scale: Vector3::repeat(1.0),
        };
        let pose = |k: usize| Ok::<_, ()>(vec![joint(k as f64)]);
        assert_eq!(sampled(4, 2.0 + 1e-8, pose).unwrap()[0], joint(2.0));
        assert_eq!(sampled(4, 9.0, pose).unwrap()[0], joint(3.0));
        assert_eq!(sampled(4, -1.0, pose).unwrap()[0], joint(0.0));
        let found = sampled(4, 1.25, pose).unwrap()[0];
        assert!((found.rotation.angle_to(&joint(1.25).rotation)).abs() < 1e-12 && (found.translation.x - 1.25).abs() < 1e-12);
    }

    #[test]
    fn up_is_up() {
        let up = [(Up::Y, Vector3::y()), (Up::Z, Vector3::z()), (Up::X, Vector3::x())];
        for (up, axis) in up {
            let joint = Joint { translation: axis * 3.0, rotation: exp(&(axis * 0.2)), scale: Vector3::repeat(1.0) };
            let world = Space::new(up, 0.5).joint(&joint);
            assert!((world.translation - Vector3::y() * 1.5).amax() < 1e-15, "{up:?}");
            assert!(world.rotation.angle_to(&exp(&(Vector3::y() * 0.2))) < 1e-12, "{up:?}");
        }
    }
}
