//! Captures of a whole sequence that change smoothly over time.

use super::{Capture, Capturer, Pull, State};
use crate::algo::smoothness::{Bends, Smoothing, bends};

/// Most sweeps over the frames.
const SWEEPS: usize = 200;
/// A sweep that lowers the total by a smaller share than this is the last.
const STILL: f64 = 1e-8;
/// Most rounds at a frame before the next one has its turn.
const ROUNDS: usize = 4;

/// What smoothing did.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothed {
    /// Squared errors of all frames and the price of all bends: before, after the start and after each sweep. It never rises.
    pub totals: Vec<f64>,
    /// Whether the last sweep changed next to nothing.
    pub converged: bool,
}

/// Makes captures of shapes the least of their squared errors and the price of bends, from where they stand.
///
/// Two things have their bends priced: the points of the moved mixed keys, in pixels, so that all parameters of a motion are weighed by
/// what they do; and the weights, in units of the keys' mean squared size, so that keys that do like things do not trade places. With its
/// neighbours held, a frame's share of the total is again a capture: of the mean of its own shape and of where the neighbours would have
/// it. So the frames take turns with the capture's own steps, within all constraints, and no turn raises the total. They start from the
/// captures of the smoothed contours, in closed form, where these are better. `between` is asked at each frame and may stop with an error
/// of its own.
///
/// # Errors
/// That of `between`.
pub fn smooth<E>(
    capturer: &mut Capturer,
    shapes: &[&[[f64; 2]]],
    captures: &mut [Capture],
    smoothing: Smoothing,
    mut between: impl FnMut() -> Result<(), E>,
) -> Result<Smoothed, E> {
    let mut run = Run::new(capturer, shapes, captures, smoothing);
    let mut totals = vec![run.total()];
    let own = run.path.clone();
    run.start(&mut between)?;
    totals.push(run.total());
    if totals[1] >= totals[0] {
        run.path = own;
        totals.pop();
    }
    let mut converged = false;
    for _ in 0..SWEEPS {
        let before = totals[totals.len() - 1];
        for t in 0..shapes.len() {
            between()?;
            run.turn(t);
        }
        let total = run.total();
        totals.push(total);
        // Of a total that is rounding alone no share is left to lower.
        converged = before - total <= STILL * before;
        if converged {
            break;
        }
    }
    for (t, capture) in captures.iter_mut().enumerate() {
        between()?;
        run.finish(t, capture);
        capture.converged &= converged;
    }
    Ok(Smoothed { totals, converged })
}

/// What the captures make of the shapes, frame by frame.
#[derive(Clone)]
struct Path {
    /// Points, x and y by turns.
    points: Vec<Vec<f64>>,
    weights: Vec<Vec<f64>>,
}

struct Run<'a> {
    capturer: &'a mut Capturer,
    /// As the path's points.
    shapes: Vec<Vec<f64>>,
    path: Path,
    bends: Bends,
    /// Of the weights: a pose may pop while the drawing glides.
    changes: Bends,
    /// What a bend of the weights costs in pixels².
    unit: f64,
}

fn flat(points: &[[f64; 2]]) -> Vec<f64> {
    points.as_flattened().to_vec()
}

fn points(flat: &[f64]) -> &[[f64; 2]] {
    flat.as_chunks().0
}

impl<'a> Run<'a> {
    fn new(capturer: &'a mut Capturer, shapes: &[&[[f64; 2]]], captures: &[Capture], smoothing: Smoothing) -> Self {
        let path = Path {
            points: captures.iter().map(|c| flat(&c.shape)).collect(),
            weights: captures.iter().map(|c| c.weights.clone()).collect(),
        };
        let k = capturer.space.n_keys();
        let [xx, _, yy] = capturer.space.products();
        let size = xx.iter().zip(yy).step_by(k + 1).map(|(x, y)| x + y).sum::<f64>() / k as f64;
        let scale = captures.iter().map(|c| c.motion.fixed_view::<2, 2>(0, 0).norm_squared()).sum::<f64>();
        Self {
            bends: Bends::new(smoothing, &bends(&path.points)),
            changes: Bends::new(smoothing, &bends(&path.weights)),
            unit: size * 0.5 * scale / captures.len().max(1) as f64,
            shapes: shapes.iter().map(|s| flat(s)).collect(),
            capturer,
            path,
        }
    }

    fn total(&self) -> f64 {
        let off = self.shapes.iter().flatten().zip(self.path.points.iter().flatten()).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        off + self.bends.cost(&self.path.points) + self.unit * self.changes.cost(&self.path.weights)
    }

    /// Captures of the smoothed shapes.
    fn start<E>(&mut self, between: &mut impl FnMut() -> Result<(), E>) -> Result<(), E> {
        self.capturer.pull.strength = 0.0;
        for (t, target) in self.bends.smoothed(&self.shapes).iter().enumerate() {
            between()?;
            self.descend(points(target), t);
        }
        Ok(())
    }

    /// Frame `t` with its neighbours held.
    fn turn(&mut self, t: usize) {
        let (target, _) = self.aim(t);
        self.descend(points(&target), t);
    }

    /// The shape that frame `t` is to capture, and how many times its error counts; the weights that are wished for go into the capturer.
    fn aim(&mut self, t: usize) -> (Vec<f64>, f64) {
        let (mut target, mut count) = (self.shapes[t].clone(), 1.0);
        if let Some((price, wished)) = self.bends.towards(&self.path.points, t) {
            count += price;
            target.iter_mut().zip(wished).for_each(|(v, w)| *v = (*v + price * w) / count);
        }
        let (price, towards) = self.changes.towards(&self.path.weights, t).unwrap_or_default();
        self.capturer.pull = Pull { strength: self.unit * price / count, towards };
        (target, count)
    }

    fn descend(&mut self, target: &[[f64; 2]], t: usize) {
        let (state, ..) = self.capturer.descend(target, &self.path.weights[t], ROUNDS);
        self.path.points[t] = flat(&self.capturer.moved(&state));
        self.path.weights[t] = state.weights;
    }

    fn finish(&mut self, t: usize, capture: &mut Capture) {
        let (target, count) = self.aim(t);
        let state: State = self.capturer.refit(points(&target), self.path.weights[t].clone());
        let errors = std::mem::take(&mut capture.errors);
        *capture = self.capturer.finish(points(&self.shapes[t]), points(&target), count, state, errors, capture.converged);
    }
}
