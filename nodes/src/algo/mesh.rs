//! Surfaces of triangles.

use nalgebra::{Matrix4, Vector3};

/// Unit normals of the vertices: the mean of the triangles around each, weighted by area. A vertex without any has the normal y.
pub fn normals_of(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<[f64; 3]> {
    let mut sums = vec![Vector3::zeros(); positions.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| Vector3::from(positions.get(v as usize).copied().unwrap_or_default()));
        let twice_area = (b - a).cross(&(c - a));
        t.iter().filter_map(|v| sums.get_mut(*v as usize).map(|s| *s += twice_area)).for_each(drop);
    }
    sums.into_iter().map(unit).collect()
}

/// A vector at length 1; y where it has no length.
pub fn unit(v: Vector3<f64>) -> [f64; 3] {
    v.try_normalize(0.0).filter(|n| n.iter().all(|x| x.is_finite())).unwrap_or_else(Vector3::y).into()
}

/// Vectors with so much of each list of displacements added.
pub fn morphed(rest: &[[f64; 3]], targets: &[(f64, &[[f64; 3]])]) -> Vec<[f64; 3]> {
    let mut out = rest.to_vec();
    for (weight, target) in targets.iter().filter(|(w, _)| *w != 0.0) {
        out.iter_mut().zip(*target).for_each(|(p, d)| (0..3).for_each(|i| p[i] += weight * d[i]));
    }
    out
}

/// The weighted sum of lists of vectors of one length.
pub fn blended(keys: &[(f64, &[[f64; 3]])]) -> Vec<[f64; 3]> {
    let n = keys.first().map_or(0, |k| k.1.len());
    morphed(&vec![[0.0; 3]; n], keys)
}

/// Positions and normals under an affine motion; normals go with the inverse transpose, or stay where it has none.
pub fn moved(motion: &Matrix4<f64>, positions: &[[f64; 3]], normals: &[[f64; 3]]) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let (linear, offset) = (motion.fixed_view::<3, 3>(0, 0).into_owned(), motion.fixed_view::<3, 1>(0, 3).into_owned());
    let positions = positions.iter().map(|p| (linear * Vector3::from(*p) + offset).into()).collect();
    let turned = linear.try_inverse().map(|i| i.transpose());
    (positions, normals.iter().map(|n| turned.map_or(*n, |t| unit(t * Vector3::from(*n)))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_those_of_the_triangles_by_area() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0], [9.0, 9.0, 9.0]];
        let n = normals_of(&p, &[[0, 1, 2], [0, 2, 3]]);
        assert_eq!(n[1], [0.0, 0.0, 1.0]);
        assert_eq!(n[3], [1.0, 0.0, 0.0]);
        let both = Vector3::new(3.0, 0.0, 1.0).normalize();
        assert!((Vector3::from(n[0]) - both).norm() < 1e-15);
        assert_eq!(n[4], [0.0, 1.0, 0.0], "a vertex of no triangle");
        assert_eq!(normals_of(&p, &[[0, 0, 0], [7, 8, 9]])[0], [0.0, 1.0, 0.0], "triangles without area or without vertices");
    }

    #[test]
    fn a_motion_moves_positions_and_turns_normals() {
        let motion = Matrix4::new_translation(&Vector3::new(1.0, 2.0, 3.0)) * Matrix4::new_nonuniform_scaling(&Vector3::new(2.0, 1.0, 1.0));
        let slant = [std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2, 0.0];
        let (p, n) = moved(&motion, &[[1.0, 0.0, 0.0]], &[slant]);
        let truth = Vector3::new(0.5, 1.0, 0.0).normalize();
        assert!(p == [[3.0, 2.0, 3.0]] && (Vector3::from(n[0]) - truth).norm() < 1e-15);
    }
}
