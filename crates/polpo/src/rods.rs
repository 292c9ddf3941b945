//! Rods: edges that are as stiff as their material and section say.

use bevy::prelude::*;
use polpo_rig::Rig;
use polpo_solver::{CalibrationError, DirectEdges, Material, Section};

use crate::capability::{CapabilityError, reject};
use crate::particles::{Awake, for_each_body};
use crate::{Edges, ImplicitGroups, Particles, SoftBody, SolverSettings, SubstepTime};

/// Edges of the body are rods of a real material: they carry stretch, shear, bend and twist, and their particles take their masses from them. For ropes, tails, tentacles, bones, frames.
///
/// An edge belongs to the rods or to [`ShapeMatching`](crate::ShapeMatching), [`DistanceConstraints`](crate::DistanceConstraints) and [`Torsion`](crate::Torsion), never to both. Where rods meet the rest
/// of a body, the particle between them is in both: it keeps its mass and gets the rods' on top, turns with the rods, and its groups hold on to it. Whatever is solved last in a substep, the rods, has
/// the last word there.
///
/// Solved once a substep. Numbers out of range, an edge that does not exist or has no length, or more loops than [`RodSolve::Direct`] takes are refused with
/// [`CapabilityRejected`](crate::CapabilityRejected). Without rods the particles have the masses back that they had before.
#[derive(Component, Debug, Clone, PartialEq)]
pub struct Rods {
    /// What they are made of.
    pub material: Material,
    /// Their cross-section, the same everywhere.
    pub section: Section,
    /// Which of the rig's edges are rods, by index; default `None`: all of them.
    pub edges: Option<Vec<u32>>,
    /// How they are solved; default [`RodSolve::Direct`].
    pub solve: RodSolve,
    /// Retardation time τ of the material \[s\]: a mode of frequency f is damped with the ratio π·f·τ. Range 0 (none, the default) to infinity; swept, it asks for more substeps.
    pub retardation: f32,
}

impl Rods {
    /// All edges of the body, solved directly, without damping.
    pub const fn new(material: Material, section: Section) -> Self {
        Self { material, section, edges: None, solve: RodSolve::Direct, retardation: 0.0 }
    }
}

/// How [`Rods`] are solved.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum RodSolve {
    /// All together: as stiff as the material says at every time step, with one substep. About ten times the work of a sweep, proportional to the number of edges on chains and trees; edges that close loops cost
    /// more, and a body full of them is refused.
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
    direct: Option<Box<DirectEdges>>,
    /// Mass and spin inertia that the particles had, and get back.
    before: Vec<[f32; 2]>,
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
}

/// The pairs of the rig's edges that are no rods, and which of them each is.
pub(crate) fn edges_beside(rig: &Rig, rods: Option<&Rods>) -> (Vec<[u32; 2]>, Vec<u32>) {
    let mut is_rod = vec![rods.is_some_and(|rods| rods.edges.is_none()); rig.edges.len()];
    for &e in rods.and_then(|rods| rods.edges.as_ref()).into_iter().flatten() {
        if let Some(is_rod) = is_rod.get_mut(e as usize) {
            *is_rod = true;
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
        if let Some(old) = old {
            give_back(&mut particles, &old.before);
        }
        commands.entity(entity).remove::<(Edges, ImplicitGroups)>();
        match calibrate(&body.rig, &mut particles, &rods) {
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
    let (beside, _) = edges_beside(rig, Some(rods));
    let pairs = match &rods.edges {
        None => rig.edges.clone(),
        Some(list) => {
            let pair = |&e: &u32| rig.edges.get(e as usize).copied().ok_or(CalibrationError::NoEdge { edge: e, count: rig.edges.len() });
            list.iter().map(pair).collect::<Result<_, _>>()?
        }
    };
    let mut seam = vec![false; particles.len()];
    for &i in beside.iter().flatten() {
        if let Some(seam) = seam.get_mut(i as usize) {
            *seam = true;
        }
    }
    let edges = polpo_solver::Edges::new(particles, &pairs)?;
    let before: Vec<[f32; 2]> = particles.mass.iter().zip(&particles.inertia).map(|(m, i)| [*m, *i]).collect();
    let spin_radius = match rods.solve {
        RodSolve::Direct => None,
        RodSolve::Sweep { spin_radius } => Some(spin_radius),
    };
    let mut edges = polpo_solver::CalibratedEdges::rods(particles, &edges, &rods.material, &rods.section, spin_radius, &seam)?;
    edges.retardation = rods.retardation;
    let (direct, longest) = match rods.solve {
        RodSolve::Direct => match DirectEdges::new(&edges, particles.len()) {
            Ok(direct) => (Some(Box::new(direct)), f32::INFINITY),
            Err(error) => {
                give_back(particles, &before);
                return Err(error.into());
            }
        },
        RodSolve::Sweep { .. } => (None, edges.longest_substep(particles)),
    };
    Ok(CalibratedEdges { edges, direct, before, longest, needed: 1, taken: 1, warned: false })
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
        let taken = settings.substeps.max(1);
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
        |(_, edges)| if edges.direct.is_some() { 1000 } else { 60 } * edges.pairs.len(),
        |(mut particles, mut edges)| {
            let CalibratedEdges { edges, direct, .. } = &mut *edges;
            match direct {
                Some(direct) => {
                    direct.solve(edges, &mut particles, time.delta);
                }
                None => polpo_solver::solve_calibrated_edges(edges, &mut particles, time.delta),
            }
        },
    );
}
