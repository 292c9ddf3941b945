//! The rows: what is measured beside what.

use std::fmt;
use std::sync::Arc;

use bevy::prelude::*;
use polpo::BodyPairs;
use polpo::prelude::*;
use polpo_benches::measure::{Times, in_turns};
use polpo_benches::octopus;
use polpo_rig::{Mesh, Recipe, Rig, build_rig};
use rapier3d_peer::prelude::SoftBodySolver;

use crate::beam::{OurBeam, TheirBeam, exact_sag};
use crate::constrained::Constrained;
use crate::crowd::Crowd;
use crate::kernels::Bare;
use crate::ours::{Ours, STEP};
use crate::rapier::Kind::{self, Clusters, Jelly, Springs};
use crate::rapier::Skin::{self, Thin, Usual};
use crate::rapier::{Model, Theirs};
use crate::scene::Scene;
use crate::shape::{Shape, extent};
use crate::table::Line;

/// What a ratio should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Wanted {
    /// Of theirs to ours.
    AtLeast(f64),
    /// Of ours to theirs.
    AtMost(f64),
}

impl Wanted {
    pub(crate) fn holds(self, ratio: f64) -> bool {
        match self {
            Self::AtLeast(least) => ratio >= least,
            Self::AtMost(most) => ratio <= most,
        }
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtLeast(least) => write!(f, "≥ {least}"),
            Self::AtMost(most) => write!(f, "≤ {most}"),
        }
    }
}

/// Two cases that are measured beside each other.
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) wanted: Wanted,
    measure: fn() -> Measured,
}

impl Row {
    pub(crate) fn measure(&self) -> Line {
        Line::new(self, (self.measure)())
    }
}

/// What a step takes \[µs\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cost {
    pub(crate) best: f64,
    pub(crate) median: f64,
}

impl From<&Times> for Cost {
    fn from(times: &Times) -> Self {
        Self { best: times.best(), median: times.median() }
    }
}

/// What came of a row.
pub(crate) struct Measured {
    pub(crate) ours: Cost,
    pub(crate) theirs: Cost,
    pub(crate) quality: String,
    /// Whether ours is as good as it has to be, whatever it costs.
    pub(crate) sound: bool,
}

impl Measured {
    fn new([ours, theirs]: &[Times; 2], quality: String, sound: bool) -> Self {
        Self { ours: ours.into(), theirs: theirs.into(), quality, sound }
    }
}

use Wanted::{AtLeast, AtMost};

pub(crate) const ROWS: [Row; 29] = [
    Row { name: "octopus/jelly", wanted: AtLeast(15.0), measure: || octopuses(1, Jelly, Usual, 200) },
    Row { name: "octopus/jelly, thin skin", wanted: AtLeast(15.0), measure: || octopuses(1, Jelly, Thin, 200) },
    Row { name: "octopus/springs", wanted: AtLeast(15.0), measure: || octopuses(1, Springs, Usual, 200) },
    Row { name: "octopus/springs, thin skin", wanted: AtLeast(15.0), measure: || octopuses(1, Springs, Thin, 200) },
    Row { name: "octopus/clusters", wanted: AtLeast(100.0), measure: || octopuses(1, Clusters, Usual, 100) },
    Row { name: "octopus/clusters, thin skin", wanted: AtLeast(100.0), measure: || octopuses(1, Clusters, Thin, 100) },
    Row { name: "heap of 3/jelly", wanted: AtLeast(12.0), measure: || three(Scene::heap(), Usual) },
    Row { name: "heap of 3/jelly, thin skin", wanted: AtLeast(12.0), measure: || three(Scene::heap(), Thin) },
    Row { name: "heap of 3/our 3 apart", wanted: AtMost(1.3), measure: || together_and_apart(Scene::heap(), Scene::apart(3)) },
    Row { name: "pit of 3/jelly", wanted: AtLeast(12.0), measure: || three(Scene::crammed(), Usual) },
    Row { name: "pit of 3/jelly, thin skin", wanted: AtLeast(12.0), measure: || three(Scene::crammed(), Thin) },
    Row { name: "pit of 3/our 3 in a pit each", wanted: AtMost(1.3), measure: || together_and_apart(Scene::crammed(), Scene::parted()) },
    Row { name: "10 octopuses/jelly", wanted: AtLeast(10.0), measure: || octopuses(10, Jelly, Usual, 60) },
    Row { name: "10 octopuses/jelly, thin skin", wanted: AtLeast(10.0), measure: || octopuses(10, Jelly, Thin, 60) },
    Row { name: "100 octopuses/jelly", wanted: AtLeast(10.0), measure: || octopuses(100, Jelly, Usual, 12) },
    Row { name: "100 octopuses/jelly, thin skin", wanted: AtLeast(10.0), measure: || octopuses(100, Jelly, Thin, 12) },
    Row { name: "1000 particles/jelly", wanted: AtLeast(10.0), measure: || fine_octopus(Usual) },
    Row { name: "1000 particles/jelly, thin skin", wanted: AtLeast(10.0), measure: || fine_octopus(Thin) },
    Row { name: "beam of 300/corotational", wanted: AtLeast(8.0), measure: || beams(SoftBodySolver::Constraints) },
    Row { name: "beam of 300/corotational, FEM", wanted: AtLeast(8.0), measure: || beams(SoftBodySolver::Fem) },
    Row { name: "self-contact: falling/at rest", wanted: AtMost(1.3), measure: self_contact },
    Row { name: "100 octopuses: asleep/awake", wanted: AtMost(0.01), measure: asleep },
    Row { name: "step/kernels", wanted: AtMost(1.15), measure: || kernels(Bare::on_given_planes) },
    Row { name: "step/kernels and contact detection", wanted: AtMost(1.15), measure: || kernels(Bare::on_floor) },
    Row { name: "333 octopuses: 1 thread/2", wanted: AtLeast(1.7), measure: || threads(None, 60) },
    Row { name: "one body of 10,648: 1 thread/2", wanted: AtLeast(1.5), measure: || threads(Some(22), 200) },
    Row { name: "one body of 97,336: 1 thread/2", wanted: AtLeast(1.5), measure: || threads(Some(46), 20) },
    Row { name: "10,648 particles: blocks/whole", wanted: AtMost(1.1), measure: || in_blocks(22, 200) },
    Row { name: "97,336 particles: blocks/whole", wanted: AtMost(1.1), measure: || in_blocks(46, 20) },
];

