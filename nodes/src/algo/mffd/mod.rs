//! Free-form deformation of the plane through scattered points, in levels of uniform cubic B-splines.
//!
//! **Source** Lee, Chwa, Hahn, Shin, *Image metamorphosis using snakes and free-form deformations*, SIGGRAPH 1995, sections 3 to 5 (levels one after
//! another, none of which folds); Choi, Lee, *Injectivity conditions of 2D and 3D uniform cubic B-spline functions*, Graphical Models 62, 2000; Lee, Wolberg,
//! Shin, *Scattered data interpolation with multilevel B-splines*, IEEE TVCG 3(3), 1997 (levels added up); Li, Gleicher, Xu, Shum 2003, section 3.4.
//!
//! A level moves a point by w(p) = p + sum_kl B_k(s) B_l(t) d_(i+k)(j+l). For points p_c that are to move by r_c each control point takes
//! d = sum_c g_c w_c² f_c / sum_c g_c w_c², with f_c = w_c r_c / sum w² and g_c the point's own weight.

mod grid;
mod level;

use level::Level;
use pegbar_engine::Setting;

/// Largest move of a control point, in spacings, at which a level folds nowhere: below 1 / 2.046392675 of Choi and Lee, as Lee et al. 1995 have it.
pub const BOUND: f64 = 0.48;
/// Compositions after which a fit is given up.
const MOST: usize = 400;
/// Control points of one level, at most.
const LARGEST: f64 = 16e6;

/// A place that is to come to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Datum {
    /// Where it is, pixels.
    pub from: [f64; 2],
    /// Where it is to be.
    pub to: [f64; 2],
    /// How much it counts where others want something else: 0 not at all.
    pub weight: f64,
}

/// How levels work together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Combine {
    /// One after another, each of which folds nowhere: nor does the whole.
    Composed,
    /// Added up, as by Lee, Wolberg, Shin 1997: it folds where points ask for it.
    Added,
}

/// How fine, how often, how well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// How levels work together.
    pub combine: Combine,
    /// Cells of the first level, across and down; each further level has twice as many.
    pub cells: [usize; 2],
    /// Levels, at most. A level of more than sixteen million control points is the last.
    pub levels: usize,
    /// Times that a level is composed while its moves had to be cut short, at most; the last level while there is a rest.
    pub repeats: usize,
    /// Distance at which a point is where it should be, pixels.
    pub tolerance: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { combine: Combine::Composed, cells: [4, 4], levels: 10, repeats: 8, tolerance: 1e-6 }
    }
}

/// What keeps points from being fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// NaN, infinity, or a weight below nought.
    #[error("point {at}: expected finite places and a weight of at least 0, found {:?} to {:?} with {}", found.from, found.to, found.weight)]
    Datum {
        /// The point, from 0.
        at: usize,
        /// What it is.
        found: Datum,
    },
    /// A rectangle without an area.
    #[error("expected a rectangle of left < right and top < bottom, found {found:?}")]
    Domain {
        /// Left, top, right, bottom.
        found: [f64; 4],
    },
    /// No cells or levels.
    #[error("expected at least one cell each way, one level and one repeat, found {cells:?}, {levels} and {repeats}")]
    Options {
        /// Of the first level.
        cells: [usize; 2],
        /// Levels.
        levels: usize,
        /// Repeats.
        repeats: usize,
    },
}

/// A deformation of the plane; far outside of its rectangle nothing moves.
#[derive(Clone, Debug)]
pub struct Ffd {
    combine: Combine,
    levels: Vec<Level>,
}

/// How well a fit went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fit {
    /// How far each point is from where it should be, pixels.
    pub residuals: Vec<f64>,
    /// Control lattices that were composed, or added.
    pub steps: usize,
}

impl Fit {
    /// The worst of the residuals.
    pub fn worst(&self) -> f64 {
        self.residuals.iter().copied().fold(0.0, f64::max)
    }
}

impl Ffd {
    /// Fits points within a rectangle `[left, top, right, bottom]`; points outside of it count as far as the border's cells reach.
    ///
    /// Where points ask for what folds, composed levels come as near as they may, and the rest stays in the residuals. Cost: O(points · levels · repeats).
    ///
    /// # Errors
    /// Where a number is not finite, or there is no cell.
    pub fn fit(data: &[Datum], domain: [f64; 4], options: &Options) -> Result<(Self, Fit), FitError> {
        check(data, domain, options)?;
        let mut fitting = Fitting { data, at: data.iter().map(|d| d.from).collect(), levels: Vec::new(), options };
        let mut cells = options.cells;
        for level in 0..options.levels {
            let size: f64 = cells.iter().map(|&n| (n + 3) as f64).product();
            if level > 0 && size > LARGEST || fitting.is_done() {
                break;
            }
            match options.combine {
                Combine::Composed => fitting.compose(&Level::new(domain, cells), level + 1 == options.levels),
                Combine::Added => fitting.add(Level::new(domain, cells)),
            }
            cells = cells.map(|n| n * 2);
        }
        let fit = Fit { residuals: fitting.residuals().map(length).collect(), steps: fitting.levels.len() };
        Ok((Self { combine: options.combine, levels: fitting.levels }, fit))
    }

