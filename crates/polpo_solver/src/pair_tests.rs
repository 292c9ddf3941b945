//! Pairs of particles: found, pushed apart, rubbed, with momentum kept.

use glam::{Quat, Vec3A};

use crate::testing::{Random, blob, line};
use crate::*;

const G: Vec3A = Vec3A::new(0.0, -9.81, 0.0);

fn body(rest: &[(Vec3A, Vec3A, f32)]) -> Particles {
    let rest: Vec<ParticleRest> =
        rest.iter().map(|&(position, radii, mass)| ParticleRest { position, frame: Quat::IDENTITY, radii, mass }).collect();
    Particles::new(&rest).unwrap()
}

fn search(dt: f32) -> PairSearch {
    PairSearch { dt, gain: 9.81 * dt }
}

fn find(p: &Particles, dt: f32) -> Pairs {
    let mut pairs = Pairs::default();
    SelfSearch::default().find(p, &search(dt), &mut PairFinder::default(), &mut pairs);
    pairs
}

fn solve(pairs: &mut Pairs, p: &mut Particles, rules: &PairRules) {
    for pass in 0..PAIR_PASSES {
        solve_pairs(pairs, &mut Sides::Within { particles: p, support: &[] }, rules, pass);
    }
}

/// A step of one substep, pairs found anew.
fn step(p: &mut Particles, pairs: &mut Pairs, gravity: Vec3A, friction: f32, dt: f32) {
    SelfSearch::default().find(p, &search(dt), &mut PairFinder::default(), pairs);
    predict(p, gravity, dt);
    solve(pairs, p, &PairRules { dt, friction, push_speed: 3.0 });
    integrate(p, dt, 0.0);
}

fn gap(p: &Particles, i: usize, j: usize) -> f32 {
    EllipsoidPair::new(&p.ellipsoid(i), &p.ellipsoid(j), p.position[j] - p.position[i]).contact().gap
}

fn random_body(random: &mut Random, n: usize, spread: f32) -> Particles {
    let rest: Vec<ParticleRest> = (0..n)
        .map(|i| ParticleRest {
            position: random.vector() * spread,
            frame: quat_exp(random.vector() * 3.0),
            radii: (Vec3A::splat(0.11) + random.vector() * 0.1) * if i % 10 == 0 { 5.0 } else { 1.0 },
            mass: 1.0 + 0.9 * random.signed(),
        })
        .collect();
    let mut p = Particles::new(&rest).unwrap();
    for i in 0..n {
        p.velocity[i] = random.vector() * 3.0;
        p.angular_velocity[i] = random.vector() * 10.0;
    }
    p
}

/// Random states keep P and L to the rounding of `f32`. Energy may rise by what it takes to put L right after the two have been moved: thousandths of it at 3 m/s, 1 % of a radius a substep.
#[test]
fn momentum_is_kept_and_no_energy_made() {
    let mut random = Random(2);
    let (mut touched, mut worst, mut gained) = (0, [0.0f32; 2], [0.0f32; 2]);
    for k in 0..4000 {
        let mut p = random_body(&mut random, 2, 0.25);
        let by_motion = k % 2 == 0;
        if by_motion {
            let d = p.position[1] - p.position[0];
            let apart = gap(&p, 0, 1);
            p.position[1] -= d.normalize() * (apart - 0.002);
            // The way out of a deep overlap is another than the line of centres.
            let left = (0.002 - gap(&p, 0, 1)).max(0.0);
            p.position[1] += d.normalize() * left;
        }
        predict(&mut p, Vec3A::ZERO, 1.0 / 300.0);
        let mut pairs = find(&p, 1.0 / 60.0);
        let before = momentum(&p);
        solve(&mut pairs, &mut p, &PairRules { dt: 1.0 / 300.0, friction: 0.5, push_speed: 3.0 });
        let after = momentum(&p);
        touched += usize::from(pairs.touch());
        let scale = [before.mass * 5.0, before.mass * 5.0 * 0.5];
        let errors = [before.linear.distance(after.linear) / scale[0], before.angular.distance(after.angular) / scale[1]];
        worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
        let kind = usize::from(!by_motion);
        gained[kind] = gained[kind].max(after.kinetic_energy / before.kinetic_energy - 1.0);
    }
    println!("{touched} touched; P off by {:.1e}, L by {:.1e}, energy gained {gained:?}", worst[0], worst[1]);
    assert!(touched > 2000);
    assert!(worst[0] < 3e-7 && worst[1] < 5e-7, "{worst:?}");
    assert!(gained[0] < 5e-3 && gained[1] < 0.01, "{gained:?}");
}

