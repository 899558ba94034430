//! Skeletons and their motion as BVH text.
//!
//! In BVH nothing is turned at rest. So the offsets are those between the joints as they rest in the world, and a joint's rotation is how far it has
//! turned from there, in the world's axes, seen from its parent: D = W W_rest⁻¹, channel rotation = D_parent⁻¹ D. A figure that was read from BVH comes out
//! as it went in.

use std::fmt::Write as _;

use nalgebra::{Matrix3, Matrix4, UnitQuaternion, Vector3};
use pegbar_engine::Setting;
use thiserror::Error;

use crate::algo::skeleton::{Joint, TreeError, order, world_from_joint};

/// The order of a joint's rotations: the first is leftmost in the product, and first in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Order {
    /// Z, X, Y: what most programs write.
    Zxy,
    /// Z, Y, X: Carnegie Mellon's.
    Zyx,
    /// X, Y, Z.
    Xyz,
    /// X, Z, Y.
    Xzy,
    /// Y, X, Z.
    Yxz,
    /// Y, Z, X.
    Yzx,
}

impl Order {
    /// The axes from left to right.
    pub fn axes(self) -> [usize; 3] {
        match self {
            Order::Zxy => [2, 0, 1],
            Order::Zyx => [2, 1, 0],
            Order::Xyz => [0, 1, 2],
            Order::Xzy => [0, 2, 1],
            Order::Yxz => [1, 0, 2],
            Order::Yzx => [1, 2, 0],
        }
    }
}

/// Which joints have channels for their place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Channels {
    /// Roots, and joints that do more than turn.
    Auto,
    /// Roots alone; a joint that does more than turn is an error.
    Roots,
    /// All joints.
    All,
}

/// What is written.
#[derive(Clone, Copy, Debug)]
pub struct Export<'a> {
    /// Parent of each joint, -1 for a root.
    pub parents: &'a [i64],
    /// Name of each joint.
    pub names: &'a [String],
    /// Each joint at rest in its parent's space, metres.
    pub rest: &'a [Joint],
    /// The joints at each frame.
    pub frames: &'a [Vec<Joint>],
    /// Frames a second.
    pub fps: f64,
    /// Metres a unit of the file.
    pub scale: f64,
    /// The order of rotations.
    pub order: Order,
    /// Which joints have channels for their place.
    pub channels: Channels,
}

/// Why a figure cannot be written.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BvhWriteError {
    /// No joint or no frame.
    #[error("expected at least one joint and one frame, found {joints} and {frames}")]
    Empty {
        /// Number of joints.
        joints: usize,
        /// Number of frames.
        frames: usize,
    },
    /// Lists of different lengths.
    #[error("expected a name, a rest and a pose for each of {joints} joints, found others{at}")]
    Counts {
        /// Number of joints.
        joints: usize,
        /// ` at frame ...` of the sequence, from 0.
        at: String,
    },
    /// Parents that make no tree.
    #[error("{0}")]
    Tree(#[from] TreeError),
    /// A name that would break the file.
    #[error("expected joints' names in one line without braces, found {name:?}")]
    Name {
        /// The name.
        name: String,
    },
    /// A joint that does more than turn, where it may not.
    #[error("joint `{name}`: expected it to turn alone, found it {distance} m from its place at position {frame} of the sequence")]
    Moves {
        /// The joint.
        name: String,
        /// Of the sequence, from 0.
        frame: usize,
        /// How far.
        distance: f64,
    },
    /// A place that is no number.
    #[error("joint `{name}`: expected a finite place, found another at position {frame} of the sequence")]
    NotFinite {
        /// The joint.
        name: String,
        /// Of the sequence, from 0.
        frame: usize,
    },
}

/// Where each joint is in the world, and how far it has turned from rest.
struct World {
    places: Vec<Vector3<f64>>,
    turns: Vec<UnitQuaternion<f64>>,
}

impl Export<'_> {
    fn parent(&self, joint: usize) -> Option<usize> {
        usize::try_from(self.parents[joint]).ok()
    }

    fn world(&self, joints: &[Joint], order: &[usize]) -> Result<World, TreeError> {
        let local: Vec<Matrix4<f64>> = joints.iter().map(Joint::matrix).collect();
        let places = world_from_joint(self.parents, &local)?.iter().map(|m| m.fixed_view::<3, 1>(0, 3).into_owned()).collect();
        let mut turns: Vec<_> = joints.iter().map(|j| j.rotation).collect();
        for &j in order {
            if let Some(parent) = self.parent(j) {
                turns[j] = turns[parent] * joints[j].rotation;
            }
        }
        Ok(World { places, turns })
    }

    /// Joints as a file has them: each right after what hangs on its elder siblings.
    fn depth_first(&self) -> Vec<usize> {
        let mut children = vec![Vec::new(); self.parents.len()];
        let mut stack = Vec::new();
        for j in (0..self.parents.len()).rev() {
            self.parent(j).map_or(&mut stack, |p| &mut children[p]).push(j);
        }
        let mut listed = Vec::new();
        while let Some(j) = stack.pop() {
            listed.push(j);
            stack.append(&mut children[j]);
        }
        listed
    }

    fn check(&self) -> Result<(), BvhWriteError> {
        let joints = self.parents.len();
        if joints == 0 || self.frames.is_empty() {
            return Err(BvhWriteError::Empty { joints, frames: self.frames.len() });
        }
        if self.names.len() != joints || self.rest.len() != joints {
            return Err(BvhWriteError::Counts { joints, at: String::new() });
        }
        if let Some(k) = self.frames.iter().position(|f| f.len() != joints) {
            return Err(BvhWriteError::Counts { joints, at: format!(" at position {k} of the sequence") });
        }
        let broken = |n: &&String| n.trim().is_empty() || n.contains(['{', '}', '\n', '\r']);
        self.names.iter().find(broken).map_or(Ok(()), |n| Err(BvhWriteError::Name { name: n.clone() }))
    }
}

