//! `polpo rig`: from a mesh to a rig.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use polpo_references::{MaterialNeeds, material_needs};
use polpo_rig::{RigError, embed_rig, read_mesh};
use serde::Serialize;

use crate::error::CliError;
use crate::figures::{CoverageFigures, MeshFigures, RigFigures};
use crate::output::Output;
use crate::recipe::{self, RecipeOptions};
use crate::{drop, progress, source};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The mesh: glb, gltf, obj, ply or stl.
    mesh: PathBuf,
    /// Where the rig goes: `.rig` is small, `.ron` is text, `.glb` and `.gltf` are a glTF MESH with the rig in it [default: MESH with the extension .rig].
    #[arg(short, long, value_name = "RIG")]
    output: Option<PathBuf>,
    /// Write the recipe that was used beside the mesh, as MESH's own, or to FILE.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    write_recipe: Option<Option<PathBuf>>,
    /// Write no file, just report.
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    recipe: RecipeOptions,
    #[command(flatten)]
    print: Output,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Report {
    mesh: MeshFigures,
    rig: RigFigures,
    coverage: CoverageFigures,
    /// The recipe's file; null for the default.
    recipe: Option<PathBuf>,
    /// What an artist should know.
    notes: Vec<String>,
    /// What the material takes; null without one.
    needs: Option<Needs>,
    /// How long each stage took \[s\], in order.
    stages_s: Vec<(String, f64)>,
    /// The rig's file; null if none was written.
    written: Option<PathBuf>,
}

/// What it takes to be as stiff as the material.
#[derive(Serialize)]
struct Needs {
    /// Substeps that a step of 1/60 s needs.
    substeps: u32,
    /// The same if a limb's stretch were not made softer to take fewer; the same number for what is no limb.
    substeps_uncapped: u32,
    /// What fewer substeps give.
    fewer: Vec<Fewer>,
}

#[derive(Serialize)]
struct Fewer {
    substeps: u32,
    /// By what share it then gives too much, about.
    softness: f32,
}

/// Whether it was done, which it was if there is no error.
pub(crate) fn run(arguments: &Arguments) -> Result<bool, CliError> {
    let path = &arguments.mesh;
    let target = arguments.output.clone().unwrap_or_else(|| path.with_extension("rig"));
    // Before the work, not after it.
    let embedded = source::is_gltf(&target) && source::is_gltf(path);
    if !source::is_rig(&target) && !embedded {
        let extension = target.extension().map(|e| e.to_string_lossy().into_owned()).unwrap_or_default();
        return Err(RigError::UnknownExtension { name: target.display().to_string(), extension }.into());
    }
    let mesh = read_mesh(path)?;
    let (used, file) = arguments.recipe.recipe(path)?;
    let (built, stages) = progress::build(&mesh, &used, arguments.print.quiet)?;
    let rig = built.rig;
    let material = |source| CliError::Material { name: path.display().to_string(), source };
    let needs = material_needs(&rig, drop::RATE).transpose().map_err(material)?;
    let mut report = Report {
        mesh: MeshFigures::of(&mesh),
        rig: RigFigures::of(&rig),
        coverage: CoverageFigures::of(&mesh, &rig),
        recipe: file,
        notes: built.notes.iter().map(ToString::to_string).collect(),
        needs: needs.as_ref().map(Needs::of),
        stages_s: stages.into_iter().map(|(name, took)| (name, took.as_secs_f64())).collect(),
        written: None,
    };
    let mut recipe_file = None;
    if !arguments.dry_run {
        if embedded {
            let name = path.display().to_string();
            let bytes = std::fs::read(path).map_err(|source| CliError::Read { path: path.clone(), source })?;
            let bytes = embed_rig(&name, &bytes, &rig)?;
            std::fs::write(&target, bytes).map_err(|source| CliError::Write { path: target.clone(), source })?;
        } else {
            rig.write(&target)?;
        }
        report.written = Some(target);
        if let Some(to) = &arguments.write_recipe {
            let to = to.clone().unwrap_or_else(|| recipe::own(path));
            let text = used.to_toml()?;
            std::fs::write(&to, text).map_err(|source| CliError::Write { path: to.clone(), source })?;
            recipe_file = Some(to);
        }
    }
    arguments.print.give(&report, &tell(&report, needs.as_ref(), recipe_file.as_deref()))?;
    Ok(true)
}

impl Needs {
    fn of(needs: &MaterialNeeds) -> Self {
        let fewer = needs.fewer.iter().map(|&(substeps, softness)| Fewer { substeps, softness }).collect();
        Self { substeps: needs.substeps, substeps_uncapped: needs.uncapped, fewer }
    }
}

fn tell(report: &Report, needs: Option<&MaterialNeeds>, recipe_file: Option<&Path>) -> String {
    let mut text = String::new();
    report.mesh.tell(&mut text);
    report.rig.tell(&mut text);
    report.coverage.tell(&mut text);
    // Writing to a string does not fail.
    if let Some(needs) = needs {
        let _ = writeln!(text, "stiffness  needs {needs}");
    }
    for note in &report.notes {
        let _ = writeln!(text, "note       {note}");
    }
    let stages: Vec<String> = report.stages_s.iter().map(|(name, s)| format!("{name} {s:.2}")).collect();
    let whole: f64 = report.stages_s.iter().map(|s| s.1).sum();
    let _ = writeln!(text, "seconds    {whole:.2}: {}", stages.join(", "));
    let recipe = report.recipe.as_ref().map_or("the default".into(), |file| file.display().to_string());
    let _ = writeln!(text, "recipe     {recipe}");
    if let Some(file) = recipe_file {
        let _ = writeln!(text, "written    {}", file.display());
    }
    let written = report.written.as_ref().map_or("nothing".into(), |file| file.display().to_string());
    let _ = writeln!(text, "written    {written}");
    text
}
