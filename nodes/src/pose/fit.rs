//! `pose.fit`: the pose, and lengths and scales of bones, in which a character is seen as it is drawn.
//!
//! **Method** Levenberg and Marquardt's on the root's place, each joint's turn, and the logarithms of lengths and scales ([`crate::algo::pose_fit`]); markers
//! pull joints to where they are drawn, and the outline of the mesh goes to the drawing's, further and more loosely first. Priors hold what neither says.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.1 (which leaves it to the user); Marquardt 1963; Geman, McClure 1987.
//!
//! **Fails when** neither drawing nor markers are given, or a name is no joint's. What one picture cannot say, depth above all, stays as it was at the start.
//!
//! **Cost** O(rounds · (triangles + pixels + goals · unknowns²)).
//!
//! ```ron
//! "posed": (type: "pose.fit", mesh: "@ant.mesh", skeleton: "@ant.skeleton", pose: "@ant.pose", camera: "@camera", markers: "@joints", lengths: ["shin.L"]),
//! ```

use nalgebra::{DVector, Matrix4, Vector2, Vector3};
use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use crate::algo::camera;
use crate::algo::curve_trace::InkStyle;
use crate::algo::mesh_lines::{Search, distance, find};
use crate::algo::pose_fit::{Bound, Figure, Free, Goal, Priors, Rim, improve, outline_goals, project};
use crate::algo::silhouette::Lines;
use crate::algo::skeleton::{Joint, world_from_joint};
use crate::algo::skin::Skin;
use crate::algo::trace::trace;
use crate::curve::ink_of;
use crate::data::{Camera, Image, Markers2, Pose, Skeleton, SkinnedMesh};
use crate::render::{limited, seen_by, within};

/// The pose, and lengths and scales of bones, in which a character is seen as it is drawn.
#[derive(Node)]
#[node(
    id = "pose.fit",
    version = 2,
    outputs = PoseFitOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.1",
    example = "\"posed\": (type: \"pose.fit\", mesh: \"@ant.mesh\", skeleton: \"@ant.skeleton\", pose: \"@ant.pose\", camera: \"@camera\", markers: \"@joints\", lengths: [\"shin.L\"])"
)]
pub(crate) struct PoseFit {
    /// The character, at rest. Needed where there is a drawing.
    pub(crate) mesh: Option<In<SkinnedMesh>>,
    /// Its joints.
    pub(crate) skeleton: In<Skeleton>,
    /// The pose to start from.
    pub(crate) pose: In<Pose>,
    /// Where it is seen from.
    pub(crate) camera: In<Camera>,
    /// The drawing: its outline is that of what is not transparent, or of what ink goes around.
    pub(crate) drawing: Option<In<Image>>,
    /// Where joints are drawn; those that are not seen say nothing.
    pub(crate) markers: Option<In<Markers2>>,
    /// The joint of each marker, by name, in their order. The markers' own names where it is left out.
    #[input(default = [])]
    pub(crate) marker_joints: Vec<String>,
    /// Whether the roots may be moved.
    #[input(default = true)]
    pub(crate) root: bool,
    /// Joints that may turn, by name. All where it is left out.
    #[input(default = ["*"])]
    pub(crate) turns: Vec<String>,
    /// Joints whose bone, from its parent, may change its length, by name; "*" for all.
    #[input(default = [])]
    pub(crate) lengths: Vec<String>,
    /// Joints that may be scaled with all that is bound to them, by name; "*" for all. What follows keeps its own size.
    #[input(default = [])]
    pub(crate) scales: Vec<String>,
    /// How much a pixel that a marker is off counts.
    #[input(default = 1.0, range = 0.0..=1000000.0)]
    pub(crate) marker_weight: f64,
    /// How much a pixel between the outlines counts, against one of twenty markers.
    #[input(default = 1.0, range = 0.0..=1000000.0)]
    pub(crate) outline_weight: f64,
    /// Pixels that a marker must gain for a joint to turn by a radian. 0 lets all joints go, large keeps the pose of the start.
    #[input(default = 3.0, range = 0.0..=1000000.0, unit = "px")]
    pub(crate) turn_prior: f64,
    /// Pixels that a marker must gain for a bone to get 2.7 times as long.
    #[input(default = 30.0, range = 0.0..=1000000.0, unit = "px")]
    pub(crate) length_prior: f64,
    /// The same for scales.
    #[input(default = 30.0, range = 0.0..=1000000.0, unit = "px")]
    pub(crate) scale_prior: f64,
    /// How far apart outlines may be at the start. Small holds on to what is near, large finds limbs that were drawn elsewhere.
    #[input(default = 48.0, range = 2.0..=10000.0, unit = "px")]
    pub(crate) reach: f64,
    /// As much ink counts as ink, 0 to 1.
    #[input(default = 0.4, range = 0.01..=0.99)]
    pub(crate) threshold: f64,
    /// How often outlines are compared anew.
    #[input(default = 20, range = 1..=1000)]
    pub(crate) rounds: u32,
}

