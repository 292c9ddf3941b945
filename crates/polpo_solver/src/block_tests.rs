//! Blocks: that they are what they are said to be, and do what whole bodies do in their order.

use glam::Vec3A;

use crate::testing::{Random, stir};
use crate::{
    Blocks, Constraints, Edges, Executor, ImplicitGroups, InTurn, ParticleRest, Particles, RestPose, Share, Shares, Stiffness, Sweep,
    Turning, match_shapes, momentum, quat_exp, solve_blocks, solve_distances, solve_torsion,
};

const DT: f32 = 0.01;

/// A block of n³ unequal ellipsoids a little out of their lattice, `stretch` times longer along z, joined along axes and face diagonals; numbered as `number` says.
fn block(n: usize, stretch: f32, number: impl Fn(usize) -> usize) -> (Particles, ImplicitGroups, Edges) {
    let mut random = Random(42);
    let count = n * n * n;
    let cell = |i: usize| [i % n, i / n % n, i / n / n];
    let made: Vec<ParticleRest> = (0..count)
        .map(|i| ParticleRest {
            position: Vec3A::from(cell(i).map(|x| x as f32 * 0.2)) * Vec3A::new(1.0, 1.0, stretch) + random.vector() * 0.02,
            frame: quat_exp(random.vector() * 2.0),
            radii: Vec3A::splat(0.1) + random.vector() * 0.05,
            mass: 1.0 + 0.5 * random.signed(),
        })
        .collect();
    let mut rest = made.clone();
    made.iter().enumerate().for_each(|(i, p)| rest[number(i)] = *p);
    let mut pairs = Vec::new();
    for i in 0..count {
        for j in i + 1..count.min(i + n * n + n + 2) {
            let [a, b] = [cell(i), cell(j)];
            let way: [usize; 3] = core::array::from_fn(|k| a[k].abs_diff(b[k]));
            if way.iter().all(|&w| w < 2) && way.iter().sum::<usize>() < 3 {
                pairs.push([number(i) as u32, number(j) as u32]);
            }
        }
    }
    let particles = Particles::new(&rest).unwrap();
    let edges = Edges::new(&particles, &pairs).unwrap();
    (particles.clone(), ImplicitGroups::new(&particles, &edges), edges)
}

fn one(fraction: f32) -> Shares<'static> {
    Stiffness::Fraction(fraction).share(DT).into()
}

fn soft() -> Constraints<'static> {
    Constraints { shapes: one(0.3), turning: Turning::AllMembers, tension: one(0.5), compression: one(0.4), torsion: one(0.2) }
}

/// Block after block on the whole body.
struct InOrder(Vec<(ImplicitGroups, Edges)>);

impl InOrder {
    fn of(blocks: &Blocks, particles: &Particles, groups: &ImplicitGroups, edges: &Edges) -> Self {
        let parts = (0..blocks.color_count()).flat_map(|color| blocks.color(color)).map(|block| {
            let rows: Vec<&[u32]> = block.groups().iter().map(|&g| groups.members(g as usize)).collect();
            let pairs: Vec<[u32; 2]> = block.edges().iter().map(|&e| edges.pairs[e as usize]).collect();
            let mut part = Edges::new(particles, &pairs).unwrap();
            part.input = part.input.iter().map(|&e| edges.input[block.edges()[e as usize] as usize]).collect();
            (ImplicitGroups::of(particles, &rows).unwrap(), part)
        });
        Self(parts.collect())
    }

    fn solve(&mut self, p: &mut Particles, c: &Constraints, sweep: Sweep) {
        for (groups, edges) in &mut self.0 {
            match_shapes(groups, p, c.shapes, c.turning, sweep);
            solve_distances(edges, p, c.tension, c.compression, sweep);
            solve_torsion(edges, p, c.torsion, sweep);
        }
    }
}

/// Threads of its own, so many, which take one task after the other.
struct Threads(usize);

impl Executor for Threads {
    fn each<T: Send>(&self, tasks: &mut [T], work: impl Fn(&mut T) + Send + Sync) {
        let queue = std::sync::Mutex::new(tasks.iter_mut());
        std::thread::scope(|scope| {
            for _ in 0..self.0 {
                scope.spawn(|| {
                    loop {
                        let task = queue.lock().unwrap().next();
                        match task {
                            Some(task) => work(task),
                            None => break,
                        }
                    }
                });
            }
        });
    }
}

