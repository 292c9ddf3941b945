//! The recipe of a rig: everything that [`build_rig`](crate::build_rig) is told beside the mesh, and its file, `.rig.toml`.
//!
//! ```toml
//! particles = 300             # or spacing = 0.05, in the mesh's unit
//! placement = "auto"          # surface, volume, medial
//! edges_per_particle = 2.5    # or edges = 750, or edge_length = 0.12
//! influences = 4
//! density = 1000.0
//!
//! [material]                  # the body is as stiff as this; left out, as the game's components say
//! youngs_modulus = 2.0e4
//! poissons_ratio = 0.3
//!
//! [[region]]
//! name = "wheels"
//! node = "Wheel*"
//! group = "rigid"
//! density = 400.0
//!
//! [[edit]]
//! disconnect = [[0.1, 0.2, 0.0], [0.3, 0.2, 0.0]]
//! ```

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::RigError;
use crate::edit::Edit;
use crate::region::RegionRule;

/// Ten voxels a particle at the finest resolution: with fewer there are no cells to speak of.
pub(crate) const MOST_PARTICLES: usize = 100_000;
/// As many particles as a vertex may follow.
pub const MOST_INFLUENCES: usize = 8;

/// How a mesh is rigged: how fine, how heavy, how stiff, and which parts are not like the rest.
///
/// A mesh that has changed is rigged anew by the same recipe. Beside `fish.glb` the recipe's file is `fish.rig.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RecipeFile", into = "RecipeFile")]
pub struct Recipe {
    /// How many particles; default 300.
    pub amount: Amount,
    /// Where they lie; default [`Placement::Auto`].
    pub placement: Placement,
    /// How many edges; default 2.5 a particle.
    pub edges: EdgeAmount,
    /// As many particles as a vertex follows at most, 1 to [`MOST_INFLUENCES`]; default 4. With one or two the weights jump where cells meet; eight change about half as fast as four.
    pub influences: usize,
    /// Density of the body \[kg/m³\], finite and positive; default 1000, water and most animals. A region may have its own.
    ///
    /// The mesh is taken to be in metres. One in centimetres weighs a million times as much, until it is spawned at a scale of 0.01.
    pub density: f32,
    /// What the body is made of. With one, the rig carries the body's cells ([`Rig::cells`](crate::Rig::cells)), which make it as stiff as that; without one (the default) it is as stiff as the components of the body say.
    pub material: Option<RecipeMaterial>,
    /// Parts that are not like the rest. Where several hold, the last one counts.
    pub regions: Vec<RegionRule>,
    /// What was changed by hand, in this order, on top of all else.
    pub edits: Vec<Edit>,
}

/// How many particles a body gets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Amount {
    /// So many, 1 to 100 000. Met exactly, unless the body has more separate parts: each gets one particle.
    ///
    /// Few make a body that bends in few places; the time of a simulation grows with them. Above about 1000 the voxels a particle
    /// gets become fewer than the 600 it should have, and cells become ragged.
    Particles(usize),
    /// As many as are on average so far from their nearest neighbour along the body \[m\], finite and positive. Met within a tenth where the
    /// body is wider than it; one particle if it is wider than the body.
    Spacing(f32),
}

/// Where particles lie.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// By the thickness of the body there: in the volume where it is thick, along the middle of limbs that are thin, and closer together in these.
    #[default]
    Auto,
    /// On the skin, evenly (Poisson disk), for thin shells and for a skin that has to be smooth; the inside is empty.
    Surface,
    /// In the volume, evenly.
    Volume,
    /// Along the middle of limbs, as few and as large as will do: a chain of large ellipsoids.
    Medial,
}

/// How many edges a body gets.
///
/// Two to three edges a particle are soft, five and more make a thick body stiff in shear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EdgeAmount {
    /// So many for every particle, finite and not negative.
    PerParticle(f32),
    /// So many. Met exactly as long as it is at least the particles less one, which it takes to hold the body together, and at most the number of pairs.
    Count(usize),
    /// All pairs that are at most so far from each other along the body \[m\], finite and positive; and those that hold the body together.
    Length(f32),
}

