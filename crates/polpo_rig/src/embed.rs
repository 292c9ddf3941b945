//! A rig in the glTF of its mesh, as extras of the default scene.
//!
//! What is new is spliced into the JSON text; all else keeps its bytes, spaces and order included.

use std::fmt;
use std::ops::Range;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;

use crate::files::not_a_rig;
use crate::{Rig, RigError};

const KEY: &str = "polpo_rig";

/// Puts a rig into the glTF of its mesh, a `.glb` or the text of a `.gltf`, so that one file carries both; `name` is for errors.
///
/// The extras of the default scene (`scene`, or the first if that is not told) hold it as `polpo_rig`, the bytes of a `.rig` file in base64
/// (the standard alphabet, padded), on one line:
///
/// ```json
/// "scenes": [{ "nodes": [0], "extras": { "polpo_rig": "UE9MUE9SSUcCAAAA…" } }]
/// ```
///
/// Any engine that hands out a scene's extras as text can read that by [`Rig::from_extras`]. A rig that was there is replaced. A file without a
/// scene gets one of all nodes that have no parent. Everything else stays as it is, byte for byte: names, other extras, extensions, chunks
/// that nobody knows, up to the spaces at the end of the JSON chunk.
///
/// # Errors
/// [`RigError::Invalid`] for a rig that [`validate`](Rig::validate) refuses, [`RigError::NotAGltf`] for bytes that are none, a default scene
/// that is not there, extras that are no object, or a file of more than 4 GiB.
pub fn embed_rig(name: &str, gltf: &[u8], rig: &Rig) -> Result<Vec<u8>, RigError> {
    let code = format!("\"{}\"", BASE64_STANDARD.encode(rig.to_postcard()?));
    let fail = |reason: String| not_a_gltf(name, reason);
    let file = File::parse(gltf).map_err(fail)?;
    let text = splices(file.text, &code).map(|splices| splice(file.text, splices)).map_err(fail)?;
    file.with(&text).map_err(fail)
}

impl Rig {
    /// The rig that [`embed_rig`] put into a `.glb` or the text of a `.gltf`, if it holds one; `name` is for errors.
    ///
    /// Whether it was made for the mesh beside it, [`check_mesh`](Rig::check_mesh) says.
    ///
    /// # Errors
    /// [`RigError::NotAGltf`] for bytes that are none or a default scene that is not there, and those of [`from_extras`](Rig::from_extras).
    pub fn from_gltf(name: &str, bytes: &[u8]) -> Result<Option<Rig>, RigError> {
        let fail = |reason: String| not_a_gltf(name, reason);
        let scene = File::parse(bytes).and_then(|file| Ok(default_scene(&Members::of(file.text)?)?.map(|scene| scene.1)));
        let Some(scene) = scene.map_err(fail)? else { return Ok(None) };
        let scene = Members::of(scene.get()).map_err(|e| fail(format!("the default scene: {e}")))?;
        scene.get("extras").map_or(Ok(None), |extras| Rig::from_extras(name, extras.get()))
    }

    /// The rig in a scene's extras, if they hold one. `json` is their text, as engines hand it out; `name` is for errors.
    ///
    /// # Errors
    /// [`RigError::NotARig`] for a text that is not JSON, or a `polpo_rig` that is not base64; those of [`from_postcard`](Rig::from_postcard).
    pub fn from_extras(name: &str, json: &str) -> Result<Option<Rig>, RigError> {
        let extras: &RawValue = serde_json::from_str(json).map_err(|e| not_a_rig(name, format_args!("extras: {e}")))?;
        // Somebody else's: glTF lets extras be anything.
        if !extras.get().starts_with('{') {
            return Ok(None);
        }
        let members = Members::of(extras.get()).map_err(|e| not_a_rig(name, format_args!("extras: {e}")))?;
        let Some(code) = members.get(KEY) else { return Ok(None) };
        let code: String = serde_json::from_str(code.get()).map_err(|e| not_a_rig(name, format_args!("extras, {KEY}: {e}")))?;
        let bytes = BASE64_STANDARD.decode(code).map_err(|e| not_a_rig(name, format_args!("extras, {KEY}: {e}")))?;
        Rig::from_postcard(name, &bytes).map(Some)
    }
}

