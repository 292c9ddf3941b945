//! Rapier colliders become contacts of Polpo's soft bodies.
//!
//! Add [`PolpoRapierPlugin`] beside `polpo::PolpoPlugin` and fill the [`RapierWorld`] by Rapier's own API:
//!
//! ```
//! use bevy::prelude::*;
//! use polpo_rapier::{PolpoRapierPlugin, RapierWorld};
//! use rapier3d::prelude::*;
//!
//! let mut app = App::new();
//! app.add_plugins((MinimalPlugins, polpo::PolpoPlugin::default(), PolpoRapierPlugin::default()));
//! let mut world = app.world_mut().resource_mut::<RapierWorld>();
//! world.insert_fixed(ColliderBuilder::cuboid(10.0, 0.5, 10.0).friction(0.8));
//! app.update();
//! ```
//!
//! Every shape of Rapier's works: balls, cuboids, capsules, cylinders, cones, convex hulls, their round variants, half-spaces, triangles, segments, triangle meshes, height fields, compounds,
//! polylines, voxels. Layers, sensors, friction and its combine rules mean what they mean in Rapier.
//!
//! The detection itself knows no ECS: [`Obstacles::gather`] takes a snapshot of any `RigidBodySet` and `ColliderSet`, [`ContactDetector::detect`] fills a body's contacts from it, [`penetration`] measures.
//!
//! # Limits
//!
//! - Dynamic rigid bodies push soft ones as if they were driven, unless the soft one has [`PushRigidBodies`].
//! - A contact is a plane for the length of a step. A particle that crosses more than its own size of a curved surface in a step sees it as flat for that long.
//! - A particle is swept along a straight line without turning, and a fast, thin obstacle is met by the whole ellipsoid. Whatever takes it elsewhere within the step, its centre does not go through a surface ([`LastLook`]),
//!   but it may reach in by up to its own size until the next step.
//! - A centre that begins a substep inside a collider is not held by that one. What passes through a thin thing all the same, because a pin or the game takes it there, is brought back by its memory
//!   (`polpo::ContactMemory`), at the body's push speed.

mod ask;
mod candidates;
mod cast;
mod convex;
mod detect;
mod follower;
mod last_look;
mod movers;
mod nearest;
mod obstacles;
mod parts;
mod penetration;
mod plugin;
mod probe;
mod push;
mod sleep;
mod snapshot;
mod touch;
mod touched;
mod world;

pub use detect::{ContactDetector, DetectionInput};
pub use follower::RigidBodyFollower;
pub use last_look::LastLook;
pub use obstacles::Obstacles;
pub use penetration::penetration;
pub use plugin::{PolpoRapierPlugin, RapierSystems};
pub use push::{PushRigidBodies, PushState};
pub use snapshot::RapierSnapshot;
pub use touched::{Touch, TouchedColliders};
pub use world::RapierWorld;
