//! Rods: edges that are as stiff as their material and section, or the body's cells, say.

use std::sync::Arc;

use bevy::math::{Mat3A, Vec3A};
use bevy::prelude::*;
use polpo_rig::{Fidelity, Rig};
use polpo_solver::{CalibrationError, DirectEdges, Facet, Limb, Material, Rings, Section};

use crate::capability::{CapabilityError, reject};
use crate::particles::{Awake, for_each_body};
use crate::{Edges, ImplicitGroups, Particles, SoftBody, SolverSettings, SubstepTime};

/// Edges of the body are as stiff as a real material: they carry stretch, shear, bend and twist, and their particles take their masses from them. For ropes, tails, tentacles, bones, frames with a
/// [`section`](RodShape::Section), for bodies of any shape with [`cells`](RodShape::Cells).
///
/// An edge belongs to the rods or to [`ShapeMatching`](crate::ShapeMatching), [`DistanceConstraints`](crate::DistanceConstraints) and [`Torsion`](crate::Torsion), never to both. Where rods meet the rest
/// of a body, the particle between them is in both: it turns with the rods, and its groups hold on to it. Whatever is solved last in a substep, the rods, has the last word there.
///
/// They follow a [`RestPose`](crate::RestPose) and [`Inflation`](crate::Inflation), with the stiffness that they were made with.
///
/// A body whose rig carries cells ([`Rig::cells`], from a recipe with a material) gets the rods of these, [`Rods::of_rig`], when it is built, unless it has rods of its own; taken off, they stay off until the body is built anew.
///
/// Solved once a substep. Numbers out of range, an edge that does not exist or has no length, a facet that is none, or what [`RodSolve::Direct`] does not take are refused with
/// [`CapabilityRejected`](crate::CapabilityRejected). Without rods the particles have the masses back that they had before.
#[derive(Component, Debug, Clone, PartialEq)]
pub struct Rods {
    /// What they are made of.
    pub material: Material,
    /// What shape they have.
    pub shape: RodShape,
    /// How they are solved; default [`RodSolve::Direct`] for a section, and a sweep for cells.
    pub solve: RodSolve,
    /// Retardation time τ of the material \[s\]: a mode of frequency f is damped with the ratio π·f·τ. Range 0 (none, the default) to infinity, negative and NaN are refused; swept, it asks for more substeps.
    pub retardation: f32,
}

impl Rods {
    /// All edges of the body, of one section, solved directly, without damping.
    pub const fn new(material: Material, section: Section) -> Self {
        Self { material, shape: RodShape::Section { section, edges: None }, solve: RodSolve::Direct, retardation: 0.0 }
    }

    /// A body in `cells`, swept with its own spin, without damping.
    pub const fn of_cells(material: Material, cells: Cells) -> Self {
        Self { material, shape: RodShape::Cells(cells), solve: RodSolve::Sweep { spin_radius: 0.0 }, retardation: 0.0 }
    }

