//! Explicit groups and rest poses made at random.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{Deformable, Drive, ExplicitGroup, ExplicitGroups, Motor, Particles, RestPose};
use polpo_rig::Rig;

use crate::Random;

/// A rest pose that bends to and fro, driven by the clock.
#[derive(Component)]
pub(crate) struct Muscle {
    /// How far \[rad/m\].
    bend: f32,
    phase: f32,
}

/// Up to three groups of particles that are near each other, with motors and dents; where they overlap they have joints.
pub(crate) fn add_groups(body: &mut EntityWorldMut, random: &mut Random, rig: &Rig) {
    let count = 1 + random.below(3);
    let near = |middle: usize, size: usize| {
        let mut all: Vec<u32> = (0..rig.particles.len() as u32).collect();
        let distance = |i: u32| rig.particles[i as usize].position.distance_squared(rig.particles[middle].position);
        all.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
        all.truncate(size);
        all
    };
    let mut group = |g: usize| {
        let mut group = ExplicitGroup::rigid(near(random.below(rig.particles.len()), 1 + random.below(8)));
        if random.once_in(3) {
            group.stiffness = Stiffness::damped(10.0 + 40.0 * random.unit(), random.unit());
        }
        if random.once_in(2) {
            group.deformable = Some(Deformable { speed: 0.5 * random.unit(), time: 0.05 + 0.4 * random.unit(), dent: random.unit() });
        }
        if random.once_in(3) {
            let drive = match random.below(2) {
                0 => Drive::Torque(0.02 * random.unit()),
                _ => Drive::Speed { target: 5.0 * random.unit(), max_torque: 0.05 },
            };
            let against = if random.once_in(2) { g.checked_sub(1).map(|g| g as u32) } else { None };
            group.motor = Some(Motor { axis: (random.vector() + Vec3::Y * 1.1).into(), drive, against });
        }
        if random.once_in(4) {
            group.scale = 0.9 + 0.2 * random.unit();
        }
        group
    };
    let list = (0..count).map(&mut group).collect();
    body.insert(ExplicitGroups { list });
}

/// Half of them move.
pub(crate) fn add_rest_pose(body: &mut EntityWorldMut, random: &mut Random, rig: &Rig) {
    let muscle = Muscle { bend: random.unit() - 0.5, phase: 6.0 * random.unit() };
    if random.once_in(2) {
        body.insert((muscle, RestPose::default()));
    } else {
        let rotation = random.turn();
        let places: Vec<_> = rig.particles.iter().map(|p| rotation * (p.position + 0.01 * random.vector())).collect();
        body.insert(RestPose { rotation: vec![rotation; places.len()], position: places });
    }
}

/// In `FixedUpdate`: bends along x, about z.
pub(crate) fn flex(time: Res<Time>, mut bodies: Query<(&Muscle, &Particles, &mut RestPose)>) {
    for (muscle, particles, mut pose) in &mut bodies {
        let bend = muscle.bend * (3.0 * time.elapsed_secs() + muscle.phase).sin();
        let angle = |x: f32| bend * x;
        pose.rotation = particles.rest_position.iter().map(|x| Quat::from_rotation_z(angle(x.x))).collect();
        pose.position = particles.rest_position.iter().map(|&x| Vec3::from(x) + Vec3::Y * (0.5 * angle(x.x) * x.x)).collect();
    }
}
