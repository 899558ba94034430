//! A pose, with lengths and scales of its bones, that is seen as it is drawn: Levenberg and Marquardt's method on joints and outline.
//!
//! Unknown are the root's place, each joint's turn from its start (a rotation vector), and the logarithms of each bone's length and scale. All derivatives
//! are exact: each unknown moves the world of the joints below it by a generator G, dW = G W.
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, section 3.1 (its pose edits, which were made by hand: root, angles, segment lengths, scales of bones); Marquardt
//! 1963; Chen, Medioni 1991 (distances along normals); Geman, McClure 1987 (robust weights).

use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, UnitQuaternion, Vector2, Vector3, Vector4};

use super::camera::Camera;
use super::skeleton::{Joint, TreeError, order, world_from_joint};

/// What may change, by joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Free {
    /// Whether the roots may be moved.
    pub root: bool,
    /// Which joints may turn.
    pub turn: Vec<bool>,
    /// Which may stand nearer to or further from their parents.
    pub length: Vec<bool>,
    /// Which may be scaled, with all that is bound to them; what follows keeps its own size.
    pub scale: Vec<bool>,
}

/// How dear it is to leave the start: residuals a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Priors {
    /// A radian of turn.
    pub turn: f64,
    /// A unit of log-length.
    pub length: f64,
    /// A unit of log-scale.
    pub scale: f64,
}

/// A point that joints move: for each of them its weight and the point in its own space.
pub type Bound = Vec<(usize, f64, Vector3<f64>)>;

/// What is wanted of a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// What point.
    pub point: Bound,
    /// Where it is to be seen, pixels.
    pub at: Vector2<f64>,
    /// Along which direction alone; none for both.
    pub along: Option<Vector2<f64>>,
    /// Residuals a pixel.
    pub weight: f64,
}

/// The unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Unknown {
    /// A root's place along an axis.
    Root(usize, usize),
    /// A joint's rotation vector along an axis.
    Turn(usize, usize),
    /// The logarithm of a bone's length.
    Length(usize),
    /// The logarithm of a bone's scale.
    Scale(usize),
}

/// A figure about its start.
#[derive(Clone, Debug)]
pub struct Figure {
    parents: Vec<i64>,
    start: Vec<Joint>,
    order: Vec<usize>,
    unknowns: Vec<Unknown>,
    /// Joints that hang on each, itself among them.
    below: Vec<Vec<usize>>,
}

/// What unknowns do to joints: where each stands, and its generators.
struct State {
    world: Vec<Matrix4<f64>>,
    /// For each unknown the joints that it moves and how.
    moves: Vec<Vec<(usize, Matrix4<f64>)>>,
}

impl Figure {
    /// A figure at its start.
    ///
    /// # Errors
    /// Where parents do not make a tree.
    pub fn new(parents: &[i64], start: &[Joint], free: &Free) -> Result<Self, TreeError> {
        let order = order(parents)?;
        let n = parents.len();
        let mut below: Vec<Vec<usize>> = vec![Vec::new(); n];
        for &j in &order {
            let mut at = Some(j);
            while let Some(a) = at {
                below[a].push(j);
                at = usize::try_from(parents[a]).ok();
            }
        }
        let mut unknowns = Vec::new();
        let is = |list: &[bool], j: usize| list.get(j).copied().unwrap_or(false);
        for &j in &order {
            if free.root && parents[j] < 0 {
                unknowns.extend((0..3).map(|k| Unknown::Root(j, k)));
            }
            if is(&free.turn, j) {
                unknowns.extend((0..3).map(|k| Unknown::Turn(j, k)));
            }
            // A root has no bone above it, nor has a joint that stands at its parent.
            if is(&free.length, j) && parents[j] >= 0 && start[j].translation.norm() > 1e-9 {
                unknowns.push(Unknown::Length(j));
            }
            if is(&free.scale, j) {
                unknowns.push(Unknown::Scale(j));
            }
        }
        Ok(Self { parents: parents.to_vec(), start: start.to_vec(), order, unknowns, below })
    }

    /// Number of unknowns.
    pub fn n_unknowns(&self) -> usize {
        self.unknowns.len()
    }

