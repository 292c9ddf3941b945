//! Muscles and inflation: a rest shape that moves.

use bevy::math::Vec3A;
use bevy::prelude::*;

use crate::capability::reject;
use crate::{CalibratedEdges, Edges, ImplicitGroups, Particles};

/// The pose that the body strives for, instead of the rig's. Change it from step to step, and it works like a muscle: [`ShapeMatching`](crate::ShapeMatching), [`DistanceConstraints`](crate::DistanceConstraints),
/// [`Torsion`](crate::Torsion) and [`Rods`](crate::Rods) follow it, with their stiffness, and nothing pulls from outside. A fish whose spine waves, with [`AirDrag`](crate::AirDrag) of water, swims.
///
/// Only what differs between neighbours counts: where the pose is as a whole does not matter. [`ExplicitGroups`](crate::ExplicitGroups) keep their shape, so a pose should move each of them as a piece.
/// Lists of the wrong length and numbers that are not finite are refused with [`CapabilityRejected`](crate::CapabilityRejected).
#[derive(Component, Debug, Clone, Default, PartialEq)]
pub struct RestPose {
    /// Where each particle is \[m\], in the axes of `Particles::rest_position`: the rig's, scaled as the body is. Empty: as in the rig.
    pub position: Vec<Vec3>,
    /// How each particle is turned there against the rig, any length but zero. Empty: not at all. A bent limb needs its particles turned along.
    pub rotation: Vec<Quat>,
}

/// The body's rest shape, or that of parts, is larger or smaller. The particles keep their radii, as the skin keeps its patches. [`ExplicitGroups`](crate::ExplicitGroups) have a scale of their own. Sizes
/// that are not positive and normal are refused with [`CapabilityRejected`](crate::CapabilityRejected).
#[derive(Component, Debug, Clone, PartialEq)]
pub struct Inflation {
    /// How many times larger the whole is; default 1.
    pub scale: f32,
    /// How many times larger still the neighbourhood of each particle is; default empty, once. Neighbours should differ little.
    pub each: Vec<f32>,
}

impl Inflation {
    /// The whole body `scale` times larger.
    pub const fn new(scale: f32) -> Self {
        Self { scale, each: Vec::new() }
    }
}

impl Default for Inflation {
    fn default() -> Self {
        Self::new(1.0)
    }
}

/// The rest pose as the constraints have it. There while [`RestPose`] or [`Inflation`] is.
#[derive(Component, Debug, Clone, Default)]
pub struct Posed {
    pub(crate) pose: polpo_solver::RestPose,
    /// Which of the two components it was made from.
    from: [bool; 2],
}

/// In phase `Prepare`, after groups and edges are there: gives them the pose if it has changed or they are new.
#[expect(clippy::type_complexity, reason = "one query over what a pose is made of and what follows it")]
pub(crate) fn pose_bodies(
    mut commands: Commands,
    mut bodies: Query<
        (
            Entity,
            &Particles,
            Option<Ref<RestPose>>,
            Option<Ref<Inflation>>,
            Option<&mut Posed>,
            Option<Mut<ImplicitGroups>>,
            Option<Mut<Edges>>,
            Option<Mut<CalibratedEdges>>,
        ),
        Or<(With<RestPose>, With<Inflation>, With<Posed>)>,
    >,
) {
    for (entity, particles, pose, inflation, mut posed, groups, edges, rods) in &mut bodies {
        let from = [pose.is_some(), inflation.is_some()];
        let changed = pose.as_ref().is_some_and(|p| p.is_changed()) || inflation.as_ref().is_some_and(|i| i.is_changed());
        let new = groups.as_ref().is_some_and(|g| g.is_added()) || edges.as_ref().is_some_and(|e| e.is_added());
        let new = new || rods.as_ref().is_some_and(|r| r.is_unposed());
        if !(changed || new) && posed.as_ref().is_some_and(|p| p.from == from) {
            continue;
        }
        let mut fresh = polpo_solver::RestPose::default();
        let made = posed.as_mut().map_or(&mut fresh, |p| &mut p.pose);
        made.size.clear();
        made.position.clear();
        made.rotation.clear();
        if let Some(pose) = &pose {
            made.position.extend(pose.position.iter().map(|&x| Vec3A::from(x)));
            made.rotation.extend(&pose.rotation);
            if let Err(error) = made.check(particles.len()) {
                made.position.clear();
                made.rotation.clear();
                reject::<RestPose>(&mut commands, entity, "RestPose", error);
            }
        }
        if let Some(inflation) = &inflation {
            if inflation.each.is_empty() {
                made.size.resize(particles.len(), inflation.scale);
            } else {
                made.size.extend(inflation.each.iter().map(|each| each * inflation.scale));
            }
            if let Err(error) = made.check(particles.len()) {
                made.size.clear();
                reject::<Inflation>(&mut commands, entity, "Inflation", error);
            }
        }
        if let Some(mut groups) = groups {
            groups.pose(particles, made);
        }
        if let Some(mut edges) = edges {
            edges.pose(particles, made);
        }
        if let Some(mut rods) = rods {
            rods.pose(particles, made);
        }
        match posed {
            _ if from == [false, false] => {
                commands.entity(entity).remove::<Posed>();
            }
            Some(mut posed) => posed.from = from,
            None => {
                commands.entity(entity).try_insert(Posed { pose: fresh, from });
            }
        }
    }
}
