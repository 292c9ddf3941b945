//! What the whole ECS step costs, awake: octopuses lying on a floor, by number, and one body by its number of particles.

use std::sync::Arc;
use std::time::Duration;

use bevy::prelude::App;
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use polpo_benches::block::block;
use polpo_benches::headless::{Threads, on_floor, step};
use polpo_benches::octopus;

fn octopuses(criterion: &mut Criterion) {
    let (_, rig) = octopus();
    let mut group = criterion.benchmark_group("step/octopuses");
    // What lies still is in a second; 333 of them take minutes for it on a slow machine.
    for (count, settle) in [(1, 120), (10, 120), (100, 60), (333, 20)] {
        let app = on_floor(Threads::All, &rig, count, settle, |_| {});
        measure(&mut group, count, count * rig.particles.len(), app);
    }
    group.finish();
}

fn blocks(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step/one body");
    for (lattice, settle) in [([10, 10, 10], 60), ([25, 20, 20], 20), ([50, 40, 50], 5)] {
        let rig = Arc::new(block(lattice));
        let app = on_floor(Threads::All, &rig, 1, settle, |_| {});
        measure(&mut group, rig.particles.len(), rig.particles.len(), app);
    }
    group.finish();
}

fn measure(group: &mut BenchmarkGroup<WallTime>, name: usize, particles: usize, mut app: App) {
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    group.throughput(Throughput::Elements(particles as u64));
    group.bench_function(BenchmarkId::from_parameter(name), |bencher| bencher.iter_custom(|steps| step(&mut app, steps)));
}

criterion_group!(benches, octopuses, blocks);
criterion_main!(benches);
