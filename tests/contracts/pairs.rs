//! Bodies do not pass through each other, nor, with `SelfContact`, through themselves.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{BodyPairs, Frozen, Particles, SelfPairs};
use polpo_rapier::RapierWorld;
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_scenes::octopus_asset;
use polpo_solver::{EllipsoidPair, momentum};
use polpo_tests::{lattice, simulation, state_of, steps};
use rapier3d::prelude::ColliderBuilder;

fn at_rate(app: &mut App, rate: f64) {
    app.insert_resource(Time::<Fixed>::from_hz(rate));
}

fn floor(app: &mut App) {
    app.world_mut()
        .resource_mut::<RapierWorld>()
        .insert_fixed(ColliderBuilder::cuboid(10.0, 1.0, 10.0).translation(Vec3::NEG_Y).friction(0.7));
}

/// Its own places in the world, and what it is made of.
fn ellipsoids(app: &App, body: Entity) -> Vec<(Vec3A, polpo_solver::Ellipsoid)> {
    let p = app.world().get::<Particles>(body).unwrap();
    let origin = Vec3A::from(app.world().get::<Transform>(body).unwrap().translation);
    (0..p.len()).map(|i| (p.position[i] + origin, p.ellipsoid(i))).collect()
}

/// The deepest overlap of any two particles of different bodies \[m\].
fn worst_depth(app: &App, bodies: &[Entity]) -> f32 {
    let all: Vec<_> = bodies.iter().map(|&b| ellipsoids(app, b)).collect();
    let mut worst = 0.0f32;
    for j in 0..all.len() {
        for i in 0..j {
            for (x, e) in &all[i] {
                for (y, f) in &all[j] {
                    if x.distance(*y) < e.bound() + f.bound() {
                        worst = worst.max(-EllipsoidPair::new(e, f, *y - *x).contact().gap);
                    }
                }
            }
        }
    }
    worst
}

fn speed(app: &App, body: Entity) -> f32 {
    app.world().get::<Particles>(body).unwrap().velocity.iter().map(|v| v.length()).fold(0.0, f32::max)
}

fn center(app: &App, body: Entity) -> Vec3 {
    app.world().get::<Transform>(body).unwrap().translation
}

fn chain(n: u32, radius: f32) -> Rig {
    let particle =
        |i| Particle { position: Vec3::X * (i as f32 * 2.0 * radius), frame: Quat::IDENTITY, radii: Vec3::splat(radius), mass: 0.05 };
    Rig { mesh_hash: MeshHash(0), particles: (0..n).map(particle).collect(), edges: (1..n).map(|i| [i - 1, i]).collect(), ..Rig::default() }
}

#[test]
fn two_jellies_come_to_rest_on_each_other() {
    for rate in [60.0, 240.0] {
        let mut app = simulation();
        at_rate(&mut app, rate);
        floor(&mut app);
        let bodies: Vec<Entity> = (0..2)
            .map(|i| {
                app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.02 * i as f32, 0.2 + 0.5 * i as f32, 0.0))).id()
            })
            .collect();
        let mut worst = 0.0f32;
        for _ in 0..(10.0 * rate) as usize {
            steps(&mut app, 1);
            worst = worst.max(worst_depth(&app, &bodies));
        }
        let speed = bodies.iter().map(|&b| speed(&app, b)).fold(0.0, f32::max);
        let rest = worst_depth(&app, &bodies);
        println!("{rate} Hz: deepest {worst:.1e} m, at rest {rest:.1e} m and {speed:.1e} m/s");
        assert!(worst < 0.1 * 0.05 && rest < 0.01 * 0.05, "{worst} m, at rest {rest} m deep");
        assert!(speed < 5e-3, "{speed} m/s");
        assert!(center(&app, bodies[1]).y - center(&app, bodies[0]).y > 0.25);
        let pairs = app.world().resource::<BodyPairs>();
        let mut sorted = [bodies[0], bodies[1]];
        sorted.sort();
        assert!(pairs.iter().len() == 1 && pairs.iter().all(|pair| pair.touch() && pair.bodies() == sorted));
        assert!(!pairs.iter().next().unwrap().pairs().is_empty());
    }
}

