//! What must not matter: from where one looks at a scene, and how its particles are numbered.
//!
//! *The frame.* Everything here is relative: a scene turned and moved, gravity and colliders with it, has the answer turned and moved, to the rounding of f32 at the coordinates it has there.
//!
//! *The numbers.* Constraints are solved one after the other, so their order matters as long as they have not converged. It is the order of where they are at rest, so that bodies whose particles and
//! edges are numbered differently do the same to rounding. Explicit groups come in the order in which they are given, and so do contacts.

mod common;

use common::{Random, cases, cloud, pairs, stir};
use glam::{Quat, Vec3A};
use polpo_solver::{
    CalibratedEdges, Contact, Contacts, Edges, ExplicitGroup, ExplicitGroups, ImplicitGroups, Material, ParticleRest, Particles, Section,
    Stiffness, Sweep, Turning, blow, damp_internally, integrate, land_explicit_groups, match_explicit_groups, match_shapes, momentum,
    predict, predict_explicit, quat_exp, quat_log, restore_angular_momentum, solve_calibrated_edges, solve_contacts, solve_contacts_beside,
    solve_distances, solve_torsion,
};
use proptest::prelude::*;

const DT: f32 = 1.0 / 240.0;

/// A body with everything that can act on it.
#[derive(Clone)]
struct Scene {
    p: Particles,
    groups: ImplicitGroups,
    edges: Edges,
    rods: CalibratedEdges,
    explicit: ExplicitGroups,
    contacts: Contacts,
    gravity: Vec3A,
    wind: Vec3A,
    share: Stiffness,
}

impl Scene {
    /// `particles` joined by `pairs`, one explicit group of `rigid` members, and a floor a little above the lowest centre.
    fn new(mut p: Particles, pairs: &[[u32; 2]], rigid: &[u32], stiffness: Stiffness) -> Self {
        let edges = Edges::new(&p, pairs).expect("sound edges");
        let material = Material { youngs_modulus: 1e5, poissons_ratio: 0.3, density: 1000.0 };
        let rods = CalibratedEdges::rods(&mut p, &edges, &material, &Section::circle(0.05), Some(0.1), &[]).expect("sound rods");
        let explicit = ExplicitGroups::new(&p, &[ExplicitGroup::rigid(rigid)]).expect("a sound group");
        let groups = ImplicitGroups::beside(&p, &edges, &explicit);
        let low = p.position.iter().map(|x| x.y).fold(f32::INFINITY, f32::min);
        let floor = |particle| Contact {
            particle,
            friction: 0.5,
            point: Vec3A::Y * (low + 0.05),
            normal: Vec3A::Y,
            velocity: Vec3A::X * 0.3,
            angular_velocity: Vec3A::Y * 0.2,
            impulse: 0.0,
        };
        let contacts = Contacts { list: (0..p.len() as u32).map(floor).collect() };
        Self {
            p,
            groups,
            edges,
            rods,
            explicit,
            contacts,
            gravity: Vec3A::NEG_Y * 9.81,
            wind: Vec3A::new(3.0, 0.0, -2.0),
            share: stiffness,
        }
    }

    /// The same scene turned by `q` and moved by `t`.
    fn seen_from(&self, q: Quat, t: Vec3A) -> Self {
        let mut scene = self.clone();
        let previous: Vec<(Vec3A, Quat)> = self.p.previous_position.iter().copied().zip(self.p.previous_rotation.iter().copied()).collect();
        scene.p.place(q, t);
        for (i, (x, r)) in previous.into_iter().enumerate() {
            scene.p.previous_position[i] = q * x + t;
            scene.p.previous_rotation[i] = (q * r).normalize();
        }
        for r in &mut scene.groups.rotation {
            *r = (q * *r).normalize();
        }
        for c in &mut scene.contacts.list {
            (c.point, c.normal, c.velocity, c.angular_velocity) = (q * c.point + t, q * c.normal, q * c.velocity, q * c.angular_velocity);
        }
        (scene.gravity, scene.wind) = (q * scene.gravity, q * scene.wind);
        scene
    }

