//! The stages in a row: a mesh in, a rig out.

use crate::cells::Cells;
use crate::clean::Surface;
use crate::domain::Domain;
use crate::edit::Edits;
use crate::fill::Fill;
use crate::marks::Marks;
use crate::recipe::{MOST_PARTICLES, check};
use crate::sample::{Sample, Wanted, touching};
use crate::voxels::Voxels;
use crate::{Amount, EdgeAmount, Mesh, Particle, Placement, Recipe, Rig, RigError, edges, ellipsoids, partition, skin};

/// A rig, and what its builder has to say of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Built {
    /// The rig.
    pub rig: Rig,
    /// What an artist should know; empty if all went as the recipe says.
    pub notes: Vec<Note>,
}

/// What an artist should know of a rig.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Note {
    /// Parts of the body lie apart, and were tied by an edge each.
    #[error("{parts} parts of the body lie apart: {} edges tie them", parts - 1)]
    Tied {
        /// How many there are.
        parts: usize,
    },
    /// A region has no particle, or one of its rules took nothing of the mesh.
    #[error("region {name:?}: a rule of it holds nowhere, or it has no particle")]
    EmptyRegion {
        /// The region.
        name: String,
    },
    /// An edit could not be done.
    #[error("edit {edit}: {what}")]
    EditLeft {
        /// Its index in the recipe.
        edit: usize,
        /// Why.
        what: &'static str,
    },
}

/// A stage of the building, for whoever shows progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The mesh is welded and cleaned.
    Clean,
    /// The body is filled with voxels.
    Voxels,
    /// Particles are spread.
    Sample,
    /// Particles are tied.
    Edges,
    /// Ellipsoids are fitted.
    Ellipsoids,
    /// Vertices get their influences.
    Skin,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Stage; 6] = [Stage::Clean, Stage::Voxels, Stage::Sample, Stage::Edges, Stage::Ellipsoids, Stage::Skin];
}

/// Builds the rig of a mesh.
///
/// The mesh may be of any size, open, in several parts, or hold degenerate and doubled triangles: parts thinner than a voxel (about a
/// tenth of the particles' spacing) weigh as if they were a voxel thick, parts that overlap are one body, parts that are apart are
/// tied by one edge to the nearest. A closed part thinner than that weighs what its own volume does; sheets (cloth, ground) have no
/// inside, whatever their waves. A region is sampled as if it were a part of its own, so it has a particle at least. The same shape at another scale gives the same rig at that scale, up to rounding.
///
/// Takes about two seconds of one core and 50 MB for 300 particles, ten seconds and 1 GB for a million triangles, half a minute and
/// 400 MB for 100,000 particles. With a material, for whose cells there are eleven voxels across each instead of eight to nine, three to four times that.
///
/// # Errors
/// [`RigError::Setting`] for a recipe that [`Recipe::validate`] refuses, for a spacing that takes more than 100,000 particles or a
/// million voxels, and for more than ten million edges, [`RigError::Mesh`] for a mesh that
/// [`Mesh::validate`] refuses or that has no triangle with an area, [`RigError::TooFewVoxels`] for more particles than the body has
/// room for, [`RigError::Invalid`] if the body is so large or small that f32 can't hold its particles' masses.
pub fn build_rig(mesh: &Mesh, recipe: &Recipe) -> Result<Rig, RigError> {
    build_rig_with(mesh, recipe, &mut |_| {}).map(|built| built.rig)
}

