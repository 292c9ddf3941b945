//! The smallest program: one soft body, one floor, no window. It prints where the body comes to rest.

use bevy::prelude::*;
use polpo::prelude::*;
use polpo_rapier::{PolpoRapierPlugin, RapierWorld};
use rapier3d::prelude::ColliderBuilder;

fn main() {
    App::new()
        .add_plugins((MinimalPlugins, PolpoPlugin::default(), PolpoRapierPlugin::default()))
        .add_systems(Startup, spawn)
        .add_systems(FixedLast, report)
        .run();
}

fn spawn(mut commands: Commands, mut world: ResMut<RapierWorld>) {
    world.insert_fixed(ColliderBuilder::cuboid(10.0, 0.5, 10.0));
    let (_mesh, rig) = polpo_scenes::octopus_asset();
    commands.spawn((SoftBody::new(rig), Transform::from_xyz(0.0, 2.0, 0.0)));
}

fn report(time: Res<Time>, body: Single<&Transform, With<SoftBody>>, mut exit: MessageWriter<AppExit>) {
    if time.elapsed_secs() > 3.0 {
        println!("after 3 s the octopus lies at {}", body.translation);
        exit.write(AppExit::Success);
    }
}
