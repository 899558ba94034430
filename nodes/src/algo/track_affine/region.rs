//! Which pixels of the reference, and which part of a frame, are looked at.

use super::Region;
use super::planes::{Planes, Window, unit};
use crate::algo::raster::Raster;

/// Where a region is: its box, its centroid and its radius (root mean square distance along an axis, doubled).
pub(super) struct Extent {
    pub(super) bounds: [f64; 4],
    pub(super) centre: [f64; 2],
    pub(super) radius: f64,
}

pub(super) fn region_weight(region: &Region, x: usize, y: usize, width: usize) -> f32 {
    match region {
        Region::Whole => 1.0,
        Region::Matte(m) => m.get(y * width + x).map_or(0.0, |&m| unit(m)),
        Region::Box([x0, y0, x1, y1]) => {
            let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
            if px >= *x0 && px <= *x1 && py >= *y0 && py <= *y1 { 1.0 } else { 0.0 }
        }
    }
}

pub(super) fn extent(weight: impl Fn(usize, usize) -> f32, width: usize, height: usize) -> Option<Extent> {
    let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let (mut s, mut sx, mut sy, mut sq) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
    for y in 0..height {
        for x in 0..width {
            let w = f64::from(weight(x, y));
            if w <= 0.0 {
                continue;
            }
            let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
            if w >= 0.25 {
                bounds = [bounds[0].min(px - 0.5), bounds[1].min(py - 0.5), bounds[2].max(px + 0.5), bounds[3].max(py + 0.5)];
            }
            (s, sx, sy, sq) = (s + w, sx + w * px, sy + w * py, sq + w * (px * px + py * py));
        }
    }
    if bounds[0].is_infinite() {
        return None;
    }
    let (cx, cy) = (sx / s, sy / s);
    let radius = libm::sqrt((2.0 * (sq / s - cx * cx - cy * cy)).max(1.0));
    Some(Extent { bounds, centre: [cx, cy], radius })
}

pub(super) fn window_of(bounds: [f64; 4], margin: f64) -> Window {
    let cut = |v: f64| v.clamp(-1e12, 1e12) as i64;
    Window {
        x0: cut(libm::floor(bounds[0] - margin)),
        y0: cut(libm::floor(bounds[1] - margin)),
        x1: cut(libm::ceil(bounds[2] + margin)),
        y1: cut(libm::ceil(bounds[3] + margin)),
    }
}

/// The region's weights as planes; zero off the picture.
pub(super) fn mask_planes(window: Window, weight: impl Fn(usize, usize) -> f32, width: usize, height: usize) -> Planes {
    let (w, h) = ((window.x1 - window.x0) as usize, (window.y1 - window.y0) as usize);
    let mut plane = vec![0.0f32; w * h];
    for (j, row) in plane.chunks_exact_mut(w).enumerate() {
        for (i, v) in row.iter_mut().enumerate() {
            let (x, y) = (window.x0 as usize + i, window.y0 as usize + j);
            if x < width && y < height {
                *v = weight(x, y);
            }
        }
    }
    Planes { width: w, height: h, origin: [window.x0 as f64, window.y0 as f64], step: 1.0, data: vec![plane] }
}

/// The region and two samples around it, full weight: the outline of a keyed region has its gradients on both sides.
pub(super) fn with_rim(mask: &Planes) -> Vec<f32> {
    let (w, h) = (mask.width, mask.height);
    let inside = |x: i64, y: i64| x >= 0 && y >= 0 && x < w as i64 && y < h as i64 && mask.data[0][y as usize * w + x as usize] > 0.3;
    let mut out = vec![0.0f32; w * h];
    for y in 0..h as i64 {
        for x in 0..w as i64 {
            if (-2..=2).any(|dy| (-2..=2).any(|dx| inside(x + dx, y + dy))) {
                out[y as usize * w + x as usize] = 1.0;
            }
        }
    }
    out
}

/// The channels that are not a copy of an earlier one over the window: a grey plate is often stored as three equal channels.
pub(super) fn used_channels(reference: Raster, window: Window) -> Vec<usize> {
    let n = reference.channels;
    let (x0, x1) = (window.x0.max(0) as usize, (window.x1.max(0) as usize).min(reference.width));
    let (y0, y1) = (window.y0.max(0) as usize, (window.y1.max(0) as usize).min(reference.height));
    let pixels = || (y0..y1).flat_map(|y| reference.row(y)[x0 * n..x1 * n].chunks_exact(n));
    let copies = |a: usize, b: usize| pixels().all(|p| p[a].to_bits() == p[b].to_bits());
    let constant = |c: usize| {
        let first = pixels().next().map(|p| p[c].to_bits());
        pixels().all(|p| Some(p[c].to_bits()) == first)
    };
    let mut used: Vec<usize> = Vec::new();
    for c in 0..n {
        if !constant(c) && !used.iter().any(|&u| copies(u, c)) {
            used.push(c);
        }
    }
    if used.is_empty() { vec![0] } else { used }
}

/// True where at least one sample near the region is finite: a coarse lattice is enough.
pub(super) fn has_finite(frame: Raster, window: Window) -> bool {
    let (x0, x1) = (window.x0.max(0) as usize, (window.x1.max(0) as usize).min(frame.width));
    let (y0, y1) = (window.y0.max(0) as usize, (window.y1.max(0) as usize).min(frame.height));
    (y0..y1).step_by(7).any(|y| frame.row(y)[x0 * frame.channels..x1 * frame.channels].iter().any(|v| v.is_finite()))
}
