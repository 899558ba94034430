//! Merges of premultiplied pictures.

/// `foreground` over `background`, both premultiplied with alpha last, into `background`: B ← A + (1 − a) B (Porter and Duff 1984).
pub fn over_in_place(foreground: &[f32], background: &mut [f32], channels: usize) {
    if channels == 4 {
        return over4(foreground, background);
    }
    for (f, b) in foreground.chunks_exact(channels.max(1)).zip(background.chunks_exact_mut(channels.max(1))) {
        let keep = 1.0 - f[f.len() - 1];
        for (b, f) in b.iter_mut().zip(f) {
            *b = f + keep * *b;
        }
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn over4(foreground: &[f32], background: &mut [f32]) {
    for (f, b) in foreground.chunks_exact(4).zip(background.chunks_exact_mut(4)) {
        let keep = 1.0 - f[3];
        for c in 0..4 {
            b[c] = f[c] + keep * b[c];
        }
    }
}
