//! Whole regions of a matte: specks, holes, the ink that belongs to a layer, and blends of two of its colours.

/// A run of equal pixels in a row, and the run that its component is known by.
struct Run {
    y: u32,
    start: u32,
    end: u32,
    inside: bool,
    parent: u32,
}

impl Run {
    /// The pixels of the run.
    fn span(&self, width: usize) -> std::ops::Range<usize> {
        let row = self.y as usize * width;
        row + self.start as usize..row + self.end as usize
    }
}

/// What is known of a component, kept at its first run.
#[derive(Clone, Copy, Default)]
struct Extent {
    area: u64,
    on_border: bool,
}

/// The first run of the component of run `i`, halving the path on the way.
fn find(runs: &mut [Run], mut i: u32) -> u32 {
    while runs[i as usize].parent != i {
        let grandparent = runs[runs[i as usize].parent as usize].parent;
        runs[i as usize].parent = grandparent;
        i = grandparent;
    }
    i
}

/// Joins two components under the earlier of their first runs.
fn unite(runs: &mut [Run], a: u32, b: u32) {
    let (a, b) = (find(runs, a), find(runs, b));
    runs[a.max(b) as usize].parent = a.min(b);
}

/// The runs of a mask, joined: the layer through its eight neighbours, the rest through four. O(pixels).
fn components(mask: &[bool], width: usize) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    let mut previous = 0..0;
    for (y, row) in mask.chunks_exact(width).enumerate() {
        let first = runs.len();
        let mut x = 0;
        while x < width {
            let inside = row[x];
            let end = row[x..].iter().position(|v| *v != inside).map_or(width, |n| x + n);
            let id = runs.len() as u32;
            runs.push(Run { y: y as u32, start: x as u32, end: end as u32, inside, parent: id });
            x = end;
        }
        let (mut above, mut here) = (previous.start, first);
        while above < previous.end && here < runs.len() {
            let (a, h) = (&runs[above], &runs[here]);
            let reach = u32::from(a.inside);
            let touches = a.inside == h.inside && a.start < h.end + reach && h.start < a.end + reach;
            // A run that ends first can meet no later one, but for the corner, which the one that begins there meets.
            let step_above = a.end < h.end || (a.end == h.end && here + 1 == runs.len());
            let corner = (a.end == h.end && a.inside != h.inside).then_some(());
            if touches {
                unite(&mut runs, above as u32, here as u32);
            }
            if corner.is_some() {
                unite_corner(&mut runs, above, here, previous.end);
            }
            if step_above {
                above += 1;
            } else {
                here += 1;
            }
        }
        previous = first..runs.len();
    }
    runs
}

/// Where two runs of different kinds end at the same column, the layer's one of the pair meets the layer's next one across the corner.
fn unite_corner(runs: &mut [Run], above: usize, here: usize, above_end: usize) {
    if runs[above].inside {
        if here + 1 < runs.len() {
            unite(runs, above as u32, here as u32 + 1);
        }
    } else if above + 1 < above_end {
        unite(runs, above as u32 + 1, here as u32);
    }
}

/// What to do with the components of a matte. Areas are in pixels.
#[derive(Clone, Copy)]
pub(super) struct Tidy {
    /// Parts of the layer that are smaller vanish.
    pub(super) min_area: f64,
    /// Holes up to this area are filled; a hole that touches the border of the picture is none.
    pub(super) max_hole: f64,
    /// Only the largest part of the layer stays.
    pub(super) largest_only: bool,
}

/// Removes specks, keeps the largest part, and then fills holes, in place. O(pixels).
///
/// One after the other: what a speck shuts in is no hole once the speck is gone, and a speck in a hole is part of it.
pub(super) fn tidy(mask: &mut [bool], width: usize, options: Tidy) {
    if width == 0 {
        return;
    }
    if options.min_area > 0.0 || options.largest_only {
        flip(mask, width, |runs, extents| {
            // Among equal parts the first in reading order counts as the largest.
            let parts = (0..runs.len()).filter(|i| runs[*i].inside);
            let largest = parts
                .fold(None, |best: Option<usize>, i| if best.is_none_or(|b| extents[i].area > extents[b].area) { Some(i) } else { best });
            let few = options.min_area;
            move |root, inside, e| inside && ((e.area as f64) < few || (options.largest_only && largest != Some(root)))
        });
    }
    if options.max_hole > 0.0 {
        flip(mask, width, |_, _| |_, inside, e: Extent| !inside && !e.on_border && e.area as f64 <= options.max_hole);
    }
}

