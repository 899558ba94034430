//! How much ink there is at each pixel of a drawing, and how far the nearest is.

/// What is ink, and what is paper: linear light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InkStyle {
    /// Colour of the ink; black where it is not said.
    pub ink: Option<[f64; 3]>,
    /// Colour of the paper, also below what is transparent; the most frequent one where it is not said.
    pub paper: Option<[f64; 3]>,
    /// Ink from this on counts as ink.
    pub threshold: f64,
}

/// The ink of a drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Ink {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 0 paper, 1 ink, row by row.
    pub amount: Vec<f32>,
    /// The nearest pixel of ink, [`u32::MAX`] where there is none at all.
    nearest: Vec<u32>,
    /// Of each pixel, squared distance to the nearest paper.
    depth_sq: Vec<f32>,
}

impl Ink {
    /// The ink of a picture of four channels, linear light, premultiplied. Cost: O(pixels).
    pub fn new(rgba: &[f32], width: usize, style: &InkStyle) -> Self {
        let pixels = rgba.as_chunks::<4>().0;
        let paper = style.paper.unwrap_or_else(|| common(pixels));
        let laid = |p: &[f32; 4]| [0, 1, 2].map(|k| f64::from(p[k]) + paper[k] * (1.0 - f64::from(p[3])));
        let ink = style.ink.unwrap_or([0.0; 3]);
        let apart = |a: [f64; 3], b: [f64; 3]| ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt();
        let whole = apart(paper, ink).max(1e-9);
        let amount = |p: &[f32; 4]| {
            let c = laid(p);
            let value = match style.ink {
                // Of that colour, and of no other.
                Some(ink) => 1.0 - apart(c, ink) / whole,
                // Darker than the paper, whatever the colour.
                None => {
                    let light = |c: [f64; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
                    1.0 - light(c) / light(paper).max(1e-9)
                }
            };
            if value.is_finite() { value.clamp(0.0, 1.0) as f32 } else { 0.0 }
        };
        Self::from_amount(pixels.iter().map(amount).collect(), width, style.threshold)
    }

    /// From as much ink as there is at each pixel.
    pub fn from_amount(amount: Vec<f32>, width: usize, threshold: f64) -> Self {
        let height = amount.len().checked_div(width).unwrap_or(0);
        let is_ink = |v: &f32| f64::from(*v) >= threshold;
        let nearest = nearest(amount.iter().map(is_ink), width, height);
        let paper = self::nearest(amount.iter().map(|v| !is_ink(v)), width, height);
        let place = |i: usize| [(i % width) as f64, (i / width) as f64];
        let far = |(i, n): (usize, &u32)| match *n {
            u32::MAX => f32::MAX,
            n => {
                let (a, b) = (place(i), place(n as usize));
                ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)) as f32
            }
        };
        let depth_sq = paper.iter().enumerate().map(far).collect();
        Self { width, height, amount, nearest, depth_sq }
    }

    /// The pixel that a place lies in, clamped to the picture.
    pub fn pixel(&self, at: [f64; 2]) -> usize {
        let clamp = |v: f64, n: usize| (v.max(0.0) as usize).min(n.saturating_sub(1));
        clamp(at[1], self.height) * self.width + clamp(at[0], self.width)
    }

    /// The middle of a pixel.
    pub fn middle(&self, pixel: usize) -> [f64; 2] {
        [(pixel % self.width) as f64 + 0.5, (pixel / self.width) as f64 + 0.5]
    }

    /// The nearest pixel of ink, and its distance: 0 on ink.
    pub fn nearest(&self, at: [f64; 2]) -> Option<([f64; 2], f64)> {
        let own = self.pixel(at);
        match *self.nearest.get(own)? {
            u32::MAX => None,
            n if n as usize == own => Some((self.middle(own), 0.0)),
            n => {
                let there = self.middle(n as usize);
                Some((there, libm::hypot(there[0] - at[0], there[1] - at[1])))
            }
        }
    }

    /// How far each pixel's nearest paper is, over half the width of a line; 1 at most.
    pub fn depths(&self, width: f64) -> Vec<f32> {
        let half = (width / 2.0).max(1.0) as f32;
        let depth = |(d, v): (&f32, &f32)| if *d > 0.0 { ((d.sqrt() - 0.5) / half).clamp(0.0, 1.0) } else { 0.5 * v / half };
        self.depth_sq.iter().zip(&self.amount).map(depth).collect()
    }

    /// Ink between pixels.
    pub fn at(&self, at: [f64; 2]) -> f64 {
        bilinear(&self.amount, self.width, self.height, at)
    }

    /// The most ink of the nine pixels around.
    pub fn around(&self, at: [f64; 2]) -> f64 {
        let steps = [-1.0, 0.0, 1.0];
        let all = steps.iter().flat_map(|dy| steps.iter().map(move |dx| [at[0] + dx, at[1] + dy]));
        all.map(|p| f64::from(self.amount.get(self.pixel(p)).copied().unwrap_or(0.0))).fold(0.0, f64::max)
    }

    /// Width of the line that a path runs along: twice the middle depth of the ink there, at least 1.
    pub fn line_width(&self, path: &[[f64; 2]]) -> f64 {
        // A path may lie a pixel or two off the middle.
        let deepest = |p: &[f64; 2]| {
            let steps = [-2.0, -1.0, 0.0, 1.0, 2.0];
            let all = steps.iter().flat_map(|dy| steps.iter().map(move |dx| [p[0] + dx, p[1] + dy]));
            all.map(|q| self.depth_sq.get(self.pixel(q)).copied().unwrap_or(0.0)).fold(0.0, f32::max)
        };
        let mut depths: Vec<f32> = path.iter().map(deepest).filter(|d| *d > 0.0).collect();
        depths.sort_by(f32::total_cmp);
        let middle = depths.get(depths.len() / 2).map_or(0.0, |d| f64::from(*d).sqrt());
        (2.0 * middle - 1.0).clamp(1.0, 64.0)
    }
}