    /// Joints that turn, parents first, with the joints that hang on each, itself among them.
    pub fn turning(&self) -> impl Iterator<Item = (usize, &[usize])> {
        self.unknowns.iter().filter_map(|u| if let Unknown::Turn(j, 0) = u { Some((*j, &self.below[*j][..])) } else { None })
    }

    /// The unknowns with which a joint that may turn, and all that hangs on it, is turned further about an axis of the world, by radians.
    pub fn swung(&self, x: &DVector<f64>, joint: usize, axis: &Vector3<f64>, angle: f64) -> DVector<f64> {
        let mut out = x.clone();
        let Some(first) = self.unknowns.iter().position(|u| *u == Unknown::Turn(joint, 0)) else { return out };
        // Of scaled and mirrored joints the turn alone: what stands on the axis stays there.
        let linear = self.world(&self.joints(x))[joint].fixed_view::<3, 3>(0, 0).into_owned();
        let Some(own) = linear.try_inverse().and_then(|i| (i * axis).try_normalize(1e-12)) else { return out };
        let angle = if linear.determinant() < 0.0 { -angle } else { angle };
        let turn = turned(&Vector3::from_fn(|k, _| x[first + k])) * turned(&(own * angle));
        let v = super::rotation::log(&super::rotation::near(&turn, &UnitQuaternion::identity())) * 2.0;
        (0..3).for_each(|k| out[first + k] = v[k]);
        out
    }

    /// The joints for a set of unknowns.
    pub fn joints(&self, x: &DVector<f64>) -> Vec<Joint> {
        let mut out = self.start.clone();
        let mut turns = vec![Vector3::zeros(); out.len()];
        for (u, &v) in self.unknowns.iter().zip(x.iter()) {
            match *u {
                Unknown::Root(j, k) => out[j].translation[k] += v,
                Unknown::Turn(j, k) => turns[j][k] = v,
                Unknown::Length(j) => out[j].translation *= libm::exp(v),
                Unknown::Scale(j) => {
                    out[j].scale *= libm::exp(v);
                    // What follows keeps its size: it is scaled back.
                    for (c, _) in self.parents.iter().enumerate().filter(|(_, p)| **p == j as i64) {
                        out[c].scale *= libm::exp(-v);
                    }
                }
            }
        }
        out.iter_mut().zip(turns).for_each(|(j, t)| j.rotation *= turned(&t));
        out
    }

    /// World from joint.
    fn world(&self, joints: &[Joint]) -> Vec<Matrix4<f64>> {
        let local: Vec<Matrix4<f64>> = joints.iter().map(Joint::matrix).collect();
        // The tree was looked at when the figure was made.
        world_from_joint(&self.parents, &local).unwrap_or(local)
    }

    fn state(&self, x: &DVector<f64>) -> State {
        let joints = self.joints(x);
        let world = self.world(&joints);
        let above = |j: usize| usize::try_from(self.parents[j]).ok().map_or_else(Matrix4::identity, |p| world[p]);
        let stretch = Matrix4::from_diagonal(&Vector4::new(1.0, 1.0, 1.0, 0.0));
        let conjugated = |m: &Matrix4<f64>, g: &Matrix4<f64>| m.try_inverse().map_or_else(Matrix4::zeros, |inverse| m * g * inverse);
        let mut turns = vec![Vector3::zeros(); joints.len()];
        for (u, &v) in self.unknowns.iter().zip(x.iter()) {
            if let Unknown::Turn(j, k) = *u {
                turns[j][k] = v;
            }
        }
        let all = |j: usize, g: Matrix4<f64>| self.below[j].iter().map(|&b| (b, g)).collect::<Vec<_>>();
        let one = |u: &Unknown| match *u {
            Unknown::Root(j, k) => {
                let mut g = Matrix4::zeros();
                g[(k, 3)] = 1.0;
                all(j, g)
            }
            Unknown::Turn(j, k) => {
                let frame = above(j) * Joint { scale: Vector3::repeat(1.0), ..joints[j] }.matrix();
                let about = right_jacobian(&turns[j]).column(k).into_owned();
                let mut cross = Matrix4::zeros();
                cross.fixed_view_mut::<3, 3>(0, 0).copy_from(&about.cross_matrix());
                all(j, conjugated(&frame, &cross))
            }
            Unknown::Length(j) => {
                let by = above(j).fixed_view::<3, 3>(0, 0) * joints[j].translation;
                let mut g = Matrix4::zeros();
                g.fixed_view_mut::<3, 1>(0, 3).copy_from(&by);
                all(j, g)
            }
            Unknown::Scale(j) => {
                let g = conjugated(&world[j], &stretch);
                let mut out = vec![(j, g)];
                for (c, _) in self.parents.iter().enumerate().filter(|(_, p)| **p == j as i64) {
                    out.extend(all(c, g - conjugated(&world[c], &stretch)));
                }
                out
            }
        };
        let moves = self.unknowns.iter().map(one).collect();
        State { world, moves }
    }

