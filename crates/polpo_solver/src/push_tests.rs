//! Particles and rigid bodies that push each other.

use glam::{DVec3, Mat3A, Quat, Vec3A};

use crate::testing::Random;
use crate::*;

const G: Vec3A = Vec3A::new(0.0, -9.81, 0.0);

/// A cube of side 1 m about its centre of mass.
fn cube(mass: f32) -> RigidMover {
    RigidMover {
        inverse_mass: Vec3A::splat(1.0 / mass),
        inverse_inertia: Mat3A::from_diagonal(Vec3A::splat(6.0 / mass).into()),
        ..Default::default()
    }
}

fn balls(places: &[Vec3A], radius: f32, mass: f32) -> Particles {
    let rest: Vec<ParticleRest> =
        places.iter().map(|&position| ParticleRest { position, frame: Quat::IDENTITY, radii: Vec3A::splat(radius), mass }).collect();
    Particles::new(&rest).unwrap()
}

fn floor(particle: u32, friction: f32) -> Contact {
    Contact { particle, friction, point: Vec3A::ZERO, normal: Vec3A::Y, velocity: Vec3A::ZERO, angular_velocity: Vec3A::ZERO, impulse: 0.0 }
}

/// A scene of one body and its movers.
struct Scene {
    p: Particles,
    statics: Contacts,
    movers: Movers,
    pushes: Vec<PushContact>,
    ties: Vec<Tie>,
    gravity: Vec3A,
    push_speed: f32,
}

impl Scene {
    fn new(p: Particles, mover: RigidMover) -> Self {
        Self {
            p,
            statics: Contacts::default(),
            movers: Movers { list: vec![mover], feet: vec![] },
            pushes: vec![],
            ties: vec![],
            gravity: Vec3A::ZERO,
            push_speed: 3.0,
        }
    }

    fn substep(&mut self, dt: f32) {
        predict(&mut self.p, self.gravity, dt);
        solve_contacts(&mut self.statics, &mut self.p, dt, 3.0);
        self.movers.begin(dt);
        begin_pushes(&mut self.pushes, &self.movers, &self.p, dt);
        for _ in 0..8 {
            solve_ties(&mut self.ties, &mut self.movers, &mut self.p, dt);
            solve_pushes(&mut self.pushes, &mut self.movers, &self.statics.list, &mut self.p, dt);
            self.movers.stand(dt);
        }
        undo_overlaps(&mut self.pushes, &mut self.movers, &self.statics.list, &mut self.p, dt, self.push_speed);
        self.movers.list.iter_mut().for_each(RigidMover::settle);
    }

    /// P, and L about the origin with the inertia that does not turn, of one mover whose centre began at `center`.
    fn momenta(&self, center: Vec3A) -> [DVec3; 2] {
        let mover = &self.movers.list[0];
        let p = mover.velocity.as_dvec3() / f64::from(mover.inverse_mass.x);
        let inertia = mover.inverse_inertia.as_dmat3().inverse();
        let l = (center + mover.way).as_dvec3().cross(p) + inertia * mover.angular_velocity.as_dvec3();
        (0..self.p.len()).fold([p, l], |[p, l], i| {
            let own = self.p.velocity[i].as_dvec3() * f64::from(self.p.mass[i]);
            let spin = self.p.angular_velocity[i].as_dvec3() * f64::from(self.p.inertia[i]);
            [p + own, l + self.p.position[i].as_dvec3().cross(own) + spin]
        })
    }
}

#[test]
fn a_hit_is_what_momentum_says() {
    // 2 kg at 5 m/s into the middle of a free cube of 3 kg: both go on at 2 m/s.
    for dt in [1.0 / 30.0, 1.0 / 240.0] {
        let mut s = Scene::new(balls(&[Vec3A::new(-0.7, 0.0, 0.0)], 0.1, 2.0), cube(3.0));
        s.p.velocity[0] = Vec3A::X * 5.0;
        s.pushes = vec![PushContact::new(0, 0, Vec3A::ZERO, Vec3A::X * -0.5, Vec3A::NEG_X)];
        for _ in 0..40 {
            s.substep(dt);
        }
        assert!((s.p.velocity[0] - Vec3A::X * 2.0).length() < 1e-5, "{}", s.p.velocity[0]);
        assert!((s.movers.list[0].velocity - Vec3A::X * 2.0).length() < 1e-5);
        let gap = s.movers.list[0].way.x - 0.6 - s.p.position[0].x;
        assert!(gap.abs() < 1e-4, "they touch: {gap} m");
        assert!((s.movers.list[0].impulse - Vec3A::X * 6.0).length() < 1e-4, "{}", s.movers.list[0].impulse);
    }
}

