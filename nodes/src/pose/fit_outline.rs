//! What `pose.fit` sees of figure and drawing: outlines, and the search for the pose in which they are one.

use std::f64::consts::PI;

use nalgebra::{DVector, Matrix4, Vector2, Vector3};
use pegbar_engine::node::{Context, NodeError};

use crate::algo::camera::Camera;
use crate::algo::curve_trace::InkStyle;
use crate::algo::mesh_lines::distance;
use crate::algo::outline::{Piece, outline};
use crate::algo::pose_fit::{Bound, Figure, Goal, Priors, Rim, apart, improve, outline_goals};
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::algo::skin::Skin;
use crate::algo::surface::{Part, Surface};
use crate::algo::trace::trace;
use crate::curve::ink_of;
use crate::data::{Image, SkinnedMesh};

/// Outlines are looked at in pieces of this length, pixels.
const STEP: f64 = 2.0;

/// An outline counts as much as so many markers.
const WORTH: f64 = 20.0;

/// Outlines are that near at the end, pixels.
const NEAR: f64 = 4.0;
/// Steps that are smaller, in radians and logarithms, change nothing that is seen.
const STILL: f64 = 1e-5;
/// Outlines that are that near on the mean are one: nothing better is looked for out of the picture's plane, pixels.
const ONE: f64 = 0.1;
/// Rounds in which the roots are moved alone.
const ALIGN: u32 = 5;
/// Joints are swung by multiples of this angle.
const SWING: f64 = PI / 12.0;
/// So many each way.
const SWINGS: i32 = 5;

/// The surface that the joints move.
pub(super) struct Body {
    skin: Skin,
    inverse_bind: Vec<Matrix4<f64>>,
    /// At rest: for its edges.
    surface: Surface,
    bound: Vec<Bound>,
}

impl Body {
    pub(super) fn new(mesh: &SkinnedMesh, n: usize) -> Result<Self, NodeError> {
        let refused = |e: String| NodeError::input(format!("mesh: {e}"));
        mesh.validate().map_err(refused)?;
        if mesh.n_joints() != n {
            return Err(refused(format!("expected {n} joints as in the skeleton, found {}", mesh.n_joints())));
        }
        let influences = mesh.joints.shape()[1];
        let (joints, weights) = (mesh.joints.data(), mesh.weights.data());
        let skin = Skin::new(&mesh.positions, &[], influences, joints, weights, n).map_err(refused)?;
        let inverse_bind = mesh.inverse_bind();
        let bound = |v: usize| -> Bound {
            let range = v * influences..(v + 1) * influences;
            let sum: f64 = weights[range.clone()].iter().sum();
            let p = Vector3::from(mesh.positions[v]);
            let own = joints[range.clone()].iter().zip(&weights[range]).filter(|(_, w)| **w != 0.0 && sum > 0.0);
            own.map(|(&j, w)| (j as usize, w / sum, (inverse_bind[j as usize] * p.push(1.0)).xyz())).collect()
        };
        let bound = (0..mesh.positions.len()).map(bound).collect();
        let part = Part { positions: &mesh.positions, triangles: &mesh.triangles, normals: &[] };
        let surface = Surface::new(&[part], PI).map_err(|e| refused(e.to_string()))?;
        Ok(Self { skin, inverse_bind, surface, bound })
    }

    /// Where vertices are.
    fn positions(&self, world: &[Matrix4<f64>]) -> Result<Vec<[f64; 3]>, NodeError> {
        let motions: Vec<Matrix4<f64>> = world.iter().zip(&self.inverse_bind).map(|(w, b)| w * b).collect();
        Ok(self.skin.pose(&motions, false).map_err(|e| NodeError::input(format!("pose: {e}")))?.0)
    }

    /// The outermost outline as it is seen, with the points that it is made of.
    fn outline(&self, world: &[Matrix4<f64>], camera: &Camera) -> Result<Vec<(Bound, Rim)>, NodeError> {
        let bound = |p: &Piece| {
            let of = |v: u32, share: f64| self.bound[v as usize].iter().map(move |(j, w, q)| (*j, w * share, *q));
            // What hangs on no joint stays: it is outline, and nothing can be wanted of it.
            let held = p.ends.iter().all(|v| !self.bound[*v as usize].is_empty());
            let point: Bound = of(p.ends[0], 1.0 - p.share).chain(of(p.ends[1], p.share)).filter(|_| held).collect();
            (point, Rim { at: p.at, out: p.out, length: p.length })
        };
        Ok(outline(&self.surface, &self.positions(world)?, camera, STEP).iter().map(bound).collect())
    }

