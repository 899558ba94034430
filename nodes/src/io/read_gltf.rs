//! `io.read_gltf`: a character with its skeleton, morph targets, texture and motion from glTF 2.0.
//!
//! The meshes that are read become one surface ([`crate::algo::gltf`]): skinned ones keep their joints, rigid ones hang on joints of their own, base
//! colours become vertex colours, and several textures lie in one picture. Animations are sampled at the time of each frame of the node's clock, so that
//! a file of any rate plays in its own time; nothing is rounded to keys.
//!
//! **Source**: Khronos Group, *glTF 2.0 Specification*, 2021. **Fails when** the file is damaged, asks for an extension that is not read (Draco,
//! meshopt), or a part that is named is not there: the error lists those that are. Vertices without any weight are no error, as the format leaves open
//! what moves them: nothing does, as in Blender. **Cost**: O(bytes), and O(joints + targets) a frame.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "otter": (type: "io.read_gltf", path: "otter.glb", animation: "Walk", end: loop),
//!     "skin": (type: "skin.linear_blend", mesh: "@otter.mesh", skeleton: "@otter.skeleton", pose: "@otter.pose"),
//! }, outputs: { "mesh": "@skin" })
//! ```

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, NodeError, Problem, Stream, Whole};
use pegbar_engine::setting::{ClockName, InputPath};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Setting};

use super::gltf::{Picks, atlas, refused, white};
use super::{file, picture};
use crate::algo::codec::{self, ColorMode, DecodeOptions};
use crate::algo::gltf::{Character, Document, GltfError, Rig};
use crate::data::{Image, Mesh, MorphTargets, Pose, Skeleton, SkinnedMesh, Weights};

/// What follows the end of an animation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum End {
    /// Its last pose, held.
    Hold,
    /// The animation over again: a walk cycle.
    Loop,
}

/// Reads a character: `.gltf` or `.glb`.
#[derive(Node)]
#[node(
    id = "io.read_gltf",
    version = 4,
    kind = whole,
    outputs = IoReadGltfOutputs,
    beside = named_beside,
    source = "glTF 2.0 Specification",
    example = "\"otter\": (type: \"io.read_gltf\", path: \"otter.glb\", animation: \"Walk\", end: loop)"
)]
pub(crate) struct IoReadGltf {
    /// The file, from the graph's folder, ending in .gltf or .glb.
    path: InputPath,
    /// The meshes that are read, by their own names, those of their nodes, or their numbers from 0. All that the file's scene shows where it is left out.
    #[input(default = None)]
    mesh: Option<Picks>,
    /// The materials whose surfaces are read, by name or number. All where it is left out.
    #[input(default = None)]
    material: Option<Picks>,
    /// The animations that are played, by name or number; of two that move the same the later wins. The first where it is left out; `[]` for the rest pose.
    #[input(default = None)]
    animation: Option<Picks>,
    /// Time of the animation at the clock's first frame.
    #[input(default = 0.0, range = -86400.0..=86400.0, unit = "s")]
    start: f64,
    /// How fast it plays: 1 as it was made, 2 twice as fast, 0 not at all, negative backwards.
    #[input(default = 1.0, range = -1000.0..=1000.0)]
    speed: f64,
    /// What follows its end.
    #[input(default = hold)]
    end: End,
    /// The clock whose frames it is sampled at; `None` for the graph's own.
    #[input(default = None)]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: Option<ClockName>,
    /// The most samples (width x height x channels) of a texture; more is an error before anything is allocated.
    #[input(default = 1073741824, range = 1..=68719476736u64)]
    max_samples: u64,
}

/// A character.
#[derive(Outputs)]
pub(crate) struct IoReadGltfOutputs {
    /// The surface at rest, metres, Y up, bound to the joints of `skeleton`.
    mesh: SkinnedMesh,
    /// The joints of all the file's meshes, whichever of them are read; parents first.
    skeleton: Skeleton,
    /// Every joint at each frame.
    pose: Stream<Pose>,
    /// What the surface is morphed to: blend shapes. No targets where the file has none.
    morphs: MorphTargets,
    /// How much of each morph target at each frame.
    weights: Stream<Weights>,
    /// The base colour's texture, linear light, premultiplied; white, of one pixel, where there is none.
    texture: Image,
    /// Seconds that the animation lasts.
    duration: Curve,
}

/// The files that a file names: its buffers and pictures.
fn named_beside(path: &Path) -> Vec<PathBuf> {
    let folder = path.parent().map(Path::to_owned).unwrap_or_default();
    let names = file::read(path).map(|bytes| Document::beside(&bytes)).unwrap_or_default();
    names.into_iter().map(|name| folder.join(name)).collect()
}