/// Contacts with friction and ties, in random states: what particles lose the rigid body gets, about any point.
#[test]
fn momentum_of_the_pair_is_kept_to_rounding() {
    let mut random = Random(7);
    let (mut worst, mut pushed) = ([0.0f64; 2], [0.0; 2]);
    for _ in 0..200 {
        let mut v = || random.vector();
        let radii = v().abs() * 0.1 + 0.05;
        let rest: Vec<_> =
            (0..6).map(|_| ParticleRest { position: v(), frame: quat_exp(v() * 2.0), radii, mass: 0.1 + v().x.abs() * 3.0 }).collect();
        let mut p = Particles::new(&rest).unwrap();
        for i in 0..6 {
            p.velocity[i] = v() * 5.0;
            p.angular_velocity[i] = v() * 5.0;
            p.previous_position[i] = p.position[i];
        }
        let center = v() * 2.0;
        let inertia = Mat3A::from_quat(quat_exp(v())) * Mat3A::from_diagonal((v().abs() + 0.2).into());
        let mut s = Scene::new(
            p,
            RigidMover {
                inverse_mass: Vec3A::splat(0.5),
                inverse_inertia: inertia * inertia.transpose(),
                velocity: v() * 5.0,
                angular_velocity: v() * 5.0,
                ..Default::default()
            },
        );
        // Undoing an overlap moves places without momentum: P is kept, L but for the overlap times the slip.
        s.push_speed = 0.0;
        let extra = v() * 3.0;
        for k in 0..4u32 {
            let n = v().normalize();
            let arm = s.p.position[k as usize] - n * 0.16 - center;
            let more = if k == 3 { extra } else { Vec3A::ZERO };
            s.pushes.push(PushContact { friction: 0.7, extra: more, ..PushContact::new(k, 0, center, arm, n) });
        }
        for k in 4..6u32 {
            let tie = Tie {
                particle: k,
                mover: 0,
                center,
                arm: s.p.position[k as usize] - center,
                rotation: Quat::IDENTITY,
                holds: [true; 2],
                impulse: Vec3A::ZERO,
            };
            s.ties.push(tie);
        }
        let before = s.momenta(center);
        for _ in 0..4 {
            s.substep(1.0 / 240.0);
            pushed[0] += s.pushes.iter().map(|c| c.impulse()).sum::<f32>();
            pushed[1] += s.ties[0].impulse.length();
        }
        for (k, after) in s.momenta(center).into_iter().enumerate() {
            worst[k] = worst[k].max((after - before[k]).length() / before[k].length().max(10.0));
        }
    }
    assert!(pushed[0] > 100.0 && pushed[1] > 100.0, "{pushed:?}");
    // Sums of a few hundred impulses of up to 30 N·s in f32, of which each rounds by 6e-8.
    println!("P {:.1e}, L {:.1e}", worst[0], worst[1]);
    assert!(worst[0] < 1e-6 && worst[1] < 3e-6, "{worst:?}");
}

