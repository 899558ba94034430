//! Joint angles from markers: two of each bone from where its markers are, the third from a motion that was captured.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 3.6; Gower and Dijksterhuis 2004 (the pelvis).
//!
//! A marker stands on a joint. The topmost marked joint is brought to its marker and turned by Procrustes to those next below it. Every other marked
//! joint is turned so that its bone, which ends at the next marked joint below, points at that joint's marker, and keeps the turn about the bone that the
//! captured motion has there. Joints between two marked ones, and those below the last, do what they do in the captured motion.

#[cfg(test)]
mod tests;
mod turn;

use nalgebra::{Matrix4, UnitQuaternion, Vector3};
use thiserror::Error;

use super::procrustes;
use super::skeleton::{Joint, TreeError, order};
pub use turn::{Reading, turned, twist};

/// Where a bone begins that points at a marker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Aim {
    /// Where its joint stands: the bone, or the line that it is on, goes through the marker, also where lengths differ.
    Marker,
    /// At its joint's own marker: the bone is parallel to the line from marker to marker.
    Bone,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// How two angles become a rotation.
    pub reading: Reading,
    /// Where a bone begins.
    pub aim: Aim,
    /// How much of the way from the rig's length to that of the markers bones are stretched: 0 none, 1 all.
    pub stretch: f64,
}

/// Why a rig cannot be put on markers.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RigError {
    /// The parents are no tree.
    #[error(transparent)]
    Tree(#[from] TreeError),
    /// A joint at rest is sheared or flat.
    #[error("joint {0}: expected a rest pose of translation, rotation and scale, found a shear or no size")]
    Rest(usize),
    /// No joint has a marker.
    #[error("expected a marker on at least one joint, found none")]
    Bare,
    /// The markers hang on several trees.
    #[error("expected one topmost marked joint, found joints {0} and {1}")]
    Tops(usize, usize),
}

/// A bone from a marked joint to the next below.
#[derive(Clone, Debug, PartialEq)]
struct Bone {
    end: usize,
    /// Joints below the marked one, down to and with the end.
    path: Vec<usize>,
}

/// A skeleton whose joints are followed by markers.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    parents: Vec<Option<usize>>,
    order: Vec<usize>,
    rest: Vec<Joint>,
    /// How long each joint's axes are in the world at rest.
    sizes: Vec<Vector3<f64>>,
    marked: Vec<bool>,
    top: usize,
    /// Of each joint; none of those that are not marked.
    bones: Vec<Vec<Bone>>,
    /// Joints whose bones the top is fitted to; all where there are none.
    fit: Vec<usize>,
}

impl Rig {
    /// A rig of `parents` and `rest` (parent from joint), some of whose joints are `marked`. `fit` names the marked joints that the topmost one is turned to: all that
    /// come next below where it is empty. `bones` says which joint a joint's bone ends at, where several come next below; else it is the one that goes
    /// straightest on.
    ///
    /// # Errors
    /// Where parents are no tree, a rest pose is sheared, no joint is marked, or marked joints have no common top among them.
    pub fn new(parents: &[i64], rest: &[Matrix4<f64>], marked: &[bool], fit: &[usize], bones: &[(usize, usize)]) -> Result<Self, RigError> {
        let order = order(parents)?;
        let rest: Vec<Joint> =
            rest.iter().enumerate().map(|(j, m)| Joint::from_matrix(m).ok_or(RigError::Rest(j))).collect::<Result<_, _>>()?;
        let parents: Vec<Option<usize>> = parents.iter().map(|p| usize::try_from(*p).ok()).collect();
        let marked: Vec<bool> = (0..parents.len()).map(|j| marked.get(j).copied().unwrap_or(false)).collect();
        let above = |mut j: usize| loop {
            match parents[j] {
                Some(p) if marked[p] => return Some(p),
                Some(p) => j = p,
                None => return None,
            }
        };
        let mut tops = order.iter().copied().filter(|&j| marked[j] && above(j).is_none());
        let top = tops.next().ok_or(RigError::Bare)?;
        if let Some(other) = tops.next() {
            return Err(RigError::Tops(top, other));
        }
        let mut rig =
            Self { sizes: Vec::new(), bones: vec![Vec::new(); parents.len()], parents, order, rest, marked, top, fit: fit.to_vec() };
        rig.find_sizes();
        rig.find_bones(bones);
        Ok(rig)
    }

