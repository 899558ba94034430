//! The meshes of a glTF file as one surface that joints and morph targets move.

use std::collections::BTreeMap;

use super::accessor::{FLOAT, INDEX, JOINT, REAL};
use super::error::{GltfError, item, malformed};
use super::{Document, Pick, Rig, Sample, json, listed};
use crate::algo::mesh::normals_of;

/// Vertices that have the same texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The image of the base colour, as a number of the file; `None` for none.
    pub image: Option<usize>,
    /// Its vertices.
    pub vertices: std::ops::Range<usize>,
}

/// Some meshes of a file as one surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Character {
    /// Vertices at rest.
    pub positions: Vec<[f64; 3]>,
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Texture coordinates of each vertex; none where nothing has any.
    pub uvs: Vec<[f64; 2]>,
    /// Unit normals; none where nothing has any.
    pub normals: Vec<[f64; 3]>,
    /// Base colours, linear light, premultiplied; none where all are white.
    pub colors: Vec<[f64; 4]>,
    /// Joints a vertex: four at the least.
    pub influences: usize,
    /// Joints of each vertex, numbers in the rig.
    pub joints: Vec<u32>,
    /// How much each of them counts.
    pub weights: Vec<f64>,
    /// Runs of vertices by their texture.
    pub parts: Vec<Part>,
    /// Names of the morph targets.
    pub target_names: Vec<String>,
    /// What each target adds to positions, one after the other.
    pub target_positions: Vec<[f64; 3]>,
    /// What each target adds to normals; none where nothing has any.
    pub target_normals: Vec<[f64; 3]>,
    /// For each target the nodes that it belongs to, the number that it has there, and its weight at rest.
    sources: Vec<Vec<(usize, usize, f64)>>,
}

/// A target of one primitive: its place in the character, and what it adds to positions and normals.
struct PieceTarget {
    slot: usize,
    positions: Vec<[f64; 3]>,
    normals: Option<Vec<[f64; 3]>>,
}

/// One primitive, read.
struct Piece {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    uvs: Option<Vec<[f64; 2]>>,
    normals: Option<Vec<[f64; 3]>>,
    colors: Vec<[f64; 4]>,
    is_colored: bool,
    image: Option<usize>,
    /// Joints and weights, sets of four.
    influences: usize,
    joints: Vec<u32>,
    weights: Vec<f64>,
    targets: Vec<PieceTarget>,
}

impl Document {
    /// The meshes of the nodes that `picks` names, by node or by mesh, or of all that are shown; of these what has a material of `materials`, or all.
    ///
    /// # Errors
    /// Where one is not there, nothing has triangles, or the file is damaged.
    pub fn character(&self, rig: &Rig, picks: Option<&[Pick]>, materials: Option<&[Pick]>) -> Result<Character, GltfError> {
        let nodes = self.mesh_nodes(picks)?;
        let materials = materials.map(|picks| picks.iter().map(|p| self.material(p)).collect::<Result<Vec<_>, _>>()).transpose()?;
        let mut character = Character::default();
        let mut pieces = Vec::new();
        for &(node, mesh) in &nodes {
            let slots = self.targets(node, mesh, &mut character)?;
            let primitives = &item(&self.root.meshes, "meshes", mesh, &format!("nodes[{node}].mesh"))?.primitives;
            for (p, primitive) in primitives.iter().enumerate() {
                let is_wanted = materials.as_ref().is_none_or(|m| primitive.material.is_some_and(|own| m.contains(&own)));
                if is_wanted {
                    pieces.extend(self.piece(rig, node, primitive, &slots, &format!("meshes[{mesh}].primitives[{p}]"))?);
                }
            }
        }
        if pieces.is_empty() {
            return Err(GltfError::NoSuch(format!("expected triangles in the meshes of the file, found {}", self.instead(&nodes))));
        }
        self.join(pieces, &mut character)?;
        Ok(character)
    }

