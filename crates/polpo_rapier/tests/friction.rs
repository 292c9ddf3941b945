//! A particle may have a friction of its own.

use bevy::math::{Quat, Vec3};
use polpo_rapier::{ContactDetector, DetectionInput, Obstacles};
use polpo_solver::{Contacts, FreePositions, ParticleRest, Particles};
use rapier3d::prelude::{CoefficientCombineRule, ColliderBuilder, ColliderSet, RigidBodySet};

#[test]
fn a_contact_has_the_friction_of_its_particle() {
    let (bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
    let floor = ColliderBuilder::cuboid(9.0, 0.5, 9.0).translation(Vec3::Y * -0.5).friction(0.5);
    colliders.insert(floor.friction_combine_rule(CoefficientCombineRule::Multiply));
    let (mut obstacles, mut contacts) = (Obstacles::default(), Contacts::default());
    obstacles.gather(&bodies, &colliders, 0.01);
    let ball =
        |x: f32| ParticleRest { position: Vec3::new(x, 0.1, 0.0).into(), frame: Quat::IDENTITY, radii: Vec3::splat(0.1).into(), mass: 1.0 };
    let particles = Particles::new(&[ball(0.0), ball(1.0), ball(2.0)]).unwrap();
    for (frictions, expected) in [(&[0.2, 1.0][..], [0.1, 0.5, 0.4]), (&[], [0.4; 3])] {
        let input = DetectionInput {
            particles: &particles,
            origin: Vec3::ZERO,
            acceleration: Vec3::ZERO,
            dt: 0.01,
            friction: 0.8,
            frictions,
            memberships: u32::MAX,
            filter: u32::MAX,
        };
        ContactDetector::default().detect(&input, &obstacles, &colliders, &mut FreePositions::default(), &mut contacts);
        let found: Vec<f32> = contacts.list.iter().map(|contact| contact.friction).collect();
        assert_eq!(found, expected);
    }
}