#[test]
fn without_the_component_or_in_other_layers_bodies_pass() {
    for layers in [None, Some(2)] {
        let mut app = simulation();
        app.insert_resource(Gravity(Vec3::ZERO));
        let mut spawn = |x: f32, v: f32| {
            app.world_mut()
                .spawn((
                    SoftBody::new(lattice(0.1)),
                    Transform::from_xyz(x, 0.0, 0.0),
                    InitialVelocity { linear: Vec3::X * v, ..default() },
                    BodyContact { filter: layers.unwrap_or(u32::MAX), ..default() },
                ))
                .id()
        };
        let (a, b) = (spawn(-0.5, 2.0), spawn(0.5, -2.0));
        if layers.is_none() {
            app.world_mut().entity_mut(a).remove::<BodyContact>();
        }
        steps(&mut app, 30);
        assert!(center(&app, a).x > 0.4 && center(&app, b).x < -0.4);
        assert_eq!(app.world().resource::<BodyPairs>().iter().len(), 0);
    }
}

/// 50 m/s are three bodies a step.
#[test]
fn a_fast_body_does_not_pass_through_another() {
    for (scale, aim) in [(1.0, 0.0), (1.0, 0.07), (0.3, 0.05)] {
        let mut app = simulation();
        app.insert_resource(Gravity(Vec3::ZERO));
        let still = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::IDENTITY)).id();
        let fast = app
            .world_mut()
            .spawn((
                SoftBody::new(lattice(0.1)),
                Transform::from_xyz(-3.1, aim, 0.03).with_scale(Vec3::splat(scale)),
                InitialVelocity { linear: Vec3::X * 50.0, ..default() },
            ))
            .id();
        let before: Vec<_> = [still, fast].iter().map(|&b| momentum(app.world().get::<Particles>(b).unwrap())).collect();
        steps(&mut app, 60);
        let after: Vec<_> = [still, fast].iter().map(|&b| momentum(app.world().get::<Particles>(b).unwrap())).collect();
        let (a, b) = (center(&app, still), center(&app, fast));
        println!("scale {scale}, aim {aim}: {a} and {b}, deepest {}", worst_depth(&app, &[still, fast]));
        assert!(a.x > b.x, "{a} {b}");
        let (p, q) = (before[0].linear + before[1].linear, after[0].linear + after[1].linear);
        assert!(p.distance(q) < 1e-5 * p.length(), "{p} {q}");
        assert!(a.is_finite() && a.length() < 60.0);
    }
}

/// Two octopuses meet off their middles, turning, far from any collider.
#[test]
fn a_collision_keeps_momentum() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let (_, rig) = octopus_asset();
    let mut spawn = |x: f32, y: f32, v: f32, w: f32| {
        app.world_mut()
            .spawn((
                SoftBody::new(rig.clone()),
                SelfContact::default(),
                Transform::from_xyz(x, y, 0.0),
                InitialVelocity { linear: Vec3::X * v, angular: Vec3::Y * w },
            ))
            .id()
    };
    let bodies = [spawn(-1.0, 0.2, 3.0, 1.0), spawn(1.0, 0.0, -3.0, 2.0)];
    // P, L about the world's origin, energy, and scales.
    let total = |app: &App| {
        let (mut p, mut l, mut e) = (Vec3A::ZERO, Vec3A::ZERO, 0.0);
        for body in bodies {
            let m = momentum(app.world().get::<Particles>(body).unwrap());
            p += m.linear;
            l += m.angular + (m.center + Vec3A::from(center(app, body))).cross(m.linear);
            e += m.kinetic_energy;
        }
        (p, l, e)
    };
    let before = total(&app);
    let (mut touched, mut size) = (0, Vec2::ZERO);
    for &body in &bodies {
        let m = momentum(app.world().get::<Particles>(body).unwrap());
        size += Vec2::new(m.linear.length(), m.angular.length());
    }
    for _ in 0..120 {
        steps(&mut app, 1);
        touched += usize::from(app.world().resource::<BodyPairs>().iter().any(|pair| pair.touch()));
    }
    let after = total(&app);
    let (p, l) = (before.0.distance(after.0) / size.x, before.1.distance(after.1) / before.1.length());
    println!("touched in {touched} steps; P off by {p:.1e}, L by {l:.1e}, {:.2} of the energy left", after.2 / before.2);
    assert!(touched > 5);
    assert!(p < 1e-6 && l < 2e-5, "P off by {p}, L by {l}");
    assert!(after.2 < before.2);
}

