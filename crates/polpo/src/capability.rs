//! What happens when a component asks for what cannot be.

use bevy::prelude::*;
use polpo_solver::{CalibrationError, EdgeError, GroupError, PoseError, TooDense};

/// Why a component of a body was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CapabilityError {
    /// An explicit group.
    #[error(transparent)]
    Group(#[from] GroupError),
    /// A rest pose or an inflation.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// A material, a section, or an edge without length.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// An edge.
    #[error(transparent)]
    Edge(#[from] EdgeError),
    /// Self-contact of a body that overlaps itself nearly everywhere at rest.
    #[error(transparent)]
    Dense(#[from] TooDense),
}

/// Triggered on a body when one of its components holds values that cannot be. The component has been removed; the body goes on without it.
#[derive(EntityEvent, Debug, Clone)]
pub struct CapabilityRejected {
    /// The body.
    pub entity: Entity,
    /// The component's name, such as `ExplicitGroups`.
    pub component: &'static str,
    /// What is wrong with it.
    pub reason: CapabilityError,
}

/// Removes the component `C`, tells the log and triggers [`CapabilityRejected`].
pub(crate) fn reject<C: Component>(commands: &mut Commands, entity: Entity, component: &'static str, reason: impl Into<CapabilityError>) {
    let reason = reason.into();
    tracing::error!("body {entity} does without {component}: {reason}");
    commands.entity(entity).remove::<C>();
    commands.trigger(CapabilityRejected { entity, component, reason });
}
