//! Fields of displacements over the vertices of a mesh: from the picture into the world, along a motion, and onto the mesh.
//!
//! **Source** Li, Gleicher, Xu, Shum 2003, sections 3.5 to 3.7: m_j is parallel to the picture and seen as the drawn displacement (figure 7); T_j(t) =
//! (sum_i w_ji M_i(t)) (sum_i w_ji M_i(t_e))⁻¹ (equation 2) takes it along (equation 3); v_j(t) + alpha(t) M(t, v_j) is drawn. Turkowski, *Transformations of
//! surface normal vectors*, 1990; Higham, *Computing the polar decomposition*, SIAM J. Sci. Stat. Comput. 7(4), 1986.

use nalgebra::{Matrix2, Matrix3, Matrix4, UnitQuaternion, Vector2, Vector3, Vector4};
use pegbar_engine::Setting;

use super::camera::Camera;

/// Vectors of the world, parallel to the picture, that are seen as `field`, at each of `positions`; nothing behind the camera.
///
/// A vertex keeps its depth, so the projection's 2 by 2 part over w is all that there is to turn round: D / (w P) in perspective, D over pixels a metre in
/// an orthographic view.
pub fn lift(positions: &[[f64; 3]], field: &[[f64; 2]], camera: &Camera) -> Vec<[f64; 3]> {
    let (clip, p) = (camera.clip_from_world(), &camera.projection);
    let flat = Matrix2::new(p[(0, 0)], p[(0, 1)], p[(1, 0)], p[(1, 1)]).try_inverse();
    let world = camera.world_from_camera();
    let [width, height] = camera.size.map(|n| n as f64);
    let one = |(p, d): (&[f64; 3], &[f64; 2])| {
        let w = (clip * Vector4::new(p[0], p[1], p[2], 1.0)).w;
        let (Some(flat), true) = (flat, w > 0.0 && *d != [0.0; 2]) else { return [0.0; 3] };
        let camera = flat * Vector2::new(2.0 * d[0] / width, -2.0 * d[1] / height) * w;
        (world * Vector4::new(camera.x, camera.y, 0.0, 0.0)).xyz().into()
    };
    positions.iter().zip(field).map(one).collect()
}

/// How a vector goes with what moves it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum Transport {
    /// By the inverse transpose, as normals do (the paper's first choice).
    Normal,
    /// As what lies in the surface does: longer where it is stretched.
    Tangent,
    /// By the rotation of the motion alone: its length stays.
    Rotation,
}

/// Joints and weights of the vertices of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Bound<'a> {
    /// Joints and weights a vertex.
    pub influences: usize,
    /// Joints that move each vertex.
    pub joints: &'a [u32],
    /// How much; they need not add up to 1.
    pub weights: &'a [f64],
}

/// A field that was made under the motions `then`, under the motions `now`: world from mesh at rest, for each joint.
///
/// Stretches of more than `limit` times, and of less than its inverse, are cut there, so that limbs that are folded flat make no spikes. Vectors of
/// nothing stay nothing. Cost: O(vertices · influences).
pub fn propagate(
    field: &[[f64; 3]],
    bound: &Bound,
    then: &[Matrix4<f64>],
    now: &[Matrix4<f64>],
    transport: Transport,
    limit: f64,
) -> Vec<[f64; 3]> {
    let one = |(v, m): (usize, &[f64; 3])| {
        if *m == [0.0; 3] {
            return *m;
        }
        let own = v * bound.influences..(v + 1) * bound.influences;
        let (joints, weights) = (&bound.joints[own.clone()], &bound.weights[own]);
        let [Some(a), Some(b)] = [now, then].map(|motions| blended(joints, weights, motions)) else { return *m };
        (transported(&a, &b, transport, limit) * Vector3::from(*m)).into()
    };
    field.iter().enumerate().map(one).collect()
}

