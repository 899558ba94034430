//! Least squares over markers that only limbs tie together: eliminated from the leaves of a tree to its root.
//!
//! A limb ties two markers by rows u · (X_child − X_parent) = β. Minimised over the child, what is left of child and limb is again such a row of the
//! parent, so that the whole system of 3N unknowns costs O(N) in place of O(N³). An infinite weight is a constraint, and needs no other formula.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

/// A limb of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Edge {
    pub(super) child: usize,
    pub(super) parent: usize,
    /// Its place in the list of limbs.
    pub(super) limb: usize,
    /// True where the list has it from child to parent.
    pub(super) turned: bool,
}

/// Limbs in such an order that each comes before those nearer to the root.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tree {
    pub(super) n: usize,
    pub(super) edges: Vec<Edge>,
    /// Limbs that close rings.
    pub(super) rings: Vec<usize>,
    pub(super) limbs: Vec<[usize; 2]>,
}

impl Tree {
    /// The tree of limbs `[parent, child]` between `n` markers; `None` where a limb has no two different ones.
    pub fn new(n: usize, limbs: &[[usize; 2]]) -> Option<Self> {
        if limbs.iter().any(|l| l[0] == l[1] || l.iter().any(|k| *k >= n)) {
            return None;
        }
        let (mut edges, mut used, mut seen) = (Vec::new(), vec![false; limbs.len()], vec![false; n]);
        for root in limbs.iter().map(|l| l[0]) {
            let mut front = if seen[root] { Vec::new() } else { vec![root] };
            seen[root] = true;
            while let Some(parent) = front.pop() {
                for (limb, &[a, b]) in limbs.iter().enumerate() {
                    let child = if a == parent { b } else { a };
                    if (a == parent || b == parent) && !used[limb] && !seen[child] {
                        (used[limb], seen[child]) = (true, true);
                        edges.push(Edge { child, parent, limb, turned: b == parent });
                        front.push(child);
                    }
                }
            }
        }
        edges.reverse();
        let rings = (0..limbs.len()).filter(|k| !used[*k]).collect();
        Some(Self { n, edges, rings, limbs: limbs.to_vec() })
    }

    /// The limbs.
    pub fn limbs(&self) -> &[[usize; 2]] {
        &self.limbs
    }
}

/// Up to two rows of a limb: weight · (u · (X_child − X_parent) − β)².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Rows {
    pub(super) u: Matrix3x2<f64>,
    pub(super) beta: Vector2<f64>,
    pub(super) weight: [f64; 2],
}

impl Rows {
    /// The weighted gram of both rows after a limb's child with the inverse `k`.
    fn stiffness(&self, k: &Matrix3<f64>) -> Matrix2<f64> {
        let h = self.u.transpose() * k * self.u;
        match self.weight {
            [0.0, 0.0] => Matrix2::zeros(),
            [w, 0.0] => Matrix2::new(1.0 / (1.0 / w + h.m11), 0.0, 0.0, 0.0),
            [0.0, w] => Matrix2::new(0.0, 0.0, 0.0, 1.0 / (1.0 / w + h.m22)),
            [v, w] => {
                let (a, b, d) = (1.0 / v + h.m11, h.m12, 1.0 / w + h.m22);
                Matrix2::new(d, -b, -b, a) / (a * d - b * b)
            }
        }
    }
}

/// A system of markers with blocks of their own and rows between them, taken apart.
#[derive(Clone, Debug)]
pub(super) struct Factor<'a> {
    tree: &'a Tree,
    /// Inverse of each marker's block, all that hangs on it included.
    inverse: Vec<Matrix3<f64>>,
    /// For each edge: rows, and what is left of them.
    rows: Vec<(Matrix3x2<f64>, Matrix2<f64>)>,
}

impl<'a> Factor<'a> {
    /// Of blocks, one for each marker, and the rows of each edge of the tree. `None` where a block has no inverse.
    pub(super) fn new(tree: &'a Tree, blocks: &[Matrix3<f64>], rows: &[Rows]) -> Option<Self> {
        let mut inverse = blocks.to_vec();
        let mut left = Vec::with_capacity(rows.len());
        for (edge, rows) in tree.edges.iter().zip(rows) {
            let k = inverted(&inverse[edge.child])?;
            inverse[edge.child] = k;
            let s = rows.stiffness(&k);
            inverse[edge.parent] += rows.u * s * rows.u.transpose();
            left.push((rows.u, s));
        }
        let mut is_child = vec![false; tree.n];
        tree.edges.iter().for_each(|e| is_child[e.child] = true);
        for (m, _) in inverse.iter_mut().zip(&is_child).filter(|(_, c)| !**c) {
            *m = inverted(m)?;
        }
        Some(Self { tree, inverse, rows: left })
    }

    /// Solves in place: `x` comes as the right-hand side and goes as the markers; `beta` of each edge, none for zeros.
    pub(super) fn solve(&self, x: &mut [Vector3<f64>], beta: Option<&[Rows]>) {
        let beta = |e: usize| beta.map_or_else(Vector2::zeros, |rows| rows[e].beta);
        for (e, (edge, (u, s))) in self.tree.edges.iter().zip(&self.rows).enumerate() {
            let own = self.inverse[edge.child] * x[edge.child];
            x[edge.parent] += u * (s * (u.transpose() * own - beta(e)));
        }
        let mut is_done = vec![false; self.tree.n];
        for (e, (edge, (u, s))) in self.tree.edges.iter().zip(&self.rows).enumerate().rev() {
            if !std::mem::replace(&mut is_done[edge.parent], true) {
                x[edge.parent] = self.inverse[edge.parent] * x[edge.parent];
            }
            is_done[edge.child] = true;
            let own = self.inverse[edge.child] * x[edge.child];
            let pull = s * (beta(e) + u.transpose() * (x[edge.parent] - own));
            x[edge.child] = own + self.inverse[edge.child] * (u * pull);
        }
        for (marker, _) in is_done.iter().enumerate().filter(|(_, d)| !**d) {
            x[marker] = self.inverse[marker] * x[marker];
        }
    }

    /// The block of each marker in the inverse of the whole.
    pub(super) fn covariances(&self) -> Vec<Matrix3<f64>> {
        let mut all = self.inverse.clone();
        for (edge, (u, s)) in self.tree.edges.iter().zip(&self.rows).rev() {
            let k = self.inverse[edge.child];
            let pull = k * u * s;
            let carried = pull * u.transpose();
            all[edge.child] = k - pull * u.transpose() * k + carried * all[edge.parent] * carried.transpose();
        }
        all
    }
}

/// The inverse of a symmetric positive block.
fn inverted(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let inverse = m.try_inverse()?;
    let sound = m.trace() > 0.0 && inverse.iter().all(|v| v.is_finite()) && inverse.trace() * m.trace() < 1e15;
    sound.then_some(inverse)
}
