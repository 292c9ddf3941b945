//! Shape matching: every particle with its neighbours keeps its shape.

use bevy::prelude::*;

use polpo_solver::{Stiffness, Turning};

use crate::particles::{Awake, for_each_body};
use crate::prototypes::Prototypes;
use crate::stiffness::shares_of;
use crate::{Blocks, ExplicitState, Frozen, ParticleStiffness, Particles, Rods, SoftBody, SubstepTime, rods};

/// Each particle and its one ring hold their shape. Comes with every [`SoftBody`].
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub struct ShapeMatching {
    /// As the spring on which one group alone would swing; default 25 Hz, undamped. Groups overlap, so a body is stiffer than one group, and a long limb, many groups in a row, is softer.
    /// [`ParticleStiffness`](crate::ParticleStiffness) overrides it particle by particle.
    pub stiffness: Stiffness,
    /// Which members of a group take its rotation; default all.
    pub turning: Turning,
}

impl ShapeMatching {
    /// Groups of the stiffness given; all members turn.
    pub const fn new(stiffness: Stiffness) -> Self {
        Self { stiffness, turning: Turning::AllMembers }
    }
}

impl Default for ShapeMatching {
    fn default() -> Self {
        Self::new(Stiffness::hertz(25.0))
    }
}

/// The one-ring groups of a body, sorted by colour. There while [`ShapeMatching`] is.
#[derive(Component, Debug, Clone, Default, Deref, DerefMut)]
pub struct ImplicitGroups(pub polpo_solver::ImplicitGroups);

/// In phase `Prepare`: bodies with [`ShapeMatching`] get their groups, bodies without lose them.
pub(crate) fn build_groups(
    mut commands: Commands,
    mut prototypes: ResMut<Prototypes>,
    lacking: Query<
        (Entity, &SoftBody, &Particles, Option<&ExplicitState>, Option<&Rods>),
        (With<ShapeMatching>, Without<ImplicitGroups>, Without<Frozen>),
    >,
    idle: Query<Entity, (With<ImplicitGroups>, Without<ShapeMatching>)>,
) {
    let none = polpo_solver::ExplicitGroups::default();
    for (entity, body, particles, explicit, rods) in &lacking {
        let groups = if explicit.is_none() && rods.is_none() {
            prototypes.groups(&body.rig, particles)
        } else {
            let (pairs, _) = rods::edges_beside(&body.rig, rods);
            let explicit = explicit.map_or(&none, |e| &e.0);
            polpo_solver::Edges::new(particles, &pairs).map(|edges| polpo_solver::ImplicitGroups::beside(particles, &edges, explicit))
        };
        match groups {
            Ok(groups) => {
                commands.entity(entity).try_insert(ImplicitGroups(groups));
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

/// At the start of phase `Substeps`: the search for the groups' rotations starts from the particles, so that a step depends on nothing else.
pub(crate) fn forget_rotations(mut bodies: Query<(&Particles, &mut ImplicitGroups), (Awake, Without<Blocks>)>) {
    for (particles, mut groups) in &mut bodies {
        groups.forget_rotations(particles);
    }
}

pub(crate) fn match_shapes(
    time: Res<SubstepTime>,
    mut bodies: Query<(&mut Particles, &mut ImplicitGroups, &ShapeMatching, Option<&mut ParticleStiffness>), (Awake, Without<Blocks>)>,
) {
    let sweep = time.sweep();
    for_each_body(
        &mut bodies,
        |(_, groups, ..)| 30 * groups.member_count(),
        |(mut particles, mut groups, matching, mut each)| {
            let shares = shares_of(each.as_mut().map(|e| e.bypass_change_detection()).map(|e| &mut e.0), matching.stiffness, sweep.dt);
            polpo_solver::match_shapes(&mut groups, &mut particles, shares, matching.turning, sweep);
        },
    );
}
