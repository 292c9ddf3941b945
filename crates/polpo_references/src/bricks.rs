//! A body in cubic finite elements with incompatible modes (Wilson 1973): the reference where no beam theory holds.

use glam::DVec3;

/// A body of cubes of side `size` \[m\] on a grid, clamped where x = 0.
pub(crate) struct Bricks {
    size: f64,
    counts: [usize; 3],
    corner: DVec3,
    elements: Vec<[usize; 8]>,
    /// Of one element, row by row.
    stiffness: Vec<f64>,
    diagonal: Vec<f64>,
    /// kg
    pub(crate) mass: Vec<f64>,
    free: Vec<bool>,
}

const CORNERS: [[f64; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
    [-1.0, 1.0, 1.0],
    [1.0, 1.0, 1.0],
];

impl Bricks {
    /// `has` tells by its middle whether an element is there; `corner` is the lowest of the grid.
    pub(crate) fn new(
        counts: [usize; 3],
        corner: DVec3,
        size: f64,
        has: impl Fn(DVec3) -> bool,
        young: f64,
        nu: f64,
        density: f64,
    ) -> Self {
        let nodes = (counts[0] + 1) * (counts[1] + 1) * (counts[2] + 1);
        let mut this = Self {
            size,
            counts,
            corner,
            elements: Vec::new(),
            stiffness: stiffness(size, young, nu),
            diagonal: vec![0.0; 3 * nodes],
            mass: vec![0.0; nodes],
            free: vec![false; nodes],
        };
        for z in 0..counts[2] {
            for y in 0..counts[1] {
                for x in 0..counts[0] {
                    if has(corner + (DVec3::new(x as f64, y as f64, z as f64) + 0.5) * size) {
                        let node = |k: usize| this.node([x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)]);
                        let element: [usize; 8] = core::array::from_fn(node);
                        for (k, &n) in element.iter().enumerate() {
                            this.mass[n] += density * size * size * size / 8.0;
                            this.free[n] = n % (counts[0] + 1) != 0;
                            for c in 0..3 {
                                this.diagonal[3 * n + c] += this.stiffness[(3 * k + c) * 25];
                            }
                        }
                        this.elements.push(element);
                    }
                }
            }
        }
        this
    }

    fn node(&self, at: [usize; 3]) -> usize {
        at[0] + (self.counts[0] + 1) * (at[1] + (self.counts[1] + 1) * at[2])
    }

    pub(crate) fn place(&self, node: usize) -> DVec3 {
        let (nx, ny) = (self.counts[0] + 1, self.counts[1] + 1);
        self.corner + DVec3::new((node % nx) as f64, (node / nx % ny) as f64, (node / nx / ny) as f64) * self.size
    }

    /// The area of the far face that each node stands for \[m²\].
    pub(crate) fn far_face(&self) -> Vec<f64> {
        let mut area = vec![0.0; self.mass.len()];
        for element in &self.elements {
            if element[1] % (self.counts[0] + 1) == self.counts[0] {
                for k in [1, 3, 5, 7] {
                    area[element[k]] += 0.25 * self.size * self.size;
                }
            }
        }
        area
    }

    fn times(&self, u: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; u.len()];
        for element in &self.elements {
            let mut local = [0.0; 24];
            for (k, &n) in element.iter().enumerate() {
                local[3 * k..3 * k + 3].copy_from_slice(&u[3 * n..3 * n + 3]);
            }
            for (k, &n) in element.iter().enumerate() {
                for c in 0..3 {
                    let row = &self.stiffness[(3 * k + c) * 24..][..24];
                    out[3 * n + c] += row.iter().zip(&local).map(|(a, b)| a * b).sum::<f64>();
                }
            }
        }
        self.clamp(&mut out);
        out
    }

    fn clamp(&self, v: &mut [f64]) {
        for (n, free) in self.free.iter().enumerate() {
            if !free {
                v[3 * n..3 * n + 3].fill(0.0);
            }
        }
    }

    /// How the nodes move under a force on each, by conjugate gradients from `guess`.
    pub(crate) fn respond(&self, force: impl Fn(usize) -> DVec3, guess: Vec<f64>) -> Vec<f64> {
        let mut f: Vec<f64> = (0..self.mass.len()).flat_map(|n| force(n).to_array()).collect();
        self.clamp(&mut f);
        let mut u = guess;
        u.resize(f.len(), 0.0);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let scaled = |r: &[f64]| r.iter().zip(&self.diagonal).map(|(r, d)| if *d > 0.0 { r / d } else { 0.0 }).collect::<Vec<_>>();
        let ku = self.times(&u);
        let mut r: Vec<f64> = f.iter().zip(&ku).map(|(f, k)| f - k).collect();
        let mut z = scaled(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let enough = 1e-12 * dot(&f, &scaled(&f));
        for _ in 0..20_000 {
            if rz <= enough {
                break;
            }
            let kp = self.times(&p);
            let alpha = rz / dot(&p, &kp);
            for k in 0..u.len() {
                u[k] += alpha * p[k];
                r[k] -= alpha * kp[k];
            }
            z = scaled(&r);
            let next = dot(&r, &z);
            for k in 0..p.len() {
                p[k] = z[k] + next / rz * p[k];
            }
            rz = next;
        }
        u
    }

    /// ω² of the lowest mode, by inverse iteration from a field.
    pub(crate) fn first_mode(&self, mut u: Vec<f64>) -> f64 {
        let mut omega2 = 0.0;
        for _ in 0..6 {
            let push: Vec<f64> = u.iter().enumerate().map(|(k, u)| u * self.mass[k / 3]).collect();
            let guess = u.iter().map(|u| if omega2 > 0.0 { u / omega2 } else { 0.0 }).collect();
            let next = self.respond(|n| DVec3::new(push[3 * n], push[3 * n + 1], push[3 * n + 2]), guess);
            let dot = |a: &[f64]| a.iter().zip(&push).map(|(a, b)| a * b).sum::<f64>();
            omega2 = dot(&u) / dot(&next);
            let largest = next.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            u = next.into_iter().map(|v| v / largest).collect();
        }
        omega2
    }

    /// The field at a place in the body.
    pub(crate) fn at(&self, u: &[f64], place: DVec3) -> DVec3 {
        let x = (place - self.corner) / self.size;
        let cell: [usize; 3] = core::array::from_fn(|k| (x[k].max(0.0) as usize).min(self.counts[k] - 1));
        let mut sum = DVec3::ZERO;
        for k in 0..8 {
            let bits = [k & 1, k >> 1 & 1, k >> 2];
            let weight: f64 = (0..3).map(|a| if bits[a] == 1 { x[a] - cell[a] as f64 } else { 1.0 - x[a] + cell[a] as f64 }).product();
            let n = self.node([cell[0] + bits[0], cell[1] + bits[1], cell[2] + bits[2]]);
            sum += DVec3::new(u[3 * n], u[3 * n + 1], u[3 * n + 2]) * weight;
        }
        sum
    }
}

