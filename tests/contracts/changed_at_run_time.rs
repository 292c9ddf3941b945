//! What is taken off, exchanged, cut short or despawned while the game runs leaves nothing behind that the step would go on reading.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{
    CapabilityRejected, ContactMemory, Contacts, ExplicitGroup, ExplicitGroups, ExplicitState, Frozen, Material, Particles, PinState,
    RestPose, RodShape, Rods, Section, Stillness,
};
use polpo_rapier::{RapierWorld, TouchedColliders};
use polpo_rig::Rig;
use polpo_tests::{lattice, simulation, state_of, steps};
use rapier3d::prelude::*;

fn floor(app: &mut App) {
    app.world_mut()
        .resource_mut::<RapierWorld>()
        .insert_fixed(ColliderBuilder::cuboid(50.0, 0.5, 50.0).translation(Vec3::Y * -0.5).friction(0.8));
}

/// A lattice that lies on a floor and tells what it touches.
fn lying(app: &mut App) -> Entity {
    floor(app);
    let body = (SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 0.15, 0.0), TouchedColliders::default());
    let body = app.world_mut().spawn(body).id();
    steps(app, 5);
    assert!(!app.world().get::<Contacts>(body).unwrap().list.is_empty());
    assert!(!app.world().get::<TouchedColliders>(body).unwrap().list.is_empty());
    body
}

#[test]
fn a_body_that_does_not_collide_any_more_has_no_planes() {
    let mut app = simulation();
    let body = lying(&mut app);
    app.world_mut().entity_mut(body).remove::<Collision>();
    steps(&mut app, 2);
    let entity = app.world().entity(body);
    assert!(entity.get::<Contacts>().unwrap().list.is_empty(), "pairs and groups would take it to lie on the floor still");
    assert!(entity.get::<ContactMemory>().unwrap().position.is_empty());
    assert!(entity.get::<TouchedColliders>().unwrap().list.is_empty());
    app.world_mut().entity_mut(body).insert(Collision::default());
    steps(&mut app, 2);
    assert!(!app.world().get::<Contacts>(body).unwrap().list.is_empty(), "and it has them again when it collides again");
}

#[test]
fn planes_of_a_larger_rig_are_not_read_with_a_smaller_one() {
    let mut app = simulation();
    let body = lying(&mut app);
    let mut small = lattice(0.1);
    small.particles.truncate(2);
    small.edges = vec![[0, 1]];
    app.world_mut().entity_mut(body).insert(SoftBody::new(small)).remove::<Collision>();
    steps(&mut app, 2);
    assert_eq!(app.world().get::<Particles>(body).unwrap().len(), 2);
}

/// A body that cannot sleep is one that moves, however long it was still when it could.
#[test]
fn a_body_whose_sleep_was_taken_away_wakes_others() {
    let mut app = simulation();
    floor(&mut app);
    let sleeper = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 0.15, 0.0))).id();
    for _ in 0..60 {
        steps(&mut app, 10);
        if app.world().get::<Sleeping>(sleeper).is_some() {
            break;
        }
    }
    assert!(app.world().get::<Sleeping>(sleeper).is_some());
    let falling = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 1.0, 0.0), Stillness(0.4))).id();
    app.world_mut().entity_mut(falling).remove::<Sleep>();
    steps(&mut app, 40);
    assert!(app.world().get::<Sleeping>(sleeper).is_none());
}

#[test]
fn pins_that_are_taken_away_leave_nothing() {
    let mut app = simulation();
    let pins = Pins { list: vec![Pin::at(0, Vec3::ZERO).breaking_at(1e6)] };
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), pins)).id();
    steps(&mut app, 2);
    app.world_mut().entity_mut(body).remove::<Pins>();
    steps(&mut app, 2);
    assert!(!app.world().entity(body).contains::<PinState>());
    assert!(app.world().get::<Particles>(body).unwrap().reaction.is_empty());
    // Taken away and given again in one breath, they hold.
    let pins = Pins { list: vec![Pin::at(0, Vec3::ZERO)] };
    app.world_mut().commands().entity(body).insert(pins.clone()).remove::<Pins>().insert(pins);
    steps(&mut app, 2);
    assert_eq!(app.world().get::<Particles>(body).unwrap().inverse_mass[0], 0.0);
}

/// What a pin holds has infinite mass, for a hand too.
#[test]
fn a_hand_does_not_pull_a_pinned_particle() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    let place = |app: &App| {
        let world = app.world();
        world.get::<Transform>(body).unwrap().translation + Vec3::from(world.get::<Particles>(body).unwrap().position[0])
    };
    let nail = place(&app);
    let grab = Grab { particle: 0, target: nail + Vec3::Y, stiffness: Stiffness::hertz(30.0) };
    app.world_mut().entity_mut(body).insert((Pins { list: vec![Pin::at(0, nail)] }, grab));
    for _ in 0..10 {
        steps(&mut app, 1);
        assert!(place(&app).distance(nail) < 1e-6, "{}", place(&app) - nail);
    }
}

#[test]
fn whoever_is_told_of_a_refusal_may_despawn_the_body() {
    let mut app = simulation();
    app.add_observer(|refused: On<CapabilityRejected>, mut commands: Commands| commands.entity(refused.entity).despawn());
    let pose = RestPose { position: vec![Vec3::ZERO; 3], rotation: vec![] };
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), pose)).id();
    steps(&mut app, 2);
    assert!(app.world().get_entity(body).is_err());
}

