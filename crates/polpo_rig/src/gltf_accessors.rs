//! The numbers that a glTF's accessors make of its buffers.

use crate::gltf_buffers::Buffers;
use crate::gltf_document::{Accessor, Document};

/// A document's accessors, and the bytes they read.
pub(crate) struct Accessors<'a> {
    pub(crate) document: &'a Document<'a>,
    pub(crate) buffers: &'a Buffers<'a>,
}

impl Accessors<'_> {
    fn get(&self, index: usize) -> Result<&Accessor, String> {
        self.document.accessors.get(index).ok_or_else(|| format!("accessor {index} is not there"))
    }

    /// How many elements it says it has: to be weighed before they are read, since it need not have bytes for them.
    pub(crate) fn count(&self, index: usize) -> Result<usize, String> {
        Ok(self.get(index)?.count)
    }

    /// Vectors of `least` to N components of any storable type; where the fourth is missing it is 1.
    pub(crate) fn vectors<const N: usize, T: From<[f32; N]> + Copy>(&self, index: usize, least: usize) -> Result<Vec<T>, String> {
        let accessor = self.get(index)?;
        let components = match &*accessor.shape {
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 0,
        };
        if !(least..=N).contains(&components) {
            return Err(format!("{} where a vector of {N} should be", accessor.shape));
        }
        let component = Component::new(accessor.component_type)?;
        self.read(accessor, components * component.width(), |bytes| {
            let mut v = [1.0; N];
            for (x, bytes) in v.iter_mut().zip(bytes.chunks(component.width())) {
                *x = component.value(bytes, accessor.normalized);
            }
            v.into()
        })
    }

    /// Unsigned scalars.
    pub(crate) fn indices(&self, index: usize) -> Result<Vec<u32>, String> {
        let accessor = self.get(index)?;
        if &*accessor.shape != "SCALAR" {
            return Err(format!("{} where a scalar should be", accessor.shape));
        }
        self.read(accessor, index_width(accessor.component_type)?, unsigned)
    }

    /// An accessor's elements, `size` bytes each; nought where it has no bytes.
    fn read<T: Copy>(&self, accessor: &Accessor, size: usize, value: impl Fn(&[u8]) -> T) -> Result<Vec<T>, String> {
        let count = accessor.count;
        let mut all: Vec<T> = match accessor.buffer_view {
            Some(view) => self.elements(view, accessor.byte_offset, count, size)?.map(&value).collect(),
            None => vec![value(&[0; WIDEST][..size.min(WIDEST)]); count],
        };
        if let Some(sparse) = &accessor.sparse {
            let part = |e: String| format!("sparse: {e}");
            let indices = &sparse.indices;
            let width = index_width(indices.component_type.unwrap_or_default()).map_err(part)?;
            let places = self.elements(indices.buffer_view, indices.byte_offset, sparse.count, width).map_err(part)?;
            let values = self.elements(sparse.values.buffer_view, sparse.values.byte_offset, sparse.count, size).map_err(part)?;
            for (place, bytes) in places.map(unsigned).zip(values) {
                let slot = all.get_mut(place as usize).ok_or_else(|| part(format!("element {place} is beyond the {count}")))?;
                *slot = value(bytes);
            }
        }
        Ok(all)
    }

    /// So many pieces of `size` bytes, checked against view and buffer.
    fn elements(&self, view: usize, offset: usize, count: usize, size: usize) -> Result<impl Iterator<Item = &[u8]>, String> {
        let view = self.document.buffer_views.get(view).ok_or_else(|| format!("buffer view {view} is not there"))?;
        let bytes = self
            .buffers
            .get(view.buffer)
            .and_then(|b| b.get(view.byte_offset..view.byte_offset.checked_add(view.byte_length)?))
            .and_then(|b| b.get(offset..))
            .ok_or("the buffer view reaches beyond its buffer")?;
        let stride = view.byte_stride.unwrap_or(size);
        if stride < size {
            return Err(format!("the buffer view steps {stride} bytes, but an element has {size}"));
        }
        let needed = match count.checked_sub(1) {
            Some(before) => before.checked_mul(stride).and_then(|n| n.checked_add(size)),
            None => Some(0),
        };
        if needed.is_none_or(|needed| needed > bytes.len()) {
            return Err("the accessor reaches beyond its buffer view".into());
        }
        Ok((0..count).map(move |i| &bytes[i * stride..i * stride + size]))
    }
}

const FLOAT: u32 = 5126;

/// Four floats.
const WIDEST: usize = 16;

fn index_width(component_type: u32) -> Result<usize, String> {
    match component_type {
        5121 => Ok(1),
        5123 => Ok(2),
        5125 => Ok(4),
        other => Err(format!("component type {other} is no index")),
    }
}

fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |n, &b| n << 8 | u32::from(b))
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
            FLOAT => Ok(Component::F32),
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
