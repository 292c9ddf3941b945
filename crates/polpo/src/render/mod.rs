//! Skinning in Bevy's renderer.
