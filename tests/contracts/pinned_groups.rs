//! Pins on members of rigid groups: the whole group hangs by them, swings as a compound pendulum does, and gives way at its weight.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Deformable, ExplicitGroup, ExplicitGroups, ExplicitState, Particles, PinBroken, PinTarget, Plasticity};
use polpo_rapier::{PushRigidBodies, RapierWorld};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_solver::fit_rigid;
use polpo_tests::{lattice, simulation, steps};
use rapier3d::prelude::*;

const G: f32 = 9.81;
/// A plate whose corners 0 and 1 are at the top; the lower ones are heavier.
const PLATE: [[f32; 3]; 4] = [[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0], [-0.2, -0.5, 0.0], [0.2, -0.5, 0.0]];
const MASS: [f32; 4] = [0.5, 1.0, 2.0, 1.5];

#[derive(Resource, Default)]
struct Broken(Vec<(usize, u32, f32)>);

#[derive(Resource, Default)]
struct Steps(usize);

/// A plate turned by `turn` in one rigid group, and its place.
fn plate(app: &mut App, turn: Quat) -> Entity {
    let particle = |i| Particle { position: Vec3::from(PLATE[i]), frame: Quat::IDENTITY, radii: Vec3::splat(0.05), mass: MASS[i] };
    let rig =
        Rig { mesh_hash: MeshHash(0), particles: (0..4).map(particle).collect(), edges: vec![[0, 1], [0, 2], [1, 3]], ..Rig::default() };
    let groups = ExplicitGroups { list: vec![ExplicitGroup::rigid([0, 1, 2, 3])] };
    app.world_mut().spawn((SoftBody::new(rig), Transform::from_rotation(turn), groups)).id()
}

fn place(app: &App, body: Entity, i: usize) -> Vec3 {
    app.world().get::<Transform>(body).unwrap().translation + Vec3::from(app.world().get::<Particles>(body).unwrap().position[i])
}

fn pin(app: &mut App, body: Entity, list: Vec<Pin>) {
    app.world_mut().entity_mut(body).insert(Pins { list });
}

fn weighing() -> App {
    let mut app = simulation();
    app.insert_resource(SolverSettings { substeps: 20, iterations: 1, ..default() }).init_resource::<Broken>().init_resource::<Steps>();
    app.add_observer(|broken: On<PinBroken>, steps: Res<Steps>, mut all: ResMut<Broken>| {
        all.0.push((steps.0, broken.pin.particle, broken.force));
    });
    app.add_systems(FixedPreUpdate, |mut steps: ResMut<Steps>| steps.0 += 1);
    app
}

/// Moment of inertia about the line through `at` along `axis` (unit), and distance of the centre of mass from that line, of the plate as it lies in the rig.
fn about(app: &App, body: Entity, at: Vec3, axis: Vec3) -> (f32, f32) {
    let p = app.world().get::<Particles>(body).unwrap();
    let across = |x: Vec3| (x - at).reject_from_normalized(axis);
    let (mut inertia, mut moment, mut mass) = (0.0, Vec3::ZERO, 0.0);
    for i in 0..4 {
        let d = across(Vec3::from(PLATE[i]));
        inertia += MASS[i] * d.length_squared() + p.inertia[i];
        moment += d * MASS[i];
        mass += MASS[i];
    }
    (inertia, moment.length() / mass)
}

/// Time between crossings of where it would hang, doubled, of `count` crossings or so; `side` tells on which side it is.
fn period(app: &mut App, count: usize, side: impl Fn(&App) -> f32) -> f32 {
    let (mut last, mut crossings) = (side(app), Vec::new());
    for step in 1..=count {
        steps(app, 1);
        let now = side(app);
        if now * last < 0.0 {
            crossings.push((step as f32 - 1.0 + last / (last - now)) / 60.0);
        }
        last = now;
    }
    (crossings[crossings.len() - 1] - crossings[0]) * 2.0 / (crossings.len() - 1) as f32
}

/// T = 2π·√(I/(m·g·d)), longer by 1/agm(1, cos ½θ) from the angle θ, for the pull g across the axis.
fn closed_form(inertia: f32, distance: f32, pull: f32, angle: f32) -> f32 {
    let mass: f32 = MASS.iter().sum();
    let (mut a, mut b) = (1.0f32, (0.5 * angle).cos());
    for _ in 0..4 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    core::f32::consts::TAU * (inertia / (mass * pull * distance)).sqrt() / a
}

