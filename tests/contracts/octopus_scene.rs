//! The scene ends as it should: octopuses at rest on the ground, in shape, not in it.

use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::Particles;
use polpo_rapier::{RapierWorld, penetration};
use polpo_scenes::{OctopusScene, SimulationPlugins};
use polpo_solver::fit_rigid;

#[test]
fn octopuses_come_down_the_stairs_and_rest_on_the_surface() {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, SimulationPlugins, OctopusScene { count: 3, seed: 1 }))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Time::<Fixed>::from_hz(60.0));
    app.finish();
    // One of them rocks on the edge of a step for ten seconds: nothing brakes its rolling but friction.
    for _ in 0..900 {
        app.update();
    }
    let world = app.world_mut();
    let rapier = world.remove_resource::<RapierWorld>().unwrap();
    let mut bodies = world.query::<(&Particles, &Transform)>();
    assert_eq!(bodies.iter(world).count(), 3);
    let mut down = 0;
    for (particles, transform) in bodies.iter(world) {
        assert!(particles.is_finite());
        let mut radii: Vec<f32> = particles.radii.iter().map(|r| r.element_sum() / 3.0).collect();
        radii.sort_by(f32::total_cmp);
        let depth = penetration(particles, transform.translation, &rapier.bodies, &rapier.colliders);
        assert!(depth < 0.05 * radii[radii.len() / 2], "{depth} m deep");
        let speed = particles.velocity.iter().map(|v| v.length()).fold(0.0, f32::max);
        assert!(speed < 0.2, "{speed} m/s");
        // Down from at least 2.3 m, and in one piece, not inside out.
        assert!(transform.translation.y < 1.8, "{}", transform.translation);
        down += usize::from(transform.translation.y < 0.5 && transform.translation.x > 1.0);
        let fit = fit_rigid(particles, particles.rotation[0]);
        // An arm is 0.7 m long; folded over, its tip is that far from where it was.
        assert!(fit.largest < 0.8, "{} m from its shape", fit.largest);
    }
    assert!(down >= 1, "none came all the way down");
}
