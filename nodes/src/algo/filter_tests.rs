//! Tests of blurs and resampling.

use super::super::raster::Raster;
use super::*;
use proptest::prelude::*;

fn source(data: &[f32], width: usize, channels: usize) -> Source<'_> {
    Source::new(Raster::new(data, width, data.len() / width / channels, channels).unwrap(), [0, 0])
}

fn picture(width: usize, height: usize, channels: usize) -> Vec<f32> {
    let value = |i: usize| {
        let (c, x, y) = (i % channels, (i / channels) % width, i / channels / width);
        libm::sin(0.37 * x as f64 + 0.21 * y as f64 + c as f64) * 0.4 + 0.5
    };
    (0..width * height * channels).map(|i| value(i) as f32).collect()
}

fn blurred(from: Source<'_>, sigma: [f64; 2], outside: Outside, window: Window) -> Vec<f32> {
    let mut out = vec![f32::NAN; window.samples(from.raster.channels).unwrap()];
    gaussian_blur(from, sigma, outside, &mut out, window).unwrap();
    out
}

/// The definition in one dimension: the whole Gaussian, normalised over the whole numbers.
fn reference(row: &[f32], sigma: f64, outside: Outside, x: i64) -> f64 {
    let reach = (8.0 * sigma) as i64 + 2;
    let (mut sum, mut total) = (0.0, 0.0);
    for i in x - reach..=x + reach {
        let weight = gaussian((i - x) as f64, sigma);
        let inside = i.clamp(0, row.len() as i64 - 1);
        total += weight;
        if inside == i || outside == Outside::Clamp {
            sum += weight * f64::from(row[inside as usize]);
        }
    }
    sum / total
}

#[test]
fn blur_is_the_gaussian_at_every_size() {
    let row: Vec<f32> = (0..97).map(|i| if (30..50).contains(&i) || i % 9 == 0 { 1.0 } else { 0.1 }).collect();
    for sigma in [0.3, 1.0, 2.7, 4.0, 4.1, 6.3, 9.9, 33.0] {
        for outside in [Outside::Transparent, Outside::Clamp] {
            let window = Window::new(-20, 0, 137, 1);
            let found = blurred(source(&row, 97, 1), [sigma, 0.0], outside, window);
            for (i, v) in found.iter().enumerate() {
                let expected = reference(&row, sigma, outside, i as i64 - 20);
                // The cut at 4.5 sigma takes 7e-6 of the weight, up to three times on the coarse grid.
                assert!((f64::from(*v) - expected).abs() < 2.5e-5, "{sigma} {outside:?} at {i}: {v} for {expected}");
            }
        }
    }
}

#[test]
fn blur_is_separable_and_mixed_stages_agree() {
    let data = picture(23, 31, 4);
    let both = blurred(source(&data, 23, 4), [1.5, 7.0], Outside::Clamp, Window::at_origin(23, 31));
    let across = blurred(source(&data, 23, 4), [1.5, 0.0], Outside::Clamp, Window::at_origin(23, 31));
    let down = blurred(source(&across, 23, 4), [0.0, 7.0], Outside::Clamp, Window::at_origin(23, 31));
    assert!(both.iter().zip(&down).all(|(a, b)| (a - b).abs() < 2e-6));
}

