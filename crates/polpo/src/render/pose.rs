//! The particle transforms of a frame, and the box around the mesh they carry.

use std::sync::Arc;

use bevy::camera::primitives::Aabb;
use bevy::math::Vec3A;
use bevy::platform::time::Instant;
use bevy::prelude::*;
use polpo_rig::Rig;
use polpo_skinning::ParticleTransform;
use polpo_skinning::bounds::skinned_aabb;

use super::attach::Skin;
use super::parts::{SkinPart, SkinParts};
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

/// The middle of a rig's particles \[m\], in its own space: what skinning stores rest data relative to.
pub(super) fn middle(rig: &Rig) -> Vec3 {
    let mut positions = rig.particles.iter().map(|particle| particle.position);
    let first = positions.next().unwrap_or_default();
    let (min, max) = positions.fold((first, first), |(min, max), position| (min.min(position), max.max(position)));
    0.5 * min + 0.5 * max
}

/// This frame's particle transforms of a body with a [`Skin`], or with parts that have one.
#[derive(Component, Debug)]
pub struct SkinPose {
    rig: Arc<Rig>,
    /// Rest positions of the particles \[m\], relative to the [`middle`].
    rest: Vec<Vec3>,
    transforms: Vec<ParticleTransform>,
}

impl SkinPose {
    pub(super) fn new(rig: &Arc<Rig>) -> Self {
        let middle = middle(rig);
        let rest = rig.particles.iter().map(|particle| particle.position - middle).collect();
        Self { rig: rig.clone(), rest, transforms: Vec::new() }
    }

    pub(super) fn is_of(&self, rig: &Arc<Rig>) -> bool {
        Arc::ptr_eq(&self.rig, rig)
    }

    /// Into the space of the body's `Transform`, axes parallel to the world's; one a particle. Empty before the first frame.
    pub fn transforms(&self) -> &[ParticleTransform] {
        &self.transforms
    }

    /// Takes the particles as they are; stays as it is if they are not those of the rig.
    pub(super) fn take(&mut self, pose: &Pose) {
        let (Some(first), Some(radii)) = (self.rig.particles.first(), pose.particles.radii.first()) else {
            return;
        };
        if pose.particles.len() != self.rest.len() {
            return;
        }
        // The body's scale went into its particles when it was built; the rig's radii are positive.
        let scale = radii.x / first.radii.x;
        self.transforms.clear();
        self.transforms.extend(self.rest.iter().enumerate().map(|(i, &rest)| {
            let (position, rotation) = pose.particle(i);
            ParticleTransform::new(position.into(), rotation, scale, rest)
        }));
    }
}

/// What is posed: a body, and the mesh beside it if there is one.
type Posed<'a> = (&'a Particles, Option<&'a StepStart>, &'a mut SkinPose, Option<(&'a Skin, &'a mut Aabb)>);

/// Poses every body that is skinned and writes its `Aabb`, so that culling knows where the mesh is. A pose that is not finite keeps the last box.
pub(super) fn pose_skins(
    mut bodies: Query<Posed, (With<SoftBody>, Or<(With<Skin>, With<SkinParts>)>)>,
    time: Option<Res<Time<Fixed>>>,
    interpolate: Res<Interpolate>,
    mut stats: ResMut<SkinningStats>,
) {
    let started = Instant::now();
    let fraction = fraction(&interpolate, time.as_deref());
    stats.bodies = bodies.iter().len();
    for_each_body(
        &mut bodies,
        |(particles, ..)| COST * particles.len(),
        |(particles, start, mut pose, skin)| {
            pose.take(&Pose::between(particles, start, fraction));
            if let Some((skin, mut aabb)) = skin {
                bound(&mut aabb, skin, &pose);
            }
        },
    );
    stats.pose_time = started.elapsed();
}

/// The boxes of bodies' parts, after their poses.
pub(super) fn bound_parts(mut parts: Query<(&SkinPart, &Skin, &mut Aabb)>, poses: Query<&SkinPose>, mut stats: ResMut<SkinningStats>) {
    let started = Instant::now();
    for_each_body(
        &mut parts,
        |(_, skin, _)| COST * skin.binding().rest_particles().len(),
        |(part, skin, mut aabb)| {
            if let Ok(pose) = poses.get(part.body) {
                bound(&mut aabb, skin, pose);
            }
        },
    );
    stats.pose_time += started.elapsed();
}

fn bound(aabb: &mut Aabb, skin: &Skin, pose: &SkinPose) {
    if let Some(bounds) = skinned_aabb(skin.binding(), &pose.transforms) {
        *aabb = Aabb::from_min_max(bounds.min, bounds.max);
    }
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
