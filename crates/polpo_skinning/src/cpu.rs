//! The mirror of `skin.wgsl`: the same packed data, the same names, the same order of operations. It is the fallback where there is no compute shader, and what the shader is tested against.

use glam::{Vec3, Vec4};

use crate::{Binding, ParticleTransform, RestVertex};

/// Squared length \[1\] under which a blended normal has no direction and the rest normal stays.
pub const DEGENERATE_LENGTH_SQUARED: f32 = 1e-12;

/// Σ_k w_k·M_k over a vertex's four influences.
///
/// # Panics
/// If `transforms` is shorter than the binding's particles.
pub fn blend(vertex: &RestVertex, transforms: &[ParticleTransform]) -> ParticleTransform {
    let mut rows = [Vec4::ZERO; 3];
    for slot in 0..4 {
        let weight = vertex.weight(slot);
        let transform = &transforms[vertex.particle(slot) as usize];
        for (row, other) in rows.iter_mut().zip(transform.rows) {
            *row += weight * other;
        }
    }
    ParticleTransform { rows }
}

/// The rotation of `blended` applied to a rest normal or tangent, normalised; `direction` itself where the result has no direction.
pub fn blend_direction(blended: &ParticleTransform, direction: Vec3) -> Vec3 {
    let rotated = Vec3::new(
        blended.rows[0].truncate().dot(direction),
        blended.rows[1].truncate().dot(direction),
        blended.rows[2].truncate().dot(direction),
    );
    let length_squared = rotated.dot(rotated);
    if length_squared > DEGENERATE_LENGTH_SQUARED { rotated / length_squared.sqrt() } else { direction }
}

/// Where [`skin`] writes. A slice shorter than the mesh leaves the rest of the mesh out; `None` leaves that attribute alone.
#[derive(Debug)]
pub struct SkinnedVertices<'a> {
    /// Positions \[m\], one per vertex.
    pub positions: &'a mut [[f32; 3]],
    /// Unit normals, one per vertex.
    pub normals: Option<&'a mut [[f32; 3]]>,
    /// Unit tangents, one per vertex; the handedness in the fourth component is left alone.
    pub tangents: Option<&'a mut [[f32; 4]]>,
}

/// Skins the whole mesh. `transforms` holds one map per particle of `binding`; if it holds fewer, nothing is written and the answer is false.
pub fn skin(binding: &Binding, transforms: &[ParticleTransform], mut out: SkinnedVertices<'_>) -> bool {
    if transforms.len() < binding.rest_particles().len() {
        return false;
    }
    for (index, vertex) in binding.vertices().iter().enumerate() {
        let blended = blend(vertex, transforms);
        if let Some(position) = out.positions.get_mut(index) {
            *position = blended.transform_point(vertex.position.into()).into();
        }
        if binding.has_normals()
            && let Some(normal) = out.normals.as_mut().and_then(|n| n.get_mut(index))
        {
            *normal = blend_direction(&blended, vertex.normal.into()).into();
        }
        if let Some(&rest) = binding.tangents().get(index)
            && let Some(tangent) = out.tangents.as_mut().and_then(|t| t.get_mut(index))
        {
            let [x, y, z] = blend_direction(&blended, rest.into()).to_array();
            *tangent = [x, y, z, tangent[3]];
        }
    }
    true
}
