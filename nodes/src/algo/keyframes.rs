//! Keyframes: what an animator sets on a few frames, and what lies between.
//!
//! Every easing is a blend of the keys around a frame, so that one set of coefficients serves positions, angles and weights alike, and weights that add up
//! to 1 on the keys do so between them.
//!
//! **Source**: Thomas and Johnston, *The Illusion of Life*, 1981 (slow in and slow out, arcs, overshoot); Catmull and Rom 1974 (spline); Penner 2001
//! (overshoot).

use pegbar_engine::Setting;

/// How one key goes over into the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Easing {
    /// It stays, then jumps.
    Hold,
    /// At one speed.
    Linear,
    /// Slowly out of the key and slowly into the next: 3u² - 2u³.
    Smooth,
    /// Slowly out of the key, as what falls: u².
    SlowOut,
    /// Slowly into the next, as what is thrown up: 1 - (1 - u)².
    SlowIn,
    /// Through the keys without a stop, in arcs: Catmull and Rom's spline, at rest at both ends.
    Spline,
    /// Fast out of the key, past the next and back to it.
    Overshoot,
}

/// What is shown before the first key and after the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Beyond {
    /// They are held.
    Hold,
    /// All of it again: a cycle, whose last key is as its first.
    Loop,
    /// All of it again, each round from where the one before ended: a walk that gets somewhere.
    Advance,
}

/// Keys in time, at least one, each later than the one before.
#[derive(Clone, Copy, Debug)]
pub struct Keyframes<'a> {
    /// When each is.
    pub times: &'a [i64],
    /// One for all, or one for each key, of which the last is for nothing.
    pub easing: &'a [Easing],
    /// Before the first and after the last.
    pub beyond: Beyond,
    /// How far an overshoot goes past its key: 0 not at all, 1.70158 by a tenth of the way.
    pub overshoot: f64,
}

impl Keyframes<'_> {
    /// How much of each key is at `time`; they add up to 1. Values at that time are the sum of the keys' values by these.
    pub fn coefficients(&self, time: i64) -> Vec<f64> {
        let mut out = vec![0.0; self.times.len()];
        let (Some(&first), Some(&last)) = (self.times.first(), self.times.last()) else { return out };
        let (mut time, mut round) = (time, 0);
        if self.beyond != Beyond::Hold && last > first {
            round = (time - first).div_euclid(last - first);
            time -= round * (last - first);
        }
        let at = self.times.partition_point(|&t| t <= time).saturating_sub(1);
        let Some(&next) = self.times.get(at + 1) else {
            self.add(&mut out, at as i64, round, 1.0);
            return out;
        };
        let here = self.times[at];
        let u = ((time - here) as f64 / (next - here) as f64).max(0.0);
        let at = at as i64;
        for (key, c) in self.segment(at, u) {
            self.add(&mut out, at + key, round, c);
        }
        out
    }

    /// Coefficients of keys before and after the segment from `at`, at the share `u` of it.
    fn segment(&self, at: i64, u: f64) -> Vec<(i64, f64)> {
        let easing = self.easing.get(at as usize).or(self.easing.first()).copied().unwrap_or(Easing::Linear);
        let v = 1.0 - u;
        let eased = match easing {
            Easing::Hold => 0.0,
            Easing::Linear => u,
            Easing::Smooth => u * u * (3.0 - 2.0 * u),
            Easing::SlowOut => u * u,
            Easing::SlowIn => 1.0 - v * v,
            Easing::Overshoot => 1.0 - v * v * ((self.overshoot + 1.0) * v - self.overshoot),
            Easing::Spline => return self.spline(at, u),
        };
        vec![(0, 1.0 - eased), (1, eased)]
    }

    /// Hermite's cubic, with the slope at each key that of the chord from the one before to the one after.
    fn spline(&self, at: i64, u: f64) -> Vec<(i64, f64)> {
        let v = 1.0 - u;
        let span = self.time(at + 1) - self.time(at);
        let mut out = vec![(0, v * v * (1.0 + 2.0 * u)), (1, u * u * (3.0 - 2.0 * u))];
        let n = self.times.len() as i64;
        for (key, hermite) in [(0, u * v * v), (1, -u * u * v)] {
            let is_end = self.beyond == Beyond::Hold && (at + key == 0 || at + key == n - 1);
            if !is_end {
                let slope = hermite * span / (self.time(at + key + 1) - self.time(at + key - 1));
                out.extend([(key + 1, slope), (key - 1, -slope)]);
            }
        }
        out
    }

    /// The key's position in its round, and the round, where the last key of one is the first of the next.
    fn wrapped(&self, key: i64) -> (i64, i64) {
        let n = self.times.len() as i64;
        if (0..n).contains(&key) { (key, 0) } else { (key.rem_euclid(n - 1), key.div_euclid(n - 1)) }
    }

    /// When a key is, also one of another round.
    fn time(&self, key: i64) -> f64 {
        let (own, round) = self.wrapped(key);
        (self.times[own as usize] + round * (self.times[self.times.len() - 1] - self.times[0])) as f64
    }

    /// Adds a share of a key in a round.
    fn add(&self, out: &mut [f64], key: i64, round: i64, share: f64) {
        let (own, more) = self.wrapped(key);
        out[own as usize] += share;
        if self.beyond == Beyond::Advance {
            let way = share * (round + more) as f64;
            out[self.times.len() - 1] += way;
            out[0] -= way;
        }
    }
}

