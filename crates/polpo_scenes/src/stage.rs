//! Light, camera and air, the same for all scenes.

use bevy::camera::{Exposure, Hdr};
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap};
use bevy::pbr::{DistanceFog, FogFalloff};
use bevy::prelude::*;

/// Where a scene wants to be seen from.
#[derive(Resource, Debug, Clone, Copy)]
pub struct View {
    /// The eye \[m\].
    pub eye: Vec3,
    /// What it looks at \[m\].
    pub target: Vec3,
}

impl Default for View {
    fn default() -> Self {
        Self { eye: Vec3::new(3.0, 2.0, 5.0), target: Vec3::new(0.0, 0.6, 0.0) }
    }
}

const SKY: Color = Color::srgb(0.62, 0.74, 0.84);

/// Lights the scene and puts a camera into it.
pub(crate) struct StagePlugin;

impl Plugin for StagePlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(ClearColor(SKY))
            .insert_resource(GlobalAmbientLight { color: Color::srgb(0.75, 0.85, 1.0), brightness: 300.0, ..default() })
            .insert_resource(DirectionalLightShadowMap { size: 4096 })
            .init_resource::<View>()
            .add_systems(Startup, light)
            .add_systems(PostStartup, place_camera);
    }
}

fn light(mut commands: Commands) {
    commands.spawn((
        DirectionalLight { color: Color::srgb(1.0, 0.95, 0.86), illuminance: 11_500.0, shadow_maps_enabled: true, ..default() },
        Transform::from_xyz(4.0, 9.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y),
        CascadeShadowConfigBuilder { num_cascades: 2, first_cascade_far_bound: 8.0, maximum_distance: 24.0, ..default() }.build(),
    ));
    // From behind, cool and without shadows: it draws the edge of what is round.
    commands.spawn((
        DirectionalLight { color: Color::srgb(0.7, 0.82, 1.0), illuminance: 2_600.0, shadow_maps_enabled: false, ..default() },
        Transform::from_xyz(-6.0, 4.0, -7.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

/// The camera of the scene.
#[derive(Component)]
pub(crate) struct SceneCamera;

pub(crate) fn place_camera(mut commands: Commands, view: Res<View>) {
    commands.spawn((
        SceneCamera,
        IsDefaultUiCamera,
        Camera3d::default(),
        // The sky goes through the same tone mapping as what stands before it.
        Hdr,
        Exposure::default(),
        Tonemapping::TonyMcMapface,
        Msaa::Sample4,
        Transform::from_translation(view.eye).looking_at(view.target, Vec3::Y),
        DistanceFog { color: SKY, falloff: FogFalloff::Linear { start: 9.0, end: 34.0 }, ..default() },
    ));
}