    /// The rods of a rig's cells, for a body `scale` times as large; `None` for a rig without. Its density is that of the rig's particles on the average, and each cell has its own where they differ. A limb has a spin radius of 0.12 of its length; take `limb` out of the
    /// [`Cells`] for a body that is to stretch as its material does, and takes substeps for it.
    pub fn of_rig(rig: &Rig, scale: f32) -> Option<Self> {
        let cells = rig.cells.as_ref()?;
        let (mut mass, mut filled) = (0.0, 0.0);
        for (particle, &volume) in rig.particles.iter().zip(&cells.volumes).filter(|(_, volume)| **volume > 0.0) {
            mass += f64::from(particle.mass);
            filled += f64::from(volume);
        }
        let (area, volume) = (scale * scale, scale * scale * scale);
        let facet = |f: &polpo_rig::Facet| {
            let [xx, yy, zz, xy, xz, yz] = f.moments.map(|m| m * area * area);
            Facet {
                pair: f.pair,
                area: Vec3A::from(f.area) * area,
                centroid: Vec3A::from(f.centroid) * scale,
                moments: Mat3A::from_cols(Vec3A::new(xx, xy, xz), Vec3A::new(xy, yy, yz), Vec3A::new(xz, yz, zz)),
            }
        };
        let limb = |l: polpo_rig::Limb| {
            let (bending, torsion) = (l.bending * area * area, l.torsion * area * area);
            Limb { axis: l.axis.into(), section: Section { area: l.area * area, bending, torsion, shear: 5.0 / 6.0 } }
        };
        let made_of = cells.material;
        let density = (mass / filled) as f32;
        let own = |(particle, &volume): (&polpo_rig::Particle, &f32)| if volume > 0.0 { particle.mass / volume } else { density };
        let densities: Vec<f32> = rig.particles.iter().zip(&cells.volumes).map(own).collect();
        let even = densities.iter().all(|d| (d / density - 1.0).abs() < 1e-4);
        Some(Self {
            material: Material { youngs_modulus: made_of.youngs_modulus, poissons_ratio: made_of.poissons_ratio, density },
            shape: RodShape::Cells(Cells {
                volumes: cells.volumes.iter().map(|v| v * volume).collect(),
                densities: if even { Vec::new() } else { densities },
                facets: cells.facets.iter().map(facet).collect(),
                limb: cells.limb.map(limb),
                without_rings: made_of.fidelity == Fidelity::Edges,
            }),
            solve: RodSolve::Sweep { spin_radius: cells.limb.map_or(0.0, |l| 0.12 * l.length * scale) },
            retardation: made_of.retardation,
        })
    }
}

/// What the body's [`Rods`] were made of when they came with its rig; they go with it as long as nobody has changed them since.
#[derive(Component, Debug)]
pub(crate) struct RodsOfRig {
    pub(crate) rig: Arc<Rig>,
    pub(crate) scale: f32,
}

impl RodsOfRig {
    /// Whether these are still the rods that came with the rig. Told by their values: a change in the tick in which they came is one, too.
    pub(crate) fn are(&self, rods: &Rods) -> bool {
        Rods::of_rig(&self.rig, self.scale).as_ref() == Some(rods)
    }
}

/// What [`Rods`] are the edges of.
#[derive(Debug, Clone, PartialEq)]
pub enum RodShape {
    /// Bars along edges of the rig. A particle that edges beside them have too keeps its mass and gets the rods' on top.
    Section {
        /// The cross-section, the same everywhere.
        section: Section,
        /// Which of the rig's edges are rods, by index; `None`: all of them.
        edges: Option<Vec<u32>>,
    },
    /// The body's volume, where the rig's particles divide it between them.
    Cells(Cells),
}

/// A body in cells, one a particle, and where they touch: what a rigger makes of a volume and the particles in it, by voxels that belong to the particle they are nearest to, say.
///
/// The facets are the edges, whatever edges the rig has: of these, the ones between two particles that have facets are nobody's. Each particle with a volume has the mass of its cell. All is in the axes of
/// `Particles::rest_position`: the rig's, scaled as the body is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cells {
    /// The volume of each particle's cell \[m³\]; 0 for a particle without one, and for walls, which have facets and are to be pinned in place and rotation.
    pub volumes: Vec<f32>,
    /// The density of each cell \[kg/m³\], one a particle, where they are not all that of the material; empty if they are. Of a particle without a cell it does not count.
    pub densities: Vec<f32>,
    /// Where cells touch, each pair once. Small facets count too: left out, they cost stiffness.
    pub facets: Vec<Facet>,
    /// If the body is one slender limb, its direction and section: it needs two fifths of the substeps then, and is too soft against stretch only; with a spin radius of about 0.12 of its length.
    pub limb: Option<Limb>,
    /// Whether to do without the rings that give Poisson's ratio: cheaper by these, thick bodies are up to a sixth too soft or stiff, and [`RodSolve::Direct`] can solve it.
    pub without_rings: bool,
}