fn unchanged(_: &mut EntityWorldMut) {}

/// How much less high than theirs ours may be, as a share of its height at rest.
const LIMP: f32 = 0.05;

/// Bodies of `rig` beside Rapier's of `model` in the same places, as stiff as one of ours is alone.
fn beside(rig: &Arc<Rig>, model: &Model, scene: &Scene, rounds: usize) -> Measured {
    let alone = Ours::new(rig, &Scene::apart(1), unchanged).settled().shape();
    let softness = model.soften(alone);
    let mut ours = Ours::new(rig, scene, unchanged).settled();
    let mut theirs = Theirs::new(model, softness, scene).settled();
    let times = in_turns(rounds, || ours.step(), || theirs.step());
    let [a, b] = [ours.shape(), theirs.shape()];
    let quality = format!(
        "ours {a}, top at {:.2} m; theirs {b}, top at {:.2} m, of {} particles at {} Hz, damping ratio {}",
        ours.top(),
        theirs.top(),
        model.particles(),
        softness.frequency,
        softness.damping
    );
    Measured::new(&times, quality, keeps_shape(a, b))
}

fn keeps_shape(ours: Shape, theirs: Shape) -> bool {
    ours.height > theirs.height - LIMP || theirs.height.is_nan()
}

fn octopuses(count: usize, kind: Kind, skin: Skin, rounds: usize) -> Measured {
    let (mesh, rig) = octopus();
    beside(&rig, &Model::new(&mesh, &rig, kind, skin), &Scene::apart(count), rounds)
}

fn three(scene: Scene, skin: Skin) -> Measured {
    let (mesh, rig) = octopus();
    beside(&rig, &Model::new(&mesh, &rig, Jelly, skin), &scene, 100)
}

fn fine_octopus(skin: Skin) -> Measured {
    let (mesh, _) = octopus();
    let rig = Arc::new(fine_rig(&mesh));
    beside(&rig, &Model::new(&mesh, &rig, Jelly, skin), &Scene::apart(1), 100)
}

/// A thousand particles, with as many edges each as the octopus of 300 has.
fn fine_rig(mesh: &Mesh) -> Rig {
    build_rig(mesh, &Recipe::with_particles(1000)).expect("the octopus can be rigged")
}

fn together_and_apart(together: Scene, apart: Scene) -> Measured {
    let (_, rig) = octopus();
    let [mut together, mut apart] = [together, apart].map(|scene| Ours::new(&rig, &scene, unchanged).settled());
    let times = in_turns(300, || together.step(), || apart.step());
    let touching = |ours: &Ours| ours.app.world().resource::<BodyPairs>().iter().filter(|pair| pair.touch()).count();
    let [a, b] = [touching(&together), touching(&apart)];
    let quality = format!("together {}, top at {:.2} m, {a} pairs touch; apart {}", together.shape(), together.top(), apart.shape());
    Measured::new(&times, quality, a > 0 && b == 0)
}

fn beams(solver: SoftBodySolver) -> Measured {
    let (mut ours, mut theirs) = (OurBeam::new(), TheirBeam::new(solver));
    let error = |sag: f32| sag / exact_sag() - 1.0;
    let [a, b] = [error(ours.settled_sag()), error(theirs.settled_sag())];
    let times = in_turns(300, || ours.step(), || theirs.step());
    let quality = format!("sag {:+.1} % off the exact {:.4} m, theirs {:+.1} %", 100.0 * a, exact_sag(), 100.0 * b);
    Measured::new(&times, quality, a.abs() < 0.05)
}

