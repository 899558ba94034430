//! How far a picture is from the frame.

use super::super::super::Robust;
use super::super::super::planes::Planes;

/// Tone scale of costs that are compared between starts.
const SOFT: f32 = 0.15;

pub(super) fn robust_weight(r: f32, bend: f32, robust: Robust) -> f32 {
    match robust {
        Robust::None => 1.0,
        Robust::Huber => (bend / r.abs().max(f32::MIN_POSITIVE)).min(1.0),
        Robust::GemanMcclure => {
            let q = 1.0 + r * r / (bend * bend);
            1.0 / (q * q)
        }
    }
}

/// Sum of the robust function of the residuals, whose weights are those of [`robust_weight`].
pub(super) fn robust_cost(a: &Planes, b: &Planes, bend: f32, robust: Robust) -> f64 {
    let rho = |r: f32| match robust {
        Robust::None => r * r,
        Robust::Huber if r.abs() <= bend => r * r,
        Robust::Huber => 2.0 * bend * r.abs() - bend * bend,
        Robust::GemanMcclure => r * r / (1.0 + r * r / (bend * bend)),
    };
    let row = |(a, b): (&Vec<f32>, &Vec<f32>)| {
        let chunks = a.chunks(256).zip(b.chunks(256));
        chunks.map(|(a, b)| f64::from(a.iter().zip(b).map(|(a, b)| rho(a - b)).sum::<f32>())).sum::<f64>()
    };
    a.data.iter().zip(&b.data).map(row).sum()
}

/// Mean share of misfit of all samples: 0 fits, 1 is unlike.
pub(super) fn soft_cost(a: &Planes, b: &Planes) -> f64 {
    let n = a.data.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let all = a.data.iter().zip(&b.data).flat_map(|(a, b)| a.iter().zip(b));
    all.map(|(a, b)| (a - b) * (a - b)).map(|s| f64::from(s / (s + SOFT * SOFT))).sum::<f64>() / n
}

/// Robust standard deviation of the residuals at some samples.
pub(super) fn robust_scale(a: &Planes, b: &Planes, at: &[usize]) -> f64 {
    let mut all: Vec<f32> = a.data.iter().zip(&b.data).flat_map(|(a, b)| at.iter().map(|&i| (a[i] - b[i]).abs())).collect();
    if all.is_empty() {
        return 0.0;
    }
    let mid = all.len() / 2;
    let (_, median, _) = all.select_nth_unstable_by(mid, f32::total_cmp);
    f64::from(*median) / 0.6745
}

/// The samples where a step changes something, of more than `most` an even choice; and which share of them it is.
pub(super) fn telling(slopes: &[Planes], most: usize) -> (Vec<usize>, f64) {
    let n = slopes.first().and_then(|s| s.data.first()).map_or(0, Vec::len);
    let mut energy = vec![0.0f32; n];
    for slope in &slopes[..2.min(slopes.len())] {
        slope.data.iter().for_each(|p| energy.iter_mut().zip(p).for_each(|(e, v)| *e += v * v));
    }
    let peak = energy.iter().fold(0.0f32, |m, v| m.max(*v));
    let all: Vec<usize> = (0..n).filter(|&i| energy[i] > 1e-3 * peak).collect();
    let keep = all.len().min(most);
    ((0..keep).map(|i| all[i * all.len() / keep.max(1)]).collect(), keep as f64 / all.len().max(1) as f64)
}