/// What the file says of each frame.
struct Frames {
    /// Each joint's turn, seen from its parent.
    turns: Vec<Vec<UnitQuaternion<f64>>>,
    /// Each joint's place, seen from its parent, metres.
    places: Vec<Vec<Vector3<f64>>>,
    /// Each joint's place at rest, likewise.
    offsets: Vec<Vector3<f64>>,
    /// Joints that do more than turn.
    moves: Vec<Option<(usize, f64)>>,
}

fn frames(export: &Export) -> Result<Frames, BvhWriteError> {
    let order = order(export.parents)?;
    let rest = export.world(export.rest, &order)?;
    let from_parent = |world: &World, j: usize| export.parent(j).map_or(world.places[j], |p| world.places[j] - world.places[p]);
    let offsets: Vec<Vector3<f64>> = (0..export.parents.len()).map(|j| from_parent(&rest, j)).collect();
    let size = offsets.iter().map(|o| o.amax()).fold(1e-9, f64::max);
    let (mut turns, mut places, mut moves) = (Vec::new(), Vec::new(), vec![None; offsets.len()]);
    for (frame, joints) in export.frames.iter().enumerate() {
        let mut world = export.world(joints, &order)?;
        world.turns.iter_mut().zip(&rest.turns).for_each(|(now, rest)| *now *= rest.inverse());
        let of_parent = |j: usize| export.parent(j).map_or_else(UnitQuaternion::identity, |p| world.turns[p].inverse());
        turns.push((0..offsets.len()).map(|j| of_parent(j) * world.turns[j]).collect());
        let own: Vec<Vector3<f64>> = (0..offsets.len()).map(|j| of_parent(j) * from_parent(&world, j)).collect();
        for (j, place) in own.iter().enumerate() {
            let distance = (place - offsets[j]).norm();
            if !distance.is_finite() {
                return Err(BvhWriteError::NotFinite { name: export.names[j].clone(), frame });
            }
            if export.parent(j).is_some() && distance > 1e-9 * size {
                moves[j] = moves[j].or(Some((frame, distance))).filter(|m| m.1 >= distance).or(Some((frame, distance)));
            }
        }
        places.push(own);
    }
    Ok(Frames { turns, places, offsets, moves })
}

/// Angles of rotations in an order, radians: of the two triples, and their full turns, the nearest to `before`, so that curves do not jump.
fn angles(turn: &UnitQuaternion<f64>, axes: [usize; 3], before: [f64; 3]) -> [f64; 3] {
    use std::f64::consts::{PI, TAU};
    let [i, j, k] = axes;
    let e = if (i + 1) % 3 == j { 1.0 } else { -1.0 };
    let m: Matrix3<f64> = turn.to_rotation_matrix().into_inner();
    let upright = libm::hypot(m[(i, i)], m[(i, j)]);
    // With the middle axis a quarter turned the outer two turn about one line: the first then stays as it was.
    let first = if upright < 1e-10 { before[0] } else { libm::atan2(-e * m[(j, k)], m[(k, k)]) };
    let middle = libm::atan2(e * m[(i, k)], upright);
    let third = |first: f64| {
        let (s, c) = libm::sincos(first);
        let row = |column: usize| c * m[(j, column)] + e * s * m[(k, column)];
        libm::atan2(e * row(i), row(j))
    };
    let near = |angle: f64, to: f64| angle + ((to - angle) / TAU).round() * TAU;
    let other = if upright < 1e-10 { first } else { first + PI };
    let triples = [[first, middle, third(first)], [other, if upright < 1e-10 { middle } else { PI - middle }, third(other)]];
    let triples = triples.map(|t| [0, 1, 2].map(|a| near(t[a], before[a])));
    let far = |t: &[f64; 3]| (0..3).map(|a| (t[a] - before[a]).abs()).sum::<f64>();
    if far(&triples[1]) < far(&triples[0]) { triples[1] } else { triples[0] }
}

/// A number with at most twelve digits after the point.
fn number(value: f64, out: &mut String) {
    let start = out.len();
    // Writing to a string cannot fail.
    let _ = write!(out, "{value:.12}");
    let kept = out.trim_end_matches('0').trim_end_matches('.').len();
    out.truncate(kept);
    if &out[start..] == "-0" {
        out.replace_range(start.., "0");
    }
}