/// How [`Rods`] are solved.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum RodSolve {
    /// All together: as stiff as the material says at every time step, with one substep. About ten times the work of a sweep, proportional to the number of edges on chains and trees; edges that close loops cost
    /// more, and a body full of them is refused; so are cells with rings, of a material with a Poisson's ratio other than 0, which are swept.
    #[default]
    Direct,
    /// One after the other: cheap, and as stiff as the material says if there are enough substeps, see [`CalibratedEdges::fidelity`].
    Sweep {
        /// The least radius of gyration of a particle's spin \[m\], 0 or more. About 0.12 of a limb's length makes stiff rods cheap and slows their higher modes.
        spin_radius: f32,
    },
}

/// The calibrated edges of a body. There while [`Rods`] is.
#[derive(Component, Debug, Clone, Default, Deref)]
pub struct CalibratedEdges {
    #[deref]
    edges: polpo_solver::CalibratedEdges,
    rings: Rings,
    direct: Option<Box<DirectEdges>>,
    /// Mass and spin inertia that the particles had, and get back.
    before: Vec<[f32; 2]>,
    /// Whether they are as they were made, and a rest pose is still to come.
    unposed: bool,
    /// The longest substep that will do; infinite where any will \[s\].
    longest: f32,
    needed: u32,
    taken: u32,
    warned: bool,
}

/// Whether rods are as stiff as their material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RodFidelity {
    /// Within about 5 % in sag and frequency.
    True,
    /// Too soft: there are fewer substeps than needed, but at least half.
    Soft,
    /// Stable, and without any meaning: there are fewer than half.
    Meaningless,
}

impl CalibratedEdges {
    /// Whether the step before or, during a step, this one had substeps enough. Without edges, or before the first step, it had.
    pub fn fidelity(&self) -> RodFidelity {
        if self.taken >= self.needed {
            RodFidelity::True
        } else if self.taken.saturating_mul(2) >= self.needed {
            RodFidelity::Soft
        } else {
            RodFidelity::Meaningless
        }
    }

    /// How many substeps it would have taken; 1 if they are solved directly.
    pub fn substeps_needed(&self) -> u32 {
        self.needed
    }

    /// Whether they are new and have no rest pose yet.
    pub(crate) fn is_unposed(&self) -> bool {
        self.unposed
    }

    /// Makes `pose` the shape in which they have no strain.
    pub(crate) fn pose(&mut self, particles: &polpo_solver::Particles, pose: &polpo_solver::RestPose) {
        self.unposed = false;
        self.edges.pose(particles, pose);
        self.rings.pose(particles, pose);
    }
}

/// The pairs of the rig's edges that are no rods, and which of them each is.
pub(crate) fn edges_beside(rig: &Rig, rods: Option<&Rods>) -> (Vec<[u32; 2]>, Vec<u32>) {
    let mut is_rod = vec![false; rig.edges.len()];
    match rods.map(|rods| &rods.shape) {
        None => {}
        Some(RodShape::Section { edges: None, .. }) => is_rod.fill(true),
        Some(RodShape::Section { edges: Some(list), .. }) => {
            for &e in list {
                if let Some(is_rod) = is_rod.get_mut(e as usize) {
                    *is_rod = true;
                }
            }
        }
        Some(RodShape::Cells(cells)) => {
            let mut touches = vec![false; rig.particles.len()];
            for &i in cells.facets.iter().flat_map(|f| &f.pair) {
                if let Some(touches) = touches.get_mut(i as usize) {
                    *touches = true;
                }
            }
            for (is_rod, pair) in is_rod.iter_mut().zip(&rig.edges) {
                *is_rod = pair.iter().all(|&i| touches[i as usize]);
            }
        }
    }
    (0u32..).zip(&rig.edges).filter(|(e, _)| !is_rod[*e as usize]).map(|(e, pair)| (*pair, e)).unzip()
}