/// The linear part of the weighted mean of motions; `None` where nothing moves.
fn blended(joints: &[u32], weights: &[f64], motions: &[Matrix4<f64>]) -> Option<Matrix3<f64>> {
    let sum: f64 = weights.iter().sum();
    let mut mean = Matrix3::zeros();
    for (j, w) in joints.iter().zip(weights) {
        mean += motions.get(*j as usize)?.fixed_view::<3, 3>(0, 0) * (w / sum);
    }
    mean.iter().all(|v| v.is_finite()).then_some(mean)
}

/// What takes a vector from where the linear map was `then` to where it is `now`.
fn transported(now: &Matrix3<f64>, then: &Matrix3<f64>, transport: Transport, limit: f64) -> Matrix3<f64> {
    if now == then {
        return Matrix3::identity();
    }
    let by = now * held(then, limit).try_inverse().unwrap_or_else(Matrix3::identity);
    match transport {
        Transport::Rotation => rotation(&by),
        Transport::Tangent => held(&by, limit),
        Transport::Normal => held(&by, limit).try_inverse().map_or_else(Matrix3::identity, |m| m.transpose()),
    }
}

/// A map whose stretches lie between the inverse of `limit` and `limit`, or, where it is flat altogether, the identity.
fn held(m: &Matrix3<f64>, limit: f64) -> Matrix3<f64> {
    let Some(svd) = m.try_svd(true, true, f64::EPSILON, 1000) else { return Matrix3::identity() };
    let (least, most) = (1.0 / limit, limit);
    if svd.singular_values.iter().all(|s| (least..=most).contains(s)) {
        return *m;
    }
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    u * Matrix3::from_diagonal(&svd.singular_values.map(|s| s.clamp(least, most))) * v_t
}