    /// What meshes without triangles are made of.
    fn instead(&self, nodes: &[(usize, usize)]) -> String {
        let own =
            |mesh: usize| self.root.meshes.get(mesh).into_iter().flat_map(move |m| m.primitives.iter().enumerate().map(move |p| (mesh, p)));
        let one = |(mesh, (p, primitive)): (usize, (usize, &json::Primitive))| {
            let what = match primitive.mode.unwrap_or(4) {
                0 => "points (mode 0)",
                mode @ 1..=3 => ["lines (mode 1)", "lines (mode 2)", "lines (mode 3)"][mode as usize - 1],
                _ if !primitive.attributes.contains_key("POSITION") => "no POSITION",
                _ => "another material",
            };
            format!("meshes[{mesh}].primitives[{p}] with {what}")
        };
        let mut found: Vec<String> = nodes.iter().flat_map(|(_, mesh)| own(*mesh)).map(one).collect();
        found.dedup();
        match found.len() {
            0 if nodes.is_empty() => "no mesh in its scene".to_owned(),
            0 => "meshes without primitives".to_owned(),
            n if n > 4 => format!("{} and {} more", found[..4].join(", "), n - 4),
            _ => found.join(", "),
        }
    }

    /// Nodes and their meshes.
    fn mesh_nodes(&self, picks: Option<&[Pick]>) -> Result<Vec<(usize, usize)>, GltfError> {
        let (nodes, meshes) = (&self.root.nodes, &self.root.meshes);
        let all: Vec<(usize, usize)> = self.shown()?.into_iter().filter_map(|n| Some((n, nodes[n].mesh?))).collect();
        let name = |(n, m): (usize, usize)| [nodes[n].name.as_deref(), meshes.get(m).and_then(|m| m.name.as_deref())];
        let Some(picks) = picks else { return Ok(all) };
        let is = |pick: &Pick, at: (usize, usize)| match pick {
            Pick::Index(index) => *index == at.1,
            Pick::Name(wanted) => name(at).contains(&Some(wanted)),
        };
        if let Some(none) = picks.iter().find(|p| !all.iter().any(|at| is(p, *at))) {
            let names = listed(all.iter().map(|at| name(*at)[0].or(name(*at)[1])));
            return Err(GltfError::NoSuch(format!("expected a mesh of the file, found {none}; there are {names}")));
        }
        Ok(all.into_iter().filter(|at| picks.iter().any(|p| is(p, *at))).collect())
    }

    fn material(&self, pick: &Pick) -> Result<usize, GltfError> {
        let materials = &self.root.materials;
        materials.iter().enumerate().position(|(i, m)| pick.is(i, m.name.as_deref())).ok_or_else(|| {
            let names = listed(materials.iter().map(|m| m.name.as_deref()));
            GltfError::NoSuch(format!("expected a material of the file, found {pick}; there are {names}"))
        })
    }

    /// Places in the character of a mesh's targets. Those of one name are one, as one slider moves them all.
    fn targets(&self, node: usize, mesh: usize, character: &mut Character) -> Result<Vec<usize>, GltfError> {
        let at = format!("meshes[{mesh}]");
        let mesh = item(&self.root.meshes, "meshes", mesh, &at)?;
        let n = mesh.primitives.first().map_or(0, |p| p.targets.len());
        if mesh.primitives.iter().any(|p| p.targets.len() != n) {
            return Err(malformed(at, format!("expected {n} targets in each primitive, found others")));
        }
        let weights = self.root.nodes[node].weights.as_ref().or(mesh.weights.as_ref());
        if weights.is_some_and(|w| w.len() != n) {
            return Err(malformed(at, format!("expected {n} weights, one for each target, found another number")));
        }
        let owner = self.root.nodes[node].name.clone().or_else(|| mesh.name.clone()).unwrap_or_else(|| format!("node {node}"));
        let given = |k: usize| mesh.extras.get("targetNames")?.get(k)?.as_str().map(str::to_owned);
        let slots = (0..n).map(|k| {
            let name = given(k).unwrap_or_else(|| format!("{owner} {k}"));
            let slot = character.target_names.iter().position(|own| *own == name).unwrap_or(character.target_names.len());
            if slot == character.target_names.len() {
                character.target_names.push(name);
                character.sources.push(Vec::new());
            }
            character.sources[slot].push((node, k, weights.map_or(0.0, |w| w[k])));
            slot
        });
        Ok(slots.collect())
    }

