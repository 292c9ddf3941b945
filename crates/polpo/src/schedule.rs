//! The step: its phases, their order, and nothing else. All ordering of the crate stands here.
//!
//! ```text
//! FixedPostUpdate (or your schedule)
//!   Prepare → DetectContacts → Substeps → Writeback
//!                                 │
//! SubstepSchedule, × substeps     └ Predict → SolveConstraints → SolveContacts → Integrate
//!                                                  │
//! ConstraintSchedule, × iterations                 └ solve_blocks or match_shapes → solve_distances → solve_torsion → solve_rods → match_explicit
//! ```
//!
//! The two inner schedules run on the single-threaded executor, which costs a tenth of a microsecond a run; the multi-threaded one would cost more than a body. Systems go parallel over bodies by
//! themselves when there is enough work for it, and inside large bodies ([`Blocks`](crate::Blocks)).

use bevy::ecs::intern::Interned;
use bevy::ecs::schedule::{ScheduleLabel, SingleThreadedExecutor};
use bevy::prelude::*;
use polpo_solver::Sweep;

use crate::{
    blocks, bodies, body_contact, collision, damping, distance, explicit_groups, freeze, grab, integrate, keep_momentum, parameters,
    particles, pins, plasticity, predict, recall, regions, rest_pose, rider, rods, self_contact, shape_matching, sleep, torsion, wind,
    writeback,
};

/// Soft bodies: adds the step to a schedule.
///
/// Works on `MinimalPlugins`, without a renderer. In `FixedPostUpdate`, the default, the time step is `Time<Fixed>`'s, 1/64 s unless you set it; in another schedule it is the delta of the generic
/// `Time` there. Several steps' worth of state stays in components, so the schedule can be run by hand as well.
pub struct PolpoPlugin {
    schedule: Interned<dyn ScheduleLabel>,
}

impl PolpoPlugin {
    /// Steps in `schedule` instead of `FixedPostUpdate`.
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for PolpoPlugin {
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

/// The phases of a step, in their order. Order your systems against them.
#[derive(SystemSet, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PolpoSystems {
    /// Bodies that cannot be stepped are frozen, sleeping ones woken; new bodies and capabilities get their data; the state at the step's start is remembered.
    Prepare,
    /// Colliders fill each body's [`Contacts`](crate::Contacts); particles that may touch others of the body, or of another, are paired.
    DetectContacts,
    /// In `DetectContacts`: particles and bodies that may touch are paired, and sleeping bodies woken by those that move. What looks for contacts of awake bodies comes after it.
    FindPairs,
    /// Runs [`SubstepSchedule`] as often as [`SolverSettings::substeps`] says.
    Substeps,
    /// In [`SubstepSchedule`]: velocities take the forces, positions and orientations take the velocities.
    Predict,
    /// In [`SubstepSchedule`]: runs [`ConstraintSchedule`] as often as [`SolverSettings::iterations`] says; in that schedule: the constraints.
    SolveConstraints,
    /// In [`SubstepSchedule`]: particles leave each other, then the colliders, with friction.
    SolveContacts,
    /// In [`SubstepSchedule`]: drag and damping; what flows plastically flows.
    Integrate,
    /// `Transform` follows the centre of mass; bodies that are no longer finite are frozen, those that have come to rest fall asleep.
    Writeback,
}

/// One substep; see [`PolpoSystems`] for its sets. Add systems to it as to any schedule.
#[derive(ScheduleLabel, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SubstepSchedule;

/// One iteration over all constraints, in the set [`PolpoSystems::SolveConstraints`]. Add constraints of your own here.
#[derive(ScheduleLabel, Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ConstraintSchedule;

/// How finely a step is divided.
#[derive(Resource, Debug, Clone, Copy, PartialEq, Eq)]
pub struct SolverSettings {
    /// Substeps a step. Range 1 to [`MOST_SUBSTEPS`](Self::MOST_SUBSTEPS); what is outside counts as the nearest. Default 5.
    ///
    /// The first thing to raise: cost grows with it, stiffness stays as asked up to about 0.3 × substeps / Δt hertz (90 Hz at the defaults and 60 steps a second), fast bodies meet thin
    /// things more reliably.
    pub substeps: u32,
    /// Sweeps over the constraints a substep. Range 1 to [`MOST_ITERATIONS`](Self::MOST_ITERATIONS); what is outside counts as the nearest. Default 1.
    ///
    /// With several, each constraint remembers what it has done in the substep, so that the stiffness stays what was asked for; that costs memory and a little time. Prefer substeps.
    pub iterations: u32,
    /// Whether a step gives the same bits on processors of every kind. Default: only on those of one kind (the same bits each run and for every number of threads it gives in any case).
    ///
    /// Processors that can multiply and add in one instruction, which are all of x86 since 2013 and of 64-bit ARM, round such a pair once instead of twice. Set, it is done in two instructions everywhere, and shape matching
    /// takes a quarter longer.
    pub deterministic: bool,
}

impl SolverSettings {
    /// As many substeps as there may be: below a microsecond or two, `f32` does not tell how far anything gets. One body of 27 particles takes a tenth of a second for them, and a slip of the pen does not hang the game.
    pub const MOST_SUBSTEPS: u32 = 10_000;
    /// As many iterations as there may be.
    pub const MOST_ITERATIONS: u32 = 100;

