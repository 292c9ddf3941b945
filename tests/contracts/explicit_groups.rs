//! Explicit groups in the whole step: true rigid bodies, joints, motors, dents, and what is refused.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{CapabilityRejected, Deformable, Drive, ExplicitGroup, ExplicitGroups, ExplicitState, Motor, Particles, Plasticity};
use polpo_rapier::RapierWorld;
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_solver::{fit_rigid, momentum};
use polpo_tests::{lattice, simulation, steps};
use rapier3d::prelude::ColliderBuilder;

fn rig(at: &[Vec3], radius: impl Fn(usize) -> f32, edges: Vec<[u32; 2]>) -> Rig {
    let particle = |(i, &position): (usize, &Vec3)| Particle { position, frame: Quat::IDENTITY, radii: Vec3::splat(radius(i)), mass: 1.0 };
    Rig { mesh_hash: MeshHash(0), particles: at.iter().enumerate().map(particle).collect(), edges, ..Rig::default() }
}

fn all(count: u32) -> ExplicitGroups {
    ExplicitGroups { list: vec![ExplicitGroup::rigid((0..count).collect::<Vec<_>>())] }
}

fn particles(app: &App, body: Entity) -> &Particles {
    app.world().get::<Particles>(body).unwrap()
}

fn floor(app: &mut App) {
    let floor = ColliderBuilder::cuboid(50.0, 0.5, 50.0).translation(Vec3::Y * -0.5).friction(0.8);
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(floor);
}

/// Euler's equations say when ω_y of the free asymmetric top crosses zero. Sampled at 60 Hz, the crossing is found by a straight line.
#[test]
fn a_free_top_turns_over_in_time() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO)).insert_resource(SolverSettings { substeps: 20, iterations: 2, ..default() });
    let at = [Vec3::X, -Vec3::X, Vec3::Y * 0.8, Vec3::Y * -0.8, Vec3::Z * 0.5, Vec3::Z * -0.5];
    // Edges that tie everything to everything must not get in the way, nor damping.
    let edges = (0..6).flat_map(|i| (i + 1..6).map(move |j| [i, j])).collect();
    let spin = InitialVelocity { linear: Vec3::ZERO, angular: Vec3::new(0.1, 5.0, 0.0) };
    let body = app.world_mut().spawn((SoftBody::new(rig(&at, |_| 1e-3, edges)), spin, all(6))).id();
    let (mut last, mut crossings) = (5.0f32, Vec::new());
    for k in 1..=1020 {
        steps(&mut app, 1);
        let q = app.world().get::<ExplicitState>(body).unwrap().rotation(0).unwrap();
        let y = (q.inverse() * particles(&app, body).angular_velocity[0]).y;
        if last * y < 0.0 {
            crossings.push((k as f32 - 1.0 + last / (last - y)) / 60.0);
        }
        last = y;
    }
    println!("top: {crossings:?}");
    assert_eq!(crossings.len(), 3);
    for (got, exact) in crossings.iter().zip([3.31495, 9.9449, 16.5748]) {
        assert!((got - exact).abs() < 1e-3, "{got} s against {exact} s");
    }
}

#[test]
fn a_wheel_keeps_its_spin_for_ten_seconds() {
    for (substeps, iterations) in [(1, 1), (5, 3), (20, 1)] {
        let mut app = simulation();
        app.insert_resource(Gravity(Vec3::ZERO)).insert_resource(SolverSettings { substeps, iterations, ..default() });
        let at: Vec<Vec3> = (0..12).map(|i| Quat::from_rotation_z(i as f32 * core::f32::consts::PI / 6.0) * Vec3::X * 0.4).collect();
        let edges = (0..11).map(|i| [i, i + 1]).collect();
        let spin = InitialVelocity { linear: Vec3::X, angular: Vec3::Z * 10.0 };
        let body = app.world_mut().spawn((SoftBody::new(rig(&at, |_| 0.05, edges)), spin, all(12))).id();
        steps(&mut app, 600);
        let omega = particles(&app, body).angular_velocity[3];
        println!("wheel × {substeps} × {iterations}: {omega}");
        assert!(omega.distance(Vec3A::Z * 10.0) < 1e-3, "{omega}");
    }
}

