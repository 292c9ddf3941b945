//! Bodies are spawned, given another rig, stripped of capabilities and despawned at any time, in any schedule.

use bevy::ecs::schedule::ScheduleLabel;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Edges, ImplicitGroups, Particles};
use polpo_tests::{lattice, simulation, steps};

#[test]
fn a_body_starts_where_its_transform_puts_it_and_falls() {
    let mut app = simulation();
    let place = Transform::from_xyz(1.0, 2.0, 3.0).with_rotation(Quat::from_rotation_y(1.0)).with_scale(Vec3::splat(2.0));
    let rig = lattice(0.1);
    let body = app.world_mut().spawn((SoftBody::new(rig.clone()), place)).id();
    // At once, before any step: the mesh's points are where the transform puts them.
    let transform = *app.world().get::<Transform>(body).unwrap();
    let particles = app.world().get::<Particles>(body).unwrap();
    assert_eq!((transform.rotation, transform.scale), (Quat::IDENTITY, Vec3::ONE));
    for (p, x) in rig.particles.iter().zip(&particles.position) {
        assert!(place.transform_point(p.position).distance(transform.translation + Vec3::from(*x)) < 1e-5);
    }
    let mass: f32 = rig.particles.iter().map(|p| p.mass).sum();
    assert!((particles.total_mass() - 8.0 * mass).abs() < 1e-4 * mass);
    steps(&mut app, 60);
    // Symplectic Euler falls ½g(t² + tΔt).
    let fallen = transform.translation.y - app.world().get::<Transform>(body).unwrap().translation.y;
    let dt = 1.0 / (60.0 * SolverSettings::default().substeps as f32);
    assert!((fallen - 0.5 * 9.81 * (1.0 + dt)).abs() < 1e-3, "{fallen}");
}

#[test]
fn bodies_may_be_despawned_and_rebuilt_between_any_two_steps() {
    let mut app = simulation();
    let bodies: Vec<Entity> =
        (0..5).map(|i| app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(i as f32, 0.0, 0.0))).id()).collect();
    steps(&mut app, 3);
    app.world_mut().despawn(bodies[1]);
    app.world_mut().entity_mut(bodies[3]).insert(SoftBody::new(lattice(0.2)));
    steps(&mut app, 3);
    let rebuilt = app.world().get::<Particles>(bodies[3]).unwrap();
    assert!((rebuilt.radii[0].x - 0.1).abs() < 1e-6);
    let groups = app.world().get::<ImplicitGroups>(bodies[3]).unwrap();
    assert!((0..groups.len()).flat_map(|g| groups.rest(g)).any(|r| r.length() > 0.15), "the groups are those of the new rig");
    assert!(app.world().get_entity(bodies[1]).is_err());
}

#[test]
fn capabilities_come_and_go_with_their_components() {
    let mut app = simulation();
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    steps(&mut app, 2);
    assert!(app.world().get::<ImplicitGroups>(body).is_some() && app.world().get::<Edges>(body).is_some());
    app.world_mut().entity_mut(body).remove::<(ShapeMatching, DistanceConstraints, Torsion)>();
    steps(&mut app, 2);
    assert!(app.world().get::<ImplicitGroups>(body).is_none() && app.world().get::<Edges>(body).is_none());
    app.world_mut().entity_mut(body).insert(Torsion::default());
    steps(&mut app, 2);
    assert!(app.world().get::<ImplicitGroups>(body).is_none() && app.world().get::<Edges>(body).is_some());
}

#[test]
fn the_step_runs_in_any_schedule() {
    #[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
    struct ByHand;
    let mut app = App::new();
    app.add_plugins(MinimalPlugins).init_schedule(ByHand).add_plugins(PolpoPlugin::new(ByHand));
    app.finish();
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    app.update();
    assert!(app.world().get::<Transform>(body).unwrap().translation.y.abs() < 1e-6, "nothing steps by itself");
    app.world_mut().resource_mut::<Time>().advance_by(std::time::Duration::from_millis(20));
    for _ in 0..10 {
        app.world_mut().run_schedule(ByHand);
    }
    let y = app.world().get::<Transform>(body).unwrap().translation.y;
    assert!((y + 0.5 * 9.81 * 0.04).abs() < 0.02, "{y}");
}

#[test]
fn moving_the_transform_moves_the_body() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    steps(&mut app, 2);
    app.world_mut().get_mut::<Transform>(body).unwrap().translation = Vec3::new(100.0, 0.0, 0.0);
    steps(&mut app, 10);
    let world = app.world();
    assert!(world.get::<Transform>(body).unwrap().translation.distance(Vec3::X * 100.0) < 1e-4);
    assert!(world.get::<Particles>(body).unwrap().velocity.iter().all(|v| v.length() < 1e-3));
}

#[test]
fn a_hand_lifts_an_octopus_by_one_particle() {
    let mut app = simulation();
    let (_, rig) = polpo_scenes::octopus_asset();
    let body = app.world_mut().spawn(SoftBody::new(rig)).id();
    let top = {
        let x = &app.world().get::<Particles>(body).unwrap().position;
        (0..x.len()).max_by(|&a, &b| x[a].y.total_cmp(&x[b].y)).unwrap()
    };
    let origin = app.world().get::<Transform>(body).unwrap().translation;
    let target = origin + Vec3::from(app.world().get::<Particles>(body).unwrap().position[top]) + Vec3::Y * 0.5;
    app.world_mut().entity_mut(body).insert(Grab { particle: top as u32, target, stiffness: Stiffness::hertz(30.0) });
    steps(&mut app, 240);
    // Held by its top in mid-air, it hangs below the hand instead of falling 78 m.
    let held =
        app.world().get::<Transform>(body).unwrap().translation + Vec3::from(app.world().get::<Particles>(body).unwrap().position[top]);
    assert!(held.distance(target) < 0.3, "{held} is not at {target}");
    app.world_mut().entity_mut(body).remove::<Grab>();
    steps(&mut app, 30);
    assert!(app.world().get::<Transform>(body).unwrap().translation.y < target.y - 1.0, "let go, it falls");
}