/// The pose, and how well it fits.
#[derive(Outputs)]
pub(crate) struct PoseFitOutputs {
    /// It: lengths are in the translations, scales in the scales.
    pub(crate) pose: Pose,
    /// How far joints are from their markers on the mean, pixels; 0 without markers.
    pub(crate) marker_error: Curve,
    /// How far the outlines are from each other on the mean, both ways, pixels; 0 without a drawing. The pose is the best that was met by both errors, weighed.
    pub(crate) outline_error: Curve,
    /// Steps that were taken.
    pub(crate) steps: Curve,
}

/// Between two places of the drawn outline that are looked at, pixels.
const STEP: f64 = 2.0;

/// The surface that the joints move.
struct Body {
    skin: Skin,
    inverse_bind: Vec<Matrix4<f64>>,
    triangles: Vec<[u32; 3]>,
    bound: Vec<Bound>,
}

impl Body {
    fn new(mesh: &SkinnedMesh, n: usize) -> Result<Self, NodeError> {
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
        Ok(Self { skin, inverse_bind, triangles: mesh.triangles.to_vec(), bound })
    }

    /// The outermost outline as it is seen, with the points that it is made of.
    fn outline(&self, world: &[Matrix4<f64>], camera: &camera::Camera) -> Result<Vec<(Bound, Rim)>, NodeError> {
        let motions: Vec<Matrix4<f64>> = world.iter().zip(&self.inverse_bind).map(|(w, b)| w * b).collect();
        let (positions, _) = self.skin.pose(&motions, false).map_err(|e| NodeError::input(format!("pose: {e}")))?;
        let search =
            Search { lines: Lines { crease: None, seams: false, ..Lines::default() }, hard: std::f64::consts::PI, subdivide: 0, smooth: 0 };
        let lines = find(&positions, &self.triangles, camera, &search).map_err(|e| NodeError::input(format!("mesh: {e}")))?;
        let mut normals = vec![Vector3::zeros(); positions.len()];
        for t in &self.triangles {
            let [a, b, c] = t.map(|v| Vector3::from(positions[v as usize]));
            t.iter().for_each(|v| normals[*v as usize] += (b - a).cross(&(c - a)));
        }
        let mut out = Vec::new();
        for line in &lines {
            let mut last: Option<[f64; 2]> = None;
            for p in line.points.iter().filter(|p| p.outline) {
                if last.is_some_and(|l| distance(l, p.pixel) < STEP) {
                    continue;
                }
                let [a, b] = p.edge.map(|v| v as usize);
                let normal = (normals[a] * (1.0 - p.share) + normals[b] * p.share).try_normalize(1e-300).unwrap_or_else(Vector3::zeros);
                let small = 1e-4 * (1.0 + p.position.norm());
                let [x, y, _] = camera.project((p.position + normal * small).into());
                let Some(away) = Vector2::new(x - p.pixel[0], y - p.pixel[1]).try_normalize(1e-9) else { continue };
                let mut point: Bound = self.bound[a].iter().map(|(j, w, q)| (*j, w * (1.0 - p.share), *q)).collect();
                point.extend(self.bound[b].iter().map(|(j, w, q)| (*j, w * p.share, *q)));
                out.push((point, Rim { at: Vector2::from(p.pixel), out: away }));
                last = Some(p.pixel);
            }
        }
        Ok(out)
    }
}

