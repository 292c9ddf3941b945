//! Pictures of meshes, rigs and bodies, drawn without a window and without a graphics card.
//!
//! `mesh` and `rig` make a `model` of triangles and ellipsoids; a `camera` sees it on a `canvas`; `shade` gives it light; `picture` sets panels side by side.

pub(crate) mod camera;
pub(crate) mod canvas;
pub(crate) mod mesh;
pub(crate) mod model;
pub(crate) mod picture;
pub(crate) mod pose;
pub(crate) mod rig;
pub(crate) mod shade;
