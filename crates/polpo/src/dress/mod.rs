//! What the body of a model's file is drawn with: a child for each part, in the file's own material.
//!
//! Positions, normals and triangles are those that the rig was made for. What else a vertex has (texture coordinates, colours, tangents) and the materials come from Bevy's own reading of the file, whose nodes and primitives are
//! in the same order; joints and weights of bones and morph targets are left out, so that nothing else deforms the mesh.
//!
//! | file | what |
//! |---|---|
//! | `source.rs` | Bevy's reading of the file, while a body waits for it |
//! | `clothes.rs` | a mesh and a material for each part |

mod clothes;
mod source;

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use bevy::asset::LoadState;
use bevy::gltf::{Gltf, GltfMaterialName, GltfMeshName};
use bevy::prelude::*;

use self::clothes::{Cloth, Clothes, make};
use self::source::{Files, Source};
use crate::assets::{Awaiting, AwaitsDress, SceneBuilt, look_again};
use crate::render::{SkinPart, SkinParts};
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

/// A child that a scene brought.
#[derive(Component, Debug)]
struct ScenePart;

/// What the body wears.
#[derive(Component, Debug)]
struct Dressed(Arc<Clothes>);

/// The clothes in use, by the address of the model's mesh.
#[derive(Resource, Debug, Default)]
struct Wardrobe(BTreeMap<usize, Weak<Clothes>>);

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