fn numbers(values: impl IntoIterator<Item = f64>, out: &mut String) {
    for value in values {
        out.push(' ');
        number(value, out);
    }
}

/// How a joint stands in the file.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    /// An `End Site`.
    End,
    Turning,
    /// With its place too.
    Moving,
}

/// The text of a file. A leaf that is called `<parent>_end` and never moves is an `End Site`, as it is read; other leaves get one of no length, without
/// which many programs do not read the file. O(joints · depth · frames).
///
/// # Errors
/// Where lists do not fit together, a name would break the file, or a joint does more than turn and may not.
pub fn write(export: &Export) -> Result<String, BvhWriteError> {
    export.check()?;
    let found = frames(export)?;
    let listed = export.depth_first();
    let forms = forms(export, &found)?;
    let mut out = String::from("HIERARCHY\n");
    hierarchy(export, &found.offsets, &forms, &listed, &mut out);
    out.push_str("MOTION\n");
    let _ = writeln!(out, "Frames: {}", export.frames.len());
    out.push_str("Frame Time:");
    numbers([1.0 / export.fps], &mut out);
    out.push('\n');
    let mut before = vec![[0.0; 3]; export.parents.len()];
    for (turns, places) in found.turns.iter().zip(&found.places) {
        let start = out.len();
        for &j in listed.iter().filter(|&&j| forms[j] != Form::End) {
            if forms[j] == Form::Moving {
                numbers(places[j].iter().map(|v| v / export.scale), &mut out);
            }
            before[j] = angles(&turns[j], export.order.axes(), before[j]);
            numbers(before[j].map(f64::to_degrees), &mut out);
        }
        out.replace_range(start..=start, "");
        out.push('\n');
    }
    Ok(out)
}

fn forms(export: &Export, found: &Frames) -> Result<Vec<Form>, BvhWriteError> {
    let mut is_leaf = vec![true; export.parents.len()];
    (0..is_leaf.len()).filter_map(|j| export.parent(j)).for_each(|p| is_leaf[p] = false);
    let form = |j: usize| {
        let moves = found.moves[j];
        let Some(parent) = export.parent(j) else { return Ok(Form::Moving) };
        let rests = || found.turns.iter().all(|t| t[j].vector().norm() < 1e-9);
        if is_leaf[j] && moves.is_none() && is_end_name(&export.names[j], &export.names[parent]) && rests() {
            return Ok(Form::End);
        }
        match (export.channels, moves) {
            (Channels::Auto, None) | (Channels::Roots, None) => Ok(Form::Turning),
            (Channels::Roots, Some((frame, distance))) => Err(BvhWriteError::Moves { name: export.names[j].clone(), frame, distance }),
            (Channels::Auto | Channels::All, _) => Ok(Form::Moving),
        }
    };
    (0..is_leaf.len()).map(form).collect()
}

/// True for `<parent>_end`, with a number after it too.
fn is_end_name(name: &str, parent: &str) -> bool {
    let tail = name.strip_prefix(parent).and_then(|n| n.strip_prefix("_end"));
    tail.is_some_and(|t| t.is_empty() || t.strip_prefix('_').is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit())))
}

fn hierarchy(export: &Export, offsets: &[Vector3<f64>], forms: &[Form], listed: &[usize], out: &mut String) {
    let mut open: Vec<usize> = Vec::new();
    let mut indent = String::new();
    let close = |indent: &mut String, out: &mut String| {
        indent.pop();
        let _ = writeln!(out, "{indent}}}");
    };
    for (place, &j) in listed.iter().enumerate() {
        while open.last().is_some_and(|&top| export.parent(j) != Some(top)) {
            open.pop();
            close(&mut indent, out);
        }
        let _ = match (forms[j], export.parent(j)) {
            (Form::End, _) => writeln!(out, "{indent}End Site"),
            (_, None) => writeln!(out, "{indent}ROOT {}", export.names[j].trim()),
            (_, Some(_)) => writeln!(out, "{indent}JOINT {}", export.names[j].trim()),
        };
        let _ = writeln!(out, "{indent}{{");
        indent.push('\t');
        let _ = write!(out, "{indent}OFFSET");
        numbers(offsets[j].iter().map(|v| v / export.scale), out);
        out.push('\n');
        if forms[j] == Form::End {
            close(&mut indent, out);
            continue;
        }
        let rotations = export.order.axes().map(|a| ["Xrotation", "Yrotation", "Zrotation"][a]).join(" ");
        let _ = match forms[j] {
            Form::Moving => writeln!(out, "{indent}CHANNELS 6 Xposition Yposition Zposition {rotations}"),
            _ => writeln!(out, "{indent}CHANNELS 3 {rotations}"),
        };
        if listed.get(place + 1).is_none_or(|&next| export.parent(next) != Some(j)) {
            let _ = writeln!(out, "{indent}End Site\n{indent}{{\n{indent}\tOFFSET 0 0 0\n{indent}}}");
        }
        open.push(j);
    }
    while open.pop().is_some() {
        close(&mut indent, out);
    }
}
