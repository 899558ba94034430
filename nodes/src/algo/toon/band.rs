//! A band of rows: depth, colours, close looks, coverage.

use kurbo::Point;

use super::Area;
use super::outline::{path, touched};
use super::shade::{Recent, Shader};
use crate::algo::paint::{FillRule, fill_rows};
use crate::algo::zbuffer::{Close, NONE, OFFSETS, Projected, Rows, SAMPLES, depth_of, draw_close};

/// Rows of a band: so few that what is looked at stays in the fastest memory.
pub(super) const ROWS: usize = 32;

/// What is the same for all bands.
pub(super) struct Band<'a> {
    pub(super) shader: Shader<'a>,
    pub(super) loops: &'a [Vec<Point>],
    pub(super) area: Area,
    pub(super) reference: f64,
    pub(super) antialias: bool,
    /// The triangles that may touch each band and a row beside it, ascending.
    pub(super) reaching: Vec<Vec<u32>>,
}

/// The rows of the results that a band writes; `near` is as wide as the area, and wanted for lines alone, the others as the picture.
pub(super) struct Out<'a> {
    pub(super) near: Option<&'a mut [f32]>,
    pub(super) image: &'a mut [f32],
    pub(super) depth: &'a mut [f32],
    pub(super) id: &'a mut [f32],
    pub(super) width: usize,
}

/// The rows of a band and one more at both its sides, whose colours the close looks depend on. A thread uses the same for all its bands.
#[derive(Default)]
pub(super) struct Look {
    /// First row of the picture, and how many there are.
    top: usize,
    rows: usize,
    /// Those of them that are not the band's own.
    above: usize,
    near: Vec<f32>,
    id: Vec<u32>,
    /// At each pixel's centre; for close looks alone.
    colour: Vec<[f32; 3]>,
    /// Where each pixel's close look stands, or [`NONE`].
    slot: Vec<u32>,
    close: Vec<Close>,
}

impl Look {
    /// Makes room for so many pixels, with nothing drawn.
    fn clear(&mut self, top: usize, rows: usize, above: usize, pixels: usize) {
        (self.top, self.rows, self.above) = (top, rows, above);
        self.near.clear();
        self.near.resize(pixels, f32::NEG_INFINITY);
        self.id.clear();
        self.id.resize(pixels, NONE);
        self.colour.clear();
        self.slot.clear();
        self.close.clear();
    }
}

/// Which triangles may touch each band of an area, a pixel more at both its sides. Cost: O(n).
pub(super) fn reaching(projected: &Projected, area: Area) -> Vec<Vec<u32>> {
    let bands = area.height.div_ceil(ROWS);
    let mut out = vec![Vec::new(); bands];
    let band = |y: f64| ((y - area.origin[1] as f64).max(0.0) as usize / ROWS).min(bands - 1);
    for (number, triangle) in projected.triangles.iter().enumerate() {
        let [a, b, c] = triangle.corners.map(|c| c[1]);
        let (low, high) = (band(a.min(b).min(c) - 2.0), band(a.max(b).max(c) + 2.0));
        out[low..=high].iter_mut().for_each(|of| of.push(number as u32));
    }
    out
}