/// Samples between pixels' centres; those at the border go on outside.
pub(super) fn bilinear(data: &[f32], width: usize, height: usize, at: [f64; 2]) -> f64 {
    if width == 0 || height == 0 {
        return 0.0;
    }
    let side = |v: f64, n: usize| {
        let v = (v - 0.5).clamp(0.0, (n - 1) as f64);
        let low = (v as usize).min(n - 1);
        (low, (low + 1).min(n - 1), v - low as f64)
    };
    let ((x0, x1, tx), (y0, y1, ty)) = (side(at[0], width), side(at[1], height));
    let get = |x: usize, y: usize| f64::from(data[y * width + x]);
    let (top, low) = (get(x0, y0) + (get(x1, y0) - get(x0, y0)) * tx, get(x0, y1) + (get(x1, y1) - get(x0, y1)) * tx);
    top + (low - top) * ty
}

/// The most frequent colour, to the nearest of 32 shades a channel; white for a drawing on nothing.
fn common(pixels: &[[f32; 4]]) -> [f64; 3] {
    let mut counts = vec![0_u32; 1 << 15];
    let (mut opaque, mut sums) = (0, vec![[0.0_f64; 3]; 1 << 15]);
    for p in pixels.iter().filter(|p| p[3] > 0.99) {
        opaque += 1;
        // As the eye sees shades, so that greys are told apart.
        let bin = [0, 1, 2].iter().fold(0, |b, &k| b << 5 | (p[k].clamp(0.0, 1.0).sqrt() * 31.0 + 0.5) as usize);
        counts[bin] += 1;
        (0..3).for_each(|k| sums[bin][k] += f64::from(p[k]));
    }
    if 2 * opaque < pixels.len() {
        return [1.0; 3];
    }
    let best = (0..counts.len()).max_by_key(|&i| (counts[i], i)).unwrap_or(0);
    match counts[best] {
        0 => [1.0; 3],
        n => sums[best].map(|s| s / f64::from(n)),
    }
}