/// The stiffness of a cube's 24 freedoms, its nine incompatible ones condensed.
fn stiffness(size: f64, young: f64, nu: f64) -> Vec<f64> {
    let (shear, lame) = (young / (2.0 * (1.0 + nu)), young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)));
    let mut full = vec![vec![0.0; 33]; 33];
    let g = 1.0 / 3f64.sqrt();
    for point in CORNERS.map(|c| c.map(|x| x * g)) {
        // Gradients of the eight shapes and of the three bubbles 1 − ξ².
        let mut gradient = [[0.0; 3]; 11];
        for (k, c) in CORNERS.iter().enumerate() {
            for a in 0..3 {
                let (b, d) = ((a + 1) % 3, (a + 2) % 3);
                gradient[k][a] = 0.25 * c[a] * (1.0 + c[b] * point[b]) * (1.0 + c[d] * point[d]) / size;
            }
        }
        for a in 0..3 {
            gradient[8 + a][a] = -4.0 * point[a] / size;
        }
        let weight = size * size * size / 8.0;
        for i in 0..11 {
            for j in 0..11 {
                let dot: f64 = (0..3).map(|a| gradient[i][a] * gradient[j][a]).sum();
                for a in 0..3 {
                    for b in 0..3 {
                        let mut k = lame * gradient[i][a] * gradient[j][b] + shear * gradient[i][b] * gradient[j][a];
                        if a == b {
                            k += shear * dot;
                        }
                        full[3 * i + a][3 * j + b] += k * weight;
                    }
                }
            }
        }
    }
    for pivot in (24..33).rev() {
        let row = full[pivot].clone();
        for line in full.iter_mut().take(pivot) {
            let factor = line[pivot] / row[pivot];
            line.iter_mut().zip(&row).for_each(|(a, b)| *a -= factor * b);
        }
    }
    (0..24).flat_map(|i| full[i][..24].to_vec()).collect()
}
