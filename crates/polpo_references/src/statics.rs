//! How edges of facets and their rings respond to small forces, exactly: what sweeps in ever shorter substeps tend to.

use glam::{DMat3, DQuat, DVec3};
use polpo_solver::{CalibratedEdges, Particles, Rings};

/// Translation and turn of a particle.
pub(crate) type Motion = [DVec3; 2];

/// The Cholesky factor of the stiffness of what is not pinned: six rows a particle, each from the first column that is not zero.
pub(crate) struct Stiff {
    rows: Vec<Vec<f64>>,
    first: Vec<usize>,
    count: usize,
    /// Particles in the order along x, which makes the matrix narrow.
    place: Vec<usize>,
}

impl Stiff {
    /// Of the first `count` particles; those behind are pinned.
    pub(crate) fn new(p: &Particles, edges: &CalibratedEdges, rings: &Rings, count: usize) -> Self {
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| p.rest_position[a].x.total_cmp(&p.rest_position[b].x));
        let mut place = vec![0; count];
        for (k, &i) in order.iter().enumerate() {
            place[i] = k;
        }
        let mut this = Self { rows: Vec::new(), first: vec![usize::MAX; 6 * count], count, place };
        let mut entries: Vec<(usize, usize, f64)> = Vec::new();
        let x = |i: u32| p.rest_position[i as usize].as_dvec3();
        for (e, &[i, j]) in edges.pairs.iter().enumerate() {
            let axes = DMat3::from_quat(DQuat::from_array(edges.frame[e].to_array().map(f64::from)).normalize());
            let diagonal = |c: glam::Vec3A| axes * DMat3::from_diagonal(c.as_dvec3().recip()) * axes.transpose();
            let (stretch, bend) = (diagonal(edges.stretch_compliance[e]), diagonal(edges.bend_compliance[e]));
            let [si, sj] = edges.contact.get(e).map_or([DVec3::ZERO; 2], |c| c.map(|c| c.as_dvec3()));
            let gap = x(j) + sj - x(i) - si;
            // How the strain of the gap changes with the places and turns: the frame turns by half of each.
            let by_turn = |s: DVec3, sign: f64| cross(s) * -sign + cross(gap) * 0.5;
            let gradient = [DMat3::IDENTITY * -1.0, by_turn(si, -1.0), DMat3::IDENTITY, by_turn(sj, 1.0)];
            for a in 0..4 {
                for b in 0..4 {
                    let mut block = gradient[a].transpose() * stretch * gradient[b];
                    if a % 2 == 1 && b % 2 == 1 {
                        block += bend * if a == b { 1.0 } else { -1.0 };
                    }
                    this.add(&mut entries, ([i, j][a / 2], a % 2), ([i, j][b / 2], b % 2), block);
                }
            }
        }
        for (r, &middle) in rings.middle.iter().enumerate() {
            let mut gradient = vec![(middle, DVec3::ZERO)];
            for at in rings.starts[r] as usize..rings.starts[r + 1] as usize {
                let j = rings.around[at];
                let pull = (x(j) - x(middle)).normalize() * f64::from(rings.weight[at][0]);
                gradient.push((j, pull));
                gradient[0].1 -= pull;
            }
            let stiffness = 1.0 / f64::from(rings.compliance[r]).max(1e-30);
            for &(i, a) in &gradient {
                for &(j, b) in &gradient {
                    let b = b * stiffness;
                    this.add(&mut entries, (i, 0), (j, 0), DMat3::from_cols(a * b.x, a * b.y, a * b.z));
                }
            }
        }
        this.rows = (0..6 * count).map(|i| vec![0.0; i + 1 - this.first[i].min(i)]).collect();
        this.first.iter_mut().enumerate().for_each(|(i, f)| *f = (*f).min(i));
        for (i, j, k) in entries {
            this.rows[i][j - this.first[i]] += k;
        }
        this.factorise();
        this
    }

    fn add(&mut self, entries: &mut Vec<(usize, usize, f64)>, (i, turn_i): (u32, usize), (j, turn_j): (u32, usize), block: DMat3) {
        let (i, j) = (i as usize, j as usize);
        if i >= self.count || j >= self.count {
            return;
        }
        for row in 0..3 {
            for column in 0..3 {
                let at = (6 * self.place[i] + 3 * turn_i + row, 6 * self.place[j] + 3 * turn_j + column);
                if at.1 <= at.0 {
                    self.first[at.0] = self.first[at.0].min(at.1);
                    entries.push((at.0, at.1, block.col(column)[row]));
                }
            }
        }
    }

    fn factorise(&mut self) {
        for i in 0..self.rows.len() {
            for j in self.first[i]..=i {
                let (done, rest) = self.rows.split_at_mut(i);
                let row = &mut rest[0];
                let from = self.first[i].max(self.first[j]);
                let part = |row: &[f64], first: usize| row[from - first..j - first].to_vec();
                let mine = part(row, self.first[i]);
                let other = if j < i { part(&done[j], self.first[j]) } else { mine.clone() };
                let dot: f64 = mine.iter().zip(&other).map(|(a, b)| a * b).sum();
                let at = j - self.first[i];
                let left = row[at] - dot;
                row[at] = if j < i { left / done[j][j - self.first[j]] } else { left.sqrt() };
            }
        }
    }

    /// How each particle moves under a force and a moment on each. NaN where the body is not held.
    pub(crate) fn respond(&self, loads: &[Motion]) -> Vec<Motion> {
        let n = self.rows.len();
        let mut x = vec![0.0; n];
        for (i, load) in loads.iter().enumerate() {
            for (k, v) in load.iter().flat_map(|v| v.to_array()).enumerate() {
                x[6 * self.place[i] + k] = v;
            }
        }
        for i in 0..n {
            let first = self.first[i];
            let dot: f64 = (first..i).map(|j| self.rows[i][j - first] * x[j]).sum();
            x[i] = (x[i] - dot) / self.rows[i][i - first];
        }
        for i in (0..n).rev() {
            let first = self.first[i];
            x[i] /= self.rows[i][i - first];
            for j in first..i {
                x[j] -= self.rows[i][j - first] * x[i];
            }
        }
        let motion = |i: usize| {
            let u = &x[6 * self.place[i]..][..6];
            [DVec3::new(u[0], u[1], u[2]), DVec3::new(u[3], u[4], u[5])]
        };
        (0..self.count).map(motion).collect()
    }
}

/// The matrix of a×.
fn cross(a: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, a.z, -a.y), DVec3::new(-a.z, 0.0, a.x), DVec3::new(a.y, -a.x, 0.0))
}
