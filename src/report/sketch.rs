//! Values as line drawings: contours, points, poses, drawings; and surfaces, shaded.

use std::fmt::Write as _;

use pegbar_nodes::algo::skeleton::world_from_joint;
use pegbar_nodes::data::{Curves, Drawing, KeyDrawings, KeyShapes, Mesh, Pose, Shape, Skeleton};

use super::html::point;
use super::picture::Thumb;

/// Points of a sketch at most, beyond which every second, third, ... is shown.
const MOST: usize = 4000;
/// Keys of a set that are shown.
const KEYS: usize = 6;
/// Side of a surface's picture.
const SIDE: usize = 260;

/// Marks within bounds, to be framed together with those of other frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Sketch {
    /// Left, top, right, bottom; left beyond right where there is nothing.
    pub(crate) bounds: Option<[f64; 4]>,
    /// SVG elements.
    pub(crate) body: String,
}

impl Sketch {
    fn grow(&mut self, [x, y]: [f64; 2]) -> bool {
        let is_finite = x.is_finite() && y.is_finite();
        if is_finite {
            let [l, t, r, b] = self.bounds.unwrap_or([x, y, x, y]);
            self.bounds = Some([l.min(x), t.min(y), r.max(x), b.max(y)]);
        }
        is_finite
    }

    /// Adds a line; gaps where points are not finite. Gives its path.
    fn trace(&mut self, points: &[[f64; 2]], closed: bool) -> String {
        let step = points.len().div_ceil(MOST).max(1);
        let (mut path, mut is_down) = (String::new(), false);
        for p in points.iter().step_by(step) {
            let is_known = self.grow(*p);
            if is_known {
                point(&mut path, if is_down { 'L' } else { 'M' }, *p);
            }
            is_down = is_known;
        }
        if closed && !path.is_empty() {
            path.push('Z');
        }
        path
    }

    fn line(&mut self, points: &[[f64; 2]], closed: bool, class: &str) {
        let path = self.trace(points, closed);
        let _ = write!(self.body, "<path class=\"{class}\" d=\"{path}\"/>");
    }

    fn dots(&mut self, points: impl Iterator<Item = [f64; 2]>) {
        let mut path = String::new();
        for p in points.take(MOST) {
            if self.grow(p) {
                point(&mut path, 'M', p);
                path.push_str("h0");
            }
        }
        let _ = write!(self.body, "<path class=\"dots\" d=\"{path}\"/>");
    }

    pub(crate) fn shape(shape: &Shape) -> Self {
        let mut out = Self::default();
        out.line(&shape.points, shape.closed, "line");
        if shape.points.len() <= 200 {
            out.dots(shape.points.iter().copied());
        }
        out
    }

    pub(crate) fn key_shapes(keys: &KeyShapes) -> Self {
        let mut out = Self::default();
        let [_, n, _] = keys.points.shape();
        for (i, points) in keys.by_point().chunks(n.max(1)).enumerate().take(12) {
            out.line(points, keys.closed, &format!("line s{}", i % 8));
        }
        out
    }

    pub(crate) fn points(points: &[[f64; 2]]) -> Self {
        let mut out = Self::default();
        out.dots(points.iter().copied());
        out
    }

    /// Points of the world from the front, in centimetres.
    pub(crate) fn points_3d(points: &[[f64; 3]]) -> Self {
        let mut out = Self::default();
        out.dots(points.iter().map(|[x, y, _]| [x * 100.0, -y * 100.0]));
        out
    }

    pub(crate) fn curves(curves: &Curves) -> Self {
        let mut out = Self::default();
        let mut left = MOST * 2;
        for curve in curves.iter() {
            left = left.saturating_sub(curve.points.len());
            if left > 0 {
                out.line(curve.points, curve.closed, "line");
            }
        }
        out
    }

    pub(crate) fn drawing(drawing: &Drawing) -> Self {
        let mut out = Self::default();
        out.grow([0.0, 0.0]);
        out.grow(drawing.size);
        out.paint(drawing);
        out
    }

