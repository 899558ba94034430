//! Contours with one number of points in one order over time.
//!
//! Bregler, Loeb, Chuang, Deshpande 2002 take contours as "the same points in the same order" (section 3.2) and do not say how they come
//! about. Here points stand at equal steps along the contour, between labelled anchors where there are some. Without anchors a contour is
//! turned to begin where the one before it does, by the least squared distance, and on request its steps are stretched to follow the
//! other's corners: the cheapest monotone matching of place and tangent from one of the best beginnings (cyclic dynamic time warping,
//! Sakoe, Chiba 1978, with a price on stretching).

use super::fit_affine::{FitError, area, centroid, finite};

/// Why a contour cannot be resampled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ResampleError {
    /// There are no points, or one is not finite.
    #[error(transparent)]
    Points(#[from] FitError),
    /// There are fewer new points than stretches between anchors.
    #[error("expected at least as many points as anchors, {anchors}, found {count}")]
    Few {
        /// Anchors.
        anchors: usize,
        /// Points asked for.
        count: usize,
    },
    /// An anchor is not finite.
    #[error("expected finite anchors, found anchor {at} at ({x}, {y})")]
    Anchor {
        /// Position, from 0.
        at: usize,
        /// Its x.
        x: f64,
        /// Its y.
        y: f64,
    },
}

/// A contour by its length: places are distances along it from its first point, in pixels.
#[derive(Clone, Debug)]
pub struct Line {
    points: Vec<[f64; 2]>,
    /// Place of each point; the last is the whole length.
    places: Vec<f64>,
    closed: bool,
}