#[test]
fn every_group_and_edge_is_in_one_block_and_a_colour_shares_no_particle() {
    for stretch in [0.7, 1.0, 3.0] {
        let (p, groups, edges) = block(18, stretch, |i| i);
        let blocks = Blocks::new(&p, &groups, &edges);
        assert!(blocks.len() >= 4 && blocks.color_count() == 2, "{} in {} colours", blocks.len(), blocks.color_count());
        let (mut group_seen, mut edge_seen) = (vec![0; groups.len()], vec![0; edges.len()]);
        let mut largest = 0;
        for color in 0..blocks.color_count() {
            let mut touched = vec![false; p.len()];
            for block in blocks.color(color) {
                largest = largest.max(block.groups().len());
                assert!(block.particles().is_sorted_by(|a, b| a < b));
                for &i in block.particles() {
                    assert!(!std::mem::replace(&mut touched[i as usize], true), "particle {i} twice in colour {color}");
                }
                block.groups().iter().for_each(|&g| group_seen[g as usize] += 1);
                block.edges().iter().for_each(|&e| edge_seen[e as usize] += 1);
                let has = |i: &u32| block.particles().binary_search(i).is_ok();
                assert!(block.groups().iter().all(|&g| groups.members(g as usize).iter().all(has)));
                assert!(block.edges().iter().all(|&e| edges.pairs[e as usize].iter().all(has)));
            }
        }
        assert!(group_seen.iter().chain(&edge_seen).all(|&seen| seen == 1));
        assert!(largest * blocks.len() < groups.len() * 3 / 2, "the largest of {} has {largest} groups", blocks.len());
    }
}

#[test]
fn small_and_bare_bodies_are_left_in_one_piece() {
    let (p, groups, edges) = block(4, 1.0, |i| i);
    assert_eq!(Blocks::new(&p, &groups, &edges).len(), 1);
    assert!(Blocks::new(&p, &ImplicitGroups::default(), &Edges::default()).is_empty());
    assert!(Blocks::new(&Particles::default(), &ImplicitGroups::default(), &Edges::default()).is_empty());
}

