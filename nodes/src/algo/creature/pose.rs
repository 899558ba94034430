//! Key poses: joints turned, feet and hands put where they belong.

use nalgebra::{Matrix3, Matrix4, Rotation3, UnitQuaternion, Vector3};
use thiserror::Error;

use super::design::{Design, Limb};
use super::field::Form;
use super::turned;
use crate::algo::skeleton::Joint;

/// A key pose as it is authored. Angles in degrees: about z, then x, then y.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Key {
    pub(super) name: String,
    /// How far the root is from where it rests.
    pub(super) shift: [f64; 3],
    pub(super) turn: [f64; 3],
    /// Squash and stretch of the whole.
    pub(super) scale: [f64; 3],
    /// True where it stands on the ground: the lowest point of the feet is put at y = 0.
    pub(super) grounded: bool,
    pub(super) turns: Vec<(String, [f64; 3])>,
    pub(super) reaches: Vec<Reach>,
}

/// Where the end of a limb is.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reach {
    /// The limb's last joint.
    pub(super) joint: String,
    /// True where place and turn are the world's (a foot); false where the place is from the limb's parent joint, and the turn that of the joint itself (a hand).
    pub(super) in_world: bool,
    pub(super) at: [f64; 3],
    pub(super) turn: [f64; 3],
    /// Where the middle joint points, in the space of `at`; as at rest where it is left out.
    pub(super) pole: Option<[f64; 3]>,
}

/// Why there is no such pose.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum KeyError {
    /// No pose of that name.
    #[error("expected a pose that the character has: {choices}, found {found}")]
    Unknown {
        /// The name.
        found: String,
        /// The names that there are.
        choices: String,
    },
    /// The design turns a joint that it does not have, or bends one that is no limb.
    #[error("expected a joint or limb of the character, found {0}")]
    Joint(String),
}

impl Key {
    /// The same with left for right.
    fn mirrored(&self) -> Self {
        let across = |[x, y, z]: [f64; 3]| [-x, y, z];
        let about = |[x, y, z]: [f64; 3]| [x, -y, -z];
        let reach = |r: &Reach| Reach {
            joint: other_side(&r.joint),
            at: across(r.at),
            turn: about(r.turn),
            pole: r.pole.map(across),
            in_world: r.in_world,
        };
        Self {
            shift: across(self.shift),
            turn: about(self.turn),
            turns: self.turns.iter().map(|(joint, turn)| (other_side(joint), about(*turn))).collect(),
            reaches: self.reaches.iter().map(reach).collect(),
            ..self.clone()
        }
    }
}

/// `foot.l` for `foot.r` and the other way round.
fn other_side(joint: &str) -> String {
    match (joint.strip_suffix(".l"), joint.strip_suffix(".r")) {
        (Some(stem), _) => format!("{stem}.r"),
        (_, Some(stem)) => format!("{stem}.l"),
        _ => joint.to_owned(),
    }
}

impl Design {
    /// A key pose by name, joint by joint; `mirror` for left instead of right.
    ///
    /// # Errors
    /// Where there is no such pose.
    pub fn key(&self, name: &str, mirror: bool) -> Result<Vec<Joint>, KeyError> {
        let key = self
            .keys
            .iter()
            .find(|k| k.name == name)
            .ok_or_else(|| KeyError::Unknown { found: name.to_owned(), choices: self.key_names().collect::<Vec<_>>().join(", ") })?;
        let key = if mirror { key.mirrored() } else { key.clone() };
        let mut joints: Vec<Joint> = self
            .skeleton()
            .map(|(_, _, translation)| Joint { translation, rotation: UnitQuaternion::identity(), scale: Vector3::repeat(1.0) })
            .collect();
        let quaternion = |turn| UnitQuaternion::from_rotation_matrix(&turned(turn));
        for (joint, turn) in &key.turns {
            let at = self.joint(joint).ok_or_else(|| KeyError::Joint(joint.clone()))?;
            joints[at].rotation = quaternion(*turn);
        }
        if let Some(root) = joints.first_mut() {
            root.translation += Vector3::from(key.shift);
            root.rotation = quaternion(key.turn);
            root.scale = key.scale.into();
        }
        for reach in &key.reaches {
            self.bend(&mut joints, reach)?;
        }
        if key.grounded {
            let low = self.lowest(&joints, |j| self.is_sole(&key, j));
            joints[0].translation.y -= if low.is_finite() { low } else { 0.0 };
        }
        Ok(joints)
    }

    /// World from joint, of each joint in a pose.
    pub fn world(&self, joints: &[Joint]) -> Vec<Matrix4<f64>> {
        let mut world: Vec<Matrix4<f64>> = Vec::with_capacity(joints.len());
        // Parents come before their children.
        for (bone, joint) in self.joints.iter().zip(joints) {
            world.push(bone.parent.map_or_else(|| joint.matrix(), |p| world[p] * joint.matrix()));
        }
        world
    }

