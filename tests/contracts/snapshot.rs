//! A snapshot is small, fits only the body it was taken of, and the steps after it are those that would have been, to the bit.

use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::prelude::*;
use polpo::{
    BodySnapshot, ContactMemory, Deformable, ExplicitGroup, ExplicitGroups, ExplicitState, ImplicitGroups, Particles, Plasticity,
    SnapshotError,
};
use polpo_rapier::{PushRigidBodies, RapierSnapshot, RapierWorld};
use polpo_scenes::{OctopusScene, SimulationPlugins, octopus_asset};
use polpo_tests::{Random, lattice, random_scene, simulation, state_of, steps};
use rapier3d::prelude::{ColliderBuilder, RigidBodyBuilder, SpringJointBuilder};

/// How many steps have to be the same.
const STEPS: usize = 600;

fn scene(build: impl FnOnce(&mut App)) -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, SimulationPlugins)).insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
    build(&mut app);
    app.finish();
    app.update();
    app
}

fn octopuses(app: &mut App) {
    app.add_plugins(OctopusScene { count: 3, seed: 5 });
}

/// All that a game would keep, as bytes where it is a snapshot.
struct Kept {
    bodies: Vec<(Entity, Vec<u8>)>,
    rapier: RapierSnapshot,
    clock: Time<Fixed>,
}

fn keep(app: &mut App) -> Kept {
    let world = app.world_mut();
    let entities: Vec<Entity> = world.query_filtered::<Entity, With<SoftBody>>().iter(world).collect();
    Kept {
        bodies: entities.into_iter().map(|e| (e, BodySnapshot::take(world, e).unwrap().to_bytes())).collect(),
        rapier: RapierSnapshot::take(world).unwrap(),
        clock: *world.resource(),
    }
}

fn put_back(app: &mut App, kept: &Kept) {
    let world = app.world_mut();
    for (entity, bytes) in &kept.bodies {
        BodySnapshot::from_bytes(bytes).unwrap().restore(world, *entity).unwrap();
    }
    kept.rapier.restore(world);
    world.insert_resource(kept.clock);
}

/// The hashes of every hundredth step.
fn go_on(app: &mut App) -> Vec<u64> {
    (0..STEPS / 100)
        .map(|_| {
            steps(app, 100);
            state_of(app.world_mut())
        })
        .collect()
}

/// Puts the first body to the end of the table that queries go over, and the last in its place; a new world has them in the order of spawning.
fn shuffle(app: &mut App) {
    #[derive(Component)]
    struct Mark;
    let world = app.world_mut();
    let first = world.query_filtered::<Entity, With<SoftBody>>().iter(world).min();
    world.entity_mut(first.unwrap()).insert(Mark).remove::<Mark>();
}

/// Keeps after `before` steps, goes on, and goes on again from what was kept: in the same world, whose bodies have moved on meanwhile, and in a new one.
fn check(name: &str, before: usize, build: impl Fn(&mut App)) {
    let mut app = scene(&build);
    steps(&mut app, before - 10);
    shuffle(&mut app);
    steps(&mut app, 10);
    let kept = keep(&mut app);
    let then = state_of(app.world_mut());
    let expected = go_on(&mut app);
    assert!(expected[0] != then, "{name}: something moves");
    put_back(&mut app, &kept);
    assert_eq!(state_of(app.world_mut()), then, "{name}");
    assert_eq!(go_on(&mut app), expected, "{name}: in the same world");
    let mut fresh = scene(&build);
    put_back(&mut fresh, &kept);
    assert_eq!(go_on(&mut fresh), expected, "{name}: in a new world");
}

#[test]
fn octopuses_on_the_stairs_go_on_as_they_would_have() {
    // The bar sweeps, octopuses touch the stairs and it.
    check("octopuses", 130, octopuses);
}

