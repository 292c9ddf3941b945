//! The stages in a row: a mesh in, a rig out.

use crate::clean::Surface;
use crate::sample::Sample;
use crate::voxels::Voxels;
use crate::{Mesh, Particle, Rig, RigError, edges, ellipsoids, skin};

/// Ten voxels a particle at the finest resolution: with fewer there are no cells to speak of.
const MOST_PARTICLES: usize = 100_000;

/// How fine and how heavy a rig is to be.
#[derive(Debug, Clone, PartialEq)]
pub struct RigSettings {
    /// Particles wanted, 1 to 100 000; default 300. Met exactly, unless the body has more separate parts: each gets one particle.
    ///
    /// Few make a body that bends in few places; the time of a simulation grows with them. Above about 1000 the voxels a particle
    /// gets become fewer than the 600 it should have, and cells become ragged.
    pub particles: usize,
    /// Edges wanted; default 750. Met exactly as long as it is at least the particles less one, which it takes to hold the body
    /// together, and at most the number of pairs.
    ///
    /// Two to three edges a particle are soft, five and more make a thick body stiff in shear.
    pub edges: usize,
    /// Density of the body \[kg/m³\], finite and positive; default 1000, water and most animals.
    ///
    /// The mesh is taken to be in metres. A mesh in centimetres weighs a million times as much: scale it first.
    pub density: f32,
}

impl Default for RigSettings {
    fn default() -> RigSettings {
        RigSettings { particles: 300, edges: 750, density: 1000.0 }
    }
}

/// Builds the rig of a mesh.
///
/// The mesh may be of any size, open, in several parts, or hold degenerate and doubled triangles: parts thinner than a voxel (about a
/// tenth of the particles' spacing) weigh as if they were a voxel thick, parts that overlap are one body, parts that are apart are
/// tied by one edge to the nearest. The same shape at another scale gives the same rig at that scale, up to rounding.
///
/// Takes about a second for 300 particles; about 100 MB at most.
///
/// # Errors
/// [`RigError::Setting`] for a number of particles out of range or a density that is not finite and positive, [`RigError::Mesh`] for a mesh that
/// [`Mesh::validate`] refuses or that has no triangle with an area, [`RigError::TooFewVoxels`] for more particles than the body has
/// room for, [`RigError::Invalid`] if the body is so large or small that f32 can't hold its particles' masses.
pub fn build_rig(mesh: &Mesh, settings: &RigSettings) -> Result<Rig, RigError> {
    let RigSettings { particles, edges, density } = *settings;
    if !(1..=MOST_PARTICLES).contains(&particles) {
        let value = particles as f64;
        return Err(RigError::Setting { setting: "particles", value, range: "1 to 100000" });
    }
    if !(density.is_finite() && density > 0.0) {
        let value = f64::from(density);
        return Err(RigError::Setting { setting: "density", value, range: "finite and positive" });
    }

    let surface = Surface::new(mesh)?;
    let voxels = Voxels::new(&surface, particles);
    if voxels.len() < particles {
        let name = mesh.name.clone();
        return Err(RigError::TooFewVoxels { name, wanted: particles, voxels: voxels.len() });
    }
    let sample = Sample::new(&voxels, particles);
    let edges = edges::connect(&voxels, &sample, edges);
    let ellipsoids = ellipsoids::fit(&surface, &voxels, &sample);
    let skin = skin::weigh(&surface, &voxels, &sample, &ellipsoids);

    // Voxels count the volume to a few percent; the mesh itself knows better, unless it crosses itself.
    let counted = voxels.len() as f64 * voxels.size * voxels.size * voxels.size;
    let volume = surface.volume().filter(|v| (0.8..1.25).contains(&(v / counted))).unwrap_or(counted);
    let scale = surface.scale;
    let voxel_mass = f64::from(density) * scale * scale * scale * volume / voxels.len() as f64;
    let particles = ellipsoids.iter().zip(&sample.volumes).map(|(e, &volume)| Particle {
        position: (surface.origin + e.centre * surface.scale).as_vec3(),
        frame: e.rotation().as_quat(),
        radii: (e.radii * surface.scale).as_vec3(),
        mass: (voxel_mass * f64::from(volume)) as f32,
    });
    let rig = Rig { mesh_hash: mesh.hash(), particles: particles.collect(), edges, skin };
    rig.validate_as(&mesh.name)?;
    Ok(rig)
}
