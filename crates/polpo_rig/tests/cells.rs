//! Cells of a material: they fill the body, touch where they should, and are told a limb from anything else.

mod common;

use common::{block, both, moved, spacing};
use glam::{DMat3, DVec3, IVec3, Quat, Vec3};
use polpo_rig::{Cells, Facet, Mesh, Recipe, RecipeMaterial, Rig, build_rig};

fn rig(mesh: &Mesh, particles: usize) -> (Rig, Cells) {
    let material = toml_material();
    let rig = build_rig(mesh, &Recipe { material: Some(material), ..Recipe::with_particles(particles) }).expect("the shape can be rigged");
    let cells = rig.cells.clone().expect("it has a material");
    (rig, cells)
}

fn toml_material() -> RecipeMaterial {
    Recipe::from_toml("test", "[material]\nyoungs_modulus = 1e6").expect("a recipe").material.expect("a material")
}

/// A box with one corner in the origin, turned so that no side is along the voxels.
fn turned(sides: Vec3) -> Mesh {
    let turn = Quat::from_array([0.3, 0.1, -0.2, 0.9]).normalize();
    let mut mesh = block([1, 1, 1], 3, sides);
    mesh.positions.iter_mut().for_each(|p| *p = turn * *p);
    mesh
}

fn moments(f: &Facet) -> DMat3 {
    let [xx, yy, zz, xy, xz, yz] = f.moments.map(f64::from);
    DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
}

#[test]
fn a_rig_without_a_material_has_no_cells() {
    assert_eq!(common::rig(&block([1, 1, 1], 2, Vec3::ONE), 20).cells, None);
}

/// In a bar of one cell across every facet is the whole section, to a fifth of what a voxel is of it. However the bar lies on the voxels.
#[test]
fn facets_are_as_large_as_the_section() {
    let sides = Vec3::new(1.0, 0.07, 0.05);
    for mesh in [block([1, 1, 1], 3, sides), moved(block([1, 1, 1], 3, sides), Vec3::new(0.0, 0.013, 0.0017)), turned(sides)] {
        let (_, cells) = rig(&mesh, 9);
        let volume: f32 = cells.volumes.iter().sum();
        assert!((volume / 0.0035 - 1.0).abs() < 1e-5, "{volume}");
        assert_eq!(cells.facets.len(), 8);
        for f in &cells.facets {
            let (area, most) = (f.area.length(), (moments(f).x_axis.x + moments(f).y_axis.y + moments(f).z_axis.z) as f32);
            // Facets tilt by a degree or two.
            assert!((area / 0.0035 - 1.0).abs() < 0.012, "area {area} of 0.0035");
            let exact = 0.07 * 0.05 * (0.07 * 0.07 + 0.05 * 0.05) / 12.0;
            assert!((most / exact - 1.0).abs() < 0.025, "moment {most} of {exact}");
        }
    }
}

/// Gauss's theorem, cell by cell: Σ S⊗(c − x) over all of its surface is its volume. Where no skin is, facets are all of it, and their areas cancel.
#[test]
fn facets_close_cells() {
    let (rig, cells) = rig(&turned(Vec3::new(1.0, 0.9, 0.8)), 150);
    let mut surface = vec![(DVec3::ZERO, DMat3::ZERO, 0.0f64); rig.particles.len()];
    for f in &cells.facets {
        let [a, b] = f.pair.map(|i| i as usize);
        for (cell, area) in [(a, f.area.as_dvec3()), (b, -f.area.as_dvec3())] {
            let arm = (f.centroid - rig.particles[cell].position).as_dvec3();
            surface[cell].0 += area;
            surface[cell].1 += DMat3::from_cols(area * arm.x, area * arm.y, area * arm.z);
            surface[cell].2 += area.length();
        }
    }
    let within: Vec<usize> = (0..surface.len()).filter(|&i| surface[i].0.length() < 0.01 * surface[i].2).collect();
    assert!(within.len() > 5, "{}", within.len());
    for i in within {
        let fabric = surface[i].1 * (1.0 / f64::from(cells.volumes[i]));
        let off = fabric - DMat3::IDENTITY;
        let largest = [off.x_axis, off.y_axis, off.z_axis].iter().map(|c| c.abs().max_element()).fold(0.0, f64::max);
        assert!(largest < 0.05, "cell {i}: {fabric}");
    }
}

