//! The same bits on every run and any number of threads with explicit groups: rigid ones with joints and motors, ones that open, soft ones, pinned ones.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Deformable, Drive, ExplicitGroup, ExplicitGroups, ExplicitState, Motor, Particles, Plasticity};
use polpo_rapier::{PushRigidBodies, RapierWorld};
use polpo_scenes::octopus_asset;
use rapier3d::prelude::*;

use crate::determinism::{THREADS, hash_with, same_for_any_threads};

/// Enough that `predict_explicit`, at 50 ns a particle, goes parallel.
const BODIES: usize = 16;

/// By place along `axis`: the outermost dozens, overlapping by one particle.
fn groups(particles: &Particles, index: usize) -> ExplicitGroups {
    let axis = [Vec3A::X, Vec3A::Y, Vec3A::Z][index % 3];
    let mut order: Vec<u32> = (0..particles.len() as u32).collect();
    order.sort_by(|&a, &b| {
        let along = |i: u32| particles.rest_position[i as usize].dot(axis);
        along(a).total_cmp(&along(b))
    });
    let deformable = Some(Deformable { speed: 1.0, time: 0.1, dent: 0.3 });
    let drive = if index.is_multiple_of(2) { Drive::Torque(0.5) } else { Drive::Speed { target: 5.0, max_torque: 1.0 } };
    let motor = Some(Motor { axis: Vec3A::Y, drive, against: Some(1) });
    ExplicitGroups {
        list: vec![
            ExplicitGroup { motor, ..ExplicitGroup::rigid(&order[..20]) },
            ExplicitGroup { deformable, ..ExplicitGroup::rigid(&order[19..40]) },
            ExplicitGroup { stiffness: Stiffness::damped(20.0, 0.3), ..ExplicitGroup::rigid(&order[100..130]) },
            ExplicitGroup { deformable, ..ExplicitGroup::rigid(&order[260..]) },
        ],
    }
}

fn scene(app: &mut App) {
    app.insert_resource(SolverSettings { substeps: 4, iterations: 2, ..default() });
    let mut world = app.world_mut().resource_mut::<RapierWorld>();
    world.insert_fixed(ColliderBuilder::cuboid(9.0, 0.5, 9.0).translation(Vec3::NEG_Y * 0.5).friction(0.7));
    let RapierWorld { bodies, colliders, .. } = &mut *world;
    let ball = bodies.insert(RigidBodyBuilder::dynamic().translation(Vec3::new(0.5, 3.0, 0.5)));
    colliders.insert_with_parent(ColliderBuilder::ball(0.4), ball, bodies);
    let (_, rig) = octopus_asset();
    for i in 0..BODIES {
        let place = Vec3::new(1.1 * (i % 4) as f32 - 1.5, 0.8 + 0.5 * (i / 8) as f32, 1.1 * (i / 4) as f32 - 1.5);
        let velocity = InitialVelocity { linear: Vec3::new(1.0, -4.0, (i % 3) as f32 - 1.0), angular: Vec3::new(0.0, 2.0, 1.0) };
        let body = app.world_mut().spawn((SoftBody::new(rig.clone()), Transform::from_translation(place), velocity)).id();
        let particles = app.world().get::<Particles>(body).unwrap();
        let (groups, nail) = (groups(particles, i), place + Vec3::from(particles.position[7]));
        let mut body = app.world_mut().entity_mut(body);
        body.insert((groups, Plasticity::default()));
        if i.is_multiple_of(4) {
            body.insert(Pins { list: vec![Pin::at(7, nail).breaking_at(30.0)] });
        }
        if i.is_multiple_of(5) {
            body.insert(PushRigidBodies);
        }
    }
}

/// What the children of the test below run.
#[test]
fn child() {
    if let Some(threads) = std::env::var(THREADS).ok().and_then(|n| n.parse().ok()) {
        let hash = hash_with(threads, 60, |app| {
            scene(app);
            app.add_systems(FixedLast, |states: Query<&ExplicitState>, mut opened: Local<bool>| {
                assert_eq!(states.iter().count(), BODIES);
                if !*opened && states.iter().any(|state| (0..4).any(|g| state.is_open(g))) {
                    *opened = true;
                    println!("a group is open");
                }
            });
        });
        println!("hashes={hash:016x};");
    }
}

#[test]
fn the_same_bits_with_explicit_groups() {
    same_for_any_threads("groups_in_parallel::child", "a group is open");
}
