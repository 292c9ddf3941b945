//! Bodies in cells: as stiff as their material in the whole step of the plugin, from what a rigger knows.

use bevy::math::{Mat3A, Vec3A};
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{
    CalibratedEdges, CapabilityError, CapabilityRejected, Cells, Edges, Facet, Limb, Material, Particles, RodFidelity, RodShape, RodSolve,
    Rods, Section,
};
use polpo_rig::{Fidelity, MeshHash, Particle, RecipeMaterial, Rig};
use polpo_tests::{simulation, steps};

const DENSITY: f32 = 1000.0;

/// A bar of 1 m and `across` cells, along x, in cubes of `size`, on a wall at x = 0, and the rig with it: cells first, then the walls, one a cell that touches.
fn bar(across: u32, size: f32) -> (Rig, Cells) {
    let long = (1.0 / size).round() as u32;
    let cell = |x: u32, y: u32, z: u32| (x * across + y) * across + z;
    let face = |pair: [u32; 2], centroid: Vec3, normal: Vec3| {
        let (area, moment) = (size * size, size.powi(4) / 12.0);
        let across = (Vec3::ONE - normal.abs()) * moment;
        Facet { pair, area: (normal * area).into(), centroid: centroid.into(), moments: Mat3A::from_diagonal(across) }
    };
    let mut cells = Cells::default();
    let mut places = Vec::new();
    for x in 0..long {
        for y in 0..across {
            for z in 0..across {
                let place = (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * size;
                for (next, normal) in [(x + 1 < long, Vec3::X), (y + 1 < across, Vec3::Y), (z + 1 < across, Vec3::Z)] {
                    if next {
                        let step = normal.as_uvec3();
                        let pair = [cell(x, y, z), cell(x + step.x, y + step.y, z + step.z)];
                        cells.facets.push(face(pair, place + normal * (0.5 * size), normal));
                    }
                }
                places.push(place);
            }
        }
    }
    cells.volumes = vec![size.powi(3); places.len()];
    for i in 0..across * across {
        let place = places[i as usize] * (Vec3::ONE - Vec3::X);
        cells.facets.push(face([i, places.len() as u32], place, Vec3::NEG_X));
        places.push(place);
        cells.volumes.push(0.0);
    }
    cells.facets.sort_by_key(|f| f.pair);
    let particle = |&position: &Vec3| Particle { position, frame: Quat::IDENTITY, radii: Vec3::splat(0.3 * size), mass: 0.5 };
    let edges = cells.facets.iter().map(|f| f.pair).collect();
    (Rig { mesh_hash: MeshHash(0), particles: places.iter().map(particle).collect(), edges, ..Rig::default() }, cells)
}

fn rubber(poissons_ratio: f32) -> Material {
    Material { youngs_modulus: 1e7, poissons_ratio, density: DENSITY }
}

fn place(app: &App, body: Entity, i: usize) -> Vec3 {
    app.world().get::<Transform>(body).unwrap().translation + Vec3::from(app.world().get::<Particles>(body).unwrap().position[i])
}

/// How far the last cells of a bar of `across`² cells of `size` sag under their weight, as a part of what Timoshenko says, and how many substeps the edges asked for and had.
fn sag(across: u32, size: f32, rods: impl Fn(Cells) -> Rods, substeps: Option<u32>) -> (f32, u32) {
    let mut app = simulation();
    let (rig, cells) = bar(across, size);
    let rods = rods(cells);
    let material = rods.material;
    let body = app.world_mut().spawn((SoftBody::new(rig), rods)).id();
    hang(&mut app, body, across, size, material, substeps)
}

/// The same of a body that is there.
fn hang(app: &mut App, body: Entity, across: u32, size: f32, material: Material, substeps: Option<u32>) -> (f32, u32) {
    let walls = across * across;
    let count = app.world().get::<Particles>(body).unwrap().len() as u32 - walls;
    app.world_mut().entity_mut(body).insert(Damping { drag: 4.0, internal: 0.0 });
    app.world_mut().entity_mut(body).remove::<(Collision, BodyContact)>();
    let list = (count..count + walls).map(|i| Pin::at(i, place(app, body, i as usize)).clamped()).collect();
    let ends: Vec<usize> = ((count - walls) as usize..count as usize).collect();
    let height = |app: &App| ends.iter().map(|&i| place(app, body, i).y).sum::<f32>() / ends.len() as f32;
    let start = height(app);
    app.world_mut().entity_mut(body).insert(Pins { list });
    steps(app, 1);
    let needed = app.world().get::<CalibratedEdges>(body).unwrap().substeps_needed();
    app.insert_resource(SolverSettings { substeps: substeps.unwrap_or(needed), iterations: 2, ..default() });
    steps(app, 240);
    assert_eq!(app.world().get::<CalibratedEdges>(body).unwrap().fidelity(), RodFidelity::True);
    assert!(app.world().get::<Edges>(body).unwrap().is_empty(), "what the rig had between the cells is not theirs");
    let (a, x) = (across as f32 * size, 1.0 - 0.5 * size);
    let load = DENSITY * 9.81;
    let bend = load * 12.0 / (24.0 * material.youngs_modulus * a * a) * x * x * (6.0 - 4.0 * x + x * x);
    let exact = bend + load * 1.2 / material.shear_modulus() * (x - 0.5 * x * x);
    ((start - height(app)) / exact - 1.0, needed)
}

/// With as many substeps as the edges ask for, which alone are good for two or three per cent.
#[test]
fn a_bar_of_cells_sags_by_its_weight() {
    for (across, size, nu, most) in [(1, 0.1, 0.0, 0.03), (2, 0.1, 0.0, 0.03), (2, 0.1, 0.3, 0.03)] {
        let (error, needed) = sag(across, size, |cells| Rods::of_cells(rubber(nu), cells), None);
        println!("{across}² cells of {size} m, nu {nu}: sag {:+.1} % with {needed} substeps", 100.0 * error);
        assert!(error.abs() < most && needed > 10, "{across}: {error} with {needed}");
    }
}

/// A rig with the cells of a bar, at half its size, of the material that the bar has.
fn half_a_bar(across: u32, size: f32) -> (Rig, Rods) {
    let (mut rig, cells) = bar(across, size);
    for (particle, &volume) in rig.particles.iter_mut().zip(&cells.volumes) {
        particle.position *= 0.5;
        particle.radii *= 0.5;
        particle.mass = 0.125 * if volume > 0.0 { DENSITY * volume } else { 1.0 };
    }
    let facet = |f: &Facet| polpo_rig::Facet {
        pair: f.pair,
        area: Vec3::from(f.area) * 0.25,
        centroid: Vec3::from(f.centroid) * 0.5,
        moments: [f.moments.x_axis.x, f.moments.y_axis.y, f.moments.z_axis.z, 0.0, 0.0, 0.0].map(|m| m * 0.0625),
    };
    rig.cells = Some(polpo_rig::Cells {
        material: RecipeMaterial { youngs_modulus: 1e7, poissons_ratio: 0.3, retardation: 0.0, fidelity: Fidelity::Cells },
        volumes: cells.volumes.iter().map(|v| v * 0.125).collect(),
        facets: cells.facets.iter().map(facet).collect(),
        limb: None,
    });
    (rig, Rods::of_cells(rubber(0.3), cells))
}

/// Without a word about rods; scaled as the body is.
#[test]
fn a_rig_with_cells_is_as_stiff_as_its_material() {
    let (rig, rods) = half_a_bar(2, 0.125);
    let mut app = simulation();
    let body = app.world_mut().spawn((SoftBody::new(rig), Transform::from_scale(Vec3::splat(2.0)))).id();
    assert_eq!(app.world().get::<Rods>(body), Some(&rods), "powers of two scale without rounding");
    let (error, needed) = hang(&mut app, body, 2, 0.125, rods.material, None);
    println!("from the rig: sag {:+.1} % with {needed} substeps", 100.0 * error);
    assert!(error.abs() < 0.03 && needed > 10, "{error} with {needed}");
}

/// A bar whose far half is four times as heavy: as a rig's regions may say.
#[test]
fn cells_are_as_dense_as_the_rig_says() {
    let (mut rig, _) = half_a_bar(1, 0.25);
    let even = rig.clone();
    for particle in rig.particles.iter_mut().filter(|p| p.position.x > 0.25) {
        particle.mass *= 4.0;
    }
    let cells = rig.cells.clone().unwrap();
    let mut app = simulation();
    let bodies = [rig.clone(), even].map(|rig| app.world_mut().spawn((SoftBody::new(rig), Transform::from_scale(Vec3::splat(2.0)))).id());
    steps(&mut app, 2);
    let [own, even] = bodies.map(|body| app.world().get::<Particles>(body).unwrap());
    for (i, particle) in rig.particles.iter().enumerate().filter(|(i, _)| cells.volumes[*i] > 0.0) {
        let (mass, times) = (particle.mass * 8.0, if particle.position.x > 0.25 { 4.0 } else { 1.0 });
        assert!((own.mass[i] / mass - 1.0).abs() < 1e-5, "{i}: {} of {mass}", own.mass[i]);
        assert!((own.inertia[i] / even.inertia[i] / times - 1.0).abs() < 1e-5, "{i}: spin is heavier, too");
    }
}

/// Rods that came with the rig go with it; those of somebody's own stay, and taken off they stay off.
#[test]
fn a_body_keeps_the_rods_of_its_own() {
    let (with, rods) = half_a_bar(1, 0.25);
    let without = Rig { cells: None, ..with.clone() };
    let mut app = simulation();
    let has = |app: &App, body: Entity| (app.world().get::<Rods>(body).cloned(), app.world().entity(body).contains::<CalibratedEdges>());
    let twice = Transform::from_scale(Vec3::splat(2.0));

    let body = app.world_mut().spawn((SoftBody::new(with.clone()), twice)).id();
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (Some(rods.clone()), true));
    app.world_mut().entity_mut(body).insert((SoftBody::new(without.clone()), twice));
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (None, false));
    app.world_mut().entity_mut(body).insert((SoftBody::new(with.clone()), twice));
    steps(&mut app, 2);
    app.world_mut().entity_mut(body).remove::<Rods>();
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (None, false));

    let own = Rods { retardation: 0.01, ..rods.clone() };
    let body = app.world_mut().spawn((SoftBody::new(with.clone()), twice, own.clone())).id();
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (Some(own.clone()), true));
    let body = app.world_mut().spawn((SoftBody::new(with.clone()), twice)).id();
    steps(&mut app, 2);
    app.world_mut().entity_mut(body).insert(own.clone());
    app.world_mut().entity_mut(body).insert((SoftBody::new(with.clone()), twice));
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (Some(own.clone()), true), "changed by hand, they are nobody else's");

    // Nor does it matter when: right after they came, and even while they come.
    let body = app.world_mut().spawn((SoftBody::new(with.clone()), twice)).id();
    app.world_mut().get_mut::<Rods>(body).unwrap().retardation = 0.01;
    app.world_mut().entity_mut(body).insert((SoftBody::new(without.clone()), twice));
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (Some(own.clone()), true), "changed right after they came");
    let damp = |add: On<Add, Rods>, mut rods: Query<&mut Rods>| rods.get_mut(add.entity).unwrap().retardation = 0.01;
    let damp = app.world_mut().add_observer(damp).id();
    let body = app.world_mut().spawn((SoftBody::new(with.clone()), twice)).id();
    app.world_mut().despawn(damp);
    app.world_mut().entity_mut(body).insert((SoftBody::new(without.clone()), twice));
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (Some(own), true), "changed while they came");

    let body = app.world_mut().spawn(SoftBody::new(without)).id();
    steps(&mut app, 2);
    assert_eq!(has(&app, body), (None, false), "and a rig without cells has none");
}

