//! Noise without chance: the same on every machine.

use bevy::math::Vec3;

/// The powers of 1/g with g⁴ = g + 1: multiples of them, modulo 1, fill a cube evenly (Roberts' R3 sequence).
const EVEN: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];

/// The `i`th of points that fill the cube −1 … 1 evenly.
pub(crate) fn noise(i: usize) -> Vec3 {
    Vec3::from(EVEN.map(|even| (2.0 * (i as f64 * even).fract() - 1.0) as f32))
}
