//! A throw: symplectic Euler's parabola, and its exactly known error.

use glam::{DVec3, Vec3A};

use crate::body::{Body, G};
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[Measurement { name: "throw", run: throw }];

fn throw() -> Vec<Reference> {
    let mut body = Body::balls([Vec3A::ZERO], 0.1);
    body.fall();
    body.particles.velocity[0] = Vec3A::new(3.0, 4.0, 0.0);
    let (rate, time) = (60.0, 2.0);
    for _ in 0..(rate * time) as usize {
        body.step(1.0 / rate, 1, 1);
    }
    let parabola = DVec3::new(3.0, 4.0, 0.0) * time - DVec3::Y * (0.5 * G * time * time);
    let at = body.place(0);
    let line = |what: &str, exact, got| Reference::new(format!("throw, after 2 s: {what} [m]"), exact, got).after("method §7").at("60 Hz");
    vec![
        line("way across", parabola.x, at.x).within(2.5e-7, "a few bits of f32"),
        line("way down", parabola.y - 0.5 * G * time / rate, at.y).within(6e-7, "a few bits of f32"),
        line("below the parabola by ½·g·Δt·t", 0.5 * G * time / rate, parabola.y - at.y).within(4e-5, "six digits of a fall of 11.8 m"),
    ]
}
