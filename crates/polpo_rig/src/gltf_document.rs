//! What a glTF's JSON says of meshes; all else in it is skipped.

use std::borrow::Cow;

use glam::{DMat3, DMat4, DQuat, DVec3};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// The parts of a document that hold a mesh; absent lists are empty.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Document<'a> {
    #[serde(borrow)]
    pub(crate) extensions_required: Vec<Cow<'a, str>>,
    #[serde(borrow)]
    pub(crate) nodes: Vec<Node<'a>>,
    #[serde(borrow)]
    pub(crate) meshes: Vec<Shape<'a>>,
    #[serde(borrow)]
    pub(crate) materials: Vec<Named<'a>>,
    pub(crate) accessors: Vec<Accessor>,
    pub(crate) buffer_views: Vec<BufferView>,
    #[serde(borrow)]
    pub(crate) buffers: Vec<BufferSource<'a>>,
}

/// Boxed where it seldom says anything: `{}` is a node, and a file may have millions.
#[derive(Deserialize)]
pub(crate) struct Node<'a> {
    #[serde(borrow)]
    name: Option<Cow<'a, str>>,
    #[serde(default)]
    pub(crate) children: Box<[usize]>,
    pub(crate) mesh: Option<usize>,
    pub(crate) skin: Option<IgnoredAny>,
    matrix: Option<Box<[f64; 16]>>,
    translation: Option<Box<[f64; 3]>>,
    rotation: Option<Box<[f64; 4]>>,
    scale: Option<Box<[f64; 3]>>,
}

#[derive(Deserialize)]
pub(crate) struct Shape<'a> {
    #[serde(borrow)]
    name: Option<Cow<'a, str>>,
    pub(crate) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(crate) struct Named<'a> {
    #[serde(borrow)]
    name: Option<Cow<'a, str>>,
}

#[derive(Deserialize)]
pub(crate) struct Primitive {
    pub(crate) attributes: Attributes,
    pub(crate) indices: Option<usize>,
    pub(crate) material: Option<usize>,
    pub(crate) mode: Option<u32>,
}

#[derive(Deserialize)]
pub(crate) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(crate) position: Option<usize>,
    #[serde(rename = "NORMAL")]
    pub(crate) normal: Option<usize>,
    #[serde(rename = "COLOR_0")]
    pub(crate) color: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    pub(crate) uv: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: Option<usize>,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) component_type: u32,
    #[serde(default)]
    pub(crate) normalized: bool,
    pub(crate) count: usize,
    #[serde(rename = "type")]
    pub(crate) shape: Box<str>,
    pub(crate) sparse: Option<Box<Sparse>>,
}

/// Elements that differ from what the accessor's buffer view, or nought, says.
#[derive(Deserialize)]
pub(crate) struct Sparse {
    pub(crate) count: usize,
    pub(crate) indices: SparseList,
    pub(crate) values: SparseList,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseList {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    /// Of indices only.
    pub(crate) component_type: Option<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) byte_length: usize,
    pub(crate) byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferSource<'a> {
    #[serde(borrow)]
    pub(crate) uri: Option<Cow<'a, str>>,
    pub(crate) byte_length: usize,
}

impl Node<'_> {
    pub(crate) fn name(&self) -> &str {
        self.name.as_deref().unwrap_or_default()
    }

    fn transform(&self) -> Option<DMat4> {
        if let Some(matrix) = &self.matrix {
            return Some(DMat4::from_cols_array(matrix));
        }
        let vector = |v: &Option<Box<[f64; 3]>>, or| v.as_deref().map_or(or, |&v| DVec3::from_array(v));
        let rotation = match self.rotation.as_deref() {
            Some(&[0.0, 0.0, 0.0, 1.0]) | None => DQuat::IDENTITY,
            Some(&[x, y, z, w]) => {
                let length = (x * x + y * y + z * z + w * w).sqrt();
                if !(length.is_finite() && length > 0.0) {
                    return None;
                }
                DQuat::from_xyzw(x / length, y / length, z / length, w / length)
            }
        };
        let axes = DMat3::from_quat(rotation) * DMat3::from_diagonal(vector(&self.scale, DVec3::ONE));
        let mut transform = DMat4::from_mat3(axes);
        transform.w_axis = vector(&self.translation, DVec3::ZERO).extend(1.0);
        Some(transform)
    }
}

impl Shape<'_> {
    pub(crate) fn name(&self) -> &str {
        self.name.as_deref().unwrap_or_default()
    }
}

impl Document<'_> {
    /// The name of a material; empty without one.
    pub(crate) fn material(&self, index: Option<usize>) -> Result<&str, String> {
        let Some(index) = index else { return Ok("") };
        let material = self.materials.get(index).ok_or_else(|| format!("material {index} is not there"))?;
        Ok(material.name.as_deref().unwrap_or_default())
    }

    /// The transform of every node to the world, in file order.
    pub(crate) fn world_transforms(&self) -> Result<Vec<DMat4>, String> {
        let nodes = &self.nodes;
        let mut parented = vec![false; nodes.len()];
        for (index, node) in nodes.iter().enumerate() {
            for &child in &node.children {
                let slot = parented.get_mut(child).ok_or_else(|| format!("node {index} has child {child}, which is not there"))?;
                if std::mem::replace(slot, true) {
                    return Err(format!("node {child} has two parents"));
                }
            }
        }
        let mut world = Vec::with_capacity(nodes.len());
        for (index, node) in nodes.iter().enumerate() {
            world.push(node.transform().ok_or_else(|| format!("the rotation of node {index} is no quaternion"))?);
        }
        let mut open: Vec<usize> = (0..nodes.len()).filter(|&node| !parented[node]).collect();
        while let Some(node) = open.pop() {
            for &child in &nodes[node].children {
                world[child] = world[node] * world[child];
                parented[child] = false;
                open.push(child);
            }
        }
        // What no root leads to goes in circles.
        match parented.iter().position(|&unreached| unreached) {
            Some(node) => Err(format!("node {node} is its own ancestor, or below one that is")),
            None => Ok(world),
        }
    }
}
