//! An example in a window.

use std::process::ExitCode;

use bevy::prelude::*;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy::render::view::screenshot::Screenshot;
use bevy::window::WindowResolution;
use bevy_panorbit_camera::{PanOrbitCamera, PanOrbitCameraPlugin};
use polpo::prelude::*;

use crate::pictures::{Pictures, Shot, shoot};
use crate::recorder::Recorder;
use crate::run::{RATE, add_simulation, task_pools};
use crate::stage::{SceneCamera, StagePlugin, View};
use crate::{Options, controls, overlay};

pub(crate) fn run(name: &'static str, options: &Options, adapter: String, build: impl FnOnce(&mut App)) -> ExitCode {
    let mut app = App::new();
    let window = Window { title: format!("Polpo · {name}"), resolution: WindowResolution::new(1280, 720), ..default() };
    app.add_plugins((
        DefaultPlugins.set(task_pools(options)).set(options.asset_plugin()).set(WindowPlugin { primary_window: Some(window), ..default() }),
        RenderDiagnosticsPlugin,
        PolpoRenderPlugin::default(),
        StagePlugin,
        PanOrbitCameraPlugin,
        overlay::OverlayPlugin,
        controls::ControlsPlugin,
    ))
    .add_systems(PostStartup, orbit.after(crate::stage::place_camera));
    add_simulation(&mut app, name, options);
    build(&mut app);
    app.insert_resource(Run {
        steps: options.seconds.map(|s| (f64::from(s) * RATE).round().max(1.0) as u64),
        pictures: Pictures::new(options),
        seen: 0,
        adapter,
        last: None,
    })
    .add_systems(Last, follow_run);
    match app.run() {
        AppExit::Success => ExitCode::SUCCESS,
        AppExit::Error(code) => ExitCode::from(code.get()),
    }
}

/// Dragging beside a body turns the camera about what the scene wants to be looked at.
fn orbit(mut commands: Commands, camera: Single<Entity, With<SceneCamera>>, view: Res<View>) {
    let arm = view.eye - view.target;
    commands.entity(*camera).insert(PanOrbitCamera {
        focus: view.target,
        target_focus: view.target,
        radius: Some(arm.length()),
        yaw: Some(arm.x.atan2(arm.z)),
        pitch: Some((arm.y / arm.length()).asin()),
        zoom_lower_limit: 0.3,
        button_pan: MouseButton::Right,
        ..default()
    });
}

/// What was asked of the run, and how far it is.
#[derive(Resource)]
struct Run {
    steps: Option<u64>,
    pictures: Pictures,
    seen: u64,
    adapter: String,
    last: Option<Shot>,
}

/// Takes the pictures that are due, and leaves when the time is up or the window is closed.
fn follow_run(world: &mut World) {
    let steps = world.resource::<Recorder>().steps();
    let closing = !world.resource::<Messages<AppExit>>().is_empty();
    world.resource_scope(|world, mut run: Mut<Run>| {
        if steps > run.seen {
            run.seen = steps;
            if let Some(path) = run.pictures.due(steps) {
                shoot(world, Screenshot::primary_window(), &path);
            }
        }
        let due = run.steps.is_some_and(|last| steps >= last);
        if run.last.is_none() && due {
            world.resource_mut::<Time<Virtual>>().pause();
            let mut last = Shot::default();
            run.pictures.at_end(|path| {
                last = shoot(world, Screenshot::primary_window(), path);
                Ok(())
            });
            run.last = Some(last);
        }
        let arrived = if run.pictures.has_png() { run.last.as_ref().and_then(Shot::take) } else { run.last.as_ref().map(|_| Ok(())) };
        if let Some(result) = arrived {
            run.pictures.at_end_arrived(result);
            finish(world, &mut run);
        } else if closing {
            finish(world, &mut run);
        }
    });
}

fn finish(world: &mut World, run: &mut Run) {
    if run.adapter.is_empty() {
        return;
    }
    let stats = Recorder::stats(world, Some(std::mem::take(&mut run.adapter)));
    stats.print();
    run.pictures.write_stats(&stats);
    let exit = if run.pictures.failed() { AppExit::error() } else { AppExit::Success };
    world.write_message(exit);
}
