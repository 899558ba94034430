//! Drawn footage with known truth: cartoon scenes as vector data and functions of time.
//!
//! A scene is a painted ground and one cel over it, drawn in ink and flat colours, that moves by an affine map (and, if asked, between key
//! shapes). Every frame comes with its exact matte, outline, map and weights, so that a tracker, a matte or a fit can be measured. Design units
//! are those of a 640×360 frame; any size is drawn from the same data.
//!
//! **Source**: the examples of Bregler, Loeb, Chuang and Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, figures 3
//! (bouncing ball) and 6 and 10 (a dancing hat); the model of equations 1 and 2. Squash and stretch, anticipation and overlap after Thomas and
//! Johnston, *The Illusion of Life*, 1981. **Cost**: O(pixels) a frame; the ground is painted once.

mod art;
mod drawing;
mod grain;
mod ground;
mod motion;
mod noise;

use crate::algo::paint::{BezPath, FillRule, coverage, polygon};
use crate::algo::raster::{Affine, apply, compose, invert};
use drawing::Drawing;
pub(crate) use grain::add_grain;
use ground::Place;
use kurbo::Point;
use nalgebra::Vector2;

/// The longest side of a frame, in pixels.
pub const MAX_SIDE: usize = 16_384;

/// Which footage is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub enum SceneKind {
    /// A felt hat that dances on a stage: a loop of 48 frames.
    #[default]
    Hat,
    /// A ball that bounces along a lane and settles: 72 frames.
    Ball,
}

impl SceneKind {
    /// Frames until the action repeats (the hat) or rests (the ball), at 24 frames a second.
    pub fn frame_count(self) -> usize {
        match self {
            Self::Hat => 48,
            Self::Ball => 72,
        }
    }
}

/// Art that takes the cel's place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, pegbar_engine::Setting)]
pub enum Art {
    /// A witch's hat, registered to the hat.
    WitchHat,
    /// An iced ring, registered to the ball.
    Donut,
    /// An orange that looks photographed, registered to the ball.
    Orange,
}

/// What to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CelSpec {
    /// The footage.
    pub scene: SceneKind,
    /// Columns, 1 to [`MAX_SIDE`]; 640 by default.
    pub width: usize,
    /// Rows, 1 to [`MAX_SIDE`]; 360 by default.
    pub height: usize,
    /// Chooses the hand's wander, the ground's paint and the grain.
    pub seed: u64,
    /// Standard deviation of the film grain, in 1/255 of the display range, 0 or more; 2 by default.
    pub grain: f64,
    /// Film frames to a drawing: 1 is on ones, 2 on twos (the default). 0 is read as 1.
    pub hold: usize,
    /// How far the ink within the silhouette moves from drawing to drawing, in design units; 0.4 by default, 0 for an exactly affine drawing.
    pub boil: f64,
    /// Width of the outline in design units; 2.4 by default.
    pub line_width: f64,
    /// How far the hat bends between its three key shapes, 0 (the default: affine alone) to 1.
    pub deform: f64,
    /// Whether the cel drops a soft shadow on the ground; true by default.
    pub shadow: bool,
}

impl Default for CelSpec {
    fn default() -> Self {
        Self {
            scene: SceneKind::Hat,
            width: 640,
            height: 360,
            seed: 1,
            grain: 2.0,
            hold: 2,
            boil: 0.4,
            line_width: 2.4,
            deform: 0.0,
            shadow: true,
        }
    }
}

/// Why footage cannot be drawn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CelError {
    /// A frame without pixels or past the cap.
    #[error("expected a frame of 1 to {MAX_SIDE} pixels a side, found {width}x{height}")]
    Size {
        /// Columns asked for.
        width: usize,
        /// Rows asked for.
        height: usize,
    },
    /// A setting out of its range.
    #[error("expected {name} to be finite, at least 0 and at most {most}, found {found}")]
    Setting {
        /// The field of [`CelSpec`].
        name: &'static str,
        /// What was asked for.
        found: f64,
        /// The largest value that is drawn.
        most: f64,
    },
}

/// One frame with its truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Cel {
    /// RGBA, linear light, premultiplied, `width * height * 4` samples.
    pub image: Vec<f32>,
    /// Exact coverage of the cel, its ink included, `width * height` samples.
    pub matte: Vec<f32>,
    /// Frame from reference drawing, in pixels.
    pub motion: Affine,
    /// The cel's closed outline in pixels, the same count of points in each frame.
    pub contour: Vec<[f64; 2]>,
    /// Weights of the key shapes; they sum to 1. The first shape is the reference drawing.
    pub key_weights: Vec<f64>,
}

