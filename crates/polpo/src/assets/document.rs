//! The bytes of a file, with those that it names.

use std::collections::BTreeMap;
use std::io;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bevy::asset::LoadContext;
use bevy::asset::io::Reader;
use percent_encoding::percent_decode_str;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use super::ModelError;

pub(super) async fn all_of(reader: &mut dyn Reader) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes).await?;
    Ok(bytes)
}

/// How many bytes buffers may take, as text, by naming a file again: hardly one does.
const REPEATS: usize = 64 << 20;

#[derive(Deserialize)]
struct Buffers {
    #[serde(default)]
    buffers: Vec<Buffer>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Buffer {
    uri: Option<String>,
    byte_length: usize,
}

impl Buffer {
    /// The file it is in, if that is one of its own.
    fn file(&self) -> Option<&str> {
        self.uri.as_deref().filter(|uri| !uri.starts_with("data:"))
    }
}

/// A `.gltf` with the buffers that lie beside it taken in; anything else as it is. All else in it stays as it stands, to the letter.
pub(super) async fn with_buffers(bytes: Vec<u8>, context: &mut LoadContext<'_>) -> Result<Vec<u8>, ModelError> {
    let Ok(Buffers { mut buffers }) = serde_json::from_slice(&bytes) else {
        return Ok(bytes);
    };
    if buffers.iter().all(|buffer| buffer.file().is_none()) {
        return Ok(bytes);
    }
    let name = context.path().to_string();
    // Which buffer holds a file: each is read once, however often it is named.
    let mut files = BTreeMap::new();
    let mut left = REPEATS;
    for index in 0..buffers.len() {
        let Some(uri) = buffers[index].file().map(str::to_owned) else { continue };
        let fail = |reason: String| ModelError::Buffer { name: name.clone(), uri: uri.clone(), reason };
        let file = percent_decode_str(&uri).decode_utf8().map_err(|e| fail(e.to_string()))?;
        let path = context.path().resolve_embed_str(&file).map_err(|e| fail(e.to_string()))?;
        let known = *files.entry(path.to_string()).or_insert(index);
        let data = if known < index {
            let data = buffers[known].uri.clone().unwrap_or_default();
            left = left.checked_sub(data.len()).ok_or_else(|| ModelError::Repeats { name: name.clone(), uri: uri.clone() })?;
            data
        } else {
            let data = context.read_asset_bytes(path).await.map_err(|e| fail(e.to_string()))?;
            format!("data:application/octet-stream;base64,{}", STANDARD.encode(data))
        };
        buffers[index].uri = Some(data);
    }
    let whole = || -> serde_json::Result<Vec<u8>> {
        let mut document: BTreeMap<String, Box<RawValue>> = serde_json::from_slice(&bytes)?;
        document.insert("buffers".into(), serde_json::value::to_raw_value(&buffers)?);
        serde_json::to_vec(&document)
    };
    // Not reached: all of it was read before. If it were, the reader of the mesh would say what is wrong.
    Ok(whole().unwrap_or(bytes))
}
