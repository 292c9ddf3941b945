//! `cargo xtask beam`: what every way of solving makes of one beam, and what it costs, as `docs/beam.md`.

use std::fmt::Write;
use std::time::Instant;

use glam::{Quat, Vec3A};
use polpo_solver::{
    CalibratedEdges, DirectEdges, Edges, ImplicitGroups, Material, ParticleRest, Particles, Section, Stiffness, Sweep, Turning, integrate,
    match_shapes, predict, solve_calibrated_edges, solve_distances, solve_torsion,
};

const GRAVITY: f32 = 9.81;
const COUNTS: [usize; 4] = [5, 9, 17, 33];
const RATES: [f32; 4] = [30.0, 60.0, 120.0, 240.0];

/// Where the table goes, from the workspace's root.
const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/beam.md");

/// Why there is no table.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BeamError {
    /// It could not be written.
    #[error("{PATH}: {0}")]
    Write(#[from] std::io::Error),
}

/// A way of solving.
#[derive(Clone, Copy)]
enum Way {
    /// Calibrated edges, swept once a substep.
    Swept,
    /// Calibrated edges, all at once.
    Direct,
    /// The paper's groups, distances and torsion.
    Paper(Stiffness),
}

/// 1 kg/dm³, 75 mm square: E such that 1 m of it sags by 5 cm, without shear.
fn material() -> (Material, Section, f32) {
    let section = Section::square(0.075);
    let density = 1000.0;
    let youngs_modulus = density * GRAVITY * section.area / (8.0 * section.bending * 0.05);
    let material = Material { youngs_modulus, poissons_ratio: 0.3, density };
    let exact = 0.05 + density * GRAVITY / (2.0 * section.shear * material.shear_modulus());
    (material, section, exact)
}

/// The beam along x, clamped at its first particle.
struct Beam {
    particles: Particles,
    rods: CalibratedEdges,
    direct: DirectEdges,
    groups: ImplicitGroups,
    edges: Edges,
    way: Way,
}

impl Beam {
    fn new(count: usize, way: Way) -> Self {
        let (material, section, _) = material();
        let rest: Vec<ParticleRest> = (0..count)
            .map(|i| ParticleRest {
                position: Vec3A::X * (i as f32 / (count - 1) as f32),
                frame: Quat::IDENTITY,
                radii: Vec3A::splat(0.0375),
                mass: 1.0,
            })
            .collect();
        let mut particles = Particles::new(&rest).expect("sound particles");
        let pairs: Vec<[u32; 2]> = (1..count as u32).map(|i| [i - 1, i]).collect();
        let edges = Edges::new(&particles, &pairs).expect("sound edges");
        let own = particles.inertia.clone();
        let mass = particles.mass.clone();
        let spin_radius = matches!(way, Way::Swept).then_some(0.12);
        let rods = CalibratedEdges::rods(&mut particles, &edges, &material, &section, spin_radius, &[]).expect("a real material");
        if let Way::Paper(_) = way {
            // The same masses, spun as the paper's ellipsoids are.
            for i in 0..count {
                particles.set_inertia(i, own[i] / mass[i] * particles.mass[i]);
            }
        }
        let direct = DirectEdges::new(&rods, count).expect("a chain has no loops");
        let groups = ImplicitGroups::new(&particles, &edges);
        particles.pin(0, true, true);
        Self { particles, rods, direct, groups, edges, way }
    }

    fn substep(&mut self, dt: f32, drag: f32) {
        let Self { particles, rods, direct, groups, edges, way } = self;
        integrate(particles, dt, drag);
        predict(particles, Vec3A::NEG_Y * GRAVITY, dt);
        match way {
            Way::Swept => solve_calibrated_edges(rods, particles, Sweep::only(dt)),
            Way::Direct => {
                direct.solve(rods, particles, dt);
            }
            Way::Paper(stiffness) => {
                let (share, sweep) = (stiffness.share(dt), Sweep::only(dt));
                match_shapes(groups, particles, share.into(), Turning::AllMembers, sweep);
                solve_distances(edges, particles, share.into(), share.into(), sweep);
                solve_torsion(edges, particles, share.into(), sweep);
            }
        }
    }

