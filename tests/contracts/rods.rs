//! Rods of a material bend as the books say, in the whole step of the plugin.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{CalibratedEdges, Material, Particles, Rods, Section};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_tests::{simulation, steps};

fn bar(n: u32) -> Rig {
    let particle =
        |i| Particle { position: Vec3::X * (i as f32 / (n - 1) as f32), frame: Quat::IDENTITY, radii: Vec3::splat(0.02), mass: 1.0 };
    Rig { mesh_hash: MeshHash(0), particles: (0..n).map(particle).collect(), edges: (1..n).map(|i| [i - 1, i]).collect(), skin: vec![] }
}

/// A bar of 1 m and 75 mm square, clamped at one end, of a rubber that its own weight bends by ρgAL⁴/(8EI) = 5 cm, and by ρgL²/(2κG) in shear.
#[test]
fn a_clamped_bar_sags_by_its_weight() {
    let section = Section::square(0.075);
    let (density, nu) = (1000.0, 0.3);
    let e = density * 9.81 * section.area / (8.0 * section.bending * 0.05);
    let exact = 0.05 + density * 9.81 * (1.0 + nu) / (section.shear * e);
    let mut app = simulation();
    let body = app
        .world_mut()
        .spawn((
            SoftBody::new(bar(9)),
            Rods { material: Material { youngs_modulus: e, poissons_ratio: nu, density }, section, spin_radius: 0.12 },
            Damping { drag: 3.0, internal: 0.0 },
        ))
        .id();
    app.world_mut().entity_mut(body).remove::<(ShapeMatching, DistanceConstraints, Torsion, Collision)>();
    let place = |app: &App, i: usize| {
        app.world().get::<Transform>(body).unwrap().translation + Vec3::from(app.world().get::<Particles>(body).unwrap().position[i])
    };
    let wall = place(&app, 0);
    app.world_mut().entity_mut(body).insert(Pins { list: vec![Pin::at(0, wall).clamped()] });
    steps(&mut app, 1);
    let substeps =
        app.world().get::<CalibratedEdges>(body).unwrap().recommended_substeps(app.world().get::<Particles>(body).unwrap(), 1.0 / 60.0);
    assert!((5..20).contains(&substeps), "{substeps}");
    app.insert_resource(SolverSettings { substeps, iterations: 3 });
    steps(&mut app, 400);
    let sag = wall.y - place(&app, 8).y;
    assert!((sag / exact - 1.0).abs() < 0.05, "{sag} m against {exact} m with {substeps} substeps");
}

#[test]
fn a_bad_material_leaves_the_body_without_rods() {
    let mut app = simulation();
    let material = Material { youngs_modulus: f32::NAN, poissons_ratio: 0.3, density: 1000.0 };
    let body = app.world_mut().spawn((SoftBody::new(bar(3)), Rods { material, section: Section::circle(0.05), spin_radius: 0.0 })).id();
    steps(&mut app, 10);
    assert!(!app.world().entity(body).contains::<Rods>() && !app.world().entity(body).contains::<CalibratedEdges>());
    assert!(app.world().get::<Particles>(body).unwrap().is_finite());
}
