//! Octopuses fall down a staircase, are swept by a turning bar, and come to rest.

use std::sync::Arc;

use bevy::prelude::*;
use polpo::prelude::*;
use polpo_rapier::RapierWorld;
use polpo_rig::{Mesh as RigMesh, Rig};
use rapier3d::na::Unit;
use rapier3d::prelude::{ColliderBuilder, RigidBodyBuilder, RigidBodyHandle};

use crate::noise::Noise;
use crate::outfit::Outfit;
use crate::props::spawn_prop;
use crate::stage::View;

/// The octopus that comes with the project: its mesh and its rig.
///
/// # Panics
///
/// Never: both files are part of the program, and a test reads them.
pub fn octopus_asset() -> (Arc<RigMesh>, Arc<Rig>) {
    let mesh = polpo_rig::parse_glb("octopus.glb", include_bytes!("../../../assets/octopus.glb"));
    let rig = Rig::from_postcard("octopus.rig", include_bytes!("../../../assets/octopus.rig"));
    (Arc::new(mesh.expect("the embedded mesh is whole")), Arc::new(rig.expect("the embedded rig is whole")))
}

/// The staircase scene.
pub struct OctopusScene {
    /// How many octopuses fall.
    pub count: usize,
    /// What differs from run to run: how they are turned.
    pub seed: u64,
}

const STEPS: usize = 6;
const RISE: f32 = 0.26;
const TREAD: f32 = 0.62;
/// The topmost step is deeper by this.
const LANDING: f32 = 1.2;
const WIDTH: f32 = 4.6;
/// Where the bar turns, at the foot of the stairs.
const PIVOT: Vec3 = Vec3::new(2.35, 0.2, 0.0);
/// The bar turns until it has swept the foot of the stairs twice, then slows down and stands \[s\].
const SLOW_FROM: f32 = 2.8;
const STANDS_FROM: f32 = 3.6;
/// \[rad/s\]
const TURNING: f32 = 1.9;

#[derive(Resource)]
struct Bar(RigidBodyHandle);

impl Plugin for OctopusScene {
    fn build(&self, app: &mut App) {
        let (count, seed) = (self.count, self.seed);
        app.insert_resource(View { eye: Vec3::new(4.5, 2.6, 4.9), target: Vec3::new(0.45, 0.42, 0.35) })
            .add_systems(Startup, build_stairs)
            .add_systems(Startup, move |commands: Commands| spawn_octopuses(commands, count, seed))
            .add_systems(FixedUpdate, turn_bar);
    }
}

fn build_stairs(mut commands: Commands, mut world: ResMut<RapierWorld>) {
    let floor = ColliderBuilder::halfspace(Unit::new_unchecked(Vec3::Y)).friction(0.7);
    spawn_prop(&mut commands, &mut world, floor, None, Color::srgb(0.33, 0.42, 0.45));
    for step in 0..STEPS {
        // From the lowest, whose front edge is at x = 1, up and to the left.
        let top = RISE * (step + 1) as f32;
        let depth = TREAD * (STEPS - step) as f32 + LANDING;
        let x = 1.0 - TREAD * STEPS as f32 - LANDING + 0.5 * depth;
        let block =
            ColliderBuilder::cuboid(0.5 * depth, 0.5 * RISE, 0.5 * WIDTH).translation(Vec3::new(x, top - 0.5 * RISE, 0.0)).friction(0.55);
        let shade = 0.50 + 0.05 * step as f32;
        spawn_prop(&mut commands, &mut world, block, None, Color::srgb(shade, shade * 0.93, shade * 0.82));
    }
    let body = world.bodies.insert(RigidBodyBuilder::kinematic_velocity_based().translation(PIVOT).angvel(Vec3::Y * TURNING));
    let bar = ColliderBuilder::capsule_x(1.25, 0.11).friction(0.4);
    spawn_prop(&mut commands, &mut world, bar, Some(body), Color::srgb(0.16, 0.42, 0.55));
    let hub = ColliderBuilder::cylinder(0.24, 0.17).friction(0.4);
    spawn_prop(&mut commands, &mut world, hub, Some(body), Color::srgb(0.12, 0.30, 0.40));
    commands.insert_resource(Bar(body));
}

fn turn_bar(time: Res<Time>, bar: Res<Bar>, mut world: ResMut<RapierWorld>) {
    let late = ((time.elapsed_secs() - SLOW_FROM) / (STANDS_FROM - SLOW_FROM)).clamp(0.0, 1.0);
    if let Some(body) = world.bodies.get_mut(bar.0) {
        body.set_angvel(Vec3::Y * (TURNING * (1.0 - late)), true);
    }
}

/// Above the upper steps, side by side in lanes, further ones higher up.
fn spawn_octopuses(mut commands: Commands, count: usize, seed: u64) {
    let (mesh, rig) = octopus_asset();
    let mut noise = Noise::new(seed);
    let lanes = count.clamp(1, 3);
    for index in 0..count {
        let (layer, lane) = (index / lanes, index % lanes);
        let z = (lane as f32 - 0.5 * (lanes - 1) as f32) * 1.45;
        let height = RISE * STEPS as f32 + 0.75 + 1.1 * layer as f32 + 0.25 * lane as f32;
        let position = Vec3::new(-2.5 + 0.3 * noise.signed(), height, z);
        let turn = Quat::from_euler(EulerRot::YXZ, 3.0 * noise.signed(), 0.5 * noise.signed(), 0.5 * noise.signed());
        // Some take all the stairs, some stay on them.
        let speed = [3.4, 0.1, 2.2][index % 3];
        let tint = [Color::WHITE, Color::srgb(1.0, 0.80, 0.62), Color::srgb(0.86, 0.72, 1.0)][index % 3];
        commands.spawn((
            Name::new(format!("octopus {index}")),
            SoftBody::new(rig.clone()),
            Outfit { mesh: mesh.clone(), color: tint },
            Transform::from_translation(position).with_rotation(turn),
            InitialVelocity {
                linear: Vec3::new(speed + 0.2 * noise.signed(), 0.0, 0.0),
                angular: Vec3::new(0.0, noise.signed(), -0.8 * speed),
            },
        ));
    }
}
