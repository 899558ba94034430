//! `mesh.features`: curves of your own on a mesh, where it shows no line by itself: a mouth, a stripe, the fold of a sleeve.
//!
//! **Method** a curve goes through vertices along the shortest edges, or is painted as pixels of a picture of the mesh, or of its texture; its points are where it crosses
//! edges of the mesh ([`crate::algo::mesh_features`]). With `correspond.curves` they are drawn where the drawing has them.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 5 (interior features, named there as work to do).
//!
//! **Fails when** a vertex is none of the mesh, a curve crosses no edge that is seen, or `uvs` are asked for where the mesh has none.
//!
//! **Cost** O(triangles · points) a curve; through vertices O(n log n).
//!
//! ```ron
//! "smile": (type: "mesh.features", mesh: "@skin", camera: "@camera", paths: [(points: [(210, 120), (224, 131), (240, 122)]), (vertices: [80, 95])]),
//! ```

use nalgebra::Vector3;
use pegbar_engine::node::{Context, Fault, In, NodeError, PerFrame, Problem};
use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};
use serde::Deserialize;

use crate::algo::mesh_features::{crossings, way};
use crate::algo::mesh_lines::Place;
use crate::algo::silhouette::Kind;
use crate::algo::surface::{Part, Surface};
use crate::algo::visibility::{DepthBuffer, Seen, Sight};
use crate::data::{Camera, Curves, Mesh};
use crate::render::{limited, seen_by};

/// The number of features in [`Curves::kinds`].
const FEATURE: u8 = 5;

/// One curve as it is written.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Path {
    #[serde(default)]
    vertices: Vec<u32>,
    #[serde(default)]
    points: Vec<[f64; 2]>,
    #[serde(default)]
    uvs: Vec<[f64; 2]>,
    #[serde(default)]
    closed: bool,
}

/// Several curves.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Paths(pub(super) Vec<Path>);

impl Setting for Paths {
    fn type_name() -> String {
        "list of curves (vertices: [n, ...] or points: [(x, y), ...] or uvs: [(u, v), ...], closed: false)".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        let found: Result<Vec<Path>, _> = parse_slice(text, Extensions::IMPLICIT_SOME);
        found.map(Self).map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
    }
    fn numbers(&self) -> Vec<f64> {
        self.0.iter().flat_map(|p| p.points.iter().chain(&p.uvs).flatten().copied()).collect()
    }
}

impl Path {
    fn wrong(&self, at: usize) -> Option<String> {
        let counts = [self.vertices.len(), self.points.len(), self.uvs.len()];
        let one = counts.iter().filter(|n| **n > 0).count() == 1 && counts.iter().sum::<usize>() > 1;
        (!one).then(|| format!("curve {}: expected two or more of either vertices, points or uvs, found {counts:?}", at + 1))
    }

    /// Its points, and the first once more where it is closed.
    fn line(&self, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        points.iter().copied().chain(points.first().copied().filter(|_| self.closed)).collect()
    }
}

/// Curves of your own on a mesh, where it shows no line by itself.
#[derive(Node)]
#[node(
    id = "mesh.features",
    version = 1,
    outputs = MeshFeaturesOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 5",
    example = "\"smile\": (type: \"mesh.features\", mesh: \"@skin\", camera: \"@camera\", paths: [(points: [(210, 120), (224, 131), (240, 122)]), (vertices: [80, 95])])"
)]
pub(crate) struct MeshFeatures {
    /// The mesh.
    pub(super) mesh: In<Mesh>,
    /// Where it is seen from, and how large the picture is.
    pub(super) camera: In<Camera>,
    /// Each through `vertices`, by their numbers, along the shortest edges; or painted on what is seen, through `points`, pixels of the picture of this frame; or on the
    /// texture, through `uvs`, 0 to 1 from its top left corner. A painted one begins and ends where it crosses its first and its last edge.
    pub(super) paths: Paths,
}

/// The curves.
#[derive(Outputs)]
pub(crate) struct MeshFeaturesOutputs {
    /// Chains of points on the edges of the mesh, and their places in the picture, numbered from 1.
    pub(super) curves: Curves,
    /// Number of curves.
    pub(super) count: Curve,
}

