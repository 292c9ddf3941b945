//! What must not matter to calibrated edges: from where one looks at them, how the particles and facets are numbered, and where a rest pose is as a whole. Swept and solved directly, of sections and of
//! facets with their rings, in the shape they were made in and in a rest pose.

mod common;

use common::{Random, cases, cloud, pairs, stir};
use glam::{Mat3A, Quat, Vec3A};
use polpo_solver::{
    CalibratedEdges, DirectEdges, Edges, Facet, Material, ParticleRest, Particles, RestPose, Rings, Section, Sweep, integrate, predict,
    quat_exp, quat_log, solve_calibrated_edges, solve_rings,
};
use proptest::prelude::*;

const DT: f32 = 1.0 / 240.0;
const WAYS: usize = 5;

/// Twelve particles at random, with edges of a section and of facets.
#[derive(Clone)]
struct Scene {
    p: Particles,
    bars: CalibratedEdges,
    cells: CalibratedEdges,
    rings: Rings,
    direct_bars: DirectEdges,
    direct_cells: DirectEdges,
    gravity: Vec3A,
}

impl Scene {
    fn new(mut p: Particles, pairs: &[[u32; 2]], pose: &RestPose) -> Self {
        let material = Material { youngs_modulus: 1e5, poissons_ratio: 0.3, density: 1000.0 };
        // Slanted, beside the line between the particles, and the same from either side.
        let slant = quat_exp(Vec3A::new(0.2, -0.1, 0.15));
        let facet = |&pair: &[u32; 2]| {
            let [a, b] = pair.map(|i| p.rest_position[i as usize]);
            let beside = (a + b).cross(Vec3A::new(0.03, 0.02, -0.05));
            let moments = Mat3A::from_diagonal(glam::Vec3::new(1e-6, 2e-6, 3e-6));
            Facet { pair, area: slant * (b - a) * 0.02, centroid: (a + b) * 0.5 + beside, moments }
        };
        let facets: Vec<Facet> = pairs.iter().map(facet).collect();
        let volumes: Vec<f32> = p.rest_position.iter().map(|x| 1e-3 * (1.0 + x.x * x.x)).collect();
        let (mut cells, mut rings) = CalibratedEdges::from_facets(&mut p, &facets, &volumes, &material, 0.1).expect("sound facets");
        let edges = Edges::new(&p, pairs).expect("sound edges");
        let mut bars = CalibratedEdges::rods(&mut p.clone(), &edges, &material, &Section::circle(0.02), None, &[]).expect("sound rods");
        pose.check(p.len()).expect("a sound pose");
        bars.pose(&p, pose);
        cells.pose(&p, pose);
        rings.pose(&p, pose);
        let direct = |edges| DirectEdges::new(edges, p.len()).expect("few loops");
        Self { direct_bars: direct(&bars), direct_cells: direct(&cells), p, bars, cells, rings, gravity: Vec3A::NEG_Y * 9.81 }
    }

    /// The same scene turned by `q` and moved by `t`.
    fn seen_from(&self, q: Quat, t: Vec3A) -> Self {
        let mut scene = self.clone();
        scene.p.place(q, t);
        for i in 0..self.p.len() {
            scene.p.previous_position[i] = q * self.p.previous_position[i] + t;
            scene.p.previous_rotation[i] = (q * self.p.previous_rotation[i]).normalize();
        }
        scene.gravity = q * scene.gravity;
        scene
    }

    fn act(&mut self, which: usize) -> &'static str {
        let p = &mut self.p;
        match which {
            0 => solve_calibrated_edges(&self.bars, p, Sweep::only(DT)),
            1 => solve_calibrated_edges(&self.cells, p, Sweep::only(DT)),
            2 => solve_rings(&self.rings, p, DT),
            3 => drop(self.direct_bars.solve(&self.bars, p, DT)),
            _ => drop(self.direct_cells.solve(&self.cells, p, DT)),
        }
        ["bars, swept", "cells, swept", "rings", "bars, solved directly", "cells, solved directly"][which]
    }

    /// A whole substep, of the section or of the cells, swept or not.
    fn step(&mut self, which: usize) {
        integrate(&mut self.p, DT, 0.1);
        predict(&mut self.p, self.gravity, DT);
        self.act(which);
        if which == 1 {
            self.act(2);
        }
    }
}

/// Greatest difference of `b` from `a` turned by `q` and moved by `t`, `b`'s particle `to[i]` being `a`'s `i`: in places \[m\], rotations \[rad\] and velocities \[m/s\].
fn difference(a: &Particles, b: &Particles, q: Quat, t: Vec3A, to: &[usize]) -> [f32; 3] {
    let mut worst = [0.0f32; 3];
    for (i, &j) in to.iter().enumerate() {
        worst[0] = worst[0].max((q * a.position[i] + t).distance(b.position[j]));
        worst[1] = worst[1].max(quat_log(q * a.rotation[i] * b.rotation[j].inverse()).length());
        worst[2] = worst[2].max((q * a.velocity[i]).distance(b.velocity[j]));
    }
    worst
}

/// Particles, edges, and a rest pose: none, or one that moves, turns and swells each at random.
fn body(seed: u64) -> (Random, Particles, Vec<[u32; 2]>, RestPose) {
    let mut random = Random(seed);
    let p = cloud(&mut random, 12, false);
    let pairs = pairs(&p, 0.6);
    let mut pose = RestPose::default();
    if random.below(3) > 0 {
        pose.position = p.rest_position.iter().map(|x| *x + random.vector() * 0.05).collect();
        pose.size = (0..12).map(|_| random.between(0.8, 1.25)).collect();
        if random.below(2) > 0 {
            pose.rotation = (0..12).map(|_| quat_exp(random.vector() * 0.4)).collect();
        }
    }
    (random, p, pairs, pose)
}

