//! The lines of a mesh as a camera sees them, as points on the edges of the mesh, with visibility, and with numbers that stay over time.
//!
//! Lines are found on a fairer surface where that is asked for; their points are then those where the lines cross edges of the mesh itself.
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, section 3.2; see [`super::silhouette`] for the lines and [`super::fairing`] for the surface.

use nalgebra::Vector3;

use super::camera::Camera;
use super::fairing::{Fair, MOST, Origin, mixed};
use super::hidden::Hidden;
use super::silhouette::{Chain, Kind, Lines, chains};
use super::surface::{Part, Surface, SurfaceError};
use super::visibility::{DepthBuffer, Sight};
use super::zbuffer::project;

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

/// A place on an edge of the mesh: its vertices, the same one twice at a vertex, and the share of the way from the first to the second.
pub type Place = ([u32; 2], f64);

/// A point on an edge of the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinePoint {
    /// The edge's vertices, the same one twice at a vertex. Where a line goes behind something within a triangle, those of its nearer end.
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

/// The place a share of the way from one place to another, where both lie on one edge. Perspective is left out: it is the share on the mesh.
pub fn between(a: Place, b: Place, share: f64) -> Option<Place> {
    let mut weights: Vec<(u32, f64)> = Vec::with_capacity(4);
    for (([v, w], s), part) in [(a, 1.0 - share), (b, share)] {
        for (vertex, own) in [(v, 1.0 - s), (w, s)].into_iter().filter(|o| o.1 > 1e-9) {
            match weights.iter_mut().find(|o| o.0 == vertex) {
                Some(known) => known.1 += own * part,
                None => weights.push((vertex, own * part)),
            }
        }
    }
    weights.retain(|w| w.1 > 1e-9);
    weights.sort_by_key(|w| w.0);
    match weights[..] {
        [(v, _)] => Some(([v, v], 0.0)),
        [(v, a), (w, b)] => Some(([v, w], b / (a + b))),
        _ => None,
    }
}

/// The lines of a mesh as a camera sees it, the longest on the screen first, with a point more wherever one goes behind something. Cost: O(triangles + pixels
/// that they cover + lines × triangles near them).
///
/// # Errors
/// Where a position is not finite, a triangle has a vertex that there is not, or the surface would get too dense.
pub fn find(positions: &[[f64; 3]], triangles: &[[u32; 3]], camera: &Camera, search: &Search) -> Result<Vec<Line>, LineError> {
    let base = Surface::new(&[Part { positions, triangles, normals: &[] }], search.hard)?;
    let projected = project(&base, camera);
    let depths = DepthBuffer::of(&projected, camera.size);
    let view = View {
        base: &base,
        sight: Sight::new(&base, camera, depths.depths()),
        hidden: Hidden::new(&base, camera, &projected),
        fair: search.subdivide > 0 || search.smooth > 0,
    };
    let mut lines: Vec<Line> = tracks(&base, camera, search)?.iter().map(|t| view.line(t)).collect();
    lines.sort_by(|a, b| b.length().total_cmp(&a.length()));
    Ok(lines)
}

/// A line as places on edges of the mesh.
struct Track {
    kind: Kind,
    closed: bool,
    places: Vec<Place>,
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
    let mut places: Vec<Place> = if on_edges.len() >= least {
        on_edges.into_iter().filter_map(|o| place(o, base)).collect()
    } else {
        all.iter().filter_map(|o| place(o, base)).collect()
    };
    places.dedup();
    (places.len() >= 2).then_some(Track { kind: chain.kind, closed: chain.closed && places.len() > 2, places })
}

/// The nearest point of an edge to a mean of vertices.
fn place(origin: &Origin, base: &Surface) -> Option<Place> {
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

/// A place of a line on the screen.
struct Point {
    line: LinePoint,
    near: f64,
}

/// What a surface shows of lines on it.
struct View<'a> {
    base: &'a Surface,
    sight: Sight<'a>,
    hidden: Hidden<'a>,
    /// True where lines were looked for on a fairer surface, so that they lie on the mesh at their points alone.
    fair: bool,
}

impl View<'_> {
    fn line(&self, track: &Track) -> Line {
        let points: Vec<Point> = track.places.iter().map(|place| self.point(*place)).collect();
        let n = points.len();
        let ways = if track.closed { n } else { n - 1 };
        let parts: Vec<Vec<[f64; 2]>> = (0..ways).map(|i| self.parts(track.kind, &points[i], &points[(i + 1) % n])).collect();
        // A point is seen where the line is on either of its sides.
        let before = |i: usize| if i > 0 { Some(i - 1) } else { track.closed.then_some(ways - 1) };
        let seen = |i: usize| {
            parts.get(i).is_some_and(|p| p.first().is_none_or(|p| p[0] > 0.0))
                || before(i).is_some_and(|j| parts[j].last().is_none_or(|p| p[1] < 1.0))
        };
        let seen: Vec<bool> = (0..n).map(seen).collect();
        let mut out = Vec::with_capacity(n);
        for i in 0..n {
            out.push(LinePoint { visible: seen[i], ..points[i].line });
            let j = (i + 1) % n;
            for &[from, to] in parts.get(i).map_or(&[][..], Vec::as_slice) {
                let mut cut = |share: f64, visible: bool| out.push(LinePoint { visible, ..self.between(&points[i], &points[j], share) });
                if from > 0.0 {
                    cut(from, true);
                }
                // Between two points that are seen one says that the line is not.
                if (from > 0.0 || seen[i]) && (to < 1.0 || seen[j]) {
                    cut((from + to) / 2.0, false);
                }
                if to < 1.0 {
                    cut(to, true);
                }
            }
        }
        out.iter_mut().for_each(|p| p.outline = p.visible && self.sight.is_outline(p.pixel));
        Line { kind: track.kind, closed: track.closed, points: out }
    }

    fn point(&self, (edge, share): Place) -> Point {
        let [a, b] = edge.map(|v| self.base.positions[v as usize]);
        let position = a + (b - a) * share;
        let (pixel, near) = self.sight.place(&position).unwrap_or(([f64::NAN; 2], f64::NAN));
        Point { line: LinePoint { edge, share, position, pixel, visible: false, outline: false }, near }
    }

    /// What is hidden of the way between two points; all of it where one is behind the camera.
    fn parts(&self, kind: Kind, a: &Point, b: &Point) -> Vec<[f64; 2]> {
        if a.near.is_nan() || b.near.is_nan() {
            return vec![[0.0, 1.0]];
        }
        // A fair surface lies before and behind the mesh.
        let slack = if self.fair { 5.0 * self.sight.small } else { self.sight.least };
        self.hidden.of_kind(kind, [a, b].map(|p| p.line.edge), [a, b].map(|p| (p.line.pixel, p.near)), slack)
    }

    /// The point at a share of the way on the screen. Within a triangle it has the edge of the nearer end.
    fn between(&self, a: &Point, b: &Point, share: f64) -> LinePoint {
        let [from, to] = [(a, 1.0 - share), (b, share)].map(|(p, part)| self.sight.evenly(p.near) * part);
        let along = to / (from + to);
        let nearer = if share < 0.5 { a } else { b };
        let places = [a, b].map(|p| (p.line.edge, p.line.share));
        let (edge, own) = between(places[0], places[1], along).unwrap_or((nearer.line.edge, nearer.line.share));
        let position = a.line.position + (b.line.position - a.line.position) * along;
        let pixel = [0, 1].map(|k| a.line.pixel[k] + (b.line.pixel[k] - a.line.pixel[k]) * share);
        LinePoint { edge, share: own, position, pixel, visible: false, outline: false }
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
