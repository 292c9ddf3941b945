//! Rig files: `.ron` to read and to compare, `.rig` (postcard) to ship. Both carry the version of the format.
//!
//! ```text
//! .ron   (version: 2, rig: (mesh_hash: (..), particles: [..], edges: [..], skin: [..], regions: [..], cells: ..))
//! .rig   "POLPORIG", the version as u32 with its little end first, then the rig in postcard's wire format
//! ```
//!
//! A list in a `.rig` begins with its length, which a broken file may put at anything: no more is set aside for it than a mebibyte, and the
//! file ends long before the list does.

use std::fs;
use std::path::Path;

use ron::extensions::Extensions;
use ron::ser::PrettyConfig;
use serde::{Deserialize, Serialize};

use crate::error::shortened;
use crate::{Rig, RigError};

/// Counts up with every change of the format; a file of another version is refused, not guessed at.
const VERSION: u32 = 2;
const MAGIC: &[u8; 8] = b"POLPORIG";

#[derive(Deserialize)]
struct Header {
    version: u32,
}

#[derive(Deserialize)]
struct RonFile {
    rig: Rig,
}

#[derive(Serialize)]
struct RonFileRef<'a> {
    version: u32,
    rig: &'a Rig,
}

impl Rig {
    /// The rig as text, one particle, edge or vertex a line. The same rig gives the same text.
    ///
    /// # Errors
    /// [`RigError::Invalid`] for a rig that [`validate`](Rig::validate) refuses: nothing is written that cannot be read back.
    pub fn to_ron(&self) -> Result<String, RigError> {
        self.validate()?;
        let layout = PrettyConfig::new().depth_limit(3).indentor("  ").new_line("\n");
        let file = RonFileRef { version: VERSION, rig: self };
        let mut text = ron::ser::to_string_pretty(&file, layout).map_err(|e| not_a_rig("rig", e))?;
        text.push('\n');
        Ok(text)
    }

    /// Reads what [`to_ron`](Rig::to_ron) wrote; `name` is for errors.
    ///
    /// # Errors
    /// [`RigError::Version`] for another version of the format, [`RigError::NotARig`] (with line and column) for anything that is
    /// not a rig, [`RigError::Invalid`] for a rig that breaks its rules.
    pub fn from_ron(name: &str, text: &str) -> Result<Rig, RigError> {
        let options = ron::Options::default().with_default_extension(Extensions::empty());
        let header: Header = options.from_str(text).map_err(|e| not_a_rig(name, e))?;
        check_version(name, header.version)?;
        let file: RonFile = options.from_str(text).map_err(|e| not_a_rig(name, e))?;
        file.rig.validate_as(name)?;
        Ok(file.rig)
    }

    /// The rig as bytes, about a fifth of the text. The same rig gives the same bytes.
    ///
    /// # Errors
    /// [`RigError::Invalid`] for a rig that [`validate`](Rig::validate) refuses.
    pub fn to_postcard(&self) -> Result<Vec<u8>, RigError> {
        self.validate()?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        postcard::to_extend(self, bytes).map_err(|e| not_a_rig("rig", e))
    }

    /// Reads what [`to_postcard`](Rig::to_postcard) wrote; `name` is for errors.
    ///
    /// # Errors
    /// [`RigError::NotARig`] for a wrong start, a truncated file or bytes left over, [`RigError::Version`] for another version of
    /// the format, [`RigError::Invalid`] for a rig that breaks its rules.
    pub fn from_postcard(name: &str, bytes: &[u8]) -> Result<Rig, RigError> {
        let body = bytes.strip_prefix(MAGIC).ok_or_else(|| not_a_rig(name, "it does not start with POLPORIG"))?;
        let (version, body) = body.split_first_chunk::<4>().ok_or_else(|| not_a_rig(name, "it ends in its version"))?;
        check_version(name, u32::from_le_bytes(*version))?;
        let (rig, rest) = postcard::take_from_bytes::<Rig>(body).map_err(|e| match e {
            postcard::Error::DeserializeUnexpectedEnd => not_a_rig(name, "it ends too early"),
            other => not_a_rig(name, other),
        })?;
        if !rest.is_empty() {
            return Err(not_a_rig(name, format_args!("{} bytes are left over at its end", rest.len())));
        }
        rig.validate_as(name)?;
        Ok(rig)
    }

    /// Writes the rig to a file: text for the extension `.ron`, bytes for `.rig`.
    ///
    /// # Errors
    /// [`RigError::UnknownExtension`], [`RigError::Invalid`], or [`RigError::Io`] if the system refuses.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), RigError> {
        let path = path.as_ref();
        let bytes = match Format::of(path)? {
            Format::Ron => self.to_ron()?.into_bytes(),
            Format::Postcard => self.to_postcard()?,
        };
        fs::write(path, bytes).map_err(|source| RigError::Io { name: path.display().to_string(), source })
    }

    /// Reads a rig file: text for the extension `.ron`, bytes for `.rig`.
    ///
    /// # Errors
    /// [`RigError::UnknownExtension`], [`RigError::Io`] if the file is not there or not readable, and those of
    /// [`from_ron`](Rig::from_ron) and [`from_postcard`](Rig::from_postcard).
    pub fn read(path: impl AsRef<Path>) -> Result<Rig, RigError> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let format = Format::of(path)?;
        let bytes = fs::read(path).map_err(|source| RigError::Io { name: name.clone(), source })?;
        match format {
            Format::Ron => Rig::from_ron(&name, std::str::from_utf8(&bytes).map_err(|e| not_a_rig(&name, e))?),
            Format::Postcard => Rig::from_postcard(&name, &bytes),
        }
    }
}

enum Format {
    Ron,
    Postcard,
}

impl Format {
    fn of(path: &Path) -> Result<Format, RigError> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match extension.as_str() {
            "ron" => Ok(Format::Ron),
            "rig" => Ok(Format::Postcard),
            _ => Err(RigError::UnknownExtension { name: path.display().to_string(), extension }),
        }
    }
}

fn check_version(name: &str, found: u32) -> Result<(), RigError> {
    if found == VERSION { Ok(()) } else { Err(RigError::Version { name: name.into(), found, expected: VERSION }) }
}

pub(crate) fn not_a_rig(name: &str, reason: impl ToString) -> RigError {
    RigError::NotARig { name: name.into(), reason: shortened(reason) }
}
