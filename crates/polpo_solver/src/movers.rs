//! Rigid bodies that soft ones push: what they are to the solver for the length of one step.

use glam::{Mat3A, Quat, Vec3A};

use crate::quat_exp;

/// A rigid body that moves through the substeps of one step as a proxy of the one that somebody else integrates: soft bodies give it impulses at once, and at the end of the step their sum is handed
/// over.
///
/// Places are differences from where the centre of mass was when the step began, so that a mover belongs to no body's origin and far from the world's costs no digits. The inertia stays that of the
/// step's start, as it does for who gets the sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidMover {
    /// Along the world's axes \[1/kg\]: 0 where its translation is locked.
    pub inverse_mass: Vec3A,
    /// About the centre of mass, world axes \[1/(kg·m²)\]: 0 where its rotation is locked.
    pub inverse_inertia: Mat3A,
    /// Of the centre of mass \[m/s\].
    pub velocity: Vec3A,
    /// \[rad/s\]
    pub angular_velocity: Vec3A,
    /// What accelerates it besides soft bodies and feet, gravity as a rule \[m/s²\].
    pub acceleration: Vec3A,
    /// The same for its spin \[rad/s²\].
    pub angular_acceleration: Vec3A,
    /// Whether an old overlap with a particle is undone by the particle alone, because something else decides where this body is (a joint).
    pub anchored: bool,
    /// How far the centre of mass had come, from the step's start to that of the substep \[m\].
    pub way: Vec3A,
    /// How far it had turned by then.
    pub rotation: Quat,
    /// The way in this substep so far \[m\].
    pub step: Vec3A,
    /// The turn in this substep so far \[rad\].
    pub angle: Vec3A,
    /// The same as a rotation.
    pub turn: Quat,
    /// The sum of what soft bodies gave it in this step \[N·s\].
    pub impulse: Vec3A,
    /// The same about the centre of mass \[N·m·s\].
    pub angular_impulse: Vec3A,
}

impl Default for RigidMover {
    /// One that nothing moves, at rest.
    fn default() -> Self {
        let zero = Vec3A::ZERO;
        Self {
            inverse_mass: zero,
            inverse_inertia: Mat3A::ZERO,
            velocity: zero,
            angular_velocity: zero,
            acceleration: zero,
            angular_acceleration: zero,
            anchored: false,
            way: zero,
            rotation: Quat::IDENTITY,
            step: zero,
            angle: zero,
            turn: Quat::IDENTITY,
            impulse: zero,
            angular_impulse: zero,
        }
    }
}

impl RigidMover {
    /// Begins a substep of `dt` \[s\]: the last one's way is booked, velocities take the accelerations, the proxy moves by them.
    pub fn begin(&mut self, dt: f32) {
        self.settle();
        self.velocity += self.acceleration * dt;
        self.angular_velocity += self.angular_acceleration * dt;
        self.step = self.velocity * dt;
        self.angle = self.angular_velocity * dt;
        self.turn = quat_exp(self.angle);
    }

    /// Books the way of the running substep, so that `way` and `rotation` tell where it is now.
    pub fn settle(&mut self) {
        self.way += self.step;
        self.rotation = (self.turn * self.rotation).normalize();
        self.step = Vec3A::ZERO;
        self.angle = Vec3A::ZERO;
        self.turn = Quat::IDENTITY;
    }

    /// Takes the impulse `j` \[N·s\] at `arm` \[m\] from where the centre of mass was when the substep of `dt` \[s\] began.
    ///
    /// That it is the place of then, and for particles too, is what keeps angular momentum to rounding: with velocities v' = v + Δv and places x' = x + Δt·v', Σ x'×mv' = Σ x×mv', which an impulse
    /// pair at a common point does not change.
    #[inline]
    pub fn push(&mut self, j: Vec3A, arm: Vec3A, dt: f32) {
        self.impulse += j;
        self.angular_impulse += arm.cross(j);
        self.feel(j, arm, dt);
    }

