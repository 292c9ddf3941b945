//! Regions of a rig: what it says of groups, stiffness and friction becomes components of the body.

use bevy::prelude::*;
use polpo_rig::{GroupKind, Region, Rig, Spring};
use polpo_solver::{ExplicitGroup, Stiffness};

use crate::{Collision, ExplicitGroups, ParticleFriction, ParticleStiffness, ShapeMatching, SoftBody};

/// Which of a body's components were made from its rig's regions, and go with them.
#[derive(Component, Debug, Clone, Copy, PartialEq)]
pub(crate) struct FromRegions {
    groups: bool,
    stiffness: bool,
    friction: bool,
}

/// As soon as a [`SoftBody`] is inserted: a rig with regions gives what the body has not been given otherwise.
pub(crate) fn take_regions(
    insert: On<Insert, SoftBody>,
    mut commands: Commands,
    bodies: Query<(
        &SoftBody,
        (&ShapeMatching, &Collision),
        (Has<ExplicitGroups>, Has<ParticleStiffness>, Has<ParticleFriction>),
        Option<&FromRegions>,
    )>,
) {
    let Ok((SoftBody { rig }, (matching, collision), has, before)) = bodies.get(insert.entity) else { return };
    if rig.regions.is_empty() && before.is_none() {
        return;
    }
    let before = before.copied().unwrap_or(FromRegions { groups: false, stiffness: false, friction: false });
    let mut body = commands.entity(insert.entity);
    let now = FromRegions {
        groups: give(&mut body, groups(rig), has.0, before.groups),
        stiffness: give(&mut body, stiffness(rig, matching).map(ParticleStiffness::new), has.1, before.stiffness),
        friction: give(&mut body, friction(rig, collision).map(ParticleFriction), has.2, before.friction),
    };
    if rig.regions.is_empty() {
        body.try_remove::<FromRegions>();
    } else {
        body.try_insert(now);
    }
}

/// Gives a component that is not the user's own, or takes the one that an earlier rig gave; whether the body's is a rig's now.
fn give<C: Component>(body: &mut EntityCommands, new: Option<C>, has: bool, given: bool) -> bool {
    if has && !given {
        return false;
    }
    match new {
        Some(new) => {
            body.try_insert(new);
            true
        }
        None => {
            if has {
                body.try_remove::<C>();
            }
            false
        }
    }
}

/// In phase `Prepare`: what is outside the regions follows the body's own numbers when these change.
pub(crate) fn follow_body(
    mut stiff: Query<(&SoftBody, &FromRegions, &ShapeMatching, &mut ParticleStiffness), Changed<ShapeMatching>>,
    mut rough: Query<(&SoftBody, &FromRegions, &Collision, &mut ParticleFriction), Changed<Collision>>,
) {
    for (body, from, matching, mut each) in &mut stiff {
        if let Some(new) = stiffness(&body.rig, matching).filter(|new| from.stiffness && new != each.get()) {
            *each.get_mut() = new;
        }
    }
    for (body, from, collision, mut each) in &mut rough {
        if let Some(new) = friction(&body.rig, collision).filter(|_| from.friction) {
            each.set_if_neq(ParticleFriction(new));
        }
    }
}

fn spring(spring: Spring) -> Stiffness {
    Stiffness::damped(spring.hertz, spring.damping_ratio)
}

/// One explicit group a region that is one.
fn groups(rig: &Rig) -> Option<ExplicitGroups> {
    let group = |region: &Region| {
        let rigid = ExplicitGroup::rigid(region.particles.clone());
        match region.group? {
            GroupKind::Rigid => Some(rigid),
            GroupKind::Soft(soft) => Some(ExplicitGroup { stiffness: spring(soft), ..rigid }),
        }
    };
    let list: Vec<ExplicitGroup> = rig.regions.iter().filter_map(group).collect();
    (!list.is_empty()).then_some(ExplicitGroups { list })
}

fn stiffness(rig: &Rig, matching: &ShapeMatching) -> Option<Vec<Stiffness>> {
    by_particle(rig, matching.stiffness, |region| region.stiffness.map(spring))
}

fn friction(rig: &Rig, collision: &Collision) -> Option<Vec<f32>> {
    by_particle(rig, collision.friction, |region| region.friction)
}

/// A value a particle: its region's, or the body's own. None if no region has one.
fn by_particle<T: Copy>(rig: &Rig, own: T, of: impl Fn(&Region) -> Option<T>) -> Option<Vec<T>> {
    let mut each = None;
    for (region, value) in rig.regions.iter().filter_map(|region| of(region).map(|value| (region, value))) {
        let each = each.get_or_insert_with(|| vec![own; rig.particles.len()]);
        for &particle in &region.particles {
            // Beyond the end only in a rig that is refused.
            if let Some(slot) = each.get_mut(particle as usize) {
                *slot = value;
            }
        }
    }
    each
}