    /// How dear each unknown is, a unit.
    fn prior(&self, priors: &Priors) -> Vec<f64> {
        let one = |u: &Unknown| match u {
            Unknown::Root(..) => 0.0,
            Unknown::Turn(..) => priors.turn,
            Unknown::Length(_) => priors.length,
            Unknown::Scale(_) => priors.scale,
        };
        self.unknowns.iter().map(one).collect()
    }

    /// The order in which joints come after their parents.
    pub fn order(&self) -> &[usize] {
        &self.order
    }
}

/// The rotation of a rotation vector.
fn turned(v: &Vector3<f64>) -> UnitQuaternion<f64> {
    super::rotation::exp(&(v * 0.5))
}

/// How a rotation vector's change turns what it turns, in the turned frame: exp(v + dv) = exp(v) exp(J dv) (Chirikjian 2012, section 10.8).
fn right_jacobian(v: &Vector3<f64>) -> Matrix3<f64> {
    let angle = v.norm();
    let cross = v.cross_matrix();
    if angle < 1e-6 {
        return Matrix3::identity() - cross * 0.5;
    }
    let sq = angle * angle;
    Matrix3::identity() - cross * ((1.0 - libm::cos(angle)) / sq) + cross * cross * ((angle - libm::sin(angle)) / (sq * angle))
}

/// Where a bound point is.
fn place(point: &Bound, world: &[Matrix4<f64>]) -> Vector3<f64> {
    point.iter().map(|(j, w, p)| (world[*j] * Vector4::new(p.x, p.y, p.z, 1.0)).xyz() * *w).sum()
}

/// Column and row of a point, and how they change with it; `None` behind the eye.
fn seen(camera: &Camera, matrix: &Matrix4<f64>, p: &Vector3<f64>) -> Option<(Vector2<f64>, nalgebra::Matrix2x3<f64>)> {
    let clip = matrix * Vector4::new(p.x, p.y, p.z, 1.0);
    if clip.w <= 1e-9 {
        return None;
    }
    let half = camera.size.map(|n| n as f64 / 2.0);
    let [x, y] = camera.pixel(&clip);
    let row = |k: usize| matrix.fixed_view::<1, 3>(k, 0).into_owned();
    let (w, dw) = (clip.w, row(3));
    let dx = (row(0) - dw * (clip.x / w)) * (half[0] / w);
    let dy = (row(1) - dw * (clip.y / w)) * (-half[1] / w);
    Some((Vector2::new(x, y), nalgebra::Matrix2x3::from_rows(&[dx, dy])))
}

/// One step's view of all goals: residuals, and the normal equations.
struct Normal {
    cost: f64,
    hessian: DMatrix<f64>,
    slope: DVector<f64>,
}