/// Forty particles in a heap, three seconds of it.
#[test]
fn a_heap_of_particles_keeps_its_momentum() {
    let mut random = Random(9);
    let mut p = random_body(&mut random, 40, 1.0);
    let before = momentum(&p);
    let mut pairs = Pairs::default();
    let mut energy = before.kinetic_energy;
    let origin = |m: &Momentum| m.angular + m.center.cross(m.linear);
    for _ in 0..900 {
        step(&mut p, &mut pairs, Vec3A::ZERO, 0.3, 1.0 / 300.0);
        let now = momentum(&p).kinetic_energy;
        assert!(now < energy * (1.0 + 1e-5), "{now} J after {energy} J");
        energy = now;
    }
    let after = momentum(&p);
    let size: f32 = (0..40).map(|i| p.mass[i] * 3.0).sum();
    let (linear, angular) = (before.linear.distance(after.linear) / size, origin(&before).distance(origin(&after)) / size);
    println!("P off by {linear:.1e}, L by {angular:.1e}; {:.2} of the energy left", energy / before.kinetic_energy);
    // Nine hundred substeps of dozens of pairs, each off by the rounding of `f32`.
    assert!(linear < 1e-6 && angular < 1e-5);
    assert!(energy < 0.9 * before.kinetic_energy, "they did not meet");
}

/// Of two balls that meet, the heavier carries the lighter along: no bounce, P kept.
#[test]
fn a_blow_is_inelastic_and_its_speed_is_told() {
    let mut p = body(&[(Vec3A::ZERO, Vec3A::splat(0.1), 1.0), (Vec3A::X * 0.5, Vec3A::splat(0.1), 3.0)]);
    p.velocity[0] = Vec3A::X * 4.0;
    let mut pairs = Pairs::default();
    let mut closing = 0.0f32;
    for _ in 0..60 {
        step(&mut p, &mut pairs, Vec3A::ZERO, 0.0, 1.0 / 300.0);
        closing = pairs.list.iter().fold(closing, |c, pair| c.max(pair.closing_speed));
    }
    assert!((closing - 4.0).abs() < 1e-5, "{closing}");
    for v in &p.velocity {
        assert!((v.x - 1.0).abs() < 1e-5, "{v}");
    }
    assert!(gap(&p, 0, 1).abs() < 1e-5);
}

/// A plate a hundred metres wide, held; what rests on it meets a plane but for 1 mm.
fn plate() -> (Vec3A, Vec3A, f32) {
    (Vec3A::new(0.0, -2.5, 0.0), Vec3A::new(50.0, 2.5, 50.0), 1000.0)
}

/// v₀ = 3 m/s, μ = 0.3 stops after v₀²/(2μg) = 1.52905 m and v₀/(μg) = 1.01937 s. The plate's middle is halfway, so that its curvature, a slope of 7e-4 at either end, slows as much as it speeds. Its 50 m
/// carry rounding of 4e-6 m, which is why it is not asked at 960 Hz.
#[test]
fn a_sliding_block_stops_where_coulomb_says() {
    for rate in [60.0, 240.0] {
        let dt = 1.0 / rate;
        let mut p = body(&[plate(), (Vec3A::new(-0.75, 0.1, 0.0), Vec3A::splat(0.1), 2.0)]);
        p.pin(0, true, true);
        p.pin(1, false, true);
        p.velocity[1] = Vec3A::X * 3.0;
        let (mut pairs, mut time) = (Pairs::default(), 0.0);
        for k in 0..(2.0 * rate) as usize {
            step(&mut p, &mut pairs, G, 0.3, dt);
            if time == 0.0 && p.velocity[1].x < 2e-3 {
                time = (k + 1) as f32 * dt;
            }
        }
        let way = p.position[1].x + 0.75;
        assert!((time - 1.01937).abs() < 1.5 * dt + 0.005, "{rate} Hz: {time} s");
        assert!((way - 1.52905).abs() < 2.0 * dt + 0.005, "{rate} Hz: {way} m");
    }
}

