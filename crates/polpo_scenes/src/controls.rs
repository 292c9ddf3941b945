//! Keys and mouse.

use bevy::app::FixedMain;
use bevy::prelude::*;
use bevy::window::PrimaryWindow;
use bevy_panorbit_camera::PanOrbitCamera;
use polpo::render::{PolpoGizmoGroup, PolpoGizmos, PolpoGizmosPlugin};
use polpo::{Grab, Particles, Stiffness};

use crate::overlay::ShowTimings;
use crate::stage::SceneCamera;

/// Pause, single step, toggles, and a mouse that grabs.
pub(crate) struct ControlsPlugin;

impl Plugin for ControlsPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(PolpoGizmosPlugin).add_systems(Startup, draw_through).add_systems(Update, (press_keys, grab_with_mouse));
    }
}

/// Particles and edges are inside the mesh: they are drawn over it.
fn draw_through(mut store: ResMut<GizmoConfigStore>) {
    let (config, _) = store.config_mut::<PolpoGizmoGroup>();
    config.depth_bias = -1.0;
    config.line.width = 1.5;
}

fn press_keys(
    keys: Res<ButtonInput<KeyCode>>,
    mut time: ResMut<Time<Virtual>>,
    mut gizmos: ResMut<PolpoGizmos>,
    mut timings: ResMut<ShowTimings>,
    mut commands: Commands,
) {
    if keys.just_pressed(KeyCode::Space) {
        if time.is_paused() { time.unpause() } else { time.pause() }
    }
    if keys.just_pressed(KeyCode::KeyN) {
        time.pause();
        commands.queue(step_once);
    }
    if keys.just_pressed(KeyCode::Digit1) {
        gizmos.particles = !gizmos.particles;
    }
    if keys.just_pressed(KeyCode::Digit2) {
        gizmos.edges = !gizmos.edges;
    }
    if keys.just_pressed(KeyCode::Digit3) {
        gizmos.contacts = !gizmos.contacts;
    }
    if keys.just_pressed(KeyCode::KeyT) {
        timings.0 = !timings.0;
    }
}

/// Runs the fixed schedules once, as Bevy's own loop does.
fn step_once(world: &mut World) {
    let generic = world.resource::<Time>().as_generic();
    let mut fixed = world.resource_mut::<Time<Fixed>>();
    let timestep = fixed.timestep();
    fixed.advance_by(timestep);
    let present = fixed.as_generic();
    *world.resource_mut::<Time>() = present;
    let _ = world.try_run_schedule(FixedMain);
    *world.resource_mut::<Time>() = generic;
}

/// How strongly the mouse pulls \[Hz\].
const HAND: f32 = 30.0;

/// What the mouse holds.
struct Held {
    body: Entity,
    /// Distance of the particle from the eye, along the direction in which the camera looks \[m\].
    depth: f32,
}

/// A press on a body grabs the nearest particle under the cursor; it then follows the mouse in the plane that faces the camera.
fn grab_with_mouse(
    buttons: Res<ButtonInput<MouseButton>>,
    window: Single<&Window, With<PrimaryWindow>>,
    mut camera: Single<(&Camera, &GlobalTransform, &mut PanOrbitCamera), With<SceneCamera>>,
    mut bodies: Query<(Entity, &Particles, &Transform, Option<&mut Grab>)>,
    mut held: Local<Option<Held>>,
    mut commands: Commands,
) {
    let (camera, eye, orbit) = &mut *camera;
    if buttons.just_released(MouseButton::Left) {
        if let Some(held) = held.take() {
            commands.entity(held.body).try_remove::<Grab>();
        }
        orbit.enabled = true;
    }
    let Some(ray) = window.cursor_position().and_then(|cursor| camera.viewport_to_world(eye, cursor).ok()) else {
        return;
    };
    if buttons.just_pressed(MouseButton::Left) {
        let hit = bodies
            .iter()
            .flat_map(|(entity, particles, transform, _)| {
                particles.position.iter().zip(&particles.radii).enumerate().filter_map(move |(i, (x, radii))| {
                    let center = transform.translation + Vec3::from(*x);
                    let along = (center - ray.origin).dot(*ray.direction);
                    let beside = (center - ray.origin - ray.direction * along).length();
                    (along > 0.0 && beside < radii.max_element()).then_some((along, entity, i as u32, center))
                })
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, body, particle, center)) = hit {
            orbit.enabled = false;
            *held = Some(Held { body, depth: (center - eye.translation()).dot(*eye.forward()) });
            commands.entity(body).insert(Grab { particle, target: center, stiffness: Stiffness::hertz(HAND) });
        }
        return;
    }
    if let Some(held) = &*held
        && let Ok((_, _, _, Some(mut grab))) = bodies.get_mut(held.body)
    {
        let share = ray.direction.dot(*eye.forward());
        if share > 1e-3 {
            grab.target = ray.origin + ray.direction * (held.depth / share);
        }
    }
}
