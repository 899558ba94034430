//! Tests of the affine warp.

use super::*;
use proptest::prelude::*;

const FILTERS: [Filter; 5] = [Filter::Nearest, Filter::Bilinear, Filter::Cubic, Filter::Mitchell, Filter::Lanczos3];

/// Smooth, different in every channel, and not symmetric.
fn picture(width: usize, height: usize, channels: usize) -> Vec<f32> {
    let value = |i: usize| {
        let (c, x, y) = (i % channels, (i / channels) % width, i / channels / width);
        libm::sin(0.37 * x as f64 + 0.21 * y as f64 + c as f64) * 0.4 + 0.5
    };
    (0..width * height * channels).map(|i| value(i) as f32).collect()
}

fn source(data: &[f32], width: usize, height: usize, channels: usize, origin: [i64; 2]) -> Source<'_> {
    Source::new(Raster::new(data, width, height, channels).unwrap(), origin)
}

fn options(filter: Filter, outside: Outside, antialias: bool) -> WarpOptions {
    WarpOptions { filter, outside, antialias }
}

fn warped(source: Source<'_>, map: &Affine, options: WarpOptions, window: Window) -> Vec<f32> {
    let mut out = vec![f32::NAN; window.samples(source.raster.channels).unwrap()];
    warp_affine(source, map, options, &mut out, window).unwrap();
    out
}

/// The definition, in `f64`: the sum over all samples of value times filter at the distance.
fn reference(source: Source<'_>, map: &Affine, options: WarpOptions, window: Window) -> Vec<f64> {
    let inverse = invert(map).unwrap();
    let r = source.raster;
    let mut out = Vec::new();
    for y in 0..window.height {
        for x in 0..window.width {
            let p = nalgebra::Vector2::new(window.x as f64 + x as f64 + 0.5, window.y as f64 + y as f64 + 0.5);
            let q = super::super::raster::apply(&inverse, p);
            let (sx, sy) = (q.x - source.origin[0] as f64 - 0.5, q.y - source.origin[1] as f64 - 0.5);
            for c in 0..r.channels {
                out.push(reference_sample(r, options, sx, sy, c));
            }
        }
    }
    out
}

fn reference_sample(r: Raster<'_>, options: WarpOptions, sx: f64, sy: f64, c: usize) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for j in sy.floor() as i64 - 3..sy.floor() as i64 + 5 {
        for i in sx.floor() as i64 - 3..sx.floor() as i64 + 5 {
            let weight = options.filter.at(i as f64 - sx) * options.filter.at(j as f64 - sy);
            total += weight;
            let (ci, cj) = (i.clamp(0, r.width as i64 - 1), j.clamp(0, r.height as i64 - 1));
            if (ci, cj) == (i, j) || options.outside == Outside::Clamp {
                sum += weight * f64::from(r.data[(cj as usize * r.width + ci as usize) * r.channels + c]);
            }
        }
    }
    sum / total
}

fn turn(angle: f64, scale: f64, x: f64, y: f64) -> Affine {
    let (s, c) = (libm::sin(angle) * scale, libm::cos(angle) * scale);
    Affine::new(c, -s, x, s, c, y)
}

#[test]
fn every_filter_agrees_with_its_definition() {
    let maps = [turn(0.4, 1.3, 7.2, -3.1), turn(2.9, 1.0, 31.0, 29.5), Affine::new(1.5, 0.7, -9.0, -0.2, -1.1, 30.0)];
    for channels in [1, 3, 4, 5] {
        let data = picture(33, 27, channels);
        let from = source(&data, 33, 27, channels, [-3, 5]);
        let window = Window::new(-8, -4, 44, 32);
        for (map, filter, outside) in every_case(&maps) {
            let options = options(filter, outside, false);
            let (found, expected) = (warped(from, &map, options, window), reference(from, &map, options, window));
            let worst = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-6, "{filter:?} {outside:?} {channels} channels: off by {worst}");
        }
    }
}

/// Every map with every filter that has a continuous definition, and every rule for the outside.
fn every_case(maps: &[Affine]) -> Vec<(Affine, Filter, Outside)> {
    let mut all = Vec::new();
    for map in maps {
        for filter in &FILTERS[1..] {
            for outside in [Outside::Transparent, Outside::Clamp] {
                all.push((*map, *filter, outside));
            }
        }
    }
    all
}

