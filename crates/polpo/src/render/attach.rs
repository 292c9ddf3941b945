//! Giving each body a mesh of its own, and taking it away again.
//!
//! A skinned vertex buffer belongs to one body, so the `Mesh3d` of a body, or of a part of it, is replaced by a copy of the user's mesh. The rest data behind it is the same for every body of
//! that mesh and rig and is shared. Another `Mesh3d`, another rig, other vertices or a change to the mesh asset binds anew; when the `SoftBody` goes, the user's handle comes back.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Weak};

use bevy::asset::RenderAssetUsages;
use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::NoAutoAabb;
use bevy::mesh::{MeshVertexAttributeId, VertexAttributeValues};
use bevy::prelude::*;
use polpo_rig::Rig;
use polpo_skinning::{Binding, BindingError, RestMesh, VertexLayout};

use super::SkinningStats;
use super::cpu_fallback::write_vertices;
use super::parts::SkinPart;
use super::pose::{Pose, SkinPose, middle};
use crate::{Particles, SoftBody};

/// A mesh that follows a body's particles. Comes to every [`SoftBody`] or [`SkinPart`] that has a `Mesh3d` which the rig fits, as soon as the mesh is loaded; goes with it.
#[derive(Component, Debug)]
pub struct Skin {
    /// The user's mesh, which comes back when the body goes.
    source: Handle<Mesh>,
    /// The body's own copy, in its `Mesh3d`.
    instance: Handle<Mesh>,
    pub(super) shared: Arc<SharedBinding>,
}

impl Skin {
    /// The mesh that was on the entity, undeformed. `Mesh3d` now holds a copy of it, which lives in the render world only (unless the CPU skins) and is deformed there.
    pub fn source(&self) -> &Handle<Mesh> {
        &self.source
    }

    /// The body's own mesh, which is in its `Mesh3d`.
    pub fn instance(&self) -> &Handle<Mesh> {
        &self.instance
    }

    /// The packed rest mesh, shared by all bodies of the same mesh and rig.
    pub fn binding(&self) -> &Binding {
        &self.shared.binding
    }

    /// Where the attributes lie in the mesh's vertices.
    pub fn layout(&self) -> VertexLayout {
        self.shared.layout
    }
}

/// What bodies of the same mesh and rig share.
#[derive(Debug)]
pub(super) struct SharedBinding {
    pub(super) binding: Binding,
    pub(super) layout: VertexLayout,
    rig: Arc<Rig>,
    /// The rig's vertices that the mesh has.
    vertices: Range<u32>,
}

/// The bindings in use, by source mesh, rig, and the first and the end of its vertices. A rig's address stands for the rig: the binding holds on to it, so the address stays taken while the entry is alive.
#[derive(Resource, Debug, Default)]
pub(super) struct Bindings(BTreeMap<(AssetId<Mesh>, usize, [u32; 2]), Weak<SharedBinding>>);

/// Why a body's mesh does not follow its particles.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkinError {
    /// The mesh is in the render world only, so there is nothing to bind: load it with `RenderAssetUsages::MAIN_WORLD` as well.
    #[error("the mesh's data is in the render world only; load it with RenderAssetUsages::MAIN_WORLD as well")]
    NotInMainWorld,
    /// The mesh has no attribute of that name, or it is not made of f32.
    #[error("the mesh has no f32 attribute {0}")]
    Attribute(&'static str),
    /// The mesh is not the one the rig was made for.
    #[error("the mesh has {mesh} vertices, the rig was made for {rig}")]
    VertexCount {
        /// Vertices of the mesh.
        mesh: usize,
        /// Vertices the rig has influences for, in all or in this part.
        rig: usize,
    },
    /// A vertex is not a whole number of 32-bit words, or an attribute is not aligned to one.
    #[error("a vertex of {stride} bytes with an attribute at byte {offset} is not made of whole words")]
    Alignment {
        /// Bytes of a vertex.
        stride: u64,
        /// Byte offset of the attribute.
        offset: u64,
    },
    /// The rig's influences or the mesh's vertices are broken.
    #[error("{0}")]
    Binding(#[from] BindingError),
}

/// Triggered on a body, or a part of one, whose mesh cannot follow its particles; the mesh stays as it is. Tried again when it gets another mesh, rig or run of vertices, or the mesh asset changes.
#[derive(EntityEvent, Debug, Clone)]
pub struct SkinRejected {
    /// The body, or the part.
    pub entity: Entity,
    /// What was wrong.
    pub reason: SkinError,
}

/// What was refused, so that it is neither tried nor reported again every frame.
#[derive(Component, Debug)]
pub(super) struct Refused {
    mesh: AssetId<Mesh>,
    rig: Arc<Rig>,
    vertices: Range<u32>,
}

type Bodies<'a> = (&'a SoftBody, &'a Particles, Option<&'a SkinPose>);

