//! Nothing touches an octopus in flight: its momentum stays, and its shape.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::Particles;
use polpo::prelude::*;
use polpo_scenes::octopus_asset;
use polpo_solver::{fit_rigid, momentum};
use polpo_tests::{simulation, steps};

fn octopus(app: &mut App, linear: Vec3, angular: Vec3, frequency: f32) -> Entity {
    app.insert_resource(Gravity(Vec3::ZERO));
    let (_, rig) = octopus_asset();
    app.world_mut()
        .spawn((
            SoftBody::new(rig),
            InitialVelocity { linear, angular },
            ShapeMatching::new(Stiffness::hertz(frequency)),
            DistanceConstraints::new(Stiffness::hertz(frequency)),
            Torsion::new(Stiffness::hertz(frequency)),
        ))
        .id()
}

#[test]
fn linear_momentum_is_exact_to_1e_5_of_its_scale() {
    let mut app = simulation();
    let body = octopus(&mut app, Vec3::new(3.0, 4.0, -1.0), Vec3::new(1.0, -2.0, 3.0), 8.0);
    // Off its shape, so that every constraint works.
    for (i, x) in app.world_mut().get_mut::<Particles>(body).unwrap().position.iter_mut().enumerate() {
        *x *= 1.0 + 0.1 * (i % 7) as f32;
    }
    let before = momentum(app.world().get::<Particles>(body).unwrap());
    steps(&mut app, 180);
    let after = momentum(app.world().get::<Particles>(body).unwrap());
    let drift = (after.linear - before.linear).length() / before.linear.length();
    assert!(drift < 1e-5, "{drift}");
}

/// Ten seconds of a soft, wobbling tumble, spin included.
#[test]
fn angular_momentum_is_exact_to_1e_4() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let body = octopus(&mut app, Vec3::ZERO, Vec3::new(1.0, -2.0, 3.0), 8.0);
    for (i, x) in app.world_mut().get_mut::<Particles>(body).unwrap().position.iter_mut().enumerate() {
        *x *= 1.0 + 0.02 * (i % 7) as f32;
    }
    let before = momentum(app.world().get::<Particles>(body).unwrap());
    steps(&mut app, 600);
    let after = momentum(app.world().get::<Particles>(body).unwrap());
    let drift = (after.angular - before.angular).length() / before.angular.length();
    println!("angular momentum drifted by {drift:.1e} in 10 s");
    assert!(drift < 1e-4, "{drift}");
}

/// At rest in its own shape, rigidly stiff, it tumbles for three seconds.
#[test]
fn a_tumbling_octopus_keeps_its_shape_to_1e_3_of_its_size() {
    let mut app = simulation();
    app.insert_resource(SolverSettings { substeps: 20, iterations: 1, ..default() });
    let spin = Vec3::new(0.6, 0.3, 0.2);
    let body = octopus(&mut app, Vec3::new(0.0, 2.0, 0.0), spin, f32::INFINITY);
    app.world_mut().entity_mut(body).remove::<Damping>();
    let size = size(app.world().get::<Particles>(body).unwrap());
    let (mut guess, mut worst) = (Quat::IDENTITY, 0.0f32);
    for _ in 0..180 {
        steps(&mut app, 1);
        let fit = fit_rigid(app.world().get::<Particles>(body).unwrap(), guess);
        guess = fit.rotation;
        worst = worst.max(fit.largest);
    }
    let turned = guess.angle_between(Quat::IDENTITY);
    assert!(turned > 0.5, "it has turned by {turned} rad");
    assert!(worst < 1e-3 * size, "{worst} m of {size} m");
}

fn size(particles: &Particles) -> f32 {
    let (low, high) = particles.position.iter().fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    (high - low).max_element()
}
