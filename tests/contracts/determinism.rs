//! The same bits on every run, whatever the number of threads.
//!
//! Bevy's task pool is one a process, so each number of threads gets a process of its own: this binary again, told by the environment what to do.

use std::process::Command;

use bevy::app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::{Particles, SoftBody, state_hash};
use polpo_scenes::{OctopusScene, SimulationPlugins};

const THREADS: &str = "POLPO_TEST_THREADS";

/// Ten octopuses on the stairs: enough work that the systems go parallel where they may.
fn hash_with(threads: usize) -> String {
    let compute = TaskPoolThreadAssignmentPolicy {
        min_threads: threads,
        max_threads: threads,
        percent: 1.0,
        on_thread_spawn: None,
        on_thread_destroy: None,
    };
    let pools = TaskPoolPlugin { task_pool_options: TaskPoolOptions { compute, ..default() } };
    let mut app = App::new();
    app.add_plugins((MinimalPlugins.set(pools), SimulationPlugins, OctopusScene { count: 10, seed: 7 }))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
    app.finish();
    for _ in 0..90 {
        app.update();
    }
    assert_eq!(bevy::tasks::ComputeTaskPool::get().thread_num(), threads);
    let world = app.world_mut();
    let mut bodies: Vec<Entity> = world.query_filtered::<Entity, With<SoftBody>>().iter(world).collect();
    bodies.sort();
    let world = &*world;
    let hash = state_hash(bodies.iter().map(|&b| (world.get::<Transform>(b).unwrap(), world.get::<Particles>(b).unwrap())));
    format!("{hash:016x}")
}

/// Not a test by itself: what the children of the test below run.
#[test]
fn child() {
    if let Some(threads) = std::env::var(THREADS).ok().and_then(|n| n.parse().ok()) {
        println!("hash={}", hash_with(threads));
    }
}

#[test]
fn the_same_bits_from_run_to_run_and_for_any_number_of_threads() {
    let run = |threads: usize| {
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "determinism::child", "--nocapture"])
            .env(THREADS, threads.to_string())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        text.split("hash=")
            .nth(1)
            .map(|rest| rest[..16].to_owned())
            .unwrap_or_else(|| panic!("{text}{}", String::from_utf8_lossy(&output.stderr)))
    };
    let one = run(1);
    assert_eq!(one, run(1), "two runs");
    assert_eq!(one, run(2), "one thread and two");
    assert_eq!(one, run(5), "one thread and five");
}
