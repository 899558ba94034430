//! `keys.draw`: key drawings, and what lies between them, as key pictures.
//!
//! **Method** each point of each path goes straight from key to key, as `retarget.drawings` with `linear` takes it, and what comes of it is painted as
//! `render.drawings` does. Paths pass in front of and behind each other as they are layered, so that an arm that crosses the body is one arm: no mesh
//! around the whole figure could do that.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, sections 3.1.3 and 3.3.
//!
//! **Fails when** the order names a key that is not there; points or colours are not finite; the pictures are too large.
//!
//! **Cost** O(pixels) a picture.
//!
//! ```ron
//! "all": (type: "keys.draw", keys: "@bear", count: 5),
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{Context, Fault, In, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::inbetween::{pair, step_name};
use crate::algo::arap::Options as ArapOptions;
use crate::algo::key_blend::{Interpolation, KeyBlend, Options};
use crate::algo::window::Window;
use crate::data::{KeyDrawings, KeyImages, KeyShapes, LARGEST};
use crate::render::{Pen, blank};

/// Key drawings, and what lies between them, as key pictures.
///
/// The keys come first, then `count` drawings for each pair at even steps. What is drawn in layers is in-betweened in layers: an arm passes in
/// front of the body.
#[derive(Node)]
#[node(
    id = "keys.draw",
    version = 1,
    outputs = KeysDrawOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, sections 3.1.3 and 3.3",
    example = "\"all\": (type: \"keys.draw\", keys: \"@bear\", count: 5)"
)]
pub(crate) struct KeysDraw {
    /// The key drawings.
    keys: In<KeyDrawings>,
    /// In-betweens of each pair. 0 leaves the keys as they are.
    #[input(default = 5, range = 0..=1000)]
    count: u32,
    /// The keys, from 1, in an order in which the character goes through them: `[1, 3, 2]` has in-betweens of 1 and 3, and of 3 and 2, and not of 1
    /// and 2. All pairs where there is none.
    #[input(default = [])]
    order: Vec<i64>,
    /// Width and height. The drawing's own, in whole pixels, where it is left out.
    #[input(default = None, range = 1..=65536, unit = "px")]
    size: Option<[i64; 2]>,
}

/// Keys and in-betweens.
#[derive(Outputs)]
pub(crate) struct KeysDrawOutputs {
    /// The keys, then the in-betweens: linear light, premultiplied.
    images: KeyImages,
    /// All points of all paths of each, in the order of the drawing, pixels: what weights are solved for, not one line to look at.
    keys: KeyShapes,
}

impl KeysDraw {
    /// The pairs from 0.
    fn pairs(&self) -> Result<Vec<(usize, usize)>, NodeError> {
        let k = self.keys.len();
        if self.order.is_empty() {
            return Ok((0..k).flat_map(|i| (i + 1..k).map(move |j| (i, j))).collect());
        }
        let known = |v: i64| usize::try_from(v).ok().filter(|v| (1..=k).contains(v)).map(|v| v - 1);
        let mut pairs = Vec::new();
        for step in self.order.windows(2) {
            let (Some(i), Some(j)) = (known(step[0]), known(step[1])) else {
                let found = format!("expected an `order` of keys from 1 to {k}, found {} then {}", step[0], step[1]);
                return Err(NodeError::new(Fault::Parameters, found));
            };
            let pair = (i.min(j), i.max(j));
            if i != j && !pairs.contains(&pair) {
                pairs.push(pair);
            }
        }
        Ok(pairs)
    }

    /// Weights of the keys in each picture, and its name.
    fn rows(&self) -> Result<Vec<(Vec<f64>, String)>, NodeError> {
        let k = self.keys.len();
        let name = |i: usize| self.keys.keys.get(i).cloned().unwrap_or_else(|| (i + 1).to_string());
        let mut rows: Vec<_> = (0..k).map(|i| (pair(k, i, i, 0.0), name(i))).collect();
        for (i, j) in self.pairs()? {
            for m in 1..=self.count {
                let t = f64::from(m) / f64::from(self.count + 1);
                rows.push((pair(k, i, j, t), step_name(&name(i), &name(j), t)));
            }
        }
        Ok(rows)
    }

    fn window(&self) -> Result<Window, NodeError> {
        let [w, h] = self.size.unwrap_or_else(|| self.keys.size.map(|v| libm::round(v) as i64));
        if (1..=65536).contains(&w) && (1..=65536).contains(&h) {
            return Ok(Window::from_bounds(0, 0, w, h));
        }
        Err(NodeError::new(Fault::Parameters, format!("expected a size from 1 to 65536 pixels a side, found {w} x {h}")))
    }
}

impl PerFrame for KeysDraw {
    fn run(self, cx: &Context) -> Result<KeysDrawOutputs, NodeError> {
        let refused = |e: &dyn std::fmt::Display| NodeError::input(e.to_string());
        let keys: Vec<&[[f64; 2]]> = (0..self.keys.len()).map(|k| self.keys.key(k)).collect();
        let options = Options { interpolation: Interpolation::Linear, count: 0, closed: false, mesh: false, arap: ArapOptions::default() };
        let blend = KeyBlend::new(&keys, options).map_err(|e| refused(&e))?;
        let (rows, window) = (self.rows()?, self.window()?);
        let samples = window.samples(4).and_then(|s| s.checked_mul(rows.len())).filter(|s| *s <= LARGEST);
        let samples = samples.ok_or_else(|| {
            let found = format!("found {} of {} x {}", rows.len(), window.width, window.height);
            NodeError::new(Fault::Limit, format!("expected pictures of at most 16 GiB in all, {found}"))
        })?;
        let (mut pixels, mut points) = (Vec::with_capacity(samples), Vec::new());
        for (weights, _) in &rows {
            cx.check()?;
            let drawing = self.keys.drawing(blend.blend(weights).map_err(|e| refused(&e))?);
            let mut picture = blank(window)?;
            Pen::default().draw(&drawing, &mut picture, window)?;
            pixels.append(&mut picture);
            points.push(drawing.points);
        }
        let names: Vec<String> = rows.into_iter().map(|(_, name)| name).collect();
        let pixels = NdArray::new([names.len(), window.height, window.width, 4], pixels);
        let pixels = pixels.ok_or_else(|| NodeError::internal("pictures of another size"))?;
        Ok(KeysDrawOutputs { images: KeyImages { pixels, names: names.clone() }, keys: super::key_shapes(&points, names, false)? })
    }
}

#[cfg(test)]
mod tests;