    fn paint(&mut self, drawing: &Drawing) {
        for (i, outline) in drawing.outlines().iter().enumerate() {
            let (Some(fill), Some(stroke), Some(width)) = (drawing.fill.get(i), drawing.stroke.get(i), drawing.width.get(i)) else {
                continue;
            };
            let path: String = outline.iter().map(|contour| self.trace(contour.points, contour.closed)).collect();
            let rule = if drawing.rule.get(i) == Some(&1) { " fill-rule=\"evenodd\"" } else { "" };
            let (fill, stroke) = (paint("fill", fill), paint("stroke", stroke));
            let _ = write!(self.body, "<path class=\"art\" d=\"{path}\"{rule} {fill} {stroke} stroke-width=\"{width:.2}\"/>");
        }
    }

    /// The first few keys, one in front of the other.
    pub(crate) fn key_drawings(keys: &KeyDrawings) -> Vec<Self> {
        let [k, n, _] = keys.points.shape();
        let points: &[[f64; 2]] = keys.points.data().as_chunks().0;
        let one = |key: usize| Drawing {
            points: points[key * n..(key + 1) * n].to_vec(),
            contours: keys.contours.clone(),
            closed: keys.closed.clone(),
            paths: keys.paths.clone(),
            fill: keys.fill.clone(),
            stroke: keys.stroke.clone(),
            width: keys.width.clone(),
            rule: keys.rule.clone(),
            depth: keys.depth.clone(),
            size: keys.size,
            ..Drawing::default()
        };
        (0..k.min(KEYS)).map(|key| Self::drawing(&one(key))).collect()
    }

    /// A skeleton from the front, in a pose or at rest; nothing where they do not go together.
    pub(crate) fn pose(skeleton: &Skeleton, pose: Option<&Pose>) -> Option<Self> {
        let local = match pose {
            Some(pose) if pose.n_joints() == skeleton.n_joints() => pose.joints().ok()?.iter().map(|joint| joint.matrix()).collect(),
            Some(_) => return None,
            None => skeleton.rest(),
        };
        let world = world_from_joint(&skeleton.parents, &local).ok()?;
        let at: Vec<[f64; 2]> = world.iter().map(|m| [m[(0, 3)] * 100.0, -m[(1, 3)] * 100.0]).collect();
        let mut out = Self::default();
        for (joint, parent) in skeleton.parents.iter().enumerate() {
            if let Some(from) = usize::try_from(*parent).ok().and_then(|p| at.get(p)) {
                out.line(&[*from, at[joint]], false, "line");
            }
        }
        out.dots(at.into_iter());
        Some(out)
    }
}

fn paint(what: &str, [r, g, b, opacity]: &[f64; 4]) -> String {
    if *opacity <= 0.0 {
        return format!("{what}=\"none\"");
    }
    let code = |v: &f64| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
    let clear = if *opacity < 1.0 { format!(" {what}-opacity=\"{opacity:.3}\"") } else { String::new() };
    format!("{what}=\"#{:02x}{:02x}{:02x}\"{clear}", code(r), code(g), code(b))
}

/// A surface from the front, lit from the eye, in the page's grey.
pub(crate) fn surface(mesh: &Mesh) -> Option<Thumb> {
    let finite = || mesh.positions.iter().filter(|p| p.iter().all(|v| v.is_finite()));
    let first = finite().next()?;
    let ends =
        finite().fold([first[0], first[1], first[0], first[1]], |[l, b, r, t], p| [l.min(p[0]), b.min(p[1]), r.max(p[0]), t.max(p[1])]);
    let size = (ends[2] - ends[0]).max(ends[3] - ends[1]).max(1e-12);
    let scale = (SIDE - 20) as f64 / size;
    let [width, height] = [ends[2] - ends[0], ends[3] - ends[1]].map(|n| (n * scale) as usize + 20);
    let seen = |i: u32| {
        let p = mesh.positions.get(i as usize)?;
        p.iter().all(|v| v.is_finite()).then(|| [10.0 + (p[0] - ends[0]) * scale, 10.0 + (ends[3] - p[1]) * scale, p[2] * scale])
    };
    let mut depth = vec![f64::NEG_INFINITY; width * height];
    let mut grey = vec![0.05f32; width * height];
    for [a, b, c] in mesh.triangles.iter() {
        if let (Some(a), Some(b), Some(c)) = (seen(*a), seen(*b), seen(*c)) {
            fill([a, b, c], width, height, &mut depth, &mut grey);
        }
    }
    Some(Thumb { width, height, rgb: grey.into_iter().flat_map(|v| [v; 3]).collect() })
}