fn normal(figure: &Figure, camera: &Camera, goals: &[Goal], prior: &[f64], x: &DVector<f64>) -> Normal {
    let n = figure.n_unknowns();
    let (state, matrix) = (figure.state(x), camera.clip_from_world());
    let mut by_joint: Vec<Vec<(usize, &Matrix4<f64>)>> = vec![Vec::new(); figure.parents.len()];
    for (u, moved) in state.moves.iter().enumerate() {
        moved.iter().for_each(|(j, g)| by_joint[*j].push((u, g)));
    }
    let mut out = Normal { cost: 0.0, hessian: DMatrix::zeros(n, n), slope: DVector::zeros(n) };
    let mut rows: Vec<(usize, Vector2<f64>)> = Vec::new();
    let mut dense = vec![Vector3::zeros(); n];
    for goal in goals {
        let Some((at, view)) = seen(camera, &matrix, &place(&goal.point, &state.world)) else { continue };
        dense.iter_mut().for_each(|d| *d = Vector3::zeros());
        for (j, w, p) in &goal.point {
            let q = state.world[*j] * Vector4::new(p.x, p.y, p.z, 1.0);
            by_joint[*j].iter().for_each(|(u, g)| dense[*u] += (*g * q).xyz() * *w);
        }
        rows.clear();
        rows.extend(dense.iter().enumerate().filter(|(_, d)| **d != Vector3::zeros()).map(|(u, d)| (u, view * d)));
        let axes: &[Vector2<f64>] = match &goal.along {
            Some(along) => std::slice::from_ref(along),
            None => &[Vector2::new(1.0, 0.0), Vector2::new(0.0, 1.0)],
        };
        for axis in axes {
            let residual = goal.weight * (at - goal.at).dot(axis);
            out.cost += residual * residual;
            let row: Vec<(usize, f64)> = rows.iter().map(|(u, d)| (*u, goal.weight * d.dot(axis))).collect();
            for (a, (u, du)) in row.iter().enumerate() {
                out.slope[*u] += du * residual;
                row[..=a].iter().for_each(|(v, dv)| out.hessian[(*u, *v)] += du * dv);
            }
        }
    }
    for (u, w) in prior.iter().enumerate() {
        out.cost += (w * x[u]).powi(2);
        out.slope[u] += w * w * x[u];
        out.hessian[(u, u)] += w * w;
    }
    for u in 0..n {
        for v in u + 1..n {
            out.hessian[(u, v)] = out.hessian[(v, u)];
        }
    }
    out
}

fn cost(figure: &Figure, camera: &Camera, goals: &[Goal], prior: &[f64], x: &DVector<f64>) -> f64 {
    let (world, matrix) = (figure.world(&figure.joints(x)), camera.clip_from_world());
    let one = |goal: &Goal| {
        let Some((at, _)) = seen(camera, &matrix, &place(&goal.point, &world)) else { return 0.0 };
        let off = at - goal.at;
        let sq = goal.along.map_or(off.norm_squared(), |along| off.dot(&along).powi(2));
        goal.weight * goal.weight * sq
    };
    goals.iter().map(one).sum::<f64>() + prior.iter().zip(x.iter()).map(|(w, v)| (w * v).powi(2)).sum::<f64>()
}

/// Some steps of Levenberg and Marquardt's method towards goals, from `x`; the number of those that were taken. Stops where a step changes next to nothing.
/// Cost: O(goals · unknowns² + unknowns³) a step.
pub fn improve(figure: &Figure, camera: &Camera, goals: &[Goal], priors: &Priors, x: &mut DVector<f64>, steps: u32) -> u32 {
    let prior = figure.prior(priors);
    let mut damping = 1e-3;
    let mut taken = 0;
    'steps: for _ in 0..steps {
        let now = normal(figure, camera, goals, &prior, x);
        if !now.cost.is_finite() || now.cost < 1e-18 {
            break;
        }
        for _ in 0..12 {
            let mut hessian = now.hessian.clone();
            for u in 0..x.len() {
                hessian[(u, u)] += damping * (hessian[(u, u)] + 1e-6);
            }
            let step = hessian.cholesky().map(|c| c.solve(&now.slope));
            if let Some(step) = step {
                let next = &*x - &step;
                let there = cost(figure, camera, goals, &prior, &next);
                if there < now.cost {
                    let done = now.cost - there < 1e-10 * now.cost;
                    *x = next;
                    taken += 1;
                    damping = (damping * 0.2).max(1e-9);
                    if done {
                        break 'steps;
                    }
                    continue 'steps;
                }
            }
            damping *= 5.0;
        }
        break;
    }
    taken
}