/// [`build_rig`], with what the builder has to say of the rig. Calls `progress` before each stage.
///
/// # Errors
/// Those of [`build_rig`].
pub fn build_rig_with(mesh: &Mesh, recipe: &Recipe, progress: &mut dyn FnMut(Stage)) -> Result<Built, RigError> {
    recipe.validate()?;
    progress(Stage::Clean);
    let surface = Surface::new(mesh)?;
    progress(Stage::Voxels);
    let scale = surface.scale;
    let wanted = match recipe.amount {
        Amount::Particles(n) => Wanted::Count(n),
        Amount::Spacing(apart) => Wanted::Spacing(f64::from(apart) / scale),
    };
    let voxels = Voxels::new(&surface, wanted, recipe.placement == Placement::Surface, recipe.material.is_some());
    progress(Stage::Sample);
    let domain = Domain::new(&voxels, recipe.placement);
    match wanted {
        Wanted::Count(wanted) if domain.room() < wanted => {
            let name = mesh.name.clone();
            return Err(RigError::TooFewVoxels { name, wanted, voxels: domain.room() });
        }
        Wanted::Spacing(apart) => {
            let given = apart * scale;
            check("spacing", given, apart >= 2.0 * voxels.size, "wide enough for voxels of half of it, a million in the body")?;
        }
        Wanted::Count(_) => {}
    }
    let cell = match wanted {
        Wanted::Count(n) => voxels.len() / n,
        Wanted::Spacing(apart) => (apart / voxels.size).powi(3) as usize,
    };
    let marks = (!recipe.regions.is_empty()).then(|| Marks::new(mesh, &surface, &voxels, &recipe.regions, cell));
    let divided = marks.as_ref().map(|marks| marks.divide(&voxels));
    let spread_over = divided.as_ref().unwrap_or(&voxels);
    let mut sample = Sample::new(spread_over, &domain, wanted);
    if let (Amount::Spacing(apart), true) = (recipe.amount, sample.positions.len() >= MOST_PARTICLES) {
        check("spacing", apart.into(), false, "wide enough for at most 100000 particles")?;
    }
    let fill = recipe.material.map(|material| (material, Fill::new(&surface, &voxels)));
    if let Some((_, fill)) = &fill {
        partition::settle(spread_over, fill, &mut sample);
    }
    let mut edits = Edits::new(&recipe.edits, &surface);
    edits.place(spread_over, &domain, &mut sample);
    drop(divided);
    // Where links were cut and cells changed hands, others touch now.
    sample.touching = touching(&voxels, &sample.owner, domain.shell);
    let mut notes = Vec::new();
    let parts = voxels.parts();
    if parts > 1 {
        notes.push(Note::Tied { parts });
    }
    progress(Stage::Edges);
    let edges = match recipe.edges {
        EdgeAmount::PerParticle(n) => edges::Wanted::Count((f64::from(n) * sample.positions.len() as f64).round() as usize),
        EdgeAmount::Count(n) => edges::Wanted::Count(n),
        EdgeAmount::Length(length) => edges::Wanted::Length(f64::from(length) / scale),
    };
    let mut edges = edges::connect(&voxels, &sample, edges)?;
    edits.tie(&voxels, &sample, &mut edges);
    progress(Stage::Ellipsoids);
    let ellipsoids = ellipsoids::fit(&surface, &voxels, &sample, domain.shell);
    progress(Stage::Skin);
    let skin = skin::weigh(&surface, &voxels, &sample, recipe.influences);

    // Voxels count the volume to a few percent; the mesh itself knows better, unless it crosses itself.
    let counted = voxels.len() as f64 * voxels.size * voxels.size * voxels.size;
    let volume = surface.volume().filter(|&v| voxels.may_be(v, &surface)).unwrap_or(counted);
    let cells = fill.map(|(material, fill)| Cells::new(material, &surface, &fill, &sample, &edges, &edits, volume));
    let voxel = scale * scale * scale * volume / voxels.len() as f64;
    let volume = |i: usize| cells.as_ref().map_or(voxel * f64::from(sample.volumes[i]), |c| c.volumes[i].into());
    // The mean over a cell's voxels.
    let mut densities = vec![0.0; sample.positions.len()];
    for (voxel, &owner) in (0..).zip(&sample.owner) {
        let density = marks.as_ref().and_then(|marks| marks.density(voxel)).unwrap_or(recipe.density);
        densities[owner as usize] += f64::from(density) / f64::from(sample.volumes[owner as usize]);
    }
    let particles = ellipsoids.iter().zip(densities).enumerate().map(|(i, (e, density))| Particle {
        position: (surface.origin + e.centre * surface.scale).as_vec3(),
        frame: e.rotation().as_quat(),
        radii: (e.radii * surface.scale).as_vec3(),
        mass: (density * volume(i)) as f32,
    });
    let particles = particles.collect();
    let (regions, empty) = marks.map(|marks| marks.regions(&sample)).unwrap_or_default();
    let rig = Rig { mesh_hash: mesh.hash(), particles, edges, skin, regions, cells };
    rig.validate_as(&mesh.name)?;
    notes.extend(empty.into_iter().map(|name| Note::EmptyRegion { name }).chain(edits.notes()));
    Ok(Built { rig, notes })
}
