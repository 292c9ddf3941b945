//! No centre goes through a wall, wherever within a step it is driven; and what goes round an edge is not held by it.

use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::prelude::*;
use polpo::{ExplicitGroup, ExplicitGroups, Particles};
use polpo_rapier::{LastLook, RapierWorld};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_scenes::{OctopusScene, SimulationPlugins, octopus_asset};
use polpo_solver::fit_rigid;
use polpo_tests::{lattice, simulation_at, steps};
use rapier3d::prelude::*;

/// Half of a room's inner side \[m\].
const HALF: f32 = 3.0;

fn rapier(app: &mut App) -> Mut<'_, RapierWorld> {
    app.world_mut().resource_mut::<RapierWorld>()
}

fn particles(app: &App, body: Entity) -> &Particles {
    app.world().get::<Particles>(body).unwrap()
}

/// Centres in the world.
fn centers(app: &App, body: Entity) -> impl Iterator<Item = Vec3> {
    let origin = app.world().get::<Transform>(body).unwrap().translation;
    particles(app, body).position.iter().map(move |&x| origin + Vec3::from(x))
}

fn looked(app: &App) -> LastLook {
    *app.world().resource::<LastLook>()
}

fn row(count: usize, radius: f32) -> Rig {
    let particle =
        |i| Particle { position: Vec3::X * (2.0 * radius * i as f32), frame: Quat::IDENTITY, radii: Vec3::splat(radius), mass: 1.0 };
    let edges = (1..count as u32).map(|i| [i - 1, i]).collect();
    Rig { mesh_hash: MeshHash(0), particles: (0..count).map(particle).collect(), edges, ..Rig::default() }
}

/// Plates of 10 cm, and a mesh that has no thickness.
fn rooms() -> [(&'static str, ColliderBuilder); 2] {
    let plates = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|normal| {
        let extents = Vec3::splat(HALF + 0.1) - normal.abs() * (HALF + 0.05);
        (Pose::from_translation(normal * (HALF + 0.05)), SharedShape::cuboid(extents.x, extents.y, extents.z))
    });
    let (points, triangles) = rapier3d::geometry::Cuboid::new(Vec3::splat(HALF)).to_trimesh();
    [("plates", ColliderBuilder::compound(plates.to_vec())), ("triangles", ColliderBuilder::trimesh(points, triangles).unwrap())]
}

/// Up to 6.7 m a step into a corner 3 m away: the first wall is foreseen, the second is met along it, the third along both.
#[test]
fn a_body_at_100_metres_a_second_stays_in_its_corner() {
    let (_, octopus) = octopus_asset();
    let bodies = [("ball", row(1, 0.1)), ("row", row(8, 0.1)), ("lattice", lattice(0.2)), ("octopus", (*octopus).clone())];
    let mut put_back = 0;
    for (name, room) in rooms() {
        for (kind, rig) in &bodies {
            for (rate, substeps) in [(15.0, 1), (15.0, 5), (60.0, 1), (60.0, 5)] {
                for held in [false, true] {
                    let mut app = simulation_at(rate);
                    app.insert_resource(SolverSettings { substeps, iterations: 1, ..default() });
                    rapier(&mut app).insert_fixed(room.clone());
                    let velocity = InitialVelocity { linear: Vec3::new(0.6, -0.48, 0.64) * 100.0, angular: Vec3::new(3.0, 5.0, 1.0) };
                    let body = app.world_mut().spawn((SoftBody::new(rig.clone()), velocity)).id();
                    if held {
                        let all = (0..rig.particles.len() as u32).collect::<Vec<_>>();
                        app.world_mut().entity_mut(body).insert(ExplicitGroups { list: vec![ExplicitGroup::rigid(all)] });
                    }
                    let (mut out, mut bent) = (f32::NEG_INFINITY, 0.0f32);
                    for _ in 0..40 {
                        steps(&mut app, 1);
                        put_back += looked(&app).put_back;
                        out = centers(&app, body).map(|x| x.abs().max_element() - HALF).fold(out, f32::max);
                        let p = particles(&app, body);
                        assert!(p.is_finite());
                        if held {
                            bent = bent.max(fit_rigid(p, p.rotation[0]).largest);
                        }
                    }
                    assert!(out < 0.0, "{name}, {kind}, {rate} Hz × {substeps}, held {held}: {out} m out of the room");
                    println!("{name} {kind} {rate} {substeps} {held} bent {bent}");
                }
            }
        }
    }
    println!("{put_back} put back");
    assert!(put_back > 0, "the rooms put nobody to the test");
}

