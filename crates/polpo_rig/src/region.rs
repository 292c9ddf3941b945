//! Regions: parts of a body that differ from the rest, chosen by rule.

use std::cmp::Ordering;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::recipe::check;
use crate::{MeshPart, RigError};

/// A channel further away makes it another colour: more than what eight bits and a soft brush leave, less than what an eye takes for the same.
const COLOR_REACH: f32 = 0.1;

/// A region of the recipe: which part of the mesh, and what differs there.
///
/// Skin is in the region if all that is said of it holds; a rule that says nothing takes the whole mesh. What is inside goes by the skin nearest to it along the body, and a particle by most of its
/// cell; cells end where a region does, unless an edit says otherwise.
///
/// Names are told apart by upper and lower case. A mesh without parts has one that is called nothing, which only `*` names.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionRule {
    /// What the region is called, not empty; regions of the same name are one.
    pub name: String,
    /// Name of the glTF node, or the OBJ object; `*` stands for any text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<String>,
    /// Name of the glTF mesh, or the OBJ group; `*` stands for any text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Name of the material; `*` stands for any text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// Vertex colour, linear RGB in 0 to 1, by which a corner counts if no channel is further away than 0.1. A triangle takes two such corners; a mesh without colours has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
    /// A box, in the mesh's unit and axes. A triangle that reaches out of it is cut, to about a voxel.
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
    /// Whether its particles hold together as one explicit group. A region that is in several pieces, such as four wheels, becomes a region a piece, in the order of the mesh: `wheels`, `wheels 2`, …
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<GroupKind>,
}

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Within {
    /// Its lowest corner \[m\], not above the highest.
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

/// A region of a rig: the particles in it, and what differs there. One with a `group` is one piece of the body: its particles are the members of one explicit group.
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

impl Within {
    pub(crate) fn holds(&self, point: Vec3) -> bool {
        point.cmpge(self.min.into()).all() && point.cmple(self.max.into()).all()
    }
}

impl RegionRule {
    /// Whether the names hold for a part.
    pub(crate) fn holds_for(&self, part: &MeshPart) -> bool {
        let names = [(&self.node, &part.node), (&self.part, &part.name), (&self.material, &part.material)];
        names.into_iter().all(|(pattern, name)| pattern.as_ref().is_none_or(|pattern| matches(pattern, name)))
    }

    /// Whether the colour holds for a triangle with corners of these, if it has any.
    pub(crate) fn holds_for_colors(&self, corners: Option<[[f32; 4]; 3]>) -> bool {
        let Some(color) = self.color else { return true };
        let near = |corner: &[f32; 4]| color.iter().zip(corner).all(|(a, b)| (a - b).abs() <= COLOR_REACH);
        corners.is_some_and(|corners| corners.iter().filter(|c| near(c)).count() >= 2)
    }

    pub(crate) fn validate(&self) -> Result<(), RigError> {
        check("name", self.name.len() as f64, !self.name.is_empty(), "not empty")?;
        if let Some(Within { min, max }) = self.within {
            // Written so that a NaN fails.
            let worst = (0..3).find(|&axis| !matches!(min[axis].partial_cmp(&max[axis]), Some(Ordering::Less | Ordering::Equal)));
            worst.map_or(Ok(()), |axis| check("within", min[axis].into(), false, "its lowest corner not above the highest"))?;
        }
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

/// Whether a pattern is the text, if every `*` in it stands for the right thing.
fn matches(pattern: &str, text: &str) -> bool {
    let mut pieces = pattern.split('*');
    let Some(mut rest) = text.strip_prefix(pieces.next().unwrap_or_default()) else { return false };
    let Some(last) = pieces.next_back() else { return rest.is_empty() };
    for piece in pieces {
        match rest.split_once(piece) {
            Some((_, after)) => rest = after,
            None => return false,
        }
    }
    rest.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_stands_for_any_text() {
        for (pattern, text) in [
            ("", ""),
            ("*", ""),
            ("*", "a"),
            ("Wheel*", "Wheel.001"),
            ("*eel", "Wheel"),
            ("*e*e*", "Wheel"),
            ("a*b*c", "a-b-b-c"),
            ("**", "x"),
        ] {
            assert!(matches(pattern, text), "{pattern} is {text}");
        }
        for (pattern, text) in [("", "a"), ("Wheel", "Wheels"), ("wheel*", "Wheel"), ("a*a", "a"), ("a*b*b", "ab"), ("*x*", "Wheel")] {
            assert!(!matches(pattern, text), "{pattern} is not {text}");
        }
    }
}
