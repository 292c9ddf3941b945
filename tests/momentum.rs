//! Ten seconds of free flight in the whole step: P and L, spin included, stay, whatever a body does to itself or another.
//!
//! Sums are made in `f64`, from `Transform` and the particles' places, so that what is off is the solver's.

use bevy::math::{DVec3, Vec3A};
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Blocks, BodyPairs, ExplicitGroup, ExplicitGroups, Material, Particles, Rods, Section, SelfPairs};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_scenes::octopus_asset;
use polpo_tests::{lattice, shaken, simulation, steps};

const TEN_SECONDS: usize = 600;

/// What bodies carry together.
#[derive(Debug, Default)]
struct Carried {
    mass: f64,
    /// Centre of mass in the world [m].
    center: DVec3,
    linear: DVec3,
    /// About the centre of mass, with spin.
    angular: DVec3,
    /// Σ m·|v| and Σ (m·|r|·|v| + I·|ω|): what the sums are made of.
    scale: [f64; 2],
}

fn carried(app: &App, bodies: &[Entity]) -> Carried {
    let mut all = Vec::new();
    for &body in bodies {
        let p = app.world().get::<Particles>(body).unwrap();
        let origin = app.world().get::<Transform>(body).unwrap().translation.as_dvec3();
        for i in 0..p.len() {
            let spin = p.angular_velocity[i].as_dvec3() * f64::from(p.inertia[i]);
            all.push((f64::from(p.mass[i]), origin + p.position[i].as_dvec3(), p.velocity[i].as_dvec3(), spin));
        }
    }
    let mut sum = Carried::default();
    for (m, x, v, _) in &all {
        sum.mass += m;
        sum.center += *x * *m;
        sum.linear += *v * *m;
        sum.scale[0] += m * v.length();
    }
    sum.center /= sum.mass;
    for (m, x, v, spin) in &all {
        let r = *x - sum.center;
        sum.angular += r.cross(*v) * *m + *spin;
        sum.scale[1] += m * r.length() * v.length() + spin.length();
    }
    sum
}

/// A line of ellipsoids 0.1 m apart.
fn line(n: u32) -> Rig {
    let particle =
        |i| Particle { position: Vec3::X * (0.1 * i as f32), frame: Quat::IDENTITY, radii: Vec3::new(0.04, 0.03, 0.02), mass: 0.1 };
    Rig { mesh_hash: MeshHash(0), particles: (0..n).map(particle).collect(), edges: (1..n).map(|i| [i - 1, i]).collect(), ..Rig::default() }
}

fn weightless() -> App {
    let mut app = simulation();
    app.insert_resource(Gravity(Vec3::ZERO));
    app
}

/// Out of its shape by up to an eighth, so that every constraint works.
fn stretch(app: &mut App, body: Entity) {
    for (i, x) in app.world_mut().get_mut::<Particles>(body).unwrap().position.iter_mut().enumerate() {
        *x *= 1.0 + 0.02 * (i % 7) as f32;
    }
}

const MOTION: InitialVelocity = InitialVelocity { linear: Vec3::new(0.5, 1.0, -0.3), angular: Vec3::new(1.0, -2.0, 3.0) };

/// Runs for ten seconds and holds what is off against shares of the scales. A hundred thousandth is three times what 3000 substeps of roundings of `f32` were seen to come to.
fn fly(name: &str, app: &mut App, bodies: &[Entity], [linear, angular]: [f64; 2]) {
    let before = carried(app, bodies);
    assert!(before.scale.iter().all(|s| *s > 0.0));
    let mut worst = [0.0f64; 2];
    for _ in 0..TEN_SECONDS {
        steps(app, 1);
        let now = carried(app, bodies);
        worst[0] = worst[0].max(now.linear.distance(before.linear) / before.scale[0]);
        worst[1] = worst[1].max(now.angular.distance(before.angular) / before.scale[1]);
    }
    println!("{name}: P off by {:.1e}, L by {:.1e}", worst[0], worst[1]);
    assert!(worst[0] < linear && worst[1] < angular, "{name}: P off by {:.1e}, L by {:.1e}", worst[0], worst[1]);
}

#[test]
fn a_lattice() {
    let mut app = weightless();
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), MOTION)).id();
    stretch(&mut app, body);
    fly("lattice", &mut app, &[body], [1e-5, 1e-5]);
}

#[test]
fn an_octopus() {
    let mut app = weightless();
    let body = app.world_mut().spawn((SoftBody::new(octopus_asset().1), MOTION)).id();
    stretch(&mut app, body);
    // 1.6e-5 and 1.1e-5: more particles and edges, more roundings.
    fly("octopus", &mut app, &[body], [3e-5, 3e-5]);
}

/// One that is solved in blocks.
#[test]
fn a_large_body() {
    let mut app = weightless();
    let body = app.world_mut().spawn((SoftBody::new(shaken(18)), MOTION)).id();
    stretch(&mut app, body);
    // 2e-7 and 2.6e-5: more roundings still where the angular momentum is summed up.
    fly("large body", &mut app, &[body], [1e-5, 6e-5]);
    assert!(app.world().get::<Blocks>(body).unwrap().len() >= 4);
}

