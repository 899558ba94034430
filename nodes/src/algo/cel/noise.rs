//! Integer hashes and the smooth noise made of them: the same bits on every machine.

/// A well mixed hash of a 64-bit word (Steele, Lea and Flood, *Fast splittable pseudorandom number generators*, 2014, figure 17).
pub(super) fn mix(word: u64) -> u64 {
    let z = word.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A hash of a lattice point.
pub(super) fn hash2(x: i64, y: i64, seed: u64) -> u64 {
    mix(mix(seed ^ (x as u64).wrapping_mul(0x8cb9_2ba7_2f3d_8dd7)) ^ (y as u64).wrapping_mul(0xd6e8_feb8_6659_fd93))
}

/// A number in [0, 1) from the upper bits of a hash.
pub(super) fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// Smooth value noise in −1 to 1 with one lattice point a unit.
pub(super) fn noise(x: f64, y: f64, seed: u64) -> f64 {
    let (fx, fy) = (x.floor(), y.floor());
    let (i, j) = (fx as i64, fy as i64);
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(x - fx), fade(y - fy));
    let at = |di: i64, dj: i64| unit(hash2(i.wrapping_add(di), j.wrapping_add(dj), seed)) * 2.0 - 1.0;
    let top = at(0, 0) + (at(1, 0) - at(0, 0)) * u;
    let bottom = at(0, 1) + (at(1, 1) - at(0, 1)) * u;
    top + (bottom - top) * v
}

/// Noise summed over `octaves`, each twice as fine and half as strong; about −1 to 1.
pub(super) fn fbm(x: f64, y: f64, octaves: u32, seed: u64) -> f64 {
    let (mut sum, mut gain, mut scale) = (0.0, 0.5, 1.0);
    for k in 0..octaves {
        // The offset keeps the lattices of the octaves from lining up at the origin.
        sum += gain * noise(x * scale + 17.3 * f64::from(k), y * scale - 9.1 * f64::from(k), seed.wrapping_add(u64::from(k)));
        gain *= 0.5;
        scale *= 2.0;
    }
    sum
}

/// A bell-shaped number of mean 0 and variance 1 from one hash: the sum of four 16-bit uniforms.
pub(super) fn bell(hash: u64) -> f64 {
    let sum = (hash & 0xffff) + ((hash >> 16) & 0xffff) + ((hash >> 32) & 0xffff) + (hash >> 48);
    // Four discrete uniforms on 0..65535 have mean 4 × 32767.5 and variance 4 × (65536² − 1) / 12.
    (sum as f64 - 131_070.0) / 37_837.227_255_857_36
}

/// 0 below `a`, 1 above `b`, smooth between.
pub(super) fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
