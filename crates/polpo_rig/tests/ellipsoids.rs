//! Ellipsoids lie in the body, reach its skin, share out its mass, and follow its shape and not its triangles.

mod common;

use common::{block, cubes, grid, rig, spacing};
use glam::{DMat3, DVec3, IVec3, Vec3};
use polpo_rig::Mesh;

/// A flat box, turned so that no axis is that of a coordinate.
fn turned_box() -> impl Fn(Vec3) -> Vec3 {
    let along = Vec3::new(2.0, 1.0, 0.5).normalize();
    let across = along.cross(Vec3::Y).normalize();
    move |p: Vec3| along * p.x + across * p.y * 0.6 + along.cross(across) * p.z * 0.3
}

#[test]
fn a_dense_corner_does_not_tilt_the_axes() {
    // The same box twice: the second has one corner of eight cut 10 times as finely.
    let place = turned_box();
    let even = cubes(&grid(IVec3::ZERO, IVec3::splat(2)), 2, |p| place(p * 0.5));
    let mut dense = even.clone();
    let corner: Vec<usize> = (0..even.triangles.len())
        .filter(|&t| even.triangles[t].iter().all(|&v| even.positions[v as usize].distance(place(Vec3::ONE)) < 0.6))
        .collect();
    assert!(!corner.is_empty());
    for t in corner {
        let [a, b, c] = dense.triangles[t].map(|v| dense.positions[v as usize]);
        let base = dense.positions.len() as u32;
        let row = |i: u32| i * (i + 1) / 2;
        for i in 0..=10_u32 {
            for j in 0..=i {
                let p = a + (b - a) * ((i - j) as f32 / 10.0) + (c - a) * (j as f32 / 10.0);
                dense.positions.push(p);
                dense.normals.push(Vec3::Y);
                if i < 10 {
                    let at = base + row(i) + j;
                    let below = base + row(i + 1) + j;
                    let small = [at, below, below + 1];
                    if small != [at, at, at] {
                        dense.triangles.push(small);
                    }
                    if j < i {
                        dense.triangles.push([at, below + 1, at + 1]);
                    }
                }
            }
        }
        dense.triangles[t] = [0, 0, 0];
    }
    let along = place(Vec3::X).normalize();
    let axis = |mesh: &Mesh| {
        let particle = rig(mesh, 1).particles[0];
        let longest = (0..3).max_by(|&i, &j| particle.radii[i].total_cmp(&particle.radii[j])).unwrap_or(0);
        particle.frame * Vec3::AXES[longest]
    };
    // For the small angles that matter here the sine will do.
    let tilt = |axis: Vec3| axis.cross(along).length().min(1.0) * 57.3;
    assert!(tilt(axis(&even)) < 0.5);
    assert!(tilt(axis(&dense)) < 1.0, "tilted by {}°", tilt(axis(&dense)));
    // The mesh is a trap: counting vertices would fall into it.
    assert!(tilt(vertex_axis(&dense)) > 1.5, "only {}°", tilt(vertex_axis(&dense)));
}

/// The longest axis of the cloud of vertices, by power iteration.
fn vertex_axis(mesh: &Mesh) -> Vec3 {
    let points: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
    let mean = points.iter().sum::<DVec3>() / points.len() as f64;
    let covariance = points.iter().fold(DMat3::ZERO, |sum, p| {
        let d = *p - mean;
        sum + DMat3::from_cols(d * d.x, d * d.y, d * d.z)
    });
    let mut axis = DVec3::new(0.9, 0.3, 0.2);
    for _ in 0..500 {
        axis = (covariance * axis).normalize();
    }
    axis.as_vec3()
}

#[test]
fn one_ellipsoid_fills_a_box() {
    let particle = rig(&block([2, 2, 2], 4, Vec3::new(3.0, 2.0, 1.0)), 1).particles[0];
    assert!(particle.position.distance(Vec3::new(1.5, 1.0, 0.5)) < 1e-3, "{particle:?}");
    let mut radii = particle.radii.to_array();
    radii.sort_by(f32::total_cmp);
    for (radius, half) in radii.into_iter().zip([0.5, 1.0, 1.5]) {
        assert!((radius / half - 1.0).abs() < 0.02, "{radius} for {half}");
    }
    assert!((particle.mass / 6000.0 - 1.0).abs() < 1e-4, "{} kg", particle.mass);
}

#[test]
fn particles_lie_on_the_middle_of_a_thin_limb() {
    let rig = rig(&block([20, 1, 1], 2, Vec3::new(4.0, 0.2, 0.2)), 10);
    for particle in &rig.particles {
        let off = particle.position.y.max(particle.position.z) - 0.1;
        assert!(off.abs() < 0.01, "{particle:?} is off the axis");
        let across = particle.frame.inverse() * Vec3::Y;
        let reach = (across * particle.radii).length();
        assert!((reach - 0.1).abs() < 0.02, "{particle:?} reaches {reach} across");
    }
}

#[test]
fn mass_is_volume_times_density() {
    let mesh = block([3, 2, 1], 2, Vec3::new(1.5, 1.0, 0.4));
    let settings = polpo_rig::Recipe { density: 250.0, ..common::settings(50) };
    let rig = polpo_rig::build_rig(&mesh, &settings).expect("a box can be rigged");
    let mass: f32 = rig.particles.iter().map(|p| p.mass).sum();
    assert!((mass / 150.0 - 1.0).abs() < 1e-4, "{mass} kg");
}

#[test]
fn ellipsoids_cover_the_skin_and_stay_in_it() {
    let sides = Vec3::new(2.0, 1.0, 0.5);
    let mesh = block([8, 4, 2], 4, sides);
    let rig = rig(&mesh, 80);
    let spacing = spacing(&rig);
    let bare = mesh.positions.iter().filter(|&&p| {
        let outside = |q: &polpo_rig::Particle| {
            let local = q.frame.inverse() * (p - q.position);
            let relative = (local / q.radii).length();
            local.length() * (1.0 - 1.0 / relative)
        };
        rig.particles.iter().all(|q| outside(q) > 0.1 * spacing)
    });
    let bare = bare.count() as f32 / mesh.positions.len() as f32;
    assert!(bare < 0.15, "{bare} of the skin is bare");
    for particle in &rig.particles {
        for normal in Vec3::AXES {
            let local = particle.frame.inverse() * normal;
            let reach = (local * particle.radii).length();
            let middle = particle.position.dot(normal);
            let side = sides.dot(normal);
            let over = (reach - middle).max(middle + reach - side);
            assert!(over < 0.5 * spacing, "{particle:?} sticks out by {over}");
        }
    }
}