/// Both slide, on nothing but each other, and end at one speed: (m₁v₁ + m₂v₂)/(m₁ + m₂) after Δv/(μF(1/m₁ + 1/m₂)).
#[test]
fn two_blocks_rub_to_one_speed() {
    let dt = 1.0 / 300.0;
    let plate = |y: f32| (Vec3A::new(0.0, y, 0.0), Vec3A::new(50.0, 2.5, 50.0));
    let ((xa, ra), (xb, rb)) = (plate(-2.5), plate(2.5));
    let mut p = body(&[(xa, ra, 4.0), (xb, rb, 1.0)]);
    p.pin(0, false, true);
    p.pin(1, false, true);
    p.velocity[1] = Vec3A::X * 2.0;
    let (mut pairs, mut time) = (Pairs::default(), 0.0);
    for k in 0..300 {
        // Pressed together by 10 N.
        p.velocity[0].y += 10.0 / 4.0 * dt;
        p.velocity[1].y -= 10.0 * dt;
        step(&mut p, &mut pairs, Vec3A::ZERO, 0.4, dt);
        if time == 0.0 && p.velocity[1].x - p.velocity[0].x < 0.01 {
            time = (k + 1) as f32 * dt;
        }
    }
    assert!((p.velocity[0].x - 0.4).abs() < 1e-3 && (p.velocity[1].x - 0.4).abs() < 1e-3, "{:?}", p.velocity);
    let exact = 2.0 / (0.4 * 10.0 * (1.0 / 4.0 + 1.0));
    assert!((time - exact).abs() < 0.03 * exact, "{time} s against {exact} s");
}

/// A ball that slides on a plate ends up rolling, the right way round.
#[test]
fn a_sliding_ball_ends_up_rolling() {
    let mut p = body(&[plate(), (Vec3A::new(-1.0, 0.1, 0.0), Vec3A::splat(0.1), 2.0)]);
    p.pin(0, true, true);
    p.velocity[1] = Vec3A::X * 3.0;
    let mut pairs = Pairs::default();
    for _ in 0..300 {
        step(&mut p, &mut pairs, G, 0.3, 1.0 / 300.0);
    }
    let v = p.velocity[1].x;
    assert!((v - 15.0 / 7.0).abs() < 0.02, "{v}");
    assert!((p.angular_velocity[1].z + v / 0.1).abs() < 0.02 * v / 0.1, "{}", p.angular_velocity[1]);
}