/// In phase `Prepare`: bodies with new or changed [`Rods`] get their edges, bodies without lose them. What else is made from the rig's edges is made anew.
pub(crate) fn build_rods(
    mut commands: Commands,
    mut wanting: Query<(Entity, &SoftBody, &mut Particles, Ref<Rods>, Option<&CalibratedEdges>)>,
    mut idle: Query<(Entity, &mut Particles, &CalibratedEdges), Without<Rods>>,
) {
    for (entity, body, mut particles, rods, old) in &mut wanting {
        if old.is_some() && !rods.is_changed() {
            continue;
        }
        // What rods make of the masses is no news for a body that sleeps; rods that come, go or change are.
        let particles = particles.bypass_change_detection();
        if let Some(old) = old {
            give_back(particles, &old.before);
        }
        commands.entity(entity).remove::<(Edges, ImplicitGroups)>();
        match calibrate(&body.rig, particles, &rods) {
            Ok(edges) => {
                commands.entity(entity).try_insert(edges);
            }
            Err(error) => {
                commands.entity(entity).remove::<CalibratedEdges>();
                reject::<Rods>(&mut commands, entity, "Rods", error);
            }
        }
    }
    for (entity, mut particles, edges) in &mut idle {
        give_back(&mut particles, &edges.before);
        commands.entity(entity).remove::<(CalibratedEdges, Edges, ImplicitGroups)>();
    }
}

fn calibrate(rig: &Rig, particles: &mut Particles, rods: &Rods) -> Result<CalibratedEdges, CapabilityError> {
    let before: Vec<[f32; 2]> = particles.mass.iter().zip(&particles.inertia).map(|(m, i)| [*m, *i]).collect();
    make(rig, particles, rods, before.clone()).inspect_err(|_| give_back(particles, &before))
}

fn make(rig: &Rig, particles: &mut Particles, rods: &Rods, before: Vec<[f32; 2]>) -> Result<CalibratedEdges, CapabilityError> {
    let spin_radius = match rods.solve {
        RodSolve::Direct => None,
        RodSolve::Sweep { spin_radius } => Some(spin_radius),
    };
    let (mut edges, rings) = match &rods.shape {
        RodShape::Section { section, edges } => (bars(rig, particles, rods, *section, edges.as_deref(), spin_radius)?, Rings::default()),
        RodShape::Cells(cells) => {
            let Cells { volumes, facets, limb, without_rings, .. } = cells;
            let radius = spin_radius.unwrap_or(0.0);
            let (mut edges, mut rings) = if *without_rings {
                let edges = polpo_solver::CalibratedEdges::from_facets_alone(particles, facets, volumes, &rods.material, radius)?;
                (edges, Rings::default())
            } else {
                polpo_solver::CalibratedEdges::from_facets(particles, facets, volumes, &rods.material, radius)?
            };
            weigh(particles, cells, rods.material.density)?;
            if let Some(limb) = limb {
                edges.cap_stretch(&mut rings, &walls_pinned(particles, volumes), &rods.material, limb)?;
            }
            (edges, rings)
        }
    };
    let retardation = rods.retardation;
    if retardation.is_nan() || retardation < 0.0 {
        return Err(CalibrationError::Range { what: "the retardation time", value: retardation, range: "not 0 or more" }.into());
    }
    edges.retardation = retardation;
    let (direct, longest) = match (rods.solve, &rods.shape) {
        (RodSolve::Direct, _) if !rings.middle.is_empty() => return Err(CalibrationError::DirectRings.into()),
        (RodSolve::Direct, _) => (Some(Box::new(DirectEdges::new(&edges, particles.len())?)), f32::INFINITY),
        (_, RodShape::Cells(cells)) => (None, edges.longest_substep(&walls_pinned(particles, &cells.volumes))),
        _ => (None, edges.longest_substep(particles)),
    };
    Ok(CalibratedEdges { edges, rings, direct, before, unposed: true, longest, needed: 1, taken: 1, warned: false })
}

