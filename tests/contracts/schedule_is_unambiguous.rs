//! No two systems of ours that touch the same data may run in either order.

use bevy::ecs::schedule::{LogLevel, ScheduleBuildSettings, ScheduleLabel};
use bevy::prelude::*;
use polpo::prelude::*;
use polpo::{ConstraintSchedule, PolpoTimingsPlugin, SubstepSchedule};
use polpo_rapier::PolpoRapierPlugin;
use polpo_tests::lattice;

#[test]
fn every_schedule_has_one_order() {
    // Alone: in Bevy's own schedules, systems of Bevy's stand beside ours without an order.
    #[derive(ScheduleLabel, Debug, Clone, PartialEq, Eq, Hash)]
    struct Step;
    let mut app = App::new();
    app.add_plugins(MinimalPlugins).init_schedule(Step).add_plugins((
        PolpoPlugin::new(Step),
        PolpoTimingsPlugin::new(Step),
        PolpoRapierPlugin::new(Step),
    ));
    let settings = || ScheduleBuildSettings { ambiguity_detection: LogLevel::Error, ..default() };
    for label in [Step.intern(), SubstepSchedule.intern(), ConstraintSchedule.intern()] {
        app.edit_schedule(label, |schedule| {
            schedule.set_build_settings(settings());
        });
    }
    app.finish();
    app.world_mut().spawn(SoftBody::new(lattice(0.1)));
    app.world_mut().resource_mut::<Time>().advance_by(std::time::Duration::from_millis(16));
    // Building a schedule with an ambiguity in it panics.
    app.world_mut().run_schedule(Step);
}