/// Balls, needles and flats fly at each other at 20 to 700 m/s, up to 60 times their thickness a substep. Held from turning, so that none can turn out of the other's way, they are never found on the other side.
#[test]
fn nothing_tunnels_in_a_substep() {
    let mut random = Random(77);
    let dt = 1.0 / 300.0;
    let (mut hits, mut misses) = (0, 0);
    for k in 0..1000 {
        let shape = |k: usize| [Vec3A::splat(0.1), Vec3A::new(0.5, 0.02, 0.02), Vec3A::new(0.5, 0.5, 0.02)][k % 3];
        let mut p = body(&[(Vec3A::ZERO, shape(k), 1.0), (random.vector().normalize() * 1.2, shape(k / 3), 1.0)]);
        for i in 0..2 {
            p.rotation[i] = quat_exp(random.vector() * 3.0);
            p.pin(i, false, true);
        }
        let aim = random.vector() * 0.2 - p.position[1];
        p.velocity[1] = aim * (0.3 + 9.0 * random.signed().abs()) / dt / 5.0;
        let mut pairs = Pairs::default();
        let start = p.clone();
        let mut substeps = 0.0;
        while substeps < 20.0 && !pairs.touch() {
            step(&mut p, &mut pairs, Vec3A::ZERO, 0.0, dt);
            substeps += 1.0;
        }
        // What is on the way, by small steps; what is only grazed may be missed.
        let way = start.velocity[1] * dt * substeps;
        let met = (0..1000).any(|t| {
            let d = start.position[1] + way * (t as f32 / 1000.0);
            EllipsoidPair::new(&start.ellipsoid(0), &start.ellipsoid(1), d).contact_function().0 < 0.995
        });
        if met {
            hits += 1;
            assert!(pairs.touch(), "nr {k}: flew through");
            let d = p.position[1] - p.position[0];
            assert!(pairs.list[0].normal.dot(d) > 0.0, "nr {k}: on the other side");
            assert!(gap(&p, 0, 1) > -2e-4, "nr {k}: left {} m in it", gap(&p, 0, 1));
        } else {
            misses += 1;
        }
    }
    assert!(hits > 500 && misses > 50, "{hits} met, {misses} did not");
}

/// Half inside each other at the start, at rest: they part at the push speed and are then at rest.
#[test]
fn an_old_overlap_is_undone_gently_and_leaves_no_speed() {
    for rate in [30.0, 60.0, 240.0, 1000.0] {
        for radii in [Vec3A::splat(0.5), Vec3A::new(0.5, 0.3, 0.2)] {
            let mut p = body(&[(Vec3A::ZERO, radii, 1.0), (Vec3A::new(0.3, 0.05, 0.0), radii, 2.0)]);
            let mut pairs = Pairs::default();
            let (mut fastest, mut fastest_way) = (0.0f32, 0.0f32);
            for _ in 0..(rate * 0.5) as usize {
                let before = p.position.clone();
                step(&mut p, &mut pairs, Vec3A::ZERO, 0.5, 1.0 / rate);
                fastest = fastest.max(p.velocity[0].length()).max(p.velocity[1].length());
                fastest_way = fastest_way.max((p.position[1] - before[1] - p.position[0] + before[0]).length() * rate);
            }
            assert!(gap(&p, 0, 1) > -1e-4, "{rate} Hz: {}", gap(&p, 0, 1));
            assert!(fastest < 1e-4 && fastest_way < 3.05, "{rate} Hz: {fastest} m/s, parted at {fastest_way} m/s");
        }
    }
}

#[test]
fn what_is_pinned_or_held_is_not_moved() {
    let mut p = body(&[(Vec3A::ZERO, Vec3A::splat(0.1), 1.0), (Vec3A::X * 0.15, Vec3A::splat(0.1), 1.0)]);
    p.pin(0, true, true);
    let mut pairs = Pairs::default();
    for _ in 0..60 {
        step(&mut p, &mut pairs, Vec3A::ZERO, 0.5, 1.0 / 60.0);
    }
    assert_eq!(p.position[0], Vec3A::ZERO);
    assert!((p.position[1].x - 0.2).abs() < 1e-5);

    let (mut a, mut b) = (line(2, 0.3, 0.1), line(2, 0.3, 0.1));
    let mut pairs = Pairs::default();
    let offset = Vec3A::new(0.0, 0.15, 0.0);
    PairFinder::default().find_between(&a, &b, offset, &search(0.01), false, &mut pairs);
    let still = a.clone();
    a.velocity[0] = Vec3A::Y * 7.0;
    for pass in 0..PAIR_PASSES {
        let mut sides = Sides::Between { first: &mut a, second: &mut b, offset, held: [true, false], support: [&[]; 2] };
        solve_pairs(&mut pairs, &mut sides, &PairRules { dt: 0.01, friction: 0.5, push_speed: 3.0 }, pass);
    }
    assert_eq!(a.position, still.position);
    // Of 0.05 m that share which a hundredth of a second undoes at 60/s.
    assert!((b.position[0].y - 0.05 * 0.6 / 1.6).abs() < 1e-6 && b.velocity[0] == Vec3A::ZERO, "{} {}", b.position[0], b.velocity[0]);
}

