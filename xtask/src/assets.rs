//! `cargo xtask assets`: makes every file in assets/ from the code here, bit for bit the same each time.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use polpo_rig::{Recipe, RigError, build_rig, parse_glb};
use thiserror::Error;

use crate::octopus::OctopusError;
use crate::{glb, octopus};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Write nothing; fail if a file is not what would be written.
    #[arg(long)]
    check: bool,
}

#[derive(Debug, Error)]
pub(crate) enum AssetsError {
    #[error("octopus: {0}")]
    Octopus(#[from] OctopusError),
    #[error(transparent)]
    Mesh(#[from] polpo_rig::MeshError),
    #[error(transparent)]
    Rig(#[from] RigError),
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: io::Error },
    #[error("{}: byte {at} is not what `cargo xtask assets` makes; run it and commit the result", path.display())]
    Differs { path: PathBuf, at: usize },
}

/// A file of assets/: name and content.
struct Asset {
    name: &'static str,
    bytes: Vec<u8>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), AssetsError> {
    let folder = folder();
    for Asset { name, bytes } in make()? {
        let path = folder.join(name);
        if arguments.check {
            compare(path, &bytes)?;
        } else {
            fs::write(&path, &bytes).map_err(|source| AssetsError::Io { path, source })?;
            println!("assets/{name}: {} bytes", bytes.len());
        }
    }
    Ok(())
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets")
}

fn compare(path: PathBuf, bytes: &[u8]) -> Result<(), AssetsError> {
    let found = match fs::read(&path) {
        Ok(found) => found,
        Err(source) => return Err(AssetsError::Io { path, source }),
    };
    let same = found.iter().zip(bytes).take_while(|(a, b)| a == b).count();
    if same == found.len() && same == bytes.len() { Ok(()) } else { Err(AssetsError::Differs { path, at: same }) }
}

/// The octopus of the paper: 5k vertices, 10k triangles, 300 particles, 750 edges (method, §8).
fn make() -> Result<Vec<Asset>, AssetsError> {
    let mesh = glb::write(&octopus::make()?);
    let rig = build_rig(&parse_glb("assets/octopus.glb", &mesh)?, &Recipe::default())?;
    Ok(vec![
        Asset { name: "octopus.rig.ron", bytes: rig.to_ron()?.into_bytes() },
        Asset { name: "octopus.rig", bytes: rig.to_postcard()? },
        Asset { name: "octopus.glb", bytes: mesh },
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The committed files are the ones this code makes, on every machine.
    #[test]
    fn assets_are_reproducible() -> Result<(), AssetsError> {
        run(&Arguments { check: true })
    }
}
