//! What a character is made of.

use nalgebra::{Rotation3, Vector3};

use super::field::{self, Blob};
use super::pose::Key;
use super::turned;

/// A character as data.
#[derive(Clone, Debug, Default)]
pub struct Design {
    pub(super) joints: Vec<Bone>,
    pub(super) body: Vec<Blob>,
    /// Colour of the body where no region is.
    pub(super) coat: [f64; 3],
    /// Later ones lie over earlier ones.
    pub(super) regions: Vec<Region>,
    pub(super) features: Vec<Feature>,
    pub(super) limbs: Vec<Limb>,
    pub(super) keys: Vec<Key>,
    /// Length of the surface's edges at detail 1, metres.
    pub(super) cell: f64,
}

/// A joint at rest.
#[derive(Clone, Debug)]
pub(super) struct Bone {
    pub(super) name: String,
    pub(super) parent: Option<usize>,
    /// In the world.
    pub(super) at: Vector3<f64>,
}

/// Where the surface has a colour of its own: inside the union of blobs.
#[derive(Clone, Debug)]
pub(super) struct Region {
    pub(super) colour: [f64; 3],
    pub(super) blobs: Vec<Blob>,
}

/// A small solid that one joint carries.
#[derive(Clone, Debug)]
pub(super) struct Feature {
    pub(super) joint: usize,
    pub(super) colour: [f64; 3],
    pub(super) form: Form,
    /// Of balls alone.
    pub(super) regions: Vec<Region>,
}

#[derive(Clone, Debug)]
pub(super) enum Form {
    Ball {
        centre: Vector3<f64>,
        radii: Vector3<f64>,
        turn: Rotation3<f64>,
    },
    /// A tube along a smooth curve, its radii spread over its length; `on_body` lays it on the body's surface.
    Tube {
        points: Vec<Vector3<f64>>,
        radii: Vec<f64>,
        on_body: bool,
    },
}

/// Three joints in a row that bend as a leg or an arm does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limb {
    pub(super) joints: [usize; 3],
    /// Where the middle joint points when bent, at rest.
    pub(super) pole: Vector3<f64>,
}

impl Design {
    /// Number of the joint `name`.
    pub(super) fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|j| j.name == name)
    }

    /// Name, parent (-1 for the root) and place at rest in the parent's space of each joint. Their axes are the world's.
    pub fn skeleton(&self) -> impl Iterator<Item = (&str, i64, Vector3<f64>)> {
        self.joints.iter().map(|j| match j.parent {
            Some(parent) => (j.name.as_str(), parent as i64, j.at - self.joints[parent].at),
            None => (j.name.as_str(), -1, j.at),
        })
    }

    /// Where each joint stands at rest in the world.
    pub fn places(&self) -> impl Iterator<Item = Vector3<f64>> {
        self.joints.iter().map(|j| j.at)
    }

    /// Names of the key poses.
    pub fn key_names(&self) -> impl Iterator<Item = &str> {
        self.keys.iter().map(|k| k.name.as_str())
    }

    pub(super) fn add_joint(&mut self, name: &str, parent: Option<usize>, at: [f64; 3]) -> usize {
        self.joints.push(Bone { name: name.to_owned(), parent, at: at.into() });
        self.joints.len() - 1
    }

    /// Clay from a joint to a point.
    pub(super) fn add_cone(&mut self, joint: usize, start: [f64; 3], end: [f64; 3], radii: [f64; 2], blend: f64) {
        self.body.push(Blob { joint, ..cone(start, end, radii, blend) });
    }

    pub(super) fn add_ellipsoid(&mut self, joint: usize, centre: [f64; 3], radii: [f64; 3], turn: [f64; 3], blend: f64) {
        self.body.push(Blob { joint, ..ellipsoid(centre, radii, turn, blend) });
    }

    pub(super) fn add_ball(&mut self, joint: usize, hex: u32, centre: [f64; 3], radii: [f64; 3], turn: [f64; 3], regions: Vec<Region>) {
        let form = Form::Ball { centre: centre.into(), radii: radii.into(), turn: turned(turn) };
        self.features.push(Feature { joint, colour: linear(hex), form, regions });
    }

    pub(super) fn add_tube(&mut self, joint: usize, hex: u32, points: &[[f64; 3]], radii: &[f64], on_body: bool) {
        let form = Form::Tube { points: points.iter().map(|&p| p.into()).collect(), radii: radii.to_vec(), on_body };
        self.features.push(Feature { joint, colour: linear(hex), form, regions: Vec::new() });
    }
}

pub(super) fn cone(start: [f64; 3], end: [f64; 3], radii: [f64; 2], blend: f64) -> Blob {
    Blob { form: field::Form::Cone { ends: [start.into(), end.into()], radii }, blend, joint: 0 }
}

pub(super) fn ellipsoid(centre: [f64; 3], radii: [f64; 3], turn: [f64; 3], blend: f64) -> Blob {
    let form = field::Form::Ellipsoid { centre: centre.into(), radii: radii.into(), turn: turned(turn) };
    Blob { form, blend, joint: 0 }
}

/// The linear light of a colour in sRGB, `0xRRGGBB`.
pub(super) fn linear(hex: u32) -> [f64; 3] {
    [16, 8, 0].map(|shift| {
        let v = f64::from(hex >> shift & 255) / 255.0;
        if v <= 0.04045 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }
    })
}
