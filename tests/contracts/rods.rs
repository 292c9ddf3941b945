//! Rods of a material bend as the books say, in the whole step of the plugin.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{CalibratedEdges, Edges, ImplicitGroups, Material, Particles, PinBroken, RodFidelity, RodShape, RodSolve, Rods, Section};
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_tests::{lattice, simulation, steps};

fn bar(n: u32) -> Rig {
    let particle =
        |i| Particle { position: Vec3::X * (i as f32 / (n - 1) as f32), frame: Quat::IDENTITY, radii: Vec3::splat(0.02), mass: 1.0 };
    Rig { mesh_hash: MeshHash(0), particles: (0..n).map(particle).collect(), edges: (1..n).map(|i| [i - 1, i]).collect(), ..Rig::default() }
}

/// A bar of 1 m and 75 mm square, of a rubber that its own weight bends by ρgAL⁴/(8EI) = 5 cm, and by ρgL²/(2κG) in shear, and how far that is.
fn rubber(solve: RodSolve) -> (Rods, f32) {
    let section = Section::square(0.075);
    let (density, nu) = (1000.0, 0.3);
    let e = density * 9.81 * section.area / (8.0 * section.bending * 0.05);
    let exact = 0.05 + density * 9.81 * (1.0 + nu) / (section.shear * e);
    (Rods { solve, ..Rods::new(Material { youngs_modulus: e, poissons_ratio: nu, density }, section) }, exact)
}

fn place(app: &App, body: Entity, i: usize) -> Vec3 {
    app.world().get::<Transform>(body).unwrap().translation + Vec3::from(app.world().get::<Particles>(body).unwrap().position[i])
}

/// The bar with its first particle clamped where it is.
fn clamped(app: &mut App, rods: Rods, damping: f32) -> (Entity, Vec3) {
    let body = app.world_mut().spawn((SoftBody::new(bar(9)), rods, Damping { drag: damping, internal: 0.0 })).id();
    let wall = place(app, body, 0);
    app.world_mut().entity_mut(body).insert(Pins { list: vec![Pin::at(0, wall).clamped()] });
    (body, wall)
}

fn fidelity(app: &App, body: Entity) -> (RodFidelity, u32) {
    let edges = app.world().get::<CalibratedEdges>(body).unwrap();
    (edges.fidelity(), edges.substeps_needed())
}

#[test]
fn a_swept_bar_sags_by_its_weight_and_says_how_many_substeps_it_needs() {
    let mut app = simulation();
    let (rods, exact) = rubber(RodSolve::Sweep { spin_radius: 0.12 });
    let (body, wall) = clamped(&mut app, rods, 3.0);
    app.insert_resource(SolverSettings { substeps: 2, iterations: 3, ..default() });
    steps(&mut app, 400);
    let (trust, needed) = fidelity(&app, body);
    assert!(trust == RodFidelity::Meaningless && (5..20).contains(&needed), "{trust:?} {needed}");
    let sag = wall.y - place(&app, body, 8).y;
    assert!(sag > 2.0 * exact, "{sag}");
    app.insert_resource(SolverSettings { substeps: needed - 1, iterations: 3, ..default() });
    steps(&mut app, 1);
    assert_eq!(fidelity(&app, body), (RodFidelity::Soft, needed));
    app.insert_resource(SolverSettings { substeps: needed, iterations: 3, ..default() });
    steps(&mut app, 400);
    assert_eq!(fidelity(&app, body), (RodFidelity::True, needed));
    let sag = wall.y - place(&app, body, 8).y;
    assert!((sag / exact - 1.0).abs() < 0.05, "{sag} m against {exact} m with {needed} substeps");
}

/// One substep a step, any number of iterations, and all components of a plain body still there.
#[test]
fn a_bar_solved_directly_sags_so_with_one_substep() {
    let mut app = simulation();
    app.insert_resource(SolverSettings { substeps: 1, iterations: 3, ..default() });
    let (rods, exact) = rubber(RodSolve::Direct);
    let (body, wall) = clamped(&mut app, rods, 3.0);
    steps(&mut app, 400);
    let sag = wall.y - place(&app, body, 8).y;
    assert!((sag / exact - 1.0).abs() < 0.01, "{sag} m against {exact} m");
    assert_eq!(fidelity(&app, body), (RodFidelity::True, 1));
    assert!(app.world().get::<Edges>(body).unwrap().is_empty() && app.world().get::<ImplicitGroups>(body).unwrap().is_empty());
}

