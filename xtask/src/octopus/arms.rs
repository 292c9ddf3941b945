//! The eight arms: curves with a radius and a side that carries the suckers. Each has a character of its own.

use glam::{DQuat, DVec3};
use libm::{cos, sin};

use super::OctopusError;

/// Points along an arm's curve.
pub(crate) const POINTS: usize = 57;
/// Arms must stay this far apart \[m\]; where they leave the body they grow together in a web.
const GAP: f64 = 0.015;
const WEB: f64 = 0.3;

/// One point of an arm.
#[derive(Clone, Copy)]
pub(crate) struct Joint {
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
    /// Unit direction towards the tip.
    pub(crate) along: DVec3,
    /// Unit direction to the side with the suckers, across `along`.
    pub(crate) below: DVec3,
}

/// An arm's joints from root to tip, evenly spaced.
pub(crate) type Arm = Vec<Joint>;

/// How an arm differs from the others. Angles in turns.
struct Character {
    /// Where it leaves the body, counted from +x towards +z.
    heading: f64,
    /// Length \[m\].
    length: f64,
    /// Elevation at the root and in its middle, up is positive.
    root: f64,
    middle: f64,
    /// How far the end curls, up, and sideways (towards larger headings).
    curl_up: f64,
    curl_side: f64,
    /// Where the curl begins, as a share of the length.
    curl_from: f64,
    /// A sideways wave of the arm before the curl.
    wave: f64,
}

const fn arm(heading: f64, length: f64, elevation: [f64; 2], curl: [f64; 3], wave: f64) -> Character {
    let ([root, middle], [curl_up, curl_side, curl_from]) = (elevation, curl);
    Character { heading, length, root, middle, curl_up, curl_side, curl_from, wave }
}

const ARMS: [Character; 8] = [
    arm(0.065, 0.74, [-0.12, 0.015], [0.66, 0.16, 0.42], 0.035),
    arm(0.185, 0.70, [-0.14, 0.005], [0.14, -0.78, 0.46], -0.040),
    arm(0.312, 0.72, [-0.13, -0.040], [0.74, -0.08, 0.40], 0.035),
    arm(0.440, 0.78, [-0.09, 0.045], [0.52, 0.50, 0.42], -0.040),
    arm(0.562, 0.70, [-0.13, -0.055], [0.66, 0.14, 0.38], 0.040),
    arm(0.690, 0.76, [-0.14, -0.015], [0.22, -0.70, 0.44], -0.030),
    arm(0.812, 0.72, [-0.13, -0.035], [0.72, 0.06, 0.44], 0.035),
    arm(0.938, 0.75, [-0.14, 0.005], [0.18, 0.74, 0.46], -0.035),
];

/// The eight arms.
pub(crate) fn grow() -> Vec<Arm> {
    ARMS.iter().map(Character::grow).collect()
}

impl Character {
    fn grow(&self) -> Arm {
        let turn = std::f64::consts::TAU;
        let step = self.length / (POINTS - 1) as f64;
        let direction = |s: f64| {
            let curl = ramp(self.curl_from, 1.06, s);
            let curl = curl * (0.45 + 0.55 * curl);
            let settle = ramp(0.0, 0.55, s);
            let settle = settle * settle * (3.0 - 2.0 * settle);
            let elevation = self.root + (self.middle - self.root) * settle + self.curl_up * curl;
            let wave = self.wave * sin(turn * s) * (1.0 - curl);
            let heading = self.heading + wave + self.curl_side * curl;
            let (e, h) = (turn * elevation, turn * heading);
            DVec3::new(cos(e) * cos(h), sin(e), cos(e) * sin(h))
        };
        let start = DVec3::new(cos(turn * self.heading), 0.0, sin(turn * self.heading)) * 0.075;
        let mut centre = start - DVec3::Y * 0.02;
        let mut along = direction(0.0);
        let mut below = DVec3::NEG_Y.reject_from_normalized(along).normalize();
        let mut joints = Vec::with_capacity(POINTS);
        for i in 0..POINTS {
            let s = i as f64 / (POINTS - 1) as f64;
            joints.push(Joint { centre, radius: radius(s), along, below });
            centre += direction(s + 0.5 / (POINTS - 1) as f64) * step;
            let next = direction((s + 1.0 / (POINTS - 1) as f64).min(1.0));
            // Carried along without twist.
            below = (DQuat::from_rotation_arc(along, next) * below).reject_from_normalized(next).normalize();
            along = next;
        }
        joints
    }
}

/// Half an arm's thickness at a share of its length \[m\]: stout where it leaves the body, then an even taper.
fn radius(s: f64) -> f64 {
    let left = 1.0 - s;
    0.0110 + 0.036 * left * (0.60 + 0.40 * left)
}

/// 0 up to `from`, 1 from `to` on, even between.
pub(crate) fn ramp(from: f64, to: f64, x: f64) -> f64 {
    ((x - from) / (to - from)).clamp(0.0, 1.0)
}

/// Fails if two arms, or two places of one, come too near.
pub(crate) fn check_gaps(arms: &[Arm]) -> Result<(), OctopusError> {
    let share = |joint: usize| joint as f64 / (POINTS - 1) as f64;
    for (a, arm) in arms.iter().enumerate() {
        for (b, other) in arms.iter().enumerate().skip(a) {
            for (i, p) in arm.iter().enumerate() {
                for (j, q) in other.iter().enumerate() {
                    let in_web = share(i.min(j)) < WEB && a != b;
                    let spacing = arm[0].centre.distance(arm[1].centre);
                    let beside = a == b && spacing * i.abs_diff(j) as f64 <= 2.5 * (p.radius + q.radius);
                    let gap = p.centre.distance(q.centre) - p.radius - q.radius;
                    if gap < GAP && !in_web && !beside {
                        return Err(OctopusError::ArmsTouch { arm: a, at: share(i), other: b, other_at: share(j), gap });
                    }
                }
            }
        }
    }
    Ok(())
}