    /// How low the clay of joints reaches, fillets left out.
    fn lowest(&self, joints: &[Joint], of: impl Fn(usize) -> bool) -> f64 {
        let world = self.world(joints);
        let low = |joint: usize, at: &Vector3<f64>, axes: &Matrix3<f64>| {
            let m = &world[joint];
            (m * (at - self.joints[joint].at).push(1.0)).y - (m.fixed_view::<1, 3>(1, 0) * axes).norm()
        };
        let lows = self.body.iter().filter(|b| of(b.joint)).map(|blob| match &blob.form {
            Form::Cone { ends: [a, b], radii } => {
                let ball = |k: usize, at| low(blob.joint, at, &Matrix3::from_diagonal_element(radii[k]));
                ball(0, a).min(ball(1, b))
            }
            Form::Ellipsoid { centre, radii, turn } => low(blob.joint, centre, &(turn.matrix() * Matrix3::from_diagonal(radii))),
        });
        lows.fold(f64::INFINITY, f64::min)
    }

    /// True for a foot and what hangs on it.
    fn is_sole(&self, key: &Key, joint: usize) -> bool {
        let placed = key.reaches.iter().any(|r| r.in_world && r.joint == self.joints[joint].name);
        placed || self.joints[joint].parent.is_some_and(|p| self.is_sole(key, p))
    }

    /// Bends a limb so that its end is where it shall be.
    fn bend(&self, joints: &mut [Joint], reach: &Reach) -> Result<(), KeyError> {
        let none = || KeyError::Joint(reach.joint.clone());
        let end = self.joint(&reach.joint).ok_or_else(none)?;
        let Limb { joints: [upper, lower, _], pole: rest_pole } = *self.limbs.iter().find(|l| l.joints[2] == end).ok_or_else(none)?;
        let parent = self.joints[upper].parent.ok_or_else(none)?;
        let world = self.world(joints);
        let to_parent = if reach.in_world { world[parent].try_inverse().ok_or_else(none)? } else { Matrix4::identity() };
        let target = (to_parent * Vector3::from(reach.at).push(1.0)).xyz() - joints[upper].translation;
        let pole = reach.pole.map_or(rest_pole, |p| (to_parent * Vector3::from(p).push(0.0)).xyz());
        let (first, second) = (joints[lower].translation, joints[end].translation);
        let middle = elbow(&target, &pole, first.norm(), second.norm());
        let upper_turn = aim(&first, &rest_pole).and_then(|rest| Some(aim(&middle, &pole)? * rest.inverse())).ok_or_else(none)?;
        let reached = target * ((first.norm() + second.norm()) * MOST_STRETCH / target.norm()).min(1.0);
        let lower_turn =
            aim(&second, &rest_pole).and_then(|rest| Some(aim(&(reached - middle), &pole)? * rest.inverse())).ok_or_else(none)?;
        joints[upper].rotation = UnitQuaternion::from_rotation_matrix(&upper_turn);
        joints[lower].rotation = UnitQuaternion::from_rotation_matrix(&(upper_turn.inverse() * lower_turn));
        let own = if reach.in_world { (self.turn_of(joints, lower)).inverse() * turned(reach.turn) } else { turned(reach.turn) };
        joints[end].rotation = UnitQuaternion::from_rotation_matrix(&own);
        Ok(())
    }

    /// How a joint is turned in the world, scales left out.
    fn turn_of(&self, joints: &[Joint], joint: usize) -> Rotation3<f64> {
        let own = joints[joint].rotation.to_rotation_matrix();
        self.joints[joint].parent.map_or(own, |p| self.turn_of(joints, p) * own)
    }
}

/// A limb is never quite straight, so that its knee has a side.
const MOST_STRETCH: f64 = 0.995;

/// Where the middle joint of a limb is, from its first: the law of cosines, on the pole's side.
fn elbow(target: &Vector3<f64>, pole: &Vector3<f64>, first: f64, second: f64) -> Vector3<f64> {
    let axis = target.try_normalize(1e-9).unwrap_or(-Vector3::y());
    let far = target.norm().clamp((first - second).abs() * 1.001 + 1e-6, (first + second) * MOST_STRETCH);
    let along = (first * first - second * second + far * far) / (2.0 * far);
    let out = (first * first - along * along).max(0.0).sqrt();
    let side = (pole - axis * axis.dot(pole)).try_normalize(1e-9).unwrap_or_else(|| axis.cross(&Vector3::x()).normalize());
    axis * along + side * out
}

/// The rotation whose x is along `axis` and whose y is on the pole's side.
fn aim(axis: &Vector3<f64>, pole: &Vector3<f64>) -> Option<Rotation3<f64>> {
    let x = axis.try_normalize(1e-9)?;
    let y = (pole - x * x.dot(pole)).try_normalize(1e-9)?;
    Some(Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)])))
}
