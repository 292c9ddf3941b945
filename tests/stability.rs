//! No state, however senseless, blows up: a matrix of 7560 cases, each a body in a closed room of its own, run to the end through the plugin at its defaults.
//!
//! Stiffness × step × substeps × mass ratio × scale × shape × start, all combinations. In each case nothing may cease to be a number (a body that the plugin froze counts as such), no centre may pass the face of a wall, and
//! the energy may not exceed a bound that the start alone gives ([`Case::bound`]). All hold without exception.

use bevy::math::{DVec3, Vec3A};
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Frozen, Particles};
use polpo_rapier::RapierWorld;
use polpo_rig::{MeshHash, Particle, Rig};
use polpo_tests::{simulation_at, steps};
use rapier3d::prelude::*;

const STEPS: usize = 40;
const GRAVITY: f64 = 9.81;
/// Of the default capabilities: at most so fast is an overlap undone \[m/s\].
const PUSH_SPEED: f64 = 3.0;
/// Half of a room's inner side, in units of the scale; a particle is 0.2 thick.
const HALF: f32 = 4.0;
/// From room to room, in units of the scale.
const SPACING: f32 = 16.0;
/// Of the ball that is in the way, at the room's centre.
const BALL: f32 = 1.2;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Resistance {
    None,
    Tiny,
    Rigid,
}

impl Resistance {
    const ALL: [Self; 3] = [Self::None, Self::Tiny, Self::Rigid];

    fn stiffness(self) -> Stiffness {
        match self {
            Self::None => Stiffness::OFF,
            Self::Tiny => Stiffness::hertz(0.1),
            Self::Rigid => Stiffness::RIGID,
        }
    }