/// Turns whole components over: those of which the rule that `choose` gives says so, by the first run, whether it is of the layer, and the extent.
fn flip<F: Fn(usize, bool, Extent) -> bool>(mask: &mut [bool], width: usize, choose: impl FnOnce(&[Run], &[Extent]) -> F) {
    let height = mask.len() / width;
    let mut runs = components(mask, width);
    let mut extents = vec![Extent::default(); runs.len()];
    for i in 0..runs.len() {
        let root = find(&mut runs, i as u32) as usize;
        let r = &runs[i];
        let e = &mut extents[root];
        e.area += u64::from(r.end - r.start);
        e.on_border |= r.start == 0 || r.end as usize == width || r.y == 0 || r.y as usize + 1 == height;
    }
    let is_flipped = choose(&runs, &extents);
    for i in 0..runs.len() {
        let root = find(&mut runs, i as u32) as usize;
        let r = &runs[i];
        if is_flipped(root, r.inside, extents[root]) {
            mask[r.span(width)].fill(!r.inside);
        }
    }
}

/// Which ink belongs to the layer: what can be reached from it through ink within `reach` pixels. O(pixels).
///
/// Two pixels of anything lie between a flat colour and its outline, where both mix; the walk begins beyond them.
pub(super) fn owned_ink(layer: &[bool], ink: &[f32], width: usize, reach: f64) -> Vec<bool> {
    const GAP: u32 = 2;
    let reach = reach.clamp(0.0, 1e6).ceil() as u32;
    let mut depth = vec![u32::MAX; layer.len()];
    let mut front: Vec<u32> = Vec::new();
    for (i, inside) in layer.iter().enumerate() {
        if *inside {
            depth[i] = 0;
            if neighbours(i, width, layer.len()).any(|j| !layer[j]) {
                front.push(i as u32);
            }
        }
    }
    let mut owned = vec![false; layer.len()];
    for step in 1..=reach.saturating_add(GAP) {
        let mut next = Vec::new();
        for &i in &front {
            for j in neighbours(i as usize, width, layer.len()) {
                let is_ink = ink[j] > 0.5;
                if depth[j] == u32::MAX && (is_ink || step <= GAP) {
                    depth[j] = step;
                    owned[j] = is_ink;
                    next.push(j as u32);
                }
            }
        }
        if next.is_empty() {
            break;
        }
        front = next;
    }
    swellings(&mut owned, ink, width);
    owned
}

/// Pens swell: what is left of an outline beyond its reach is the layer's, too, where it is broad and shallow, its area no more than a quarter of the square of its
/// contact with what is owned.
/// A stroke of the ground that meets the outline is long, and its contact narrow.
fn swellings(owned: &mut [bool], ink: &[f32], width: usize) {
    let rest: Vec<bool> = ink.iter().zip(owned.iter()).map(|(p, o)| *p > 0.5 && !o).collect();
    let mut runs = components(&rest, width);
    let mut counts = vec![[0u64; 2]; runs.len()];
    for i in 0..runs.len() {
        if runs[i].inside {
            let root = find(&mut runs, i as u32) as usize;
            let span = runs[i].span(width);
            counts[root][0] += span.len() as u64;
            counts[root][1] += span.filter(|j| neighbours(*j, width, owned.len()).any(|k| owned[k])).count() as u64;
        }
    }
    for i in 0..runs.len() {
        let root = find(&mut runs, i as u32) as usize;
        let [area, contact] = counts[root];
        if runs[i].inside && 4 * area <= contact.saturating_mul(contact) {
            owned[runs[i].span(width)].fill(true);
        }
    }
}

