use super::*;

const SQUARE: [Point; 4] = [[1.0, 1.0], [9.0, 1.0], [9.0, 7.0], [1.0, 7.0]];
const HALVES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

/// A picture of 10 by 8 whose samples are x + 10 y at their centres.
fn ramp() -> Vec<f32> {
    (0..80).map(|i| ((i % 10) as f32 + 0.5) + 10.0 * ((i / 10) as f32 + 0.5)).collect()
}

fn drawn(to: &[Point], window: Window, filter: Filter) -> Vec<f32> {
    let data = ramp();
    let source = Source::new(Raster { data: &data, width: 10, height: 8, channels: 1 }, [0, 0]);
    let mut target = vec![-1.0; window.width * window.height];
    MeshWarp { source, triangles: &HALVES, from: &SQUARE, to, filter }.draw(&mut target, window);
    target
}

#[test]
fn a_mesh_that_does_not_move_copies_what_it_covers() {
    for filter in [Filter::Nearest, Filter::Bilinear, Filter::Cubic] {
        let (found, ramp) = (drawn(&SQUARE, Window::at_origin(10, 8), filter), ramp());
        for (i, (a, b)) in found.iter().zip(&ramp).enumerate() {
            let inside = (1..9).contains(&(i % 10)) && (1..7).contains(&(i / 10));
            assert_eq!(*a, if inside { *b } else { -1.0 }, "{filter:?} {i}");
        }
    }
}

/// Bilinear reading keeps a ramp, so that the value says which place was read: each half has its own map.
#[test]
fn each_triangle_has_its_own_map() {
    let to = [[2.0, 3.0], [42.0, 3.0], [32.0, 33.0], [2.0, 33.0]];
    let found = drawn(&to, Window::at_origin(50, 40), Filter::Bilinear);
    let mut seen = 0;
    for (i, value) in found.iter().enumerate().filter(|(_, v)| **v >= 0.0) {
        let [x, y] = [(i % 50) as f64 + 0.5, (i / 50) as f64 + 0.5];
        // Above the diagonal the top edge is 40 long for 8, below it the lower one 30.
        let (v, middle) = (1.0 + (y - 3.0) / 5.0, 1.0 + (y - 3.0) * 8.0 / 30.0);
        let left = 2.0 + (y - 3.0);
        let u = if x >= left { middle + (x - left) / 5.0 } else { middle - (left - x) * 8.0 / 30.0 };
        let truth = u + 10.0 * v;
        assert!((f64::from(*value) - truth).abs() < 1e-3, "{x} {y}: {value} {truth}");
        seen += 1;
    }
    assert_eq!(seen, found.iter().filter(|v| **v >= 0.0).count());
    assert!(seen > 1000, "{seen}");
}

#[test]
fn tiles_give_the_same_bits() {
    let to = [[2.3, 3.1], [22.7, 4.2], [18.9, 17.4], [1.2, 15.0]];
    let whole = drawn(&to, Window::at_origin(24, 20), Filter::Cubic);
    for y in 0..20 {
        let row = drawn(&to, Window::new(0, y, 24, 1), Filter::Cubic);
        assert_eq!(row, &whole[y as usize * 24..(y as usize + 1) * 24]);
    }
}

#[test]
fn a_shrunk_picture_is_averaged() {
    let data: Vec<f32> = (0..64 * 64).map(|i| f32::from(u8::from((i % 64 + i / 64) % 2 == 0))).collect();
    let source = Source::new(Raster { data: &data, width: 64, height: 64, channels: 1 }, [0, 0]);
    let (from, to) = ([[0.0, 0.0], [64.0, 0.0], [64.0, 64.0], [0.0, 64.0]], [[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]]);
    let mut target = vec![0.0; 64];
    MeshWarp { source, triangles: &HALVES, from: &from, to: &to, filter: Filter::Bilinear }.draw(&mut target, Window::at_origin(8, 8));
    assert!((1..7).all(|y| (1..7).all(|x| (target[y * 8 + x] - 0.5_f32).abs() < 1e-6)), "{target:?}");
}

#[test]
fn flat_triangles_and_points_that_are_no_numbers_draw_nothing() {
    let window = Window::at_origin(10, 8);
    for to in [[[3.0, 3.0]; 4], [[f64::NAN; 2]; 4], [[0.0, 0.0], [5.0, 5.0], [9.0, 9.0], [f64::INFINITY, 0.0]]] {
        assert!(drawn(&to, window, Filter::Bilinear).iter().all(|v| *v == -1.0), "{to:?}");
    }
}

#[test]
fn a_band_lies_outside_either_way_round() {
    let out = [[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]];
    assert_eq!(band(&SQUARE, 1.0), out);
    let turned: Vec<Point> = SQUARE.iter().rev().copied().collect();
    assert_eq!(band(&turned, 1.0), out.iter().rev().copied().collect::<Vec<_>>());
}
