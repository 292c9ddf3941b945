//! Support: which particles lie on a collider, so that pairs know what bears them.

use glam::Vec3A;

use crate::{Contacts, Particles};

/// What the particles of a body lie on as a substep is about to solve contacts. Reuse it: a warmed-up search allocates nothing.
///
/// A pair cannot press a particle into what it lies on: the collider, which has the last word, would give back at once what the pair gave, as a speed that only the next substep could pass on. A particle between the ground
/// and others would carry their weight by being thrown to and fro, M·g·Δt/m fast. So a pair asks in which directions the particle can give way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Support {
    /// For each particle the first of its bearings, or [`NONE`]; empty if none lies on anything.
    first: Vec<u32>,
    bearings: Vec<Bearing>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Bearing {
    normal: Vec3A,
    friction: f32,
    /// The particle's next one, or [`NONE`].
    next: u32,
}

const NONE: u32 = u32::MAX;

/// Rounding of two opposite normals.
const JAM: f32 = 0.9999;

/// In which directions a particle can be moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Freedom {
    /// In all.
    All,
    /// Across this unit vector.
    Plane(Vec3A),
    /// Along this unit vector.
    Line(Vec3A),
    /// In none.
    None,
}

impl Freedom {
    /// What is left of a way.
    #[inline]
    pub(crate) fn of(self, way: Vec3A) -> Vec3A {
        match self {
            Self::All => way,
            Self::Plane(normal) => way - normal * normal.dot(way),
            Self::Line(along) => along * along.dot(way),
            Self::None => Vec3A::ZERO,
        }
    }
}

impl Support {
    /// Notes which particles lie on a collider, to a thousandth of their thickness, after [`sweep_contacts`](crate::sweep_contacts).
    pub fn find(&mut self, contacts: &Contacts, p: &Particles) {
        self.clear();
        for contact in &contacts.list {
            let i = contact.particle as usize;
            if i < p.len() && contact.normal.dot(p.position[i] - contact.point) <= 1.001 * p.ellipsoid(i).support(contact.normal).0 {
                self.first.resize(p.len(), NONE);
                let next = core::mem::replace(&mut self.first[i], self.bearings.len() as u32);
                self.bearings.push(Bearing { normal: contact.normal, friction: contact.friction, next });
            }
        }
    }

    /// Nothing lies on anything.
    pub fn clear(&mut self) {
        self.first.clear();
        self.bearings.clear();
    }

    fn of(&self, i: usize) -> impl Iterator<Item = &Bearing> {
        let mut at = self.first.get(i).copied().unwrap_or(NONE);
        core::iter::from_fn(move || {
            let bearing = self.bearings.get(at as usize)?;
            at = bearing.next;
            Some(bearing)
        })
    }

    /// How particle `i` can give way to a push along the unit vector `push` by something with the coefficient of friction μ.
    ///
    /// With c = −push·n for what bears it with normal n, it is jammed between the two if both are within the angle of nip, c ≥ (1 − μ²)/(1 + μ²), μ the smaller of the two coefficients: a lump between two jaws cannot be
    /// squeezed out then. Beyond, it slides along what bears it.
    pub(crate) fn freedom(&self, i: usize, push: Vec3A, friction: f32) -> Freedom {
        let mut freedom = Freedom::All;
        for bearing in self.of(i) {
            let c = -push.dot(bearing.normal);
            if c <= 0.0 {
                continue;
            }
            let mu2 = friction.min(bearing.friction).powi(2);
            if c * (1.0 + mu2) >= (1.0 - mu2) * JAM {
                return Freedom::None;
            }
            freedom = match freedom {
                Freedom::All => Freedom::Plane(bearing.normal),
                Freedom::Plane(normal) => bearing.normal.cross(normal).try_normalize().map_or(freedom, Freedom::Line),
                _ => Freedom::None,
            };
        }
        freedom
    }
}
