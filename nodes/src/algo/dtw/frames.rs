//! One source frame for each drawing.

/// Which drawing each target frame shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawings(Vec<usize>);

impl Drawings {
    /// Frames for which `same` holds with the frame before show the same drawing.
    pub fn new(n: usize, same: impl Fn(usize) -> bool) -> Self {
        let mut drawing = 0;
        Self((0..n).map(|i| (drawing += usize::from(i > 0 && !same(i)), drawing).1).collect())
    }
}

/// The source frame, from 0, of each target frame: the median of all that its drawing is matched with, or what a pin says; smoothed over a Gaussian window of
/// `smooth` drawings.
///
/// Smoothing keeps both ends and all pins, and nothing runs backwards: a series mirrored in its ends, and averaged with positive weights, still rises.
pub fn source_frames(path: &[[usize; 2]], drawings: &Drawings, pins: &[[usize; 2]], smooth: f64) -> Vec<f64> {
    let of = &drawings.0;
    let count = of.last().map_or(0, |d| d + 1);
    let mut matched = vec![Vec::new(); count];
    path.iter().for_each(|[i, j]| matched[of[*i]].push(*j));
    let mut frames: Vec<f64> = matched.iter().map(|m| median(m)).collect();
    let mut anchors = vec![0, count.saturating_sub(1)];
    for [i, j] in pins {
        frames[of[*i]] = *j as f64;
        anchors.push(of[*i]);
    }
    anchors.sort_unstable();
    anchors.dedup();
    if smooth > 0.0 {
        let rough = frames.clone();
        for ends in anchors.windows(2) {
            smoothed(&rough[ends[0]..=ends[1]], smooth, &mut frames[ends[0]..=ends[1]]);
        }
    }
    of.iter().map(|d| frames[*d]).collect()
}

/// Of a path's columns, which are in order.
fn median(sorted: &[usize]) -> f64 {
    match sorted.len() {
        0 => 0.0,
        n => (sorted[(n - 1) / 2] + sorted[n / 2]) as f64 / 2.0,
    }
}

fn smoothed(rough: &[f64], sigma: f64, out: &mut [f64]) {
    let last = rough.len() as i64 - 1;
    let reach = (3.0 * sigma).ceil() as i64;
    let kernel: Vec<f64> = (-reach..=reach).map(|k| libm::exp(-0.5 * (k as f64 / sigma).powi(2))).collect();
    let total: f64 = kernel.iter().sum();
    // Turned by half about each end, again and again, the series goes on as it came.
    let whole = rough[last as usize] - rough[0];
    let at = |k: i64| {
        let (turns, rest) = (k.div_euclid(2 * last), k.rem_euclid(2 * last));
        let base = 2.0 * whole * turns as f64;
        base + if rest <= last { rough[rest as usize] } else { 2.0 * rough[last as usize] - rough[(2 * last - rest) as usize] }
    };
    for k in 1..last {
        out[k as usize] = kernel.iter().zip(-reach..).map(|(w, d)| w * at(k + d)).sum::<f64>() / total;
    }
}
