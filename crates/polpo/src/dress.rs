//! What the body of a model's file is drawn with: a child for each part, in the file's own material.
//!
//! Positions, normals and triangles are those that the rig was made for. What else a vertex has (texture coordinates, colours, tangents) and the materials come from Bevy's own reading of the file, whose nodes and primitives are
//! in the same order; joints and weights of bones and morph targets are left out, so that nothing else deforms the mesh.
//!
//! With `GltfConvertCoordinates::rotate_meshes` Bevy gives tangents half a turn about Y, which is not undone here: normal maps are shaded wrongly then. Of a mesh that Bevy has loaded into the render world only there is nothing to
//! read: its part goes without tangents and a second set of texture coordinates.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use bevy::asset::{AssetPath, LoadState, RecursiveDependencyLoadState, UntypedAssetId};
use bevy::ecs::system::SystemParam;
use bevy::gltf::{Gltf, GltfMaterial, GltfMaterialName, GltfMesh, GltfMeshName, GltfNode};
use bevy::mesh::{PrimitiveTopology, VertexAttributeValues};
use bevy::prelude::*;
use polpo_rig::MeshPart;

use crate::assets::{Awaiting, AwaitsDress, SceneBuilt, look_again};
use crate::render::{SkinPart, SkinParts, mesh_of_part};
use crate::{SoftBodyAssetSystems, SoftBodyModel, SoftBodyScene};

/// Dresses the bodies of [`SoftBodyScene`]s.
pub(crate) struct DressPlugin;

impl Plugin for DressPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Wardrobe>()
            .add_observer(fetch)
            .add_observer(let_go::<Awaiting>)
            .add_observer(let_go::<SoftBodyScene>)
            .add_observer(dress)
            .add_systems(
                Update,
                (dress_anew.run_if(resource_exists::<Messages<AssetEvent<Gltf>>>), wait.run_if(any_with_component::<AwaitsDress>))
                    .chain()
                    .before(SoftBodyAssetSystems),
            );
    }
}

/// Bevy's own reading of the scene's file; there as long as the scene awaits its body.
#[derive(Component, Debug)]
struct Source {
    gltf: Handle<Gltf>,
    /// What its primitives are made of, once it is read: held, for Bevy drops what no scene of the file shows as it is.
    materials: Option<Vec<Handle<StandardMaterial>>>,
    /// Whether it is read since the body awaits it. What somebody else had loaded may be older than the model.
    fresh: bool,
}

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
    /// Whether they are of a file that was read for them; see [`Source`].
    fresh: bool,
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
    fn source(&self, scene: &SoftBodyScene) -> Option<Source> {
        let (server, gltfs) = (self.server.as_ref()?, self.gltfs.as_ref()?);
        let path = server.get_path(&scene.model)?;
        if !path.path().extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf")) {
            return None;
        }
        // Whoever loaded the model has approved of its path.
        let gltf: Handle<Gltf> = server.load_builder().override_unapproved().load(path.into_owned());
        let fresh = !gltfs.contains(&gltf);
        Some(Source { gltf, materials: None, fresh })
    }

    /// Whether all that there will ever be of a source is there; its materials are asked for if there may be any.
    fn have(&self, source: &mut Source, with_materials: bool) -> bool {
        let Some(server) = &self.server else { return true };
        if source.materials.is_none() {
            // One that is being read again for a label of it is there.
            let known = self.gltfs.as_ref().is_some_and(|gltfs| gltfs.contains(&source.gltf)) && !server.is_loaded(&source.gltf);
            if !known && !is_settled(server, &source.gltf) {
                return false;
            }
            let materials = if with_materials { self.materials(&source.gltf) } else { None };
            let materials = source.materials.insert(materials.unwrap_or_default());
            // For a material that Bevy has dropped the whole file is read again.
            source.fresh |= materials.iter().any(|material| !server.is_loaded(material));
        }
        source.materials.iter().flatten().all(|material| is_settled(server, material))
    }

    /// What the primitives of a file are made of.
    fn materials(&self, source: &Handle<Gltf>) -> Option<Vec<Handle<StandardMaterial>>> {
        let (server, meshes) = (self.server.as_ref()?, self.meshes.as_ref()?);
        let gltf = self.gltfs.as_ref()?.get(source)?;
        let primitives = gltf.meshes.iter().filter_map(|mesh| meshes.get(mesh)).flat_map(|mesh| &mesh.primitives);
        let paths = primitives.filter_map(|primitive| self.material(source, primitive.material.as_ref()));
        Some(paths.map(|path| server.load_builder().override_unapproved().load(path)).collect())
    }

    /// Where the `StandardMaterial` is that Bevy's loader made of a material: it is a labelled asset of the file.
    fn material(&self, source: &Handle<Gltf>, material: Option<&Handle<GltfMaterial>>) -> Option<AssetPath<'static>> {
        let server = self.server.as_ref()?;
        let label = match material {
            Some(material) => server.get_path(material)?.label()?.to_owned(),
            None => GltfAssetLabel::DefaultMaterial.to_string(),
        };
        Some(server.get_path(source)?.into_owned().with_label(format!("{label}/std")))
    }
}

