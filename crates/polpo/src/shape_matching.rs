//! Shape matching: every particle with its neighbours keeps its shape.

use bevy::prelude::*;

use crate::particles::for_each_body;
use crate::{Frozen, Particles, SoftBody, SubstepTime};

/// Each particle and its one ring hold their shape. Comes with every [`SoftBody`].
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct ShapeMatching {
    /// Stiffness as the frequency at which one group alone would swing \[Hz\]. Range 0 (off) to infinity (rigid); default 25. Groups overlap, so a body is stiffer than one group, and a long limb, many
    /// groups in a row, is softer. Negative and NaN count as 0.
    pub frequency: f32,
}

impl Default for ShapeMatching {
    fn default() -> Self {
        Self { frequency: 25.0 }
    }
}

/// The one-ring groups of a body, sorted by colour. There while [`ShapeMatching`] is.
#[derive(Component, Debug, Clone, Default, Deref, DerefMut)]
pub struct ImplicitGroups(pub polpo_solver::ImplicitGroups);

/// In phase `Prepare`: bodies with [`ShapeMatching`] get their groups, bodies without lose them.
pub(crate) fn build_groups(
    mut commands: Commands,
    lacking: Query<(Entity, &SoftBody, &Particles), (With<ShapeMatching>, Without<ImplicitGroups>)>,
    idle: Query<Entity, (With<ImplicitGroups>, Without<ShapeMatching>)>,
) {
    for (entity, body, particles) in &lacking {
        match polpo_solver::Edges::new(particles, &body.rig.edges) {
            Ok(edges) => {
                commands.entity(entity).insert(ImplicitGroups(polpo_solver::ImplicitGroups::new(particles, &edges)));
            }
            // The rig was validated when the body was built, so this is not reached; if it were, the body does without.
            Err(error) => {
                tracing::error!("body {entity}: {error}");
                commands.entity(entity).remove::<ShapeMatching>();
            }
        }
    }
    for entity in &idle {
        commands.entity(entity).remove::<ImplicitGroups>();
    }
}

pub(crate) fn match_shapes(
    time: Res<SubstepTime>,
    mut bodies: Query<(&mut Particles, &mut ImplicitGroups, &ShapeMatching), Without<Frozen>>,
) {
    for_each_body(
        &mut bodies,
        |(_, groups, _)| 30 * groups.members.len(),
        |(mut particles, mut groups, matching)| {
            let fraction = polpo_solver::stiffness_fraction(matching.frequency, time.delta);
            polpo_solver::match_shapes(&mut groups, &mut particles, fraction, time.delta);
        },
    );
}