/// Where bound points are seen with these unknowns; NaN behind the eye.
pub fn project(figure: &Figure, camera: &Camera, points: &[Bound], x: &DVector<f64>) -> Vec<Vector2<f64>> {
    let (world, matrix) = (figure.world(&figure.joints(x)), camera.clip_from_world());
    points.iter().map(|p| seen(camera, &matrix, &place(p, &world)).map_or(Vector2::repeat(f64::NAN), |s| s.0)).collect()
}

/// A short, straight piece of an outline with the direction out of the figure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rim {
    /// Column and row of its middle.
    pub at: Vector2<f64>,
    /// Of length one, out of the figure.
    pub out: Vector2<f64>,
    /// How long it is, pixels.
    pub length: f64,
}

impl Rim {
    /// The square of a place's distance from the piece.
    fn square(&self, p: &Vector2<f64>) -> f64 {
        let off = p - self.at;
        let beside = (off.perp(&self.out).abs() - self.length / 2.0).max(0.0);
        beside * beside + off.dot(&self.out).powi(2)
    }
}

/// The mean distance between outlines, both ways, pixels; NaN where one is empty. Cost: O(points · drawn places).
pub fn apart(own: &[(Bound, Rim)], drawn: &[Rim]) -> f64 {
    let nearest =
        |p: &Rim, all: &mut dyn Iterator<Item = &Rim>| all.map(|q| q.square(&p.at)).fold(f64::INFINITY, f64::min).sqrt() * p.length;
    if own.is_empty() || drawn.is_empty() {
        return f64::NAN;
    }
    let to: f64 = own.iter().map(|p| nearest(&p.1, &mut drawn.iter())).sum::<f64>() / own.iter().map(|p| p.1.length).sum::<f64>();
    let from: f64 =
        drawn.iter().map(|p| nearest(p, &mut own.iter().map(|o| &o.1))).sum::<f64>() / drawn.iter().map(|p| p.length).sum::<f64>();
    (to + from) / 2.0
}

/// Goals that bring an outline of the mesh to the drawn one: each of its pieces to the nearest drawn one, and to each drawn piece the nearest of its own,
/// where both face the same way within 60 degrees and lie within `reach` pixels; along the drawn normal. Weights fall off by Geman and McClure's function with
/// `bend` pixels and go with lengths, so that a dense mesh says no more than a coarse one; all together weigh `weight` before that. Cost: O(points · drawn places).
pub fn outline_goals(own: &[(Bound, Rim)], drawn: &[Rim], reach: f64, bend: f64, weight: f64) -> Vec<Goal> {
    let nearest = |from: &Rim, all: &mut dyn Iterator<Item = (usize, &Rim)>| {
        let mut best: Option<(f64, usize)> = None;
        for (i, to) in all {
            let d = to.square(&from.at);
            if d <= reach * reach && best.is_none_or(|b| d < b.0) && from.out.dot(&to.out) > 0.5 {
                best = Some((d, i));
            }
        }
        best.map(|b| b.1)
    };
    let goal = |point: &(Bound, Rim), to: &Rim| {
        let off = (point.1.at - to.at).dot(&to.out);
        let soft = bend * bend / (bend * bend + off * off);
        Goal { point: point.0.clone(), at: to.at, along: Some(to.out), weight: weight * soft }
    };
    let mut out = Vec::new();
    for point in own {
        if let Some(i) = nearest(&point.1, &mut drawn.iter().enumerate()) {
            out.push((goal(point, &drawn[i]), point.1.length));
        }
    }
    for to in drawn {
        if let Some(i) = nearest(to, &mut own.iter().map(|p| &p.1).enumerate()) {
            out.push((goal(&own[i], to), to.length));
        }
    }
    out.retain(|(goal, _)| !goal.point.is_empty());
    let whole: f64 = out.iter().map(|(_, length)| length).sum();
    out.into_iter().map(|(goal, length)| Goal { weight: goal.weight * (length / whole).sqrt(), ..goal }).collect()
}

#[cfg(test)]
mod tests {
    use super::super::camera::{Orbit, perspective};
    use super::*;

