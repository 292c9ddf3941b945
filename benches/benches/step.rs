//! What the whole ECS step costs: octopuses lying on a floor, by number.

use std::time::Instant;

use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use polpo::prelude::*;
use polpo_benches::octopus;
use polpo_rapier::{PolpoRapierPlugin, RapierWorld};
use rapier3d::prelude::ColliderBuilder;

/// `count` octopuses at rest on a floor, two metres apart.
fn resting(count: usize) -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, PolpoPlugin::default(), PolpoRapierPlugin::default()))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .insert_resource(Time::<Fixed>::from_hz(60.0));
    app.finish();
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(ColliderBuilder::cuboid(1000.0, 0.5, 1000.0));
    let (_, rig) = octopus();
    for i in 0..count {
        let place = Transform::from_xyz(2.0 * (i % 20) as f32, 1.1, 2.0 * (i / 20) as f32);
        app.world_mut().spawn((SoftBody::new(rig.clone()), place));
    }
    for _ in 0..180 {
        app.update();
    }
    app
}

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step");
    group.sample_size(20);
    for count in [1, 10, 100] {
        let mut app = resting(count);
        group.throughput(Throughput::Elements(300 * count as u64));
        group.bench_function(BenchmarkId::from_parameter(count), |bencher| {
            bencher.iter_custom(|steps| {
                let started = Instant::now();
                for _ in 0..steps {
                    app.update();
                }
                started.elapsed()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, step);
criterion_main!(benches);
