//! Large bodies are solved in blocks, on as many threads as there are: the same bits for any number of them, and whatever else a body has works as in a small one.

use std::sync::Arc;

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Blocks, Edges, ExplicitGroup, ExplicitGroups, ImplicitGroups, Inflation, ParticleStiffness, Particles, Plasticity};
use polpo_rapier::RapierWorld;
use polpo_rig::Rig;
use polpo_tests::{lattice, shaken, simulation, steps};
use rapier3d::prelude::ColliderBuilder;

use crate::determinism::{THREADS, hash_with, same_for_any_threads};

/// Five that fall onto a floor: a plain one, one of many stiffnesses whose pins break, one that flows, one of which a part is rigid and that is inflated, and a small one.
fn scene(app: &mut App, iterations: u32) {
    app.insert_resource(SolverSettings { iterations, ..default() });
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(ColliderBuilder::cuboid(50.0, 0.5, 50.0).translation(Vec3::NEG_Y * 0.5));
    let (rig, small) = (Arc::new(shaken(18)), Arc::new(lattice(0.1)));
    let place = |k: usize, rig: &Arc<Rig>| {
        let velocity = InitialVelocity { linear: Vec3::new(0.5, -3.0, 0.2), angular: Vec3::new(0.5, 1.0, -0.3 * k as f32) };
        (SoftBody::new(rig.clone()), Transform::from_xyz(4.0 * k as f32, 1.0, 0.0), velocity)
    };
    let count = rig.particles.len();
    let each: Vec<Stiffness> = (0..count).map(|i| Stiffness::damped(5.0 + (i % 30) as f32, 0.1 * (i % 2) as f32)).collect();
    let world = app.world_mut();
    world.spawn(place(0, &rig));
    let pins = Pins { list: vec![Pin::at(5, Vec3::new(4.0, 1.5, 0.0)).breaking_at(500.0), Pin::at(4000, Vec3::new(4.0, 2.0, 0.0))] };
    world.spawn((place(1, &rig), ParticleStiffness::new(each), pins));
    world.spawn((place(2, &rig), Plasticity { yield_strain: 0.01, ..default() }));
    let groups = ExplicitGroups { list: vec![ExplicitGroup::rigid((0..200).collect::<Vec<_>>())] };
    world.spawn((place(3, &rig), groups, Inflation::new(1.1)));
    world.spawn(place(4, &small));
}

/// What the children of the test below run.
#[test]
fn child() {
    if let Some(threads) = std::env::var(THREADS).ok().and_then(|n| n.parse().ok()) {
        let hashes = [1, 2].map(|iterations| {
            hash_with(threads, 12, |app| {
                scene(app, iterations);
                app.add_systems(FixedLast, |bodies: Query<(&Blocks, &ImplicitGroups)>| {
                    assert!(bodies.iter().count() == 4 && bodies.iter().all(|(blocks, _)| blocks.len() >= 4));
                    if bodies.iter().any(|(_, groups)| !groups.flow().is_empty()) {
                        println!("one flows");
                    }
                });
            })
        });
        println!("hashes={hashes:x?};");
    }
}

#[test]
fn the_same_bits_with_large_bodies() {
    same_for_any_threads("large_bodies::child", "one flows");
}

#[test]
fn only_large_bodies_are_cut_while_they_have_something_to_cut() {
    let mut app = simulation();
    let [small, large] = [17, 18].map(|n| app.world_mut().spawn(SoftBody::new(shaken(n))).id());
    steps(&mut app, 1);
    let blocks = |app: &App, body| app.world().get::<Blocks>(body).map_or(0, Blocks::len);
    assert!(!app.world().entity(small).contains::<Blocks>());
    let all = blocks(&app, large);
    assert!(all >= 4, "{all}");
    let changes: [(fn(&mut EntityWorldMut), bool); 6] = [
        (|body| _ = body.remove::<ShapeMatching>(), true),
        (|body| _ = body.remove::<(DistanceConstraints, Torsion)>(), false),
        (|body| _ = body.insert(ShapeMatching::default()), true),
        (|body| _ = body.insert(Torsion::default()), true),
        (|body| _ = body.insert(SoftBody::new(shaken(18))), true),
        (|body| _ = body.insert(SoftBody::new(shaken(17))), false),
    ];
    for (change, left) in changes {
        change(&mut app.world_mut().entity_mut(large));
        steps(&mut app, 2);
        assert_eq!(blocks(&app, large) >= 4, left);
    }
    assert!(!app.world().entity(large).contains::<Blocks>(), "it is small now");
}

/// The radius of gyration of a body [m].
fn size(app: &App, body: Entity) -> f32 {
    let p = app.world().get::<Particles>(body).unwrap();
    (p.position.iter().map(|x| x.length_squared()).sum::<f32>() / p.len() as f32).sqrt()
}

/// What is written to a large body while it goes on reaches its blocks: a rest shape, the lengths of edges, stiffness.
#[test]
fn blocks_follow_what_changes() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let body = app.world_mut().spawn(SoftBody::new(shaken(18))).remove::<Sleep>().id();
    steps(&mut app, 2);
    let rest = size(&app, body);
    let near = |app: &App, wanted: f32| {
        let grown = size(app, body) / rest;
        assert!((grown - wanted).abs() < 0.03, "{grown} times as large, not {wanted}");
    };
    near(&app, 1.0);
    app.world_mut().entity_mut(body).insert(Inflation::new(1.2));
    steps(&mut app, 90);
    near(&app, 1.2);
    app.world_mut().entity_mut(body).remove::<Inflation>();
    steps(&mut app, 90);
    near(&app, 1.0);
    app.world_mut().entity_mut(body).remove::<ShapeMatching>();
    steps(&mut app, 2);
    app.world_mut().get_mut::<Edges>(body).unwrap().rest_length.iter_mut().for_each(|l| *l *= 1.1);
    steps(&mut app, 90);
    near(&app, 1.1);
    // Nothing holds it any more: every particle keeps its speed.
    app.world_mut().entity_mut(body).remove::<Damping>().insert((DistanceConstraints::new(Stiffness::OFF), Torsion::new(Stiffness::OFF)));
    app.world_mut().get_mut::<Particles>(body).unwrap().velocity[7] = Vec3A::X;
    steps(&mut app, 2);
    assert!(app.world().get::<Particles>(body).unwrap().velocity[7].distance(Vec3A::X) < 1e-2);
}