fn distance_sq(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

impl Line {
    /// # Errors
    /// No points, or one that is not finite.
    pub fn new(points: &[[f64; 2]], closed: bool) -> Result<Self, ResampleError> {
        let Some(first) = points.first() else { return Err(FitError::Empty.into()) };
        finite(points)?;
        let mut points = points.to_vec();
        if closed {
            points.push(*first);
        }
        let mut places = vec![0.0];
        let mut length = 0.0;
        for p in points.windows(2) {
            length += distance_sq(p[0], p[1]).sqrt();
            places.push(length);
        }
        Ok(Self { points, places, closed })
    }

    /// The whole length.
    pub fn length(&self) -> f64 {
        self.places.last().copied().unwrap_or_default()
    }

    /// The point at a place; places beyond the ends go round a closed contour and stop at the ends of an open one.
    pub fn at(&self, place: f64) -> [f64; 2] {
        let length = self.length();
        if length <= 0.0 {
            return self.points[0];
        }
        let place = if self.closed { place - (place / length).floor() * length } else { place.clamp(0.0, length) };
        let i = self.places.partition_point(|p| *p <= place).clamp(1, self.points.len() - 1);
        let step = self.places[i] - self.places[i - 1];
        let t = if step > 0.0 { (place - self.places[i - 1]) / step } else { 0.0 };
        let (a, b) = (self.points[i - 1], self.points[i]);
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
    }

    /// The place nearest to a point.
    fn nearest(&self, point: [f64; 2]) -> f64 {
        let mut best = (f64::INFINITY, 0.0);
        for (i, p) in self.points.windows(2).enumerate() {
            let (d, length_sq) = ([p[1][0] - p[0][0], p[1][1] - p[0][1]], distance_sq(p[0], p[1]));
            let t = if length_sq > 0.0 { ((point[0] - p[0][0]) * d[0] + (point[1] - p[0][1]) * d[1]) / length_sq } else { 0.0 };
            let t = t.clamp(0.0, 1.0);
            let off = distance_sq(point, [p[0][0] + t * d[0], p[0][1] + t * d[1]]);
            if off < best.0 {
                best = (off, self.places[i] + t * (self.places[i + 1] - self.places[i]));
            }
        }
        best.1
    }

    /// `count` points at equal steps from a place on: all round a closed contour, from end to end of an open one.
    pub fn steps(&self, count: usize, start: f64) -> Vec<[f64; 2]> {
        let steps = if self.closed { count } else { count.saturating_sub(1) }.max(1);
        (0..count).map(|i| self.at(start + self.length() * i as f64 / steps as f64)).collect()
    }

    fn reversed(&self) -> Self {
        let length = self.length();
        Self {
            points: self.points.iter().rev().copied().collect(),
            places: self.places.iter().rev().map(|p| length - p).collect(),
            closed: self.closed,
        }
    }
}

/// As many points between each two anchors, at equal steps; the first ones get what is left over. A closed contour begins at the first
/// anchor and runs in the order of the anchors; an open one runs from its own first point to its last.
///
/// # Errors
/// Fewer points than anchors, or an anchor that is not finite.
pub fn between_anchors(line: &Line, anchors: &[[f64; 2]], count: usize) -> Result<Vec<[f64; 2]>, ResampleError> {
    if let Some(at) = anchors.iter().position(|a| !(a[0].is_finite() && a[1].is_finite())) {
        return Err(ResampleError::Anchor { at, x: anchors[at][0], y: anchors[at][1] });
    }
    if anchors.is_empty() {
        return Ok(line.steps(count, 0.0));
    }
    if count < anchors.len() {
        return Err(ResampleError::Few { anchors: anchors.len(), count });
    }
    let turned = if is_backward(line, anchors) { line.reversed() } else { line.clone() };
    Ok(if line.closed { around(&turned, anchors, count) } else { along(&turned, anchors, count) })
}

/// Whether the anchors come in the other order along the contour.
fn is_backward(line: &Line, anchors: &[[f64; 2]]) -> bool {
    let places: Vec<f64> = anchors.iter().map(|a| line.nearest(*a)).collect();
    let length = line.length();
    if !line.closed {
        return places.first() > places.last();
    }
    // The way round, summed over all pairs: once for the right order, once less than there are anchors for the other.
    let round = |a: f64, b: f64| if b >= a { b - a } else { b - a + length };
    let turns: f64 = (0..places.len()).map(|i| round(places[i], places[(i + 1) % places.len()])).sum();
    places.len() > 2 && turns > 1.5 * length
}

fn around(line: &Line, anchors: &[[f64; 2]], count: usize) -> Vec<[f64; 2]> {
    let mut places: Vec<f64> = anchors.iter().map(|a| line.nearest(*a)).collect();
    for i in 1..places.len() {
        // Anchors out of order stand where the one before them does.
        if places[i] < places[i - 1] {
            places[i] = if places[i] + line.length() <= places[0] + line.length() { places[i] + line.length() } else { places[i - 1] };
        }
    }
    places.push(places[0] + line.length());
    let n = anchors.len();
    (0..n).flat_map(|i| stretch(line, places[i], places[i + 1], count / n + usize::from(i < count % n))).collect()
}

fn along(line: &Line, anchors: &[[f64; 2]], count: usize) -> Vec<[f64; 2]> {
    let mut places = vec![0.0];
    places.extend(anchors.iter().map(|a| line.nearest(*a)));
    places.push(line.length());
    places.sort_by(f64::total_cmp);
    // The end is a point of its own.
    let (n, count) = (places.len() - 1, count.saturating_sub(1));
    let mut out: Vec<[f64; 2]> =
        (0..n).flat_map(|i| stretch(line, places[i], places[i + 1], count / n + usize::from(i < count % n))).collect();
    out.push(line.at(line.length()));
    out
}

fn stretch(line: &Line, from: f64, to: f64, count: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..count).map(move |i| line.at(from + (to - from) * i as f64 / count as f64))
}

/// How a contour follows another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// How far steps are stretched so that corners meet corners: 0 keeps equal steps, 1 is usual, large ones follow at any price.
    pub elastic: f64,
    /// Whether the drawing may have turned against the other by any angle; else it is matched as it stands.
    pub turned: bool,
}

/// Places that are tried for the beginning, for each point of the other contour; then the best is refined.
const FINER: usize = 4;
/// Most beginnings that are matched to the end.
const BEGINNINGS: usize = 4;
/// Beginnings that fit less well than this share of the best are not matched.
const NEARLY: f64 = 0.8;