/// By one member, in its plane, pinned to the world or to an entity.
#[test]
fn a_group_swings_from_a_pin_as_a_compound_pendulum() {
    for to_entity in [false, true] {
        let mut app = weighing();
        let angle = 0.5f32;
        let (mass, center) = PLATE.iter().zip(MASS).fold((0.0, Vec3::ZERO), |(m, c), (&x, mass)| (m + mass, c + Vec3::from(x) * mass));
        // At rest its centre of mass is below particle 0.
        let hanging = Quat::from_rotation_arc((center / mass - Vec3::from(PLATE[0])).normalize(), Vec3::NEG_Y);
        let body = plate(&mut app, Quat::from_rotation_z(angle) * hanging);
        let nail = place(&app, body, 0);
        let hand = app.world_mut().spawn(Transform::from_xyz(3.0, 1.0, 0.0).with_rotation(Quat::from_rotation_y(1.0))).id();
        let offset = Quat::from_rotation_y(-1.0) * (nail - Vec3::new(3.0, 1.0, 0.0));
        pin(&mut app, body, vec![if to_entity { Pin::to_entity(0, hand, offset) } else { Pin::at(0, nail) }]);
        let (inertia, distance) = about(&app, body, Vec3::from(PLATE[0]), Vec3::Z);
        let exact = closed_form(inertia, distance, G, angle);
        let got = period(&mut app, 900, |app| (app.world().get::<Transform>(body).unwrap().translation - nail).x);
        let out = (0..4).map(|i| place(&app, body, i).z.abs()).fold(0.0, f32::max);
        println!("pinned plate: {got} s, exact {exact} s, {out:.1e} m out of its plane");
        assert!((got / exact - 1.0).abs() < 1e-4, "{got} s against {exact} s");
        assert!(place(&app, body, 0).distance(nail) < 1e-5 && out < 1e-3);
    }
}

/// By two members: a hinge along the line through both, here sloping by 20°, from 90° aside.
#[test]
fn two_pins_are_a_hinge() {
    let mut app = weighing();
    let slope = Quat::from_rotation_z(20f32.to_radians());
    let axis = slope * Vec3::X;
    let angle = core::f32::consts::FRAC_PI_2;
    let body = plate(&mut app, Quat::from_axis_angle(axis, angle) * slope);
    let nails = [0, 1].map(|i| place(&app, body, i));
    pin(&mut app, body, vec![Pin::at(0, nails[0]), Pin::at(1, nails[1])]);
    let (inertia, distance) = about(&app, body, Vec3::from(PLATE[0]), Vec3::X);
    let exact = closed_form(inertia, distance, G * 20f32.to_radians().cos(), angle);
    let got = period(&mut app, 900, |app| (app.world().get::<Transform>(body).unwrap().translation - nails[0]).z);
    let turned = app.world().get::<ExplicitState>(body).unwrap().rotation(0).unwrap();
    println!("hinged plate: {got} s, exact {exact} s");
    assert!((got / exact - 1.0).abs() < 1e-3, "{got} s against {exact} s");
    assert!((turned * Vec3::X).distance(axis) < 1e-4, "its axis has turned to {}", turned * Vec3::X);
    for (i, nail) in nails.iter().enumerate() {
        assert!(place(&app, body, i).distance(*nail) < 1e-5);
    }
}

/// Its orientation alone: it falls without turning. Both: it stands out like a flag; and follows a hand that turns, rigidly.
#[test]
fn a_pinned_orientation_turns_the_group() {
    let mut app = weighing();
    let body = plate(&mut app, Quat::IDENTITY);
    pin(&mut app, body, vec![Pin { position: false, ..Pin::at(2, Vec3::ZERO).clamped() }]);
    let before: Vec<Vec3> = (0..4).map(|i| place(&app, body, i)).collect();
    app.world_mut().get_mut::<Particles>(body).unwrap().velocity[0] = Vec3A::new(0.0, 0.0, 2.0);
    steps(&mut app, 60);
    let dt = 1.0 / 1200.0;
    let way = Vec3::new(0.0, -0.5 * G * (1.0 + dt), 2.0 * MASS[0] / 5.0);
    for (i, x) in before.iter().enumerate() {
        assert!((place(&app, body, i) - *x).distance(way) < 2e-3, "particle {i}: {} against {way}", place(&app, body, i) - *x);
    }

    let mut app = weighing();
    let body = plate(&mut app, Quat::IDENTITY);
    let grip = place(&app, body, 1);
    let hand = app.world_mut().spawn(Transform::from_translation(grip)).id();
    pin(&mut app, body, vec![Pin::to_entity(1, hand, Vec3::ZERO).clamped()]);
    let before: Vec<Vec3> = (0..4).map(|i| place(&app, body, i)).collect();
    for step in 0..240 {
        if step >= 60 {
            let mut hand = app.world_mut().get_mut::<Transform>(hand).unwrap();
            hand.rotate_z(0.01);
            hand.translation.x += 0.005;
        }
        steps(&mut app, 1);
        let at = *app.world().get::<Transform>(hand).unwrap();
        for (i, x) in before.iter().enumerate() {
            let there = at.transform_point(*x - before[1]);
            assert!(place(&app, body, i).distance(there) < 1e-4, "step {step}, particle {i}: {} against {there}", place(&app, body, i));
        }
    }
}

