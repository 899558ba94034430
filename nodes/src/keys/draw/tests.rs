use pegbar_engine::node::Cancel;

use super::*;
use crate::counted::clock;
use crate::data::Drawing;

/// A square of side 4, `x` from the left, in front of a bar.
fn key(x: f64) -> Drawing {
    let bar = [[0.0, 2.0], [20.0, 2.0], [20.0, 8.0], [0.0, 8.0]];
    let square = [[x, 3.0], [x + 4.0, 3.0], [x + 4.0, 7.0], [x, 7.0]];
    Drawing {
        points: [bar, square].concat(),
        contours: vec![4, 4],
        closed: vec![1, 1],
        paths: vec![1, 1],
        fill: vec![[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]],
        stroke: vec![[0.0; 4]; 2],
        width: vec![0.0; 2],
        rule: vec![0; 2],
        depth: vec![0.0; 2],
        size: [20.0, 10.0],
        ..Drawing::default()
    }
}

fn run(keys: &[f64], order: &[i64], count: u32) -> Result<KeysDrawOutputs, NodeError> {
    let names = (0..keys.len()).map(|i| format!("k{i}")).collect();
    let keys = KeyDrawings::new(keys.iter().map(|x| key(*x)).collect(), names).unwrap();
    let clock = clock(1);
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
    KeysDraw { keys: In::new(keys), count, order: order.to_vec(), size: None }.run(&cx)
}

#[test]
fn keys_come_first_and_in_betweens_lie_between_them_in_front_of_what_is_behind() {
    let out = run(&[2.0, 8.0, 14.0], &[1, 3, 1], 1).unwrap();
    assert_eq!(out.images.names, ["k0", "k1", "k2", "k0 to k2 at 0.500"]);
    assert_eq!(out.images.pixels.shape(), [4, 10, 20, 4]);
    let x = |k: usize| out.keys.by_point()[k * 8 + 4][0];
    assert_eq!([x(0), x(1), x(2), x(3)], [2.0, 8.0, 14.0, 8.0]);
    let pictures: Vec<&[f32]> = out.images.pixels.data().chunks_exact(800).collect();
    assert_eq!(pictures[3], pictures[1], "half way from the first to the third is as the second");
    let pixel = |k: usize, x: usize| &pictures[k][(5 * 20 + x) * 4..][..4];
    assert_eq!((pixel(3, 9), pixel(3, 3)), (&[0.0, 1.0, 0.0, 1.0][..], &[1.0, 0.0, 0.0, 1.0][..]));
}

#[test]
fn all_pairs_are_in_betweened_unless_an_order_is_given() {
    let names = |order: &[i64], count| run(&[2.0, 8.0, 14.0], order, count).unwrap().images.names.len();
    assert_eq!((names(&[], 5), names(&[], 0), names(&[1, 3, 2], 5)), (18, 3, 13));
}

#[test]
fn keys_that_are_not_there_are_told() {
    for order in [[0, 1], [1, 4]] {
        let error = run(&[2.0, 8.0, 14.0], &order, 1).err().unwrap().to_string();
        assert!(error.contains("expected an `order` of keys from 1 to 3, found"), "{error}");
    }
    assert!(run(&[f64::NAN], &[], 1).is_err());
}
