//! Calibrated edges solved all at once: the material's stiffness at every time step.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3A};

use crate::block_cholesky::BlockCholesky;
use crate::{CalibratedEdges, CalibrationError, Particles, quat_log};

/// The most iterations of Newton's method in a substep, the turn \[rad\], or strain, under which another would change nothing that counts, and the longest one.
const ITERATIONS: usize = 8;
const ENOUGH: f64 = 0.02;
const LONGEST: f64 = 0.7;

/// How many blocks of 3×3 the factors may have for each particle; a tree has 5.
const BLOCKS: usize = 200;

/// Solves all calibrated edges of a body together: one step of implicit Euler by Newton's method.
///
/// The end of the substep is where M·(x − x̃) = δt²·f(x), with x̃ what was predicted and f the edges' forces as [`solve_calibrated_edges`](crate::solve_calibrated_edges) has them. Each iteration solves
///
/// ```text
/// (M + δt²·Gᵀ·S·G + δt²·T/|d|·(1 − d·dᵀ/|d|²))·Δ = δt²·f(x) − M·(x − x̃)
/// ```
///
/// in `f64` and in blocks of position and rotation, with Gᵀ·S·G the material's stiffness at where the edges are and the last term that of a string under the tension T > 0: without it a light rope with
/// a heavy end would swing across from one iteration to the next. Pushed edges have none, so that the matrix stays positive definite whatever the strain, and iterations are shortened to 0.7 rad. They
/// end, after eight at the latest, when the last changed nothing beyond 0.02 rad or that strain, for what is left then is of second order in it.
///
/// The work is proportional to the number of edges on chains and trees. Edges that close loops are solved with the others and cost what the elimination fills in: little for a ring or a ladder, more than
/// it is worth for a lattice. Implicit Euler damps what swings faster than the substep, and nothing else changes with δt.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DirectEdges {
    /// The particles with edges, ascending; all below is in their order.
    members: Vec<u32>,
    pairs: Vec<[u32; 2]>,
    matrix: BlockCholesky,
    /// Where the members are in this iteration, and how far from where they were predicted: positions, then rotations.
    position: Vec<DVec3>,
    rotation: Vec<DQuat>,
    way: Vec<[DVec3; 2]>,
    right: Vec<DVec3>,
    /// The edges' strains where the substep began, if there is retardation.
    before: Vec<[DVec3; 2]>,
    /// The edges' tensions \[N\].
    tension: Vec<f64>,
    forces: Vec<Force>,
}

/// What an edge pulls with, at an iteration's state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Force {
    arm: [DVec3; 2],
    /// On the second end \[N\], and the moment on it besides arm × force \[N·m\].
    force: DVec3,
    moment: DVec3,
    /// In the world's axes \[N/m, N·m/rad\].
    stiffness: DMat3,
    bend_stiffness: DMat3,
}

impl DirectEdges {
    /// For `edges` of a body with `count` particles.
    ///
    /// # Errors
    ///
    /// If the edges close so many loops that the elimination would fill more than 200 blocks a particle.
    pub fn new(edges: &CalibratedEdges, count: usize) -> Result<Self, CalibrationError> {
        let mut rank = vec![u32::MAX; count];
        for &i in edges.pairs.iter().flatten() {
            rank[i as usize] = 0;
        }
        let mut members = Vec::new();
        for (i, rank) in rank.iter_mut().enumerate().filter(|(_, rank)| **rank == 0) {
            *rank = members.len() as u32;
            members.push(i as u32);
        }
        let n = members.len();
        let pairs: Vec<[u32; 2]> = edges.pairs.iter().map(|&[i, j]| [rank[i as usize], rank[j as usize]]).collect();
        let mut blocks: Vec<[u32; 2]> = (0..n as u32).map(|i| [2 * i, 2 * i + 1]).collect();
        for &[i, j] in &pairs {
            blocks.extend([[2 * i, 2 * j], [2 * i, 2 * j + 1], [2 * i + 1, 2 * j], [2 * i + 1, 2 * j + 1]]);
        }
        let matrix = BlockCholesky::within(2 * n, &blocks, BLOCKS * n).ok_or(CalibrationError::Loops { particles: n })?;
        Ok(Self {
            matrix,
            position: vec![DVec3::ZERO; n],
            rotation: vec![DQuat::IDENTITY; n],
            way: vec![[DVec3::ZERO; 2]; n],
            right: vec![DVec3::ZERO; 2 * n],
            before: vec![[DVec3::ZERO; 2]; pairs.len()],
            tension: vec![0.0; pairs.len()],
            forces: vec![Force::default(); pairs.len()],
            members,
            pairs,
        })
    }