/// For every pixel the nearest one that is set. Felzenszwalb, Huttenlocher, *Distance transforms of sampled functions*, 2012: exact. Cost: O(pixels).
fn nearest(set: impl Iterator<Item = bool>, width: usize, height: usize) -> Vec<u32> {
    let set: Vec<bool> = set.collect();
    let mut row_of = vec![u32::MAX; width * height];
    for x in 0..width {
        let mut last: Option<usize> = None;
        for y in 0..height {
            if set[y * width + x] {
                last = Some(y);
            }
            row_of[y * width + x] = last.map_or(u32::MAX, |l| l as u32);
        }
        last = None;
        for y in (0..height).rev() {
            if set[y * width + x] {
                last = Some(y);
            }
            let above = row_of[y * width + x];
            if let Some(below) = last
                && (above == u32::MAX || below - y < y - above as usize)
            {
                row_of[y * width + x] = below as u32;
            }
        }
    }
    let mut out = vec![u32::MAX; width * height];
    let mut hull: Vec<(usize, f64, f64)> = Vec::with_capacity(width);
    for y in 0..height {
        let rows = &row_of[y * width..(y + 1) * width];
        hull.clear();
        for (x, &r) in rows.iter().enumerate().filter(|(_, r)| **r != u32::MAX) {
            let d = r as f64 - y as f64;
            let f = d * d;
            // Where this parabola is below the last one.
            loop {
                let Some(&(q, fq, from)) = hull.last() else {
                    hull.push((x, f, f64::NEG_INFINITY));
                    break;
                };
                let s = ((f + (x * x) as f64) - (fq + (q * q) as f64)) / (2 * x - 2 * q) as f64;
                if s <= from {
                    hull.pop();
                } else {
                    hull.push((x, f, s));
                    break;
                }
            }
        }
        let mut k = 0;
        for x in 0..width {
            while k + 1 < hull.len() && hull[k + 1].2 < x as f64 {
                k += 1;
            }
            if let Some(&(q, ..)) = hull.get(k) {
                out[y * width + x] = rows[q] * width as u32 + q as u32;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pixel_is_the_nearest() {
        let (w, h) = (37, 23);
        let set: Vec<bool> = (0..w * h).map(|i| (i * 7919 + 13) % 83 == 0).collect();
        let found = nearest(set.iter().copied(), w, h);
        for i in 0..w * h {
            let far = |j: usize| ((i % w).abs_diff(j % w)).pow(2) + ((i / w).abs_diff(j / w)).pow(2);
            let truth = (0..w * h).filter(|j| set[*j]).map(far).min().unwrap();
            assert_eq!(far(found[i] as usize), truth);
        }
        assert!(nearest([false; 6].into_iter(), 3, 2).iter().all(|n| *n == u32::MAX));
        assert!(nearest(std::iter::empty(), 0, 0).is_empty());
    }

    #[test]
    fn ink_is_what_the_paper_is_not() {
        let style = InkStyle { ink: None, paper: None, threshold: 0.5 };
        let grey = |v: f32| [v, v, v, 1.0];
        let drawn: Vec<f32> = [grey(0.6), grey(0.6), grey(0.3), grey(0.0), grey(0.61), [0.0; 4]].concat();
        let ink = Ink::new(&drawn, 6, &style);
        let rounded: Vec<f32> = ink.amount.iter().map(|v| (v * 10.0).round() / 10.0).collect();
        assert_eq!(rounded, [0.0, 0.0, 0.5, 1.0, 0.0, 0.0]);
        let clear = Ink::new(&[[0.0_f32; 4], [0.0; 4], [0.0, 0.0, 0.0, 0.5]].concat(), 3, &style);
        assert_eq!(clear.amount, [0.0, 0.0, 0.5]);
        let red = InkStyle { ink: Some([0.8, 0.0, 0.0]), paper: Some([1.0; 3]), threshold: 0.5 };
        let ink = Ink::new(&[[0.8_f32, 0.0, 0.0, 1.0], [0.0, 0.0, 0.8, 1.0], [1.0; 4]].concat(), 3, &red);
        assert!(ink.amount[0] > 0.99 && ink.amount[1] < 0.3 && ink.amount[2] == 0.0);
        assert_eq!(Ink::new(&[f32::NAN; 4], 1, &style).amount, [0.0]);
    }
}