    /// How far what hangs on a joint is seen to reach from it, pixels.
    fn span(&self, world: &[Matrix4<f64>], camera: &Camera, joint: usize, below: &[usize]) -> Result<f64, NodeError> {
        let positions = self.positions(world)?;
        let at = |p: [f64; 3]| Vector2::from_fn(|k, _| camera.project(p)[k]);
        let middle = at(world[joint].column(3).xyz().into());
        let mut own = vec![false; world.len()];
        below.iter().for_each(|j| own[*j] = true);
        let hangs = |bound: &Bound| bound.iter().filter(|(j, ..)| own[*j]).map(|b| b.1).sum::<f64>() > 0.5;
        let far = self.bound.iter().zip(positions).filter(|(b, _)| hangs(b)).map(|(_, p)| (at(p) - middle).norm());
        Ok(far.filter(|d| d.is_finite()).fold(0.0, f64::max))
    }
}

/// The outline of a drawing: of its alpha where something is transparent, else of all that ink goes around.
pub(super) fn drawn_outline(image: &Image, threshold: f64) -> Result<Vec<Rim>, NodeError> {
    let window = image.display_window();
    let rgba = crate::render::rgba(image, window)?;
    let alpha: Vec<f32> = rgba.as_chunks::<4>().0.iter().map(|p| p[3]).collect();
    let (width, height) = (window.width, window.height);
    let clear = alpha.iter().any(|a| *a < 0.5);
    let mask = if clear {
        alpha
    } else {
        filled(&ink_of(image, &InkStyle { ink: None, paper: None, threshold })?.amount, width, height, threshold)
    };
    let outlines = trace(&mask, width, height, 0.5).map_err(|e| NodeError::input(format!("drawing: {e}")))?;
    let [w, h] = [width, height].map(|n| n as f64);
    let mut out = Vec::new();
    for o in outlines.iter().filter(|o| o.area.abs() > 16.0) {
        let line = Closed::new(&o.points);
        let count = (line.length() / STEP).round().max(3.0);
        let length = line.length() / count;
        for k in 0..count as usize {
            let s = (k as f64 + 0.5) * length;
            let [p, a, b] = [s, s - STEP, s + STEP].map(|s| line.at(s));
            // Where the figure leaves the picture there is no outline.
            let inside = p.x > 1.0 && p.y > 1.0 && p.x < w - 1.0 && p.y < h - 1.0;
            // Layers lie to the right of their outlines on the screen, so that their outside is to the left.
            if let Some(out_of) = Vector2::new(b.y - a.y, a.x - b.x).try_normalize(1e-9).filter(|_| inside) {
                out.push(Rim { at: p + Vector2::new(window.x as f64, window.y as f64), out: out_of, length });
            }
        }
    }
    Ok(out)
}

/// A closed line by its length.
struct Closed<'a> {
    points: &'a [[f64; 2]],
    /// Length up to the end of each side.
    ends: Vec<f64>,
}

impl<'a> Closed<'a> {
    fn new(points: &'a [[f64; 2]]) -> Self {
        let n = points.len();
        let sides = (0..n).map(|i| distance(points[i], points[(i + 1) % n]));
        let ends = sides.scan(0.0, |sum, d| {
            *sum += d;
            Some(*sum)
        });
        Self { points, ends: ends.collect() }
    }

    fn length(&self) -> f64 {
        self.ends.last().copied().unwrap_or(0.0)
    }

    /// The place at a length, which goes around.
    fn at(&self, s: f64) -> Vector2<f64> {
        let s = s.rem_euclid(self.length().max(f64::MIN_POSITIVE));
        let i = self.ends.partition_point(|e| *e < s).min(self.points.len() - 1);
        let start = if i == 0 { 0.0 } else { self.ends[i - 1] };
        let (a, b) = (Vector2::from(self.points[i]), Vector2::from(self.points[(i + 1) % self.points.len()]));
        a + (b - a) * ((s - start) / (self.ends[i] - start).max(f64::MIN_POSITIVE)).min(1.0)
    }
}

