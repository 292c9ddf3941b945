//! Numbers of the world that cannot be used.

use bevy::prelude::*;

use crate::{Gravity, Wind};

/// Triggered when a resource was set to something that is not finite: the value it had before stays.
#[derive(Event, Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{parameter} was set to {value}, which is not finite; it stays {kept}")]
pub struct ParameterRefused {
    /// The resource's name.
    pub parameter: &'static str,
    /// What it was set to.
    pub value: Vec3,
    /// What it stays.
    pub kept: Vec3,
}

/// In phase `Prepare`: one bad number in a resource would reach every body there is.
pub(crate) fn refuse_parameters(
    mut commands: Commands,
    mut gravity: ResMut<Gravity>,
    mut wind: ResMut<Wind>,
    mut good: Local<Option<(Vec3, Vec3)>>,
) {
    let (kept_gravity, kept_wind) = good.get_or_insert((Gravity::default().0, Wind::default().0));
    let mut keep = |parameter, value: Vec3, kept: &mut Vec3| {
        if value.is_finite() {
            *kept = value;
            return true;
        }
        let refused = ParameterRefused { parameter, value, kept: *kept };
        tracing::error!("{refused}");
        commands.trigger(refused);
        false
    };
    if !keep("Gravity", gravity.0, kept_gravity) {
        gravity.0 = *kept_gravity;
    }
    if !keep("Wind", wind.0, kept_wind) {
        wind.0 = *kept_wind;
    }
}
