//! Points that stand where they are told to, for as long as they are told to.
//!
//! The whole motion is moved, as Bregler et al. 2002, section 3.4, do: at the frames of a pin by what brings its point to its place, between pins along the
//! curve of [`pins::between`].

use crate::algo::pins;

/// One pin, at positions of the motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Pinned {
    /// First position.
    pub first: usize,
    /// Last position.
    pub last: usize,
    /// Where the motion itself has the point at each position, pixels.
    pub path: Vec<[f64; 2]>,
    /// Where it is to be. Where it is at the first position, if it is not said.
    pub target: Option<[f64; 2]>,
}

/// How frames without a pin are moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinning {
    /// Frames before the first pin and after the last over which their shift comes and goes; none holds it.
    pub blend: Option<f64>,
    /// No pinned point goes below this height (y, which grows downwards) at any frame.
    pub ground: Option<f64>,
}

/// What a motion is shifted by, at each of `n` positions; and how far each pinned point then is from its place.
///
/// Where pins overlap their shifts are averaged. O(n · pins).
pub fn shifts(pinned: &[Pinned], n: usize, how: &Pinning) -> Vec<[f64; 2]> {
    let mut wanted: Vec<Option<[f64; 2]>> = vec![None; n];
    for (k, slot) in wanted.iter_mut().enumerate() {
        let here: Vec<[f64; 2]> = pinned.iter().filter(|p| (p.first..=p.last).contains(&k)).filter_map(|p| p.shift(k)).collect();
        let mean = |d: usize| here.iter().map(|s| s[d]).sum::<f64>() / here.len() as f64;
        *slot = (!here.is_empty()).then(|| [mean(0), mean(1)]);
    }
    let axes = [0, 1].map(|d| pins::between(&wanted.iter().map(|w| w.map(|w| w[d])).collect::<Vec<_>>(), how.blend));
    let mut out: Vec<[f64; 2]> = (0..n).map(|k| [axes[0][k], axes[1][k]]).collect();
    if let Some(ground) = how.ground {
        for (k, shift) in out.iter_mut().enumerate() {
            let lowest = pinned.iter().filter_map(|p| p.path.get(k)).map(|p| p[1] + shift[1]).fold(f64::NEG_INFINITY, f64::max);
            if lowest > ground {
                shift[1] -= lowest - ground;
            }
        }
    }
    out
}

/// How far the worst pinned point is from its place at each position, after the shifts; 0 where nothing is pinned.
pub fn misses(pinned: &[Pinned], shifts: &[[f64; 2]]) -> Vec<f64> {
    let miss = |(k, s): (usize, &[f64; 2])| {
        let here = pinned.iter().filter(|p| (p.first..=p.last).contains(&k)).filter_map(|p| p.shift(k));
        here.map(|w| libm::hypot(w[0] - s[0], w[1] - s[1])).fold(0.0, f64::max)
    };
    shifts.iter().enumerate().map(miss).collect()
}

impl Pinned {
    fn shift(&self, k: usize) -> Option<[f64; 2]> {
        let to = self.target.or_else(|| self.path.get(self.first).copied())?;
        let from = self.path.get(k)?;
        Some([to[0] - from[0], to[1] - from[1]])
    }
}
