//! Tests of the slanted footprint.

use super::super::warp_affine::{WarpOptions, lanczos_at, warp_affine};
use super::*;

const FILTERS: [Filter; 4] = [Filter::Bilinear, Filter::Cubic, Filter::Mitchell, Filter::Lanczos3];

/// Five channels, transparent but for a slanted band.
fn picture(width: usize, height: usize) -> Vec<f32> {
    let value = |i: usize| {
        let (c, x, y) = (i % 5, (i / 5) % width, i / 5 / width);
        let inside = (20..34).contains(&(x + y / 2));
        f32::from(u8::from(inside)) * (0.5 + 0.4 * libm::sinf(0.9 * x as f32 + 0.5 * y as f32 + c as f32))
    };
    (0..width * height * 5).map(value).collect()
}

fn warped(data: &[f32], size: [usize; 2], channels: usize, map: &Affine, options: WarpOptions) -> Vec<f32> {
    let window = Window::new(-5, -3, 41, 37);
    let raster = Raster::new(data, size[0], size[1], channels).unwrap();
    let mut out = vec![f32::NAN; 41 * 37 * channels];
    warp_affine(Source::new(raster, [2, -1]), map, options, &mut out, window).unwrap();
    out
}

/// Pictures of five channels go the plain way, tap by tap in `f64`.
#[test]
fn blocks_agree_with_the_plain_way() {
    let size = [48, 40];
    let all = picture(size[0], size[1]);
    // Moderate, anisotropic at 45 degrees, mirrored, and far beyond the picture's edges.
    let maps = [
        Affine::new(0.79, 0.62, -16.0, -0.31, 1.24, -4.0),
        Affine::new(0.6, 0.4, -4.0, 0.4, 0.6, -3.0),
        Affine::new(-0.5, 0.2, 30.0, 0.3, 0.8, 0.0),
        Affine::new(0.11, 0.05, 9.0, -0.02, 0.17, 12.0),
    ];
    for (map, filter) in maps.iter().flat_map(|map| FILTERS.map(|filter| (map, filter))) {
        for outside in [Outside::Transparent, Outside::Clamp] {
            let options = WarpOptions { filter, outside, antialias: true };
            let expected = warped(&all, size, 5, map, options);
            assert!(expected.iter().any(|v| *v > 0.01), "{filter:?} {map}: nothing to be seen");
            for channels in 1..=4 {
                let data: Vec<f32> = all.chunks_exact(5).flat_map(|pixel| pixel[..channels].to_vec()).collect();
                let found = warped(&data, size, channels, map, options);
                let pairs = found.chunks_exact(channels).zip(expected.chunks_exact(5)).flat_map(|(a, b)| a.iter().zip(b));
                let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(worst < 4e-6, "{filter:?} {outside:?} {channels} channels {map}: off by {worst}");
            }
        }
    }
}

#[test]
fn a_zero_that_is_negative_is_empty_and_a_nan_is_not() {
    let size = [30, 30];
    let map = Affine::new(0.6, 0.2, 3.0, 0.1, 0.8, 2.0);
    let mut data = vec![-0.0_f32; 900];
    let zero = warped(&data, size, 1, &map, WarpOptions::default());
    assert!(zero.iter().all(|v| v.to_bits() == 0));
    data[15 * 30 + 15] = f32::NAN;
    let holed = warped(&data, size, 1, &map, WarpOptions::default());
    let found = holed.iter().filter(|v| v.is_nan()).count();
    assert!((1..40).contains(&found), "{found} pixels saw the NaN");
    assert!(holed.iter().all(|v| v.is_nan() || *v == 0.0));
}

#[test]
fn kernels_agree_with_their_definitions() {
    for (filter, kernel) in FILTERS.iter().zip([tent as fn(f32) -> f32, catmull_rom, mitchell, lanczos3]) {
        for i in 0..=4000 {
            let x = i as f32 / 1000.0;
            let expected = if *filter == Filter::Lanczos3 { lanczos_at(f64::from(x), 3.0) } else { filter.at(f64::from(x)) };
            assert!((f64::from(kernel(x)) - expected).abs() < 4e-7, "{filter:?} at {x}: {} for {expected}", kernel(x));
        }
    }
}

#[test]
fn what_the_blocks_leave_to_the_plain_way() {
    let data = [0.0; 5];
    let shape = Matrix2::new(0.5, 0.1, 0.1, 0.7);
    let slant = |channels: usize, shape: &Matrix2<f64>| {
        let raster = Raster::new(&data[..channels], 1, 1, channels).unwrap();
        Slant::new(raster, Filter::Cubic, Outside::Clamp, shape).is_some()
    };
    assert!(slant(4, &shape) && !slant(5, &shape));
    assert!(!slant(4, &(shape * 0.01)) && !slant(4, &Matrix2::zeros()) && !slant(4, &(shape * f64::NAN)));
}
