//! The two particles of a pair while it is solved, and what an impulse between them does.

use glam::{Quat, Vec3A};

use crate::Sides;
use crate::pairs::Pair;
use crate::shape_matching::turned;

/// Only from something heavier by this factor is a particle on a collider taken for immovable: lighter ones are thrown to and fro little, and then momentum need not go to the collider. In heaps of bodies alike it would make
/// the heap tremble.
const CRUSHING: f32 = 80.0;

/// Whether one of two masses may be taken to crush the other.
pub(crate) fn is_uneven(a: f32, b: f32) -> bool {
    crushes(a, b) || crushes(b, a)
}

fn crushes(mass: f32, other: f32) -> bool {
    mass > CRUSHING * other
}

/// A particle while a pair is solved, in the first body's coordinates.
pub(crate) struct End {
    x: Vec3A,
    v: Vec3A,
    pub(crate) q: Quat,
    spin: Vec3A,
    /// Inverse mass and inverse inertia.
    pub(crate) w: [f32; 2],
    inertia: f32,
}

impl End {
    /// `push` is where the pair presses it, `by` the mass \[kg\] of what does.
    fn new(sides: &Sides, k: usize, i: usize, push: Vec3A, by: f32) -> Self {
        let (p, origin, held) = sides.side(k);
        let free = if held { 0.0 } else { 1.0 };
        let crushed = crushes(by, p.mass[i]) && sides.is_supported(k, i, push);
        let yields = if held || crushed { 0.0 } else { 1.0 };
        Self {
            x: p.position[i] + origin,
            v: p.velocity[i] * free,
            q: p.rotation[i],
            spin: p.angular_velocity[i] * free,
            w: [p.inverse_mass[i] * yields, p.inverse_inertia[i] * yields],
            inertia: p.inertia[i],
        }
    }

    fn store(self, sides: &mut Sides, k: usize, i: usize) {
        let (p, origin, held) = sides.side_mut(k);
        if !held {
            p.position[i] = self.x - origin;
            p.velocity[i] = self.v;
            p.rotation[i] = self.q;
            p.angular_velocity[i] = self.spin;
        }
    }
}

/// Both ends, the point where they touch, and the angular momentum that moving them has added.
pub(crate) struct Ends {
    pub(crate) ends: [End; 2],
    pub(crate) point: Vec3A,
    /// How fast one moved past the other at first, squared.
    speed2: f32,
    added: Vec3A,
}

impl Ends {
    /// The two of a pair that touch along the normal at the point, from the first's centre.
    pub(crate) fn new(pair: &Pair, sides: &Sides, [normal, point]: [Vec3A; 2]) -> Self {
        let [i, j] = pair.particles.map(|i| i as usize);
        let mass = [sides.side(0).0.mass[i], sides.side(1).0.mass[j]];
        let ends = [End::new(sides, 0, i, -normal, mass[1]), End::new(sides, 1, j, normal, mass[0])];
        Self { point: ends[0].x + point, speed2: (ends[1].v - ends[0].v).length_squared(), ends, added: Vec3A::ZERO }
    }

    pub(crate) fn store(self, pair: &Pair, sides: &mut Sides) {
        for (k, end) in self.ends.into_iter().enumerate() {
            end.store(sides, k, pair.particles[k] as usize);
        }
    }

    pub(crate) fn arms(&self) -> [Vec3A; 2] {
        [self.point - self.ends[0].x, self.point - self.ends[1].x]
    }

    /// W along the unit vector `n`: how far apart an impulse of one moves the two at the point where they touch.
    pub(crate) fn yielding(&self, n: Vec3A) -> f32 {
        let arms = self.arms();
        (0..2).map(|k| self.ends[k].w[0] + self.ends[k].w[1] * arms[k].cross(n).length_squared()).sum()
    }

    /// The velocity of the second past the first where they touch \[m/s\].
    pub(crate) fn velocity(&self) -> Vec3A {
        let arms = self.arms();
        let [a, b] = &self.ends;
        b.v + b.spin.cross(arms[1]) - a.v - a.spin.cross(arms[0])
    }

    /// Moves and turns the second by `impulse` \[kg·m\] at the point, the first by the opposite, and gives it to their velocities; `rate` is 1/Δt.
    pub(crate) fn strike(&mut self, impulse: Vec3A, rate: f32) {
        let arms = self.arms();
        for (k, sign) in [(0, -1.0), (1, 1.0)] {
            let end = &mut self.ends[k];
            let angle = arms[k].cross(impulse * sign) * end.w[1];
            end.v += impulse * (sign * end.w[0] * rate);
            end.spin += angle * rate;
            end.q = turned(end.q, angle);
        }
        self.displace(impulse);
    }

    /// Moves the second by `way` \[m\] from the first, by their masses, and leaves the velocities alone.
    pub(crate) fn part(&mut self, way: Vec3A) {
        let sum = self.ends[0].w[0] + self.ends[1].w[0];
        if sum > 0.0 {
            self.displace(way / sum);
        }
    }

    fn displace(&mut self, impulse: Vec3A) {
        let [a, b] = &mut self.ends;
        self.added += impulse.cross(b.v - a.v);
        a.x -= impulse * a.w[0];
        b.x += impulse * b.w[0];
    }

    /// Takes the angular momentum back that moving has added: an impulse j across the line of centres D with D×j = −added, and equal spins for what is left along D.
    ///
    /// Of two centres almost in one place that impulse would be faster than they were, and nothing is taken back, unless their bodies are `leaving` each other, where it happens to many at once. These turn as one rigid body instead, spins included, which of all changes of velocity that do it is the one of least energy: with
    /// m = m₁m₂/(m₁ + m₂) and I = I₁ + I₂ the inertia is (mD² + I)·1 − m·DDᵀ, and its inverse (1 + m/I·DDᵀ)/(mD² + I).
    pub(crate) fn settle(&mut self, leaving: bool) {
        let added = self.added;
        let [a, b] = &mut self.ends;
        if a.w[0] == 0.0 || b.w[0] == 0.0 || added == Vec3A::ZERO {
            return;
        }
        let (sum, d) = (a.w[0] + b.w[0], b.x - a.x);
        let length2 = d.length_squared();
        let turn_freely = a.w[1] > 0.0 && b.w[1] > 0.0;
        let inertia = a.inertia + b.inertia;
        let mut impulse = d.cross(added) / length2;
        let mut turn = d * (-added.dot(d) / length2 / inertia);
        let brakes = impulse.length_squared() * sum * sum <= self.speed2;
        if !brakes {
            if !(leaving && turn_freely) {
                return;
            }
            let mass = 1.0 / sum;
            turn = -(added + d * (mass * d.dot(added) / inertia)) / (mass * length2 + inertia);
            impulse = turn.cross(d) * mass;
        }
        a.v -= impulse * a.w[0];
        b.v += impulse * b.w[0];
        if turn_freely {
            a.spin += turn;
            b.spin += turn;
        }
    }
}
