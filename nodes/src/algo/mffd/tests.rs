use super::*;

/// Numbers from 0 to 1 that look random and are always the same (Vigna, SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.next()
    }
}

const DOMAIN: [f64; 4] = [0.0, 0.0, 128.0, 128.0];

/// Points of a picture of 128 pixels with moves of up to so many: most sets ask for folds.
fn wild(random: &mut Random, n: usize, far: f64) -> Vec<Datum> {
    let place = |random: &mut Random| [random.between(8.0, 120.0), random.between(8.0, 120.0)];
    let one = |_| {
        let from = place(random);
        let to = from.map(|v| (v + random.between(-far, far)).clamp(2.0, 126.0));
        Datum { from, to, weight: random.between(0.2, 1.0) }
    };
    (0..n).map(one).collect()
}

/// Points under a smooth map that folds nowhere: shears by waves one after another.
fn tame(random: &mut Random, n: usize) -> Vec<Datum> {
    let waves: Vec<(f64, f64, f64)> =
        (0..4).map(|_| (random.between(-6.0, 6.0), random.between(20.0, 40.0), random.between(0.0, 6.0))).collect();
    let map = |p: [f64; 2]| {
        waves.iter().enumerate().fold(p, |mut p, (k, (height, width, phase))| {
            p[k % 2] += height * libm::sin(p[1 - k % 2] / width + phase);
            p
        })
    };
    let one = |_| {
        let from = [random.between(12.0, 116.0), random.between(12.0, 116.0)];
        Datum { from, to: map(from), weight: 1.0 }
    };
    (0..n).map(one).collect()
}

#[test]
fn explore() {
    let mut random = Random(1);
    for n in [1, 2, 5, 10, 30, 100] {
        let (mut worst, mut most, mut least) = (0.0f64, 0, f64::INFINITY);
        let t = std::time::Instant::now();
        for _ in 0..50 {
            let (ffd, fit) = Ffd::fit(&tame(&mut random, n), DOMAIN, &Options::default()).unwrap();
            worst = worst.max(fit.worst());
            most = most.max(fit.steps);
            least = least.min(ffd.least_growth(DOMAIN, 33));
        }
        println!("tame {n}: {worst:e} {most} {least} {:?}", t.elapsed() / 50);
    }
    for n in [2, 5, 10, 30, 100] {
        for far in [10.0, 40.0] {
            let (mut worst, mut most, mut least, mut mean, mut folds) = (0.0f64, 0, f64::INFINITY, 0.0, 0);
            let t = std::time::Instant::now();
            for _ in 0..50 {
                let data = wild(&mut random, n, far);
                let (ffd, fit) = Ffd::fit(&data, DOMAIN, &Options::default()).unwrap();
                worst = worst.max(fit.worst());
                mean += fit.worst() / 50.0;
                most = most.max(fit.steps);
                least = least.min(ffd.least_growth(DOMAIN, 65));
                let (ffd, _) = Ffd::fit(&data, DOMAIN, &Options { combine: Combine::Added, levels: 5, ..Options::default() }).unwrap();
                folds += usize::from(ffd.least_growth(DOMAIN, 65) <= 0.0);
            }
            println!("wild {n} {far}: {worst:e} mean {mean} {most} {least:e} added folds {folds}/50 {:?}", t.elapsed() / 50);
        }
    }
}

