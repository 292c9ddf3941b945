//! The eyes: rings of vertices about where they look, so that iris and lid have round outlines.

use glam::DVec3;
use libm::{cos, floor, sin, sqrt};

use super::remesh::Remesh;
use super::shape::{EYE, EYE_RADIUS, GAZE, Shape};

/// Angle from ring to ring \[rad\], about a vertex's distance.
const RING: f64 = 0.155;
/// Rings that belong to the eye; the last one is skin, to keep the lid's outline round.
const RINGS: usize = 6;

/// What a place of an eye is.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Part {
    Pupil,
    Iris,
    White,
    Lid,
}

/// Gives every ring its vertices: 6 k in the k-th, which is the pattern of a triangular grid.
pub(crate) fn place(shape: &Shape, mesh: &mut Remesh) {
    for mirror in [1.0, -1.0] {
        let (gaze, right, up) = axes();
        for ring in 0..=RINGS {
            let tilt = ring as f64 * RING;
            for i in 0..(6 * ring).max(1) {
                let turn = std::f64::consts::TAU * i as f64 / (6 * ring).max(1) as f64;
                let toward = gaze * cos(tilt) + (right * cos(turn) + up * sin(turn)) * sin(tilt);
                let point = EYE + toward * EYE_RADIUS;
                mesh.pin(shape.project(DVec3::new(point.x * mirror, point.y, point.z)), shape);
            }
        }
    }
}

/// The part of an eye that a point of the skin belongs to.
pub(crate) fn part(p: DVec3) -> Option<Part> {
    let out = DVec3::new(p.x.abs(), p.y, p.z) - EYE;
    if out.length() > EYE_RADIUS * 1.15 {
        return None;
    }
    let (gaze, right, up) = axes();
    let toward = out.normalize_or(gaze);
    let (x, y, z) = (toward.dot(right), toward.dot(up), toward.dot(gaze));
    // Chord instead of angle: on these few rings they differ by a hair, and no arc function is needed.
    let chord = sqrt((x * x + y * y + (1.0 - z) * (1.0 - z)).max(0.0));
    let ring = floor(chord / RING + 0.5);
    // A horizontal bar with round ends, two rings to either side, one up and down.
    let slit = (x / (2.9 * RING)).abs();
    match ring as usize {
        0..=3 if slit < 1.0 && y.abs() < 1.15 * RING * (1.0 - slit * slit * slit * slit) => Some(Part::Pupil),
        0..=3 => Some(Part::Iris),
        4 => Some(Part::White),
        5 => Some(Part::Lid),
        _ => None,
    }
}

/// Where the right eye looks, and the horizontal and vertical directions across it.
fn axes() -> (DVec3, DVec3, DVec3) {
    let gaze = GAZE.normalize();
    let right = DVec3::Y.cross(gaze).normalize();
    (gaze, right, gaze.cross(right))
}