/// Over an edge a body goes its own way: nobody is put back.
#[test]
fn what_goes_round_an_edge_is_not_held_by_it() {
    let (points, triangles) = rapier3d::geometry::Cuboid::new(Vec3::splat(2.0)).to_trimesh();
    let boxes = [("box", ColliderBuilder::cuboid(2.0, 2.0, 2.0)), ("mesh", ColliderBuilder::trimesh(points, triangles).unwrap())];
    let (_, octopus) = octopus_asset();
    let bodies = [("ball", row(1, 0.1)), ("row", row(12, 0.1)), ("octopus", (*octopus).clone())];
    for (name, obstacle) in boxes {
        for (kind, rig) in &bodies {
            for speed in [1.0, 4.0, 40.0] {
                for (rate, substeps) in [(15.0, 1), (60.0, 5)] {
                    let mut app = simulation_at(rate);
                    app.insert_resource(SolverSettings { substeps, iterations: 1, ..default() });
                    rapier(&mut app).insert_fixed(obstacle.clone().translation(Vec3::Y * -2.0).friction(0.0));
                    let place = Transform::from_xyz(0.6, 0.5, 0.0).with_rotation(Quat::from_rotation_y(0.7));
                    let velocity = InitialVelocity { linear: Vec3::new(speed, -1.0, 0.0), angular: Vec3::Z * -2.0 };
                    let slippery = Collision { friction: 0.0, ..default() };
                    let body = app.world_mut().spawn((SoftBody::new(rig.clone()), velocity, place, slippery)).id();
                    let mut put_back = 0;
                    for _ in 0..2 * rate as usize {
                        steps(&mut app, 1);
                        put_back += looked(&app).put_back;
                    }
                    let x = app.world().get::<Transform>(body).unwrap().translation.x;
                    assert_eq!(put_back, 0, "{name}, {kind}, {speed} m/s, {rate} Hz × {substeps}");
                    assert!(x > 0.5 + 2.0 * speed, "{name}, {kind}, {speed} m/s, {rate} Hz × {substeps}: at {x}");
                }
            }
        }
    }
}

/// What moves bodies in the ordinary way is not interfered with, however fast.
#[test]
fn what_colliders_carry_and_push_is_not_put_back() {
    let drives = [
        ("lift", Vec3::Y * 8.0, Vec3::ZERO),
        ("belt", Vec3::X * 20.0, Vec3::ZERO),
        ("turntable", Vec3::ZERO, Vec3::Y * 6.0),
        ("paddle", Vec3::ZERO, Vec3::Z * 9.0),
    ];
    for (name, linear, angular) in drives {
        for (kind, rig) in [("ball", row(1, 0.1)), ("lattice", lattice(0.2))] {
            for (rate, substeps) in [(15.0, 5), (60.0, 1), (60.0, 5)] {
                let mut app = simulation_at(rate);
                app.insert_resource(SolverSettings { substeps, iterations: 1, ..default() });
                let mut world = rapier(&mut app);
                let world = &mut *world;
                let driven = world.bodies.insert(RigidBodyBuilder::kinematic_velocity_based().linvel(linear).angvel(angular));
                world.colliders.insert_with_parent(ColliderBuilder::cuboid(4.0, 0.05, 4.0), driven, &mut world.bodies);
                app.world_mut().spawn((SoftBody::new(rig.clone()), Transform::from_xyz(1.0, 0.4, 0.3)));
                let mut put_back = 0;
                for _ in 0..rate as usize {
                    steps(&mut app, 1);
                    put_back += looked(&app).put_back;
                }
                assert_eq!(put_back, 0, "{name}, {kind}, {rate} Hz × {substeps}");
            }
        }
    }
}

/// A plate that goes round in a closed room five times a second, with the body in the way: 25 m/s at its rim.
#[test]
fn what_a_paddle_hits_stays_in_the_room() {
    for (name, room) in rooms() {
        for (kind, rig) in [("ball", row(1, 0.1)), ("lattice", lattice(0.2))] {
            for (rate, substeps) in [(60.0, 1), (60.0, 5), (240.0, 5)] {
                let mut app = simulation_at(rate);
                app.insert_resource(SolverSettings { substeps, iterations: 1, ..default() });
                let mut world = rapier(&mut app);
                let world = &mut *world;
                world.insert_fixed(room.clone());
                let driven = world.bodies.insert(RigidBodyBuilder::kinematic_velocity_based().angvel(Vec3::Z * 31.4));
                world.colliders.insert_with_parent(ColliderBuilder::cuboid(0.8, 0.05, 1.0), driven, &mut world.bodies);
                let body = app.world_mut().spawn((SoftBody::new(rig.clone()), Transform::from_xyz(0.5, 1.2, 0.1))).id();
                let (mut out, mut back, mut fastest) = (f32::NEG_INFINITY, 0, 0.0f32);
                for _ in 0..3 * rate as usize {
                    steps(&mut app, 1);
                    back += looked(&app).put_back;
                    fastest = fastest.max(particles(&app, body).velocity.iter().map(|v| v.length()).fold(0.0, f32::max));
                    out = centers(&app, body).map(|x| x.abs().max_element() - HALF).fold(out, f32::max);
                }
                println!("paddle {name} {kind} {rate} {substeps} out {out} back {back} fastest {fastest}");
                assert!(out < 0.0, "{name}, {kind}, {rate} Hz × {substeps}: {out} m out of the room");
            }
        }
    }
}

/// What it costs where nothing goes wrong: of 4,500 ways of each octopus a second, hardly one is cast while they come down the stairs, and none when they rest.
#[test]
fn ordinary_scenes_pay_nothing() {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, SimulationPlugins, OctopusScene { count: 3, seed: 1 }))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Time::<Fixed>::from_hz(60.0));
    app.finish();
    let mut seconds = [LastLook::default(); 12];
    for second in &mut seconds {
        for _ in 0..60 {
            steps(&mut app, 1);
            second.casts += looked(&app).casts;
            second.put_back += looked(&app).put_back;
        }
    }
    println!("{seconds:?}");
}
