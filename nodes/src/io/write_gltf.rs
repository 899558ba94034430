//! `io.write_gltf`: a character and its motion to glTF 2.0, as `.glb` or `.gltf`.
//!
//! A skinned mesh is written with its skeleton and a key for each frame of its poses. A mesh with morph targets is written with a key for each frame of
//! their weights; both may be together. A stream of plain meshes is baked: each frame that differs from the one before becomes a morph target, and
//! weights that hold until the next frame show them one after the other, so that any reader plays it as it is, on twos as well. The file holds its
//! numbers and its texture itself, is written beside its place and renamed, so that it is there whole or not at all.
//!
//! **Source**: Khronos Group, *glTF 2.0 Specification*, 2021. **Fails when** there is nothing to see, a number is not finite, the frames of a stream are
//! meshes of different kinds, or the file cannot be written. **Cost**: O(bytes); the file is made in memory, and for baked meshes every drawing.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "otter": (type: "io.read_gltf", path: "otter.glb"),
//!     "out": (type: "io.write_gltf", mesh: "@otter.mesh", skeleton: "@otter.skeleton", pose: "@otter.pose", path: "$out/otter.glb"),
//! })
//! ```

use pegbar_engine::clock::Clock;
use pegbar_engine::node::{AnySequence, Context, Fault, In, NodeError, Problem, Sequence, Whole};
use pegbar_engine::setting::OutputPath;
use pegbar_engine::value::downcast;
use pegbar_engine::{Node, Setting};

use super::gltf::refused;
use super::{file, picture};
use crate::algo::codec::{self, ColorMode, EncodeOptions, Format};
use crate::algo::gltf::{self, Animated, Export, Skin, Surface, Target};
use crate::algo::skeleton::Joint;
use crate::data::{Image, Mesh, MorphTargets, Pose, Skeleton, SkinnedMesh, Weights};

/// How a reader goes from one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Between {
    /// Straight for poses and weights, held for baked meshes.
    Auto,
    /// Straight from one to the next.
    Linear,
    /// Each is held until the next: drawn animation.
    Step,
}

/// Writes a character and its motion: `.glb`, or `.gltf` with its bytes inside.
#[derive(Node)]
#[node(
    id = "io.write_gltf",
    version = 1,
    kind = whole,
    source = "glTF 2.0 Specification",
    example = "\"out\": (type: \"io.write_gltf\", mesh: \"@skin.mesh\", path: \"$out/otter.glb\")"
)]
pub(crate) struct IoWriteGltf {
    /// The surface: one `SkinnedMesh`, one `Mesh`, or a stream of meshes, which is baked.
    mesh: AnySequence,
    /// The joints of a skinned mesh.
    skeleton: Option<In<Skeleton>>,
    /// What the joints do. They rest where it is left out.
    pose: Option<Sequence<Pose>>,
    /// What the mesh is morphed to.
    morphs: Option<In<MorphTargets>>,
    /// How much of each morph target. None of any where it is left out.
    weights: Option<Sequence<Weights>>,
    /// A texture, linear light, premultiplied; it is written as 8-bit sRGB, where the mesh has texture coordinates for it to lie by.
    texture: Option<In<Image>>,
    /// The file, inside the output folder, ending in .glb or .gltf.
    path: OutputPath,
    /// How a reader goes from one frame to the next.
    #[input(default = auto)]
    interpolation: Between,
    /// The character's name in the file.
    #[input(default = "character")]
    name: String,
}

fn is_binary(path: &std::path::Path) -> Result<bool, String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match extension.as_str() {
        "glb" => Ok(true),
        "gltf" => Ok(false),
        other => Err(format!("expected a path ending in .glb or .gltf, found {other:?}")),
    }
}

fn surface(mesh: &Mesh) -> Surface<'_> {
    Surface { positions: &mesh.positions, triangles: &mesh.triangles, uvs: &mesh.uvs, normals: &mesh.normals, colors: &mesh.colors }
}

fn targets(morphs: &MorphTargets, vertices: usize) -> Result<Vec<Target>, NodeError> {
    let (m, v) = (morphs.n_targets(), morphs.n_vertices());
    if m > 0 && v != vertices {
        return Err(NodeError::input(format!("morphs: expected {vertices} vertices, those of the mesh, found {v}")));
    }
    let name = |k: usize| morphs.names.get(k).cloned().unwrap_or_else(|| format!("target {k}"));
    let target = |k| Target { name: name(k), positions: morphs.target(k).to_vec(), normals: morphs.target_normals(k).to_vec() };
    Ok((0..m).map(target).collect())
}

