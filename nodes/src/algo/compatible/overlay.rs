//! Polygons without a common diagonal: their triangulations overlaid in one convex polygon (Aronov, Seidel, Souvaine 1993).

use std::collections::BTreeMap;

use super::diagonals::{ears, quality};
use super::{Point, cross, lerp, sub};

/// Triangles that fill `ring` in every contour; crossings of diagonals are added to `points`.
pub(super) fn overlay(ring: &[usize], points: &mut [Vec<Point>]) -> Vec<[usize; 3]> {
    let common = convex(ring.len());
    let local: Vec<usize> = (0..ring.len()).collect();
    let corners: Vec<Vec<Point>> = points.iter().map(|p| ring.iter().map(|&i| p[i]).collect()).collect();
    let own: Vec<Vec<[usize; 3]>> = corners.iter().map(|p| ears(p, &local)).collect();
    let mut plane = Plane { place: common, ring: ring.to_vec(), on: BTreeMap::new() };
    for triangles in &own {
        plane.add_diagonals(triangles);
    }
    plane.cross(&corners, &own, points);
    plane.faces().iter().flat_map(|face| plane.fan(face, points)).collect()
}

/// A convex polygon in which no three diagonals meet, for all that rounding says.
fn convex(m: usize) -> Vec<Point> {
    let mut state = 0x9E37_79B9_u32;
    let angle = |i: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (i as f64 + f64::from(state >> 8) / f64::from(1 << 25)) * std::f64::consts::TAU / m as f64
    };
    (0..m).map(angle).map(|a| [libm::cos(a), libm::sin(a)]).collect()
}

/// The arrangement of all diagonals in the convex polygon.
struct Plane {
    /// Places of corners and crossings in the convex polygon.
    place: Vec<Point>,
    /// The point of the mesh that each is.
    ring: Vec<usize>,
    /// For each diagonal the crossings on it, as (parameter, place).
    on: BTreeMap<(usize, usize), Vec<(f64, usize)>>,
}

