//! What a body does not have is neither stored nor run.

use polpo::prelude::*;
use polpo::{Contacts, Edges, ImplicitGroups, Particles};
use polpo_tests::{lattice, simulation, steps};

#[test]
fn a_bare_body_stores_particles_and_nothing_else() {
    let mut app = simulation();
    let body = app.world_mut().spawn(SoftBody::new(lattice(0.1))).id();
    app.world_mut().entity_mut(body).remove::<(ShapeMatching, DistanceConstraints, Torsion, Damping, Collision, Contacts)>();
    steps(&mut app, 5);
    let entity = app.world().entity(body);
    assert!(!entity.contains::<ImplicitGroups>() && !entity.contains::<Edges>() && !entity.contains::<Contacts>());
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

#[test]
fn a_step_without_bodies_does_nothing() {
    let mut app = simulation();
    steps(&mut app, 5);
    assert_eq!(app.world_mut().query::<&Particles>().iter(app.world()).count(), 0);
}
