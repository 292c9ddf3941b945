//! A number that says whether two runs came to the same state, to the bit.

use bevy::prelude::*;

use crate::Particles;

/// FNV-1a over the bits of the positions, rotations and velocities of `bodies`, in the order given, and where each body is.
pub fn state_hash<'a>(bodies: impl IntoIterator<Item = (&'a Transform, &'a Particles)>) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut eat = |value: f32| {
        for byte in value.to_bits().to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    for (transform, particles) in bodies {
        transform.translation.to_array().into_iter().for_each(&mut eat);
        for list in [&particles.position, &particles.velocity, &particles.angular_velocity] {
            list.iter().flat_map(|v| v.to_array()).for_each(&mut eat);
        }
        particles.rotation.iter().flat_map(|q| q.to_array()).for_each(&mut eat);
    }
    hash
}
