//! Calibrated edges solved all at once: the material's stiffness at every time step.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3A};

use crate::block_cholesky::BlockCholesky;
use crate::edge_strain::{EdgeStrain, rotation_by};
use crate::{CalibratedEdges, CalibrationError, Particles, quat_log};

/// The most iterations of Newton's method in a substep, and halvings of each.
const ITERATIONS: usize = 8;
const HALVINGS: usize = 6;

/// The turn \[rad\], or strain, of an iteration after which another would change nothing that counts, and the longest one.
const ENOUGH: f64 = 0.02;
const LONGEST: f64 = 0.7;

/// How many blocks of 3×3 the factors may have for each particle; a tree has 5.
const BLOCKS: usize = 200;

/// Solves all calibrated edges of a body together: one step of implicit Euler by Newton's method.
///
/// The end of the substep is where ½(x − x̃)ᵀ·M·(x − x̃) + δt²·U(x) is least, with x̃ what was predicted and U the edges' energy, whose forces [`solve_calibrated_edges`](crate::solve_calibrated_edges) has
/// too. With the strains C, their gradient G and stiffness S, each iteration solves
///
/// ```text
/// (M + δt²·Gᵀ·S·G + δt²·T/|d|·(1 − d·dᵀ/|d|²))·Δ = −δt²·Gᵀ·S·C − M·(x − x̃)
/// ```
///
/// in `f64`, in blocks of position and rotation. The last term on the left is the stiffness of a string under the tension T > 0 across it: without it a light rope with a heavy end would swing to the other
/// side from one iteration to the next. An edge that is pushed has none, so that the matrix is positive definite whatever the strain. Δ is shortened to 0.7 rad, and halved while it does not lead
/// downhill. After an iteration of less than 0.02 rad, or that strain, the next would be of second order in it, and none follows; nor after the eighth. If that is not lower than where the substep began, it is
/// done again from there, so that no prediction, however far out, leaves edges with more energy than they had and their particles brought in.
///
/// The work is proportional to the number of edges on chains and trees. Edges that close loops are solved with the others and cost what the elimination fills in: little for a ring or a ladder, more than
/// it is worth for a lattice. Implicit Euler damps what swings faster than the substep, and nothing else changes with δt.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DirectEdges {
    /// The particles with edges, ascending; all below is in their order.
    members: Vec<u32>,
    pairs: Vec<[u32; 2]>,
    /// What hangs together with each member, by the first of it.
    piece: Vec<u32>,
    matrix: BlockCholesky,
    /// Where the members are in this iteration, where it began, and where they were predicted.
    now: Vec<Place>,
    from: Vec<Place>,
    predicted: Vec<Place>,
    right: Vec<DVec3>,
    /// Ways and turns of the iteration.
    step: Vec<DVec3>,
    /// The edges' strains where the substep began.
    before: Vec<[DVec3; 2]>,
    /// The edges' tensions \[N\].
    tension: Vec<f64>,
    pulls: Vec<Pull>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Place {
    position: DVec3,
    rotation: DQuat,
}