    fn piece(&self, rig: &Rig, node: usize, primitive: &json::Primitive, slots: &[usize], at: &str) -> Result<Option<Piece>, GltfError> {
        let mode = primitive.mode.unwrap_or(4);
        if !(4..=6).contains(&mode) {
            return if mode < 4 { Ok(None) } else { Err(malformed(at, format!("expected a mode from 0 to 6, found {mode}"))) };
        }
        let attribute = |name: &str| primitive.attributes.get(name).copied();
        let Some(position) = attribute("POSITION") else { return Ok(None) };
        let positions = self.vectors::<3>(position, &["VEC3"], REAL, at)?;
        let n = positions.len();
        let matched = |name: &str, found: usize| {
            if found == n { Ok(()) } else { Err(malformed(at, format!("expected {n} values of {name}, found {found}"))) }
        };
        let normals = attribute("NORMAL").map(|a| self.vectors::<3>(a, &["VEC3"], REAL, at)).transpose()?;
        normals.iter().try_for_each(|v| matched("NORMAL", v.len()))?;
        let triangles = self.triangles(primitive.indices, mode, n, at)?;
        let material = primitive.material.map(|m| item(&self.root.materials, "materials", m, at)).transpose()?;
        let texture = material.and_then(|m| m.pbr_metallic_roughness.base_color_texture.as_ref());
        let image = texture.map(|t| self.source(t.index)).transpose()?.flatten();
        let uvs = self.uvs(texture, &attribute, at)?;
        uvs.iter().try_for_each(|v| matched("TEXCOORD", v.len()))?;
        let (colors, is_colored) = self.colors(material, attribute("COLOR_0"), n, at)?;
        matched("COLOR_0", colors.len())?;
        let (influences, joints, weights) = self.influences(rig, node, &attribute, n, at)?;
        let mut targets = Vec::new();
        for (target, slot) in primitive.targets.iter().zip(slots) {
            let each = |name: &str| target.get(name).map(|a| self.vectors::<3>(*a, &["VEC3"], REAL, at)).transpose();
            let (positions, normals) = (each("POSITION")?, each("NORMAL")?);
            positions.iter().chain(&normals).try_for_each(|v| matched("a target", v.len()))?;
            targets.push(PieceTarget { slot: *slot, positions: positions.unwrap_or_default(), normals });
        }
        let image = image.filter(|_| uvs.is_some());
        Ok(Some(Piece { positions, triangles, uvs, normals, colors, is_colored, image, influences, joints, weights, targets }))
    }

    /// The image of a texture.
    fn source(&self, texture: usize) -> Result<Option<usize>, GltfError> {
        Ok(item(&self.root.textures, "textures", texture, "materials")?.source)
    }

    fn triangles(&self, indices: Option<usize>, mode: u32, n: usize, at: &str) -> Result<Vec<[u32; 3]>, GltfError> {
        let corners = match indices {
            Some(accessor) => self.numbers(accessor, &["SCALAR"], INDEX, at)?,
            None => (0..n).map(|v| v as f64).collect(),
        };
        if let Some(far) = corners.iter().find(|v| !(0.0..n as f64).contains(*v)) {
            return Err(malformed(at, format!("expected indices below {n}, the number of vertices, found {far}")));
        }
        let c: Vec<u32> = corners.iter().map(|v| *v as u32).collect();
        let different = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        Ok(match mode {
            4 => c.as_chunks::<3>().0.to_vec(),
            // Every other triangle of a strip is wound the other way; those without area join parts of it.
            5 => c
                .windows(3)
                .enumerate()
                .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
                .filter(different)
                .collect(),
            _ => c.windows(2).skip(1).map(|w| [c[0], w[0], w[1]]).filter(different).collect(),
        })
    }

    fn uvs(
        &self,
        texture: Option<&json::TextureInfo>,
        attribute: &impl Fn(&str) -> Option<usize>,
        at: &str,
    ) -> Result<Option<Vec<[f64; 2]>>, GltfError> {
        let transform = texture.and_then(|t| t.extensions.transform.as_ref());
        let set = transform.and_then(|t| t.tex_coord).or(texture.map(|t| t.tex_coord)).unwrap_or(0);
        let Some(accessor) = attribute(&format!("TEXCOORD_{set}")) else { return Ok(None) };
        let mut uvs = self.vectors::<2>(accessor, &["VEC2"], REAL, at)?;
        if let Some(t) = transform {
            let (sin, cos) = (libm::sin(t.rotation), libm::cos(t.rotation));
            let [sx, sy] = t.scale.unwrap_or([1.0; 2]);
            for [u, v] in &mut uvs {
                let (x, y) = (*u * sx, *v * sy);
                (*u, *v) = (cos * x + sin * y + t.offset[0], cos * y - sin * x + t.offset[1]);
            }
        }
        Ok(Some(uvs))
    }