/// A scene that is ready to draw: its ground is painted.
#[derive(Clone, Debug)]
pub struct Scene {
    spec: CelSpec,
    drawing: Drawing,
    ground: Vec<f32>,
    frame_from_design: Affine,
    /// The reference drawing stands in the middle of the frame.
    reference_from_drawing: Affine,
    drawing_from_reference: Affine,
    scale: f64,
}

impl Scene {
    /// Paints the ground of `spec`. Cost: O(pixels), about ten frames' worth.
    ///
    /// # Errors
    /// [`CelError`] where a size or a setting is out of range.
    pub fn new(spec: CelSpec) -> Result<Self, CelError> {
        check(&spec)?;
        let (width, height) = (spec.width as f64, spec.height as f64);
        let scale = (width / 640.0).min(height / 360.0);
        let (x, y) = ((width - 640.0 * scale) / 2.0, (height - 360.0 * scale) / 2.0);
        let (place, drawing) = match spec.scene {
            SceneKind::Hat => (Place::Stage, art::hat(spec.line_width, spec.seed)),
            SceneKind::Ball => (Place::Meadow, art::ball(spec.line_width, spec.seed)),
        };
        let reference = Affine::new(scale, 0.0, width / 2.0, 0.0, scale, height / 2.0);
        let inverse = Affine::new(1.0 / scale, 0.0, -width / 2.0 / scale, 0.0, 1.0 / scale, -height / 2.0 / scale);
        Ok(Self {
            spec,
            drawing,
            ground: ground::paint_ground(place, spec.width, spec.height, scale, (x, y), spec.seed),
            frame_from_design: Affine::new(scale, 0.0, x, 0.0, scale, y),
            reference_from_drawing: reference,
            drawing_from_reference: invert(&reference).unwrap_or(inverse),
            scale,
        })
    }

    /// What is drawn.
    pub fn spec(&self) -> &CelSpec {
        &self.spec
    }

    /// The drawing that film frame `frame` shows: the same number for as long as it is held.
    pub fn drawing_of(&self, frame: usize) -> usize {
        frame / self.spec.hold.max(1)
    }

    /// The painted ground alone: RGBA, linear, opaque, without grain.
    pub fn ground(&self) -> &[f32] {
        &self.ground
    }

    /// The outline of the reference drawing in pixels.
    pub fn reference_contour(&self) -> Vec<[f64; 2]> {
        self.key_contour(0)
    }

    /// The outlines of the key shapes that [`Cel::key_weights`] weigh, in pixels of the reference drawing.
    pub fn key_contours(&self) -> Vec<Vec<[f64; 2]>> {
        (0..self.key_count()).map(|k| self.key_contour(k)).collect()
    }

    fn key_count(&self) -> usize {
        if self.spec.scene == SceneKind::Hat && self.spec.deform > 0.0 { 3 } else { 1 }
    }

    fn key_contour(&self, k: usize) -> Vec<[f64; 2]> {
        pairs(&self.drawing.contour(|p| map(&self.reference_from_drawing, motion::hat_key(k, p))))
    }

    /// The reference drawing alone, RGBA on a transparent ground in the middle of the frame, with its matte.
    pub fn reference(&self) -> (Vec<f32>, Vec<f32>) {
        self.drawing.draw(self.spec.width, self.spec.height, self.scale, (0.0, 0), |p| map(&self.reference_from_drawing, p))
    }

    /// Film frame `frame`: ground, shadow, cel and grain.
    pub fn render(&self, frame: usize) -> Cel {
        let layer = self.layer(frame);
        let mut image = self.ground.clone();
        if self.spec.shadow {
            self.drop_shadow(&mut image, &self.pose(frame));
        }
        for (below, above) in image.chunks_exact_mut(4).zip(layer.image.chunks_exact(4)) {
            let keep = 1.0 - above[3];
            below.iter_mut().zip(above).for_each(|(b, a)| *b = a + *b * keep);
        }
        grain::add_grain(&mut image, self.spec.width, self.spec.grain, self.spec.seed, frame as u64);
        Cel { image, ..layer }
    }