impl Band<'_> {
    /// Draws the band that starts `top` rows below the area's own top.
    pub(super) fn draw(&self, (look, recent): &mut (Look, Recent), top: usize, out: Out<'_>) {
        let width = self.area.width;
        let own = out.id.len() / out.width;
        let above = usize::from(top > 0 && self.antialias);
        let below = usize::from(top + own < self.area.height && self.antialias);
        let rows = own + above + below;
        look.clear(self.area.origin[1] + top - above, rows, above, rows * width);
        let numbers = &self.reaching[top / ROWS];
        self.rows(look).draw(&self.shader.projected.triangles, numbers);
        let mut cover = Vec::new();
        if self.antialias {
            self.colour(look, recent);
            self.look_closely(look, numbers);
            cover = self.cover(look, own);
        }
        self.write(look, recent, &cover, own, out);
    }

    fn rows<'b>(&self, look: &'b mut Look) -> Rows<'b> {
        Rows {
            origin: [self.area.origin[0], look.top],
            width: self.area.width,
            near: &mut look.near,
            id: &mut look.id,
            reference: self.reference,
        }
    }

    /// The colour at each pixel's centre.
    fn colour(&self, look: &mut Look, recent: &mut Recent) {
        look.colour.resize(look.id.len(), [0.0; 3]);
        let rows = look.id.chunks(self.area.width).zip(look.colour.chunks_mut(self.area.width));
        for (y, (ids, colours)) in rows.enumerate() {
            for x in drawn(ids, &[]) {
                colours[x] = self.shader.at_centre(ids[x], [x + self.area.origin[0], y + look.top], recent);
            }
        }
    }

    /// Samples the pixels where colours meet, and those at the outline.
    fn look_closely(&self, look: &mut Look, numbers: &[u32]) {
        let width = self.area.width;
        let mut wanted = vec![false; look.near.len()];
        let differ = |a: usize, b: usize| {
            let (p, q) = (look.colour[a], look.colour[b]);
            (look.id[a] == NONE) != (look.id[b] == NONE) || (p != q && (0..3).any(|k| (p[k] - q[k]).abs() > 1.0 / 64.0))
        };
        // Where two differ one of them is drawn, and looks at the other; of two that are, the first.
        for (y, ids) in look.id.chunks(width).enumerate() {
            for x in drawn(ids, &[]) {
                let i = y * width + x;
                if x + 1 < width && differ(i, i + 1) {
                    (wanted[i], wanted[i + 1]) = (true, true);
                }
                if i + width < wanted.len() && differ(i, i + width) {
                    (wanted[i], wanted[i + width]) = (true, true);
                }
                if x > 0 && look.id[i - 1] == NONE {
                    (wanted[i], wanted[i - 1]) = (true, true);
                }
                if y > 0 && look.id[i - width] == NONE {
                    (wanted[i], wanted[i - width]) = (true, true);
                }
            }
        }
        let left = self.area.origin[0] as f64;
        for line in self.loops {
            for (i, &a) in line.iter().enumerate() {
                touched(a, line[(i + 1) % line.len()], look.top, look.rows, |y, x0, x1| {
                    let row = (y - look.top) * width;
                    let (low, high) = ((x0 - left).max(0.0) as usize, ((x1 - left + 1.0).max(0.0) as usize).min(width));
                    (low..high).for_each(|x| wanted[row + x] = true);
                });
            }
        }
        let mut count = 0;
        look.slot = wanted
            .iter()
            .map(|&w| {
                if w {
                    count += 1;
                    count - 1
                } else {
                    NONE
                }
            })
            .collect();
        look.close = vec![Close::default(); count as usize];
        let slot = std::mem::take(&mut look.slot);
        let mut close = std::mem::take(&mut look.close);
        draw_close(&self.rows(look), &slot, &mut close, &self.shader.projected.triangles, numbers);
        (look.slot, look.close) = (slot, close);
    }

    /// The covered part of the band's own pixels.
    fn cover(&self, look: &Look, own: usize) -> Vec<f32> {
        let width = self.area.width;
        let mut cover = vec![0.0; own * width];
        let origin = [self.area.origin[0], look.top + look.above];
        let near: Vec<Vec<Point>> = self.loops.iter().filter(|l| reaches(l, origin[1], own)).cloned().collect();
        fill_rows(&path(&near, origin), FillRule::NonZero, width, own, |y, x0, row| {
            cover[y * width + x0..][..row.len()].copy_from_slice(row);
        });
        cover
    }

    fn write(&self, look: &Look, recent: &mut Recent, cover: &[f32], own: usize, out: Out<'_>) {
        let width = self.area.width;
        if let Some(near) = out.near {
            near.copy_from_slice(&look.near[look.above * width..][..own * width]);
        }
        // The part of the triangle that was last.
        let (mut last, mut part) = (NONE, 0.0);
        for y in 0..own {
            let (row, place) = ((y + look.above) * width, [self.area.origin[0], y + look.above + look.top]);
            let ids = &look.id[row..][..width];
            let slots = look.slot.get(row..row + width).unwrap_or_default();
            for x in drawn(ids, slots) {
                let i = row + x;
                let slot = slots.get(x).copied().unwrap_or(NONE);
                let at = [place[0] + x, place[1]];
                let (id, near, colour) = match look.close.get(slot as usize) {
                    None if self.antialias => (look.id[i], look.near[i], look.colour[i]),
                    None => (look.id[i], look.near[i], self.shader.at_centre(look.id[i], at, recent)),
                    Some(close) => {
                        let colour = self.mean(close, at, recent);
                        let (id, near) = nearest(close, look.id[i], look.near[i]);
                        (id, near, colour)
                    }
                };
                let alpha = match cover.get(y * width + x) {
                    Some(&part) => part,
                    None => f32::from(u8::from(id != NONE)),
                };
                if id == NONE || alpha <= 0.0 {
                    continue;
                }
                if id != last {
                    let source = self.shader.projected.triangles[id as usize].source;
                    (last, part) = (id, (self.shader.surface.part[source as usize] + 1) as f32);
                }
                let to = y * out.width + at[0];
                let [r, g, b] = colour.map(|c| c * alpha);
                out.image[4 * to..4 * to + 4].copy_from_slice(&[r, g, b, alpha]);
                if near > f32::NEG_INFINITY {
                    out.depth[to] = depth_of(f64::from(near) + self.reference, self.shader.orthographic) as f32;
                }
                out.id[to] = part;
            }
        }
    }

    /// The mean colour of the samples of a pixel that something covers; of a sliver that no sample meets, its own.
    fn mean(&self, close: &Close, pixel: [usize; 2], recent: &mut Recent) -> [f32; 3] {
        let [x, y] = pixel.map(|v| v as f64);
        let (mut sum, mut count) = ([0.0_f32; 3], 0.0_f32);
        let mut add = |id: u32, dx: f64, dy: f64| {
            let colour = self.shader.colour(id, x + dx, y + dy, recent);
            sum = std::array::from_fn(|k| sum[k] + colour[k]);
            count += 1.0;
        };
        for s in (0..SAMPLES).filter(|&s| close.id[s] != NONE) {
            add(close.id[s], OFFSETS[s][0], OFFSETS[s][1]);
        }
        if close.id == [NONE; SAMPLES] && close.touching != NONE {
            add(close.touching, 0.5, 0.5);
        }
        sum.map(|v| v / count.max(1.0))
    }
}

