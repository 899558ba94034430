//! Keys moved onto one of them or their mean, so that what an affine motion can do is left to the motion (Bregler et al. 2002, sections 3.1.3
//! and 3.4; equation 5).

use pegbar_engine::Setting;
use pegbar_engine::node::NodeError;

use crate::algo::fit_affine::{aligned, finite, fit};
use crate::algo::raster::{Affine, apply, identity};
use crate::algo::track_affine::Model;

/// What keys are moved onto.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum AlignTo {
    /// Nothing: they stay as drawn.
    None,
    /// The first key.
    First,
    /// The mean of the keys, once they are moved onto the first.
    Mean,
}

type Points = Vec<[f64; 2]>;

/// Moves keys onto `to` as far as `model` can; for each key the motion that moved it.
///
/// Keys whose points lie on a line are moved by a similarity at the most, as more cannot be told.
pub(crate) fn align(keys: &mut [Points], to: AlignTo, model: Model) -> Result<Vec<Affine>, NodeError> {
    let mut motions = vec![identity(); keys.len()];
    let Some(first) = keys.first().filter(|_| to != AlignTo::None).cloned() else { return Ok(motions) };
    for (k, key) in keys.iter().enumerate() {
        finite(key).map_err(|e| NodeError::input(format!("key {k}: {e}")))?;
    }
    let onto = if to == AlignTo::First { first } else { mean(keys, &first, model) };
    // The first key stays to the bit where it is what the others are moved onto.
    let stay = usize::from(to == AlignTo::First);
    for (k, (key, motion)) in keys.iter_mut().zip(&mut motions).enumerate().skip(stay) {
        *motion = fit(key, &onto, model).map_err(|e| NodeError::input(format!("key {k}: {e}")))?.motion;
        key.iter_mut().for_each(|p| *p = apply(motion, (*p).into()).into());
    }
    Ok(motions)
}

/// The mean of keys, each moved onto the first.
fn mean(keys: &[Points], first: &[[f64; 2]], model: Model) -> Points {
    let mut mean = vec![[0.0; 2]; first.len()];
    for key in keys {
        for (m, p) in mean.iter_mut().zip(aligned(key, first, model)) {
            (0..2).for_each(|c| m[c] += p[c] / keys.len() as f64);
        }
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: [[f64; 2]; 5] = [[0.0, 0.0], [4.0, 0.0], [6.0, 3.0], [4.0, 5.0], [-1.0, 4.0]];

    fn by(m: &Affine, points: &[[f64; 2]]) -> Points {
        points.iter().map(|p| apply(m, (*p).into()).into()).collect()
    }

    fn farthest(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn moved_keys_come_back_onto_the_first() {
        let motion = Affine::new(1.2, -0.4, 30.0, 0.3, 0.9, -5.0);
        for to in [AlignTo::First, AlignTo::Mean] {
            let mut keys = [FIRST.to_vec(), by(&motion, &FIRST)];
            let drawn = keys.clone();
            let found = align(&mut keys, to, Model::Affine).unwrap();
            assert!(farthest(&keys[0], &FIRST) < 1e-12 && farthest(&keys[1], &FIRST) < 1e-12);
            assert!(farthest(&by(&found[1], &drawn[1]), &keys[1]) == 0.0);
        }
    }

    #[test]
    fn what_stays_as_drawn_keeps_its_bits() {
        let mut keys = [FIRST.to_vec(), vec![[9.0, 1.0]; 5]];
        let drawn = keys.clone();
        assert_eq!((align(&mut keys, AlignTo::None, Model::Affine).unwrap(), &keys), (vec![identity(); 2], &drawn));
        align(&mut keys, AlignTo::First, Model::Translation).unwrap();
        assert_eq!(keys[0], drawn[0]);
    }

    /// The mean prefers no key: each is as far from it as its own difference says.
    #[test]
    fn the_mean_lies_between() {
        let shift = |d: f64| FIRST.map(|p| [p[0] + d, p[1]]).to_vec();
        let mut keys = [shift(0.0), shift(3.0), shift(6.0)];
        align(&mut keys, AlignTo::Mean, Model::Translation).unwrap();
        assert!(keys.iter().all(|k| farthest(k, &FIRST) < 1e-12));
        let mut squashed = [FIRST.to_vec(), FIRST.map(|p| [p[0], 0.5 * p[1]]).to_vec()];
        align(&mut squashed, AlignTo::Mean, Model::Rigid).unwrap();
        assert!(farthest(&squashed[0], &squashed[1]) > 1.0);
    }

    #[test]
    fn what_cannot_be_moved_names_the_key() {
        let message = |mut keys: Vec<Points>, to| align(&mut keys, to, Model::Affine).unwrap_err().message;
        let bad = vec![FIRST.to_vec(), vec![[f64::NAN; 2]; 5]];
        assert_eq!(message(bad, AlignTo::First), "key 1: expected finite points, found (NaN, NaN) at point 0");
        assert_eq!(message(vec![vec![[f64::INFINITY, 0.0]; 2]], AlignTo::Mean), "key 0: expected finite points, found (inf, 0) at point 0");
        let line = vec![FIRST.to_vec(), (0..5).map(|i| [f64::from(i), 2.0]).collect()];
        let mut keys = line.clone();
        align(&mut keys, AlignTo::First, Model::Affine).unwrap();
        assert!(keys[1].iter().flatten().all(|v| v.is_finite()));
    }
}
