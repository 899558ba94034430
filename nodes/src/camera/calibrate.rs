//! `camera.calibrate`: the direction from which capture is most like a drawing.
//!
//! **Method** see [`crate::algo::calibrate`]: the time warp between drawings and capture costs least under the right camera; a grid of directions about
//! the given one, refined by halved steps, then in turn with the time map by least squares over all limbs that drawings and capture have in common.
//!
//! **Holds** to a degree from fifteen degrees off, azimuth and elevation each, with markers a centimetre (a thirtieth of a limb) off: on 203 and 202 of
//! 204 trials over twelve passages of four seconds, of walks, jumps, a kick, gestures and dances, with arms and spine posed up to eight degrees another way
//! than captured; on 68 and 68 of 72 where the drawn figure has other proportions too; posed fifteen degrees another way on about nine in ten. The cheapest
//! warp alone (`refine: off`) does on seven, and four, in ten. Longer takes tell more; a figure that stands still, or turns with the camera, tells little:
//! `uncertainty` says so. It knows of noise and style, not of capture that is of another kind than the drawing.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, sections 3.1 (the animator's camera, there set by hand) and 3.3 (the cost); Hooke and Jeeves 1961; Newey and West 1987 (covariance).
//!
//! **Fails when** limbs name markers that there are not, or the warp has no path. What a drawing exaggerates pulls the direction with it.
//!
//! **Cost** O(directions · drawings · frames of capture · limbs).
//!
//! ```ron
//! "found": (type: "camera.calibrate", target: "@drawn", source: "@captured", camera: "@camera"),
//! ```

use pegbar_engine::node::{Context, Fault, In, NodeError, Sequence, Whole};
use pegbar_engine::value::{Curve, Vector};
use pegbar_engine::{Node, Outputs};

use crate::algo::calibrate::{Refinement, Search, Views, enlarged, turned};
use crate::algo::camera;
use crate::algo::dtw::{Options, Steps};
use crate::algo::markers::standard;
use crate::data::{Camera, Markers2, Markers3};
use crate::lift::Limbs;

/// Directions of a grid at most.
const DIRECTIONS: f64 = 100_000.0;

/// The direction from which capture is most like a drawing.
#[derive(Node)]
#[node(
    id = "camera.calibrate",
    version = 2,
    kind = whole,
    outputs = CameraCalibrateOutputs,
    source = "Jain, Sheikh, Hodgins 2009, sections 3.1 and 3.3; Hooke, Jeeves 1961; Newey, West 1987",
    example = "\"found\": (type: \"camera.calibrate\", target: \"@drawn\", source: \"@captured\", camera: \"@camera\")"
)]
pub(crate) struct CameraCalibrate {
    /// The drawing's markers.
    target: Sequence<Markers2>,
    /// The capture's markers, on any clock.
    #[input(any_clock)]
    source: Sequence<Markers3>,
    /// The camera from which the search sets out: a guess by eye.
    camera: In<Camera>,
    /// Limbs by the names of the markers where they begin and end. The eight of the descriptor where nothing is said.
    #[input(default = [
        ("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist"),
        ("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("right_hip", "right_knee"), ("right_knee", "right_ankle"),
    ])]
    limbs: Limbs,
    /// How far the azimuth may be off on either side.
    #[input(default = 30.0, range = 0.0..=180.0, unit = "°")]
    azimuth_range_deg: f64,
    /// How far the elevation may be off on either side. 0 leaves it as it is.
    #[input(default = 15.0, range = 0.0..=90.0, unit = "°")]
    elevation_range_deg: f64,
    /// Between directions of the grid. Small misses no dip of the cost, large is quick.
    #[input(default = 5.0, range = 0.1..=45.0, unit = "°")]
    step_deg: f64,
    /// True where limbs count by how much of their lengths the camera sees.
    #[input(default = true)]
    foreshortening: bool,
    /// How the cheapest warp's direction is refined: `own` where the drawn figure has proportions of its own, `same` where it has the capture's.
    #[input(default = own)]
    refine: Refinement,
    /// True where the capture begins before the drawings do.
    #[input(default = false)]
    open_begin: bool,
    /// True where the capture goes on after the drawings.
    #[input(default = false)]
    open_end: bool,
    /// True also enlarges the picture, so that the capture is as large as it is drawn.
    #[input(default = false)]
    fit_scale: bool,
}

