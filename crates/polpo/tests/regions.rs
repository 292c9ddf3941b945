//! A rig's regions make a body's groups, stiffness and friction, unless it has its own.

use bevy::math::Vec3A;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::prelude::*;
use polpo::{Contacts, ExplicitGroup, ExplicitGroups, ExplicitState, ParticleFriction, ParticleStiffness, Particles};
use polpo_rig::{EdgeAmount, GroupKind, Mesh, MeshPart, Recipe, RegionRule, Rig, Spring, Within, build_rig};
use polpo_solver::Contact;

/// The table that everything stands on, at height 0: its friction times the particle's.
#[derive(Resource)]
struct Table(f32);

fn lie_on_the_table(table: Res<Table>, mut bodies: Query<(&Particles, &Transform, &Collision, Option<&ParticleFriction>, &mut Contacts)>) {
    for (particles, transform, collision, each, mut contacts) in &mut bodies {
        contacts.list.clear();
        let friction = |i: usize| each.and_then(|each| each.0.get(i)).copied().unwrap_or(collision.friction);
        contacts.list.extend((0..particles.len()).map(|i| Contact {
            particle: i as u32,
            friction: table.0 * friction(i),
            point: Vec3A::NEG_Y * transform.translation.y,
            normal: Vec3A::Y,
            velocity: Vec3A::ZERO,
            angular_velocity: Vec3A::ZERO,
            impulse: 0.0,
        }));
    }
}

fn app() -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, PolpoPlugin::default()))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Time::<Fixed>::from_hz(60.0));
    app.finish();
    app.update();
    app
}

fn steps(app: &mut App, count: usize) {
    (0..count).for_each(|_| app.update());
}

/// Adds a box to a mesh, as a part of its own.
fn add_box(mesh: &mut Mesh, node: &str, min: Vec3, size: Vec3) {
    let [v, t] = [mesh.positions.len() as u32, mesh.triangles.len() as u32];
    mesh.positions.extend((0..8).map(|i| min + size * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)));
    mesh.normals.resize(mesh.positions.len(), Vec3::Y);
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    mesh.triangles.extend(faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).map(|t| t.map(|c: u32| v + c)));
    let (vertices, triangles) = (v..v + 8, t..t + 12);
    mesh.parts.push(MeshPart { node: node.into(), vertices, triangles, ..MeshPart::default() });
}

fn rule(name: &str) -> RegionRule {
    RegionRule { name: name.into(), ..RegionRule::default() }
}

fn truck() -> Rig {
    let mut mesh = Mesh { name: "truck".into(), ..Mesh::default() };
    add_box(&mut mesh, "Chassis", Vec3::Y * 0.5, Vec3::new(3.0, 0.5, 1.0));
    for (i, [x, z]) in [[0.2, 0.0], [0.2, 0.7], [2.3, 0.0], [2.3, 0.7]].into_iter().enumerate() {
        add_box(&mut mesh, &format!("Wheel {i}"), Vec3::new(x, 0.0, z), Vec3::new(0.5, 0.5, 0.3));
    }
    let wheels = RegionRule { node: Some("Wheel*".into()), group: Some(GroupKind::Rigid), friction: Some(0.9), ..rule("wheels") };
    build_rig(&mesh, &Recipe { regions: vec![wheels], edges: EdgeAmount::PerParticle(4.0), ..Recipe::with_particles(60) }).unwrap()
}

#[test]
fn a_truck_stands_on_its_four_wheels() {
    let mut app = app();
    app.insert_resource(Table(1.0)).add_systems(FixedPostUpdate, lie_on_the_table.in_set(PolpoSystems::DetectContacts));
    let rig = truck();
    let body = app.world_mut().spawn((SoftBody::new(rig.clone()), Transform::from_xyz(0.0, 0.1, 0.0))).id();
    steps(&mut app, 180);
    let list = app.world().get::<ExplicitGroups>(body).unwrap().list.clone();
    let wheels: Vec<&Vec<u32>> = rig.regions.iter().map(|region| &region.particles).collect();
    assert_eq!(wheels.len(), 4);
    assert_eq!(list, wheels.iter().map(|wheel| ExplicitGroup::rigid((*wheel).clone())).collect::<Vec<_>>());
    assert_eq!(app.world().get::<ExplicitState>(body).unwrap().len(), 4);
    let particles = app.world().get::<Particles>(body).unwrap();
    let origin = app.world().get::<Transform>(body).unwrap().translation;
    let place = |p: u32| Vec3::from(particles.position[p as usize]) + origin;
    let bottom = |p: u32| place(p).y - particles.ellipsoid(p as usize).support(Vec3A::NEG_Y).0;
    for wheel in &wheels {
        // Each bears: its lowest point is on the table, and it is as it was made.
        let lowest = wheel.iter().map(|&p| bottom(p)).fold(f32::INFINITY, f32::min);
        assert!(lowest.abs() < 0.01, "{lowest}");
        let [a, b] = [wheel[0], wheel[wheel.len() - 1]];
        let made = rig.particles[a as usize].position.distance(rig.particles[b as usize].position);
        assert!((place(a).distance(place(b)) - made).abs() < 1e-3 * made);
    }
    for p in (0..60).filter(|p| wheels.iter().all(|wheel| !wheel.contains(p))) {
        assert!(bottom(p) > 0.3, "{}", place(p));
    }
    // The tyres are as the rule says, the rest as the body.
    let friction = &app.world().get::<ParticleFriction>(body).unwrap().0;
    for (p, &friction) in (0..).zip(friction) {
        assert_eq!(friction, if wheels.iter().any(|wheel| wheel.contains(&p)) { 0.9 } else { Collision::default().friction });
    }
}

