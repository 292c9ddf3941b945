//! Rods: edges that are as stiff as their material and section say.

use bevy::prelude::*;
use polpo_solver::{Material, Section};

use crate::capability::reject;
use crate::particles::{Awake, for_each_body};
use crate::{Particles, SoftBody, SubstepTime};

/// The edges of the body are rods of a real material: they carry stretch, shear, bend and twist, and the particles take their masses from them. For ropes, tails, tentacles, frames.
///
/// It does not need [`ShapeMatching`](crate::ShapeMatching), [`DistanceConstraints`](crate::DistanceConstraints) or [`Torsion`](crate::Torsion), which would add their own stiffness: remove them from a
/// body that is rods alone. Solved once a substep; how many substeps make the stiffness true is in [`CalibratedEdges`]. Numbers out of range, or an edge without length, are refused with
/// [`CapabilityRejected`](crate::CapabilityRejected).
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct Rods {
    /// What they are made of.
    pub material: Material,
    /// Their cross-section, the same everywhere.
    pub section: Section,
    /// The least radius of gyration of a particle's spin \[m\]; 0 for none. About 0.12 of a limb's length makes stiff rods cheap and slows their higher modes.
    pub spin_radius: f32,
}

/// The calibrated edges of a body. There while [`Rods`] is. `recommended_substeps` tells how many substeps a step needs for the material's stiffness to be true.
#[derive(Component, Debug, Clone, Default, Deref, DerefMut)]
pub struct CalibratedEdges(pub polpo_solver::CalibratedEdges);

/// In phase `Prepare`: bodies with new or changed [`Rods`] get their edges, bodies without lose them.
pub(crate) fn build_rods(
    mut commands: Commands,
    mut wanting: Query<(Entity, &SoftBody, &mut Particles, Ref<Rods>, Has<CalibratedEdges>)>,
    idle: Query<Entity, (With<CalibratedEdges>, Without<Rods>)>,
) {
    for (entity, body, mut particles, rods, has) in &mut wanting {
        if has && !rods.is_changed() {
            continue;
        }
        let edges = match polpo_solver::Edges::new(&particles, &body.rig.edges) {
            Ok(edges) => edges,
            Err(error) => {
                reject::<Rods>(&mut commands, entity, "Rods", error);
                continue;
            }
        };
        match polpo_solver::CalibratedEdges::rods(&mut particles, &edges, &rods.material, &rods.section, Some(rods.spin_radius), &[]) {
            Ok(edges) => {
                commands.entity(entity).insert(CalibratedEdges(edges));
            }
            Err(error) => {
                commands.entity(entity).remove::<CalibratedEdges>();
                reject::<Rods>(&mut commands, entity, "Rods", error);
            }
        }
    }
    for entity in &idle {
        commands.entity(entity).remove::<CalibratedEdges>();
    }
}

/// In phase `SolveConstraints`, in the first iteration only: more would stiffen.
pub(crate) fn solve_rods(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &CalibratedEdges), Awake>) {
    if time.iteration > 0 {
        return;
    }
    for_each_body(
        &mut bodies,
        |(_, edges)| 60 * edges.pairs.len(),
        |(mut particles, edges)| polpo_solver::solve_calibrated_edges(edges, &mut particles, time.delta),
    );
}
