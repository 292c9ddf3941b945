//! Random bodies for the property tests, and runs that are the same each time.
#![allow(dead_code, reason = "each test uses a part of it")]

use glam::{Quat, Vec3A};
use polpo_solver::{ParticleRest, Particles, quat_exp};
use proptest::test_runner::{Config, RngSeed};

/// `cases` cases from a fixed seed, without a file of failures.
pub(crate) fn cases(cases: u32) -> Config {
    Config { cases, failure_persistence: None, rng_seed: RngSeed::Fixed(7), ..Config::default() }
}

/// A small generator (splitmix64): a whole scene from one number of proptest's.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in 0 … 1.
    pub(crate) fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in the cube −1 … 1.
    pub(crate) fn vector(&mut self) -> Vec3A {
        Vec3A::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    pub(crate) fn rotation(&mut self) -> Quat {
        quat_exp(self.vector() * 3.0).normalize()
    }

    /// From `low` to `high`, evenly in the exponent.
    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        low * libm::powf(high / low, self.unit())
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f32) as usize).min(n - 1)
    }
}

/// `n` particles at random in a cube of ±0.5 m, of 0.1 to 10 kg, flat, long and round; balls only if `round`.
pub(crate) fn cloud(random: &mut Random, n: usize, round: bool) -> Particles {
    let rest: Vec<ParticleRest> = (0..n)
        .map(|_| {
            let radius = random.between(0.05, 0.3);
            let radii = if round { Vec3A::ONE } else { Vec3A::ONE + random.vector() * 0.8 };
            ParticleRest {
                position: random.vector() * 0.5,
                frame: random.rotation(),
                radii: radii * radius,
                mass: random.between(0.1, 10.0),
            }
        })
        .collect();
    Particles::new(&rest).expect("sound particles")
}

/// Every particle displaced by up to `way` \[m\], turned by up to √3·`angle` \[rad\], and in motion.
pub(crate) fn stir(random: &mut Random, p: &mut Particles, way: f32, angle: f32) {
    for i in 0..p.len() {
        p.previous_position[i] = p.position[i];
        p.previous_rotation[i] = p.rotation[i];
        p.position[i] += random.vector() * way;
        p.rotation[i] = (quat_exp(random.vector() * angle) * p.rotation[i]).normalize();
        p.velocity[i] = random.vector() * 3.0;
        p.angular_velocity[i] = random.vector() * 3.0;
    }
}

/// All pairs of `n` particles nearer than `reach` at rest, and a chain through all.
pub(crate) fn pairs(p: &Particles, reach: f32) -> Vec<[u32; 2]> {
    let mut pairs = Vec::new();
    for j in 1..p.len() {
        for i in 0..j {
            if i + 1 == j || p.rest_position[i].distance(p.rest_position[j]) < reach {
                pairs.push([i as u32, j as u32]);
            }
        }
    }
    pairs
}

/// What a constraint did to the momentum of a body, as shares of what it handed round and, since that is a difference of rounded numbers, of what the particles carry one by one.
#[derive(Debug)]
pub(crate) struct Loss {
    /// |Σ m·Δv| over Σ m·(|Δv| + |v|).
    pub(crate) linear: f32,
    /// |Σ m·x×Δv + I·Δω| over the same with amounts, x where the constraint acted, about the centre of mass.
    pub(crate) angular: f32,
    /// Whether it did anything.
    pub(crate) acted: bool,
}

/// Compares `after` with `before`, in `f64`. Impulses that pinned particles took up count.
pub(crate) fn loss(before: &Particles, after: &Particles) -> Loss {
    let n = before.len();
    let mass: f64 = before.mass.iter().map(|&m| f64::from(m)).sum();
    let center = (0..n).map(|i| before.position[i].as_dvec3() * f64::from(before.mass[i])).sum::<glam::DVec3>() / mass;
    let (mut linear, mut angular) = (glam::DVec3::ZERO, glam::DVec3::ZERO);
    let (mut linear_scale, mut angular_scale, mut acted) = (0.0, 0.0, false);
    for i in 0..n {
        let p = (after.velocity[i] - before.velocity[i]).as_dvec3() * f64::from(before.mass[i]);
        let l = (before.position[i].as_dvec3() - center).cross(p);
        let s = (after.angular_velocity[i] - before.angular_velocity[i]).as_dvec3() * f64::from(before.inertia[i]);
        linear += p;
        acted |= p.length() + s.length() > 0.0;
        let (v, w) = (before.velocity[i].as_dvec3().length(), before.angular_velocity[i].as_dvec3().length());
        let (mv, r) = (v * f64::from(before.mass[i]), before.position[i].as_dvec3().distance(center));
        linear_scale += p.length() + mv;
        angular += l + s;
        angular_scale += l.length() + s.length() + r * mv + w * f64::from(before.inertia[i]);
    }
    for reaction in &after.reaction {
        linear += reaction.as_dvec3();
    }
    let share = |a: f64, b: f64| if b > 0.0 { (a / b) as f32 } else { 0.0 };
    Loss { linear: share(linear.length(), linear_scale), angular: share(angular.length(), angular_scale), acted }
}
