//! Regions of colour: triangles cut along the border of a region, so that no triangle has two colours and borders are as smooth as the region.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::field::gradient;
use super::net::Net;

/// A vertex nearer to a border than this, in lengths of the edge that the border cuts, is moved onto it: what is left are no slivers.
const SNAP: f64 = 0.3;
/// The same for a vertex that is on another border.
const SNAP_LOCKED: f64 = 0.2;

/// Cuts a surface where `region` is nought; `on_surface` puts a point back on the surface. `locked` vertices keep their place.
pub(super) fn cut(
    net: &mut Net,
    locked: &mut Vec<bool>,
    region: &impl Fn(&Vector3<f64>) -> f64,
    on_surface: &impl Fn(&Vector3<f64>) -> Vector3<f64>,
) {
    locked.resize(net.positions.len(), false);
    let mut values: Vec<f64> = net.positions.iter().map(region).collect();
    snap(net, locked, &mut values, region, on_surface);
    let mut middles = BTreeMap::new();
    let old = std::mem::take(&mut net.triangles);
    for t in old {
        let [a, b, c] = t.map(|i| values[i as usize]);
        if a.min(b).min(c) >= 0.0 || a.max(b).max(c) <= 0.0 {
            net.triangles.push(t);
            continue;
        }
        let middle = [0, 1, 2].map(|k| {
            let ends = [t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3])];
            let crossed = values[ends[0] as usize] * values[ends[1] as usize] < 0.0;
            crossed.then(|| {
                *middles.entry(ends).or_insert_with(|| {
                    net.positions.push(border(ends.map(|i| net.positions[i as usize]), region, on_surface));
                    net.positions.len() as u32 - 1
                })
            })
        });
        split(t, middle, &mut net.triangles);
    }
    values.resize(net.positions.len(), 0.0);
    locked.resize(net.positions.len(), false);
    locked.iter_mut().zip(&values).filter(|(_, v)| **v == 0.0).for_each(|(l, _)| *l = true);
}

/// Moves the vertices near the border onto it.
fn snap(
    net: &mut Net,
    locked: &[bool],
    values: &mut [f64],
    region: &impl Fn(&Vector3<f64>) -> f64,
    on_surface: &impl Fn(&Vector3<f64>) -> Vector3<f64>,
) {
    // How far along the nearest cut edge the border is, and where.
    let mut nearest: Vec<Option<f64>> = vec![None; net.positions.len()];
    for (a, b) in net.triangles.iter().flat_map(|t| (0..3).map(|k| (t[k] as usize, t[(k + 1) % 3] as usize))) {
        if values[a] * values[b] < 0.0 {
            for (from, to) in [(a, b), (b, a)] {
                let share = values[from] / (values[from] - values[to]);
                nearest[from] = Some(nearest[from].map_or(share, |n| n.min(share)));
            }
        }
    }
    for (i, share) in nearest.into_iter().enumerate() {
        match share {
            Some(share) if share < SNAP && !locked[i] => {
                net.positions[i] = onto(net.positions[i], region, on_surface);
                values[i] = 0.0;
            }
            // It stays on the border that it is on, and this border goes through it.
            Some(share) if share < SNAP_LOCKED => values[i] = 0.0,
            _ => {}
        }
    }
}

/// The point of the border near a point of the surface.
fn onto(from: Vector3<f64>, region: &impl Fn(&Vector3<f64>) -> f64, on_surface: &impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Vector3<f64> {
    let mut at = from;
    for _ in 0..6 {
        let (value, slope) = (region(&at), gradient(region, &at));
        at = on_surface(&(at - slope * (value / slope.norm_squared().max(1e-6))));
    }
    at
}

/// Where the border crosses an edge.
fn border(
    ends: [Vector3<f64>; 2],
    region: &impl Fn(&Vector3<f64>) -> f64,
    on_surface: &impl Fn(&Vector3<f64>) -> Vector3<f64>,
) -> Vector3<f64> {
    let starts_inside = region(&ends[0]) < 0.0;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..20 {
        let t = (low + high) / 2.0;
        if (region(&ends[0].lerp(&ends[1], t)) < 0.0) == starts_inside { low = t } else { high = t }
    }
    on_surface(&ends[0].lerp(&ends[1], low))
}

/// The parts of a triangle with new vertices amid one or two of its sides.
fn split(t: [u32; 3], middle: [Option<u32>; 3], out: &mut Vec<[u32; 3]>) {
    for k in 0..3 {
        let [a, b, c] = [0, 1, 2].map(|i| t[(k + i) % 3]);
        match [0, 1, 2].map(|i| middle[(k + i) % 3]) {
            [Some(m), None, None] => out.extend([[a, m, c], [m, b, c]]),
            [Some(m), None, Some(n)] => out.extend([[a, m, n], [m, b, c], [m, c, n]]),
            _ => {}
        }
    }
}
