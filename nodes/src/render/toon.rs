//! `render.toon`: meshes in flat bands of light with ink lines, as a camera sees them.
//!
//! **Method** see [`crate::algo::toon`]: exact coverage, bands of light, silhouettes along the zero set of n · v, creases, borders, seams and, if asked
//! for, where parts run through each other ([`crate::algo::crossings`]); coarse meshes are rounded where their silhouettes would show it.
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 4 (its renderer); Hertzmann and Zorin, *Illustrating
//! smooth surfaces*, 2000 (its lines).
//!
//! **Fails when** a position or the camera is not finite, or the light has no direction.
//!
//! **Cost** O(triangles + pixels touched + length of lines).
//!
//! ```ron
//! "camera": (type: "camera.perspective", azimuth_deg: 30.0, target: (0.0, 1.0, 0.0)),
//! "toon":   (type: "render.toon", mesh: "@skin", camera: "@camera", colors: [(0.9, 0.55, 0.2)], outline_width: 3.0),
//! "comp":   (type: "comp.over", fg: "@toon", bg: "@plate"),
//! ```

use nalgebra::Vector3;
use pegbar_engine::node::{Context, In, List, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs, Setting};

use super::scene::{seen_by, surface_of, toward_light};
use super::{blank, faded, rgba, screen, within};
use crate::algo::silhouette::Lines;
use crate::algo::surface::Surface;
use crate::algo::toon::{Highlight, Light, Paint, Pen, Style, Texture, render};
use crate::algo::window::Window;
use crate::algo::{camera, toon};
use crate::data::{Camera, Image, Mesh};

/// What the direction of the light is told in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub(crate) enum LightSpace {
    /// The world: the light stands still while the camera goes round.
    #[default]
    World,
    /// The camera: x to the right of the picture, y up, z towards the eye.
    Camera,
}

/// The pictures of a render, each of the camera's size.
#[derive(Outputs)]
pub(crate) struct Rendered {
    /// Four channels, linear light, premultiplied; transparent where there is no mesh.
    pub(crate) image: Image,
    /// Depth along the camera's axis in metres, of fills, not lines; 0 where there is no mesh.
    depth: Image,
    /// Number of the mesh in the list, counted from 1; 0 where there is none.
    id: Image,
}