/// At rest a pin bears the weight, the pinned particle's own included: it breaks at 1 % less and holds at 1 % more. Two pins share it by the lever. At the foot of its swing a pin bears m·g + m·d·ω².
#[test]
fn a_pin_on_a_group_breaks_at_what_it_bears() {
    let mass: f32 = MASS.iter().sum();
    let (center, weight) = (PLATE.iter().zip(MASS).map(|(&x, m)| Vec3::from(x) * m).sum::<Vec3>() / mass, mass * G);
    let hanging = Quat::from_rotation_arc((center - Vec3::from(PLATE[0])).normalize(), Vec3::NEG_Y);
    let run = |turn: Quat, pinned: &[u32], force: &dyn Fn(u32) -> f32, count: usize| {
        let mut app = weighing();
        let body = plate(&mut app, turn);
        let list = pinned.iter().map(|&i| Pin::at(i, place(&app, body, i as usize)).breaking_at(force(i))).collect();
        pin(&mut app, body, list);
        steps(&mut app, count);
        let left = app.world().get::<Pins>(body).unwrap().list.len();
        (app.world().resource::<Broken>().0.clone(), left)
    };
    let (broken, left) = run(hanging, &[0], &|_| 0.99 * weight, 60);
    println!("hanging: {broken:?} of {weight} N");
    assert_eq!((broken.len(), left), (1, 0));
    assert!((broken[0].2 / weight - 1.0).abs() < 1e-3, "{} N of {weight} N", broken[0].2);
    assert_eq!(run(hanging, &[0], &|_| 1.01 * weight, 300), (vec![], 1));
    // By the lever: what each of the upper corners bears.
    let share = |i: u32| weight * if i == 0 { 0.2 - center.x } else { 0.2 + center.x } / 0.4;
    let (broken, _) = run(Quat::IDENTITY, &[0, 1], &|i| if i == 1 { 0.99 * share(1) } else { f32::MAX }, 10);
    println!("two pins: {broken:?}, {} N", share(1));
    assert!(broken.len() == 1 && broken[0].1 == 1);
    assert_eq!(run(Quat::IDENTITY, &[0, 1], &|i| 1.01 * share(i), 300), (vec![], 2));

    let mut app = weighing();
    let body = plate(&mut app, hanging);
    let (inertia, distance) = about(&app, body, Vec3::from(PLATE[0]), Vec3::Z);
    let angle = 1.2f32;
    let most = weight * (1.0 + 2.0 * mass * distance * distance / inertia * (1.0 - angle.cos()));
    let swing = Quat::from_rotation_z(angle) * hanging;
    let (broken, _) = run(swing, &[0], &|_| 0.99 * most, 600);
    let quarter = closed_form(inertia, distance, G, angle) / 4.0;
    println!("swinging: {broken:?} of {most} N, a quarter period is {quarter} s");
    assert!(broken.len() == 1 && (broken[0].0 as f32 / 60.0 - quarter).abs() < 0.1);
    assert_eq!(run(swing, &[0], &|_| 1.01 * most, 600), (vec![], 1));
}

/// A lattice in one group that a blow opens.
fn deformable(dent: f32) -> ExplicitGroups {
    let deformable = Some(Deformable { speed: 2.0, time: 0.25, dent });
    ExplicitGroups { list: vec![ExplicitGroup { deformable, ..ExplicitGroup::rigid((0..27).collect::<Vec<_>>()) }] }
}