/// Grows a mask by `radius` pixels in all eight directions, in place. O(pixels × log radius).
pub(super) fn dilate(mask: &mut [bool], width: usize, radius: usize) {
    let mut left = radius;
    let mut copy = mask.to_vec();
    let mut step = 1;
    while left > 0 && width > 0 {
        // A step of one more than what has been grown leaves no gap, at the border of the picture either, where only half of the square is there to be moved.
        let by = step.min(left);
        for (row, from) in mask.chunks_exact_mut(width).zip(copy.chunks_exact(width)) {
            merge_shifted(row, from, by);
        }
        copy.copy_from_slice(mask);
        merge_shifted(mask, &copy, by.saturating_mul(width));
        copy.copy_from_slice(mask);
        left -= by;
        step = radius - left + 1;
    }
}

/// Fills holes up to `max_hole` whose walls have gaps of at most `gap` pixels, in place. O(pixels).
///
/// The walls are grown until the gaps close, and what is then a hole grows back to them.
pub(super) fn close_gaps(mask: &mut [bool], width: usize, gap: f64, max_hole: f64) {
    let radius = (gap.clamp(0.0, 64.0) / 2.0).ceil() as usize;
    if radius == 0 || max_hole <= 0.0 {
        return;
    }
    let mut grown = mask.to_vec();
    dilate(&mut grown, width, radius);
    let mut filled = grown.clone();
    tidy(&mut filled, width, Tidy { min_area: 0.0, max_hole, largest_only: false });
    for (f, g) in filled.iter_mut().zip(&grown) {
        *f &= !g;
    }
    dilate(&mut filled, width, radius);
    for (m, f) in mask.iter_mut().zip(&filled) {
        *m |= f;
    }
}

/// Ors `from`, moved by `by` samples either way, into `out`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2"))]
fn merge_shifted(out: &mut [bool], from: &[bool], by: usize) {
    if by >= out.len() {
        return;
    }
    for (o, f) in out[by..].iter_mut().zip(from) {
        *o |= f;
    }
    for (o, f) in out.iter_mut().zip(&from[by..]) {
        *o |= f;
    }
}

/// The neighbours of pixel `i`, at most eight.
fn neighbours(i: usize, width: usize, len: usize) -> impl Iterator<Item = usize> {
    let (x, y, height) = (i % width, i / width, len / width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    rows.flat_map(move |v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| v * width + u)).filter(move |j| *j != i)
}

/// Turns pixels that are a blend of two of the other kind, one on each side, to that kind: between a flat colour and its outline lie colours that are neither, and that may
/// look like the ground. In the same way `alpha` becomes 1 where a pixel of the layer is in doubt (below `sure`) but a blend of two others. `color` gives the colour of a pixel
/// in the space in which it was mixed (0 to 1), `tolerance` how far off the line between the two it may be. O(pixels).
pub(super) fn join_blends(
    mask: &mut [bool],
    alpha: &mut [f32],
    width: usize,
    sure: f32,
    color: impl Fn(usize) -> [f32; 3],
    tolerance: f32,
) {
    if width == 0 {
        return;
    }
    let height = mask.len() / width;
    let before = mask.to_vec();
    for y in 2..height.saturating_sub(2) {
        for x in 2..width.saturating_sub(2) {
            let i = y * width + x;
            let kind = before[i];
            if kind && alpha[i] < sure && is_blend(&before, i, true, width, &color, tolerance) {
                alpha[i] = 1.0;
                continue;
            }
            let enclosed = before[i - 1] == kind && before[i + 1] == kind && before[i - width] == kind && before[i + width] == kind;
            if !enclosed && is_blend(&before, i, !kind, width, &color, tolerance) {
                mask[i] = !kind;
            }
        }
    }
}

