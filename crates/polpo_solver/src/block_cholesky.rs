//! A sparse factorisation of symmetric matrices of 3×3 blocks: chains and trees without fill.

use glam::{DMat3, DVec3};

/// L·D·Lᵀ by blocks, for a positive definite matrix whose pattern stays the same.
///
/// Nodes are eliminated in the order of fewest neighbours (minimum degree, ties by index), which leaves a tree without fill-in, so that n joints of a tree cost O(n). In `f64`, because joints at mass
/// ratios of 1:10 and hinges, whose matrix is nearly singular, lose the six digits of `f32`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct BlockCholesky {
    /// Which node is eliminated when, and the inverse.
    order: Vec<u32>,
    rank: Vec<u32>,
    /// Per rank, where its column starts in `rows` and `lower`, and the end of the last.
    starts: Vec<u32>,
    /// The ranks, ascending and greater than the column's, in which the column has blocks.
    rows: Vec<u32>,
    lower: Vec<DMat3>,
    diagonal: Vec<DMat3>,
    right: Vec<DVec3>,
}

impl BlockCholesky {
    /// For `n` nodes of which the `pairs` have a block in common.
    pub(crate) fn new(n: usize, pairs: &[[u32; 2]]) -> Self {
        Self::within(n, pairs, usize::MAX).unwrap_or_default()
    }

    /// The same, or nothing if the elimination fills more than `most` blocks.
    pub(crate) fn within(n: usize, pairs: &[[u32; 2]], most: usize) -> Option<Self> {
        let mut near: Vec<Vec<u32>> = vec![Vec::new(); n];
        let link = |near: &mut Vec<Vec<u32>>, a: u32, b: u32| {
            for (a, b) in [(a, b), (b, a)] {
                if let Err(k) = near[a as usize].binary_search(&b) {
                    near[a as usize].insert(k, b);
                }
            }
        };
        for &[a, b] in pairs {
            if a != b {
                link(&mut near, a, b);
            }
        }
        let mut this = Self { rank: vec![0; n], starts: vec![0], ..Self::default() };
        let mut left: Vec<u32> = (0..n as u32).collect();
        let mut columns: Vec<Vec<u32>> = Vec::new();
        let mut filled = 0;
        while let Some(at) = (0..left.len()).min_by_key(|&k| (near[left[k] as usize].len(), left[k])) {
            let node = left.remove(at);
            let ring = core::mem::take(&mut near[node as usize]);
            filled += ring.len();
            if filled > most {
                return None;
            }
            for (k, &a) in ring.iter().enumerate() {
                near[a as usize].retain(|&b| b != node);
                for &b in &ring[..k] {
                    link(&mut near, a, b);
                }
            }
            this.rank[node as usize] = this.order.len() as u32;
            this.order.push(node);
            columns.push(ring);
        }
        for column in columns {
            let start = this.rows.len();
            this.rows.extend(column.iter().map(|&node| this.rank[node as usize]));
            this.rows[start..].sort_unstable();
            this.starts.push(this.rows.len() as u32);
        }
        this.lower = vec![DMat3::ZERO; this.rows.len()];
        this.diagonal = vec![DMat3::ZERO; n];
        this.right = vec![DVec3::ZERO; n];
        Some(this)
    }

    /// Sets the matrix to zero.
    pub(crate) fn clear(&mut self) {
        self.lower.fill(DMat3::ZERO);
        self.diagonal.fill(DMat3::ZERO);
    }

    /// Adds `block` in row `i`, column `j`, and its transpose in row `j`, column `i`. A pair outside the pattern is left out.
    pub(crate) fn add(&mut self, i: usize, j: usize, block: DMat3) {
        let (a, b) = (self.rank[i] as usize, self.rank[j] as usize);
        if a == b {
            self.diagonal[a] += block;
        } else if let Some(k) = self.find(a.max(b), a.min(b)) {
            self.lower[k] += if a > b { block } else { block.transpose() };
        }
    }