/// The contour in as many points as `other`, which it follows: in the same direction, beginning where it does, and stretched along itself.
/// O(points²).
///
/// Contours are compared about their centres, so that a move of the whole drawing changes nothing. Of a closed contour all beginnings are
/// tried by the product of the places; the best few are matched to the end by place and tangent, and the cheapest matching stays.
pub fn following(line: &Line, other: &[[f64; 2]], how: Following) -> Vec<[f64; 2]> {
    let count = other.len();
    if count < 3 || line.length() <= 0.0 {
        return line.steps(count, 0.0);
    }
    let flipped = if line.closed { area(&line.points) * area(other) < 0.0 } else { ends_swapped(line, other) };
    let line = if flipped { line.reversed() } else { line.clone() };
    let starts = if line.closed { beginnings(&line, other, how.turned) } else { vec![upright(&line, other, how.turned)] };
    let Some(first) = starts.first().filter(|_| how.elastic <= 0.0) else { return cheapest(&line, other, &starts, how.elastic) };
    line.steps(count, first.place)
}

fn ends_swapped(line: &Line, other: &[[f64; 2]]) -> bool {
    let error = |points: &[[f64; 2]]| points.iter().zip(other).map(|(a, b)| distance_sq(*a, *b)).sum::<f64>();
    let points = line.steps(other.len(), 0.0);
    error(&points) > error(&points.iter().rev().copied().collect::<Vec<_>>())
}

/// A place at which a contour may begin, and how the other is turned to it.
#[derive(Clone, Copy, Debug)]
struct Beginning {
    place: f64,
    cos: f64,
    sin: f64,
}

impl Beginning {
    /// From the sums of products and of cross products of points that belong together.
    fn new(place: f64, [dot, cross]: [f64; 2], turned: bool) -> Self {
        let length = libm::hypot(dot, cross);
        let (cos, sin) = if turned && length > 0.0 { (dot / length, cross / length) } else { (1.0, 0.0) };
        Self { place, cos, sin }
    }
}

fn about_centre(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let c = centroid(points);
    points.iter().map(|p| [p[0] - c[0], p[1] - c[1]]).collect()
}

/// Sums of products and of cross products.
fn products(from: &[[f64; 2]], to: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    from.iter().zip(to).fold([0.0; 2], |s, (q, p)| [s[0] + (p[0] * q[0] + p[1] * q[1]), s[1] + (q[0] * p[1] - q[1] * p[0])])
}

/// The beginning of an open contour.
fn upright(line: &Line, other: &[[f64; 2]], turned: bool) -> Beginning {
    let points = about_centre(&line.steps(other.len(), 0.0));
    Beginning::new(0.0, products(&about_centre(other), points.into_iter()), turned)
}

