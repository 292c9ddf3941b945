//! A soft body of many groups, for what only such a body shows.

use glam::Vec3A;
use polpo_solver::Stiffness;

use crate::body::Body;

/// Numbers in −1 … 1 from a seed, the same everywhere (splitmix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn signed(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (((z ^ (z >> 31)) >> 40) as f32) / (1u64 << 23) as f32 - 1.0
    }

    pub(crate) fn vector(&mut self) -> Vec3A {
        Vec3A::new(self.signed(), self.signed(), self.signed())
    }
}

/// A lattice of `size` balls of 1 kg, 0.1 m apart, uneven by `uneven` \[m\], joined along axes and face diagonals.
pub(crate) fn lattice(size: [u32; 3], uneven: f32) -> Body {
    let mut random = Random(1);
    let mut places = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                places.push(Vec3A::new(x as f32, y as f32, z as f32) * 0.1 + random.vector() * uneven);
            }
        }
    }
    let mut pairs = Vec::new();
    for j in 0..places.len() {
        for i in 0..j {
            if places[i].distance(places[j]) < 0.15 {
                pairs.push([i as u32, j as u32]);
            }
        }
    }
    let mut body = Body::balls(places, 0.05);
    body.join(&pairs);
    body
}

/// As stiff as the plugin's bodies are by default.
pub(crate) fn default_stiffness(body: &mut Body) {
    body.shape = Stiffness::hertz(25.0);
    (body.tension, body.compression) = (Stiffness::hertz(40.0), Stiffness::hertz(40.0));
    body.torsion = Stiffness::hertz(15.0);
}