impl Plane {
    fn add_diagonals(&mut self, triangles: &[[usize; 3]]) {
        let m = self.ring.len();
        for t in triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let (a, b) = (a.min(b), a.max(b));
                if b - a > 1 && (a, b) != (0, m - 1) {
                    self.on.entry((a, b)).or_default();
                }
            }
        }
    }

    /// Finds where diagonals cross, and where those points are in each contour.
    fn cross(&mut self, corners: &[Vec<Point>], own: &[Vec<[usize; 3]>], points: &mut [Vec<Point>]) {
        let diagonals: Vec<(usize, usize)> = self.on.keys().copied().collect();
        for (k, &(a, b)) in diagonals.iter().enumerate() {
            for &(c, d) in &diagonals[k + 1..] {
                // In a convex polygon diagonals cross where their ends alternate.
                if !(a < c && c < b && b < d) {
                    continue;
                }
                let (p, q) = (self.place[a], self.place[c]);
                let (u, v) = (sub(self.place[b], p), sub(self.place[d], q));
                let area = cross(u, v);
                let (s, t) = (cross(sub(q, p), v) / area, cross(sub(q, p), u) / area);
                let at = self.place.len();
                self.place.push(lerp(p, self.place[b], s));
                self.ring.push(points[0].len());
                for ((corner, triangles), points) in corners.iter().zip(own).zip(points.iter_mut()) {
                    points.push(self.image(corner, triangles, [(a, b, s), (c, d, t)], at));
                }
                self.on.entry((a, b)).or_default().push((s, at));
                self.on.entry((c, d)).or_default().push((t, at));
            }
        }
        self.on.values_mut().for_each(|v| v.sort_by(|x, y| x.0.total_cmp(&y.0)));
    }

    /// Where a crossing is in one contour: on its own diagonal if it has one of the two, else in one of its triangles.
    fn image(&self, corner: &[Point], triangles: &[[usize; 3]], pair: [(usize, usize, f64); 2], at: usize) -> Point {
        let has = |a, b| triangles.iter().any(|t| t.contains(&a) && t.contains(&b));
        if let Some((a, b, s)) = pair.into_iter().find(|&(a, b, _)| has(a, b)) {
            return lerp(corner[a], corner[b], s);
        }
        let shares = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| self.place[i]);
            let p = self.place[at];
            let area = cross(sub(b, a), sub(c, a));
            [cross(sub(b, p), sub(c, p)) / area, cross(sub(c, p), sub(a, p)) / area, cross(sub(a, p), sub(b, p)) / area]
        };
        let least = |w: [f64; 3]| w[0].min(w[1]).min(w[2]);
        let inside = triangles.iter().map(|t| (t, shares(t))).max_by(|x, y| least(x.1).total_cmp(&least(y.1)));
        inside.map_or([0.0; 2], |(t, w)| [0, 1].map(|k| (0..3).map(|i| w[i] * corner[t[i]][k]).sum()))
    }

    /// The faces between diagonals, each convex, in the positive sense.
    fn faces(&self) -> Vec<Vec<usize>> {
        let mut around = self.neighbours();
        for (v, list) in around.iter_mut().enumerate() {
            let angle = |&u: &usize| {
                let d = sub(self.place[u], self.place[v]);
                libm::atan2(d[1], d[0])
            };
            list.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        }
        let mut used = std::collections::BTreeSet::new();
        let mut faces = Vec::new();
        for v in 0..around.len() {
            for &u in &around[v] {
                let face = walk(&around, &mut used, v, u);
                let area: f64 = (0..face.len()).map(|i| cross(self.place[face[i]], self.place[face[(i + 1) % face.len()]])).sum();
                if face.len() > 2 && area > 0.0 {
                    faces.push(face);
                }
            }
        }
        faces
    }

    fn neighbours(&self) -> Vec<Vec<usize>> {
        let mut around = vec![Vec::new(); self.place.len()];
        let mut join = |a: usize, b: usize| {
            around[a].push(b);
            around[b].push(a);
        };
        let crossings: usize = self.on.values().map(Vec::len).sum::<usize>() / 2;
        let m = self.place.len() - crossings;
        (0..m).for_each(|i| join(i, (i + 1) % m));
        for (&(a, b), on) in &self.on {
            let mut last = a;
            for &(_, at) in on {
                join(last, at);
                last = at;
            }
            join(last, b);
        }
        around
    }

    /// A convex face as a fan from the corner that makes the best triangles in all contours.
    fn fan(&self, face: &[usize], points: &[Vec<Point>]) -> Vec<[usize; 3]> {
        let m = face.len();
        let fan = |s: usize| -> Vec<[usize; 3]> {
            (1..m - 1).map(|k| [face[s], face[(s + k) % m], face[(s + k + 1) % m]].map(|i| self.ring[i])).collect()
        };
        let worst = |triangles: &[[usize; 3]]| {
            let each = points.iter().flat_map(|p| triangles.iter().map(|t| quality(t.map(|i| p[i]))));
            each.fold(f64::INFINITY, f64::min)
        };
        (0..m).map(fan).max_by(|a, b| worst(a).total_cmp(&worst(b))).unwrap_or_default()
    }
}

/// Follows the face to the left of v-u.
fn walk(around: &[Vec<usize>], used: &mut std::collections::BTreeSet<(usize, usize)>, mut v: usize, mut u: usize) -> Vec<usize> {
    let mut face = Vec::new();
    while used.insert((v, u)) {
        face.push(v);
        let at = around[u].iter().position(|&w| w == v).unwrap_or(0);
        // The neighbour before the way back, in the order of angles, keeps the face on the left.
        let next = around[u][(at + around[u].len() - 1) % around[u].len()];
        (v, u) = (u, next);
    }
    face
}
