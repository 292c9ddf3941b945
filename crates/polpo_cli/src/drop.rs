//! Bodies fall on a floor: the plugins as a game has them, without a window.

use std::sync::Arc;
use std::time::Duration;

use bevy::app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::ecs::schedule::SingleThreadedExecutor;
use bevy::math::{Mat3A, Vec3A};
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use indicatif::ProgressBar;
use polpo::prelude::*;
use polpo::{
    CalibratedEdges, CapabilityError, CapabilityRejected, Frozen, Particles, PolpoTimingsPlugin, RejectReason, SoftBodyRejected,
    StepTimings, state_hash,
};
use polpo_rapier::{PolpoRapierPlugin, RapierWorld};
use polpo_rig::Rig;
use rapier3d::na::Unit;
use rapier3d::prelude::ColliderBuilder;

use crate::draw::pose::Pose;
use crate::error::CliError;

/// Steps a second \[Hz\].
pub(crate) const RATE: f32 = 60.0;

/// How a body falls.
#[derive(Debug, Clone)]
pub(crate) struct Fall {
    /// As a multiple of the rig's size.
    pub(crate) scale: f32,
    /// \[s\]
    pub(crate) seconds: f32,
    /// Of the lowest point above the floor \[m\].
    pub(crate) height: f32,
    /// About an axis that leans \[rad/s\].
    pub(crate) spin: f32,
    pub(crate) count: usize,
    /// Frequency of its groups \[Hz\], instead of the default.
    pub(crate) hertz: Option<f32>,
    pub(crate) substeps: Option<u32>,
    pub(crate) threads: Option<usize>,
}

/// A body after its fall.
#[derive(Debug, Clone)]
pub(crate) struct Fallen {
    pub(crate) pose: Pose,
    pub(crate) finite: bool,
    pub(crate) asleep: bool,
    /// Deepest that any ellipsoid has been in the floor \[m\].
    pub(crate) penetration: f32,
    /// The same at the end \[m\].
    pub(crate) penetration_at_end: f32,
    /// Highest less lowest point of the ellipsoids at the end \[m\].
    pub(crate) height: f32,
    /// Of the fastest particle at the end \[m/s\].
    pub(crate) speed: f32,
    /// How much longer than at rest an edge has been at most, as a share of its length.
    pub(crate) strain: f32,
    /// The same at the end.
    pub(crate) strain_at_end: f32,
}

/// All bodies, and what it took.
#[derive(Debug, Clone)]
pub(crate) struct Landing {
    pub(crate) bodies: Vec<Fallen>,
    pub(crate) steps: u64,
    pub(crate) substeps: u32,
    /// Substeps that the material would take; none without one.
    pub(crate) substeps_needed: Option<u32>,
    pub(crate) threads: usize,
    /// Of each step in which a body was awake \[ms\].
    pub(crate) step_ms: Vec<f32>,
    /// When all bodies fell asleep \[s\], if they did and were not woken.
    pub(crate) asleep_after: Option<f32>,
    pub(crate) state_hash: u64,
}