#[test]
fn identity_and_whole_translations_are_exact_copies() {
    let data = picture(19, 11, 4);
    let from = source(&data, 19, 11, 4, [2, -1]);
    for filter in FILTERS.into_iter().filter(|f| f.interpolates()) {
        let options = options(filter, Outside::Transparent, true);
        assert_eq!(warped(from, &Affine::identity(), options, from.window()), data, "{filter:?}");
        let moved = Affine::new(1.0, 0.0, 7.0, 0.0, 1.0, -3.0);
        assert_eq!(bounds(from.window(), &moved, options).unwrap(), Window::new(9, -4, 19, 11));
        assert_eq!(warped(from, &moved, options, Window::new(9, -4, 19, 11)), data, "{filter:?}");
        let larger = warped(from, &moved, options, Window::new(8, -5, 21, 13));
        assert_eq!(larger.iter().filter(|v| **v != 0.0).count(), data.len());
    }
}

#[test]
fn quarter_turns_move_samples() {
    let data = picture(8, 8, 4);
    let from = source(&data, 8, 8, 4, [0, 0]);
    let map = Affine::new(0.0, -1.0, 8.0, 1.0, 0.0, 0.0);
    for filter in FILTERS.into_iter().filter(|f| f.interpolates()) {
        let out = warped(from, &map, options(filter, Outside::Transparent, true), Window::at_origin(8, 8));
        for (y, x) in (0..8).flat_map(|y| (0..8).map(move |x| (y, x))) {
            let at = (x * 8 + 7 - y) * 4;
            assert_eq!(out[at..at + 4], data[(y * 8 + x) * 4..][..4], "{filter:?} {x} {y}");
        }
    }
}