    /// Moves the particles from where they were predicted to the end of the substep of `dt` \[s\]. `edges` are those it was made for. Returns the number of iterations.
    pub fn solve(&mut self, edges: &CalibratedEdges, particles: &mut Particles, dt: f32) -> usize {
        if self.pairs.len() != edges.pairs.len() || self.members.last().is_none_or(|&last| last as usize >= particles.len()) {
            return 0;
        }
        let lag = f64::from(edges.lag(1.0 / dt));
        let h = f64::from(dt);
        self.load(&particles.previous_position, &particles.previous_rotation);
        for e in 0..self.pairs.len() {
            let strain = self.strain(edges, e);
            self.before[e] = [strain.gamma, strain.phi];
            let stretch = strain.gap.dot(strain.axes.x_axis) - f64::from(edges.rest_gap[e].x);
            self.tension[e] = stretch / f64::from(edges.stretch_compliance[e].x);
        }
        self.load(&particles.position, &particles.rotation);
        self.way.fill([DVec3::ZERO; 2]);
        let mut iterations = 0;
        loop {
            iterations += 1;
            self.assemble(edges, particles, h, lag);
            self.matrix.solve(&mut self.right);
            let largest = self.largest(edges);
            let share = if largest > LONGEST { LONGEST / largest } else { 1.0 };
            self.advance(share);
            if largest < ENOUGH || iterations == ITERATIONS || !largest.is_finite() {
                self.react(particles, h, share);
                break;
            }
        }
        let rate = 1.0 / dt;
        for (k, &i) in self.members.iter().enumerate() {
            let i = i as usize;
            if particles.inverse_mass[i] > 0.0 {
                particles.displace(i, self.way[k][0].as_vec3a(), rate);
            }
            if particles.inverse_inertia[i] > 0.0 {
                let turned = (self.rotation[k].as_quat() * particles.rotation[i].inverse()).normalize();
                particles.angular_velocity[i] += quat_log(turned) * rate;
                particles.rotation[i] = self.rotation[k].as_quat().normalize();
            }
        }
        iterations
    }

    fn load(&mut self, position: &[Vec3A], rotation: &[Quat]) {
        for (k, &i) in self.members.iter().enumerate() {
            self.position[k] = position[i as usize].as_dvec3();
            self.rotation[k] = rotation[i as usize].as_dquat().normalize();
        }
    }

    /// The strains of an edge, and what they are measured in.
    fn strain(&self, edges: &CalibratedEdges, e: usize) -> Strain {
        let [i, j] = self.pairs[e].map(|k| k as usize);
        let qi = self.rotation[i];
        let qj = if qi.dot(self.rotation[j]) < 0.0 { -self.rotation[j] } else { self.rotation[j] };
        let axes = DMat3::from_quat((qi + qj).normalize() * edges.frame[e].as_dquat());
        let mut gap = self.position[j] - self.position[i];
        let mut arm = [DVec3::ZERO; 2];
        if let Some(contact) = edges.contact.get(e) {
            arm = [qi * contact[0].as_dvec3(), qj * contact[1].as_dvec3()];
            gap += arm[1] - arm[0];
        }
        arm[0] += gap * 0.5;
        arm[1] -= gap * 0.5;
        let gamma = axes.transpose() * gap - edges.rest_gap[e].as_dvec3();
        let phi = axes.transpose() * rotation_between(qi, qj);
        Strain { axes, gap, arm, gamma, phi }
    }