/// A material without Poisson's ratio has no rings, and one substep is enough.
#[test]
fn cells_without_rings_are_solved_directly() {
    let direct = |cells| Rods { solve: RodSolve::Direct, ..Rods::of_cells(rubber(0.0), cells) };
    let (error, needed) = sag(2, 0.1, direct, Some(1));
    println!("direct: sag {:+.1} %", 100.0 * error);
    assert!(error.abs() < 0.02 && needed == 1, "{error} with {needed}");
}

/// Nor does a body have rings that does without.
#[test]
fn cells_may_do_without_rings() {
    let direct = |cells| {
        let shape = RodShape::Cells(Cells { without_rings: true, ..cells });
        Rods { material: rubber(0.3), shape, solve: RodSolve::Direct, retardation: 0.0 }
    };
    let (error, needed) = sag(2, 0.1, direct, Some(1));
    println!("direct, without rings: sag {:+.1} %", 100.0 * error);
    assert!(error.abs() < 0.06 && needed == 1, "{error} with {needed}");
}

#[test]
fn a_limb_of_cells_takes_fewer_substeps() {
    let spin = RodSolve::Sweep { spin_radius: 0.12 };
    let whole = |cells| Rods { solve: spin, ..Rods::of_cells(rubber(0.3), cells) };
    let limb = |cells| {
        let limb = Some(Limb { axis: Vec3A::X, section: Section::square(0.1) });
        Rods { solve: spin, ..Rods::of_cells(rubber(0.3), Cells { limb, ..cells }) }
    };
    let ((_, all), (error, few)) = (sag(2, 0.05, whole, None), sag(2, 0.05, limb, None));
    println!("limb: sag {:+.1} % with {few} substeps of {all}", 100.0 * error);
    assert!(error.abs() < 0.08 && few * 2 < all, "{error} with {few} of {all}");
}

