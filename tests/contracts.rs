//! The contracts that need no renderer, one module each. One binary, because each would link all of Bevy.

#[path = "contracts/assets_are_whole.rs"]
mod assets_are_whole;
#[path = "contracts/bad_input.rs"]
mod bad_input;
#[path = "contracts/bodies_come_and_go.rs"]
mod bodies_come_and_go;
#[path = "contracts/cells.rs"]
mod cells;
#[path = "contracts/changed_at_run_time.rs"]
mod changed_at_run_time;
#[path = "contracts/determinism.rs"]
mod determinism;
#[path = "contracts/dynamic_bodies.rs"]
mod dynamic_bodies;
#[path = "contracts/explicit_groups.rs"]
mod explicit_groups;
#[path = "contracts/far_from_the_origin.rs"]
mod far_from_the_origin;
#[path = "contracts/free_flight.rs"]
mod free_flight;
#[path = "contracts/groups_in_parallel.rs"]
mod groups_in_parallel;
#[path = "contracts/joints.rs"]
mod joints;
#[path = "contracts/large_bodies.rs"]
mod large_bodies;
#[path = "contracts/last_look.rs"]
mod last_look;
#[path = "contracts/model_files.rs"]
mod model_files;
#[path = "contracts/octopus_scene.rs"]
mod octopus_scene;
#[path = "contracts/pairs.rs"]
mod pairs;
#[path = "contracts/pinned_groups.rs"]
mod pinned_groups;
#[path = "contracts/pins.rs"]
mod pins;
#[path = "contracts/plasticity.rs"]
mod plasticity;
#[path = "contracts/quarantine.rs"]
mod quarantine;
#[path = "contracts/rapier_pins.rs"]
mod rapier_pins;
#[path = "contracts/rest_pose.rs"]
mod rest_pose;
#[path = "contracts/rod_poses.rs"]
mod rod_poses;
#[path = "contracts/rods.rs"]
mod rods;
#[path = "contracts/schedule_is_unambiguous.rs"]
mod schedule_is_unambiguous;
#[path = "contracts/sleeping.rs"]
mod sleeping;
#[path = "contracts/sleeping_rigid.rs"]
mod sleeping_rigid;
#[path = "contracts/snapshot.rs"]
mod snapshot;
#[path = "contracts/stiffness_in_hertz.rs"]
mod stiffness_in_hertz;
#[path = "contracts/stiffness_lists.rs"]
mod stiffness_lists;
#[path = "contracts/unused_costs_nothing.rs"]
mod unused_costs_nothing;
#[path = "contracts/unused_is_not_run.rs"]
mod unused_is_not_run;
