//! The octopus of the demos, made from formulas: an implicit shape, meshed, evened out and painted.
//!
//! ```text
//! arms → shape → surface → eyes, suckers → remesh → paint
//! ```
//!
//! It looks along +z, its mantle leans back, Y is up; metres, centred about the origin.

mod arms;
mod eyes;
mod paint;
mod remesh;
mod shape;
mod suckers;
mod surface;

use glam::DVec3;
use thiserror::Error;

use crate::glb::ColoredMesh;

#[derive(Debug, Error, PartialEq)]
pub(crate) enum OctopusError {
    /// Two places of the arms are nearer than they may be.
    #[error("arm {arm} at {at:.2} of its length comes within {gap:.4} m of arm {other} at {other_at:.2}")]
    ArmsTouch { arm: usize, at: f64, other: usize, other_at: f64, gap: f64 },
    /// The mesh is not one closed surface without handles.
    #[error("the mesh has Euler characteristic {euler}, {open} open or overfull sides and {parts} parts")]
    NotASphere { euler: i64, open: usize, parts: usize },
}

/// Makes the octopus.
pub(crate) fn make() -> Result<ColoredMesh, OctopusError> {
    let arms = arms::grow();
    arms::check_gaps(&arms)?;
    let shape = shape::Shape::new(arms);
    let mut mesh = remesh::Remesh::new(surface::mesh(&shape));
    eyes::place(&shape, &mut mesh);
    let suckers = suckers::place(&shape, &mut mesh);
    mesh.even_out(&shape);
    let (mut positions, triangles) = mesh.finish();
    surface::check_sphere(&positions, &triangles)?;

    let colors = paint::paint(&shape, &positions, &suckers);
    let normals = suckers::raise(&shape, &mut positions, &triangles, &suckers);
    let low = positions.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
    let high = positions.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
    let middle = (low + high) * 0.5;
    positions.iter_mut().for_each(|p| *p -= middle);
    Ok(ColoredMesh { name: "octopus", positions, normals, colors, triangles })
}