/// The ball of the solver's test, with Rapier's floor and gravity leaning by 20°: a = g·sin/(1 + k).
#[test]
fn a_weighted_ball_rolls_down_a_slope() {
    let mut app = simulation();
    floor(&mut app);
    let (sin, cos) = (20f32.to_radians().sin(), 20f32.to_radians().cos());
    app.insert_resource(Gravity(Vec3::new(sin, -cos, 0.0) * 9.81));
    let mut at = vec![Vec3::ZERO];
    at.extend([Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|x| [x * 0.2, x * -0.2]));
    let place = Transform::from_xyz(0.0, 0.5, 0.0);
    let body = app.world_mut().spawn((SoftBody::new(rig(&at, |i| if i == 0 { 0.5 } else { 0.1 }, vec![])), place, all(7))).id();
    steps(&mut app, 60);
    let p = particles(&app, body);
    let k = (p.inertia.iter().sum::<f32>() + 4.0 * 0.04) / (7.0 * 0.25);
    let (got, exact) = (p.velocity[0].x, 9.81 * sin / (1.0 + k));
    println!("slope: {got} against {exact} m/s");
    assert!((got / exact - 1.0).abs() < 1e-3, "{got} against {exact}");
}

/// A wheel on a frame with two shared particles for an axle. Its motor is set anew while it runs.
#[test]
fn a_motor_reaches_its_speed_and_pushes_back() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let at = [[0.0, 0.0, -0.1], [0.0, 0.0, 0.1], [0.3, 0.0, 0.0], [-0.3, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, -0.5, 0.05]].map(Vec3::from);
    let motor = |target| Some(Motor { axis: Vec3A::Z, drive: Drive::Speed { target, max_torque: 5.0 }, against: Some(1) });
    let list = vec![ExplicitGroup { motor: motor(20.0), ..ExplicitGroup::rigid([0, 1, 2, 3]) }, ExplicitGroup::rigid([0, 1, 4, 5])];
    let body = app.world_mut().spawn((SoftBody::new(rig(&at, |_| 0.05, vec![[0, 1]])), ExplicitGroups { list })).id();
    for target in [20.0, -5.0] {
        app.world_mut().get_mut::<ExplicitGroups>(body).unwrap().list[0].motor = motor(target);
        let turned = app.world().get::<ExplicitState>(body).map(|s| s.rotation(0).unwrap());
        steps(&mut app, 1);
        if let Some(before) = turned {
            let now = app.world().get::<ExplicitState>(body).unwrap().rotation(0).unwrap();
            assert!(now.angle_between(before) < 0.5, "what turns goes on turning");
        }
        steps(&mut app, 240);
        let p = particles(&app, body);
        let speed = (p.rotation[2] * Vec3A::Z).dot(p.angular_velocity[2] - p.angular_velocity[4]);
        let m = momentum(p);
        println!("motor: {speed} of {target} rad/s, P {}, L {}", m.linear, m.angular);
        assert!((speed - target).abs() < 0.02 && p.angular_velocity[4].length() > 0.2);
        assert!(m.linear.length() < 1e-4 && m.angular.length() < 1e-4);
        for (i, j) in [(0, 2), (1, 3), (0, 4), (1, 5)] {
            assert!((p.position[i].distance(p.position[j]) - at[i].distance(at[j])).abs() < 1e-4, "the axle holds");
        }
    }
}

/// Dropped fast, the block opens, its soft inside takes the dent and the closed block keeps it; dropped gently, it does not.
#[test]
fn a_dent_stays() {
    let fallen = |speed: f32, dent: f32| {
        let mut app = simulation();
        floor(&mut app);
        let deformable = Some(Deformable { speed: 4.0, time: 0.1, dent });
        let list = vec![ExplicitGroup { deformable, ..ExplicitGroup::rigid((0..27).collect::<Vec<_>>()) }];
        let body = app
            .world_mut()
            .spawn((
                SoftBody::new(lattice(0.1)),
                Transform::from_xyz(0.0, 0.2, 0.0),
                InitialVelocity { linear: Vec3::Y * -speed, angular: Vec3::ZERO },
                ShapeMatching::new(Stiffness::hertz(8.0)),
                Plasticity { yield_strain: 0.05, creep: 200.0, maximum: 0.5 },
                ExplicitGroups { list },
            ))
            .id();
        let mut opened = false;
        for _ in 0..120 {
            steps(&mut app, 1);
            opened |= app.world().get::<ExplicitState>(body).unwrap().is_open(0);
        }
        let state = app.world().get::<ExplicitState>(body).unwrap();
        assert!(!state.is_open(0));
        (opened, fit_rigid(particles(&app, body), state.rotation(0).unwrap()).largest)
    };
    let (fast, springs, gentle) = (fallen(8.0, 0.4), fallen(8.0, 0.0), fallen(1.0, 0.4));
    println!("dents: {fast:?}, {springs:?}, {gentle:?}");
    assert!(fast.0 && fast.1 > 5e-3 && fast.1 < 0.1);
    assert!(springs.0 && springs.1 < 1e-4);
    assert!(!gentle.0 && gentle.1 < 1e-4);
}

