//! A body that has come to rest sleeps: it costs nothing, nothing about it changes, and it wakes when something happens to it.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Awake, Frozen, Inflation, Material, Particles, RodSolve, Rods, Section, Stillness, SubstepSchedule};
use polpo_rapier::RapierWorld;
use polpo_tests::{lattice, simulation, steps};
use rapier3d::prelude::*;

/// A floor whose top is at 0 and a lattice on it that sleeps.
struct Bedroom {
    app: App,
    body: Entity,
    floor: ColliderHandle,
}

impl Bedroom {
    fn new() -> Self {
        let mut app = simulation();
        let floor = app
            .world_mut()
            .resource_mut::<RapierWorld>()
            .insert_fixed(ColliderBuilder::cuboid(3.0, 0.5, 3.0).translation(Vec3::NEG_Y * 0.5));
        let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 0.2, 0.0))).id();
        let mut this = Self { app, body, floor };
        for _ in 0..60 {
            steps(&mut this.app, 10);
            if this.asleep() {
                return this;
            }
        }
        panic!("it does not fall asleep: {:?}", this.app.world().get::<Stillness>(body));
    }

    fn asleep(&self) -> bool {
        self.app.world().get::<Sleeping>(self.body).is_some()
    }

    fn rapier(&mut self) -> Mut<'_, RapierWorld> {
        self.app.world_mut().resource_mut::<RapierWorld>()
    }

    fn particles(&self) -> polpo_solver::Particles {
        self.app.world().get::<Particles>(self.body).unwrap().0.clone()
    }
}

/// How many bodies the inner schedules have seen.
#[derive(Resource, Default)]
struct Seen(usize);

#[test]
fn a_sleeping_body_is_not_touched_to_the_last_bit() {
    let mut room = Bedroom::new();
    room.app.init_resource::<Seen>().add_systems(SubstepSchedule, |mut seen: ResMut<Seen>, awake: Query<(), (With<SoftBody>, Awake)>| {
        seen.0 += awake.iter().count();
    });
    let world = room.app.world();
    let before = (room.particles(), *world.get::<Transform>(room.body).unwrap());
    let changed = world.entity(room.body).get_ref::<Particles>().unwrap().last_changed();
    assert!(before.0.velocity.iter().chain(&before.0.angular_velocity).all(|v| *v == Vec3A::ZERO));
    steps(&mut room.app, 600);
    let world = room.app.world();
    assert!(room.asleep());
    assert_eq!((room.particles(), *world.get::<Transform>(room.body).unwrap()), before);
    assert_eq!(world.entity(room.body).get_ref::<Particles>().unwrap().last_changed(), changed, "nobody wrote to it");
    assert_eq!(world.resource::<Seen>().0, 0, "no system of the step saw it");
    room.app.world_mut().entity_mut(room.body).remove::<Sleeping>();
    steps(&mut room.app, 1);
    assert!(room.app.world().resource::<Seen>().0 > 0, "awake, it is seen");
}