/// Three bodies that push lie on one board, which a joint accelerates.
#[test]
fn a_board_on_a_spring_goes_on_as_it_would_have() {
    check("board", 50, |app| {
        let mut world = app.world_mut().resource_mut::<RapierWorld>();
        let world = &mut *world;
        let above = world.bodies.insert(RigidBodyBuilder::fixed().translation(Vec3::Y * 2.0));
        let board = world.bodies.insert(RigidBodyBuilder::dynamic().translation(Vec3::Y).linvel(Vec3::X));
        world.colliders.insert_with_parent(ColliderBuilder::cuboid(0.5, 0.05, 0.5).density(20.0), board, &mut world.bodies);
        world.impulse_joints.insert(above, board, SpringJointBuilder::new(0.8, 50.0, 1.0), true);
        for x in [-0.1, 0.2, -0.25] {
            let place = Transform::from_xyz(x, 1.22 + x.abs(), 0.8 * x);
            app.world_mut().spawn((SoftBody::new(lattice(0.07)), place, PushRigidBodies));
        }
    });
}

#[test]
fn random_scenes_go_on_as_they_would_have() {
    for seed in [1, 2, 8] {
        check(&format!("scene {seed}"), 40 + 30 * seed as usize, |app| random_scene(app, seed));
    }
}

#[test]
fn a_body_of_300_particles_fits_20_kb() {
    let mut app = scene(octopuses);
    steps(&mut app, 100);
    for (entity, bytes) in keep(&mut app).bodies {
        let world = app.world();
        let (particles, memory) = (world.get::<Particles>(entity).unwrap(), world.get::<ContactMemory>(entity).unwrap());
        assert_eq!((particles.len(), memory.position.len()), (300, 300), "with its contacts' memory");
        println!("{} bytes", bytes.len());
        assert!(bytes.len() <= 20_000, "{} bytes", bytes.len());
    }
}

fn one_body() -> (App, Entity) {
    let mut app = simulation();
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(ColliderBuilder::ball(0.3).translation(Vec3::NEG_Y));
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    steps(&mut app, 30);
    (app, body)
}

#[test]
fn what_does_not_fit_is_refused_by_name_and_changes_nothing() {
    let (mut app, body) = one_body();
    let good = BodySnapshot::take(app.world(), body).unwrap();
    steps(&mut app, 5);
    let before = state_of(app.world_mut());
    let world = app.world_mut();

    let other = world.spawn(SoftBody::new(octopus_asset().1)).id();
    let smaller = world.spawn((SoftBody::new(lattice(0.1)), Transform::from_scale(Vec3::splat(0.5)))).id();
    let stone = world.spawn(Transform::default()).id();
    assert_eq!(good.restore(world, other), Err(SnapshotError::Count { found: 27, expected: 300 }));
    assert_eq!(good.restore(world, smaller), Err(SnapshotError::OtherBody));
    assert_eq!(good.restore(world, stone), Err(SnapshotError::NoBody(stone)));
    world.despawn(other);
    assert_eq!(good.restore(world, other), Err(SnapshotError::NoBody(other)));
    assert_eq!(BodySnapshot::take(world, stone), Err(SnapshotError::NoBody(stone)));
    world.despawn(smaller);

    let bytes = good.to_bytes();
    for end in [0, 1, 10, 100, bytes.len() - 1] {
        assert!(matches!(BodySnapshot::from_bytes(&bytes[..end]), Err(SnapshotError::Bytes(_))), "cut at {end}");
    }
    assert_eq!(BodySnapshot::from_bytes(&[&bytes[..], &[7, 7]].concat()), Err(SnapshotError::Trailing(2)));
    let mut newer = bytes.clone();
    newer[0] = 9;
    assert_eq!(BodySnapshot::from_bytes(&newer), Err(SnapshotError::Version { found: 9, expected: BodySnapshot::VERSION }));

    // The first number after version, fingerprint and origin is the count, then the first position.
    let mut bad = bytes.clone();
    let at = bytes.len() - 27 * 12 - 27 * 12 - 27 * 16 - 27 * 12 - 27 * 12 - 30;
    bad[at..at + 60].fill(0xff);
    let error = BodySnapshot::from_bytes(&bad).and_then(|s| s.restore(world, body)).unwrap_err();
    assert!(matches!(error, SnapshotError::Particles(_) | SnapshotError::Bytes(_) | SnapshotError::Range { .. }), "{error}");
    assert_eq!(state_of(world), before, "nothing was changed");
}