    /// Base colour times vertex colour, premultiplied; and whether any is not white.
    fn colors(
        &self,
        material: Option<&json::Material>,
        accessor: Option<usize>,
        n: usize,
        at: &str,
    ) -> Result<(Vec<[f64; 4]>, bool), GltfError> {
        let factor = material.and_then(|m| m.pbr_metallic_roughness.base_color_factor).unwrap_or([1.0; 4]);
        let own = match accessor {
            None => vec![[1.0; 4]; n],
            Some(a) if self.root.accessors.get(a).is_some_and(|a| a.shape == "VEC3") => {
                self.vectors::<3>(a, &["VEC3"], REAL, at)?.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect()
            }
            Some(a) => self.vectors::<4>(a, &["VEC4"], REAL, at)?,
        };
        let is_colored = accessor.is_some() || factor != [1.0; 4];
        let tinted = own.into_iter().map(|c| {
            let alpha = (c[3] * factor[3]).clamp(0.0, 1.0);
            [c[0] * factor[0] * alpha, c[1] * factor[1] * alpha, c[2] * factor[2] * alpha, alpha]
        });
        Ok((tinted.collect(), is_colored))
    }

    fn influences(
        &self,
        rig: &Rig,
        node: usize,
        attribute: &impl Fn(&str) -> Option<usize>,
        n: usize,
        at: &str,
    ) -> Result<(usize, Vec<u32>, Vec<f64>), GltfError> {
        let skin = self.root.nodes[node].skin;
        let (Some(skin), Some(_)) = (skin, attribute("JOINTS_0")) else {
            let joint = rig.rigid.get(node).copied().flatten();
            let joint = joint.ok_or_else(|| malformed(at, "expected a mesh with joints on a node with a skin, found none"))?;
            return Ok((1, vec![joint; n], vec![1.0; n]));
        };
        let columns = item(&rig.skins, "skins", skin, &format!("nodes[{node}].skin"))?;
        let shown = self.shown()?;
        if let Some(far) = self.root.skins[skin].joints.iter().find(|j| shown.binary_search(j).is_err()) {
            let message = format!("expected joints in the scene of the mesh, found node {far} outside of it");
            return Err(malformed(format!("skins[{skin}].joints"), message));
        }
        let mut sets = Vec::new();
        while let Some(joints) = attribute(&format!("JOINTS_{}", sets.len())) {
            let weights = attribute(&format!("WEIGHTS_{}", sets.len()));
            let weights = weights.ok_or_else(|| malformed(at, "expected WEIGHTS for each JOINTS, found none"))?;
            let (joints, shares) = (self.vectors::<4>(joints, &["VEC4"], JOINT, at)?, self.vectors::<4>(weights, &["VEC4"], REAL, at)?);
            let kind = &self.root.accessors[weights];
            if !FLOAT.contains(&kind.component_type) && !kind.normalized {
                let message = "expected weights as numbers with a point or as normalized integers, found integers that are not normalized";
                return Err(malformed(format!("accessors[{weights}]"), message));
            }
            let weights = shares;
            if joints.len() != n || weights.len() != n {
                let message = format!("expected {n} values of JOINTS and WEIGHTS, found {} and {}", joints.len(), weights.len());
                return Err(malformed(at, message));
            }
            sets.push((joints, weights));
        }
        let influences = 4 * sets.len();
        let (mut joints, mut weights) = (Vec::with_capacity(n * influences), Vec::with_capacity(n * influences));
        for v in 0..n {
            if let Some(w) = sets.iter().flat_map(|(_, w)| w[v]).find(|w| *w < 0.0) {
                return Err(malformed(at, format!("vertex {v}: expected weights of 0 and above, found {w}")));
            }
            for (j, w) in &sets {
                for (j, w) in j[v].iter().zip(&w[v]) {
                    // What has no weight may name anything.
                    let column = if *w == 0.0 { Some(&0) } else { columns.get(*j as usize) };
                    let message = || format!("vertex {v}: expected joints below {}, found {j}", columns.len());
                    joints.push(*column.ok_or_else(|| malformed(at, message()))?);
                    weights.push(*w);
                }
            }
        }
        Ok((influences, joints, weights))
    }

