//! Surfaces made denser and smoother, and where their points lie on the surface that they were made of.
//!
//! **Source** Loop, *Smooth subdivision surfaces based on triangles*, 1987; Hoppe et al., *Piecewise smooth surface reconstruction*, 1994 (sharp edges);
//! Li, Gleicher, Xu, Shum 2003, section 3.2 (vertices move to the mean of their neighbours, then out along their normals to the volume of before).

use nalgebra::Vector3;

use super::surface::{Part, Surface, SurfaceError};

/// Triangles that subdivision makes at the most.
pub const MOST: usize = 1 << 22;

/// A vertex of a fair surface as a mean of vertices of the surface that it was made of: three at the most, all of one triangle.
pub type Origin = Vec<(u32, f64)>;

/// A fair surface in the making.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fair {
    /// Its vertices.
    pub positions: Vec<[f64; 3]>,
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Where each vertex comes from.
    pub origins: Vec<Origin>,
}

impl Fair {
    /// The surface's joined vertices, each its own origin. What cannot be seen as a triangle is left out.
    pub fn new(surface: &Surface) -> Self {
        let positions = surface.first.iter().map(|&v| surface.positions[v as usize].into()).collect();
        let real = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        let triangles = (0..surface.triangles.len()).map(|t| surface.corners(t)).filter(real).collect();
        Self { positions, triangles, origins: (0..surface.first.len() as u32).map(|v| vec![(v, 1.0)]).collect() }
    }

    /// It with its edges. Those bent by more than `hard` radians break its normals.
    ///
    /// # Errors
    /// Where a position is not finite.
    pub fn surface(&self, hard: f64) -> Result<Surface, SurfaceError> {
        Surface::new(&[Part { positions: &self.positions, triangles: &self.triangles, normals: &[] }], hard)
    }

    /// Every triangle in four by Loop's scheme. Open edges, and those bent by more than `sharp` radians, stay so. Cost: O(n).
    ///
    /// # Errors
    /// As of [`Fair::surface`].
    pub fn subdivide(&mut self, sharp: f64) -> Result<(), SurfaceError> {
        let surface = self.surface(sharp)?;
        let cos = libm::cos(sharp);
        // The surface joins vertices at one place once more; of each its first stands for all.
        let at = |joined: u32| Vector3::from(self.positions[surface.first[joined as usize] as usize]);
        let is_sharp: Vec<bool> = surface.edges.iter().map(|e| e.sides.contains(&super::surface::NONE) || e.bend < cos).collect();
        let around = Around::new(&surface, &is_sharp);
        let mut positions: Vec<[f64; 3]> = (0..surface.first.len() as u32).map(|v| around.vertex(v, &at).into()).collect();
        let mut origins: Vec<Origin> = surface.first.iter().map(|&v| self.origins[v as usize].clone()).collect();
        let mut middle_of = vec![0_u32; 3 * surface.triangles.len()];
        for (e, &sharp) in surface.edges.iter().zip(&is_sharp) {
            let [a, b] = e.ends;
            for half in e.sides.into_iter().filter(|h| *h != super::surface::NONE) {
                middle_of[half as usize] = positions.len() as u32;
            }
            let across = |half: u32| at(surface.corners(half as usize / 3)[(half as usize % 3 + 2) % 3]);
            let place =
                if sharp { (at(a) + at(b)) / 2.0 } else { (at(a) + at(b)) * 0.375 + (across(e.sides[0]) + across(e.sides[1])) * 0.125 };
            positions.push(place.into());
            origins.push(mixed(&origins[a as usize], &origins[b as usize], 0.5));
        }
        let mut triangles = Vec::with_capacity(4 * surface.triangles.len());
        for t in 0..surface.triangles.len() {
            let [a, b, c] = surface.corners(t);
            if a == b || b == c || c == a {
                continue;
            }
            let [p, q, r] = [0, 1, 2].map(|k| middle_of[3 * t + k]);
            triangles.extend([[a, p, r], [p, b, q], [r, q, c], [p, q, r]]);
        }
        *self = Self { positions, triangles, origins };
        Ok(())
    }