/// To the bit what the kernels for whole bodies do with the same groups and edges, block after block: plain, and with everything that a block has to be told.
#[test]
fn blocks_do_what_is_done_one_after_the_other() {
    let (rest, groups, edges) = block(18, 1.0, |i| i);
    let each = |count: usize, seed| {
        let mut random = Random(seed);
        let share = |r: f32| Stiffness::Fraction(if r > 0.9 { 1.0 } else { r.max(0.0) }).share(DT);
        (0..count).map(|_| share(random.signed())).collect::<Vec<Share>>()
    };
    let (of_groups, of_edges) = (each(rest.len(), 5), each(edges.len(), 6));
    let told =
        Constraints { shapes: Shares::Each(&of_groups), tension: Shares::Each(&of_edges), torsion: Shares::Each(&of_edges), ..soft() };
    let damped = Constraints { shapes: Stiffness::damped(10.0, 0.3).share(DT).into(), ..soft() };
    let paper = Constraints { turning: Turning::MainOnly, ..soft() };
    for (constraints, sweeps, pinned) in [(soft(), 1, false), (told, 1, true), (damped, 2, false), (paper, 1, false)] {
        let mut p = rest.clone();
        stir(&mut p, 3, 0.2);
        if pinned {
            (0..p.len()).step_by(97).for_each(|i| p.pin(i, true, i % 2 == 0));
            p.reaction = vec![Vec3A::ZERO; p.len()];
        }
        let mut blocks = Blocks::new(&p, &groups, &edges);
        let mut order = InOrder::of(&blocks, &p, &groups, &edges);
        let mut whole = p.clone();
        for round in 0..2 {
            for index in 0..sweeps {
                let sweep = Sweep { dt: DT, index, count: sweeps, deterministic: false };
                solve_blocks(&mut blocks, &mut p, &constraints, sweep, &InTurn);
                order.solve(&mut whole, &constraints, sweep);
            }
            // Not the sums of what was pushed, of which the blocks make sums of their own.
            assert!(p.position == whole.position && p.velocity == whole.velocity, "round {round}");
            assert!(p.rotation == whole.rotation && p.angular_velocity == whole.angular_velocity, "round {round}");
            assert_eq!(p.rigid_push.len(), whole.rigid_push.len());
            for (a, b) in p.rigid_push.iter().zip(&whole.rigid_push) {
                assert!(a[0].distance(b[0]) < 1e-3 && a[1].distance(b[1]) < 1e-3);
            }
            for (a, b) in p.reaction.iter().zip(&whole.reaction) {
                assert!(a.distance(*b) < 1e-4 * (1.0 + b.length()));
            }
            assert_eq!(pinned, p.reaction.iter().any(|r| *r != Vec3A::ZERO));
            // Masses that change between two passes are no news.
            for i in (0..p.len()).step_by(3) {
                p.set_mass(i, 2.0);
                whole.set_mass(i, 2.0);
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (mut p, groups, edges) = block(18, 1.0, |i| i);
    stir(&mut p, 3, 0.2);
    let blocks = Blocks::new(&p, &groups, &edges);
    let solve = |executor: &dyn Fn(&mut Blocks, &mut Particles)| {
        let (mut blocks, mut p) = (blocks.clone(), p.clone());
        (0..3).for_each(|_| executor(&mut blocks, &mut p));
        p
    };
    let one = solve(&|blocks, p| solve_blocks(blocks, p, &soft(), Sweep::only(DT), &InTurn));
    assert_ne!(one, p);
    for threads in [1, 2, 8] {
        let many = solve(&|blocks, p| solve_blocks(blocks, p, &soft(), Sweep::only(DT), &Threads(threads)));
        assert!(one == many, "{threads} threads");
    }
}

#[test]
fn linear_momentum_is_kept() {
    let (mut p, groups, edges) = block(18, 1.0, |i| i);
    stir(&mut p, 3, 0.2);
    let before = momentum(&p);
    let mut blocks = Blocks::new(&p, &groups, &edges);
    let scale: f32 = p.velocity.iter().zip(&p.mass).map(|(v, m)| v.length() * m).sum();
    solve_blocks(&mut blocks, &mut p, &soft(), Sweep::only(DT), &InTurn);
    let moved: f32 = p.velocity.iter().zip(&p.mass).map(|(v, m)| v.length() * m).sum();
    assert!((moved / scale - 1.0).abs() > 0.1, "{moved} of {scale}");
    let lost = momentum(&p).linear.distance(before.linear);
    assert!(lost < 1e-6 * moved, "{lost} of {moved}");
}

/// The same groups go into the same blocks, whatever the numbers of the particles.
#[test]
fn how_a_body_is_cut_does_not_depend_on_numbers() {
    // 1,001 has no factor in common with 5,832.
    let number = |i: usize| i * 1001 % 5832;
    let cuts = [block(18, 1.2, |i| i), block(18, 1.2, number)].map(|(p, groups, edges)| {
        let blocks = Blocks::new(&p, &groups, &edges);
        let place = |g: &u32| p.rest_position[groups.members(*g as usize)[0] as usize].to_array().map(f32::to_bits);
        let mut places: Vec<Vec<_>> = blocks.list.iter().map(|block| block.groups().iter().map(place).collect()).collect();
        places.iter_mut().for_each(|list| list.sort_unstable());
        places
    });
    assert!(cuts[0].len() >= 4);
    assert_eq!(cuts[0], cuts[1]);
}

/// Rest shapes that change reach the blocks when they are told to follow.
#[test]
fn blocks_follow_what_they_were_made_from() {
    let (p, mut groups, mut edges) = block(18, 1.0, |i| i);
    let mut blocks = Blocks::new(&p, &groups, &edges);
    let mut random = Random(9);
    let pose = RestPose {
        size: (0..p.len()).map(|_| 1.2 + 0.1 * random.signed()).collect(),
        position: p.rest_position.iter().map(|x| *x * Vec3A::new(1.1, 1.0, 0.9)).collect(),
        rotation: (0..p.len()).map(|_| quat_exp(random.vector() * 0.2)).collect(),
    };
    groups.pose(&p, &pose);
    edges.pose(&p, &pose);
    blocks.follow(&groups, &edges);
    assert_eq!(blocks, Blocks::new(&p, &groups, &edges));
    for block in &blocks.list {
        for (own, &g) in block.group_of.iter().enumerate() {
            assert_eq!(block.groups.rest(own), groups.rest(g as usize));
        }
        for (own, &e) in block.edge_of.iter().enumerate() {
            assert_eq!(block.edges.rest_length[own], edges.rest_length[e as usize]);
            assert_eq!(block.edges.rest_turn[own], edges.rest_turn[e as usize]);
        }
    }
}
