//! Bevy's own reading of a scene's file.

use bevy::asset::{AssetPath, LoadState, RecursiveDependencyLoadState, UntypedAssetId};
use bevy::ecs::system::SystemParam;
use bevy::gltf::{Gltf, GltfMaterial, GltfMesh, GltfNode};
use bevy::prelude::*;

use crate::SoftBodyScene;

/// Bevy's own reading of the scene's file; there as long as the scene awaits its body.
#[derive(Component, Debug)]
pub(super) struct Source {
    pub(super) gltf: Handle<Gltf>,
    /// What its primitives are made of, once it is read: held, for Bevy drops what no scene of the file shows as it is.
    pub(super) materials: Option<Vec<Handle<StandardMaterial>>>,
    /// Whether it is read since the body awaits it. What somebody else had loaded may be older than the model.
    pub(super) fresh: bool,
}

/// Everything that Bevy makes of a glTF.
#[derive(SystemParam)]
pub(super) struct Files<'w> {
    pub(super) server: Option<Res<'w, AssetServer>>,
    pub(super) gltfs: Option<Res<'w, Assets<Gltf>>>,
    pub(super) nodes: Option<Res<'w, Assets<GltfNode>>>,
    pub(super) meshes: Option<Res<'w, Assets<GltfMesh>>>,
}

impl Files<'_> {
    /// Starts loading the glTF of a scene, if it is one and this app can.
    pub(super) fn source(&self, scene: &SoftBodyScene) -> Option<Source> {
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
    pub(super) fn have(&self, source: &mut Source, with_materials: bool) -> bool {
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
    pub(super) fn material(&self, source: &Handle<Gltf>, material: Option<&Handle<GltfMaterial>>) -> Option<AssetPath<'static>> {
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
