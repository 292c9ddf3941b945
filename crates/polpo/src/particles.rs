//! A body's packed state: particles and edges as components.

use bevy::math::Vec3A;
use bevy::prelude::*;

use crate::prototypes::Prototypes;
use crate::{DistanceConstraints, ExplicitState, Frozen, Rods, Sleeping, SoftBody, Torsion, rods};

/// All particles of a body, as a structure of arrays. Made from the rig when a [`SoftBody`] is inserted.
///
/// Positions are relative to the entity's `Transform::translation`, in axes parallel to the world's.
#[derive(Component, Debug, Clone, Default, Deref, DerefMut)]
pub struct Particles(pub polpo_solver::Particles);

/// All edges of a body, sorted by colour. There while a component that needs edges is.
#[derive(Component, Debug, Clone, Default, Deref, DerefMut)]
pub struct Edges(pub polpo_solver::Edges);

/// Where the particles were when the running step began: what rendering interpolates from, and the last good state of a body that breaks.
#[derive(Component, Debug, Clone, Default)]
pub struct StepStart {
    /// Centres \[m\], relative to the body's *present* origin.
    pub position: Vec<Vec3A>,
    /// Rotations since rest.
    pub rotation: Vec<Quat>,
    /// The body's present origin in the world \[m\], as it was last seen.
    pub origin: Vec3,
}

/// A query's filter for the bodies that take part in the step: neither [`Frozen`] nor [`Sleeping`].
pub type Awake = (Without<Frozen>, Without<Sleeping>);

/// Copies positions and rotations, into arrays that are already there.
pub(crate) fn remember_step_start(mut bodies: Query<(&Particles, &Transform, &mut StepStart), Awake>) {
    for (particles, transform, mut start) in &mut bodies {
        start.origin = transform.translation;
        start.position.clone_from(&particles.position);
        start.rotation.clone_from(&particles.rotation);
    }
}

/// Bodies whose components need edges get them; bodies that no longer need them lose them.
pub(crate) fn build_edges(
    mut commands: Commands,
    mut prototypes: ResMut<Prototypes>,
    lacking: Query<
        (Entity, &SoftBody, &Particles, Option<&ExplicitState>, Option<&Rods>),
        (Or<(With<DistanceConstraints>, With<Torsion>)>, Without<Edges>, Without<Frozen>),
    >,
    idle: Query<Entity, (With<Edges>, Without<DistanceConstraints>, Without<Torsion>)>,
) {
    for (entity, body, particles, explicit, rods) in &lacking {
        let edges = if explicit.is_none() && rods.is_none() {
            prototypes.edges(&body.rig, particles)
        } else {
            let (pairs, input) = rods::edges_beside(&body.rig, rods);
            polpo_solver::Edges::new(particles, &pairs).map(|mut edges| {
                edges.input.iter_mut().for_each(|e| *e = input[*e as usize]);
                if let Some(explicit) = explicit {
                    edges.rest_where_held(explicit);
                }
                edges
            })
        };
        match edges {
            Ok(edges) => {
                commands.entity(entity).try_insert(Edges(edges));
            }
            // The rig was validated when the body was built, so this is not reached; if it were, the body does without.
            Err(error) => {
                tracing::error!("body {entity}: {error}");
                commands.entity(entity).remove::<(DistanceConstraints, Torsion)>();
            }
        }
    }
    for entity in &idle {
        commands.entity(entity).remove::<Edges>();
    }
}

/// Runs `work` on every item of the query, in parallel over bodies if all of it together is worth the price of starting threads.
///
/// `cost` is a rough guess of the work for a body \[ns\]. Bodies are independent, so the result does not depend on the number of threads.
pub(crate) fn for_each_body<'w, D, F>(
    query: &mut Query<'w, '_, D, F>,
    cost: impl Fn(&<D::ReadOnly as bevy::ecs::query::QueryData>::Item<'_, '_>) -> usize,
    work: impl Fn(D::Item<'_, '_>) + Send + Sync + Clone,
) where
    D: bevy::ecs::query::IterQueryData,
    D::ReadOnly: bevy::ecs::query::IterQueryData,
    F: bevy::ecs::query::QueryFilter,
{
    /// What a parallel query must save before it gains anything \[ns\].
    const WORTHWHILE: usize = 200_000;
    let mut bodies = 0;
    let total: usize = query
        .iter()
        .map(|item| {
            bodies += 1;
            cost(&item)
        })
        .sum();
    if bodies > 1 && total > WORTHWHILE {
        query.par_iter_mut().batching_strategy(bevy::ecs::batching::BatchingStrategy::new().max_batch_size(1)).for_each(work);
    } else {
        query.iter_mut().for_each(work);
    }
}
