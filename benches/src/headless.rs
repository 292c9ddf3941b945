//! Apps without a window, and bodies on a floor.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bevy::app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::ecs::schedule::{Schedules, SingleThreadedExecutor};
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::PolpoTimingsPlugin;
use polpo::prelude::*;
use polpo_rapier::{PolpoRapierPlugin, RapierWorld};
use polpo_rig::{Particle, Rig};
use rapier3d::prelude::ColliderBuilder;

/// Steps a second \[Hz\].
pub const RATE: f64 = 60.0;
/// Wide enough for any scene \[m\]. Much wider, and its floats are so coarse that nothing on it comes to rest.
pub const FLOOR_HALF_EXTENTS: Vec3 = Vec3::new(100.0, 0.5, 100.0);
/// So that its top is at y = 0 \[m\].
pub const FLOOR_CENTER: Vec3 = Vec3::new(0.0, -FLOOR_HALF_EXTENTS.y, 0.0);
/// How far above the floor bodies start \[m\].
pub const DROP: f32 = 0.02;

/// Which threads an app computes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// As in a game that sets nothing: all there are, and systems may run side by side.
    All,
    /// So many, at least 1. Systems run on the thread that calls; bodies go parallel inside them. The first app of a process decides how many it has.
    Of(usize),
}

/// An app with soft bodies and colliders, at [`RATE`] steps a second: every `update` is one step. The first one, which has no time in it, is done.
pub fn app(threads: Threads) -> App {
    let mut pools = TaskPoolOptions::default();
    if let Threads::Of(count) = threads {
        pools.compute = TaskPoolThreadAssignmentPolicy { min_threads: count, max_threads: count, percent: 1.0, ..pools.compute };
    }
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins.set(TaskPoolPlugin { task_pool_options: pools }),
        PolpoPlugin::default(),
        PolpoRapierPlugin::default(),
    ))
    .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
    .insert_resource(Time::<Fixed>::from_hz(RATE));
    if threads != Threads::All {
        for (_, schedule) in app.world_mut().resource_mut::<Schedules>().iter_mut() {
            schedule.set_executor(SingleThreadedExecutor::new());
        }
    }
    app.finish();
    app.cleanup();
    app.update();
    app
}

/// Puts a floor into `app`, its top at y = 0.
pub fn add_floor(app: &mut App) {
    let Vec3 { x, y, z } = FLOOR_HALF_EXTENTS;
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(ColliderBuilder::cuboid(x, y, z).translation(FLOOR_CENTER));
}

/// Makes `app` measure its phases, in the resource [`StepTimings`](polpo::StepTimings).
pub fn add_timings(app: &mut App) {
    // `add_plugins` is for apps that are not ready yet.
    PolpoTimingsPlugin::default().build(app);
}

/// How high a body of `rig` has to be for its lowest particle to end [`DROP`] above the floor \[m\].
pub fn drop_height(rig: &Rig) -> f32 {
    let bottom = |p: &Particle| {
        let up = p.frame.inverse() * Vec3::Y;
        p.position.y - (up * p.radii).length()
    };
    DROP - rig.particles.iter().map(bottom).fold(f32::INFINITY, f32::min)
}

/// An app with `count` bodies of `rig` on a floor, two metres apart, that do not sleep, each changed by `change`, after so many steps.
pub fn on_floor(threads: Threads, rig: &Arc<Rig>, count: usize, steps: usize, change: impl Fn(&mut EntityWorldMut)) -> App {
    let mut app = app(threads);
    add_floor(&mut app);
    let across = (count as f32).sqrt().ceil() as usize;
    for i in 0..count {
        let place = Vec3::new(2.0 * (i % across) as f32, drop_height(rig), 2.0 * (i / across) as f32);
        let mut body = app.world_mut().spawn((SoftBody::new(rig.clone()), Transform::from_translation(place)));
        body.remove::<Sleep>();
        change(&mut body);
    }
    step(&mut app, steps as u64);
    app
}

/// Takes so many steps, and says how long they took.
pub fn step(app: &mut App, steps: u64) -> Duration {
    let started = Instant::now();
    for _ in 0..steps {
        app.update();
    }
    started.elapsed()
}
