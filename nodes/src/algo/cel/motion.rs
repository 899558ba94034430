//! How the drawings move: poses at chosen frames, the arcs between them, and a ball's bounces by gravity.

use crate::algo::raster::Affine;
use nalgebra::{Matrix2, Rotation2, Vector2};

/// Where a layer is at a time, in design units from its reference drawing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    /// The map from the reference drawing's units to the 640×360 frame.
    pub(super) affine: Affine,
    /// The middle of its contact shadow, across.
    pub(super) shadow_x: f64,
    /// Its height above the ground, in design units.
    pub(super) lift: f64,
    /// The weights of its key shapes; they sum to 1.
    pub(super) keys: [f64; 3],
}

/// The hat's dance of 48 frames: frame, x, height, turn (degrees), stretch, lean. Anticipation, launch, apex, fall, squash, rebound; three hops.
const HAT: [[f64; 6]; 22] = [
    [0.0, 0.0, 0.0, 0.0, 0.78, 0.0],
    [2.0, 1.0, 11.0, 3.0, 1.10, 0.02],
    [4.0, 4.0, 0.0, 7.0, 0.74, 0.10],
    [6.0, -18.0, 34.0, -12.0, 1.24, -0.14],
    [8.0, -50.0, 72.0, -22.0, 1.08, -0.08],
    [10.0, -82.0, 78.0, -24.0, 0.98, -0.02],
    [12.0, -110.0, 42.0, -12.0, 1.16, 0.06],
    [14.0, -124.0, 0.0, 4.0, 0.68, 0.12],
    [16.0, -124.0, 14.0, 9.0, 1.13, 0.05],
    [18.0, -122.0, 0.0, 8.0, 0.90, -0.03],
    [20.0, -120.0, 0.0, 13.0, 0.66, -0.16],
    [22.0, -96.0, 50.0, 18.0, 1.30, 0.16],
    [24.0, -56.0, 100.0, 31.0, 1.10, 0.10],
    [27.0, 6.0, 124.0, 40.0, 0.97, 0.03],
    [30.0, 66.0, 98.0, 28.0, 1.04, -0.03],
    [32.0, 102.0, 48.0, 12.0, 1.20, -0.08],
    [34.0, 122.0, 0.0, -6.0, 0.64, -0.14],
    [36.0, 124.0, 17.0, -13.0, 1.15, -0.06],
    [38.0, 121.0, 0.0, -15.0, 0.74, 0.12],
    [40.0, 94.0, 44.0, -4.0, 1.22, -0.12],
    [43.0, 46.0, 62.0, 9.0, 1.0, -0.03],
    [46.0, 8.0, 24.0, 3.0, 1.15, 0.03],
];
const HAT_FRAMES: f64 = 48.0;
/// The lowest point of the hat's reference drawing, about which it squashes.
const HAT_PIVOT: Vector2<f64> = Vector2::new(0.0, 64.0);
/// The stage's mark.
const HAT_FLOOR: Vector2<f64> = Vector2::new(320.0, 300.0);

/// Radius of the ball's reference drawing.
pub(super) const BALL_RADIUS: f64 = 40.0;
const BALL_FLOOR: f64 = 306.0;
/// Where the ball comes in, how far it travels, and the frames in which its speed falls to 1/e.
const LEFT: f64 = 92.0;
const RUN: f64 = 425.0;
const TIME: f64 = 26.0;

/// The hat at a frame, which wraps round after 48; `deform` scales how far its weights leave the first key shape.
pub(super) fn hat(frame: f64, deform: f64) -> Pose {
    let [x, lift, turn, stretch, lean] = hat_channels(frame);
    let turn = Rotation2::new(turn.to_radians());
    let squash = Matrix2::new(1.0 / stretch.sqrt(), 0.0, 0.0, stretch);
    let linear = turn.matrix() * Matrix2::new(1.0, -lean, 0.0, 1.0) * squash;
    // The crown follows the body late: the overlap that keys draw.
    let late = hat_channels(frame - 2.0);
    let bend = (deform * 2.2 * late[4]).clamp(-1.0, 1.0);
    let keys = [1.0 - bend.abs(), bend.max(0.0), (-bend).max(0.0)];
    Pose { affine: about(linear, HAT_PIVOT, HAT_FLOOR + Vector2::new(x, -lift)), shadow_x: HAT_FLOOR.x + x, lift, keys }
}

/// The map with this linear part that takes `from` to `to`.
fn about(linear: Matrix2<f64>, from: Vector2<f64>, to: Vector2<f64>) -> Affine {
    let offset = to - linear * from;
    Affine::from_columns(&[linear.column(0).into(), linear.column(1).into(), offset])
}

/// The channels of the dance between its poses: cubic Hermite arcs with Catmull-Rom slopes, round the loop.
fn hat_channels(frame: f64) -> [f64; 5] {
    let frame = frame.rem_euclid(HAT_FRAMES);
    let n = HAT.len();
    let key = |i: usize| -> [f64; 6] {
        let mut key = HAT[i % n];
        key[0] += HAT_FRAMES * (i / n) as f64;
        key
    };
    // One whole loop is added so that the pose before the first exists.
    let i = n + HAT.iter().rposition(|k| k[0] <= frame).unwrap_or(0);
    let keys = [key(i - 1), key(i), key(i + 1), key(i + 2)];
    let t = (frame + HAT_FRAMES - keys[1][0]) / (keys[2][0] - keys[1][0]);
    std::array::from_fn(|c| hermite(&keys, c + 1, t))
}