fn bars(
    rig: &Rig,
    particles: &mut Particles,
    rods: &Rods,
    section: Section,
    list: Option<&[u32]>,
    spin_radius: Option<f32>,
) -> Result<polpo_solver::CalibratedEdges, CapabilityError> {
    let pairs = match list {
        None => rig.edges.clone(),
        Some(list) => {
            let pair = |&e: &u32| rig.edges.get(e as usize).copied().ok_or(CalibrationError::NoEdge { edge: e, count: rig.edges.len() });
            list.iter().map(pair).collect::<Result<_, _>>()?
        }
    };
    let (beside, _) = edges_beside(rig, Some(rods));
    let mut seam = vec![false; particles.len()];
    for &i in beside.iter().flatten() {
        if let Some(seam) = seam.get_mut(i as usize) {
            *seam = true;
        }
    }
    let edges = polpo_solver::Edges::new(particles, &pairs)?;
    Ok(polpo_solver::CalibratedEdges::rods(particles, &edges, &rods.material, &section, spin_radius, &seam)?)
}

/// Gives cells their own densities instead of that of the material.
fn weigh(particles: &mut Particles, cells: &Cells, density: f32) -> Result<(), CalibrationError> {
    let Cells { volumes, densities, .. } = cells;
    if densities.is_empty() {
        return Ok(());
    }
    if densities.len() != volumes.len() {
        return Err(CalibrationError::Range {
            what: "the number of densities",
            value: densities.len() as f32,
            range: "not one a particle",
        });
    }
    for (i, (&own, &volume)) in densities.iter().zip(volumes).enumerate().filter(|(_, (_, volume))| **volume > 0.0) {
        if !(own > 0.0 && own.is_normal()) {
            return Err(CalibrationError::Range { what: "the density of a cell", value: own, range: "not positive and normal" });
        }
        let inertia = particles.inertia[i] * (own / density);
        particles.set_mass(i, own * volume);
        particles.set_inertia(i, inertia);
    }
    Ok(())
}

/// The particles with those pinned that have no cell, as they are to be, and no others: whether a substep will do should not depend on who is held just now.
fn walls_pinned(particles: &Particles, volumes: &[f32]) -> polpo_solver::Particles {
    let mut particles = particles.0.clone();
    for (i, volume) in volumes.iter().enumerate() {
        particles.pin(i, *volume == 0.0, *volume == 0.0);
    }
    particles
}

fn give_back(particles: &mut Particles, before: &[[f32; 2]]) {
    for (i, &[mass, inertia]) in before.iter().enumerate().take(particles.len()) {
        particles.set_mass(i, mass);
        particles.set_inertia(i, inertia);
    }
}

/// In phase `Prepare`: tells whether there are substeps enough, in [`CalibratedEdges`] and, once a body, in the log.
pub(crate) fn check_substeps(time: Res<Time>, settings: Res<SolverSettings>, mut bodies: Query<(Entity, &mut CalibratedEdges), Awake>) {
    let step = time.delta_secs();
    for (entity, mut edges) in &mut bodies {
        // Saturates.
        let needed = (step / edges.longest).ceil().max(1.0) as u32;
        let taken = settings.in_range().substeps;
        if edges.needed != needed || edges.taken != taken {
            (edges.needed, edges.taken) = (needed, taken);
        }
        if !edges.warned && edges.fidelity() == RodFidelity::Meaningless {
            edges.warned = true;
            tracing::warn!("the rods of body {entity} need {needed} substeps a step to be as stiff as their material, and have {taken}");
        }
    }
}

/// In phase `SolveConstraints`, in the first iteration only: more would stiffen.
pub(crate) fn solve_rods(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &mut CalibratedEdges), Awake>) {
    if time.iteration > 0 {
        return;
    }
    for_each_body(
        &mut bodies,
        |(_, edges)| if edges.direct.is_some() { 1000 } else { 60 } * edges.pairs.len() + 10 * edges.rings.around.len(),
        |(mut particles, mut edges)| {
            let CalibratedEdges { edges, rings, direct, .. } = &mut *edges;
            match direct {
                Some(direct) => {
                    direct.solve(edges, &mut particles, time.delta);
                }
                None => {
                    polpo_solver::solve_calibrated_edges(edges, &mut particles, time.sweep());
                    polpo_solver::solve_rings(rings, &mut particles, time.delta);
                }
            }
        },
    );
}