/// What a body is made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecipeMaterial {
    /// Young's modulus E \[Pa\], finite and positive. Jelly 1e3 … 1e4, rubber 1e6 … 1e7; stiffer takes more substeps.
    pub youngs_modulus: f32,
    /// Poisson's ratio ν, 0 to 0.5; default 0.3.
    #[serde(default = "poissons_ratio")]
    pub poissons_ratio: f32,
    /// Retardation time τ \[s\]: a mode of frequency f is damped with the ratio π·f·τ. Finite and not negative; default 0.
    #[serde(default)]
    pub retardation: f32,
    /// How faithful to it; default [`Fidelity::Cells`].
    #[serde(default)]
    pub fidelity: Fidelity,
}

/// How a body comes to its material's stiffness.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fidelity {
    /// By the facets between the particles' cells, with their contact points and the rings that give Poisson's ratio.
    #[default]
    Cells,
    /// By the same facets without rings: cheaper, and no volume is kept. Limbs are as stiff as with them, within about 8 %; what is thick in all directions gives too much, by up to a sixth.
    Edges,
}

fn poissons_ratio() -> f32 {
    0.3
}

impl Default for Recipe {
    fn default() -> Recipe {
        Recipe {
            amount: Amount::Particles(300),
            placement: Placement::Auto,
            edges: EdgeAmount::PerParticle(2.5),
            influences: 4,
            density: 1000.0,
            material: None,
            regions: Vec::new(),
            edits: Vec::new(),
        }
    }
}

impl Recipe {
    /// The default with so many particles.
    pub fn with_particles(particles: usize) -> Recipe {
        Recipe { amount: Amount::Particles(particles), ..Recipe::default() }
    }

    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// [`RigError::Setting`] with the first that is not.
    pub fn validate(&self) -> Result<(), RigError> {
        let positive = |setting, value: f32| check(setting, value.into(), value.is_finite() && value > 0.0, "finite and positive");
        let not_negative = |setting, value: f32| check(setting, value.into(), value.is_finite() && value >= 0.0, "finite and not negative");
        match self.amount {
            Amount::Particles(n) => check("particles", n as f64, (1..=MOST_PARTICLES).contains(&n), "1 to 100000")?,
            Amount::Spacing(d) => positive("spacing", d)?,
        }
        match self.edges {
            EdgeAmount::PerParticle(n) => not_negative("edges_per_particle", n)?,
            EdgeAmount::Count(_) => {}
            EdgeAmount::Length(d) => positive("edge_length", d)?,
        }
        check("influences", self.influences as f64, (1..=MOST_INFLUENCES).contains(&self.influences), "1 to 8")?;
        positive("density", self.density)?;
        if let Some(m) = self.material {
            positive("youngs_modulus", m.youngs_modulus)?;
            check("poissons_ratio", m.poissons_ratio.into(), (0.0..=0.5).contains(&m.poissons_ratio), "0 to 0.5")?;
            not_negative("retardation", m.retardation)?;
        }
        self.regions.iter().try_for_each(RegionRule::validate)?;
        self.edits.iter().try_for_each(Edit::validate)
    }

    /// Reads a recipe from the text of a `.rig.toml`; `name` is for errors. What is not there has its default.
    ///
    /// # Errors
    /// [`RigError::Recipe`] with line and column for a text that is none, a key that nobody knows, or two that exclude each other; those of [`validate`](Recipe::validate).
    pub fn from_toml(name: &str, text: &str) -> Result<Recipe, RigError> {
        let recipe: Recipe = toml::from_str(text).map_err(|e| RigError::Recipe { name: name.into(), reason: e.to_string() })?;
        recipe.validate()?;
        Ok(recipe)
    }

    /// The recipe as the text of a `.rig.toml`, which [`from_toml`](Recipe::from_toml) reads back.
    ///
    /// # Errors
    /// Those of [`validate`](Recipe::validate).
    pub fn to_toml(&self) -> Result<String, RigError> {
        self.validate()?;
        toml::to_string(self).map_err(|e| RigError::Recipe { name: "recipe".into(), reason: e.to_string() })
    }

    /// Reads a `.rig.toml`.
    ///
    /// # Errors
    /// [`RigError::Io`] if the file can't be read, and those of [`from_toml`](Recipe::from_toml).
    pub fn read(path: impl AsRef<Path>) -> Result<Recipe, RigError> {
        let name = path.as_ref().display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| RigError::Io { name: name.clone(), source })?;
        Recipe::from_toml(&name, &text)
    }
}