/// Whether two pixels of a kind that face each other across `i`, one or two pixels off, mix to its colour.
fn is_blend(mask: &[bool], i: usize, kind: bool, width: usize, color: &impl Fn(usize) -> [f32; 3], tolerance: f32) -> bool {
    for step in [1, width, width + 1, width - 1] {
        for (before, after) in [(1, 1), (1, 2), (2, 1), (2, 2)] {
            let (a, b) = (i - before * step, i + after * step);
            if mask[a] == kind && mask[b] == kind && distance_to_segment_sq(color(i), color(a), color(b)) < tolerance * tolerance {
                return true;
            }
        }
    }
    false
}

/// Squared distance of `p` from the segment between `a` and `b`.
fn distance_to_segment_sq(p: [f32; 3], a: [f32; 3], b: [f32; 3]) -> f32 {
    let dot = |u: [f32; 3], v: [f32; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let sub = |u: [f32; 3], v: [f32; 3]| [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
    let (d, e) = (sub(b, a), sub(p, a));
    let t = (dot(e, d) / dot(d, d).max(1e-12)).clamp(0.0, 1.0);
    let r = sub(e, d.map(|v| v * t));
    dot(r, r)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(rows: &[&str]) -> Vec<bool> {
        rows.iter().flat_map(|r| r.bytes().map(|b| b == b'#')).collect()
    }

    #[test]
    fn specks_go_and_holes_close() {
        let mut m = mask(&["#.......", "..####..", "..#..#..", "..####..", "#......#"]);
        let size = |m: &[bool]| m.iter().filter(|v| **v).count();
        tidy(&mut m, 8, Tidy { min_area: 2.0, max_hole: 1.0, largest_only: false });
        assert_eq!(size(&m), 10);
        tidy(&mut m, 8, Tidy { min_area: 0.0, max_hole: 2.0, largest_only: false });
        assert_eq!(size(&m), 12);
    }

    #[test]
    fn a_hole_with_a_gap_in_its_wall_closes_and_a_bay_does_not() {
        let rows = [
            "..............",
            ".########.....",
            ".#......#.....",
            ".#......#.....",
            ".#............",
            ".#......#.....",
            ".#......#.....",
            ".########.....",
        ];
        let mut m = mask(&rows);
        let walls = m.iter().filter(|v| **v).count();
        close_gaps(&mut m, 14, 0.0, 1e9);
        assert_eq!(m.iter().filter(|v| **v).count(), walls);
        close_gaps(&mut m, 14, 2.0, 1e9);
        tidy(&mut m, 14, Tidy { min_area: 0.0, max_hole: 1e9, largest_only: false });
        assert!((2..7).all(|y| (1..8).all(|x| m[y * 14 + x])), "the inside is full");
        assert!((0..8).all(|y| (10..14).all(|x| !m[y * 14 + x])), "the outside is not");
        let bay = mask(&["#......#", "#......#", "#......#", "########"]);
        let mut m = bay.clone();
        close_gaps(&mut m, 8, 2.0, 1e9);
        assert_eq!(m, bay);
    }

    #[test]
    fn a_hole_open_to_the_border_stays() {
        let open = mask(&["###", "#..", "###"]);
        let mut m = open.clone();
        tidy(&mut m, 3, Tidy { min_area: 0.0, max_hole: 1e9, largest_only: false });
        assert_eq!(m, open);
    }

    #[test]
    fn the_layer_hangs_together_by_corners_and_the_ground_does_not() {
        // Both diagonals, so that the corner is met from either side.
        for rows in [["#...", ".#..", "..#.", "...#"], ["...#", "..#.", ".#..", "#..."]] {
            let diagonal = mask(&rows);
            let mut m = diagonal.clone();
            tidy(&mut m, 4, Tidy { min_area: 4.0, max_hole: 0.0, largest_only: true });
            assert_eq!(m, diagonal, "{rows:?}");
        }
        let mut ring = mask(&[".....", "..#..", ".#.#.", "..#..", "....."]);
        tidy(&mut ring, 5, Tidy { min_area: 0.0, max_hole: 1.0, largest_only: false });
        assert_eq!(ring.iter().filter(|v| **v).count(), 5);
    }

    #[test]
    fn components_agree_with_a_flood_fill() {
        // A checkered noise with every configuration of corners; the flood fill is the definition itself.
        let (width, height) = (37, 29);
        let mut state = 7u32;
        let noise: Vec<bool> = (0..width * height)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                state >> 31 == 1
            })
            .collect();
        let mut runs = components(&noise, width);
        let mut label = vec![0u32; noise.len()];
        for i in 0..runs.len() {
            let root = find(&mut runs, i as u32);
            let row = runs[i].y as usize * width;
            label[row + runs[i].start as usize..row + runs[i].end as usize].fill(root);
        }
        let mut flood = vec![usize::MAX; noise.len()];
        for start in 0..noise.len() {
            let mut stack = if flood[start] == usize::MAX { vec![start] } else { Vec::new() };
            while let Some(i) = stack.pop() {
                flood[i] = start;
                let straight = |j: usize| i.abs_diff(j) == 1 || i.abs_diff(j) == width;
                stack.extend(
                    neighbours(i, width, noise.len())
                        .filter(|j| noise[*j] == noise[i] && flood[*j] == usize::MAX && (noise[i] || straight(*j))),
                );
            }
        }
        for i in 0..noise.len() {
            for j in 0..noise.len() {
                assert_eq!(label[i] == label[j], flood[i] == flood[j], "pixels {i} and {j}");
            }
        }
    }

    #[test]
    fn what_a_speck_shuts_in_goes_with_it_and_a_speck_in_a_hole_is_filled() {
        // A ring of eight pixels beside a large part, whose hole has a pixel in its middle.
        let mut m = mask(&[
            "...............",
            ".###...#######.",
            ".#.#...#.....#.",
            ".###...#..#..#.",
            ".......#.....#.",
            ".......#######.",
            "...............",
        ]);
        tidy(&mut m, 15, Tidy { min_area: 10.0, max_hole: 1e9, largest_only: false });
        let expected = mask(&[
            "...............",
            ".......#######.",
            ".......#######.",
            ".......#######.",
            ".......#######.",
            ".......#######.",
            "...............",
        ]);
        assert_eq!(m, expected);
    }

    #[test]
    fn a_point_grows_to_a_square() {
        for radius in [0, 1, 2, 3, 4, 7] {
            let mut m = vec![false; 19 * 17];
            (m[8 * 19 + 9], m[0]) = (true, true);
            dilate(&mut m, 19, radius);
            for (i, v) in m.iter().enumerate() {
                let (x, y) = (i % 19, i / 19);
                let expected = (x.abs_diff(9) <= radius && y.abs_diff(8) <= radius) || (x <= radius && y <= radius);
                assert_eq!(*v, expected, "radius {radius}, pixel ({x}, {y})");
            }
        }
    }

    #[test]
    fn ink_is_reached_through_ink_alone() {
        // Layer at the left, two pixels of outline after a mixed one, ground, and a line of the ground's own.
        let layer = mask(&["##........"; 3]);
        let ink: Vec<f32> = ["...++..+++"; 3].iter().flat_map(|r| r.bytes().map(|b| f32::from(b == b'+'))).collect();
        let owned = owned_ink(&layer, &ink, 10, 4.0);
        let expected: Vec<bool> = ["...##....."; 3].iter().flat_map(|r| r.bytes().map(|b| b == b'#')).collect();
        assert_eq!(owned, expected);
    }

    #[test]
    fn a_blend_joins_its_neighbours() {
        let mut m = mask(&["##.##"; 5]);
        let color = |i: usize| [[0.0, 0.0, 0.8], [0.0, 0.0, 0.8], [0.0, 0.0, 0.3], [0.0, 0.0, 0.1], [0.0, 0.0, 0.1]][i % 5];
        let mut alpha = vec![0.0; 25];
        join_blends(&mut m, &mut alpha, 5, 0.9, color, 0.02);
        assert!(m[12]);
        let mut n = mask(&["##.##"; 5]);
        join_blends(&mut n, &mut alpha, 5, 0.9, |i| if i % 5 == 2 { [0.0, 0.9, 0.0] } else { color(i) }, 0.02);
        assert!(!n[12]);
    }
}
