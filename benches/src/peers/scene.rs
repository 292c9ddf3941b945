//! Where bodies are put, and what they lie on: the same for both sides.

use bevy::math::Vec3;
use polpo_benches::headless::{FLOOR_CENTER, FLOOR_HALF_EXTENTS};

/// Bodies to be dropped.
pub(crate) struct Scene {
    /// Above which places: the centre of each body's rig, its lowest particle [`DROP`](polpo_benches::headless::DROP) above the floor at height 0 \[m\].
    pub(crate) places: Vec<Vec3>,
    /// What does not move.
    pub(crate) blocks: Vec<Block>,
}

/// A box along the axes, fixed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Block {
    /// \[m\]
    pub(crate) center: Vec3,
    /// \[m\]
    pub(crate) half_extents: Vec3,
}

impl Scene {
    /// On a floor at y = 0.
    pub(crate) fn on_floor(places: Vec<Vec3>) -> Self {
        Self { places, blocks: vec![floor()] }
    }

    /// `count` octopuses on the floor, that do not touch.
    pub(crate) fn apart(count: usize) -> Self {
        let across = (count as f32).sqrt().ceil() as usize;
        Self::on_floor((0..count).map(|i| Vec3::new((i % across) as f32, 0.0, (i / across) as f32) * 2.0).collect())
    }

    /// Three octopuses in a heap.
    pub(crate) fn heap() -> Self {
        Self::on_floor(vec![Vec3::ZERO, Vec3::new(0.35, 0.3, 0.0), Vec3::new(0.1, 0.6, 0.35)])
    }

    /// Three octopuses crammed into a pit.
    pub(crate) fn crammed() -> Self {
        let mut scene = Self::on_floor(vec![Vec3::ZERO, Vec3::new(0.03, 0.75, 0.02), Vec3::new(-0.02, 1.5, 0.03)]);
        scene.dig(Vec3::ZERO);
        scene
    }

    /// Three octopuses in a pit each.
    pub(crate) fn parted() -> Self {
        let mut scene = Self::apart(3);
        for place in scene.places.clone() {
            scene.dig(place);
        }
        scene
    }

    /// Walls around `place`, 2.4 m high, just wider apart than an octopus is long.
    fn dig(&mut self, place: Vec3) {
        /// \[m\]
        const INSIDE: f32 = 0.55;
        const THICK: f32 = 0.1;
        for side in [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z] {
            let along = Vec3::ONE - side.abs() - Vec3::Y;
            self.blocks.push(Block {
                center: place + side * (INSIDE + THICK) + Vec3::Y * 1.2,
                half_extents: side.abs() * THICK + along * (INSIDE + THICK) + Vec3::Y * 1.2,
            });
        }
    }
}

/// The one that all benches have.
pub(crate) fn floor() -> Block {
    Block { center: FLOOR_CENTER, half_extents: FLOOR_HALF_EXTENTS }
}
