//! What it takes to spawn an octopus from its rig, where there have been others: the entity with what observers give it, and its first phase `Prepare`.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bevy::prelude::*;
use criterion::{Criterion, criterion_group, criterion_main};
use polpo::StepTimings;
use polpo::prelude::*;
use polpo_benches::headless::{Threads, add_floor, add_timings, app, drop_height};
use polpo_benches::measure::Times;
use polpo_benches::octopus;
use polpo_rig::Rig;

/// What spawning should take at most \[µs\].
const WANTED: f64 = 500.0;
/// How often an octopus is spawned for the parts.
const ROUNDS: usize = 300;

/// A world in which octopuses come and go.
struct Pond {
    app: App,
    rig: Arc<Rig>,
}

/// What a spawning took.
struct Spawned {
    entity: Duration,
    prepare: Duration,
}

impl Spawned {
    fn total(&self) -> Duration {
        self.entity + self.prepare
    }
}

impl Pond {
    fn new() -> Self {
        let mut app = app(Threads::All);
        add_timings(&mut app);
        add_floor(&mut app);
        Self { app, rig: octopus().1 }
    }

    /// Spawns an octopus, takes its first step and despawns it.
    fn spawn(&mut self, capabilities: impl Bundle) -> Spawned {
        let place = Transform::from_xyz(0.0, drop_height(&self.rig), 0.0);
        let started = Instant::now();
        let body = self.app.world_mut().spawn((SoftBody::new(self.rig.clone()), place, capabilities)).id();
        let entity = started.elapsed();
        self.app.update();
        let timings = self.app.world().resource::<StepTimings>();
        let prepare = timings.phases().find(|(name, _)| *name == "prepare").map_or(Duration::ZERO, |(_, spent)| spent);
        self.app.world_mut().despawn(body);
        Spawned { entity, prepare }
    }
}

fn spawn(criterion: &mut Criterion) {
    let mut pond = Pond::new();
    let mut group = criterion.benchmark_group("spawn");
    group.sample_size(20).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    group.bench_function("octopus", |bencher| bencher.iter_custom(|count| (0..count).map(|_| pond.spawn(()).total()).sum()));
    group.bench_function("octopus with self-contact", |bencher| {
        bencher.iter_custom(|count| (0..count).map(|_| pond.spawn(SelfContact::default()).total()).sum());
    });
    group.finish();
    let mut times = <[Times; 3]>::default();
    for _ in 0..ROUNDS {
        let spawned = pond.spawn(());
        for (times, spent) in times.iter_mut().zip([spawned.entity, spawned.prepare, spawned.total()]) {
            times.note(spent);
        }
    }
    let [entity, prepare, total] = times.map(|times| times.median());
    let reached = if total < WANTED { "reached" } else { "missed" };
    println!(
        "\nspawning an octopus: {total:.0} µs (entity {entity:.0}, first Prepare {prepare:.0}); wanted below {WANTED:.0} µs: {reached}"
    );
}

criterion_group!(benches, spawn);
criterion_main!(benches);
