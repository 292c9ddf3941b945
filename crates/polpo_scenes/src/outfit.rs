//! The meshes that the scenes' bodies wear.

use std::sync::Arc;

use bevy::prelude::*;
use polpo::render::bevy_mesh;

/// The mesh a body of a scene wears, the one its rig was made for.
#[derive(Component, Debug, Clone)]
pub struct Outfit {
    /// Shared by all bodies that wear it.
    pub mesh: Arc<polpo_rig::Mesh>,
    /// Its paint, times the mesh's own colours.
    pub color: Color,
}

/// Gives bodies with an [`Outfit`] the mesh to draw; bodies with the same outfit start from the same asset.
pub(crate) fn dress_bodies(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: Option<ResMut<Assets<StandardMaterial>>>,
    bodies: Query<(Entity, &Outfit), Without<Mesh3d>>,
    mut made: Local<Vec<(Arc<polpo_rig::Mesh>, Handle<Mesh>)>>,
) {
    for (entity, outfit) in &bodies {
        let handle = match made.iter().find(|(mesh, _)| Arc::ptr_eq(mesh, &outfit.mesh)) {
            Some((_, handle)) => handle.clone(),
            None => {
                let handle = meshes.add(bevy_mesh(&outfit.mesh));
                made.push((outfit.mesh.clone(), handle.clone()));
                handle
            }
        };
        commands.entity(entity).insert(Mesh3d(handle));
        if let Some(materials) = &mut materials {
            let material = StandardMaterial { base_color: outfit.color, perceptual_roughness: 0.38, reflectance: 0.55, ..default() };
            commands.entity(entity).insert(MeshMaterial3d(materials.add(material)));
        }
    }
}
