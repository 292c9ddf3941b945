//! A number that says whether two runs came to the same state, to the bit.

use bevy::prelude::*;

use crate::Particles;

/// FNV-1a over the bits of the positions, rotations and velocities of `bodies` and where each body is. The order in which they come does not matter: queries go by archetype, and which component came first is
/// no part of the state.
pub fn state_hash<'a>(bodies: impl IntoIterator<Item = (&'a Transform, &'a Particles)>) -> u64 {
    let mut hashes: Vec<u64> = bodies.into_iter().map(|(transform, particles)| body_hash(transform, particles)).collect();
    hashes.sort_unstable();
    let mut hash = Fnv::default();
    hashes.into_iter().for_each(|h| hash.eat(&h.to_le_bytes()));
    hash.0
}

fn body_hash(transform: &Transform, particles: &Particles) -> u64 {
    let mut hash = Fnv::default();
    hash.eat_all(transform.translation.to_array());
    for list in [&particles.position, &particles.velocity, &particles.angular_velocity] {
        hash.eat_all(list.iter().flat_map(|v| v.to_array()));
    }
    hash.eat_all(particles.rotation.iter().flat_map(|q| q.to_array()));
    hash.0
}

/// FNV-1a.
pub(crate) struct Fnv(pub(crate) u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    pub(crate) fn eat(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    pub(crate) fn eat_all(&mut self, values: impl IntoIterator<Item = f32>) {
        for value in values {
            self.eat(&value.to_bits().to_le_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Vec3A;

    #[test]
    fn the_order_of_the_bodies_does_not_matter_but_every_bit_does() {
        let body = |x: f32| {
            let rest = [polpo_solver::ParticleRest { position: Vec3A::X * x, frame: Quat::IDENTITY, radii: Vec3A::ONE, mass: 1.0 }];
            (Transform::from_xyz(x, 0.0, 0.0), Particles(polpo_solver::Particles::new(&rest).unwrap()))
        };
        let hash = |list: &[(Transform, Particles)]| state_hash(list.iter().map(|(t, p)| (t, p)));
        let (a, b) = (body(1.0), body(2.0));
        let both = hash(&[a.clone(), b.clone()]);
        assert_eq!(both, hash(&[b.clone(), a.clone()]));
        let mut other = b;
        let spin = &mut other.1.angular_velocity[0].z;
        *spin = f32::from_bits(spin.to_bits() + 1);
        assert_ne!(both, hash(&[a, other]));
    }
}
