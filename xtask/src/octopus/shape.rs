//! The octopus as an implicit function, negative inside: body parts that grow together smoothly.

use glam::{DMat3, DVec3};
use libm::{cos, sin};

use super::arms::{Arm, Joint, ramp};

/// The eyes: middle of the right one (its mirror image is the left one), radius, and where it looks \[m\].
pub(crate) const EYE: DVec3 = DVec3::new(0.080, 0.112, 0.074);
pub(crate) const EYE_RADIUS: f64 = 0.054;
pub(crate) const GAZE: DVec3 = DVec3::new(0.66, 0.22, 0.72);

/// Arm joints that share a bounding sphere.
const CHUNK: usize = 8;

pub(crate) struct Shape {
    pub(crate) arms: Vec<Arm>,
    chunks: Vec<Chunk>,
    lean: DMat3,
}

/// A stretch of an arm with a sphere around it.
struct Chunk {
    joints: Vec<Joint>,
    arm: usize,
    middle: DVec3,
    reach: f64,
}

impl Shape {
    pub(crate) fn new(arms: Vec<Arm>) -> Shape {
        let mut chunks = Vec::new();
        for (number, arm) in arms.iter().enumerate() {
            for start in (0..arm.len() - 1).step_by(CHUNK) {
                let joints = arm[start..=(start + CHUNK).min(arm.len() - 1)].to_vec();
                let middle = joints.iter().map(|j| j.centre).sum::<DVec3>() / joints.len() as f64;
                let reach = joints.iter().fold(0.0, |r: f64, j| r.max(j.centre.distance(middle) + j.radius));
                chunks.push(Chunk { joints, arm: number, middle, reach });
            }
        }
        let (s, c) = (sin(LEAN), cos(LEAN));
        let lean = DMat3::from_cols(DVec3::X, DVec3::new(0.0, c, -s), DVec3::new(0.0, s, c));
        Shape { arms, chunks, lean }
    }

    /// About the distance to the skin \[m\], negative inside.
    pub(crate) fn distance(&self, p: DVec3) -> f64 {
        let mirrored = DVec3::new(p.x.abs(), p.y, p.z);
        let in_mantle = self.lean.transpose() * (p - MANTLE);
        let mantle = ellipsoid(in_mantle, DVec3::new(0.150, 0.205, 0.145));
        // Wider towards its end, as a pear.
        let bulb = in_mantle.distance(DVec3::new(0.0, 0.055, 0.0)) - 0.160;
        let head = ellipsoid(p - DVec3::new(0.0, 0.050, 0.020), DVec3::new(0.112, 0.100, 0.108));
        let eye = mirrored.distance(EYE) - EYE_RADIUS;
        let web = ellipsoid(p - DVec3::new(0.0, -0.050, 0.0), DVec3::new(0.150, 0.050, 0.150));

        let body = join(mantle, bulb, 0.06);
        let body = join(body, head, 0.07);
        let body = join(body, web, 0.07);
        let arms = self.arms_distance(p);
        let body = join(body, arms, 0.075);
        join(body, eye, 0.022)
    }

    /// Arms grow together where they leave the body, and are strictly apart further out.
    fn arms_distance(&self, p: DVec3) -> f64 {
        let reach = p.length();
        let k = 0.012 + 0.070 * (1.0 - ramp(0.10, 0.25, reach));
        let mut nearest = [f64::INFINITY; 8];
        let mut best = f64::INFINITY;
        for chunk in &self.chunks {
            let slot = &mut nearest[chunk.arm];
            // An arm further than the nearest by more than `k` changes nothing.
            if p.distance(chunk.middle) - chunk.reach < slot.min(best + k) {
                *slot = slot.min(chunk.distance(p));
                best = best.min(*slot);
            }
        }
        nearest.into_iter().fold(f64::INFINITY, |all, arm| if all.is_finite() { join(all, arm, k) } else { arm })
    }

    /// The unit normal of the skin, outwards: the gradient, by central differences.
    pub(crate) fn normal(&self, p: DVec3) -> DVec3 {
        self.gradient(p).normalize_or(DVec3::Y)
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let h = 1e-4;
        let slope = |d: DVec3| (self.distance(p + d) - self.distance(p - d)) / (2.0 * h);
        DVec3::new(slope(DVec3::X * h), slope(DVec3::Y * h), slope(DVec3::Z * h))
    }

    /// The point of the skin near a point near it: Newton steps along the gradient.
    pub(crate) fn project(&self, mut p: DVec3) -> DVec3 {
        for _ in 0..4 {
            let distance = self.distance(p);
            if distance.abs() < 1e-7 {
                break;
            }
            let gradient = self.gradient(p);
            let square = gradient.length_squared();
            if square > 1e-6 {
                p -= gradient * (distance / square).clamp(-0.01, 0.01);
            }
        }
        p
    }

    /// The arm nearest to a point: its number, where along it (0 to 1), and the joint there.
    pub(crate) fn nearest_arm(&self, p: DVec3) -> (usize, f64, Joint) {
        let mut best = (f64::INFINITY, 0, 0);
        for (number, arm) in self.arms.iter().enumerate() {
            for (i, joint) in arm.iter().enumerate() {
                let distance = p.distance(joint.centre) - joint.radius;
                if distance < best.0 {
                    best = (distance, number, i);
                }
            }
        }
        let (_, number, i) = best;
        let arm = &self.arms[number];
        (number, i as f64 / (arm.len() - 1) as f64, arm[i])
    }

    /// How long the mesh's sides should be at a point of the skin \[m\]: short where there is something to see or to bend.
    pub(crate) fn side(&self, p: DVec3) -> f64 {
        let mirrored = DVec3::new(p.x.abs(), p.y, p.z);
        let eye = mirrored.distance(EYE) - EYE_RADIUS;
        let near_eye = 0.0086 + 0.016 * ramp(0.006, 0.07, eye);
        let (_, _, joint) = self.nearest_arm(p);
        let arm = p.distance(joint.centre) - joint.radius;
        let on_arm = (0.74 * joint.radius).max(0.0085) + 0.6 * arm.max(0.0);
        near_eye.min(on_arm).min(0.0225)
    }
}

const MANTLE: DVec3 = DVec3::new(0.0, 0.265, -0.085);
/// How far the mantle leans back \[rad\].
const LEAN: f64 = 0.45;

impl Chunk {
    /// Distance to a chain of cones with rounded ends.
    fn distance(&self, p: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        for pair in self.joints.windows(2) {
            let (a, b) = (&pair[0], &pair[1]);
            let side = b.centre - a.centre;
            let t = ((p - a.centre).dot(side) / side.length_squared()).clamp(0.0, 1.0);
            let radius = a.radius + (b.radius - a.radius) * t;
            nearest = nearest.min(p.distance(a.centre + side * t) - radius);
        }
        nearest
    }
}

/// About the distance to an ellipsoid about the origin; exact on it and to first order near it.
fn ellipsoid(p: DVec3, radii: DVec3) -> f64 {
    let scaled = (p / radii).length();
    let slope = (p / (radii * radii)).length();
    if slope > 1e-9 { scaled * (scaled - 1.0) / slope } else { -radii.min_element() }
}

/// The union of two shapes, rounded over a width `k`: a polynomial that differs from the minimum only where |a − b| < k.
fn join(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k * 0.25
}
