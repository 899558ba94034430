use super::*;
use crate::algo::color::srgb_from_linear;

fn small(scene: SceneKind) -> CelSpec {
    CelSpec { scene, width: 160, height: 90, grain: 0.0, ..CelSpec::default() }
}

#[test]
fn cel_matte_is_the_coverage_of_its_contour() {
    for kind in [SceneKind::Hat, SceneKind::Ball] {
        let scene = Scene::new(small(kind)).unwrap();
        for frame in [0, 7, 20, 33] {
            let cel = scene.render(frame);
            assert_eq!(cel.matte, contour_coverage(&cel.contour, 160, 90));
            assert!(cel.matte.iter().sum::<f32>() > 100.0, "the cel is in the frame");
            let alpha: Vec<f32> = scene.layer(frame).image.chunks_exact(4).map(|p| p[3]).collect();
            assert_eq!(alpha, cel.matte);
        }
    }
}

#[test]
fn cel_motion_maps_the_reference_contour_onto_each_frame() {
    for kind in [SceneKind::Hat, SceneKind::Ball] {
        let scene = Scene::new(CelSpec { width: 300, ..small(kind) }).unwrap();
        let reference = scene.reference_contour();
        for frame in 0..kind.frame_count() {
            let cel = scene.layer(frame);
            assert_eq!(cel.key_weights, [1.0]);
            for (r, c) in reference.iter().zip(&cel.contour) {
                let p = apply(&cel.motion, Vector2::new(r[0], r[1]));
                assert!((p.x - c[0]).abs() < 1e-9 && (p.y - c[1]).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn cel_key_weights_and_motion_rebuild_a_deformed_contour() {
    let scene = Scene::new(CelSpec { deform: 1.0, ..small(SceneKind::Hat) }).unwrap();
    let keys = scene.key_contours();
    let mut bent = 0.0f64;
    for frame in 0..48 {
        let cel = scene.layer(frame);
        assert!((cel.key_weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        bent = bent.max(cel.key_weights[1]).max(cel.key_weights[2]);
        for (i, c) in cel.contour.iter().enumerate() {
            let shape = (0..3).fold(Vector2::zeros(), |s, k| s + Vector2::from(keys[k][i]) * cel.key_weights[k]);
            let p = apply(&cel.motion, shape);
            assert!((p.x - c[0]).abs() < 1e-9 && (p.y - c[1]).abs() < 1e-9, "frame {frame}");
        }
    }
    assert!(bent > 0.2, "the shapes are used: {bent}");
}

#[test]
fn cel_holds_are_exact_and_grain_is_not_held() {
    for hold in [1, 2, 3] {
        let scene = Scene::new(CelSpec { hold, ..small(SceneKind::Hat) }).unwrap();
        for frame in 0..6 {
            let same = scene.drawing_of(frame) == scene.drawing_of(frame + 1);
            assert_eq!(scene.render(frame) == scene.render(frame + 1), same, "frame {frame} on {hold}s");
        }
    }
    let grainy = Scene::new(CelSpec { grain: 2.0, ..small(SceneKind::Hat) }).unwrap();
    assert!(grainy.render(0).image != grainy.render(1).image && grainy.layer(0) == grainy.layer(1));
}

#[test]
fn cel_is_determined_by_its_seed() {
    let spec = CelSpec { grain: 2.0, ..small(SceneKind::Ball) };
    let (a, b) = (Scene::new(spec).unwrap(), Scene::new(spec).unwrap());
    assert_eq!(a.render(5), b.render(5));
    let other = Scene::new(CelSpec { seed: 2, ..spec }).unwrap();
    assert!(a.ground() != other.ground() && a.layer(5).image != other.layer(5).image);
}

#[test]
fn cel_grain_has_the_deviation_that_was_asked_for() {
    for sigma in [1.0, 4.0] {
        let clean = Scene::new(CelSpec { width: 320, height: 180, ..small(SceneKind::Ball) }).unwrap().render(3);
        let grainy = Scene::new(CelSpec { width: 320, height: 180, grain: sigma, ..small(SceneKind::Ball) }).unwrap().render(3);
        for c in 0..3 {
            let display = |v: f32| if v < 0.0 { -srgb_from_linear(f64::from(-v)) } else { srgb_from_linear(f64::from(v)) };
            let noise = clean.image.iter().zip(&grainy.image).skip(c).step_by(4).map(|(a, b)| 255.0 * (display(*b) - display(*a)));
            let (n, sum, squares) = noise.fold((0.0, 0.0, 0.0), |(n, s, q), v| (n + 1.0, s + v, q + v * v));
            let deviation = (squares / n - (sum / n) * (sum / n)).sqrt();
            // 57,600 samples: the deviation's own error is 0.3 %, the mean's 0.4 % of sigma.
            assert!((deviation / sigma - 1.0).abs() < 0.015, "expected {sigma}, found {deviation}");
            assert!((sum / n).abs() < 0.02 * sigma, "mean {}", sum / n);
        }
    }
}

#[test]
fn cel_replacements_cover_what_they_replace() {
    let hat = Scene::new(small(SceneKind::Hat)).unwrap();
    let alpha = |image: &[f32]| image.chunks_exact(4).map(|p| p[3]).collect::<Vec<f32>>();
    let (_, matte) = hat.reference();
    let witch = alpha(&hat.art(Art::WitchHat));
    let both: f32 = matte.iter().zip(&witch).map(|(a, b)| a.min(*b)).sum();
    assert!(both > 0.8 * matte.iter().sum::<f32>() && witch.iter().sum::<f32>() > matte.iter().sum::<f32>());
    let ball = Scene::new(small(SceneKind::Ball)).unwrap();
    let (_, disc) = ball.reference();
    let (donut, orange) = (alpha(&ball.art(Art::Donut)), alpha(&ball.art(Art::Orange)));
    assert_eq!(donut[45 * 160 + 80], 0.0, "the hole is open");
    assert!((orange.iter().sum::<f32>() / disc.iter().sum::<f32>() - 1.0).abs() < 0.06);
    for image in [hat.art(Art::WitchHat), ball.art(Art::Donut), ball.art(Art::Orange)] {
        assert!(image.chunks_exact(4).all(|p| p[3] > 0.0 || p[..3] == [0.0; 3]), "premultiplied");
    }
}

#[test]
fn cel_survives_odd_settings() {
    for (width, height) in [(1, 1), (3, 200), (200, 3)] {
        let scene = Scene::new(CelSpec { width, height, hold: 0, ..CelSpec::default() }).unwrap();
        assert!(scene.render(usize::MAX).image.iter().all(|v| v.is_finite()));
    }
    let error = Scene::new(CelSpec { width: 0, ..CelSpec::default() }).unwrap_err();
    assert_eq!(error.to_string(), "expected a frame of 1 to 16384 pixels a side, found 0x360");
    let error = Scene::new(CelSpec { grain: f64::NAN, ..CelSpec::default() }).unwrap_err();
    assert_eq!(error.to_string(), "expected grain to be finite, at least 0 and at most 255, found NaN");
}
