//! Polpo's side: an app without a window, the whole ECS step on as many threads as asked for.

use std::sync::Arc;

use bevy::prelude::*;
use polpo::Particles;
use polpo::prelude::*;
use polpo_benches::headless::{RATE, Threads, app, drop_height};
use polpo_rapier::RapierWorld;
use polpo_rig::Rig;
use rapier3d::prelude::ColliderBuilder;

use crate::scene::{Block, Scene};
use crate::shape::{Shape, extent};

/// The length of a step \[s\].
pub(crate) const STEP: f32 = (1.0 / RATE) as f32;
/// Steps after which a body that was dropped lies still: 2 s.
pub(crate) const SETTLE: usize = 120;

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
        let mut app = app(Threads::Of(threads));
        for it in &scene.blocks {
            app.world_mut().resource_mut::<RapierWorld>().insert_fixed(collider(it));
        }
        let lift = drop_height(rig);
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
