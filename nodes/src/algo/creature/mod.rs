//! Characters modelled as clay on a skeleton: a skinned surface with regions of colour, and key poses.
//!
//! A design is data: joints, lumps of clay about them that melt into each other, regions of colour, small solids (eyes, nose, whiskers) and key
//! poses. The clay's surface is found by dual marching cubes, evened out, and cut along the borders of the regions; joints move what is near them.
//! At rest a character stands on y = 0 about the origin, looks along +z, and has its left at +x; every joint's axes are the world's.
//!
//! **Source** Wyvill, McPheeters, Wyvill, *Data structure for soft objects*, 1986 (bodies as blended fields); Nielson, *Dual marching cubes*, 2004;
//! Thomas and Johnston, *The Illusion of Life*, 1981 (key poses). **Cost** O(area / cell² · lumps).

mod colour;
mod design;
mod field;
mod net;
mod otter;
mod performer;
mod pose;
mod solid;
#[cfg(test)]
mod tests;
mod weights;

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};

pub use design::Design;
use design::{Feature, Form, Region};
use field::{field, gradient, projected};
use net::Net;
pub use performer::Player;
pub use pose::KeyError;
use weights::{INFLUENCES, weights};

/// A skinned surface. Triangles of different colours share no vertex; otherwise it is closed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Creature {
    /// Vertices at rest, metres.
    pub positions: Vec<[f64; 3]>,
    /// Unit normals at rest.
    pub normals: Vec<[f64; 3]>,
    /// Colour of each vertex: linear light, opaque.
    pub colors: Vec<[f64; 4]>,
    /// Vertices of each triangle, anticlockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Joints that move each vertex, [`Creature::INFLUENCES`] a vertex.
    pub joints: Vec<u32>,
    /// How much each of them moves it; they add up to 1.
    pub weights: Vec<f64>,
}

impl Creature {
    /// Joints a vertex.
    pub const INFLUENCES: usize = INFLUENCES;

    /// Builds a design. `detail` divides the length of its edges: 1 gives some 15,000 triangles, 2 four times as many; below 0.75 fingers fold.
    ///
    /// `None` where the design's surface cannot be made at that detail.
    pub fn new(design: &Design, detail: f64) -> Option<Self> {
        let mut creature = Self::default();
        let blobs = &design.body;
        let mut body = net::net(blobs, design.cell / detail)?;
        let f = |p: &Vector3<f64>| field(blobs, p);
        paint(&mut body, &design.regions, &|p| projected(&f, p, design.cell, 1e-9));
        let normals: Vec<_> = body.positions.iter().map(|p| gradient(&f, p).normalize()).collect();
        let parents: Vec<_> = design.joints.iter().map(|j| j.parent).collect();
        let softness = libm::ceil(6.0 * detail * detail) as usize;
        let weights = weights(&body, blobs, &parents, softness);
        creature.append(&body, &normals, &weights, design.coat, &design.regions);
        for feature in &design.features {
            let mut net = solid_of(feature, &f, detail);
            paint_feature(&mut net, feature);
            let rigid: Vec<f64> = (0..parents.len()).map(|j| f64::from(u8::from(j == feature.joint))).collect();
            let weights = vec![rigid; net.positions.len()];
            creature.append(&net, &normals_of(&net), &weights, feature.colour, &feature.regions);
        }
        Some(creature)
    }

    /// Adds a surface, with a vertex of its own for each colour that meets there.
    fn append(&mut self, net: &Net, normals: &[Vector3<f64>], weights: &[Vec<f64>], colour: [f64; 3], regions: &[Region]) {
        let mut vertices = BTreeMap::new();
        for t in &net.triangles {
            let middle = t.iter().map(|&i| net.positions[i as usize]).sum::<Vector3<f64>>() / 3.0;
            let region = regions.iter().rposition(|r| field(&r.blobs, &middle) < 0.0);
            let [r, g, b] = region.map_or(colour, |r| regions[r].colour);
            let corners = t.map(|i| {
                *vertices.entry((region, i)).or_insert_with(|| {
                    let i = i as usize;
                    self.positions.push(net.positions[i].into());
                    self.normals.push(normals[i].into());
                    self.colors.push([r, g, b, 1.0]);
                    self.bind(&weights[i]);
                    self.positions.len() as u32 - 1
                })
            });
            self.triangles.push(corners);
        }
    }

    fn bind(&mut self, weights: &[f64]) {
        let end = self.joints.len() + INFLUENCES;
        for (joint, weight) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            self.joints.push(joint as u32);
            self.weights.push(*weight);
        }
        self.joints.resize(end, 0);
        self.weights.resize(end, 0.0);
    }
}

fn paint(net: &mut Net, regions: &[Region], on_surface: &impl Fn(&Vector3<f64>) -> Vector3<f64>) {
    let mut locked = Vec::new();
    for region in regions {
        colour::cut(net, &mut locked, &|p| field(&region.blobs, p), on_surface);
    }
}

fn paint_feature(net: &mut Net, feature: &Feature) {
    if let Form::Ball { centre, radii, turn } = &feature.form {
        paint(net, &feature.regions, &|p| {
            let own = turn.inverse_transform_vector(&(p - centre)).component_div(radii);
            centre + turn * own.normalize().component_mul(radii)
        });
    }
}

fn solid_of(feature: &Feature, f: &impl Fn(&Vector3<f64>) -> f64, detail: f64) -> Net {
    let finer = |n: f64| libm::ceil(n * detail) as u32;
    match &feature.form {
        Form::Ball { centre, radii, turn } => solid::ball(centre, radii, turn, finer(radii.max() / 0.0075).max(3)),
        Form::Tube { points, radii, on_body } => {
            let points = solid::curve(points, finer(4.0) as usize);
            let along = |i: usize| i as f64 / (points.len() - 1) as f64 * (radii.len() - 1) as f64;
            let radius = |i: usize| {
                let (low, t) = (along(i) as usize, along(i) - libm::floor(along(i)));
                radii[low] * (1.0 - t) + radii[(low + 1).min(radii.len() - 1)] * t
            };
            let radii: Vec<f64> = (0..points.len()).map(radius).collect();
            let points: Vec<_> = points.iter().map(|p| if *on_body { projected(f, p, 1.0, 1e-9) } else { *p }).collect();
            solid::tube(&points, &radii, finer(6.0).max(4))
        }
    }
}

/// Unit normals: the mean of the triangles about a vertex, by area.
fn normals_of(net: &Net) -> Vec<Vector3<f64>> {
    let mut sums = vec![Vector3::zeros(); net.positions.len()];
    for t in &net.triangles {
        let [a, b, c] = t.map(|i| net.positions[i as usize]);
        let normal = (b - a).cross(&(c - a));
        t.iter().for_each(|&i| sums[i as usize] += normal);
    }
    sums.iter().map(|n| n.try_normalize(0.0).unwrap_or_else(Vector3::y)).collect()
}

/// A rotation by degrees about z, then x, then y.
fn turned([x, y, z]: [f64; 3]) -> Rotation3<f64> {
    let [x, y, z] = [x, y, z].map(f64::to_radians);
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    about(Vector3::y_axis(), y) * about(Vector3::x_axis(), x) * about(Vector3::z_axis(), z)
}