type Attachable<'a> = (Entity, Option<&'a SkinPart>, &'a mut Mesh3d, Option<&'a Skin>, Option<&'a Refused>);

/// Binds bodies, and their parts, that are new or whose mesh, rig or vertices changed.
pub(super) fn attach_skins(
    mut commands: Commands,
    bodies: Query<Bodies>,
    mut attachable: Query<Attachable, Or<(With<SoftBody>, With<SkinPart>)>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut bindings: ResMut<Bindings>,
    (mut events, mut modified): (MessageReader<AssetEvent<Mesh>>, Local<Vec<AssetId<Mesh>>>),
    stats: Res<SkinningStats>,
) {
    modified.clear();
    modified.extend(events.read().filter_map(|event| match event {
        AssetEvent::Modified { id } => Some(*id),
        _ => None,
    }));
    if !modified.is_empty() {
        bindings.0.retain(|(mesh, ..), _| !modified.contains(mesh));
    }
    for (entity, part, mut mesh3d, skin, refused) in &mut attachable {
        let owner = part.map_or(entity, |part| part.body);
        let Ok((body, particles, pose)) = bodies.get(owner) else {
            continue;
        };
        let vertices = part.map_or(0..body.rig.skin.len() as u32, |part| part.vertices.clone());
        let is_of = |rig: &Arc<Rig>, of: &Range<u32>| Arc::ptr_eq(rig, &body.rig) && *of == vertices;
        let source = match skin {
            // The user's mesh is still the source as long as nobody put another one into `Mesh3d`.
            Some(skin) if mesh3d.0 == skin.instance => {
                if is_of(&skin.shared.rig, &skin.shared.vertices) && !modified.contains(&skin.source.id()) {
                    continue;
                }
                skin.source.clone()
            }
            _ => mesh3d.0.clone(),
        };
        if let Some(refused) = refused
            && refused.mesh == source.id()
            && is_of(&refused.rig, &refused.vertices)
            && !modified.contains(&refused.mesh)
        {
            continue;
        }
        // Not loaded yet, or gone: nothing to bind, and nothing to complain about.
        let Some(mesh) = meshes.get(&source) else {
            continue;
        };
        match bind(&mut bindings, source.id(), mesh, &body.rig, vertices.clone()) {
            Ok(shared) => {
                let mut instance = mesh.clone();
                instance.asset_usage = if stats.on_cpu { RenderAssetUsages::all() } else { RenderAssetUsages::RENDER_WORLD };
                // The copy starts in the body's pose and space, so that its first upload is already right.
                let mut present = SkinPose::new(&body.rig);
                present.take(&Pose::present(particles));
                write_vertices(&mut instance, &shared.binding, present.transforms());
                if pose.is_none_or(|pose| !pose.is_of(&body.rig)) {
                    commands.entity(owner).try_insert(present);
                }
                let instance = meshes.add(instance);
                mesh3d.0 = instance.clone();
                let skin = (Skin { source, instance, shared }, Aabb::default(), NoAutoAabb);
                commands.entity(entity).try_remove::<Refused>().try_insert(skin);
            }
            Err(reason) => {
                tracing::error!("the mesh of soft body {entity} stays undeformed: {reason}");
                let refused = Refused { mesh: source.id(), rig: body.rig.clone(), vertices };
                if skin.is_some() {
                    mesh3d.0 = source;
                }
                commands.entity(entity).try_remove::<(Skin, NoAutoAabb, Aabb)>().try_insert(refused);
                commands.trigger(SkinRejected { entity, reason });
            }
        }
    }
}