/// The outline of a drawing: of its alpha where something is transparent, else of all that ink goes around.
fn drawn_outline(image: &Image, threshold: f64) -> Result<Vec<Rim>, NodeError> {
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
    let mut out = Vec::new();
    for o in outlines.iter().filter(|o| o.area.abs() > 16.0) {
        let n = o.points.len();
        let mut last: Option<[f64; 2]> = None;
        for i in 0..n {
            let p = o.points[i];
            // Where the figure leaves the picture there is no outline.
            let inside = p[0] > 1.0 && p[1] > 1.0 && p[0] < width as f64 - 1.0 && p[1] < height as f64 - 1.0;
            if !inside || last.is_some_and(|l| distance(l, p) < STEP) {
                continue;
            }
            let (a, b) = (o.points[(i + n - 2.min(n - 1)) % n], o.points[(i + 2) % n]);
            // Layers lie to the right of their outlines on the screen, so that their outside is to the left.
            if let Some(away) = Vector2::new(b[1] - a[1], a[0] - b[0]).try_normalize(1e-9) {
                let at = Vector2::new(p[0] + window.x as f64, p[1] + window.y as f64);
                out.push(Rim { at, out: away });
                last = Some(p);
            }
        }
    }
    Ok(out)
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

impl PoseFit {
    fn chosen(&self, names: &[String], input: &str) -> Result<Vec<bool>, NodeError> {
        let n = self.skeleton.n_joints();
        let mut out = vec![names.iter().any(|name| name == "*"); n];
        for name in names.iter().filter(|n| *n != "*") {
            let j = self.skeleton.find(name).ok_or_else(|| self.no_joint(input, name))?;
            out[j] = true;
        }
        Ok(out)
    }

    fn no_joint(&self, input: &str, name: &str) -> NodeError {
        let names = self.skeleton.names.iter().take(40).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
        NodeError::input(format!("{input}: expected a joint of the skeleton, found {name:?}")).help(format!("the joints are {names}"))
    }

    /// What the markers want.
    fn marker_goals(&self) -> Result<Vec<Goal>, NodeError> {
        let Some(markers) = &self.markers else { return Ok(Vec::new()) };
        let mut out = Vec::new();
        for (i, p) in markers.points.iter().enumerate().filter(|(_, p)| p.iter().all(|v| !v.is_nan())) {
            let own = if self.marker_joints.is_empty() { markers.names.get(i) } else { self.marker_joints.get(i) };
            let name = own.ok_or_else(|| {
                NodeError::input(format!("markers: expected a joint for marker {i}, found none"))
                    .help("`marker_joints` names them in order")
            })?;
            let j = self.skeleton.find(name).ok_or_else(|| self.no_joint("markers", name))?;
            if p.iter().any(|v| !v.is_finite()) {
                return Err(NodeError::input(format!("markers: expected finite places, found `{name}` at {p:?}")));
            }
            out.push(Goal { point: vec![(j, 1.0, Vector3::zeros())], at: Vector2::from(*p), along: None, weight: self.marker_weight });
        }
        Ok(out)
    }

    fn check_numbers(&self) -> Result<(), NodeError> {
        within("marker_weight", self.marker_weight, 0.0, 1e6)?;
        within("outline_weight", self.outline_weight, 0.0, 1e6)?;
        within("turn_prior", self.turn_prior, 0.0, 1e6)?;
        within("length_prior", self.length_prior, 0.0, 1e6)?;
        within("scale_prior", self.scale_prior, 0.0, 1e6)?;
        within("reach", self.reach, 2.0, 1e4)?;
        within("threshold", self.threshold, 0.01, 0.99)?;
        Ok(())
    }

    fn figure(&self) -> Result<Figure, NodeError> {
        let n = self.skeleton.n_joints();
        let start = self.pose.joints().map_err(|e| NodeError::input(format!("pose: {e}")))?;
        if start.len() != n {
            return Err(NodeError::input(format!("pose: expected {n} joints as in the skeleton, found {}", start.len())));
        }
        let free = Free {
            root: self.root,
            turn: self.chosen(&self.turns, "turns")?,
            length: self.chosen(&self.lengths, "lengths")?,
            scale: self.chosen(&self.scales, "scales")?,
        };
        Figure::new(&self.skeleton.parents, &start, &free).map_err(|e| NodeError::input(format!("skeleton: {e}")))
    }
}

/// The mean distance between outlines, both ways.
fn apart(own: &[(Bound, Rim)], drawn: &[Rim]) -> f64 {
    let nearest = |p: &Rim, all: &mut dyn Iterator<Item = &Rim>| all.map(|q| (q.at - p.at).norm()).fold(f64::INFINITY, f64::min);
    if own.is_empty() || drawn.is_empty() {
        return f64::NAN;
    }
    let to: f64 = own.iter().map(|p| nearest(&p.1, &mut drawn.iter())).sum::<f64>() / own.len() as f64;
    let from: f64 = drawn.iter().map(|p| nearest(p, &mut own.iter().map(|o| &o.1))).sum::<f64>() / drawn.len() as f64;
    (to + from) / 2.0
}

/// The best unknowns so far, with the errors of markers and outline.
struct Best {
    score: f64,
    x: DVector<f64>,
    errors: [f64; 2],
}

impl Best {
    fn new(x: DVector<f64>) -> Self {
        Self { score: f64::INFINITY, x, errors: [f64::NAN; 2] }
    }

    fn offer(&mut self, score: f64, x: &DVector<f64>, errors: [f64; 2]) {
        // Not that of an outline that is not there, which is NaN.
        if score < self.score {
            *self = Self { score, x: x.clone(), errors };
        }
    }
}

impl PerFrame for PoseFit {
    fn run(self, cx: &Context) -> Result<PoseFitOutputs, NodeError> {
        self.check_numbers()?;
        let camera = seen_by(&self.camera)?;
        limited(camera.size[0], camera.size[1])?;
        let (figure, markers) = (self.figure()?, self.marker_goals()?);
        let outline = match (&self.drawing, &self.mesh) {
            (None, _) => None,
            (Some(_), None) => return Err(NodeError::input("mesh: expected the character where there is a drawing, found none")),
            (Some(drawing), Some(mesh)) => Some((drawn_outline(drawing, self.threshold)?, Body::new(mesh, self.skeleton.n_joints())?)),
        };
        if outline.is_none() && self.markers.is_none() {
            return Err(NodeError::input("expected a drawing or markers, found neither"));
        }
        if outline.as_ref().is_some_and(|(drawn, _)| drawn.is_empty()) {
            return Err(NodeError::input("drawing: expected a figure with an outline, found none").help("`threshold` says what is ink"));
        }
        let priors = Priors { turn: self.turn_prior, length: self.length_prior, scale: self.scale_prior };
        let world = |x: &DVector<f64>| {
            let local: Vec<Matrix4<f64>> = figure.joints(x).iter().map(Joint::matrix).collect();
            world_from_joint(&self.skeleton.parents, &local).map_err(|e| NodeError::input(format!("skeleton: {e}")))
        };
        let points: Vec<Bound> = markers.iter().map(|g| g.point.clone()).collect();
        let marker_error = |x: &DVector<f64>| {
            let offs = project(&figure, &camera, &points, x);
            let sum: f64 = offs.iter().zip(&markers).map(|(p, g)| (p - g.at).norm()).sum();
            if markers.is_empty() { 0.0 } else { sum / markers.len() as f64 }
        };
        let mut x = DVector::zeros(figure.n_unknowns());
        let mut best = Best::new(x.clone());
        let mut look = |x: &DVector<f64>, own: &[(Bound, Rim)], drawn: &[Rim]| {
            let (outline, marker) = (apart(own, drawn), marker_error(x));
            best.offer(self.outline_weight * 20.0 * outline + self.marker_weight * markers.len() as f64 * marker, x, [marker, outline]);
        };
        if let Some((drawn, body)) = &outline {
            look(&x, &body.outline(&world(&x)?, &camera)?, drawn);
        }
        let mut steps = if markers.is_empty() { 0 } else { improve(&figure, &camera, &markers, &priors, &mut x, 100) };
        if let Some((drawn, body)) = &outline {
            for round in 0..self.rounds {
                cx.check()?;
                // From far and loose to near and firm.
                let t = f64::from(round) / f64::from(self.rounds.max(2) - 1);
                let reach = self.reach * libm::pow((4.0 / self.reach).min(1.0), t);
                let own = body.outline(&world(&x)?, &camera)?;
                look(&x, &own, drawn);
                let mut goals = outline_goals(&own, drawn, reach, reach / 2.0, 1.0);
                let weight = self.outline_weight * (20.0 / goals.len().max(1) as f64).sqrt();
                goals.iter_mut().for_each(|g| g.weight *= weight);
                goals.extend(markers.iter().cloned());
                steps += improve(&figure, &camera, &goals, &priors, &mut x, 4);
            }
            look(&x, &body.outline(&world(&x)?, &camera)?, drawn);
            if !best.score.is_finite() {
                return Err(NodeError::input("mesh: expected an outline with an outside in the picture, found none")
                    .help("a flat, open mesh that faces the camera has none, nor one out of the picture; fit it by markers alone"));
            }
        } else {
            best = Best { score: 0.0, errors: [marker_error(&x), 0.0], x };
        }
        let [marker_error, outline_error] = best.errors;
        Ok(PoseFitOutputs {
            pose: figure.joints(&best.x).into_iter().collect(),
            marker_error: Curve { value: marker_error },
            outline_error: Curve { value: outline_error },
            steps: Curve { value: f64::from(steps) },
        })
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
