use super::*;
use crate::algo::compatible::sub;
use crate::algo::pca::{Keep, pca};

/// The outline of a bar of 4 by 0.8 bent into an arc.
fn bar(angle: f64) -> Vec<Point> {
    let place = |x: f64, y: f64| {
        let angle = if angle == 0.0 { 1e-5 } else { angle };
        let (radius, (sin, cos)) = (4.0 / angle, libm::sincos(x * angle / 4.0));
        [(radius - y) * sin, radius - (radius - y) * cos]
    };
    let (below, above) = ((0..=20).map(|i| [0.2 * f64::from(i), -0.4]), (0..=20).rev().map(|i| [0.2 * f64::from(i), 0.4]));
    let ends = ([[4.0, -0.2], [4.0, 0.0], [4.0, 0.2]], [[0.0, 0.2], [0.0, 0.0], [0.0, -0.2]]);
    below.chain(ends.0).chain(above).chain(ends.1).map(|[x, y]| place(x, y)).collect()
}

fn options(interpolation: Interpolation) -> Options {
    Options { interpolation, count: 5, closed: true, mesh: false, arap: ArapOptions::default() }
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>() / (a.len() / 2) as f64).sqrt()
}

/// What is left of a shape when its part in the space of `rows` about `mean` is taken away.
fn miss(shape: &[f64], mean: &[f64], rows: &[Vec<f64>]) -> f64 {
    let mut rest: Vec<f64> = shape.iter().zip(mean).map(|(a, b)| a - b).collect();
    for row in rows {
        let along: f64 = rest.iter().zip(row).map(|(a, b)| a * b).sum();
        rest.iter_mut().zip(row).for_each(|(a, b)| *a -= along * b);
    }
    rms(&rest, &vec![0.0; rest.len()])
}

/// Bends that were never drawn, in the space of four keys and in that of their in-betweens with six components.
#[test]
fn in_betweens_span_a_family_of_bends_ten_times_better_than_the_keys() {
    let keys: Vec<Vec<Point>> = [-90.0_f64, 0.0, 90.0, 180.0].iter().map(|d| bar(d.to_radians())).collect();
    let views: Vec<&[Point]> = keys.iter().map(Vec::as_slice).collect();
    let between = inbetweens(&views, options(Interpolation::Extended)).unwrap();
    assert_eq!(between.len(), 30);
    let flat: Vec<&[f64]> = keys.iter().chain(&between).map(|k| k.as_flattened()).collect();
    let n = keys[0].len();
    let (hand, extended) = (pca(&flat[..4], n, Keep::Components(3)).unwrap(), pca(&flat, n, Keep::Components(6)).unwrap());
    let bends: Vec<Vec<Point>> = (0..55).map(|i| bar((-90.0 + 5.0 * f64::from(i)).to_radians())).collect();
    let worst =
        |space: &crate::algo::pca::Space| bends.iter().map(|b| miss(b.as_flattened(), &space.mean, &space.components)).fold(0.0, f64::max);
    let (by_hand, by_space) = (worst(&hand), worst(&extended));
    assert!(by_space <= by_hand / 10.0, "{by_space} {by_hand}");
}

#[test]
fn every_interpolation_gives_the_keys_back() {
    let keys = [bar(0.0), bar(1.0), bar(-2.0)];
    for interpolation in [Interpolation::Linear, Interpolation::Extended, Interpolation::Arap] {
        let blend = KeyBlend::new(&[&keys[0], &keys[1], &keys[2]], options(interpolation)).unwrap();
        for (k, key) in keys.iter().enumerate() {
            let weights: Vec<f64> = (0..3).map(|i| f64::from(u8::from(i == k))).collect();
            assert_eq!(&blend.blend(&weights).unwrap()[..key.len()], key.as_slice(), "{interpolation:?}");
        }
    }
}

/// With two weights the extended space is at the in-between that stands there, and weights for in-betweens are taken as they are.
#[test]
fn the_extended_space_goes_through_its_in_betweens() {
    let keys = [bar(0.0), bar(3.0), bar(-1.0)];
    let views = [keys[0].as_slice(), &keys[1], &keys[2]];
    let blend = KeyBlend::new(&views, options(Interpolation::Extended)).unwrap();
    let between = inbetweens(&views, options(Interpolation::Extended)).unwrap();
    let n = keys[0].len();
    let third = blend.blend(&[4.0 / 6.0, 2.0 / 6.0, 0.0]).unwrap();
    assert!(rms(third[..n].as_flattened(), between[1].as_flattened()) < 1e-12);
    let mut weights = vec![0.0; 3 + 15];
    weights[3 + 1] = 1.0;
    assert_eq!(&blend.blend(&weights).unwrap()[..n], between[1].as_slice());
}

/// No step of the weights, however they pass through zero, makes the shape jump.
#[test]
fn the_extended_space_is_continuous() {
    let keys = [bar(0.0), bar(3.0), bar(-1.0)];
    let blend = KeyBlend::new(&[&keys[0], &keys[1], &keys[2]], options(Interpolation::Extended)).unwrap();
    let at = |u: f64| blend.blend(&[0.5 - u, 0.5 + 0.3 * u, 0.7 * u]).unwrap();
    for i in -40..40 {
        let (a, b) = (at(f64::from(i) * 0.05), at(f64::from(i) * 0.05 + 1e-7));
        let step = a.iter().zip(&b).map(|(p, q)| sub(*p, *q)).map(|d| libm::hypot(d[0], d[1])).fold(0.0, f64::max);
        assert!(step < 1e-5, "{i}: {step}");
    }
}

#[test]
fn weights_of_another_number_are_refused() {
    let keys = [bar(0.0), bar(1.0)];
    let blend = KeyBlend::new(&[&keys[0], &keys[1]], options(Interpolation::Extended)).unwrap();
    assert_eq!(blend.blend(&[1.0]), Err(KeyBlendError::Weights { keys: 2, extended: 7, found: 1 }));
    assert_eq!(blend.blend(&[f64::NAN, 1.0]), Err(KeyBlendError::NotFinite { at: 0 }));
    let open = Options { closed: false, ..options(Interpolation::Linear) };
    assert!(KeyBlend::new(&[&keys[0], &keys[1][1..]], open).is_err());
}
