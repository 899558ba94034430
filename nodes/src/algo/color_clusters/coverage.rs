//! The matte of one frame: posterior, ink, agreement of neighbours, regions, and the coverage of the edge.

use super::{MatteError, Mix, Model, Options, Space, Status, edge, field, kernel, regions, validate};
use crate::algo::color;
use crate::algo::raster::Raster;

/// The matte of one frame into `out`, one sample a pixel, 0 to 1. The same bits on every run and processor.
///
/// # Errors
/// An empty picture, `out` of another size, or an option out of range.
pub fn alpha(image: Raster<'_>, model: &Model, options: &Options, out: &mut [f32]) -> Result<Status, MatteError> {
    validate(image, options)?;
    let n = image.width * image.height;
    if out.len() != n {
        return Err(MatteError::Size { expected: n, found: out.len() });
    }
    let planes = kernel::planes(image, model.space);
    let (ink, log_likelihood) = kernel::posterior(&planes, &kernel::PackedModel::new(model), out);
    let (_, ambiguity) = kernel::mean_and_ambiguity(out);
    give_ink(out, &ink, image.width, options);
    if options.smoothness > 0.0 {
        kernel::log_odds(out);
        field::smooth(out, &planes, image.width, image.height, options.smoothness, options.min_sigma * options.min_sigma);
    }
    let mask = tidy_mask(image, options, out);
    kernel::clip(out, options.clip.0 as f32, options.clip.1 as f32);
    if options.edge > 0.0 {
        solve_edge(image, model, options, &mask, out);
        settle_doubts(image.width, options, &mask, out);
    }
    let (area, _) = kernel::mean_and_ambiguity(out);
    Ok(Status { area, log_likelihood: log_likelihood / n as f64, ambiguity })
}

/// Adds the probability of ink to the layer where the ink is the layer's.
fn give_ink(out: &mut [f32], ink: &[f32], width: usize, options: &Options) {
    if ink.is_empty() || options.ink <= 0.0 {
        return;
    }
    // A speck of grain with the colour of the layer owns no ink.
    let mut layer: Vec<bool> = out.iter().map(|p| *p > 0.5).collect();
    regions::tidy(&mut layer, width, regions::Tidy { min_area: options.min_area, max_hole: 0.0, largest_only: false });
    let owned = regions::owned_ink(&layer, ink, width, options.ink);
    for ((o, i), owned) in out.iter_mut().zip(ink).zip(owned) {
        if owned {
            *o += i;
        }
    }
}

/// The colour of a pixel in the space in which edges were mixed.
fn mixed_color<'a>(image: Raster<'a>, mix: Mix) -> impl Fn(usize) -> [f32; 3] + 'a {
    move |i| {
        let rgb = kernel::clean_rgb(&image.data[i * image.channels..(i + 1) * image.channels]);
        match mix {
            Mix::Linear => rgb,
            Mix::Display => rgb.map(color::srgb_from_linear_f32),
        }
    }
}

/// Cuts the matte at one half, tidies its regions, and sets what changed sides.
fn tidy_mask(image: Raster<'_>, options: &Options, out: &mut [f32]) -> Vec<bool> {
    let mut mask: Vec<bool> = out.iter().map(|p| *p > 0.5).collect();
    if options.edge > 0.0 {
        let color = mixed_color(image, options.mix);
        let tolerance = 0.02 + 3.0 * grain(image, &color);
        regions::join_blends(&mut mask, out, image.width, options.clip.1 as f32, color, tolerance);
    }
    regions::close_gaps(&mut mask, image.width, options.close_gaps, options.fill_holes);
    let rules = regions::Tidy { min_area: options.min_area, max_hole: options.fill_holes, largest_only: options.largest_component };
    regions::tidy(&mut mask, image.width, rules);
    for (o, m) in out.iter_mut().zip(&mask) {
        if (*o > 0.5) != *m {
            *o = f32::from(*m);
        }
    }
    mask
}

/// Takes the doubts away that lie further from the outline than its band: faint specks of the ground where specks go, pinholes of the layer where holes do.
fn settle_doubts(width: usize, options: &Options, mask: &[bool], out: &mut [f32]) {
    let reach = options.edge.ceil() as usize + 2;
    if options.min_area > 0.0 {
        let mut near = mask.to_vec();
        regions::dilate(&mut near, width, reach);
        out.iter_mut().zip(&near).filter(|(_, near)| !**near).for_each(|(o, _)| *o = 0.0);
    }
    if options.fill_holes > 0.0 {
        let mut near: Vec<bool> = mask.iter().map(|m| !m).collect();
        regions::dilate(&mut near, width, reach);
        out.iter_mut().zip(&near).filter(|(_, near)| !**near).for_each(|(o, _)| *o = 1.0);
    }
}

/// Solves the band of mixed pixels.
fn solve_edge(image: Raster<'_>, model: &Model, options: &Options, mask: &[bool], out: &mut [f32]) {
    let color = mixed_color(image, options.mix);
    let palette: Vec<[f32; 3]> = model
        .ink
        .iter()
        .chain(&model.foreground)
        .filter(|g| g.weight > 0.01)
        .map(|g| palette_color(model.space, options.mix, g.mean))
        .collect();
    let band = edge::Band {
        width: image.width,
        height: image.height,
        mask,
        // Ink hides where its line ends: blends with it look like ground sooner than blends with a fill.
        radius: options.edge.ceil() as usize + usize::from(!model.ink.is_empty()),
        inks: model.ink.iter().filter(|g| g.weight > 0.01).count(),
        grain: grain(image, &color),
        color,
        palette: &palette,
    };
    band.solve(out);
}

/// The colour of a cluster in the space in which edges were mixed.
fn palette_color(space: Space, mix: Mix, mean: [f64; 3]) -> [f32; 3] {
    let linear = match space {
        Space::Lab => color::rgb_from_lab(mean),
        Space::Oklab => color::rgb_from_oklab(mean.map(|v| v / 100.0)),
        Space::Display => mean.map(|v| color::linear_from_srgb(v / 100.0)),
        Space::Linear => mean.map(|v| v / 100.0),
    };
    let mixed = |v: f64| if mix == Mix::Display { color::srgb_from_linear(v) } else { v };
    linear.map(|v| mixed(v.clamp(0.0, 1.0)) as f32)
}

/// Standard deviation of the grain of one sample: the median second difference along rows, over that of a unit normal.
fn grain(image: Raster<'_>, color: &impl Fn(usize) -> [f32; 3]) -> f32 {
    let n = image.width * image.height;
    if image.width < 3 {
        return 0.0;
    }
    let step = (n / 8192).max(1) | 1;
    let inner = (0..n).step_by(step).filter(|i| (1..image.width - 1).contains(&(i % image.width)));
    let mut differences: Vec<f32> = inner
        .map(|i| {
            let (a, b, c) = (color(i - 1), color(i), color(i + 1));
            (0..3).map(|k| (a[k] - 2.0 * b[k] + c[k]).abs()).sum::<f32>() / 3.0
        })
        .collect();
    if differences.is_empty() {
        return 0.0;
    }
    let middle = differences.len() / 2;
    let (_, median, _) = differences.select_nth_unstable_by(middle, f32::total_cmp);
    // The mean of three absolute normal deviates has its median near √(2/π), a second difference √6 times the spread of a sample.
    *median / (0.798 * 2.449_5)
}