/// Two groups on either side of the origin, each as far from it as `distance` \[m\], that come towards each other, each at `speed` \[m/s\].
fn two_that_meet(deformable: Deformable, distance: f32, speed: f32) -> (App, [Entity; 2]) {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let mut group = ExplicitGroup::rigid((0..27).collect::<Vec<_>>());
    group.deformable = Some(deformable);
    let groups = ExplicitGroups { list: vec![group] };
    let bodies = [-1.0f32, 1.0].map(|side| {
        let velocity = InitialVelocity { linear: Vec3::X * (-side * speed), angular: Vec3::ZERO };
        let place = Transform::from_xyz(distance * side, 0.0, 0.0);
        app.world_mut().spawn((SoftBody::new(lattice(0.1)), place, velocity, groups.clone())).id()
    });
    (app, bodies)
}

/// Two of them meet in the air: above the speed that opens them they do, below they bounce off as they are.
#[test]
fn a_blow_from_another_body_opens_a_group() {
    let opens = |speed: f32| {
        let (mut app, bodies) = two_that_meet(Deformable { speed: 2.0, time: 0.2, dent: 0.5 }, 0.2, speed);
        let mut opened = [false; 2];
        for _ in 0..30 {
            steps(&mut app, 1);
            for (opened, body) in opened.iter_mut().zip(bodies) {
                *opened |= app.world().get::<ExplicitState>(body).unwrap().is_open(0);
            }
        }
        opened
    };
    assert_eq!(opens(3.0), [true; 2]);
    assert_eq!(opens(0.5), [false; 2]);
}

/// The time counts from the blow, however long the two then lie against each other: struck in the first of five substeps, a group that opens for two and a half is closed again at the step's end.
#[test]
fn a_group_is_open_for_its_time_from_the_blow_on() {
    let is_open = |time: f32| {
        // What comes after, and is a blow too, at 5.4 m/s: the rest of the bodies, which the first layers stop.
        let (mut app, bodies) = two_that_meet(Deformable { speed: 5.7, time, dent: 0.5 }, 0.1501, 3.0);
        steps(&mut app, 1);
        bodies.map(|body| app.world().get::<ExplicitState>(body).unwrap().is_open(0))
    };
    assert_eq!(is_open(5.5 / 300.0), [true; 2]);
    assert_eq!(is_open(2.5 / 300.0), [false; 2]);
}

#[test]
fn bad_groups_are_refused_by_name_and_leave_nothing() {
    #[derive(Resource, Default)]
    struct Told(Vec<String>);
    let mut app = simulation();
    app.init_resource::<Told>().add_observer(|event: On<CapabilityRejected>, mut told: ResMut<Told>| {
        told.0.push(format!("{}: {}", event.component, event.reason))
    });
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), all(28))).id();
    steps(&mut app, 2);
    // While it runs, too.
    app.world_mut().entity_mut(body).insert(all(27));
    steps(&mut app, 2);
    assert!(app.world().entity(body).contains::<ExplicitState>());
    app.world_mut().get_mut::<ExplicitGroups>(body).unwrap().list[0].scale = f32::NAN;
    steps(&mut app, 2);
    let told = &app.world().resource::<Told>().0;
    assert_eq!(
        *told,
        [
            "ExplicitGroups: group 0: particle 27 is not among the 27 there are",
            "ExplicitGroups: group 0: the rest scale is NaN, not positive and normal"
        ]
    );
    steps(&mut app, 2);
    assert!(!app.world().entity(body).contains::<ExplicitGroups>() && !app.world().entity(body).contains::<ExplicitState>());
    assert!(particles(&app, body).velocity[0].y < -0.5 && particles(&app, body).is_finite(), "it falls on");
}

/// With its groups taken away, a body is what it would be without.
#[test]
fn groups_that_are_gone_leave_nothing() {
    let run = |with: bool| {
        let mut app = simulation();
        let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
        if with {
            app.world_mut().entity_mut(body).insert(all(27));
            app.world_mut().entity_mut(body).remove::<ExplicitGroups>();
        }
        steps(&mut app, 1);
        app.world_mut().get_mut::<Particles>(body).unwrap().position[3].x += 0.05;
        steps(&mut app, 30);
        assert!(!app.world().entity(body).contains::<ExplicitState>());
        particles(&app, body).0.clone()
    };
    assert_eq!(run(false), run(true));
}
