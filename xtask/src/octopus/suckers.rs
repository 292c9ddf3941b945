//! Suckers: two rows along the lower side of every arm, each one a vertex of its own, raised a little.

use glam::{DQuat, DVec3};
use libm::{cos, sin};

use super::remesh::Remesh;
use super::shape::Shape;

/// Half the angle between the two rows, seen from the arm's middle \[rad\].
const SPREAD: f64 = 0.62;
/// Distance of a row's suckers and their height, in arm radii.
const PITCH: f64 = 1.9;
const HEIGHT: f64 = 0.10;
/// Suckers start where the web ends, and the tip has none.
const FROM: f64 = 0.10;
const TO: f64 = 0.97;

/// A sucker: where it is on the skin, and the arm's radius there \[m\].
#[derive(Clone, Copy)]
pub(crate) struct Sucker {
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
}

/// Places the suckers and gives each a vertex of the mesh.
pub(crate) fn place(shape: &Shape, mesh: &mut Remesh) -> Vec<Sucker> {
    let mut suckers = Vec::new();
    for arm in &shape.arms {
        let spacing = arm[0].centre.distance(arm[1].centre);
        let (mut at, mut left) = (FROM * (arm.len() - 1) as f64, true);
        while at < TO * (arm.len() - 1) as f64 {
            let joint = arm[at as usize];
            let next = arm[(at as usize + 1).min(arm.len() - 1)];
            let t = at.fract();
            let angle = if left { SPREAD } else { -SPREAD };
            let turn = DQuat::from_xyzw(
                joint.along.x * sin(angle / 2.0),
                joint.along.y * sin(angle / 2.0),
                joint.along.z * sin(angle / 2.0),
                cos(angle / 2.0),
            );
            let middle = joint.centre.lerp(next.centre, t);
            let radius = joint.radius + (next.radius - joint.radius) * t;
            let centre = shape.project(middle + turn * joint.below * radius);
            mesh.pin(centre, shape);
            suckers.push(Sucker { centre, radius });
            at += 0.5 * PITCH * radius / spacing;
            left = !left;
        }
    }
    suckers
}

/// Raises the suckers and gives the normals of the raised skin.
pub(crate) fn raise(shape: &Shape, positions: &mut [DVec3], triangles: &[[u32; 3]], suckers: &[Sucker]) -> Vec<DVec3> {
    let smooth: Vec<DVec3> = positions.iter().map(|&p| shape.normal(p)).collect();
    for sucker in suckers {
        let own = (0..positions.len()).find(|&v| positions[v] == sucker.centre);
        if let Some(v) = own {
            positions[v] += smooth[v] * (HEIGHT * sucker.radius);
        }
    }
    let mut faceted = vec![DVec3::ZERO; positions.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        for &v in t {
            faceted[v as usize] += (b - a).cross(c - a);
        }
    }
    // The exact normal where the skin is smooth, the mesh's own where suckers stand out of it.
    let mixed = smooth.iter().zip(&faceted).map(|(s, f)| (*s + f.normalize_or_zero()).normalize_or(*s));
    mixed.collect()
}
