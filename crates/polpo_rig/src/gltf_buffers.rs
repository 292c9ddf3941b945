//! The bytes of a glTF: the chunks of a `.glb`, buffers in files and in data URIs.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;

use crate::gltf_document::BufferSource;

const JSON: &[u8] = b"JSON";
const BIN: &[u8] = b"BIN\0";

/// Padded or not, as files are.
const BASE64: GeneralPurpose =
    GeneralPurpose::new(&alphabet::STANDARD, GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent));

/// The JSON text and the binary chunk of a `.glb`; anything else is taken to be text.
pub(crate) fn binary_chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let Some(rest) = bytes.strip_prefix(b"glTF") else {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
    };
    let (version, rest) = rest.split_first_chunk::<4>().ok_or("it ends in its header")?;
    if u32::from_le_bytes(*version) != 2 {
        return Err(format!("glTF version {}, only 2 is read", u32::from_le_bytes(*version)));
    }
    let mut rest = rest.get(4..).ok_or("it ends in its header")?;
    let (mut text, mut blob) = (None, None);
    while !rest.is_empty() {
        let (header, after) = rest.split_first_chunk::<8>().ok_or("it ends in a chunk's header")?;
        let [a, b, c, d, ..] = *header;
        let length = u32::from_le_bytes([a, b, c, d]) as usize;
        let (chunk, after) = after.split_at_checked(length).ok_or("it ends in a chunk")?;
        match &header[4..] {
            kind if kind == JSON && text.is_none() => text = Some(chunk),
            kind if kind == BIN && blob.is_none() => blob = Some(chunk),
            _ => {}
        }
        rest = after;
    }
    Ok((text.ok_or("it has no JSON chunk")?, blob))
}

/// The bytes of a document's buffers, each file read once however often it is named.
pub(crate) struct Buffers<'a> {
    /// Which of `bytes` a buffer is.
    of: Vec<usize>,
    bytes: Vec<Cow<'a, [u8]>>,
}

impl<'a> Buffers<'a> {
    pub(crate) fn load(sources: &[BufferSource], blob: Option<&'a [u8]>, folder: Option<&Path>) -> Result<Buffers<'a>, String> {
        let mut buffers = Buffers { of: Vec::new(), bytes: Vec::new() };
        let mut files: BTreeMap<PathBuf, usize> = BTreeMap::new();
        for (index, source) in sources.iter().enumerate() {
            let fail = |reason: String| format!("buffer {index}: {reason}");
            let mut at = buffers.bytes.len();
            match source.uri.as_deref() {
                None => buffers.bytes.push(Cow::Borrowed(blob.ok_or_else(|| fail("there is no binary chunk".into()))?)),
                Some(uri) => match uri.strip_prefix("data:") {
                    Some(data) => buffers.bytes.push(Cow::Owned(data_uri(data).map_err(fail)?)),
                    None => {
                        let path = file(uri, folder).map_err(fail)?;
                        at = *files.entry(path.clone()).or_insert(at);
                        if at == buffers.bytes.len() {
                            buffers.bytes.push(Cow::Owned(fs::read(path).map_err(|e| fail(format!("{uri}: {e}")))?));
                        }
                    }
                },
            }
            let (found, wanted) = (buffers.bytes[at].len(), source.byte_length);
            if found < wanted {
                return Err(fail(format!("{found} bytes where {wanted} should be")));
            }
            buffers.of.push(at);
        }
        Ok(buffers)
    }

    pub(crate) fn get(&self, buffer: usize) -> Option<&[u8]> {
        self.bytes.get(*self.of.get(buffer)?).map(|bytes| &**bytes)
    }

    /// The bytes that came from elsewhere than the document's own file.
    pub(crate) fn outside(&self) -> usize {
        self.bytes.iter().filter(|b| matches!(b, Cow::Owned(_))).map(|b| b.len()).sum()
    }
}

/// The bytes after `data:`, which must be base64.
fn data_uri(data: &str) -> Result<Vec<u8>, String> {
    let (_, code) = data.split_once(";base64,").ok_or("a data URI that is not base64")?;
    BASE64.decode(code).map_err(|e| format!("its data URI is not base64: {e}"))
}

/// The file that a URI names: by a path from the document's folder, which may lead out of it, and nothing else.
fn file(uri: &str, folder: Option<&Path>) -> Result<PathBuf, String> {
    let folder = folder.ok_or_else(|| format!("{uri} is a file of its own"))?;
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
    if let Some(scheme) = scheme.filter(|s| s.bytes().all(|b| b.is_ascii_alphanumeric() || b"+-.".contains(&b))) {
        return Err(format!("{uri}: only files beside the document are read, nothing by {scheme:?}"));
    }
    let decoded = percent_decode_str(uri).decode_utf8().map_err(|e| format!("{uri}: {e}"))?;
    let relative = Path::new(&*decoded);
    if relative.components().any(|c| matches!(c, Component::RootDir | Component::Prefix(_))) || decoded.starts_with('\\') {
        return Err(format!("{uri}: a path from the root, only files beside the document are read"));
    }
    // The one name of the file: it is read once. What is no file, like a device, may never end.
    let path = fs::canonicalize(folder.join(relative)).map_err(|e| format!("{uri}: {e}"))?;
    if path.is_file() { Ok(path) } else { Err(format!("{uri} is not a file")) }
}
