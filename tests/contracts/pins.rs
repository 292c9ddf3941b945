//! Pins hold what they are told to, follow what they are tied to, and give way where they must; entities ride on particles.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Particles, PinBroken};
use polpo_tests::{lattice, simulation, steps};

fn place(app: &App, body: Entity, i: usize) -> Vec3 {
    app.world().get::<Transform>(body).unwrap().translation + Vec3::from(app.world().get::<Particles>(body).unwrap().position[i])
}

/// Spawns the lattice with particle 0 pinned where it is.
fn hanging(app: &mut App, change: impl Fn(Pin) -> Pin) -> (Entity, Vec3) {
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    let nail = place(app, body, 0);
    app.world_mut().entity_mut(body).insert(Pins { list: vec![change(Pin::at(0, nail))] });
    (body, nail)
}

#[test]
fn a_pinned_corner_stays_and_the_body_hangs_below_it() {
    let mut app = simulation();
    let (body, nail) = hanging(&mut app, |pin| pin);
    steps(&mut app, 600);
    assert!(place(&app, body, 0).distance(nail) < 1e-5, "{}", place(&app, body, 0));
    // It swings to rest below the nail: the diagonal of the cube, half of it 0.173 m, stretched by its weight.
    let center = app.world().get::<Transform>(body).unwrap().translation;
    assert!(center.y < nail.y - 0.14 && center.y > nail.y - 0.26, "{center}");
    app.world_mut().entity_mut(body).remove::<Pins>();
    steps(&mut app, 60);
    assert!(app.world().get::<Transform>(body).unwrap().translation.y < nail.y - 4.0, "without its pin it falls");
}

#[test]
fn a_clamped_corner_does_not_turn() {
    let mut app = simulation();
    let (body, _) = hanging(&mut app, Pin::clamped);
    steps(&mut app, 120);
    let particles = app.world().get::<Particles>(body).unwrap();
    assert!(particles.rotation[0].angle_between(Quat::IDENTITY) < 1e-4);
    assert!(particles.rotation.iter().any(|q| q.angle_between(Quat::IDENTITY) > 1e-3), "the others are free to");
}

#[test]
fn a_pin_gives_way_at_its_force_and_not_before() {
    #[derive(Resource, Default)]
    struct Broken(Vec<f32>);
    // 27 particles of 10 g weigh 2.65 N; letting it drop from rest onto the nail takes less than three times that.
    for (force, breaks) in [(1.5, true), (40.0, false)] {
        let mut app = simulation();
        app.init_resource::<Broken>().add_observer(|broken: On<PinBroken>, mut all: ResMut<Broken>| all.0.push(broken.force));
        let (body, nail) = hanging(&mut app, |pin| pin.breaking_at(force));
        steps(&mut app, 240);
        assert_eq!(app.world().resource::<Broken>().0.len(), usize::from(breaks), "{force} N");
        assert_eq!(place(&app, body, 0).distance(nail) > 1.0, breaks, "{force} N");
    }
}

/// Hanging at rest, what the pin gives is the weight.
#[test]
fn the_pull_of_a_pin_is_the_weight() {
    #[derive(Resource, Default)]
    struct Broken(Option<f32>);
    let mut app = simulation();
    app.init_resource::<Broken>().add_observer(|broken: On<PinBroken>, mut last: ResMut<Broken>| last.0 = Some(broken.force));
    let (body, _) = hanging(&mut app, |pin| pin);
    app.world_mut().entity_mut(body).insert(Damping { drag: 2.0, internal: 8.0 });
    steps(&mut app, 900);
    app.world_mut().get_mut::<Pins>(body).unwrap().list[0].break_force = 0.1;
    steps(&mut app, 1);
    let weight = 27.0 * 0.01 * 9.81;
    let force = app.world().resource::<Broken>().0.expect("it gave way");
    assert!((force / weight - 1.0).abs() < 0.01, "{force} N against {weight} N");
}

#[test]
fn a_pin_follows_its_entity_and_survives_its_end() {
    let mut app = simulation();
    let hand = app.world_mut().spawn(Transform::from_xyz(0.0, 1.0, 0.0)).id();
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.1, 1.1, 0.1))).id();
    app.world_mut().entity_mut(body).insert(Pins { list: vec![Pin::to_entity(0, hand, Vec3::X * 0.05)] });
    for _ in 0..120 {
        app.world_mut().get_mut::<Transform>(hand).unwrap().translation.x += 0.02;
        steps(&mut app, 1);
    }
    let target = app.world().get::<Transform>(hand).unwrap().translation + Vec3::X * 0.05;
    assert!(place(&app, body, 0).distance(target) < 1e-4, "{} against {target}", place(&app, body, 0));
    assert!(app.world().get::<Transform>(body).unwrap().translation.distance(target) < 0.4, "the body came along");
    app.world_mut().despawn(hand);
    steps(&mut app, 60);
    assert!(place(&app, body, 0).distance(target) < 1e-4, "what is left without its hand stays where it is");
}

#[test]
fn nonsense_pins_do_nothing() {
    let mut app = simulation();
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    let list = vec![Pin::at(999, Vec3::ZERO), Pin::at(1, Vec3::NAN), Pin::at(2, Vec3::ZERO).breaking_at(f32::NAN)];
    app.world_mut().entity_mut(body).insert(Pins { list });
    steps(&mut app, 30);
    assert!(app.world().get::<Particles>(body).unwrap().is_finite());
    assert!(place(&app, body, 2).length() < 1e-5);
}

#[test]
fn an_entity_rides_on_a_particle() {
    let mut app = simulation();
    let body =
        app.world_mut().spawn((SoftBody::new(lattice(0.1)), InitialVelocity { linear: Vec3::X, angular: Vec3::new(0.0, 3.0, 1.0) })).id();
    let anchor = ParticleAnchor { offset: Vec3::Y * 0.2, ..ParticleAnchor::new(body, 5) };
    let hat = app.world_mut().spawn((Transform::default(), anchor)).id();
    steps(&mut app, 45);
    let q = app.world().get::<Particles>(body).unwrap().rotation[5];
    let expected = place(&app, body, 5) + q * (Vec3::Y * 0.2);
    let hat = app.world().get::<Transform>(hat).unwrap();
    assert!(hat.translation.distance(expected) < 1e-5 && hat.rotation.angle_between(q) < 1e-3, "{hat:?}");
    assert!(q.angle_between(Quat::IDENTITY) > 0.5);
}

#[test]
fn the_wind_carries_those_that_feel_it() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO)).insert_resource(Wind(Vec3::X * 10.0));
    let kite = app.world_mut().spawn((SoftBody::new(lattice(0.1)), AirDrag::default())).id();
    let stone = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 5.0, 0.0))).id();
    steps(&mut app, 600);
    let x = |body| app.world().get::<Transform>(body).unwrap().translation.x;
    assert!(x(kite) > 20.0 && x(kite) < 100.0, "{}", x(kite));
    assert!(x(stone).abs() < 1e-4);
}