/// A body with a dented group, a joint, plastic flow, pairs of particles within and a neighbour.
fn complex_body() -> (App, Entity) {
    let (mut app, body) = one_body();
    let dented = ExplicitGroup {
        deformable: Some(Deformable { speed: 0.01, time: 0.05, dent: 1.0 }),
        ..ExplicitGroup::rigid((0..9).collect::<Vec<_>>())
    };
    let list = vec![dented, ExplicitGroup::rigid([8, 17, 16]), ExplicitGroup::rigid([17, 26])];
    let plasticity = Plasticity { yield_strain: 0.001, ..default() };
    app.world_mut().entity_mut(body).insert((ExplicitGroups { list }, plasticity, SelfContact::default()));
    let above = app.world().get::<Transform>(body).unwrap().translation + Vec3::Y * 0.28;
    app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_translation(above)));
    steps(&mut app, 60);
    let flows = |app: &App| !app.world().get::<ImplicitGroups>(body).unwrap().flow().is_empty();
    assert!(flows(&app));
    (app, body)
}

/// What a component says has to be there before the snapshot is put back: in a new world it is what was made anew from it, in the same one what has become of it meanwhile, that goes on as it was.
#[test]
fn what_capabilities_remember_comes_back_and_has_to_fit() {
    let (mut app, body) = complex_body();
    let kept = BodySnapshot::take(app.world(), body).unwrap();
    let remembered = |app: &App| {
        let (groups, shapes) = (app.world().get::<ExplicitState>(body).unwrap(), app.world().get::<ImplicitGroups>(body).unwrap());
        (
            groups.memory(app.world().get::<Particles>(body).unwrap()),
            shapes.flow().to_vec(),
            (0..shapes.len()).flat_map(|g| shapes.rest(g)).copied().collect::<Vec<_>>(),
        )
    };
    let then = remembered(&app);
    steps(&mut app, 30);
    assert_ne!(remembered(&app), then);
    kept.restore(app.world_mut(), body).unwrap();
    // Not yet recalled, and no less the same.
    assert_eq!(BodySnapshot::take(app.world(), body).unwrap(), kept);
    let still = app.world().resource::<Time<Fixed>>().timestep();
    app.insert_resource(Time::<Fixed>::from_duration(std::time::Duration::from_nanos(1)));
    steps(&mut app, 1);
    app.insert_resource(Time::<Fixed>::from_duration(still));
    let now = remembered(&app);
    assert_eq!(now.1, then.1);
    assert_eq!(now.0[1].rest, then.0[1].rest);

    let before = state_of(app.world_mut());
    let world = app.world_mut();
    let groups = world.entity_mut(body).take::<ExplicitGroups>().unwrap();
    assert_eq!(kept.restore(world, body), Err(SnapshotError::Capability("its explicit groups")));
    world.entity_mut(body).insert(groups).remove::<ShapeMatching>();
    assert_eq!(kept.restore(world, body), Err(SnapshotError::Capability("the plastic flow of its shapes")));
    world.entity_mut(body).insert(ShapeMatching::default()).remove::<(DistanceConstraints, Torsion)>();
    assert_eq!(kept.restore(world, body), Err(SnapshotError::Capability("the plastic flow of its edges")));
    world.entity_mut(body).insert(DistanceConstraints::default());
    assert_eq!(state_of(world), before, "nothing was changed");
    kept.restore(world, body).unwrap();

    // The same particles, joined by other edges.
    let mut rig = lattice(0.1);
    rig.edges.pop();
    let other = world.spawn(SoftBody::new(rig)).id();
    assert_eq!(kept.restore(world, other), Err(SnapshotError::OtherBody));
}

