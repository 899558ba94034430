//! Bodies as fields: smooth unions of round cones and ellipsoids.

use nalgebra::{Rotation3, Vector3};

/// The form of a blob.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Form {
    /// Two balls and the cone that touches both.
    Cone { ends: [Vector3<f64>; 2], radii: [f64; 2] },
    /// Half axes along its own x, y, z; `turn` is world from own.
    Ellipsoid { centre: Vector3<f64>, radii: Vector3<f64>, turn: Rotation3<f64> },
}

/// A lump of clay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Blob {
    pub(super) form: Form,
    /// How wide a fillet joins it to those before it, metres.
    pub(super) blend: f64,
    /// The joint that it is modelled about.
    pub(super) joint: usize,
}

/// A round cone's distance, after Quilez, *Distance functions*, 2013.
fn cone(p: &Vector3<f64>, ends: &[Vector3<f64>; 2], radii: &[f64; 2]) -> f64 {
    let (axis, from_start) = (ends[1] - ends[0], p - ends[0]);
    let (length_sq, taper) = (axis.norm_squared(), radii[0] - radii[1]);
    let slant_sq = length_sq - taper * taper;
    if slant_sq <= 0.0 {
        // One ball is inside the other.
        let larger = usize::from(radii[1] > radii[0]);
        return (p - ends[larger]).norm() - radii[larger];
    }
    let y = from_start.dot(&axis);
    let z = y - length_sq;
    let x_sq = (from_start * length_sq - axis * y).norm_squared();
    let (y_sq, z_sq) = (y * y * length_sq, z * z * length_sq);
    let k = taper.signum() * taper * taper * x_sq;
    if z.signum() * slant_sq * z_sq > k {
        (x_sq + z_sq).sqrt() / length_sq - radii[1]
    } else if y.signum() * slant_sq * y_sq < k {
        (x_sq + y_sq).sqrt() / length_sq - radii[0]
    } else {
        ((x_sq * slant_sq / length_sq).sqrt() + y * taper) / length_sq - radii[0]
    }
}

/// An ellipsoid's distance, exact to first order at its surface.
fn ellipsoid(own: &Vector3<f64>, radii: &Vector3<f64>) -> f64 {
    let scaled = own.component_div(radii);
    let (near, steep) = (scaled.norm(), scaled.component_div(radii).norm());
    if steep < 1e-12 { -radii.min() } else { near * (near - 1.0) / steep }
}

impl Blob {
    /// Distance to its surface, below nought inside, metres.
    pub(super) fn distance(&self, p: &Vector3<f64>) -> f64 {
        match &self.form {
            Form::Cone { ends, radii } => cone(p, ends, radii),
            Form::Ellipsoid { centre, radii, turn } => ellipsoid(&turn.inverse_transform_vector(&(p - centre)), radii),
        }
    }

    /// The middle, and how far from it the blob reaches.
    pub(super) fn bounds(&self) -> (Vector3<f64>, f64) {
        match &self.form {
            Form::Cone { ends, radii } => ((ends[0] + ends[1]) / 2.0, (ends[1] - ends[0]).norm() / 2.0 + radii[0].max(radii[1])),
            Form::Ellipsoid { centre, radii, .. } => (*centre, radii.max()),
        }
    }

    /// A length that tells how thick it is: the mean radius.
    pub(super) fn thickness(&self) -> f64 {
        match &self.form {
            Form::Cone { radii, .. } => (radii[0] + radii[1]) / 2.0,
            Form::Ellipsoid { radii, .. } => radii.sum() / 3.0,
        }
    }
}

/// A minimum whose crease is filled over a width of `k`.
fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0);
    if h == 0.0 { a.min(b) } else { a.min(b) - h * h / (4.0 * k) }
}

/// Smooth union of blobs, in their order: below nought inside.
pub(super) fn field(blobs: &[Blob], p: &Vector3<f64>) -> f64 {
    let mut sum = f64::INFINITY;
    for blob in blobs {
        let (middle, reach) = blob.bounds();
        let far = sum + blob.blend + reach;
        // What is farther than its fillet changes nothing.
        if far <= 0.0 || (p - middle).norm_squared() >= far * far {
            continue;
        }
        let d = blob.distance(p);
        sum = if sum.is_finite() { smooth_min(sum, d, blob.blend) } else { d };
    }
    sum
}

/// Which way a field grows: differences to the corners of a small tetrahedron.
pub(super) fn gradient(f: &impl Fn(&Vector3<f64>) -> f64, p: &Vector3<f64>) -> Vector3<f64> {
    const STEP: f64 = 1e-6;
    const CORNERS: [[f64; 3]; 4] = [[1.0, -1.0, -1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]];
    let corners = CORNERS.map(Vector3::from);
    corners.iter().map(|c| c * f(&(p + c * STEP))).sum::<Vector3<f64>>() / (4.0 * STEP)
}

/// The point of the surface near `p`, as far off as `tolerance`: Newton steps down the gradient, none longer than `reach`.
pub(super) fn projected(f: &impl Fn(&Vector3<f64>) -> f64, p: &Vector3<f64>, reach: f64, tolerance: f64) -> Vector3<f64> {
    let mut at = *p;
    for _ in 0..5 {
        let value = f(&at);
        if value.abs() < tolerance {
            break;
        }
        let slope = gradient(f, &at);
        let step = slope * (-value / slope.norm_squared().max(1e-6));
        at += step * (reach / step.norm().max(reach));
    }
    at
}
