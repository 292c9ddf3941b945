//! Plasticity in the whole step.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Particles, Plasticity};
use polpo_rapier::RapierWorld;
use polpo_solver::fit_rigid;
use polpo_tests::{lattice, simulation, steps};
use rapier3d::prelude::ColliderBuilder;

/// Thrown on the floor, a soft cube of clay stays flat, an elastic one does not; the maximum bounds it.
#[test]
fn clay_stays_flat() {
    let left = |plasticity: Option<Plasticity>| {
        let mut app = simulation();
        let floor = ColliderBuilder::cuboid(50.0, 0.5, 50.0).translation(Vec3::Y * -0.5).friction(0.8);
        app.world_mut().resource_mut::<RapierWorld>().insert_fixed(floor);
        let body = app
            .world_mut()
            .spawn((
                SoftBody::new(lattice(0.1)),
                Transform::from_xyz(0.0, 0.2, 0.0),
                InitialVelocity { linear: Vec3::Y * -6.0, angular: Vec3::ZERO },
                ShapeMatching::new(Stiffness::hertz(8.0)),
                DistanceConstraints::new(Stiffness::hertz(8.0)),
            ))
            .id();
        if let Some(plasticity) = plasticity {
            app.world_mut().entity_mut(body).insert(plasticity);
        }
        steps(&mut app, 60);
        // Without weight it takes its rest shape.
        app.insert_resource(Gravity(Vec3::ZERO));
        app.world_mut().entity_mut(body).remove::<(Plasticity, Collision)>();
        steps(&mut app, 240);
        fit_rigid(app.world().get::<Particles>(body).unwrap(), Quat::IDENTITY).largest
    };
    let clay = Plasticity { yield_strain: 0.05, creep: 100.0, maximum: 0.5 };
    let (elastic, plastic, capped) = (left(None), left(Some(clay)), left(Some(Plasticity { maximum: 0.05, ..clay })));
    println!("clay: elastic {elastic}, plastic {plastic}, capped {capped} m");
    assert!(elastic < 1e-3 && plastic > 0.01 && capped < 0.5 * plastic && capped > elastic);
}
