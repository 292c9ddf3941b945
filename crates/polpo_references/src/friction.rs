//! Coulomb's friction: stopping, rolling, inclines.

use glam::{DVec3, Vec3A};

use crate::body::{Body, G};
use crate::measure::order;
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] = &[
    Measurement { name: "friction/stop", run: stop },
    Measurement { name: "friction/roll", run: slide_to_roll },
    Measurement { name: "friction/incline", run: incline },
    Measurement { name: "friction/least", run: least_friction },
];

const RADIUS: f32 = 0.1;

/// A ball on a slope of `angle` \[rad\] that falls towards +x; one that cannot turn is a block.
fn on_slope(angle: f64, friction: f32, turns: bool) -> Body {
    let normal = Vec3A::new(angle.sin() as f32, angle.cos() as f32, 0.0);
    let mut body = Body::balls([normal * RADIUS], RADIUS);
    body.floor = Some((normal, friction));
    body.fall();
    if !turns {
        body.particles.pin(0, false, true);
    }
    body
}

/// Time and way to a stop from 3 m/s at μ = 0.3.
fn stopping(rate: f64) -> (f64, f64) {
    let mut body = on_slope(0.0, 0.3, false);
    body.particles.velocity[0] = Vec3A::X * 3.0;
    let (mut last, mut k, mut time) = (3.0, 0, f64::NAN);
    while k < (3.0 * rate) as usize {
        body.step(1.0 / rate, 1, 1);
        k += 1;
        let speed = f64::from(body.particles.velocity[0].x);
        // The last substep's deceleration is cut short: the time it took at that of the one before.
        if time.is_nan() && speed < 1e-5 {
            time = (k - 1) as f64 / rate + last / (0.3 * G);
        }
        last = speed;
    }
    (time, body.place(0).x)
}

fn stop() -> Vec<Reference> {
    let (time, way) = (3.0 / (0.3 * G), 4.5 / (0.3 * G));
    let line = |what: &str, exact, got| Reference::new(format!("block from 3 m/s, μ = 0.3: {what}"), exact, got).after("method §7");
    vec![
        line("time to stop [s]", time, stopping(480.0).0).at("480 Hz").within(1e-6, "a few bits of f32"),
        line("way to stop [m]", way, stopping(3840.0).1).at("3840 Hz").within(4e-4, "symplectic Euler: short by ½·v₀·Δt, 2.6e-4"),
        line("order of the way in Δt", 1.0, order(stopping(60.0).1 - way, stopping(240.0).1 - way, 4.0))
            .at("60 and 240 Hz")
            .within(4e-3, "the last substep is cut short"),
    ]
}

struct Roll {
    time: f64,
    way: f64,
    speed: f64,
    spin: f64,
}

/// A ball that slides at 3 m/s at μ = 0.3, until half a second later it rolls.
fn roll(rate: f64) -> Roll {
    let mut body = on_slope(0.0, 0.3, true);
    body.particles.velocity[0] = Vec3A::X * 3.0;
    let slip = |b: &Body| f64::from(b.particles.velocity[0].x + b.particles.angular_velocity[0].z * RADIUS);
    let (mut last, mut way, mut time) = (3.0, 0.0, f64::NAN);
    for k in 0..(0.5 * rate) as usize {
        let before = body.place(0).x;
        body.step(1.0 / rate, 1, 1);
        let now = slip(&body);
        if time.is_nan() && now < 1e-4 {
            // In the last substep of sliding slip falls, by 7/2·μ·g a second, for only a share of it.
            let share = last / (3.5 * 0.3 * G) * rate;
            time = (k as f64 + share) / rate;
            way = before + share * (body.place(0).x - before);
        }
        last = now;
    }
    Roll { time, way, speed: f64::from(body.particles.velocity[0].x), spin: f64::from(body.particles.angular_velocity[0].z) }
}

fn slide_to_roll() -> Vec<Reference> {
    let exact = 3.0 / (3.5 * 0.3 * G);
    let (coarse, fine) = (roll(240.0), roll(960.0));
    let line = |what: &str, exact, got| Reference::new(format!("ball sliding at 3 m/s, μ = 0.3: {what}"), exact, got).after("method §7");
    vec![
        line("time until it rolls [s]", exact, coarse.time).at("240 Hz").within(7e-6, ROUNDING),
        line("way until it rolls [m]", 3.0 * exact - 0.15 * G * exact * exact, fine.way)
            .at("960 Hz")
            .within(8e-4, "symplectic Euler: short by ½·μ·g·Δt·t, 6e-4"),
        line("speed when it rolls [m/s]", 15.0 / 7.0, fine.speed).at("960 Hz").within(5e-5, ROLLING),
        line("spin when it rolls [rad/s]", -150.0 / 7.0, fine.spin).at("960 Hz").within(1.2e-4, ROLLING),
    ]
}

/// Acceleration down a slope over one second from rest.
fn acceleration(degrees: f64, friction: f32, turns: bool, rate: f64) -> f64 {
    let angle = degrees.to_radians();
    let mut body = on_slope(angle, friction, turns);
    for _ in 0..rate as usize {
        body.step(1.0 / rate, 1, 1);
    }
    body.particles.velocity[0].as_dvec3().dot(DVec3::new(angle.cos(), -angle.sin(), 0.0))
}

const ROUNDING: &str = "rounding of places in f32: the more, the finer Δt";
const ROLLING: &str = "second order in Δt: the ball turns on while friction acts where it was";

fn incline() -> Vec<Reference> {
    let (block, ball) = (30.0f64.to_radians(), 20.0f64.to_radians());
    let line = |what: &str, exact, got| Reference::new(format!("{what}: acceleration [m/s²]"), exact, got).after("method §7");
    vec![
        line("block down 30°, μ = 0.3", G * (block.sin() - 0.3 * block.cos()), acceleration(30.0, 0.3, false, 240.0))
            .at("240 Hz")
            .within(7e-6, ROUNDING),
        line("ball rolling down 20°, μ = 0.5", G * ball.sin() / 1.4, acceleration(20.0, 0.5, true, 960.0))
            .at("960 Hz")
            .within(6e-5, ROLLING),
    ]
}

/// How fast a ball slips after a second on a slope of 20°.
fn slip(friction: f64, rate: f64) -> f64 {
    let mut body = on_slope(20.0f64.to_radians(), friction as f32, true);
    for _ in 0..rate as usize {
        body.step(1.0 / rate, 1, 1);
    }
    body.particles.velocity[0].as_dvec3().length() - f64::from(body.particles.angular_velocity[0].z.abs() * RADIUS)
}

fn least_friction() -> Vec<Reference> {
    let exact = 20.0f64.to_radians().tan() / 3.5;
    let line = |rate: f64| {
        // Below the least friction slip grows in proportion to what is lacking: the straight line through two points.
        let (a, b) = (slip(0.06, rate), slip(0.08, rate));
        Reference::new("ball on 20°: least μ for rolling", exact, 0.08 + 0.02 * b / (a - b)).after("method §7").at(format!("{rate} Hz"))
    };
    vec![line(240.0).within(3e-6, ROUNDING), line(3840.0).within(4e-5, ROUNDING), line(15360.0).within(2.5e-4, ROUNDING)]
}