impl MeshFeatures {
    /// Where a curve crosses the mesh.
    fn places(&self, path: &Path, surface: &Surface, sight: &Sight<'_>) -> Result<Vec<Place>, NodeError> {
        if !path.vertices.is_empty() {
            return way(surface, &path.vertices, path.closed).map_err(|e| NodeError::new(Fault::Parameters, e.to_string()));
        }
        let mesh = &self.mesh;
        if !path.uvs.is_empty() {
            if mesh.uvs.is_empty() {
                return Err(NodeError::input("mesh: expected places on a texture for a curve of `uvs`, found none")
                    .help("use `points` or `vertices`"));
            }
            let line = path.line(&path.uvs);
            return Ok(crossings(surface, &line, |t| Some(surface.triangles[t].map(|v| (mesh.uvs[v as usize], 1.0)))));
        }
        let seen: Vec<Option<([f64; 2], f64)>> = surface.positions.iter().map(|p| sight.place(p)).collect();
        let front = |t: usize| {
            let [a, b, c] = surface.triangles[t].map(|v| seen[v as usize]);
            let (a, b, c) = (a?, b?, c?);
            let area = (b.0[1] - a.0[1]) * (c.0[0] - a.0[0]) - (b.0[0] - a.0[0]) * (c.0[1] - a.0[1]);
            (area > 0.0).then(|| [a, b, c].map(|(p, near)| (p, sight.evenly(near))))
        };
        let places = crossings(surface, &path.line(&path.points), front);
        Ok(places.into_iter().filter(|p| visible(sight, &world(surface, *p)).is_some_and(|v| v.1)).collect())
    }
}

fn world(surface: &Surface, ([a, b], share): Place) -> Vector3<f64> {
    let [a, b] = [a, b].map(|v| surface.positions[v as usize]);
    a + (b - a) * share
}

/// Where a point is in the picture, and whether it is seen; `None` behind the camera.
fn visible(sight: &Sight<'_>, p: &Vector3<f64>) -> Option<([f64; 2], bool)> {
    let (pixel, near) = sight.place(p)?;
    Some((pixel, sight.seen(pixel, near, Kind::Crease) == Seen::Yes))
}

impl PerFrame for MeshFeatures {
    fn check(&self) -> Vec<Problem> {
        self.paths.0.iter().enumerate().filter_map(|(at, p)| p.wrong(at)).map(|message| Problem { input: "paths", message }).collect()
    }

    fn run(self, _cx: &Context) -> Result<MeshFeaturesOutputs, NodeError> {
        let camera = seen_by(&self.camera)?;
        let [width, height] = camera.size;
        limited(width, height)?;
        let mesh = &self.mesh;
        mesh.validate().map_err(|e| NodeError::input(format!("mesh: {e}")))?;
        let part = Part { positions: &mesh.positions, triangles: &mesh.triangles, normals: &[] };
        let surface = Surface::new(&[part], std::f64::consts::PI).map_err(|e| NodeError::input(format!("mesh: {e}")))?;
        let depths = DepthBuffer::new(&surface, &camera);
        let sight = Sight::new(&surface, &camera, depths.depths());
        let mut curves = Curves::default();
        for (at, path) in self.paths.0.iter().enumerate() {
            let places = self.places(path, &surface, &sight)?;
            if places.len() < 2 {
                let message = format!("curve {}: expected a curve across two or more edges of the mesh, found {}", at + 1, places.len());
                return Err(NodeError::new(Fault::Parameters, message)
                    .help("points are pixels of the picture at this frame, on what is seen there"));
            }
            curves.lengths.push(places.len() as u32);
            curves.closed.push(u8::from(path.closed && places.len() > 2));
            curves.ids.push(at as i64 + 1);
            curves.kinds.push(FEATURE);
            for place in places {
                let (pixel, seen) = visible(&sight, &world(&surface, place)).unwrap_or(([f64::NAN; 2], false));
                curves.points.push(pixel);
                curves.visible.push(u8::from(seen));
                curves.edges.push(place.0);
                curves.shares.push(place.1);
            }
        }
        Ok(MeshFeaturesOutputs { count: Curve { value: curves.lengths.len() as f64 }, curves })
    }
}
