//! What the body of a model's file is drawn with: a child for each part, in the file's own material.
//!
//! Positions, normals and triangles are those that the rig was made for. What else a vertex has (texture coordinates, colours, tangents) and the materials come from Bevy's own reading of the file, whose nodes and primitives are
//! in the same order; joints and weights of bones and morph targets are left out, so that nothing else deforms the mesh.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use bevy::asset::{LoadState, RecursiveDependencyLoadState};
use bevy::ecs::system::SystemParam;
use bevy::gltf::{Gltf, GltfMaterial, GltfMaterialName, GltfMesh, GltfMeshName, GltfNode};
use bevy::mesh::{PrimitiveTopology, VertexAttributeValues};
use bevy::prelude::*;
use polpo_rig::MeshPart;

use crate::assets::{AwaitsDress, SceneBuilt};
use crate::render::{SkinPart, SkinParts, mesh_of_part};
use crate::{SoftBody, SoftBodyAssetSystems, SoftBodyModel, SoftBodyScene};

/// Dresses the bodies of [`SoftBodyScene`]s.
pub(crate) struct DressPlugin;

impl Plugin for DressPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Wardrobe>().add_observer(fetch_new).add_observer(dress).add_systems(
            Update,
            (fetch_changed.run_if(resource_exists::<Messages<AssetEvent<SoftBodyModel>>>), wait.run_if(any_with_component::<AwaitsDress>))
                .chain()
                .before(SoftBodyAssetSystems),
        );
    }
}

/// Bevy's own reading of the scene's file; there until the body is dressed.
#[derive(Component, Debug)]
struct Source(Handle<Gltf>);

/// A child that a scene brought.
#[derive(Component, Debug)]
struct ScenePart;

/// What the body wears.
#[derive(Component, Debug)]
struct Dressed(Arc<Clothes>);

/// The parts of a model, shared by all bodies made of it.
#[derive(Debug)]
struct Clothes {
    /// Its address stands for the model.
    model: Arc<polpo_rig::Mesh>,
    parts: Vec<Cloth>,
}

#[derive(Debug)]
struct Cloth {
    part: MeshPart,
    mesh: Handle<Mesh>,
    material: Handle<StandardMaterial>,
}

/// The clothes in use, by the address of the model's mesh.
#[derive(Resource, Debug, Default)]
struct Wardrobe(BTreeMap<usize, Weak<Clothes>>);

/// Everything that Bevy makes of a glTF.
#[derive(SystemParam)]
struct Files<'w> {
    server: Option<Res<'w, AssetServer>>,
    gltfs: Option<Res<'w, Assets<Gltf>>>,
    nodes: Option<Res<'w, Assets<GltfNode>>>,
    meshes: Option<Res<'w, Assets<GltfMesh>>>,
}

impl Files<'_> {
    /// Starts loading the glTF of a scene, if it is one and this app can.
    fn fetch(&self, commands: &mut Commands, entity: Entity, scene: &SoftBodyScene) {
        let (Some(server), Some(_)) = (&self.server, &self.gltfs) else { return };
        let Some(path) = server.get_path(&scene.model) else { return };
        if !path.path().extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf")) {
            return;
        }
        // Whoever loaded the model has approved of its path.
        let gltf = server.load_builder().override_unapproved().load(path.into_owned());
        commands.entity(entity).try_insert((AwaitsDress, Source(gltf)));
    }
}

fn fetch_new(insert: On<Insert, SoftBodyScene>, scenes: Query<&SoftBodyScene>, files: Files, mut commands: Commands) {
    if let Ok(scene) = scenes.get(insert.entity) {
        files.fetch(&mut commands, insert.entity, scene);
    }
}

/// A model that has changed, or has come after all, is not drawn as it was read before.
fn fetch_changed(
    mut events: MessageReader<AssetEvent<SoftBodyModel>>,
    scenes: Query<(Entity, &SoftBodyScene, Has<SoftBody>), Without<AwaitsDress>>,
    files: Files,
    mut commands: Commands,
) {
    for event in events.read() {
        let (id, come) = match event {
            AssetEvent::Modified { id } => (id, false),
            AssetEvent::Added { id } => (id, true),
            _ => continue,
        };
        for (entity, scene, is_body) in &scenes {
            if scene.model.id() == *id && !(come && is_body) {
                files.fetch(&mut commands, entity, scene);
            }
        }
    }
}

