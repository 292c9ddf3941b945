//! Regions: parts of a body that differ from the rest, chosen by rule.

use serde::{Deserialize, Serialize};

use crate::RigError;
use crate::recipe::check;

/// A region of the recipe: which part of the mesh, and what differs there.
///
/// A triangle is in the region if all that is said of it holds; a rule that says nothing takes the whole mesh. A particle is in the region that most of the skin around it is in.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionRule {
    /// What the region is called, not empty; regions of the same name are one.
    pub name: String,
    /// Name of the glTF node, or the OBJ object or group; `*` stands for any text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<String>,
    /// Name of the glTF mesh; `*` stands for any text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Name of the material; `*` stands for any text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// Vertex colour, linear RGB in 0 to 1, by which a corner counts if no channel is further away than 0.1. A triangle takes two such corners.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
    /// A box, in the mesh's unit and axes, that the middle of the triangle is in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within: Option<Within>,
    /// Density \[kg/m³\], finite and positive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density: Option<f32>,
    /// Stiffness of the groups around its particles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<Spring>,
    /// Coulomb's coefficient of its skin, finite and not negative.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f32>,
    /// Whether its particles hold together as one explicit group. A region that is in several pieces, such as four wheels, becomes a group a piece.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<GroupKind>,
}

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Within {
    /// Its lowest corner \[m\].
    pub min: [f32; 3],
    /// Its highest corner \[m\].
    pub max: [f32; 3],
}

/// Stiffness as the frequency and damping of one group alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spring {
    /// Frequency \[Hz\], not negative; infinite is rigid.
    pub hertz: f32,
    /// Damping ratio, finite and not negative; default 0.
    #[serde(default)]
    pub damping_ratio: f32,
}

/// How an explicit group holds together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GroupKind {
    /// As one rigid piece.
    Rigid,
    /// As one piece that gives.
    Soft(Spring),
}

/// A region of a rig: the particles in it, and what differs there.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// What it is called.
    pub name: String,
    /// Its particles, sorted, unique. A particle is in one region at most.
    pub particles: Vec<u32>,
    /// Stiffness of the groups around its particles, if not the body's.
    pub stiffness: Option<Spring>,
    /// Coulomb's coefficient of its skin, if not the body's.
    pub friction: Option<f32>,
    /// How it holds together, if it is an explicit group.
    pub group: Option<GroupKind>,
}

impl Spring {
    pub(crate) fn is_valid(&self) -> bool {
        self.hertz >= 0.0 && self.damping_ratio.is_finite() && self.damping_ratio >= 0.0
    }

    fn validate(&self) -> Result<(), RigError> {
        check("hertz", self.hertz.into(), self.hertz >= 0.0, "not negative")?;
        let damping = self.damping_ratio;
        check("damping_ratio", damping.into(), damping.is_finite() && damping >= 0.0, "finite and not negative")
    }
}

impl RegionRule {
    pub(crate) fn validate(&self) -> Result<(), RigError> {
        check("name", self.name.len() as f64, !self.name.is_empty(), "not empty")?;
        if let Some(density) = self.density {
            check("density", density.into(), density.is_finite() && density > 0.0, "finite and positive")?;
        }
        if let Some(friction) = self.friction {
            check("friction", friction.into(), friction.is_finite() && friction >= 0.0, "finite and not negative")?;
        }
        if let Some(spring) = self.stiffness {
            spring.validate()?;
        }
        match self.group {
            Some(GroupKind::Soft(spring)) => spring.validate(),
            _ => Ok(()),
        }
    }
}
