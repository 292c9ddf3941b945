//! What pulls the bodies down.

use bevy::prelude::*;

/// The acceleration every body feels \[m/s²\]. Default (0, −9.81, 0).
#[derive(Resource, Debug, Clone, Copy, PartialEq, Deref, DerefMut)]
pub struct Gravity(pub Vec3);

impl Default for Gravity {
    fn default() -> Self {
        Self(Vec3::new(0.0, -9.81, 0.0))
    }
}

/// How much of [`Gravity`] this body feels: 0 floats, 1 is the same as without this component, negative rises. One that is not finite gets the body [`Frozen`](crate::Frozen).
#[derive(Component, Debug, Clone, Copy, PartialEq, Deref, DerefMut)]
pub struct GravityScale(pub f32);