/// Whether an asset is there with all that it needs, or never will be.
fn is_settled(server: &AssetServer, id: impl Into<UntypedAssetId>) -> bool {
    match server.get_load_states(id) {
        Some((LoadState::Loading | LoadState::NotLoaded, ..)) => false,
        Some((LoadState::Loaded, _, state)) => {
            !matches!(state, RecursiveDependencyLoadState::Loading | RecursiveDependencyLoadState::NotLoaded)
        }
        _ => true,
    }
}

/// A scene that awaits its body and does not wear what its model is drawn with starts loading that.
fn fetch(
    insert: On<Insert, Awaiting>,
    scenes: Query<(&SoftBodyScene, Option<&Dressed>)>,
    models: Res<Assets<SoftBodyModel>>,
    files: Files,
    mut commands: Commands,
) {
    let Ok((scene, dressed)) = scenes.get(insert.entity) else { return };
    let model = models.get(&scene.model).map(SoftBodyModel::mesh);
    let is_dressed = model.zip(dressed).is_some_and(|(model, dressed)| Arc::ptr_eq(model, &dressed.0.model));
    let mut entity = commands.entity(insert.entity);
    entity.try_remove::<(AwaitsDress, Source)>();
    if !is_dressed && let Some(source) = files.source(scene) {
        entity.try_insert((AwaitsDress, source));
    }
}

/// A scene that awaits nothing any more holds on to nothing.
fn let_go<C: Component>(removed: On<Remove, C>, mut commands: Commands) {
    commands.entity(removed.entity).try_remove::<(AwaitsDress, Source)>();
}

/// Bevy loads a file that has changed again for one kind of asset after the other: bodies that were dressed from what was left of the old file are dressed anew.
fn dress_anew(
    mut events: MessageReader<AssetEvent<Gltf>>,
    dressed: Query<(Entity, &SoftBodyScene, &Dressed)>,
    files: Files,
    mut wardrobe: ResMut<Wardrobe>,
    mut commands: Commands,
) {
    let Some(server) = &files.server else { return };
    for event in events.read() {
        let AssetEvent::Modified { id } = event else { continue };
        let Some(path) = server.get_path(*id) else { continue };
        for (entity, scene, Dressed(clothes)) in &dressed {
            if !clothes.fresh && server.get_path(&scene.model).as_ref() == Some(&path) {
                wardrobe.forget(&clothes.model);
                commands.entity(entity).try_remove::<Dressed>();
                look_again(&mut commands, entity);
            }
        }
    }
}