/// What was refused.
#[derive(Resource, Default)]
struct Refused {
    body: Option<RejectReason>,
    component: Option<(&'static str, CapabilityError)>,
}

impl Refused {
    fn check(&mut self, name: &str) -> Result<(), CliError> {
        if let Some(source) = self.body.take() {
            return Err(CliError::Body { name: name.into(), source });
        }
        match self.component.take() {
            Some((component, source)) => Err(CliError::Capability { name: name.into(), component, source }),
            None => Ok(()),
        }
    }
}

/// Bevy without a window, a floor at the height 0, and the time in steps.
fn app(threads: Option<usize>, substeps: Option<u32>) -> App {
    let mut pools = TaskPoolOptions::default();
    if let Some(threads) = threads {
        pools.compute = TaskPoolThreadAssignmentPolicy { min_threads: threads, max_threads: threads, percent: 1.0, ..pools.compute };
    }
    let mut app = App::new();
    let defaults = SolverSettings::default();
    app.add_plugins(MinimalPlugins.set(TaskPoolPlugin { task_pool_options: pools }))
        .add_plugins((PolpoPlugin::default(), PolpoRapierPlugin::default(), PolpoTimingsPlugin::default()))
        .insert_resource(SolverSettings { substeps: substeps.unwrap_or(defaults.substeps), ..defaults })
        .insert_resource(Time::<Fixed>::from_duration(Duration::from_secs_f64(1.0 / f64::from(RATE))))
        .insert_resource(TimeUpdateStrategy::FixedTimesteps(1))
        .init_resource::<Refused>()
        .add_observer(|told: On<SoftBodyRejected>, mut refused: ResMut<Refused>| refused.body = Some(told.reason.clone()))
        .add_observer(|told: On<CapabilityRejected>, mut refused: ResMut<Refused>| {
            refused.component = Some((told.component, told.reason.clone()));
        })
        .edit_schedule(FixedPostUpdate, |schedule| {
            schedule.set_executor(SingleThreadedExecutor::new());
        });
    let floor = ColliderBuilder::halfspace(Unit::new_unchecked(Vec3::Y)).friction(0.7);
    app.world_mut().resource_mut::<RapierWorld>().insert_fixed(floor);
    app.finish();
    app.cleanup();
    app
}

/// Drops bodies of `rig` one above the other.
///
/// # Errors
/// If the body cannot be simulated, or cannot have its material.
pub(crate) fn fall(rig: &Arc<Rig>, name: &str, fall: &Fall, progress: &ProgressBar) -> Result<Landing, CliError> {
    let mut app = app(fall.threads, fall.substeps);
    let (low, high) = rest_span(rig, fall.scale);
    for index in 0..fall.count {
        let y = fall.height - low + 1.2 * (high - low) * index as f32;
        let mut body = app.world_mut().spawn((
            InitialVelocity { linear: Vec3::ZERO, angular: Vec3::new(0.6, 0.5, 0.62) * fall.spin },
            Transform::from_xyz(0.0, y, 0.0).with_rotation(Quat::from_rotation_y(2.4 * index as f32)).with_scale(Vec3::splat(fall.scale)),
        ));
        if let Some(hertz) = fall.hertz {
            // In the defaults' proportion.
            body.insert((ShapeMatching::new(Stiffness::hertz(hertz)), DistanceConstraints::new(Stiffness::hertz(1.6 * hertz))));
        }
        body.insert(SoftBody::new(rig.clone()));
    }
    let world = app.world_mut();
    let mut entities: Vec<Entity> = world.query_filtered::<Entity, With<SoftBody>>().iter(world).collect();
    entities.sort();

    let steps = (fall.seconds * RATE).round().max(1.0) as u64;
    let (mut step_ms, mut worst, mut asleep_after) = (Vec::new(), vec![(0.0f32, 0.0f32); entities.len()], None);
    progress.set_length(steps);
    // The first update has no time in it.
    for step in 0..=steps {
        let asleep = entities.iter().all(|&e| app.world().entity(e).contains::<Sleeping>());
        app.update();
        app.world_mut().resource_mut::<Refused>().check(name)?;
        progress.set_position(step);
        if step == 0 || asleep {
            continue;
        }
        step_ms.push(1000.0 * app.world().resource::<StepTimings>().total().as_secs_f32());
        for (&entity, worst) in entities.iter().zip(&mut worst) {
            let Some((origin, particles)) = state(app.world(), entity) else { continue };
            *worst = (worst.0.max(-span(particles, origin).0), worst.1.max(strain(rig, particles, fall.scale)));
        }
        let all = entities.iter().all(|&e| app.world().entity(e).contains::<Sleeping>());
        asleep_after = all.then_some(step as f32 / RATE);
    }
    let world = app.world();
    let states = || entities.iter().filter_map(|&e| Some((world.get::<Transform>(e)?, world.get::<Particles>(e)?)));
    Ok(Landing {
        bodies: entities.iter().zip(worst).filter_map(|(&entity, worst)| fallen(world, entity, rig, fall.scale, worst)).collect(),
        steps,
        substeps: world.resource::<SolverSettings>().substeps,
        substeps_needed: entities.iter().find_map(|&e| world.get::<CalibratedEdges>(e)).map(CalibratedEdges::substeps_needed),
        threads: bevy::tasks::ComputeTaskPool::get().thread_num(),
        step_ms,
        asleep_after,
        state_hash: state_hash(states()),
    })
}

fn state(world: &World, entity: Entity) -> Option<(Vec3, &Particles)> {
    Some((world.get::<Transform>(entity)?.translation, world.get::<Particles>(entity)?))
}

fn fallen(world: &World, entity: Entity, rig: &Rig, scale: f32, (penetration, strain_ever): (f32, f32)) -> Option<Fallen> {
    let (origin, particles) = state(world, entity)?;
    let body = world.entity(entity);
    let (low, high) = span(particles, origin);
    Some(Fallen {
        pose: Pose {
            positions: particles.position.iter().map(|&p| Vec3::from(p) + origin).collect(),
            rotations: particles.rotation.clone(),
            scale,
        },
        finite: particles.is_finite() && origin.is_finite() && !body.contains::<Frozen>(),
        asleep: body.contains::<Sleeping>(),
        penetration: penetration.max(0.0),
        penetration_at_end: (-low).max(0.0),
        height: high - low,
        speed: particles.velocity.iter().map(|v| v.length()).fold(0.0, f32::max),
        strain: strain_ever,
        strain_at_end: strain(rig, particles, scale),
    })
}

/// Lowest and highest point of the ellipsoids: y ∓ √(Σ r²·(axis·y)²) \[m\].
fn span(particles: &Particles, origin: Vec3) -> (f32, f32) {
    let each = (0..particles.len()).map(|i| {
        let axes = Mat3A::from_quat(particles.rotation[i] * particles.frame[i]);
        let reach = (axes.transpose() * Vec3A::Y * particles.radii[i]).length();
        (particles.position[i].y - reach, particles.position[i].y + reach)
    });
    let (low, high) = each.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)));
    (origin.y + low, origin.y + high)
}

/// The same of the rig, `scale` times as large.
pub(crate) fn rest_span(rig: &Rig, scale: f32) -> (f32, f32) {
    let each = rig.particles.iter().map(|p| {
        let reach = ((p.frame.inverse() * Vec3::Y) * p.radii).length();
        (p.position.y - reach, p.position.y + reach)
    });
    let (low, high) = each.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)));
    (low * scale, high * scale)
}

/// How much longer than at rest the longest edge is, for its length.
fn strain(rig: &Rig, particles: &Particles, scale: f32) -> f32 {
    let longer = rig.edges.iter().map(|&[a, b]| {
        let [a, b] = [a, b].map(|i| i as usize);
        let rest = scale * rig.particles[a].position.distance(rig.particles[b].position);
        if rest > 0.0 { particles.position[a].distance(particles.position[b]) / rest - 1.0 } else { 0.0 }
    });
    longer.fold(0.0, f32::max)
}