    /// The same with both within their ranges: what the step takes.
    pub(crate) fn in_range(self) -> Self {
        Self { substeps: self.substeps.clamp(1, Self::MOST_SUBSTEPS), iterations: self.iterations.clamp(1, Self::MOST_ITERATIONS), ..self }
    }
}

impl Default for SolverSettings {
    fn default() -> Self {
        Self { substeps: 5, iterations: 1, deterministic: false }
    }
}

/// The length of the running substep, for systems in [`SubstepSchedule`].
#[derive(Resource, Debug, Clone, Copy, PartialEq, Default)]
pub struct SubstepTime {
    /// Length of one substep \[s\].
    pub delta: f32,
    /// Which substep of the step runs, from 0.
    pub index: u32,
    /// Which iteration of the substep runs, from 0.
    pub iteration: u32,
    /// How many iterations a substep has.
    pub iterations: u32,
    /// As in [`SolverSettings::deterministic`].
    pub deterministic: bool,
}

impl SubstepTime {
    /// The running iteration, as the solver wants it told.
    pub fn sweep(&self) -> Sweep {
        Sweep { dt: self.delta, index: self.iteration, count: self.iterations, deterministic: self.deterministic }
    }
}

impl Plugin for PolpoPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<SolverSettings>()
            .init_resource::<SubstepTime>()
            .init_resource::<crate::BodyPairs>()
            .init_resource::<crate::prototypes::Prototypes>()
            .init_resource::<crate::Gravity>()
            .init_resource::<crate::Wind>()
            .add_observer(bodies::build_body)
            .add_observer(regions::take_regions)
            .add_observer(collision::forget_planes)
            .add_observer(pins::release_pins)
            .configure_sets(
                self.schedule,
                (PolpoSystems::Prepare, PolpoSystems::DetectContacts, PolpoSystems::Substeps, PolpoSystems::Writeback).chain(),
            )
            .add_systems(
                self.schedule,
                (
                    (
                        parameters::refuse_parameters,
                        sleep::wake,
                        freeze::freeze_unfit_bodies,
                        regions::follow_body,
                        rods::build_rods,
                        explicit_groups::build_explicit,
                        shape_matching::build_groups,
                        particles::build_edges,
                        rest_pose::pose_bodies,
                        self_contact::build_self_pairs,
                        recall::recall,
                        blocks::build_blocks,
                        rods::check_substeps,
                        pins::hold_pins,
                        particles::remember_step_start,
                    )
                        .chain()
                        .in_set(PolpoSystems::Prepare),
                    (self_contact::find_self_pairs, body_contact::find_body_pairs, sleep::wake_touched)
                        .chain()
                        .in_set(PolpoSystems::FindPairs)
                        .in_set(PolpoSystems::DetectContacts),
                    // After the contacts, whose search wakes bodies.
                    (shape_matching::forget_rotations, blocks::forget_rotations, run_substeps).chain().in_set(PolpoSystems::Substeps),
                    (
                        freeze::freeze_broken_bodies,
                        writeback::follow_center_of_mass,
                        pins::break_pins,
                        sleep::count_stillness,
                        sleep::fall_asleep,
                        rider::carry_riders,
                    )
                        .chain()
                        .in_set(PolpoSystems::Writeback),
                ),
            );

