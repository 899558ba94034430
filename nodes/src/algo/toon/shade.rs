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
    /// Half-way between the light and the eye from far off, the camera's axis.
    pub(super) half: Vector3<f64>,
}

/// What of a triangle does not change from pixel to pixel.
struct Shaded {
    id: u32,
    /// The weight of each corner in the view's perspective, up to a factor that is the same for all three: a x + b y + c.
    weights: [[f64; 3]; 3],
    normals: [Vector3<f64>; 3],
    /// The normal, of some length, is a x + b y + c too; `None` for a triangle so slim that a pixel's centre may lie far outside of it.
    normal: Option<[Vector3<f64>; 3]>,
    part: usize,
    colours: [[f32; 3]; 3],
    /// True where the colours of the corners are one.
    plain: bool,
    uvs: Option<[[f64; 2]; 3]>,
    level: usize,
}

impl Default for Shaded {
    fn default() -> Self {
        let (weights, normals, colours) = ([[0.0; 3]; 3], [Vector3::zeros(); 3], [[0.0; 3]; 3]);
        Self { id: NONE, weights, normals, normal: None, part: 0, colours, plain: true, uvs: None, level: 0 }
    }
}

/// The triangles that were shaded last: row by row, and sample by sample, the same ones come back.
pub(super) struct Recent(Vec<Shaded>);

/// How many of them: a power of two.
const RECENT: usize = 256;

impl Default for Recent {
    fn default() -> Self {
        Self(std::iter::repeat_with(Shaded::default).take(RECENT).collect())
    }
}

impl Shader<'_> {
    /// The colour of a triangle at a place of the screen, linear and opaque.
    #[inline]
    pub(super) fn colour(&self, id: u32, x: f64, y: f64, recent: &mut Recent) -> [f32; 3] {
        let shaded = &mut recent.0[id as usize % RECENT];
        if shaded.id != id {
            self.prepare(id, shaded);
        }
        self.colour_of(shaded, x, y)
    }

    /// The colour of a triangle at the centre of a pixel.
    #[inline]
    pub(super) fn at_centre(&self, id: u32, [x, y]: [usize; 2], recent: &mut Recent) -> [f32; 3] {
        self.colour(id, x as f64 + 0.5, y as f64 + 0.5, recent)
    }

    fn prepare(&self, id: u32, to: &mut Shaded) {
        let triangle = &self.projected.triangles[id as usize];
        let source = triangle.source as usize;
        let area = triangle.area();
        // Seen from behind, a surface shows its other side.
        let side = if area < 0.0 { -1.0 } else { 1.0 };
        let vertices = self.surface.triangles[source];
        let part = self.surface.part[source] as usize;
        (to.id, to.part) = (id, part);
        let [a, b, c] = self.surface.normal_of[source];
        let normal = |n: u32| self.surface.normals[n as usize] * side;
        to.normals = [normal(a), normal(b), normal(c)];
        let lens = if self.orthographic { [1.0; 3] } else { triangle.near };
        to.weights = planes(triangle, area, lens);
        let base = self.paint.base.get(part).copied().unwrap_or([1.0; 3]);
        (to.plain, to.uvs) = (self.paint.vertex.is_empty(), None);
        to.colours = if to.plain {
            [base; 3]
        } else {
            let tint = |v: u32| self.paint.vertex.get(v as usize).copied().unwrap_or([1.0; 3]);
            vertices.map(|v| std::array::from_fn(|k| base[k] * tint(v)[k]))
        };
        let texture = self.texture(part).filter(|_| !self.paint.uvs.is_empty());
        to.uvs = texture.map(|_| vertices.map(|v| self.paint.uvs.get(v as usize).copied().unwrap_or_default()));
        if triangle.piece != NONE {
            spread(to, &self.projected.pieces[triangle.piece as usize]);
        }
        let along = |k: usize| to.normals[0] * to.weights[0][k] + to.normals[1] * to.weights[1][k] + to.normals[2] * to.weights[2][k];
        to.normal = (!slim(triangle, area)).then(|| [along(0), along(1), along(2)]);
        to.level = to.uvs.zip(texture).map_or(0, |(uvs, texture)| texture.level(&uvs, area.abs()));
    }

    fn texture(&self, part: usize) -> Option<&Texture> {
        self.paint.textures.get(part).copied().flatten()
    }

    #[inline]
    fn colour_of(&self, shaded: &Shaded, x: f64, y: f64) -> [f32; 3] {
        let bare = shaded.plain && shaded.uvs.is_none();
        if bare && let Some([a, b, c]) = &shaded.normal {
            return self.lit(&(a * x + b * y + c), shaded.colours[0]);
        }
        // Close to its rim a triangle is sampled a little outside of it: clamped, so that nothing shoots over.
        let w = shaded.weights.map(|[a, b, c]| (a * x + b * y + c).max(0.0));
        // Light asks for the normal's direction alone, so that its weights need not add up to 1.
        let normal = shaded.normals[0] * w[0] + shaded.normals[1] * w[1] + shaded.normals[2] * w[2];
        self.lit(&normal, if bare { shaded.colours[0] } else { self.base(shaded, w) })
    }

    /// The colour of a triangle without light, where its corners have the weights `w`.
    fn base(&self, shaded: &Shaded, w: [f64; 3]) -> [f32; 3] {
        let sum = (w[0] + w[1] + w[2]).max(f64::MIN_POSITIVE);
        let w = w.map(|v| v / sum);
        let base: [f32; 3] = std::array::from_fn(|k| (0..3).map(|j| shaded.colours[j][k] * w[j] as f32).sum());
        let (Some(uvs), Some(texture)) = (&shaded.uvs, self.texture(shaded.part)) else { return base };
        let at = [0, 1].map(|k| (0..3).map(|j| uvs[j][k] * w[j]).sum::<f64>());
        let [r, g, b, a] = texture.sample(at, shaded.level);
        // What is transparent in the texture shows the colour below; the rest is multiplied by it, as in glTF.
        let through = [r, g, b].map(|t| t + 1.0 - a);
        std::array::from_fn(|k| base[k] * through[k])
    }

    /// The base colour in the light, where the normal has this direction.
    #[inline]
    fn lit(&self, normal: &Vector3<f64>, base: [f32; 3]) -> [f32; 3] {
        let length = normal.norm().max(f64::MIN_POSITIVE);
        let lit = normal.dot(&self.light.direction);
        let band = self.light.thresholds.iter().filter(|t| lit >= **t * length).count();
        let shade = self.light.shades.get(band).copied().unwrap_or([1.0; 3]);
        let colour: [f32; 3] = std::array::from_fn(|k| base[k] * shade[k]);
        match self.light.highlight {
            Some(spot) if lit > 0.0 && normal.dot(&self.half) >= spot.cos * length => {
                std::array::from_fn(|k| colour[k] + (spot.colour[k] - colour[k]) * spot.strength)
            }
            _ => colour,
        }
    }
}

