//! What can be wrong with a mesh, a rig or a file; every error names the culprit.

use std::io;

use thiserror::Error;

use crate::MeshHash;

/// Why a mesh could not be read or used. `name` is where the mesh came from: a path, or the name given to the parser.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file could not be opened or read.
    #[error("{name}: cannot be read: {source}")]
    Io {
        /// The mesh file.
        name: String,
        /// What the system said.
        source: io::Error,
    },
    /// The extension is none of `.glb`, `.gltf`, `.obj`, `.ply`, `.stl`.
    #[error("{name}: extension {extension:?} is not a mesh format read here (glb, gltf, obj, ply, stl)")]
    UnknownExtension {
        /// The mesh file.
        name: String,
        /// The extension, empty if there is none.
        extension: String,
    },
    /// The bytes are not what the extension promises.
    #[error("{name}: not a readable mesh: {reason}")]
    NotAMesh {
        /// The mesh file.
        name: String,
        /// What was wrong, and where.
        reason: String,
    },
    /// A glTF has points or lines, and no triangles beside them.
    #[error("{name}: mesh {mesh}, primitive {primitive}: mode {mode} has no surface, and nothing else in the file has triangles")]
    NoSurface {
        /// The mesh file.
        name: String,
        /// Index of the first glTF mesh like that.
        mesh: usize,
        /// Index of the primitive in it.
        primitive: usize,
        /// Its mode: `"Points"`, `"Lines"`, `"LineLoop"` or `"LineStrip"`.
        mode: &'static str,
    },
    /// There are no vertices.
    #[error("{name}: the mesh is empty, it has no vertices")]
    Empty {
        /// The mesh.
        name: String,
    },
    /// There are vertices, but no triangles.
    #[error("{name}: the mesh has no triangles")]
    NoTriangles {
        /// The mesh.
        name: String,
    },
    /// More vertices or triangles than a 32-bit index reaches.
    #[error("{name}: {count} {item} are more than a 32-bit index reaches")]
    TooLarge {
        /// The mesh.
        name: String,
        /// `"vertices"` or `"triangles"`.
        item: &'static str,
        /// How many there are.
        count: usize,
    },
    /// A vertex attribute is NaN or infinite.
    #[error("{name}: {item} {index} is not finite")]
    NotFinite {
        /// The mesh.
        name: String,
        /// Which attribute: `"position"`, `"normal"`, `"color"` or `"uv"`.
        item: &'static str,
        /// Index of the vertex.
        index: usize,
    },
    /// An attribute does not have one entry a vertex.
    #[error("{name}: {found} entries in {item}, but {expected} vertices")]
    LengthMismatch {
        /// The mesh.
        name: String,
        /// Which attribute.
        item: &'static str,
        /// The number of vertices.
        expected: usize,
        /// The number of entries.
        found: usize,
    },
    /// A triangle points beyond the vertices.
    #[error("{name}: triangle {triangle} points to vertex {vertex}, but there are {vertices}")]
    IndexOutOfRange {
        /// The mesh.
        name: String,
        /// Index of the triangle.
        triangle: usize,
        /// The vertex it asks for.
        vertex: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// The parts don't follow each other from the first vertex and triangle to the last, or a triangle leaves its part.
    #[error("{name}: part {part}: {reason}")]
    Part {
        /// The mesh.
        name: String,
        /// Index of the part.
        part: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// All vertices lie in one point.
    #[error("{name}: the mesh has no extent, all its vertices lie in one point")]
    ZeroExtent {
        /// The mesh.
        name: String,
    },
    /// Every triangle is degenerate: two equal corners, or three on a line.
    #[error("{name}: none of the {triangles} triangles has an area")]
    NoArea {
        /// The mesh.
        name: String,
        /// How many triangles there are.
        triangles: usize,
    },
}

/// The most bytes of a reason; it may quote the file, whose words may be of any length.
const LONGEST: usize = 300;

/// A reason, cut off where it is too long to read.
pub(crate) fn shortened(reason: impl ToString) -> String {
    let mut reason = reason.to_string();
    if reason.len() > LONGEST {
        let end = (0..=LONGEST).rev().find(|&i| reason.is_char_boundary(i)).unwrap_or_default();
        reason.truncate(end);
        reason.push('…');
    }
    reason
}

/// What is wrong inside a rig, and where.
#[derive(Debug, Error, Clone, PartialEq)]
#[non_exhaustive]
pub enum RigFault {
    /// The rig has no particles.
    #[error("there are no particles")]
    NoParticles,
    /// More items than a 32-bit index reaches.
    #[error("{count} {item} are more than a 32-bit index reaches")]
    TooLarge {
        /// `"particles"`.
        item: &'static str,
        /// How many there are.
        count: usize,
    },
    /// A particle's position is NaN or infinite.
    #[error("particle {particle}: position is not finite")]
    Position {
        /// Index of the particle.
        particle: usize,
    },
    /// A particle's frame is not a unit quaternion (length off by more than 1e-4, or not finite).
    #[error("particle {particle}: frame is not a unit quaternion")]
    Frame {
        /// Index of the particle.
        particle: usize,
    },
    /// A particle's half axis is not finite and positive.
    #[error("particle {particle}: radius {axis} is {radius}, must be finite and positive")]
    Radius {
        /// Index of the particle.
        particle: usize,
        /// 0, 1 or 2.
        axis: usize,
        /// The value \[m\].
        radius: f32,
    },
    /// A particle's mass is not finite and positive.
    #[error("particle {particle}: mass is {mass}, must be finite and positive")]
    Mass {
        /// Index of the particle.
        particle: usize,
        /// The value \[kg\].
        mass: f32,
    },
    /// An edge points beyond the particles.
    #[error("edge {edge} points to particle {particle}, but there are {particles}")]
    EdgeIndex {
        /// Index of the edge.
        edge: usize,
        /// The particle it asks for.
        particle: u32,
        /// The number of particles.
        particles: usize,
    },
    /// An edge is not written as (smaller, larger) index.
    #[error("edge {edge} is ({first}, {second}), the first index must be the smaller")]
    EdgeOrder {
        /// Index of the edge.
        edge: usize,
        /// Its first particle.
        first: u32,
        /// Its second particle.
        second: u32,
    },
    /// Edges are not sorted, or one comes twice.
    #[error("edge {edge} does not come after edge {}: edges must be sorted and unique", edge - 1)]
    EdgesUnsorted {
        /// Index of the offending edge, at least 1.
        edge: usize,
    },
    /// A vertex follows a particle that is not there.
    #[error("vertex {vertex}, influence {slot} points to particle {particle}, but there are {particles}")]
    InfluenceIndex {
        /// Index of the vertex.
        vertex: usize,
        /// 0 to 3.
        slot: usize,
        /// The particle it asks for.
        particle: u32,
        /// The number of particles.
        particles: usize,
    },
    /// A weight is negative or not finite.
    #[error("vertex {vertex}, influence {slot}: weight is {weight}, must be finite and not negative")]
    Weight {
        /// Index of the vertex.
        vertex: usize,
        /// 0 to 3.
        slot: usize,
        /// The value.
        weight: f32,
    },
    /// A vertex's weights don't sum to 1 within 1e-6.
    #[error("vertex {vertex}: weights sum to {sum}, must be 1")]
    WeightSum {
        /// Index of the vertex.
        vertex: usize,
        /// Their sum.
        sum: f32,
    },
    /// A region breaks its rules.
    #[error("region {region}: {what}")]
    Region {
        /// Index of the region.
        region: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// The cells break their rules.
    #[error("cells: {what} ({index})")]
    Cells {
        /// What is wrong.
        what: &'static str,
        /// Index of the volume or facet.
        index: usize,
    },
}

/// Why a rig could not be built, read or written. `name` is the file, or the mesh the rig was built from.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RigError {
    /// The mesh itself is not usable.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A setting is out of its range.
    #[error("setting `{setting}` is {value}: {range}")]
    Setting {
        /// Its key in the recipe's file.
        setting: &'static str,
        /// The value given.
        value: f64,
        /// What it must be.
        range: &'static str,
    },
    /// The text is not a recipe.
    #[error("{name}: not a recipe: {reason}")]
    Recipe {
        /// The recipe's file.
        name: String,
        /// What was wrong, and where in the file.
        reason: String,
    },
    /// More particles wanted than the finest affordable voxel grid has voxels.
    #[error("{name}: {wanted} particles wanted, but the body has only {voxels} voxels at the finest resolution")]
    TooFewVoxels {
        /// The mesh.
        name: String,
        /// The particles wanted.
        wanted: usize,
        /// The voxels the body has.
        voxels: usize,
    },
    /// The rig contradicts itself; see [`RigFault`].
    #[error("{name}: {fault}")]
    Invalid {
        /// The rig.
        name: String,
        /// What is wrong, and where.
        fault: RigFault,
    },
    /// The file could not be read or written.
    #[error("{name}: {source}")]
    Io {
        /// The rig file.
        name: String,
        /// What the system said.
        source: io::Error,
    },
    /// The extension is neither `.ron` nor `.rig`.
    #[error("{name}: extension {extension:?} is not a rig format (ron, rig)")]
    UnknownExtension {
        /// The rig file.
        name: String,
        /// The extension, empty if there is none.
        extension: String,
    },
    /// The content is not a rig: wrong start, truncated, or a wrong shape.
    #[error("{name}: not a rig: {reason}")]
    NotARig {
        /// The rig file.
        name: String,
        /// What was wrong, and where in the file if known.
        reason: String,
    },
    /// The bytes are not a glTF that a rig can be put into or taken from.
    #[error("{name}: not a glTF to hold a rig: {reason}")]
    NotAGltf {
        /// The glTF file.
        name: String,
        /// What was wrong.
        reason: String,
    },
    /// The file is of another version of the format.
    #[error(
        "{name}: rig format version {found}, this library reads version {expected}: {}",
        if found < expected { "rig the mesh anew" } else { "it was made by a newer one" }
    )]
    Version {
        /// The rig file.
        name: String,
        /// The version of the file.
        found: u32,
        /// The version this library reads and writes.
        expected: u32,
    },
    /// The rig was built for another mesh.
    #[error("{name}: the mesh has hash {found}, the rig was built for {expected}")]
    MeshHash {
        /// The mesh.
        name: String,
        /// The hash the rig carries.
        expected: MeshHash,
        /// The hash of the mesh.
        found: MeshHash,
    },
    /// The rig skins another number of vertices than the mesh has.
    #[error("{name}: the mesh has {found} vertices, the rig skins {expected}")]
    VertexCount {
        /// The mesh.
        name: String,
        /// The number of vertices the rig skins.
        expected: usize,
        /// The number of vertices of the mesh.
        found: usize,
    },
}