        sleep::watch_removals(app);
        blocks::watch_sources(app);

        app.init_schedule(SubstepSchedule)
            .edit_schedule(SubstepSchedule, |schedule| {
                schedule.set_executor(SingleThreadedExecutor::new());
            })
            .configure_sets(
                SubstepSchedule,
                (PolpoSystems::Predict, PolpoSystems::SolveConstraints, PolpoSystems::SolveContacts, PolpoSystems::Integrate).chain(),
            )
            .add_systems(
                SubstepSchedule,
                (
                    (wind::blow, predict::predict_particles, explicit_groups::predict_explicit).chain().in_set(PolpoSystems::Predict),
                    (
                        keep_momentum::measure_momentum,
                        run_iterations,
                        keep_momentum::restore_momentum,
                        grab::pull_grabbed,
                        explicit_groups::hold_explicit,
                    )
                        .chain()
                        .in_set(PolpoSystems::SolveConstraints),
                    (
                        explicit_groups::strike_explicit,
                        self_contact::solve_self_pairs,
                        body_contact::solve_body_pairs,
                        explicit_groups::strike_by_pairs,
                        // What pairs gave each other is shared out by momentum; what colliders give is not.
                        explicit_groups::hold_explicit,
                        collision::solve_contacts,
                        explicit_groups::land_explicit,
                    )
                        .chain()
                        .in_set(PolpoSystems::SolveContacts),
                    (integrate::integrate_particles, damping::damp_internally, plasticity::creep, pins::sum_reactions)
                        .chain()
                        .in_set(PolpoSystems::Integrate),
                ),
            );

        app.init_schedule(ConstraintSchedule)
            .edit_schedule(ConstraintSchedule, |schedule| {
                schedule.set_executor(SingleThreadedExecutor::new());
            })
            .add_systems(
                ConstraintSchedule,
                (
                    blocks::solve_blocks,
                    shape_matching::match_shapes,
                    distance::solve_distances,
                    torsion::solve_torsion,
                    rods::solve_rods,
                    explicit_groups::match_explicit,
                )
                    .chain()
                    .in_set(PolpoSystems::SolveConstraints),
            );
    }

    fn finish(&self, _app: &mut App) {
        // Parallel queries need the pool; a game without `TaskPoolPlugin` gets a default one.
        bevy::tasks::ComputeTaskPool::get_or_init(bevy::tasks::TaskPool::default);
    }
}

/// One step is `substeps` runs of [`SubstepSchedule`]. A step of no, negative or non-finite duration does nothing.
fn run_substeps(world: &mut World) {
    let step = world.get_resource::<Time>().map_or(0.0, Time::delta_secs);
    let SolverSettings { substeps, iterations, deterministic } = world.resource::<SolverSettings>().in_range();
    let delta = step / substeps as f32;
    if !(delta > 0.0 && delta.is_finite()) {
        return;
    }
    let _ = world.try_schedule_scope(SubstepSchedule, |world, schedule| {
        for index in 0..substeps {
            *world.resource_mut::<SubstepTime>() = SubstepTime { delta, index, iteration: 0, iterations, deterministic };
            schedule.run(world);
        }
    });
}

fn run_iterations(world: &mut World) {
    let iterations = world.resource::<SubstepTime>().iterations;
    let _ = world.try_schedule_scope(ConstraintSchedule, |world, schedule| {
        for iteration in 0..iterations {
            world.resource_mut::<SubstepTime>().iteration = iteration;
            schedule.run(world);
        }
    });
}