/// Sizes 1:100, moving fast: all that come near each other in the step, by brute force.
#[test]
fn the_search_finds_what_flies_past() {
    let mut random = Random(4);
    let rest: Vec<ParticleRest> = (0..300)
        .map(|i| ParticleRest {
            position: random.vector() * 3.0,
            frame: Quat::IDENTITY,
            radii: Vec3A::splat(if i % 20 == 0 { 1.0 } else { 0.01 + 0.05 * random.signed().abs() }),
            mass: 1.0,
        })
        .collect();
    let mut p = Particles::new(&rest).unwrap();
    for v in &mut p.velocity {
        *v = Vec3A::new(300.0, 0.0, 0.0) + random.vector() * 30.0;
    }
    p.position[7].x = f32::NAN;
    p.velocity[9].x = f32::INFINITY;
    p.position[11].x = 1e38;
    let dt = 1.0 / 60.0;
    let pairs = find(&p, dt);
    let found: Vec<[u32; 2]> = pairs.list.iter().map(|pair| pair.particles).collect();
    assert!(found.is_sorted());
    let mut missing = 0;
    for j in 0..300 {
        for i in 0..j {
            // Two thousand looks along the way.
            let meet = (0..2000).any(|t| {
                let at = |i: usize| p.position[i] + p.velocity[i] * (dt * t as f32 / 2000.0);
                at(i).distance(at(j)) < p.radii[i].x + p.radii[j].x
            });
            missing += usize::from(meet && !found.contains(&[i as u32, j as u32]));
        }
    }
    assert_eq!(missing, 0);
    assert!(found.len() > 100 && found.iter().flatten().all(|&i| ![7, 9].contains(&i)));
}

#[test]
fn a_body_at_rest_has_no_pairs_with_itself() {
    let (p, edges) = blob();
    let mut own = SelfSearch::new(&p, &edges).unwrap();
    let mut finder = PairFinder::default();
    let mut pairs = Pairs::default();
    own.find(&p, &search(1.0 / 60.0), &mut finder, &mut pairs);
    let mut p = p;
    let before = p.clone();
    solve(&mut pairs, &mut p, &PairRules { dt: 1.0 / 300.0, friction: 0.5, push_speed: 3.0 });
    assert_eq!(p, before);
    for x in &mut p.position {
        *x *= 0.3;
    }
    own.find(&p, &search(1.0 / 60.0), &mut finder, &mut pairs);
    assert!(!pairs.list.is_empty() && edges.iter().all(|&[i, j]| pairs.list.iter().all(|pair| pair.particles != [i.min(j), i.max(j)])));
}

/// A body that is crumpled, flies, stands still, blows up and comes back, and of which two particles fly about in the rest, once with one search for all steps, once with a new one in each.
#[test]
fn what_is_found_does_not_depend_on_when_it_was_searched_for() {
    let mut random = Random(9);
    let mut p = random_body(&mut random, 200, 4.0);
    let edges: Vec<[u32; 2]> = (1..200).map(|i| [i - 1, i]).collect();
    let mut own = SelfSearch::new(&p, &edges).unwrap();
    let mut finder = PairFinder::default();
    let (mut kept, mut anew) = (Pairs::default(), Pairs::default());
    let mut found = 0;
    for step in 0..300 {
        let dt = 1.0 / 60.0;
        let (still, drift) = ((100..150).contains(&step), Vec3A::X * step as f32);
        for i in 0..p.len() {
            let few = step > 220;
            p.velocity[i] = match i {
                _ if still || (few && i % 100 != 5) => Vec3A::ZERO,
                _ if few => random.vector() * 5.0 - p.position[i],
                _ => random.vector() * 2.0 + drift,
            };
            p.position[i] += (p.velocity[i] - if still || few { Vec3A::ZERO } else { drift }) * dt;
        }
        if step == 200 {
            p.position[3] *= f32::NAN;
        }
        if step == 210 {
            p.position[3] = Vec3A::ZERO;
        }
        own.find(&p, &search(dt), &mut finder, &mut kept);
        SelfSearch::new(&p, &edges).unwrap().find(&p, &search(dt), &mut PairFinder::default(), &mut anew);
        found += kept.list.len();
        assert_eq!(kept, anew, "step {step}");
    }
    assert!(found > 1000, "{found}");
}

