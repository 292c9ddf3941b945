//! All that kernels read and write, and how it was before they ran.

use glam::{Quat, Vec3A};
use polpo_solver::{
    CalibratedEdges, Contact, Contacts, Edges, ImplicitGroups, Pair, PairFinder, Pairs, Particles, SelfSearch, find_support, momentum,
};

use super::Body;
use super::body::DT;
use crate::scalar::{ScalarEdges, ScalarGroups};

/// What kernels work on.
pub(super) struct State {
    pub(super) particles: Particles,
    pub(super) groups: ImplicitGroups,
    pub(super) scalar_groups: ScalarGroups,
    pub(super) edges: Edges,
    pub(super) calibrated: CalibratedEdges,
    pub(super) scalar_edges: ScalarEdges,
    pub(super) contacts: Contacts,
    pub(super) fresh: SelfSearch,
    pub(super) own: SelfSearch,
    pub(super) finder: PairFinder,
    pub(super) pairs: Pairs,
    pub(super) support: Vec<Vec3A>,
    /// Angular momentum at the start \[kg·m²/s\].
    pub(super) angular: Vec3A,
    start: Start,
}

/// What kernels change.
struct Start {
    particles: Particles,
    /// Of the groups.
    rotation: Vec<Quat>,
    contacts: Vec<Contact>,
    pairs: Vec<Pair>,
}

impl State {
    /// Of `body`, its particles as they are in `particles`, on `contacts`.
    pub(super) fn new(body: &Body, particles: Particles, contacts: Contacts, calibrated: CalibratedEdges) -> Self {
        let mut groups = body.groups.clone();
        groups.forget_rotations(&particles);
        let mut support = Vec::new();
        let fresh = SelfSearch::new(&particles, &body.edges.pairs).expect("few particles overlap at rest");
        find_support(&contacts, &particles, DT, &mut support);
        Self {
            scalar_groups: ScalarGroups::new(&groups, &particles),
            scalar_edges: ScalarEdges::new(&calibrated),
            edges: body.edges.clone(),
            own: fresh.clone(),
            fresh,
            finder: PairFinder::default(),
            pairs: Pairs::default(),
            support,
            angular: momentum(&particles).angular,
            start: Start {
                particles: particles.clone(),
                rotation: groups.rotation.clone(),
                contacts: contacts.list.clone(),
                pairs: Vec::new(),
            },
            particles,
            groups,
            calibrated,
            contacts,
        }
    }

    /// Makes the pairs that there are now those of the start.
    pub(super) fn keep_pairs(&mut self) {
        self.start.pairs.clone_from(&self.pairs.list);
    }

    /// Back to the start, in the memory that there is.
    pub(super) fn reset(&mut self) {
        let (now, start) = (&mut self.particles, &self.start.particles);
        now.position.clone_from(&start.position);
        now.previous_position.clone_from(&start.previous_position);
        now.velocity.clone_from(&start.velocity);
        now.rotation.clone_from(&start.rotation);
        now.previous_rotation.clone_from(&start.previous_rotation);
        now.angular_velocity.clone_from(&start.angular_velocity);
        self.groups.rotation.clone_from(&self.start.rotation);
        self.scalar_groups.rotation.clone_from(&self.start.rotation);
        self.contacts.list.clone_from(&self.start.contacts);
        self.pairs.list.clone_from(&self.start.pairs);
    }
}
