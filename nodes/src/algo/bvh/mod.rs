//! Biovision Hierarchy (`.bvh`): skeletons with their motion.
//!
//! Any hierarchy, several roots, any channels in any order for each joint. A joint's rotation is the product of its rotation channels in their order, the
//! first leftmost; position channels stand in place of the numbers of its OFFSET. An `End Site` becomes a joint `<parent>_end` that never turns.
//!
//! **Source**: Biovision's format as described by Lander, *Working with Motion Capture File Formats*, 1998, and Meredith and Maddock, *Motion Capture
//! File Formats Explained*, 2001. **Cost**: O(characters).

mod read;
mod write;

#[cfg(test)]
mod tests;

pub use read::read;
pub use write::{BvhWriteError, Channels, Export, Order, write};

use nalgebra::{UnitQuaternion, Vector3};

use super::rotation::exp;
use super::skeleton::Joint;

/// The most joints of a file: each frame costs so much.
pub const MAX_JOINTS: usize = 10_000;

/// What one number of a frame moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// The place along axis 0, 1 or 2, in place of that number of the offset.
    Position(usize),
    /// A turn about axis 0, 1 or 2, degrees.
    Rotation(usize),
}

/// A joint of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct BvhJoint {
    /// Its name, unlike every other.
    pub name: String,
    /// Its parent, which comes before it; none for a root.
    pub parent: Option<usize>,
    /// Where it stands in its parent's space at rest, in the file's units.
    pub offset: [f64; 3],
    /// What its numbers of each frame move.
    pub channels: Vec<Channel>,
    /// True for an `End Site`.
    pub is_end: bool,
}

/// A file: joints, and the numbers of each frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Bvh {
    /// The joints, parents first, in the order of the file.
    pub joints: Vec<BvhJoint>,
    /// Names that stood twice, and what became of the later.
    pub renamed: Vec<(String, String)>,
    /// Number of frames, at least 1.
    pub n_frames: usize,
    /// Seconds of a frame, as the file has it.
    pub frame_time: f64,
    /// Frames a second, of which [`Bvh::frame_time`] is a rounding.
    pub fps: f64,
    /// The numbers of each frame, one row after the other.
    pub values: Vec<f64>,
}

/// The turn by `degrees` about axis 0, 1 or 2.
pub(super) fn turned(axis: usize, degrees: f64) -> UnitQuaternion<f64> {
    let mut half = Vector3::zeros();
    half[axis.min(2)] = degrees.to_radians() / 2.0;
    exp(&half)
}

impl Bvh {
    /// Numbers of a frame.
    pub fn width(&self) -> usize {
        self.joints.iter().map(|j| j.channels.len()).sum()
    }

    /// Every joint at rest: at its offset, not turned.
    pub fn rest(&self) -> Vec<Joint> {
        let rest = |j: &BvhJoint| Joint {
            translation: Vector3::from(j.offset),
            rotation: UnitQuaternion::identity(),
            scale: Vector3::repeat(1.0),
        };
        self.joints.iter().map(rest).collect()
    }

    /// Every joint at frame `k` from 0, in the file's units; as at rest beyond the last. `added` takes positions as added to offsets instead of in their
    /// place.
    pub fn pose(&self, k: usize, added: bool) -> Vec<Joint> {
        let mut pose = self.rest();
        let mut row = self.values.iter().skip(k.saturating_mul(self.width()));
        for (joint, own) in pose.iter_mut().zip(&self.joints) {
            for (channel, value) in own.channels.iter().zip(row.by_ref()) {
                match *channel {
                    Channel::Position(axis) => joint.translation[axis] = if added { joint.translation[axis] + value } else { *value },
                    Channel::Rotation(axis) => joint.rotation *= turned(axis, *value),
                }
            }
        }
        pose
    }
}
