//! Where a figure stands and which way it looks: what a space of poses is freed from.

use nalgebra::Vector3;
use pegbar_engine::Setting;

/// What poses of a linear space are relative to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setting)]
pub enum Framing {
    /// The world, as in the paper.
    World,
    /// Their root.
    Root,
    /// Their root, turned about the vertical so that they look along +z.
    #[default]
    Heading,
}

/// A figure's place and heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    root: Vector3<f64>,
    cos: f64,
    sin: f64,
}

impl Stand {
    /// Of a figure with these markers, its root, and those of its left and right hip; `None` where one of them is not finite.
    ///
    /// A figure whose hips lie above each other looks along +z.
    pub fn new(framing: Framing, markers: &[Vector3<f64>], root: usize, hips: [usize; 2]) -> Option<Self> {
        let [left, right] = hips.map(|k| markers[k]);
        let across = left - right;
        let length = libm::hypot(across.x, across.z);
        let (cos, sin) = if framing == Framing::Heading && length > 1e-9 { (across.x / length, -across.z / length) } else { (1.0, 0.0) };
        let root = if framing == Framing::World { Vector3::zeros() } else { markers[root] };
        let finite = root.iter().chain([&cos, &sin]).all(|v| v.is_finite());
        finite.then_some(Self { root, cos, sin })
    }

    /// A direction of the world in the figure's own space.
    pub fn inward(&self, v: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.cos * v.x - self.sin * v.z, v.y, self.sin * v.x + self.cos * v.z)
    }

    /// A direction of the figure's own space in the world.
    pub fn outward(&self, v: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.cos * v.x + self.sin * v.z, v.y, self.cos * v.z - self.sin * v.x)
    }

    /// A place of the world in the figure's own space.
    pub fn local(&self, p: Vector3<f64>) -> Vector3<f64> {
        self.inward(p - self.root)
    }

    /// A place of the figure's own space in the world.
    pub fn world(&self, p: Vector3<f64>) -> Vector3<f64> {
        self.outward(p) + self.root
    }
}
