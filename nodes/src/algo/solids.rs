//! For tests: solids of known shape.

use std::f64::consts::{PI, TAU};

/// Positions and triangles.
pub(super) type Solid = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// The cube from −1 to 1.
pub(super) fn cube() -> Solid {
    let positions = (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { 1.0 } else { -1.0 })).collect();
    let quads = [[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]];
    (positions, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// The unit sphere about the y axis, of `around` by `up` quads; its vertices lie on it.
pub(super) fn sphere(around: u32, up: u32) -> Solid {
    let ring = |j: u32, i: u32| {
        let (theta, phi) = (PI * f64::from(j) / f64::from(up), TAU * f64::from(i) / f64::from(around));
        [theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos()]
    };
    let mut positions = vec![[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]];
    (1..up).for_each(|j| positions.extend((0..around).map(|i| ring(j, i))));
    let at = |j: u32, i: u32| match j {
        0 => 0,
        j if j == up => 1,
        j => 2 + (j - 1) * around + i % around,
    };
    let mut triangles = Vec::new();
    for (j, i) in (0..up).flat_map(|j| (0..around).map(move |i| (j, i))) {
        let [a, b, c, d] = [at(j, i), at(j + 1, i), at(j + 1, i + 1), at(j, i + 1)];
        triangles.extend([[a, b, c], [a, c, d]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
    }
    (positions, triangles)
}

/// The cylinder about the y axis of radius 1 from −1 to 1, of `around` sides, with caps.
pub(super) fn cylinder(around: u32) -> Solid {
    let mut positions = vec![[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    for y in [-1.0, 1.0] {
        positions.extend((0..around).map(|i| {
            let (s, c) = (TAU * f64::from(i) / f64::from(around)).sin_cos();
            [s, y, c]
        }));
    }
    let at = |top: u32, i: u32| 2 + top * around + i % around;
    let side = |i: u32| {
        [
            [at(0, i), at(0, i + 1), at(1, i + 1)],
            [at(0, i), at(1, i + 1), at(1, i)],
            [0, at(0, i + 1), at(0, i)],
            [1, at(1, i), at(1, i + 1)],
        ]
    };
    (positions, (0..around).flat_map(side).collect())
}
