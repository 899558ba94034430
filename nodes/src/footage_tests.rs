//! Drawn footage from files, matted and tracked by graphs. The pictures are other people's and are not part of the project: where the folder
//! `shared/data/cartoons` does not lie next to the project, and `PEGBAR_CARTOONS` names no other, these tests say so and pass.

use std::path::PathBuf;
use std::sync::Arc;

use nalgebra::Vector2;
use pegbar_engine::check::{LoadOptions, load_text};
use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::Port;
use pegbar_engine::value::{Curve, Value, downcast};

use crate::algo::raster::{Affine, apply};
use crate::data::{Affine2, Matte};

/// Left, top, right, bottom.
type Region = [f64; 4];

/// A clip: the files, how many, the key, and the part that is followed; the whole key where there is no box.
struct Clip {
    files: &'static str,
    frames: i64,
    key: &'static str,
    part: Option<Region>,
}

/// The key and the motion of each frame, and in how many of them the track converged.
struct Tracked {
    keys: Vec<Arc<Matte>>,
    motions: Vec<Arc<Affine2>>,
    converged: usize,
}

pub(crate) fn folder() -> Option<PathBuf> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/cartoons"));
    let found = std::env::var_os("PEGBAR_CARTOONS").map_or(beside, PathBuf::from);
    found.is_dir().then_some(found)
}

fn tracked(clip: &Clip) -> Option<Tracked> {
    let Some(folder) = folder() else {
        eprintln!("skipped: no folder of cartoons; PEGBAR_CARTOONS may name one");
        return None;
    };
    let region = match clip.part {
        Some([l, t, r, b]) => format!("region: ({l}, {t}, {r}, {b})"),
        None => "matte: \"@key\"".to_owned(),
    };
    let text = format!(
        "Graph(pegbar: 1, frames: (first: 1, last: {}, fps: 12), nodes: {{
            \"plate\": (type: \"io.read_images\", path: \"{}\"),
            \"key\": ({}, image: \"@plate\"),
            \"track\": (type: \"track.affine\", image: \"@plate\", {region}),
        }})",
        clip.frames,
        folder.join(clip.files).display(),
        clip.key
    );
    let loaded = load_text(&folder.join("test.ron"), &text, &crate::registry(), &LoadOptions::default());
    let graph = loaded.graph.unwrap_or_else(|| panic!("{:#?}", loaded.diagnostics));
    let port = |node, output| Port { node: graph.find(node).unwrap(), output };
    let ports = [port("key", 0), port("track", 0), port("track", 3)];
    let mut report = execute(&graph, &[], &ports, &Options::default()).unwrap();
    assert!(report.failures.is_empty(), "{:#?}", report.failures);
    let [keys, motions, converged] = ports.map(|p| report.kept.remove(&p).unwrap().into_iter().map(Option::unwrap));
    fn all<T: Value>(values: impl Iterator<Item = pegbar_engine::value::ValueRef>) -> Vec<Arc<T>> {
        values.map(|v| downcast(v).unwrap()).collect()
    }
    let converged = all::<Curve>(converged).iter().filter(|c| c.value == 1.0).count();
    Some(Tracked { keys: all(keys), motions: all(motions), converged })
}

fn is_layer(matte: &Matte, x: f64, y: f64) -> bool {
    let inside = x >= 0.0 && y >= 0.0 && x < matte.width() as f64 && y < matte.height() as f64;
    inside && matte.alpha()[y as usize * matte.width() + x as usize] > 0.5
}

/// Of the pixels of the part that either drawing covers, the share that both cover once the motion is taken out.
fn agreement(reference: &Matte, key: &Matte, motion: &Affine2, part: Option<Region>) -> f64 {
    let (w, h) = (reference.width() as f64, reference.height() as f64);
    let [left, top, right, bottom] = part.unwrap_or([0.0, 0.0, w, h]);
    let (mut both, mut either) = (0.0, 0.0f64);
    for y in top as usize..bottom as usize {
        for x in left as usize..right as usize {
            let at = Vector2::new(x as f64 + 0.5, y as f64 + 0.5);
            let to = apply(&Affine::from(motion), at);
            let (a, b) = (is_layer(reference, at.x, at.y), is_layer(key, to.x, to.y));
            both += f64::from(u8::from(a && b));
            either += f64::from(u8::from(a || b));
        }
    }
    both / either.max(1.0)
}

