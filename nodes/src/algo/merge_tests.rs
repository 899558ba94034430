//! Tests of the merges.

use super::super::raster::Raster;
use super::*;
use proptest::prelude::*;

fn source(data: &[f32], width: usize, channels: usize, origin: [i64; 2]) -> Source<'_> {
    Source::new(Raster::new(data, width, data.len() / width / channels, channels).unwrap(), origin)
}

fn one(operation: Operation, fg: [f32; 4], bg: [f32; 4]) -> [f32; 4] {
    let mut out = [0.0; 4];
    let window = Window::at_origin(1, 1);
    merge(source(&fg, 1, 4, [0, 0]), source(&bg, 1, 4, [0, 0]), MergeOptions::new(operation), &mut out, window).unwrap();
    out
}

/// A = (0.25, 0.5, 0, a = 0.5) with B = (0.5, 0.25, 0.75, b = 0.75); every figure is worked out by hand and exact in binary but for the last three.
#[test]
fn formulas() {
    use Operation::*;
    let (fg, bg) = ([0.25, 0.5, 0.0, 0.5], [0.5, 0.25, 0.75, 0.75]);
    let table = [
        (Over, [0.5, 0.625, 0.375, 0.875]),
        (Under, [0.5625, 0.375, 0.75, 0.875]),
        (Plus, [0.75, 0.75, 0.75, 1.25]),
        (Minus, [-0.25, 0.25, -0.75, -0.25]),
        (From, [0.25, -0.25, 0.75, 0.25]),
        (Difference, [0.25, 0.25, 0.75, 0.25]),
        (Multiply, [0.125, 0.125, 0.0, 0.375]),
        (Screen, [0.625, 0.625, 0.75, 0.875]),
        (In, [0.1875, 0.375, 0.0, 0.375]),
        (Out, [0.0625, 0.125, 0.0, 0.125]),
        (Atop, [0.4375, 0.5, 0.375, 0.75]),
        (Xor, [0.3125, 0.25, 0.375, 0.5]),
        (Max, [0.5, 0.5, 0.75, 0.75]),
        (Min, [0.25, 0.25, 0.0, 0.5]),
        (Mask, [0.25, 0.125, 0.375, 0.375]),
        (Stencil, [0.25, 0.125, 0.375, 0.375]),
        (Average, [0.375, 0.375, 0.375, 0.625]),
        (Exclusion, [0.5, 0.5, 0.75, 0.5]),
        (Copy, fg),
        (Matte, [0.375, 0.375, 0.375, 0.625]),
        (Hypot, [0.559_017, 0.559_017, 0.75, 0.901_387_8]),
        (Divide, [0.5, 2.0, 0.0, 0.666_666_7]),
        (DisjointOver, [0.583_333_4, 0.666_666_7, 0.5, 1.0]),
        (ConjointOver, [0.416_666_66, 0.583_333_3, 0.25, 0.75]),
    ];
    assert_eq!(table.len(), Operation::ALL.len());
    for (operation, expected) in table {
        let found = one(operation, fg, bg);
        for c in 0..4 {
            assert!((found[c] - expected[c]).abs() < 2e-7, "{operation:?}: expected {expected:?}, found {found:?}");
        }
    }
}

#[test]
fn special_values() {
    use Operation::*;
    assert_eq!(one(Multiply, [-1.0; 4], [-2.0; 4]), [0.0; 4]);
    assert_eq!(one(Screen, [2.0; 4], [0.5; 4]), [2.0; 4]);
    assert_eq!(one(Divide, [1.0; 4], [0.0; 4]), [0.0; 4]);
    assert_eq!(one(DisjointOver, [0.25; 4], [0.5; 4]), [0.75; 4]);
    assert_eq!(one(ConjointOver, [0.5; 4], [0.25; 4]), [0.5; 4]);
    assert_eq!(one(ConjointOver, [0.0; 4], [0.0; 4]), [0.0; 4]);
    assert!(one(Over, [f32::NAN; 4], [0.0; 4])[0].is_nan());
}

#[test]
fn differing_windows() {
    let (fg, bg) = ([0.5; 2 * 2 * 4], [0.25; 3 * 2 * 4]);
    let (fg, bg) = (source(&fg, 2, 4, [2, 1]), source(&bg, 3, 4, [0, 0]));
    let window = Operation::Over.bounds(fg.window(), bg.window(), 1.0);
    assert_eq!(window, Window::new(0, 0, 4, 3));
    let mut out = vec![9.0; 48];
    merge(fg, bg, MergeOptions::new(Operation::Over), &mut out, window).unwrap();
    let firsts: Vec<f32> = out.iter().step_by(4).copied().collect();
    assert_eq!(firsts, [0.25, 0.25, 0.25, 0.0, 0.25, 0.25, 0.625, 0.5, 0.0, 0.0, 0.5, 0.5]);
    merge(fg, bg, MergeOptions::new(Operation::Mask), &mut out, window).unwrap();
    assert_eq!(out.iter().filter(|v| **v != 0.0).count(), 4);
}

