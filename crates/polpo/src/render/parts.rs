//! Bodies of several meshes: each part is an entity of its own.

use std::ops::Range;

use bevy::prelude::*;

/// Makes the `Mesh3d` beside it a part of a body: a run of the vertices that the body's rig was made for.
///
/// The skinned vertices are in the space of the body's `Transform`, so a part should be a child of the body and its own `Transform` the identity. Every part has its own mesh and material, and is culled by itself.
#[derive(Component, Debug, Clone, PartialEq, Eq)]
#[relationship(relationship_target = SkinParts)]
pub struct SkinPart {
    /// The body.
    #[relationship]
    pub body: Entity,
    /// The vertices of the rig that this mesh has, as many as it has.
    pub vertices: Range<u32>,
}

/// The parts of a body.
#[derive(Component, Debug, Default)]
#[relationship_target(relationship = SkinPart)]
pub struct SkinParts(Vec<Entity>);
