//! Acclaim: a skeleton in one file (`.asf`), its motion in another (`.amc`).
//!
//! A bone's joint stands where the bone begins, which is where its parent ends; the last joint of each chain is `<bone>_end`. Nothing is turned at rest, and a
//! bone with the axes C turns by C M C⁻¹, where M is the product of the turns of its degrees of freedom in the order of its axes: `XYZ` turns about x first,
//! M = Rz Ry Rx, as C itself.
//!
//! **Source**: Lander, *Working with Motion Capture File Formats*, 1998; the files of mocap.cs.cmu.edu. **Cost**: O(characters).

mod read;
#[cfg(test)]
mod tests;

pub use read::{read_amc, read_asf};

use nalgebra::{UnitQuaternion, Vector3};

use super::bvh::turned;
use super::skeleton::Joint;

/// What a number of a frame moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dof {
    /// The place along axis 0, 1 or 2: of the root alone.
    Translation(usize),
    /// A turn about axis 0, 1 or 2.
    Rotation(usize),
}

/// A bone, or the root.
#[derive(Clone, Debug, PartialEq)]
pub struct Bone {
    /// Its name, unlike every other.
    pub name: String,
    /// The bone that it hangs on, which comes before it; none for the root.
    pub parent: Option<usize>,
    /// From its beginning to its end, in the file's units; of the root its place at rest.
    pub vector: [f64; 3],
    /// Its own axes at rest.
    pub axes: UnitQuaternion<f64>,
    /// The order in which it turns, the first of them first.
    pub order: [usize; 3],
    /// What its numbers of each frame move.
    pub dofs: Vec<Dof>,
}

/// A skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct Asf {
    /// The root, then the bones, parents first.
    pub bones: Vec<Bone>,
    /// What lengths of both files are divided by: 0.45 in those of Carnegie Mellon, which makes them inches.
    pub length: f64,
    /// True where angles are radians.
    pub is_radians: bool,
}

/// A motion: the numbers of each frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Amc {
    /// Number of frames, at least 1.
    pub n_frames: usize,
    /// The numbers of each frame, bone by bone in the order of the skeleton; angles in degrees.
    pub values: Vec<f64>,
}

/// The product of turns about three axes, the first of them first, degrees.
fn product(order: [usize; 3], degrees: [f64; 3]) -> UnitQuaternion<f64> {
    order.into_iter().fold(UnitQuaternion::identity(), |turn, axis| turned(axis, degrees[axis]) * turn)
}

impl Asf {
    /// Numbers of a frame.
    pub fn width(&self) -> usize {
        self.bones.iter().map(|b| b.dofs.len()).sum()
    }

    /// Bones on which no other hangs: each has an end of its own.
    fn leaves(&self) -> impl Iterator<Item = usize> {
        (1..self.bones.len()).filter(|b| !self.bones.iter().any(|c| c.parent == Some(*b)))
    }

    /// Parents and names of the joints: the root, the bones, and the ends of chains.
    pub fn joints(&self) -> (Vec<i64>, Vec<String>) {
        let bone = |b: &Bone| (b.parent.map_or(-1, |p| p as i64), b.name.clone());
        let end = |b: usize| (b as i64, format!("{}_end", self.bones[b].name));
        self.bones.iter().map(bone).chain(self.leaves().map(end)).unzip()
    }

    /// Every joint at rest, in the file's units.
    pub fn rest(&self) -> Vec<Joint> {
        let at = |translation: Vector3<f64>| Joint { translation, rotation: UnitQuaternion::identity(), scale: Vector3::repeat(1.0) };
        let vector = |b: usize| Vector3::from(self.bones[b].vector) / self.length;
        let begin = |b: &Bone| match b.parent {
            None => Vector3::from(b.vector) / self.length,
            Some(0) => Vector3::zeros(),
            Some(parent) => vector(parent),
        };
        self.bones.iter().map(begin).chain(self.leaves().map(vector)).map(at).collect()
    }

    /// Every joint at frame `k` of a motion, from 0, in the file's units; as at rest beyond the last.
    pub fn pose(&self, motion: &Amc, k: usize) -> Vec<Joint> {
        let mut pose = self.rest();
        let mut row = motion.values.iter().skip(k.saturating_mul(self.width()));
        for (joint, bone) in pose.iter_mut().zip(&self.bones) {
            let mut degrees = [0.0; 3];
            for (dof, value) in bone.dofs.iter().zip(row.by_ref()) {
                match *dof {
                    Dof::Translation(axis) => joint.translation[axis] += value / self.length,
                    Dof::Rotation(axis) => degrees[axis] = *value,
                }
            }
            joint.rotation = bone.axes * product(bone.order, degrees) * bone.axes.inverse();
        }
        pose
    }
}