/// Bodies wait until their materials and textures are there, or will never be.
fn wait(waiting: Query<(Entity, Option<&Source>), With<AwaitsDress>>, server: Option<Res<AssetServer>>, mut commands: Commands) {
    for (entity, source) in &waiting {
        let states = server.as_ref().zip(source).and_then(|(server, source)| server.get_load_states(&source.0));
        match states {
            Some((LoadState::Loaded, _, RecursiveDependencyLoadState::Loading | RecursiveDependencyLoadState::NotLoaded)) => continue,
            Some((LoadState::Loading | LoadState::NotLoaded, ..)) => continue,
            Some((LoadState::Failed(error), ..)) => tracing::warn!("soft body {entity} goes without its materials: {error}"),
            _ => {}
        }
        commands.entity(entity).try_remove::<AwaitsDress>();
    }
}

/// Spawns the parts of a body; those of another model go. A body that has another rig keeps them.
fn dress(
    built: On<SceneBuilt>,
    bodies: Query<(Option<&Dressed>, Option<&Source>, Option<&SkinParts>)>,
    old: Query<(), With<ScenePart>>,
    files: Files,
    mut wardrobe: ResMut<Wardrobe>,
    meshes: Option<ResMut<Assets<Mesh>>>,
    materials: Option<ResMut<Assets<StandardMaterial>>>,
    mut commands: Commands,
) {
    let entity = built.entity;
    let (Ok((dressed, source, parts)), Some(mut meshes), Some(mut materials)) = (bodies.get(entity), meshes, materials) else {
        return;
    };
    if dressed.is_some_and(|dressed| Arc::ptr_eq(&dressed.0.model, &built.mesh)) {
        commands.entity(entity).remove::<Source>();
        return;
    }
    for part in parts.into_iter().flat_map(|parts| parts.iter()).filter(|&part| old.contains(part)) {
        commands.entity(part).despawn();
    }
    let clothes = wardrobe.of(&built.mesh, || make(&built.mesh, source, &files, &mut meshes, &mut materials));
    for Cloth { part, mesh, material } in &clothes.parts {
        let name = if part.node.is_empty() { &part.name } else { &part.node };
        let mut child = commands.spawn((
            ScenePart,
            Mesh3d(mesh.clone()),
            MeshMaterial3d(material.clone()),
            SkinPart { body: entity, vertices: part.vertices.clone() },
            ChildOf(entity),
        ));
        if !name.is_empty() {
            child.insert(Name::new(name.clone()));
        }
        if !part.name.is_empty() {
            child.insert(GltfMeshName(part.name.clone()));
        }
        if !part.material.is_empty() {
            child.insert(GltfMaterialName(part.material.clone()));
        }
    }
    commands.entity(entity).remove::<Source>().insert(Dressed(clothes)).insert_if_new(Visibility::default());
}

impl Wardrobe {
    fn of(&mut self, model: &Arc<polpo_rig::Mesh>, make: impl FnOnce() -> Vec<Cloth>) -> Arc<Clothes> {
        self.0.retain(|_, clothes| clothes.strong_count() > 0);
        let address = Arc::as_ptr(model) as usize;
        self.0.get(&address).and_then(Weak::upgrade).unwrap_or_else(|| {
            let clothes = Arc::new(Clothes { model: model.clone(), parts: make() });
            self.0.insert(address, Arc::downgrade(&clothes));
            clothes
        })
    }
}

/// A mesh and a material for each part of the model.
fn make(
    model: &polpo_rig::Mesh,
    source: Option<&Source>,
    files: &Files,
    meshes: &mut Assets<Mesh>,
    materials: &mut Assets<StandardMaterial>,
) -> Vec<Cloth> {
    let whole = [MeshPart { vertices: 0..model.positions.len() as u32, triangles: 0..model.triangles.len() as u32, ..default() }];
    let parts = if model.parts.is_empty() { &whole[..] } else { &model.parts };
    let pieces = source.and_then(|source| pieces(source, files, meshes)).unwrap_or_default();
    if !pieces.is_empty() && pieces.len() != parts.len() {
        tracing::warn!(
            "{}: Bevy finds {} pieces in it, the rigger {}: it goes without its materials",
            model.name,
            pieces.len(),
            parts.len()
        );
    }
    let fits = pieces.len() == parts.len();
    let mut plain = None;
    let dress = |(index, part): (usize, &MeshPart)| {
        let piece = pieces.get(index).filter(|_| fits);
        let mesh = mesh_like(model, part, piece.and_then(|piece| Some((meshes.get(&piece.mesh)?, piece.turn))));
        let material = piece.and_then(|piece| material(piece, source?, files));
        let material = material.unwrap_or_else(|| plain.get_or_insert_with(|| materials.add(StandardMaterial::default())).clone());
        Cloth { part: part.clone(), mesh: meshes.add(mesh), material }
    };
    parts.iter().enumerate().filter(|(_, part)| !part.vertices.is_empty()).map(dress).collect()
}

