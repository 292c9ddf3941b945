//! Soft bodies and the rigid ones that they carry come to rest together, sleep together and wake together.

use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{BodySnapshot, Particles, Stillness};
use polpo_rapier::{PushRigidBodies, RapierSnapshot, RapierWorld};
use polpo_tests::{cube, simulation, state_of, steps};
use rapier3d::prelude::*;

struct Room {
    app: App,
    jellies: Vec<Entity>,
    boxes: Vec<RigidBodyHandle>,
}

impl Room {
    fn new() -> Self {
        let mut app = simulation();
        let mut world = app.world_mut().resource_mut::<RapierWorld>();
        world.insert_fixed(ColliderBuilder::cuboid(9.0, 0.5, 9.0).translation(Vec3::NEG_Y * 0.5).friction(0.6));
        Self { app, jellies: Vec::new(), boxes: Vec::new() }
    }

    fn jelly(mut self, at: Vec3) -> Self {
        let jelly = (SoftBody::new(cube(3, 0.6, 20.0)), Transform::from_translation(at), PushRigidBodies);
        self.jellies.push(self.app.world_mut().spawn(jelly).id());
        self
    }

    fn rigid(mut self, at: Vec3, half: Vec3, can_sleep: bool) -> Self {
        let RapierWorld { bodies, colliders, .. } = &mut *self.app.world_mut().resource_mut::<RapierWorld>();
        let body = bodies.insert(RigidBodyBuilder::dynamic().translation(at).can_sleep(can_sleep));
        colliders.insert_with_parent(ColliderBuilder::cuboid(half.x, half.y, half.z).mass(1.0).friction(0.6), body, bodies);
        self.boxes.push(body);
        self
    }

    fn body(&self, i: usize) -> &RigidBody {
        &self.app.world().resource::<RapierWorld>().bodies[self.boxes[i]]
    }

    /// How many soft and rigid bodies sleep.
    fn asleep(&self) -> [usize; 2] {
        let soft = self.jellies.iter().filter(|&&b| self.app.world().get::<Sleeping>(b).is_some()).count();
        [soft, (0..self.boxes.len()).filter(|&i| self.body(i).is_sleeping()).count()]
    }

    /// Waits until all sleep, and sees that nothing moves for ten seconds.
    fn sleep(mut self) -> Self {
        let all = [self.jellies.len(), self.boxes.len()];
        let mut tenths = 0;
        while self.asleep() != all && tenths < 300 {
            steps(&mut self.app, 6);
            tenths += 1;
        }
        assert_eq!(self.asleep(), all, "after half a minute: {:?}", self.places());
        assert!(self.places().iter().all(|(at, _)| at.y > 0.55), "carried: {:?}", self.places());
        println!("asleep after {:.1} s", 0.1 * tenths as f32);
        let before = (state_of(self.app.world_mut()), self.places());
        for _ in 0..600 {
            steps(&mut self.app, 1);
            assert_eq!(self.asleep(), all);
        }
        assert_eq!((state_of(self.app.world_mut()), self.places()), before);
        self
    }

    fn places(&self) -> Vec<(Vec3, Quat)> {
        (0..self.boxes.len()).map(|i| (self.body(i).translation(), *self.body(i).rotation())).collect()
    }
}

fn jelly_with_box() -> Room {
    Room::new().jelly(Vec3::Y * 0.3).rigid(Vec3::new(0.05, 0.8, 0.02), Vec3::splat(0.15), true)
}

#[test]
fn a_box_on_a_jelly_sleeps_with_it() {
    jelly_with_box().sleep();
}

#[test]
fn two_jellies_under_one_plate_wait_for_each_other() {
    let room = Room::new().jelly(Vec3::new(-0.5, 0.3, 0.0)).jelly(Vec3::new(0.5, 0.3, 0.0));
    let mut room = room.rigid(Vec3::Y * 0.65, Vec3::new(0.9, 0.04, 0.3), true);
    for _ in 0..900 {
        let last = room.jellies[1];
        room.app.world_mut().get_mut::<Stillness>(last).unwrap().0 = 0.0;
        steps(&mut room.app, 1);
        assert_eq!(room.asleep(), [0, 0]);
    }
    room.sleep();
}

#[test]
fn what_never_sleeps_keeps_what_carries_it_awake() {
    let mut room = Room::new().jelly(Vec3::Y * 0.3).rigid(Vec3::new(0.05, 0.8, 0.02), Vec3::splat(0.15), false);
    for _ in 0..900 {
        steps(&mut room.app, 1);
        assert_eq!(room.asleep(), [0, 0]);
    }
}