/// 27,000 times as heavy as what it stands on: nine balls of 37 g on the floor carry a tonne as if they were the floor.
#[test]
fn jammed_particles_carry_a_tonne() {
    let places: Vec<Vec3A> = (0..9).map(|i| Vec3A::new((i % 3) as f32 * 0.4 - 0.4, 0.1, (i / 3) as f32 * 0.4 - 0.4)).collect();
    for rate in [150.0, 300.0, 1200.0] {
        let dt = 1.0 / rate;
        let mut s =
            Scene::new(balls(&places, 0.1, 0.037), RigidMover { acceleration: G, velocity: Vec3A::new(0.5, -3.0, 0.0), ..cube(1000.0) });
        s.gravity = G;
        let center = Vec3A::Y * 0.75;
        for i in 0..9 {
            s.statics.list.push(floor(i, 0.6));
            let arm = places[i as usize] - Vec3A::Y * 0.1 - center;
            let arm = Vec3A::new(arm.x, -0.5, arm.z);
            s.pushes.push(PushContact { friction: 0.6, support: [i, i + 1], ..PushContact::new(i, 0, center, arm, Vec3A::NEG_Y) });
        }
        let mut lowest = f32::INFINITY;
        for _ in 0..(2.0 * rate) as usize {
            s.substep(dt);
            lowest = lowest.min((center + s.movers.list[0].way).y);
        }
        let mover = &s.movers.list[0];
        println!("{rate} Hz: lowest {lowest}, at {} {}, {}", mover.way, mover.velocity, mover.angular_velocity);
        // Resting at 0.2 + 0.5; 0.5 m/s at μ = 0.6 stops within v²/(2μg) = 21 mm and the way that it slid before.
        assert!(lowest > 0.7 - 1e-4, "{rate} Hz: sank to {lowest}");
        assert!((mover.way.y + 0.05).abs() < 1e-4, "{rate} Hz: {}", mover.way);
        assert!(
            mover.velocity.length() < 1e-3 && mover.angular_velocity.length() < 1e-3,
            "{rate} Hz: {} {}",
            mover.velocity,
            mover.angular_velocity
        );
        assert!(mover.way.x < 0.04, "{rate} Hz: slid by {}", mover.way);
        let moved = (0..9).map(|i| s.p.position[i].distance(places[i])).fold(0.0, f32::max);
        assert!(moved < 0.03, "{rate} Hz: a ball went {moved} m");
    }
}

/// Between jaws at 30° the angle of nip says: held at μ = 0.3 > tan 15° = 0.268, squeezed out at μ = 0.2.
#[test]
fn jaws_hold_a_ball_within_the_angle_of_nip() {
    for (friction, held) in [(0.3, true), (0.2, false), (0.0, false)] {
        let n = Vec3A::new(libm::sinf(core::f32::consts::FRAC_PI_6), -libm::cosf(core::f32::consts::FRAC_PI_6), 0.0);
        let ball = Vec3A::Y * 0.1;
        let mut s = Scene::new(
            balls(&[ball], 0.1, 0.01),
            RigidMover { velocity: Vec3A::NEG_Y, inverse_inertia: Mat3A::ZERO, acceleration: G * 10.0, ..cube(100.0) },
        );
        s.movers.list[0].inverse_mass = Vec3A::Y * 0.01;
        s.statics.list.push(floor(0, friction));
        s.pushes.push(PushContact { friction, support: [0, 1], ..PushContact::new(0, 0, Vec3A::Y, ball - n * 0.1 - Vec3A::Y, n) });
        for _ in 0..60 {
            s.substep(1.0 / 300.0);
        }
        let (way, speed) = (s.movers.list[0].way.y, s.movers.list[0].velocity.y);
        assert_eq!(way > -0.001, held, "μ = {friction}: {way} m, {speed} m/s, ball {}", s.p.position[0]);
        assert_eq!(s.p.position[0].x > 0.05, !held, "μ = {friction}: {}", s.p.position[0]);
    }
}

/// A jammed particle that its own body pushes at the heavy one has the impulse of a particle, not that of the ground.
#[test]
fn a_jammed_particle_pushes_with_its_own_mass() {
    let mut s = Scene::new(balls(&[Vec3A::Y * 0.1], 0.1, 0.01), cube(100.0));
    s.statics.list.push(floor(0, 0.6));
    s.pushes.push(PushContact { friction: 0.6, support: [0, 1], ..PushContact::new(0, 0, Vec3A::Y * 0.7, Vec3A::Y * -0.5, Vec3A::NEG_Y) });
    s.p.velocity[0] = Vec3A::Y * 10.0;
    s.substep(1.0 / 300.0);
    let expected = 0.01 * 10.0 / 100.01;
    assert!((s.movers.list[0].velocity.y - expected).abs() < 1e-6, "{}", s.movers.list[0].velocity);
}