    /// One of the things that can be done to it, alone.
    fn act(&mut self, which: usize) -> &'static str {
        let p = &mut self.p;
        let share = self.share.share(DT);
        let sweep = Sweep::only(DT);
        match which {
            0 => {
                predict(p, self.gravity, DT);
                "predict"
            }
            1 => {
                match_shapes(&mut self.groups, p, share.into(), Turning::AllMembers, sweep);
                "implicit groups, all members"
            }
            2 => {
                match_shapes(&mut self.groups, p, share.into(), Turning::MainOnly, sweep);
                "implicit groups, main only"
            }
            3 => {
                solve_distances(&mut self.edges, p, share.into(), share.into(), sweep);
                "distances"
            }
            4 => {
                solve_torsion(&mut self.edges, p, share.into(), sweep);
                "torsion"
            }
            5 => {
                solve_calibrated_edges(&self.rods, p, Sweep::only(DT));
                "calibrated edges"
            }
            6 => {
                predict_explicit(&mut self.explicit, p, DT);
                "explicit groups, predicted"
            }
            7 => {
                predict_explicit(&mut self.explicit, p, DT);
                solve_distances(&mut self.edges, p, share.into(), share.into(), sweep);
                match_explicit_groups(&mut self.explicit, p, sweep);
                "explicit groups, matched"
            }
            8 => {
                solve_contacts(&mut self.contacts, p, DT, 3.0);
                "contacts"
            }
            9 => {
                predict_explicit(&mut self.explicit, p, DT);
                solve_contacts_beside(&self.explicit, &mut self.contacts, p, DT, 3.0);
                land_explicit_groups(&mut self.explicit, p, DT);
                "contacts of explicit groups"
            }
            10 => {
                damp_internally(p, DT, 5.0);
                integrate(p, DT, 1.0);
                "damping"
            }
            11 => {
                blow(p, self.wind, 1.2, 0.5, DT);
                "wind"
            }
            _ => {
                let target = momentum(p).angular * 0.9;
                restore_angular_momentum(p, target, DT);
                "angular momentum restored"
            }
        }
    }

    /// A whole substep.
    fn step(&mut self) {
        let p = &mut self.p;
        let share = self.share.share(DT);
        blow(p, self.wind, 1.2, 0.5, DT);
        predict(p, self.gravity, DT);
        predict_explicit(&mut self.explicit, p, DT);
        let angular = momentum(p).angular;
        for index in 0..2 {
            let sweep = Sweep { index, count: 2, ..Sweep::only(DT) };
            match_shapes(&mut self.groups, p, share.into(), Turning::AllMembers, sweep);
            solve_distances(&mut self.edges, p, share.into(), share.into(), sweep);
            solve_torsion(&mut self.edges, p, share.into(), sweep);
            solve_calibrated_edges(&self.rods, p, Sweep::only(DT));
            match_explicit_groups(&mut self.explicit, p, sweep);
        }
        restore_angular_momentum(p, angular, DT);
        solve_contacts_beside(&self.explicit, &mut self.contacts, p, DT, 3.0);
        land_explicit_groups(&mut self.explicit, p, DT);
        integrate(p, DT, 0.1);
        damp_internally(p, DT, 2.0);
    }
}

/// Greatest difference of `b` from `a` turned by `q` and moved by `t`, `b`'s particle `to[i]` being `a`'s `i`: in places \[m\], rotations \[rad\] and velocities \[m/s, m·rad/s\].
fn difference(a: &Particles, b: &Particles, q: Quat, t: Vec3A, to: &[usize]) -> [f32; 3] {
    let mut worst = [0.0f32; 3];
    for (i, &j) in to.iter().enumerate() {
        worst[0] = worst[0].max((q * a.position[i] + t).distance(b.position[j]));
        worst[1] = worst[1].max(quat_log(q * a.rotation[i] * b.rotation[j].inverse()).length());
        let spin = (q * a.angular_velocity[i]).distance(b.angular_velocity[j]) * a.radii[i].max_element();
        worst[2] = worst[2].max((q * a.velocity[i]).distance(b.velocity[j])).max(spin);
    }
    worst
}

/// A stirred body of 12 particles, a stiffness, and the edges.
fn body(seed: u64) -> (Random, Particles, Vec<[u32; 2]>, Stiffness) {
    let mut random = Random(seed);
    let p = cloud(&mut random, 12, false);
    let pairs = pairs(&p, 0.6);
    let stiffness = match random.below(3) {
        0 => Stiffness::RIGID,
        1 => Stiffness::Fraction(random.unit()),
        _ => Stiffness::damped(random.between(0.1, 100.0), random.unit()),
    };
    (random, p, pairs, stiffness)
}

