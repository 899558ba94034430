//! The lines of a mesh as a camera sees them, as points on the edges of the mesh, with visibility, and with numbers that stay over time.
//!
//! Lines are found on a fairer surface where that is asked for; their points are then those where the lines cross edges of the mesh itself.
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, section 3.2; see [`super::silhouette`] for the lines and [`super::fairing`] for the surface.

use nalgebra::Vector3;

use super::camera::Camera;
use super::fairing::{Fair, MOST, Origin, mixed};
use super::silhouette::{Chain, Kind, Lines, chains};
use super::surface::{Part, Surface, SurfaceError};
use super::visibility::{DepthBuffer, Seen, Sight};

/// Gaps and pieces shorter than this many pixels are noise of the depth buffer.
const NOISE: f64 = 4.0;

/// How lines are looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Which ones.
    pub lines: Lines,
    /// Edges bent by more than this break the surface's normals, radians.
    pub hard: f64,
    /// How often the surface is made denser first.
    pub subdivide: u32,
    /// How often it is smoothed first.
    pub smooth: u32,
}

/// What keeps lines from being found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LineError {
    /// Of the mesh.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Denser than is made.
    #[error("expected at most {MOST} triangles after subdivision, found {found}")]
    Dense {
        /// Triangles that there would be.
        found: usize,
    },
}

/// A point on an edge of the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinePoint {
    /// The edge's vertices, the same one twice at a vertex.
    pub edge: [u32; 2],
    /// 0 at the first, 1 at the second.
    pub share: f64,
    /// Where it is in the world.
    pub position: Vector3<f64>,
    /// Column and row; NaN behind the camera.
    pub pixel: [f64; 2],
    /// True where nothing hides it.
    pub visible: bool,
    /// True where it lies on the outermost outline: next to nothing at all.
    pub outline: bool,
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What it shows.
    pub kind: Kind,
    /// True where its last point joins its first.
    pub closed: bool,
    /// Its points.
    pub points: Vec<LinePoint>,
}

impl Line {
    /// Its length on the screen, pixels, as far as it is before the camera.
    pub fn length(&self) -> f64 {
        let whole: f64 = self.points.windows(2).map(|p| distance(p[0].pixel, p[1].pixel)).filter(|d| d.is_finite()).sum();
        let last = self.points.first().zip(self.points.last()).map_or(0.0, |(a, b)| distance(a.pixel, b.pixel));
        if self.closed && last.is_finite() { whole + last } else { whole }
    }
}

/// Between two points of the picture.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// The lines of a mesh as a camera sees it, the longest on the screen first. Cost: O(triangles + pixels that they cover).
///
/// # Errors
/// Where a position is not finite, a triangle has a vertex that there is not, or the surface would get too dense.
pub fn find(positions: &[[f64; 3]], triangles: &[[u32; 3]], camera: &Camera, search: &Search) -> Result<Vec<Line>, LineError> {
    let base = Surface::new(&[Part { positions, triangles, normals: &[] }], search.hard)?;
    let depths = DepthBuffer::new(&base, camera);
    let sight = Sight::new(&base, camera, depths.depths());
    let tracks = tracks(&base, camera, search)?;
    let mut lines: Vec<Line> = tracks.into_iter().map(|t| t.seen(&base, &sight)).collect();
    lines.sort_by(|a, b| b.length().total_cmp(&a.length()));
    Ok(lines)
}

/// A line as places on edges of the mesh.
struct Track {
    kind: Kind,
    closed: bool,
    places: Vec<([u32; 2], f64)>,
}

fn tracks(base: &Surface, camera: &Camera, search: &Search) -> Result<Vec<Track>, LineError> {
    let whole = |c: &Chain| Track { kind: c.kind, closed: c.closed, places: c.points.iter().map(|p| (p.vertices, p.t)).collect() };
    if search.subdivide == 0 && search.smooth == 0 {
        return Ok(chains(base, camera.toward(), search.lines, |_| false).iter().map(whole).collect());
    }
    let mut fair = Fair::new(base);
    let found = fair.triangles.len().saturating_mul(4_usize.saturating_pow(search.subdivide));
    if found > MOST {
        return Err(LineError::Dense { found });
    }
    // What is sharp stays sharp, unless nothing is.
    let sharp = search.lines.crease.unwrap_or(search.hard);
    (0..search.subdivide).try_for_each(|_| fair.subdivide(sharp))?;
    fair.smooth(search.smooth)?;
    let surface = fair.surface(search.hard)?;
    let found = chains(&surface, camera.toward(), search.lines, |_| false);
    Ok(found.iter().filter_map(|c| back(c, &fair, base)).collect())
}

/// A chain of the fair surface as places where it crosses edges of the mesh. One that stays within a triangle goes to the nearest of its edges.
fn back(chain: &Chain, fair: &Fair, base: &Surface) -> Option<Track> {
    let origin = |p: &super::silhouette::EdgePoint| -> Origin {
        let [a, b] = p.vertices.map(|v| &fair.origins[v as usize]);
        mixed(a, b, p.t).into_iter().filter(|o| o.1 > 1e-9).collect()
    };
    let all: Vec<Origin> = chain.points.iter().map(origin).collect();
    let on_edges: Vec<&Origin> = all.iter().filter(|o| o.len() < 3).collect();
    let least = if chain.closed { 3 } else { 2 };
    let mut places: Vec<([u32; 2], f64)> = if on_edges.len() >= least {
        on_edges.into_iter().filter_map(|o| place(o, base)).collect()
    } else {
        all.iter().filter_map(|o| place(o, base)).collect()
    };
    places.dedup();
    (places.len() >= 2).then_some(Track { kind: chain.kind, closed: chain.closed && places.len() > 2, places })
}