/// Reads files that lie beside `path`.
fn beside(path: &Path) -> impl FnMut(&str) -> Result<Vec<u8>, String> {
    let folder = path.parent().map(Path::to_owned).unwrap_or_default();
    move |name| file::read(&folder.join(name)).map_err(|e| e.to_string())
}

fn stack(rows: Vec<[f64; 3]>, targets: usize, vertices: usize) -> NdArray<f64, 3> {
    NdArray::new([targets, vertices, 3], rows.into_flattened()).unwrap_or_default()
}

fn morphs(character: &mut Character) -> MorphTargets {
    let (m, v) = (character.target_names.len(), character.positions.len());
    MorphTargets {
        positions: stack(std::mem::take(&mut character.target_positions), m, v),
        normals: stack(std::mem::take(&mut character.target_normals), m, v),
        names: character.target_names.clone(),
    }
}

fn skinned(rig: &Rig, character: Character) -> Result<SkinnedMesh, NodeError> {
    let mesh = Mesh {
        positions: character.positions,
        triangles: Arc::new(character.triangles),
        uvs: Arc::new(character.uvs),
        normals: character.normals,
        colors: Arc::new(character.colors),
    };
    SkinnedMesh::new(mesh, character.influences, character.joints, character.weights, &rig.inverse_bind).map_err(NodeError::internal)
}

impl IoReadGltf {
    fn texture(&self, path: &Path, document: &Document, character: &mut Character) -> Result<Image, NodeError> {
        let decode = |index: usize| {
            let bytes = document.image(index, &mut beside(path)).map_err(|e| refused(path, &e))?;
            let options = DecodeOptions { color: ColorMode::Auto, layer: None, max_samples: self.max_samples, threads: 0 };
            let decoded = codec::decode(&bytes, &options).map_err(|e| file::codec_error(path, &e))?;
            picture::to_image(decoded).ok_or_else(|| NodeError::internal("a texture was decoded to another size than it has"))
        };
        let mut images: Vec<Option<usize>> = Vec::new();
        character.parts.iter().for_each(|p| {
            if !images.contains(&p.image) {
                images.push(p.image);
            }
        });
        match images[..] {
            [] | [None] => white(),
            [Some(image)] => decode(image),
            _ => {
                let pages = images.into_iter().map(|i| Ok((i, i.map(decode).transpose()?))).collect::<Result<Vec<_>, NodeError>>()?;
                atlas(&character.parts, &pages, &mut character.uvs)
                    .map_err(|e| NodeError { message: format!("{}: {e}", path.display()), ..e })
            }
        }
    }

    /// The animation's time at each frame.
    fn times(&self, cx: &Context, duration: f64) -> Vec<f64> {
        let seconds = |k: usize| {
            let t = self.start + self.speed * k as f64 * f64::from(cx.clock.fps.1) / f64::from(cx.clock.fps.0);
            if self.end == End::Loop && duration > 0.0 { t.rem_euclid(duration) } else { t }
        };
        (0..cx.clock.len()).map(seconds).collect()
    }
}

impl Whole for IoReadGltf {
    fn check(&self) -> Vec<Problem> {
        let message = "expected one file, found a frame number as #### in its path".to_owned();
        if self.path.is_sequence() { vec![Problem { input: "path", message }] } else { Vec::new() }
    }

    fn run(self, cx: &Context) -> Result<IoReadGltfOutputs, NodeError> {
        let path = self.path.at(0);
        let failed = |e: GltfError| refused(&path, &e);
        let document = Document::open(&file::read(&path)?, &mut beside(&path)).map_err(failed)?;
        let picks = |p: &Option<Picks>| p.as_ref().map(|p| p.0.clone());
        let rig = document.rig().map_err(failed)?;
        let mut character = document.character(&rig, picks(&self.mesh).as_deref(), picks(&self.material).as_deref()).map_err(failed)?;
        let sample = document.sample(picks(&self.animation).as_deref()).map_err(failed)?;
        let (mut poses, mut weights) = (Vec::new(), Vec::new());
        for t in self.times(cx, sample.duration()) {
            cx.check()?;
            poses.push(sample.pose(&rig, t).into_iter().collect());
            weights.push(Weights { weights: character.target_weights(&sample, t).map_err(failed)? });
        }
        let texture = self.texture(&path, &document, &mut character)?;
        let morphs = morphs(&mut character);
        let rest: Vec<_> = rig.rest.iter().map(|j| j.matrix()).collect();
        Ok(IoReadGltfOutputs {
            skeleton: Skeleton::new(rig.parents.clone(), &rest, rig.names.clone()).map_err(NodeError::internal)?,
            mesh: skinned(&rig, character)?,
            pose: Stream(poses),
            morphs,
            weights: Stream(weights),
            texture,
            duration: Curve { value: sample.duration() },
        })
    }
}
