//! Vector drawings.

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;

/// A vector drawing: filled and stroked paths of straight lines, the first at the bottom.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "check")]
pub struct Drawing {
    /// Points of all contours, one contour after the other; pixels, origin at the top left corner of the format.
    #[value(shape = "[n, 2]")]
    pub points: Vec<[f64; 2]>,
    /// Points of each contour; together n.
    #[value(shape = "[m]")]
    pub contours: Vec<u32>,
    /// 1 for each contour whose last point joins its first, else 0.
    #[value(shape = "[m]")]
    pub closed: Vec<u8>,
    /// Contours of each path; together m.
    #[value(shape = "[p]")]
    pub paths: Vec<u32>,
    /// Red, green, blue and opacity of each path's inside, as seen on screen, 0 to 1; opacity 0 where it is not filled.
    #[value(shape = "[p, 4]")]
    pub fill: Vec<[f64; 4]>,
    /// The same of each path's line.
    #[value(shape = "[p, 4]")]
    pub stroke: Vec<[f64; 4]>,
    /// Width of each path's line, pixels.
    #[value(shape = "[p]")]
    pub width: Vec<f64>,
    /// What is inside of each path: 0 wherever it winds around, 1 where it does so an odd number of times.
    #[value(shape = "[p]")]
    pub rule: Vec<u8>,
    /// Place of each path in the depth of what it was drawn in, higher ones in front.
    #[value(shape = "[p]")]
    pub depth: Vec<f64>,
    /// Width and height of the format, pixels.
    #[value(shape = "[2]")]
    pub size: [f64; 2],
    /// Name of each path, or none at all.
    #[value(text)]
    pub names: Vec<String>,
    /// Names of the groups that each path is in, from outside, or none at all.
    #[value(text)]
    pub groups: Vec<Vec<String>>,
}

/// Vector drawings that are blended: the same paths of as many points each, in the same order and paint.
#[derive(Clone, Debug, PartialEq, Value)]
#[value(check = "check")]
pub struct KeyDrawings {
    /// Points of all contours of each key; pixels, origin at the top left corner of the format.
    #[value(shape = "[k, n, 2]")]
    pub points: NdArray<f64, 3>,
    /// Points of each contour; together n.
    #[value(shape = "[m]")]
    pub contours: Vec<u32>,
    /// 1 for each contour whose last point joins its first, else 0.
    #[value(shape = "[m]")]
    pub closed: Vec<u8>,
    /// Contours of each path; together m.
    #[value(shape = "[p]")]
    pub paths: Vec<u32>,
    /// Red, green, blue and opacity of each path's inside, as seen on screen, 0 to 1; opacity 0 where it is not filled.
    #[value(shape = "[p, 4]")]
    pub fill: Vec<[f64; 4]>,
    /// The same of each path's line.
    #[value(shape = "[p, 4]")]
    pub stroke: Vec<[f64; 4]>,
    /// Width of each path's line, pixels.
    #[value(shape = "[p]")]
    pub width: Vec<f64>,
    /// What is inside of each path: 0 wherever it winds around, 1 where it does so an odd number of times.
    #[value(shape = "[p]")]
    pub rule: Vec<u8>,
    /// Place of each path in the depth of what it was drawn in, higher ones in front.
    #[value(shape = "[p]")]
    pub depth: Vec<f64>,
    /// Width and height of the format, pixels.
    #[value(shape = "[2]")]
    pub size: [f64; 2],
    /// Name of each key, or none at all.
    #[value(text)]
    pub keys: Vec<String>,
    /// Name of each path, or none at all.
    #[value(text)]
    pub names: Vec<String>,
    /// Names of the groups that each path is in, from outside, or none at all.
    #[value(text)]
    pub groups: Vec<Vec<String>>,
}

/// One contour of a drawing.
#[derive(Clone, Copy, Debug)]
pub struct Contour<'a> {
    /// Position of its first point among all of the drawing's.
    pub first: usize,
    /// Its points.
    pub points: &'a [[f64; 2]],
    /// Whether its last point joins its first.
    pub closed: bool,
}

