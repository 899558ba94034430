//! Several curves: lines of a mesh as a camera sees them, or of a drawing.

use pegbar_engine::Value;

/// Several curves of a picture. Those of a mesh also say where on its edges each point lies.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct Curves {
    /// Points of all curves, one curve after the other; pixels, origin at the top left corner of the format; NaN behind the camera.
    #[value(shape = "[n, 2]")]
    pub points: Vec<[f64; 2]>,
    /// Points of each curve; together n.
    #[value(shape = "[c]")]
    pub lengths: Vec<u32>,
    /// 1 for each curve whose last point joins its first, else 0.
    #[value(shape = "[c]")]
    pub closed: Vec<u8>,
    /// Number of each curve, the same over all frames of a stream.
    #[value(shape = "[c]")]
    pub ids: Vec<i64>,
    /// What each curve shows: 0 drawn, 1 silhouette, 2 border, 3 crease, 4 seam, 5 feature, 6 intersection.
    #[value(shape = "[c]")]
    pub kinds: Vec<u8>,
    /// 1 for each point that is seen, 0 where something hides it.
    #[value(shape = "[n]")]
    pub visible: Vec<u8>,
    /// The vertices of the mesh whose edge each point lies on, the same one twice at a vertex; none at all where there is no mesh.
    #[value(shape = "[n, 2]", optional)]
    pub edges: Vec<[u32; 2]>,
    /// Where on that edge: 0 at its first vertex, 1 at its second; none at all where there is no mesh.
    #[value(shape = "[n]", optional)]
    pub shares: Vec<f64>,
}

/// One curve of [`Curves`].
#[derive(Clone, Copy, Debug)]
pub struct CurveRef<'a> {
    /// Position of its first point among all.
    pub first: usize,
    /// Its points, pixels.
    pub points: &'a [[f64; 2]],
    /// Whether its last point joins its first.
    pub closed: bool,
    /// Its number.
    pub id: i64,
}

impl Curves {
    /// Its curves, one by one.
    pub fn iter(&self) -> impl Iterator<Item = CurveRef<'_>> {
        let mut first = 0;
        self.lengths.iter().zip(&self.closed).zip(&self.ids).map(move |((&n, &closed), &id)| {
            let curve = CurveRef { first, points: &self.points[first..first + n as usize], closed: closed != 0, id };
            first += n as usize;
            curve
        })
    }

    /// Adds a drawn curve, all of it seen, with the next number.
    pub fn push_drawn(&mut self, points: Vec<[f64; 2]>, closed: bool) {
        self.lengths.push(points.len() as u32);
        self.closed.push(u8::from(closed));
        self.ids.push(self.lengths.len() as i64);
        self.kinds.push(0);
        self.visible.extend(points.iter().map(|_| 1));
        self.points.extend(points);
    }

    /// Adds the curves of another value, as they are.
    pub fn append(&mut self, other: &Self) {
        self.points.extend(&other.points);
        self.lengths.extend(&other.lengths);
        self.closed.extend(&other.closed);
        self.ids.extend(&other.ids);
        self.kinds.extend(&other.kinds);
        self.visible.extend(&other.visible);
        self.edges.extend(&other.edges);
        self.shares.extend(&other.shares);
    }

    /// What keeps the parts from being curves.
    ///
    /// # Errors
    /// Where the numbers of points or of curves differ, or a kind is none.
    pub fn validate(&self) -> Result<(), String> {
        let (n, c) = (self.points.len(), self.lengths.len());
        let sum: u64 = self.lengths.iter().map(|l| u64::from(*l)).sum();
        if sum != n as u64 {
            return Err(format!("expected lengths that add up to {n} points, found {sum}"));
        }
        if [self.closed.len(), self.ids.len(), self.kinds.len()] != [c; 3] {
            let [a, b, k] = [self.closed.len(), self.ids.len(), self.kinds.len()];
            return Err(format!("expected closed, ids and kinds for each of {c} curves, found {a}, {b} and {k}"));
        }
        if self.visible.len() != n {
            return Err(format!("expected visible for each of {n} points, found {}", self.visible.len()));
        }
        let (edges, shares) = (self.edges.len(), self.shares.len());
        if edges != shares || (edges != 0 && edges != n) {
            return Err(format!("expected edges and shares for each of {n} points or none, found {edges} and {shares}"));
        }
        match self.kinds.iter().find(|k| **k > 6) {
            Some(kind) => Err(format!("expected kinds from 0 to 6, found {kind}")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_say_what_is_wrong_with_them() {
        let mut curves = Curves::default();
        curves.push_drawn(vec![[0.0; 2]; 3], true);
        curves.push_drawn(vec![[1.0; 2]; 2], false);
        assert_eq!(curves.validate(), Ok(()));
        assert_eq!(
            curves.iter().map(|c| (c.first, c.points.len(), c.closed, c.id)).collect::<Vec<_>>(),
            [(0, 3, true, 1), (3, 2, false, 2)]
        );
        let broken = |change: fn(&mut Curves)| {
            let mut own = curves.clone();
            change(&mut own);
            own.validate().unwrap_err()
        };
        assert_eq!(broken(|c| c.lengths[0] = 4), "expected lengths that add up to 5 points, found 6");
        assert_eq!(broken(|c| c.kinds[1] = 9), "expected kinds from 0 to 6, found 9");
        assert_eq!(broken(|c| c.shares = vec![0.0; 5]), "expected edges and shares for each of 5 points or none, found 0 and 5");
        assert_eq!(broken(|c| c.ids.clear()), "expected closed, ids and kinds for each of 2 curves, found 2, 0 and 2");
        assert_eq!(broken(|c| c.visible.clear()), "expected visible for each of 5 points, found 0");
    }
}
