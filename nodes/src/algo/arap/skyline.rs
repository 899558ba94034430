//! A sparse symmetric matrix, factored once and solved for many right-hand sides.
//!
//! Cholesky's method inside the envelope (George, Liu, Computer Solution of Large Sparse Positive Definite Systems, 1981, chapter 4) in the
//! order of Cuthill and McKee, reversed. Meshes of contours are long or small, so that the envelope is thin.

/// L and D of L D Lᵀ. Of a Laplacian, which knows nothing of where a mesh is, without the first row and column in order.
#[derive(Debug)]
pub(crate) struct Skyline {
    /// Row of each point; row 0 is not solved for.
    row: Vec<usize>,
    /// First column of each row's envelope, and where its values start.
    first: Vec<usize>,
    start: Vec<usize>,
    /// Rows of L left of the diagonal.
    lower: Vec<f64>,
    /// The inverse of D.
    inverse: Vec<f64>,
}

impl Skyline {
    /// Factors the Laplacian of `entries` (row, column, value; one triangle, repeated ones add up), with one point left where it is; `None` where
    /// not all points hang together.
    pub(crate) fn new(n: usize, entries: &[(u32, u32, f64)]) -> Option<Self> {
        let (row, parts) = order(n, entries);
        if parts == 1 { Self::with_rows(n, row, entries) } else { None }
    }

    /// Factors a matrix all of which is solved for; `None` where it is not positive definite.
    pub(crate) fn definite(n: usize, entries: &[(u32, u32, f64)]) -> Option<Self> {
        let row = order(n, entries).0.iter().map(|r| r + 1).collect();
        Self::with_rows(n + 1, row, entries)
    }

    fn with_rows(n: usize, row: Vec<usize>, entries: &[(u32, u32, f64)]) -> Option<Self> {
        let place = |&(i, j, _): &(u32, u32, f64)| {
            let (i, j) = (row[i as usize], row[j as usize]);
            (i.max(j), i.min(j))
        };
        let mut first: Vec<usize> = (0..n).collect();
        for (i, j) in entries.iter().map(place).filter(|&(_, j)| j > 0) {
            first[i] = first[i].min(j);
        }
        let mut start = Vec::with_capacity(n);
        let mut len = 0;
        for i in 0..n {
            start.push(len);
            len += i - first[i];
        }
        let mut made = Self { first, start, lower: vec![0.0; len], inverse: vec![0.0; n], row: Vec::new() };
        for entry in entries {
            match place(entry) {
                (_, 0) => {}
                (i, j) if i == j => made.inverse[i] += entry.2,
                (i, j) => made.lower[made.start[i] + j - made.first[i]] += entry.2,
            }
        }
        made.row = row;
        made.factor().then_some(made)
    }

    /// Row by row; false where a pivot is not positive.
    fn factor(&mut self) -> bool {
        let n = self.first.len();
        for i in 1..n {
            let (done, own) = self.lower.split_at_mut(self.start[i]);
            let own = &mut own[..i - self.first[i]];
            for j in self.first[i] + 1..i {
                let from = self.first[i].max(self.first[j]);
                let above = &done[self.start[j] + from - self.first[j]..][..j - from];
                let sum = inner(&own[from - self.first[i]..j - self.first[i]], above);
                own[j - self.first[i]] -= sum;
            }
            let mut pivot = self.inverse[i];
            for (v, inverse) in own.iter_mut().zip(&self.inverse[self.first[i]..i]) {
                let scaled = *v * inverse;
                pivot -= *v * scaled;
                *v = scaled;
            }
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            self.inverse[i] = 1.0 / pivot;
        }
        true
    }

    /// Solves for `width` right-hand sides at once, those of one point next to each other; the first point in order comes out as 0.
    pub(crate) fn solve(&self, sides: &mut [f64], width: usize) {
        if width == 0 {
            return;
        }
        let n = self.first.len();
        let mut x = vec![0.0; n * width];
        for (i, &r) in self.row.iter().enumerate().filter(|&(_, &r)| r > 0) {
            x[r * width..(r + 1) * width].copy_from_slice(&sides[i * width..(i + 1) * width]);
        }
        for i in 1..n {
            let (done, own) = x.split_at_mut(i * width);
            for (l, row) in self.values(i).iter().zip(done[self.first[i] * width..].chunks_exact(width)) {
                own[..width].iter_mut().zip(row).for_each(|(a, b)| *a -= l * b);
            }
        }
        for (i, row) in x.chunks_exact_mut(width).enumerate() {
            row.iter_mut().for_each(|v| *v *= self.inverse[i]);
        }
        for i in (1..n).rev() {
            let (rest, own) = x.split_at_mut(i * width);
            for (l, row) in self.values(i).iter().zip(rest[self.first[i] * width..].chunks_exact_mut(width)) {
                row.iter_mut().zip(&own[..width]).for_each(|(a, b)| *a -= l * b);
            }
        }
        for (i, &r) in self.row.iter().enumerate() {
            sides[i * width..(i + 1) * width].copy_from_slice(&x[r * width..(r + 1) * width]);
        }
    }

    fn values(&self, i: usize) -> &[f64] {
        &self.lower[self.start[i]..self.start[i] + i - self.first[i]]
    }
}

/// A sum of products in four fixed lanes.
fn inner(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (pa, pb) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = pa.remainder().iter().zip(pb.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in pa.zip(pb) {
        (0..4).for_each(|i| lanes[i] += x[i] * y[i]);
    }
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
}

/// The reverse of Cuthill and McKee's order, as the row of each point, and the number of parts that do not hang together.
fn order(n: usize, entries: &[(u32, u32, f64)]) -> (Vec<usize>, usize) {
    let mut near = vec![Vec::new(); n];
    for &(i, j, _) in entries.iter().filter(|e| e.0 != e.1) {
        near[i as usize].push(j);
        near[j as usize].push(i);
    }
    for list in &mut near {
        list.sort_unstable();
        list.dedup();
    }
    // A far end, found by two walks, makes the levels narrow.
    let end = |from: usize| levels(&near, from).last().copied().unwrap_or(from);
    let (mut sorted, mut parts) = (Vec::with_capacity(n), 0);
    let mut seen = vec![false; n];
    for from in 0..n {
        if !seen[from] {
            let part = levels(&near, end(end(from)));
            part.iter().for_each(|&v| seen[v] = true);
            sorted.extend(part);
            parts += 1;
        }
    }
    let mut row = vec![0; n];
    sorted.iter().rev().enumerate().for_each(|(r, &v)| row[v] = r);
    (row, parts)
}

/// Points by their distance in edges, those of few neighbours first.
fn levels(near: &[Vec<u32>], from: usize) -> Vec<usize> {
    let mut seen = vec![false; near.len()];
    let mut sorted = vec![from];
    if let Some(first) = seen.get_mut(from) {
        *first = true;
    }
    let mut at = 0;
    while at < sorted.len() {
        let mut next: Vec<usize> = near[sorted[at]].iter().map(|&v| v as usize).filter(|&v| !seen[v]).collect();
        next.sort_unstable_by_key(|&v| (near[v].len(), v));
        next.iter().for_each(|&v| seen[v] = true);
        sorted.extend(next);
        at += 1;
    }
    sorted
}