pub(crate) fn check(setting: &'static str, value: f64, holds: bool, range: &'static str) -> Result<(), RigError> {
    if holds { Ok(()) } else { Err(RigError::Setting { setting, value, range }) }
}

/// The recipe as it stands in its file: one key a number.
#[derive(Serialize, Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct RecipeFile {
    particles: Option<usize>,
    spacing: Option<f32>,
    placement: Placement,
    edges_per_particle: Option<f32>,
    edges: Option<usize>,
    edge_length: Option<f32>,
    influences: Option<usize>,
    density: Option<f32>,
    material: Option<RecipeMaterial>,
    #[serde(rename = "region", skip_serializing_if = "Vec::is_empty")]
    regions: Vec<RegionRule>,
    #[serde(rename = "edit", skip_serializing_if = "Vec::is_empty")]
    edits: Vec<Edit>,
}

impl TryFrom<RecipeFile> for Recipe {
    type Error = &'static str;

    fn try_from(file: RecipeFile) -> Result<Recipe, &'static str> {
        let default = Recipe::default();
        Ok(Recipe {
            amount: match (file.particles, file.spacing) {
                (Some(_), Some(_)) => return Err("`particles` and `spacing` exclude each other"),
                (Some(n), None) => Amount::Particles(n),
                (None, Some(d)) => Amount::Spacing(d),
                (None, None) => default.amount,
            },
            placement: file.placement,
            edges: match (file.edges_per_particle, file.edges, file.edge_length) {
                (Some(n), None, None) => EdgeAmount::PerParticle(n),
                (None, Some(n), None) => EdgeAmount::Count(n),
                (None, None, Some(d)) => EdgeAmount::Length(d),
                (None, None, None) => default.edges,
                _ => return Err("`edges_per_particle`, `edges` and `edge_length` exclude each other"),
            },
            influences: file.influences.unwrap_or(default.influences),
            density: file.density.unwrap_or(default.density),
            material: file.material,
            regions: file.regions,
            edits: file.edits,
        })
    }
}

impl From<Recipe> for RecipeFile {
    fn from(recipe: Recipe) -> RecipeFile {
        let mut file = RecipeFile {
            placement: recipe.placement,
            influences: Some(recipe.influences),
            density: Some(recipe.density),
            material: recipe.material,
            regions: recipe.regions,
            edits: recipe.edits,
            ..RecipeFile::default()
        };
        match recipe.amount {
            Amount::Particles(n) => file.particles = Some(n),
            Amount::Spacing(d) => file.spacing = Some(d),
        }
        match recipe.edges {
            EdgeAmount::PerParticle(n) => file.edges_per_particle = Some(n),
            EdgeAmount::Count(n) => file.edges = Some(n),
            EdgeAmount::Length(d) => file.edge_length = Some(d),
        }
        file
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recipe_survives_its_file() {
        let text = r#"
            spacing = 0.05
            placement = "medial"
            edge_length = 0.1
            influences = 8
            density = 400.0

            [material]
            youngs_modulus = 2e4
            fidelity = "edges"

            [[region]]
            name = "wheels"
            node = "Wheel*"
            group = "rigid"
            density = 300.0

            [[region]]
            name = "tail"
            within = { min = [0, 0, 0], max = [1, 1, 1] }
            stiffness = { hertz = 4.0 }
            friction = 0.2

            [[edit]]
            disconnect = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
        "#;
        let recipe = Recipe::from_toml("fish.rig.toml", text).unwrap();
        assert_eq!(recipe.amount, Amount::Spacing(0.05));
        assert_eq!(recipe.regions.len(), 2);
        assert_eq!(Recipe::from_toml("again", &recipe.to_toml().unwrap()).unwrap(), recipe);
        assert_eq!(Recipe::from_toml("empty", "").unwrap(), Recipe::default());
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, message) in [
            ("particles = 5\nspacing = 1.0", "`particles` and `spacing` exclude each other"),
            ("particels = 5", "unknown field `particels`"),
            ("influences = 9", "setting `influences` is 9: 1 to 8"),
            ("density = -1.0", "setting `density` is -1: finite and positive"),
            ("[material]\nyoungs_modulus = 1e4\npoissons_ratio = 0.6", "setting `poissons_ratio` is"),
            ("[[region]]\nname = \"a\"\ndensity = 0.0", "setting `density` is 0: finite and positive"),
        ] {
            let error = Recipe::from_toml("x.rig.toml", text).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
