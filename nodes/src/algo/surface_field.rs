//! Displacements known at a few places of a mesh, spread over its surface instead of over the picture.
//!
//! **Source** Pinkall, Polthier, *Computing discrete minimal surfaces and their conjugates*, Experimental Mathematics 2(1), 1993 (cotangent weights); Botsch,
//! Kobbelt, *An intuitive framework for real-time freeform modeling*, SIGGRAPH 2004 (the biharmonic field, smooth at what is held).

use pegbar_engine::Setting;

use super::arap::Skyline;
use super::layered_warp::Pair;

/// How much a place is held, against the stiffest vertex.
const HOLD: f64 = 1e5;

/// What a field is like between the places where it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Smooth {
    /// As steep as need be, nowhere more than where it is known: heat that has settled.
    Harmonic,
    /// As little bent as may be: smooth at the places too.
    Biharmonic,
}

/// A surface that cannot be solved on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a surface of triangles with areas, found one on which no field can be solved for")]
pub struct SurfaceFieldError;

/// The displacement of each vertex, from those of `pairs` (`by`, one for each). Parts of the mesh that no pair lies on do not move.
///
/// Vertices at one place are one. Cost: O(vertices · envelope²), where the envelope of a surface is about the square root of its vertices.
///
/// # Errors
/// Where there is no solution.
pub fn spread(
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    pairs: &[Pair],
    by: &[[f64; 2]],
    smooth: Smooth,
) -> Result<Vec<[f64; 2]>, SurfaceFieldError> {
    let (joined, n) = join(positions);
    let rows = laplacian(positions, triangles, &joined, n);
    let slot = slots(&held(&rows, &joined, pairs, n));
    let Some(n_held) = slot.iter().flatten().max().map(|m| *m as usize + 1) else { return Ok(vec![[0.0; 2]; positions.len()]) };
    let of = |v: u32| slot[v as usize].unwrap_or(0);
    let mut entries = energy(&rows, triangles, positions, &joined, smooth);
    entries.retain_mut(|e| {
        let is_held = slot[e.0 as usize].is_some();
        (e.0, e.1) = (of(e.0), of(e.1));
        is_held
    });
    let stiffest = entries.iter().filter(|(i, j, _)| i == j).map(|e| e.2).fold(1e-300, f64::max);
    let mut sides = vec![0.0; 2 * n_held];
    for (pair, by) in pairs.iter().zip(by).filter(|(p, _)| p.weight > 0.0) {
        let [a, b] = pair.edge.map(|v| of(joined[v as usize]));
        let parts: &[(u32, f64)] = if a == b { &[(a, 1.0)] } else { &[(a, 1.0 - pair.share), (b, pair.share)] };
        let hold = HOLD * stiffest * pair.weight;
        for (i, s) in parts {
            entries.extend(parts.iter().filter(|(j, _)| j <= i).map(|(j, t)| (*i, *j, hold * s * t)));
            (0..2).for_each(|k| sides[2 * *i as usize + k] += hold * s * by[k]);
        }
    }
    let matrix = Skyline::definite(n_held, &entries).ok_or(SurfaceFieldError)?;
    matrix.solve(&mut sides, 2);
    let solved = |s: u32| [sides[2 * s as usize], sides[2 * s as usize + 1]];
    Ok(joined.iter().map(|&v| slot[v as usize].map_or([0.0; 2], solved)).collect())
}

/// Numbers of those that are held; the rest stays where it is.
fn slots(held: &[bool]) -> Vec<Option<u32>> {
    let mut next = 0..;
    held.iter().map(|held| if *held { next.next() } else { None }).collect()
}