proptest! {
    #![proptest_config(cases(1500))]

    #[test]
    fn every_constraint_turns_with_the_scene(seed: u64, which in 0usize..13) {
        let (mut random, p, pairs, stiffness) = body(seed);
        let mut a = Scene::new(p, &pairs, &[0, 3, 4, 7], stiffness);
        stir(&mut random, &mut a.p, 0.05, 0.5);
        let (q, t) = (random.rotation(), random.vector());
        let mut b = a.seen_from(q, t);
        let (what, _) = (a.act(which), b.act(which));
        let all: Vec<usize> = (0..a.p.len()).collect();
        let [place, rotation, velocity] = difference(&a.p, &b.p, q, t, &all);
        // Coordinates of two metres are rounded to 1e-7, a rotation of two or three particles nearly in a row magnifies that; velocities are ways over Δt.
        prop_assert!(place < 1e-5 && rotation < 1e-4 && velocity < 5e-3, "{what}: {place:.1e} m, {rotation:.1e} rad, {velocity:.1e} m/s");
    }
}

proptest! {
    #![proptest_config(cases(200))]

    /// Everything at once for thirty substeps, starting at rest in a bent shape.
    #[test]
    fn a_simulation_turns_with_the_scene(seed: u64) {
        let (mut random, p, pairs, _) = body(seed);
        let mut a = Scene::new(p, &pairs, &[0, 3, 4, 7], Stiffness::damped(8.0, 0.5));
        for x in &mut a.p.position {
            *x += random.vector() * 0.02;
        }
        let (q, t) = (random.rotation(), random.vector());
        let mut b = a.seen_from(q, t);
        for _ in 0..30 {
            a.step();
            b.step();
        }
        let all: Vec<usize> = (0..a.p.len()).collect();
        let [place, rotation, velocity] = difference(&a.p, &b.p, q, t, &all);
        prop_assert!(place < 1e-4 && rotation < 1e-3 && velocity < 2e-2, "{place:.1e} m, {rotation:.1e} rad, {velocity:.1e} m/s");
    }

    /// The same body with its particles and its edges numbered otherwise, and some edges the other way round: the same motion to rounding.
    #[test]
    fn numbers_do_not_matter(seed: u64) {
        let (mut random, p, pairs, _) = body(seed);
        let n = p.len();
        let mut to: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            to.swap(i, random.below(i + 1));
        }
        let mut rest = vec![None; n];
        for i in 0..n {
            rest[to[i]] = Some(ParticleRest { position: p.rest_position[i], frame: p.frame[i], radii: p.radii[i], mass: p.mass[i] });
        }
        let renumbered = Particles::new(&rest.into_iter().flatten().collect::<Vec<_>>()).unwrap();
        let mut other: Vec<[u32; 2]> = pairs.iter().map(|pair| {
            let [a, b] = pair.map(|i| to[i as usize] as u32);
            if random.below(2) == 0 { [a, b] } else { [b, a] }
        }).collect();
        other.sort_unstable();
        let rigid = [0, 3, 4, 7];
        let mut a = Scene::new(p, &pairs, &rigid, Stiffness::damped(8.0, 0.5));
        let mut b = Scene::new(renumbered, &other, &rigid.map(|i| to[i as usize] as u32), Stiffness::damped(8.0, 0.5));
        for (i, &j) in to.iter().enumerate() {
            let (way, turn) = (random.vector() * 0.02, quat_exp(random.vector() * 0.3));
            a.p.position[i] += way;
            b.p.position[j] += way;
            a.p.rotation[i] = turn;
            b.p.rotation[j] = turn;
        }
        for _ in 0..30 {
            a.step();
            b.step();
        }
        let [place, rotation, velocity] = difference(&a.p, &b.p, Quat::IDENTITY, Vec3A::ZERO, &to);
        prop_assert!(place < 1e-4 && rotation < 1e-3 && velocity < 2e-2, "{place:.1e} m, {rotation:.1e} rad, {velocity:.1e} m/s");
    }
}