    /// Makes every diagonal block larger by `share` of its mean eigenvalue.
    pub(crate) fn regularise(&mut self, share: f64) {
        for d in &mut self.diagonal {
            let by = share / 3.0 * (d.x_axis.x + d.y_axis.y + d.z_axis.z);
            *d += DMat3::from_diagonal(DVec3::splat(by));
        }
    }

    /// Factorises in place and solves for `x`, given as the right side. The matrix is gone afterwards.
    pub(crate) fn solve(&mut self, x: &mut [DVec3]) {
        let n = self.order.len();
        for (r, &node) in self.right.iter_mut().zip(&self.order) {
            *r = x[node as usize];
        }
        for k in 0..n {
            let inverse = invert(self.diagonal[k]);
            self.diagonal[k] = inverse;
            let column = self.starts[k] as usize..self.starts[k + 1] as usize;
            for a in column.clone() {
                let factor = self.lower[a] * inverse;
                let row = self.rows[a] as usize;
                let y = self.right[k];
                self.right[row] -= factor * y;
                for b in column.start..=a {
                    let update = factor * self.lower[b].transpose();
                    let other = self.rows[b] as usize;
                    if other == row {
                        self.diagonal[row] -= update;
                    } else if let Some(target) = self.find(row, other) {
                        self.lower[target] -= update;
                    }
                }
            }
        }
        for k in (0..n).rev() {
            let mut y = self.right[k];
            for a in self.starts[k] as usize..self.starts[k + 1] as usize {
                y -= self.lower[a].transpose() * self.right[self.rows[a] as usize];
            }
            self.right[k] = self.diagonal[k] * y;
        }
        for (r, &node) in self.right.iter().zip(&self.order) {
            x[node as usize] = *r;
        }
    }

    fn find(&self, row: usize, column: usize) -> Option<usize> {
        let start = self.starts[column] as usize;
        self.rows[start..self.starts[column + 1] as usize].binary_search(&(row as u32)).ok().map(|k| start + k)
    }
}

/// The inverse, or zero where there is none: what cannot be moved takes no impulse.
pub(crate) fn invert(m: DMat3) -> DMat3 {
    let inverse = m.inverse();
    if inverse.is_finite() { inverse } else { DMat3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    /// Against the product with the matrix itself, for a chain, a tree and a ring with a chord.
    #[test]
    fn solves_what_it_was_given() {
        let mut random = Random(5);
        for (n, pairs, fill) in [
            (6, vec![[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]], 5),
            (7, vec![[0, 1], [0, 2], [0, 3], [3, 4], [3, 5], [5, 6]], 6),
            (6, vec![[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0], [1, 4]], 9),
        ] {
            let mut matrix = BlockCholesky::new(n, &pairs);
            assert!(matrix.rows.len() <= fill, "{} blocks", matrix.rows.len());
            let mut number = || f64::from(random.signed());
            let mut blocks: Vec<(usize, usize, DMat3)> = Vec::new();
            for i in 0..n {
                blocks.push((i, i, DMat3::from_diagonal(DVec3::new(9.0, 10.0, 11.0))));
            }
            for &[i, j] in &pairs {
                let b = DMat3::from_cols_array(&[(); 9].map(|()| number()));
                blocks.push((i as usize, j as usize, b));
            }
            let x: Vec<DVec3> = (0..n).map(|_| DVec3::new(number(), number(), number())).collect();
            let mut y = vec![DVec3::ZERO; n];
            for &(i, j, b) in &blocks {
                matrix.add(i, j, b);
                y[i] += b * x[j];
                if i != j {
                    y[j] += b.transpose() * x[i];
                }
            }
            matrix.solve(&mut y);
            for i in 0..n {
                assert!(y[i].distance(x[i]) < 1e-12, "{i}: {} against {}", y[i], x[i]);
            }
        }
    }
}