/// Fully, all but fully, half and a corner inside each other, at three rates: apart in two seconds, and no particle ever faster than three times the push speed.
#[test]
fn what_is_spawned_inside_another_leaves_it_without_an_explosion() {
    for rate in [30.0, 60.0, 240.0] {
        for offset in
            [Vec3::ZERO, Vec3::new(0.05, 0.05, 0.05), Vec3::new(0.15, 0.0, 0.0), Vec3::new(0.17, 0.2, -0.11), Vec3::new(0.0, -0.25, 0.04)]
        {
            let mut app = simulation();
            at_rate(&mut app, rate);
            app.insert_resource(Gravity(Vec3::ZERO));
            let bodies =
                [Vec3::ZERO, offset].map(|at| app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_translation(at))).id());
            let mut fastest = 0.0f32;
            let mut parted = f32::NAN;
            for k in 0..(2.0 * rate) as usize {
                steps(&mut app, 1);
                fastest = bodies.iter().map(|&b| speed(&app, b)).fold(fastest, f32::max);
                if parted.is_nan() && worst_depth(&app, &bodies) < 1e-3 {
                    parted = k as f32 / rate as f32;
                }
            }
            let depth = worst_depth(&app, &bodies);
            let apart = center(&app, bodies[0]).distance(center(&app, bodies[1]));
            println!(
                "{rate} Hz, {offset}: apart after {parted:.2} s, fastest {fastest:.2} m/s, then {apart:.2} m apart, {depth:.1e} m deep"
            );
            assert!(parted < 1.0 && depth < 1e-3, "{depth} m deep");
            // What they are deformed by on their way out springs back.
            assert!(fastest < 9.0, "{fastest} m/s");
        }
    }
}

/// A loose chain let down onto the ground end first: with self-contact it lies in a heap, link upon link, without it in itself.
#[test]
fn a_chain_lies_on_itself() {
    let overlap = |contact: bool, upright: f32| {
        let mut app = simulation();
        floor(&mut app);
        let turn = Quat::from_rotation_z(core::f32::consts::FRAC_PI_2 * upright);
        let body = app.world_mut().spawn((SoftBody::new(chain(24, 0.05)), Transform::from_xyz(0.0, 0.2, 0.0).with_rotation(turn))).id();
        app.world_mut().entity_mut(body).remove::<(ShapeMatching, Torsion)>();
        app.world_mut().entity_mut(body).insert(DistanceConstraints::new(Stiffness::hertz(60.0)));
        if contact {
            app.world_mut().entity_mut(body).insert(SelfContact::default());
        }
        let mut worst = 0.0f32;
        for k in 0..240 {
            steps(&mut app, 1);
            if k > 60 {
                let all = ellipsoids(&app, body);
                for j in 0..all.len() {
                    for i in 0..j.saturating_sub(1) {
                        worst = worst.max(-EllipsoidPair::new(&all[i].1, &all[j].1, all[j].0 - all[i].0).contact().gap);
                    }
                }
            }
        }
        assert_eq!(app.world().get::<SelfPairs>(body).is_some(), contact);
        assert!(app.world().get::<Particles>(body).unwrap().is_finite());
        worst / 0.1
    };
    // How a chain falls hangs on a hair; what its links do to each other at worst does too.
    let mut with: Vec<f32> = (0..5).map(|k| overlap(true, 0.96 + 0.005 * k as f32)).collect();
    let without = overlap(false, 0.97);
    with.sort_by(f32::total_cmp);
    println!("deepest overlap, of a diameter: {with:.3?} with self-contact, {without:.3} without");
    assert!(with[2] < 0.2 && with[4] < 0.4 && without > 0.5, "{with:?} {without}");
}

/// A soft, tumbling octopus that touches itself all the time keeps its momentum.
#[test]
fn self_contact_does_not_move_the_body() {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    let (_, rig) = octopus_asset();
    let body = app
        .world_mut()
        .spawn((
            SoftBody::new(rig),
            SelfContact::default(),
            ShapeMatching::new(Stiffness::hertz(2.0)),
            InitialVelocity { linear: Vec3::new(1.0, 2.0, 0.0), angular: Vec3::new(0.5, 1.0, 0.2) },
        ))
        .id();
    // Pressed together to four tenths of its width, arm upon arm.
    for x in &mut app.world_mut().get_mut::<Particles>(body).unwrap().position {
        x.x *= 0.4;
    }
    let before = momentum(app.world().get::<Particles>(body).unwrap());
    let mut touched = 0;
    for _ in 0..300 {
        steps(&mut app, 1);
        touched += app.world().get::<SelfPairs>(body).unwrap().pairs().iter().filter(|pair| pair.touching).count();
    }
    let after = momentum(app.world().get::<Particles>(body).unwrap());
    let (p, l) =
        (before.linear.distance(after.linear) / before.linear.length(), before.angular.distance(after.angular) / before.angular.length());
    println!("{touched} touches in 5 s; P off by {p:.1e}, L by {l:.1e}");
    assert!(touched > 300);
    assert!(p < 1e-5 && l < 2e-4, "P off by {p}, L by {l}");
}

