//! Textures that repeat, with smaller copies of themselves for where they are seen small.

/// A picture on a surface and its halves, quarters and so on: RGBA, linear, premultiplied.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    levels: Vec<(usize, usize, Vec<[f32; 4]>)>,
}

impl Texture {
    /// A texture of rows from the top; `None` where the samples are not `4 * width * height`, or none. Cost: O(samples).
    pub fn new(samples: &[f32], width: usize, height: usize) -> Option<Self> {
        let (pixels, rest) = samples.as_chunks::<4>();
        if pixels.is_empty() || !rest.is_empty() || width.checked_mul(height)? != pixels.len() {
            return None;
        }
        let mut levels = vec![(width, height, pixels.to_vec())];
        while let Some((w, h, from)) = levels.last().filter(|(w, h, _)| *w > 1 && *h > 1) {
            let half = halved(*w, *h, from);
            levels.push(half);
        }
        Some(Self { levels })
    }

    /// The copy whose pixels are about as large as the screen's, for a triangle of these places that fills `area` half pixels.
    pub fn level(&self, uvs: &[[f64; 2]; 3], area: f64) -> usize {
        let [a, b, c] = uvs;
        let (w, h, _) = &self.levels[0];
        let texels = ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs() * (*w as f64) * (*h as f64);
        let mut ratio = texels / area.max(1e-12);
        let mut level = 0;
        // Half a level early: sharp, as drawings are.
        while ratio > 2.8 && level + 1 < self.levels.len() {
            ratio /= 4.0;
            level += 1;
        }
        level
    }

    /// The colour at a place, between the four nearest pixels.
    pub fn sample(&self, uv: [f64; 2], level: usize) -> [f32; 4] {
        let (w, h, pixels) = &self.levels[level.min(self.levels.len() - 1)];
        let (x, y) = (uv[0] * *w as f64 - 0.5, uv[1] * *h as f64 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let wrap = |v: f64, n: usize| (v.rem_euclid(n as f64) as usize).min(n - 1);
        let (columns, rows) = ([wrap(x0, *w), wrap(x0 + 1.0, *w)], [wrap(y0, *h), wrap(y0 + 1.0, *h)]);
        let (fx, fy) = ((x - x0) as f32, (y - y0) as f32);
        let at = |j: usize, i: usize| pixels[rows[j] * w + columns[i]];
        let mix = |a: [f32; 4], b: [f32; 4], t: f32| std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t);
        mix(mix(at(0, 0), at(0, 1), fx), mix(at(1, 0), at(1, 1), fx), fy)
    }
}

fn halved(w: usize, h: usize, from: &[[f32; 4]]) -> (usize, usize, Vec<[f32; 4]>) {
    let (hw, hh) = (w / 2, h / 2);
    let mut out = Vec::with_capacity(hw * hh);
    for y in 0..hh {
        let (top, bottom) = (&from[2 * y * w..], &from[(2 * y + 1) * w..]);
        out.extend((0..hw).map(|x| {
            let (a, b, c, d) = (top[2 * x], top[2 * x + 1], bottom[2 * x], bottom[2 * x + 1]);
            std::array::from_fn(|k| ((a[k] + b[k]) + (c[k] + d[k])) * 0.25)
        }));
    }
    (hw, hh, out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checks() -> Texture {
        let pixel = |x: usize, y: usize| if (x + y).is_multiple_of(2) { [1.0, 0.0, 0.0, 1.0] } else { [0.0, 0.0, 1.0, 1.0] };
        let samples: Vec<f32> = (0..16).flat_map(|i| pixel(i % 4, i / 4)).collect();
        Texture::new(&samples, 4, 4).unwrap()
    }

    #[test]
    fn a_texture_repeats_and_blends() {
        let texture = checks();
        assert_eq!(texture.sample([0.125, 0.125], 0), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(texture.sample([3.125, -0.875], 0), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(texture.sample([0.25, 0.125], 0), [0.5, 0.0, 0.5, 1.0]);
        assert_eq!(texture.sample([0.0, 0.0], 1), [0.5, 0.0, 0.5, 1.0]);
    }

    #[test]
    fn small_triangles_read_small_copies() {
        let texture = checks();
        let whole = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        assert_eq!([256.0, 16.0, 4.0, 1.0, 0.0].map(|area| texture.level(&whole, area)), [0, 0, 1, 2, 2]);
    }

    #[test]
    fn what_is_no_picture_is_no_texture() {
        assert_eq!(Texture::new(&[], 0, 0), None);
        assert_eq!(Texture::new(&[0.0; 8], 1, 1), None);
    }
}
