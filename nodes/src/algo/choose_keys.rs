//! Which drawings of a sequence are its best keys.
//!
//! Bregler et al. 2002 leave the choice to the eye (section 1.4). Here the first key is the drawing from which an affine motion comes
//! nearest to all others at its worst, and each next one is the drawing that the capture with the keys so far makes worst: the
//! farthest-first rule of Gonzalez 1985, with the capture's own error for a distance. Then the drawing that is worst off takes the place of
//! one of the keys as long as that helps.

use super::capture_contour::{Capturer, Options};
use super::fit_affine::{aligned, fit_finite};
use super::key_weights::{KeySpace, Limits, WeightsError};

/// What was chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Positions of the chosen drawings, in the order of choice.
    pub chosen: Vec<usize>,
    /// Largest error of any drawing with one key, with two and so on, as they were chosen one by one, and at the end with all that are left
    /// after exchanges: root mean square, pixels.
    pub worst: Vec<f64>,
    /// Error of each drawing with all of them.
    pub errors: Vec<f64>,
    /// Points of the keys, one behind the other: the first as it is drawn, the others moved onto it.
    pub keys: Vec<[f64; 2]>,
}

/// Drawings that are tried for the first key.
const FIRST: usize = 48;
/// Most keys that are exchanged.
const EXCHANGES: usize = 100;

/// Chooses at most `count` of the drawings, fewer where all are captured to within `enough`. O(count × drawings × capture), and as much for
/// each exchange.
///
/// # Errors
/// No drawings, drawings of other numbers of points, or a point that is not finite. `between` is asked now and then and may stop with an
/// error of its own.
pub fn choose<E: From<WeightsError>>(
    shapes: &[Vec<[f64; 2]>],
    count: usize,
    enough: f64,
    options: Options,
    mut between: impl FnMut() -> Result<(), E>,
) -> Result<Choice, E> {
    let Some(first) = shapes.first() else { return Err(WeightsError::NoKeys.into()) };
    let space = KeySpace::new(1, first)?;
    shapes.iter().try_for_each(|s| space.check(s))?;
    // With few keys the bounds must still let the weights add up to 1.
    let limits = Limits { upper: options.limits.upper.max(1.0), ..options.limits };
    let options = Options { limits, ..options };
    let mut found = Choice { chosen: vec![central(shapes, options)], worst: Vec::new(), errors: vec![0.0; shapes.len()], keys: Vec::new() };
    loop {
        capture_all(shapes, &mut found, options, f64::INFINITY, &mut between)?;
        let far = worst(&found.errors);
        found.worst.push(found.errors[far]);
        if found.errors[far] <= enough || found.chosen.contains(&far) {
            return Ok(found);
        }
        if found.chosen.len() >= count {
            return exchanged(shapes, found, enough, options, between);
        }
        found.chosen.push(far);
    }
}

/// The greedy choice mended: the drawing that is worst off takes the place of that key without which the worst of all is least, while that
/// is better. The first choices were made without knowing of the last.
fn exchanged<E: From<WeightsError>>(
    shapes: &[Vec<[f64; 2]>],
    mut found: Choice,
    enough: f64,
    options: Options,
    mut between: impl FnMut() -> Result<(), E>,
) -> Result<Choice, E> {
    for _ in 0..EXCHANGES {
        let far = worst(&found.errors);
        let mut bound = found.errors[far] * (1.0 - 1e-6);
        if found.errors[far] <= enough || found.chosen.contains(&far) {
            break;
        }
        let mut best = None;
        for slot in 0..found.chosen.len() {
            let mut trial = found.clone();
            trial.chosen[slot] = far;
            if capture_all(shapes, &mut trial, options, bound, &mut between)? {
                bound = trial.errors[worst(&trial.errors)];
                best = Some(trial);
            }
        }
        let Some(better) = best else { break };
        found = better;
        found.worst.pop();
        found.worst.push(bound);
    }
    Ok(found)
}

fn worst(errors: &[f64]) -> usize {
    (0..errors.len()).fold(0, |f, i| if errors[i] > errors[f] { i } else { f })
}

/// Captures all drawings with the chosen keys, those first that were worst off before; false as soon as one is as bad as `bound`.
fn capture_all<E: From<WeightsError>>(
    shapes: &[Vec<[f64; 2]>],
    choice: &mut Choice,
    options: Options,
    bound: f64,
    between: &mut impl FnMut() -> Result<(), E>,
) -> Result<bool, E> {
    let first = &shapes[choice.chosen[0]];
    choice.keys.clone_from(first);
    for &at in &choice.chosen[1..] {
        // What the motion can do is no business of the keys'.
        choice.keys.extend(aligned(&shapes[at], first, options.model));
    }
    let mut capturer = Capturer::new(choice.chosen.len(), &choice.keys, options)?;
    let mut order: Vec<usize> = (0..shapes.len()).collect();
    order.sort_by(|a, b| choice.errors[*b].total_cmp(&choice.errors[*a]).then(a.cmp(b)));
    for at in order {
        between()?;
        choice.errors[at] = capturer.capture(&shapes[at])?.rms;
        if choice.errors[at] >= bound {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The drawing that is nearest to all others at its worst.
fn central(shapes: &[Vec<[f64; 2]>], options: Options) -> usize {
    let stride = shapes.len().div_ceil(FIRST);
    let reach = |at: usize| shapes.iter().map(|s| fit_finite(&shapes[at], s, options.model).rms).fold(0.0, f64::max);
    let reaches: Vec<(f64, usize)> = (0..shapes.len()).step_by(stride).map(|at| (reach(at), at)).collect();
    reaches.iter().fold((f64::INFINITY, 0), |b, r| if r.0 < b.0 { *r } else { b }).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(phase: f64) -> Vec<[f64; 2]> {
        let (s, c) = libm::sincos(phase);
        (0..60)
            .map(|i| {
                let t = f64::from(i) / 60.0 * std::f64::consts::TAU;
                let r = 80.0 + 20.0 * s * libm::cos(3.0 * t) + 15.0 * c * libm::sin(4.0 * t);
                [r * libm::cos(t), r * libm::sin(t)]
            })
            .collect()
    }

    #[test]
    fn two_free_directions_need_three_keys() {
        let shapes: Vec<_> = (0..24).map(|i| wave(f64::from(i) * 0.26)).collect();
        let limits = Limits { max_nonzero: 3, lower: -5.0, upper: 5.0 };
        let options = Options { limits, ..Options::default() };
        let found = choose::<WeightsError>(&shapes, 6, 1e-3, options, || Ok(())).unwrap();
        assert_eq!(found.chosen.len(), 3, "{:?}", found.worst);
        assert!(found.worst[0] > 10.0 && found.worst.windows(2).all(|w| w[1] <= w[0]) && found.worst[2] <= 1e-3, "{:?}", found.worst);
        assert!(found.chosen.iter().all(|at| found.errors[*at] < 1e-9));
    }

    #[test]
    fn one_drawing_held_needs_one_key() {
        let found = choose::<WeightsError>(&[wave(0.0), wave(0.0)], 5, 0.0, Options::default(), || Ok(())).unwrap();
        assert_eq!(found.chosen.len(), 1, "{found:?}");
        assert_eq!(choose::<WeightsError>(&[], 5, 0.0, Options::default(), || Ok(())), Err(WeightsError::NoKeys));
    }
}