/// Meshes in flat bands of light with ink lines, as a camera sees them.
///
/// Colours are given as seen on screen, 0 to 1.
#[derive(Node)]
#[node(
    id = "render.toon",
    version = 4,
    outputs = Rendered,
    source = "Li, Gleicher, Xu, Shum 2003, section 4; Hertzmann, Zorin 2000",
    example = "\"toon\": (type: \"render.toon\", mesh: \"@skin\", camera: \"@camera\", colors: [(0.9, 0.55, 0.2)], outline_width: 3.0)"
)]
pub(crate) struct RenderToon {
    /// The meshes, one or a list; they hide each other as they stand in space.
    mesh: List<In<Mesh>>,
    /// Where they are seen from, and how large the picture is.
    camera: In<Camera>,
    /// A texture for all meshes, or one for each in their order. What is transparent in it shows the colour below.
    texture: List<Option<In<Image>>>,
    /// Colours of the meshes in turn; colours of vertices are multiplied by them. White for those that have a texture or colours of their own and an
    /// ochre for others where it is left out.
    #[input(default = [], range = 0.0..=1.0)]
    colors: Vec<[f64; 3]>,
    /// Towards the light.
    #[input(default = (0.4, 0.8, 0.5))]
    light: [f64; 3],
    /// What that is told in.
    #[input(default = world)]
    light_space: LightSpace,
    /// Cosines of the angle between normal and light at which one band ends and the next begins; none at all for one flat colour.
    #[input(default = [0.3], range = -1.0..=1.0)]
    thresholds: Vec<f64>,
    /// What the colours are multiplied by in each band, darkest first: one more than there are thresholds; the last goes for all that follow.
    #[input(default = [(0.62, 0.58, 0.72), (1.0, 1.0, 1.0)], range = 0.0..=1.0)]
    shades: Vec<[f64; 3]>,
    /// Angle across the flat spot where light is mirrored into the eye. 0 draws none.
    #[input(default = 0.0, range = 0.0..=180.0, unit = "°")]
    highlight_deg: f64,
    /// Colour of that spot.
    #[input(default = (1.0, 1.0, 1.0), range = 0.0..=1.0)]
    highlight_color: [f64; 3],
    /// Opacity of that spot.
    #[input(default = 0.8, range = 0.0..=1.0)]
    highlight_opacity: f64,
    /// Width of silhouettes and borders. 0 draws none.
    #[input(default = 3.0, range = 0.0..=1000.0, unit = "px")]
    outline_width: f64,
    /// Width of creases, seams and intersections. 0 draws none.
    #[input(default = 2.0, range = 0.0..=1000.0, unit = "px")]
    crease_width: f64,
    /// Edges bent by more than this are drawn. 180 draws none.
    #[input(default = 60.0, range = 0.0..=180.0, unit = "°")]
    crease_deg: f64,
    /// Edges bent by more than this end smooth light, in meshes without normals of their own. 0 shows every triangle, 180 none.
    #[input(default = 60.0, range = 0.0..=180.0, unit = "°")]
    hard_deg: f64,
    /// Draw the rims of open meshes.
    #[input(default = true)]
    borders: bool,
    /// Draw where meshes, or colours of one mesh, meet.
    #[input(default = true)]
    seams: bool,
    /// Draw where meshes, or parts of one, run through each other: a leg in a shoe, a tree in the ground.
    #[input(default = false)]
    intersections: bool,
    /// Colour of the lines.
    #[input(default = (0.1, 0.08, 0.07), range = 0.0..=1.0)]
    ink_color: [f64; 3],
    /// Opacity of the lines.
    #[input(default = 1.0, range = 0.0..=1.0)]
    ink_opacity: f64,
    /// Over how many pixels a line that ends of itself thins out to a point.
    #[input(default = 12.0, range = 0.0..=10000.0, unit = "px")]
    taper: f64,
    /// How much lines thin out with distance: width × (depth of the middle / depth) to this power. 0 not at all, 1 as perspective does.
    #[input(default = 0.0, range = 0.0..=4.0)]
    thin_far: f64,
    /// How much wider lines are where the surface faces away from the light: 1 doubles them, 0 leaves them.
    #[input(default = 0.0, range = 0.0..=10.0)]
    shadow_weight: f64,
    /// How deep a line may lie under what is before it and still be drawn, as a part of the whole's extent: eyes and mouths that lie on a head, or are sunk
    /// into it, keep their outlines. 0 draws what is seen alone.
    #[input(default = 0.005, range = 0.0..=1.0)]
    line_bias: f64,
    /// How far a mesh may lie inside of the smooth surface that it stands for before it is made finer at its silhouettes. 0 draws it as it is.
    #[input(default = 0.25, range = 0.0..=100.0, unit = "px")]
    round: f64,
    /// Exact coverage, and 16 samples where colours meet; false draws what each pixel's centre sees.
    #[input(default = true)]
    antialias: bool,
}

/// The colour of a mesh that nothing is said of.
const OCHRE: [f64; 3] = [0.87, 0.62, 0.32];

impl RenderToon {
    fn check_numbers(&self) -> Result<(), NodeError> {
        within("highlight_deg", self.highlight_deg, 0.0, 180.0)?;
        within("highlight_opacity", self.highlight_opacity, 0.0, 1.0)?;
        within("outline_width", self.outline_width, 0.0, 1000.0)?;
        within("crease_width", self.crease_width, 0.0, 1000.0)?;
        within("crease_deg", self.crease_deg, 0.0, 180.0)?;
        within("hard_deg", self.hard_deg, 0.0, 180.0)?;
        within("ink_opacity", self.ink_opacity, 0.0, 1.0)?;
        within("taper", self.taper, 0.0, 10000.0)?;
        within("thin_far", self.thin_far, 0.0, 4.0)?;
        within("shadow_weight", self.shadow_weight, 0.0, 10.0)?;
        within("line_bias", self.line_bias, 0.0, 1.0)?;
        within("round", self.round, 0.0, 100.0)?;
        Ok(())
    }