#[test]
fn a_chain_of_rods() {
    let mut app = weightless();
    let rubber = Material { youngs_modulus: 2e6, poissons_ratio: 0.4, density: 1000.0 };
    let body = app.world_mut().spawn((SoftBody::new(line(9)), MOTION, Rods::new(rubber, Section::circle(0.02)))).id();
    // The material gives the particles their masses in the first step.
    steps(&mut app, 1);
    // Bent, and not in a plane.
    for (i, v) in app.world_mut().get_mut::<Particles>(body).unwrap().velocity.iter_mut().enumerate() {
        *v += Vec3A::new(0.0, (i % 3) as f32, (i % 2) as f32) * 0.3;
    }
    fly("rods", &mut app, &[body], [1e-5, 1e-5]);
}

/// One layer of nine is rigid, the other two hang on it.
#[test]
fn a_body_with_an_explicit_group() {
    let mut app = weightless();
    let groups = ExplicitGroups { list: vec![ExplicitGroup::rigid((0..9).collect::<Vec<_>>())] };
    let body = app.world_mut().spawn((SoftBody::new(lattice(0.1)), MOTION, groups)).id();
    stretch(&mut app, body);
    fly("explicit group", &mut app, &[body], [1e-5, 1e-5]);
}

/// A limp horseshoe whose ends are thrown at each other.
#[test]
fn a_body_that_touches_itself() {
    let mut app = weightless();
    let mut rig = line(12);
    for (i, particle) in rig.particles.iter_mut().enumerate() {
        // Five sixths of a circle, open at the bottom.
        let (sin, cos) = (0.476 * (i as f32 - 5.5)).sin_cos();
        particle.position = Vec3::new(sin, cos, 0.0) * 0.21;
        particle.radii = Vec3::splat(0.045);
    }
    let soft = Stiffness::hertz(0.5);
    let body = app.world_mut().spawn((SoftBody::new(rig), MOTION, SelfContact::default(), ShapeMatching::new(soft))).id();
    let velocity = &mut app.world_mut().get_mut::<Particles>(body).unwrap().velocity;
    for i in 0..3 {
        velocity[i] += Vec3A::X * 2.0;
        velocity[11 - i] -= Vec3A::X * 2.0;
    }
    let before = carried(&app, &[body]);
    let (mut touched, mut worst) = (0, [0.0f64; 2]);
    for _ in 0..TEN_SECONDS {
        steps(&mut app, 1);
        touched += usize::from(app.world().get::<SelfPairs>(body).unwrap().pairs().iter().any(|pair| pair.touching));
        let now = carried(&app, &[body]);
        worst[0] = worst[0].max(now.linear.distance(before.linear) / before.scale[0]);
        worst[1] = worst[1].max(now.angular.distance(before.angular) / before.scale[1]);
    }
    println!("self-contact: touched in {touched} steps, P off by {:.1e}, L by {:.1e}", worst[0], worst[1]);
    assert!(touched > 0, "touched itself in {touched} steps");
    assert!(worst[0] < 1e-5 && worst[1] < 1e-5, "P off by {:.1e}, L by {:.1e}", worst[0], worst[1]);
}

/// Off centre, so that the blow turns both.
#[test]
fn two_bodies_that_collide() {
    let mut app = weightless();
    let bodies: Vec<Entity> = [-1.0f32, 1.0]
        .iter()
        .map(|&side| {
            let motion = InitialVelocity { linear: Vec3::X * -side, angular: Vec3::Z * 0.5 };
            app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(0.4 * side, 0.07 * side, 0.02), motion)).id()
        })
        .collect();
    let before = carried(&app, &bodies);
    let (mut touched, mut worst) = (0, [0.0f64; 2]);
    for _ in 0..TEN_SECONDS {
        steps(&mut app, 1);
        touched += usize::from(app.world().resource::<BodyPairs>().iter().any(|pair| pair.touch()));
        let now = carried(&app, &bodies);
        worst[0] = worst[0].max(now.linear.distance(before.linear) / before.scale[0]);
        worst[1] = worst[1].max(now.angular.distance(before.angular) / before.scale[1]);
    }
    println!("collision: touched in {touched} steps, P off by {:.1e}, L by {:.1e}", worst[0], worst[1]);
    assert!(touched > 0, "they missed each other");
    assert!(worst[0] < 1e-5 && worst[1] < 1e-5, "P off by {:.1e}, L by {:.1e}", worst[0], worst[1]);
}

/// What wobbles about its own centre does not swim away: the centre, of places, not of velocities.
#[test]
fn a_wobbling_body_stays_where_it_is() {
    for (name, rig) in [("lattice", lattice(0.1)), ("octopus", octopus_asset().1.as_ref().clone())] {
        let mut app = weightless();
        let body = app.world_mut().spawn(SoftBody::new(rig)).id();
        // It must not fall asleep, and nothing but the solver brakes it.
        app.world_mut().entity_mut(body).remove::<Sleep>().insert(Damping { drag: 0.0, internal: 0.0 });
        stretch(&mut app, body);
        let before = carried(&app, &[body]);
        steps(&mut app, TEN_SECONDS);
        let after = carried(&app, &[body]);
        let drift = after.center.distance(before.center) / 10.0;
        let speed = after.scale[0] / after.mass;
        println!("{name}: drifts at {drift:.1e} m/s, its particles move at {speed:.1e} m/s");
        assert!(drift < 1e-6, "{name}: {drift} m/s");
    }
}