/// Facets stand across the lines between particles, and these are in the middle of their cells and about as dense everywhere.
#[test]
fn cells_are_those_of_voronoi() {
    let (rig, cells) = rig(&block([1, 1, 1], 2, Vec3::new(1.0, 0.6, 0.5)), 60);
    let h = spacing(&rig);
    for f in &cells.facets {
        let [a, b] = f.pair.map(|i| rig.particles[i as usize].position);
        if f.area.length() > 0.2 * h * h {
            let (cos, off) = (f.area.normalize().dot((b - a).normalize()), (f.centroid - (a + b) * 0.5).dot((b - a).normalize()));
            assert!(cos > 0.97, "{:?}: {cos}", f.pair);
            assert!(off.abs() < 0.05 * h, "{:?}: {off}", f.pair);
        }
    }
    let mean = 0.3 / 60.0;
    assert!(cells.volumes.iter().all(|v| (0.5 * mean..2.0 * mean).contains(v)), "{:?}", cells.volumes);
}

#[test]
fn one_slender_limb_is_told_from_anything_else() {
    let sides = Vec3::new(1.0, 0.1, 0.1);
    let (_, cells) = rig(&turned(sides), 20);
    let limb = cells.limb.expect("a bar is a limb");
    let along = Quat::from_array([0.3, 0.1, -0.2, 0.9]).normalize() * Vec3::X;
    assert!(limb.axis.dot(along).abs() > 0.9999 && (limb.length - 1.0).abs() < 0.02, "{limb:?}");
    let exact = [0.01, 1e-4 / 12.0, 0.1406e-4];
    for (got, exact) in [limb.area, limb.bending, limb.torsion].into_iter().zip(exact) {
        assert!((got / exact - 1.0).abs() < 0.03, "{limb:?}: {got} of {exact}");
    }
    let bent = |p: Vec3| Vec3::new(p.x, p.y + 0.6 * p.x * p.x, p.z);
    let bar = block([12, 1, 1], 2, sides);
    let no_limbs = [
        ("stout", block([1, 1, 1], 2, Vec3::new(1.0, 0.25, 0.25))),
        ("flat", block([1, 1, 1], 2, Vec3::new(1.0, 0.1, 0.03))),
        ("bent", Mesh { positions: bar.positions.iter().map(|&p| bent(p)).collect(), ..bar.clone() }),
        (
            "tapered",
            Mesh {
                positions: bar.positions.iter().map(|&p| p * Vec3::new(1.0, 1.0 - 0.5 * p.x, 1.0 - 0.5 * p.x)).collect(),
                ..bar.clone()
            },
        ),
        ("two strands", both(bar.clone(), moved(bar.clone(), Vec3::new(0.0, 0.15, 0.0)))),
        ("angle", common::cubes(&[(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2)].map(|(x, y)| IVec3::new(x, y, 0)), 2, |p| p * 0.25)),
    ];
    for (what, mesh) in no_limbs {
        assert_eq!(rig(&mesh, 12).1.limb, None, "{what}");
    }
}

/// Parts that lie apart are tied by a facet each, as by an edge; or they would fall apart.
#[test]
fn parts_are_tied() {
    let cube = block([1, 1, 1], 2, Vec3::splat(0.2));
    let (rig, cells) = rig(&both(cube.clone(), moved(cube, Vec3::new(0.0, 0.5, 0.0))), 8);
    let part = |i: u32| rig.particles[i as usize].position.y > 0.35;
    let ties: Vec<&Facet> = cells.facets.iter().filter(|f| part(f.pair[0]) != part(f.pair[1])).collect();
    assert_eq!(ties.len(), 1);
    let [a, b] = ties[0].pair.map(|i| rig.particles[i as usize].position);
    assert!(ties[0].area.dot(b - a) > 0.0 && ties[0].centroid.distance((a + b) * 0.5) < 1e-6);
}

#[test]
fn the_same_mesh_gives_the_same_cells() {
    let mesh = turned(Vec3::new(0.5, 0.4, 0.3));
    assert_eq!(rig(&mesh, 30).0.to_postcard().ok(), rig(&mesh.clone(), 30).0.to_postcard().ok());
    // And in proportion at another scale.
    let large = Mesh { positions: mesh.positions.iter().map(|p| *p * 1024.0).collect(), ..mesh.clone() };
    let (one, other) = (rig(&mesh, 30).1, rig(&large, 30).1);
    for (a, b) in one.facets.iter().zip(&other.facets) {
        assert_eq!(a.pair, b.pair);
        assert!((a.area * 1024.0 * 1024.0).distance(b.area) < 1e-4 * b.area.length());
    }
    for (a, b) in one.volumes.iter().zip(&other.volumes) {
        assert!((b / a / 1024f32.powi(3) - 1.0).abs() < 1e-4);
    }
}
