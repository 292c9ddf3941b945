//! From a triangle mesh to a soft-body rig: particles, ellipsoids, edges, skin weights; and the files.
//!
//! A [`Rig`] is what the solver simulates and what the skin hangs on: a few hundred oriented, ellipsoidal particles, the edges
//! between them and, for every vertex of the mesh, the particles it follows. [`build_rig`] makes one from any triangle mesh; the
//! modules below are its stages, in order:
//!
//! ```text
//! read → clean → grid → voxels → thickness → domain → sample → edges → ellipsoids → shell → skin → files
//! ```
//!
//! A recipe with a material has four more, `fill` and `partition` after `sample`, `facets` and `limb` after `edges`: how full voxels are, Voronoi cells, where these touch, and whether the body is one slender limb. They make
//! [`Rig::cells`].
//!
//! Lengths are in the mesh's own unit, which the rest of the house takes to be metres. The same mesh and settings give the same
//! bytes on every run and every platform: no hash maps, no threads, no platform transcendentals.

mod budget;
mod build;
mod cells;
mod clean;
mod cliffs;
mod coverage;
mod domain;
mod edges;
mod edit;
mod ellipsoids;
mod embed;
mod error;
mod facets;
mod files;
mod fill;
mod flood;
mod gltf_accessors;
mod gltf_buffers;
mod gltf_document;
mod grid;
mod limb;
mod marks;
mod mesh;
mod paint;
mod partition;
mod parts;
mod polygons;
mod read;
mod read_gltf;
mod read_obj;
mod read_ply;
mod read_stl;
mod recipe;
mod region;
mod rig;
mod sample;
mod shell;
mod skin;
mod thickness;
mod tree;
mod voxels;

pub use build::{Built, Note, Stage, build_rig, build_rig_with};
pub use cells::{Cells, Facet, Limb};
pub use coverage::{Coverage, coverage};
pub use edit::Edit;
pub use embed::embed_rig;
pub use error::{MeshError, RigError, RigFault};
pub use mesh::{Mesh, MeshHash};
pub use parts::MeshPart;
pub use read::{parse_glb, parse_mesh, read_mesh};
pub use recipe::{Amount, EdgeAmount, Fidelity, MOST_INFLUENCES, Placement, Recipe, RecipeMaterial};
pub use region::{GroupKind, Region, RegionRule, Spring, Within};
pub use rig::{Influences, Particle, Rig};
