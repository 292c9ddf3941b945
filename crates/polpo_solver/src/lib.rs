//! The kernels of Polpo: position-based dynamics of oriented, ellipsoidal particles.
//!
//! A body is a set of particles that have a position *and* an orientation. One substep of length Δt is
//!
//! ```text
//! predict            v += Δt·g;  x += Δt·v;  q = exp(ω·Δt)·q
//! solve_constraints  match_shapes, solve_distances, solve_torsion   (× iterations)
//! solve_contacts     planes the particles must stay above, friction
//! integrate          drag; velocities were summed up where particles were moved
//! ```
//!
//! The constraints of a large body can be solved in [`Blocks`], on threads of the caller's.
//!
//! Every stage is a function on the slices of [`Particles`] and the data of one capability ([`ImplicitGroups`], [`Edges`], [`Contacts`]). Nothing here knows an ECS, a file, a
//! thread or a clock, and nothing calls the platform's transcendental functions: the same input gives the same bits on every run and any number of threads, and, if [`Sweep::deterministic`] is set, everywhere `f32` arithmetic is IEEE 754.
//! Without it processors with a fused multiply-add use it.
//!
//! After Müller & Chentanez, *Solid Simulation with Oriented Particles* (2011), with the corrections that each module derives where it departs from the paper.
//!
//! # Units
//!
//! SI throughout: m, kg, s, rad. Stiffness is a frequency in hertz, see [`Stiffness`].

mod batches;
#[cfg(test)]
mod beam_tests;
mod block_cholesky;
#[cfg(test)]
mod block_tests;
mod blocks;
mod broad_phase;
mod calibrated_edges;
mod check;
mod coloring;
mod contact_lanes;
mod contacts;
mod damping;
mod direct_edges;
#[cfg(test)]
mod direct_tests;
mod distance;
mod edge_strain;
mod edges;
mod ellipsoid;
mod ellipsoid_pair;
mod explicit_groups;
mod explicit_memory;
#[cfg(test)]
mod explicit_tests;
#[cfg(test)]
mod facet_bodies;
#[cfg(test)]
mod facet_sweep_tests;
#[cfg(test)]
mod facet_tests;
mod facets;
mod groups;
mod integrate;
#[cfg(test)]
mod joint_tests;
mod joints;
mod landing;
mod lanes;
mod limb;
mod match_batch;
mod material;
mod math;
mod momentum;
mod motor;
mod movers;
mod pair_ends;
#[cfg(test)]
mod pair_tests;
mod pair_touch;
mod pairs;
mod particles;
mod plasticity;
mod predict;
mod push;
#[cfg(test)]
mod push_tests;
mod rest_pairs;
mod rest_pose;
mod rigid_groups;
mod rings;
mod rods;
#[cfg(test)]
mod rolling_tests;
mod rotation;
mod self_search;
mod shape_matching;
mod soft_groups;
mod solve_blocks;
mod solve_contacts;
mod solve_pairs;
mod stiffness;
mod support;
#[cfg(test)]
mod testing;
mod ties;
mod torsion;
mod wind;
mod workless;

pub use blocks::{Block, Blocks};
pub use broad_phase::{Bounds, BroadPhase};
pub use calibrated_edges::{CalibratedEdges, solve_calibrated_edges};
pub use check::StateError;
pub use contacts::{Contact, Contacts, FreePositions};
pub use damping::{damp_beside, damp_internally};
pub use direct_edges::DirectEdges;
pub use distance::solve_distances;
pub use edges::{EdgeError, Edges};
pub use ellipsoid::Ellipsoid;
pub use ellipsoid_pair::{EllipsoidPair, PairGap};
pub use explicit_groups::{Deformable, ExplicitGroup, ExplicitGroups, GroupError};
pub use explicit_memory::GroupMemory;
pub use facets::Facet;
pub use groups::ImplicitGroups;
pub use integrate::integrate;
pub use landing::land_explicit_groups;
pub use limb::Limb;
pub use material::{CalibrationError, Material, Section};
pub use math::{quat_exp, quat_log};
pub use momentum::{Momentum, RigidFit, fit_rigid, momentum, restore_angular_momentum};
pub use motor::{Drive, Motor};
pub use movers::{Foot, Movers, RigidMover};
pub use pairs::{Pair, PairFinder, PairSearch, Pairs, swept_bounds};
pub use particles::{ParticleError, ParticleRest, Particles};
pub use plasticity::{Plasticity, creep_edges, creep_shapes};
pub use predict::predict;
pub use push::{PushContact, PushState, begin_pushes, solve_pushes, undo_overlaps};
pub use rest_pairs::TooDense;
pub use rest_pose::{PoseError, RestPose};
pub use rigid_groups::{hold_explicit_groups, match_explicit_groups, predict_explicit};
pub use rings::{Rings, solve_rings};
pub use rotation::extract_rotation;
pub use self_search::SelfSearch;
pub use shape_matching::{Turning, match_shapes};
pub use solve_blocks::{Constraints, Executor, InTurn, forget_block_rotations, solve_blocks};
pub use solve_contacts::{solve_contacts, solve_contacts_beside};
pub use solve_pairs::{PAIR_PASSES, PairRules, Sides, solve_pairs};
pub use stiffness::{Share, Shares, Stiffness, Sweep};
pub use support::find_support;
pub use ties::{Tie, solve_ties};
pub use torsion::solve_torsion;
pub use wind::blow;
