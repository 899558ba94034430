//! The pixels that the edge of the layer runs through: their alpha from the two colours that mix there.
//!
//! A posterior answers which side a pixel is on, not how much of it. Within a narrow band the colour of the layer `F` and of the ground `B` are taken from the nearest pixels that are
//! all one or the other, and alpha is the projection of the pixel on the line between them: α = (I − B)·(F − B) / |F − B|².
//!
//! **Source** Y. Mishima, US patent 5,355,174, 1993, and Y.-Y. Chuang and others, *A Bayesian approach to digital matting*, 2001, eq. 10, with the samples chosen by distance.

use super::regions;

/// Colour differences of less than this many times the grain tell nothing.
const MIN_CONTRAST: f32 = 4.0;
/// Colours off the line by more than this many times the grain (and a tenth of the line) are not a mix of the two.
const MAX_OFF_LINE: f32 = 4.0;

/// What the solve of a band needs to know.
pub(super) struct Band<'a, C: Fn(usize) -> [f32; 3]> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Which pixels are more layer than ground.
    pub(super) mask: &'a [bool],
    /// Half the width of the band, in whole pixels, at least 1.
    pub(super) radius: usize,
    /// The colour of a pixel in the space in which the edge was mixed, 0 to 1.
    pub(super) color: C,
    /// Standard deviation of the grain in that space.
    pub(super) grain: f32,
    /// Colours of the layer that stand in where it is too thin to hold a whole pixel.
    pub(super) palette: &'a [[f32; 3]],
    /// How many of the palette, from its start, are ink: they lie between the layer's fill and the ground.
    pub(super) inks: usize,
}

/// Colours of the nearest whole pixels of one side, averaged.
#[derive(Clone, Copy)]
struct Nearby {
    sum: [f32; 3],
    n: f32,
    nearest_sq: usize,
}

impl Nearby {
    const NONE: Self = Self { sum: [0.0; 3], n: 0.0, nearest_sq: usize::MAX };

    fn mean(&self) -> Option<[f32; 3]> {
        (self.n > 0.0).then(|| self.sum.map(|v| v / self.n))
    }
}

/// The explanation of a colour that fits it best: its alpha, and how far off it is.
#[derive(Default)]
struct Best(Option<(f32, f32)>);

impl Best {
    /// Takes an explanation that is nearer than the one held; the first of equals stays.
    fn offer(&mut self, found: Option<(f32, f32)>) {
        if let Some(f) = found
            && self.0.is_none_or(|held| f.1 < held.1)
        {
            self.0 = Some(f);
        }
    }

    fn alpha(&self) -> Option<f32> {
        self.0.map(|held| held.0)
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

impl<C: Fn(usize) -> [f32; 3]> Band<'_, C> {
    /// Which pixels lie within `radius` of one of the other kind. O(pixels × log radius).
    fn unknown(&self) -> Vec<bool> {
        let mut layer = self.mask.to_vec();
        let mut ground: Vec<bool> = self.mask.iter().map(|m| !m).collect();
        regions::dilate(&mut layer, self.width, self.radius);
        regions::dilate(&mut ground, self.width, self.radius);
        layer.iter().zip(&ground).map(|(l, g)| *l && *g).collect()
    }

    /// Solves the alpha of the band, in place. O(pixels + band × radius²).
    pub(super) fn solve(&self, alpha: &mut [f32]) {
        let unknown = self.unknown();
        for i in (0..alpha.len()).filter(|i| unknown[*i]) {
            if let Some(a) = self.mixed_alpha(i, &unknown) {
                alpha[i] = a;
            }
        }
    }

    /// The whole pixels around `i` of one side: the nearest, and those less than `slack` further off.
    fn nearby(&self, i: usize, unknown: &[bool], inside: bool, slack: usize) -> Nearby {
        let (x, y, reach) = (i % self.width, i / self.width, self.radius + 2);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(self.width);
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(self.height);
        let distance_sq = |u: usize, v: usize| u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2);
        let mut found = Nearby::NONE;
        for pass in 0..2 {
            for v in rows.clone() {
                for u in columns.clone() {
                    let j = v * self.width + u;
                    if unknown[j] || self.mask[j] != inside {
                        continue;
                    }
                    let d = distance_sq(u, v);
                    if pass == 0 {
                        found.nearest_sq = found.nearest_sq.min(d);
                    } else if d <= found.nearest_sq + slack {
                        let c = (self.color)(j);
                        found.sum = [found.sum[0] + c[0], found.sum[1] + c[1], found.sum[2] + c[2]];
                        found.n += 1.0;
                    }
                }
            }
            if found.nearest_sq == usize::MAX {
                break;
            }
        }
        found
    }

