//! What a body does not have is neither stored nor run.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{
    BodyPairs, CalibratedEdges, ContactMemory, Contacts, Edges, ExplicitState, ImplicitGroups, KeepMomentum, Particles, PinState, Posed,
    SelfPairs, Stillness,
};
use polpo_rapier::{PushState, TouchedColliders};
use polpo_tests::{lattice, simulation, steps};

#[test]
fn a_bare_body_stores_particles_and_nothing_else() {
    let mut app = simulation();
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    app.world_mut()
        .entity_mut(body)
        .remove::<(ShapeMatching, DistanceConstraints, Torsion, Damping, KeepMomentum, BodyContact, Sleep, Stillness)>()
        .remove::<(Collision, Contacts, ContactMemory)>();
    steps(&mut app, 5);
    let entity = app.world().entity(body);
    assert!(!entity.contains::<ImplicitGroups>() && !entity.contains::<Edges>() && !entity.contains::<Contacts>());
    assert!(!entity.contains::<ContactMemory>() && !entity.contains::<Stillness>());
    // And nothing acts on it but gravity: every particle falls alike, deformed or not.
    app.world_mut().get_mut::<Particles>(body).unwrap().position[3].x += 0.5;
    let before = app.world().get::<Particles>(body).unwrap().0.clone();
    steps(&mut app, 10);
    let after = app.world().get::<Particles>(body).unwrap();
    for i in 1..after.len() {
        let (then, now) = (before.position[i] - before.position[0], after.position[i] - after.position[0]);
        assert!(then.distance(now) < 1e-5);
    }
}

/// What comes with every body brings no data of what does not: nothing is stored for a capability that nobody asked for.
#[test]
fn a_plain_body_stores_nothing_of_what_it_does_not_use() {
    let mut app = simulation();
    let bodies = [0.0, 5.0].map(|x| app.world_mut().spawn((SoftBody::new(lattice(0.1)), Transform::from_xyz(x, 0.0, 0.0))).id());
    steps(&mut app, 5);
    for body in bodies {
        let entity = app.world().entity(body);
        assert!(!entity.contains::<CalibratedEdges>() && !entity.contains::<ExplicitState>() && !entity.contains::<Posed>());
        assert!(!entity.contains::<SelfPairs>() && !entity.contains::<PinState>());
        assert!(!entity.contains::<PushState>() && !entity.contains::<TouchedColliders>());
        assert!(entity.get::<Particles>().unwrap().reaction.is_empty());
    }
    assert_eq!(app.world().resource::<BodyPairs>().iter().len(), 0, "bodies that are apart have no pairs");
}

/// A capability that has been there and is gone has left nothing that the step would look at.
#[test]
fn what_is_taken_away_takes_its_data_along() {
    let mut app = simulation();
    let body =
        app.world_mut().spawn((SoftBody::new(lattice(0.1)), SelfContact::default(), Pins { list: vec![Pin::at(0, Vec3::ZERO)] })).id();
    steps(&mut app, 2);
    assert!(app.world().entity(body).contains::<SelfPairs>());
    app.world_mut().entity_mut(body).remove::<(SelfContact, Pins, ShapeMatching, DistanceConstraints, Torsion)>();
    steps(&mut app, 2);
    let entity = app.world().entity(body);
    assert!(!entity.contains::<SelfPairs>() && !entity.contains::<ImplicitGroups>() && !entity.contains::<Edges>());
    assert!(entity.get::<Particles>().unwrap().inverse_mass.iter().all(|&w| w > 0.0));
}

#[test]
fn a_step_without_bodies_does_nothing() {
    let mut app = simulation();
    steps(&mut app, 5);
    assert_eq!(app.world_mut().query::<&Particles>().iter(app.world()).count(), 0);
}
