//! Where there are no compute shaders: the CPU mirror writes the mesh asset, and Bevy uploads it again. Every body, seen or not, every frame.

use bevy::mesh::VertexAttributeValues;
use bevy::platform::time::Instant;
use bevy::prelude::*;
use polpo_skinning::cpu::{SkinnedVertices, skin};
use polpo_skinning::{Binding, ParticleTransform};

use super::SkinningStats;
use super::attach::Skin;
use super::parts::SkinPart;
use super::pose::SkinPose;

/// Writes the skinned vertices into each body's own mesh.
pub(super) fn skin_on_cpu(
    skins: Query<(Entity, &Skin, Option<&SkinPart>)>,
    poses: Query<&SkinPose>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut stats: ResMut<SkinningStats>,
) {
    let started = Instant::now();
    for (entity, skin, part) in &skins {
        if let Ok(pose) = poses.get(part.map_or(entity, |part| part.body))
            && let Some(mut mesh) = meshes.get_mut(skin.instance())
        {
            write_vertices(&mut mesh, skin.binding(), pose.transforms());
        }
    }
    stats.cpu_skin_time = started.elapsed();
}

/// Writes positions, normals and tangents; does nothing to a mesh whose data is in the render world only.
pub(super) fn write_vertices(mesh: &mut Mesh, binding: &Binding, transforms: &[ParticleTransform]) {
    let Ok(attributes) = mesh.try_attributes_mut() else {
        return;
    };
    let (mut positions, mut normals, mut tangents) = (None, None, None);
    for (attribute, values) in attributes {
        if attribute.id == Mesh::ATTRIBUTE_POSITION.id {
            positions = vectors(values);
        } else if attribute.id == Mesh::ATTRIBUTE_NORMAL.id {
            normals = vectors(values);
        } else if attribute.id == Mesh::ATTRIBUTE_TANGENT.id
            && let VertexAttributeValues::Float32x4(values) = values
        {
            tangents = Some(values.as_mut_slice());
        }
    }
    let Some(positions) = positions else {
        return;
    };
    skin(binding, transforms, SkinnedVertices { positions, normals, tangents });
}

fn vectors(values: &mut VertexAttributeValues) -> Option<&mut [[f32; 3]]> {
    match values {
        VertexAttributeValues::Float32x3(values) => Some(values),
        _ => None,
    }
}