fn turn(m: &Affine2) -> f64 {
    let [[a, b, _], [c, d, _]] = m.matrix;
    libm::atan2(c - b, a + d).to_degrees()
}

/// Asserts that at least `converged` frames converge, that the part covers what it did by `agree` or more, and that it turns by no more than `turned` degrees.
fn sticks(clip: &Clip, converged: usize, agree: f64, turned: f64) {
    let Some(found) = tracked(clip) else { return };
    assert!(found.converged >= converged, "{} of {} frames converged", found.converged, clip.frames);
    for (k, (key, motion)) in found.keys.iter().zip(&found.motions).enumerate() {
        let share = agreement(&found.keys[0], key, motion, clip.part);
        assert!(share >= agree, "frame {} agrees by {share}: {motion:?}", k + 1);
        assert!(turn(motion).abs() <= turned, "frame {} turned by {} degrees", k + 1, turn(motion));
    }
}

const ALPHA: &str = "type: \"matte.from_image\", channel: alpha";
const BRIGHT: &str = "type: \"matte.from_image\", channel: luma, threshold: 0.8, softness: 0.2";

#[test]
fn a_bouncing_ball_squashes_and_never_turns() {
    let key = "type: \"matte.color_clusters\", foreground: [(0.93, 0.11, 0.14)], ink: 0, mix: display";
    let ball = Clip { files: "bouncing_ball/ball.####.png", frames: 6, key, part: None };
    sticks(&ball, 6, 0.85, 2.0);
    let Some(found) = tracked(&ball) else { return };
    let [[wide, ..], [_, high, _]] = found.motions[5].matrix;
    assert!(wide > 1.2 && high < 0.85, "the last drawing is squashed, found {wide} by {high}");
}

#[test]
fn the_head_of_a_drawn_horse_is_followed() {
    let part = Some([235.0, 34.0, 284.0, 85.0]);
    sticks(&Clip { files: "horse_rotoscope/horse.####.png", frames: 12, key: BRIGHT, part }, 11, 0.8, 15.0);
}

#[test]
fn the_skirt_of_a_dancer_in_ink_is_followed() {
    let part = Some([306.0, 276.0, 415.0, 374.0]);
    let key = "type: \"matte.from_image\", invert: true";
    let doll = Clip { files: "doll_dance/doll.####.png", frames: 20, key, part };
    let Some(found) = tracked(&doll) else { return };
    assert!(found.converged >= 18, "{} of 20 frames converged", found.converged);
    assert!(found.motions.iter().all(|m| turn(m).abs() < 15.0));
}

#[test]
fn heads_of_transparent_sprites_are_followed() {
    let head = |files, frames, part| Clip { files, frames, key: ALPHA, part: Some(part) };
    sticks(&head("dog_walk/dog.####.png", 10, [28.0, 2.0, 108.0, 84.0]), 9, 0.85, 6.0);
    sticks(&head("dog_jump/dog.####.png", 8, [38.0, 5.0, 118.0, 90.0]), 6, 0.85, 8.0);
    sticks(&head("kenney_female_adventurer_walk/female_adventurer.####.png", 8, [22.0, 31.0, 76.0, 86.0]), 7, 0.85, 6.0);
    sticks(&head("supertux_walk/tux.####.png", 8, [22.0, 10.0, 53.0, 38.0]), 7, 0.9, 3.0);
    sticks(&head("grant_run/grant.####.png", 26, [63.0, 70.0, 141.0, 152.0]), 24, 0.75, 3.0);
}
