//! `mesh.silhouette`: silhouettes, borders, creases and intersections of a mesh as chains of points on its edges.
//!
//! **Method** the zero set of n · v, interpolated over each triangle ([`crate::algo::silhouette`]): smooth chains whose points lie on edges. What is
//! hidden of them is exact ([`crate::algo::hidden`]), as is where parts cross ([`crate::algo::crossings`]): a line has a point more where it goes behind something. Where the mesh is coarse or rough, lines are
//! looked for on a denser and smoother one, and their points are those where they cross edges of the mesh itself ([`crate::algo::mesh_lines`]).
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.2; Hertzmann, Zorin, *Illustrating smooth surfaces*, 2000; Loop 1987.
//!
//! **Fails when** a position or the camera is not finite, or the mesh would get too dense.
//!
//! **Cost** O(triangles + pixels that they cover + lines × triangles near them) a frame. With `follow` frames run in order.
//!
//! ```ron
//! "lines": (type: "mesh.silhouette", mesh: "@skin", camera: "@camera", crease_deg: 40.0, smooth: 2),
//! ```

use pegbar_engine::node::{Context, In, NodeError, Recurrent};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Value};

use crate::algo::camera;
use crate::algo::mesh_lines::{Known, Line, Search, find, number};
use crate::algo::silhouette::{Kind, Lines};
use crate::data::{Camera, Curves, Mesh};
use crate::render::{limited, seen_by};

/// Silhouettes, borders, creases and intersections of a mesh as chains of points on its edges.
///
/// The longest on the screen come first. A line keeps its number over time, as long as most of it lies along what it was.
#[derive(Node)]
#[node(
    id = "mesh.silhouette",
    version = 3,
    kind = recurrent,
    outputs = MeshSilhouetteOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.2; Hertzmann, Zorin 2000",
    example = "\"lines\": (type: \"mesh.silhouette\", mesh: \"@skin\", camera: \"@camera\", crease_deg: 40.0, smooth: 2)"
)]
pub(crate) struct MeshSilhouette {
    /// The mesh.
    pub(crate) mesh: In<Mesh>,
    /// Where it is seen from, and how large the picture is.
    pub(crate) camera: In<Camera>,
    /// Find where the surface turns away from the eye.
    #[input(default = true)]
    pub(crate) silhouettes: bool,
    /// Find the rims of an open mesh.
    #[input(default = true)]
    pub(crate) borders: bool,
    /// Edges bent by more than this are creases. 180 finds none.
    #[input(default = 40.0, range = 0.0..=180.0, unit = "°")]
    pub(crate) crease_deg: f64,
    /// Find where parts of the mesh run through each other.
    #[input(default = false)]
    pub(crate) intersections: bool,
    /// Edges bent by more than this break the surface: a silhouette then runs along them. 0 does so everywhere, 180 nowhere.
    #[input(default = 60.0, range = 0.0..=180.0, unit = "°")]
    pub(crate) hard_deg: f64,
    /// How often the mesh is made four times as dense before lines are looked for. 0 leaves it; more follow a coarse mesh's smooth shape.
    #[input(default = 0, range = 0..=6)]
    pub(crate) subdivide: u32,
    /// How often each vertex is moved to the mean of its neighbours before lines are looked for; the volume is kept. 0 leaves the mesh as it is, 2 takes
    /// small bumps out, many melt it.
    #[input(default = 0, range = 0..=100)]
    pub(crate) smooth: u32,
    /// Leave out what something hides: lines are cut where they go behind.
    #[input(default = false)]
    pub(crate) visible_only: bool,
    /// Leave out lines shorter than this on the screen. 0 keeps all.
    #[input(default = 0.0, range = 0.0..=65536.0, unit = "px")]
    pub(crate) min_length: f64,
    /// Lines keep their numbers from frame to frame. Without, those of each frame are numbered from 1, and any frame is made by itself.
    #[input(default = true)]
    pub(crate) follow: bool,
}

/// The lines.
#[derive(Outputs)]
pub(crate) struct MeshSilhouetteOutputs {
    /// Chains of points on the edges of the mesh, and their places in the picture.
    pub(crate) curves: Curves,
    /// Number of lines.
    pub(crate) count: Curve,
}

/// The lines of the frame before, by what they lie on.
#[derive(Clone, Debug, Default, Value)]
pub(crate) struct LineState {
    /// The edge of each point.
    #[value(shape = "[n, 2]")]
    edges: Vec<[u32; 2]>,
    /// Where on it.
    #[value(shape = "[n]")]
    shares: Vec<f64>,
    /// Points of each line.
    #[value(shape = "[c]")]
    lengths: Vec<u32>,
    /// Its number.
    #[value(shape = "[c]")]
    ids: Vec<i64>,
    /// Its kind, as of `Curves`.
    #[value(shape = "[c]")]
    kinds: Vec<u8>,
    /// The next number that is free.
    #[value(shape = "[]")]
    next: i64,
}

