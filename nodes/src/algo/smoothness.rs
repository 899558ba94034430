//! Smooth sequences: a price on second differences over time, beyond Bregler et al. 2002, which has "no temporal constraints" and jitters
//! for it (section 5).
//!
//! The sum over frames of ρ |x(t - 1) - 2 x(t) + x(t + 1)|² is what a least-squares fit pays on top of its error (Whittaker, *On a New
//! Method of Graduation*, 1923). The shares ρ are 1 for a plain price. So that contacts, pops and other accents are not rounded off, ρ may
//! fall where the sequence itself bends many times as hard as it mostly does (Geman, McClure, *Statistical Methods for Tomographic Image
//! Reconstruction*, 1987).

/// How smooth a sequence is to be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smoothing {
    /// Price of a squared second difference, in units of a squared error. 0 smooths nothing; 1 damps changes from frame to frame to a
    /// seventeenth and leaves swings of twenty frames and more.
    pub strength: f64,
    /// Second differences that are so many times the median are priced at a quarter, those far above hardly; 0 prices all alike.
    pub accents: f64,
}

/// The price of bending at each frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Bends {
    /// Strength times share, a frame; 0 at the first and the last, which are no middle of three.
    price: Vec<f64>,
}

impl Bends {
    /// For a sequence whose second differences have these squared lengths: one for each frame but the first and the last.
    pub(crate) fn new(smoothing: Smoothing, squared: &[f64]) -> Self {
        let mut sorted: Vec<f64> = squared.to_vec();
        sorted.sort_by(f64::total_cmp);
        // Frames that do not bend at all are held: they say nothing about how hard the others usually do.
        let still = 1e-18 * sorted.last().copied().unwrap_or_default();
        let moving = &sorted[sorted.partition_point(|d| *d <= still)..];
        let usual = moving.get(moving.len() / 2).copied().unwrap_or_default() * smoothing.accents * smoothing.accents;
        let share = |d: f64| {
            let over = if usual > 0.0 { d / usual } else { 0.0 };
            1.0 / ((1.0 + over * over) * (1.0 + over * over))
        };
        let mut price = vec![0.0];
        price.extend(squared.iter().map(|d| smoothing.strength * share(*d)));
        price.push(0.0);
        Self { price }
    }

    /// Factors of the frames two before to two after `t` in half the gradient of the whole price.
    pub(crate) fn stencil(&self, t: usize) -> [f64; 5] {
        let mut out = [0.0; 5];
        for (centre, own) in [(t.wrapping_sub(1), 1.0), (t, -2.0), (t + 1, 1.0)] {
            let Some(price) = self.price.get(centre).filter(|p| **p != 0.0) else { continue };
            for (at, factor) in [(centre - 1, 1.0), (centre, -2.0), (centre + 1, 1.0)] {
                out[at + 2 - t] += price * own * factor;
            }
        }
        out
    }

    /// What the price of frame `t` comes to with its neighbours held: so many times the squared distance from where they would have it, and
    /// a constant. `None` where they do not mind.
    pub(crate) fn towards<T: AsRef<[f64]>>(&self, values: &[T], t: usize) -> Option<(f64, Vec<f64>)> {
        let row = self.stencil(t);
        let mut out = vec![0.0; values.get(t)?.as_ref().len()];
        if row[2] <= 0.0 {
            return None;
        }
        for at in [0, 1, 3, 4] {
            if let Some(other) = (t + at).checked_sub(2).and_then(|s| values.get(s)) {
                subtract(&mut out, row[at] / row[2], other.as_ref());
            }
        }
        Some((row[2], out))
    }

    /// The whole price of a sequence.
    pub(crate) fn cost<T: AsRef<[f64]>>(&self, values: &[T]) -> f64 {
        bends(values).iter().zip(self.price.iter().skip(1)).map(|(d, p)| d * p).sum()
    }

    /// The sequence that is nearest to `values`, its price counted. O(frames × values).
    pub(crate) fn smoothed(&self, values: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let (mut out, factor) = (values.to_vec(), self.factor(values.len()));
        for t in 0..out.len() {
            let (before, here) = out.split_at_mut(t);
            for (back, other) in before.iter().rev().take(2).enumerate() {
                subtract(&mut here[0], factor[t][1 + back], other);
            }
        }
        for t in (0..out.len()).rev() {
            let (here, after) = out[t..].split_at_mut(1);
            here[0].iter_mut().for_each(|v| *v /= factor[t][0]);
            for (ahead, other) in after.iter().take(2).enumerate() {
                subtract(&mut here[0], factor[t + 1 + ahead][1 + ahead], other);
            }
        }
        out
    }