/// Gives back the user's mesh where the body, its particles or the mesh component is gone.
pub(super) fn detach_skins(
    mut commands: Commands,
    mut skinned: Query<(Entity, &Skin, Option<&SkinPart>, Option<&mut Mesh3d>)>,
    bodies: Query<(), (With<SoftBody>, With<Particles>)>,
) {
    for (entity, skin, part, mesh3d) in &mut skinned {
        if mesh3d.is_some() && bodies.contains(part.map_or(entity, |part| part.body)) {
            continue;
        }
        if let Some(mut mesh3d) = mesh3d
            && mesh3d.0 == skin.instance
        {
            mesh3d.0 = skin.source.clone();
        }
        commands.entity(entity).try_remove::<(Skin, NoAutoAabb, Aabb)>();
    }
}

/// The shared binding of this mesh to these vertices of the rig, made if nobody has it.
fn bind(
    bindings: &mut Bindings,
    id: AssetId<Mesh>,
    mesh: &Mesh,
    rig: &Arc<Rig>,
    vertices: Range<u32>,
) -> Result<Arc<SharedBinding>, SkinError> {
    let key = (id, Arc::as_ptr(rig) as usize, [vertices.start, vertices.end]);
    if let Some(shared) = bindings.0.get(&key).and_then(Weak::upgrade) {
        return Ok(shared);
    }
    let layout = vertex_layout(mesh)?;
    let positions = vectors(mesh, Mesh::ATTRIBUTE_POSITION.id).ok_or(SkinError::Attribute("position"))?;
    let normals = vectors(mesh, Mesh::ATTRIBUTE_NORMAL.id).unwrap_or(&[]);
    let tangents = match mesh.try_attribute_option(Mesh::ATTRIBUTE_TANGENT) {
        Ok(Some(VertexAttributeValues::Float32x4(values))) => values.as_slice(),
        _ => &[],
    };
    // Bevy cuts all attributes to the shortest.
    let count = mesh.count_vertices();
    let skin = rig.skin.get(vertices.start as usize..vertices.end as usize).unwrap_or_default();
    if count != skin.len() || positions.len() != count {
        return Err(SkinError::VertexCount { mesh: count, rig: skin.len() });
    }
    let particles: Vec<Vec3> = rig.particles.iter().map(|particle| particle.position).collect();
    let binding = Binding::about(
        middle(rig),
        RestMesh { positions, normals: cut(normals, count), tangents: cut(tangents, count) },
        &particles,
        skin.iter().map(|influences| (influences.particles, influences.weights)),
    )?;
    let shared = Arc::new(SharedBinding { binding, layout, rig: rig.clone(), vertices });
    bindings.0.retain(|_, shared| shared.strong_count() > 0);
    bindings.0.insert(key, Arc::downgrade(&shared));
    Ok(shared)
}

fn cut<T>(values: &[T], len: usize) -> &[T] {
    values.get(..len).unwrap_or(values)
}

fn vectors(mesh: &Mesh, id: MeshVertexAttributeId) -> Option<&[[f32; 3]]> {
    match mesh.try_attribute_option(id) {
        Ok(Some(VertexAttributeValues::Float32x3(values))) => Some(values),
        _ => None,
    }
}

/// Where position, normal and tangent lie: Bevy packs a mesh's attributes in the order of their ids, without gaps.
fn vertex_layout(mesh: &Mesh) -> Result<VertexLayout, SkinError> {
    let attributes = mesh.try_attributes().map_err(|_| SkinError::NotInMainWorld)?;
    let (mut position, mut normal, mut tangent) = (None, None, None);
    let mut stride = 0;
    for (attribute, values) in attributes {
        let offset = Some(stride);
        match values {
            VertexAttributeValues::Float32x3(_) if attribute.id == Mesh::ATTRIBUTE_POSITION.id => position = offset,
            VertexAttributeValues::Float32x3(_) if attribute.id == Mesh::ATTRIBUTE_NORMAL.id => normal = offset,
            VertexAttributeValues::Float32x4(_) if attribute.id == Mesh::ATTRIBUTE_TANGENT.id => tangent = offset,
            _ => {}
        }
        stride += attribute.format.size();
    }
    let words = |offset: u64| {
        if stride.is_multiple_of(4) && offset.is_multiple_of(4) {
            Ok((offset / 4) as u32)
        } else {
            Err(SkinError::Alignment { stride, offset })
        }
    };
    Ok(VertexLayout {
        stride: (stride / 4) as u32,
        position: words(position.ok_or(SkinError::Attribute("position"))?)?,
        normal: normal.map(words).transpose()?,
        tangent: tangent.map(words).transpose()?,
    })
}
