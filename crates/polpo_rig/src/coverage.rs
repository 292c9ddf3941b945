//! How well a rig's ellipsoids fill the body that they stand for: no gaps, little overhang.
//!
//! The skin is sampled evenly by its area, and so is the surface of the ellipsoids' union; the same points on every run. What is
//! nearest is found exactly: on a triangle by its regions (Ericson 2005, §5.1.5), on an ellipsoid by the root of a convex function
//! (Eberly 2013), which Newton's steps approach from one side.

use glam::{DMat3, DVec3};

use crate::clean::Surface;
use crate::grid::Grid;
use crate::tree::{Bounds, Tree};
use crate::{Mesh, Rig};

/// Points on the skin, and on the ellipsoids: shares are told to half a percent.
const SAMPLES: usize = 20_000;
/// So near to an ellipsoid the skin counts as covered, as a share of the body's size.
const NEAR: f64 = 0.02;
/// Voxels along the body, by which a point far from the skin is inside or not.
const VOXELS: f64 = 64.0;

/// How well ellipsoids fill a body.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Coverage {
    /// The share of the skin's area that is within 2 % of the body's size (the longest side of its box) of an ellipsoid, 0 to 1.
    pub covered: f32,
    /// Mean distance of the skin from the ellipsoids \[m\]; 0 where it is within one.
    pub bare: f32,
    /// Mean distance that the surface of the ellipsoids' union sticks out of the body \[m\]; 0 where it is inside. A sheet has no inside.
    pub overhang: f32,
}

/// An ellipsoid in the unit box: centre, the rotation into its frame, half axes.
struct Ellipsoid {
    centre: DVec3,
    inverse: DMat3,
    radii: DVec3,
}

/// Measures how well a rig's ellipsoids fill a mesh, to about half a percent.
///
/// Takes some 0.2 s, and a second for a million triangles. A mesh that [`build_rig`](crate::build_rig) refuses has nothing to cover: all is 0. A rig without particles leaves it infinitely bare.
pub fn coverage(mesh: &Mesh, rig: &Rig) -> Coverage {
    let Ok(surface) = Surface::new(mesh) else { return Coverage::default() };
    if rig.particles.is_empty() {
        return Coverage { bare: f32::INFINITY, ..Coverage::default() };
    }
    let ellipsoids: Vec<Ellipsoid> = rig
        .particles
        .iter()
        .map(|p| Ellipsoid {
            centre: (p.position.as_dvec3() - surface.origin) / surface.scale,
            inverse: DMat3::from_quat(p.frame.as_dquat()).transpose(),
            radii: p.radii.as_dvec3() / surface.scale,
        })
        .collect();
    let tree = Tree::new(&ellipsoids.iter().map(Ellipsoid::bounds).collect::<Vec<_>>());
    let (covered, bare) = skin(&surface, &ellipsoids, &tree);
    let overhang = overhang(&surface, &ellipsoids, &tree);
    Coverage { covered: covered as f32, bare: (bare * surface.scale) as f32, overhang: (overhang * surface.scale) as f32 }
}

/// The covered share of the skin, and its mean distance from the ellipsoids.
fn skin(surface: &Surface, ellipsoids: &[Ellipsoid], tree: &Tree) -> (f64, f64) {
    let area = |t: usize| {
        let [a, b, c] = surface.corners(t);
        (b - a).cross(c - a).length() * 0.5
    };
    let count = surface.triangles.len();
    let step = (0..count).map(area).sum::<f64>() / SAMPLES as f64;
    let (mut sample, mut passed) = (0, 0.0);
    let (mut covered, mut bare) = (0, 0.0);
    for t in 0..count {
        passed += area(t);
        // Rounding must not cost the last triangle its samples.
        while sample < SAMPLES && ((sample as f64 + 0.5) * step <= passed || t + 1 == count) {
            let [u, v] = plane_sequence(sample);
            let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
            let [a, b, c] = surface.corners(t);
            let point = a + (b - a) * u + (c - a) * v;
            let mut nearest = f64::INFINITY;
            tree.near(point, nearest, |e| {
                nearest = nearest.min(ellipsoids[e as usize].distance(point));
                if nearest > 0.0 { nearest } else { -1.0 }
            });
            covered += usize::from(nearest <= NEAR);
            bare += nearest;
            sample += 1;
        }
    }
    (covered as f64 / SAMPLES as f64, bare / SAMPLES as f64)
}

