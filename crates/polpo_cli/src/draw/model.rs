//! What can be drawn: triangles and ellipsoids.

use glam::{Mat3, Quat, Vec3};

/// A corner of a triangle, in the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    /// \[m\]
    pub(crate) position: Vec3,
    /// Unit vector.
    pub(crate) normal: Vec3,
    /// Linear RGB, 0 to 1.
    pub(crate) colour: Vec3,
}

/// An ellipsoid, in the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ellipsoid {
    /// \[m\]
    pub(crate) centre: Vec3,
    /// Turns x, y, z into the directions of `radii`.
    pub(crate) frame: Quat,
    /// Half axes \[m\], positive.
    pub(crate) radii: Vec3,
    /// Linear RGB, 0 to 1.
    pub(crate) colour: Vec3,
}

impl Ellipsoid {
    /// R·diag(r²)·Rᵀ \[m²\]: the half extent along a unit vector d is √(d·M·d).
    pub(crate) fn spread(&self) -> Mat3 {
        let axes = Mat3::from_quat(self.frame);
        axes * Mat3::from_diagonal(self.radii * self.radii) * axes.transpose()
    }

    /// How far it reaches from its centre along the unit vector `direction` \[m\].
    pub(crate) fn reach(&self, direction: Vec3) -> f32 {
        (self.spread() * direction).dot(direction).max(0.0).sqrt()
    }
}

/// Everything in a picture, or one layer of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Model {
    pub(crate) corners: Vec<Corner>,
    /// Three corners each.
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) ellipsoids: Vec<Ellipsoid>,
}

impl Model {
    /// All of `other` too.
    pub(crate) fn add(&mut self, other: Model) {
        let first = self.corners.len() as u32;
        self.corners.extend(other.corners);
        self.triangles.extend(other.triangles.into_iter().map(|t| t.map(|c| c + first)));
        self.ellipsoids.extend(other.ellipsoids);
    }

    /// A round bar between two places.
    pub(crate) fn add_bar(&mut self, ends: [Vec3; 2], radius: f32, colour: Vec3) {
        const SIDES: u32 = 8;
        let Some(along) = (ends[1] - ends[0]).try_normalize() else { return };
        let (across, up) = along.any_orthonormal_pair();
        let first = self.corners.len() as u32;
        for side in 0..SIDES {
            let (sin, cos) = (side as f32 * (core::f32::consts::TAU / SIDES as f32)).sin_cos();
            let normal = across * cos + up * sin;
            self.corners.extend(ends.map(|end| Corner { position: end + normal * radius, normal, colour }));
            let [a, b] = [2 * side, 2 * ((side + 1) % SIDES)];
            self.triangles.extend([[a, b, a + 1], [b, b + 1, a + 1]].map(|t| t.map(|c| c + first)));
        }
    }

    /// Points whose hull holds all of it \[m\].
    pub(crate) fn outline(&self) -> impl Iterator<Item = Vec3> + Clone {
        let boxes = self.ellipsoids.iter().flat_map(|e| {
            let half = Vec3::AXES.map(|axis| axis * e.reach(axis));
            (0..8u32)
                .map(move |corner| half.iter().enumerate().fold(e.centre, |p, (k, &h)| if corner >> k & 1 == 0 { p - h } else { p + h }))
        });
        let used = self.triangles.iter().flatten().map(|&c| self.corners[c as usize].position);
        used.chain(boxes)
    }
}