/// One slab slides on another, which is held: v₀²/(2μg) = 0.5097 m at 2 m/s and μ = 0.4.
#[test]
fn a_slab_stops_on_another_where_coulomb_says() {
    let slab = |size: [i32; 2], lift: f32| {
        let mut rig = Rig { mesh_hash: MeshHash(0), particles: vec![], edges: vec![], ..Rig::default() };
        for z in 0..size[1] {
            for x in 0..size[0] {
                // Flat and wide, so that their tops are all but a plane.
                let position = Vec3::new(x as f32 * 0.1, lift, z as f32 * 0.1);
                rig.particles.push(Particle { position, frame: Quat::IDENTITY, radii: Vec3::new(0.2, 0.02, 0.2), mass: 0.1 });
            }
        }
        let p = &rig.particles;
        for i in 0..p.len() {
            for j in i + 1..p.len() {
                if p[i].position.distance(p[j].position) < 0.15 {
                    rig.edges.push([i as u32, j as u32]);
                }
            }
        }
        rig
    };
    let mut app = simulation();
    let contact = BodyContact { friction: 0.4, ..default() };
    let table = app.world_mut().spawn((SoftBody::new(slab([14, 4], 0.0)), contact)).id();
    let origin = center(&app, table);
    let pins = app.world().get::<Particles>(table).unwrap().position.iter().enumerate();
    let pins = pins.map(|(i, x)| Pin::at(i as u32, origin + Vec3::from(*x)).clamped()).collect();
    app.world_mut().entity_mut(table).insert(Pins { list: pins });
    let block = app.world_mut().spawn((SoftBody::new(slab([3, 3], 0.0)), contact, Transform::from_xyz(0.2, 0.0395, 0.05))).id();
    steps(&mut app, 30);
    let start = center(&app, block);
    for v in &mut app.world_mut().get_mut::<Particles>(block).unwrap().velocity {
        v.x += 2.0;
    }
    steps(&mut app, 90);
    let way = center(&app, block).x - start.x;
    let exact = 2.0 * 2.0 / (2.0 * 0.4 * 9.81);
    println!("slid {way} m, by Coulomb {exact} m; still at {} m/s", speed(&app, block));
    assert!((way / exact - 1.0).abs() < 0.05, "{way} m against {exact} m");
    assert!(speed(&app, block) < 5e-3);
}

#[test]
fn a_frozen_body_is_an_obstacle() {
    let mut app = simulation();
    let still = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Frozen)).id();
    app.world_mut().entity_mut(still).insert(Frozen);
    let other = app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.0, 0.4, 0.0))).id();
    let before = app.world().get::<Particles>(still).unwrap().0.clone();
    steps(&mut app, 60);
    assert_eq!(app.world().get::<Particles>(still).unwrap().0, before);
    assert!((center(&app, other).y - 0.3).abs() < 0.03, "{}", center(&app, other));
}

/// 8 km out, where a float is half a millimetre, they meet as at home.
#[test]
fn far_out_bodies_meet_as_at_home() {
    let run = |at: Vec3| {
        let mut app = simulation();
        app.insert_resource(Gravity(Vec3::ZERO));
        let bodies = [(-0.25, 1.0), (0.25, -1.0)].map(|(x, v)| {
            let velocity = InitialVelocity { linear: Vec3::X * v, ..default() };
            app.world_mut()
                .spawn((SoftBody::new(lattice(0.1)), Transform::from_translation(at + Vec3::new(x, 0.0625 * x, 0.0)), velocity))
                .id()
        });
        steps(&mut app, 60);
        [center(&app, bodies[0]) - at, center(&app, bodies[1]) - at]
    };
    let home = run(Vec3::ZERO);
    let far = run(Vec3::new(8192.0, 0.0, -8192.0));
    for k in 0..2 {
        assert!(home[k].distance(far[k]) < 5e-3, "{} {}", home[k], far[k]);
    }
    assert!(home[1].x - home[0].x > 0.25);
}

#[test]
fn nonsense_does_not_panic() {
    for value in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30] {
        let mut app = simulation();
        let bodies = [0.0, 0.2].map(|x| {
            let contact = BodyContact { friction: value, push_speed: value, ..default() };
            let own = SelfContact { friction: value, push_speed: value };
            app.world_mut().spawn((SoftBody::new(lattice(0.1)), contact, own, Transform::from_xyz(x, 0.0, 0.0))).id()
        });
        steps(&mut app, 5);
        app.world_mut().get_mut::<Particles>(bodies[0]).unwrap().position[3].x = value;
        steps(&mut app, 5);
        assert!(app.world().get::<Particles>(bodies[1]).unwrap().is_finite(), "{value}");
    }
}

