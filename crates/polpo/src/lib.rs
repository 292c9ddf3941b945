//! Soft bodies made of few, oriented, ellipsoidal particles, as a Bevy ECS plugin.
