//! Characters into glTF: a skin with poses, morph targets with weights, or both.

use nalgebra::Matrix4;
use serde_json::{Map, Value as Json, json};

use super::container::{pack, to_base64};
use super::error::{GltfError, malformed};
use crate::algo::mesh::unit;
use crate::algo::rotation::near;
use crate::algo::skeleton::{Joint, order};

/// A surface to be written.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surface<'a> {
    /// Vertices, metres.
    pub positions: &'a [[f64; 3]],
    /// Vertices of each triangle.
    pub triangles: &'a [[u32; 3]],
    /// Texture coordinates, or none.
    pub uvs: &'a [[f64; 2]],
    /// Normals, or none.
    pub normals: &'a [[f64; 3]],
    /// Colours, linear light, premultiplied, or none.
    pub colors: &'a [[f64; 4]],
}

/// The joints that move a surface.
#[derive(Clone, Copy, Debug)]
pub struct Skin<'a> {
    /// Joints a vertex.
    pub influences: usize,
    /// Joints of each vertex.
    pub joints: &'a [u32],
    /// How much each of them counts.
    pub weights: &'a [f64],
    /// For each joint, joint at rest from mesh at rest.
    pub inverse_bind: &'a [Matrix4<f64>],
    /// Parent of each joint, -1 for a root.
    pub parents: &'a [i64],
    /// Each joint at rest.
    pub rest: &'a [Joint],
    /// Name of each joint, or none at all.
    pub names: &'a [String],
}

/// A morph target.
#[derive(Clone, Debug, Default)]
pub struct Target {
    /// Its name.
    pub name: String,
    /// What it adds to positions.
    pub positions: Vec<[f64; 3]>,
    /// What it adds to normals, or none.
    pub normals: Vec<[f64; 3]>,
}

/// What moves, frame by frame from the time 0.
#[derive(Clone, Copy, Debug, Default)]
pub struct Animated<'a> {
    /// Frames a second.
    pub fps: f64,
    /// Every joint at each frame; none where nothing is posed.
    pub poses: &'a [Vec<Joint>],
    /// Weight of each target at each frame; none where nothing is weighted.
    pub weights: &'a [Vec<f64>],
    /// True holds each frame until the next, false goes straight from one to the next: of poses, and of weights.
    pub steps: [bool; 2],
}

/// All that goes into a file.
#[derive(Clone, Copy, Debug)]
pub struct Export<'a> {
    /// Name of the character.
    pub name: &'a str,
    /// The surface at rest.
    pub surface: Surface<'a>,
    /// What it is bound to.
    pub skin: Option<Skin<'a>>,
    /// What it is morphed to.
    pub targets: &'a [Target],
    /// What moves.
    pub animated: Animated<'a>,
    /// A texture as PNG, and whether it is see-through anywhere; left out where the surface has no texture coordinates.
    pub texture: Option<(&'a [u8], bool)>,
    /// True for `.glb`, false for `.gltf` with its bytes inside.
    pub binary: bool,
    /// A text about the file, under a name in `asset.extras`.
    pub text: Option<(&'a str, &'a str)>,
}

const FLOAT: u32 = 5126;

/// Buffer views, accessors, and the bytes that they lie in.
#[derive(Default)]
struct Bytes {
    bytes: Vec<u8>,
    views: Vec<Json>,
    accessors: Vec<Json>,
}

impl Bytes {
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], target: Option<u32>, kind: u32, shape: &str, count: usize) -> usize {
        let view = self.view(bytes, target);
        self.accessors.push(json!({ "bufferView": view, "componentType": kind, "count": count, "type": shape }));
        self.accessors.len() - 1
    }

    /// Floats, `width` an element, with their bounds where these are asked for.
    fn floats(&mut self, numbers: &[f64], width: usize, target: Option<u32>, bounds: bool, what: &str) -> Result<usize, GltfError> {
        let narrow: Vec<f32> = numbers.iter().map(|v| *v as f32).collect();
        if let Some(i) = narrow.iter().position(|v| !v.is_finite()) {
            return Err(malformed(what, format!("element {}: expected a finite number, found {}", i / width.max(1), numbers[i])));
        }
        let bytes: Vec<u8> = narrow.iter().flat_map(|v| v.to_le_bytes()).collect();
        let shape = ["SCALAR", "VEC2", "VEC3", "VEC4"].get(width - 1).copied().unwrap_or("MAT4");
        let at = self.accessor(&bytes, target, FLOAT, shape, narrow.len() / width);
        if bounds {
            let of = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
                let column = |c: usize| narrow.iter().skip(c).step_by(width).copied();
                (0..width).filter_map(|c| column(c).reduce(pick)).collect()
            };
            self.accessors[at]["min"] = of(f32::min).into();
            self.accessors[at]["max"] = of(f32::max).into();
        }
        Ok(at)
    }
}

