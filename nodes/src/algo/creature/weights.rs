//! Skin weights from how near each joint's clay is.

use nalgebra::Vector3;

use super::field::Blob;
use super::net::Net;

/// Joints that may move a vertex.
pub(super) const INFLUENCES: usize = 4;
/// How far a joint's influence reaches beyond its own clay, in thicknesses of it.
const REACH: f64 = 0.8;

/// Weights of each vertex, `[vertex][joint]`, which add up to 1 and of which no more than [`INFLUENCES`] are above nought.
///
/// The nearest joint's kin (two steps up or down the tree) share a vertex by how near they are; then weights are evened out along edges, over a
/// distance of about `softness` edges squared. Joints across a gap have no part in it. Cost: O(vertices · (blobs + edges · softness)).
pub(super) fn weights(net: &Net, blobs: &[Blob], parents: &[Option<usize>], softness: usize) -> Vec<Vec<f64>> {
    let n = parents.len();
    let reach: Vec<f64> = (0..n).map(|j| REACH * thickness(blobs, j)).collect();
    let mut weights: Vec<Vec<f64>> = net.positions.iter().map(|p| near(p, blobs, parents, &reach)).collect();
    for _ in 0..softness {
        weights = evened(&weights, &net.triangles);
    }
    weights.iter_mut().for_each(keep_largest);
    weights
}

fn thickness(blobs: &[Blob], joint: usize) -> f64 {
    blobs.iter().filter(|b| b.joint == joint).map(Blob::thickness).fold(0.01, f64::max)
}

fn near(p: &Vector3<f64>, blobs: &[Blob], parents: &[Option<usize>], reach: &[f64]) -> Vec<f64> {
    let mut distance = vec![f64::INFINITY; parents.len()];
    for blob in blobs {
        distance[blob.joint] = distance[blob.joint].min(blob.distance(p));
    }
    let nearest = (0..parents.len()).min_by(|&a, &b| distance[a].total_cmp(&distance[b])).unwrap_or(0);
    let weight = |j: usize| {
        let kin = is_above(parents, j, nearest) || is_above(parents, nearest, j);
        let far = (distance[j] - distance[nearest]) / ((reach[j] + reach[nearest]) / 2.0);
        if kin && far < 1.0 { (1.0 - far) * (1.0 - far) } else { 0.0 }
    };
    normalised((0..parents.len()).map(weight).collect())
}

/// True where `upper` is `lower`, its parent, or its parent's parent.
fn is_above(parents: &[Option<usize>], upper: usize, lower: usize) -> bool {
    let parent = parents[lower];
    upper == lower || parent == Some(upper) || parent.and_then(|p| parents[p]) == Some(upper)
}

fn normalised(mut weights: Vec<f64>) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}

fn evened(weights: &[Vec<f64>], triangles: &[[u32; 3]]) -> Vec<Vec<f64>> {
    let mut sums: Vec<Vec<f64>> = weights.iter().map(|w| vec![0.0; w.len()]).collect();
    let mut counts = vec![0.0; weights.len()];
    for (a, b) in triangles.iter().flat_map(|t| (0..3).map(|k| (t[k] as usize, t[(k + 1) % 3] as usize))) {
        sums[a].iter_mut().zip(&weights[b]).for_each(|(s, w)| *s += w);
        counts[a] += 1.0;
    }
    for ((sum, own), count) in sums.iter_mut().zip(weights).zip(counts) {
        sum.iter_mut().zip(own).for_each(|(s, w)| *s = (*w + *s / f64::max(count, 1.0)) / 2.0);
    }
    sums
}

fn keep_largest(weights: &mut Vec<f64>) {
    let mut sorted = weights.clone();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let least = sorted.get(INFLUENCES - 1).copied().unwrap_or(0.0).max(0.01);
    let mut left = INFLUENCES;
    for w in weights.iter_mut() {
        let kept = *w >= least && left > 0;
        left -= usize::from(kept);
        *w = if kept { *w } else { 0.0 };
    }
    *weights = normalised(std::mem::take(weights));
}