/// OpenCV 5.0.0 on `picture(48, 40, 4)`, channel 1: `GaussianBlur` with sigma 2.5 and replicated borders, `resize` to 24 × 20 by area.
#[test]
fn agrees_with_opencv() {
    let data = picture(48, 40, 4);
    let worst = |found: &[f32], bytes: &[u8]| {
        let recorded: Vec<f32> = bytemuck::pod_collect_to_vec(bytes);
        assert_eq!(recorded.len() * 4, found.len());
        found.iter().skip(1).step_by(4).zip(&recorded).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let blur = blurred(source(&data, 48, 4), [2.5; 2], Outside::Clamp, Window::at_origin(48, 40));
    // OpenCV cuts its kernel at 4 sigma.
    assert!(worst(&blur, include_bytes!("testdata/opencv_gaussian_2_5.f32")) < 1e-4);
    let mut small = vec![0.0; 24 * 20 * 4];
    resize(source(&data, 48, 4), ResizeFilter::Area, &mut small, 24, 20).unwrap();
    assert!(worst(&small, include_bytes!("testdata/opencv_resize_area.f32")) < 1e-6);
}

#[test]
fn resize_to_the_same_size_is_a_copy_and_ratios_are_exact() {
    let data = picture(9, 7, 3);
    for filter in
        [ResizeFilter::Area, ResizeFilter::CatmullRom, ResizeFilter::Kernel(Filter::Lanczos3), ResizeFilter::Kernel(Filter::Nearest)]
    {
        let mut out = vec![0.0; data.len()];
        resize(source(&data, 9, 3), filter, &mut out, 9, 7).unwrap();
        assert!(out.iter().zip(&data).all(|(a, b)| (a - b).abs() < 1e-7), "{filter:?}");
    }
    let mut out = [0.0; 2];
    resize(source(&[1.0, 2.0, 4.0, 8.0, 16.0, 32.0], 6, 1), ResizeFilter::Area, &mut out, 2, 1).unwrap();
    assert!((out[0] - 7.0 / 3.0).abs() < 1e-6 && (out[1] - 56.0 / 3.0).abs() < 1e-5);
    let mut out = [0.0; 4];
    resize(source(&[1.0, 2.0], 2, 1), ResizeFilter::Kernel(Filter::Nearest), &mut out, 4, 1).unwrap();
    assert_eq!(out, [1.0, 1.0, 2.0, 2.0]);
}

#[test]
fn derivative_kernels_are_exact_on_polynomials() {
    for sigma in [0.7, 1.0, 3.3] {
        for (order, power, expected) in [(0, 0, 1.0), (0, 1, 0.0), (1, 0, 0.0), (1, 1, 1.0), (2, 0, 0.0), (2, 1, 0.0), (2, 2, 2.0)] {
            let kernel = gaussian_kernel(sigma, order);
            let r = (kernel.len() / 2) as f64;
            // Convolved at 0: f(0 - i) times k(i), for f = x^power; its derivative of the order there is the expectation.
            let sum: f64 = kernel.iter().enumerate().map(|(i, k)| k * libm::pow(r - i as f64, f64::from(power))).sum();
            assert!((sum - expected).abs() < 1e-9, "sigma {sigma} order {order} power {power}: {sum}");
        }
    }
    assert!(gaussian_kernel(0.0, 0).is_empty() && gaussian_kernel(f64::NAN, 0).is_empty() && gaussian_kernel(1.0, 3).is_empty());
}

#[test]
fn box_blur_counts_parts_of_pixels() {
    let row = [0.0, 0.0, 1.0, 0.0, 0.0];
    let mut out = [0.0; 5];
    box_blur(source(&row, 5, 1), [2.0, 1.0], Outside::Transparent, &mut out, Window::at_origin(5, 1)).unwrap();
    assert_eq!(out, [0.0, 0.25, 0.5, 0.25, 0.0]);
    box_blur(source(&row, 5, 1), [0.0, 0.0], Outside::Transparent, &mut out, Window::at_origin(5, 1)).unwrap();
    assert_eq!(out, row);
}

#[test]
fn unsharp_undoes_nothing_on_flat_and_overshoots_at_edges() {
    let step: Vec<f32> = (0..20).map(|i| if i < 10 { 0.25 } else { 0.75 }).collect();
    let mut out = vec![0.0; 20];
    unsharp(source(&step, 20, 1), 1.0, 1.0, Outside::Clamp, &mut out, Window::at_origin(20, 1)).unwrap();
    assert!((out[0] - 0.25).abs() < 1e-6 && (out[19] - 0.75).abs() < 1e-6);
    assert!(out[9] < 0.2 && out[10] > 0.8);
    unsharp(source(&step, 20, 1), 1.0, 0.0, Outside::Clamp, &mut out, Window::at_origin(20, 1)).unwrap();
    assert_eq!(out, step);
}

#[test]
fn narrow_blurs_reach_beyond_the_picture() {
    let data = picture(3, 2, 1);
    let window = Window::new(-5, -4, 12, 9);
    let near = |x: i64, n: i64| x.clamp(0, n - 1) as usize;
    for sigma in [[0.0, 0.0], [0.005, 1e-9], [0.01, 0.03]] {
        let found = blurred(source(&data, 3, 1), sigma, Outside::Clamp, window);
        for (i, v) in found.iter().enumerate() {
            let (x, y) = (window.x + (i % window.width) as i64, window.y + (i / window.width) as i64);
            assert_eq!(*v, data[near(y, 2) * 3 + near(x, 3)], "sigma {sigma:?} at {x}, {y}");
        }
    }
}

#[test]
fn refusals() {
    let mut out = [0.0; 1];
    let from = [0.0];
    for bad in [f64::NAN, -1.0, 1e6] {
        let error = gaussian_blur(source(&from, 1, 1), [1.0, bad], Outside::Clamp, &mut out, Window::at_origin(1, 1)).unwrap_err();
        assert!(matches!(error, FilterError::Size { .. }));
    }
    let error = gaussian_blur(source(&from, 1, 1), [1.0; 2], Outside::Clamp, &mut out, Window::at_origin(2, 1)).unwrap_err();
    assert_eq!(error.to_string(), "expected 2 samples for the window, found 1");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(80))]

    #[test]
    fn flat_pictures_stay_flat(w in 0_usize..9, h in 0_usize..9, c in 1_usize..6, sx in 0.0_f64..30.0, sy in 0.0_f64..30.0, tw in 0_usize..12, th in 0_usize..12, f in 0_usize..4) {
        let data = vec![0.75_f32; w * h * c];
        let from = Source::new(Raster::new(&data, w, h, c).unwrap(), [1, -2]);
        let window = Window::new(-3, -4, tw, th);
        let expected = if w * h == 0 { 0.0 } else { 0.75 };
        let found = blurred(from, [sx, sy], Outside::Clamp, window);
        prop_assert!(found.iter().all(|v| (v - expected).abs() < 2e-6), "{found:?}");
        let mut out = vec![f32::NAN; tw * th * c];
        let filter = [ResizeFilter::Area, ResizeFilter::CatmullRom, ResizeFilter::Kernel(Filter::Lanczos3), ResizeFilter::Kernel(Filter::Nearest)][f];
        resize(from, filter, &mut out, tw, th).unwrap();
        prop_assert!(out.iter().all(|v| (v - expected).abs() < 2e-6), "{out:?}");
        let cut = blurred(from, [sx, sy], Outside::Transparent, window);
        prop_assert!(cut.iter().all(|v| (-1e-6..=0.750_01).contains(v)));
    }
}
