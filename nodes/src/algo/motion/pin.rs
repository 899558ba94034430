//! Points that stand where they are told to, for as long as they are told to.
//!
//! The whole motion is moved, as Bregler et al. 2002, section 3.4, do: at the frames of a pin by what brings its point to its place, between pins along a cubic
//! that goes on as both pins leave off and never swings past either (Hermite, with the slopes of Fritsch and Carlson 1980).

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
pub fn shifts(pins: &[Pinned], n: usize, how: &Pinning) -> Vec<[f64; 2]> {
    let mut wanted: Vec<Option<[f64; 2]>> = vec![None; n];
    for (k, slot) in wanted.iter_mut().enumerate() {
        let here: Vec<[f64; 2]> = pins.iter().filter(|p| (p.first..=p.last).contains(&k)).filter_map(|p| p.shift(k)).collect();
        let mean = |d: usize| here.iter().map(|s| s[d]).sum::<f64>() / here.len() as f64;
        *slot = (!here.is_empty()).then(|| [mean(0), mean(1)]);
    }
    let axes = [0, 1].map(|d| between(&wanted.iter().map(|w| w.map(|w| w[d])).collect::<Vec<_>>(), how.blend));
    let mut out: Vec<[f64; 2]> = (0..n).map(|k| [axes[0][k], axes[1][k]]).collect();
    if let Some(ground) = how.ground {
        for (k, shift) in out.iter_mut().enumerate() {
            let lowest = pins.iter().filter_map(|p| p.path.get(k)).map(|p| p[1] + shift[1]).fold(f64::NEG_INFINITY, f64::max);
            if lowest > ground {
                shift[1] -= lowest - ground;
            }
        }
    }
    out
}

/// How far the worst pinned point is from its place at each position, after the shifts; 0 where nothing is pinned.
pub fn misses(pins: &[Pinned], shifts: &[[f64; 2]]) -> Vec<f64> {
    let miss = |(k, s): (usize, &[f64; 2])| {
        let here = pins.iter().filter(|p| (p.first..=p.last).contains(&k)).filter_map(|p| p.shift(k));
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

/// One curve through what is known.
fn between(known: &[Option<f64>], blend: Option<f64>) -> Vec<f64> {
    let n = known.len();
    let at: Vec<(usize, f64)> = known.iter().enumerate().filter_map(|(k, v)| v.map(|v| (k, v))).collect();
    let (Some(&first), Some(&last)) = (at.first(), at.last()) else { return vec![0.0; n] };
    // The slope with which a run of pinned frames leaves off on one side; none for a single frame.
    let run = |k: usize, next: usize| match (known.get(k).copied().flatten(), known.get(next).copied().flatten()) {
        (Some(a), Some(b)) if next > k => b - a,
        (Some(a), Some(b)) => a - b,
        _ => 0.0,
    };
    let ease = |distance: f64| blend.map_or(1.0, |b| if distance < b { eased(1.0 - distance / b) } else { 0.0 });
    let mut out: Vec<f64> = (0..n).map(|k| known[k].unwrap_or(0.0)).collect();
    (0..first.0).for_each(|k| out[k] = first.1 * ease((first.0 - k) as f64));
    (last.0 + 1..n).for_each(|k| out[k] = last.1 * ease((k - last.0) as f64));
    for pair in at.windows(2).filter(|p| p[1].0 > p[0].0 + 1) {
        let ((a, from), (b, to)) = (pair[0], pair[1]);
        let slopes = [run(a, a.wrapping_sub(1)), run(b, b + 1)];
        let width = (b - a) as f64;
        for (k, slot) in out.iter_mut().enumerate().take(b).skip(a + 1) {
            *slot = hermite(from, to, slopes, width, (k - a) as f64 / width);
        }
    }
    out
}

/// From 0 to 1 with no slope at either end.
fn eased(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// A cubic from one value to another that stays between them: slopes of the other direction are none, and steep ones are cut.
fn hermite(from: f64, to: f64, slopes: [f64; 2], width: f64, t: f64) -> f64 {
    let rise = (to - from) / width;
    let [m0, m1] = slopes.map(|m| if m * rise > 0.0 { m.abs().min(3.0 * rise.abs()).copysign(rise) } else { 0.0 });
    let (s, u) = (1.0 - t, t);
    from * (1.0 + 2.0 * u) * s * s + to * u * u * (3.0 - 2.0 * u) + width * (m0 * u * s * s - m1 * u * u * s)
}