    /// L D Lᵀ of one plus half the price's second derivative: D and the two bands of L, row by row.
    fn factor(&self, n: usize) -> Vec<[f64; 3]> {
        let mut rows: Vec<[f64; 3]> = Vec::with_capacity(n);
        for t in 0..n {
            let row = self.stencil(t);
            let back = |b: usize| t.checked_sub(b).and_then(|at| rows.get(at)).copied().unwrap_or([1.0, 0.0, 0.0]);
            let ([d, band, _], [e, ..]) = (back(1), back(2));
            let two = row[0] / e;
            let one = (row[1] - two * e * band) / d;
            rows.push([1.0 + row[2] - one * one * d - two * two * e, one, two]);
        }
        rows
    }
}

fn subtract(from: &mut [f64], share: f64, other: &[f64]) {
    from.iter_mut().zip(other).for_each(|(v, o)| *v -= share * o);
}

/// Squared lengths of the second differences: one for each frame but the first and the last.
pub(crate) fn bends<T: AsRef<[f64]>>(values: &[T]) -> Vec<f64> {
    let bend = |w: &[T]| {
        let (a, b, c) = (w[0].as_ref(), w[1].as_ref(), w[2].as_ref());
        a.iter().zip(b).zip(c).map(|((a, b), c)| (a - 2.0 * b + c) * (a - 2.0 * b + c)).sum()
    };
    values.windows(3).map(bend).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(strength: f64, n: usize) -> Bends {
        Bends::new(Smoothing { strength, accents: 0.0 }, &vec![1.0; n.saturating_sub(2)])
    }

    #[test]
    fn the_stencil_is_that_of_squared_second_differences() {
        assert_eq!(plain(1.0, 20).stencil(5), [1.0, -4.0, 6.0, -4.0, 1.0]);
        assert_eq!(plain(1.0, 20).stencil(0), [0.0, 0.0, 1.0, -2.0, 1.0]);
        assert_eq!(plain(1.0, 3).stencil(1), [0.0, -2.0, 4.0, -2.0, 0.0]);
        assert_eq!((plain(1.0, 1).stencil(0), plain(1.0, 2).stencil(1)), ([0.0; 5], [0.0; 5]));
    }

    #[test]
    fn the_smoothed_sequence_is_the_least() {
        let values: Vec<Vec<f64>> = (0..30u32).map(|t| vec![f64::from(t * 7 % 11), f64::from(t * t % 13)]).collect();
        let bends = Bends::new(Smoothing { strength: 2.5, accents: 1.5 }, &super::bends(&values));
        let found = bends.smoothed(&values);
        let total = |x: &[Vec<f64>]| -> f64 {
            x.iter().flatten().zip(values.iter().flatten()).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() + bends.cost(x)
        };
        for t in 0..30 {
            // The gradient vanishes.
            let row = bends.stencil(t);
            for c in 0..2 {
                let pull: f64 = (0..5).filter_map(|j| Some(row[j] * found.get((t + j).checked_sub(2)?)?[c])).sum();
                assert!((found[t][c] - values[t][c] + pull).abs() < 1e-10);
            }
        }
        assert!(total(&found) < total(&values));
    }

    #[test]
    fn straight_lines_stay_and_a_change_at_every_frame_is_damped_to_a_seventeenth() {
        let line: Vec<Vec<f64>> = (0..40).map(|t| vec![3.0 - 0.5 * f64::from(t)]).collect();
        for (a, b) in plain(7.0, 40).smoothed(&line).iter().zip(&line) {
            assert!((a[0] - b[0]).abs() < 1e-9);
        }
        let shaken: Vec<Vec<f64>> = (0..40).map(|t| vec![f64::from(1 - 2 * (t % 2))]).collect();
        assert!((plain(1.0, 40).smoothed(&shaken)[20][0] - 1.0 / 17.0).abs() < 1e-3);
    }

    #[test]
    fn accents_keep_a_contact() {
        // A ball that comes down, and up again.
        let ball: Vec<Vec<f64>> = (0..41).map(|t| vec![f64::from((t - 20i32).abs()) + 0.1 * f64::from(t * 7 % 3)]).collect();
        let kept = |accents: f64| Bends::new(Smoothing { strength: 10.0, accents }, &bends(&ball)).smoothed(&ball)[20][0];
        assert!(kept(0.0) > 1.0 && kept(3.0) < 0.4, "{} and {}", kept(0.0), kept(3.0));
    }

    #[test]
    fn held_frames_do_not_make_accents_of_all_others() {
        let bends = Bends::new(Smoothing { strength: 1.0, accents: 3.0 }, &[0.0, 0.0, 0.0, 0.0, 4.0, 4.0]);
        assert!(bends.price[5] > 0.7 && bends.price[1] == 1.0, "{bends:?}");
    }
}