/// The columns where either of two rows is not [`NONE`]; the second may be empty. Most of a picture is, so that it is passed over in blocks.
fn drawn<'a>(first: &'a [u32], second: &'a [u32]) -> impl Iterator<Item = usize> + 'a {
    const BLOCK: usize = 16;
    let is_empty =
        |row: &[u32], x: usize| row.get(x..(x + BLOCK).min(row.len())).is_none_or(|block| block.iter().fold(NONE, |a, b| a & b) == NONE);
    let blocks = (0..first.len()).step_by(BLOCK).filter(move |x| !(is_empty(first, *x) && is_empty(second, *x)));
    let columns = blocks.flat_map(|x| x..(x + BLOCK).min(first.len()));
    columns.filter(|x| first[*x] != NONE || second.get(*x).is_some_and(|v| *v != NONE))
}

/// True where a closed line may touch so many rows from `top` on.
fn reaches(line: &[Point], top: usize, rows: usize) -> bool {
    let [low, high] = line.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], p| [a.min(p.y), b.max(p.y)]);
    high >= top as f64 && low <= (top + rows) as f64
}

/// What stands for a pixel: what its centre sees, or the nearest of its samples, or what touches it.
fn nearest(close: &Close, id: u32, near: f32) -> (u32, f32) {
    if id != NONE {
        return (id, near);
    }
    let seen = (0..SAMPLES).filter(|&s| close.id[s] != NONE);
    let first = seen.fold(None, |best: Option<usize>, s| if best.is_some_and(|b| close.near[b] >= close.near[s]) { best } else { Some(s) });
    first.map_or((close.touching, f32::NEG_INFINITY), |s| (close.id[s], close.near[s]))
}
