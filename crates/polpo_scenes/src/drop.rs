//! Any mesh, rigged on the spot, falls on a floor.

use std::path::Path;
use std::sync::Arc;

use bevy::prelude::*;
use polpo::prelude::*;
use polpo_rapier::RapierWorld;
use polpo_rig::{EdgeAmount, Mesh as RigMesh, MeshError, Recipe, Rig, RigError, build_rig, read_mesh};
use rapier3d::na::Unit;
use rapier3d::prelude::ColliderBuilder;

use crate::noise::Noise;
use crate::outfit::Outfit;
use crate::props::spawn_prop;
use crate::stage::View;

/// Bodies made from one mesh fall on a floor with a step.
pub struct DropScene {
    mesh: Arc<RigMesh>,
    rig: Arc<Rig>,
    scale: f32,
    count: usize,
    seed: u64,
}

/// Why a mesh could not be dropped.
#[derive(Debug)]
pub enum DropSceneError {
    /// The mesh could not be read.
    Mesh(MeshError),
    /// The mesh could not be rigged.
    Rig(RigError),
}

impl std::fmt::Display for DropSceneError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Mesh(error) => error.fmt(f),
            Self::Rig(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for DropSceneError {}

impl DropScene {
    /// Reads and rigs the mesh in `path`; `size` \[m\] is the largest side of its box in the scene, whatever the mesh's own unit.
    ///
    /// # Errors
    ///
    /// If the mesh cannot be read or rigged.
    pub fn new(path: &Path, particles: usize, edges: usize, size: f32, count: usize, seed: u64) -> Result<Self, DropSceneError> {
        let mesh = read_mesh(path).map_err(DropSceneError::Mesh)?;
        let rig = build_rig(&mesh, &Recipe { edges: EdgeAmount::Count(edges), ..Recipe::with_particles(particles) })
            .map_err(DropSceneError::Rig)?;
        let bounds = mesh.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
        let scale = size / (bounds.1 - bounds.0).max_element();
        Ok(Self { mesh: Arc::new(mesh), rig: Arc::new(rig), scale, count, seed })
    }
}

impl Plugin for DropScene {
    fn build(&self, app: &mut App) {
        let (mesh, rig, scale, count, seed) = (self.mesh.clone(), self.rig.clone(), self.scale, self.count, self.seed);
        app.insert_resource(View { eye: Vec3::new(1.6, 1.2, 2.6), target: Vec3::new(0.0, 0.45, 0.0) }).add_systems(
            Startup,
            move |mut commands: Commands, mut world: ResMut<RapierWorld>| {
                let floor = ColliderBuilder::halfspace(Unit::new_unchecked(Vec3::Y)).friction(0.7);
                spawn_prop(&mut commands, &mut world, floor, None, Color::srgb(0.80, 0.78, 0.74));
                let step = ColliderBuilder::cuboid(0.5, 0.12, 0.9).translation(Vec3::new(-0.75, 0.12, 0.0)).friction(0.6);
                spawn_prop(&mut commands, &mut world, step, None, Color::srgb(0.42, 0.50, 0.56));
                let mut noise = Noise::new(seed);
                for index in 0..count {
                    let place = Vec3::new(0.12 * noise.signed(), 1.3 + 1.2 * index as f32, 0.12 * noise.signed());
                    let turn = Quat::from_euler(EulerRot::YXZ, noise.signed(), 0.4 * noise.signed(), 0.4 * noise.signed());
                    commands.spawn((
                        Name::new(format!("body {index}")),
                        SoftBody::new(rig.clone()),
                        Outfit { mesh: mesh.clone(), color: Color::srgb(0.95, 0.62, 0.42) },
                        Transform::from_translation(place).with_rotation(turn).with_scale(Vec3::splat(scale)),
                    ));
                }
            },
        );
    }
}
