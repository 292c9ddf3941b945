//! Ten kilometres out computes like home.

use bevy::prelude::*;
use polpo::Particles;
use polpo::prelude::*;
use polpo_rapier::RapierWorld;
use polpo_tests::{lattice, simulation, steps};
use rapier3d::prelude::ColliderBuilder;

/// Positions relative to the body after a fall onto a floor.
fn land(at: Vec3) -> (Vec<Vec3>, f32) {
    let mut app = simulation();
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(ColliderBuilder::cuboid(5.0, 0.5, 5.0).translation(at - Vec3::Y * 0.5));
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_translation(at + Vec3::Y * 1.0))).id();
    steps(&mut app, 120);
    let particles = app.world().get::<Particles>(body).unwrap();
    let height = app.world().get::<Transform>(body).unwrap().translation.y - at.y;
    (particles.position.iter().map(|x| Vec3::from(*x)).collect(), height)
}

#[test]
fn a_body_lands_the_same_at_home_and_far_out() {
    let (home, height) = land(Vec3::ZERO);
    // Powers of two, so that the floor itself is not rounded.
    for at in [Vec3::new(8192.0, 0.0, 0.0), Vec3::new(-8192.0, 1024.0, 16384.0)] {
        let (far, far_height) = land(at);
        let worst = home.iter().zip(&far).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        // A float at 8192 m is 0.5 to 1 mm; the body is 0.3 m.
        assert!(worst < 3e-3, "{at}: {worst} m apart");
        assert!((far_height - height).abs() < 3e-3, "{at}: lies at {far_height} m, at home at {height} m");
    }
}