type Disturbance = (&'static str, fn(&mut Bedroom));

fn component<T: Component>(room: &mut Bedroom, component: T) {
    room.app.world_mut().entity_mut(room.body).insert(component);
}

#[test]
fn what_happens_to_a_body_wakes_it() {
    let wakes: [Disturbance; 26] = [
        ("a velocity", |r| r.app.world_mut().get_mut::<Particles>(r.body).unwrap().velocity[3].x = 1.0),
        ("a moved transform", |r| r.app.world_mut().get_mut::<Transform>(r.body).unwrap().translation.y += 1.0),
        ("gravity", |r| r.app.world_mut().resource_mut::<Gravity>().0.x = 1.0),
        ("substeps", |r| r.app.world_mut().resource_mut::<SolverSettings>().substeps = 7),
        ("a grab", |r| component(r, Grab { particle: 3, target: Vec3::Y, stiffness: Stiffness::hertz(20.0) })),
        ("pins", |r| component(r, Pins::default())),
        ("less gravity", |r| component(r, GravityScale(0.1))),
        ("air drag", |r| component(r, AirDrag::default())),
        ("shape matching", |r| component(r, ShapeMatching::new(Stiffness::hertz(5.0)))),
        ("distances", |r| component(r, DistanceConstraints::new(Stiffness::OFF))),
        ("torsion", |r| component(r, Torsion::new(Stiffness::OFF))),
        ("damping", |r| component(r, Damping { drag: 1.0, internal: 0.0 })),
        ("friction", |r| component(r, Collision { friction: 0.0, ..default() })),
        ("sleep itself", |r| component(r, Sleep { time: 3.0, ..default() })),
        ("stillness", |r| r.app.world_mut().get_mut::<Stillness>(r.body).unwrap().0 = 0.0),
        ("a capability taken away", |r| {
            r.app.world_mut().entity_mut(r.body).remove::<Torsion>();
        }),
        ("a removed floor", |r| {
            let floor = r.floor;
            r.rapier().remove_collider(floor);
        }),
        ("a disabled floor", |r| {
            let floor = r.floor;
            r.rapier().colliders.get_mut(floor).unwrap().set_enabled(false);
        }),
        ("a lowered floor", |r| {
            let floor = r.floor;
            r.rapier().colliders.get_mut(floor).unwrap().set_translation(Vec3::NEG_Y);
        }),
        ("a slippery floor", |r| {
            let floor = r.floor;
            r.rapier().colliders.get_mut(floor).unwrap().set_friction(0.0);
        }),
        ("a floor of another shape", |r| {
            let floor = r.floor;
            // With the same box around it.
            r.rapier().colliders.get_mut(floor).unwrap().set_shape(SharedShape::cuboid(3.0, 0.5, 3.0));
        }),
        ("a floor for others", |r| {
            let floor = r.floor;
            r.rapier().colliders.get_mut(floor).unwrap().set_collision_groups(InteractionGroups::none());
        }),
        ("a collider put beside it", |r| {
            r.rapier().insert_fixed(ColliderBuilder::ball(0.1).translation(Vec3::X * 0.2));
        }),
        ("a driven collider that comes", |r| {
            let bar = RigidBodyBuilder::kinematic_velocity_based().translation(Vec3::new(1.0, 0.2, 0.0)).linvel(Vec3::NEG_X * 10.0);
            let RapierWorld { bodies, colliders, .. } = &mut *r.rapier();
            let bar = bodies.insert(bar);
            colliders.insert_with_parent(ColliderBuilder::ball(0.1), bar, bodies);
        }),
        ("a ball that falls on it", |r| {
            let RapierWorld { bodies, colliders, .. } = &mut *r.rapier();
            let ball = bodies.insert(RigidBodyBuilder::dynamic().translation(Vec3::Y * 0.6));
            colliders.insert_with_parent(ColliderBuilder::ball(0.1), ball, bodies);
        }),
        ("the component removed by hand", |r| {
            r.app.world_mut().entity_mut(r.body).remove::<Sleeping>();
        }),
    ];
    for (name, disturb) in wakes {
        let mut room = Bedroom::new();
        steps(&mut room.app, 3);
        assert!(room.asleep());
        disturb(&mut room);
        let mut woke = false;
        for _ in 0..25 {
            steps(&mut room.app, 1);
            woke |= !room.asleep();
        }
        assert!(woke, "{name} does not wake it");
    }
}

#[test]
fn what_does_not_concern_it_does_not_wake_it() {
    let lets_sleep: [Disturbance; 6] = [
        ("the wind, which it does not feel", |r| r.app.world_mut().resource_mut::<Wind>().0.x = 9.0),
        ("the same gravity again", |r| r.app.insert_resource(Gravity::default()).update()),
        ("a component that is nobody's business", |r| component(r, Name::new("lattice"))),
        ("a collider far away", |r| {
            r.rapier().insert_fixed(ColliderBuilder::ball(0.1).translation(Vec3::X * 2.0));
        }),
        ("a collider on another layer", |r| {
            let layer = InteractionGroups::new(Group::GROUP_5, Group::GROUP_5, InteractionTestMode::And);
            r.rapier().insert_fixed(ColliderBuilder::ball(0.1).collision_groups(layer));
        }),
        ("another body far away", |r| {
            r.app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(2.0, 1.0, 0.0)));
        }),
    ];
    for (name, disturb) in lets_sleep {
        let mut room = Bedroom::new();
        let before = room.particles();
        disturb(&mut room);
        steps(&mut room.app, 20);
        assert!(room.asleep(), "{name} wakes it");
        assert_eq!(room.particles(), before);
    }
}

#[test]
fn a_pinned_body_wakes_when_the_hand_moves_and_not_before() {
    let mut room = Bedroom::new();
    let hand = room.app.world_mut().spawn(Transform::from_xyz(0.0, 0.6, 0.0)).id();
    room.app
        .world_mut()
        .entity_mut(room.body)
        .insert((Pins { list: vec![Pin::to_entity(13, hand, Vec3::ZERO)] }, Damping { drag: 3.0, ..default() }));
    for _ in 0..60 {
        steps(&mut room.app, 10);
        if room.asleep() {
            break;
        }
    }
    assert!(room.asleep(), "it hangs at rest");
    steps(&mut room.app, 100);
    assert!(room.asleep());
    room.app.world_mut().get_mut::<Transform>(hand).unwrap().translation.x += 0.01;
    steps(&mut room.app, 1);
    assert!(!room.asleep());
}