/// A beam on nails at its middle: one half is told to be soft.
fn beam() -> Rig {
    let mut mesh = Mesh { name: "beam".into(), ..Mesh::default() };
    add_box(&mut mesh, "Beam", Vec3::new(-1.0, -0.1, -0.1), Vec3::new(2.0, 0.2, 0.2));
    let soft = Spring { hertz: 3.0, damping_ratio: 0.5 };
    let left = Within { min: [-9.0; 3], max: [-0.2, 9.0, 9.0] };
    let soft = RegionRule { within: Some(left), stiffness: Some(soft), ..rule("soft") };
    build_rig(&mesh, &Recipe { regions: vec![soft], ..Recipe::with_particles(30) }).unwrap()
}

/// How far both ends of the beam hang down after three seconds \[m\].
fn sag(app: &mut App, body: Entity, rig: &Rig) -> [f32; 2] {
    steps(app, 180);
    let particles = app.world().get::<Particles>(body).unwrap();
    let y = app.world().get::<Transform>(body).unwrap().translation.y;
    let end = |sign: f32| {
        (0..rig.particles.len()).max_by(|&a, &b| (sign * rig.particles[a].position.x).total_cmp(&(sign * rig.particles[b].position.x)))
    };
    [-1.0, 1.0].map(|sign| end(sign).map_or(0.0, |p| rig.particles[p].position.y - particles.position[p].y - y))
}

#[test]
fn a_body_bends_where_it_is_soft() {
    let mut app = app();
    let rig = beam();
    let nailed = |(p, at): (usize, Vec3)| Pin::at(p as u32, at).clamped();
    let middle = rig.particles.iter().map(|p| p.position).enumerate().filter(|(_, at)| at.x.abs() < 0.2);
    let pins = Pins { list: middle.map(nailed).collect() };
    assert!(!pins.list.is_empty());
    let stiff = ShapeMatching::new(Stiffness::hertz(60.0));
    let edges = DistanceConstraints::default();
    let body = app.world_mut().spawn((SoftBody::new(rig.clone()), pins.clone(), stiff, edges)).id();
    let [left, right] = sag(&mut app, body, &rig);
    println!("sags by {left} m and {right} m");
    assert!(left > 3.0 * right && right > 0.0, "{left} m, {right} m");
    // The rest follows the body's own number, the region does not.
    app.world_mut().get_mut::<ShapeMatching>(body).unwrap().stiffness = Stiffness::hertz(30.0);
    steps(&mut app, 1);
    let each = app.world().get::<ParticleStiffness>(body).unwrap().get();
    let soft = &rig.regions[0].particles;
    for (p, &stiffness) in (0..).zip(each) {
        assert_eq!(stiffness, if soft.contains(&p) { Stiffness::damped(3.0, 0.5) } else { Stiffness::hertz(30.0) });
    }
}

#[test]
fn a_body_keeps_what_it_has_of_its_own() {
    let mut app = app();
    let own = ExplicitGroups { list: vec![ExplicitGroup::rigid([0, 1])] };
    let body = app.world_mut().spawn((SoftBody::new(truck()), own.clone())).id();
    let plain = app.world_mut().spawn(SoftBody::new(truck())).id();
    steps(&mut app, 2);
    assert_eq!(app.world().get::<ExplicitGroups>(body), Some(&own));
    assert_eq!(app.world().get::<ExplicitGroups>(plain).map(|groups| groups.list.len()), Some(4));
    // Another rig takes with it what the first one gave, and nothing else.
    for entity in [body, plain] {
        app.world_mut().entity_mut(entity).insert(SoftBody::new(beam()));
    }
    steps(&mut app, 2);
    assert_eq!(app.world().get::<ExplicitGroups>(body), Some(&own));
    assert!(app.world().get::<ExplicitGroups>(plain).is_none() && app.world().get::<ParticleFriction>(plain).is_none());
    assert!(app.world().get::<ParticleStiffness>(plain).is_some());
}