#[test]
fn a_push_at_either_wakes_both() {
    let mut room = jelly_with_box().sleep();
    let body = room.boxes[0];
    room.app.world_mut().resource_mut::<RapierWorld>().bodies[body].apply_impulse(Vec3::X * 0.3, true);
    steps(&mut room.app, 2);
    assert_eq!(room.asleep(), [0, 0]);
    let mut room = room.sleep();
    let jelly = room.jellies[0];
    room.app.world_mut().get_mut::<Particles>(jelly).unwrap().set_rigid_velocity(Vec3A::X, Vec3A::ZERO);
    steps(&mut room.app, 2);
    assert_eq!(room.asleep(), [0, 0]);
}

/// Nothing stays hanging in the air.
#[test]
fn a_box_falls_when_what_carried_it_is_gone() {
    type Loss = fn(&mut World, Entity);
    let losses: [Loss; 3] = [
        |world, jelly| {
            world.despawn(jelly);
        },
        |world, jelly| world.get_mut::<Transform>(jelly).unwrap().translation.x += 5.0,
        |world, jelly| {
            world.entity_mut(jelly).remove::<PushRigidBodies>();
        },
    ];
    for (i, lose) in losses.into_iter().enumerate() {
        let mut room = jelly_with_box().sleep();
        let (jelly, before) = (room.jellies[0], room.places());
        lose(room.app.world_mut(), jelly);
        steps(&mut room.app, 20);
        for ((from, _), (to, _)) in before.iter().zip(room.places()) {
            assert!(from.y - to.y > 0.3, "{i}: from {from} to {to}");
        }
    }
}

/// What a jelly carries is in no snapshot of either, yet known after it: in the same world, where it has carried another box meanwhile, and in a new one.
#[test]
fn a_box_falls_when_what_carried_it_is_gone_after_a_snapshot() {
    let mut room = jelly_with_box().rigid(Vec3::new(3.0, 0.15, 0.0), Vec3::splat(0.15), true);
    steps(&mut room.app, 1800);
    assert_eq!(room.asleep(), [1, 2]);
    let (jelly, places) = (room.jellies[0], room.places());
    let kept = BodySnapshot::take(room.app.world(), jelly).unwrap();
    let rigid = RapierSnapshot::take(room.app.world()).unwrap();
    for (k, at) in [Vec3::new(-3.0, 0.15, 0.0), Vec3::new(0.0, 0.8, 0.0)].into_iter().enumerate() {
        let body = room.boxes[k];
        room.app.world_mut().resource_mut::<RapierWorld>().bodies[body].set_translation(at, true);
    }
    steps(&mut room.app, 60);
    let boxes = room.boxes.clone();
    for mut room in [room, Room { boxes, ..Room::new().jelly(Vec3::Y * 0.3) }] {
        kept.restore(room.app.world_mut(), room.jellies[0]).unwrap();
        rigid.restore(room.app.world_mut());
        steps(&mut room.app, 60);
        assert_eq!((room.asleep(), room.places()), ([1, 2], places.clone()));
        room.app.world_mut().despawn(room.jellies[0]);
        steps(&mut room.app, 20);
        let [fallen, other] = [0, 1].map(|i| places[i].0.y - room.places()[i].0.y);
        assert!(fallen > 0.3 && other == 0.0, "by {fallen} m, {other} m");
    }
}

/// What lies on what a jelly carries does not press it into the jelly harder than it weighs: two slabs were thrown up by 46 m.
#[test]
fn stacked_slabs_are_not_thrown_up() {
    for k in 0..4 {
        let (y, half) = (0.65 + 0.01 * k as f32, Vec3::new(0.3, 0.04, 0.3));
        let mut room = Room::new().jelly(Vec3::Y * 0.3).rigid(Vec3::Y * y, half, true).rigid(Vec3::Y * (y + 0.09), half, true);
        for _ in 0..300 {
            steps(&mut room.app, 1);
            let [lower, upper] = [0, 1].map(|i| room.body(i));
            assert!(lower.translation().y <= y && upper.translation().y <= y + 0.09, "{k}: {:?}", room.places());
            assert!(lower.linvel().length() < 1.0 && upper.linvel().length() < 1.0, "{k}: {}, {} m/s", lower.linvel(), upper.linvel());
        }
    }
}
