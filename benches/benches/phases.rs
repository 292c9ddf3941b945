//! What each phase of the ECS step takes, substeps summed, for an octopus that touches itself and lies on a floor: on one thread, or what is measured would be how threads wait for each other.

use std::time::Duration;

use bevy::prelude::*;
use criterion::{Criterion, criterion_group, criterion_main};
use polpo::StepTimings;
use polpo::prelude::*;
use polpo_benches::headless::{Threads, add_timings, on_floor};
use polpo_benches::octopus;

/// Steps until it lies: 2 s.
const SETTLE: usize = 120;

/// Takes so many steps, and adds up what `read` reads off each.
fn sum(app: &mut App, steps: u64, read: impl Fn(&StepTimings) -> Duration) -> Duration {
    let one = |_| {
        app.update();
        read(app.world().resource::<StepTimings>())
    };
    (0..steps).map(one).sum()
}

fn phases(criterion: &mut Criterion) {
    let (_, rig) = octopus();
    let mut app = on_floor(Threads::Of(1), &rig, 1, SETTLE, |body| {
        body.insert(SelfContact::default());
    });
    add_timings(&mut app);
    app.update();
    let names: Vec<&str> = app.world().resource::<StepTimings>().phases().map(|(name, _)| name).collect();
    let mut group = criterion.benchmark_group("phases");
    group.sample_size(20).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    for (k, name) in names.into_iter().enumerate() {
        let phase = |timings: &StepTimings| timings.phases().nth(k).map_or(Duration::ZERO, |(_, spent)| spent);
        group.bench_function(name, |bencher| bencher.iter_custom(|steps| sum(&mut app, steps, phase)));
    }
    group.bench_function("total", |bencher| bencher.iter_custom(|steps| sum(&mut app, steps, StepTimings::total)));
    group.finish();
}

criterion_group!(benches, phases);
criterion_main!(benches);