/// The rotation nearest to a map (its polar factor; the least stretched axis is turned round where the map mirrors).
pub fn rotation(m: &Matrix3<f64>) -> Matrix3<f64> {
    let size = m.norm();
    let mut x = m / size;
    // Newton's iteration doubles the digits each time, unless the map is nearly flat.
    if m.determinant() > 1e-3 * size * size * size / 5.2 {
        for _ in 0..30 {
            let Some(inverse) = x.try_inverse() else { break };
            let next = (x + inverse.transpose()) * 0.5;
            let step = (next - x).amax();
            x = next;
            if step < 1e-15 {
                return x;
            }
        }
    }
    let Some(svd) = m.try_svd(true, true, f64::EPSILON, 1000) else { return Matrix3::identity() };
    let (Some(mut u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    if (u * v_t).determinant() < 0.0 {
        let least = -u.column(2);
        u.set_column(2, &least);
    }
    u * v_t
}

/// Vertices with so much of each field added.
pub fn displaced(positions: &[[f64; 3]], fields: &[(f64, &[[f64; 3]])]) -> Vec<[f64; 3]> {
    super::mesh::morphed(positions, fields)
}

/// Normals turned as the surface around each vertex turns between two shapes of it; those around which nothing changes stay to the bit.
pub fn turned_normals(normals: &[[f64; 3]], before: &[[f64; 3]], after: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<[f64; 3]> {
    let (was, is) = (area_normals(before, triangles), area_normals(after, triangles));
    let one = |(n, (was, is)): (&[f64; 3], (&Vector3<f64>, &Vector3<f64>))| {
        if was == is {
            return *n;
        }
        UnitQuaternion::rotation_between(was, is).map_or(*n, |turn| (turn * Vector3::from(*n)).into())
    };
    normals.iter().zip(was.iter().zip(&is)).map(one).collect()
}

/// Twice the area vectors of the triangles around each vertex, added up.
fn area_normals(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let mut sums = vec![Vector3::zeros(); positions.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| Vector3::from(positions[v as usize]));
        let twice_area = (b - a).cross(&(c - a));
        t.iter().for_each(|v| sums[*v as usize] += twice_area);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algo::camera::{Orbit, orthographic, perspective};
    use nalgebra::Rotation3;

    fn cameras() -> [Camera; 2] {
        let orbit = Orbit { target: [0.3, 1.0, -0.2], azimuth: 0.7, elevation: 0.4, roll: 0.2, distance: 5.0 };
        let of = |projection| Camera::new(orbit.view(), projection, [640, 360]).unwrap();
        let mut shifted = perspective(0.9, [640, 360], 0.1, 100.0);
        // A lens that is shifted and pixels that are not square.
        shifted[(0, 2)] = 0.2;
        shifted[(0, 1)] = 0.05;
        [of(orthographic(120.0, [640, 360], 0.1, 100.0)), of(shifted)]
    }

    #[test]
    fn a_lifted_field_is_seen_as_it_was_drawn_and_keeps_its_depth() {
        let positions = [[0.0, 1.0, 0.0], [0.4, 0.7, 1.5], [-0.6, 1.4, -2.0]];
        let field = [[12.0, -7.0], [0.5, 30.0], [-200.0, 3.0]];
        for camera in cameras() {
            for ((p, d), m) in positions.iter().zip(&field).zip(lift(&positions, &field, &camera)) {
                let (before, after) = (camera.project(*p), camera.project([0, 1, 2].map(|k| p[k] + m[k])));
                for k in 0..2 {
                    assert!((after[k] - before[k] - d[k]).abs() < 1e-9, "{before:?} {after:?} {d:?}");
                }
                assert!((after[2] - before[2]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn in_an_orthographic_view_it_is_the_pixels_over_the_scale() {
        let orbit = Orbit { target: [0.0; 3], azimuth: 0.0, elevation: 0.0, roll: 0.0, distance: 3.0 };
        let camera = Camera::new(orbit.view(), orthographic(50.0, [100, 80], 0.1, 9.0), [100, 80]).unwrap();
        let m = lift(&[[7.0, 1.0, -20.0]], &[[10.0, 25.0]], &camera)[0];
        assert!((Vector3::from(m) - Vector3::new(0.2, -0.5, 0.0)).amax() < 1e-15, "{m:?}");
    }

    #[test]
    fn behind_the_camera_nothing_moves() {
        let [_, camera] = cameras();
        let behind = camera.world_from_camera() * Vector4::new(0.0, 0.0, 1.0, 1.0);
        assert_eq!(lift(&[behind.xyz().into()], &[[9.0, 9.0]], &camera), [[0.0; 3]]);
    }

    fn motion(turn: [f64; 3], scale: [f64; 3]) -> Matrix4<f64> {
        Rotation3::from_scaled_axis(Vector3::from(turn)).to_homogeneous() * Matrix4::new_nonuniform_scaling(&Vector3::from(scale))
    }

    fn taken(then: Matrix4<f64>, now: Matrix4<f64>, transport: Transport, m: [f64; 3]) -> Vector3<f64> {
        let bound = Bound { influences: 1, joints: &[0], weights: &[2.0] };
        propagate(&[m], &bound, &[then], &[now], transport, 10.0)[0].into()
    }

    #[test]
    fn all_three_ways_agree_on_rotations() {
        let (then, now) = (motion([0.3, -0.2, 1.0], [1.0; 3]), motion([-1.0, 0.8, 0.1], [1.0; 3]));
        let m = Vector3::new(0.3, -0.7, 0.2);
        let turn = now.fixed_view::<3, 3>(0, 0) * then.fixed_view::<3, 3>(0, 0).transpose();
        for transport in [Transport::Normal, Transport::Tangent, Transport::Rotation] {
            assert!((taken(then, now, transport, m.into()) - turn * m).amax() < 1e-14, "{transport:?}");
        }
    }

    #[test]
    fn a_stretch_lengthens_tangents_shortens_normals_and_leaves_rotations() {
        let (then, now) = (motion([0.0; 3], [1.0; 3]), motion([0.0; 3], [2.0, 1.0, 1.0]));
        let along = |transport| taken(then, now, transport, [1.0, 1.0, 0.0]);
        assert!((along(Transport::Tangent) - Vector3::new(2.0, 1.0, 0.0)).amax() < 1e-14);
        assert!((along(Transport::Normal) - Vector3::new(0.5, 1.0, 0.0)).amax() < 1e-14);
        assert!((along(Transport::Rotation) - Vector3::new(1.0, 1.0, 0.0)).amax() < 1e-14);
    }

    #[test]
    fn the_polar_factor_is_that_of_the_singular_values() {
        for (turn, scale) in [([0.4, 1.0, -2.0], [3.0, 0.2, 1.0]), ([1.0, 0.0, 0.0], [1.0, 1.0, 1e-7]), ([0.0, 2.0, 0.5], [1.0, 1.0, 1.0])]
        {
            let r = Rotation3::from_scaled_axis(Vector3::from(turn)).into_inner();
            let stretch = {
                let s = Rotation3::from_scaled_axis(Vector3::new(0.2, 0.5, -0.3)).into_inner();
                s * Matrix3::from_diagonal(&Vector3::from(scale)) * s.transpose()
            };
            assert!((rotation(&(r * stretch)) - r).amax() < 1e-9, "{scale:?}");
        }
        let mirrored = rotation(&Matrix3::from_diagonal(&Vector3::new(2.0, 1.0, -0.1)));
        assert!((mirrored - Matrix3::identity()).amax() < 1e-12);
    }

    #[test]
    fn what_is_folded_flat_makes_no_spikes() {
        // Two bones turned half round against each other blend to a map that is flat.
        let bound = Bound { influences: 2, joints: &[0, 1], weights: &[0.5, 0.5] };
        let flat = [motion([0.0; 3], [1.0; 3]), motion([0.0, std::f64::consts::PI, 0.0], [1.0; 3])];
        let plain = [motion([0.0; 3], [1.0; 3]), motion([0.0; 3], [1.0; 3])];
        for transport in [Transport::Normal, Transport::Tangent, Transport::Rotation] {
            for (then, now) in [(&flat, &plain), (&plain, &flat), (&[Matrix4::zeros(); 2], &plain), (&plain, &[Matrix4::zeros(); 2])] {
                let m = propagate(&[[1.0, 1.0, 1.0]], &bound, then, now, transport, 4.0)[0];
                assert!(m.iter().all(|v| v.is_finite() && v.abs() <= 4.0 * 2.0), "{transport:?} {m:?}");
            }
        }
    }

    #[test]
    fn the_same_motion_and_no_field_stay_to_the_bit() {
        let then = [motion([0.3, 0.1, 0.2], [1.0, 2.0, 0.7])];
        let bound = Bound { influences: 1, joints: &[0, 0], weights: &[1.0, 1.0] };
        let field = [[0.1, 0.2, 0.3], [0.0; 3]];
        for transport in [Transport::Normal, Transport::Tangent, Transport::Rotation] {
            assert_eq!(propagate(&field, &bound, &then, &then, transport, 10.0), field);
        }
    }

    #[test]
    fn normals_turn_with_what_is_around_them_and_others_stay() {
        let before = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0, 0.0, 0.0], [6.0, 0.0, 0.0], [5.0, 1.0, 0.0]];
        let mut after = before;
        after[2] = [0.0, 0.0, 1.0];
        let slant = Vector3::new(0.0, 0.6, 0.8);
        let normals = [slant.into(), [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.3, 0.1, 0.9], [0.0; 3], [0.0; 3]];
        let found = turned_normals(&normals, &before, &after, &[[0, 1, 2], [3, 4, 5]]);
        assert!((Vector3::from(found[1]) - Vector3::new(0.0, -1.0, 0.0)).amax() < 1e-14);
        assert!((Vector3::from(found[0]) - Vector3::new(0.0, -0.8, 0.6)).amax() < 1e-14, "an artist's normal turns along");
        assert_eq!(found[3..], normals[3..]);
    }
}