    /// Moves every vertex to the mean of its neighbours, `iterations` times, and then all out along their normals, so that the volume is that of before.
    /// The rims of an open surface stay where they are; its volume is that of the cone to its middle. Cost: O(n) an iteration.
    ///
    /// # Errors
    /// As of [`Fair::surface`].
    pub fn smooth(&mut self, iterations: u32) -> Result<(), SurfaceError> {
        if iterations == 0 {
            return Ok(());
        }
        let surface = self.surface(std::f64::consts::PI)?;
        let before = volume(&self.positions, &self.triangles);
        let mut fixed = vec![false; surface.first.len()];
        surface.edges.iter().filter(|e| e.open).for_each(|e| e.ends.iter().for_each(|&v| fixed[v as usize] = true));
        let mut at: Vec<Vector3<f64>> = surface.first.iter().map(|&v| Vector3::from(self.positions[v as usize])).collect();
        for _ in 0..iterations {
            let (mut sums, mut counts) = (vec![Vector3::zeros(); at.len()], vec![0_u32; at.len()]);
            for e in &surface.edges {
                let [a, b] = e.ends.map(|v| v as usize);
                sums[a] += at[b];
                sums[b] += at[a];
                counts[a] += 1;
                counts[b] += 1;
            }
            for (i, p) in at.iter_mut().enumerate().filter(|(i, _)| !fixed[*i] && counts[*i] > 0) {
                *p = sums[i] / f64::from(counts[i]);
            }
        }
        self.positions = surface.joined.iter().map(|&j| at[j as usize].into()).collect();
        self.inflate(before, &fixed)
    }

    /// Moves every vertex along its normal by the one distance that gives a volume.
    fn inflate(&mut self, wanted: f64, fixed: &[bool]) -> Result<(), SurfaceError> {
        let surface = self.surface(std::f64::consts::PI)?;
        let own = |v: usize| {
            let joined = surface.joined[v] as usize;
            if fixed.get(joined) == Some(&true) {
                Vector3::zeros()
            } else {
                surface.normals.get(joined).copied().unwrap_or_else(Vector3::zeros)
            }
        };
        let normals: Vec<Vector3<f64>> = (0..self.positions.len()).map(own).collect();
        let moved =
            |by: f64| -> Vec<[f64; 3]> { self.positions.iter().zip(&normals).map(|(p, n)| (Vector3::from(*p) + n * by).into()).collect() };
        let size = libm::cbrt(wanted.abs());
        let (mut by, step) = (0.0, 1e-4 * size);
        if size == 0.0 {
            return Ok(());
        }
        // The volume is a cubic of the distance, nearly straight over so short a way.
        for _ in 0..20 {
            let miss = wanted - volume(&moved(by), &self.triangles);
            let slope = (volume(&moved(by + step), &self.triangles) - volume(&moved(by - step), &self.triangles)) / (2.0 * step);
            let next = by + miss / slope;
            if !next.is_finite() || next.abs() > size {
                // A surface without an inside cannot be blown up: it stays as it was smoothed.
                return Ok(());
            }
            let done = (next - by).abs() < 1e-12 * size;
            by = next;
            if done {
                break;
            }
        }
        self.positions = moved(by);
        Ok(())
    }
}

/// A point between two, `t` of the way from the first.
pub fn mixed(a: &Origin, b: &Origin, t: f64) -> Origin {
    let mut all: Vec<(u32, f64)> = a.iter().map(|&(v, w)| (v, w * (1.0 - t))).chain(b.iter().map(|&(v, w)| (v, w * t))).collect();
    all.sort_by_key(|p| p.0);
    let mut out: Origin = Vec::with_capacity(3);
    for (v, w) in all {
        match out.last_mut() {
            Some(last) if last.0 == v => last.1 += w,
            _ => out.push((v, w)),
        }
    }
    out
}

