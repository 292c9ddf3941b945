//! One pass over the blocks of a body: colour by colour, the blocks of a colour side by side.

use glam::{Quat, Vec3A};

use crate::blocks::{Block, Blocks};
use crate::{Particles, Shares, Sweep, Turning, match_shapes, solve_distances, solve_torsion};

/// Runs tasks that have nothing to do with each other: one after the other, or side by side on threads that the caller has.
pub trait Executor {
    /// Calls `work` once for every task, in any order.
    fn each<T: Send>(&self, tasks: &mut [T], work: impl Fn(&mut T) + Send + Sync);
}

/// One after the other, on the thread that calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InTurn;

impl Executor for InTurn {
    fn each<T: Send>(&self, tasks: &mut [T], work: impl Fn(&mut T) + Send + Sync) {
        tasks.iter_mut().for_each(work);
    }
}

/// What the constraints of a body share out; what is off costs nothing.
#[derive(Clone, Copy, Debug)]
pub struct Constraints<'a> {
    /// Of groups, see [`match_shapes`](crate::match_shapes()).
    pub shapes: Shares<'a>,
    /// Which members take a group's rotation.
    pub turning: Turning,
    /// Of edges that are too long, see [`solve_distances`](crate::solve_distances).
    pub tension: Shares<'a>,
    /// Of edges that are too short.
    pub compression: Shares<'a>,
    /// Of edges that are twisted, see [`solve_torsion`](crate::solve_torsion).
    pub torsion: Shares<'a>,
}

impl Constraints<'_> {
    fn are_off(&self) -> bool {
        self.shapes.are_off() && self.tension.are_off() && self.compression.are_off() && self.torsion.are_off()
    }
}

/// Into how many ranges a body's particles are divided where blocks give back what they have moved.
const RANGES: usize = 8;

/// Matches shapes, then solves distances, then torsion, block by block: those of one colour as tasks of `executor`, colour after colour, each from the result of those before (Gauss–Seidel).
///
/// A task copies the particles that its block touches, solves there by the kernels for whole bodies, and when all of a colour are done what they have moved is copied back, in tasks of their own. The result is the same to the bit
/// whatever the executor does with them, and however many threads it has.
///
/// # Panics
///
/// If the blocks are those of a body with more particles.
pub fn solve_blocks(blocks: &mut Blocks, particles: &mut Particles, constraints: &Constraints, sweep: Sweep, executor: &impl Executor) {
    if constraints.are_off() {
        return;
    }
    for shares in [constraints.shapes, constraints.tension, constraints.compression, constraints.torsion] {
        particles.ready_rigid_push(shares);
    }
    let weighed = blocks.weigh(particles);
    for color in 0..blocks.color_count() {
        let list = blocks.color_mut(color);
        let body = &*particles;
        executor.each(list, |block| block.solve(body, weighed, constraints, sweep));
        let list = &*list;
        executor.each(&mut ranges(particles), |range| list.iter().for_each(|block| block.give(range)));
    }
}

/// Starts the search for the rotations of all groups from those of the particles, as [`ImplicitGroups::forget_rotations`](crate::ImplicitGroups::forget_rotations) does. To be called once a step.
///
/// # Panics
///
/// If the blocks are those of a body with more particles.
pub fn forget_block_rotations(blocks: &mut Blocks, particles: &Particles, executor: &impl Executor) {
    executor.each(&mut blocks.list, |block| {
        let Block { particles: at, copies, groups, .. } = block;
        take(&mut copies.rotation, &particles.rotation, at);
        groups.forget_rotations(copies);
    });
}

impl Blocks {
    /// Whether masses, inertias or what is pinned have changed since the last pass.
    fn weigh(&mut self, p: &Particles) -> bool {
        let now = [&p.mass, &p.inverse_mass, &p.inertia, &p.inverse_inertia];
        if now.iter().zip(&self.masses).all(|(now, then)| same(now, then)) {
            return false;
        }
        for (then, now) in self.masses.iter_mut().zip(now) {
            then.clone_from(now);
        }
        true
    }
}

