//! A small body to skin: a bent tube of vertices around a curve of particles, offset from the origin, with random poses.

use glam::{Quat, Vec3};
use polpo_skinning::{Binding, ParticleTransform, RestMesh};

/// The tube's length, by which errors are measured [m].
pub(crate) const SIZE: f32 = 4.0;

/// xorshift: the tests need no better randomness, but the same on every machine.
pub(crate) struct Random(pub(crate) u32);

impl Random {
    /// Uniform in −1..1.
    pub(crate) fn signed(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        (self.0 >> 8) as f32 / (1u32 << 23) as f32 - 1.0
    }

    /// A vector in the cube −1..1.
    pub(crate) fn vector(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    /// A rotation, any.
    pub(crate) fn rotation(&mut self) -> Quat {
        Quat::from_xyzw(self.signed(), self.signed(), self.signed(), self.signed() + 1e-3).normalize()
    }
}

/// Rest positions of the mesh's vertices and particles, and the binding of the two.
pub(crate) struct Body {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) normals: Vec<[f32; 3]>,
    pub(crate) tangents: Vec<[f32; 4]>,
    pub(crate) particles: Vec<Vec3>,
    pub(crate) binding: Binding,
}

/// A tube of `rings` rings of 12 vertices and `particles` particles, its middle at `offset`; a vertex follows its four nearest.
pub(crate) fn tube(rings: usize, particles: usize, offset: Vec3) -> Body {
    tube_following::<4>(rings, particles, offset)
}

/// The same with vertices that follow their `N` nearest.
pub(crate) fn tube_following<const N: usize>(rings: usize, particles: usize, offset: Vec3) -> Body {
    let along = |i: usize, n: usize| SIZE * (i as f32 / (n - 1) as f32 - 0.5);
    let particles: Vec<Vec3> = (0..particles)
        .map(|i| {
            let x = along(i, particles);
            offset + Vec3::new(x, 0.1 * x * x, 0.0)
        })
        .collect();
    let mut positions = Vec::new();
    let mut normals = Vec::new();
    let mut tangents = Vec::new();
    let mut influences = Vec::new();
    for ring in 0..rings {
        for side in 0..12 {
            let angle = side as f32 * core::f32::consts::TAU / 12.0;
            let normal = Vec3::new(0.0, angle.cos(), angle.sin());
            let x = along(ring, rings);
            let position = offset + Vec3::new(x, 0.1 * x * x, 0.0) + 0.3 * normal;
            positions.push(position.to_array());
            // One zero normal: it has to survive.
            let normal = if (ring, side) == (0, 0) { Vec3::ZERO } else { normal };
            normals.push(normal.to_array());
            tangents.push([1.0, 0.0, 0.0, -1.0]);
            influences.push(nearest::<N>(position, &particles));
        }
    }
    let mesh = RestMesh { positions: &positions, normals: &normals, tangents: &tangents };
    let binding = Binding::new(mesh, &particles, influences.into_iter()).expect("valid binding");
    Body { positions, normals, tangents, particles, binding }
}

fn nearest<const N: usize>(position: Vec3, particles: &[Vec3]) -> ([u32; N], [f32; N]) {
    let mut order: Vec<u32> = (0..particles.len() as u32).collect();
    let distance = |i: u32| particles[i as usize].distance(position);
    order.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let mut indices = [order[0]; N];
    let mut weights = [0.0; N];
    for (slot, &particle) in order.iter().take(N).enumerate() {
        indices[slot] = particle;
        weights[slot] = 1.0 / (0.1 + distance(particle));
    }
    let sum: f32 = weights.iter().sum();
    (indices, weights.map(|weight| weight / sum))
}

impl Body {
    /// Every particle somewhere within `spread` [m] of its rest place (relative to the tube's middle), turned any way.
    pub(crate) fn random_pose(&self, random: &mut Random, spread: f32) -> Vec<ParticleTransform> {
        let rest = self.binding.rest_particles();
        rest.iter()
            .map(|&rest| {
                let position = rest + spread * random.vector();
                ParticleTransform::new(position, random.rotation(), 1.0, rest)
            })
            .collect()
    }
}
