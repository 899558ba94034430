//! The camera that an animator had in mind: that under which capture is most like the drawings.
//!
//! The animator's camera of Jain, Sheikh, Hodgins 2009, section 3.1, is set by hand. Its direction is in the drawings: the time warp of descriptors (section
//! 3.3) costs least where it is right. A grid of directions about the given one, then a compass search with halved steps (Hooke and Jeeves 1961); then least
//! squares, which noise of the drawn markers leaves where it is.

mod refine;

pub use refine::Refinement;

use nalgebra::{Matrix4, Unit, UnitQuaternion, Vector3};

use super::camera::Camera;
use super::dtw::{DtwError, Metric, Options, Series, SeriesError, dtw};
use super::pose_descriptor::{Reference, angles, length, true_lengths};
use refine::Refine;

/// Where is looked for the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Degrees on either side of the given azimuth and elevation.
    pub range_deg: [f64; 2],
    /// Degrees between directions of the grid.
    pub step_deg: f64,
    /// True where limbs count by how much of their lengths the camera sees.
    pub foreshortening: bool,
    /// How the cheapest warp's direction is refined.
    pub refinement: Refinement,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// To be added to azimuth and elevation, degrees.
    pub turn_deg: [f64; 2],
    /// Mean distance along the warp's path, radians a limb.
    pub cost: f64,
    /// The same under the given camera.
    pub cost_before: f64,
    /// How much larger the drawings are than the capture as that camera sees it.
    pub scale: f64,
    /// Variance of azimuth and elevation, and between them their covariance, square degrees; NaN where nothing was refined.
    pub covariance: [[f64; 2]; 2],
}

/// Why no camera was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// A series that is none.
    #[error("{name}: {source}")]
    Series {
        /// Drawings or capture.
        name: &'static str,
        /// What is wrong with it.
        source: SeriesError,
    },
    /// No warp under the given camera.
    #[error("{0}")]
    Warp(#[from] DtwError),
}

/// A camera turned about a point: its orbit's azimuth and elevation with so many degrees more.
pub fn turned(camera: &Camera, about: Vector3<f64>, turn_deg: [f64; 2]) -> Camera {
    let world = camera.world_from_camera();
    let (right, back) = (world.column(0).xyz(), world.column(2).xyz());
    let level = Vector3::y().cross(&back);
    // Straight down there is no horizon: its own axis will do.
    let level = if level.norm() > 1e-9 * back.norm() { level } else { right };
    let [azimuth, elevation] = turn_deg.map(f64::to_radians);
    let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(level), elevation)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -azimuth);
    let there = Matrix4::new_translation(&about) * turn.to_homogeneous() * Matrix4::new_translation(&-about);
    Camera { view: camera.view * there, ..camera.clone() }
}

/// A camera whose picture is larger by `scale` about its middle.
pub fn enlarged(camera: &Camera, scale: f64) -> Camera {
    let mut larger = camera.clone();
    for k in 0..2 {
        let row = larger.projection.row(k) * scale;
        larger.projection.set_row(k, &row);
    }
    larger
}

/// Drawings and capture, marker by marker alike.
pub struct Views<'a> {
    /// Markers of each drawing, pixels.
    pub drawn: &'a [Vec<[f64; 2]>],
    /// Markers of each frame of capture, metres.
    pub captured: &'a [Vec<[f64; 3]>],
    /// Limbs of the descriptor.
    pub limbs: &'a [[usize; 2]],
    /// Limbs of the refinement: as many as drawings and capture have in common, those across hips and shoulders above all.
    pub bones: &'a [[usize; 2]],
}

