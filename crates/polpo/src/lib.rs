//! Soft bodies made of few, oriented, ellipsoidal particles, as a Bevy ECS plugin.
//!
//! Add [`PolpoPlugin`], spawn a [`SoftBody`] with a rig, and it falls:
//!
//! ```
//! use bevy::prelude::*;
//! use polpo::prelude::*;
//! use std::sync::Arc;
//!
//! # fn rig() -> polpo_rig::Rig {
//! #     use polpo_rig::{MeshHash, Particle, Rig};
//! #     let particle = |x| Particle { position: Vec3::X * x, frame: Quat::IDENTITY, radii: Vec3::splat(0.1), mass: 1.0 };
//! #     Rig { mesh_hash: MeshHash(0), particles: vec![particle(0.0), particle(0.2)], edges: vec![[0, 1]], ..Rig::default() }
//! # }
//! let mut app = App::new();
//! app.add_plugins((MinimalPlugins, PolpoPlugin::default()));
//! app.world_mut().spawn((SoftBody::new(Arc::new(rig())), Transform::from_xyz(0.0, 2.0, 0.0)));
//! app.update();
//! ```
//!
//! # One capability, one component
//!
//! What a body can do is what it has: [`ShapeMatching`] holds its shape, [`DistanceConstraints`] the length of its edges, [`Torsion`] resists twist, [`Damping`] lets its wobble die, [`KeepMomentum`] keeps its spin,
//! [`Collision`] keeps it out of colliders, [`BodyContact`] out of other bodies, [`Sleep`] lets it rest. [`SelfContact`] keeps it out of itself, [`ExplicitGroups`] make pieces of it rigid, [`Rods`] make its edges as stiff as
//! a material, [`Plasticity`] lets dents stay, [`RestPose`] and [`Inflation`] move its rest shape from inside, [`Pins`] hold parts of it, [`Grab`] lets a hand pull it, [`AirDrag`] gives it to the wind. Remove the
//! component and neither its code nor its data is there any more. The first eight come with every
//! [`SoftBody`]; put your own values beside it when you spawn it.
//!
//! # The step
//!
//! The step runs in `FixedPostUpdate`, or in any schedule named in [`PolpoPlugin::new`]; [`PolpoSystems`] lists its phases in their order, and a system of yours may go between any two.

mod blocks;
mod bodies;
mod body_contact;
mod capability;
mod collision;
mod damping;
mod distance;
mod explicit_groups;
mod freeze;
mod grab;
mod gravity;
mod integrate;
mod keep_momentum;
mod parameters;
mod particles;
mod pins;
mod plasticity;
mod predict;
mod prototypes;
mod recall;
mod regions;
mod rest_pose;
mod rider;
mod rods;
mod schedule;
mod self_contact;
mod shape_matching;
mod sleep;
mod snapshot;
mod state_hash;
mod stiffness;
mod timings;
mod torsion;
mod wind;
mod writeback;

#[cfg(feature = "assets")]
mod assets;
#[cfg(feature = "gltf")]
mod dress;
#[cfg(feature = "render")]
pub mod render;

#[cfg(feature = "assets")]
pub use assets::{
    LoadError, ModelError, PolpoAssetsPlugin, RecipeAsset, RigAsset, RigSource, SoftBodyAssetSystems, SoftBodyLoadFailed, SoftBodyModel,
    SoftBodyReady, SoftBodyRig, SoftBodyScene,
};
pub use blocks::Blocks;
pub use bodies::{InitialVelocity, RejectReason, SoftBody, SoftBodyRejected};
pub use body_contact::{BodyContact, BodyPair, BodyPairs};
pub use capability::{CapabilityError, CapabilityRejected};
pub use collision::{Collision, ContactMemory, Contacts, ParticleFriction};
pub use damping::Damping;
pub use distance::DistanceConstraints;
pub use explicit_groups::{ExplicitGroups, ExplicitState};
pub use freeze::{BodyFrozen, FreezeReason, Frozen};
pub use grab::Grab;
pub use gravity::{Gravity, GravityScale};
pub use keep_momentum::KeepMomentum;
pub use parameters::ParameterRefused;
pub use particles::{Awake, Edges, Particles, StepStart};
pub use pins::{Pin, PinBroken, PinState, PinTarget, Pins};
pub use plasticity::Plasticity;
pub use polpo_solver::{
    CalibrationError, Deformable, Drive, ExplicitGroup, Facet, Limb, Material, Motor, Section, StateError, Stiffness, Turning,
};
pub use rest_pose::{Inflation, Posed, RestPose};
pub use rider::ParticleAnchor;
pub use rods::{CalibratedEdges, Cells, RodFidelity, RodShape, RodSolve, Rods};
pub use schedule::{ConstraintSchedule, PolpoPlugin, PolpoSystems, SolverSettings, SubstepSchedule, SubstepTime};
pub use self_contact::{SelfContact, SelfPairs};
pub use shape_matching::{ImplicitGroups, ShapeMatching};
pub use sleep::{Sleep, Sleeping, Stillness};
pub use snapshot::{BodySnapshot, SnapshotError};
pub use state_hash::state_hash;
pub use stiffness::{EdgeStiffness, ParticleStiffness};
pub use timings::{PolpoTimingsPlugin, StepTimings};
pub use torsion::Torsion;
pub use wind::{AirDrag, Wind};

/// What a game needs at hand.
pub mod prelude {
    #[cfg(feature = "render")]
    pub use crate::render::PolpoRenderPlugin;
    pub use crate::{
        AirDrag, BodyContact, BodyFrozen, Collision, Damping, DistanceConstraints, Grab, Gravity, GravityScale, InitialVelocity,
        KeepMomentum, ParticleAnchor, Pin, Pins, PolpoPlugin, PolpoSystems, SelfContact, ShapeMatching, Sleep, Sleeping, SoftBody,
        SolverSettings, Stiffness, Torsion, Wind,
    };
    #[cfg(feature = "assets")]
    pub use crate::{PolpoAssetsPlugin, SoftBodyLoadFailed, SoftBodyReady, SoftBodyRig, SoftBodyScene};
}