/// Cells in one part, the paper's groups in another; and all as it was when the rods are gone.
#[test]
fn cells_weigh_what_their_volume_says() {
    let (mut rig, cells) = bar(1, 0.25);
    let last = rig.particles.len() as u32;
    rig.particles.push(Particle { position: Vec3::new(1.2, 0.0, 0.0), ..rig.particles[0] });
    rig.edges.push([3, last]);
    rig.edges.sort_unstable();
    let cells = Cells { volumes: [cells.volumes, vec![0.0]].concat(), ..cells };
    let mut app = simulation();
    let body = app.world_mut().spawn((SoftBody::new(rig.clone()), Rods::of_cells(rubber(0.3), cells))).id();
    steps(&mut app, 2);
    let masses = |app: &App| app.world().get::<Particles>(body).unwrap().mass.clone();
    let cell = DENSITY * 0.25f32.powi(3);
    assert_eq!(masses(&app), [cell, cell, cell, cell, 0.5, 0.5]);
    assert_eq!(app.world().get::<Edges>(body).unwrap().pairs, [[3, last]]);
    app.world_mut().entity_mut(body).remove::<Rods>();
    steps(&mut app, 2);
    assert_eq!(masses(&app), [0.5; 6]);
    assert_eq!(app.world().get::<Edges>(body).unwrap().len(), rig.edges.len());
}