fn not_a_gltf(name: &str, reason: String) -> RigError {
    RigError::NotAGltf { name: name.into(), reason }
}

/// A glTF file: its JSON text, and what stands around that in a `.glb`.
struct File<'a> {
    text: &'a str,
    binary: Option<Binary<'a>>,
}

struct Binary<'a> {
    /// The chunks behind the JSON.
    chunks: &'a [u8],
    /// What comes after the length that the file tells; of no meaning.
    rest: &'a [u8],
}

/// Bytes of a `.glb`'s header, and of it and the first chunk's.
const HEADER: usize = 12;
const HEADERS: usize = 20;

impl<'a> File<'a> {
    fn parse(bytes: &'a [u8]) -> Result<File<'a>, String> {
        let text = |bytes| std::str::from_utf8(bytes).map_err(|e| e.to_string());
        if !bytes.starts_with(b"glTF") {
            return Ok(File { text: text(bytes)?, binary: None });
        }
        let (headers, _) = bytes.split_first_chunk::<HEADERS>().ok_or("it ends in its header")?;
        let word = |at: usize| u32::from_le_bytes([headers[at], headers[at + 1], headers[at + 2], headers[at + 3]]);
        let (version, length, json) = (word(4), word(8) as usize, word(HEADER) as usize);
        if version != 2 {
            return Err(format!("glTF version {version}, only 2 is read"));
        }
        if &headers[HEADER + 4..] != b"JSON" {
            return Err("its first chunk is not JSON".into());
        }
        let (chunks, rest) = bytes.split_at_checked(length).ok_or("it ends too early")?;
        let (json, chunks) = chunks.get(HEADERS..).and_then(|c| c.split_at_checked(json)).ok_or("it ends in its JSON")?;
        Ok(File { text: text(json)?, binary: Some(Binary { chunks, rest }) })
    }

    /// The file with another text.
    fn with(&self, text: &str) -> Result<Vec<u8>, String> {
        let Some(Binary { chunks, rest }) = &self.binary else { return Ok(text.into()) };
        let text = text.trim_end_matches(' ');
        let json = text.len().next_multiple_of(4);
        let word = |n: usize| u32::try_from(n).map(u32::to_le_bytes).map_err(|_| "it would take more than 4 GiB");
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend(word(HEADERS + json + chunks.len())?);
        bytes.extend(word(json)?);
        bytes.extend(b"JSON");
        bytes.extend(text.as_bytes());
        bytes.resize(HEADERS + json, b' ');
        bytes.extend(*chunks);
        bytes.extend(*rest);
        Ok(bytes)
    }
}

/// The members of a JSON object, their values as they stand in the text.
struct Members<'a>(Vec<(String, &'a RawValue)>);

impl<'a> Members<'a> {
    fn of(text: &'a str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|e| e.to_string())
    }

    /// The value of a key; the last, if it comes twice, as most readers have it.
    fn get(&self, key: &str) -> Option<&'a RawValue> {
        self.0.iter().rev().find(|member| member.0 == key).map(|member| member.1)
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for Members<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Object;

        impl<'de> Visitor<'de> for Object {
            type Value = Vec<(String, &'de RawValue)>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut members = Vec::new();
                while let Some(member) = map.next_entry()? {
                    members.push(member);
                }
                Ok(members)
            }
        }

        deserializer.deserialize_map(Object).map(Members)
    }
}

