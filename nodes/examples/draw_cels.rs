//! Draws contact sheets of the cartoon scenes, the replacement art and the lettering into the folder that is named, to look at.
use pegbar_nodes::algo::cel::{Art, CelSpec, Scene, SceneKind};
use pegbar_nodes::algo::color::srgb_u8_from_linear;
use pegbar_nodes::algo::paint::{Canvas, FillRule, hex, text_outline};
use std::time::Instant;

fn save(path: &str, data: &[f32], width: usize) -> Result<(), Box<dyn std::error::Error>> {
    let bytes: Vec<u8> = data.iter().map(|v| srgb_u8_from_linear(*v)).collect();
    let height = data.len() / 4 / width;
    image::RgbaImage::from_raw(width as u32, height as u32, bytes).ok_or("expected whole rows")?.save(path)?;
    Ok(())
}

/// Every `step`th frame, each small, in a grid.
fn sheet(kind: SceneKind, folder: &str, name: &str) -> Result<(), Box<dyn std::error::Error>> {
    let (w, h, columns) = (320, 180, 4);
    let scene = Scene::new(CelSpec { scene: kind, width: w, height: h, ..CelSpec::default() })?;
    let frames: Vec<usize> = (0..kind.frame_count()).step_by(2).collect();
    let rows = frames.len().div_ceil(columns);
    let mut out = vec![1.0; w * columns * h * rows * 4];
    for (k, frame) in frames.into_iter().enumerate() {
        let image = scene.render(frame).image;
        for (y, row) in image.chunks_exact(w * 4).enumerate() {
            let start = ((k / columns * h + y) * columns + k % columns) * w * 4;
            out[start..start + w * 4].copy_from_slice(row);
        }
    }
    save(&format!("{folder}/cel_{name}_sheet.png"), &out, w * columns)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    for (kind, name, frame) in [(SceneKind::Hat, "hat", 26), (SceneKind::Ball, "ball", 24)] {
        let start = Instant::now();
        let scene = Scene::new(CelSpec { scene: kind, ..CelSpec::default() })?;
        let painted = start.elapsed();
        let image = scene.render(frame).image;
        println!("{name}: ground {painted:?}, frame {:?}", start.elapsed() - painted);
        save(&format!("{folder}/cel_{name}.png"), &image, 640)?;
        sheet(kind, &folder, name)?;
    }
    let w = 1280;
    for (kind, art, name) in [
        (SceneKind::Hat, None, "hat"),
        (SceneKind::Hat, Some(Art::WitchHat), "witch"),
        (SceneKind::Ball, None, "ball"),
        (SceneKind::Ball, Some(Art::Donut), "donut"),
        (SceneKind::Ball, Some(Art::Orange), "orange"),
    ] {
        let scene = Scene::new(CelSpec { scene: kind, width: w, height: 720, line_width: 2.4, ..CelSpec::default() })?;
        let mut image = art.map_or_else(|| scene.reference().0, |a| scene.art(a));
        for pixel in image.chunks_exact_mut(4) {
            let keep = 1.0 - pixel[3];
            pixel.iter_mut().for_each(|v| *v += 0.8 * keep);
            pixel[3] = 1.0;
        }
        save(&format!("{folder}/cel_art_{name}.png"), &image, w)?;
    }
    lettering(&folder)
}

fn lettering(folder: &str) -> Result<(), Box<dyn std::error::Error>> {
    let (w, h) = (1100, 420);
    let mut data = vec![1.0f32; w * h * 4];
    let mut canvas = Canvas::new(&mut data, w, h)?;
    let lines = "ABCDEFGHIJKLMNOPQRSTUVWXYZ 0123456789\nabcdefghijklmnopqrstuvwxyz -1.25e-3 °±²µ×Δθσ−\n!\"#$%&'()*+,-./:;<=>?@[\\]^_`{|}~\nRMS error (px), 24 fps, frame 48";
    for (i, line) in lines.lines().enumerate() {
        for (size, weight, y) in [(28.0, 2.6, 50.0 + 60.0 * i as f64), (8.0, 1.1, 350.0 + 13.0 * i as f64)] {
            let outline = kurbo::Affine::translate((20.0, y)) * text_outline(line, size, weight);
            canvas.fill(&outline, FillRule::NonZero, hex(0x202020));
        }
    }
    save(&format!("{folder}/cel_font.png"), &data, w)
}
