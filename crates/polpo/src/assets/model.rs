//! Mesh files as assets, as the rigger takes them.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use bevy::asset::io::Reader;
use bevy::asset::{Asset, AssetLoader, LoadContext};
use bevy::prelude::*;
use bevy::reflect::TypePath;
use polpo_rig::{Mesh, MeshError, MeshHash, Rig, RigError, parse_mesh};

use super::document::{all_of, with_buffers};

/// A model that a soft body can be made of: all the meshes in a file, in the file's unit and axes, and the rig if the file has one.
///
/// Any mesh file that `polpo_rig` reads; of a glTF all nodes and primitives, node transforms applied. One with bones is taken in the pose that its file stores; bones and animations are left out. A rig
/// of its own is in the extras of a glTF's default scene, see [`Rig::from_gltf`].
///
/// Bevy's own glTF loader may load the same file beside it. A `.meta` file beside it must not name that loader, nor may the file go through Bevy's asset processor (`AssetMode::Processed` writes such a `.meta`): Bevy then loads
/// it as a `Gltf` only, says "Expected …, got …" in the log, and the handle of the model stays in `LoadState::Loading` for ever, without an event.
#[derive(Asset, TypePath, Debug, Clone)]
pub struct SoftBodyModel {
    mesh: Arc<Mesh>,
    /// What [`Mesh::validate`] has found.
    fault: Option<Arc<RigError>>,
    print: ModelPrint,
    rig: Result<Option<Arc<Rig>>, Arc<RigError>>,
}

/// What a rig depends on besides its recipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ModelPrint {
    pub(super) mesh: MeshHash,
    /// Of the colours and the names of parts, by which recipes choose regions. The same in one run.
    paint: u64,
}

impl ModelPrint {
    fn of(mesh: &Mesh) -> Self {
        let mut paint = DefaultHasher::new();
        mesh.colors.iter().flatten().for_each(|x| x.to_bits().hash(&mut paint));
        for part in &mesh.parts {
            (&part.node, &part.name, &part.material, &part.vertices).hash(&mut paint);
        }
        Self { mesh: mesh.hash(), paint: paint.finish() }
    }
}

impl SoftBodyModel {
    /// A model made by a program, for `Assets::add`. Of a mesh that [`Mesh::validate`] refuses no body can be made: [`SoftBodyLoadFailed`](crate::SoftBodyLoadFailed) says why.
    pub fn new(mesh: Mesh, rig: Option<Arc<Rig>>) -> Self {
        let fault = mesh.validate().err().map(|fault| Arc::new(RigError::from(fault)));
        Self { fault, print: ModelPrint::of(&mesh), mesh: Arc::new(mesh), rig: Ok(rig) }
    }

    /// Its mesh. What it is made of stands in [`Mesh::parts`].
    pub fn mesh(&self) -> &Arc<Mesh> {
        &self.mesh
    }

    /// The rig in its file, if there is one.
    ///
    /// # Errors
    /// If the file has one that cannot be read. The model is of use with another.
    pub fn rig(&self) -> Result<Option<&Arc<Rig>>, &Arc<RigError>> {
        self.rig.as_ref().map(Option::as_ref)
    }

    pub(super) fn print(&self) -> ModelPrint {
        self.print
    }

    /// Whether its mesh is whole.
    pub(super) fn check(&self) -> Result<(), Arc<RigError>> {
        self.fault.clone().map_or(Ok(()), Err)
    }

    /// Whether `rig` was made for this model, as [`Rig::check_mesh`] says it.
    pub(super) fn check_rig(&self, rig: &Rig) -> Result<(), RigError> {
        let (name, vertices) = (|| self.mesh.name.clone(), self.mesh.positions.len());
        if rig.skin.len() != vertices {
            return Err(RigError::VertexCount { name: name(), expected: rig.skin.len(), found: vertices });
        }
        if rig.mesh_hash != self.print.mesh {
            return Err(RigError::MeshHash { name: name(), expected: rig.mesh_hash, found: self.print.mesh });
        }
        Ok(())
    }
}

/// Why a model could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The file is no mesh, or one that cannot be rigged.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A file that a glTF names could not be read.
    #[error("{name}: its buffer {uri}: {reason}")]
    Buffer {
        /// The glTF.
        name: String,
        /// The buffer.
        uri: String,
        /// Why.
        reason: String,
    },
    /// The buffers of a glTF name one file so often that they take over 64 MiB more than their files.
    #[error("{name}: its buffers name {uri} so often that they take over 64 MiB more than their files")]
    Repeats {
        /// The glTF.
        name: String,
        /// The file that is one too many.
        uri: String,
    },
}

#[derive(TypePath)]
pub(super) struct ModelLoader;

impl AssetLoader for ModelLoader {
    type Asset = SoftBodyModel;
    type Settings = ();
    type Error = ModelError;

    async fn load(&self, reader: &mut dyn Reader, _: &(), context: &mut LoadContext<'_>) -> Result<SoftBodyModel, ModelError> {
        let name = context.path().to_string();
        let bytes = all_of(reader).await.map_err(|source| MeshError::Io { name: name.clone(), source })?;
        let bytes = with_buffers(bytes, context).await?;
        let mesh = parse_mesh(&name, &bytes)?;
        let is_gltf = context.path().path().extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"));
        let own = if is_gltf { Rig::from_gltf(&name, &bytes) } else { Ok(None) };
        let rig = own.map(|rig| rig.map(Arc::new)).map_err(Arc::new);
        Ok(SoftBodyModel { rig, ..SoftBodyModel::new(mesh, None) })
    }

    // No extensions: it is chosen by the type that is asked for. Files that are loaded without a type, and labels in them, stay with Bevy's own loader.
}
