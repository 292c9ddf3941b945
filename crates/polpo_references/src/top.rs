//! The free asymmetric top: a rigid group against Euler's equations.

use glam::Vec3A;

use crate::body::{Body, POINT};
use crate::measure::{Crossings, agm, order};
use crate::{Measurement, Reference};

pub(crate) const MEASUREMENTS: &[Measurement] =
    &[Measurement { name: "top/0.1", run: || top(0.1) }, Measurement { name: "top/0.5", run: || top(0.5) }];

const SOURCE: &str = "method §7; Landau & Lifshitz, Mechanics, §37";

/// Quarter of the period of ω_y for the principal moments `i` and a start at (`x`, 5, 0).
///
/// With 2E = Σ I·ω² and M² = Σ (I·ω)² the motion is elliptic of modulus k in τ = p·t, and ω_y goes from its maximum to zero in K(k)/p, K(k) = π/(2·agm(1, √(1 − k²))). There M² > 2E·I₂; for
/// M² < 2E·I₂ the first and the third axis change places.
fn quarter(mut i: [f64; 3], x: f64) -> f64 {
    let energy = i[0] * x * x + i[1] * 25.0;
    let square = (i[0] * x).powi(2) + (i[1] * 5.0).powi(2);
    if square < energy * i[1] {
        i.swap(0, 2);
    }
    let [a, b, c] = i;
    let p2 = (c - b) * (square - energy * a) / (a * b * c);
    let k2 = (b - a) * (energy * c - square) / ((c - b) * (square - energy * a));
    core::f64::consts::FRAC_PI_2 / agm(1.0, (1.0 - k2).sqrt()) / p2.sqrt()
}

const SECOND: &str = "the midpoint step is of second order: about (5/960)²/12";

struct Run {
    crossings: Crossings,
    angular: f64,
    energy: f64,
}

fn run(x: f32, rate: f64) -> Run {
    let at = [Vec3A::X, Vec3A::Y * 0.8, Vec3A::Z * 0.5];
    let mut body = Body::balls(at.into_iter().flat_map(|a| [a, -a]), POINT);
    body.make_rigid([&[0, 1, 2, 3, 4, 5][..]]);
    body.particles.set_rigid_velocity(Vec3A::ZERO, Vec3A::new(x, 5.0, 0.0));
    let before = body.carried();
    let mut crossings = Crossings::default();
    for k in 1..=(17.0 * rate) as usize {
        body.step(1.0 / rate, 1, 1);
        let back = body.explicit.rotation(0).unwrap_or_default().inverse();
        crossings.sample(k as f64 / rate, f64::from((back * body.particles.angular_velocity[0]).y));
    }
    let after = body.carried();
    Run { crossings, angular: after.angular.distance(before.angular) / before.angular.length(), energy: after.energy / before.energy - 1.0 }
}

fn top(x: f32) -> Vec<Reference> {
    // What the six points' own spin adds.
    let spin = 6.0 * 0.4 * f64::from(POINT * POINT);
    let quarter = quarter([1.78, 2.5, 3.28].map(|i| i + spin), f64::from(x));
    let (coarse, fine) = (run(x, 60.0), run(x, 960.0));
    let error = |r: &Run| r.crossings.time(2) - 5.0 * quarter;
    let line = |what: &str, exact, got| Reference::new(format!("top from ({x}, 5, 0): {what}"), exact, got).after(SOURCE).at("960 Hz");
    vec![
        line("first turnover [s]", quarter, fine.crossings.time(0)).within(3e-6, SECOND),
        line("second turnover [s]", 3.0 * quarter, fine.crossings.time(1)).within(3e-6, SECOND),
        line("third turnover [s]", 5.0 * quarter, fine.crossings.time(2)).within(3e-6, SECOND),
        line("order in Δt", 2.0, order(error(&coarse), error(&run(x, 240.0)), 4.0))
            .at("60 and 240 Hz")
            .within(1e-3, "at 60 Hz the next order shows"),
        line("L lost in 17 s", 0.0, fine.angular).within(6e-8, "the members hold it in f32"),
        line("E gained in 17 s", 0.0, fine.energy)
            .within(3e-7, "the members hold it in f32; the midpoint step itself neither gains nor loses"),
    ]
}
