//! Curves of a drawing between anchors: a path along the ink that no dead end can hold, then a snake that settles on it to a fraction of a pixel.
//!
//! **Source** Mortensen, Barrett, *Intelligent scissors for image composition*, 1995 (live-wire); Kass, Witkin, Terzopoulos, *Snakes: active contour
//! models*, 1988 (semi-implicit steps); Steger, *An unbiased detector of curvilinear structures*, 1998 (where a line's middle is within a pixel); Li,
//! Gleicher, Xu, Shum 2003, section 3.2 (curves of the drawing between anchors).

mod feature;
mod ink;
mod livewire;
mod snake;

pub use feature::{Feature, Field};
pub use ink::{Ink, InkStyle};
pub use livewire::livewire;
pub use snake::{Snake, polish};

use pegbar_engine::Setting;

/// How curves are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Method {
    /// The cheapest path along the ink.
    Livewire,
    /// Straight lines that are drawn to the ink.
    Snake,
    /// The path, polished as a snake.
    Both,
}

/// What of the ink the curve is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Along {
    /// The middle of a line.
    Center,
    /// The edge of a painted area, wherever ink and paper meet.
    Edge,
    /// The rim of a line that lies outside of what the curve goes around.
    Outside,
    /// The rim of a line that lies inside.
    Inside,
}

/// How one curve is traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// How.
    pub method: Method,
    /// What.
    pub along: Along,
    /// Width of the line, pixels; measured along the way where it is not said.
    pub width: Option<f64>,
    /// Ink from this on counts as ink.
    pub threshold: f64,
    /// How far an anchor may be moved to the ink, pixels; 0 leaves anchors where they are.
    pub snap: f64,
    /// How far the path may leave the box of two anchors, pixels.
    pub margin: f64,
    /// The snake.
    pub snake: Snake,
    /// From the last anchor back to the first.
    pub closed: bool,
    /// Share of each section that is to lie on ink, 0 to 1.
    pub least_on_ink: f64,
}

/// Sections of as many points, a pixel apart, may be gaps in the line and nothing else.
const GAP: usize = 8;

/// What keeps a curve from being traced.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// Too few anchors.
    #[error("expected at least {least} anchors, found {found}")]
    Few {
        /// As many as are needed.
        least: usize,
        /// As many as there are.
        found: usize,
    },
    /// An anchor that is nowhere.
    #[error("anchor {anchor}: expected a place within {width} x {height}, found ({}, {})", at[0], at[1])]
    Outside {
        /// Its number, from 1.
        anchor: usize,
        /// Where it is.
        at: [f64; 2],
        /// Columns of the picture.
        width: usize,
        /// Rows of the picture.
        height: usize,
    },
    /// An anchor without ink.
    #[error("anchor {anchor} at ({}, {}): expected ink within {snap} px, {}", at[0], at[1], nearest.map_or("found none at all".to_owned(), |d| format!("found the nearest {d:.1} px away")))]
    NoInk {
        /// Its number, from 1.
        anchor: usize,
        /// Where it is.
        at: [f64; 2],
        /// How far it may be moved.
        snap: f64,
        /// How far the nearest ink is.
        nearest: Option<f64>,
    },
    /// A section over paper.
    #[error("anchors {from} and {to}: expected {least} or more of the curve between them on ink, found {on_ink:.2}")]
    OffInk {
        /// The number of its first anchor, from 1.
        from: usize,
        /// The number of its second.
        to: usize,
        /// Share of it on ink.
        on_ink: f64,
        /// Share that is asked for.
        least: f64,
    },
    /// Two anchors at one place.
    #[error("anchors {0} and {1}: expected two places, found one", .anchor, .anchor + 1)]
    Same {
        /// The number of the first, from 1.
        anchor: usize,
    },
}

/// A curve that was traced.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traced {
    /// Its points, about a pixel apart; a closed one does not repeat its first.
    pub points: Vec<[f64; 2]>,
    /// Where the anchors came to lie on it.
    pub anchors: Vec<[f64; 2]>,
    /// Positions of the anchors among the points.
    pub at: Vec<usize>,
    /// Share of it that lies on ink, 0 to 1: less than 1 where it bridges gaps.
    pub on_ink: f64,
    /// Width of the line, pixels, as it was said or measured.
    pub width: f64,
}

/// The curve through anchors, in their order. Cost: O(pixels), and O(w log w) for each pair of anchors with w pixels in their window.
///
/// # Errors
/// [`TraceError`].
pub fn trace(ink: &Ink, anchors: &[[f64; 2]], options: &Options) -> Result<Traced, TraceError> {
    let snapped = snapped(ink, anchors, options)?;
    let pairs = pairs(&snapped, options.closed);
    if let Some(anchor) = pairs.iter().position(|[a, b]| a == b) {
        return Err(TraceError::Same { anchor: anchor + 1 });
    }
    let rough = Field::new(ink, if options.along == Along::Edge { Feature::Edge } else { Feature::Line }, 1.0);
    let wires: Vec<Vec<[f64; 2]>> = match options.method {
        Method::Snake => pairs.iter().map(|p| p.to_vec()).collect(),
        _ => pairs.iter().map(|p| livewire(&rough, *p, options.margin)).collect(),
    };
    let width = options.width.unwrap_or_else(|| ink.line_width(&wires.concat()));
    let field = match options.along {
        Along::Edge => rough,
        // A wide line is as dark all across; how far its paper is has one ridge, and blur would cut its corners.
        _ if width > 3.5 => Field::of(ink.depths(width), [ink.width, ink.height], Feature::Line, 1.0),
        _ => rough,
    };
    let ends: Vec<[f64; 2]> = snapped.iter().map(|&a| if options.snap > 0.0 { field.centred(a, 1.0 + width / 2.0) } else { a }).collect();
    let mut out = Traced { anchors: ends.clone(), width, ..Traced::default() };
    for (k, wire) in wires.into_iter().enumerate() {
        let [a, b] = [ends[k], ends[(k + 1) % ends.len()]];
        out.at.push(out.points.len());
        let mut points = section(wire, a, b, &field, ink, options);
        let on_ink = share_on_ink(ink, &points, options.threshold);
        if on_ink < options.least_on_ink && points.len() > GAP {
            return Err(TraceError::OffInk { from: k + 1, to: (k + 1) % ends.len() + 1, on_ink, least: options.least_on_ink });
        }
        points.pop();
        out.points.extend(points);
    }
    if !options.closed {
        out.at.push(out.points.len());
        out.points.extend(ends.last());
    }
    out.on_ink = share_on_ink(ink, &out.points, options.threshold);
    if matches!(options.along, Along::Outside | Along::Inside) {
        to_rim(ink, &mut out, width, options);
    }
    Ok(out)
}

