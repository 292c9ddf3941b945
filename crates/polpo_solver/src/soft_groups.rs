//! Explicit groups that are not rigid: shape matching as of implicit groups, without loss of spin.

use glam::{DMat3, DVec3, Vec3A};

use crate::block_cholesky::invert;
use crate::rigid_groups::read;
use crate::{ExplicitGroups, Particles, Share, Shares, Sweep, Turning, match_shapes};

/// Matches every soft, closed group, one after the other.
///
/// A projection that moves members by Δx and their velocities by Δx/Δt keeps L about where they were, but loses Σ m·Δx×v, second order in the angle turned in a substep and always to the same side: a soft
/// wheel brakes itself, ω₀/√(1 + 2ω₀²Δt·t). So the group gets back what it lost, as the rigid turn δω = J⁻¹·δL. A group with pinned members does not: it has given that to the pins.
pub(crate) fn match_soft_groups(groups: &mut ExplicitGroups, particles: &mut Particles, sweep: Sweep) {
    groups.shares.clear();
    groups.shares.resize(groups.len(), Share::default());
    let mut sweep = sweep;
    for g in 0..groups.len() {
        if groups.open[g] > 0.0 || groups.bodies[g].acting {
            continue;
        }
        let share = groups.stiffness[g].share(sweep.dt);
        if share.is_off() {
            continue;
        }
        let (before, _) = turning(groups, particles, g);
        groups.shares[g] = share;
        match_shapes(&mut groups.shape, particles, Shares::Each(&groups.shares), Turning::AllMembers, sweep);
        groups.shares[g] = Share::default();
        // The first call of the substep has cleared what all groups remember.
        sweep.index = sweep.index.max(1);
        restore(groups, particles, g, before);
    }
}

fn restore(groups: &ExplicitGroups, particles: &mut Particles, g: usize, before: DVec3) {
    let members = groups.members(g);
    if members.iter().any(|&i| particles.inverse_mass[i as usize] == 0.0 || particles.inverse_inertia[i as usize] == 0.0) {
        return;
    }
    let (after, inertia) = turning(groups, particles, g);
    let omega = (invert(inertia) * (before - after)).as_vec3a();
    if omega.length_squared() > 0.0 {
        let (center, _) = center(groups, particles, g);
        let center = center.as_vec3a();
        for &i in members {
            let i = i as usize;
            particles.velocity[i] += omega.cross(particles.position[i] - center);
            particles.angular_velocity[i] += omega;
        }
    }
}

/// Centre of mass of group `g` and its velocity.
fn center(groups: &ExplicitGroups, particles: &Particles, g: usize) -> (DVec3, DVec3) {
    let (mut mass, mut center, mut velocity) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for &i in groups.members(g) {
        let m = f64::from(particles.mass[i as usize]);
        mass += m;
        center += particles.position[i as usize].as_dvec3() * m;
        velocity += particles.velocity[i as usize].as_dvec3() * m;
    }
    (center / mass, velocity / mass)
}

/// Angular momentum and inertia of group `g` about its centre, with the spin of all members, that of joints too: else a group of two joints could not take what is lost about the line through them.
fn turning(groups: &ExplicitGroups, particles: &Particles, g: usize) -> (DVec3, DMat3) {
    let (center, velocity) = center(groups, particles, g);
    let (mut angular, mut inertia) = (DVec3::ZERO, DMat3::ZERO);
    for &i in groups.members(g) {
        let i = i as usize;
        let m = f64::from(particles.mass[i]);
        let spin = f64::from(particles.inertia[i]);
        let r = particles.position[i].as_dvec3() - center;
        angular += r.cross(particles.velocity[i].as_dvec3() - velocity) * m + particles.angular_velocity[i].as_dvec3() * spin;
        inertia += DMat3::from_diagonal(DVec3::splat(m * r.length_squared() + spin));
        inertia -= DMat3::from_cols(r * (m * r.x), r * (m * r.y), r * (m * r.z));
    }
    (angular, inertia)
}

/// Reads a soft group as if it were rigid, for its motor.
pub(crate) fn read_soft(groups: &mut ExplicitGroups, particles: &Particles, g: usize) {
    for k in groups.row(g) {
        let i = groups.shape.members[k] as usize;
        let h = &mut groups.held[k];
        (h.mass, h.carried) = (particles.mass[i], !groups.shape.unoriented[i]);
    }
    groups.bodies[g].end.rotation = groups.shape.rotation[g].as_dquat();
    read(groups, particles, g, true);
    groups.bodies[g].changed = false;
}

/// Gives the members of a soft group the angular impulse `impulse` \[N·m·s\], as to a rigid body.
pub(crate) fn turn_soft(groups: &ExplicitGroups, particles: &mut Particles, g: usize, impulse: DVec3, dt: f64) {
    let body = &groups.bodies[g];
    let omega = (body.mobility(body.start.rotation) * impulse).as_vec3a();
    let center: Vec3A = body.start.center.as_vec3a();
    let dt = dt as f32;
    for &i in groups.members(g) {
        let i = i as usize;
        if particles.inverse_mass[i] > 0.0 {
            let dv = omega.cross(particles.previous_position[i] - center);
            particles.displace(i, dv * dt, 1.0 / dt);
        }
        if particles.inverse_inertia[i] > 0.0 && !groups.shape.unoriented[i] {
            particles.turn(i, omega * dt, 1.0 / dt);
        }
    }
}
