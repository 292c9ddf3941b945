//! The same bits on every run, whatever the number of threads: in every demo scene and in scenes made from seeds.
//!
//! Bevy's task pool is one a process, so each number of threads gets a process of its own: this binary again, told by the environment what to do.

use std::path::Path;
use std::process::Command;

use bevy::app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo_scenes::{DropScene, OctopusScene, SimulationPlugins};
use polpo_tests::{random_scene, state_of, steps};

pub(crate) const THREADS: &str = "POLPO_TEST_THREADS";

/// Takes `count` steps of the scene that `build` makes, on `threads` threads.
pub(crate) fn hash_with(threads: usize, count: usize, build: impl FnOnce(&mut App)) -> u64 {
    let compute = TaskPoolThreadAssignmentPolicy {
        min_threads: threads,
        max_threads: threads,
        percent: 1.0,
        on_thread_spawn: None,
        on_thread_destroy: None,
    };
    let pools = TaskPoolPlugin { task_pool_options: TaskPoolOptions { compute, ..default() } };
    let mut app = App::new();
    app.add_plugins((MinimalPlugins.set(pools), SimulationPlugins)).insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
    build(&mut app);
    app.finish();
    steps(&mut app, count);
    assert_eq!(bevy::tasks::ComputeTaskPool::get().thread_num(), threads);
    state_of(app.world_mut())
}

fn hashes_with(threads: usize) -> String {
    let octopus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/octopus.glb");
    // Enough bodies that the systems go parallel where they may, and enough steps that they come down on something.
    let mut hashes = vec![
        (
            "octopus",
            hash_with(threads, 90, |app| {
                app.add_plugins(OctopusScene { count: 10, seed: 7 });
            }),
        ),
        (
            "drop",
            hash_with(threads, 90, |app| {
                app.add_plugins(DropScene::new(&octopus, 120, 300, 1.0, 4, 3).unwrap());
            }),
        ),
    ];
    hashes.extend((1..5).map(|seed| ("random", hash_with(threads, 90, |app| random_scene(app, seed)))));
    hashes.iter().map(|(name, hash)| format!("{name} {hash:016x}, ")).collect()
}

/// Not a test by itself: what the children of the test below run.
#[test]
fn child() {
    if let Some(threads) = std::env::var(THREADS).ok().and_then(|n| n.parse().ok()) {
        println!("hashes={};", hashes_with(threads));
    }
}

/// Runs the test `child` of this binary with 1, 1, 2 and 8 threads; it says `hashes=…;`, and `witness` at some time.
pub(crate) fn same_for_any_threads(child: &str, witness: &str) {
    let run = |threads: usize| {
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", child, "--nocapture"])
            .env(THREADS, threads.to_string())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(text.contains(witness), "{text}{}", String::from_utf8_lossy(&output.stderr));
        let hashes = text.split("hashes=").nth(1).and_then(|rest| rest.split(';').next());
        hashes.map(str::to_owned).unwrap_or_else(|| panic!("{text}{}", String::from_utf8_lossy(&output.stderr)))
    };
    let one = run(1);
    println!("{one}");
    assert_eq!(one, run(1), "two runs");
    assert_eq!(one, run(2), "one thread and two");
    assert_eq!(one, run(8), "one thread and eight");
}

#[test]
fn the_same_bits_from_run_to_run_and_for_any_number_of_threads() {
    same_for_any_threads("determinism::child", "octopus");
}
