//! What bodies made from the same rig have in common: made once, then copied.

use std::sync::{Arc, Weak};

use bevy::prelude::*;
use polpo_rig::Rig;
use polpo_solver::{EdgeError, Edges, ImplicitGroups, Particles, SelfSearch, TooDense};

/// The groups and edges of bodies that consist of nothing but a rig's particles and edges, and the pairs of their particles that never touch.
///
/// Groups and pairs share with their copies what does not change, which is most of them: many bodies of one rig take less memory than each on its own would, and less time to read.
#[derive(Resource, Default)]
pub(crate) struct Prototypes(Vec<Prototype>);

struct Prototype {
    rig: Weak<Rig>,
    /// The particles that they were made for, of which what is at rest counts.
    particles: Particles,
    edges: Edges,
    /// Made when the first body wants them.
    groups: Option<ImplicitGroups>,
    search: Option<SelfSearch>,
}

impl Prototypes {
    /// The edges of a body of `rig` with these `particles`.
    pub(crate) fn edges(&mut self, rig: &Arc<Rig>, particles: &Particles) -> Result<Edges, EdgeError> {
        self.of(rig, particles).map(|prototype| prototype.edges.clone())
    }

    /// Its groups.
    pub(crate) fn groups(&mut self, rig: &Arc<Rig>, particles: &Particles) -> Result<ImplicitGroups, EdgeError> {
        let prototype = self.of(rig, particles)?;
        let groups = prototype.groups.get_or_insert_with(|| ImplicitGroups::new(&prototype.particles, &prototype.edges));
        Ok(groups.clone())
    }

    /// Its search for pairs with itself.
    pub(crate) fn self_search(&mut self, rig: &Arc<Rig>, particles: &Particles) -> Result<SelfSearch, TooDense> {
        // Without a prototype if its edges are none: self-contact does not ask for sound ones.
        let Ok(prototype) = self.of(rig, particles) else {
            return SelfSearch::new(particles, &rig.edges);
        };
        let search = match prototype.search.take() {
            Some(search) => search,
            None => SelfSearch::new(particles, &rig.edges)?,
        };
        Ok(prototype.search.insert(search).clone())
    }

    fn of(&mut self, rig: &Arc<Rig>, particles: &Particles) -> Result<&mut Prototype, EdgeError> {
        let known = self.0.iter().position(|known| {
            let at_rest = |p: &Particles| {
                (&p.rest_position[..], &p.frame[..], &p.radii[..], &p.mass[..])
                    == (&particles.rest_position, &particles.frame, &particles.radii, &particles.mass)
            };
            std::ptr::eq(known.rig.as_ptr(), Arc::as_ptr(rig)) && at_rest(&known.particles)
        });
        let at = match known {
            Some(at) => at,
            None => {
                let edges = Edges::new(particles, &rig.edges)?;
                self.0.retain(|known| known.rig.strong_count() > 0);
                self.0.push(Prototype { rig: Arc::downgrade(rig), particles: particles.clone(), edges, groups: None, search: None });
                self.0.len() - 1
            }
        };
        Ok(&mut self.0[at])
    }
}