/// The frame whose drawing is shown at `frame`, where each is shown for `hold` frames from `first` on.
pub fn drawn(frame: i64, first: i64, hold: u32) -> i64 {
    let hold = i64::from(hold.max(1));
    first + (frame - first).div_euclid(hold) * hold
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(times: &[i64], values: &[f64], easing: &[Easing], beyond: Beyond, time: i64) -> f64 {
        let keys = Keyframes { times, easing, beyond, overshoot: 1.70158 };
        let c = keys.coefficients(time);
        assert!((c.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{c:?}");
        c.iter().zip(values).map(|(c, v)| c * v).sum()
    }

    #[test]
    fn each_easing_is_its_formula() {
        // A quarter and three quarters of the way from 0 to 1.
        let cases = [
            (Easing::Hold, [0.0, 0.0]),
            (Easing::Linear, [0.25, 0.75]),
            (Easing::Smooth, [0.15625, 0.84375]),
            (Easing::SlowOut, [0.0625, 0.5625]),
            (Easing::SlowIn, [0.4375, 0.9375]),
            (Easing::Spline, [0.15625, 0.84375]),
            (Easing::Overshoot, [1.0 - 2.70158 * 0.421875 + 1.70158 * 0.5625, 1.0 - 2.70158 * 0.015625 + 1.70158 * 0.0625]),
        ];
        for (easing, truth) in cases {
            for (time, truth) in [(3, truth[0]), (9, truth[1]), (0, 0.0), (12, 1.0), (-5, 0.0), (99, 1.0)] {
                let found = at(&[0, 12], &[0.0, 1.0], &[easing], Beyond::Hold, time);
                assert!((found - truth).abs() < 1e-12, "{easing:?} at {time}: {found}, expected {truth}");
            }
        }
    }

    #[test]
    fn an_overshoot_goes_past_by_a_tenth() {
        let most = (0..=1000).map(|t| at(&[0, 1000], &[0.0, 1.0], &[Easing::Overshoot], Beyond::Hold, t)).fold(0.0, f64::max);
        assert!((most - 1.1).abs() < 1e-4, "{most}");
    }

    #[test]
    fn what_is_thrown_up_and_falls_is_a_parabola() {
        for t in 0..=20 {
            let found = at(&[0, 10, 20], &[0.0, 100.0, 0.0], &[Easing::SlowIn, Easing::SlowOut, Easing::Hold], Beyond::Hold, t);
            assert!((found - (100.0 - ((t - 10) * (t - 10)) as f64)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_spline_through_keys_of_a_line_or_parabola_stays_on_it() {
        // Chords over equal spans have a parabola's slope at their middle.
        let times = [0, 4, 8, 12, 16];
        let curve = |t: i64| 3.0 + 2.0 * t as f64 - 0.5 * (t * t) as f64;
        let values = times.map(curve);
        for t in 4..=12 {
            assert!((at(&times, &values, &[Easing::Spline], Beyond::Hold, t) - curve(t)).abs() < 1e-12);
        }
        let uneven = [0, 3, 4, 9, 20];
        for t in 3..=9 {
            assert!((at(&uneven, &uneven.map(|t| t as f64), &[Easing::Spline], Beyond::Hold, t) - t as f64).abs() < 1e-12);
        }
    }

    #[test]
    fn a_loop_repeats_and_an_advance_goes_on() {
        let (times, values) = ([2, 5, 8, 10], [1.0, 4.0, 2.0, 1.0]);
        for easing in [Easing::Linear, Easing::Spline, Easing::Overshoot] {
            for t in 2..10 {
                let own = at(&times, &values, &[easing], Beyond::Loop, t);
                for round in [-3, 1, 7] {
                    assert!((at(&times, &values, &[easing], Beyond::Loop, t + 8 * round) - own).abs() < 1e-12);
                }
            }
        }
        // A straight walk is straight through all its rounds.
        let way = times.map(|t| 10.0 * t as f64);
        for easing in [Easing::Linear, Easing::Spline] {
            for t in -40..60 {
                assert!((at(&times, &way, &[easing], Beyond::Advance, t) - 10.0 * t as f64).abs() < 1e-9, "{easing:?} {t}");
            }
        }
    }

    #[test]
    fn one_key_is_always_shown() {
        for beyond in [Beyond::Hold, Beyond::Loop, Beyond::Advance] {
            for t in [-9, 4, 50] {
                assert_eq!(at(&[4], &[7.0], &[Easing::Spline], beyond, t), 7.0);
            }
        }
    }

    #[test]
    fn drawings_stand_on_twos_from_the_first_frame() {
        assert_eq!((1..=6).map(|f| drawn(f, 1, 2)).collect::<Vec<_>>(), [1, 1, 3, 3, 5, 5]);
        assert_eq!(drawn(7, 1, 1), 7);
    }
}
