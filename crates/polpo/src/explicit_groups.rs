//! Explicit groups: rigid or soft pieces of a body, with joints, motors and dents.

use bevy::prelude::*;
use polpo_solver::ExplicitGroup;

use crate::capability::reject;
use crate::particles::{Awake, for_each_body};
use crate::{BodyPairs, Contacts, Edges, Frozen, ImplicitGroups, Particles, SelfPairs, SubstepTime};

/// Pieces of the body that move as a whole: a skull, a wheel, the plates of a car.
///
/// A rigid group, the default, is a true rigid body: its spin does not decay, contacts and whatever pulls at a member act on all of it. Its members have no groups of [`ShapeMatching`](crate::ShapeMatching)
/// of their own, and edges inside it rest. A particle in two groups is a ball joint, two are a hinge. Groups may open on a blow and keep a dent ([`Deformable`](polpo_solver::Deformable)), have a
/// [`Motor`](polpo_solver::Motor), be inflated, or be soft.
///
/// Change the list at any time. While members and which groups can open stay the same, what is open, dented and turning goes on; otherwise groups are made anew, closed and in the rig's shape, and the
/// body's plastic flow is forgotten. Numbers out of range are refused with [`CapabilityRejected`](crate::CapabilityRejected).
#[derive(Component, Debug, Clone, Default, PartialEq)]
pub struct ExplicitGroups {
    /// The groups; particles are counted as in the rig.
    pub list: Vec<ExplicitGroup>,
}

/// What the explicit groups of a body are doing. There while [`ExplicitGroups`] is.
#[derive(Component, Debug, Clone, Default, Deref, DerefMut)]
pub struct ExplicitState(pub polpo_solver::ExplicitGroups);

/// In phase `Prepare`, before the implicit groups are built beside them: bodies with new or changed [`ExplicitGroups`] get their state, bodies without lose it.
pub(crate) fn build_explicit(
    mut commands: Commands,
    mut wanting: Query<(Entity, &Particles, Ref<ExplicitGroups>, Option<&mut ExplicitState>, Has<Frozen>)>,
    idle: Query<Entity, (With<ExplicitState>, Without<ExplicitGroups>)>,
) {
    for (entity, particles, groups, state, frozen) in &mut wanting {
        let anew = match state {
            Some(_) if !groups.is_changed() => continue,
            Some(mut state) => state.update(particles, &groups.list),
            // What froze it may be what they would be made from.
            None if frozen => continue,
            None => polpo_solver::ExplicitGroups::new(particles, &groups.list).map(|state| {
                commands.entity(entity).try_insert(ExplicitState(state));
                true
            }),
        };
        match anew {
            Ok(false) => {}
            Ok(true) => {
                commands.entity(entity).remove::<(Edges, ImplicitGroups)>();
            }
            // Without the component, what is left of the state is idle.
            Err(error) => reject::<ExplicitGroups>(&mut commands, entity, "ExplicitGroups", error),
        }
    }
    for entity in &idle {
        commands.entity(entity).remove::<(ExplicitState, Edges, ImplicitGroups)>();
    }
}

/// What is told when groups open and close.
type Resting<'w> = (Option<Mut<'w, ImplicitGroups>>, Option<Mut<'w, Edges>>);

/// Lets implicit groups and edges rest where explicit groups hold them, if that has changed since `revision`.
fn let_rest(groups: &ExplicitState, revision: u32, (implicit, edges): Resting) {
    if groups.revision() != revision {
        if let Some(mut implicit) = implicit {
            implicit.rest_where_held(groups);
        }
        if let Some(mut edges) = edges {
            edges.rest_where_held(groups);
        }
    }
}

/// In phase `Predict`, after the particles.
pub(crate) fn predict_explicit(
    time: Res<SubstepTime>,
    mut bodies: Query<(&mut Particles, &mut ExplicitState, Option<&mut ImplicitGroups>, Option<&mut Edges>), Awake>,
) {
    for_each_body(
        &mut bodies,
        |(particles, ..)| 50 * particles.len(),
        |(mut particles, mut groups, implicit, edges)| {
            let revision = groups.revision();
            polpo_solver::predict_explicit(&mut groups, &mut particles, time.delta);
            let_rest(&groups, revision, (implicit, edges));
        },
    );
}

/// In phase `SolveConstraints`, in every iteration, after the other constraints.
pub(crate) fn match_explicit(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &mut ExplicitState), Awake>) {
    let sweep = time.sweep();
    for_each_body(
        &mut bodies,
        |(particles, _)| 50 * particles.len(),
        |(mut particles, mut groups)| polpo_solver::match_explicit_groups(&mut groups, &mut particles, sweep),
    );
}

/// In phase `SolveConstraints`, at its end: what moved members outside the iterations moves their groups.
pub(crate) fn hold_explicit(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &mut ExplicitState), Awake>) {
    for_each_body(
        &mut bodies,
        |(particles, _)| 50 * particles.len(),
        |(mut particles, mut groups)| polpo_solver::hold_explicit_groups(&mut groups, &mut particles, time.delta),
    );
}

/// In phase `SolveContacts`, before the contacts, while the velocities still tell the blow.
pub(crate) fn strike_explicit(
    time: Res<SubstepTime>,
    mut bodies: Query<(&Particles, &Contacts, &mut ExplicitState, Option<&mut ImplicitGroups>, Option<&mut Edges>), Awake>,
) {
    for_each_body(
        &mut bodies,
        |(_, contacts, ..)| 20 * contacts.list.len(),
        |(particles, contacts, mut groups, implicit, edges)| {
            let revision = groups.revision();
            groups.strike_all(particles, contacts, time.delta);
            let_rest(&groups, revision, (implicit, edges));
        },
    );
}

/// In phase `SolveContacts`, after pairs of particles: a blow from another body, or from another part of this one, opens groups too.
pub(crate) fn strike_by_pairs(
    between: Res<BodyPairs>,
    mut bodies: Query<(&mut ExplicitState, Option<&mut ImplicitGroups>, Option<&mut Edges>, Option<&SelfPairs>), Awake>,
) {
    for (mut groups, implicit, edges, own) in &mut bodies {
        let revision = groups.revision();
        for pair in own.map_or(&[][..], SelfPairs::pairs) {
            for particle in pair.particles {
                groups.strike(particle, pair.closing_speed);
            }
        }
        let_rest(&groups, revision, (implicit, edges));
    }
    for met in between.iter() {
        for (side, body) in met.bodies().into_iter().enumerate() {
            let Ok((mut groups, implicit, edges, _)) = bodies.get_mut(body) else { continue };
            let revision = groups.revision();
            for pair in met.pairs() {
                groups.strike(pair.particles[side], pair.closing_speed);
            }
            let_rest(&groups, revision, (implicit, edges));
        }
    }
}

/// In phase `SolveContacts`, after the contacts.
pub(crate) fn land_explicit(time: Res<SubstepTime>, mut bodies: Query<(&mut Particles, &mut ExplicitState), (Awake, With<Contacts>)>) {
    for_each_body(
        &mut bodies,
        |(particles, _)| 20 * particles.len(),
        |(mut particles, mut groups)| polpo_solver::land_explicit_groups(&mut groups, &mut particles, time.delta),
    );
}