/// Index and text of the default scene, if the document has scenes.
fn default_scene<'a>(document: &Members<'a>) -> Result<Option<(usize, &'a RawValue)>, String> {
    let list = |raw: &'a RawValue| serde_json::from_str::<Option<Vec<&RawValue>>>(raw.get()).map_err(|e| format!("scenes: {e}"));
    let scenes = document.get("scenes").map(list).transpose()?.flatten().unwrap_or_default();
    if scenes.is_empty() {
        return Ok(None);
    }
    let index = document.get("scene").map(|raw| serde_json::from_str(raw.get()).map_err(|e| format!("scene: {e}")));
    let index = index.transpose()?.unwrap_or(0_usize);
    scenes.get(index).map(|scene| Some((index, *scene))).ok_or_else(|| format!("the default scene is {index}, of {}", scenes.len()))
}

/// A stretch of the text, and what comes in its place.
type Splice = (Range<usize>, String);

/// What has to change in a document's text for its default scene to hold a rig.
fn splices(text: &str, code: &str) -> Result<Vec<Splice>, String> {
    let document = Members::of(text)?;
    // Without it there would be nothing to put a comma after.
    document.get("asset").ok_or("it has no asset")?;
    let Some((index, scene)) = default_scene(&document)? else {
        let scene = format!("[{{{}\"extras\":{{\"{KEY}\":{code}}}}}]", roots(&document)?);
        return Ok(vec![set(text, text, &document, "scene", "0".into()), set(text, text, &document, "scenes", scene)]);
    };
    let within = |e: String| format!("scene {index}: {e}");
    let members = Members::of(scene.get()).map_err(within)?;
    let splice = match members.get("extras").map(RawValue::get) {
        None | Some("null") => set(text, scene.get(), &members, "extras", format!("{{\"{KEY}\":{code}}}")),
        Some(extras) => {
            let others = Members::of(extras).map_err(|e| within(format!("its extras: {e}")))?;
            set(text, extras, &others, KEY, code.into())
        }
    };
    Ok(vec![splice])
}

/// Sets a member of an object in a text.
fn set(text: &str, object: &str, members: &Members, key: &str, value: String) -> Splice {
    // `object` and the values are parts of `text`: where they begin is how far apart they are in memory.
    let start = |part: &str| part.as_ptr() as usize - text.as_ptr() as usize;
    if let Some(old) = members.get(key).map(RawValue::get) {
        return (start(old)..start(old) + old.len(), value);
    }
    let at = start(object) + object.find('{').map_or(0, |brace| brace + 1);
    let comma = if members.0.is_empty() { "" } else { "," };
    (at..at, format!("\"{key}\":{value}{comma}"))
}

fn splice(text: &str, mut splices: Vec<Splice>) -> String {
    splices.sort_by_key(|splice| splice.0.start);
    let mut spliced = String::with_capacity(text.len() + splices.iter().map(|splice| splice.1.len()).sum::<usize>());
    let mut at = 0;
    for (range, new) in splices {
        spliced.push_str(&text[at..range.start]);
        spliced.push_str(&new);
        at = range.end;
    }
    spliced.push_str(&text[at..]);
    spliced
}

/// The nodes without a parent, as a scene's member; nothing if there are no nodes.
fn roots(document: &Members) -> Result<String, String> {
    #[derive(Deserialize)]
    struct Node {
        #[serde(default)]
        children: Vec<usize>,
    }

    let list = |raw: &RawValue| serde_json::from_str::<Vec<Node>>(raw.get()).map_err(|e| format!("nodes: {e}"));
    let nodes = document.get("nodes").map(list).transpose()?.unwrap_or_default();
    let mut is_root = vec![true; nodes.len()];
    for &child in nodes.iter().flat_map(|node| &node.children) {
        *is_root.get_mut(child).ok_or_else(|| format!("node {child} is not there"))? = false;
    }
    let roots: Vec<String> = (0..nodes.len()).filter(|&n| is_root[n]).map(|n| n.to_string()).collect();
    Ok(if roots.is_empty() { String::new() } else { format!("\"nodes\":[{}],", roots.join(",")) })
}
