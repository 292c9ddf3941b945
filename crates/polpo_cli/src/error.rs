//! What can go wrong, told in one line.

use std::error::Error;
use std::path::PathBuf;

use polpo_rig::{MeshError, RigError};

use crate::draw::picture::PictureError;

/// Why a command could not be done.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    /// A mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A rig or a recipe.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// A picture.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A picture of a body needs its mesh.
    #[error("{rig}: its mesh is not beside it; say where with --mesh")]
    NoMesh {
        /// The rig.
        rig: String,
    },
    /// A body could not be simulated.
    #[error("{name}: the body cannot be simulated")]
    Body {
        /// The mesh or rig.
        name: String,
        /// Why.
        source: polpo::RejectReason,
    },
    /// A body could not have what was asked for.
    #[error("{name}: the body cannot have {component}")]
    Capability {
        /// The mesh or rig.
        name: String,
        /// What it cannot have.
        component: &'static str,
        /// Why.
        source: polpo::CapabilityError,
    },
    /// A material that the rig's cells cannot have.
    #[error("{name}: the body cannot be as stiff as its material")]
    Material {
        /// The mesh.
        name: String,
        /// Why.
        source: polpo::CalibrationError,
    },
    /// An option does not go with the rig.
    #[error("{name}: {what}")]
    Option {
        /// The mesh or rig.
        name: String,
        /// What does not go.
        what: &'static str,
    },
    /// No measurement has such a name.
    #[error("no measurement's name contains `{only}`; there are {names}")]
    UnknownReference {
        /// What was asked for.
        only: String,
        /// All names.
        names: String,
    },
    /// A file could not be read.
    #[error("{path}: cannot be read", path = path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error("{path}: cannot be written", path = path.display())]
    Write {
        /// Where to.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Standard output is not there.
    #[error("standard output")]
    Output(#[source] std::io::Error),
}

/// The error and all its causes in one line. A cause that an error already tells of comes once, and of a text that shows a piece of a file, the lines that draw it are left out.
pub(crate) fn one_line(error: &dyn Error) -> String {
    let mut line = flat(&error.to_string());
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = flat(&error.to_string());
        if !line.contains(&text) {
            line = format!("{line}: {text}");
        }
        cause = error.source();
    }
    line
}

fn flat(text: &str) -> String {
    let draws = |line: &str| line.split_once('|').is_some_and(|(before, _)| before.trim().chars().all(|c| c.is_ascii_digit()));
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !draws(line));
    lines.collect::<Vec<_>>().join(": ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_once_and_in_one_line() {
        let source = std::io::Error::other("the disk is full");
        let error = CliError::Write { path: "a.rig".into(), source };
        assert_eq!(one_line(&error), "a.rig: cannot be written: the disk is full");
        let error = CliError::Rig(RigError::Io { name: "a.rig".into(), source: std::io::Error::other("gone") });
        assert_eq!(one_line(&error), "a.rig: gone");
        let error = CliError::Rig(polpo_rig::Recipe::from_toml("a.rig.toml", "particles = 3\nparticels = 2\n").expect_err("a slip"));
        let line = one_line(&error);
        assert!(line.starts_with("a.rig.toml: not a recipe: TOML parse error at line 2, column 1: unknown field `particels`"), "{line}");
        assert!(!line.contains('\n') && !line.contains('|'), "{line}");
    }
}