    /// Where a point comes to. A point that is not finite stays what it is.
    pub fn warp(&self, p: [f64; 2]) -> [f64; 2] {
        match self.combine {
            Combine::Composed => self.levels.iter().fold(p, |p, level| moved(p, level.displacement(p))),
            Combine::Added => self.levels.iter().fold(p, |sum, level| moved(sum, level.displacement(p))),
        }
    }

    /// Where a point comes to, and the determinant of the derivative there: how much an area around it grows; at most 0 where it folds.
    pub fn warp_and_growth(&self, p: [f64; 2]) -> ([f64; 2], f64) {
        let composed = self.combine == Combine::Composed;
        let (mut at, mut growth, mut sum) = (p, 1.0, [[1.0, 0.0], [0.0, 1.0]]);
        for level in &self.levels {
            let (by, [[a, b], [c, d]]) = level.derivative(if composed { at } else { p });
            at = moved(at, by);
            growth *= (1.0 + a) * (1.0 + d) - b * c;
            sum = [[sum[0][0] + a, sum[0][1] + b], [sum[1][0] + c, sum[1][1] + d]];
        }
        (at, if composed { growth } else { sum[0][0] * sum[1][1] - sum[0][1] * sum[1][0] })
    }

    /// The least growth at `n` by `n` points of a rectangle `[left, top, right, bottom]`, its border among them.
    pub fn least_growth(&self, [left, top, right, bottom]: [f64; 4], n: usize) -> f64 {
        let step = |k: usize| k as f64 / n.saturating_sub(1).max(1) as f64;
        let place = |k: usize| [left + step(k % n) * (right - left), top + step(k / n) * (bottom - top)];
        (0..n * n).map(|k| self.warp_and_growth(place(k)).1).fold(f64::INFINITY, f64::min)
    }

    /// Control lattices.
    pub fn steps(&self) -> usize {
        self.levels.len()
    }
}

fn moved(p: [f64; 2], by: [f64; 2]) -> [f64; 2] {
    [p[0] + by[0], p[1] + by[1]]
}

fn length([x, y]: [f64; 2]) -> f64 {
    libm::hypot(x, y)
}

fn check(data: &[Datum], domain: [f64; 4], options: &Options) -> Result<(), FitError> {
    let fine = |d: &Datum| d.from.iter().chain(&d.to).all(|v| v.abs() < 1e150) && d.weight >= 0.0 && d.weight < 1e150;
    if let Some(at) = data.iter().position(|d| !fine(d)) {
        return Err(FitError::Datum { at, found: data[at] });
    }
    let [left, top, right, bottom] = domain;
    if !(left < right && top < bottom && domain.iter().all(|v| v.abs() < 1e150)) {
        return Err(FitError::Domain { found: domain });
    }
    let Options { cells, levels, repeats, .. } = *options;
    let size: f64 = cells.iter().map(|&n| (n + 3) as f64).product();
    if cells.contains(&0) || levels == 0 || repeats == 0 || size > LARGEST {
        return Err(FitError::Options { cells, levels, repeats });
    }
    Ok(())
}

/// Points on their way.
struct Fitting<'a> {
    data: &'a [Datum],
    at: Vec<[f64; 2]>,
    levels: Vec<Level>,
    options: &'a Options,
}

impl Fitting<'_> {
    fn residuals(&self) -> impl Iterator<Item = [f64; 2]> {
        self.data.iter().zip(&self.at).map(|(d, p)| [d.to[0] - p[0], d.to[1] - p[1]])
    }

    fn worst(&self) -> f64 {
        self.counted().map(length).fold(0.0, f64::max)
    }

    /// Residuals of the points that count.
    fn counted(&self) -> impl Iterator<Item = [f64; 2]> {
        self.residuals().zip(self.data).filter(|(_, d)| d.weight > 0.0).map(|(r, _)| r)
    }

    fn is_done(&self) -> bool {
        self.levels.len() >= MOST || self.worst() <= self.options.tolerance
    }

    /// The control points' moves that bring the points nearer, where they stand or where they came from.
    fn approximate(&self, places: impl Iterator<Item = [f64; 2]>, empty: &Level) -> Level {
        let rows = places.zip(self.residuals()).zip(self.data).map(|((p, r), d)| (p, r, d.weight));
        empty.approximate(rows)
    }

    /// Composes a level until it need not be cut short any more, or that does not help; the last one as long as it helps.
    fn compose(&mut self, empty: &Level, is_last: bool) {
        let mut before = f64::INFINITY;
        for _ in 0..self.options.repeats {
            let sum: f64 = self.counted().map(|[x, y]| x * x + y * y).sum();
            // What cannot be met without a fold comes nearer by less and less.
            if self.is_done() || sum > before * 0.98 {
                return;
            }
            before = sum;
            let mut level = self.approximate(self.at.iter().copied(), empty);
            let is_cut = level.limit(BOUND);
            self.at.iter_mut().for_each(|p| *p = moved(*p, level.displacement(*p)));
            self.levels.push(level);
            if !is_cut && !is_last {
                return;
            }
        }
    }

    /// Adds a level.
    fn add(&mut self, empty: Level) {
        let level = self.approximate(self.data.iter().map(|d| d.from), &empty);
        self.at.iter_mut().zip(self.data).for_each(|(p, d)| *p = moved(*p, level.displacement(d.from)));
        self.levels.push(level);
    }
}

#[cfg(test)]
mod tests;