/// The nearest point of an edge to a mean of vertices.
fn place(origin: &Origin, base: &Surface) -> Option<([u32; 2], f64)> {
    let mut heaviest = origin.clone();
    heaviest.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    heaviest.truncate(2);
    heaviest.sort_by_key(|o| o.0);
    match heaviest[..] {
        [(v, _)] => Some(([base.first[v as usize]; 2], 0.0)),
        [(a, wa), (b, wb)] => Some(([base.first[a as usize], base.first[b as usize]], wb / (wa + wb))),
        _ => None,
    }
}

impl Track {
    fn seen(self, base: &Surface, sight: &Sight<'_>) -> Line {
        let point = |&(edge, share): &([u32; 2], f64)| {
            let [a, b] = edge.map(|v| base.positions[v as usize]);
            let position = a + (b - a) * share;
            let Some((pixel, near)) = sight.place(&position) else {
                return LinePoint { edge, share, position, pixel: [f64::NAN; 2], visible: false, outline: false };
            };
            let visible = sight.seen(pixel, near, self.kind) == Seen::Yes;
            LinePoint { edge, share, position, pixel, visible, outline: visible && sight.is_outline(pixel) }
        };
        let mut points: Vec<LinePoint> = self.places.iter().map(point).collect();
        for wanted in [true, false] {
            settle(&mut points, wanted);
        }
        Line { kind: self.kind, closed: self.closed, points }
    }
}

/// Closes gaps (`visible`) or drops pieces that are too short to be real.
fn settle(points: &mut [LinePoint], visible: bool) {
    let mut start = 0;
    while start < points.len() {
        let here = points[start].visible;
        let end = points[start..].iter().position(|p| p.visible != here).map_or(points.len(), |i| i + start);
        let (from, to) = (start.saturating_sub(1), (end + 1).min(points.len()));
        let length: f64 = points[from..to].windows(2).map(|p| distance(p[0].pixel, p[1].pixel)).sum();
        if here != visible && start > 0 && end < points.len() && length < NOISE {
            points[start..end].iter_mut().for_each(|p| p.visible = visible);
        }
        start = end;
    }
}

/// Lines of the frame before, wherever their points are by now.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// Their number.
    pub id: i64,
    /// What they show.
    pub kind: Kind,
    /// Where their points are on the mesh of this frame.
    pub positions: Vec<Vector3<f64>>,
}

/// Numbers for lines: those of the known ones of the same kind that most of each lies along, each given once, and fresh ones from `next` on for the rest.
/// Cost: O(points · known points), less where they lie apart.
pub fn number(lines: &[Line], known: &[Known], next: i64) -> Vec<i64> {
    let mut votes: Vec<(f64, usize, usize)> = Vec::new();
    for (l, line) in lines.iter().enumerate() {
        let rivals: Vec<(usize, Vector3<f64>)> = known
            .iter()
            .enumerate()
            .filter(|(_, k)| k.kind == line.kind)
            .flat_map(|(i, k)| k.positions.iter().map(move |p| (i, *p)))
            .collect();
        let nearest = Nearest::new(&rivals);
        let mut own = vec![0.0; known.len()];
        for (i, p) in line.points.iter().enumerate() {
            let before = i.checked_sub(1).map_or(0.0, |j| (line.points[j].position - p.position).norm());
            let after = line.points.get(i + 1).map_or(0.0, |q| (q.position - p.position).norm());
            if let Some(k) = nearest.find(&p.position) {
                own[k] += before + after;
            }
        }
        votes.extend(own.into_iter().enumerate().filter(|(_, v)| *v > 0.0).map(|(k, v)| (v, l, k)));
    }
    votes.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut ids, mut taken) = (vec![None; lines.len()], vec![false; known.len()]);
    for (_, l, k) in votes {
        if ids[l].is_none() && !taken[k] {
            (ids[l], taken[k]) = (Some(known[k].id), true);
        }
    }
    let mut fresh = next - 1;
    ids.into_iter()
        .map(|id| {
            id.unwrap_or_else(|| {
                fresh += 1;
                fresh
            })
        })
        .collect()
}

/// Points sorted along x, to be searched from the middle outwards.
struct Nearest {
    points: Vec<(usize, Vector3<f64>)>,
}

impl Nearest {
    fn new(points: &[(usize, Vector3<f64>)]) -> Self {
        let mut points = points.to_vec();
        points.sort_by(|a, b| a.1.x.total_cmp(&b.1.x).then(a.0.cmp(&b.0)));
        Self { points }
    }

    fn find(&self, p: &Vector3<f64>) -> Option<usize> {
        let start = self.points.partition_point(|q| q.1.x < p.x);
        let mut best: Option<(f64, usize)> = None;
        let mut look = |points: &mut dyn Iterator<Item = &(usize, Vector3<f64>)>| {
            for (owner, q) in points {
                let most = best.map_or(f64::INFINITY, |b| b.0);
                if (q.x - p.x) * (q.x - p.x) > most {
                    break;
                }
                let d = (q - p).norm_squared();
                if d < most || best.is_some_and(|b| d == b.0 && *owner < b.1) {
                    best = Some((d, *owner));
                }
            }
        };
        look(&mut self.points[start..].iter());
        look(&mut self.points[..start].iter().rev());
        best.map(|b| b.1)
    }
}

#[cfg(test)]
#[path = "mesh_lines_tests.rs"]
mod tests;