/// How far the union's surface sticks out of the body on average.
fn overhang(surface: &Surface, ellipsoids: &[Ellipsoid], tree: &Tree) -> f64 {
    let triangles = Tree::new(&(0..surface.triangles.len()).map(|t| bounds(&surface.corners(t))).collect::<Vec<_>>());
    let normals = surface.normals();
    let grid = Grid::new(surface, VOXELS);
    let has_inside = grid.has_inside();
    let deep = grid.size * 1.8;
    let (mut total, mut out) = (0.0, 0.0);
    for sample in 0..SAMPLES.max(ellipsoids.len()) {
        let own = sample % ellipsoids.len();
        let ellipsoid = &ellipsoids[own];
        let [u, v] = plane_sequence(sample);
        let (z, turn) = (1.0 - 2.0 * u, std::f64::consts::TAU * v);
        let across = (1.0 - z * z).max(0.0).sqrt();
        let direction = DVec3::new(libm::cos(turn) * across, libm::sin(turn) * across, z);
        let point = ellipsoid.centre + ellipsoid.inverse.transpose() * (ellipsoid.radii * direction);
        let mut hidden = false;
        tree.near(point, 0.0, |e| {
            hidden |= e as usize != own && ellipsoids[e as usize].holds(point);
            if hidden { -1.0 } else { 0.0 }
        });
        if hidden {
            continue;
        }
        // An area of the unit sphere grows by this where the sphere is pulled into the ellipsoid.
        let r = ellipsoid.radii;
        let weight = (DVec3::new(r.y * r.z, r.z * r.x, r.x * r.y) * direction).length();
        total += weight;
        let (mut nearest, mut facing) = (f64::INFINITY, 0.0_f64);
        triangles.near(point, nearest, |t| {
            let away = point - on_triangle(point, surface.corners(t as usize));
            let (distance, dot) = (away.length(), away.dot(normals[t as usize]));
            // At a corner several triangles are as near; the one that faces the point most tells its side.
            let as_near = (distance - nearest).abs() <= 1e-9;
            if (as_near && dot.abs() > facing.abs()) || (!as_near && distance < nearest) {
                facing = dot;
            }
            nearest = nearest.min(distance);
            nearest + 1e-9
        });
        let outside = if nearest > deep { !grid.holds(point) } else { facing > 0.0 || !has_inside };
        if outside {
            out += weight * nearest;
        }
    }
    if total > 0.0 { out / total } else { 0.0 }
}

/// The n-th of an even sequence of points in the unit square (Roberts 2018, R₂).
fn plane_sequence(n: usize) -> [f64; 2] {
    [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step| (0.5 + n as f64 * step).fract())
}

fn bounds(points: &[DVec3; 3]) -> Bounds {
    let [a, b, c] = *points;
    (a.min(b).min(c), a.max(b).max(c))
}

impl Ellipsoid {
    fn bounds(&self) -> Bounds {
        // Half a side of the box is the length of the row of the matrix that makes the ellipsoid from the unit sphere.
        let axes = self.inverse.transpose();
        let half = DVec3::from_array([0, 1, 2].map(|i| (axes.row(i) * self.radii).length()));
        (self.centre - half, self.centre + half)
    }

    fn holds(&self, point: DVec3) -> bool {
        (self.inverse * (point - self.centre) / self.radii).length_squared() < 1.0
    }

    /// Distance of a point, 0 within.
    ///
    /// With p the point in the frame, the nearest place is x = r² p / (t + r²) for the t ≥ 0 at which |x / r| = 1. |x / r|² is convex
    /// and falls with t, so Newton's steps from 0 never pass the root.
    fn distance(&self, point: DVec3) -> f64 {
        let p = self.inverse * (point - self.centre);
        let squares = self.radii * self.radii;
        let mut t = 0.0;
        for _ in 0..50 {
            let x = self.radii * p / (squares + t);
            let value = x.length_squared() - 1.0;
            if value <= 1e-12 {
                break;
            }
            t += value / (2.0 * (x * x / (squares + t)).element_sum());
        }
        // p − x = p t / (t + r²).
        (p * t / (squares + t)).length()
    }
}

/// The place on a triangle that is nearest to a point.
fn on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let beside_c = d1 * d4 - d3 * d2;
    if beside_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let beside_b = d5 * d2 - d1 * d6;
    if beside_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let beside_a = d3 * d6 - d5 * d4;
    if beside_a <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / (d4 - d3 + d5 - d6));
    }
    let all = beside_a + beside_b + beside_c;
    a + ab * (beside_b / all) + ac * (beside_c / all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_of_an_ellipsoid_is_that_of_its_nearest_place() {
        let ellipsoid = Ellipsoid { centre: DVec3::new(0.1, 0.2, 0.3), inverse: DMat3::IDENTITY, radii: DVec3::new(0.5, 0.2, 0.01) };
        for n in 0..200 {
            let [u, v] = plane_sequence(n);
            let point = DVec3::new(u * 2.0 - 1.0, v * 2.0 - 1.0, u * v);
            let mut nearest = f64::INFINITY;
            for i in 0..40_000 {
                let [u, v] = plane_sequence(i);
                let (z, turn) = (1.0 - 2.0 * u, std::f64::consts::TAU * v);
                let across = (1.0 - z * z).sqrt();
                let on = ellipsoid.radii * DVec3::new(libm::cos(turn) * across, libm::sin(turn) * across, z);
                nearest = nearest.min((ellipsoid.centre + on).distance(point));
            }
            let found = ellipsoid.distance(point);
            assert!((found - nearest).abs() < 0.01 || ellipsoid.holds(point) && found == 0.0, "{point}: {found} is not {nearest}");
        }
    }
}