/// The force on an edge's gap, and what it changes with, at an iteration's start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Pull {
    force: DVec3,
    stiffness: DMat3,
    gradient: [DMat3; 4],
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
        let mut piece: Vec<u32> = (0..n as u32).collect();
        for &[i, j] in &pairs {
            let (a, b) = (piece[i as usize], piece[j as usize]);
            if a != b {
                piece.iter_mut().filter(|p| **p == a.max(b)).for_each(|p| *p = a.min(b));
            }
        }
        let matrix = BlockCholesky::within(2 * n, &blocks, BLOCKS * n).ok_or(CalibrationError::Loops { particles: n })?;
        let place = Place::default();
        Ok(Self {
            matrix,
            now: vec![place; n],
            from: vec![place; n],
            predicted: vec![place; n],
            right: vec![DVec3::ZERO; 2 * n],
            step: vec![DVec3::ZERO; 2 * n],
            before: vec![[DVec3::ZERO; 2]; pairs.len()],
            tension: vec![0.0; pairs.len()],
            pulls: vec![Pull::default(); pairs.len()],
            members,
            pairs,
            piece,
        })
    }

    /// Moves the particles from where they were predicted to the end of the substep of `dt` \[s\]. `edges` are those it was made for, or nothing happens. Returns the number of iterations.
    pub fn solve(&mut self, edges: &CalibratedEdges, particles: &mut Particles, dt: f32) -> usize {
        if self.pairs.len() != edges.pairs.len() || self.members.last().is_none_or(|&last| last as usize >= particles.len()) {
            return 0;
        }
        let (h, lag) = (f64::from(dt), f64::from(edges.lag(1.0 / dt)));
        self.load(&particles.position, &particles.rotation);
        self.predicted.clone_from(&self.now);
        self.load(&particles.previous_position, &particles.previous_rotation);
        let mut least = self.inertia(particles);
        for e in 0..self.pairs.len() {
            let at = self.strain(edges, e);
            least += h * h * at.energy(edges, e);
            self.before[e] = at.strain;
            self.tension[e] = at.strain[0].x / f64::from(edges.stretch_compliance[e].x);
        }
        self.now.clone_from(&self.predicted);
        let (mut iterations, height) = self.descend(edges, particles, h, lag);
        if !(height <= least || self.assemble(edges, particles, h, lag) <= least) {
            // Lost among the folds of what was predicted.
            self.load(&particles.previous_position, &particles.previous_rotation);
            self.follow(particles);
            iterations += self.descend(edges, particles, h, lag).0;
        }
        self.store(particles, dt);
        iterations
    }

    /// Newton's method from where the members are. Returns the number of iterations, and how high the last began.
    fn descend(&mut self, edges: &CalibratedEdges, particles: &Particles, h: f64, lag: f64) -> (usize, f64) {
        let mut height = self.assemble(edges, particles, h, lag);
        for iteration in 1.. {
            self.step.clone_from(&self.right);
            self.matrix.solve(&mut self.step);
            self.from.clone_from(&self.now);
            let largest = self.largest(edges);
            let mut share = if largest > LONGEST { LONGEST / largest } else { 1.0 };
            self.advance(share);
            self.pull(share);
            if largest < ENOUGH || !largest.is_finite() {
                return (iteration, height);
            }
            let mut halvings = 0;
            let next = loop {
                let next = self.assemble(edges, particles, h, lag);
                if next <= height {
                    break next;
                }
                // Also if it is not a number.
                halvings += 1;
                share = if halvings > HALVINGS { 0.0 } else { 0.5 * share };
                self.advance(share);
                if share == 0.0 {
                    return (iteration, height);
                }
            };
            height = next;
            if iteration == ITERATIONS {
                break;
            }
        }
        (ITERATIONS, height)
    }

    fn load(&mut self, position: &[Vec3A], rotation: &[Quat]) {
        for (place, &i) in self.now.iter_mut().zip(&self.members) {
            *place = Place { position: position[i as usize].as_dvec3(), rotation: rotation[i as usize].as_dquat().normalize() };
        }
    }

    /// Takes what is pinned to where it was predicted, and what hangs together without being pinned anywhere to where its centre of mass was.
    fn follow(&mut self, particles: &Particles) {
        self.step.fill(DVec3::ZERO);
        // Per piece the sum of m·way, and in the second slot that of m; infinite if pinned.
        for (k, &i) in self.members.iter().enumerate() {
            let (i, piece) = (i as usize, 2 * self.piece[k] as usize);
            let mass = if particles.inverse_mass[i] > 0.0 { f64::from(particles.mass[i]) } else { f64::INFINITY };
            let way = self.predicted[k].position - self.now[k].position;
            self.step[piece] += way * f64::from(particles.mass[i]);
            self.step[piece + 1].x += mass;
        }
        for (k, &i) in self.members.iter().enumerate() {
            let (i, piece) = (i as usize, 2 * self.piece[k] as usize);
            self.now[k].position = if particles.inverse_mass[i] > 0.0 {
                self.now[k].position + self.step[piece] / self.step[piece + 1].x
            } else {
                self.predicted[k].position
            };
            if particles.inverse_inertia[i] == 0.0 {
                self.now[k].rotation = self.predicted[k].rotation;
            }
        }
    }

    fn strain(&self, edges: &CalibratedEdges, e: usize) -> EdgeStrain {
        let [i, j] = self.pairs[e].map(|k| self.now[k as usize]);
        EdgeStrain::new(edges, e, [i.position, j.position], [i.rotation, j.rotation])
    }

    /// How far member `k` is from where it was predicted: its way, and sin ½θ about the axis of its turn.
    fn moved(&self, k: usize) -> [DVec3; 2] {
        let (now, predicted) = (self.now[k], self.predicted[k]);
        let turned = now.rotation * predicted.rotation.inverse();
        [now.position - predicted.position, DVec3::new(turned.x, turned.y, turned.z) * turned.w.signum()]
    }

    /// ½(x − x̃)ᵀ·M·(x − x̃), with 4I·(1 − cos ½θ) for ½·I·θ²: its gradient 2I·sin ½θ has no branches.
    fn inertia(&self, particles: &Particles) -> f64 {
        let mut sum = 0.0;
        for (k, &i) in self.members.iter().enumerate() {
            let [way, half] = self.moved(k);
            let sin2 = half.length_squared();
            // 1 − cos without cancellation.
            let turned = 4.0 * sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt());
            sum += 0.5 * f64::from(particles.mass[i as usize]) * way.length_squared() + f64::from(particles.inertia[i as usize]) * turned;
        }
        sum
    }

    /// The matrix and the right side at where the members are. Returns what is to be made least there.
    fn assemble(&mut self, edges: &CalibratedEdges, particles: &Particles, h: f64, lag: f64) -> f64 {
        let h2 = h * h;
        let mut height = self.inertia(particles);
        self.matrix.clear();
        for (k, &i) in self.members.iter().enumerate() {
            let i = i as usize;
            // What is pinned stays: a row of its own with nothing on the right.
            let (moves, turns) = (particles.inverse_mass[i] > 0.0, particles.inverse_inertia[i] > 0.0);
            let mass = f64::from(if moves { particles.mass[i] } else { 1.0 });
            let inertia = f64::from(if turns { particles.inertia[i] } else { 1.0 });
            self.matrix.add(2 * k, 2 * k, DMat3::from_diagonal(DVec3::splat(mass)));
            self.matrix.add(2 * k + 1, 2 * k + 1, DMat3::from_diagonal(DVec3::splat(inertia)));
            let [way, half] = self.moved(k);
            self.right[2 * k] = way * -mass;
            self.right[2 * k + 1] = half * (-2.0 * inertia);
        }
        for e in 0..self.pairs.len() {
            height += h2 * self.assemble_edge(edges, particles, e, h2, lag);
        }
        height
    }

    /// Adds an edge. Returns its energy.
    fn assemble_edge(&mut self, edges: &CalibratedEdges, particles: &Particles, e: usize, h2: f64, lag: f64) -> f64 {
        let ends = self.pairs[e];
        let at = self.strain(edges, e);
        let stiffness = [edges.stretch_compliance[e], edges.bend_compliance[e]].map(|c| c.as_dvec3().recip());
        let [late_gamma, late_phi] = [0, 1].map(|m| at.strain[m] + (at.strain[m] - self.before[e][m]) * lag);
        let energy = |m: usize| {
            let change = at.strain[m] - self.before[e][m];
            0.5 * stiffness[m].dot(at.strain[m] * at.strain[m] + change * change * lag)
        };
        let turned = |stiffness: DVec3| at.axes * DMat3::from_diagonal(stiffness) * at.axes.transpose();
        let pull = Pull {
            force: -(at.axes * (late_gamma * stiffness[0])),
            stiffness: turned(stiffness[0] * (1.0 + lag)),
            gradient: at.gradient(),
        };
        let moment = at.axes * (late_phi * stiffness[1]) * -at.steep;
        let bend = turned(stiffness[1] * (at.steep * at.steep * (1.0 + lag)));
        let d = self.now[ends[1] as usize].position - self.now[ends[0] as usize].position;
        let string = string_stiffness(d, self.tension[e]);

        let free = ends.map(|k| {
            let i = self.members[k as usize] as usize;
            [particles.inverse_mass[i] > 0.0, particles.inverse_inertia[i] > 0.0]
        });
        let node = |a: usize| 2 * ends[a / 2] as usize + a % 2;
        for a in (0..4).filter(|a| free[a / 2][a % 2]) {
            let left = pull.gradient[a].transpose();
            let mut force = left * pull.force;
            if a % 2 == 1 {
                force += if a == 1 { -moment } else { moment };
            }
            self.right[node(a)] += force * h2;
            let left = left * pull.stiffness;
            for b in (0..=a).filter(|b| free[b / 2][b % 2]) {
                let mut block = left * pull.gradient[b];
                let sign = if a / 2 == b / 2 { 1.0 } else { -1.0 };
                match (a % 2, b % 2) {
                    (0, 0) => block += string * sign,
                    (1, 1) => block += bend * sign,
                    _ => {}
                }
                self.matrix.add(node(a), node(b), block * h2);
            }
        }
        self.pulls[e] = pull;
        energy(0) + energy(1)
    }

    /// The largest turn of the iteration just solved, and change of an edge's direction or length, relative to it.
    fn largest(&self, edges: &CalibratedEdges) -> f64 {
        let mut largest = 0.0f64;
        for (e, ends) in self.pairs.iter().enumerate() {
            let [i, j] = ends.map(|k| k as usize);
            let [turn_i, turn_j] = [self.step[2 * i + 1], self.step[2 * j + 1]];
            let d = self.now[j].position - self.now[i].position;
            // Without the turn of the edge as a whole, which is no strain.
            let apart = self.step[2 * j] - self.step[2 * i] - ((turn_i + turn_j) * 0.5).cross(d);
            let length2 = d.length_squared().max(edges.rest_gap[e].as_dvec3().length_squared());
            let strain2 = if length2 > 0.0 { apart.length_squared() / length2 } else { 0.0 };
            let turn2 = turn_i.length_squared().max(turn_j.length_squared());
            // A sum lets through what is not a number, where a maximum would not.
            largest = if strain2 + turn2 <= largest { largest } else { strain2.max(turn2) + 0.0 * (strain2 + turn2) };
        }
        largest.sqrt()
    }

    /// Takes `share` of the iteration just solved, from where it began.
    fn advance(&mut self, share: f64) {
        for (k, (now, from)) in self.now.iter_mut().zip(&self.from).enumerate() {
            now.position = from.position + self.step[2 * k] * share;
            let turn = self.step[2 * k + 1] * share;
            now.rotation = if turn == DVec3::ZERO { from.rotation } else { (rotation_by(turn) * from.rotation).normalize() };
        }
    }

    /// What the edges pull with after `share` of the iteration just solved, as far as it is linear: strains that are what is left of stiff edges would be rounding.
    fn pull(&mut self, share: f64) {
        for (e, (pull, ends)) in self.pulls.iter_mut().zip(&self.pairs).enumerate() {
            let [i, j] = ends.map(|k| k as usize);
            let steps = [self.step[2 * i], self.step[2 * i + 1], self.step[2 * j], self.step[2 * j + 1]];
            let change = pull.gradient.iter().zip(&steps).fold(DVec3::ZERO, |sum, (g, s)| sum + *g * *s);
            pull.force -= pull.stiffness * change * share;
            let d = self.now[j].position - self.now[i].position;
            let length = d.length();
            self.tension[e] = if length > 0.0 { -pull.force.dot(d) / length } else { 0.0 };
        }
    }

    /// Gives the particles what the members did, and pinned ones what the edges pulled at them with.
    fn store(&self, particles: &mut Particles, dt: f32) {
        let rate = 1.0 / dt;
        for (k, &i) in self.members.iter().enumerate() {
            let i = i as usize;
            if particles.inverse_mass[i] > 0.0 {
                particles.displace(i, (self.now[k].position - self.predicted[k].position).as_vec3a(), rate);
            }
            if particles.inverse_inertia[i] > 0.0 {
                let turned = self.now[k].rotation * self.predicted[k].rotation.inverse();
                particles.angular_velocity[i] += quat_log(turned.as_quat()) * rate;
                particles.rotation[i] = self.now[k].rotation.as_quat().normalize();
            }
        }
        if particles.reaction.is_empty() {
            return;
        }
        for (pull, ends) in self.pulls.iter().zip(&self.pairs) {
            let impulse = pull.force.as_vec3a() * dt;
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

/// T/|d|·(1 − d·dᵀ/|d|²), zero for a string that is slack or has no length.
fn string_stiffness(d: DVec3, tension: f64) -> DMat3 {
    let length2 = d.length_squared();
    if !(tension > 0.0 && length2 > 0.0) {
        return DMat3::ZERO;
    }
    let outer = DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    (DMat3::from_diagonal(DVec3::splat(length2)) - outer) * (tension / (length2 * length2.sqrt()))
}