    /// How far the tip hangs \[m\], and what a substep took, by particle \[ns\].
    fn sag(mut self, rate: f32, substeps: u32) -> (f32, f64) {
        let dt = 1.0 / (rate * substeps as f32);
        let count = self.particles.len();
        let (mut sum, mut number) = (0.0, 0);
        let started = Instant::now();
        for step in 0..(5.0 * rate) as usize {
            let late = step as f32 > 3.0 * rate;
            for _ in 0..substeps {
                // Damped on the way down, all but free at the end.
                self.substep(dt, if late { 0.5 } else { 6.0 });
            }
            if step as f32 > 4.0 * rate {
                sum -= self.particles.position[count - 1].y;
                number += 1;
            }
        }
        let taken = started.elapsed().as_nanos() as f64 / (f64::from(5.0 * rate) * f64::from(substeps) * count as f64);
        (sum / number as f32, taken)
    }
}

/// The frequency of the paper's springs for which 9 particles at 60 Hz with 8 substeps sag as they should.
fn tuned_hertz(exact: f32) -> f32 {
    let (mut low, mut high) = (1.0f32, 1000.0f32);
    for _ in 0..20 {
        let middle = (low * high).sqrt();
        let (sag, _) = Beam::new(9, Way::Paper(Stiffness::hertz(middle))).sag(60.0, 8);
        if sag > exact { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}

/// Measures and writes the table.
pub(crate) fn run() -> Result<(), BeamError> {
    let (.., exact) = material();
    let hertz = tuned_hertz(exact);
    let mut text = String::from(
        "# One beam, every way of solving\n\n\
         A beam of 1 m, clamped at one end, of a rubber that its own weight bends by 5 cm (and shears by a little), in 5 to 33 particles, at 30 to 240 steps a second. The figures are how far its tip hangs,\n\
         relative to Timoshenko's beam: 0 % is right (−0.2 % that it is an arc), −99 % a stick, more than +100 % a rope. The last column is what a step takes at that number of substeps, by particle, as a multiple of one swept\n\
         substep of the same beam.\n\n\
         Generated by `cargo xtask beam`; do not edit.\n",
    );
    let paper = |s| Way::Paper(s);
    let ways = [
        ("calibrated edges, swept", Way::Swept, &[1, 2, 4, 8, 16, 32, 0][..]),
        ("calibrated edges, direct", Way::Direct, &[1, 2, 4]),
        ("paper, stiffness 1", paper(Stiffness::Fraction(1.0)), &[1, 2, 4, 8]),
        ("paper, tuned", paper(Stiffness::hertz(hertz)), &[1, 2, 4, 8]),
    ];
    for count in COUNTS {
        let _ = write!(text, "\n## {count} particles\n\n| | substeps |");
        for rate in RATES {
            let _ = write!(text, " {rate} Hz |");
        }
        text.push_str(" cost |\n|---|---|---|---|---|---|---|\n");
        let mut unit = 0.0;
        for (name, way, list) in ways {
            for &asked in list {
                let needed = |rate: f32| {
                    let beam = Beam::new(count, way);
                    beam.rods.recommended_substeps(&beam.particles, 1.0 / rate)
                };
                let label =
                    if asked == 0 { RATES.map(|rate| needed(rate).to_string()).join("/") + " (the rule)" } else { asked.to_string() };
                let _ = write!(text, "| {name} | {label} |");
                let mut cost = 0.0;
                for rate in RATES {
                    let substeps = if asked == 0 { needed(rate) } else { asked };
                    let (sag, taken) = Beam::new(count, way).sag(rate, substeps);
                    if unit == 0.0 {
                        unit = taken;
                    }
                    if rate == 60.0 {
                        cost = taken * f64::from(substeps) / unit;
                    }
                    let _ = write!(text, " {:+.1} % |", 100.0 * (sag / exact - 1.0));
                }
                let _ = writeln!(text, " {cost:.0} |");
            }
        }
    }
    let _ = write!(
        text,
        "\n\"Tuned\": {hertz:.0} Hz, which makes 9 particles at 60 steps of 8 substeps right. \"The rule\": `CalibratedEdges::recommended_substeps`, with a spin radius of 0.12 m.\n"
    );
    std::fs::write(PATH, text)?;
    Ok(())
}