/// Ink and all that no way from the border leads to.
fn filled(ink: &[f32], width: usize, height: usize, threshold: f64) -> Vec<f32> {
    let is_paper = |i: usize| f64::from(ink[i]) < threshold;
    let mut outside = vec![false; ink.len()];
    let border = (0..width).flat_map(|x| [x, (height.saturating_sub(1)) * width + x]);
    let border = border.chain((0..height).flat_map(|y| [y * width, y * width + width.saturating_sub(1)]));
    let mut open: Vec<usize> = border.filter(|&i| i < ink.len() && is_paper(i)).collect();
    open.iter().for_each(|&i| outside[i] = true);
    while let Some(i) = open.pop() {
        let (x, y) = (i % width, i / width);
        let next =
            [(x > 0).then(|| i - 1), (x + 1 < width).then(|| i + 1), (y > 0).then(|| i - width), (y + 1 < height).then(|| i + width)];
        for n in next.into_iter().flatten() {
            if !outside[n] && is_paper(n) {
                outside[n] = true;
                open.push(n);
            }
        }
    }
    ink.iter().zip(outside).map(|(v, out)| if out { *v } else { 1.0 }).collect()
}

/// The best unknowns so far, with the errors of markers and outline.
pub(super) struct Best {
    pub(super) score: f64,
    pub(super) x: DVector<f64>,
    pub(super) errors: [f64; 2],
}

impl Best {
    pub(super) fn new(x: DVector<f64>) -> Self {
        Self { score: f64::INFINITY, x, errors: [f64::NAN; 2] }
    }

    fn offer(&mut self, score: f64, x: &DVector<f64>, errors: [f64; 2]) {
        // Not that of an outline that is not there, which is NaN.
        if score < self.score {
            *self = Self { score, x: x.clone(), errors };
        }
    }
}

/// The search for a pose in which the outlines are one.
pub(super) struct Search<'a> {
    pub(super) cx: &'a Context<'a>,
    pub(super) figure: &'a Figure,
    pub(super) parents: &'a [i64],
    pub(super) camera: &'a Camera,
    pub(super) body: &'a Body,
    pub(super) drawn: &'a [Rim],
    pub(super) markers: &'a [Goal],
    pub(super) marker_error: &'a dyn Fn(&DVector<f64>) -> f64,
    pub(super) priors: Priors,
    /// Of markers and outline.
    pub(super) weights: [f64; 2],
    pub(super) reach: f64,
    pub(super) rounds: u32,
    pub(super) best: Best,
    pub(super) steps: u32,
}

