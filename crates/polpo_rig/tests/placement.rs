//! Particles lie where the recipe says, as many or as far apart as it says.

mod common;

use common::{block, cubes, grid, pieces, two_fingers};
use glam::{IVec3, Vec3};
use polpo_rig::{Amount, EdgeAmount, Mesh, Particle, Placement, Recipe, Rig, build_rig};

const PLACEMENTS: [Placement; 4] = [Placement::Auto, Placement::Surface, Placement::Volume, Placement::Medial];

/// A ball of radius 1, as a cube blown up.
fn ball() -> Mesh {
    cubes(&grid(IVec3::ZERO, IVec3::splat(2)), 8, |p| (p - 1.0).normalize())
}

fn rig(mesh: &Mesh, placement: Placement, particles: usize) -> Rig {
    build_rig(mesh, &Recipe { placement, ..Recipe::with_particles(particles) }).expect("the shape can be rigged")
}

/// How far every particle is from the nearest one that an edge leads to.
fn nearest(rig: &Rig) -> Vec<f32> {
    let mut nearest = vec![f32::INFINITY; rig.particles.len()];
    for [a, b] in rig.edges.iter().map(|e| e.map(|p| p as usize)) {
        let distance = rig.particles[a].position.distance(rig.particles[b].position);
        nearest[a] = nearest[a].min(distance);
        nearest[b] = nearest[b].min(distance);
    }
    nearest
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len() as f32
}

#[test]
fn the_count_is_met_exactly() {
    for placement in PLACEMENTS {
        for count in [1, 60] {
            let rig = rig(&two_fingers(0.05), placement, count);
            assert_eq!((rig.particles.len(), pieces(&rig)), (count, 1), "{placement:?}");
        }
    }
}

#[test]
fn the_spacing_is_met() {
    for placement in PLACEMENTS {
        for (mesh, wanted) in [(two_fingers(0.05), 0.08), (ball(), 0.4)] {
            let recipe = Recipe { placement, amount: Amount::Spacing(wanted), ..Recipe::default() };
            let rig = build_rig(&mesh, &recipe).expect("the shape can be rigged");
            let spacing = mean(&nearest(&rig));
            let count = rig.particles.len();
            assert!((spacing / wanted - 1.0).abs() < 0.1, "{placement:?}: {count} particles, {spacing} apart and not {wanted}");
        }
    }
}

#[test]
fn a_spacing_wider_than_the_body_is_one_particle_and_one_too_fine_is_named() {
    let bar = block([4, 1, 1], 1, Vec3::new(0.4, 0.1, 0.1));
    let with = |spacing| build_rig(&bar, &Recipe { amount: Amount::Spacing(spacing), ..Recipe::default() });
    assert_eq!(with(5.0).expect("a rig").particles.len(), 1);
    for spacing in [1e-4, 1e-30] {
        let error = with(spacing).map(|_| ()).map_err(|e| e.to_string());
        assert!(error.as_ref().is_err_and(|e| e.starts_with("setting `spacing` is")), "{error:?}");
    }
}

#[test]
fn on_the_skin_particles_are_even_and_flat() {
    let rig = rig(&ball(), Placement::Surface, 120);
    let apart = nearest(&rig);
    let spacing = mean(&apart);
    let variance = mean(&apart.iter().map(|d| (d - spacing) * (d - spacing)).collect::<Vec<_>>());
    assert!(variance.sqrt() < 0.12 * spacing, "nearest neighbours are {spacing} ± {} away", variance.sqrt());
    for particle in &rig.particles {
        let thinnest = particle.radii.min_position();
        let across = particle.frame * Vec3::AXES[thinnest];
        let out = particle.position.normalize();
        assert!(across.dot(out).abs() > 0.95, "{particle:?} does not lie along the skin");
        assert!(particle.radii[thinnest] < 0.5 * particle.radii.max_element(), "{particle:?} is not flat");
        let top = particle.position.length() + particle.radii[thinnest];
        assert!((top - 1.0).abs() < 0.05, "{particle:?} does not reach the skin: {top}");
    }
    let masses: Vec<f32> = rig.particles.iter().map(|p| p.mass).collect();
    let (least, most) = masses.iter().fold((f32::INFINITY, 0.0_f32), |m, &x| (m.0.min(x), m.1.max(x)));
    assert!(most < 3.0 * least, "a ball is shared out evenly, not {least} kg to {most} kg");
}

#[test]
fn in_the_volume_particles_are_even() {
    // A palm with fingers half as thick: by default these get more.
    let mesh = two_fingers(0.05);
    let share = |placement| {
        let rig = rig(&mesh, placement, 80);
        let masses: Vec<f32> = rig.particles.iter().map(|p| p.mass).collect();
        masses.iter().fold(0.0_f32, |m, &x| m.max(x)) / masses.iter().fold(f32::INFINITY, |m, &x| m.min(x))
    };
    assert!(share(Placement::Volume) < 2.5, "{}", share(Placement::Volume));
}

/// A cube with a thin limb.
fn hammer() -> Mesh {
    let mut cells = grid(IVec3::ZERO, IVec3::splat(6));
    cells.extend(grid(IVec3::new(6, 2, 2), IVec3::new(30, 4, 4)));
    cubes(&cells, 1, |p| p * 0.1)
}

#[test]
fn along_the_middle_a_limb_is_a_chain_and_a_head_is_few() {
    let rig = rig(&hammer(), Placement::Medial, 16);
    let (limb, head): (Vec<&Particle>, Vec<&Particle>) = rig.particles.iter().partition(|p| p.position.x > 0.85);
    assert!(head.len() <= 4, "{} in the head", head.len());
    for particle in &limb {
        let off = (particle.position - Vec3::new(particle.position.x, 0.3, 0.3)).length();
        assert!(off < 0.03, "{particle:?} is {off} off the middle");
        for normal in [Vec3::Y, Vec3::Z] {
            let across = (particle.frame.inverse() * normal * particle.radii).length();
            assert!((0.08..0.13).contains(&across), "{particle:?} does not fill the limb: {across}");
        }
    }
    // In the volume the head takes more.
    let even = self::rig(&hammer(), Placement::Volume, 16);
    assert!(even.particles.iter().filter(|p| p.position.x < 0.6).count() > 5);
}

#[test]
fn edges_of_a_length_are_all_pairs_along_the_body() {
    let mesh = two_fingers(0.05);
    let length = 0.25;
    let recipe = Recipe { edges: EdgeAmount::Length(length), ..Recipe::with_particles(60) };
    let rig = build_rig(&mesh, &recipe).expect("the shape can be rigged");
    assert_eq!(pieces(&rig), 1);
    let finger = |p: Vec3| if p.y < 0.2 { 0 } else { 1 + i32::from(p.x > 0.025) };
    for b in 0..60_u32 {
        for a in 0..b {
            let [p, q] = [a, b].map(|i| rig.particles[i as usize].position);
            let edge = rig.edges.contains(&[a, b]);
            // Within one finger a way along the body is straight.
            let same = finger(p) == finger(q) && finger(p) > 0;
            assert!(!same || edge == (p.distance(q) <= length), "{p} and {q}, {} apart", p.distance(q));
            let across = finger(p) * finger(q) == 2 && p.y.min(q.y) > 0.5;
            assert!(!across || !edge, "{p} and {q} are tied across the gap");
        }
    }
}