/// The places at which equal steps lie nearest to the other contour's points, the best first.
fn beginnings(line: &Line, other: &[[f64; 2]], turned: bool) -> Vec<Beginning> {
    let (fine, other) = (about_centre(&line.steps(FINER * other.len(), 0.0)), about_centre(other));
    let n = fine.len();
    // The squares add up to the same from any place, or nearly: what differs is the product.
    let sums: Vec<[f64; 2]> = (0..n).map(|s| products(&other, (0..other.len()).map(|i| fine[(s + FINER * i) % n]))).collect();
    let fits: Vec<f64> = sums.iter().map(|s| if turned { libm::hypot(s[0], s[1]) } else { s[0] }).collect();
    let around = |s: usize| [fits[(s + n - 1) % n], fits[s], fits[(s + 1) % n]];
    let mut tops: Vec<usize> = (0..n).filter(|&s| around(s)[1] > around(s)[0] && around(s)[1] >= around(s)[2]).collect();
    tops.sort_by(|a, b| fits[*b].total_cmp(&fits[*a]).then(a.cmp(b)));
    let least = tops.first().map_or(f64::NEG_INFINITY, |s| NEARLY * fits[*s]);
    tops.retain(|s| fits[*s] >= least);
    tops.truncate(BEGINNINGS);
    if tops.is_empty() {
        // All beginnings are alike: a circle, or points in one place.
        tops.push(0);
    }
    let place = |s: usize| {
        // The top of a parabola through the best and its neighbours.
        let [l, m, r] = around(s);
        let bend = l - 2.0 * m + r;
        let part = if bend < 0.0 { (0.5 * (l - r) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        (s as f64 + part) * line.length() / n as f64
    };
    tops.into_iter().map(|s| Beginning::new(place(s), sums[s], turned)).collect()
}

fn cheapest(line: &Line, other: &[[f64; 2]], starts: &[Beginning], elastic: f64) -> Vec<[f64; 2]> {
    let all = starts.iter().map(|start| matched(line, other, *start, elastic));
    all.reduce(|best, next| if next.0 < best.0 { next } else { best }).map_or_else(Vec::new, |best| best.1)
}

/// Longest step, in fine steps; the usual one is [`FINER`].
const LONGEST: usize = 3 * FINER;

/// The cheapest monotone matching of the other contour's points to fine steps, and what it costs.
fn matched(line: &Line, other: &[[f64; 2]], start: Beginning, elastic: f64) -> (f64, Vec<[f64; 2]>) {
    let count = other.len();
    let (steps, closed) = (if line.closed { count } else { count - 1 }, line.closed);
    let n = FINER * steps;
    let fine: Vec<[f64; 2]> = (0..=n).map(|j| line.at(start.place + line.length() * j as f64 / n as f64)).collect();
    let turn = |p: &[f64; 2]| [start.cos * p[0] - start.sin * p[1], start.sin * p[0] + start.cos * p[1]];
    let other = Drawn::new(&other.iter().map(turn).collect::<Vec<_>>(), 1, closed);
    let own = Drawn::new(&fine, FINER, closed);
    // A seventh of the way round counts as much as a right angle.
    let reach = (0.15 * line.length()).powi(2).max(f64::MIN_POSITIVE);
    // How far a point may be from its equal step: a sixth of the contour.
    let width = (n / 6).max(FINER);
    let (mut sums, mut from) = (vec![vec![f64::INFINITY; n + 1]; steps + 1], vec![vec![0usize; n + 1]; steps + 1]);
    sums[0][0] = 0.0;
    let stretch: Vec<f64> = (0..=LONGEST).map(|s| (s as f64 / FINER as f64 - 1.0).powi(2) / elastic * 0.05).collect();
    for i in 1..=steps {
        for j in (FINER * i).saturating_sub(width)..=(FINER * i + width).min(n) {
            let here = own.unlike(j, &other, i % count, reach);
            for s in 1..=LONGEST.min(j) {
                let sum = sums[i - 1][j - s] + stretch[s] + here;
                if sum < sums[i][j] {
                    (sums[i][j], from[i][j]) = (sum, s);
                }
            }
        }
    }
    let mut at = n;
    let mut places = vec![0; steps + 1];
    for i in (1..=steps).rev() {
        places[i] = at;
        at -= from[i][at];
    }
    places.truncate(count);
    let points = softened(&places, n, closed).iter().map(|j| line.at(start.place + line.length() * j / n as f64)).collect();
    (sums[steps][n], points)
}

/// Steps averaged over their neighbours: whole fine steps are coarse.
fn softened(places: &[usize], n: usize, closed: bool) -> Vec<f64> {
    let k = places.len();
    let at = |i: isize| -> f64 {
        let turn = i.div_euclid(k as isize);
        places[i.rem_euclid(k as isize) as usize] as f64 + turn as f64 * n as f64
    };
    let soft = |i: usize| {
        let i = i as isize;
        0.0625 * (at(i - 2) + at(i + 2)) + 0.25 * (at(i - 1) + at(i + 1)) + 0.375 * at(i)
    };
    (0..k).map(|i| if closed || (i > 1 && i + 2 < k) { soft(i) } else { places[i] as f64 }).collect()
}

/// Points about their first, which is matched already, and the tangents there.
struct Drawn {
    points: Vec<[f64; 2]>,
    tangents: Vec<[f64; 2]>,
}

impl Drawn {
    /// Tangents reach over so many points on either side.
    fn new(points: &[[f64; 2]], reach: usize, closed: bool) -> Self {
        let n = points.len();
        let tangent = |at: usize| {
            let (a, b) =
                if closed { ((at + n - reach) % n, (at + reach) % n) } else { (at.saturating_sub(reach), (at + reach).min(n - 1)) };
            let d = [points[b][0] - points[a][0], points[b][1] - points[a][1]];
            let length = libm::hypot(d[0], d[1]);
            if length > 0.0 { [d[0] / length, d[1] / length] } else { [0.0; 2] }
        };
        let first = points.first().copied().unwrap_or_default();
        Self { points: points.iter().map(|p| [p[0] - first[0], p[1] - first[1]]).collect(), tangents: (0..n).map(tangent).collect() }
    }

    /// How unlike two points are: their tangents, and their places in units of a squared reach.
    fn unlike(&self, j: usize, other: &Self, i: usize, reach: f64) -> f64 {
        let (t, u) = (self.tangents[j], other.tangents[i]);
        (1.0 - (t[0] * u[0] + t[1] * u[1])) + distance_sq(self.points[j], other.points[i]) / reach
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEPS: Following = Following { elastic: 0.0, turned: false };
    const USUAL: Following = Following { elastic: 1.0, turned: false };

    fn square() -> Vec<[f64; 2]> {
        vec![[10.0, 10.0], [50.0, 10.0], [50.0, 50.0], [10.0, 50.0]]
    }

    /// A blob with a nose, so that no turn of it is like another.
    fn blob(n: usize) -> Vec<[f64; 2]> {
        (0..n)
            .map(|i| {
                let t = i as f64 / n as f64 * std::f64::consts::TAU;
                let r = 60.0 + 40.0 * libm::exp(-8.0 * (t - 1.0) * (t - 1.0)) + 6.0 * libm::cos(3.0 * t);
                [200.0 + r * libm::cos(t), 150.0 + r * libm::sin(t)]
            })
            .collect()
    }

    fn worst(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
        a.iter().zip(b).map(|(p, q)| distance_sq(*p, *q).sqrt()).fold(0.0, f64::max)
    }

    #[test]
    fn steps_are_equal_and_start_where_they_should() {
        let line = Line::new(&square(), true).unwrap();
        assert_eq!(line.length(), 160.0);
        assert_eq!(
            line.steps(8, 0.0),
            [[10.0, 10.0], [30.0, 10.0], [50.0, 10.0], [50.0, 30.0], [50.0, 50.0], [30.0, 50.0], [10.0, 50.0], [10.0, 30.0]]
        );
        let open = Line::new(&square(), false).unwrap();
        assert_eq!(open.steps(4, 0.0), square());
        assert_eq!(open.steps(1, 0.0), [[10.0, 10.0]]);
    }

    #[test]
    fn anchors_are_points_whatever_the_direction() {
        let anchors = [[49.0, 8.0], [51.0, 52.0], [9.0, 51.0]];
        let backward: Vec<_> = square().into_iter().rev().collect();
        for points in [square(), backward] {
            let found = between_anchors(&Line::new(&points, true).unwrap(), &anchors, 10).unwrap();
            assert_eq!(found.len(), 10);
            // 10 points in three stretches: four, three, three.
            assert!(worst(&[found[0], found[4], found[7]], &[[49.0, 10.0], [50.0, 50.0], [10.0, 50.0]]) < 1.0 + 1e-9, "{found:?}");
        }
        let open = between_anchors(&Line::new(&square(), false).unwrap(), &[[50.0, 10.0]], 5).unwrap();
        assert_eq!(
            open,
            [[10.0, 10.0], [30.0, 10.0], [50.0, 10.0], [30.0, 50.0], [10.0, 50.0]].map(|p| if p == [30.0, 50.0] {
                [50.0, 50.0]
            } else {
                p
            })
        );
    }

    proptest! {
        #[test]
        fn the_start_and_the_direction_of_a_contour_do_not_matter(turn in 0usize..400, back in any::<bool>(), dx in -50.0f64..50.0) {
            let other = Line::new(&blob(400), true).unwrap().steps(100, 0.0);
            let mut points = blob(400);
            points.rotate_left(turn);
            if back {
                points.reverse();
            }
            points.iter_mut().for_each(|p| p[0] += dx);
            let expected: Vec<_> = other.iter().map(|p| [p[0] + dx, p[1]]).collect();
            let line = Line::new(&points, true).unwrap();
            prop_assert!(worst(&following(&line, &other, STEPS), &expected) < 0.6);
            prop_assert!(worst(&following(&line, &other, USUAL), &expected) < 2.0);
        }
    }

    #[test]
    fn stretched_steps_follow_a_corner_that_equal_steps_lose() {
        // A bar with a foot, that grows longer: with equal steps all its corners slip.
        let bar = |long: f64| vec![[0.0, 0.0], [long, 0.0], [long, 20.0], [20.0, 20.0], [20.0, 50.0], [0.0, 50.0]];
        let other = Line::new(&bar(100.0), true).unwrap().steps(120, 0.0);
        let line = Line::new(&bar(190.0), true).unwrap();
        let corner = |points: &[[f64; 2]], to: [f64; 2]| {
            (0..points.len()).min_by(|a, b| distance_sq(points[*a], to).total_cmp(&distance_sq(points[*b], to))).unwrap() as i64
        };
        let slip = |elastic: f64| -> i64 {
            let found = following(&line, &other, Following { elastic, turned: false });
            [([100.0, 0.0], [190.0, 0.0]), ([100.0, 20.0], [190.0, 20.0]), ([20.0, 20.0], [20.0, 20.0]), ([0.0, 50.0], [0.0, 50.0])]
                .iter()
                .map(|(a, b)| (corner(&other, *a) - corner(&found, *b)).abs())
                .max()
                .unwrap()
        };
        assert!(slip(1.0) <= 2 && slip(0.0) >= 6, "{} and {}", slip(1.0), slip(0.0));
    }

    proptest! {
        #[test]
        fn a_drawing_that_turned_is_followed(turn in 0usize..400, angle in -3.1f64..3.1, elastic in 0.0f64..2.0) {
            let other = Line::new(&blob(400), true).unwrap().steps(100, 0.0);
            let (s, c) = libm::sincos(angle);
            let turned = |p: &[f64; 2]| [c * p[0] - s * p[1] + 40.0, s * p[0] + c * p[1] - 9.0];
            let mut points: Vec<_> = blob(400).iter().map(turned).collect();
            points.rotate_left(turn);
            let expected: Vec<_> = other.iter().map(turned).collect();
            let found = following(&Line::new(&points, true).unwrap(), &other, Following { elastic, turned: true });
            prop_assert!(worst(&found, &expected) < 2.0, "{}", worst(&found, &expected));
        }
    }

    #[test]
    fn of_four_sides_the_one_with_the_notch_is_found() {
        // A square with a notch in one side, turned by a quarter and drawn from elsewhere: its places alone fit nearly as well in four
        // ways.
        let notched = vec![[0.0, 0.0], [45.0, 0.0], [50.0, 12.0], [55.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]];
        let other = Line::new(&notched, true).unwrap().steps(120, 0.0);
        let mut turned: Vec<[f64; 2]> = notched.iter().map(|[x, y]| [-y, *x]).collect();
        turned.rotate_left(5);
        let expected: Vec<_> = other.iter().map(|[x, y]| [-y, *x]).collect();
        let found = following(&Line::new(&turned, true).unwrap(), &other, Following { elastic: 1.0, turned: true });
        assert!(worst(&found, &expected) < 3.0, "{}", worst(&found, &expected));
    }

    #[test]
    fn degenerate_contours_are_answered() {
        let dot = Line::new(&[[3.0, 4.0]; 5], true).unwrap();
        assert_eq!(following(&dot, &square(), USUAL), [[3.0, 4.0]; 4]);
        assert_eq!(between_anchors(&dot, &square(), 6).unwrap(), [[3.0, 4.0]; 6]);
        let line = Line::new(&[[0.0, 0.0], [9.0, 0.0]], true).unwrap();
        assert!(following(&line, &square(), USUAL).iter().flatten().all(|v| v.is_finite()));
        let text = |e: ResampleError| e.to_string();
        assert_eq!(text(Line::new(&[], true).unwrap_err()), "expected a contour with points, found none");
        assert_eq!(text(Line::new(&[[0.0, f64::NAN]], true).unwrap_err()), "expected finite points, found (0, NaN) at point 0");
        assert_eq!(text(between_anchors(&line, &square(), 3).unwrap_err()), "expected at least as many points as anchors, 4, found 3");
    }
}