    fn light(&self, camera: &camera::Camera) -> Result<Light, NodeError> {
        let given = toward_light(self.light)?;
        let direction = match self.light_space {
            LightSpace::World => given,
            LightSpace::Camera => {
                let turned = camera.world_from_camera().fixed_view::<3, 3>(0, 0) * given;
                turned.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::z)
            }
        };
        let opaque = |c: [f64; 3]| {
            let [r, g, b, _] = screen(c);
            [r, g, b]
        };
        let mut shades: Vec<[f32; 3]> = self.shades.iter().map(|&s| opaque(s)).collect();
        let last = shades.last().copied().unwrap_or([1.0; 3]);
        shades.resize(self.thresholds.len() + 1, last);
        let highlight = (self.highlight_deg > 0.0).then(|| Highlight {
            cos: libm::cos(self.highlight_deg.to_radians() / 2.0),
            strength: self.highlight_opacity as f32,
            colour: opaque(self.highlight_color),
        });
        Ok(Light { direction, thresholds: self.thresholds.clone(), shades, highlight })
    }

    fn paint<'a>(&self, textures: &'a [Option<Texture>]) -> Paint<'a> {
        let meshes = &self.mesh.0;
        let texture = |i: usize| textures.get(if textures.len() == 1 { 0 } else { i }).and_then(Option::as_ref);
        let base = |(i, mesh): (usize, &In<Mesh>)| {
            let own = !mesh.colors.is_empty() || texture(i).is_some();
            let [r, g, b, _] = match self.colors.len() {
                0 => screen(if own { [1.0; 3] } else { OCHRE }),
                n => screen(self.colors[i % n]),
            };
            [r, g, b]
        };
        let mut paint = Paint { base: meshes.iter().enumerate().map(base).collect(), ..Paint::default() };
        if meshes.iter().any(|m| !m.colors.is_empty()) {
            // Colours are premultiplied, and meshes opaque.
            let opaque = |c: &[f64; 4]| [0, 1, 2].map(|k| if c[3] > 0.0 { (c[k] / c[3]) as f32 } else { 0.0 });
            for mesh in meshes {
                paint.vertex.extend(mesh.colors.iter().map(opaque));
                paint.vertex.resize(paint.vertex.len() + mesh.positions.len() - mesh.colors.len(), [1.0; 3]);
            }
        }
        if textures.iter().any(Option::is_some) {
            for mesh in meshes {
                paint.uvs.extend(mesh.uvs.iter());
                paint.uvs.resize(paint.uvs.len() + mesh.positions.len() - mesh.uvs.len(), [0.0; 2]);
            }
            paint.textures = meshes.iter().enumerate().map(|(i, m)| texture(i).filter(|_| !m.uvs.is_empty())).collect();
        }
        paint
    }

    fn lines(&self) -> Option<(Lines, Pen)> {
        let (outlines, inner) = (self.outline_width > 0.0, self.crease_width > 0.0);
        let colour = faded(screen(self.ink_color), self.ink_opacity);
        let lines = Lines {
            silhouettes: outlines,
            borders: outlines && self.borders,
            crease: (inner && self.crease_deg < 180.0).then(|| self.crease_deg.to_radians()),
            seams: inner && self.seams,
            intersections: inner && self.intersections,
        };
        let pen = Pen {
            outline: self.outline_width,
            inner: self.crease_width,
            taper: self.taper,
            thin_far: self.thin_far,
            weight: self.shadow_weight,
            bias: self.line_bias,
            colour,
        };
        ((outlines || inner) && self.ink_opacity > 0.0).then_some((lines, pen))
    }

    fn draw(&self, surface: Surface, camera: &camera::Camera, threads: usize) -> Result<toon::Render, NodeError> {
        let textures = self.texture.0.iter().map(|t| t.as_ref().map(|t| texture_of(t)).transpose()).collect::<Result<Vec<_>, _>>()?;
        let textures: Vec<Option<Texture>> = textures.into_iter().map(Option::flatten).collect();
        let style = Style {
            paint: self.paint(&textures),
            light: self.light(camera)?,
            lines: self.lines(),
            round: (self.round > 0.0).then_some(self.round),
            antialias: self.antialias,
            threads,
        };
        Ok(render(surface, camera, style))
    }
}

/// A picture as a texture: all of its display window; `None` for one without a pixel.
fn texture_of(image: &Image) -> Result<Option<Texture>, NodeError> {
    let window = image.display_window();
    Ok(Texture::new(&rgba(image, window)?, window.width, window.height))
}

impl PerFrame for RenderToon {
    fn run(self, cx: &Context) -> Result<Rendered, NodeError> {
        self.check_numbers()?;
        let camera = seen_by(&self.camera)?;
        let [width, height] = camera.size;
        blank(Window::new(0, 0, width, height))?;
        let edges = self.antialias || self.round > 0.0 || self.lines().is_some();
        let surface = surface_of(&self.mesh.0, self.hard_deg, edges)?;
        // The frames of a stream are drawn side by side already.
        let drawn = self.draw(surface, &camera, usize::from(cx.clock.len() > 1))?;
        let picture = |channels: usize, name: &str, samples: Vec<f32>| {
            let image = Image::new(width, height, channels, samples)
                .ok_or_else(|| NodeError::internal("a picture of another size than its samples"));
            image.map(|i| if channels == 1 { i.with_channels(vec![name.to_owned()]) } else { i })
        };
        Ok(Rendered { image: picture(4, "", drawn.image)?, depth: picture(1, "Z", drawn.depth)?, id: picture(1, "id", drawn.id)? })
    }
}

#[cfg(test)]
#[path = "toon_tests.rs"]
mod tests;