const VERTICES: Option<u32> = Some(34962);
const INDICES: Option<u32> = Some(34963);

/// The bytes of a glTF file.
///
/// # Errors
/// Where there is nothing to see, a number is not finite as f32, the parts do not go together, or the file would be too large.
pub fn write(export: &Export) -> Result<Vec<u8>, GltfError> {
    let export = &Export { texture: export.texture.filter(|_| !export.surface.uvs.is_empty()), ..*export };
    let surface = &export.surface;
    if surface.positions.is_empty() || surface.triangles.is_empty() {
        return Err(malformed("mesh", "expected triangles, found none"));
    }
    let mut out = Bytes::default();
    let mut root = json!({ "asset": { "version": "2.0", "generator": "pegbar" }, "scene": 0 });
    if let Some((name, text)) = export.text {
        root["asset"]["extras"] = json!({ name: text });
    }
    let mut attributes = attributes(surface, &mut out)?;
    let mut nodes = Vec::new();
    let mut mesh_node = json!({ "name": export.name, "mesh": 0 });
    let mut top = Vec::new();
    if let Some(skin) = &export.skin {
        let bound = Bound::new(skin, surface.positions.len())?;
        bound.attributes(&mut attributes, &mut out)?;
        (nodes, top) = bound.nodes();
        let matrices: Vec<f64> = bound.inverse_bind.iter().flat_map(|m| m.as_slice().to_vec()).collect();
        let matrices = out.floats(&matrices, 16, None, false, "inverse_bind")?;
        root["skins"] = json!([{ "joints": bound.nodes_of_columns, "inverseBindMatrices": matrices }]);
        mesh_node["skin"] = 0.into();
    }
    let mesh_index = nodes.len();
    nodes.push(mesh_node);
    top.push(mesh_index);
    root["meshes"] = json!([mesh(export, attributes, &mut out)?]);
    root["materials"] = json!([material(export)]);
    if let Some((png, _)) = export.texture {
        let view = out.view(png, None);
        root["images"] = json!([{ "bufferView": view, "mimeType": "image/png" }]);
        root["textures"] = json!([{ "source": 0 }]);
    }
    let channels = channels(export, mesh_index, &mut out)?;
    if let Some(animation) = channels {
        root["animations"] = json!([animation]);
    }
    root["scenes"] = json!([{ "nodes": top }]);
    root["nodes"] = nodes.into();
    root["accessors"] = out.accessors.into();
    root["bufferViews"] = out.views.into();
    let mut buffer = json!({ "byteLength": out.bytes.len() });
    if !export.binary {
        buffer["uri"] = format!("data:application/octet-stream;base64,{}", to_base64(&out.bytes)).into();
    }
    root["buffers"] = json!([buffer]);
    let text = root.to_string().into_bytes();
    if export.binary { pack(&text, &out.bytes) } else { Ok(text) }
}

fn attributes(surface: &Surface, out: &mut Bytes) -> Result<Map<String, Json>, GltfError> {
    let mut attributes = Map::new();
    attributes.insert("POSITION".to_owned(), out.floats(surface.positions.as_flattened(), 3, VERTICES, true, "positions")?.into());
    if !surface.normals.is_empty() {
        let normals: Vec<f64> = surface.normals.iter().flat_map(|n| unit((*n).into())).collect();
        attributes.insert("NORMAL".to_owned(), out.floats(&normals, 3, VERTICES, false, "normals")?.into());
    }
    if !surface.uvs.is_empty() {
        attributes.insert("TEXCOORD_0".to_owned(), out.floats(surface.uvs.as_flattened(), 2, VERTICES, false, "uvs")?.into());
    }
    if !surface.colors.is_empty() {
        // Alpha stands apart from colour in the file.
        let straight = |[r, g, b, a]: &[f64; 4]| if *a > 0.0 { [r / a, g / a, b / a, *a] } else { [0.0; 4] };
        let colors: Vec<f64> = surface.colors.iter().flat_map(straight).collect();
        attributes.insert("COLOR_0".to_owned(), out.floats(&colors, 4, VERTICES, false, "colors")?.into());
    }
    Ok(attributes)
}