impl Block {
    /// Solves its groups and edges on copies of the `body`'s particles. `weighed`: whether their masses have changed.
    fn solve(&mut self, body: &Particles, weighed: bool, constraints: &Constraints, sweep: Sweep) {
        let Self { particles: at, copies, groups, edges, .. } = self;
        take(&mut copies.position, &body.position, at);
        take(&mut copies.velocity, &body.velocity, at);
        take(&mut copies.rotation, &body.rotation, at);
        take(&mut copies.angular_velocity, &body.angular_velocity, at);
        if weighed {
            take(&mut copies.mass, &body.mass, at);
            take(&mut copies.inverse_mass, &body.inverse_mass, at);
            take(&mut copies.inertia, &body.inertia, at);
            take(&mut copies.inverse_inertia, &body.inverse_inertia, at);
        }
        // These two are sums, so that what a block adds to them starts from zero.
        copies.rigid_push.clear();
        copies.reaction.clear();
        if !body.reaction.is_empty() {
            copies.reaction.resize(at.len(), Vec3A::ZERO);
        }
        let Constraints { shapes, turning, tension, compression, torsion } = *constraints;
        match_shapes(groups, copies, shapes, turning, sweep);
        solve_distances(edges, copies, tension, compression, sweep);
        solve_torsion(edges, copies, torsion, sweep);
    }

    /// Gives a range of the body's particles what it has moved them.
    fn give(&self, range: &mut Range) {
        let first = self.particles.partition_point(|&i| i < range.start);
        let end = range.start + range.position.len() as u32;
        let count = self.particles[first..].partition_point(|&i| i < end);
        let (at, copies) = (first..first + count, &self.copies);
        let of = |i: u32| (i - range.start) as usize;
        for k in at.clone() {
            let i = of(self.particles[k]);
            range.position[i] = copies.position[k];
            range.velocity[i] = copies.velocity[k];
            range.rotation[i] = copies.rotation[k];
            range.spin[i] = copies.angular_velocity[k];
        }
        if !range.rigid_push.is_empty() && !copies.rigid_push.is_empty() {
            for k in at.clone() {
                let push = &mut range.rigid_push[of(self.particles[k])];
                push[0] += copies.rigid_push[k][0];
                push[1] += copies.rigid_push[k][1];
            }
        }
        if !range.reaction.is_empty() {
            for k in at {
                range.reaction[of(self.particles[k])] += copies.reaction[k];
            }
        }
    }
}

/// Copies the items of `from` at `at`.
fn take<T: Copy>(to: &mut [T], from: &[T], at: &[u32]) {
    for (to, &i) in to.iter_mut().zip(at) {
        *to = from[i as usize];
    }
}

/// Whether the numbers are the same to the bit.
fn same(a: &[f32], b: &[f32]) -> bool {
    const RUN: usize = 64;
    // Whole runs without a way out can be compared in vector lanes.
    let all = |(a, b): (&[f32], &[f32])| a.iter().zip(b).fold(true, |same, (a, b)| same & (a.to_bits() == b.to_bits()));
    a.len() == b.len() && a.chunks(RUN).zip(b.chunks(RUN)).all(all)
}

/// What constraints change of a range of particles; the last two are empty if nobody wants to know.
struct Range<'a> {
    /// Which particle is the first.
    start: u32,
    position: &'a mut [Vec3A],
    velocity: &'a mut [Vec3A],
    rotation: &'a mut [Quat],
    spin: &'a mut [Vec3A],
    rigid_push: &'a mut [[Vec3A; 2]],
    reaction: &'a mut [Vec3A],
}

fn ranges(p: &mut Particles) -> [Range<'_>; RANGES] {
    let length = p.len().div_ceil(RANGES);
    let (mut position, mut velocity, mut rotation) = (&mut p.position[..], &mut p.velocity[..], &mut p.rotation[..]);
    let (mut spin, mut rigid_push, mut reaction) = (&mut p.angular_velocity[..], &mut p.rigid_push[..], &mut p.reaction[..]);
    core::array::from_fn(|k| Range {
        start: (k * length) as u32,
        position: cut(&mut position, length),
        velocity: cut(&mut velocity, length),
        rotation: cut(&mut rotation, length),
        spin: cut(&mut spin, length),
        rigid_push: cut(&mut rigid_push, length),
        reaction: cut(&mut reaction, length),
    })
}

/// Cuts the first `length` items off, or what there is.
fn cut<'a, T>(from: &mut &'a mut [T], length: usize) -> &'a mut [T] {
    let all = core::mem::take(from);
    let (first, rest) = all.split_at_mut(length.min(all.len()));
    *from = rest;
    first
}