#[test]
fn what_has_collapsed_does_not_fill_the_memory() {
    let heap = body(&vec![(Vec3A::ZERO, Vec3A::splat(0.1), 1.0); 3000]);
    assert_eq!(find(&heap, 0.01).list.len(), 64 * 3000);
    assert!(SelfSearch::new(&heap, &[]).is_err());
    let mut p = heap.clone();
    let mut pairs = find(&p, 0.01);
    solve(&mut pairs, &mut p, &PairRules { dt: 0.01, friction: 0.5, push_speed: 3.0 });
    assert!(p.is_finite());
}

#[test]
fn two_bodies_find_each_other_wherever_they_are() {
    let (a, _) = blob();
    let (mut b, _) = blob();
    b.place(quat_exp(Vec3A::new(0.3, 0.2, 1.0)), Vec3A::new(0.1, 0.3, 0.2));
    let mut finder = PairFinder::default();
    let (mut here, mut there) = (Pairs::default(), Pairs::default());
    finder.find_between(&a, &b, Vec3A::new(0.0, -0.25, 0.0), &search(0.01), true, &mut here);
    b.shift_origin(Vec3A::Y);
    finder.find_between(&a, &b, Vec3A::new(0.0, 0.75, 0.0), &search(0.01), true, &mut there);
    let ids = |pairs: &Pairs| pairs.list.iter().map(|p| p.particles).collect::<Vec<_>>();
    assert!(!here.list.is_empty());
    assert_eq!(ids(&here), ids(&there));
    let mut expected = 0;
    for i in 0..a.len() {
        for j in 0..b.len() {
            let d = b.position[j] + Vec3A::new(0.0, 0.75, 0.0) - a.position[i];
            expected += usize::from(d.length() < a.radii[i].max_element() + b.radii[j].max_element());
        }
    }
    assert!(ids(&here).len() >= expected && expected > 0);
}

/// Ten grams on the ground bear a kilogram, because the pair knows that the ground is there; otherwise the heavy one sinks through the light one.
#[test]
fn what_lies_on_the_ground_bears_what_lies_on_it() {
    let depth = |knows: bool| {
        let dt = 1.0 / 300.0;
        let mut p = body(&[(Vec3A::Y * 0.1, Vec3A::splat(0.1), 0.01), (Vec3A::Y * 0.3, Vec3A::splat(0.1), 1.0)]);
        let plane = Contact {
            particle: 0,
            friction: 0.5,
            point: Vec3A::ZERO,
            normal: Vec3A::Y,
            velocity: Vec3A::ZERO,
            angular_velocity: Vec3A::ZERO,
            impulse: 0.0,
        };
        let (mut contacts, mut pairs, mut support) = (Contacts { list: vec![plane] }, Pairs::default(), Vec::new());
        for _ in 0..600 {
            SelfSearch::default().find(&p, &search(dt), &mut PairFinder::default(), &mut pairs);
            predict(&mut p, G, dt);
            if knows {
                find_support(&contacts, &p, dt, &mut support);
            }
            for pass in 0..PAIR_PASSES {
                let mut sides = Sides::Within { particles: &mut p, support: &support };
                solve_pairs(&mut pairs, &mut sides, &PairRules { dt, friction: 0.5, push_speed: 3.0 }, pass);
            }
            solve_contacts(&mut contacts, &mut p, dt, 3.0);
            integrate(&mut p, dt, 0.0);
        }
        // How far the heavy one has come down, since one that is through has a gap again.
        0.3 - p.position[1].y
    };
    let (knowing, blind) = (depth(true), depth(false));
    assert!(knowing < 1e-3 && blind > 0.1, "{knowing} m against {blind} m");
}
