//! Diagonals that lie inside every contour, and the best triangulation that they make.

use super::{Point, dot, orient, sub};

/// What common diagonals make of the contours.
pub(super) struct Parts {
    /// Triangles whose sides are common diagonals or edges.
    pub(super) triangles: Vec<[usize; 3]>,
    /// Polygons, by point, that have no common diagonal.
    pub(super) holes: Vec<Vec<usize>>,
}

/// Triangulates a simple polygon of positive area by cutting ears: `ring` names its corners among `points`.
///
/// Flat corners are kept; no triangle is flat. Cost: O(n²) to O(n³).
pub(super) fn ears(points: &[Point], ring: &[usize]) -> Vec<[usize; 3]> {
    let mut ring = ring.to_vec();
    let mut triangles = Vec::with_capacity(ring.len());
    while ring.len() > 3 {
        let n = ring.len();
        let corner = |i: usize| [ring[(i + n - 1) % n], ring[i], ring[(i + 1) % n]];
        // The best ear by shape, so that slivers are not left for last.
        let best = (0..n)
            .filter(|&i| is_ear(points, &ring, corner(i)))
            .map(|i| (i, quality(corner(i).map(|c| points[c]))))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        // A simple polygon always has an ear; the first corner stands in where it is not simple.
        let i = best.map_or(0, |(i, _)| i);
        triangles.push(corner(i));
        ring.remove(i);
    }
    if let [a, b, c] = ring[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

fn is_ear(points: &[Point], ring: &[usize], [a, b, c]: [usize; 3]) -> bool {
    let (pa, pb, pc) = (points[a], points[b], points[c]);
    if orient(pa, pb, pc) <= 0.0 {
        return false;
    }
    let inside = |p: Point| orient(pa, pb, p) >= 0.0 && orient(pb, pc, p) >= 0.0 && orient(pc, pa, p) >= 0.0;
    let (low, high) = ([0, 1].map(|k| pa[k].min(pb[k]).min(pc[k])), [0, 1].map(|k| pa[k].max(pb[k]).max(pc[k])));
    let near = |p: Point| (0..2).all(|k| low[k] <= p[k] && p[k] <= high[k]);
    !ring.iter().any(|&v| v != a && v != b && v != c && near(points[v]) && inside(points[v]))
}

/// 1 for an equilateral triangle, 0 for a flat one, negative for one turned over: 4 √3 area over the sum of squared sides.
pub(super) fn quality([a, b, c]: [Point; 3]) -> f64 {
    let (u, v, w) = (sub(b, a), sub(c, b), sub(a, c));
    let sides = dot(u, u) + dot(v, v) + dot(w, w);
    let area = u[0] * (c[1] - a[1]) - u[1] * (c[0] - a[0]);
    if sides > 0.0 { 2.0 * 1.732_050_807_568_877_2 * area / sides } else { -1.0 }
}

/// A square table of whether two corners see each other.
struct Sight {
    n: usize,
    seen: Vec<bool>,
}

impl Sight {
    fn get(&self, i: usize, j: usize) -> bool {
        self.seen[i * self.n + j]
    }

    /// What is seen in every contour.
    fn common(contours: &[Vec<Point>]) -> Self {
        let n = contours[0].len();
        let mut all = Self { n, seen: vec![true; n * n] };
        for points in contours {
            let own = Self::of(points);
            all.seen.iter_mut().zip(own.seen).for_each(|(a, b)| *a &= b);
        }
        all
    }

    /// Which corners see each other inside one contour, strictly: nothing lies on the line between them.
    ///
    /// From each corner a cone is followed through a triangulation and narrowed at the corners that it passes. Cost: O(n) to O(n²) a corner.
    fn of(points: &[Point]) -> Self {
        let n = points.len();
        let ring: Vec<usize> = (0..n).collect();
        let triangles = ears(points, &ring);
        let mut across = std::collections::BTreeMap::new();
        for &[a, b, c] in &triangles {
            across.extend([((a, b), c), ((b, c), a), ((c, a), b)]);
        }
        let mut sight = Self { n, seen: vec![false; n * n] };
        for &[a, b, c] in &triangles {
            for [i, right, left] in [[a, b, c], [b, c, a], [c, a, b]] {
                sight.look(points, &across, i, [right, left]);
            }
        }
        sight
    }

    /// Follows the cone from `i` through the edge right-left of a triangle that holds it.
    fn look(&mut self, points: &[Point], across: &std::collections::BTreeMap<(usize, usize), usize>, i: usize, edge: [usize; 2]) {
        self.seen[i * self.n + edge[0]] = true;
        self.seen[i * self.n + edge[1]] = true;
        let mut open = vec![(edge, edge)];
        while let Some(([right, left], [low, high])) = open.pop() {
            let Some(&next) = across.get(&(left, right)) else { continue };
            let above = orient(points[i], points[low], points[next]);
            let below = orient(points[i], points[next], points[high]);
            if above > 0.0 && below > 0.0 {
                self.seen[i * self.n + next] = true;
                open.extend([([right, next], [low, next]), ([next, left], [next, high])]);
            } else if above > 0.0 {
                open.push(([right, next], [low, high]));
            } else {
                open.push(([next, left], [low, high]));
            }
        }
    }
}

/// Cheapest triangulations by common diagonals of the polygons cut off by each chord (Klincsek 1980).
struct Plan {
    n: usize,
    /// For chord i to i + len: the cost, infinite where there is none.
    cost: Vec<f64>,
    /// The corner of the triangle on the chord.
    apex: Vec<u32>,
}

impl Plan {
    fn new(contours: &[Vec<Point>], sight: &Sight) -> Self {
        let n = sight.n;
        let mut plan = Self { n, cost: vec![f64::INFINITY; n * n], apex: vec![0; n * n] };
        for i in 0..n {
            plan.cost[i * n + 1] = 0.0;
        }
        for len in 2..n {
            for i in 0..n {
                let j = (i + len) % n;
                if len < n - 1 && !sight.get(i, j) {
                    continue;
                }
                let (mut best, mut apex) = (f64::INFINITY, 0);
                for k in 1..len {
                    let sum = plan.cost[i * n + k] + plan.cost[(i + k) % n * n + len - k];
                    if sum < best {
                        let cost = sum + triangle_cost(contours, [i, (i + k) % n, j]);
                        if cost < best {
                            (best, apex) = (cost, k as u32);
                        }
                    }
                }
                plan.cost[i * n + len] = best;
                plan.apex[i * n + len] = apex;
            }
        }
        plan
    }

    fn is_solved(&self, i: usize, len: usize) -> bool {
        self.cost[i * self.n + len].is_finite()
    }

    /// The triangles of the polygon i..=i + len.
    fn triangles(&self, i: usize, len: usize, out: &mut Vec<[usize; 3]>) {
        let mut open = vec![(i, len)];
        while let Some((i, len)) = open.pop() {
            if len < 2 {
                continue;
            }
            let k = self.apex[i * self.n + len] as usize;
            out.push([i, (i + k) % self.n, (i + len) % self.n]);
            open.extend([(i, k), ((i + k) % self.n, len - k)]);
        }
    }
}

/// Slivers are dear in any contour.
fn triangle_cost(contours: &[Vec<Point>], t: [usize; 3]) -> f64 {
    let worst = contours.iter().map(|p| quality(t.map(|i| p[i]))).fold(f64::INFINITY, f64::min);
    if worst > 0.0 { 1.0 / worst } else { f64::INFINITY }
}

/// Cuts contours of positive area along common diagonals.
pub(super) fn partition(contours: &[Vec<Point>]) -> Parts {
    let n = contours[0].len();
    let sight = Sight::common(contours);
    let plan = Plan::new(contours, &sight);
    let mut parts = Parts { triangles: Vec::new(), holes: Vec::new() };
    if let Some(i) =
        (0..n).filter(|&i| plan.is_solved(i, n - 1)).min_by(|&a, &b| plan.cost[a * n + n - 1].total_cmp(&plan.cost[b * n + n - 1]))
    {
        plan.triangles(i, n - 1, &mut parts.triangles);
        return parts;
    }
    let mut open = vec![cut_off(&plan, &mut parts.triangles)];
    while let Some(ring) = open.pop() {
        match balanced(&ring, &sight) {
            Some((a, b)) => {
                let inner = ring[a..=b].to_vec();
                let outer = ring[b..].iter().chain(&ring[..=a]).copied().collect();
                for half in [inner, outer] {
                    if let [a, b, c] = half[..] { parts.triangles.push([a, b, c]) } else { open.push(half) }
                }
            }
            None => parts.holes.push(ring),
        }
    }
    parts
}

/// Cuts off the longest chords that are solved; what stays, as a ring.
fn cut_off(plan: &Plan, triangles: &mut Vec<[usize; 3]>) -> Vec<usize> {
    let n = plan.n;
    let mut kept = vec![true; n];
    for len in (2..n - 1).rev() {
        for i in 0..n {
            let free = (0..=len).all(|k| kept[(i + k) % n]);
            if plan.is_solved(i, len) && free && kept.iter().filter(|k| **k).count() - (len - 1) >= 4 {
                plan.triangles(i, len, triangles);
                (1..len).for_each(|k| kept[(i + k) % n] = false);
            }
        }
    }
    (0..n).filter(|&i| kept[i]).collect()
}

/// The common diagonal of a ring that halves it best.
fn balanced(ring: &[usize], sight: &Sight) -> Option<(usize, usize)> {
    let m = ring.len();
    let pairs = (0..m).flat_map(|a| (a + 2..m).map(move |b| (a, b))).filter(|&(a, b)| (b + 1) % m != a);
    pairs.filter(|&(a, b)| sight.get(ring[a], ring[b])).min_by_key(|&(a, b)| (2 * (b - a)).abs_diff(m))
}