fn ball(app: &mut App, at: Vec3, velocity: Vec3) {
    let RapierWorld { bodies, colliders, .. } = &mut *app.world_mut().resource_mut::<RapierWorld>();
    let ball = bodies.insert(RigidBodyBuilder::dynamic().translation(at).linvel(velocity).gravity_scale(0.0));
    colliders.insert_with_parent(ColliderBuilder::ball(0.1).density(2000.0), ball, bodies);
}

fn is_open(app: &App, body: Entity) -> bool {
    app.world().get::<ExplicitState>(body).unwrap().is_open(0)
}

fn bent(app: &App, body: Entity) -> f32 {
    let turned = app.world().get::<ExplicitState>(body).unwrap().rotation(0).unwrap();
    fit_rigid(app.world().get::<Particles>(body).unwrap(), turned).largest
}

/// Struck while it hangs from a pin: it opens, the pin holds on, and closed again it is rigid, with the dent that plasticity left or without.
#[test]
fn a_blow_opens_a_pinned_group_and_the_pin_holds() {
    for (dent, clay) in [(0.0, false), (0.5, true)] {
        let mut app = simulation();
        let groups = (deformable(dent), ShapeMatching::new(Stiffness::hertz(8.0)));
        let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), groups)).id();
        if clay {
            app.world_mut().entity_mut(body).insert(Plasticity { yield_strain: 0.02, creep: 200.0, maximum: 0.5 });
        }
        // The middle of the top face.
        let nail = place(&app, body, 16);
        let to = PinTarget::World(nail, Quat::IDENTITY);
        pin(&mut app, body, vec![Pin::new(16, to)]);
        ball(&mut app, Vec3::new(-1.0, -0.1, 0.0), Vec3::X * 8.0);
        let (mut opened, mut closed, mut off, mut most) = (0, 0, 0.0f32, 0.0f32);
        for step in 1..=240 {
            steps(&mut app, 1);
            off = off.max(place(&app, body, 16).distance(nail));
            if is_open(&app, body) {
                opened = if opened == 0 { step } else { opened };
                most = most.max(bent(&app, body));
                closed = 0;
            } else if opened > 0 && closed == 0 {
                closed = step;
            }
        }
        let dented = bent(&app, body);
        println!("pinned, struck: open {opened} … {closed}, bent by {most}, left {dented}, pin off by {off:.1e} m");
        assert!(opened > 0 && closed > opened + 10);
        assert!(most > 0.01 && off < 1e-5);
        if clay {
            assert!(dented > 3e-3 && dented < 0.1, "{dented}");
        } else {
            assert!(dented < 1e-4, "{dented}");
        }
    }
}

/// Asleep on the floor it is struck: it wakes, opens, takes the dent, closes and sleeps again.
#[test]
fn a_blow_wakes_and_opens_a_sleeping_group() {
    let mut app = simulation();
    let floor = ColliderBuilder::cuboid(5.0, 0.5, 5.0).translation(Vec3::NEG_Y * 0.5).friction(0.8);
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(floor);
    let body = app
        .world_mut()
        .spawn((
            SoftBody::new(lattice(0.1)),
            Transform::from_xyz(0.0, 0.151, 0.0),
            deformable(0.5),
            PushRigidBodies,
            ShapeMatching::new(Stiffness::hertz(8.0)),
            Plasticity { yield_strain: 0.02, creep: 200.0, maximum: 0.5 },
        ))
        .id();
    let asleep = |app: &App| app.world().get::<Sleeping>(body).is_some();
    let until = |app: &mut App, what: &dyn Fn(&App) -> bool| {
        (0..1200).any(|_| {
            steps(app, 1);
            what(app)
        })
    };
    assert!(until(&mut app, &asleep), "it falls asleep");
    assert!(!is_open(&app, body) && bent(&app, body) < 1e-4);
    ball(&mut app, Vec3::new(0.0, 2.0, 0.0), Vec3::NEG_Y * 8.0);
    assert!(until(&mut app, &|app| is_open(app, body)), "the blow opens it");
    assert!(!asleep(&app));
    assert!(until(&mut app, &|app| !is_open(app, body)), "it closes");
    assert!(until(&mut app, &asleep), "it sleeps again");
    println!("asleep, struck: dent {}", bent(&app, body));
    assert!(bent(&app, body) > 3e-3);
    let before = app.world().get::<Particles>(body).unwrap().0.clone();
    steps(&mut app, 120);
    assert!(asleep(&app) && app.world().get::<Particles>(body).unwrap().0 == before);
}
