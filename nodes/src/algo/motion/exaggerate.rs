//! Poses carried further than they were drawn: each curve's distance from its rest grows.

use super::{Group, Kind, bounded};

/// What poses are measured from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rest {
    /// The mean over all frames.
    Mean,
    /// The frame at a position.
    Frame(usize),
    /// The straight line through all frames, by least squares: a walk keeps its way and its pace.
    Trend,
}

/// How much further each kind of curve goes: 0 leaves it, 1 doubles its distance from rest, -1 brings it to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amounts {
    /// The pivot's path.
    pub translation: f64,
    /// The rotation.
    pub rotation: f64,
    /// The squash, which keeps the area.
    pub squash: f64,
    /// The size.
    pub size: f64,
    /// Weights and all other numbers.
    pub values: f64,
}

impl Amounts {
    fn of(&self, kind: Kind) -> f64 {
        match kind {
            Kind::Translation => self.translation,
            Kind::Rotation => self.rotation,
            Kind::Squash => self.squash,
            Kind::Size => self.size,
            Kind::Weights | Kind::Values => self.values,
        }
    }
}

/// Carries every curve further from `rest`; weights stay within `bounds` and add up to 1. O(n).
pub fn exaggerate(groups: &mut [Group], amounts: &Amounts, rest: Rest, bounds: [f64; 2]) {
    for group in groups {
        let amount = amounts.of(group.kind);
        if amount == 0.0 {
            continue;
        }
        for curve in &mut group.curves {
            let at = resting(curve, rest);
            curve.iter_mut().zip(at).for_each(|(x, r)| *x += amount * (*x - r));
        }
        if group.kind == Kind::Weights {
            rebound(&mut group.curves, bounds);
        }
    }
}

/// Weights brought back within bounds, frame by frame.
pub fn rebound(curves: &mut [Vec<f64>], [lower, upper]: [f64; 2]) {
    for k in 0..curves.first().map_or(0, Vec::len) {
        let mut weights: Vec<f64> = curves.iter().map(|c| c[k]).collect();
        bounded(&mut weights, lower, upper);
        curves.iter_mut().zip(weights).for_each(|(c, w)| c[k] = w);
    }
}

fn resting(curve: &[f64], rest: Rest) -> Vec<f64> {
    let n = curve.len();
    let mean = curve.iter().sum::<f64>() / n.max(1) as f64;
    match rest {
        Rest::Mean => vec![mean; n],
        Rest::Frame(k) => vec![curve.get(k).copied().unwrap_or(mean); n],
        Rest::Trend => {
            let middle = 0.5 * n.saturating_sub(1) as f64;
            let spread: f64 = (0..n).map(|k| (k as f64 - middle) * (k as f64 - middle)).sum();
            let slope: f64 = curve.iter().enumerate().map(|(k, x)| (k as f64 - middle) * (x - mean)).sum::<f64>() / spread.max(1.0);
            (0..n).map(|k| mean + slope * (k as f64 - middle)).collect()
        }
    }
}