/// Whatever bytes say, they are refused or make a body that can be stepped.
#[test]
fn changed_bytes_never_panic() {
    let (mut app, body) = complex_body();
    app.world_mut().entity_mut(body).insert(Pins { list: vec![Pin::at(3, Vec3::Y), Pin::to_entity(5, body, Vec3::ZERO).clamped()] });
    steps(&mut app, 5);
    let bytes = BodySnapshot::take(app.world(), body).unwrap().to_bytes();
    let mut random = Random(1);
    let (mut refused, mut taken) = (0, 0);
    for round in 0..3000 {
        let mut bad = bytes.clone();
        for _ in 0..1 + random.below(4) {
            // Half of them where counts and flags are.
            let at = if round % 2 == 0 { random.below(bad.len()) } else { bad.len() - 1 - random.below(bad.len() - 27 * 64) };
            bad[at] = random.bits() as u8;
        }
        if random.once_in(10) {
            bad.truncate(random.below(bad.len()));
        }
        match BodySnapshot::from_bytes(&bad).and_then(|snapshot| snapshot.restore(app.world_mut(), body)) {
            Ok(()) => {
                taken += 1;
                if taken % 20 == 0 {
                    steps(&mut app, 1);
                }
            }
            Err(_) => refused += 1,
        }
    }
    println!("{refused} refused, {taken} taken");
    assert!(refused > 100 && taken > 100);
    BodySnapshot::from_bytes(&bytes).unwrap().restore(app.world_mut(), body).unwrap();
}

/// A pin that gave way is there again, one that somebody added is gone, what sleeps goes on sleeping.
#[test]
fn pins_and_sleep_come_back() {
    let (mut app, body) = one_body();
    let pin = Pin::at(13, Vec3::Y * 0.5).breaking_at(1e6);
    app.world_mut().entity_mut(body).insert(Pins { list: vec![pin] });
    steps(&mut app, 3);
    let kept = BodySnapshot::take(app.world(), body).unwrap();
    app.world_mut().get_mut::<Pins>(body).unwrap().list = vec![Pin::at(1, Vec3::Y), Pin::at(2, Vec3::Y)];
    steps(&mut app, 3);
    kept.restore(app.world_mut(), body).unwrap();
    steps(&mut app, 1);
    let world = app.world_mut();
    assert_eq!(world.get::<Pins>(body).unwrap().list, [pin]);
    let pinned: Vec<usize> = (0..27).filter(|&i| world.get::<Particles>(body).unwrap().inverse_mass[i] == 0.0).collect();
    assert_eq!(pinned, [13]);

    world.entity_mut(body).insert(GravityScale(0.0)).remove::<Pins>();
    world.get_mut::<Particles>(body).unwrap().set_rigid_velocity(default(), default());
    steps(&mut app, 200);
    assert!(app.world().get::<Sleeping>(body).is_some());
    let asleep = BodySnapshot::take(app.world(), body).unwrap();
    app.world_mut().get_mut::<Particles>(body).unwrap().velocity[0].x = 1.0;
    steps(&mut app, 10);
    assert!(app.world().get::<Sleeping>(body).is_none());
    asleep.restore(app.world_mut(), body).unwrap();
    let then = state_of(app.world_mut());
    steps(&mut app, 10);
    assert!(app.world().get::<Sleeping>(body).is_some());
    assert_eq!(state_of(app.world_mut()), then);
    // What is written after it was put back wakes it all the same.
    asleep.restore(app.world_mut(), body).unwrap();
    app.world_mut().get_mut::<GravityScale>(body).unwrap().0 = 1.0;
    steps(&mut app, 1);
    assert!(app.world().get::<Sleeping>(body).is_none());
}