#[test]
fn refusals() {
    let data = [0.0; 4];
    let rgba = source(&data, 1, 4, [0, 0]);
    let grey = source(&data, 4, 1, [0, 0]);
    let window = Window::at_origin(1, 1);
    let run = |fg, options, out: &mut [f32]| merge(fg, rgba, options, out, window).unwrap_err().to_string();
    let over = MergeOptions::new(Operation::Over);
    assert_eq!(run(grey, over, &mut [0.0; 4]), "expected a foreground of 4 channels as the background has, found 1");
    assert_eq!(run(rgba, over, &mut [0.0; 3]), "expected 4 samples for the window, found 3");
    assert_eq!(run(rgba, MergeOptions { alpha: Some(4), ..over }, &mut [0.0; 4]), "expected an alpha channel below 4, found 4");
    assert_eq!(run(rgba, MergeOptions { opacity: f32::NAN, ..over }, &mut [0.0; 4]), "expected an opacity from 0 to 1, found NaN");
}

/// A pixel with colours up to its alpha.
fn premultiplied() -> impl Strategy<Value = [f32; 4]> {
    (proptest::array::uniform3(0.0_f32..=1.0), 0.0_f32..=1.0).prop_map(|(c, a)| [c[0] * a, c[1] * a, c[2] * a, a])
}

proptest! {
    #[test]
    fn laws(a in premultiplied(), b in premultiplied(), opacity in 0.0_f32..=1.0) {
        use Operation::*;
        let close = |x: [f32; 4], y: [f32; 4]| x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1e-6);
        let sum = |x: [f32; 4], y: [f32; 4]| one(Plus, x, y);
        prop_assert_eq!(one(Over, a, b), one(Under, b, a));
        prop_assert_eq!(one(In, a, b), one(Mask, b, a));
        prop_assert!(close(one(Over, a, b), sum(a, one(Stencil, a, b))));
        prop_assert!(close(one(Atop, a, b), sum(one(In, a, b), one(Stencil, a, b))));
        prop_assert!(close(one(Xor, a, b), sum(one(Out, a, b), one(Stencil, a, b))));
        prop_assert_eq!(one(Over, [0.0; 4], b), b);
        prop_assert!(close(one(Over, a, [0.0; 4]), a));
        // Opacity is the foreground scaled.
        let mut mixed = b;
        let options = MergeOptions { opacity, ..MergeOptions::new(Over) };
        merge_in_place(source(&a, 1, 4, [0, 0]), &mut mixed, 4, Window::at_origin(1, 1), options).unwrap();
        prop_assert!(close(mixed, one(Over, a.map(|v| v * opacity), b)));
    }

    #[test]
    fn any_windows(
        fw in 0_usize..5, fh in 0_usize..4, bw in 0_usize..5, bh in 0_usize..4, x in -6_i64..6, y in -5_i64..5, channels in 1_usize..6, op in 0_usize..24,
        opacity in prop_oneof![Just(1.0_f32), Just(0.5)],
    ) {
        let fg: Vec<f32> = (0..fw * fh * channels).map(|i| (i % 7) as f32 * 0.125).collect();
        let bg: Vec<f32> = (0..bw * bh * channels).map(|i| (i % 5) as f32 * 0.25).collect();
        let fg = Source::new(Raster::new(&fg, fw, fh, channels).unwrap(), [x, y]);
        let bg = Source::new(Raster::new(&bg, bw, bh, channels).unwrap(), [0, 0]);
        let operation = Operation::ALL[op];
        let options = MergeOptions { operation, opacity, alpha: Some(channels - 1) };
        let window = Window::new(-8, -8, 20, 20);
        let mut out = vec![5.0; 400 * channels];
        merge(fg, bg, options, &mut out, window).unwrap();
        let bounds = operation.bounds(fg.window(), bg.window(), opacity);
        for (i, pixel) in out.chunks_exact(channels).enumerate() {
            let at = [window.x + (i % 20) as i64, window.y + (i / 20) as i64];
            let look = |s: Source<'_>| {
                let inside = !s.window().intersect(&Window::new(at[0], at[1], 1, 1)).is_empty();
                let sample = |c| s.raster.row((at[1] - s.origin[1]) as usize)[(at[0] - s.origin[0]) as usize * channels + c];
                (0..channels).map(|c| if inside { sample(c) } else { 0.0 }).collect::<Vec<f32>>()
            };
            let (f, b) = (look(fg), look(bg));
            let inside = !bounds.intersect(&Window::new(at[0], at[1], 1, 1)).is_empty();
            for c in 0..channels {
                let full = operation.apply(f[c], b[c], f[channels - 1], b[channels - 1]);
                let expected = b[c] + opacity * (full - b[c]);
                prop_assert!((pixel[c] - expected).abs() < 1e-6, "{:?} at {:?}: {} for {}", operation, at, pixel[c], expected);
                prop_assert!(inside || pixel[c] == 0.0, "{:?} outside {:?}", operation, bounds);
            }
        }
    }
}
