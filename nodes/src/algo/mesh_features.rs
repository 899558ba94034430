//! Curves painted on a mesh, as points where they cross its edges.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 5: features inside of the outline, which lines of the mesh do not show, are named
//! there as work to do. Shortest ways along edges: Dijkstra 1959.

use super::mesh_lines::Place;
use super::shortest_way::shortest_way;
use super::surface::Surface;

/// A crossing of a painted line and an edge.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    /// How far along the painted line: segments, and the share of the last.
    along: f64,
    ends: [u32; 2],
    place: Place,
}

/// Where a painted line of points, in the plane of a picture or of a texture, crosses the edges of triangles, in its order. `corners` says where the corners of a triangle
/// lie in that plane, with the weight that runs evenly over it (1 over depth, or 1); `None` of one that is not painted on. Cost: O(triangles · segments).
pub fn crossings(surface: &Surface, line: &[[f64; 2]], corners: impl Fn(usize) -> Option<[([f64; 2], f64); 3]>) -> Vec<Place> {
    let mut found: Vec<Crossing> = Vec::new();
    for t in 0..surface.triangles.len() {
        let Some(corner) = corners(t) else { continue };
        let (vertices, joined) = (surface.triangles[t], surface.corners(t));
        for k in 0..3 {
            let l = (k + 1) % 3;
            // Both triangles of an edge see it from the same end, so that its crossings have the same bits.
            let (a, b) = if joined[k] <= joined[l] { (k, l) } else { (l, k) };
            let ((p, near_p), (q, near_q)) = (corner[a], corner[b]);
            for (s, segment) in line.windows(2).enumerate() {
                let Some((along, share)) = crossing([segment[0], segment[1]], [p, q]) else { continue };
                // What is half way in the picture is less than half way to what is further off.
                let (from, to) = ((1.0 - share) * near_p, share * near_q);
                let share = if from + to > 0.0 { to / (from + to) } else { share };
                let place = ([vertices[a], vertices[b]], share);
                found.push(Crossing { along: s as f64 + along, ends: [joined[a], joined[b]], place });
            }
        }
    }
    found.sort_by(|a, b| a.along.total_cmp(&b.along).then(a.ends.cmp(&b.ends)).then(a.place.0.cmp(&b.place.0)));
    // An edge is met once for each of its triangles, and a vertex once for each of its edges.
    found.dedup_by(|b, a| b.along - a.along < 1e-9);
    found.into_iter().map(|c| c.place).collect()
}

/// Where a segment crosses another: the shares of both. None where they run alike.
fn crossing([a, b]: [[f64; 2]; 2], [p, q]: [[f64; 2]; 2]) -> Option<(f64, f64)> {
    let apart = |k: usize| a[k].max(b[k]) < p[k].min(q[k]) || a[k].min(b[k]) > p[k].max(q[k]);
    if apart(0) || apart(1) {
        return None;
    }
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    let less = |u: [f64; 2], v: [f64; 2]| [u[0] - v[0], u[1] - v[1]];
    let (along, edge, to) = (less(b, a), less(q, p), less(p, a));
    let size = cross(along, edge);
    let (s, t) = (cross(to, edge) / size, cross(to, along) / size);
    ((0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t)).then_some((s, t))
}

/// What keeps a way from being found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WayError {
    /// A vertex that there is not.
    #[error("expected vertices below {n}, found {found}")]
    Vertex {
        /// Number of vertices.
        n: usize,
        /// The vertex.
        found: u32,
    },
    /// Two parts of a mesh that hang together nowhere.
    #[error("expected vertices that edges join, found no way from {from} to {to}")]
    Apart {
        /// One vertex.
        from: u32,
        /// The other.
        to: u32,
    },
}