/// A sequence of meshes as the first, a target for each that differs from those before it, and weights that show them.
struct Baked {
    first: Mesh,
    targets: Vec<Target>,
    weights: Vec<Vec<f64>>,
}

fn difference(a: &[[f64; 3]], b: &[[f64; 3]]) -> Vec<[f64; 3]> {
    a.iter().zip(b).map(|(a, b)| [a[0] - b[0], a[1] - b[1], a[2] - b[2]]).collect()
}

impl IoWriteGltf {
    fn bake(&self, clock: &Clock, cx: &Context) -> Result<Baked, NodeError> {
        let get = |k: usize| {
            let mesh = downcast::<Mesh>(self.mesh.get(k)?).ok_or_else(wrong_type)?;
            mesh.validate().map_err(|e| NodeError::input(format!("mesh at frame {}: {e}", clock.first + k as i64)))?;
            Ok::<_, NodeError>(mesh)
        };
        let first = get(0)?;
        // Place of each frame among the drawings; 0 is the first.
        let (mut shown, mut targets, mut before) = (vec![0], Vec::new(), first.clone());
        for k in 1..self.mesh.len() {
            cx.check()?;
            let mesh = get(k)?;
            if mesh.triangles != first.triangles
                || mesh.positions.len() != first.positions.len()
                || mesh.normals.len() != first.normals.len()
            {
                let frame = clock.first + k as i64;
                let error =
                    NodeError::input(format!("mesh at frame {frame}: expected the vertices and triangles of the first, found others"));
                return Err(error.help("write each frame as a file of its own, with #### in the path"));
            }
            let is_as_first = mesh.positions == first.positions && mesh.normals == first.normals;
            if is_as_first {
                shown.push(0);
            } else if mesh.positions == before.positions && mesh.normals == before.normals {
                shown.push(shown[k - 1]);
            } else {
                targets.push(Target {
                    name: format!("frame {}", clock.first + k as i64),
                    positions: difference(&mesh.positions, &first.positions),
                    normals: difference(&mesh.normals, &first.normals),
                });
                shown.push(targets.len());
            }
            before = mesh;
        }
        let n = targets.len();
        let weights = shown.into_iter().map(|s| (1..=n).map(|t| f64::from(u8::from(t == s))).collect()).collect();
        Ok(Baked { first: first.as_ref().clone(), targets, weights })
    }

    fn poses(&self, joints: usize) -> Result<Vec<Vec<Joint>>, NodeError> {
        let Some(poses) = &self.pose else { return Ok(Vec::new()) };
        let first = poses.clock().map_or(0, |c| c.first);
        let pose = |k: usize| {
            let refused = |m: String| NodeError::input(format!("pose at frame {}: {m}", first + k as i64));
            let pose = poses.get(k)?.joints().map_err(refused)?;
            if pose.len() == joints { Ok(pose) } else { Err(refused(format!("expected {joints} joints, found {}", pose.len()))) }
        };
        (0..poses.len()).map(pose).collect()
    }

    fn weights(&self, targets: usize) -> Result<Vec<Vec<f64>>, NodeError> {
        let Some(weights) = &self.weights else { return Ok(Vec::new()) };
        let one = |k: usize| {
            let own = weights.get(k)?.weights.clone();
            let message = || format!("weights: expected {targets}, one for each morph target, found {}", own.len());
            if own.len() == targets { Ok(own) } else { Err(NodeError::input(message())) }
        };
        (0..weights.len()).map(one).collect()
    }

    /// PNG bytes, and whether anything shows through.
    fn png(&self) -> Result<Option<(Vec<u8>, bool)>, NodeError> {
        let Some(texture) = &self.texture else { return Ok(None) };
        let image = texture.in_display()?.into_owned();
        let clear = image.alpha().is_some_and(|a| image.samples().iter().skip(a).step_by(image.n_channels()).any(|v| *v < 1.0));
        let options = EncodeOptions { color: ColorMode::Auto, threads: 1, ..EncodeOptions::new(Format::Png) };
        let bytes = codec::encode_to_vec(&picture::to_picture(image)?, &options).map_err(|e| NodeError::input(format!("texture: {e}")))?;
        Ok(Some((bytes, clear)))
    }