/// A primitive of a node as Bevy read it.
struct Piece {
    mesh: Handle<Mesh>,
    /// The linear part of its node's transform.
    turn: Mat3,
    material: Option<Handle<GltfMaterial>>,
}

/// The primitives of all nodes that have a surface, in the file's order.
fn pieces(source: &Source, files: &Files, meshes: &Assets<Mesh>) -> Option<Vec<Piece>> {
    let gltf = files.gltfs.as_ref()?.get(&source.0)?;
    let (all_nodes, all_meshes) = (files.nodes.as_ref()?, files.meshes.as_ref()?);
    let nodes: Vec<&GltfNode> = gltf.nodes.iter().map(|node| all_nodes.get(node)).collect::<Option<_>>()?;
    let indices: BTreeMap<_, usize> = gltf.nodes.iter().map(Handle::id).zip(0..).collect();
    let mut parents = vec![None; nodes.len()];
    for (index, child) in nodes.iter().enumerate().flat_map(|(index, node)| node.children.iter().map(move |child| (index, child))) {
        parents[*indices.get(&child.id())?] = Some(index);
    }
    let linear = |node: usize| {
        let Transform { rotation, scale, .. } = nodes[node].transform;
        Mat3::from_quat(rotation) * Mat3::from_diagonal(scale)
    };
    let mut pieces = Vec::new();
    for (index, node) in nodes.iter().enumerate() {
        let Some(mesh) = node.mesh.as_ref().and_then(|mesh| all_meshes.get(mesh)) else { continue };
        let mut turn = Mat3::IDENTITY;
        // As glTF wants it, the node of a mesh with bones does not count. Bevy has looked for loops.
        let mut above = Some(index).filter(|_| node.skin.is_none());
        while let Some(node) = above {
            turn = linear(node) * turn;
            above = parents[node];
        }
        for primitive in &mesh.primitives {
            let topology = meshes.get(&primitive.mesh).map(Mesh::primitive_topology);
            if matches!(topology, Some(PrimitiveTopology::TriangleList | PrimitiveTopology::TriangleStrip)) {
                pieces.push(Piece { mesh: primitive.mesh.clone(), turn, material: primitive.material.clone() });
            }
        }
    }
    Some(pieces)
}

/// The `StandardMaterial` that Bevy's loader made of the piece's material: it is a labelled asset of the file.
fn material(piece: &Piece, source: &Source, files: &Files) -> Option<Handle<StandardMaterial>> {
    let server = files.server.as_ref()?;
    let label = match &piece.material {
        Some(material) => server.get_path(material)?.label()?.to_owned(),
        None => GltfAssetLabel::DefaultMaterial.to_string(),
    };
    let path = server.get_path(&source.0)?.into_owned().with_label(format!("{label}/std"));
    Some(server.load_builder().override_unapproved().load(path))
}

/// The mesh of a part, with what else the vertices of `like` have; without that if they are not the same ones.
fn mesh_like(model: &polpo_rig::Mesh, part: &MeshPart, like: Option<(&Mesh, Mat3)>) -> Mesh {
    let mut mesh = mesh_of_part(model, part.vertices.clone(), part.triangles.clone());
    let Some((like, turn)) = like.filter(|(like, _)| like.count_vertices() == part.vertices.len()) else { return mesh };
    let Ok(attributes) = like.try_attributes() else { return mesh };
    mesh.remove_attribute(Mesh::ATTRIBUTE_COLOR);
    mesh.remove_attribute(Mesh::ATTRIBUTE_UV_0);
    let ours = [Mesh::ATTRIBUTE_POSITION, Mesh::ATTRIBUTE_NORMAL, Mesh::ATTRIBUTE_JOINT_INDEX, Mesh::ATTRIBUTE_JOINT_WEIGHT].map(|a| a.id);
    for (attribute, values) in attributes.filter(|(attribute, _)| !ours.contains(&attribute.id)) {
        let values = match values {
            VertexAttributeValues::Float32x4(tangents) if attribute.id == Mesh::ATTRIBUTE_TANGENT.id => {
                VertexAttributeValues::Float32x4(tangents.iter().map(|&tangent| turned(tangent, turn)).collect())
            }
            values => values.clone(),
        };
        mesh.insert_attribute(*attribute, values);
    }
    mesh
}

/// A tangent in the model's axes; one that vanishes there stays as it is.
fn turned([x, y, z, hand]: [f32; 4], turn: Mat3) -> [f32; 4] {
    let tangent = Vec3::new(x, y, z);
    let hand = if turn.determinant() < 0.0 { -hand } else { hand };
    (turn * tangent).normalize_or(tangent).extend(hand).to_array()
}