/// Fills one triangle, by how much it faces the eye, where nothing lies before it.
fn fill([a, b, c]: [[f64; 3]; 3], width: usize, height: usize, depth: &mut [f64], grey: &mut [f32]) {
    let side = |u: &[f64; 3], v: &[f64; 3], p: [f64; 2]| (v[0] - u[0]) * (p[1] - u[1]) - (v[1] - u[1]) * (p[0] - u[0]);
    let area = side(&a, &b, [c[0], c[1]]);
    if area == 0.0 {
        return;
    }
    let slope = |i: usize, j: usize| (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
    let facing = area.abs() / (slope(1, 2).powi(2) + slope(2, 0).powi(2) + area * area).sqrt();
    let range = |i: usize, most: usize| {
        let (low, high) = (a[i].min(b[i]).min(c[i]), a[i].max(b[i]).max(c[i]));
        (low.floor().max(0.0) as usize)..(high.ceil().max(0.0) as usize).min(most)
    };
    for y in range(1, height) {
        for x in range(0, width) {
            let p = [x as f64 + 0.5, y as f64 + 0.5];
            let [wa, wb, wc] = [side(&b, &c, p), side(&c, &a, p), side(&a, &b, p)].map(|w| w / area);
            let (z, at) = (wa * a[2] + wb * b[2] + wc * c[2], y * width + x);
            if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 && z > depth[at] {
                (depth[at], grey[at]) = (z, (0.06 + 0.6 * facing) as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use pegbar_engine::array::NdArray;

    use super::*;

    #[test]
    fn lines_have_gaps_where_points_are_not_known_and_bounds_of_the_rest() {
        let points = vec![[0.0, 1.0], [f64::NAN, 0.0], [4.0, 3.0], [5.0, 3.0]];
        let sketch = Sketch::shape(&Shape { points, closed: true });
        assert_eq!(sketch.bounds, Some([0.0, 1.0, 5.0, 3.0]));
        assert!(sketch.body.starts_with("<path class=\"line\" d=\"M0.00 1.00M4.00 3.00L5.00 3.00Z\"/>"), "{}", sketch.body);
    }

    #[test]
    fn a_surface_hides_what_lies_behind_it() {
        let square = |z: f64, half: f64| [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
        let positions = square(0.0, 1.0).into_iter().chain(square(1.0, 0.5).map(|[x, y, z]| [x, y, z + x])).collect();
        let triangles = vec![[0u32, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let thumb = surface(&Mesh { positions, triangles: triangles.into(), ..Mesh::default() }).unwrap();
        assert_eq!((thumb.width, thumb.height), (SIDE, SIDE));
        let at = |x: usize, y: usize| thumb.rgb[(y * SIDE + x) * 3];
        assert!((at(20, SIDE / 2) - 0.66).abs() < 1e-6 && at(SIDE / 2, SIDE / 2) < 0.6 && at(2, 2) == 0.05);
        assert!(surface(&Mesh::default()).is_none());
    }

    #[test]
    fn bones_lead_from_parents_to_joints() {
        let joint = |y: f64| [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, y, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let rest = NdArray::new([2, 4, 4], [joint(0.0), joint(1.0)].concat()).unwrap();
        let skeleton = Skeleton { parents: vec![-1, 0], parent_from_joint: rest, names: Vec::new() };
        let sketch = Sketch::pose(&skeleton, None).unwrap();
        assert_eq!(sketch.bounds, Some([0.0, -100.0, 0.0, 0.0]));
        assert!(sketch.body.contains("M0.00 0.00L0.00 -100.00"), "{}", sketch.body);
        assert!(Sketch::pose(&skeleton, Some(&Pose::default())).is_none());
    }
}