/// The pin of a bar solved directly bears its weight, 5.6 kg, and gives way when it does not.
#[test]
fn a_pin_feels_the_rods_pull() {
    #[derive(Resource, Default)]
    struct Broken(Option<f32>);
    for solve in [RodSolve::Direct, RodSolve::Sweep { spin_radius: 0.12 }] {
        let mut app = simulation();
        app.insert_resource(SolverSettings { substeps: 12, iterations: 1, ..default() });
        app.init_resource::<Broken>().add_observer(|broken: On<PinBroken>, mut last: ResMut<Broken>| last.0 = Some(broken.force));
        let (rods, _) = rubber(solve);
        let (body, wall) = clamped(&mut app, rods, 3.0);
        app.world_mut().get_mut::<Pins>(body).unwrap().list[0].break_force = 500.0;
        steps(&mut app, 400);
        assert_eq!(app.world().resource::<Broken>().0, None);
        app.world_mut().get_mut::<Pins>(body).unwrap().list[0].break_force = 0.1;
        steps(&mut app, 2);
        let force = app.world().resource::<Broken>().0.expect("it gave way");
        let weight = 1000.0 * 0.075 * 0.075 * 9.81;
        assert!((force / weight - 1.0).abs() < 0.01, "{solve:?}: {force} N of {weight} N");
        steps(&mut app, 30);
        assert!(place(&app, body, 0).y < wall.y - 0.5, "it fell");
    }
}

/// A soft cube on a stiff stalk: the stalk's edges are rods, the cube's are the paper's, and the particle between them is in both.
#[test]
fn rods_in_one_part_and_groups_in_another() {
    let mut rig = lattice(0.1);
    let cube = rig.edges.len();
    // Up from the middle of the top, particle 16 at (0, 0.1, 0).
    let count = rig.particles.len() as u32;
    for k in 0..4 {
        rig.particles.push(Particle {
            position: Vec3::new(0.0, 0.2 + 0.1 * k as f32, 0.0),
            frame: Quat::IDENTITY,
            radii: Vec3::splat(0.02),
            mass: 5.0,
        });
        rig.edges.push([if k == 0 { 16 } else { count + k - 1 }, count + k]);
    }
    rig.edges.sort_unstable();
    let stalk: Vec<u32> = (0..rig.edges.len() as u32).filter(|&e| rig.edges[e as usize][1] >= count).collect();
    let section = Section::circle(0.01);
    let material = Material { youngs_modulus: 1e9, poissons_ratio: 0.3, density: 1000.0 };
    let mut app = simulation();
    let body = app
        .world_mut()
        .spawn((
            SoftBody::new(rig.clone()),
            Rods { shape: RodShape::Section { section, edges: Some(stalk.clone()) }, ..Rods::new(material, section) },
            Damping { drag: 2.0, internal: 4.0 },
        ))
        .id();
    let nail = place(&app, body, count as usize + 3);
    app.world_mut().entity_mut(body).insert(Pins { list: vec![Pin::at(count + 3, nail).clamped()] });
    steps(&mut app, 1);
    let rod = 1000.0 * section.area * 0.1;
    let mass = |app: &App, i: u32| app.world().get::<Particles>(body).unwrap().mass[i as usize];
    assert!((mass(&app, count) - rod).abs() < 1e-6 && (mass(&app, 16) - 0.01 - 0.5 * rod).abs() < 1e-6 && mass(&app, 0) == 0.01);
    let edges = app.world().get::<Edges>(body).unwrap();
    assert!(edges.len() == cube && edges.input.iter().all(|&e| rig.edges[e as usize].iter().all(|&i| i < count)));
    assert_eq!(app.world().get::<CalibratedEdges>(body).unwrap().pairs.len(), 4);
    steps(&mut app, 300);
    // It hangs: the stalk straight and 40 cm long, the cube below it.
    let (top, bottom) = (place(&app, body, 16), place(&app, body, 10));
    assert!((nail.distance(top) - 0.4).abs() < 1e-4, "{nail} {top}");
    assert!(bottom.y < top.y - 0.1 && bottom.y > top.y - 0.35, "{bottom} {top}");
    // The rods gone, all is the paper's again and weighs what it did.
    app.world_mut().entity_mut(body).remove::<Rods>();
    steps(&mut app, 2);
    assert!(mass(&app, count) == 5.0 && mass(&app, 16) == 0.01);
    assert_eq!(app.world().get::<Edges>(body).unwrap().len(), rig.edges.len());
    assert!(!app.world().entity(body).contains::<CalibratedEdges>());
}

#[test]
fn bad_rods_leave_the_body_without() {
    let section = Section::circle(0.05);
    let good = Material { youngs_modulus: 1e6, poissons_ratio: 0.3, density: 1000.0 };
    for rods in [
        Rods::new(Material { youngs_modulus: f32::NAN, ..good }, section),
        Rods { shape: RodShape::Section { section, edges: Some(vec![0, 7]) }, ..Rods::new(good, section) },
        Rods { shape: RodShape::Section { section, edges: Some(vec![1, 1]) }, ..Rods::new(good, section) },
        Rods { solve: RodSolve::Sweep { spin_radius: f32::NAN }, ..Rods::new(good, section) },
        Rods { retardation: f32::NAN, ..Rods::new(good, section) },
        Rods { retardation: -1e-3, ..Rods::new(good, section) },
    ] {
        let mut app = simulation();
        let body = app.world_mut().spawn((SoftBody::new(bar(3)), rods)).id();
        steps(&mut app, 10);
        assert!(!app.world().entity(body).contains::<Rods>() && !app.world().entity(body).contains::<CalibratedEdges>());
        assert_eq!(app.world().get::<Edges>(body).unwrap().len(), 2, "its edges are the paper's");
        assert!(app.world().get::<Particles>(body).unwrap().is_finite());
    }
}
