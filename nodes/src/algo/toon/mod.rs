//! A toon renderer: flat bands of light, exact coverage, ink lines.
//!
//! Bands of rows are drawn by themselves, on as many threads as there are; each pixel's bits depend on the scene alone. Every pixel is sampled at its
//! centre; those where colours meet are sampled 16 times over. How much of a pixel is covered at all is not sampled but exact. Lines are
//! the chains of [`super::silhouette`], cut where triangles hide them ([`super::hidden`]), and drawn with a pen whose width may change. Where the mesh hides the
//! line of the smooth surface that it stands for, the outermost outline has ink along the mesh's own edges.
//!
//! **Source** Hertzmann and Zorin, *Illustrating smooth surfaces*, 2000; Northrup and Markosian, *Artistic silhouettes: a hybrid approach*, 2000
//! (visibility and linking on the screen); the look of Li, Gleicher, Xu and Shum, *Stylizing Motion with Drawings*, 2003.

mod band;
mod ink;
mod outline;
mod shade;
mod texture;

use std::sync::Mutex;

pub use ink::Pen;
pub use shade::{Highlight, Light, Paint};
pub use texture::Texture;

use super::camera::Camera;
use super::hidden::Hidden;
use super::refine::refine;
use super::silhouette::{Lines, chains, folds};
use super::surface::{Edge, Surface};
use super::visibility::{Area, Depths, Sight, reference_of};
use super::zbuffer::{Projected, project};
use band::{Band, Look, Out, ROWS, reaching};
use shade::Recent;

/// How a surface is drawn.
#[derive(Clone, Debug)]
pub struct Style<'a> {
    /// What it is painted with.
    pub paint: Paint<'a>,
    /// What it is lit by.
    pub light: Light,
    /// Which lines are drawn, and with what pen; `None` for fills alone.
    pub lines: Option<(Lines, Pen)>,
    /// How far, in pixels, the mesh may lie inside of the smooth surface that it stands for before it is made finer at silhouettes; `None` draws it as
    /// it is.
    pub round: Option<f64>,
    /// Exact coverage and 16 samples where colours meet; without, a pixel is what its centre sees.
    pub antialias: bool,
    /// Threads; 0 for one a processor.
    pub threads: usize,
}

/// What a render gives, each of the camera's size, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Render {
    /// RGBA, linear light, premultiplied.
    pub image: Vec<f32>,
    /// Depth along the camera's axis, scene units; 0 where there is nothing.
    pub depth: Vec<f32>,
    /// Number of the part, counted from 1; 0 where there is nothing.
    pub id: Vec<f32>,
}

/// Draws a surface as a camera sees it. Cost: O(triangles × bands + pixels touched + length of lines + triangles near them).
pub fn render(mut surface: Surface, camera: &Camera, mut style: Style<'_>) -> Render {
    if let Some(tolerance) = style.round {
        let between = refine(&mut surface, camera, tolerance);
        style.paint.extend(&between);
    }
    draw(&surface, camera, &style)
}

fn draw(surface: &Surface, camera: &Camera, style: &Style<'_>) -> Render {
    let [width, height] = camera.size;
    let n = width * height;
    let mut out = Render { image: vec![0.0; 4 * n], depth: vec![0.0; n], id: vec![0.0; n] };
    let projected = project(surface, camera);
    let area = Area::of(&projected, camera.size);
    if area.width == 0 || area.height == 0 {
        return out;
    }
    let near = fill(surface, camera, style, &projected, area, &mut out);
    if let Some((lines, pen)) = style.lines {
        let tints = &style.paint.vertex;
        let differ = |e: &Edge| {
            let [up, down] = e.sides.map(|h| surface.ends(h));
            let same = |a: u32, b: u32| tints.get(a as usize) == tints.get(b as usize);
            !(same(up[0], down[1]) && same(up[1], down[0]))
        };
        let depths = Depths { near: &near.0, reference: near.1, area };
        let see = || (Sight::new(surface, camera, depths), Hidden::new(surface, camera, &projected));
        let ends = || if lines.silhouettes { folds(surface, camera.toward()) } else { Vec::new() };
        let ((found, ends), sight) = both(style.threads, || (chains(surface, camera.toward(), lines, differ), ends()), see);
        let strokes = ink::strokes((&found, &ends), sight, camera, &pen, &style.light, style.threads);
        ink::lay(&strokes, pen.colour, width, &mut out.image, style.threads);
    }
    out
}