impl Search<'_> {
    /// The best that was met: where outlines pull at once, or after each limb was swung towards its own, in the picture's plane or out of it too.
    pub(super) fn run(mut self, root: bool) -> Result<(Best, u32), NodeError> {
        let mut x = self.best.x.clone();
        self.look(&x)?;
        if !self.markers.is_empty() {
            self.steps += improve(self.figure, self.camera, self.markers, &self.priors, &mut x, 100);
        } else if root {
            // Limbs are only compared where the figure stands as it is drawn.
            let stiff = Priors { turn: 1e6, length: 1e6, scale: 1e6 };
            for _ in 0..ALIGN {
                self.round(&mut x, self.reach, &stiff)?;
            }
        }
        let aligned = x.clone();
        self.pull(&mut x, self.reach)?;
        let mut last = aligned.clone();
        for deep in [false, true] {
            // Markers say where limbs are; depth is only looked for where nothing does.
            if deep && (self.best.errors[1] < ONE || !self.markers.is_empty()) {
                break;
            }
            let mut swung = aligned.clone();
            self.swing(&mut swung, deep)?;
            if swung != last {
                last = swung.clone();
                self.pull(&mut swung, self.reach / 4.0)?;
            }
        }
        x = self.best.x.clone();
        for _ in 0..self.rounds {
            let before = x.clone();
            self.round(&mut x, NEAR, &self.priors.clone())?;
            if (&x - before).amax() < STILL {
                break;
            }
        }
        self.look(&x)?;
        if !self.best.score.is_finite() {
            return Err(NodeError::input("mesh: expected an outline in the picture, found none").help("fit it by markers alone"));
        }
        Ok((self.best, self.steps))
    }

    fn world(&self, x: &DVector<f64>) -> Result<Vec<Matrix4<f64>>, NodeError> {
        let local: Vec<Matrix4<f64>> = self.figure.joints(x).iter().map(Joint::matrix).collect();
        world_from_joint(self.parents, &local).map_err(|e| NodeError::input(format!("skeleton: {e}")))
    }

    /// The outline there, and how bad it is with the markers; the best is kept.
    fn look(&mut self, x: &DVector<f64>) -> Result<(Vec<(Bound, Rim)>, f64), NodeError> {
        self.cx.check()?;
        let own = self.body.outline(&self.world(x)?, self.camera)?;
        let (outline, marker) = (apart(&own, self.drawn), (self.marker_error)(x));
        let score = self.weights[1] * WORTH * outline + self.weights[0] * self.markers.len() as f64 * marker;
        self.best.offer(score, x, [marker, outline]);
        Ok((own, score))
    }

    /// Some steps towards what is nearest within `reach`.
    fn round(&mut self, x: &mut DVector<f64>, reach: f64, priors: &Priors) -> Result<(), NodeError> {
        let (own, _) = self.look(x)?;
        let mut goals = outline_goals(&own, self.drawn, reach, reach / 2.0, self.weights[1] * WORTH.sqrt());
        goals.extend(self.markers.iter().cloned());
        self.steps += improve(self.figure, self.camera, &goals, priors, x, 4);
        Ok(())
    }

    /// From far and loose to near and firm.
    fn pull(&mut self, x: &mut DVector<f64>, reach: f64) -> Result<(), NodeError> {
        for round in 0..self.rounds {
            let t = f64::from(round) / f64::from(self.rounds.max(2) - 1);
            self.round(x, reach * libm::pow((NEAR / reach).min(1.0), t), &self.priors.clone())?;
        }
        self.look(x)?;
        Ok(())
    }

    /// Swings each joint that turns, parents first, to where the outlines come nearest, no point further than `reach`: in the plane of the picture, and out
    /// of it where `deep`. A limb that is drawn beyond its neighbours, which pull at it from nearby, is only found so.
    fn swing(&mut self, x: &mut DVector<f64>, deep: bool) -> Result<(), NodeError> {
        let toward = self.camera.toward();
        let eye = self.camera.world_from_camera();
        let (_, mut score) = self.look(x)?;
        for (joint, below) in self.figure.turning() {
            let world = self.world(x)?;
            let span = self.body.span(&world, self.camera, joint, below)?;
            let axes = [toward(&world[joint].column(3).xyz()), eye.column(0).xyz(), eye.column(1).xyz()];
            let mut found = None;
            for k in (-SWINGS..=SWINGS).filter(|k| *k != 0) {
                let angle = f64::from(k) * SWING;
                let way = 2.0 * span * libm::sin(angle.abs() / 2.0);
                if way > self.reach || way < NEAR {
                    continue;
                }
                for axis in &axes[..if deep { 3 } else { 1 }] {
                    let there = self.figure.swung(x, joint, axis, angle);
                    let (_, now) = self.look(&there)?;
                    // What turns for nothing, as a finger before the body, stays.
                    if now < 0.95 * score && found.as_ref().is_none_or(|(best, _)| now < *best) {
                        found = Some((now, there));
                    }
                }
            }
            if let Some((best, there)) = found {
                (score, *x) = (best, there);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_pose_is_kept_with_its_errors() {
        let at = |v: f64| DVector::from_element(2, v);
        let mut best = Best::new(at(0.0));
        best.offer(f64::NAN, &at(1.0), [f64::NAN; 2]);
        assert!(!best.score.is_finite() && best.x == at(0.0));
        best.offer(3.0, &at(2.0), [1.0, 2.0]);
        best.offer(4.0, &at(3.0), [2.0, 2.0]);
        best.offer(3.0, &at(4.0), [0.0, 3.0]);
        assert!(best.x == at(2.0) && best.errors == [1.0, 2.0], "the first of several that are as good");
        best.offer(2.0, &at(5.0), [0.5, 1.5]);
        assert!(best.x == at(5.0) && best.errors == [0.5, 1.5]);
    }
}
