//! What it takes to find the contacts of an octopus with what it lies on, by the shape of that: on one thread, without an ECS.

use std::time::Duration;

use bevy::math::Vec3;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use polpo::prelude::*;
use polpo_benches::headless::{FLOOR_HALF_EXTENTS, RATE, Threads, on_floor, step};
use polpo_benches::octopus;
use polpo_rapier::{ContactDetector, DetectionInput, Obstacles, RapierWorld};
use polpo_solver::{Contacts, FreePositions, Particles};
use rapier3d::geometry::{Array2, SharedShape};
use rapier3d::prelude::ColliderBuilder;

/// Steps until it lies: 2 s.
const SETTLE: u64 = 120;
/// So many steps one after the other are gone through again and again.
const STEPS: usize = 8;
/// Cells of a mesh and of a height field along a side, of so many metres.
const CELLS: u32 = 40;
const CELL: f32 = 0.1;

/// Shapes whose top is at y = 0.
fn grounds() -> [(&'static str, ColliderBuilder); 7] {
    let Vec3 { x, y, z } = FLOOR_HALF_EXTENTS;
    let side = CELL * CELLS as f32;
    let at = |i: u32, k: u32| Vec3::new(i as f32 * CELL - 0.5 * side, 0.0, k as f32 * CELL - 0.5 * side);
    let row = CELLS + 1;
    let points = (0..row * row).map(|n| at(n % row, n / row)).collect();
    let cell = |n: u32| {
        let a = n % CELLS + n / CELLS * row;
        [[a, a + row, a + 1], [a + 1, a + row, a + row + 1]]
    };
    let corners: Vec<Vec3> = [-1.0, 1.0].iter().flat_map(|u| [-1.0, 1.0].map(|v| Vec3::new(*u, 0.0, v) * side)).collect();
    let hull: Vec<Vec3> = corners.iter().flat_map(|c| [*c, *c - Vec3::Y]).collect();
    let mesh = SharedShape::trimesh(points, (0..CELLS * CELLS).flat_map(cell).collect()).expect("a grid is a mesh");
    let field = Array2::repeat(row as usize, row as usize, 0.0);
    [
        ("cuboid", ColliderBuilder::cuboid(x, y, z).translation(Vec3::NEG_Y * y)),
        ("half-space", ColliderBuilder::new(SharedShape::halfspace(Vec3::Y))),
        ("ball", ColliderBuilder::ball(100.0).translation(Vec3::NEG_Y * 100.0)),
        ("capsule", ColliderBuilder::capsule_x(100.0, 100.0).translation(Vec3::NEG_Y * 100.0)),
        ("hull", ColliderBuilder::convex_hull(&hull).expect("a box is a hull")),
        ("mesh", ColliderBuilder::new(mesh)),
        ("height field", ColliderBuilder::heightfield(field, Vec3::new(side, 1.0, side))),
    ]
}

/// A body lying, in steps one after the other: its particles, and how far its origin came since the step before.
fn lying() -> Vec<(Particles, Vec3, Vec3)> {
    let (_, rig) = octopus();
    let mut app = on_floor(Threads::Of(1), &rig, 1, SETTLE as usize, |_| {});
    let mut bodies = app.world_mut().query::<(&polpo::Particles, &bevy::prelude::Transform)>();
    let mut last = None;
    let mut states = Vec::new();
    for _ in 0..STEPS {
        step(&mut app, 1);
        let (particles, place) = bodies.single(app.world()).expect("there is one");
        let way = place.translation - last.unwrap_or(place.translation);
        last = Some(place.translation);
        states.push((particles.0.clone(), place.translation, way));
    }
    states
}

fn detect(criterion: &mut Criterion) {
    let states = lying();
    let mut group = criterion.benchmark_group("detect");
    group.sample_size(20).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    for (name, ground) in grounds() {
        let mut world = RapierWorld::default();
        world.insert_fixed(ground);
        let (mut obstacles, mut detector) = <(Obstacles, ContactDetector)>::default();
        let (mut free, mut contacts) = <(FreePositions, Contacts)>::default();
        obstacles.gather(&world.bodies, &world.colliders, (1.0 / RATE) as f32);
        let mut turn = 0;
        group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
            bencher.iter(|| {
                let (particles, origin, way) = &states[turn % STEPS];
                turn += 1;
                free.position.iter_mut().for_each(|x| *x -= *way);
                let body = DetectionInput {
                    particles,
                    origin: *origin,
                    acceleration: Gravity::default().0,
                    dt: (1.0 / RATE) as f32,
                    friction: 0.6,
                    frictions: &[],
                    memberships: 1,
                    filter: u32::MAX,
                };
                detector.detect(&body, &obstacles, &world.colliders, &mut free, &mut contacts);
            });
        });
        assert!(!contacts.list.is_empty(), "it does not lie on the {name}");
    }
    group.finish();
}

criterion_group!(benches, detect);
criterion_main!(benches);
