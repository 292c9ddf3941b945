//! What a body does not have is not run: each system of the step is asked which bodies its queries match.
//!
//! Queries that ask for one component or another (`Or`), as those that build edges and poses, are taken to ask for all of them, and so are not seen here.

use std::any::TypeId;
use std::collections::{BTreeMap, BTreeSet};

use bevy::ecs::schedule::{ScheduleLabel, Schedules};
use bevy::ecs::system::System;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{
    ConstraintSchedule, ContactMemory, Contacts, ExplicitGroup, ExplicitGroups, Material, Particles, Plasticity, RodShape, Rods, Section,
    Stillness, SubstepSchedule,
};
use polpo_rapier::{PushRigidBodies, TouchedColliders};
use polpo_scenes::SimulationPlugins;
use polpo_tests::{lattice, simulation, steps};

/// A query over bodies: what it asks for, and what must not be there.
struct Asking {
    /// Of which schedule, and the how manieth there. (Without Bevy's debug feature systems have no names.)
    system: (&'static str, usize),
    with: Vec<TypeId>,
    without: Vec<TypeId>,
}

/// Every query that looks at particles, of every system of ours in the three schedules.
fn queries() -> Vec<Asking> {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, SimulationPlugins));
    let mut all = Vec::new();
    let schedules = [("step", FixedPostUpdate.intern()), ("substep", SubstepSchedule.intern()), ("iteration", ConstraintSchedule.intern())];
    for (schedule_name, label) in schedules {
        let mut schedule = app.world_mut().resource_mut::<Schedules>().remove(label).unwrap();
        let systems = &mut schedule.graph_mut().systems;
        let keys: Vec<_> = systems.iter().map(|(key, ..)| key).collect();
        for (index, key) in keys.into_iter().enumerate() {
            let system = systems.get_mut(key).unwrap();
            let access = system.initialize(app.world_mut());
            let components = app.world().components();
            let particles = components.get_id(TypeId::of::<Particles>());
            let type_of = |id| components.get_info(id).and_then(|info| info.type_id());
            for query in access.filtered_accesses() {
                let with: Vec<_> = query.with_filters().collect();
                let looks = particles.is_some_and(|id| with.contains(&id) || query.access().has_read(id));
                if looks {
                    let system = (schedule_name, index);
                    let with = with.into_iter().filter_map(type_of).collect();
                    all.push(Asking { system, with, without: query.without_filters().filter_map(type_of).collect() });
                }
            }
        }
    }
    all
}

/// The systems that see a body made by `change` from one that has particles and nothing else.
fn seeing(queries: &[Asking], change: &dyn Fn(&mut EntityWorldMut)) -> BTreeSet<(&'static str, usize)> {
    let mut app = simulation();
    let mut body = app.world_mut().spawn(SoftBody::new(lattice(0.1)));
    body.remove::<(ShapeMatching, DistanceConstraints, Torsion, Damping, KeepMomentum, BodyContact, Sleep, Stillness)>().remove::<(
        Collision,
        Contacts,
        ContactMemory,
    )>();
    change(&mut body);
    let body = body.id();
    steps(&mut app, 3);
    let world = app.world();
    let has: BTreeSet<TypeId> = world
        .entity(body)
        .archetype()
        .components()
        .iter()
        .filter_map(|&id| world.components().get_info(id).and_then(|info| info.type_id()))
        .collect();
    let sees = |q: &&Asking| q.with.iter().all(|t| has.contains(t)) && !q.without.iter().any(|t| has.contains(t));
    queries.iter().filter(sees).map(|q| q.system).collect()
}