/// A negative speed, or none, leaves an overlap as it is; it does not deepen it, nor undo it at once. Of two particles of one body and of two bodies.
#[test]
fn a_push_speed_that_is_none_pushes_no_pair() {
    let ball = |x: f32| Particle { position: Vec3::X * x, frame: Quat::IDENTITY, radii: Vec3::splat(0.1), mass: 1.0 };
    let rig =
        |at: &[f32]| Rig { mesh_hash: MeshHash(0), particles: at.iter().map(|&x| ball(x)).collect(), edges: vec![], ..Rig::default() };
    for within in [true, false] {
        let run = |push_speed: f32| {
            let mut app = simulation();
            app.insert_resource(Gravity(Vec3::ZERO));
            if within {
                let own = SelfContact { push_speed, ..default() };
                let body = app.world_mut().spawn((SoftBody::new(rig(&[-1.0, 1.0])), own)).id();
                app.world_mut().get_mut::<Particles>(body).unwrap().position = vec![Vec3A::X * -0.05, Vec3A::X * 0.05];
            } else {
                for x in [-0.05, 0.05] {
                    let contact = BodyContact { push_speed, ..default() };
                    app.world_mut().spawn((SoftBody::new(rig(&[0.0])), contact, Transform::from_xyz(x, 0.0, 0.0)));
                }
            }
            steps(&mut app, 2);
            state_of(app.world_mut())
        };
        let still = run(0.0);
        assert_ne!(run(3.0), still, "within {within}");
        assert_eq!(run(-5.0), still, "within {within}");
        assert_eq!(run(f32::NAN), still, "within {within}");
    }
}

/// Four octopuses dropped onto each other: they stay finite, come to rest and stay where they are, though not each of their particles is without speed: a light one wedged between others is given one by the last of
/// them that pushes it, and is pushed back by the next.
#[test]
fn a_heap_of_octopuses_stays_where_it_lies() {
    for own in [false, true] {
        let mut app = simulation();
        floor(&mut app);
        let (_, rig) = octopus_asset();
        let bodies: Vec<Entity> = (0..4)
            .map(|k| {
                let place = Transform::from_xyz(0.1 * k as f32, 0.6 + 0.8 * k as f32, 0.05 * k as f32)
                    .with_rotation(Quat::from_rotation_y(k as f32));
                let body = app.world_mut().spawn((SoftBody::new(rig.clone()), place)).id();
                if own {
                    app.world_mut().entity_mut(body).insert(SelfContact::default());
                }
                body
            })
            .collect();
        let places = |app: &App| -> Vec<Vec3A> { bodies.iter().flat_map(|&b| ellipsoids(app, b)).map(|(x, _)| x).collect() };
        let mut worst = 0.0f32;
        for k in 0..720 {
            steps(&mut app, 1);
            if k % 60 == 0 {
                worst = worst.max(worst_depth(&app, &bodies));
            }
        }
        let before = places(&app);
        let centers: Vec<Vec3> = bodies.iter().map(|&b| center(&app, b)).collect();
        steps(&mut app, 120);
        let after = places(&app);
        let crept: f32 = before.iter().zip(&after).map(|(x, y)| x.distance(*y)).fold(0.0, f32::max);
        let moved = bodies.iter().zip(&centers).map(|(&b, x)| center(&app, b).distance(*x)).fold(0.0, f32::max);
        let fastest = bodies.iter().map(|&b| speed(&app, b)).fold(0.0, f32::max);
        let energy: f32 = bodies.iter().map(|&b| momentum(app.world().get::<Particles>(b).unwrap()).kinetic_energy).sum();
        let depth = worst_depth(&app, &bodies);
        println!(
            "self {own}: in 2 s a particle moved by {crept:.1e} m, a body by {moved:.1e} m; fastest {fastest:.2} m/s, {energy:.1e} J; {worst:.1e} m deep, at rest {depth:.1e} m"
        );
        assert!(bodies.iter().all(|&b| app.world().get::<Frozen>(b).is_none()));
        assert!(centers.iter().all(|x| x.is_finite() && x.y > 0.0));
        assert!(moved < 0.005 && crept < 0.04, "{moved} m, {crept} m");
        // The median radius is 0.02 m. Those light ones in the heap's wedges are pressed in by about as much: two passes do not carry a heavy body's weight through them.
        assert!(depth < 0.03, "{depth} m");
    }
}
