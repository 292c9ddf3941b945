//! The particle transforms of a frame, and the box around the mesh they carry.

use bevy::camera::primitives::Aabb;
use bevy::math::Vec3A;
use bevy::platform::time::Instant;
use bevy::prelude::*;
use polpo_rig::Rig;
use polpo_skinning::bounds::skinned_aabb;
use polpo_skinning::{Binding, ParticleTransform};

use super::attach::Skin;
use super::{Interpolate, SkinningStats};
use crate::particles::for_each_body;
use crate::{Particles, SoftBody, StepStart};

/// What a particle's transform costs, roughly \[ns\]: to decide whether threads pay.
const COST: usize = 30;

/// Particles at a moment between the start of the last step (0) and its end (1).
pub(super) struct Pose<'a> {
    particles: &'a Particles,
    start: Option<&'a StepStart>,
    fraction: f32,
}

impl<'a> Pose<'a> {
    /// At the end of the last step.
    pub(super) fn present(particles: &'a Particles) -> Self {
        Self { particles, start: None, fraction: 1.0 }
    }

    /// `fraction` of the way through the last step, 0 to 1. A start that does not fit the particles is left out.
    pub(super) fn between(particles: &'a Particles, start: Option<&'a StepStart>, fraction: f32) -> Self {
        let fits = |start: &&StepStart| start.position.len() == particles.len() && start.rotation.len() == particles.len();
        Self { particles, start: start.filter(fits), fraction }
    }

    /// Position \[m\], relative to the body's present origin, and rotation since rest of particle `i`.
    ///
    /// Rotations are blended linearly on the shorter arc and normalised: within a step they differ by little, and the angle is then off by less than θ³/100.
    pub(super) fn particle(&self, i: usize) -> (Vec3A, Quat) {
        let (position, rotation) = (self.particles.position[i], self.particles.rotation[i]);
        let Some(start) = self.start else {
            return (position, rotation);
        };
        let from = start.rotation[i];
        let to = if from.dot(rotation) < 0.0 { -rotation } else { rotation };
        let blended = from * (1.0 - self.fraction) + to * self.fraction;
        // Halfway between two rotations half a turn apart there is nothing to normalise.
        let rotation = if blended.length_squared() > 1e-6 { blended.normalize() } else { rotation };
        (start.position[i].lerp(position, self.fraction), rotation)
    }
}

/// How far through the last step the frame stands.
pub(super) fn fraction(interpolate: &Interpolate, time: Option<&Time<Fixed>>) -> f32 {
    match time {
        Some(time) if interpolate.0 => time.overstep_fraction().clamp(0.0, 1.0),
        _ => 1.0,
    }
}

/// Fills `transforms`, one a particle; leaves them as they are if the particles are not those of the binding.
pub(super) fn pose_particles(transforms: &mut Vec<ParticleTransform>, binding: &Binding, rig: &Rig, pose: &Pose) {
    let rest = binding.rest_particles();
    let (Some(first), Some(radii)) = (rig.particles.first(), pose.particles.radii.first()) else {
        return;
    };
    if pose.particles.len() != rest.len() {
        return;
    }
    // The body's scale went into its particles when it was built; the rig's radii are positive.
    let scale = radii.x / first.radii.x;
    transforms.clear();
    transforms.extend(rest.iter().enumerate().map(|(i, &rest)| {
        let (position, rotation) = pose.particle(i);
        ParticleTransform::new(position.into(), rotation, scale, rest)
    }));
}

/// Poses every skin and writes its `Aabb`, so that culling knows where the mesh is. A pose that is not finite keeps the last box.
pub(super) fn pose_skins(
    mut skins: Query<(&SoftBody, &Particles, Option<&StepStart>, &mut Skin, &mut Aabb)>,
    time: Option<Res<Time<Fixed>>>,
    interpolate: Res<Interpolate>,
    mut stats: ResMut<SkinningStats>,
) {
    let started = Instant::now();
    let fraction = fraction(&interpolate, time.as_deref());
    stats.bodies = skins.iter().len();
    for_each_body(
        &mut skins,
        |(_, particles, ..)| COST * particles.len(),
        |(body, particles, start, mut skin, mut aabb)| {
            let Skin { shared, transforms, .. } = &mut *skin;
            pose_particles(transforms, &shared.binding, &body.rig, &Pose::between(particles, start, fraction));
            if let Some(bounds) = skinned_aabb(&shared.binding, transforms) {
                *aabb = Aabb::from_min_max(bounds.min, bounds.max);
            }
        },
    );
    stats.pose_time = started.elapsed();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_particle() -> Particles {
        let rest = polpo_solver::ParticleRest { position: Vec3A::ZERO, frame: Quat::IDENTITY, radii: Vec3A::ONE, mass: 1.0 };
        Particles(polpo_solver::Particles::new(&[rest]).expect("a valid particle"))
    }

    #[test]
    fn poses_between_steps_take_the_shorter_arc() {
        let mut particles = one_particle();
        particles.0.position[0] = Vec3A::X;
        // A quarter turn about z, written the long way round.
        let half = core::f32::consts::FRAC_1_SQRT_2;
        particles.0.rotation[0] = -Quat::from_xyzw(0.0, 0.0, half, half);
        let start = StepStart { position: vec![Vec3A::ZERO], rotation: vec![Quat::IDENTITY], ..default() };
        let (position, rotation) = Pose::between(&particles, Some(&start), 0.5).particle(0);
        assert_eq!(position, Vec3A::X * 0.5);
        let eighth = rotation * Vec3::X;
        assert!((eighth - Vec3::new(half, half, 0.0)).length() < 1e-6, "{eighth}");
        assert_eq!(Pose::between(&particles, Some(&start), 0.0).particle(0).0, Vec3A::ZERO);
        assert_eq!(Pose::between(&particles, Some(&start), 1.0).particle(0).0, Vec3A::X);
    }

    #[test]
    fn a_start_of_another_body_is_left_out() {
        let mut particles = one_particle();
        particles.0.position[0] = Vec3A::X;
        let (position, _) = Pose::between(&particles, Some(&StepStart::default()), 0.5).particle(0);
        assert_eq!(position, Vec3A::X);
    }
}