    fn chain(n: usize) -> (Vec<i64>, Vec<Joint>) {
        let joint = |k: usize| Joint {
            translation: Vector3::new(0.1, if k == 0 { 0.0 } else { 0.5 }, 0.05 * k as f64),
            rotation: turned(&Vector3::new(0.2, 0.1 * k as f64, -0.3)),
            scale: Vector3::new(1.0, 1.1, 0.9),
        };
        ((-1..n as i64 - 1).collect(), (0..n).map(joint).collect())
    }

    fn camera() -> Camera {
        let orbit = Orbit { target: [0.0, 1.0, 0.0], azimuth: 0.4, elevation: 0.2, roll: 0.0, distance: 5.0 };
        Camera::new(orbit.view(), perspective(0.7, [512, 512], 0.1, 100.0), [512, 512]).unwrap()
    }

    fn all(n: usize) -> Free {
        Free { root: true, turn: vec![true; n], length: vec![true; n], scale: vec![true; n] }
    }

    #[test]
    fn derivatives_are_those_of_small_changes() {
        let (parents, start) = chain(4);
        let figure = Figure::new(&parents, &start, &all(4)).unwrap();
        assert_eq!(figure.n_unknowns(), 3 + 12 + 3 + 4);
        let x = DVector::from_fn(figure.n_unknowns(), |i, _| 0.3 * ((i * 7 % 5) as f64 / 5.0 - 0.4));
        let point: Bound = vec![(1, 0.3, Vector3::new(0.2, 0.1, 0.4)), (3, 0.7, Vector3::new(-0.1, 0.3, 0.2))];
        let goals = [Goal { point, at: Vector2::new(200.0, 300.0), along: None, weight: 1.0 }];
        let prior = figure.prior(&Priors { turn: 2.0, length: 3.0, scale: 4.0 });
        let found = normal(&figure, &camera(), &goals, &prior, &x);
        for u in 0..x.len() {
            let at = |by: f64| {
                let mut y = x.clone();
                y[u] += by;
                cost(&figure, &camera(), &goals, &prior, &y)
            };
            let slope = (at(1e-5) - at(-1e-5)) / 4e-5;
            assert!((slope - found.slope[u]).abs() < 1e-5 * (1.0 + slope.abs()), "{u}: {slope} {}", found.slope[u]);
        }
        assert!((found.cost - cost(&figure, &camera(), &goals, &prior, &x)).abs() < 1e-9);
    }

    #[test]
    fn joints_come_to_where_they_are_drawn_and_lengths_hold() {
        let (parents, start) = chain(5);
        let free = Free { length: vec![], scale: vec![], ..all(5) };
        let figure = Figure::new(&parents, &start, &free).unwrap();
        let truth = DVector::from_fn(figure.n_unknowns(), |i, _| 0.4 * ((i * 5 % 7) as f64 / 7.0 - 0.4));
        let points: Vec<Bound> = (0..5).map(|j| vec![(j, 1.0, Vector3::zeros())]).collect();
        let goals: Vec<Goal> = points
            .iter()
            .zip(project(&figure, &camera(), &points, &truth))
            .map(|(p, at)| Goal { point: p.clone(), at, along: None, weight: 1.0 })
            .collect();
        let mut x = DVector::zeros(figure.n_unknowns());
        improve(&figure, &camera(), &goals, &Priors { turn: 0.01, length: 1.0, scale: 1.0 }, &mut x, 100);
        let off = project(&figure, &camera(), &points, &x);
        assert!(off.iter().zip(&goals).all(|(a, g)| (a - g.at).norm() < 0.05));
        let lengths = |x: &DVector<f64>| figure.joints(x).iter().skip(1).map(|j| j.translation.norm()).collect::<Vec<_>>();
        assert_eq!(lengths(&x), lengths(&DVector::zeros(x.len())));
    }

