//! Bodies and noise for the kernels' tests.

use fearless_simd::Level;
use glam::{Quat, Vec3A};

use crate::{ParticleRest, Particles, quat_exp, quat_log};

/// A small generator (xorshift*), so that tests need no dependency and no clock.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in −1 … 1.
    pub(crate) fn signed(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    pub(crate) fn vector(&mut self) -> Vec3A {
        Vec3A::new(self.signed(), self.signed(), self.signed())
    }
}

/// `n` balls of `radius` on the x axis, `spacing` apart, 1 kg each.
pub(crate) fn line(n: usize, spacing: f32, radius: f32) -> Particles {
    let rest: Vec<ParticleRest> = (0..n)
        .map(|i| ParticleRest { position: Vec3A::X * (i as f32 * spacing), frame: Quat::IDENTITY, radii: Vec3A::splat(radius), mass: 1.0 })
        .collect();
    Particles::new(&rest).unwrap()
}

/// A 3×3×2 lattice of unequal ellipsoids with face and diagonal edges.
pub(crate) fn blob() -> (Particles, Vec<[u32; 2]>) {
    let mut random = Random(42);
    let mut rest = Vec::new();
    for z in 0..2 {
        for y in 0..3 {
            for x in 0..3 {
                rest.push(ParticleRest {
                    position: Vec3A::new(x as f32, y as f32, z as f32) * 0.2 + random.vector() * 0.02,
                    frame: quat_exp(random.vector() * 2.0),
                    radii: Vec3A::splat(0.1) + random.vector() * 0.05,
                    mass: 1.0 + 0.5 * random.signed(),
                });
            }
        }
    }
    let mut pairs = Vec::new();
    for j in 0..rest.len() {
        for i in 0..j {
            if rest[i].position.distance(rest[j].position) < 0.31 {
                pairs.push([i as u32, j as u32]);
            }
        }
    }
    (Particles::new(&rest).unwrap(), pairs)
}

/// Displaces and turns every particle at random, by about a third of the lattice's spacing.
pub(crate) fn scramble(p: &mut Particles, seed: u64) {
    let mut random = Random(seed);
    for i in 0..p.len() {
        p.position[i] += random.vector() * 0.07;
        p.rotation[i] = (quat_exp(random.vector() * 0.5) * p.rotation[i]).normalize();
    }
}

/// Moves and turns every particle by up to `size` of its radius, or of a radian, and gives it as much speed.
pub(crate) fn stir(p: &mut Particles, seed: u64, size: f32) {
    let mut random = Random(seed);
    for i in 0..p.len() {
        let radius = p.radii[i].x;
        p.position[i] += random.vector() * (size * radius);
        p.rotation[i] = quat_exp(random.vector() * size) * p.rotation[i];
        p.velocity[i] = random.vector() * size;
        p.angular_velocity[i] = random.vector() * size;
    }
}

/// Positions and rotations that differ by no more than `tolerance` \[m, rad\], velocities by a hundred, spins by a thousand times that.
pub(crate) fn assert_close(a: &Particles, b: &Particles, tolerance: f32) {
    assert_eq!(a.rigid_push.len(), b.rigid_push.len());
    for i in 0..a.len() {
        let apart = a.position[i].distance(b.position[i]);
        assert!(apart < tolerance, "particle {i}: {apart} m");
        let turned = quat_log(a.rotation[i] * b.rotation[i].inverse()).length();
        assert!(turned < 10.0 * tolerance, "particle {i}: {turned} rad");
        assert!(a.velocity[i].distance(b.velocity[i]) < 100.0 * tolerance, "particle {i}");
        assert!(a.angular_velocity[i].distance(b.angular_velocity[i]) < 1000.0 * tolerance, "particle {i}");
    }
    for (a, b) in a.rigid_push.iter().zip(&b.rigid_push) {
        assert!(a[0].distance(b[0]) < 100.0 * tolerance && a[1].distance(b[1]) < 1000.0 * tolerance);
    }
}

/// That `solve` gives the same bits from `p` with every instruction set that this processor has.
pub(crate) fn same_at_every_level(p: &Particles, mut solve: impl FnMut(&mut Particles, Level)) {
    let mut levels = vec![Level::baseline(), Level::new()];
    #[cfg(target_arch = "x86_64")]
    {
        let level = Level::new();
        levels.extend(level.as_sse4_2().map(Level::Sse4_2));
        levels.extend(level.as_avx2().map(Level::Avx2));
        levels.extend(level.as_avx512().map(Level::Avx512));
    }
    let mut first = None;
    for level in levels {
        let mut p = p.clone();
        solve(&mut p, level);
        let vectors = [&p.position, &p.velocity, &p.angular_velocity].into_iter().flatten().flat_map(|v| v.to_array());
        let bits: Vec<u32> = vectors.chain(p.rotation.iter().flat_map(|q| q.to_array())).map(f32::to_bits).collect();
        assert!(*first.get_or_insert(bits.clone()) == bits, "{level:?}");
    }
}
