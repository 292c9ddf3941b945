//! A mesh and its rig, from whichever of them is named.

use std::path::{Path, PathBuf};
use std::time::Duration;

use polpo_rig::{Mesh, Note, Rig, read_mesh};

use crate::error::CliError;
use crate::progress;
use crate::recipe::RecipeOptions;

const MESHES: [&str; 5] = ["glb", "gltf", "obj", "ply", "stl"];
const RIGS: [&str; 3] = ["rig", "rig.ron", "ron"];

/// Whether a file is a rig, by its name.
pub(crate) fn is_rig(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("rig") || e.eq_ignore_ascii_case("ron"))
}

/// Whether a file is a glTF, by its name.
pub(crate) fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
}

/// The rig of a mesh, and the file that it is in: the one beside it, or the one that a glTF carries.
pub(crate) fn rig_of(mesh: &Path) -> Result<Option<(Rig, PathBuf)>, CliError> {
    if let Some(path) = rig_beside(mesh) {
        return Ok(Some((Rig::read(&path)?, path)));
    }
    if !is_gltf(mesh) {
        return Ok(None);
    }
    let bytes = std::fs::read(mesh).map_err(|source| CliError::Read { path: mesh.to_owned(), source })?;
    Ok(Rig::from_gltf(&mesh.display().to_string(), &bytes)?.map(|rig| (rig, mesh.to_owned())))
}

/// The mesh beside a rig: `fish.glb` beside `fish.rig` or `fish.rig.ron`.
pub(crate) fn mesh_beside(rig: &Path) -> Option<PathBuf> {
    let stem = rig.with_extension("");
    let stem = if stem.extension().is_some_and(|e| e == "rig") { stem.with_extension("") } else { stem };
    beside(&stem, &MESHES)
}

/// The rig beside a mesh.
pub(crate) fn rig_beside(mesh: &Path) -> Option<PathBuf> {
    beside(&mesh.with_extension(""), &RIGS)
}

fn beside(stem: &Path, extensions: &[&str]) -> Option<PathBuf> {
    let with = |extension: &&str| {
        let mut name = stem.as_os_str().to_owned();
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    };
    extensions.iter().map(with).find(|path| path.is_file())
}

/// A rig with the mesh that it is for.
pub(crate) struct Source {
    pub(crate) rig: Rig,
    /// The mesh, where it was found.
    pub(crate) mesh: Option<Mesh>,
    /// Where they are from, in words.
    pub(crate) from: String,
    /// What the builder had to say, if it was built now.
    pub(crate) notes: Vec<Note>,
}

/// Reads a rig and the mesh beside it, or a mesh and the rig beside or in it; a mesh that has no rig, or one that recipe options are given for, is rigged.
///
/// # Errors
/// If a file cannot be read, or mesh and rig do not go together.
pub(crate) fn read(path: &Path, mesh: Option<&Path>, recipe: &RecipeOptions, quiet: bool) -> Result<Source, CliError> {
    let own = is_rig(path).then(|| Rig::read(path)).transpose()?;
    let mesh_path = if own.is_some() { mesh.map(Path::to_owned).or_else(|| mesh_beside(path)) } else { Some(path.to_owned()) };
    let mesh = mesh_path.as_deref().map(read_mesh).transpose()?;
    let rig = match own {
        Some(rig) => Some((rig, path.to_owned())),
        None if recipe.given() => None,
        None => rig_of(path)?,
    };
    match (rig, mesh) {
        (Some((rig, rig_path)), mesh) => {
            mesh.as_ref().map_or(Ok(()), |mesh| rig.check_mesh(mesh))?;
            let with = mesh_path.map_or("without its mesh".into(), |mesh| format!("with {}", mesh.display()));
            Ok(Source { rig, mesh, from: format!("{} {with}", rig_path.display()), notes: Vec::new() })
        }
        (None, Some(mesh)) => {
            let (recipe, file) = recipe.recipe(path)?;
            let (built, stages) = progress::build(&mesh, &recipe, quiet)?;
            let took: Duration = stages.iter().map(|s| s.1).sum();
            let by = file.map_or("the default recipe".into(), |file| file.display().to_string());
            let from = format!("rigged by {by} in {:.2} s", took.as_secs_f64());
            Ok(Source { rig: built.rig, mesh: Some(mesh), from, notes: built.notes })
        }
        (None, None) => Err(CliError::NoMesh { rig: path.display().to_string() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mesh_and_rig_find_each_other() {
        let folder = std::env::temp_dir().join(format!("polpo_source_{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let at = |name: &str| folder.join(name);
        ["my.fish.glb", "my.fish.rig", "cow.obj", "cow.rig.ron"].iter().for_each(|name| std::fs::write(at(name), "").expect("a file"));
        assert_eq!(mesh_beside(&at("my.fish.rig")), Some(at("my.fish.glb")));
        assert_eq!(mesh_beside(&at("my.fish.rig.ron")), Some(at("my.fish.glb")));
        assert_eq!(mesh_beside(&at("cow.rig.ron")), Some(at("cow.obj")));
        assert_eq!(mesh_beside(&at("dog.rig")), None);
        assert_eq!(rig_beside(&at("my.fish.glb")), Some(at("my.fish.rig")));
        assert_eq!(rig_beside(&at("cow.obj")), Some(at("cow.rig.ron")));
        assert!(is_rig(&at("a.RIG")) && is_rig(&at("a.rig.ron")) && !is_rig(&at("a.glb")));
        std::fs::remove_dir_all(folder).expect("it can go");
    }
}