/// The volume that triangles enclose, seen from the middle of their corners.
pub fn volume(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> f64 {
    let n = positions.len().max(1) as f64;
    let middle = positions.iter().map(|p| Vector3::from(*p)).sum::<Vector3<f64>>() / n;
    let corner = |v: u32| Vector3::from(positions[v as usize]) - middle;
    triangles.iter().map(|t| corner(t[0]).dot(&corner(t[1]).cross(&corner(t[2])))).sum::<f64>() / 6.0
}

/// The neighbours of each vertex.
struct Around {
    sums: Vec<Vector3<f64>>,
    counts: Vec<u32>,
    sharp: Vec<Vec<u32>>,
}

impl Around {
    fn new(surface: &Surface, is_sharp: &[bool]) -> Self {
        let n = surface.first.len();
        let mut own = Self { sums: vec![Vector3::zeros(); n], counts: vec![0; n], sharp: vec![Vec::new(); n] };
        for (e, &sharp) in surface.edges.iter().zip(is_sharp) {
            for [a, b] in [e.ends, [e.ends[1], e.ends[0]]] {
                own.sums[a as usize] += surface.positions[surface.first[b as usize] as usize];
                own.counts[a as usize] += 1;
                if sharp {
                    own.sharp[a as usize].push(b);
                }
            }
        }
        own
    }

    /// Where a vertex goes.
    fn vertex(&self, v: u32, at: &impl Fn(u32) -> Vector3<f64>) -> Vector3<f64> {
        let (own, n) = (at(v), f64::from(self.counts[v as usize]));
        match self.sharp[v as usize][..] {
            [] | [_] if n >= 3.0 => {
                let c = 0.375 + 0.25 * libm::cos(std::f64::consts::TAU / n);
                let beta = (0.625 - c * c) / n;
                own * (1.0 - n * beta) + self.sums[v as usize] * beta
            }
            [a, b] => own * 0.75 + (at(a) + at(b)) * 0.125,
            _ => own,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::solids::{cube, sphere};
    use super::*;

    fn fair((positions, triangles): (Vec<[f64; 3]>, Vec<[u32; 3]>)) -> Fair {
        let part = Part { positions: &positions, triangles: &triangles, normals: &[] };
        Fair::new(&Surface::new(&[part], 3.0).unwrap())
    }

    #[test]
    fn smoothing_keeps_the_volume_and_evens_out_bumps() {
        let (mut positions, triangles) = sphere(48, 24);
        for (i, p) in positions.iter_mut().enumerate() {
            let by = 1.0 + 0.03 * ((i * 7 % 11) as f64 / 11.0 - 0.5);
            *p = p.map(|v| v * by);
        }
        let roughness = |f: &Fair| {
            let r: Vec<f64> = f.positions.iter().map(|p| Vector3::from(*p).norm()).collect();
            let mean = r.iter().sum::<f64>() / r.len() as f64;
            (r.iter().map(|r| (r - mean) * (r - mean)).sum::<f64>() / r.len() as f64).sqrt()
        };
        let rough = fair((positions, triangles));
        let mut smooth = rough.clone();
        smooth.smooth(2).unwrap();
        let volumes = [&rough, &smooth].map(|f| volume(&f.positions, &f.triangles));
        assert!((volumes[0] - volumes[1]).abs() < 1e-9 * volumes[0], "{volumes:?}");
        assert!(roughness(&smooth) < roughness(&rough) / 1.7, "{} {}", roughness(&rough), roughness(&smooth));
    }

    #[test]
    fn subdivision_knows_where_its_vertices_come_from() {
        let (positions, triangles) = cube();
        let mut dense = fair((positions.clone(), triangles.clone()));
        dense.subdivide(3.2).unwrap();
        dense.subdivide(3.2).unwrap();
        assert_eq!(dense.triangles.len(), 16 * triangles.len());
        assert!(dense.origins.iter().all(|o| o.len() <= 3 && (o.iter().map(|p| p.1).sum::<f64>() - 1.0).abs() < 1e-12));
        // Loop's surface of a cube lies within it.
        assert!(dense.positions.iter().flatten().all(|v| v.abs() < 1.0));
        // With its edges sharp it stays the cube, and every vertex is where its origin says.
        let mut sharp = fair((positions.clone(), triangles));
        sharp.subdivide(0.5).unwrap();
        for (p, o) in sharp.positions.iter().zip(&sharp.origins) {
            let from = o.iter().map(|(v, w)| Vector3::from(positions[*v as usize]) * *w).sum::<Vector3<f64>>();
            assert!((Vector3::from(*p) - from).norm() < 1e-12, "{p:?} {o:?}");
        }
    }

    #[test]
    fn open_and_empty_surfaces_survive() {
        let mut flat = fair((vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]));
        flat.subdivide(1.0).unwrap();
        flat.smooth(2).unwrap();
        assert!(flat.positions.iter().flatten().all(|v| v.is_finite()));
        let mut none = Fair::default();
        none.smooth(1).unwrap();
        assert_eq!(none, Fair::default());
    }
}
