//! Flat bands of light, base colours and textures.

use nalgebra::Vector3;

use super::texture::Texture;
use crate::algo::surface::Surface;
use crate::algo::zbuffer::{NONE, Projected, ScreenTriangle};

/// Colours of the surface: linear light, opaque.
#[derive(Clone, Debug, Default)]
pub struct Paint<'a> {
    /// Colour of each part.
    pub base: Vec<[f32; 3]>,
    /// Colour of each vertex, by which that of its part is multiplied; none at all for white.
    pub vertex: Vec<[f32; 3]>,
    /// Place of each vertex on the texture, or none at all.
    pub uvs: Vec<[f64; 2]>,
    /// The texture of each part; none at all without.
    pub textures: Vec<Option<&'a Texture>>,
}

impl Paint<'_> {
    /// Paints vertices that were added between two others.
    pub(super) fn extend(&mut self, between: &[[u32; 2]]) {
        for &[a, b] in between {
            if let (Some(&p), Some(&q)) = (self.vertex.get(a as usize), self.vertex.get(b as usize)) {
                self.vertex.push([0, 1, 2].map(|k| (p[k] + q[k]) * 0.5));
            }
            if let (Some(&p), Some(&q)) = (self.uvs.get(a as usize), self.uvs.get(b as usize)) {
                self.uvs.push([0, 1].map(|k| (p[k] + q[k]) * 0.5));
            }
        }
    }
}

/// A flat spot where light is mirrored into the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Highlight {
    /// Cosine of half its angle: of the normal to the direction half-way between light and eye.
    pub cos: f64,
    /// How much of its colour covers the band, 0 to 1.
    pub strength: f32,
    /// Its colour, linear.
    pub colour: [f32; 3],
}

/// How light falls.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Towards the light, world space, of length one.
    pub direction: Vector3<f64>,
    /// Cosines of the normal to the light between the bands, ascending.
    pub thresholds: Vec<f64>,
    /// What the base colour is multiplied by in each band, darkest first: one more than thresholds, linear.
    pub shades: Vec<[f32; 3]>,
    /// A flat spot of mirrored light.
    pub highlight: Option<Highlight>,
}

/// Colours of points on the screen.
pub(super) struct Shader<'a> {
    pub(super) surface: &'a Surface,
    pub(super) projected: &'a Projected,
    pub(super) paint: &'a Paint<'a>,
    pub(super) light: &'a Light,
    pub(super) orthographic: bool,
    /// Towards the eye from far off: the camera's axis.
    pub(super) back: Vector3<f64>,
}

/// What of a triangle does not change from pixel to pixel.
pub(super) struct Shaded {
    id: u32,
    /// The weight of each corner, not yet for perspective: a x + b y + c.
    weights: [[f64; 3]; 3],
    /// What perspective multiplies them by.
    lens: [f64; 3],
    normals: [Vector3<f64>; 3],
    uvs: Option<[[f64; 2]; 3]>,
    level: usize,
    colours: [[f32; 3]; 3],
    part: usize,
}