/// The part of each pixel that a surface covers, exactly: `width * height` numbers from 0 to 1.
pub fn coverage(surface: &Surface, camera: &Camera) -> Vec<f32> {
    let projected = project(surface, camera);
    let path = outline::path(&outline::outline(surface, &projected, camera), [0, 0]);
    super::paint::coverage(&path, super::paint::FillRule::NonZero, camera.size[0], camera.size[1])
}

/// Draws all but the lines; gives the nearness of each pixel of the area, if there are to be lines, and what was subtracted from it.
fn fill(surface: &Surface, camera: &Camera, style: &Style<'_>, projected: &Projected, area: Area, out: &mut Render) -> (Vec<f32>, f64) {
    let loops = if style.antialias { outline::outline(surface, projected, camera) } else { Vec::new() };
    let shader = shade::Shader {
        surface,
        projected,
        paint: &style.paint,
        light: &style.light,
        orthographic: camera.is_orthographic(),
        half: (style.light.direction + camera.world_from_camera().column(2).xyz().normalize()).normalize(),
    };
    let band = Band {
        shader,
        loops: &loops,
        area,
        reference: reference_of(projected),
        antialias: style.antialias,
        reaching: reaching(projected, area),
    };
    let mut near = vec![0.0; if style.lines.is_some() { area.width * area.height } else { 0 }];
    let mut nears = near.chunks_mut(ROWS * area.width);
    let width = camera.size[0];
    let first = area.origin[1] * width;
    let end = first + area.height * width;
    let jobs = out.image[4 * first..4 * end]
        .chunks_mut(4 * ROWS * width)
        .zip(out.depth[first..end].chunks_mut(ROWS * width).zip(out.id[first..end].chunks_mut(ROWS * width)))
        .enumerate();
    let jobs = jobs.map(|(i, (image, (depth, id)))| (i * ROWS, Out { near: nears.next(), image, depth, id, width })).collect();
    on_threads(jobs, style.threads, |state: &mut (Look, Recent), (top, out): (usize, Out<'_>)| band.draw(state, top, out));
    (near, band.reference)
}

/// Rows of a band: a few for each thread, so that all have something to do to the end.
fn rows_of(height: usize, threads: usize) -> usize {
    let count = thread_count(threads);
    if count == 1 { height.max(1) } else { height.div_ceil(4 * count).max(1) }
}

fn thread_count(threads: usize) -> usize {
    if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads }
}

/// Does two things, at once where there is more than one thread.
fn both<A: Send, B>(threads: usize, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B) -> (A, B) {
    if thread_count(threads) < 2 {
        return (a(), b());
    }
    std::thread::scope(|scope| {
        let a = scope.spawn(a);
        let b = b();
        (a.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), b)
    })
}

/// Does every job once, on up to `threads` threads, each of which has a state of its own.
fn on_threads<S: Default, J: Send>(jobs: Vec<J>, threads: usize, run: impl Fn(&mut S, J) + Sync) {
    let count = thread_count(threads).min(jobs.len());
    if count < 2 {
        let mut state = S::default();
        return jobs.into_iter().for_each(|job| run(&mut state, job));
    }
    let queue = Mutex::new(jobs.into_iter());
    let (queue, run) = (&queue, &run);
    std::thread::scope(|scope| {
        for _ in 0..count {
            scope.spawn(move || {
                let mut state = S::default();
                // A job that panicked leaves the queue as it was.
                while let Some(job) = { queue.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next() } {
                    run(&mut state, job);
                }
            });
        }
    });
}

#[cfg(test)]
mod tests;
