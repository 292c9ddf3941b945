//! Puts an app together around a scene and runs it, with a window or without.

use std::process::ExitCode;
use std::time::Duration;

use bevy::app::{PluginGroupBuilder, TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::ecs::schedule::SingleThreadedExecutor;
use bevy::prelude::*;
use polpo::PolpoTimingsPlugin;
use polpo::prelude::*;
use polpo_rapier::PolpoRapierPlugin;

use crate::{Options, Recorder, headless, outfit, props, recorder, windowed};

/// All scenes step at this rate \[Hz\].
pub(crate) const RATE: f64 = 60.0;
/// How long an example without a window simulates if not told \[s\].
pub(crate) const DEFAULT_SECONDS: f32 = 6.0;

/// Runs the scene called `name`, which `build` adds to the app, as `options` say.
///
/// Opens a window if there is a display and a graphics driver; otherwise simulates without one and prints the timings. Without a graphics driver there are no pictures, which is said in one
/// line; everything else still works.
///
/// The exit code is a failure if a file that was asked for could not be written.
pub fn run(name: &'static str, options: &Options, build: impl FnOnce(&mut App)) -> ExitCode {
    let wants_window = !options.headless && has_display();
    let wants_pictures = wants_window || options.png.is_some() || options.frames.is_some();
    let adapter = if wants_pictures { find_adapter() } else { None };
    if wants_pictures && adapter.is_none() {
        println!(
            "No Vulkan driver was found, so there are no pictures; install one to get them (Debian, Ubuntu: apt install mesa-vulkan-drivers libvulkan1)."
        );
    }
    match (adapter, wants_window) {
        (Some(adapter), true) => windowed::run(name, options, adapter, build),
        (adapter, _) => headless::run(name, options, adapter, build),
    }
}

/// Whether a window can be opened: on Linux, whether an X server is named and, if it is on this machine, listens.
fn has_display() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    let Some(display) = std::env::var("DISPLAY").ok().filter(|d| !d.is_empty()) else {
        return false;
    };
    match display.strip_prefix(':') {
        Some(local) => {
            let number = local.split('.').next().unwrap_or_default();
            // Abstract sockets have no file; only a missing folder is no evidence.
            let sockets = std::path::Path::new("/tmp/.X11-unix");
            !sockets.is_dir() || sockets.join(format!("X{number}")).exists()
        }
        None => true,
    }
}

/// The name of the graphics adapter that Bevy would use, if there is one.
fn find_adapter() -> Option<String> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok()?;
    let info = adapter.get_info();
    Some(format!("{} ({:?})", info.name, info.backend))
}

/// Bevy's task pools with as many simulating threads as asked for.
pub(crate) fn task_pools(options: &Options) -> TaskPoolPlugin {
    let mut pools = TaskPoolOptions::default();
    if let Some(threads) = options.threads {
        pools.compute =
            TaskPoolThreadAssignmentPolicy { min_threads: threads as usize, max_threads: threads as usize, percent: 1.0, ..pools.compute };
    }
    TaskPoolPlugin { task_pool_options: pools }
}

/// What every scene needs to simulate, on top of Bevy's time and task pools: soft bodies, Rapier's colliders, the timings. Needs no renderer.
pub struct SimulationPlugins;

impl PluginGroup for SimulationPlugins {
    fn build(self) -> PluginGroupBuilder {
        PluginGroupBuilder::start::<Self>().add(PolpoPlugin::default()).add(PolpoRapierPlugin::default()).add(PolpoTimingsPlugin::default())
    }
}

/// The same in every mode: the simulation and the figures.
pub(crate) fn add_simulation(app: &mut App, name: &'static str, options: &Options) {
    let defaults = SolverSettings::default();
    app.insert_resource(SolverSettings {
        substeps: options.substeps.unwrap_or(defaults.substeps),
        iterations: options.iterations.unwrap_or(defaults.iterations),
        ..defaults
    })
    .insert_resource(Time::<Fixed>::from_duration(Duration::from_secs_f64(1.0 / RATE)))
    .insert_resource(Recorder::new(name))
    .add_plugins(SimulationPlugins)
    // Nothing else is in this schedule here, and passing five systems from thread to thread would cost 0.2 ms a step. Bodies still go parallel inside the systems.
    .edit_schedule(FixedPostUpdate, |schedule| {
        schedule.set_executor(SingleThreadedExecutor::new());
    })
    .add_systems(FixedLast, recorder::record_step)
    .add_systems(
        Update,
        (
            outfit::dress_bodies.run_if(resource_exists::<Assets<Mesh>>),
            props::dress_props.run_if(resource_exists::<Assets<StandardMaterial>>),
            props::follow_colliders,
        ),
    );
}
