//! The bytes of a glTF: the chunks of a `.glb`, buffers in files and data URIs, and the numbers accessors make of them.

use std::fs;
use std::path::Path;

use crate::read_gltf::{Accessor, Document};

const JSON: &[u8] = b"JSON";
const BIN: &[u8] = b"BIN\0";

/// The JSON text and the binary chunk of a `.glb`; anything else is taken to be text.
pub(crate) fn binary_chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let Some(rest) = bytes.strip_prefix(b"glTF") else { return Ok((bytes, None)) };
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

/// A document's buffers, and its accessors to read them by.
pub(crate) struct Buffers<'a> {
    document: &'a Document,
    bytes: Vec<Vec<u8>>,
}

impl Buffers<'_> {
    pub(crate) fn load<'a>(document: &'a Document, blob: Option<&[u8]>, folder: Option<&Path>) -> Result<Buffers<'a>, String> {
        let mut bytes = Vec::new();
        for (index, source) in document.buffers.iter().enumerate() {
            let fail = |reason: String| format!("buffer {index}: {reason}");
            let loaded = match &source.uri {
                None => blob.ok_or_else(|| fail("there is no binary chunk".into()))?.to_vec(),
                Some(uri) => match uri.strip_prefix("data:") {
                    Some(data) => data_uri(data).map_err(fail)?,
                    None => {
                        let folder = folder.ok_or_else(|| fail(format!("{uri} is a file of its own")))?;
                        let path = folder.join(percent_decoded(uri));
                        fs::read(path).map_err(|e| fail(format!("{uri}: {e}")))?
                    }
                },
            };
            if loaded.len() < source.byte_length {
                let (found, wanted) = (loaded.len(), source.byte_length);
                return Err(fail(format!("{found} bytes where {wanted} should be")));
            }
            bytes.push(loaded);
        }
        Ok(Buffers { document, bytes })
    }

    fn accessor(&self, index: usize) -> Result<&Accessor, String> {
        let accessor = self.document.accessors.get(index);
        accessor.ok_or_else(|| format!("accessor {index} is not there"))
    }

    /// The elements of an accessor, `size` bytes each, checked against view and buffer.
    fn elements(&self, accessor: &Accessor, size: usize) -> Result<impl Iterator<Item = &[u8]>, String> {
        if accessor.sparse.is_some() {
            return Err("sparse accessors are not supported".into());
        }
        let view = accessor.buffer_view.ok_or("the accessor has no buffer view")?;
        let view = self.document.buffer_views.get(view).ok_or_else(|| format!("buffer view {view} is not there"))?;
        let bytes = self
            .bytes
            .get(view.buffer)
            .and_then(|b| b.get(view.byte_offset..view.byte_offset.checked_add(view.byte_length)?))
            .and_then(|b| b.get(accessor.byte_offset..))
            .ok_or("the buffer view reaches beyond its buffer")?;
        let stride = view.byte_stride.unwrap_or(size).max(1);
        let count = accessor.count;
        let needed = match count.checked_sub(1) {
            Some(before) => before.checked_mul(stride).and_then(|n| n.checked_add(size)),
            None => Some(0),
        };
        if needed.is_none_or(|needed| needed > bytes.len()) {
            return Err("the accessor reaches beyond its buffer view".into());
        }
        Ok((0..count).map(move |i| &bytes[i * stride..i * stride + size]))
    }

    /// Vectors of two to four components of any storable type; missing components are 0, a missing fourth is 1.
    pub(crate) fn vectors(&self, index: usize) -> Result<Vec<[f32; 4]>, String> {
        let accessor = self.accessor(index)?;
        let components = match accessor.shape.as_str() {
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => return Err(format!("{other} where a vector should be")),
        };
        let component = Component::new(accessor.component_type)?;
        let vector = |bytes: &[u8]| {
            let mut v = [0.0, 0.0, 0.0, 1.0];
            for (x, bytes) in v.iter_mut().zip(bytes.chunks(component.width())) {
                *x = component.value(bytes, accessor.normalized);
            }
            v
        };
        Ok(self.elements(accessor, components * component.width())?.map(vector).collect())
    }

    /// Unsigned scalars.
    pub(crate) fn indices(&self, index: usize) -> Result<Vec<u32>, String> {
        let accessor = self.accessor(index)?;
        if accessor.shape != "SCALAR" {
            return Err(format!("{} where a scalar should be", accessor.shape));
        }
        let width = match accessor.component_type {
            5121 => 1,
            5123 => 2,
            5125 => 4,
            other => return Err(format!("component type {other} is no index")),
        };
        let value = |bytes: &[u8]| bytes.iter().rev().fold(0, |n, &b| n << 8 | u32::from(b));
        Ok(self.elements(accessor, width)?.map(value).collect())
    }
}

/// The types a vector's component is stored in.
#[derive(Clone, Copy)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    F32,
}

impl Component {
    fn new(code: u32) -> Result<Component, String> {
        match code {
            5120 => Ok(Component::I8),
            5121 => Ok(Component::U8),
            5122 => Ok(Component::I16),
            5123 => Ok(Component::U16),
            5126 => Ok(Component::F32),
            other => Err(format!("component type {other} is not supported in a vector")),
        }
    }

    fn width(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::F32 => 4,
        }
    }

    /// Normalised integers become 0 to 1 or -1 to 1.
    fn value(self, bytes: &[u8], normalized: bool) -> f32 {
        let (value, most) = match (self, bytes) {
            (Component::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
            (Component::I8, &[a]) => (f32::from(a as i8), 127.0),
            (Component::U8, &[a]) => (f32::from(a), 255.0),
            (Component::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
            (Component::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
            // Chunks are as wide as the component; if not, the check for finite values reports it.
            _ => (f32::NAN, 1.0),
        };
        if normalized { (value / most).max(-1.0) } else { value }
    }
}

/// The bytes after `data:`, which must be base64.
fn data_uri(data: &str) -> Result<Vec<u8>, String> {
    let (_, code) = data.split_once(";base64,").ok_or("a data URI that is not base64")?;
    let mut bytes = Vec::with_capacity(code.len() / 4 * 3);
    let (mut bits, mut count) = (0_u32, 0);
    for symbol in code.trim_end_matches('=').bytes() {
        let value = match symbol {
            b'A'..=b'Z' => symbol - b'A',
            b'a'..=b'z' => symbol - b'a' + 26,
            b'0'..=b'9' => symbol - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return Err(format!("{:?} is not base64", char::from(symbol))),
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Ok(bytes)
}

/// `%20` and the like in a file name.
fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let code = after.get(..2).and_then(|c| std::str::from_utf8(c).ok());
        match code.and_then(|c| u8::from_str_radix(c, 16).ok()) {
            Some(byte) if first == b'%' => {
                bytes.push(byte);
                rest = &after[2..];
            }
            _ => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
