//! What each phase of the step takes.

use bevy::ecs::schedule::ScheduleLabel;
use bevy::platform::time::Instant;
use bevy::prelude::*;
use core::time::Duration;

use crate::{PolpoSystems, SubstepSchedule};

/// The phases that are timed, in the order of [`StepTimings::phases`].
const PHASES: [&str; 7] = ["prepare", "detect_contacts", "predict", "solve_constraints", "solve_contacts", "integrate", "writeback"];

/// How long the last step took, by phase. Needs [`PolpoTimingsPlugin`].
#[derive(Resource, Debug, Clone, Copy)]
pub struct StepTimings {
    /// How many steps have been taken.
    pub steps: u64,
    started: Instant,
    lap: Instant,
    spent: [Duration; PHASES.len()],
    total: Duration,
}

impl Default for StepTimings {
    fn default() -> Self {
        let now = Instant::now();
        Self { steps: 0, started: now, lap: now, spent: [Duration::ZERO; PHASES.len()], total: Duration::ZERO }
    }
}

impl StepTimings {
    /// The whole of the last step, from before `Prepare` to after `Writeback`.
    pub fn total(&self) -> Duration {
        self.total
    }

    /// Name and duration of each phase in the last step, substeps summed.
    pub fn phases(&self) -> impl Iterator<Item = (&'static str, Duration)> + '_ {
        PHASES.into_iter().zip(self.spent)
    }
}

/// Measures [`StepTimings`]. Add it after [`PolpoPlugin`](crate::PolpoPlugin), with the same schedule. A game that does not add it does not read a clock.
pub struct PolpoTimingsPlugin {
    schedule: bevy::ecs::intern::Interned<dyn ScheduleLabel>,
}

impl PolpoTimingsPlugin {
    /// For a step in `schedule`.
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for PolpoTimingsPlugin {
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

impl Plugin for PolpoTimingsPlugin {
    fn build(&self, app: &mut App) {
        use PolpoSystems::{DetectContacts, Integrate, Predict, Prepare, SolveConstraints, SolveContacts, Substeps, Writeback};
        app.init_resource::<StepTimings>()
            .add_systems(
                self.schedule,
                (
                    begin_step.before(Prepare),
                    lap::<0>.after(Prepare).before(DetectContacts),
                    lap::<1>.after(DetectContacts).before(Substeps),
                    begin_lap.after(Substeps).before(Writeback),
                    end_step.after(Writeback),
                ),
            )
            .add_systems(
                SubstepSchedule,
                (
                    begin_lap.before(Predict),
                    lap::<2>.after(Predict).before(SolveConstraints),
                    lap::<3>.after(SolveConstraints).before(SolveContacts),
                    lap::<4>.after(SolveContacts).before(Integrate),
                    lap::<5>.after(Integrate),
                ),
            );
    }
}

fn begin_step(mut timings: ResMut<StepTimings>) {
    let now = Instant::now();
    timings.started = now;
    timings.lap = now;
    timings.spent = [Duration::ZERO; PHASES.len()];
}

fn begin_lap(mut timings: ResMut<StepTimings>) {
    timings.lap = Instant::now();
}

/// Books the time since the last lap on a phase.
fn lap<const PHASE: usize>(mut timings: ResMut<StepTimings>) {
    let now = Instant::now();
    let spent = now - timings.lap;
    timings.spent[PHASE] += spent;
    timings.lap = now;
}

fn end_step(mut timings: ResMut<StepTimings>) {
    let now = Instant::now();
    let spent = now - timings.lap;
    timings.spent[6] += spent;
    timings.total = now - timings.started;
    timings.steps += 1;
}
