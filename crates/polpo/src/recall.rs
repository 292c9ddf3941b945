//! What a body's capabilities carry over from step to step, in a form that can be kept and put back.

use bevy::ecs::system::SystemChangeTick;
use bevy::ecs::world::EntityRef;
use bevy::math::{DQuat, DVec3, Vec3A};
use bevy::prelude::*;
use polpo_solver::GroupMemory;
use serde::{Deserialize, Serialize};

use crate::{
    DistanceConstraints, Edges, ExplicitGroups, ExplicitState, Frozen, ImplicitGroups, Particles, Posed, Rods, SelfContact, SelfPairs,
    ShapeMatching, Sleeping, SoftBody, Torsion, rods,
};

/// What the capabilities of a body remember, each list empty if there is nothing. Everything else that they have made from the body's particles is made again from those.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Memory {
    /// Of the explicit groups, one a group.
    groups: Vec<GroupRecord>,
    /// The plastic flow of the implicit groups and of the edges, in their order.
    shapes: Vec<Vec3A>,
    lengths: Vec<f32>,
    /// Of the pairs of particles within the body, by their particles.
    own: Vec<KnownPair>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct GroupRecord(#[serde(with = "GroupFields")] GroupMemory);

#[derive(Serialize, Deserialize)]
#[serde(remote = "GroupMemory")]
struct GroupFields {
    rotation: DQuat,
    acting: bool,
    open: f32,
    lost_spin: DVec3,
    rest: Vec<Vec3A>,
    lost: Vec<[Vec3A; 2]>,
}

/// Two particles and the normal between them.
pub(crate) type KnownPair = ([u32; 2], Vec3A);

/// Whether `known` is sorted by particles, as lists of pairs are, the first of each below `count`, with normals of unit length.
pub(crate) fn are_known_pairs(known: &[KnownPair], count: usize) -> bool {
    known.is_sorted_by(|a, b| a.0 < b.0) && known.iter().all(|&([i, _], n)| (i as usize) < count && is_direction(n))
}

/// Whether `n` is a unit vector, as near as makes no difference.
pub(crate) fn is_direction(n: Vec3A) -> bool {
    (0.9..1.1).contains(&n.length_squared())
}

/// What is to be put back as soon as the capabilities of the body have made what they make from its particles: in the next step's `Prepare`.
#[derive(Component, Debug)]
pub(crate) struct Recall(pub(crate) Memory);

impl Memory {
    /// That of `body`; what waits to be put back if anything does.
    pub(crate) fn of(body: &EntityRef, particles: &Particles) -> Self {
        if let Some(Recall(memory)) = body.get() {
            return memory.clone();
        }
        Self {
            groups: body.get::<ExplicitState>().map_or(Vec::new(), |state| state.memory(particles).into_iter().map(GroupRecord).collect()),
            shapes: body.get::<ImplicitGroups>().map_or(Vec::new(), |groups| groups.flow().to_vec()),
            lengths: body.get::<Edges>().map_or(Vec::new(), |edges| edges.flow().to_vec()),
            own: body.get::<SelfPairs>().map_or(Vec::new(), |own| own.known().collect()),
        }
    }

    fn groups(&self) -> Vec<GroupMemory> {
        self.groups.iter().map(|group| group.0.clone()).collect()
    }

    /// What of it does not fit `body`, whose components may not have made anything from its particles yet.
    pub(crate) fn misfit(&self, body: &EntityRef, particles: &polpo_solver::Particles) -> Option<&'static str> {
        let explicit = body.get::<ExplicitGroups>().and_then(|groups| polpo_solver::ExplicitGroups::new(particles, &groups.list).ok());
        let explicit = explicit.unwrap_or_default();
        if !(self.groups.is_empty() || explicit.can_recall(&self.groups())) {
            return Some("its explicit groups");
        }
        if !self.shapes.is_empty() || !self.lengths.is_empty() {
            let pairs = body.get::<SoftBody>().map_or(Vec::new(), |soft| rods::edges_beside(&soft.rig, body.get::<Rods>()).0);
            let edges = polpo_solver::Edges::new(particles, &pairs).unwrap_or_default();
            let members = polpo_solver::ImplicitGroups::beside(particles, &edges, &explicit).member_count();
            let matches = body.contains::<ShapeMatching>() && self.shapes.len() == members;
            if !(self.shapes.is_empty() || matches && self.shapes.iter().all(|f| f.is_finite())) {
                return Some("the plastic flow of its shapes");
            }
            let matches = (body.contains::<DistanceConstraints>() || body.contains::<Torsion>()) && self.lengths.len() == edges.len();
            if !(self.lengths.is_empty() || matches && self.lengths.iter().all(|f| *f > 0.0 && f.is_finite())) {
                return Some("the plastic flow of its edges");
            }
        }
        let inside = |&([i, j], _): &KnownPair| i < j && (j as usize) < particles.len();
        let matches = body.contains::<SelfContact>() && are_known_pairs(&self.own, particles.len()) && self.own.iter().all(inside);
        if !(self.own.is_empty() || matches) {
            return Some("its pairs of particles");
        }
        None
    }
}

/// In phase `Prepare`, when all has been made that components ask for: what was put back since the last step is recalled. What no longer fits, because components have changed since, is forgotten.
pub(crate) fn recall(
    mut commands: Commands,
    ticks: SystemChangeTick,
    mut bodies: Query<
        (
            Entity,
            &Recall,
            &Particles,
            Option<&ExplicitGroups>,
            Option<&mut ExplicitState>,
            Option<&mut ImplicitGroups>,
            Option<&mut Edges>,
            Option<&mut SelfPairs>,
            Option<&Posed>,
            Option<&mut Sleeping>,
        ),
        Without<Frozen>,
    >,
) {
    for (entity, Recall(memory), particles, list, state, implicit, edges, own, posed, sleeping) in &mut bodies {
        let mut explicit = polpo_solver::ExplicitGroups::default();
        if let (Some(list), Some(mut state)) = (list, state)
            && let Ok(new) = polpo_solver::ExplicitGroups::new(particles, &list.list)
        {
            state.0 = new;
            state.recall(particles, &memory.groups());
            explicit.clone_from(&state);
        }
        let made = polpo_solver::RestPose::default();
        let pose = posed.map_or(&made, |posed| &posed.pose);
        if let Some(mut implicit) = implicit {
            implicit.set_flow(&memory.shapes);
            implicit.pose(particles, pose);
            implicit.rest_where_held(&explicit);
        }
        if let Some(mut edges) = edges {
            edges.set_flow(&memory.lengths);
            edges.pose(particles, pose);
            edges.rest_where_held(&explicit);
        }
        if let Some(mut own) = own {
            own.remember(&memory.own);
        }
        // What has just been made for a body that sleeps, masses of rods say, does not wake it.
        if let Some(mut sleeping) = sleeping {
            *sleeping = Sleeping::restored(ticks.this_run(), sleeping.conditions());
        }
        commands.entity(entity).remove::<Recall>();
    }
}
