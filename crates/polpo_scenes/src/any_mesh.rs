//! Any model in its own materials falls on a floor: one component a body.

use std::path::Path;

use bevy::prelude::*;
use polpo::{LoadError, RecipeAsset, RigAsset, SoftBody, SoftBodyLoadFailed, SoftBodyModel, SoftBodyReady, SoftBodyScene};
use polpo_rapier::RapierWorld;
use polpo_rig::Recipe;
use rapier3d::na::Unit;
use rapier3d::prelude::ColliderBuilder;

use crate::noise::Noise;
use crate::props::spawn_prop;
use crate::stage::View;

/// Bodies made of a model's file fall on a floor with a step. The clock starts when they are there.
#[derive(Resource, Debug, Clone)]
pub struct AnyMeshScene {
    /// The model, from the app's assets.
    pub model: String,
    /// A rig or a recipe for it (`.rig`, `.rig.ron`, `.rig.toml`), likewise.
    pub rig: Option<String>,
    /// By how many particles it is rigged if it has no rig and there is no recipe.
    pub particles: usize,
    /// Largest side of a body in the scene \[m\].
    pub size: f32,
    /// How many bodies.
    pub count: usize,
    /// What differs from run to run.
    pub seed: u64,
}

/// The model while it loads.
#[derive(Resource)]
struct Loading(Handle<SoftBodyModel>);

impl Plugin for AnyMeshScene {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.clone())
            .insert_resource(View { eye: Vec3::new(1.6, 1.2, 2.6), target: Vec3::new(0.0, 0.45, 0.0) })
            .add_systems(Startup, start)
            .add_systems(Update, spawn.run_if(resource_exists::<Loading>))
            .add_observer(begin)
            .add_observer(fail);
    }
}

fn start(
    mut commands: Commands,
    mut world: ResMut<RapierWorld>,
    mut time: ResMut<Time<Virtual>>,
    scene: Res<AnyMeshScene>,
    assets: Res<AssetServer>,
) {
    let floor = ColliderBuilder::halfspace(Unit::new_unchecked(Vec3::Y)).friction(0.7);
    spawn_prop(&mut commands, &mut world, floor, None, Color::srgb(0.80, 0.78, 0.74));
    let step = ColliderBuilder::cuboid(0.5, 0.12, 0.9).translation(Vec3::new(-0.75, 0.12, 0.0)).friction(0.6);
    spawn_prop(&mut commands, &mut world, step, None, Color::srgb(0.42, 0.50, 0.56));
    commands.insert_resource(Loading(assets.load(scene.model.clone())));
    time.pause();
}

/// A game knows the unit of its models; here it is looked up.
fn spawn(
    mut commands: Commands,
    scene: Res<AnyMeshScene>,
    loading: Res<Loading>,
    models: Res<Assets<SoftBodyModel>>,
    assets: Res<AssetServer>,
    mut recipes: ResMut<Assets<RecipeAsset>>,
    exit: MessageWriter<AppExit>,
) {
    let Some(model) = models.get(&loading.0) else {
        if let bevy::asset::LoadState::Failed(error) = assets.load_state(&loading.0) {
            give_up(&LoadError::Asset(error), exit);
            commands.remove_resource::<Loading>();
        }
        return;
    };
    let body = SoftBodyScene::new(loading.0.clone());
    let body = match &scene.rig {
        Some(recipe) if Path::new(recipe).extension().is_some_and(|e| e == "toml") => body.with_recipe(assets.load(recipe.clone())),
        Some(rig) => body.with_rig(assets.load::<RigAsset>(rig.clone())),
        None if model.rig().is_ok_and(|rig| rig.is_some()) => body,
        None => body.with_recipe(recipes.add(RecipeAsset(Recipe::with_particles(scene.particles)))),
    };
    let positions = &model.mesh().positions;
    let (low, high) = positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
    let scale = scene.size / (high - low).max_element();
    let mut noise = Noise::new(scene.seed);
    for index in 0..scene.count {
        let place = Vec3::new(0.12 * noise.signed(), 1.3 + 1.2 * index as f32, 0.12 * noise.signed());
        let turn = Quat::from_euler(EulerRot::YXZ, noise.signed(), 0.4 * noise.signed(), 0.4 * noise.signed());
        // The model's middle is put in its place, wherever its origin is.
        let transform =
            Transform::from_translation(place - turn * (0.5 * scale * (low + high))).with_rotation(turn).with_scale(Vec3::splat(scale));
        commands.spawn((Name::new(format!("body {index}")), body.clone(), transform));
    }
    commands.remove_resource::<Loading>();
}

/// Once: afterwards the clock is the user's, and a file may change.
fn begin(
    _: On<SoftBodyReady>,
    waiting: Query<(), (With<SoftBodyScene>, Without<SoftBody>)>,
    mut time: ResMut<Time<Virtual>>,
    mut begun: Local<bool>,
) {
    if waiting.is_empty() && !*begun {
        *begun = true;
        time.unpause();
    }
}

/// A body that is there stays as it was.
fn fail(failed: On<SoftBodyLoadFailed>, bodies: Query<(), With<SoftBody>>, exit: MessageWriter<AppExit>) {
    if !bodies.contains(failed.entity) {
        give_up(&failed.reason, exit);
    }
}

fn give_up(reason: &LoadError, mut exit: MessageWriter<AppExit>) {
    eprintln!("{reason}");
    exit.write(AppExit::error());
}