/// For each vertex the number of its place, in the order in which places come first, and how many there are.
fn join(positions: &[[f64; 3]]) -> (Vec<u32>, usize) {
    let key = |v: &u32| positions[*v as usize].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_by_key(|v| (key(v), *v));
    let mut first: Vec<u32> = (0..positions.len() as u32).collect();
    for w in 1..order.len() {
        if key(&order[w]) == key(&order[w - 1]) {
            first[order[w] as usize] = first[order[w - 1] as usize];
        }
    }
    let mut number = vec![0; first.len()];
    let mut n = 0;
    for v in 0..first.len() {
        number[v] = if first[v] as usize == v { n } else { number[first[v] as usize] };
        n += u32::from(first[v] as usize == v);
    }
    (number, n as usize)
}

fn sub(a: [f64; 3], b: [f64; 3]) -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::from(a) - nalgebra::Vector3::from(b)
}

/// Rows of the cotangent Laplacian, columns in order; triangles without an area count for nothing.
fn laplacian(positions: &[[f64; 3]], triangles: &[[u32; 3]], joined: &[u32], n: usize) -> Vec<Vec<(u32, f64)>> {
    let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); n];
    for t in triangles {
        for k in 0..3 {
            let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
            let (u, v) = (sub(positions[b as usize], positions[a as usize]), sub(positions[c as usize], positions[a as usize]));
            let area = u.cross(&v).norm();
            if area <= 1e-12 * u.norm() * v.norm() || !area.is_finite() {
                continue;
            }
            let half_cotangent = u.dot(&v) / area / 2.0;
            let [b, c] = [joined[b as usize], joined[c as usize]];
            for (i, j) in [(b, c), (c, b)] {
                rows[i as usize].push((j, -half_cotangent));
                rows[i as usize].push((i, half_cotangent));
            }
        }
    }
    for row in &mut rows {
        row.sort_by_key(|e| e.0);
        let mut merged: Vec<(u32, f64)> = Vec::with_capacity(row.len() / 2);
        for (j, v) in row.drain(..) {
            match merged.last_mut() {
                Some(last) if last.0 == j => last.1 += v,
                _ => merged.push((j, v)),
            }
        }
        *row = merged;
    }
    rows
}

/// True for what hangs together with a pair.
fn held(rows: &[Vec<(u32, f64)>], joined: &[u32], pairs: &[Pair], n: usize) -> Vec<bool> {
    let mut held = vec![false; n];
    let mut open: Vec<u32> = pairs.iter().filter(|p| p.weight > 0.0).flat_map(|p| p.edge.map(|v| joined[v as usize])).collect();
    while let Some(v) = open.pop() {
        if !std::mem::replace(&mut held[v as usize], true) {
            open.extend(rows[v as usize].iter().map(|e| e.0));
        }
    }
    held
}