    fn find_sizes(&mut self) {
        let mut world = vec![Matrix4::identity(); self.rest.len()];
        for &j in &self.order {
            world[j] = self.parents[j].map_or_else(Matrix4::identity, |p| world[p]) * self.rest[j].matrix();
        }
        self.sizes = world.iter().map(lengths).collect();
    }

    /// The bones of each marked joint, that which it points along first.
    fn find_bones(&mut self, chosen: &[(usize, usize)]) {
        for &j in self.order.iter().filter(|&&j| self.marked[j]) {
            let mut path = vec![j];
            while let Some(p) = self.parents[path[path.len() - 1]] {
                if self.marked[p] {
                    path.reverse();
                    self.bones[p].push(Bone { end: j, path });
                    break;
                }
                path.push(p);
            }
        }
        for j in 0..self.bones.len() {
            let onwards = self.rest[j].rotation.inverse() * self.rest[j].translation;
            let offset = |b: &Bone| self.offset(b, |k| self.rest[k].rotation);
            let straight = |b: &Bone| {
                let offset = offset(b);
                // A bone without a length points nowhere.
                if offset.norm() < SHORT { f64::NEG_INFINITY } else { onwards.normalize().dot(&offset.normalize()) }
            };
            let rank = |b: &Bone| {
                if chosen.contains(&(j, b.end)) {
                    2.0
                } else {
                    let s = straight(b);
                    if s.is_nan() { 0.0 } else { s }
                }
            };
            let mut ranked: Vec<(f64, Bone)> = self.bones[j].iter().map(|b| (rank(b), b.clone())).collect();
            ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
            self.bones[j] = ranked.into_iter().map(|(_, b)| b).collect();
        }
    }

    /// Where a bone ends, in its joint's own space, the joints between turned as told.
    fn offset(&self, bone: &Bone, turn: impl Fn(usize) -> UnitQuaternion<f64>) -> Vector3<f64> {
        bone.path.iter().rev().fold(Vector3::zeros(), |below, &k| {
            let Joint { translation, scale, .. } = self.rest[k];
            translation + turn(k) * scale.component_mul(&below)
        })
    }

    /// The topmost marked joint.
    pub fn top(&self) -> usize {
        self.top
    }

    /// Every joint's part, from markers in the world (by joint; `None` where a marker is not known) and what the joints do in the captured motion.
    ///
    /// A bone whose marker is not known, or is where the bone begins, keeps the captured turn; without the topmost marker the captured root stays.
    pub fn solve(&self, markers: &[Option<Vector3<f64>>], prior: &[Joint], options: Options) -> Vec<Joint> {
        let mut frame = Frame {
            rig: self,
            markers,
            prior,
            options,
            world: vec![Matrix4::identity(); self.rest.len()],
            stretches: vec![None; self.rest.len()],
        };
        let mut joints = prior.to_vec();
        for &j in &self.order {
            joints[j] = frame.joint(j);
        }
        joints
    }

    /// The topmost marked joint alone, and how well its markers fit: the root of the mean squared distance, metres.
    pub fn root(&self, markers: &[Option<Vector3<f64>>], prior: &[Joint]) -> (Joint, procrustes::Told, f64) {
        let options = Options { reading: Reading::SwingTwist, aim: Aim::Marker, stretch: 0.0 };
        let mut frame =
            Frame { rig: self, markers, prior, options, world: vec![Matrix4::identity(); self.rest.len()], stretches: Vec::new() };
        for &j in &self.order {
            if j == self.top {
                break;
            }
            frame.world[j] = frame.parent(j) * prior[j].matrix();
        }
        let parent = frame.parent(self.top);
        let place = frame.place(self.top, &parent);
        let (from, to) = frame.pairs(&parent, &place);
        let (rotation, told) = procrustes::rotation(&from, &to, &prior[self.top].rotation);
        let misses: Vec<f64> = from.iter().zip(&to).map(|(a, b)| (rotation * a - b).norm_squared()).collect();
        let error = (misses.iter().sum::<f64>() / misses.len().max(1) as f64).sqrt();
        (Joint { translation: place, rotation, scale: self.rest[self.top].scale }, told, error)
    }
}