const ALL: [usize; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn every_way_of_solving_turns_with_the_scene(seed: u64, which in 0usize..WAYS) {
        let (mut random, p, pairs, pose) = body(seed);
        let mut a = Scene::new(p, &pairs, &pose);
        stir(&mut random, &mut a.p, 0.05, 0.5);
        let (q, t) = (random.rotation(), random.vector());
        let mut b = a.seen_from(q, t);
        let before = a.p.clone();
        let (what, _) = (a.act(which), b.act(which));
        let [place, rotation, velocity] = difference(&a.p, &b.p, q, t, &ALL);
        prop_assert!(place < 1e-5 && rotation < 1e-4 && velocity < 5e-3, "{what}: {place:.1e} m, {rotation:.1e} rad, {velocity:.1e} m/s");
        prop_assert!(a.p.position != before.position, "{what} did nothing");
    }

    /// A pose that is moved and turned as a whole is the same pose.
    #[test]
    fn where_a_pose_is_does_not_matter(seed: u64, which in 0usize..WAYS) {
        let (mut random, p, pairs, mut pose) = body(seed);
        if pose.position.is_empty() {
            pose.position.clone_from(&p.rest_position);
        }
        if pose.rotation.is_empty() {
            pose.rotation = vec![Quat::IDENTITY; 12];
        }
        let mut a = Scene::new(p.clone(), &pairs, &pose);
        stir(&mut random, &mut a.p, 0.05, 0.5);
        let (q, t) = (random.rotation(), random.vector());
        pose.position.iter_mut().for_each(|x| *x = q * *x + t);
        pose.rotation.iter_mut().for_each(|r| *r = q * *r);
        let mut b = Scene { p: a.p.clone(), ..Scene::new(p, &pairs, &pose) };
        let (what, _) = (a.act(which), b.act(which));
        let [place, rotation, velocity] = difference(&a.p, &b.p, Quat::IDENTITY, Vec3A::ZERO, &ALL);
        prop_assert!(place < 1e-5 && rotation < 1e-4 && velocity < 5e-3, "{what}: {place:.1e} m, {rotation:.1e} rad, {velocity:.1e} m/s");
    }
}

proptest! {
    #![proptest_config(cases(150))]

    /// Thirty substeps, starting at rest beside the rest pose.
    #[test]
    fn a_simulation_turns_with_the_scene(seed: u64, which in 0usize..WAYS) {
        let (mut random, p, pairs, pose) = body(seed);
        let mut a = Scene::new(p, &pairs, &pose);
        for x in &mut a.p.position {
            *x += random.vector() * 0.02;
        }
        let (q, t) = (random.rotation(), random.vector());
        let mut b = a.seen_from(q, t);
        for _ in 0..30 {
            a.step(which);
            b.step(which);
        }
        let [place, rotation, velocity] = difference(&a.p, &b.p, q, t, &ALL);
        prop_assert!(place < 1e-4 && rotation < 1e-3 && velocity < 2e-2, "{which}: {place:.1e} m, {rotation:.1e} rad, {velocity:.1e} m/s");
    }

    /// The same body with its particles, edges and facets numbered otherwise, and some of them the other way round: the same motion to rounding.
    #[test]
    fn numbers_do_not_matter(seed: u64, which in 0usize..WAYS) {
        let (mut random, p, pairs, pose) = body(seed);
        let mut to = ALL;
        for i in (1..12).rev() {
            to.swap(i, random.below(i + 1));
        }
        let mut from = [0; 12];
        for i in 0..12 {
            from[to[i]] = i;
        }
        let rest: Vec<ParticleRest> = from.iter().map(|&i| {
            ParticleRest { position: p.rest_position[i], frame: p.frame[i], radii: p.radii[i], mass: p.mass[i] }
        }).collect();
        let mut other: Vec<[u32; 2]> = pairs.iter().map(|pair| {
            let [a, b] = pair.map(|i| to[i as usize] as u32);
            if random.below(2) == 0 { [a, b] } else { [b, a] }
        }).collect();
        for i in (1..other.len()).rev() {
            other.swap(i, random.below(i + 1));
        }
        let other_pose = RestPose {
            position: from.iter().filter_map(|&i| pose.position.get(i).copied()).collect(),
            rotation: from.iter().filter_map(|&i| pose.rotation.get(i).copied()).collect(),
            size: from.iter().filter_map(|&i| pose.size.get(i).copied()).collect(),
        };
        let mut a = Scene::new(p, &pairs, &pose);
        let mut b = Scene::new(Particles::new(&rest).unwrap(), &other, &other_pose);
        for (i, &j) in to.iter().enumerate() {
            let (way, turn) = (random.vector() * 0.02, quat_exp(random.vector() * 0.3));
            a.p.position[i] += way;
            b.p.position[j] += way;
            a.p.rotation[i] = turn;
            b.p.rotation[j] = turn;
        }
        for _ in 0..30 {
            a.step(which);
            b.step(which);
        }
        let [place, rotation, velocity] = difference(&a.p, &b.p, Quat::IDENTITY, Vec3A::ZERO, &to);
        prop_assert!(place < 1e-4 && rotation < 1e-3 && velocity < 2e-2, "{which}: {place:.1e} m, {rotation:.1e} rad, {velocity:.1e} m/s");
    }
}