    /// By what a deformation turns into speed at most \[1/s\]: ω of a spring. What nothing bends holds no energy, however it starts.
    fn rate(self) -> f64 {
        match self {
            Self::None | Self::Rigid => 0.0,
            Self::Tiny => 0.1 * std::f64::consts::TAU,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Single,
    Pair,
    Chain,
    Sheet,
    Solid,
}

impl Shape {
    const ALL: [Self; 5] = [Self::Single, Self::Pair, Self::Chain, Self::Sheet, Self::Solid];

    /// Balls of radius 0.2 m that touch, every other one `ratio` times as heavy; joined to the next and across the diagonals of faces.
    fn rig(self, ratio: f32) -> Rig {
        let [nx, ny, nz] = match self {
            Self::Single => [1, 1, 1],
            Self::Pair => [2, 1, 1],
            Self::Chain => [5, 1, 1],
            Self::Sheet => [4, 4, 1],
            Self::Solid => [3, 3, 3],
        };
        let mut particles = Vec::new();
        for i in 0..nx * ny * nz {
            let [x, y, z] = [i % nx, i / nx % ny, i / nx / ny];
            let cell = Vec3::new(x as f32, y as f32, z as f32) - Vec3::new((nx - 1) as f32, (ny - 1) as f32, (nz - 1) as f32) * 0.5;
            let heavy = self == Self::Single || (x + y + z) % 2 == 1;
            let mass = if heavy { ratio } else { 1.0 };
            particles.push(Particle { position: cell * 0.4, frame: Quat::IDENTITY, radii: Vec3::splat(0.2), mass });
        }
        let mut edges = Vec::new();
        for i in 0..particles.len() {
            for j in i + 1..particles.len() {
                if particles[i].position.distance(particles[j].position) < 0.6 {
                    edges.push([i as u32, j as u32]);
                }
            }
        }
        Rig { mesh_hash: MeshHash(0), particles, edges, ..Rig::default() }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Start {
    Rest,
    Fast,
    Spin,
    InsideOut,
    Point,
    Overlap,
    Inside,
}

impl Start {
    const ALL: [Self; 7] = [Self::Rest, Self::Fast, Self::Spin, Self::InsideOut, Self::Point, Self::Overlap, Self::Inside];
}

#[derive(Clone, Copy, Debug)]
#[allow(dead_code, reason = "its name is its debug output")]
struct Case {
    resistance: Resistance,
    rate: f64,
    substeps: u32,
    ratio: f32,
    scale: f32,
    shape: Shape,
    start: Start,
}

/// A case that runs.
struct Run {
    case: Case,
    centre: Vec3,
    bodies: Vec<Entity>,
    bound: f64,
    finite: bool,
    /// How far a centre was past a wall's face, in units of the scale.
    out: f32,
    speed: f32,
    energy: f64,
}

impl Case {
    fn all(rate: f64, substeps: u32) -> Vec<Self> {
        let mut cases = Vec::new();
        for scale in [1e-3, 1.0, 1e3] {
            for resistance in Resistance::ALL {
                for ratio in [1.0, 1e3, 1e6] {
                    for shape in Shape::ALL {
                        for start in Start::ALL {
                            cases.push(Self { resistance, rate, substeps, ratio, scale, shape, start });
                        }
                    }
                }
            }
        }
        cases
    }

    /// Puts the case in its room, the `index`-th of the scale's 7×7×7. The grids of the three scales lie side by side; what is of another room is told apart by layers, or a body on its way at 100 m/s through rooms of a
    /// centimetre would be asked about all of them.
    fn spawn(self, app: &mut App, index: usize) -> Run {
        let cell = Vec3::new((index % 7) as f32, (index / 7 % 7) as f32, (index / 49) as f32) + Vec3::ONE;
        let centre = cell * (SPACING * self.scale);
        let layer = 1u32 << (index % 32);
        let groups = InteractionGroups::new(Group::from_bits_retain(layer), Group::from_bits_retain(layer), InteractionTestMode::And);
        let mut rapier = app.world_mut().resource_mut::<RapierWorld>();
        rapier.insert_fixed(room(self.scale).translation(centre).collision_groups(groups));
        if self.start == Start::Inside {
            let place = centre + Vec3::new(0.05, -0.1, 0.02) * self.scale;
            rapier.insert_fixed(ColliderBuilder::ball(BALL * self.scale).translation(place).friction(0.6).collision_groups(groups));
        }
        let stiffness = self.resistance.stiffness();
        let mut body = |offset: Vec3| {
            let velocity = match self.start {
                Start::Fast => InitialVelocity { linear: Vec3::new(0.6, 0.48, 0.64) * 100.0, angular: Vec3::ZERO },
                Start::Spin => InitialVelocity { linear: Vec3::ZERO, angular: Vec3::new(0.6, 0.48, 0.64) * 1000.0 },
                _ => InitialVelocity::default(),
            };
            let place = Transform::from_translation(centre + offset * self.scale).with_scale(Vec3::splat(self.scale));
            let entity = app
                .world_mut()
                .spawn((
                    SoftBody::new(self.shape.rig(self.ratio)),
                    place,
                    velocity,
                    ShapeMatching::new(stiffness),
                    DistanceConstraints::new(stiffness),
                    Torsion::new(stiffness),
                    Collision { memberships: layer, filter: layer, ..default() },
                    BodyContact { memberships: layer, filter: layer, ..default() },
                ))
                .id();
            if self.start != Start::Overlap {
                app.world_mut().entity_mut(entity).remove::<BodyContact>();
            }
            let mut particles = app.world_mut().get_mut::<Particles>(entity).expect("a sound rig");
            match self.start {
                Start::InsideOut => particles.position.iter_mut().for_each(|x| *x = -*x),
                Start::Point => particles.position.fill(Vec3A::ZERO),
                _ => {}
            }
            entity
        };
        let mut bodies = vec![body(Vec3::ZERO)];
        if self.start == Start::Overlap {
            bodies.push(body(Vec3::new(0.11, 0.07, 0.05)));
        }
        let mut run = Run { case: self, centre, bodies, bound: 0.0, finite: true, out: 0.0, speed: 0.0, energy: 0.0 };
        run.bound = self.bound(app, &run);
        run
    }

    /// The most energy the case may ever have \[J\], above the floor: what it starts with, as motion and as height; what overlaps are pushed apart with, [`PUSH_SPEED`] for all of its mass and a lift out of what it is
    /// in; and what the springs hold at the start, ½·m·(ω·e)² for a member of a group or an edge that is off by e.
    fn bound(self, app: &App, run: &Run) -> f64 {
        let scale = f64::from(self.scale);
        let rate = self.resistance.rate();
        let rig = self.shape.rig(self.ratio);
        let lift = if self.start == Start::Inside { 2.0 * f64::from(BALL) } else { 0.2 } * scale;
        let mut bound = run.energy(app).expect("it starts finite");
        for &body in &run.bodies {
            let p = app.world().get::<Particles>(body).expect("it was built");
            bound += f64::from(p.total_mass()) * (0.5 * PUSH_SPEED * PUSH_SPEED + GRAVITY * lift);
            let [now, then] = [&p.position, &p.rest_position].map(|x| x.iter().map(|x| x.as_dvec3()).collect::<Vec<_>>());
            bound += 0.5 * rate * rate * deformation(&rig, &p.mass, &now, &then);
        }
        bound
    }
}

/// Σ m·e² over all groups and edges, e measured without turning the rest shape, which makes it larger than what the solver sees; 0 for a body in its rest shape.
fn deformation(rig: &Rig, mass: &[f32], now: &[DVec3], then: &[DVec3]) -> f64 {
    let mut sum = 0.0;
    for i in 0..mass.len() {
        let mut members = vec![i];
        members.extend(rig.edges.iter().filter(|e| e.contains(&(i as u32))).map(|e| (e[0] + e[1]) as usize - i));
        let total: f64 = members.iter().map(|&j| f64::from(mass[j])).sum();
        let mean = |x: &[DVec3]| members.iter().map(|&j| x[j] * f64::from(mass[j])).sum::<DVec3>() / total;
        let shift = mean(now) - mean(then);
        sum += members.iter().map(|&j| f64::from(mass[j]) * (now[j] - then[j] - shift).length_squared()).sum::<f64>();
    }
    for [i, j] in rig.edges.iter().map(|e| e.map(|i| i as usize)) {
        let [a, b] = [i, j].map(|i| f64::from(mass[i]));
        let e = now[i].distance(now[j]) - then[i].distance(then[j]);
        sum += a * b / (a + b) * e * e;
    }
    sum
}

/// Six thick plates around nothing.
fn room(scale: f32) -> ColliderBuilder {
    let (half, thick) = (HALF * scale, scale);
    let plates = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|normal| {
        let extents = Vec3::splat(half + 2.0 * thick) - normal.abs() * (half + thick);
        (Pose::from_translation(normal * (half + thick)), SharedShape::cuboid(extents.x, extents.y, extents.z))
    });
    ColliderBuilder::compound(plates.to_vec()).friction(0.6)
}

impl Run {
    /// Kinetic and of height above the floor \[J\]; `None` if a body is frozen or no longer finite.
    fn energy(&self, app: &App) -> Option<f64> {
        let mut energy = 0.0;
        for &body in &self.bodies {
            let p = app.world().get::<Particles>(body)?;
            if !p.is_finite() || app.world().get::<Frozen>(body).is_some() {
                return None;
            }
            let floor = f64::from(self.centre.y) - f64::from(HALF * self.case.scale);
            let origin = f64::from(app.world().get::<Transform>(body)?.translation.y);
            for i in 0..p.len() {
                let [m, inertia] = [p.mass[i], p.inertia[i]].map(f64::from);
                energy += 0.5 * m * p.velocity[i].as_dvec3().length_squared()
                    + 0.5 * inertia * p.angular_velocity[i].as_dvec3().length_squared()
                    + GRAVITY * m * (origin + f64::from(p.position[i].y) - floor);
            }
        }
        Some(energy)
    }

    fn look(&mut self, app: &App) {
        let Some(energy) = self.energy(app) else {
            self.finite = false;
            return;
        };
        self.energy = self.energy.max(energy);
        for &body in &self.bodies {
            let p = app.world().get::<Particles>(body).expect("a body");
            let origin = app.world().get::<Transform>(body).expect("a body").translation - self.centre;
            for i in 0..p.len() {
                self.speed = self.speed.max(p.velocity[i].length());
                let out = (origin + Vec3::from(p.position[i])).abs().max_element() / self.case.scale - HALF;
                self.out = self.out.max(out);
            }
        }
    }
}

/// All cases of a rate, 1 and 8 substeps, to the end.
fn run(rate: f64) -> Vec<Run> {
    let mut done = Vec::new();
    for substeps in [1, 8] {
        let mut app = simulation_at(rate);
        app.insert_resource(SolverSettings { substeps, iterations: 1, ..default() });
        let mut runs = Vec::new();
        for (index, case) in Case::all(rate, substeps).into_iter().enumerate() {
            runs.push(case.spawn(&mut app, index % 315));
        }
        for _ in 0..STEPS {
            steps(&mut app, 1);
            for run in &mut runs {
                run.look(&app);
            }
        }
        done.append(&mut runs);
    }
    done
}

fn check(rate: f64) {
    let runs = run(rate);
    println!("{rate} Hz, {STEPS} steps:");
    println!("{:>9} {:>5} {:>5} {:>12} {:>12} {:>12}", "start", "hold", "cases", "speed [m/s]", "energy/bound", "out/size");
    let mut table = String::new();
    for start in Start::ALL {
        for resistance in Resistance::ALL {
            let these: Vec<&Run> = runs.iter().filter(|r| r.case.start == start && r.case.resistance == resistance).collect();
            let worst = |of: &dyn Fn(&Run) -> f64| these.iter().map(|r| of(r)).fold(0.0, f64::max);
            let [speed, energy, out] = [worst(&|r| f64::from(r.speed)), worst(&|r| r.energy / r.bound), worst(&|r| f64::from(r.out))];
            let (start, resistance) = (format!("{start:?}"), format!("{resistance:?}"));
            table += &format!("{start:>9} {resistance:>5} {:>5} {speed:>12.3e} {energy:>12.3e} {out:>12.3e}\n", these.len());
        }
    }
    println!("{table}");
    let broken: Vec<_> = runs.iter().filter(|r| !r.finite).map(|r| r.case).collect();
    assert!(broken.is_empty(), "{} are not finite: {broken:?}", broken.len());
    let out: Vec<_> = runs.iter().filter(|r| r.out > 0.0).map(|r| (r.out, r.case)).collect();
    assert!(out.is_empty(), "{} left the room: {out:#?}", out.len());
    let over: Vec<_> = runs.iter().filter(|r| r.energy > 1.01 * r.bound).map(|r| (r.energy / r.bound, r.case)).collect();
    assert!(over.is_empty(), "{} are over the bound: {over:#?}", over.len());
}

#[test]
fn at_15_hz() {
    check(15.0);
}

#[test]
fn at_60_hz() {
    check(60.0);
}

#[test]
fn at_240_hz() {
    check(240.0);
}

#[test]
fn at_1000_hz() {
    check(1000.0);
}