fn hermite(keys: &[[f64; 6]; 4], c: usize, t: f64) -> f64 {
    let span = keys[2][0] - keys[1][0];
    let slope = |a: &[f64; 6], b: &[f64; 6]| (b[c] - a[c]) / (b[0] - a[0]);
    let (m0, m1) = (slope(&keys[0], &keys[2]) * span, slope(&keys[1], &keys[3]) * span);
    let (t2, t3) = (t * t, t * t * t);
    (2.0 * t3 - 3.0 * t2 + 1.0) * keys[1][c] + (t3 - 2.0 * t2 + t) * m0 + (3.0 * t2 - 2.0 * t3) * keys[2][c] + (t3 - t2) * m1
}

/// The ball at a frame: it falls in from the left, bounces lower and quicker by gravity, rolls and settles; 72 frames until it rests.
pub(super) fn ball(frame: f64) -> Pose {
    let bounce = bounce_at(frame.max(0.0));
    let ease = libm::exp(-frame.max(0.0) / TIME);
    let x = LEFT + RUN * (1.0 - ease);
    let speed = Vector2::new(RUN / TIME * ease, bounce.fall);
    let spin = Rotation2::new((x - LEFT) / BALL_RADIUS * 0.8);
    let along = Rotation2::new(libm::atan2(speed.y, speed.x));
    let stretch = 1.0 + 0.30 * (1.0 - libm::exp(-bounce.fall * bounce.fall / 600.0)) * (1.0 - bounce.contact);
    let smear = along.matrix() * Matrix2::new(stretch, 0.0, 0.0, 1.0 / stretch) * along.matrix().transpose();
    let flat = 1.0 - 0.30 * bounce.contact * bounce.strength;
    let squash = Matrix2::new(1.0 / flat, 0.0, 0.0, flat);
    let linear = squash * smear * spin.matrix();
    // The extent below the middle of a circle under a linear map is the length of the map's lower row.
    let reach = BALL_RADIUS * (linear[(1, 0)] * linear[(1, 0)] + linear[(1, 1)] * linear[(1, 1)]).sqrt();
    let middle = Vector2::new(x, BALL_FLOOR - bounce.height - reach);
    Pose { affine: about(linear, Vector2::zeros(), middle), shadow_x: x, lift: bounce.height, keys: [1.0, 0.0, 0.0] }
}

struct Bounce {
    height: f64,
    /// Velocity down, design units a frame.
    fall: f64,
    /// 1 in the moment of contact, 0 in flight.
    contact: f64,
    /// 1 at the first contact, less with each.
    strength: f64,
}

/// Ballistic arcs of falling height between contacts of two frames.
fn bounce_at(frame: f64) -> Bounce {
    const GRAVITY: f64 = 2.6;
    const KEEP: f64 = 0.5;
    const TOUCH: f64 = 2.0;
    // Time since the apex from which the first fall comes.
    let (mut height, mut start) = (205.0, 0.0);
    let mut half = (2.0f64 * height / GRAVITY).sqrt();
    let mut rising = 0.0;
    for k in 0..12 {
        let strength = (height / 205.0f64).sqrt();
        let time = frame - start;
        if time < half + rising {
            let from_apex = time - rising;
            return Bounce { height: height - 0.5 * GRAVITY * from_apex * from_apex, fall: GRAVITY * from_apex, contact: 0.0, strength };
        }
        let touch = time - half - rising;
        let hold = TOUCH * (0.4 + 0.6 * strength);
        if touch < hold {
            let contact = libm::sin(std::f64::consts::PI * (0.18 + 0.7 * touch / hold));
            return Bounce { height: 0.0, fall: 0.0, contact, strength };
        }
        start += half + rising + hold;
        height *= KEEP * if k > 3 { 0.6 } else { 1.0 };
        half = (2.0 * height / GRAVITY).sqrt();
        rising = half;
    }
    // At rest it breathes out once more.
    let wobble = libm::exp(-(frame - start) / 5.0) * libm::sin((frame - start) * 0.9) * 0.25;
    Bounce { height: 0.0, fall: 0.0, contact: wobble.max(0.0), strength: 0.4 }
}

/// A key shape of the hat: the drawing itself, its crown bent to the right, and its crown bent to the left; `p` in design units.
pub(super) fn hat_key(k: usize, p: kurbo::Point) -> kurbo::Point {
    let up = ((40.0 - p.y) / 100.0).max(0.0);
    match k {
        1 => kurbo::Point::new(p.x + 34.0 * up * up, p.y + 9.0 * up * up),
        2 => kurbo::Point::new(p.x - 34.0 * up * up, p.y + 7.0 * up * up),
        _ => p,
    }
}
