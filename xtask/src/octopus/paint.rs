//! The skin's colours, one a vertex: coral arms, a magenta mantle, mottled; pale below, with suckers; golden eyes with a slit pupil.

use glam::DVec3;
use libm::{floor, pow};

use super::arms::ramp;
use super::eyes::{self, Part};
use super::shape::Shape;
use super::suckers::Sucker;

const CORAL: [u8; 3] = [242, 98, 52];
const MAGENTA: [u8; 3] = [196, 30, 78];
const PLUM: [u8; 3] = [104, 16, 58];
const PEACH: [u8; 3] = [255, 176, 130];
const CREAM: [u8; 3] = [255, 238, 214];
const ROSE: [u8; 3] = [222, 92, 88];
const GOLD: [u8; 3] = [255, 204, 64];
const IVORY: [u8; 3] = [255, 246, 220];
const SHADOW: [u8; 3] = [58, 8, 36];
const INK: [u8; 3] = [16, 8, 20];

/// Linear RGB of every vertex.
pub(crate) fn paint(shape: &Shape, positions: &[DVec3], suckers: &[Sucker]) -> Vec<DVec3> {
    let mut colors: Vec<DVec3> = positions.iter().map(|&p| eye(p).unwrap_or_else(|| skin(shape, p))).collect();
    for sucker in suckers {
        for (color, position) in colors.iter_mut().zip(positions) {
            let distance = position.distance(sucker.centre) / sucker.radius;
            *color = linear(CREAM).lerp(*color, ramp(0.15, 0.4, distance));
        }
    }
    colors
}

fn skin(shape: &Shape, p: DVec3) -> DVec3 {
    let normal = shape.normal(p);
    let (_, along, joint) = shape.nearest_arm(p);
    let on_arm = 1.0 - ramp(0.01, 0.06, p.distance(joint.centre) - joint.radius);

    let height = ramp(-0.05, 0.42, p.y);
    let mut color = linear(CORAL).lerp(linear(MAGENTA), height);
    // Arms glow towards their tips, the back is in shade.
    color = color.lerp(linear(MAGENTA), on_arm * ramp(0.45, 1.0, along) * 0.75);
    let back = ramp(0.1, 1.0, normal.dot(DVec3::new(0.0, 0.35, -0.94)));
    color = color.lerp(linear(PLUM), 0.55 * back * (1.0 - on_arm));

    // Two sizes of spots, on the upper side.
    let above = if on_arm > 0.5 { ramp(-0.2, 0.5, -normal.dot(joint.below)) } else { 1.0 };
    color = color.lerp(linear(PLUM), 0.80 * above * spot(p, 0.105, 0.36));
    color = color.lerp(linear(PEACH), 0.40 * above * spot(p + DVec3::splat(3.7), 0.10, 0.24));

    // The lower side of the arms is pale.
    let below = ramp(0.05, 0.55, (p - joint.centre).normalize_or_zero().dot(joint.below)) * on_arm;
    color.lerp(linear(PEACH).lerp(linear(ROSE), 0.35), below * ramp(0.02, 0.12, along))
}

/// The colour of an eye, or nothing beside it.
fn eye(p: DVec3) -> Option<DVec3> {
    let part = eyes::part(p)?;
    Some(linear(match part {
        Part::Pupil => INK,
        Part::Iris => GOLD,
        Part::White => IVORY,
        Part::Lid => SHADOW,
    }))
}

/// Round spots scattered one a cell of a grid with side `size`: 1 in a spot, 0 outside, soft between. `radius` in cells.
fn spot(p: DVec3, size: f64, radius: f64) -> f64 {
    let at = p / size;
    let cell = DVec3::new(floor(at.x), floor(at.y), floor(at.z));
    let mut nearest = f64::INFINITY;
    for dx in -1..=1 {
        for dy in -1..=1 {
            for dz in -1..=1 {
                let corner = cell + DVec3::new(dx.into(), dy.into(), dz.into());
                let jitter = DVec3::new(noise(corner, 1), noise(corner, 2), noise(corner, 3));
                let scale = 0.7 + 0.6 * noise(corner, 4);
                nearest = nearest.min(at.distance(corner + jitter) / scale);
            }
        }
    }
    1.0 - ramp(radius * 0.55, radius * 1.25, nearest)
}

/// A number in 0..1 for every cell and channel, from an integer hash (the finaliser of SplitMix64).
fn noise(cell: DVec3, channel: u64) -> f64 {
    let word = |x: f64| x as i64 as u64;
    let mut h = channel
        ^ word(cell.x).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ word(cell.y).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
        ^ word(cell.z).wrapping_mul(0x1656_67b1_9e37_79f9);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((h ^ (h >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// sRGB to linear.
fn linear(srgb: [u8; 3]) -> DVec3 {
    let channel = |c: u8| {
        let c = f64::from(c) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { pow((c + 0.055) / 1.055, 2.4) }
    };
    DVec3::from_array(srgb.map(channel))
}
