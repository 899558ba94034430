//! Small solids: balls and tapered tubes.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};

use super::net::Net;

/// An ellipsoid of `side` by `side` quadrangles on each of the six sides of a cube.
pub(super) fn ball(centre: &Vector3<f64>, radii: &Vector3<f64>, turn: &Rotation3<f64>, side: u32) -> Net {
    let mut net = Net::default();
    let mut vertices = BTreeMap::new();
    // A corner of the cube's grid: no coordinate repeats, so corners of two sides are one vertex.
    let mut vertex = |i: [u32; 3]| {
        *vertices.entry(i).or_insert_with(|| {
            // Tangents make the quadrangles of one size.
            let cube = Vector3::from_fn(|k, _| libm::tan((f64::from(i[k]) / f64::from(side) - 0.5) * std::f64::consts::FRAC_PI_2));
            net.positions.push(centre + turn * cube.normalize().component_mul(radii));
            net.positions.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for (far, a, b) in (0..2 * side * side).map(|n| (n % 2, n / 2 % side, n / 2 / side)) {
            let mut at = |da: u32, db: u32| {
                let mut i = [0; 3];
                i[axis] = far * side;
                i[(axis + 1) % 3] = a + da;
                i[(axis + 2) % 3] = b + db;
                vertex(i)
            };
            let mut quad = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
            if far == 0 {
                quad.reverse();
            }
            triangles.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
        }
    }
    net.triangles = triangles;
    net
}

/// A tube along points, as thick as a radius at each of them, its ends closed by a vertex a radius on.
///
/// Rings are carried along without a twist.
pub(super) fn tube(points: &[Vector3<f64>], radii: &[f64], around: u32) -> Net {
    let n = points.len();
    let mut net = Net::default();
    if n < 2 {
        return net;
    }
    let along = |i: usize| (points[(i + 1).min(n - 1)] - points[i.saturating_sub(1)]).normalize();
    let first = along(0);
    let mut side = first.cross(&Vector3::ith(first.iamin(), 1.0)).normalize();
    for i in 0..n {
        let axis = along(i);
        side = (side - axis * axis.dot(&side)).normalize();
        let up = axis.cross(&side);
        for k in 0..around {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(around);
            net.positions.push(points[i] + (side * libm::cos(angle) + up * libm::sin(angle)) * radii[i]);
        }
    }
    let (start, end) = (net.positions.len() as u32, net.positions.len() as u32 + 1);
    net.positions.extend([points[0] - first * radii[0], points[n - 1] + along(n - 1) * radii[n - 1]]);
    let at = |i: u32, k: u32| i * around + k % around;
    let last = n as u32 - 1;
    for k in 0..around {
        net.triangles.extend([[start, at(0, k + 1), at(0, k)], [end, at(last, k), at(last, k + 1)]]);
        for i in 0..last {
            net.triangles.extend([[at(i, k), at(i, k + 1), at(i + 1, k + 1)], [at(i, k), at(i + 1, k + 1), at(i + 1, k)]]);
        }
    }
    net
}

/// A smooth curve through points: Catmull and Rom's, `steps` pieces between two of them.
pub(super) fn curve(points: &[Vector3<f64>], steps: usize) -> Vec<Vector3<f64>> {
    let last = points.len().saturating_sub(1);
    let get = |i: i64| points[i.clamp(0, last as i64) as usize];
    let mut out = Vec::new();
    for (i, step) in (0..last as i64).flat_map(|i| (0..steps).map(move |s| (i, s))) {
        let t = step as f64 / steps as f64;
        let [a, b, c, d] = [get(i - 1), get(i), get(i + 1), get(i + 2)];
        out.push((b * 2.0 + (c - a) * t + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (t * t) + (b * 3.0 - a - c * 3.0 + d) * (t * t * t)) / 2.0);
    }
    out.extend(points.last());
    out
}