/// Gives a piece of a triangle corners of its own.
fn spread(shaded: &mut Shaded, weights: &[[f64; 3]; 3]) {
    let (normals, uvs, colours) = (shaded.normals, shaded.uvs, shaded.colours);
    for (i, w) in weights.iter().enumerate() {
        shaded.normals[i] = normals[0] * w[0] + normals[1] * w[1] + normals[2] * w[2];
        if !shaded.plain {
            shaded.colours[i] = std::array::from_fn(|k| (0..3).map(|j| colours[j][k] * w[j] as f32).sum());
        }
        if let (Some(to), Some(from)) = (&mut shaded.uvs, uvs) {
            to[i] = [0, 1].map(|k| (0..3).map(|j| from[j][k] * w[j]).sum());
        }
    }
}

/// The weights of a triangle's corners over the screen, each times its `lens`. `area` is [`ScreenTriangle::area`].
fn planes(triangle: &ScreenTriangle, area: f64, lens: [f64; 3]) -> [[f64; 3]; 3] {
    let p = triangle.corners;
    // Over an area of which y runs up.
    let scale = if area == 0.0 { 0.0 } else { -1.0 / area };
    let plane = |i: usize| {
        let (u, v, scale) = (p[(i + 1) % 3], p[(i + 2) % 3], scale * lens[i]);
        let (a, b) = (u[1] - v[1], v[0] - u[0]);
        [a * scale, b * scale, -(a * u[0] + b * u[1]) * scale]
    };
    [plane(0), plane(1), plane(2)]
}

/// True for a triangle less than an eighth of a pixel high; its corners are drawn up to 1/512 of a pixel from where they are.
fn slim(triangle: &ScreenTriangle, area: f64) -> bool {
    let p = triangle.corners;
    let side = |i: usize| (p[i][0] - p[(i + 1) % 3][0]).powi(2) + (p[i][1] - p[(i + 1) % 3][1]).powi(2);
    64.0 * area * area < side(0).max(side(1)).max(side(2))
}
