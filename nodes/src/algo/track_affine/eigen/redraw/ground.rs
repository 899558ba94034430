//! What lies behind a character: what the frame shows around it, carried on.
//!
//! **Source**: pull-push, Gortler et al., "The Lumigraph", SIGGRAPH 1996, section 3.4.1.

/// Where nothing within so many samples is set.
pub(super) fn away_from(set: &[bool], w: usize, h: usize, reach: usize) -> Vec<bool> {
    let mut rows = vec![false; w * h];
    for y in 0..h {
        for x in 0..w {
            rows[y * w + x] = (x.saturating_sub(reach)..(x + reach + 1).min(w)).any(|u| set[y * w + u]);
        }
    }
    let near = |x: usize, y: usize| (y.saturating_sub(reach)..(y + reach + 1).min(h)).any(|v| rows[v * w + x]);
    (0..w * h).map(|i| !near(i % w, i / w)).collect()
}

/// Carries what is known over to what is not: means of the known ones in ever larger cells.
pub(super) fn fill(planes: &mut [Vec<f32>], known: &[bool], w: usize, h: usize) {
    if known.iter().all(|k| *k) || w * h <= 1 {
        return;
    }
    let (cw, ch) = (w.div_ceil(2), h.div_ceil(2));
    let mut count = vec![0.0f32; cw * ch];
    let mut coarse = vec![vec![0.0f32; cw * ch]; planes.len()];
    for (i, _) in known.iter().enumerate().filter(|(_, k)| **k) {
        let cell = (i / w / 2) * cw + i % w / 2;
        count[cell] += 1.0;
        coarse.iter_mut().zip(planes.iter()).for_each(|(c, p)| c[cell] += p[i]);
    }
    coarse.iter_mut().for_each(|c| c.iter_mut().zip(&count).for_each(|(v, n)| *v /= n.max(1.0)));
    let some: Vec<bool> = count.iter().map(|n| *n > 0.0).collect();
    fill(&mut coarse, &some, cw, ch);
    for (i, _) in known.iter().enumerate().filter(|(_, k)| !**k) {
        // Between the four nearest cells: three quarters of the own one each way.
        let (x, y) = (i % w, i / w);
        let near = |v: usize, n: usize| if v.is_multiple_of(2) { (v / 2).saturating_sub(1) } else { (v / 2 + 1).min(n - 1) };
        let (nx, ny) = (near(x, cw), near(y, ch));
        for (p, c) in planes.iter_mut().zip(&coarse) {
            let at = |x: usize, y: usize| c[y * cw + x];
            p[i] = 0.5625 * at(x / 2, y / 2) + 0.1875 * (at(nx, y / 2) + at(x / 2, ny)) + 0.0625 * at(nx, ny);
        }
    }
}
