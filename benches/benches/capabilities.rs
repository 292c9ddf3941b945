//! What each capability adds to the step of an octopus that lies on a floor: one row a capability, beside the body without any and the body as it comes.

use std::time::Duration;

use bevy::prelude::*;
use criterion::{Criterion, criterion_group, criterion_main};
use polpo::prelude::*;
use polpo::{
    ContactMemory, Contacts, ExplicitGroup, ExplicitGroups, Inflation, Material, Plasticity, RestPose, RodShape, RodSolve, Rods, Section,
    Stillness,
};
use polpo_benches::headless::{Threads, on_floor, step};
use polpo_benches::octopus;
use polpo_rapier::{PushRigidBodies, TouchedColliders};
use polpo_rig::Rig;

/// How many octopuses share a row's time: with several, what a step costs without any is lost in what they cost.
const COUNT: usize = 4;
/// Steps until they lie: 2 s.
const SETTLE: usize = 120;

type Change = fn(&mut EntityWorldMut, &Rig);

/// The edges of a tree through the rig: loops cost direct rods more, and an octopus is full of them.
fn tree(rig: &Rig) -> Vec<u32> {
    let mut reached = vec![false; rig.particles.len()];
    let mut tree = Vec::new();
    reached[0] = true;
    for _ in 0..rig.particles.len() {
        for (e, &[i, j]) in (0u32..).zip(&rig.edges) {
            let (i, j) = (i as usize, j as usize);
            if reached[i] != reached[j] {
                (reached[i], reached[j]) = (true, true);
                tree.push(e);
            }
        }
    }
    tree
}

fn rods(rig: &Rig, solve: RodSolve) -> Rods {
    let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.4, density: 1000.0 };
    let section = Section::circle(0.02);
    Rods { shape: RodShape::Section { section, edges: Some(tree(rig)) }, solve, ..Rods::new(material, section) }
}

fn bare(body: &mut EntityWorldMut, _: &Rig) {
    body.remove::<(ShapeMatching, DistanceConstraints, Torsion, Damping, KeepMomentum, BodyContact, Stillness)>().remove::<(
        Collision,
        Contacts,
        ContactMemory,
    )>();
}

/// The row's name, and what is done to the body. The first rows change a body without anything, which falls; those after `default` the body as it comes.
const ROWS: [(&str, Change); 23] = [
    ("bare", bare),
    ("bare + shape_matching", |body, rig| {
        bare(body, rig);
        body.insert(ShapeMatching::default());
    }),
    ("bare + distance", |body, rig| {
        bare(body, rig);
        body.insert(DistanceConstraints::default());
    }),
    ("bare + torsion", |body, rig| {
        bare(body, rig);
        body.insert(Torsion::default());
    }),
    ("bare + damping", |body, rig| {
        bare(body, rig);
        body.insert(Damping::default());
    }),
    ("bare + keep_momentum", |body, rig| {
        bare(body, rig);
        body.insert(KeepMomentum::default());
    }),
    ("bare + body_contact", |body, rig| {
        bare(body, rig);
        body.insert(BodyContact::default());
    }),
    ("default", |_, _| {}),
    ("default - collision", |body, _| {
        body.remove::<(Collision, Contacts, ContactMemory)>();
    }),
    ("default + sleep", |body, _| {
        // Counts stillness, and never has enough of it.
        body.insert(Sleep { time: f32::INFINITY, ..default() });
    }),
    ("default + self_contact", |body, _| {
        body.insert(SelfContact::default());
    }),
    ("default + explicit_groups", |body, rig| {
        let mut near: Vec<u32> = (0..rig.particles.len() as u32).collect();
        let distance = |i: u32| rig.particles[i as usize].position.distance_squared(rig.particles[0].position);
        near.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        body.insert(ExplicitGroups { list: vec![ExplicitGroup::rigid(&near[..20]), ExplicitGroup::rigid(&near[19..40])] });
    }),
    ("default + rods, direct", |body, rig| {
        body.insert(rods(rig, RodSolve::Direct));
    }),
    ("default + rods, swept", |body, rig| {
        body.insert(rods(rig, RodSolve::Sweep { spin_radius: 0.05 }));
    }),
    ("default + plasticity", |body, _| {
        body.insert(Plasticity::default());
    }),
    ("default + rest_pose", |body, _| {
        body.insert(RestPose::default());
    }),
    ("default + inflation", |body, _| {
        body.insert(Inflation::new(1.05));
    }),
    ("default + pins", |body, _| {
        let place = body.get::<Transform>().map_or(Vec3::ZERO, |at| at.translation);
        body.insert(Pins { list: vec![Pin::at(0, place).breaking_at(1e9)] });
    }),
    ("default + grab", |body, _| {
        let target = body.get::<Transform>().map_or(Vec3::ZERO, |at| at.translation);
        body.insert(Grab { particle: 0, target, stiffness: Stiffness::hertz(20.0) });
    }),
    ("default + air_drag", |body, _| {
        body.insert(AirDrag::default());
    }),
    ("default + gravity_scale", |body, _| {
        body.insert(GravityScale(0.9));
    }),
    ("default + push_rigid_bodies", |body, _| {
        body.insert(PushRigidBodies);
    }),
    ("default + touched_colliders", |body, _| {
        body.insert(TouchedColliders::default());
    }),
];

fn capabilities(criterion: &mut Criterion) {
    let (_, rig) = octopus();
    let mut group = criterion.benchmark_group("capabilities");
    group.sample_size(20).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    for (name, change) in ROWS {
        let mut app = on_floor(Threads::All, &rig, COUNT, SETTLE, |body| change(body, &rig));
        group.bench_function(name, |bencher| bencher.iter_custom(|steps| step(&mut app, steps) / COUNT as u32));
    }
    group.finish();
}

criterion_group!(benches, capabilities);
criterion_main!(benches);
