//! A soft body of many groups, for what only such a body shows.

use glam::{Quat, Vec3A};
use polpo_solver::{ParticleRest, Stiffness, quat_exp};

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

/// A head of 3×3×3 and eight arms of six, thinner towards their ends: 75 balls.
pub(crate) fn octopus() -> Body {
    let ball = |position: Vec3A, radius: f32| ParticleRest {
        position,
        frame: Quat::IDENTITY,
        radii: Vec3A::splat(radius),
        mass: 1000.0 * radius * radius * radius,
    };
    let head = lattice([3, 3, 3], 0.01);
    let mut rest: Vec<ParticleRest> = head.particles.position.iter().map(|&x| ball(x - Vec3A::splat(0.1), 0.05)).collect();
    let mut pairs = head.edges.pairs.clone();
    for arm in 0..8 {
        let along = quat_exp(Vec3A::Y * (arm as f32 * core::f32::consts::FRAC_PI_4)) * Vec3A::X - Vec3A::Y * 0.3;
        for k in 0..6 {
            let place = along * (0.16 + 0.08 * k as f32) - Vec3A::Y * 0.08;
            let this = rest.len() as u32;
            // The first ball of an arm holds on to the three of the head that are nearest, the others to the one before.
            let mut near: Vec<u32> = (0..27).collect();
            near.sort_by(|&i, &j| rest[i as usize].position.distance(place).total_cmp(&rest[j as usize].position.distance(place)));
            if k == 0 {
                pairs.extend(near[..3].iter().map(|&i| [i, this]));
            } else {
                pairs.push([this - 1, this]);
            }
            rest.push(ball(place, 0.045 - 0.005 * k as f32));
        }
    }
    let mut body = Body::new(&rest);
    body.join(&pairs);
    body
}

/// As stiff as the plugin's bodies are by default.
pub(crate) fn default_stiffness(body: &mut Body) {
    body.shape = Stiffness::hertz(25.0);
    (body.tension, body.compression) = (Stiffness::hertz(40.0), Stiffness::hertz(40.0));
    body.torsion = Stiffness::hertz(15.0);
}
