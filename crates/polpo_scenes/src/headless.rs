//! An example without a window.

use std::process::ExitCode;
use std::time::Duration;

use bevy::asset::RenderAssetUsages;
use bevy::camera::{CameraOutputMode, RenderTarget};
use bevy::log::LogPlugin;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::diagnostic::RenderDiagnosticsPlugin;
use bevy::render::render_resource::{Extent3d, PollType, TextureDimension, TextureFormat, TextureUsages};
use bevy::render::renderer::RenderDevice;
use bevy::render::view::screenshot::Screenshot;
use bevy::time::TimeUpdateStrategy;
use bevy::window::ExitCondition;
use bevy::winit::WinitPlugin;
use polpo::prelude::*;
use polpo::render::SkinningBackend;

use crate::pictures::Pictures;
use crate::recorder::Recorder;
use crate::run::{DEFAULT_SECONDS, RATE, add_simulation, task_pools};
use crate::stage::{SceneCamera, StagePlugin};
use crate::{Options, overlay};

const WIDTH: u32 = 1280;
const HEIGHT: u32 = 720;

pub(crate) fn run(name: &'static str, options: &Options, adapter: Option<String>, build: impl FnOnce(&mut App)) -> ExitCode {
    let mut app = App::new();
    if adapter.is_some() {
        add_renderer(&mut app, options);
    } else {
        app.add_plugins((
            MinimalPlugins.set(task_pools(options)),
            LogPlugin::default(),
            options.asset_plugin(),
            PolpoRenderPlugin { backend: SkinningBackend::Cpu, ..default() },
        ))
        .init_asset::<Mesh>();
    }
    add_simulation(&mut app, name, options);
    app.insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
    build(&mut app);
    app.finish();
    app.cleanup();

    let steps = (f64::from(options.seconds.unwrap_or(DEFAULT_SECONDS)) * RATE).round().max(1.0) as u64;
    let mut pictures = Pictures::new(options);
    // The first update has no time in it; a scene that never steps would loop for ever.
    let mut idle = 0;
    let mut last = 0;
    while app.world().resource::<Recorder>().steps() < steps && idle < 100 {
        update(&mut app);
        if let Some(AppExit::Error(code)) = app.should_exit() {
            return ExitCode::from(code.get());
        }
        let done = app.world().resource::<Recorder>().steps();
        // A scene that waits for its files stops the clock.
        let waits = app.world().resource::<Time<Virtual>>().is_paused();
        if waits {
            std::thread::sleep(Duration::from_millis(5));
        }
        idle = if done == last && !waits { idle + 1 } else { 0 };
        if adapter.is_some() && done != last {
            pictures.each_step(done, |path| capture(&mut app, path));
        }
        last = done;
    }
    if adapter.is_some() {
        pictures.at_end(|path| capture(&mut app, path));
    }
    let stats = Recorder::stats(app.world_mut(), adapter);
    stats.print();
    pictures.write_stats(&stats);
    pictures.exit_code()
}

fn add_renderer(app: &mut App, options: &Options) {
    app.add_plugins((
        DefaultPlugins
            .set(task_pools(options))
            .set(options.asset_plugin())
            .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
            // Every shader is there for the first picture.
            .set(RenderPlugin { synchronous_pipeline_compilation: true, ..default() })
            .disable::<WinitPlugin>(),
        RenderDiagnosticsPlugin,
        PolpoRenderPlugin::default(),
        StagePlugin,
        overlay::CaptionPlugin,
    ))
    .add_systems(PostStartup, aim_at_image.after(crate::stage::place_camera));
}

/// Where the pictures are drawn.
#[derive(Resource)]
struct Canvas(Handle<Image>);

/// Without a window the camera draws into an image, and only when a picture is wanted.
fn aim_at_image(mut commands: Commands, mut images: ResMut<Assets<Image>>, mut camera: Single<(Entity, &mut Camera), With<SceneCamera>>) {
    let size = Extent3d { width: WIDTH, height: HEIGHT, depth_or_array_layers: 1 };
    let mut image = Image::new_uninit(size, TextureDimension::D2, TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::RENDER_WORLD);
    image.texture_descriptor.usage |= TextureUsages::RENDER_ATTACHMENT;
    let canvas = images.add(image);
    let (entity, camera) = &mut *camera;
    camera.is_active = false;
    camera.output_mode = CameraOutputMode::default();
    commands.entity(*entity).insert(RenderTarget::from(canvas.clone()));
    commands.insert_resource(Canvas(canvas));
}

/// One update, and wait until the graphics are done with it, so that they do not run into the next step's timings.
fn update(app: &mut App) {
    app.update();
    if let Some(device) = app.world().get_resource::<RenderDevice>() {
        let _ = device.wgpu_device().poll(PollType::Wait { submission_index: None, timeout: Some(Duration::from_secs(60)) });
    }
}

/// Draws the scene as it stands; time stands still meanwhile.
fn capture(app: &mut App, path: &std::path::Path) -> Result<(), String> {
    let world = app.world_mut();
    world.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO));
    set_camera(world, true);
    // Meshes and textures that came with the last update reach the graphics card in the next.
    for _ in 0..3 {
        update(app);
    }
    let canvas = app.world().resource::<Canvas>().0.clone();
    let shot = crate::pictures::shoot(app.world_mut(), Screenshot::image(canvas), path);
    let mut result = None;
    for _ in 0..20 {
        update(app);
        result = shot.take();
        if result.is_some() {
            break;
        }
    }
    let world = app.world_mut();
    set_camera(world, false);
    world.insert_resource(TimeUpdateStrategy::FixedTimesteps(1));
    result.unwrap_or_else(|| Err(format!("{}: the graphics driver gave no picture", path.display())))
}

fn set_camera(world: &mut World, active: bool) {
    let mut cameras = world.query_filtered::<&mut Camera, With<SceneCamera>>();
    for mut camera in cameras.iter_mut(world) {
        camera.is_active = active;
    }
}