#[test]
fn whoever_is_told_of_one_sleeping_may_despawn_another() {
    let mut app = simulation();
    app.add_observer(|asleep: On<Add, Sleeping>, mut commands: Commands, bodies: Query<Entity, With<SoftBody>>| {
        bodies.iter().filter(|&other| other != asleep.entity).for_each(|other| commands.entity(other).despawn());
    });
    app.insert_resource(Gravity(Vec3::ZERO));
    for x in [0.0, 5.0] {
        let drowsy = Sleep { speed: f32::INFINITY, time: 0.1 };
        app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(x, 0.0, 0.0), drowsy));
    }
    steps(&mut app, 20);
    assert_eq!(app.world_mut().query::<&SoftBody>().iter(app.world()).count(), 1);
}

/// Edges rest inside a rigid group. When the group gives way to a soft one elsewhere they work again.
#[test]
fn edges_work_again_when_their_rigid_group_is_exchanged() {
    let run = |rigid: bool| {
        let mut app = simulation();
        app.insert_resource(Gravity(Vec3::ZERO));
        let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
        let made = app.world().get::<Particles>(body).unwrap().0.clone();
        app.world_mut().entity_mut(body).remove::<(ShapeMatching, Torsion)>();
        if rigid {
            let all = ExplicitGroup::rigid((0..27).collect::<Vec<_>>());
            app.world_mut().entity_mut(body).insert(ExplicitGroups { list: vec![all] });
        }
        steps(&mut app, 3);
        let soft = ExplicitGroup { stiffness: Stiffness::hertz(5.0), ..ExplicitGroup::rigid([0, 1, 2]) };
        app.world_mut().entity_mut(body).insert((ExplicitGroups { list: vec![soft] }, Transform::default()));
        let mut particles = app.world_mut().get_mut::<Particles>(body).unwrap();
        particles.0 = made;
        particles.position[26].y += 0.05;
        steps(&mut app, 3);
        state_of(app.world_mut())
    };
    assert_eq!(run(true), run(false));
}

/// A frozen body is looked at by those it may touch: nothing written to it may reach past the end of its arrays.
#[test]
fn a_frozen_body_may_be_cut_short() {
    let spoil: [fn(&mut polpo_solver::Particles); 5] =
        [|p| p.velocity.clear(), |p| p.radii.truncate(3), |p| p.rest_position.clear(), |p| p.position.clear(), |p| p.frame.truncate(1)];
    for spoil in spoil {
        let mut app = simulation();
        let frozen = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
        app.world_mut().entity_mut(frozen).insert(Frozen);
        app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 0.35, 0.0)));
        steps(&mut app, 2);
        spoil(&mut app.world_mut().get_mut::<Particles>(frozen).unwrap());
        app.world_mut().entity_mut(frozen).insert(SelfContact::default());
        steps(&mut app, 20);
        let p = app.world().get::<Particles>(frozen).unwrap();
        let lengths = [p.position.len(), p.velocity.len(), p.radii.len(), p.rest_position.len(), p.frame.len()];
        assert_eq!(lengths, [27; 5]);
        let mut others = app.world_mut().query_filtered::<&Particles, Without<Frozen>>();
        assert_eq!(others.iter(app.world()).filter(|p| p.is_finite()).count(), 1, "the other one goes on");
    }
}

/// What was made from a body's particles while these were not numbers would break it again.
#[test]
fn groups_outlive_a_quarantine() {
    let mut app = simulation();
    let groups = ExplicitGroups { list: vec![ExplicitGroup::rigid([0, 1, 3, 9])] };
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), groups)).id();
    steps(&mut app, 3);
    let mass = app.world().get::<Particles>(body).unwrap().mass.clone();
    app.world_mut().get_mut::<Particles>(body).unwrap().mass[3] = f32::NAN;
    steps(&mut app, 3);
    assert!(app.world().entity(body).contains::<Frozen>());
    app.world_mut().get_mut::<Particles>(body).unwrap().mass = mass;
    app.world_mut().entity_mut(body).remove::<Frozen>();
    steps(&mut app, 3);
    let entity = app.world().entity(body);
    assert!(!entity.contains::<Frozen>() && entity.contains::<ExplicitState>());
}

/// A rig that was exchanged in place has not been validated; rods meet its edges first.
#[test]
fn rods_of_a_rig_exchanged_in_place_do_not_panic() {
    let mut app = simulation();
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    steps(&mut app, 2);
    let bad = Rig { edges: vec![[0, 1], [2, 99]], ..lattice(0.1) };
    app.world_mut().get_mut::<SoftBody>(body).unwrap().rig = bad.into();
    let material = Material { youngs_modulus: 1e5, poissons_ratio: 0.4, density: 1000.0 };
    let section = Section::circle(0.02);
    let rods = Rods { shape: RodShape::Section { section, edges: Some(vec![0]) }, ..Rods::new(material, section) };
    app.world_mut().entity_mut(body).insert(rods);
    steps(&mut app, 3);
    assert!(app.world().get::<Particles>(body).unwrap().is_finite());
}

/// A negative speed, or none, leaves an overlap as it is; it does not deepen it, nor undo it at once.
#[test]
fn a_push_speed_that_is_none_pushes_nothing() {
    let run = |push_speed: f32| {
        let mut app = simulation();
        floor(&mut app);
        let body = (SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 0.0, 0.0), Collision { push_speed, ..default() });
        app.world_mut().spawn(body);
        steps(&mut app, 20);
        state_of(app.world_mut())
    };
    let still = run(0.0);
    assert_eq!(run(-5.0), still);
    assert_eq!(run(f32::NAN), still);
}