#[test]
fn woken_in_mid_air_it_falls_in_the_same_step() {
    let mut room = Bedroom::new();
    let height = room.app.world().get::<Transform>(room.body).unwrap().translation.y;
    let floor = room.floor;
    room.rapier().remove_collider(floor);
    steps(&mut room.app, 1);
    assert!(room.app.world().get::<Transform>(room.body).unwrap().translation.y < height);
    steps(&mut room.app, 59);
    // Symplectic Euler falls ½g(t² + tΔt).
    let fallen = height - room.app.world().get::<Transform>(room.body).unwrap().translation.y;
    let dt = 1.0 / (60.0 * SolverSettings::default().substeps as f32);
    assert!((fallen - 0.5 * 9.81 * (1.0 + dt)).abs() < 1e-3, "{fallen}");
}

#[test]
fn without_the_component_a_body_never_sleeps() {
    let mut room = Bedroom::new();
    room.app.world_mut().entity_mut(room.body).remove::<Sleep>();
    steps(&mut room.app, 300);
    assert!(!room.asleep());
}

/// Ten octopuses in a heap: all of them come to rest, and stay to the last bit.
#[test]
fn a_pile_of_ten_octopuses_falls_asleep_and_does_not_creep() {
    let mut app = simulation();
    app.world_mut()
        .resource_mut::<RapierWorld>()
        .insert_fixed(ColliderBuilder::cuboid(9.0, 0.5, 9.0).translation(Vec3::NEG_Y * 0.5).friction(0.7));
    let (_, rig) = polpo_scenes::octopus_asset();
    let bodies: Vec<Entity> = (0..10)
        .map(|i| {
            let place = Vec3::new(0.25 * (i % 3) as f32, 0.5 + 0.35 * i as f32, 0.2 * (i % 2) as f32);
            app.world_mut().spawn((SoftBody::new(rig.clone()), Transform::from_translation(place))).id()
        })
        .collect();
    let asleep = |app: &App| bodies.iter().filter(|&&b| app.world().get::<Sleeping>(b).is_some()).count();
    let mut seconds = 0;
    while asleep(&app) < 10 && seconds < 40 {
        steps(&mut app, 60);
        seconds += 1;
        println!("{seconds} s: {} asleep", asleep(&app));
    }
    assert_eq!(asleep(&app), 10, "after {seconds} s");
    let before = polpo_tests::state_of(app.world_mut());
    steps(&mut app, 600);
    assert_eq!(asleep(&app), 10);
    assert_eq!(polpo_tests::state_of(app.world_mut()), before, "ten seconds later");
    // Poked, one wakes, and those it lies on with it.
    app.world_mut().get_mut::<Particles>(bodies[0]).unwrap().set_rigid_velocity(Vec3A::Y, Vec3A::ZERO);
    steps(&mut app, 4);
    assert!(asleep(&app) < 9, "{} still sleep", asleep(&app));
}

/// Spawned asleep or frozen, a body stays where it was put, in one piece, until it is woken; built anew, it is awake.
#[test]
fn a_body_may_be_spawned_asleep_or_frozen() {
    let mut app = simulation();
    let at = |x: f32| Transform::from_xyz(x, 1.0, 0.0);
    let material = Material { youngs_modulus: 1e5, poissons_ratio: 0.3, density: 1000.0 };
    let rods = Rods { solve: RodSolve::Sweep { spin_radius: 0.0 }, ..Rods::new(material, Section::circle(0.02)) };
    let world = app.world_mut();
    let bodies = [
        world.spawn((SoftBody::new(lattice(0.1)), at(0.0), Sleeping::default())).id(),
        world.spawn((SoftBody::new(lattice(0.1)), at(2.0), Frozen)).id(),
        world.spawn((SoftBody::new(lattice(0.1)), at(4.0), Sleeping::default(), rods, Inflation::new(1.1))).id(),
    ];
    let held =
        |app: &App| bodies.map(|body| app.world().entity(body).contains::<Sleeping>() || app.world().entity(body).contains::<Frozen>());
    let heights = |app: &App| bodies.map(|body| app.world().get::<Transform>(body).unwrap().translation.y);
    steps(&mut app, 30);
    assert_eq!((held(&app), heights(&app)), ([true; 3], [1.0; 3]));
    for body in bodies {
        app.world_mut().entity_mut(body).remove::<(Sleeping, Frozen)>();
    }
    steps(&mut app, 30);
    assert_eq!(held(&app), [false; 3]);
    assert!(heights(&app).iter().all(|y| *y < 0.0), "{:?}", heights(&app));
    app.world_mut().entity_mut(bodies[0]).insert(Sleeping::default());
    app.world_mut().entity_mut(bodies[1]).insert(Frozen);
    steps(&mut app, 2);
    assert_eq!(held(&app), [true, true, false]);
    for body in &bodies[..2] {
        app.world_mut().entity_mut(*body).insert(SoftBody::new(lattice(0.1)));
    }
    steps(&mut app, 2);
    assert_eq!(held(&app), [false; 3]);
}