    /// The same for an impulse that is not handed over, because who gets the sum finds it by itself.
    #[inline]
    fn feel(&mut self, j: Vec3A, arm: Vec3A, dt: f32) {
        let dv = j * self.inverse_mass;
        self.velocity += dv;
        self.step += dv * dt;
        self.spin(self.inverse_inertia * arm.cross(j), dt);
    }

    /// Takes an angular impulse \[N·m·s\].
    #[inline]
    pub fn twist(&mut self, t: Vec3A, dt: f32) {
        self.angular_impulse += t;
        self.spin(self.inverse_inertia * t, dt);
    }

    #[inline]
    fn spin(&mut self, dw: Vec3A, dt: f32) {
        self.angular_velocity += dw;
        self.angle += dw * dt;
        self.turn = quat_exp(self.angle);
    }

    /// Moves without getting faster: by what the pseudo-impulse `j` \[kg·m\] at `arm` \[m\] gives.
    #[inline]
    pub fn shift(&mut self, j: Vec3A, arm: Vec3A) {
        self.step += j * self.inverse_mass;
        self.angle += self.inverse_inertia * arm.cross(j);
        self.turn = quat_exp(self.angle);
    }

    /// How much velocity along the unit vector `n` the unit impulse along it gives the point at `arm` \[1/kg\].
    #[inline]
    pub fn yielding(&self, n: Vec3A, arm: Vec3A) -> f32 {
        let lever = arm.cross(n);
        (n * self.inverse_mass).dot(n) + lever.dot(self.inverse_inertia * lever)
    }

    /// Velocity of the point at `arm` \[m/s\].
    #[inline]
    pub fn velocity_at(&self, arm: Vec3A) -> Vec3A {
        self.velocity + self.angular_velocity.cross(arm)
    }
}

/// A point at which a mover stands on something that does not give way. Whoever gets the impulses will hold the body there by itself; the proxy must know, or it would sink for the length of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// Index of the mover.
    pub mover: u32,
    /// From the centre of mass to the point \[m\], at the step's start.
    pub arm: Vec3A,
    /// Unit normal, out of what it stands on.
    pub normal: Vec3A,
    /// The gap \[m\] at the step's start; negative is an overlap, which is not undone.
    pub gap: f32,
    /// Velocity of what it stands on \[m/s\].
    pub velocity: Vec3A,
    /// The impulse of the running substep \[N·s\]; 0 at its start.
    pub impulse: f32,
}

/// The rigid bodies that soft bodies push in this step.
#[derive(Clone, Debug, Default)]
pub struct Movers {
    /// In an order that does not depend on the bodies that push them.
    pub list: Vec<RigidMover>,
    /// What they stand on.
    pub feet: Vec<Foot>,
}

impl Movers {
    /// Begins a substep of `dt` \[s\].
    pub fn begin(&mut self, dt: f32) {
        for mover in &mut self.list {
            mover.begin(dt);
        }
        for foot in &mut self.feet {
            foot.gap -= foot.normal.dot(foot.velocity) * dt;
            foot.impulse = 0.0;
        }
    }

    /// Sweeps over the feet: none sinks, by summed up impulses that only push. A foot of a mover that does not exist is skipped.
    ///
    /// Several sweeps, because four feet under one body disturb each other more than what stands on it disturbs them.
    pub fn stand(&mut self, dt: f32) {
        for _ in 0..4 {
            for foot in &mut self.feet {
                if let Some(mover) = self.list.get_mut(foot.mover as usize) {
                    stand(foot, mover, dt);
                }
            }
        }
    }
}

fn stand(foot: &mut Foot, mover: &mut RigidMover, dt: f32) {
    let arm = mover.rotation * foot.arm;
    let here = foot.gap + foot.normal.dot(mover.way + arm - foot.arm);
    let before = here + foot.normal.dot(foot.velocity) * dt;
    let gap = here + foot.normal.dot(mover.step + mover.turn * arm - arm);
    let yielding = mover.yielding(foot.normal, arm) * dt;
    if yielding > 0.0 {
        let impulse = (foot.impulse - (gap - before.min(0.0)) / yielding).max(0.0);
        mover.feel(foot.normal * (impulse - foot.impulse), arm, dt);
        foot.impulse = impulse;
    }
}