#[test]
fn each_component_brings_its_own_systems_and_no_others() {
    let queries = queries();
    let bare = seeing(&queries, &|_| {});
    println!("bare: {bare:?}");
    let section = Section::circle(0.02);
    let material = Material { youngs_modulus: 1e6, poissons_ratio: 0.4, density: 1000.0 };
    type Change<'a> = Box<dyn Fn(&mut EntityWorldMut) + 'a>;
    fn insert<'a, B: Bundle + Clone + 'a>(bundle: B) -> Change<'a> {
        Box::new(move |body| {
            body.insert(bundle.clone());
        })
    }
    let capabilities: Vec<(&str, Change)> = vec![
        ("ShapeMatching", insert(ShapeMatching::default())),
        ("DistanceConstraints", insert(DistanceConstraints::default())),
        ("Torsion", insert(Torsion::default())),
        ("Damping", insert(Damping::default())),
        ("KeepMomentum", insert(KeepMomentum::default())),
        ("Collision", insert(Collision::default())),
        ("BodyContact", insert(BodyContact::default())),
        ("Sleep", insert(Sleep::default())),
        ("SelfContact", insert(SelfContact::default())),
        ("ExplicitGroups", insert(ExplicitGroups { list: vec![ExplicitGroup::rigid([0, 1, 2])] })),
        ("Rods", insert(Rods { shape: RodShape::Section { section, edges: Some(vec![0]) }, ..Rods::new(material, section) })),
        ("Plasticity", insert(Plasticity::default())),
        ("Pins", insert(Pins::default())),
        ("Grab", insert(Grab { particle: 0, target: Vec3::ZERO, stiffness: Stiffness::hertz(9.0) })),
        ("AirDrag", insert(AirDrag::default())),
        ("GravityScale", insert(GravityScale(0.5))),
        ("PushRigidBodies", insert(PushRigidBodies)),
        ("TouchedColliders", insert(TouchedColliders::default())),
    ];
    let brought: BTreeMap<&str, Vec<(&'static str, usize)>> =
        capabilities.iter().map(|(name, change)| (*name, seeing(&queries, change.as_ref()).difference(&bare).cloned().collect())).collect();
    for (name, systems) in &brought {
        println!("{name}: {systems:?}");
    }
    // Two that check and freeze it, one that remembers where it was, prediction, integration, the centre of mass, and two that look it up: what falls asleep beside it, and what rides on it.
    assert_eq!(bare.len(), 8, "{bare:?}");
    let counts: Vec<(&str, usize)> = brought.iter().map(|(name, systems)| (*name, systems.len())).collect();
    let expected = [
        ("AirDrag", 1),
        ("BodyContact", 2),
        ("Collision", 3),
        ("Damping", 1),
        ("DistanceConstraints", 1),
        ("ExplicitGroups", 5),
        ("Grab", 1),
        // Read by the prediction.
        ("GravityScale", 0),
        ("KeepMomentum", 2),
        ("Pins", 2),
        ("Plasticity", 1),
        ("PushRigidBodies", 1),
        ("Rods", 2),
        ("SelfContact", 2),
        ("ShapeMatching", 2),
        ("Sleep", 1),
        ("Torsion", 1),
        ("TouchedColliders", 1),
    ];
    assert_eq!(counts, expected);
    let mut owners = BTreeMap::new();
    for (name, systems) in &brought {
        for system in systems {
            assert_eq!(owners.insert(*system, *name), None, "{system:?} belongs to {name} and to another");
        }
    }
    // Those that come with every body bring their own, and one that asks for two of them: what a collider near a sleeper stirs.
    let both = seeing(&queries, &|body| {
        body.insert((Collision::default(), Sleep::default()));
    });
    let plain = seeing(&queries, &|body| {
        body.insert((ShapeMatching::default(), DistanceConstraints::default(), Torsion::default(), Damping::default()));
        body.insert((KeepMomentum::default(), Collision::default(), BodyContact::default(), Sleep::default()));
    });
    let defaults = ["ShapeMatching", "DistanceConstraints", "Torsion", "Damping", "KeepMomentum", "Collision", "BodyContact", "Sleep"];
    for system in plain.difference(&bare) {
        let own = owners.get(system).map_or(both.contains(system), |name| defaults.contains(name));
        assert!(own, "a plain body is seen by {system:?} of {:?}", owners.get(system));
    }
    let own: usize = defaults.iter().map(|name| brought[name].len()).sum();
    assert_eq!(plain.len(), bare.len() + own + 1);
}