/// The shortest way along edges through vertices, in their order, and back to the first where `closed`. Cost: O(vertices · n log n).
///
/// # Errors
/// Where there is no such vertex, or no way.
pub fn way(surface: &Surface, vertices: &[u32], closed: bool) -> Result<Vec<Place>, WayError> {
    let n = surface.positions.len();
    if let Some(&found) = vertices.iter().find(|v| **v as usize >= n) {
        return Err(WayError::Vertex { n, found });
    }
    let at = |joined: u32| surface.first[joined as usize];
    let mut near: Vec<Vec<(u32, f64)>> = vec![Vec::new(); surface.first.len()];
    for e in &surface.edges {
        let [a, b] = e.ends;
        let length = (surface.positions[at(a) as usize] - surface.positions[at(b) as usize]).norm();
        near[a as usize].push((b, length));
        near[b as usize].push((a, length));
    }
    let place = |v: u32| ([v, v], 0.0);
    let mut out: Vec<Place> = vertices.first().map(|v| place(*v)).into_iter().collect();
    let back = if closed && vertices.len() > 2 { Some([vertices[vertices.len() - 1], vertices[0]]) } else { None };
    for [from, to] in vertices.windows(2).map(|w| [w[0], w[1]]).chain(back) {
        let ends = [from, to].map(|v| surface.joined[v as usize] as usize);
        let steps = shortest_way(near.len(), ends, |at, step| near[at].iter().for_each(|&(next, length)| step(next as usize, length)));
        let steps = steps.ok_or(WayError::Apart { from, to })?;
        // The inner vertices stand for their places; the ends are those that were named.
        out.extend(steps.get(1..steps.len() - 1).unwrap_or_default().iter().map(|j| place(at(*j as u32))));
        out.push(place(to));
    }
    if back.is_some() {
        out.pop();
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::surface::Part;

    /// A grid of 4 by 3 squares, each cut from its lower left to its upper right corner; vertex 5 y + x at (x, y, 0).
    fn grid() -> Surface {
        let positions: Vec<[f64; 3]> = (0..4).flat_map(|y| (0..5).map(move |x| [f64::from(x), f64::from(y), 0.0])).collect();
        let squares = (0..3).flat_map(|y| (0..4).map(move |x| 5 * y + x));
        let triangles: Vec<[u32; 3]> = squares.flat_map(|v| [[v, v + 1, v + 6], [v, v + 6, v + 5]]).collect();
        Surface::new(&[Part { positions: &positions, triangles: &triangles, normals: &[] }], 1.0).unwrap()
    }

    fn at(surface: &Surface, ([a, b], share): Place) -> [f64; 2] {
        let [a, b] = [a, b].map(|v| surface.positions[v as usize]);
        let p = a + (b - a) * share;
        [p.x, p.y]
    }

    #[test]
    fn a_line_crosses_every_edge_on_its_way_once_and_in_order() {
        let surface = grid();
        let plane =
            |t: usize| Some(surface.triangles[t].map(|v| ([surface.positions[v as usize].x, surface.positions[v as usize].y], 1.0)));
        let found = crossings(&surface, &[[-1.0, 0.25], [1.5, 0.25], [1.5, 9.0]], plane);
        let places: Vec<[f64; 2]> = found.iter().map(|p| at(&surface, *p)).collect();
        let truth =
            [[0.0, 0.25], [0.25, 0.25], [1.0, 0.25], [1.25, 0.25], [1.5, 0.5], [1.5, 1.0], [1.5, 1.5], [1.5, 2.0], [1.5, 2.5], [1.5, 3.0]];
        assert_eq!(places.len(), truth.len(), "{places:?}");
        for (p, q) in places.iter().zip(truth) {
            assert!((p[0] - q[0]).abs() + (p[1] - q[1]).abs() < 1e-12, "{places:?}");
        }
        // Through a vertex that six edges meet at there is one point.
        let through = crossings(&surface, &[[0.5, 1.25], [1.5, 0.75]], plane);
        assert_eq!(through.iter().filter(|p| at(&surface, **p) == [1.0, 1.0]).count(), 1, "{through:?}");
        assert_eq!(crossings(&surface, &[[9.0, 9.0], [10.0, 9.0]], plane), []);
        assert_eq!(crossings(&surface, &[[0.5, 0.5]], plane), []);
        assert_eq!(crossings(&surface, &[[-1.0, 0.25], [1.5, 0.25]], |_| None), []);
    }

    #[test]
    fn half_way_in_perspective_is_nearer_to_what_is_near() {
        let surface = grid();
        // Seen from where x is 1 at depth 1 and further off to the right: nearness 1 / (1 + x).
        let plane = |t: usize| {
            let corner = |v: u32| {
                let p = surface.positions[v as usize];
                let near = 1.0 / (1.0 + p.x);
                ([p.x * near, p.y * near], near)
            };
            Some(surface.triangles[t].map(corner))
        };
        // The ray through (x, y) = (3, 2.5) and its like: pixels (0.75, 0.625) lie on the line from (0, 0) to (1, 5/6).
        for place in crossings(&surface, &[[0.0, 0.0], [1.0, 5.0 / 6.0]], plane) {
            let [x, y] = at(&surface, place);
            assert!((y / x.max(1e-9) - 5.0 / 6.0).abs() < 1e-9 || x < 1e-9, "{x} {y}");
        }
    }

    #[test]
    fn ways_go_along_the_shortest_edges_and_say_where_there_are_none() {
        let surface = grid();
        let places = |v: &[u32], closed| way(&surface, v, closed).map(|w| w.iter().map(|p| p.0[0]).collect::<Vec<_>>());
        assert_eq!(places(&[0, 18], false), Ok(vec![0, 6, 12, 18]), "along the diagonals");
        assert_eq!(places(&[0, 2, 12], false), Ok(vec![0, 1, 2, 7, 12]));
        assert_eq!(places(&[0, 1, 6], true), Ok(vec![0, 1, 6]), "closed: the last edge goes back");
        assert_eq!(places(&[7], false), Ok(vec![7]));
        assert_eq!(places(&[3, 99], false), Err(WayError::Vertex { n: 20, found: 99 }));
        let two = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 0.0, 0.0], [6.0, 0.0, 0.0], [5.0, 1.0, 0.0]];
        let apart = Surface::new(&[Part { positions: &two, triangles: &[[0, 1, 2], [3, 4, 5]], normals: &[] }], 1.0).unwrap();
        assert_eq!(way(&apart, &[0, 4], false), Err(WayError::Apart { from: 0, to: 4 }));
    }
}
