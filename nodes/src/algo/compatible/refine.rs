//! Fewer points where diagonals were overlaid, more where the contours are wide, all of them where angles are good.

use super::mesh::{Mesh, shape};
use super::{Options, Point, dot, sub};

/// Rounds of collapsing; each leaves fewer points, and nearly all go in the first three.
const ROUNDS: usize = 8;
/// Sweeps of flips and moves after points have been added or removed.
const SWEEPS: usize = 6;
/// Sweeps of the last moves, which lessen distortion.
const LAST_SWEEPS: usize = 12;
/// A point is collapsed where triangles better than this stay.
const COLLAPSE_FROM: f64 = 0.02;

/// Triangles of at least this shape are left where they are; an angle of 30 degrees has about this.
const GOOD: f64 = 0.7;

/// Makes a valid or nearly valid mesh a good one.
pub(super) fn improve(mesh: &mut Mesh, options: Options) {
    for round in 0..ROUNDS {
        let removed = (mesh.n_contour..mesh.n_points()).filter(|&v| mesh.is_free(v) && collapsible(mesh, v)).count();
        polish(mesh, 2);
        if removed == 0 && round > 0 {
            break;
        }
    }
    polish(mesh, SWEEPS);
    if options.spacing.is_finite() {
        refine(mesh, options);
    }
    (0..LAST_SWEEPS).for_each(|_| relax(mesh));
    polish(mesh, 1);
}

fn collapsible(mesh: &mut Mesh, v: usize) -> bool {
    let star: Vec<[usize; 3]> = mesh.around(v).collect();
    let least = mesh.worst(&star).clamp(f64::MIN_POSITIVE, COLLAPSE_FROM);
    mesh.collapse(v, least)
}

/// Flips and moves, until neither helps or `sweeps` are done.
fn polish(mesh: &mut Mesh, sweeps: usize) {
    for _ in 0..sweeps {
        let flips = mesh.inner_edges().into_iter().filter(|&(a, b)| mesh.flip(a, b)).count();
        let moves = (mesh.n_contour..mesh.n_points()).filter(|&v| mesh.is_free(v) && smooth(mesh, v)).count();
        if flips + moves == 0 {
            break;
        }
    }
}

/// Moves an interior point in each contour where that betters the worst triangle at it.
fn smooth(mesh: &mut Mesh, v: usize) -> bool {
    let star: Vec<[usize; 3]> = mesh.around(v).collect();
    let neighbours = mesh.neighbours(v);
    let mut moved = false;
    for p in &mut mesh.points {
        let worst = |at: Point| star.iter().map(|t| shape(t.map(|i| if i == v { at } else { p[i] }))).fold(f64::INFINITY, f64::min);
        let (start, old) = (p[v], worst(p[v]));
        if old > GOOD {
            continue;
        }
        let found = climb(start, reach(p, v, &neighbours), Some(centre(p, &neighbours)), &worst);
        if worst(found) > old + 1e-6 {
            p[v] = found;
            moved = true;
        }
    }
    moved
}

/// Mean distance to the neighbours.
fn reach(p: &[Point], v: usize, neighbours: &[usize]) -> f64 {
    let sum: f64 = neighbours.iter().map(|&u| length(sub(p[u], p[v]))).sum();
    sum / neighbours.len().max(1) as f64
}

fn length(v: Point) -> f64 {
    dot(v, v).sqrt()
}

fn centre(p: &[Point], of: &[usize]) -> Point {
    [0, 1].map(|k| of.iter().map(|&u| p[u][k]).sum::<f64>() / of.len().max(1) as f64)
}

/// The best of a pattern of steps around a point, steps halved as they fail.
fn climb(start: Point, reach: f64, guess: Option<Point>, value: &impl Fn(Point) -> f64) -> Point {
    let (mut at, mut best) = (start, value(start));
    if let Some(guess) = guess
        && value(guess) > best
    {
        (at, best) = (guess, value(guess));
    }
    let mut step = 0.3 * reach;
    for _ in 0..6 {
        let tries = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step], [step, step], [-step, step], [step, -step], [-step, -step]];
        let found = tries.map(|d| [at[0] + d[0], at[1] + d[1]]).map(|p| (p, value(p)));
        let top = found.into_iter().fold((at, best), |a, b| if b.1 > a.1 { b } else { a });
        if top.1 > best {
            (at, best) = top;
        } else {
            step *= 0.5;
        }
    }
    at
}

