//! Where the particles of a body are, and the mesh with them.

use glam::{Quat, Vec3};
use polpo_rig::{Mesh, Rig};
use polpo_skinning::cpu::{SkinnedVertices, skin};
use polpo_skinning::{Binding, BindingError, ParticleTransform, RestMesh};

/// A body as it lies in the world.
#[derive(Debug, Clone)]
pub(crate) struct Pose {
    /// Centres of the particles \[m\].
    pub(crate) positions: Vec<Vec3>,
    /// Their rotations since rest.
    pub(crate) rotations: Vec<Quat>,
    /// The body's size, as a multiple of the rig's.
    pub(crate) scale: f32,
}

impl Pose {
    /// As the rig was made.
    pub(crate) fn rest(rig: &Rig) -> Pose {
        Pose {
            positions: rig.particles.iter().map(|p| p.position).collect(),
            rotations: vec![Quat::IDENTITY; rig.particles.len()],
            scale: 1.0,
        }
    }
}

/// The mesh as its rig carries it, by the kernel that skins in games too.
///
/// # Errors
/// If the rig is not one of this mesh.
pub(crate) fn skinned(mesh: &Mesh, rig: &Rig, pose: &Pose) -> Result<Mesh, BindingError> {
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    let normals: Vec<[f32; 3]> = mesh.normals.iter().map(|n| n.to_array()).collect();
    let rest: Vec<Vec3> = rig.particles.iter().map(|p| p.position).collect();
    let binding = Binding::new(
        RestMesh { positions: &positions, normals: &normals, tangents: &[] },
        &rest,
        rig.skin.iter().map(|i| (i.particles, i.weights)),
    )?;
    let moved = pose.positions.iter().zip(&pose.rotations).zip(binding.rest_particles());
    let transforms: Vec<ParticleTransform> = moved.map(|((&p, &q), &rest)| ParticleTransform::new(p, q, pose.scale, rest)).collect();
    let (mut new_positions, mut new_normals) = (positions, normals);
    skin(&binding, &transforms, SkinnedVertices { positions: &mut new_positions, normals: Some(&mut new_normals), tangents: None });
    Ok(Mesh {
        positions: new_positions.into_iter().map(Vec3::from).collect(),
        normals: new_normals.into_iter().map(Vec3::from).collect(),
        ..mesh.clone()
    })
}