    fn join(&self, pieces: Vec<Piece>, out: &mut Character) -> Result<(), GltfError> {
        let n: usize = pieces.iter().map(|p| p.positions.len()).sum();
        out.influences = pieces.iter().map(|p| p.influences).max().unwrap_or(0).max(4);
        let has_target_normals = pieces.iter().any(|p| p.targets.iter().any(|t| t.normals.is_some()));
        let targets = n.saturating_mul(out.target_names.len()).saturating_mul(if has_target_normals { 6 } else { 3 });
        self.spend(targets.saturating_add(n.saturating_mul(2 * out.influences)), "meshes")?;
        let (has_uvs, has_normals) = (pieces.iter().any(|p| p.uvs.is_some()), pieces.iter().any(|p| p.normals.is_some()));
        let has_colors = pieces.iter().any(|p| p.is_colored);
        out.target_positions = vec![[0.0; 3]; n * out.target_names.len()];
        out.target_normals = vec![[0.0; 3]; if has_target_normals { n * out.target_names.len() } else { 0 }];
        for piece in pieces {
            let (start, own) = (out.positions.len(), piece.positions.len());
            for PieceTarget { slot, positions, normals } in &piece.targets {
                let at = slot * n + start;
                out.target_positions[at..at + positions.len()].copy_from_slice(positions);
                if let Some(normals) = normals {
                    out.target_normals[at..at + own].copy_from_slice(normals);
                }
            }
            if has_uvs {
                out.uvs.extend(piece.uvs.unwrap_or_else(|| vec![[0.0; 2]; own]));
            }
            if has_normals {
                out.normals.extend(piece.normals.unwrap_or_else(|| normals_of(&piece.positions, &piece.triangles)));
            }
            if has_colors {
                out.colors.extend(piece.colors);
            }
            for v in 0..own {
                let own = v * piece.influences..(v + 1) * piece.influences;
                out.joints.extend_from_slice(&piece.joints[own.clone()]);
                out.weights.extend_from_slice(&piece.weights[own]);
                out.joints.resize((start + v + 1) * out.influences, piece.joints[v * piece.influences]);
                out.weights.resize((start + v + 1) * out.influences, 0.0);
            }
            let start = u32::try_from(start).map_err(|_| malformed("meshes", "expected at most 2^32 vertices, found more"))?;
            out.triangles.extend(piece.triangles.iter().map(|t| t.map(|v| v + start)));
            out.positions.extend(piece.positions);
            out.parts.push(Part { image: piece.image, vertices: start as usize..out.positions.len() });
        }
        Ok(())
    }
}

impl Character {
    /// Weight of each morph target at a time.
    ///
    /// # Errors
    /// Where meshes of one target are moved apart from each other.
    pub fn target_weights(&self, sample: &Sample, seconds: f64) -> Result<Vec<f64>, GltfError> {
        let mut of_node: BTreeMap<usize, Option<Vec<f64>>> = BTreeMap::new();
        let mut weight = |(node, k, rest): (usize, usize, f64)| {
            let moved = of_node.entry(node).or_insert_with(|| sample.weights(node, seconds));
            moved.as_ref().and_then(|w| w.get(k).copied()).unwrap_or(rest)
        };
        let each = self.sources.iter().zip(&self.target_names).map(|(sources, name)| {
            let weights: Vec<f64> = sources.iter().map(|s| weight(*s)).collect();
            let first = weights.first().copied().unwrap_or(0.0);
            if weights.iter().any(|w| (w - first).abs() > 1e-6) {
                let message = format!("expected one weight for the morph target {name:?} of all meshes, found {weights:?}; read one mesh");
                return Err(malformed(format!("{seconds} s"), message));
            }
            Ok(first)
        });
        each.collect()
    }
}