fn mesh(export: &Export, attributes: Map<String, Json>, out: &mut Bytes) -> Result<Json, GltfError> {
    let triangles = export.surface.triangles.as_flattened();
    let bytes: Vec<u8> = triangles.iter().flat_map(|v| v.to_le_bytes()).collect();
    let indices = out.accessor(&bytes, INDICES, 5125, "SCALAR", triangles.len());
    let mut primitive = json!({ "attributes": attributes, "indices": indices, "material": 0 });
    let mut mesh = json!({ "name": export.name });
    if !export.targets.is_empty() {
        let mut targets = Vec::new();
        for (k, target) in export.targets.iter().enumerate() {
            let what = format!("morph target {k}");
            let mut one = json!({ "POSITION": out.floats(target.positions.as_flattened(), 3, VERTICES, true, &what)? });
            if !target.normals.is_empty() {
                one["NORMAL"] = out.floats(target.normals.as_flattened(), 3, VERTICES, false, &what)?.into();
            }
            targets.push(one);
        }
        primitive["targets"] = targets.into();
        let names: Vec<&str> = export.targets.iter().map(|t| t.name.as_str()).collect();
        mesh["extras"] = json!({ "targetNames": names });
        let first = export.animated.weights.first().cloned().unwrap_or_else(|| vec![0.0; export.targets.len()]);
        mesh["weights"] = first.iter().map(|w| *w as f32).collect::<Vec<f32>>().into();
    }
    mesh["primitives"] = json!([primitive]);
    Ok(mesh)
}

fn material(export: &Export) -> Json {
    let mut surface = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
    if export.texture.is_some() {
        surface["baseColorTexture"] = json!({ "index": 0 });
    }
    let mut material = json!({ "name": export.name, "pbrMetallicRoughness": surface, "doubleSided": true });
    if export.texture.is_some_and(|t| t.1) || export.surface.colors.iter().any(|c| c[3] < 1.0) {
        material["alphaMode"] = "BLEND".into();
    }
    material
}

/// A skin as the format wants it: weights that add up to 1, each joint of a vertex once, and one root.
struct Bound<'a> {
    skin: &'a Skin<'a>,
    /// The node of each column of the skin.
    nodes_of_columns: Vec<usize>,
    inverse_bind: Vec<Matrix4<f64>>,
    /// Sets of four a vertex.
    sets: usize,
    joints: Vec<u16>,
    weights: Vec<f64>,
    /// True where a joint stands for those that nothing moves.
    has_unmoved: bool,
}