impl Views<'_> {
    fn seen(&self, camera: &Camera) -> Vec<Vec<[f64; 2]>> {
        let pixel = |p: &[f64; 3]| {
            let [x, y, _] = camera.project(*p);
            [x, y]
        };
        self.captured.iter().map(|f| f.iter().map(pixel).collect()).collect()
    }

    fn series(&self, frames: &[Vec<[f64; 2]>], weights: Option<Vec<Vec<f64>>>, name: &'static str) -> Result<Series, CalibrateError> {
        let rows: Vec<Vec<f64>> = frames.iter().map(|f| angles(f, self.limbs, Reference::Absolute, 1e-6)).collect();
        let rows: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
        let weights: Option<Vec<&[f64]>> = weights.as_ref().map(|w| w.iter().map(Vec::as_slice).collect());
        Series::new(&rows, weights.as_deref()).map_err(|source| CalibrateError::Series { name, source })
    }

    fn weights(&self, camera: &Camera, seen: &[Vec<[f64; 2]>]) -> Vec<Vec<f64>> {
        let share = |l: f64, whole: f64| if whole > 0.0 && l.is_finite() { (l / whole).min(1.0) } else { 0.0 };
        let frame = |(flat, deep): (&Vec<[f64; 2]>, &Vec<[f64; 3]>)| {
            let whole = true_lengths(deep, self.limbs, camera);
            self.limbs.iter().zip(whole).map(|(l, w)| share(length(flat, *l), w)).collect()
        };
        seen.iter().zip(self.captured).map(frame).collect()
    }

    /// Mean distance under a camera, and the path.
    fn cost(&self, drawn: &Series, camera: &Camera, search: &Search, options: &Options) -> Result<(f64, Vec<[usize; 2]>), CalibrateError> {
        let seen = self.seen(camera);
        let weights = search.foreshortening.then(|| self.weights(camera, &seen));
        let captured = self.series(&seen, weights, "source")?;
        let found = dtw(drawn, &captured, Metric::Angle, options)?;
        Ok((found.cost / (found.path.len() * self.limbs.len().max(1)) as f64, found.path))
    }

    /// How much larger limbs are drawn than they are seen, in the least squares of marker by marker about each frame's mean.
    fn scale(&self, camera: &Camera, path: &[[usize; 2]]) -> f64 {
        let seen = self.seen(camera);
        let (mut across, mut own) = (0.0, 0.0);
        for &[i, j] in path {
            let pairs: Vec<_> = self.drawn[i].iter().zip(&seen[j]).filter(|(a, b)| a.iter().chain(*b).all(|v| v.is_finite())).collect();
            for c in 0..2 {
                let n = pairs.len().max(1) as f64;
                let (a, b) = pairs.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0[c] / n, m.1 + p.1[c] / n));
                across += pairs.iter().map(|p| (p.0[c] - a) * (p.1[c] - b)).sum::<f64>();
                own += pairs.iter().map(|p| (p.1[c] - b).powi(2)).sum::<f64>();
            }
        }
        if own > 0.0 && across > 0.0 { across / own } else { 1.0 }
    }

    /// Where the capture is on the mean.
    pub fn middle(&self) -> Vector3<f64> {
        let finite = || self.captured.iter().flatten().filter(|p| p.iter().all(|v| v.is_finite()));
        let n = finite().count().max(1) as f64;
        finite().fold(Vector3::zeros(), |m, p| m + Vector3::from(*p) / n)
    }

    /// Looks for the direction from which the capture is most like the drawings.
    ///
    /// # Errors
    /// As of series and warps. Cost: O(directions · drawings · frames of capture · limbs).
    pub fn calibrate(&self, camera: &Camera, search: &Search, options: &Options) -> Result<Found, CalibrateError> {
        let drawn = self.series(self.drawn, None, "target")?;
        let middle = self.middle();
        let at = |turn: [f64; 2]| self.cost(&drawn, &turned(camera, middle, turn), search, options);
        let before = at([0.0; 2])?.0;
        let (mut best, mut turn) = (before, [0.0; 2]);
        let mut better = |to: [f64; 2], turn: &mut [f64; 2]| {
            let inside = to.iter().zip(search.range_deg).all(|(t, r)| t.abs() <= r + 1e-9);
            let cost = if inside { at(to)?.0 } else { f64::INFINITY };
            let is_better = cost < best;
            if is_better {
                (best, *turn) = (cost, to);
            }
            Ok::<bool, CalibrateError>(is_better)
        };
        let steps = search.range_deg.map(|r| (r / search.step_deg).floor() as i64);
        for a in -steps[0]..=steps[0] {
            for e in -steps[1]..=steps[1] {
                better([a as f64 * search.step_deg, e as f64 * search.step_deg], &mut turn)?;
            }
        }
        let mut step = search.step_deg / 2.0;
        while step > 0.02 {
            let from = turn;
            let mut moved = false;
            for by in [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]] {
                moved |= better([from[0] + by[0], from[1] + by[1]], &mut turn)?;
            }
            if !moved {
                step /= 2.0;
            }
        }
        let mut covariance = [[f64::NAN; 2]; 2];
        if search.refinement != Refinement::Off && !self.bones.is_empty() {
            let refine = Refine { views: self, camera, range_deg: search.range_deg, refinement: search.refinement, options };
            let refined = refine.run(turn)?;
            (turn, covariance) = (refined.turn_deg, refined.covariance.into());
        }
        let camera = turned(camera, middle, turn);
        let (cost, path) = self.cost(&drawn, &camera, search, options)?;
        Ok(Found { turn_deg: turn, cost, cost_before: before, scale: self.scale(&camera, &path), covariance })
    }
}