    /// Frames a second of what is written.
    fn fps(&self) -> f64 {
        let clocks = [self.pose.as_ref().and_then(Sequence::clock), self.weights.as_ref().and_then(Sequence::clock), self.mesh.clock()];
        clocks.into_iter().flatten().next().map_or(24.0, Clock::rate)
    }

    fn write(&self, export: &Export) -> Result<(), NodeError> {
        let path = self.path.at(0);
        let bytes = gltf::write(export).map_err(|e| refused(&path, &e))?;
        file::write(&path, Fault::Io, |out| std::io::Write::write_all(out, &bytes))
    }
}

fn wrong_type() -> NodeError {
    NodeError::input("mesh: expected a SkinnedMesh, a Mesh, or a stream of Mesh, found another type")
}

impl Whole for IoWriteGltf {
    fn check(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        if let Err(message) = is_binary(&self.path.at(0)) {
            problems.push(Problem { input: "path", message });
        }
        if self.path.is_sequence() {
            problems.push(Problem { input: "path", message: "expected one file, found a frame number as #### in its path".to_owned() });
        }
        problems
    }

    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let binary = is_binary(&self.path.at(0)).map_err(|m| NodeError::new(Fault::Parameters, m))?;
        let png = self.png()?;
        let (step, baked_step) = (self.interpolation == Between::Step, self.interpolation != Between::Linear);
        let animated = |poses, weights, steps| Animated { fps: self.fps(), poses, weights, steps };
        let texture = png.as_ref().map(|(bytes, clear)| (&bytes[..], *clear));
        let export = Export {
            name: &self.name,
            texture,
            binary,
            text: self.path.origin().map(|origin| (pegbar_engine::origin::KEY, origin.as_ref())),
            surface: Surface::default(),
            skin: None,
            targets: &[],
            animated: Animated::default(),
        };
        if let Some(clock) = self.mesh.clock() {
            let baked = self.bake(clock, cx)?;
            let animated = animated(&[], &baked.weights, [step, baked_step]);
            return self.write(&Export { surface: surface(&baked.first), targets: &baked.targets, animated, ..export });
        }
        let value = self.mesh.get(0)?;
        let (mesh, skinned) = match downcast::<SkinnedMesh>(value.clone()) {
            Some(skinned) => (skinned.rest(), Some(skinned)),
            None => (downcast::<Mesh>(value).ok_or_else(wrong_type)?.as_ref().clone(), None),
        };
        mesh.validate().map_err(|e| NodeError::input(format!("mesh: {e}")))?;
        let targets = self.morphs.as_deref().map_or_else(|| Ok(Vec::new()), |m| targets(m, mesh.positions.len()))?;
        let weights = self.weights(targets.len())?;
        let Some(skinned) = skinned else {
            let animated = animated(&[], &weights, [step; 2]);
            return self.write(&Export { surface: surface(&mesh), targets: &targets, animated, ..export });
        };
        let skeleton =
            self.skeleton.as_deref().ok_or_else(|| NodeError::input("skeleton: expected the joints of the skinned mesh, found none"))?;
        let rest = rest_joints(skeleton)?;
        let (poses, inverse_bind) = (self.poses(rest.len())?, skinned.inverse_bind());
        let skin = Skin {
            influences: skinned.joints.shape()[1],
            joints: skinned.joints.data(),
            weights: skinned.weights.data(),
            inverse_bind: &inverse_bind,
            parents: &skeleton.parents,
            rest: &rest,
            names: &skeleton.names,
        };
        let animated = animated(&poses, &weights, [step; 2]);
        self.write(&Export { surface: surface(&mesh), skin: Some(skin), targets: &targets, animated, ..export })
    }
}

/// Every joint at rest, taken apart.
fn rest_joints(skeleton: &Skeleton) -> Result<Vec<Joint>, NodeError> {
    let refused = |j: usize| {
        NodeError::input(format!("skeleton: joint {j}: expected a translation, rotation and scale at rest, found another matrix"))
    };
    skeleton.rest().iter().enumerate().map(|(j, m)| Joint::from_matrix(m).ok_or_else(|| refused(j))).collect()
}