/// One triangle of the matrix of the energy: L, or L M⁻¹ L with a third of the triangles' areas at each vertex.
fn energy(
    rows: &[Vec<(u32, f64)>],
    triangles: &[[u32; 3]],
    positions: &[[f64; 3]],
    joined: &[u32],
    smooth: Smooth,
) -> Vec<(u32, u32, f64)> {
    let own = rows.iter().enumerate();
    if smooth == Smooth::Harmonic {
        return own.flat_map(|(i, row)| row.iter().filter(move |e| e.0 as usize <= i).map(move |e| (i as u32, e.0, e.1))).collect();
    }
    let mut areas = vec![0.0; rows.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        let third = sub(b, a).cross(&sub(c, a)).norm() / 6.0;
        t.iter().for_each(|v| areas[joined[*v as usize] as usize] += third);
    }
    let mut entries = Vec::new();
    for (k, row) in own.filter(|(k, _)| areas[*k] > 0.0) {
        for (i, u) in row {
            entries.extend(row.iter().filter(|(j, _)| j <= i).map(|(j, v)| (*i, *j, u * v / areas[k])));
        }
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat grid of `n` by `n` vertices over the unit square.
    fn grid(n: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let step = 1.0 / f64::from(n - 1);
        let positions = (0..n * n).map(|v| [f64::from(v % n) * step, f64::from(v / n) * step, 0.0]).collect();
        let cells = (0..(n - 1) * (n - 1)).map(|c| c / (n - 1) * n + c % (n - 1));
        (positions, cells.flat_map(|v| [[v, v + 1, v + n + 1], [v, v + n + 1, v + n]]).collect())
    }

    fn at(v: u32) -> Pair {
        Pair { edge: [v, v], share: 0.0, point: [0.0; 2], weight: 1.0 }
    }

    #[test]
    fn a_harmonic_field_is_straight_between_two_sides() {
        let (positions, triangles) = grid(9);
        let pairs: Vec<Pair> = (0..9).flat_map(|k| [at(9 * k), at(9 * k + 8)]).collect();
        let by: Vec<[f64; 2]> = (0..18).map(|k| if k % 2 == 0 { [0.0, 0.0] } else { [8.0, -4.0] }).collect();
        let found = spread(&positions, &triangles, &pairs, &by, Smooth::Harmonic).unwrap();
        for (p, d) in positions.iter().zip(&found) {
            assert!((d[0] - 8.0 * p[0]).abs() < 1e-3 && (d[1] + 4.0 * p[0]).abs() < 1e-3, "{p:?} {d:?}");
        }
    }

    #[test]
    fn one_place_moves_all_that_hangs_together_with_it_and_nothing_else() {
        let (mut positions, mut triangles) = grid(4);
        let (more, apart) = grid(4);
        positions.extend(more.iter().map(|p| [p[0] + 3.0, p[1], p[2]]));
        triangles.extend(apart.iter().map(|t| t.map(|v| v + 16)));
        for smooth in [Smooth::Harmonic, Smooth::Biharmonic] {
            let found = spread(&positions, &triangles, &[at(5)], &[[3.0, -2.0]], smooth).unwrap();
            assert!(found[..16].iter().all(|d| (d[0] - 3.0).abs() < 1e-3 && (d[1] + 2.0).abs() < 1e-3), "{found:?}");
            assert!(found[16..].iter().all(|d| *d == [0.0; 2]));
        }
    }

    #[test]
    fn places_on_edges_are_met_over_seams_and_the_biharmonic_field_has_no_peak() {
        // Two halves whose vertices coincide in the middle: a seam of textures.
        let (left, mut triangles) = grid(9);
        let mut positions = left.clone();
        positions.extend(left.iter().map(|p| [p[0] + 1.0, p[1], p[2]]));
        let more: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| v + 81)).collect();
        triangles.extend(more);
        let middle = Pair { edge: [40, 41], share: 0.25, point: [0.0; 2], weight: 1.0 };
        let pairs = [middle, at(0), at(72), at(81 + 8), at(81 + 80)];
        let by = [[10.0, 0.0], [0.0; 2], [0.0; 2], [0.0; 2], [0.0; 2]];
        let run = |smooth| spread(&positions, &triangles, &pairs, &by, smooth).unwrap();
        let (harmonic, biharmonic) = (run(Smooth::Harmonic), run(Smooth::Biharmonic));
        for found in [&harmonic, &biharmonic] {
            assert!((0.75 * found[40][0] + 0.25 * found[41][0] - 10.0).abs() < 1e-2);
            assert!((0..9).all(|k| found[9 * k + 8] == found[81 + 9 * k]), "the seam holds");
        }
        let fall = |f: &[[f64; 2]]| f[40][0] - f[42][0];
        assert!(fall(&biharmonic) < 0.5 * fall(&harmonic), "{} {}", fall(&biharmonic), fall(&harmonic));
    }

    #[test]
    fn triangles_without_an_area_do_no_harm() {
        let (positions, mut triangles) = grid(4);
        triangles.extend([[0, 0, 1], [2, 2, 2], [0, 1, 2]]);
        let found = spread(&positions, &triangles, &[at(0)], &[[1.0, 1.0]], Smooth::Biharmonic).unwrap();
        assert!(found.iter().all(|d| (d[0] - 1.0).abs() < 1e-3));
        assert_eq!(spread(&[], &[], &[], &[], Smooth::Harmonic), Ok(Vec::new()));
    }
}
