//! The same bits on every run, whatever the number of threads: in every demo scene and in scenes made from seeds.
//!
//! Bevy's task pool is one a process, so each number of threads gets a process of its own: this binary again, told by the environment what to do.

use std::path::Path;
use std::process::Command;

use bevy::app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::prelude::*;
use polpo::{
    BodyPairs, Edges, ExplicitGroups, ExplicitState, Frozen, ImplicitGroups, Inflation, Plasticity, RestPose, RodShape, RodSolve, Rods,
    SelfPairs,
};
use polpo_rapier::{PushRigidBodies, PushState};
use polpo_scenes::{DropScene, OctopusScene, SimulationPlugins};
use polpo_tests::{random_scene, simulation, state_of, steps};

pub(crate) const THREADS: &str = "POLPO_TEST_THREADS";
/// The seeds of the random scenes.
const RANDOM: std::ops::Range<u64> = 1..7;

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
    hashes.extend(RANDOM.map(|seed| ("random", hash_with(threads, 90, |app| random_scene(app, seed)))));
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

/// Otherwise the test above would say nothing about them.
#[test]
fn every_capability_is_used_in_the_random_scenes_and_something_happens_to_it() {
    let mut seen = std::collections::BTreeMap::new();
    for seed in RANDOM {
        let mut app = simulation();
        random_scene(&mut app, seed);
        for _ in 0..90 {
            steps(&mut app, 1);
            let world = app.world_mut();
            let mut note = |what, happens: bool| *seen.entry(what).or_insert(0) += usize::from(happens);
            note("bodies touch", world.resource::<BodyPairs>().iter().any(|pair| pair.touch()));
            let mut bodies = world.query_filtered::<EntityRef, With<SoftBody>>();
            for body in bodies.iter(world) {
                let groups = body.get::<ExplicitGroups>().zip(body.get::<ExplicitState>());
                let open = |(list, state): (&ExplicitGroups, &ExplicitState)| (0..list.list.len()).any(|g| state.is_open(g));
                note("groups", groups.is_some());
                note("groups open", groups.is_some_and(open));
                note("plasticity", body.contains::<Plasticity>());
                note("shapes flow", body.get::<ImplicitGroups>().is_some_and(|groups| !groups.flow().is_empty()));
                note("edges flow", body.get::<Edges>().is_some_and(|edges| !edges.flow().is_empty()));
                note("self-contact", body.get::<SelfPairs>().is_some_and(|own| own.pairs().iter().any(|pair| pair.touching)));
                let rods = body.get::<Rods>();
                note("direct rods", rods.is_some_and(|rods| rods.solve == RodSolve::Direct));
                note("swept rods", rods.is_some_and(|rods| rods.solve != RodSolve::Direct));
                note("ribs", rods.is_some_and(|rods| matches!(rods.shape, RodShape::Section { edges: Some(_), .. })));
                note("pushes", body.contains::<PushRigidBodies>() && body.get::<PushState>().is_some_and(|push| !push.contacts.is_empty()));
                note("tied to a rigid body", body.get::<PushState>().is_some_and(|push| !push.ties.is_empty()));
                note("rest pose", body.contains::<RestPose>());
                note("inflation", body.contains::<Inflation>());
                note("pins break", body.get::<Pins>().is_some_and(|pins| pins.list.len() < 3));
                note("sleeps", body.contains::<Sleeping>());
                note("frozen", body.contains::<Frozen>());
            }
        }
    }
    println!("{seen:?}");
    assert_eq!(seen.remove("frozen"), Some(0));
    assert!(seen.values().all(|&steps| steps > 20), "{seen:?}");
}