/// Kinds and their numbers in [`Curves::kinds`].
const KINDS: [(Kind, u8); 5] = [(Kind::Silhouette, 1), (Kind::Border, 2), (Kind::Crease, 3), (Kind::Seam, 4), (Kind::Intersection, 6)];

fn code(kind: Kind) -> u8 {
    KINDS.iter().find(|k| k.0 == kind).map_or(0, |k| k.1)
}

impl LineState {
    /// Where the lines are on this frame's mesh. Those of a mesh of fewer vertices are forgotten.
    fn known(&self, mesh: &Mesh) -> Vec<Known> {
        let mut start = 0;
        let mut out = Vec::new();
        for ((&n, &id), &kind) in self.lengths.iter().zip(&self.ids).zip(&self.kinds) {
            let range = start..start + n as usize;
            start = range.end;
            let at = |v: u32| mesh.positions.get(v as usize).map(|p| nalgebra::Vector3::from(*p));
            let point = |i: usize| {
                let [a, b] = *self.edges.get(i)?;
                let (a, b) = (at(a)?, at(b)?);
                Some(a + (b - a) * *self.shares.get(i)?)
            };
            if let (Some(positions), Some(&(kind, _))) = (range.map(point).collect(), KINDS.iter().find(|k| k.1 == kind)) {
                out.push(Known { id, kind, positions });
            }
        }
        out
    }
}

impl MeshSilhouette {
    fn lines(&self, camera: &camera::Camera) -> Result<Vec<Line>, NodeError> {
        let lines = Lines {
            silhouettes: self.silhouettes,
            borders: self.borders,
            crease: (self.crease_deg < 180.0).then(|| self.crease_deg.to_radians()),
            seams: false,
            intersections: self.intersections,
        };
        let search = Search { lines, hard: self.hard_deg.to_radians(), subdivide: self.subdivide, smooth: self.smooth };
        let mut found =
            find(&self.mesh.positions, &self.mesh.triangles, camera, &search).map_err(|e| NodeError::input(format!("mesh: {e}")))?;
        if self.visible_only {
            found = found.into_iter().flat_map(visible).collect();
            found.sort_by(|a, b| b.length().total_cmp(&a.length()));
        }
        found.retain(|l| l.length() >= self.min_length);
        Ok(found)
    }
}

/// The parts of a line that are seen.
fn visible(mut line: Line) -> Vec<Line> {
    let Some(hidden) = line.points.iter().position(|p| !p.visible) else { return vec![line] };
    if line.closed {
        line.points.rotate_left(hidden);
    }
    let runs = line.points.split(|p| !p.visible).filter(|r| r.len() > 1);
    runs.map(|r| Line { kind: line.kind, closed: false, points: r.to_vec() }).collect()
}

/// Lines and their numbers as a value.
pub(super) fn curves_of(lines: &[Line], ids: Vec<i64>) -> Curves {
    let all = || lines.iter().flat_map(|l| &l.points);
    Curves {
        points: all().map(|p| p.pixel).collect(),
        lengths: lines.iter().map(|l| l.points.len() as u32).collect(),
        closed: lines.iter().map(|l| u8::from(l.closed)).collect(),
        ids,
        kinds: lines.iter().map(|l| code(l.kind)).collect(),
        visible: all().map(|p| u8::from(p.visible)).collect(),
        edges: all().map(|p| p.edge).collect(),
        shares: all().map(|p| p.share).collect(),
    }
}

impl Recurrent for MeshSilhouette {
    type State = LineState;

    fn run(self, state: Option<&LineState>, _cx: &Context) -> Result<(MeshSilhouetteOutputs, LineState), NodeError> {
        let camera = seen_by(&self.camera)?;
        let [width, height] = camera.size;
        limited(width, height)?;
        self.mesh.validate().map_err(|e| NodeError::input(format!("mesh: {e}")))?;
        let lines = self.lines(&camera)?;
        let (known, next) = state.map_or((Vec::new(), 1), |s| (s.known(&self.mesh), s.next));
        let ids = number(&lines, &known, next);
        let next = ids.iter().fold(next, |n, id| n.max(id + 1));
        let curves = curves_of(&lines, ids);
        let state = LineState {
            edges: curves.edges.clone(),
            shares: curves.shares.clone(),
            lengths: curves.lengths.clone(),
            ids: curves.ids.clone(),
            kinds: curves.kinds.clone(),
            next,
        };
        Ok((MeshSilhouetteOutputs { count: Curve { value: lines.len() as f64 }, curves }, state))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        (self.follow && cx.frame > cx.clock.first).then(|| cx.frame - 1)
    }
}