/// A mover on its feet does not sink under a load, nor does it stick to what it stands on.
#[test]
fn a_mover_stands_on_its_feet() {
    let mut s = Scene::new(balls(&[Vec3A::Y * 1.1], 0.1, 1.0), RigidMover { acceleration: G, ..cube(1.0) });
    s.gravity = G;
    for (x, z) in [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)] {
        let foot = Foot { mover: 0, arm: Vec3A::new(x, -0.5, z), normal: Vec3A::Y, gap: 0.0, velocity: Vec3A::ZERO, impulse: 0.0 };
        s.movers.feet.push(foot);
    }
    s.pushes.push(PushContact { friction: 0.6, ..PushContact::new(0, 0, Vec3A::Y * 0.5, Vec3A::Y * 0.5, Vec3A::Y) });
    s.p.velocity[0] = Vec3A::Y * -3.0;
    for _ in 0..100 {
        s.substep(1.0 / 300.0);
    }
    assert!(s.movers.list[0].way.length() < 1e-3, "{}", s.movers.list[0].way);
    assert!((s.p.position[0].y - 1.1).abs() < 1e-3, "{}", s.p.position[0]);
    s.movers.list[0].velocity = Vec3A::Y;
    s.movers.list[0].acceleration = Vec3A::ZERO;
    for _ in 0..30 {
        s.substep(1.0 / 300.0);
    }
    assert!(s.movers.list[0].way.y > 0.01);
}

/// A tied particle and a rigid body swing about their common centre, and the tie holds.
#[test]
fn a_tie_holds_and_turns_along() {
    let mut s = Scene::new(balls(&[Vec3A::X * 0.5], 0.1, 1.0), cube(2.0));
    s.ties.push(Tie {
        particle: 0,
        mover: 0,
        center: Vec3A::ZERO,
        arm: Vec3A::X * 0.5,
        rotation: Quat::IDENTITY,
        holds: [true; 2],
        impulse: Vec3A::ZERO,
    });
    s.p.velocity[0] = Vec3A::Z * 3.0;
    for _ in 0..600 {
        s.substep(1.0 / 600.0);
        let mover = &s.movers.list[0];
        assert!(s.p.position[0].distance(mover.way + mover.rotation * (Vec3A::X * 0.5)) < 1e-3);
    }
    assert!(quat_log(s.p.rotation[0] * s.movers.list[0].rotation.inverse()).length() < 1e-3);
    assert!((s.movers.list[0].velocity + s.p.velocity[0] * 0.5 - Vec3A::Z * 1.5).length() < 1e-4, "{}", s.movers.list[0].velocity);
    assert!(s.movers.list[0].angular_velocity.y < -1.0);
}

#[test]
fn nonsense_is_skipped() {
    let mut s = Scene::new(balls(&[Vec3A::Y * 0.05], 0.1, 1.0), RigidMover::default());
    s.pushes = vec![
        PushContact::new(9, 0, Vec3A::ZERO, Vec3A::ZERO, Vec3A::Y),
        PushContact::new(0, 9, Vec3A::ZERO, Vec3A::ZERO, Vec3A::Y),
        PushContact { support: [5, 2], ..PushContact::new(0, 0, Vec3A::ZERO, Vec3A::ZERO, Vec3A::Y) },
        PushContact { support: [0, 7], ..PushContact::new(0, 0, Vec3A::ZERO, Vec3A::ZERO, Vec3A::Y) },
    ];
    let tie = Tie {
        particle: 0,
        mover: 9,
        center: Vec3A::ZERO,
        arm: Vec3A::ZERO,
        rotation: Quat::IDENTITY,
        holds: [true; 2],
        impulse: Vec3A::ZERO,
    };
    s.ties = vec![tie, Tie { particle: 9, mover: 0, ..tie }];
    s.movers.feet.push(Foot { mover: 9, arm: Vec3A::ZERO, normal: Vec3A::Y, gap: 0.0, velocity: Vec3A::ZERO, impulse: 0.0 });
    s.p.pin(0, true, true);
    s.ties.push(Tie { mover: 0, ..tie });
    for _ in 0..3 {
        s.substep(1.0 / 60.0);
    }
    assert!(s.p.is_finite());
    assert_eq!(s.movers.list[0].way, Vec3A::ZERO);
}
