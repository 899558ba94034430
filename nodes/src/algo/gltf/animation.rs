//! The animations of a glTF file, sampled at a time.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::accessor::{FLOAT, REAL};
use super::error::{GltfError, item, malformed};
use super::{Document, Pick, Rig, json, listed};
use crate::algo::rotation::slerp;
use crate::algo::skeleton::Joint;

/// How values go from key to key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interpolation {
    Step,
    Linear,
    Cubic,
}

/// What a channel moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Path {
    Translation,
    Rotation,
    Scale,
    Weights,
}

struct Track {
    node: usize,
    path: Path,
    interpolation: Interpolation,
    /// Seconds, ascending.
    times: Vec<f64>,
    /// `width` numbers a key; of a cubic spline three times as many: tangent in, value, tangent out.
    values: Vec<f64>,
    width: usize,
}

/// Animations of a file, ready to be sampled.
pub struct Sample {
    tracks: Vec<Track>,
}

impl Track {
    /// Holds keys against what can be followed.
    fn check(&self) -> Result<(), String> {
        let (times, values) = (&self.times, &self.values);
        if times.is_empty() {
            return Err("expected a key at least, found none".to_owned());
        }
        if let Some(k) = times.iter().position(|t| !t.is_finite()) {
            return Err(format!("key {k}: expected a finite time, found {}", times[k]));
        }
        if let Some(k) = times.windows(2).position(|w| w[0] >= w[1]) {
            return Err(format!("key {}: expected times that ascend, found {} after {}", k + 1, times[k + 1], times[k]));
        }
        let each = self.width * if self.interpolation == Interpolation::Cubic { 3 } else { 1 };
        if values.len() != times.len() * each {
            return Err(format!("expected {} numbers for {} keys, found {}", times.len() * each, times.len(), values.len()));
        }
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(format!("key {}: expected finite numbers, found {}", i / each, values[i]));
        }
        let still = |k: &usize| self.path == Path::Rotation && self.value(*k).iter().map(|v| v * v).sum::<f64>() < 1e-12;
        match (0..times.len()).find(still) {
            Some(k) => Err(format!("key {k}: expected a unit quaternion, found one without length")),
            None => Ok(()),
        }
    }

    fn key(&self, k: usize, part: usize) -> &[f64] {
        let parts = if self.interpolation == Interpolation::Cubic { 3 } else { 1 };
        let start = (k * parts + part.min(parts - 1)) * self.width;
        &self.values[start..start + self.width]
    }

    /// The value of key `k`.
    fn value(&self, k: usize) -> &[f64] {
        self.key(k, 1)
    }

    /// The value at a time; held before the first key and after the last.
    fn at(&self, seconds: f64) -> Vec<f64> {
        // Times are of 32 bits: a step that was written for a frame must not come after it.
        let seconds = if self.interpolation == Interpolation::Step { seconds + 1e-5 } else { seconds };
        let after = self.times.partition_point(|t| *t <= seconds);
        if after == 0 || after == self.times.len() {
            return self.value(after.saturating_sub(1)).to_vec();
        }
        let (k, span) = (after - 1, self.times[after] - self.times[after - 1]);
        let t = (seconds - self.times[k]) / span;
        let (a, b) = (self.value(k), self.value(after));
        match (self.interpolation, self.path, a, b) {
            (Interpolation::Step, ..) => a.to_vec(),
            (Interpolation::Linear, Path::Rotation, [ax, ay, az, aw], [bx, by, bz, bw]) => {
                let unit = |x: &f64, y: &f64, z: &f64, w: &f64| UnitQuaternion::new_normalize(Quaternion::new(*w, *x, *y, *z));
                slerp(&unit(ax, ay, az, aw), &unit(bx, by, bz, bw), t).coords.as_slice().to_vec()
            }
            (Interpolation::Linear, ..) => a.iter().zip(b).map(|(a, b)| a + (b - a) * t).collect(),
            (Interpolation::Cubic, ..) => {
                let (out, into) = (self.key(k, 2), self.key(after, 0));
                let (t2, t3) = (t * t, t * t * t);
                let hermite = |i: usize| {
                    (2.0 * t3 - 3.0 * t2 + 1.0) * a[i]
                        + span * (t3 - 2.0 * t2 + t) * out[i]
                        + (3.0 * t2 - 2.0 * t3) * b[i]
                        + span * (t3 - t2) * into[i]
                };
                (0..self.width).map(hermite).collect()
            }
        }
    }
}

