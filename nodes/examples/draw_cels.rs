//! Draws the type specimen to the folder that is named, to look at.
use pegbar_nodes::algo::paint::{Canvas, FillRule, hex, srgb_from_linear, text_outline};

fn main() {
    let folder = std::env::args().nth(1).unwrap_or_else(|| ".".into());
    let (w, h) = (1100, 420);
    let mut data = vec![1.0f32; w * h * 4];
    if let Ok(mut canvas) = Canvas::new(&mut data, w, h) {
        let lines = "ABCDEFGHIJKLMNOPQRSTUVWXYZ 0123456789\nabcdefghijklmnopqrstuvwxyz -1.25e-3 °±²µ×Δθσ−\n!\"#$%&'()*+,-./:;<=>?@[\\]^_`{|}~\nThe quick brown fox jumps over the lazy dog.\nRMS error (px), 24 fps, frame 48";
        for (i, line) in lines.lines().enumerate() {
            let outline = kurbo::Affine::translate((20.0, 50.0 + 60.0 * i as f64)) * text_outline(line, 28.0, 2.6);
            canvas.fill(&outline, FillRule::NonZero, hex(0x202020));
            let outline = kurbo::Affine::translate((20.0, 350.0 + 13.0 * i as f64)) * text_outline(line, 8.0, 1.1);
            canvas.fill(&outline, FillRule::NonZero, hex(0x202020));
        }
    }
    let bytes: Vec<u8> = data.iter().map(|v| (srgb_from_linear(v.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8).collect();
    if let Some(picture) = image::RgbaImage::from_raw(w as u32, h as u32, bytes) {
        let _ = picture.save(format!("{folder}/cel_font.png"));
    }
}