    /// The cel of film frame `frame` alone, on a transparent ground, without grain.
    pub fn layer(&self, frame: usize) -> Cel {
        let pose = self.pose(frame);
        let (motion, shape) = (compose(&self.frame_from_design, &pose.affine), |p| bend(&pose.keys, p));
        let boil = (self.spec.boil, noise::mix(self.spec.seed ^ ((self.drawing_of(frame) as u64) << 20)));
        let (image, matte) = self.drawing.draw(self.spec.width, self.spec.height, self.scale, boil, |p| map(&motion, shape(p)));
        Cel {
            image,
            matte,
            motion: compose(&motion, &self.drawing_from_reference),
            contour: pairs(&self.drawing.contour(|p| map(&motion, shape(p)))),
            key_weights: pose.keys[..self.key_count()].to_vec(),
        }
    }

    /// Replacement art, RGBA on a transparent ground, registered with [`Scene::reference`].
    pub fn art(&self, art: Art) -> Vec<f32> {
        let spec = &self.spec;
        let drawing = match art {
            Art::WitchHat => art::witch_hat(spec.line_width, spec.seed),
            Art::Donut => art::donut(spec.line_width, spec.seed),
            Art::Orange => return art::orange(spec.width, spec.height, self.scale, spec.seed),
        };
        drawing.draw(spec.width, spec.height, self.scale, (0.0, 0), |p| map(&self.reference_from_drawing, p)).0
    }

    fn pose(&self, frame: usize) -> motion::Pose {
        let time = (self.drawing_of(frame) * self.spec.hold.max(1)) as f64;
        match self.spec.scene {
            SceneKind::Hat => motion::hat(time, self.spec.deform),
            SceneKind::Ball => motion::ball(time),
        }
    }

    /// Darkens the ground beneath the cel: the nearer, the smaller and deeper.
    fn drop_shadow(&self, image: &mut [f32], pose: &motion::Pose) {
        let (floor, half, depth) = match self.spec.scene {
            SceneKind::Hat => (298.0, 92.0, 0.62),
            SceneKind::Ball => (307.0, 40.0, 0.62),
        };
        let near = 1.0 / (1.0 + pose.lift / 60.0);
        let (rx, ry) = (half * (1.35 - 0.35 * near), half * 0.15 * (1.5 - 0.5 * near));
        let dark = art::shadow_colour();
        let to_design = |i: usize, o: f64| (i as f64 + 0.5 - o) / self.scale;
        for (j, row) in image.chunks_exact_mut(self.spec.width * 4).enumerate() {
            let dy = (to_design(j, self.frame_from_design[(1, 2)]) - floor) / ry;
            if dy.abs() > 2.2 {
                continue;
            }
            for (i, pixel) in row.chunks_exact_mut(4).enumerate() {
                let dx = (to_design(i, self.frame_from_design[(0, 2)]) - pose.shadow_x) / rx;
                let alpha = (depth * (0.35 + 0.65 * near) * (1.0 - noise::smoothstep(0.25, 1.6, (dx * dx + dy * dy).sqrt()))) as f32;
                pixel.iter_mut().zip(dark).for_each(|(v, d)| *v += (d - *v) * alpha);
            }
        }
    }
}

/// Exact coverage of a closed outline: what [`Cel::matte`] is to [`Cel::contour`].
pub fn contour_coverage(contour: &[[f64; 2]], width: usize, height: usize) -> Vec<f32> {
    let points: Vec<Point> = contour.iter().map(|p| Point::new(p[0], p[1])).collect();
    let path: BezPath = polygon(&points);
    coverage(&path, FillRule::EvenOdd, width, height)
}

fn check(spec: &CelSpec) -> Result<(), CelError> {
    let sides = 1..=MAX_SIDE;
    if !(sides.contains(&spec.width) && sides.contains(&spec.height)) {
        return Err(CelError::Size { width: spec.width, height: spec.height });
    }
    for (name, found, most) in
        [("grain", spec.grain, 255.0), ("boil", spec.boil, 20.0), ("line_width", spec.line_width, 40.0), ("deform", spec.deform, 1.0)]
    {
        if !(0.0..=most).contains(&found) {
            return Err(CelError::Setting { name, found, most });
        }
    }
    Ok(())
}

fn map(m: &Affine, p: Point) -> Point {
    let q = apply(m, Vector2::new(p.x, p.y));
    Point::new(q.x, q.y)
}

/// The point of the drawing among its key shapes.
fn bend(keys: &[f64; 3], p: Point) -> Point {
    if keys[0] == 1.0 {
        return p;
    }
    (0..3).fold(Point::ZERO, |sum, k| sum + motion::hat_key(k, p).to_vec2() * keys[k])
}

fn pairs(points: &[Point]) -> Vec<[f64; 2]> {
    points.iter().map(|p| [p.x, p.y]).collect()
}

#[cfg(test)]
mod tests;