/// Shorter bones have no direction, metres.
const SHORT: f64 = 1e-9;

/// How long the axes of a map are.
fn lengths(m: &Matrix4<f64>) -> Vector3<f64> {
    Vector3::from_fn(|c, _| m.fixed_view::<3, 1>(0, c).norm())
}

/// A frame that is being solved, joint by joint.
struct Frame<'a> {
    rig: &'a Rig,
    markers: &'a [Option<Vector3<f64>>],
    prior: &'a [Joint],
    options: Options,
    /// World from joint of what is solved.
    world: Vec<Matrix4<f64>>,
    /// How much each marked joint's bone is stretched, and would have to be to reach its marker.
    stretches: Vec<Option<[f64; 2]>>,
}

impl Frame<'_> {
    fn parent(&self, j: usize) -> Matrix4<f64> {
        self.rig.parents[j].map_or_else(Matrix4::identity, |p| self.world[p])
    }

    fn marker(&self, j: usize) -> Option<Vector3<f64>> {
        self.markers.get(j).copied().flatten().filter(|m| m.iter().all(|v| v.is_finite()))
    }

    /// Where a joint stands in its parent's space.
    fn place(&self, j: usize, parent: &Matrix4<f64>) -> Vector3<f64> {
        let inside = |world: Vector3<f64>| parent.try_inverse().map(|m| m.transform_point(&world.into()).coords);
        let is_above = || j == self.rig.top || self.rig.parents[j].is_none() || !self.below_top(j);
        let own = if is_above() { self.prior[j].translation } else { self.rig.rest[j].translation };
        match self.marker(j).filter(|_| self.rig.marked[j]) {
            Some(marker) if j == self.rig.top => inside(marker).unwrap_or(own),
            Some(marker) if self.options.stretch > 0.0 => {
                inside(self.drawn(j, parent.transform_point(&own.into()).coords, marker)).unwrap_or(own)
            }
            _ => own,
        }
    }

    /// Where a stretched bone ends: on its line, as long as it is stretched to; where it is not the bone that its joint points along, on the way to its marker.
    fn drawn(&self, j: usize, own: Vector3<f64>, marker: Vector3<f64>) -> Vector3<f64> {
        let begins = (0..self.stretches.len()).find(|&a| self.rig.bones[a].first().is_some_and(|b| b.end == j));
        let stretch = begins.and_then(|a| Some((self.world[a].fixed_view::<3, 1>(0, 3).into_owned(), self.stretches[a]?)));
        let share = |(from, [stretch, full]): (Vector3<f64>, [f64; 2])| from + (marker - from) * (stretch / full);
        stretch.map_or_else(|| own + (marker - own) * self.options.stretch, share)
    }

    fn below_top(&self, mut j: usize) -> bool {
        loop {
            if j == self.rig.top {
                return true;
            }
            match self.rig.parents[j] {
                Some(p) => j = p,
                None => return false,
            }
        }
    }

    /// What the topmost joint is turned from, and to: its bones as they are, and as their markers are, in its parent's space but for its place.
    fn pairs(&self, parent: &Matrix4<f64>, place: &Vector3<f64>) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
        let top = self.rig.top;
        let inverse = parent.try_inverse();
        let wanted = |b: &&Bone| self.rig.fit.is_empty() || self.rig.fit.contains(&b.end);
        let known = |b: &Bone| {
            let to = inverse?.transform_point(&self.marker(b.end)?.into()).coords - place;
            Some((self.rig.rest[top].scale.component_mul(&self.offset(b)), to))
        };
        self.rig.bones[top].iter().filter(wanted).filter_map(known).unzip()
    }

    /// Where a bone ends in its joint's own space, the joints between turned as captured.
    fn offset(&self, bone: &Bone) -> Vector3<f64> {
        self.rig.offset(bone, |k| self.prior[k].rotation)
    }

    fn joint(&mut self, j: usize) -> Joint {
        let parent = self.parent(j);
        let translation = self.place(j, &parent);
        // Where its own marker is not seen, nothing tells how the topmost joint is turned.
        let rotation = if !self.rig.marked[j] || j == self.rig.top && self.marker(j).is_none() {
            self.prior[j].rotation
        } else if j == self.rig.top {
            let (from, to) = self.pairs(&parent, &translation);
            procrustes::rotation(&from, &to, &self.prior[j].rotation).0
        } else {
            self.aimed(j, &parent, &translation).unwrap_or(self.prior[j].rotation)
        };
        let mut joint = Joint { translation, rotation, scale: self.rig.rest[j].scale };
        if self.options.stretch > 0.0 && self.below_top(j) {
            joint.scale = self.scale(j, &parent, &joint);
        }
        self.world[j] = parent * joint.matrix();
        joint
    }

    /// How a joint is turned whose bone points at its end's marker.
    fn aimed(&self, j: usize, parent: &Matrix4<f64>, place: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
        let bone = self.rig.bones[j].first()?;
        let rest = &self.rig.rest[j];
        let along = rest.scale.component_mul(&self.offset(bone));
        let inside = |world: Vector3<f64>| Some(parent.try_inverse()?.transform_point(&world.into()).coords);
        let from = match self.options.aim {
            Aim::Bone => self.marker(j).and_then(inside).unwrap_or(*place),
            Aim::Marker => *place,
        };
        let to = inside(self.marker(bone.end)?)? - from;
        (along.norm() >= SHORT && to.norm() >= SHORT)
            .then(|| turned(self.options.reading, &rest.rotation, &along, &self.prior[j].rotation, &to))
    }

    /// The scale of a joint whose bone is stretched: along the bone as much, across it so much less that it keeps its volume, and without what its parents
    /// have. Where the bone lies between the joint's axes, as near as those come to it.
    fn scale(&mut self, j: usize, parent: &Matrix4<f64>, joint: &Joint) -> Vector3<f64> {
        let own = Joint { scale: Vector3::repeat(1.0), ..*joint };
        let inherited = lengths(&(parent * own.matrix()));
        let wanted = self.bone(j, parent, joint).map_or(Vector3::repeat(1.0), |(stretch, along)| {
            let across = 1.0 / stretch.sqrt();
            along.normalize().map(|v| across + (stretch - across) * v * v)
        });
        wanted.component_mul(&self.rig.sizes[j]).component_div(&inherited).map(|s| if s.is_finite() && s > 0.0 { s } else { 1.0 })
    }

    /// How much the bone that a joint is part of is stretched, and where it goes in the joint's own space.
    fn bone(&mut self, j: usize, parent: &Matrix4<f64>, joint: &Joint) -> Option<(f64, Vector3<f64>)> {
        if !self.rig.marked[j] {
            // A joint between two marked ones is part of the bone; what branches off is not.
            let begins = (0..self.stretches.len()).find(|&a| self.rig.bones[a].first().is_some_and(|b| b.path.contains(&j)))?;
            let path = &self.rig.bones[begins].first()?.path;
            let next = path.iter().position(|k| *k == j).and_then(|at| path.get(at + 1))?;
            let along = self.rig.rest[*next].translation;
            return (along.norm() >= SHORT).then_some((self.stretches[begins]?[0], along));
        }
        // The pelvis is no bone.
        let bone = self.rig.bones[j].first().filter(|_| j != self.rig.top)?;
        let along = self.offset(bone);
        let at = parent.transform_point(&joint.translation.into());
        let to = (self.marker(bone.end)? - at.coords).norm();
        let long = along.component_mul(&self.rig.sizes[j]).norm();
        if long < SHORT || to < SHORT {
            return None;
        }
        let stretch = libm::pow(to / long, self.options.stretch);
        self.stretches[j] = Some([stretch, to / long]);
        Some((stretch, along))
    }
}