impl Drawing {
    /// The contours of each path.
    pub fn outlines(&self) -> Vec<Vec<Contour<'_>>> {
        let mut first = 0;
        let mut all = self.contours.iter().zip(&self.closed).map(|(&n, &closed)| {
            let contour = Contour { first, points: &self.points[first..first + n as usize], closed: closed != 0 };
            first += n as usize;
            contour
        });
        self.paths.iter().map(|&n| all.by_ref().take(n as usize).collect()).collect()
    }

    /// Name of a path, for messages: its own, else its position from 0.
    pub fn name(&self, path: usize) -> String {
        let own = self.names.get(path).filter(|n| !n.is_empty());
        own.map_or_else(|| format!("path {path}"), |name| format!("path `{name}`"))
    }

    /// The drawing of the paths at these positions, in this order.
    #[must_use]
    pub fn picked(&self, paths: &[usize]) -> Self {
        let outlines = self.outlines();
        let mut out = Self { size: self.size, ..Self::default() };
        for &i in paths {
            for contour in &outlines[i] {
                out.points.extend_from_slice(contour.points);
                out.contours.push(contour.points.len() as u32);
                out.closed.push(u8::from(contour.closed));
            }
            out.paths.push(self.paths[i]);
            out.fill.push(self.fill[i]);
            out.stroke.push(self.stroke[i]);
            out.width.push(self.width[i]);
            out.rule.push(self.rule[i]);
            out.depth.push(self.depth[i]);
            out.names.push(self.names.get(i).cloned().unwrap_or_default());
            out.groups.push(self.groups.get(i).cloned().unwrap_or_default());
        }
        out
    }

    /// The paths of `above` after these.
    pub fn append(&mut self, above: &Self) {
        let named = |d: &Self| (0..d.paths.len()).map(|i| d.names.get(i).cloned().unwrap_or_default()).collect::<Vec<_>>();
        let grouped = |d: &Self| (0..d.paths.len()).map(|i| d.groups.get(i).cloned().unwrap_or_default()).collect::<Vec<_>>();
        (self.names, self.groups) = (named(self), grouped(self));
        self.names.extend(named(above));
        self.groups.extend(grouped(above));
        self.points.extend_from_slice(&above.points);
        self.contours.extend_from_slice(&above.contours);
        self.closed.extend_from_slice(&above.closed);
        self.paths.extend_from_slice(&above.paths);
        self.fill.extend_from_slice(&above.fill);
        self.stroke.extend_from_slice(&above.stroke);
        self.width.extend_from_slice(&above.width);
        self.rule.extend_from_slice(&above.rule);
        self.depth.extend_from_slice(&above.depth);
    }

    fn check(&self) -> Result<(), String> {
        self.check_with(self.points.len())
    }

    /// Whether the arrays go together where there are `n` points.
    fn check_with(&self, n: usize) -> Result<(), String> {
        let p = self.paths.len();
        let sum = |counts: &[u32]| counts.iter().map(|&n| n as usize).sum::<usize>();
        let same = |what: &str, of: &str, expected: usize, found: usize| match expected == found {
            true => Ok(()),
            false => Err(format!("expected {expected} {what}, as many as `{of}` says, found {found}")),
        };
        same("points", "contours", sum(&self.contours), n)?;
        same("contours", "paths", sum(&self.paths), self.contours.len())?;
        same("contours in `closed`", "contours", self.contours.len(), self.closed.len())?;
        let named = |n: usize| if n == 0 { p } else { n };
        let lists = [
            ("fill", self.fill.len()),
            ("stroke", self.stroke.len()),
            ("width", self.width.len()),
            ("rule", self.rule.len()),
            ("depth", self.depth.len()),
            ("names", named(self.names.len())),
            ("groups", named(self.groups.len())),
        ];
        lists.iter().try_for_each(|(name, found)| same(&format!("paths in `{name}`"), "paths", p, *found))
    }
}

impl KeyDrawings {
    /// Keys from drawings of the same paths; `None` where there is none, or their points are of another number than the first's.
    pub fn new(drawings: Vec<Drawing>, keys: Vec<String>) -> Option<Self> {
        let n = drawings.first()?.points.len();
        let all: Vec<f64> = drawings.iter().flat_map(|d| d.points.as_flattened()).copied().collect();
        let points = NdArray::new([drawings.len(), n, 2], all)?;
        let Drawing { contours, closed, paths, fill, stroke, width, rule, depth, size, names, groups, .. } = drawings.into_iter().next()?;
        Some(Self { points, contours, closed, paths, fill, stroke, width, rule, depth, size, keys, names, groups })
    }

    /// Number of keys.
    pub fn len(&self) -> usize {
        self.points.shape()[0]
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Points of a key.
    pub fn key(&self, k: usize) -> &[[f64; 2]] {
        let [_, n, _] = self.points.shape();
        &self.points.data().as_chunks::<2>().0[k * n..(k + 1) * n]
    }

    /// The drawing whose points are these, painted as the keys are.
    pub fn drawing(&self, points: Vec<[f64; 2]>) -> Drawing {
        Drawing {
            points,
            contours: self.contours.clone(),
            closed: self.closed.clone(),
            paths: self.paths.clone(),
            fill: self.fill.clone(),
            stroke: self.stroke.clone(),
            width: self.width.clone(),
            rule: self.rule.clone(),
            depth: self.depth.clone(),
            size: self.size,
            names: self.names.clone(),
            groups: self.groups.clone(),
        }
    }

    fn check(&self) -> Result<(), String> {
        let [k, n, two] = self.points.shape();
        if two != 2 {
            return Err(format!("expected points of two numbers each, found {two}"));
        }
        if !self.keys.is_empty() && self.keys.len() != k {
            return Err(format!("expected {k} names in `keys`, one for each, or none, found {}", self.keys.len()));
        }
        self.drawing(Vec::new()).check_with(n)
    }
}
