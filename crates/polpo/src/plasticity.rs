//! Plasticity: shapes that keep part of what was done to them.

use bevy::prelude::*;

use crate::particles::{Awake, for_each_body};
use crate::{Edges, ImplicitGroups, Particles, Posed, SubstepTime};

/// Dents and bends stay: the rest shapes of [`ShapeMatching`](crate::ShapeMatching) and the rest lengths of [`DistanceConstraints`](crate::DistanceConstraints) give way. Without the component nothing flows
/// any more, and what has flowed stays. For clay, lead, car bodies.
///
/// Bodies with explicit groups keep the dents of those by their own number, and what holds them while they are open flows.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct Plasticity {
    /// Strain above which the shape gives way. Range 0 to infinity; default 0.1. NaN counts as infinite.
    pub yield_strain: f32,
    /// Rate at which the rest shape then approaches what is there \[1/s\]. Range 0 (never) to infinity (at once); default 10. Negative and NaN count as 0.
    pub creep: f32,
    /// Strain of the rest shape against the rig's, or against the rest pose, at most. Range 0 to infinity; default 0.3. From about 0.5 on neighbouring groups may contradict each other. Negative and NaN
    /// count as 0.
    pub maximum: f32,
}

impl Default for Plasticity {
    fn default() -> Self {
        Self { yield_strain: 0.1, creep: 10.0, maximum: 0.3 }
    }
}

/// In phase `Integrate`, when the particles are where the substep leaves them.
pub(crate) fn creep(
    time: Res<SubstepTime>,
    mut bodies: Query<(&Particles, &Plasticity, Option<&mut ImplicitGroups>, Option<&mut Edges>, Option<&Posed>), Awake>,
) {
    for_each_body(
        &mut bodies,
        |(_, _, groups, ..)| groups.map_or(0, |g| 20 * g.member_count()),
        |(particles, &Plasticity { yield_strain, creep, maximum }, groups, edges, posed)| {
            let plasticity = polpo_solver::Plasticity { yield_strain, creep, maximum };
            let made = polpo_solver::RestPose::default();
            let pose = posed.map_or(&made, |posed| &posed.pose);
            if let Some(mut groups) = groups {
                polpo_solver::creep_shapes(&mut groups, particles, pose, plasticity, time.delta);
            }
            if let Some(mut edges) = edges {
                polpo_solver::creep_edges(&mut edges, particles, pose, plasticity, time.delta);
            }
        },
    );
}