/// Bodies wait until their materials and textures are there, or will never be.
fn wait(
    mut waiting: Query<(Entity, Option<&mut Source>), With<AwaitsDress>>,
    files: Files,
    materials: Option<Res<Assets<StandardMaterial>>>,
    mut commands: Commands,
) {
    for (entity, source) in &mut waiting {
        if let Some(mut source) = source {
            if !files.have(&mut source, materials.is_some()) {
                continue;
            }
            if let Some(LoadState::Failed(error)) = files.server.as_ref().map(|server| server.load_state(&source.gltf)) {
                tracing::warn!("soft body {entity} goes without its materials: {error}");
            }
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
    (meshes, materials): (Option<ResMut<Assets<Mesh>>>, Option<ResMut<Assets<StandardMaterial>>>),
    mut commands: Commands,
) {
    let entity = built.entity;
    let (Ok((dressed, source, parts)), Some(mut meshes), Some(mut materials)) = (bodies.get(entity), meshes, materials) else {
        return;
    };
    if dressed.is_some_and(|dressed| Arc::ptr_eq(&dressed.0.model, &built.mesh)) {
        return;
    }
    for part in parts.into_iter().flat_map(|parts| parts.iter()).filter(|&part| old.contains(part)) {
        commands.entity(part).try_despawn();
    }
    let clothes = wardrobe.of(&built.mesh, || Clothes {
        model: built.mesh.clone(),
        fresh: source.is_none_or(|source| source.fresh),
        parts: make(&built.mesh, source, &files, &mut meshes, &mut materials),
    });
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
            child.try_insert(Name::new(name.clone()));
        }
        if !part.name.is_empty() {
            child.try_insert(GltfMeshName(part.name.clone()));
        }
        if !part.material.is_empty() {
            child.try_insert(GltfMaterialName(part.material.clone()));
        }
    }
    commands.entity(entity).try_insert(Dressed(clothes)).try_insert_if_new(Visibility::default());
}

impl Wardrobe {
    fn of(&mut self, model: &Arc<polpo_rig::Mesh>, make: impl FnOnce() -> Clothes) -> Arc<Clothes> {
        self.0.retain(|_, clothes| clothes.strong_count() > 0);
        let address = Arc::as_ptr(model) as usize;
        self.0.get(&address).and_then(Weak::upgrade).unwrap_or_else(|| {
            let clothes = Arc::new(make());
            self.0.insert(address, Arc::downgrade(&clothes));
            clothes
        })
    }

    /// The next body of the model gets new ones.
    fn forget(&mut self, model: &Arc<polpo_rig::Mesh>) {
        self.0.remove(&(Arc::as_ptr(model) as usize));
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
    let pieces = source.and_then(|source| pieces(&source.gltf, files, meshes)).unwrap_or_default();
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
        let material = piece.and_then(|piece| material(piece, &source?.gltf, files));
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
fn pieces(source: &Handle<Gltf>, files: &Files, meshes: &Assets<Mesh>) -> Option<Vec<Piece>> {
    let gltf = files.gltfs.as_ref()?.get(source)?;
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

/// The piece's material, if it is there: the source holds it.
fn material(piece: &Piece, source: &Handle<Gltf>, files: &Files) -> Option<Handle<StandardMaterial>> {
    let path = files.material(source, piece.material.as_ref())?;
    let server = files.server.as_ref()?;
    server.get_handle::<StandardMaterial>(path).filter(|material| !server.load_state(material).is_failed())
}

/// The mesh of a part, with what else the vertices of `like` have; without that if they are not the same ones.
fn mesh_like(model: &polpo_rig::Mesh, part: &MeshPart, like: Option<(&Mesh, Mat3)>) -> Mesh {
    let mut mesh = mesh_of_part(model, part.vertices.clone(), part.triangles.clone());
    // There is nothing to read in one that is in the render world only.
    let Some((attributes, turn)) = like.and_then(|(like, turn)| Some((like.try_attributes().ok()?, turn))) else { return mesh };
    let attributes: Vec<_> = attributes.collect();
    if attributes.is_empty() || attributes.iter().any(|(_, values)| values.len() != part.vertices.len()) {
        return mesh;
    }
    mesh.remove_attribute(Mesh::ATTRIBUTE_COLOR);
    mesh.remove_attribute(Mesh::ATTRIBUTE_UV_0);
    let ours = [Mesh::ATTRIBUTE_POSITION, Mesh::ATTRIBUTE_NORMAL, Mesh::ATTRIBUTE_JOINT_INDEX, Mesh::ATTRIBUTE_JOINT_WEIGHT].map(|a| a.id);
    for (attribute, values) in attributes.into_iter().filter(|(attribute, _)| !ours.contains(&attribute.id)) {
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