impl Shader<'_> {
    /// Prepares a triangle, unless it is the one that was.
    #[inline]
    pub(super) fn prepare<'b>(&self, id: u32, last: &'b mut Option<Shaded>) -> &'b Shaded {
        if last.as_ref().is_some_and(|last| last.id != id) {
            *last = None;
        }
        last.get_or_insert_with(|| self.shaded(id))
    }

    /// The colour of a triangle at the centre of a pixel.
    #[inline]
    pub(super) fn at_centre(&self, id: u32, [x, y]: [usize; 2], last: &mut Option<Shaded>) -> [f32; 3] {
        self.colour(self.prepare(id, last), x as f64 + 0.5, y as f64 + 0.5)
    }

    #[inline]
    fn shaded(&self, id: u32) -> Shaded {
        let triangle = &self.projected.triangles[id as usize];
        let source = triangle.source as usize;
        // Seen from behind, a surface shows its other side.
        let side = if triangle.area() < 0.0 { -1.0 } else { 1.0 };
        let vertices = self.surface.triangles[source];
        let normals = self.surface.normal_of[source].map(|n| self.surface.normals[n as usize] * side);
        let part = self.surface.part[source] as usize;
        let base = self.paint.base.get(part).copied().unwrap_or([1.0; 3]);
        let tint = |v: u32| self.paint.vertex.get(v as usize).copied().unwrap_or([1.0; 3]);
        let colours = vertices.map(|v| std::array::from_fn(|k| base[k] * tint(v)[k]));
        let textured = self.paint.textures.get(part).is_some_and(Option::is_some) && !self.paint.uvs.is_empty();
        let uvs = textured.then(|| vertices.map(|v| self.paint.uvs.get(v as usize).copied().unwrap_or_default()));
        let lens = if self.orthographic { [1.0; 3] } else { triangle.near };
        let mut shaded = Shaded { id, weights: planes(triangle), lens, normals, uvs, level: 0, colours, part };
        if triangle.piece != NONE {
            self.spread(&mut shaded, &self.projected.pieces[triangle.piece as usize]);
        }
        shaded.level = shaded.uvs.zip(self.texture(part)).map_or(0, |(uvs, texture)| texture.level(&uvs, triangle.area().abs()));
        shaded
    }

    fn texture(&self, part: usize) -> Option<&Texture> {
        self.paint.textures.get(part).copied().flatten()
    }

    /// Gives a piece of a triangle corners of its own.
    fn spread(&self, shaded: &mut Shaded, weights: &[[f64; 3]; 3]) {
        let (normals, uvs, colours) = (shaded.normals, shaded.uvs, shaded.colours);
        for (i, w) in weights.iter().enumerate() {
            shaded.normals[i] = normals[0] * w[0] + normals[1] * w[1] + normals[2] * w[2];
            shaded.colours[i] = std::array::from_fn(|k| (0..3).map(|j| colours[j][k] * w[j] as f32).sum());
            if let (Some(to), Some(from)) = (&mut shaded.uvs, uvs) {
                to[i] = [0, 1].map(|k| (0..3).map(|j| from[j][k] * w[j]).sum());
            }
        }
    }

    /// The colour of a triangle at a place of the screen: linear, opaque.
    pub(super) fn colour(&self, shaded: &Shaded, x: f64, y: f64) -> [f32; 3] {
        // Close to its rim a triangle is sampled a little outside of it: clamped, so that nothing shoots over.
        let w = [0, 1, 2].map(|i| (shaded.weights[i][0] * x + shaded.weights[i][1] * y + shaded.weights[i][2]).max(0.0) * shaded.lens[i]);
        let sum = (w[0] + w[1] + w[2]).max(f64::MIN_POSITIVE);
        let w = w.map(|v| v / sum);
        let normal = shaded.normals[0] * w[0] + shaded.normals[1] * w[1] + shaded.normals[2] * w[2];
        let mut base: [f32; 3] = std::array::from_fn(|k| (0..3).map(|j| shaded.colours[j][k] * w[j] as f32).sum());
        if let (Some(uvs), Some(texture)) = (&shaded.uvs, self.texture(shaded.part)) {
            let at = [0, 1].map(|k| (0..3).map(|j| uvs[j][k] * w[j]).sum::<f64>());
            let [r, g, b, a] = texture.sample(at, shaded.level);
            // What is transparent in the texture shows the colour below; the rest is multiplied by it, as in glTF.
            let through = [r, g, b].map(|t| t + 1.0 - a);
            base = std::array::from_fn(|k| base[k] * through[k]);
        }
        self.light.apply(&normal, &self.back, base)
    }
}

impl Light {
    /// The base colour in the light.
    fn apply(&self, normal: &Vector3<f64>, back: &Vector3<f64>, base: [f32; 3]) -> [f32; 3] {
        let length = normal.norm().max(f64::MIN_POSITIVE);
        let lit = normal.dot(&self.direction) / length;
        let band = self.thresholds.iter().filter(|t| lit >= **t).count();
        let shade = self.shades.get(band).copied().unwrap_or([1.0; 3]);
        let colour: [f32; 3] = std::array::from_fn(|k| base[k] * shade[k]);
        match self.highlight {
            Some(spot) if lit > 0.0 && normal.dot(&(self.direction + back).normalize()) >= spot.cos * length => {
                std::array::from_fn(|k| colour[k] + (spot.colour[k] - colour[k]) * spot.strength)
            }
            _ => colour,
        }
    }
}

/// The weights of a triangle's corners over the screen.
fn planes(triangle: &ScreenTriangle) -> [[f64; 3]; 3] {
    let p = triangle.corners;
    let area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
    let scale = if area == 0.0 { 0.0 } else { 1.0 / area };
    [0, 1, 2].map(|i| {
        let (u, v) = (p[(i + 1) % 3], p[(i + 2) % 3]);
        let (a, b) = (u[1] - v[1], v[0] - u[0]);
        [a * scale, b * scale, -(a * u[0] + b * u[1]) * scale]
    })
}
