//! Tests of the generated pictures.

use super::*;

#[test]
fn constants() {
    let mut out = [0.0; 6];
    constant(&[1.0, 2.0, 3.0], &mut out);
    assert_eq!(out, [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]);
    constant(&[], &mut out);
}

#[test]
fn checks_have_a_corner_at_the_origin() {
    let mut out = [0.0; 16];
    checkerboard(&[1.0], &[2.0], [2.0, 1.0], &mut out, Window::new(-2, -1, 4, 4));
    assert_eq!(out, [1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 1.0, 1.0]);
}

#[test]
fn gradients() {
    let mut out = [9.0; 4];
    let row = Window::at_origin(4, 1);
    linear_gradient(&[0.0], &[1.0], [1.0, 0.0], [3.0, 0.0], Ramp::Linear, &mut out, row);
    assert_eq!(out, [0.0, 0.25, 0.75, 1.0]);
    linear_gradient(&[0.0], &[1.0], [1.0, 0.0], [3.0, 0.0], Ramp::Smooth, &mut out, row);
    assert_eq!(out, [0.0, 0.15625, 0.84375, 1.0]);
    linear_gradient(&[0.0], &[1.0], [1.0, 1.0], [1.0, 1.0], Ramp::Linear, &mut out, row);
    assert_eq!(out, [1.0; 4]);
    radial_gradient(&[1.0], &[0.0], [0.5, 0.5], [2.0, 1.0], Ramp::Linear, &mut out, row);
    assert_eq!(out, [1.0, 0.5, 0.0, 0.0]);
    radial_gradient(&[1.0], &[0.0], [0.5, 0.5], [0.0, 0.0], Ramp::Linear, &mut out, row);
    assert_eq!(out[3], 0.0);
    linear_gradient(&[0.0], &[1.0], [0.0; 2], [1.0; 2], Ramp::Linear, &mut out, Window::at_origin(9, 9));
}
