//! Model files in memory, for what loads them.

use std::path::Path;

use bevy::asset::io::memory::{Dir, MemoryAssetReader};
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::mesh::{Indices, VertexAttributeValues};
use bevy::prelude::*;
use serde_json::{Value, json};

/// The files that an app loads from: a folder in memory. What is changed in it the app sees when it is told to reload it.
#[derive(Clone, Default)]
pub struct Files(Dir);

impl Files {
    /// Makes it the app's assets; before the `AssetPlugin`.
    pub fn serve(&self, app: &mut App) {
        let root = self.0.clone();
        let reader = move || -> Box<dyn bevy::asset::io::ErasedAssetReader> { Box::new(MemoryAssetReader { root: root.clone() }) };
        app.register_asset_source(AssetSourceId::Default, AssetSourceBuilder::new(reader));
    }

    /// Writes a file.
    pub fn write(&self, path: &str, bytes: impl Into<Vec<u8>>) {
        self.0.insert_asset(Path::new(path), bytes.into());
    }

    /// Writes a file and has it loaded again.
    pub fn change(&self, app: &App, path: &str, bytes: impl Into<Vec<u8>>) {
        self.write(path, bytes);
        app.world().resource::<AssetServer>().reload(path.to_owned());
    }
}

/// A primitive of a glTF mesh.
pub struct Primitive {
    mesh: Mesh,
    /// Whether its normals are in the file.
    pub normals: bool,
    /// Whether its texture coordinates are.
    pub uvs: bool,
    /// Index of its material, if it has one.
    pub material: Option<usize>,
}

impl Primitive {
    /// Of a shape of Bevy's.
    pub fn new(mesh: impl Into<Mesh>, material: Option<usize>) -> Self {
        Self { mesh: mesh.into(), normals: true, uvs: true, material }
    }
}

/// A `.glb` of `nodes`, each with a mesh of its own, materials by name and base colour, and extras of its scene.
pub fn glb(nodes: &[(Transform, Vec<Primitive>)], materials: &[(&str, [f32; 4])], extras: Value) -> Vec<u8> {
    let (document, blob) = gltf(nodes, materials, extras, json!(null));
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + text.len() as u32 + blob.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &blob)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// The document and the buffer that it names `uri`.
pub fn gltf(nodes: &[(Transform, Vec<Primitive>)], materials: &[(&str, [f32; 4])], extras: Value, uri: Value) -> (Value, Vec<u8>) {
    let (mut blob, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |bytes: Vec<u8>, shape: &str, component: u32, count: usize, bounds: Option<[Vec3; 2]>| {
        views.push(json!({ "buffer": 0, "byteOffset": blob.len(), "byteLength": bytes.len() }));
        blob.extend(bytes);
        let mut accessor = json!({ "bufferView": views.len() - 1, "componentType": component, "count": count, "type": shape });
        if let Some([min, max]) = bounds {
            (accessor["min"], accessor["max"]) = (json!(min.to_array()), json!(max.to_array()));
        }
        accessors.push(accessor);
        accessors.len() - 1
    };
    const FLOAT: u32 = 5126;
    let mut meshes = Vec::new();
    for (_, primitives) in nodes {
        let list: Vec<Value> = primitives
            .iter()
            .map(|primitive| {
                let vectors = |attribute| match primitive.mesh.attribute(attribute) {
                    Some(VertexAttributeValues::Float32x3(values)) => values.clone(),
                    _ => panic!("the shape has its attributes"),
                };
                let positions = vectors(Mesh::ATTRIBUTE_POSITION);
                let places = || positions.iter().map(|&p| Vec3::from(p));
                let bounds = [places().reduce(Vec3::min), places().reduce(Vec3::max)].map(|bound| bound.expect("there are vertices"));
                let bytes = |values: &[[f32; 3]]| values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
                let mut attributes = json!({ "POSITION": add(bytes(&positions), "VEC3", FLOAT, positions.len(), Some(bounds)) });
                if primitive.normals {
                    attributes["NORMAL"] = json!(add(bytes(&vectors(Mesh::ATTRIBUTE_NORMAL)), "VEC3", FLOAT, positions.len(), None));
                }
                if primitive.uvs
                    && let Some(VertexAttributeValues::Float32x2(uvs)) = primitive.mesh.attribute(Mesh::ATTRIBUTE_UV_0)
                {
                    let bytes = uvs.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
                    attributes["TEXCOORD_0"] = json!(add(bytes, "VEC2", FLOAT, uvs.len(), None));
                }
                let indices: Vec<u32> =
                    primitive.mesh.indices().map(Indices::iter).expect("the shape is indexed").map(|i| i as u32).collect();
                let bytes = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
                let mut out = json!({ "attributes": attributes, "indices": add(bytes, "SCALAR", 5125, indices.len(), None) });
                if let Some(material) = primitive.material {
                    out["material"] = json!(material);
                }
                out
            })
            .collect();
        meshes.push(json!({ "name": format!("mesh {}", meshes.len()), "primitives": list }));
    }
    let node = |(index, (t, _)): (usize, &(Transform, Vec<Primitive>))| {
        let (translation, rotation, scale) = (t.translation.to_array(), t.rotation.to_array(), t.scale.to_array());
        let mut node = json!({ "name": format!("node {index}"), "mesh": index });
        if *t != Transform::IDENTITY {
            (node["translation"], node["rotation"], node["scale"]) = (json!(translation), json!(rotation), json!(scale));
        }
        node
    };
    let material = |(name, color): &(&str, [f32; 4])| json!({ "name": name, "pbrMetallicRoughness": { "baseColorFactor": color } });
    let mut buffer = json!({ "byteLength": blob.len() });
    if uri.is_string() {
        buffer["uri"] = uri;
    }
    let mut document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes.iter().enumerate().map(node).collect::<Vec<_>>(),
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [buffer],
    });
    if !materials.is_empty() {
        document["materials"] = json!(materials.iter().map(material).collect::<Vec<_>>());
    }
    if !extras.is_null() {
        document["scenes"][0]["extras"] = extras;
    }
    (document, blob)
}

/// A dumbbell about 1.6 m long: a red ball and a green bar of one node, and a blue ball of another that is shifted, turned and mirrored. The bar has no texture coordinates, and the blue ball no normals.
pub fn dumbbell() -> Vec<(Transform, Vec<Primitive>)> {
    let ball = || Sphere::new(0.3).mesh().uv(16, 12);
    let bar = Primitive { uvs: false, ..Primitive::new(Cuboid::new(1.2, 0.16, 0.16), Some(1)) };
    let far = Transform::from_xyz(1.1, 0.0, 0.0).with_rotation(Quat::from_rotation_y(0.5)).with_scale(Vec3::new(-0.8, 0.8, 0.8));
    let red = Primitive::new(ball().translated_by(Vec3::X * -0.6), Some(0));
    vec![(Transform::IDENTITY, vec![red, bar]), (far, vec![Primitive { normals: false, ..Primitive::new(ball(), Some(2)) }])]
}

/// The dumbbell's materials.
pub const COLORS: [(&str, [f32; 4]); 3] = [("red", [1.0, 0.0, 0.0, 1.0]), ("green", [0.0, 1.0, 0.0, 1.0]), ("blue", [0.0, 0.0, 1.0, 1.0])];
