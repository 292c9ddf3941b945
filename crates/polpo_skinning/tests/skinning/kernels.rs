//! The CPU kernels: exact on rigid motions, silent on degenerate normals, and inside their bounds.

use crate::body::{Body, Random, SIZE, tube};
use glam::{Quat, Vec3};
use polpo_skinning::bounds::skinned_aabb;
use polpo_skinning::cpu::{SkinnedVertices, skin};
use polpo_skinning::{Binding, ParticleTransform, RestMesh};

struct Skinned {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    tangents: Vec<[f32; 4]>,
}

fn skinned(body: &Body, transforms: &[ParticleTransform]) -> Skinned {
    let mut out = Skinned {
        positions: vec![[f32::NAN; 3]; body.positions.len()],
        normals: vec![[f32::NAN; 3]; body.positions.len()],
        tangents: body.tangents.clone(),
    };
    let written = skin(
        &body.binding,
        transforms,
        SkinnedVertices { positions: &mut out.positions, normals: Some(&mut out.normals), tangents: Some(&mut out.tangents) },
    );
    assert!(written);
    out
}

#[test]
fn rigid_motion_moves_positions_normals_and_tangents_rigidly() {
    // 100 m from the mesh's origin, as modelling tools leave meshes.
    let body = tube(20, 7, Vec3::new(100.0, -50.0, 30.0));
    let mut random = Random(1);
    for _ in 0..20 {
        let (rotation, center) = (random.rotation(), 10.0 * random.vector());
        let origin = body.binding.origin();
        let transforms: Vec<_> = body
            .particles
            .iter()
            .zip(body.binding.rest_particles())
            .map(|(&particle, &rest)| {
                let position = center + rotation.mul_vec3(particle - origin);
                ParticleTransform::new(position, rotation, 1.0, rest)
            })
            .collect();
        let out = skinned(&body, &transforms);
        for (vertex, rest) in body.positions.iter().enumerate() {
            let expected = center + rotation.mul_vec3(Vec3::from(*rest) - origin);
            let error = expected.distance(out.positions[vertex].into());
            assert!(error < 2e-6 * SIZE, "vertex {vertex}: off by {error}");
            let normal = rotation.mul_vec3(body.normals[vertex].into());
            assert!(normal.distance(out.normals[vertex].into()) < 2e-6);
            let tangent = rotation.mul_vec3(Vec3::X);
            let [x, y, z, w] = out.tangents[vertex];
            assert!(tangent.distance(Vec3::new(x, y, z)) < 2e-6);
            assert_eq!(w, -1.0);
        }
    }
}

#[test]
fn rest_pose_leaves_the_rest_mesh() {
    let body = tube(20, 7, Vec3::ZERO);
    let transforms = vec![ParticleTransform::IDENTITY; body.particles.len()];
    let out = skinned(&body, &transforms);
    for (vertex, rest) in body.positions.iter().enumerate() {
        let position = Vec3::from(out.positions[vertex]) + body.binding.origin();
        assert!(position.distance((*rest).into()) < 5e-7 * SIZE);
        assert!(Vec3::from(out.normals[vertex]).distance(body.normals[vertex].into()) < 1e-6);
    }
}

#[test]
fn opposite_rotations_leave_the_rest_normal() {
    let mesh = RestMesh { positions: &[[0.0; 3]], normals: &[[0.0, 1.0, 0.0]], tangents: &[] };
    // 65535 is odd, so halves cannot cancel exactly: three quarter turns and their opposites do it with 21845 units each.
    let thirds = [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0];
    let binding = Binding::new(mesh, &[Vec3::ZERO; 3], [([0, 1, 2, 0], thirds)].into_iter()).expect("valid binding");
    let root = 0.75f32.sqrt();
    let turns = [(0.0, 1.0), (root, 0.5), (root, -0.5)]
        .map(|(x, w)| ParticleTransform::new(Vec3::ZERO, Quat::from_xyzw(x, 0.0, 0.0, w), 1.0, Vec3::ZERO));
    let (mut position, mut normal) = ([[0.0; 3]], [[9.0; 3]]);
    let out = SkinnedVertices { positions: &mut position, normals: Some(&mut normal), tangents: None };
    assert!(skin(&binding, &turns, out));
    assert_eq!(normal, [[0.0, 1.0, 0.0]]);
}

#[test]
fn bounds_hold_every_vertex_and_stay_tight() {
    let body = tube(30, 9, Vec3::new(5.0, 0.0, 0.0));
    let mut random = Random(7);
    for round in 0..200 {
        let transforms = body.random_pose(&mut random, 0.02 * round as f32);
        let aabb = skinned_aabb(&body.binding, &transforms).expect("finite pose");
        let out = skinned(&body, &transforms);
        for position in out.positions {
            let position = Vec3::from(position);
            assert!(position.cmpge(aabb.min).all() && position.cmple(aabb.max).all(), "round {round}: {position} outside {aabb:?}");
        }
    }
    // At rest the images of the followers' boxes are the mesh's own box.
    let at_rest = vec![ParticleTransform::IDENTITY; body.particles.len()];
    let aabb = skinned_aabb(&body.binding, &at_rest).expect("finite pose");
    let mesh = body
        .positions
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), &position| (min.min(position.into()), max.max(position.into())));
    let origin = body.binding.origin();
    assert!((aabb.min + origin).distance(mesh.0) < 1e-4 * SIZE);
    assert!((aabb.max + origin).distance(mesh.1) < 1e-4 * SIZE);
}

#[test]
fn bounds_of_a_broken_pose_are_none() {
    let body = tube(5, 4, Vec3::ZERO);
    let mut transforms = vec![ParticleTransform::IDENTITY; 4];
    assert!(skinned_aabb(&body.binding, &transforms[..3]).is_none());
    transforms[2] = ParticleTransform::new(Vec3::NAN, Quat::IDENTITY, 1.0, Vec3::ZERO);
    assert!(skinned_aabb(&body.binding, &transforms).is_none());
}