/// The camera.
#[derive(Outputs)]
pub(crate) struct CameraCalibrateOutputs {
    /// The camera as the drawings look at the figure.
    camera: Camera,
    /// What was added to the azimuth, degrees.
    azimuth_deg: Curve,
    /// What was added to the elevation, degrees.
    elevation_deg: Curve,
    /// How much larger the drawings are than the capture as that camera sees it, before `fit_scale`.
    scale: Curve,
    /// Standard deviation of azimuth and of elevation, degrees, and their correlation; NaN where nothing is refined.
    uncertainty: Vector,
    /// Mean angle between drawn and captured limbs, radians.
    cost: Curve,
    /// The same under the camera that was given.
    cost_before: Curve,
}

impl CameraCalibrate {
    /// Ends of the limbs, and whatever standard markers are both drawn and captured.
    fn names(&self) -> Result<Vec<String>, NodeError> {
        let mut names: Vec<String> = Vec::new();
        let ends = self.limbs.0.iter().flat_map(|(from, to)| [from, to]).cloned();
        let mut add = |name: String| {
            if !names.contains(&name) {
                names.push(name)
            }
        };
        ends.for_each(&mut add);
        if !self.target.is_empty() && !self.source.is_empty() {
            let (drawn, captured) = (self.target.get(0)?, self.source.get(0)?);
            let both = |name: &str| drawn.find(name).is_some() && captured.find(name).is_some();
            standard::MARKERS.iter().filter(|m| both(m.name)).for_each(|m| add(m.name.to_owned()));
        }
        Ok(names)
    }
}

/// Standard deviations, and the correlation.
fn uncertainty(&[[a, b], [_, d]]: &[[f64; 2]; 2]) -> [f64; 3] {
    [a.sqrt(), d.sqrt(), if a * d > 0.0 { b / (a * d).sqrt() } else { f64::NAN }]
}

impl Whole for CameraCalibrate {
    fn run(self, _cx: &Context) -> Result<CameraCalibrateOutputs, NodeError> {
        let directions = (2.0 * self.azimuth_range_deg / self.step_deg + 1.0) * (2.0 * self.elevation_range_deg / self.step_deg + 1.0);
        if directions > DIRECTIONS {
            let message = format!("expected at most {DIRECTIONS} directions, found {directions}: a larger `step_deg` makes them fewer");
            return Err(NodeError::new(Fault::Parameters, message));
        }
        let given = camera::Camera::try_from(&*self.camera).map_err(|e| NodeError::input(format!("camera: {e}")))?;
        let (mut drawn, mut captured) = (Vec::with_capacity(self.target.len()), Vec::with_capacity(self.source.len()));
        let names = self.names()?;
        for k in 0..self.target.len() {
            let m = self.target.get(k)?;
            self.limbs.find(&m.names, "target")?;
            drawn.push(names.iter().map(|n| m.find(n).map_or([f64::NAN; 2], |at| m.points[at])).collect::<Vec<_>>());
        }
        for k in 0..self.source.len() {
            let m = self.source.get(k)?;
            self.limbs.find(&m.names, "source")?;
            captured.push(names.iter().map(|n| m.find(n).map_or([f64::NAN; 3], |at| m.points[at])).collect::<Vec<_>>());
        }
        let limbs = self.limbs.find(&names, "limbs")?;
        let others = standard::limbs(&names).into_iter().filter(|l| !limbs.contains(l));
        let bones: Vec<[usize; 2]> = limbs.iter().copied().chain(others).collect();
        let views = Views { drawn: &drawn, captured: &captured, limbs: &limbs, bones: &bones };
        let search = Search {
            range_deg: [self.azimuth_range_deg, self.elevation_range_deg],
            step_deg: self.step_deg,
            foreshortening: self.foreshortening,
            refinement: self.refine,
        };
        let options = Options { steps: Steps::Symmetric1, open_begin: self.open_begin, open_end: self.open_end, ..Options::default() };
        let found = views.calibrate(&given, &search, &options).map_err(|e| NodeError::input(e.to_string()))?;
        let camera = turned(&given, views.middle(), found.turn_deg);
        let camera = if self.fit_scale { enlarged(&camera, found.scale) } else { camera };
        let curve = |value: f64| Curve { value };
        Ok(CameraCalibrateOutputs {
            camera: Camera::from(&camera),
            azimuth_deg: curve(found.turn_deg[0]),
            elevation_deg: curve(found.turn_deg[1]),
            scale: curve(found.scale),
            uncertainty: Vector { values: uncertainty(&found.covariance).to_vec() },
            cost: curve(found.cost),
            cost_before: curve(found.cost_before),
        })
    }
}