/// What self-contact adds to the step of octopuses: while they fall at 20 m/s, and while they lie.
fn self_contact() -> Measured {
    const COUNT: usize = 4;
    let (_, rig) = octopus();
    let fall = |body: &mut EntityWorldMut| {
        let velocity = InitialVelocity { linear: Vec3::NEG_Y * 20.0, ..default() };
        body.insert((velocity, GravityScale(0.0), SoftBody::new(rig.clone())));
    };
    let numb = |body: &mut EntityWorldMut| {
        body.remove::<SelfContact>();
    };
    let high = Scene::on_floor(Scene::apart(COUNT).places.into_iter().map(|place| place + Vec3::Y * 500.0).collect());
    let mut cases = [
        Ours::new(&rig, &high, fall),
        Ours::new(&rig, &high, |body| {
            fall(body);
            numb(body);
        }),
        Ours::new(&rig, &Scene::apart(COUNT), unchanged),
        Ours::new(&rig, &Scene::apart(COUNT), numb),
    ]
    .map(Ours::settled);
    let mut times = <[Times; 4]>::default();
    for _ in 0..600 {
        for (case, times) in cases.iter_mut().zip(&mut times) {
            times.time(|| case.step());
        }
    }
    let [falling, falling_numb, lying, lying_numb] = times.each_ref().map(Cost::from);
    let added = |with: Cost, without: Cost| Cost {
        best: (with.best - without.best) / COUNT as f64,
        median: (with.median - without.median) / COUNT as f64,
    };
    let speed = cases[0].shape().speed;
    let quality = format!("an octopus at {speed:.1} m/s; lying, a step takes {:.1} µs without", lying_numb.best / COUNT as f64);
    Measured { ours: added(falling, falling_numb), theirs: added(lying, lying_numb), quality, sound: (speed - 20.0).abs() < 1.0 }
}

fn asleep() -> Measured {
    const COUNT: usize = 100;
    /// Half a minute.
    const PATIENCE: usize = 1800;
    let (_, rig) = octopus();
    let mut asleep = Ours::new(&rig, &Scene::apart(COUNT), |body| {
        body.insert(Sleep::default());
    });
    let sleeping = |ours: &Ours| ours.bodies.iter().filter(|&&body| ours.app.world().get::<Sleeping>(body).is_some()).count();
    let mut steps = 0;
    while sleeping(&asleep) < COUNT && steps < PATIENCE {
        asleep.step();
        steps += 1;
    }
    let mut awake = Ours::new(&rig, &Scene::apart(COUNT), unchanged).settled();
    let times = in_turns(100, || asleep.step(), || awake.step());
    let count = sleeping(&asleep);
    Measured::new(&times, format!("{count} sleep, after {:.1} s", steps as f32 * STEP), count == COUNT)
}

fn kernels(bare: fn(&Ours) -> Bare) -> Measured {
    let (_, rig) = octopus();
    let mut ours = Ours::new(&rig, &Scene::apart(1), unchanged).settled();
    let mut bare = bare(&ours);
    let times = in_turns(1000, || ours.step(), || bare.step());
    let rest = extent(rig.particles.iter().map(|p| p.position.y));
    let [a, b] = [ours.shape().height, bare.height() / rest];
    let quality = format!("{:.2} % high, by hand {:.2} %", 100.0 * a, 100.0 * b);
    Measured::new(&times, quality, (a - b).abs() < 0.01)
}

/// The constraints of a cube of `side`³ particles, in blocks beside in one piece, on one thread.
fn in_blocks(side: usize, rounds: usize) -> Measured {
    let mut cases = [Constrained::new(side, true), Constrained::new(side, false)];
    let [blocks, whole] = &mut cases;
    let times = in_turns(rounds, || blocks.solve(), || whole.solve());
    let apart = cases[0].distance(&cases[1]);
    Measured::new(&times, format!("{} blocks, places differ by {apart:.1e} m", cases[0].block_count()), apart < 0.01)
}

fn threads(side: Option<usize>, rounds: usize) -> Measured {
    let run = || -> std::io::Result<Measured> {
        let (mut one, mut two) = (Crowd::start(1, side)?, Crowd::start(2, side)?);
        let mut times = <[Times; 2]>::default();
        let mut same = true;
        for _ in 0..rounds {
            let (b, a) = (two.step()?, one.step()?);
            times[0].note(b.0);
            times[1].note(a.0);
            same &= a.1 == b.1;
        }
        let quality = if same { "the same bits" } else { "the bits differ" };
        Ok(Measured::new(&times, quality.into(), same))
    };
    run().unwrap_or_else(|error| Measured::new(&default(), format!("not measured: {error}"), false))
}
