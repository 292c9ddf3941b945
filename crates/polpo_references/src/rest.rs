//! A soft body at rest: how deep it lies in the floor, and whether it creeps.

use glam::{DVec3, Quat, Vec3, Vec3A};

use crate::soft::{default_stiffness, lattice};
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "rest/floor", run: || rest(0.0, 1.5e-7, 2.5e-5) },
    Measurement { name: "rest/slope", run: || rest(15.0, 1.2e-5, 4e-5) },
];

/// A lattice of 0.4 m that lies on a slope of `degrees` from the start, with friction enough to stay. Watched from 5 s to 10 s. The last two are tolerances.
fn rest(degrees: f64, creep: f64, speed: f64) -> Vec<Reference> {
    let angle = degrees.to_radians();
    let normal = Vec3A::new(angle.sin() as f32, angle.cos() as f32, 0.0);
    let along = DVec3::new(angle.cos(), -angle.sin(), 0.0);
    let mut body = lattice([4, 3, 3], 0.0);
    default_stiffness(&mut body);
    body.floor = Some((normal, 0.6));
    body.fall();
    (body.drag, body.internal_damping) = (0.1, 2.0);
    body.particles.place(Quat::from_rotation_arc(Vec3::Y, normal.into()), normal * 0.05);
    let (mut settled, mut deepest) = (DVec3::ZERO, 0.0f64);
    for step in 0..600 {
        body.step(1.0 / 60.0, 5, 1);
        if step == 299 {
            settled = body.origin;
        }
        if step >= 300 {
            let lowest = (0..body.particles.len()).map(|i| body.place(i).dot(normal.as_dvec3())).fold(f64::MAX, f64::min);
            deepest = deepest.max(0.05 - lowest);
        }
    }
    let fastest = body.particles.velocity.iter().map(|v| f64::from(v.length())).fold(0.0, f64::max);
    let moved = body.origin - settled;
    let name = if degrees == 0.0 { "soft body on a floor".to_owned() } else { format!("soft body on {degrees}°, μ = 0.6") };
    let line = |what: &str, got| Reference::new(format!("{name}: {what}"), 0.0, got).after("method §7").at("60 Hz × 5");
    let rounding = "rounding in f32";
    vec![
        line("penetration, of its balls' radius", deepest / 0.05).within(8e-7, rounding),
        line("creep from 5 s to 10 s, of its length", moved.dot(along).abs() / 0.4)
            .within(creep, "rounding in f32; on the slope what is left of its wobble"),
        line("sinking from 5 s to 10 s, of its height", moved.dot(normal.as_dvec3()).abs() / 0.3).within(8e-8, rounding),
        line("speed of its fastest ball after 10 s [m/s]", fastest).within(speed, "one bit of a place in 1/300 s is 1e-5 m/s"),
    ]
}
