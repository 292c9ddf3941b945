//! Which kernels there are, and in what state each gets its body.

use glam::Vec3A;
use polpo_solver::{
    CalibratedEdges, Contacts, PAIR_PASSES, PairRules, PairSearch, Shares, Sides, Stiffness, Sweep, Turning, damp_internally, integrate,
    match_shapes, momentum, predict, restore_angular_momentum, solve_calibrated_edges, solve_contacts, solve_distances, solve_pairs,
    solve_torsion,
};

use super::body::{DAMPING, DT, FRICTION, GRAVITY, LENGTH, PUSH_SPEED, SHAPE, TWIST};
use super::state::State;
use super::{Body, Kernel, stir};

/// By how much edges are strained: particles are moved by this share of their radius, and turned by as many radians.
const STRAIN: f32 = 0.02;
/// A body that touches itself is one pressed flat to this share of its height.
const PRESSED: f32 = 0.6;
/// \[1/s\]
const DRAG: f32 = 0.1;
/// A step, in which pairs are looked for \[s\].
const SEARCH: PairSearch = PairSearch { dt: 1.0 / 60.0, gain: 9.81 / 60.0 };

/// Every kernel on the octopus of 300 particles and on a block of 1000.
pub fn all() -> Vec<Kernel> {
    let mut kernels = of("octopus", &Body::octopus());
    kernels.extend(of("block", &Body::block([10, 10, 10])));
    kernels
}

fn share(stiffness: Stiffness) -> Shares<'static> {
    Shares::One(stiffness.share(DT))
}

/// In the order of a step; the scalar ones come after those that they repeat.
fn of(name: &'static str, body: &Body) -> Vec<Kernel> {
    let (lying, contacts) = body.lying();
    let mut predicted = lying.clone();
    predict(&mut predicted, GRAVITY, DT);
    let lying = || State::new(body, lying.clone(), contacts.clone(), CalibratedEdges::default());
    let predicted = || State::new(body, predicted.clone(), contacts.clone(), CalibratedEdges::default());
    let rods = || strained(body, Body::rods);
    let facets = || strained(body, Body::facets);
    let count = body.particles.len();
    let mut kernels = Vec::new();
    let mut add = |kernel: &'static str, unit, count, repeats, state, run| {
        kernels.push(Kernel { name: kernel, body: name, unit, count, repeats, state, run });
    };
    add("find pairs, anew", "particle", count, 1, lying(), |s| {
        s.own.clone_from(&s.fresh);
        s.own.find(&s.particles, &SEARCH, &mut s.finder, &mut s.pairs);
    });
    add("find pairs of those near", "particle", count, 1, lying(), |s| s.own.find(&s.particles, &SEARCH, &mut s.finder, &mut s.pairs));
    add("predict", "particle", count, 8, lying(), |s| {
        predict(&mut s.particles, GRAVITY, DT);
    });
    add("momentum, restore_angular_momentum", "particle", count, 8, predicted(), |s| {
        let before = momentum(&s.particles).angular;
        restore_angular_momentum(&mut s.particles, before + s.angular, DT);
    });
    let groups = body.groups.len();
    add("match_shapes", "group", groups, 1, predicted(), |s| {
        match_shapes(&mut s.groups, &mut s.particles, share(SHAPE), Turning::AllMembers, Sweep::only(DT));
    });
    add("match_shapes, scalar glam", "group", groups, 1, predicted(), |s| {
        s.scalar_groups.match_shapes(&mut s.particles, SHAPE.share(DT).stiffness, DT);
    });
    let edges = body.edges.len();
    add("solve_distances", "edge", edges, 1, predicted(), |s| {
        solve_distances(&mut s.edges, &mut s.particles, share(LENGTH), share(LENGTH), Sweep::only(DT));
    });
    add("solve_torsion", "edge", edges, 1, predicted(), |s| solve_torsion(&mut s.edges, &mut s.particles, share(TWIST), Sweep::only(DT)));
    let wide: fn(&mut State) = |s| solve_calibrated_edges(&s.calibrated, &mut s.particles, Sweep::only(DT));
    let scalar: fn(&mut State) = |s| s.scalar_edges.solve(&mut s.particles, DT);
    add("calibrated edges, rods", "edge", edges, 1, rods(), wide);
    add("calibrated edges, rods, scalar glam", "edge", edges, 1, rods(), scalar);
    add("calibrated edges, facets", "edge", edges, 1, facets(), wide);
    add("calibrated edges, facets, scalar glam", "edge", edges, 1, facets(), scalar);
    let (pressed, pairs) = pressed(body);
    add("solve_pairs, both passes", "pair", pairs, 1, pressed, |s| {
        let rules = PairRules { dt: DT, friction: FRICTION, push_speed: PUSH_SPEED };
        let mut sides = Sides::Within { particles: &mut s.particles, support: &s.support };
        for pass in 0..PAIR_PASSES {
            solve_pairs(&mut s.pairs, &mut sides, &rules, pass);
        }
    });
    add("solve_contacts", "contact", contacts.list.len(), 1, predicted(), |s| {
        solve_contacts(&mut s.contacts, &mut s.particles, DT, PUSH_SPEED);
    });
    add("integrate", "particle", count, 8, predicted(), |s| integrate(&mut s.particles, DT, DRAG));
    add("damp_internally", "particle", count, 8, predicted(), |s| damp_internally(&mut s.particles, DT, DAMPING));
    kernels
}

/// `body` made of calibrated edges, out of shape.
fn strained(body: &Body, make: fn(&Body) -> (polpo_solver::Particles, CalibratedEdges)) -> State {
    let (mut particles, calibrated) = make(body);
    stir(&mut particles, STRAIN);
    State::new(body, particles, Contacts::default(), calibrated)
}

/// `body` pressed flat, so that it touches itself, at the end of a substep; and how many pairs that makes.
fn pressed(body: &Body) -> (State, usize) {
    let mut particles = body.particles.clone();
    for x in &mut particles.position {
        *x *= Vec3A::new(1.0, PRESSED, 1.0);
    }
    predict(&mut particles, GRAVITY, DT);
    let mut state = State::new(body, particles, Contacts::default(), CalibratedEdges::default());
    state.own.find(&state.particles, &SEARCH, &mut state.finder, &mut state.pairs);
    state.keep_pairs();
    let count = state.pairs.list.len();
    (state, count)
}
