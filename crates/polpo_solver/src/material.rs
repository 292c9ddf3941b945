//! Materials and cross-sections: what calibrated edges are made of.

use core::f32::consts::PI;

/// What an edge is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Young's modulus E \[Pa\], positive. Rubber has about 1e6, wood 1e10.
    pub youngs_modulus: f32,
    /// Poisson's ratio ν, −1 … 0.5; the shear modulus is E/(2(1 + ν)).
    pub poissons_ratio: f32,
    /// ρ \[kg/m³\], positive.
    pub density: f32,
}

impl Material {
    /// Shear modulus G = E/(2(1 + ν)) \[Pa\].
    pub fn shear_modulus(&self) -> f32 {
        self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))
    }

    /// Whether it can be calibrated from.
    pub(crate) fn check(&self) -> Result<(), CalibrationError> {
        positive(&[("Young's modulus", self.youngs_modulus), ("the density", self.density)])?;
        let nu = self.poissons_ratio;
        if !(nu > -1.0 && nu <= 0.5) {
            return Err(CalibrationError::Range { what: "Poisson's ratio", value: nu, range: "not above -1 and at most 0.5" });
        }
        Ok(())
    }
}

/// The cross-section of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// A \[m²\]
    pub area: f32,
    /// Second moment of area I, the same about both axes \[m⁴\].
    pub bending: f32,
    /// Torsion constant J \[m⁴\].
    pub torsion: f32,
    /// Shear factor κ: how much of the area counts against shear.
    pub shear: f32,
}

impl Section {
    /// A full circle of `radius` \[m\].
    pub fn circle(radius: f32) -> Self {
        let r2 = radius * radius;
        Self { area: PI * r2, bending: 0.25 * PI * r2 * r2, torsion: 0.5 * PI * r2 * r2, shear: 0.9 }
    }

    /// A full square of `side` \[m\].
    pub fn square(side: f32) -> Self {
        let a2 = side * side;
        Self { area: a2, bending: a2 * a2 / 12.0, torsion: 0.1406 * a2 * a2, shear: 5.0 / 6.0 }
    }

    pub(crate) fn check(&self) -> Result<(), CalibrationError> {
        positive(&[
            ("the area", self.area),
            ("the second moment of area", self.bending),
            ("the torsion constant", self.torsion),
            ("the shear factor", self.shear),
        ])
    }
}

/// The first of the `numbers` that is not positive and normal, as an error.
pub(crate) fn positive(numbers: &[(&'static str, f32)]) -> Result<(), CalibrationError> {
    match numbers.iter().find(|(_, value)| !(*value > 0.0 && value.is_normal())) {
        Some(&(what, value)) => Err(CalibrationError::Range { what, value, range: "not positive and normal" }),
        None => Ok(()),
    }
}

/// Refuses a radius or a time that is negative or not finite.
pub(crate) fn not_negative(what: &'static str, value: f32) -> Result<(), CalibrationError> {
    if value >= 0.0 && value.is_finite() { Ok(()) } else { Err(CalibrationError::Range { what, value, range: "not 0 or more" }) }
}

/// Why edges could not be calibrated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A number of the material or the section is out of its range.
    #[error("{what} is {value}, {range}")]
    Range {
        /// Which number.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it should be.
        range: &'static str,
    },
    /// An edge has no length to calibrate.
    #[error("edge {edge}: its ends are in the same place at rest")]
    Length {
        /// Which edge.
        edge: usize,
    },
    /// There is no such edge.
    #[error("edge {edge} is not among the {count} there are")]
    NoEdge {
        /// Which edge.
        edge: u32,
        /// How many there are.
        count: usize,
    },
    /// A facet joins particles that do not exist, or one to itself.
    #[error("facet {facet}: {a} and {b} are not two of {count} particles")]
    Pair {
        /// Which facet.
        facet: usize,
        /// Its first particle.
        a: u32,
        /// Its second particle.
        b: u32,
        /// How many particles there are.
        count: usize,
    },
    /// A facet is not finite, or does not face from its first particle to its second.
    #[error("facet {facet}: {what}")]
    Facet {
        /// Which facet.
        facet: usize,
        /// What is wrong with it.
        what: &'static str,
    },
    /// The edges close too many loops to be solved all at once.
    #[error("the edges of {particles} particles close too many loops to be solved directly; sweep them")]
    Loops {
        /// How many particles have edges.
        particles: usize,
    },
    /// Rings are swept, and not solved with the edges.
    #[error("cells of a material with a Poisson's ratio other than 0 have rings, which cannot be solved directly; sweep them")]
    DirectRings,
    /// There is not one volume a particle, or one is negative or not finite.
    #[error("the volume of particle {particle} of {count} is not 0 or more")]
    Volume {
        /// Which particle.
        particle: usize,
        /// How many particles there are.
        count: usize,
    },
}