impl<'a> Bound<'a> {
    fn new(skin: &'a Skin<'a>, vertices: usize) -> Result<Self, GltfError> {
        let j = skin.parents.len();
        if skin.rest.len() != j || skin.inverse_bind.len() != j || j == 0 {
            let message =
                format!("expected as many joints as the mesh is bound to, {}, and one at least, found {j}", skin.inverse_bind.len());
            return Err(malformed("skeleton", message));
        }
        let mut merged = Vec::with_capacity(vertices);
        for v in 0..vertices {
            let own = v * skin.influences..(v + 1) * skin.influences;
            merged.push(influences(&skin.joints[own.clone()], &skin.weights[own], v)?);
        }
        let has_unmoved = merged.iter().any(Vec::is_empty);
        if has_unmoved {
            merged.iter_mut().filter(|m| m.is_empty()).for_each(|m| m.push((j as u32, 1.0)));
        }
        let columns = columns(skin, &merged)?;
        let mut places = vec![columns.len(); j + 1];
        columns.iter().enumerate().for_each(|(place, (joint, _))| places[*joint] = place);
        let most = merged.iter().map(Vec::len).max().unwrap_or(1);
        let sets = most.div_ceil(4).max(1);
        let (mut joints, mut weights) = (Vec::new(), Vec::new());
        for (v, own) in merged.iter().enumerate() {
            for (joint, weight) in own {
                let column = places.get(*joint as usize).copied().unwrap_or(columns.len());
                joints.push(u16::try_from(column).map_err(|_| malformed("skeleton", "expected at most 65536 joints, found more"))?);
                weights.push(*weight);
            }
            joints.resize((v + 1) * sets * 4, 0);
            weights.resize((v + 1) * sets * 4, 0.0);
        }
        let (mut nodes_of_columns, mut inverse_bind): (Vec<usize>, Vec<Matrix4<f64>>) = columns.into_iter().unzip();
        inverse_bind.iter_mut().for_each(|m| m.set_row(3, &nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0)));
        if has_unmoved {
            nodes_of_columns.push(j);
            inverse_bind.push(Matrix4::identity());
        }
        Ok(Self { skin, nodes_of_columns, inverse_bind, sets, joints, weights, has_unmoved })
    }

    fn attributes(&self, attributes: &mut Map<String, Json>, out: &mut Bytes) -> Result<(), GltfError> {
        let n = self.joints.len() / (self.sets * 4).max(1);
        for set in 0..self.sets {
            let column = |v: usize| (v * self.sets + set) * 4..(v * self.sets + set + 1) * 4;
            let joints: Vec<u8> = (0..n).flat_map(|v| &self.joints[column(v)]).flat_map(|j| j.to_le_bytes()).collect();
            let weights: Vec<f64> = (0..n).flat_map(|v| &self.weights[column(v)]).copied().collect();
            attributes.insert(format!("JOINTS_{set}"), out.accessor(&joints, VERTICES, 5123, "VEC4", n).into());
            attributes.insert(format!("WEIGHTS_{set}"), out.floats(&weights, 4, VERTICES, false, "weights")?.into());
        }
        Ok(())
    }

    /// The joints as nodes, and those on top of them: one, as a skin wants a common root.
    fn nodes(&self) -> (Vec<Json>, Vec<usize>) {
        let skin = self.skin;
        let mut nodes = Vec::new();
        for (j, rest) in skin.rest.iter().enumerate() {
            let children: Vec<usize> = (0..skin.parents.len()).filter(|c| skin.parents[*c] == j as i64).collect();
            let name = skin.names.get(j).cloned().unwrap_or_else(|| format!("joint {j}"));
            let narrow = |v: &[f64]| v.iter().map(|x| *x as f32).collect::<Vec<f32>>();
            let mut node = json!({
                "name": name,
                "translation": narrow(rest.translation.as_slice()),
                "rotation": narrow(rest.rotation.coords.as_slice()),
                "scale": narrow(rest.scale.as_slice()),
            });
            if !children.is_empty() {
                node["children"] = children.into();
            }
            nodes.push(node);
        }
        let mut roots: Vec<usize> = (0..skin.parents.len()).filter(|j| skin.parents[*j] == -1).collect();
        if self.has_unmoved {
            roots.push(nodes.len());
            nodes.push(json!({ "name": "unmoved" }));
        }
        if roots.len() > 1 {
            nodes.push(json!({ "name": "roots", "children": roots }));
            roots = vec![nodes.len() - 1];
        }
        (nodes, roots)
    }
}

/// The joints that a skin lists, and how each is bound: those that move something, those that are bound at all, and what hangs on either. What is above
/// them, as an armature that is scaled as a whole, stays a plain node: programs take bones to stand where their inverse bind matrices say.
fn columns(skin: &Skin, merged: &[Vec<(u32, f64)>]) -> Result<Vec<(usize, Matrix4<f64>)>, GltfError> {
    let j = skin.parents.len();
    let mut moves = vec![false; j];
    for (joint, _) in merged.iter().flatten() {
        // What nothing moves has a joint past the end.
        if let Some(moves) = moves.get_mut(*joint as usize) {
            *moves = true;
        }
    }
    let mut bound: Vec<Option<Matrix4<f64>>> =
        (0..j).map(|i| (moves[i] || skin.inverse_bind[i] != Matrix4::identity()).then(|| skin.inverse_bind[i])).collect();
    for i in order(skin.parents).map_err(|e| malformed("skeleton", e.to_string()))? {
        if let (None, Some(parent)) = (bound[i], usize::try_from(skin.parents[i]).ok().and_then(|p| bound[p])) {
            bound[i] = skin.rest[i].matrix().try_inverse().map(|own| own * parent);
        }
    }
    Ok(bound.into_iter().enumerate().filter_map(|(i, m)| m.map(|m| (i, m))).collect())
}