#[test]
fn bad_cells_are_refused_by_name() {
    #[derive(Resource, Default)]
    struct Told(Vec<String>);
    let (rig, cells) = bar(1, 0.25);
    let bad = |change: &dyn Fn(&mut Rods, &mut Cells)| {
        let (mut rods, mut cells) = (Rods::of_cells(rubber(0.3), cells.clone()), cells.clone());
        change(&mut rods, &mut cells);
        rods.shape = RodShape::Cells(cells);
        rods
    };
    let flat = Limb { axis: Vec3A::ZERO, section: Section::square(0.25) };
    for (rods, reason) in [
        (bad(&|_, c| c.volumes.truncate(3)), "the volume of particle 3 of 5 is not 0 or more"),
        (bad(&|_, c| c.volumes[1] = f32::NAN), "the volume of particle 1 of 5 is not 0 or more"),
        (bad(&|_, c| c.facets[1].pair[1] = 77), "facet 1: 0 and 77 are not two of 5 particles"),
        (bad(&|_, c| c.densities = vec![1000.0]), "the number of densities is 1, not one a particle"),
        (bad(&|_, c| c.densities = vec![0.0; 5]), "the density of a cell is 0, not positive and normal"),
        (bad(&|_, c| c.facets[2].area = Vec3A::ZERO), "facet 2: it does not face from its first particle to its second"),
        (bad(&|_, c| c.facets[2].area *= 1e38), "facet 2: its numbers are too large or too small"),
        (bad(&|_, c| c.limb = Some(flat)), "the length of the limb's axis is 0, not positive and normal"),
        (bad(&|r, _| r.material.poissons_ratio = -0.1), "Poisson's ratio is -0.1, not 0 or more"),
        (bad(&|r, _| r.solve = RodSolve::Sweep { spin_radius: -1.0 }), "the spin radius is -1, not 0 or more"),
        (
            bad(&|r, _| r.solve = RodSolve::Direct),
            "cells of a material with a Poisson's ratio other than 0 have rings, which cannot be solved directly; sweep them",
        ),
    ] {
        let mut app = simulation();
        app.init_resource::<Told>().add_observer(|event: On<CapabilityRejected>, mut told: ResMut<Told>| {
            assert!(matches!(event.reason, CapabilityError::Calibration(_)));
            told.0.push(format!("{}: {}", event.component, event.reason));
        });
        let body = app.world_mut().spawn((SoftBody::new(rig.clone()), rods)).id();
        steps(&mut app, 10);
        assert_eq!(app.world().resource::<Told>().0, [format!("Rods: {reason}")]);
        let entity = app.world().entity(body);
        assert!(!entity.contains::<Rods>() && !entity.contains::<CalibratedEdges>());
        assert_eq!(entity.get::<Edges>().unwrap().len(), rig.edges.len(), "its edges are the paper's");
        let particles = entity.get::<Particles>().unwrap();
        assert!(particles.is_finite() && particles.mass.iter().all(|m| *m == 0.5), "and its masses the rig's");
    }
}
