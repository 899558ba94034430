//! `pose.fit`: the pose, and lengths and scales of bones, in which a character is seen as it is drawn.
//!
//! **Method** Levenberg and Marquardt's on the root's place, each joint's turn, and the logarithms of lengths and scales ([`crate::algo::pose_fit`]); markers
//! pull joints to where they are drawn, and the outline of the mesh ([`crate::algo::outline`]) goes to the drawing's, further and more loosely first. This
//! is done from the start and from where each joint, parents first, was swung to bring the outlines nearer; the best pose is kept. Priors hold what neither
//! says.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.1 (which leaves it to the user); Marquardt 1963; Geman, McClure 1987.
//!
//! **Fails when** neither drawing nor markers are given, or a name is no joint's. One picture does not say everything: a limb that comes towards the eye is
//! told by how much shorter it looks, which in parallel lines one that goes away does as well, and a freely longer one does not; priors decide there.
//!
//! **Cost** O(rounds · (triangles + pixels + goals · unknowns²) + joints · triangles).
//!
//! ```ron
//! "posed": (type: "pose.fit", mesh: "@ant.mesh", skeleton: "@ant.skeleton", pose: "@ant.pose", camera: "@camera", markers: "@joints", lengths: ["shin.L"]),
//! ```

use nalgebra::{DVector, Vector2, Vector3};
use pegbar_engine::node::{Context, In, NodeError, PerFrame};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use super::fit_outline::{Best, Body, Search, drawn_outline};
use crate::algo::pose_fit::{Bound, Figure, Free, Goal, Priors, improve, project};
use crate::data::{Camera, Image, Markers2, Pose, Skeleton, SkinnedMesh};
use crate::render::{limited, seen_by, within};

/// The pose, and lengths and scales of bones, in which a character is seen as it is drawn.
#[derive(Node)]
#[node(
    id = "pose.fit",
    version = 3,
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
    #[input(default = 1.0, range = 0.0..=1000000.0, unit = "px")]
    pub(crate) turn_prior: f64,
    /// Pixels that a marker must gain for a bone to get 2.7 times as long.
    #[input(default = 2.0, range = 0.0..=1000000.0, unit = "px")]
    pub(crate) length_prior: f64,
    /// The same for scales.
    #[input(default = 2.0, range = 0.0..=1000000.0, unit = "px")]
    pub(crate) scale_prior: f64,
    /// How far apart outlines may be at the start. Small holds on to what is near, large finds limbs that were drawn elsewhere.
    #[input(default = 120.0, range = 2.0..=10000.0, unit = "px")]
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
        let points: Vec<Bound> = markers.iter().map(|g| g.point.clone()).collect();
        let marker_error = |x: &DVector<f64>| {
            let offs = project(&figure, &camera, &points, x);
            let sum: f64 = offs.iter().zip(&markers).map(|(p, g)| (p - g.at).norm()).sum();
            if markers.is_empty() { 0.0 } else { sum / markers.len() as f64 }
        };
        let start = DVector::zeros(figure.n_unknowns());
        let (best, steps) = if let Some((drawn, body)) = &outline {
            let search = Search {
                cx,
                figure: &figure,
                parents: &self.skeleton.parents,
                camera: &camera,
                body,
                drawn,
                markers: &markers,
                marker_error: &marker_error,
                priors,
                weights: [self.marker_weight, self.outline_weight],
                reach: self.reach,
                rounds: self.rounds,
                best: Best::new(start),
                steps: 0,
            };
            search.run(self.root)?
        } else {
            let mut x = start;
            let steps = improve(&figure, &camera, &markers, &priors, &mut x, 100);
            (Best { score: 0.0, errors: [marker_error(&x), 0.0], x }, steps)
        };
        let [marker_error, outline_error] = best.errors;
        Ok(PoseFitOutputs {
            pose: figure.joints(&best.x).into_iter().collect(),
            marker_error: Curve { value: marker_error },
            outline_error: Curve { value: outline_error },
            steps: Curve { value: f64::from(steps) },
        })
    }
}