    /// The matrix and the right side at where the members are.
    fn assemble(&mut self, edges: &CalibratedEdges, particles: &Particles, h: f64, lag: f64) {
        let h2 = h * h;
        self.matrix.clear();
        let free = |k: u32, members: &[u32]| {
            let i = members[k as usize] as usize;
            [particles.inverse_mass[i] > 0.0, particles.inverse_inertia[i] > 0.0]
        };
        for (k, &i) in self.members.iter().enumerate() {
            let [moves, turns] = free(k as u32, &self.members);
            // What is pinned stays: a row of its own with nothing on the right.
            let mass = f64::from(if moves { particles.mass[i as usize] } else { 1.0 });
            let inertia = f64::from(if turns { particles.inertia[i as usize] } else { 1.0 });
            self.matrix.add(2 * k, 2 * k, DMat3::from_diagonal(DVec3::splat(mass)));
            self.matrix.add(2 * k + 1, 2 * k + 1, DMat3::from_diagonal(DVec3::splat(inertia)));
            self.right[2 * k] = self.way[k][0] * -mass;
            self.right[2 * k + 1] = self.way[k][1] * -inertia;
        }
        for e in 0..self.pairs.len() {
            let strain = self.strain(edges, e);
            let axes = strain.axes;
            let stretch = edges.stretch_compliance[e].as_dvec3().recip();
            let bend = edges.bend_compliance[e].as_dvec3().recip();
            let gamma = strain.gamma + (strain.gamma - self.before[e][0]) * lag;
            let phi = strain.phi + (strain.phi - self.before[e][1]) * lag;
            let turned = |stiffness: DVec3| axes * DMat3::from_diagonal(stiffness) * axes.transpose();
            let force = Force {
                arm: strain.arm,
                force: axes * (gamma * stretch) * -1.0,
                moment: axes * (phi * bend) * -1.0,
                stiffness: turned(stretch * (1.0 + lag)),
                bend_stiffness: turned(bend * (1.0 + lag)),
            };
            let ends = self.pairs[e];
            let string = string_stiffness(self.position[ends[1] as usize] - self.position[ends[0] as usize], self.tension[e]);
            // What the gap and the bend change with: the first end's and the second's way and turn.
            let g = [-DMat3::IDENTITY, cross(force.arm[0]), DMat3::IDENTITY, cross(-force.arm[1])];
            let free = [free(ends[0], &self.members), free(ends[1], &self.members)];
            let pulls = [
                -force.force,
                -force.arm[0].cross(force.force) - force.moment,
                force.force,
                force.arm[1].cross(force.force) + force.moment,
            ];
            for a in 0..4 {
                if !free[a / 2][a % 2] {
                    continue;
                }
                let node = |a: usize| 2 * ends[a / 2] as usize + a % 2;
                self.right[node(a)] += pulls[a] * h2;
                let left = g[a].transpose() * force.stiffness;
                for b in 0..=a {
                    if !free[b / 2][b % 2] {
                        continue;
                    }
                    let mut block = left * g[b];
                    let sign = if a / 2 == b / 2 { 1.0 } else { -1.0 };
                    match (a % 2, b % 2) {
                        (0, 0) => block += string * sign,
                        (1, 1) => block += force.bend_stiffness * sign,
                        _ => {}
                    }
                    self.matrix.add(node(a), node(b), block * h2);
                }
            }
            self.forces[e] = force;
        }
    }

    /// The largest turn of the iteration just solved, and change of a gap relative to its edge's length.
    fn largest(&self, edges: &CalibratedEdges) -> f64 {
        let mut largest = 0.0f64;
        for (e, ends) in self.pairs.iter().enumerate() {
            let [i, j] = ends.map(|k| k as usize);
            let [ti, tj] = [self.right[2 * i + 1], self.right[2 * j + 1]];
            let d = self.position[j] - self.position[i];
            let turn = (ti + tj) * 0.5;
            // Without the turn of the edge as a whole, which is no strain.
            let apart = self.right[2 * j] - self.right[2 * i] - turn.cross(d);
            let length2 = d.length_squared().max(edges.rest_gap[e].as_dvec3().length_squared());
            if length2 > 0.0 {
                largest = largest.max(apart.length_squared() / length2);
            }
            largest = largest.max(ti.length_squared()).max(tj.length_squared());
        }
        largest.sqrt()
    }