fn pairs(anchors: &[[f64; 2]], closed: bool) -> Vec<[[f64; 2]; 2]> {
    let n = anchors.len();
    (0..if closed { n } else { n - 1 }).map(|k| [anchors[k], anchors[(k + 1) % n]]).collect()
}

/// Anchors at the nearest ink.
fn snapped(ink: &Ink, anchors: &[[f64; 2]], options: &Options) -> Result<Vec<[f64; 2]>, TraceError> {
    let least = if options.closed { 3 } else { 2 };
    if anchors.len() < least {
        return Err(TraceError::Few { least, found: anchors.len() });
    }
    let snap = |(k, &at): (usize, &[f64; 2])| {
        let (anchor, [width, height]) = (k + 1, [ink.width, ink.height]);
        let inside = at[0] >= 0.0 && at[1] >= 0.0 && at[0] <= width as f64 && at[1] <= height as f64;
        if !inside {
            return Err(TraceError::Outside { anchor, at, width, height });
        }
        if options.snap <= 0.0 {
            return Ok(at);
        }
        let (there, far) = ink.nearest(at).ok_or(TraceError::NoInk { anchor, at, snap: options.snap, nearest: None })?;
        if far > options.snap {
            return Err(TraceError::NoInk { anchor, at, snap: options.snap, nearest: Some(far) });
        }
        Ok(if far == 0.0 { at } else { there })
    };
    anchors.iter().enumerate().map(snap).collect()
}

/// One section from anchor to anchor, both at its ends.
fn section(mut wire: Vec<[f64; 2]>, a: [f64; 2], b: [f64; 2], field: &Field, ink: &Ink, options: &Options) -> Vec<[f64; 2]> {
    if let Some(first) = wire.first_mut() {
        *first = a;
    }
    if let Some(last) = wire.last_mut() {
        *last = b;
    }
    match options.method {
        Method::Livewire => wire,
        Method::Snake => polish(snake::spread(&wire, 1.0), field, Some(ink), &options.snake),
        Method::Both => polish(snake::spread(&wire, 1.0), field, None, &options.snake),
    }
}

fn share_on_ink(ink: &Ink, points: &[[f64; 2]], threshold: f64) -> f64 {
    let on = points.iter().filter(|p| ink.around(**p) >= threshold).count();
    on as f64 / points.len().max(1) as f64
}

/// Moves a curve from the middle of its line to one of its rims, where ink falls to the threshold.
fn to_rim(ink: &Ink, out: &mut Traced, width: f64, options: &Options) {
    let n = out.points.len();
    let area: f64 = (0..n).map(|i| (out.points[i], out.points[(i + 1) % n])).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
    // With y down a curve of positive area runs clockwise on the screen, and its outside is on its left: (dy, −dx).
    let side = if (area > 0.0) == (options.along == Along::Outside) { 1.0 } else { -1.0 };
    let old = out.points.clone();
    let mut offsets: Vec<f64> = Vec::with_capacity(n);
    let normal = |i: usize| {
        let span = 3;
        let (a, b) = if options.closed {
            (old[(i + n - span.min(n - 1)) % n], old[(i + span) % n])
        } else {
            (old[i.saturating_sub(span)], old[(i + span).min(n - 1)])
        };
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let length = libm::hypot(dx, dy).max(1e-12);
        [side * dy / length, -side * dx / length]
    };
    for (i, p) in old.iter().enumerate() {
        let d = normal(i);
        let value = |s: f64| ink.at([p[0] + d[0] * s, p[1] + d[1] * s]);
        let (mut s, step) = (0.0, 0.25);
        while s < width && value(s + step) >= options.threshold {
            s += step;
        }
        let (here, there) = (value(s), value(s + step));
        let within = if here > there { ((here - options.threshold) / (here - there)).clamp(0.0, 1.0) } else { 0.0 };
        offsets.push(s + step * within);
    }
    // A blot or a crossing line is no rim: the middle of the neighbours says.
    let middle = |i: usize| {
        let mut near: Vec<f64> = (0..7).filter_map(|k| offsets.get((i + k).checked_sub(3)?)).copied().collect();
        near.sort_by(f64::total_cmp);
        near[near.len() / 2]
    };
    for i in 0..n {
        let (d, s) = (normal(i), middle(i));
        out.points[i] = [old[i][0] + d[0] * s, old[i][1] + d[1] * s];
    }
    out.anchors = out.at.iter().filter_map(|&i| out.points.get(i).copied()).collect();
}

#[cfg(test)]
mod tests;