/// Joints of a vertex, each once, the weightiest first; weights add up to 1. None where nothing moves it.
fn influences(joints: &[u32], weights: &[f64], vertex: usize) -> Result<Vec<(u32, f64)>, GltfError> {
    let mut own: Vec<(u32, f64)> = Vec::new();
    for (j, w) in joints.iter().zip(weights) {
        match own.iter_mut().find(|(known, _)| known == j) {
            Some((_, sum)) => *sum += w,
            None => own.push((*j, *w)),
        }
    }
    own.retain(|(_, w)| *w as f32 != 0.0);
    let sum: f64 = own.iter().map(|(_, w)| w).sum();
    if own.iter().any(|(_, w)| !w.is_finite() || *w < 0.0) {
        return Err(malformed(format!("vertex {vertex}"), format!("expected weights from 0 on, found {weights:?}")));
    }
    own.iter_mut().for_each(|(_, w)| *w /= sum);
    own.retain(|(_, w)| *w as f32 != 0.0);
    own.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    Ok(own)
}

/// The animation, where anything moves.
fn channels(export: &Export, mesh: usize, out: &mut Bytes) -> Result<Option<Json>, GltfError> {
    let animated = &export.animated;
    let (mut samplers, mut channels) = (Vec::new(), Vec::new());
    let words = animated.steps.map(|step| if step { "STEP" } else { "LINEAR" });
    let times = |n: usize| -> Vec<f64> { (0..n).map(|k| k as f64 / animated.fps).collect() };
    let mut put = |input: usize, output: usize, word: &str, node: usize, path: &str| {
        samplers.push(json!({ "input": input, "output": output, "interpolation": word }));
        channels.push(json!({ "sampler": samplers.len() - 1, "target": { "node": node, "path": path } }));
    };
    if let (Some(skin), false) = (&export.skin, animated.poses.is_empty()) {
        let input = out.floats(&times(animated.poses.len()), 1, None, true, "times")?;
        for (j, rest) in skin.rest.iter().enumerate() {
            for (path, width, values) in paths(animated.poses, j, rest) {
                let output = out.floats(&values, width, None, false, &format!("{path} of joint {j}"))?;
                put(input, output, words[0], j, path);
            }
        }
    }
    if !export.targets.is_empty() && !animated.weights.is_empty() {
        // What holds needs a key only where it changes.
        let changes = |k: &usize| *k == 0 || !animated.steps[1] || animated.weights[*k] != animated.weights[k - 1];
        let keys: Vec<usize> = (0..animated.weights.len()).filter(changes).collect();
        let all = times(animated.weights.len());
        let input = out.floats(&keys.iter().map(|k| all[*k]).collect::<Vec<f64>>(), 1, None, true, "times")?;
        let values: Vec<f64> = keys.iter().flat_map(|k| animated.weights[*k].iter().copied()).collect();
        let output = out.floats(&values, 1, None, false, "weights")?;
        put(input, output, words[1], mesh, "weights");
    }
    Ok((!channels.is_empty()).then(|| json!({ "name": export.name, "samplers": samplers, "channels": channels })))
}

/// What of a joint is not at rest throughout: the path, numbers a key, and the numbers.
fn paths(poses: &[Vec<Joint>], joint: usize, rest: &Joint) -> Vec<(&'static str, usize, Vec<f64>)> {
    let own: Vec<&Joint> = poses.iter().filter_map(|p| p.get(joint)).collect();
    let mut found = Vec::new();
    let translations: Vec<f64> = own.iter().flat_map(|j| j.translation.as_slice().to_vec()).collect();
    let scales: Vec<f64> = own.iter().flat_map(|j| j.scale.as_slice().to_vec()).collect();
    let mut rotations = Vec::with_capacity(4 * own.len());
    let mut before = rest.rotation;
    for j in &own {
        // Readers blend numbers, so that a quaternion and its opposite must not follow one another.
        before = near(&j.rotation, &before);
        rotations.extend_from_slice(before.coords.as_slice());
    }
    let lists = [
        ("translation", translations, rest.translation.as_slice()),
        ("rotation", rotations, rest.rotation.coords.as_slice()),
        ("scale", scales, rest.scale.as_slice()),
    ];
    for (path, values, still) in lists {
        // A rest pose that went through a matrix is off by some last bits.
        if values.chunks_exact(still.len()).flatten().zip(still.iter().cycle()).any(|(v, s)| (v - s).abs() > 1e-9 * s.abs().max(1e-3)) {
            found.push((path, still.len(), values));
        }
    }
    found
}