/// Splits edges that are long against the contour's own spacing, the worst first.
fn refine(mesh: &mut Mesh, options: Options) {
    let most = mesh.n_contour + (options.most_inner * mesh.n_contour as f64) as usize;
    let mut sizes: Vec<Vec<f64>> = mesh.points.iter().map(|p| contour_sizes(&p[..mesh.n_contour])).collect();
    for (p, size) in mesh.points.iter().zip(&mut sizes) {
        for v in size.len()..p.len() {
            let near = mesh.neighbours(v);
            // A point that has vanished has no neighbours and is never asked.
            size.push(if near.is_empty() { 1.0 } else { reach(p, v, &near) });
        }
    }
    let mut free = mesh.n_contour + (mesh.n_contour..mesh.n_points()).filter(|&v| mesh.is_free(v)).count();
    for _ in 0..12 {
        let long = |&(a, b): &(usize, usize)| {
            let each = mesh.points.iter().zip(&sizes).map(|(p, s)| length(sub(p[a], p[b])) * 2.0 / (s[a] + s[b]));
            each.fold(0.0, f64::max)
        };
        let mut edges: Vec<(f64, (usize, usize))> = mesh.inner_edges().iter().map(|e| (long(e), *e)).collect();
        edges.retain(|e| e.0 > options.spacing);
        edges.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
        let mut split = 0;
        for (_, (a, b)) in edges {
            if free < most && mesh.split(a, b) {
                // Triangles grow away from the contour.
                sizes.iter_mut().for_each(|s| s.push(0.55 * (s[a] + s[b])));
                (free, split) = (free + 1, split + 1);
            }
        }
        polish(mesh, SWEEPS);
        if split == 0 {
            break;
        }
    }
}

/// Mean length of the two edges at each point of a contour.
fn contour_sizes(points: &[Point]) -> Vec<f64> {
    let n = points.len();
    let edge = |i: usize| length(sub(points[(i + 1) % n], points[i]));
    (0..n).map(|i| (edge(i) + edge((i + n - 1) % n)) / 2.0).collect()
}

/// Moves interior points to where the triangles of each contour are least distorted against those of the first: the symmetric Dirichlet
/// energy (Smith, Schaefer 2015), which no step can cross into a turned triangle.
fn relax(mesh: &mut Mesh) {
    let Some((rest, others)) = mesh.points.split_first() else { return };
    let rest = rest.clone();
    let n_others = others.len();
    for v in mesh.n_contour..mesh.n_points() {
        if !mesh.is_free(v) {
            continue;
        }
        let star: Vec<[usize; 3]> = mesh.around(v).collect();
        let neighbours = mesh.neighbours(v);
        for k in 1..=n_others {
            let p = &mesh.points[k];
            let value =
                |at: Point| -star.iter().map(|t| distortion(t.map(|i| rest[i]), t.map(|i| if i == v { at } else { p[i] }))).sum::<f64>();
            let found = climb(p[v], reach(p, v, &neighbours), None, &value);
            // A move that makes a sliver is not worth its distortion.
            let worst = |at: Point| star.iter().map(|t| shape(t.map(|i| if i == v { at } else { p[i] }))).fold(f64::INFINITY, f64::min);
            if worst(found) > worst(p[v]).min(0.3) {
                mesh.points[k][v] = found;
            }
        }
    }
}

/// Area of `a` times |J|² + |J⁻¹|² of the map to `b`; infinite where `b` is turned.
fn distortion(a: [Point; 3], b: [Point; 3]) -> f64 {
    let (u, v) = (sub(a[1], a[0]), sub(a[2], a[0]));
    let (x, y) = (sub(b[1], b[0]), sub(b[2], b[0]));
    let (area, image) = (u[0] * v[1] - u[1] * v[0], x[0] * y[1] - x[1] * y[0]);
    if image <= 0.0 || area <= 0.0 {
        return f64::INFINITY;
    }
    // With J = [x y][u v]⁻¹, |J|² area² is this sum, and |J⁻¹| = |J| / det J in the plane.
    let sum = dot(x, x) * dot(v, v) - 2.0 * dot(x, y) * dot(u, v) + dot(y, y) * dot(u, u);
    sum / area + sum * area / (image * image)
}