    /// Takes `share` of the iteration just solved, and what tension it came to.
    fn advance(&mut self, share: f64) {
        for k in 0..self.members.len() {
            let (way, turn) = (self.right[2 * k] * share, self.right[2 * k + 1] * share);
            self.position[k] += way;
            self.way[k][0] += way;
            if turn != DVec3::ZERO {
                let before = self.rotation[k];
                // The rotation of which `rotation_between` is the inverse; its length is capped by LONGEST.
                let t = turn * 0.25;
                let t2 = t.length_squared();
                let step = DQuat::from_xyzw(2.0 * t.x, 2.0 * t.y, 2.0 * t.z, 1.0 - t2) * (1.0 / (1.0 + t2));
                self.rotation[k] = (step * before).normalize();
                self.way[k][1] += turn;
            }
        }
        for (e, ends) in self.pairs.iter().enumerate() {
            let [i, j] = ends.map(|k| k as usize);
            let force = self.pull(e, share);
            let d = self.position[j] - self.position[i];
            let length = d.length();
            self.tension[e] = if length > 0.0 { -force.dot(d) / length } else { 0.0 };
        }
    }

    /// The force on the second end of edge `e` after `share` of the iteration, as far as it is linear.
    fn pull(&self, e: usize, share: f64) -> DVec3 {
        let [i, j] = self.pairs[e].map(|k| k as usize);
        let force = &self.forces[e];
        let change =
            self.right[2 * j] - self.right[2 * i] + self.right[2 * j + 1].cross(force.arm[1]) - self.right[2 * i + 1].cross(force.arm[0]);
        force.force - force.stiffness * change * share
    }

    /// Tells what the edges pulled at pinned particles with.
    fn react(&self, particles: &mut Particles, h: f64, share: f64) {
        if particles.reaction.is_empty() {
            return;
        }
        for (e, ends) in self.pairs.iter().enumerate() {
            let impulse = (self.pull(e, share) * h).as_vec3a();
            for (k, sign) in [(ends[0], -1.0), (ends[1], 1.0)] {
                let i = self.members[k as usize] as usize;
                if particles.inverse_mass[i] == 0.0
                    && let Some(reaction) = particles.reaction.get_mut(i)
                {
                    *reaction += impulse * sign;
                }
            }
        }
    }
}

/// The strains of an edge and what they are measured in.
struct Strain {
    axes: DMat3,
    gap: DVec3,
    arm: [DVec3; 2],
    gamma: DVec3,
    phi: DVec3,
}

/// T/|d|·(1 − d·dᵀ/|d|²), zero for a string that is slack or has no length.
fn string_stiffness(d: DVec3, tension: f64) -> DMat3 {
    let length2 = d.length_squared();
    if !(tension > 0.0 && length2 > 0.0) {
        return DMat3::ZERO;
    }
    let outer = DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    (DMat3::from_diagonal(DVec3::splat(length2)) - outer) * (tension / (length2 * length2.sqrt()))
}

/// 4·vec(p)/(1 + p_w) of p = b·a⁻¹: the rotation vector, to second order in its length.
fn rotation_between(a: DQuat, b: DQuat) -> DVec3 {
    let p = b * a.inverse();
    let p = if p.w < 0.0 { -p } else { p };
    DVec3::new(p.x, p.y, p.z) * (4.0 / (1.0 + p.w))
}

/// a× as a matrix.
fn cross(a: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, a.z, -a.y), DVec3::new(-a.z, 0.0, a.x), DVec3::new(a.y, -a.x, 0.0))
}