impl Document {
    /// The animations that are named, or the first where `picks` is none. Of two that move the same the later wins.
    ///
    /// # Errors
    /// Where one is not there, or its keys are out of order or too few.
    pub fn sample(&self, picks: Option<&[Pick]>) -> Result<Sample, GltfError> {
        let animations = &self.root.animations;
        let mut tracks = Vec::new();
        let chosen = match picks {
            None => (0..animations.len().min(1)).collect(),
            Some(picks) => picks.iter().map(|p| self.animation(p)).collect::<Result<Vec<_>, _>>()?,
        };
        for a in chosen {
            for c in 0..animations[a].channels.len() {
                tracks.extend(self.track(a, c)?);
            }
        }
        Ok(Sample { tracks })
    }

    fn animation(&self, pick: &Pick) -> Result<usize, GltfError> {
        let animations = &self.root.animations;
        let found = animations.iter().enumerate().position(|(i, a)| pick.is(i, a.name.as_deref()));
        found.ok_or_else(|| {
            let names = listed(animations.iter().map(|a| a.name.as_deref()));
            GltfError::NoSuch(format!("expected an animation of the file, found {pick}; there are {names}"))
        })
    }

    fn track(&self, animation: usize, channel: usize) -> Result<Option<Track>, GltfError> {
        let animation_at = format!("animations[{animation}]");
        let animation = item(&self.root.animations, "animations", animation, "animations")?;
        let at = format!("{animation_at}.channels[{channel}]");
        let channel = item(&animation.channels, "channels", channel, &at)?;
        let path = match channel.target.path.as_str() {
            "translation" => Path::Translation,
            "rotation" => Path::Rotation,
            "scale" => Path::Scale,
            "weights" => Path::Weights,
            // That of KHR_animation_pointer moves nothing that is read.
            "pointer" => return Ok(None),
            other => {
                let message = format!("expected the path translation, rotation, scale or weights, found {other:?}");
                return Err(malformed(format!("{at}.target"), message));
            }
        };
        let Some(node) = channel.target.node else { return Ok(None) };
        let targets = self.n_targets(item(&self.root.nodes, "nodes", node, &at)?)?;
        let sampler = item(&animation.samplers, "samplers", channel.sampler, &at)?;
        let at = format!("{animation_at}.samplers[{}]", channel.sampler);
        let interpolation = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => Interpolation::Linear,
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::Cubic,
            Some(other) => return Err(malformed(at, format!("expected LINEAR, STEP or CUBICSPLINE, found {other:?}"))),
        };
        let (width, shape) = match path {
            Path::Translation | Path::Scale => (3, "VEC3"),
            Path::Rotation => (4, "VEC4"),
            Path::Weights => (targets, "SCALAR"),
        };
        let times = self.numbers(sampler.input, &["SCALAR"], FLOAT, &at)?;
        let values = self.numbers(sampler.output, &[shape], REAL, &at)?;
        let track = Track { node, path, interpolation, times, values, width };
        track.check().map_err(|message| malformed(at, message))?;
        Ok(Some(track))
    }

    /// Morph targets of a node's mesh.
    fn n_targets(&self, node: &json::Node) -> Result<usize, GltfError> {
        let Some(mesh) = node.mesh else { return Ok(0) };
        let mesh = item(&self.root.meshes, "meshes", mesh, "nodes")?;
        Ok(mesh.primitives.first().map_or(0, |p| p.targets.len()))
    }
}

impl Sample {
    /// Seconds to the last key.
    pub fn duration(&self) -> f64 {
        self.tracks.iter().filter_map(|t| t.times.last()).fold(0.0, |a, b| a.max(*b))
    }

    /// Every joint of a rig at a time.
    pub fn pose(&self, rig: &Rig, seconds: f64) -> Vec<Joint> {
        let mut joints = rig.rest.clone();
        for track in &self.tracks {
            let Some(joint) = rig.joints.get(track.node).copied().flatten().and_then(|j| joints.get_mut(j)) else { continue };
            match (track.path, &track.at(seconds)[..]) {
                (Path::Translation, [x, y, z]) => joint.translation = Vector3::new(*x, *y, *z),
                (Path::Scale, [x, y, z]) => joint.scale = Vector3::new(*x, *y, *z),
                (Path::Rotation, [x, y, z, w]) => {
                    // A spline may pass through nought, where nothing is turned.
                    joint.rotation = UnitQuaternion::try_new(Quaternion::new(*w, *x, *y, *z), 1e-12).unwrap_or_default();
                }
                _ => {}
            }
        }
        joints
    }

    /// Weights of the morph targets of a node at a time; `None` where nothing moves them.
    pub(super) fn weights(&self, node: usize, seconds: f64) -> Option<Vec<f64>> {
        self.tracks.iter().rev().find(|t| t.node == node && t.path == Path::Weights).map(|t| t.at(seconds))
    }
}
