//! The recipe on the command line: a file, and options that override it.

use std::path::{Path, PathBuf};

use polpo_rig::{Amount, EdgeAmount, Fidelity, Placement, Recipe, RecipeMaterial};

use crate::error::CliError;

/// How a mesh is rigged. What is not given is as the recipe's file says, or else by default.
#[derive(clap::Args, Debug, Clone, Default)]
#[command(next_help_heading = "Recipe")]
pub(crate) struct RecipeOptions {
    /// Recipe [default: MESH's own, fish.rig.toml beside fish.glb, if it is there].
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    /// How many particles.
    #[arg(long, value_name = "N", conflicts_with = "spacing")]
    particles: Option<usize>,
    /// About how far particles lie from each other, in the mesh's unit.
    #[arg(long, value_name = "D")]
    spacing: Option<f32>,
    /// Where particles lie.
    #[arg(long, value_name = "WHERE", value_parser = placement)]
    placement: Option<Placement>,
    /// How many edges.
    #[arg(long, value_name = "N", conflicts_with_all = ["edges_per_particle", "edge_length"])]
    edges: Option<usize>,
    /// How many edges a particle.
    #[arg(long, value_name = "N", conflicts_with = "edge_length")]
    edges_per_particle: Option<f32>,
    /// Tie all particles that are so near each other along the body, in the mesh's unit.
    #[arg(long, value_name = "D")]
    edge_length: Option<f32>,
    /// As many particles as a vertex follows at most.
    #[arg(long, value_name = "N")]
    influences: Option<usize>,
    /// Density [kg/m³].
    #[arg(long, value_name = "RHO")]
    density: Option<f32>,
    #[command(flatten)]
    pub(crate) material: MaterialOptions,
}

/// The material that a body is as stiff as.
#[derive(clap::Args, Debug, Clone, Default)]
#[command(next_help_heading = "Material")]
pub(crate) struct MaterialOptions {
    /// Young's modulus [Pa]: the body is as stiff as its material then.
    #[arg(long, value_name = "E")]
    youngs_modulus: Option<f32>,
    /// Poisson's ratio, 0 to 0.5.
    #[arg(long, value_name = "NU")]
    poissons_ratio: Option<f32>,
    /// Retardation time [s]: a mode of frequency f is damped with the ratio π·f·τ.
    #[arg(long, value_name = "TAU")]
    retardation: Option<f32>,
    /// How faithful to the material: cells or edges.
    #[arg(long, value_name = "HOW", value_parser = fidelity)]
    fidelity: Option<Fidelity>,
}

fn placement(text: &str) -> Result<Placement, String> {
    let all = [("auto", Placement::Auto), ("surface", Placement::Surface), ("volume", Placement::Volume), ("medial", Placement::Medial)];
    all.into_iter().find(|p| p.0 == text).map(|p| p.1).ok_or_else(|| "one of auto, surface, volume, medial".into())
}

fn fidelity(text: &str) -> Result<Fidelity, String> {
    let all = [("cells", Fidelity::Cells), ("edges", Fidelity::Edges)];
    all.into_iter().find(|f| f.0 == text).map(|f| f.1).ok_or_else(|| "one of cells, edges".into())
}

impl MaterialOptions {
    /// Whether any of them was given.
    pub(crate) fn any(&self) -> bool {
        self.youngs_modulus.is_some() || self.poissons_ratio.is_some() || self.retardation.is_some() || self.fidelity.is_some()
    }

    /// `material` with what was given; none if there is no Young's modulus.
    pub(crate) fn over(&self, material: Option<RecipeMaterial>) -> Option<RecipeMaterial> {
        let youngs_modulus = self.youngs_modulus.or(material.map(|m| m.youngs_modulus))?;
        let old =
            material.unwrap_or(RecipeMaterial { youngs_modulus, poissons_ratio: 0.3, retardation: 0.0, fidelity: Fidelity::default() });
        Some(RecipeMaterial {
            youngs_modulus,
            poissons_ratio: self.poissons_ratio.unwrap_or(old.poissons_ratio),
            retardation: self.retardation.unwrap_or(old.retardation),
            fidelity: self.fidelity.unwrap_or(old.fidelity),
        })
    }
}

/// Where the recipe of a mesh is: `fish.rig.toml` beside `fish.glb`.
pub(crate) fn own(mesh: &Path) -> PathBuf {
    mesh.with_extension("rig.toml")
}

impl RecipeOptions {
    /// Whether any of them was given that only a rig made anew can follow. The material of one that is there can be changed.
    pub(crate) fn given(&self) -> bool {
        let numbers = [self.spacing, self.edges_per_particle, self.edge_length, self.density].iter().any(Option::is_some);
        let counts = [self.particles, self.edges, self.influences].iter().any(Option::is_some);
        numbers || counts || self.recipe.is_some() || self.placement.is_some()
    }

    /// The recipe for `mesh`, and the file that it is from.
    ///
    /// # Errors
    /// If the file is not a recipe, or a number is out of its range.
    pub(crate) fn recipe(&self, mesh: &Path) -> Result<(Recipe, Option<PathBuf>), CliError> {
        let file = self.recipe.clone().or_else(|| Some(own(mesh)).filter(|own| own.is_file()));
        let mut recipe = file.as_ref().map(Recipe::read).transpose()?.unwrap_or_default();
        if let Some(n) = self.particles {
            recipe.amount = Amount::Particles(n);
        }
        if let Some(d) = self.spacing {
            recipe.amount = Amount::Spacing(d);
        }
        if let Some(placement) = self.placement {
            recipe.placement = placement;
        }
        if let Some(n) = self.edges {
            recipe.edges = EdgeAmount::Count(n);
        }
        if let Some(n) = self.edges_per_particle {
            recipe.edges = EdgeAmount::PerParticle(n);
        }
        if let Some(d) = self.edge_length {
            recipe.edges = EdgeAmount::Length(d);
        }
        recipe.influences = self.influences.unwrap_or(recipe.influences);
        recipe.density = self.density.unwrap_or(recipe.density);
        if self.material.any() {
            recipe.material = self.material.over(recipe.material);
            if recipe.material.is_none() {
                let name = mesh.display().to_string();
                return Err(CliError::Option { name, what: "a material needs --youngs-modulus" });
            }
        }
        recipe.validate()?;
        Ok((recipe, file))
    }
}