    #[test]
    fn a_scaled_bone_leaves_what_follows_its_own_size() {
        let (parents, mut start) = chain(3);
        start.iter_mut().for_each(|j| j.scale = Vector3::repeat(1.0));
        let free = Free { root: false, turn: vec![], length: vec![], scale: vec![false, true, false] };
        let figure = Figure::new(&parents, &start, &free).unwrap();
        let world = figure.world(&figure.joints(&DVector::from_element(1, 2.0_f64.ln())));
        let size = |m: &Matrix4<f64>| m.fixed_view::<3, 3>(0, 0).determinant();
        assert!((size(&world[1]) - 8.0).abs() < 1e-9 && (size(&world[2]) - 1.0).abs() < 1e-9);
        let before = figure.world(&start);
        let bone = |w: &[Matrix4<f64>]| (w[2].column(3) - w[1].column(3)).norm();
        assert!((bone(&world) / bone(&before) - 2.0).abs() < 1e-9, "the bone is twice as long");
    }
    #[test]
    fn a_swung_joint_turns_about_the_axis_with_all_that_hangs_on_it_and_stays_in_its_place() {
        let (parents, mut start) = chain(4);
        start.iter_mut().for_each(|j| j.scale = Vector3::repeat(1.0));
        let figure = Figure::new(&parents, &start, &all(4)).unwrap();
        let x = DVector::from_fn(figure.n_unknowns(), |i, _| 0.3 * ((i * 7 % 5) as f64 / 5.0 - 0.4));
        let axis = Vector3::new(0.3, -0.2, 0.9).normalize();
        assert_eq!(figure.turning().map(|(j, below)| (j, below.len())).collect::<Vec<_>>(), [(0, 4), (1, 3), (2, 2), (3, 1)]);
        let before = figure.world(&figure.joints(&x));
        let after = figure.world(&figure.joints(&figure.swung(&x, 1, &axis, 0.7)));
        let turn = UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(axis), 0.7);
        let about = before[1].column(3).xyz();
        for j in 1..4 {
            let to = about + turn * (before[j].column(3).xyz() - about);
            assert!((after[j].column(3).xyz() - to).norm() < 1e-12, "{j}");
        }
        assert_eq!(after[0], before[0]);
        let still = Figure::new(&parents, &start, &Free { root: true, turn: vec![], length: vec![], scale: vec![] }).unwrap();
        assert_eq!(still.swung(&DVector::zeros(3), 1, &axis, 0.7), DVector::zeros(3), "what may not turn does not");
    }

    /// A square of pieces of two pixels, its middle at `(x, 0)`.
    fn square(x: f64) -> Vec<Rim> {
        let side = |out: Vector2<f64>| {
            let along = Vector2::new(-out.y, out.x);
            (-5..5).map(move |k| Rim { at: Vector2::new(x, 0.0) + out * 10.0 + along * (2.0 * f64::from(k) + 1.0), out, length: 2.0 })
        };
        [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].into_iter().flat_map(|o| side(o.into())).collect()
    }

    #[test]
    fn outlines_are_apart_by_their_mean_distance_and_pieces_count_by_their_length() {
        let own = |rims: Vec<Rim>| rims.into_iter().map(|r| (vec![(0, 1.0, Vector3::zeros())], r)).collect::<Vec<_>>();
        assert_eq!(apart(&own(square(0.0)), &square(0.0)), 0.0);
        // Half a piece along, all lie on each other but the ends, which stand out by half a pixel; two sides are a pixel off.
        let off = apart(&own(square(1.0)), &square(0.0));
        assert!((off - 0.5).abs() < 0.06, "{off}");
        assert!(apart(&[], &square(0.0)).is_nan());
        // Ten times as many pieces of a side say no more.
        let mut fine = square(0.0);
        let first = fine.remove(0);
        fine.extend((0..10).map(|_| Rim { length: 0.2, ..first }));
        let weight = |rims| outline_goals(&own(rims), &square(0.5), 4.0, 2.0, 3.0).iter().map(|g| g.weight * g.weight).sum::<f64>();
        assert!((weight(fine) - weight(square(0.0))).abs() < 1e-9);
        let all = outline_goals(&own(square(0.0)), &square(0.0), 4.0, 2.0, 3.0).iter().map(|g| g.weight * g.weight).sum::<f64>();
        assert!((all - 9.0).abs() < 1e-9);
    }
}
