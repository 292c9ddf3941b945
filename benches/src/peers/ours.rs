//! Polpo's side: an app without a window, the whole ECS step on as many threads as asked for.

use std::sync::Arc;

use bevy::app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::ecs::schedule::{Schedules, SingleThreadedExecutor};
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use polpo::Particles;
use polpo::prelude::*;
use polpo_rapier::{PolpoRapierPlugin, RapierWorld};
use polpo_rig::Rig;
use rapier3d::prelude::ColliderBuilder;

use crate::scene::{Block, DROP, Scene};
use crate::shape::{Shape, extent};

/// Steps a second \[Hz\].
pub(crate) const RATE: f64 = 60.0;
/// The length of a step \[s\].
pub(crate) const STEP: f32 = (1.0 / RATE) as f32;
/// Steps after which a body that was dropped lies still: 2 s.
pub(crate) const SETTLE: usize = 120;

/// A world with soft bodies in it. Its first `update` has no time in it.
pub(crate) fn app(threads: usize) -> App {
    let pools = TaskPoolOptions {
        compute: TaskPoolThreadAssignmentPolicy {
            min_threads: threads,
            max_threads: threads,
            percent: 1.0,
            ..TaskPoolOptions::default().compute
        },
        ..default()
    };
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins.set(TaskPoolPlugin { task_pool_options: pools }),
        PolpoPlugin::default(),
        PolpoRapierPlugin::default(),
    ))
    .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
    .insert_resource(Time::<Fixed>::from_hz(RATE));
    // Systems run on the thread that calls; bodies go parallel inside them.
    for (_, schedule) in app.world_mut().resource_mut::<Schedules>().iter_mut() {
        schedule.set_executor(SingleThreadedExecutor::new());
    }
    app.finish();
    app.cleanup();
    app.update();
    app
}

/// An app on one thread, and its bodies.
pub(crate) struct Ours {
    pub(crate) app: App,
    pub(crate) bodies: Vec<Entity>,
    rest: f32,
}

impl Ours {
    /// Bodies of `rig` in `scene`, that touch themselves and do not sleep, changed by `change`.
    pub(crate) fn new(rig: &Arc<Rig>, scene: &Scene, change: impl Fn(&mut EntityWorldMut)) -> Self {
        Self::with_threads(1, rig, scene, change)
    }

    /// The same on so many threads. The first world of a process decides how many it has.
    pub(crate) fn with_threads(threads: usize, rig: &Arc<Rig>, scene: &Scene, change: impl Fn(&mut EntityWorldMut)) -> Self {
        let mut app = app(threads);
        for it in &scene.blocks {
            app.world_mut().resource_mut::<RapierWorld>().insert_fixed(collider(it));
        }
        let lift = DROP - lowest(rig);
        let spawn = |place: &Vec3| {
            let place = Transform::from_translation(*place + Vec3::Y * lift);
            let mut body = app.world_mut().spawn((SoftBody::new(rig.clone()), SelfContact::default(), place));
            body.remove::<Sleep>();
            change(&mut body);
            body.id()
        };
        let bodies = scene.places.iter().map(spawn).collect();
        Self { app, bodies, rest: extent(rig.particles.iter().map(|p| p.position.y)) }
    }

    pub(crate) fn step(&mut self) {
        self.app.update();
    }

    /// Steps until bodies that were dropped lie.
    pub(crate) fn settled(mut self) -> Self {
        for _ in 0..SETTLE {
            self.step();
        }
        self
    }

    pub(crate) fn particles(&self, body: Entity) -> &Particles {
        self.app.world().get(body).expect("a body has particles")
    }

    /// Where the highest particle of all is \[m\].
    pub(crate) fn top(&self) -> f32 {
        let heights = self.bodies.iter().flat_map(|&body| {
            let at = self.app.world().get::<Transform>(body).map_or(0.0, |at| at.translation.y);
            self.particles(body).position.iter().map(move |x| at + x.y)
        });
        heights.fold(f32::NEG_INFINITY, f32::max)
    }

    pub(crate) fn shape(&self) -> Shape {
        Shape::mean(self.bodies.iter().map(|&body| {
            let particles = self.particles(body);
            let speeds = particles.velocity.iter().map(|v| v.length_squared()).collect();
            (extent(particles.position.iter().map(|x| x.y)), self.rest, speeds)
        }))
    }
}

/// One of the scene's blocks, for polpo_rapier.
pub(crate) fn collider(it: &Block) -> ColliderBuilder {
    ColliderBuilder::cuboid(it.half_extents.x, it.half_extents.y, it.half_extents.z).translation(it.center)
}

/// Where a rig's lowest particle ends.
fn lowest(rig: &Rig) -> f32 {
    let bottom = |p: &polpo_rig::Particle| {
        let up = p.frame.inverse() * Vec3::Y;
        p.position.y - (up * p.radii).length()
    };
    rig.particles.iter().map(bottom).fold(f32::INFINITY, f32::min)
}