#[test]
fn a_ramp_stays_a_ramp() {
    let data: Vec<f32> = (0..40 * 40).map(|i| (i % 40) as f32 * 0.01 + (i / 40) as f32 * 0.02).collect();
    let from = source(&data, 40, 40, 1, [0, 0]);
    for scale in [0.3, 0.5, 0.75, 0.95, 1.7] {
        for filter in [Filter::Bilinear, Filter::Cubic, Filter::Mitchell, Filter::Lanczos3] {
            let map = turn(0.3, scale, 12.0, 4.0);
            let out = warped(from, &map, options(filter, Outside::Transparent, true), Window::at_origin(40, 40));
            let inverse = invert(&map).unwrap();
            for i in 0..1600 {
                let q = super::super::raster::apply(&inverse, nalgebra::Vector2::new((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5));
                let reach = 4.5 / scale.min(1.0);
                let inside = |v: f64| v > reach && v < 40.0 - reach;
                if inside(q.x) && inside(q.y) {
                    let expected = (q.x - 0.5) * 0.01 + (q.y - 0.5) * 0.02;
                    // The filters that are as wide as the samples reproduce ramps, Lanczos nearly so; the first moment of a widened filter
                    // is zero only on average, and is off by up to a seventh of a pixel where the slope is 0.02 a pixel.
                    let tolerance = if scale >= ANTIALIAS_FROM && filter != Filter::Lanczos3 { 1e-6 } else { 3e-3 };
                    assert!((f64::from(out[i]) - expected).abs() < tolerance, "{filter:?} {scale} pixel {i}: {} {expected}", out[i]);
                }
            }
        }
    }
}

#[test]
fn shrinking_keeps_flat_fields_and_removes_a_checkerboard() {
    let flat = vec![0.25_f32; 200 * 200];
    let checks: Vec<f32> = (0..200 * 200).map(|i| ((i % 200 + i / 200) % 2) as f32).collect();
    for map in [turn(0.35, 0.21, 30.0, 5.0), Affine::new(0.2, 0.11, 3.0, 0.05, 0.3, 4.0), turn(0.0, 0.4, 0.0, 0.0)] {
        for filter in [Filter::Bilinear, Filter::Cubic, Filter::Mitchell, Filter::Lanczos3] {
            let options = options(filter, Outside::Clamp, true);
            let window = Window::new(0, 0, 60, 60);
            for v in warped(source(&flat, 200, 200, 1, [0, 0]), &map, options, window) {
                assert!((v - 0.25).abs() < 2e-6, "{filter:?}: flat became {v}");
            }
            let inner = reduced_inner(&warped(source(&checks, 200, 200, 1, [0, 0]), &map, options, window), &map);
            assert!(inner.iter().all(|v| (v - 0.5).abs() < 0.03), "{filter:?}: checks became {inner:?}");
        }
    }
}

/// The pixels whose source position is well inside 200 × 200.
fn reduced_inner(out: &[f32], map: &Affine) -> Vec<f32> {
    let inverse = invert(map).unwrap();
    let inside = |i: &usize| {
        let q = super::super::raster::apply(&inverse, nalgebra::Vector2::new((i % 60) as f64 + 0.5, (i / 60) as f64 + 0.5));
        [q.x, q.y].iter().all(|v| (40.0..160.0).contains(v))
    };
    (0..out.len()).filter(inside).map(|i| out[i]).collect()
}

/// The sum over all samples, in `f64`, of value times the widened filter, against both the separable and the slanted kernels.
#[test]
fn widened_filters_agree_with_their_definition() {
    let data = picture(40, 32, 4);
    let from = source(&data, 40, 32, 4, [0, 0]);
    let window = Window::at_origin(16, 12);
    for map in [turn(0.35, 0.4, 6.0, 0.0), Affine::new(0.35, 0.11, 0.0, 0.05, 0.6, -3.0), turn(0.0, 0.8, -1.0, 2.0)] {
        for filter in [Filter::Bilinear, Filter::Cubic, Filter::Mitchell, Filter::Lanczos3] {
            let options = options(filter, Outside::Transparent, true);
            let shape = footprint(&map, options).unwrap();
            let inverse = invert(&map).unwrap();
            let out = warped(from, &map, options, window);
            for (i, pixel) in out.chunks_exact(4).enumerate() {
                let centre = nalgebra::Vector2::new((i % 16) as f64 + 0.5, (i / 16) as f64 + 0.5);
                let position = super::super::raster::apply(&inverse, centre);
                let (mut sum, mut total) = (0.0, 0.0);
                for (x, y) in (-40..80).flat_map(|x| (-40..80).map(move |y| (x, y))) {
                    let d = shape * (nalgebra::Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - position);
                    let weight = filter.at(d.x) * filter.at(d.y);
                    total += weight;
                    if (0..40).contains(&x) && (0..32).contains(&y) {
                        sum += weight * f64::from(data[(y as usize * 40 + x as usize) * 4]);
                    }
                }
                // The tables have 2048 phases, between which the kink of the tent is cut.
                assert!((f64::from(pixel[0]) - sum / total).abs() < 2e-4, "{filter:?} pixel {i}: {} for {}", pixel[0], sum / total);
            }
        }
    }
}

#[test]
fn shrinking_keeps_the_total() {
    let data = picture(64, 48, 4);
    let from = source(&data, 64, 48, 4, [0, 0]);
    let before: f64 = data.iter().map(|&v| f64::from(v)).sum();
    for map in [turn(0.5, 0.3, 0.0, 0.0), Affine::new(0.25, 0.1, 0.0, -0.1, 0.5, 0.0), turn(0.1, 0.01, 0.0, 0.0)] {
        let det = map[(0, 0)] * map[(1, 1)] - map[(0, 1)] * map[(1, 0)];
        for filter in [Filter::Bilinear, Filter::Mitchell] {
            let options = options(filter, Outside::Transparent, true);
            let window = bounds(from.window(), &map, options).unwrap();
            let after: f64 = warped(from, &map, options, window).iter().map(|&v| f64::from(v)).sum();
            assert!((after / (before * det) - 1.0).abs() < 0.02, "{filter:?}: {after} of {}", before * det);
        }
    }
}

#[test]
fn what_cannot_be_warped() {
    let data = picture(3, 3, 4);
    let from = source(&data, 3, 3, 4, [0, 0]);
    let window = Window::at_origin(3, 3);
    let mut out = vec![1.0; 36];
    for bad in [f64::NAN, f64::INFINITY] {
        let map = Affine::new(1.0, 0.0, bad, 0.0, 1.0, 0.0);
        assert_eq!(warp_affine(from, &map, WarpOptions::default(), &mut out, window), Err(WarpError::NotFinite));
        assert_eq!(bounds(window, &map, WarpOptions::default()), Err(WarpError::NotFinite));
    }
    let short = warp_affine(from, &Affine::identity(), WarpOptions::default(), &mut out[1..], window);
    assert_eq!(short.unwrap_err().to_string(), "expected 36 samples for the window, found 35");
    let singular = Affine::new(1.0, 2.0, 0.0, 2.0, 4.0, 0.0);
    warp_affine(from, &singular, WarpOptions::default(), &mut out, window).unwrap();
    assert!(out.iter().all(|v| *v == 0.0));
    assert!(bounds(window, &singular, WarpOptions::default()).unwrap().is_empty());
    let huge = turn(0.0, 1e9, 0.0, 0.0);
    assert!(matches!(bounds(window, &huge, WarpOptions::default()), Err(WarpError::TooLarge { .. })));
}

#[test]
fn far_away_and_huge_scales_survive() {
    let data = picture(5, 4, 4);
    let from = source(&data, 5, 4, 4, [0, 0]);
    for map in [
        turn(0.2, 1.0, 1e300, 0.0),
        turn(0.2, 1e-300, 0.0, 0.0),
        turn(0.3, 1e-7, 3.0, 3.0),
        turn(0.3, 1e12, 0.0, 0.0),
        turn(1.0, 1.0, -1e15, 1e15),
    ] {
        for filter in FILTERS {
            for outside in [Outside::Transparent, Outside::Clamp] {
                let out = warped(from, &map, options(filter, outside, true), Window::at_origin(6, 6));
                assert!(out.iter().all(|v| v.is_finite()), "{filter:?} {outside:?}");
            }
        }
    }
}

#[test]
fn fused_over_is_warp_then_over() {
    let data = picture(40, 30, 4);
    let from = source(&data, 40, 30, 4, [0, 0]);
    let window = Window::new(-3, -2, 77, 300);
    let map = turn(0.3, 2.5, 5.0, 5.0);
    let mut fused = picture(77, 300, 4);
    let mut apart = fused.clone();
    warp_affine_over(from, &map, WarpOptions::default(), &mut fused, window).unwrap();
    merge::over_in_place(&warped(from, &map, WarpOptions::default(), window), &mut apart, 4);
    assert_eq!(fused, apart);
}

/// Recorded with OpenCV 5.0.0 on `picture(48, 40, 4)`, channel 1: `remap` with `INTER_LINEAR` and a constant border of 0.
#[test]
fn bilinear_agrees_with_opencv() {
    let recorded: Vec<f32> = bytemuck::pod_collect_to_vec(include_bytes!("testdata/opencv_remap_linear.f32"));
    let data = picture(48, 40, 4);
    let map = invert(&Affine::new(1.05, -0.2, 3.5, 0.25, 0.9, -4.25)).unwrap();
    let out = warped(source(&data, 48, 40, 4, [0, 0]), &map, WarpOptions::default(), Window::at_origin(48, 40));
    let squares: f64 = out.iter().skip(1).step_by(4).zip(&recorded).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum();
    let psnr = -10.0 * libm::log10(squares / recorded.len() as f64);
    assert_eq!(recorded.len(), 48 * 40);
    assert!(psnr > 90.0, "{psnr} dB");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn any_map_and_size(
        width in 0_usize..9, height in 0_usize..9, channels in 1_usize..6, filter in 0_usize..5, clamp: bool, antialias: bool,
        m in proptest::array::uniform6(-4.0_f64..4.0), x in -20_i64..20, y in -20_i64..20, w in 0_usize..40, h in 0_usize..12,
    ) {
        let data = vec![1.0_f32; width * height * channels];
        let from = source(&data, width, height, channels, [-2, 3]);
        let map = Affine::new(m[0], m[1], m[2], m[3], m[4], m[5]);
        let outside = if clamp { Outside::Clamp } else { Outside::Transparent };
        let options = options(FILTERS[filter], outside, antialias);
        let window = Window::new(x, y, w, h);
        let whole = warped(from, &map, options, window);
        // Ringing of the sharp filters stays below a half of the step.
        prop_assert!(whole.iter().all(|v| (-0.5..=1.5).contains(v)));
        // Any tiling gives the same bits.
        let (cut_x, cut_y) = (w / 3, h / 2);
        for tile in [Window::new(x, y, cut_x, cut_y), Window::new(x + cut_x as i64, y + cut_y as i64, w - cut_x, h - cut_y)] {
            let part = warped(from, &map, options, tile);
            for j in 0..tile.height {
                let at = (((tile.y - y) as usize + j) * w + (tile.x - x) as usize) * channels;
                prop_assert_eq!(&part[j * tile.width * channels..][..tile.width * channels], &whole[at..][..tile.width * channels]);
            }
        }
        // Nothing lies outside the bounds.
        if let (Ok(data_window), Outside::Transparent) = (bounds(from.window(), &map, options), outside) {
            for (i, v) in whole.iter().enumerate() {
                let pixel = i / channels;
                let at = Window::new(x + (pixel % w) as i64, y + (pixel / w) as i64, 1, 1);
                prop_assert!(*v == 0.0 || !data_window.intersect(&at).is_empty(), "{v} at {at:?} outside {data_window:?}");
            }
        }
    }
}
