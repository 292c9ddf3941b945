//! What shape bodies keep, so that no one is fast by being limp.

use std::fmt;

/// The shape of some bodies, on average, and how still they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shape {
    /// From the lowest particle to the highest, as a share of that at rest.
    pub(crate) height: f32,
    /// Root mean square of the particles' speeds \[m/s\].
    pub(crate) speed: f32,
}

impl Shape {
    /// The mean over bodies, each its height now, its height at rest and the squares of its particles' speeds.
    pub(crate) fn mean(bodies: impl IntoIterator<Item = (f32, f32, Vec<f32>)>) -> Self {
        let (mut height, mut count, mut squares, mut particles) = (0.0, 0.0, 0.0, 0.0);
        for (now, rest, speeds) in bodies {
            height += now / rest;
            count += 1.0;
            squares += speeds.iter().sum::<f32>();
            particles += speeds.len() as f32;
        }
        Self { height: height / count, speed: (squares / particles).sqrt() }
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.0} % high, {:.2} m/s", 100.0 * self.height, self.speed)
    }
}

/// From the lowest to the highest.
pub(crate) fn extent(heights: impl IntoIterator<Item = f32>) -> f32 {
    let (low, high) = heights.into_iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
    high - low
}
