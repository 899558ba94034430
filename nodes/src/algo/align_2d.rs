//! Chains of limbs turned in the picture as those of another figure. Jain, Sheikh, Hodgins 2009, section 3.4.

use pegbar_engine::Setting;

/// How long limbs are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Lengths {
    /// As they come, foreshortening included: the drawing's proportions are not taken.
    Source,
    /// As in the target: the drawing itself, hung on the source's root.
    Target,
}

/// Turns each limb of each chain of markers as in `target`, from the chain's first marker outwards: x_c = x_p + l (cos θ, sin θ).
///
/// Limbs without a direction in `target`, and all whose ends are not in it, keep their own. Markers in no chain stay where they are.
pub fn align_2d(source: &[[f64; 2]], target: &[[f64; 2]], chains: &[Vec<usize>], lengths: Lengths) -> Vec<[f64; 2]> {
    let mut points = source.to_vec();
    for limb in chains.iter().flat_map(|c| c.windows(2)) {
        let across = |p: &[[f64; 2]]| [0, 1].map(|c| p[limb[1]][c] - p[limb[0]][c]);
        let (own, drawn) = (across(source), across(target));
        let [l, d] = [own, drawn].map(|v| libm::hypot(v[0], v[1]));
        let by = match lengths {
            _ if !(d > 0.0 && d.is_finite()) => own,
            Lengths::Source => drawn.map(|v| v / d * l),
            Lengths::Target => drawn,
        };
        points[limb[1]] = [0, 1].map(|c| points[limb[0]][c] + by[c]);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: [[f64; 2]; 5] = [[10.0, 10.0], [10.0, 7.0], [10.0, 3.0], [12.0, 7.0], [10.0, 20.0]];

    fn chains() -> Vec<Vec<usize>> {
        vec![vec![0, 1, 2], vec![1, 3]]
    }

    #[test]
    fn limbs_turn_and_keep_their_lengths() {
        let target = [[100.0, 100.0], [130.0, 100.0], [130.0, 60.0], [130.0, 190.0], [0.0, 0.0]];
        let found = align_2d(&SOURCE, &target, &chains(), Lengths::Source);
        assert_eq!(found, [[10.0, 10.0], [13.0, 10.0], [13.0, 6.0], [13.0, 12.0], [10.0, 20.0]]);
        let drawn = align_2d(&SOURCE, &target, &chains(), Lengths::Target);
        assert_eq!(drawn, [[10.0, 10.0], [40.0, 10.0], [40.0, -30.0], [40.0, 100.0], [10.0, 20.0]]);
    }

    #[test]
    fn a_figure_aligned_to_itself_stays() {
        for lengths in [Lengths::Source, Lengths::Target] {
            let found = align_2d(&SOURCE, &SOURCE, &chains(), lengths);
            assert!(found.iter().flatten().zip(SOURCE.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    #[test]
    fn what_has_no_direction_keeps_its_own_and_what_hangs_on_it_goes_along() {
        let mut target = SOURCE;
        target[1] = [f64::NAN; 2];
        assert_eq!(align_2d(&SOURCE, &target, &chains(), Lengths::Source), SOURCE);
        let mut flat = SOURCE;
        (flat[1], flat[2]) = (flat[0], [13.0, 10.0]);
        assert_eq!(align_2d(&SOURCE, &flat, &[vec![0, 1, 2]], Lengths::Source)[..3], [[10.0, 10.0], [10.0, 7.0], [14.0, 7.0]]);
    }
}