    /// Alpha of one pixel; `None` where its neighbourhood does not tell.
    fn mixed_alpha(&self, i: usize, unknown: &[bool]) -> Option<f32> {
        let near_ground = self.nearby(i, unknown, false, 4);
        let (near_layer, ground) = (self.nearby(i, unknown, true, 1), near_ground.mean()?);
        let color = (self.color)(i);
        let (inks, fills) = self.palette.split_at(self.inks.min(self.palette.len()));
        let mut best = Best::default();
        let Some(layer) = near_layer.mean() else {
            // Where the layer is a line thinner than the band, one of its known colours is what mixes here.
            inks.iter().chain(fills).for_each(|f| best.offer(self.project(color, *f, ground)));
            return best.alpha();
        };
        best.offer(self.project(color, layer, ground));
        for ink in inks {
            best.offer(self.project(color, *ink, ground));
            // Between the fill and its outline all is layer, but only on the layer's side of the line.
            if near_layer.nearest_sq <= near_ground.nearest_sq {
                best.offer(self.inside(color, layer, *ink));
            }
        }
        best.alpha()
    }

    /// Alpha 1 if `color` is a mix of two colours of the layer, and its distance from the line between them.
    fn inside(&self, color: [f32; 3], fill: [f32; 3], ink: [f32; 3]) -> Option<(f32, f32)> {
        let (d, e) = (sub(ink, fill), sub(color, fill));
        let t = (dot(e, d) / dot(d, d).max(1e-12)).clamp(0.0, 1.0);
        let rest = sub(e, d.map(|v| v * t));
        let off = dot(rest, rest).sqrt();
        (off <= MAX_OFF_LINE * self.grain + 0.1 * dot(d, d).sqrt()).then_some((1.0, off))
    }

    /// Where `color` lies between the two, 0 at the ground, and its distance from the line.
    fn project(&self, color: [f32; 3], layer: [f32; 3], ground: [f32; 3]) -> Option<(f32, f32)> {
        let (d, e) = (sub(layer, ground), sub(color, ground));
        let length = dot(d, d).sqrt();
        if length.is_nan() || length <= MIN_CONTRAST * self.grain {
            return None;
        }
        let t = dot(e, d) / (length * length);
        let rest = sub(e, d.map(|v| v * t));
        let off = dot(rest, rest).sqrt();
        if off > MAX_OFF_LINE * self.grain + 0.1 * length {
            return None;
        }
        // What the grain alone may do to a whole pixel is not a mix; the rest is stretched to close the gap.
        let dead = (self.grain / length).min(0.25);
        Some((((t - dead) / (1.0 - 2.0 * dead)).clamp(0.0, 1.0), off))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_of_a_straight_edge_is_found() {
        // A vertical edge at 4.3: the fifth pixel is covered to 0.3.
        let (width, height) = (10, 5);
        let mixed = |i: usize| match i % 10 {
            0..4 => [0.1, 0.2, 0.8],
            4 => [0.3 * 0.1 + 0.7 * 0.6, 0.3 * 0.2 + 0.7 * 0.5, 0.3 * 0.8 + 0.7 * 0.4],
            _ => [0.6, 0.5, 0.4],
        };
        for wrong in [4, 5] {
            // The mask may have put the mixed pixel on either side.
            let mask: Vec<bool> = (0..50).map(|i| i % 10 < wrong).collect();
            let mut alpha: Vec<f32> = mask.iter().map(|v| f32::from(*v)).collect();
            Band { width, height, mask: &mask, radius: 1, color: mixed, grain: 0.0, palette: &[], inks: 0 }.solve(&mut alpha);
            for (i, a) in alpha.iter().enumerate() {
                let truth = [1.0, 1.0, 1.0, 1.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0][i % 10];
                assert!((a - truth).abs() < 1e-5, "pixel {i}: expected {truth}, found {a}");
            }
        }
    }

    #[test]
    fn a_line_thinner_than_a_pixel_takes_its_colour_from_the_palette() {
        let (width, height) = (9, 5);
        let color = |i: usize| if i % 9 == 4 { [0.58; 3] } else { [0.9; 3] };
        let mask: Vec<bool> = (0..45).map(|i| i % 9 == 4).collect();
        let mut alpha: Vec<f32> = mask.iter().map(|v| f32::from(*v)).collect();
        Band { width, height, mask: &mask, radius: 1, color, grain: 0.0, palette: &[[1.0, 0.0, 0.0], [0.1; 3]], inks: 0 }.solve(&mut alpha);
        assert!((alpha[22] - 0.4).abs() < 1e-5 && alpha[21].abs() < 1e-6, "found {} and {}", alpha[22], alpha[21]);
    }
}
