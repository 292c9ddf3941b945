//! `polpo simulate`: a body falls on a floor.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use polpo_rig::{Mesh, Rig};
use serde::Serialize;

use crate::draw::picture::{self, Panel, PictureError, View};
use crate::draw::pose::skinned;
use crate::draw::{mesh as draw_mesh, model::Model, rig as draw_rig};
use crate::drop::{self, Fall, Landing};
use crate::error::CliError;
use crate::figures::bounds;
use crate::inspect::Picture;
use crate::number;
use crate::output::{Output, digits};
use crate::progress;
use crate::recipe::RecipeOptions;
use crate::references::{self, References};
use crate::source::{self, Source};

/// Deeper than this share of its size no body may get into the floor.
const DEEPEST: f32 = 0.01;
/// Longer by more than this share no edge may get.
const LONGEST: f32 = 1.0;

pub(crate) const EXIT_CODES: &str = "Exit codes: 0 all is well; 1 a body did not stay finite, was deeper in the floor than 1 % of its size, or had an edge twice as long as at rest, \
or a reference is out of its tolerance; 2 it could not be done.";

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A rig, or a mesh, which is rigged if there is no rig beside it or a recipe's option is given.
    #[arg(value_name = "MESH|RIG", required_unless_present = "references", conflicts_with = "references")]
    file: Option<PathBuf>,
    /// The rig's mesh [default: the one beside it, fish.glb for fish.rig].
    #[arg(long, value_name = "FILE", conflicts_with = "references")]
    mesh: Option<PathBuf>,
    #[command(flatten)]
    scene: Scene,
    #[command(flatten)]
    picture: Picture,
    #[command(flatten)]
    recipe: RecipeOptions,
    #[command(flatten)]
    references: References,
    #[command(flatten)]
    print: Output,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Scene")]
struct Scene {
    /// How long [s].
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = number::seconds)]
    seconds: f32,
    /// How high above the floor the lowest point starts [m].
    #[arg(long, value_name = "H", default_value_t = 1.0, value_parser = number::finite)]
    height: f32,
    /// Largest side of the body [m], whatever the mesh's unit [default: 1].
    #[arg(long, value_name = "SIZE", value_parser = number::positive_f32)]
    size: Option<f32>,
    /// How many bodies, one above the other.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    count: u32,
    /// How fast it spins at first [rad/s].
    #[arg(long, value_name = "OMEGA", default_value_t = 0.0, value_parser = number::finite, allow_negative_numbers = true)]
    spin: f32,
    /// Stiffness of its groups [Hz], instead of the default of 25 or the rig's material.
    #[arg(long, value_name = "F", value_parser = number::positive_f32)]
    hertz: Option<f32>,
    /// Substeps a step of 1/60 s [default: the plugin's, 5].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    substeps: Option<u32>,
    /// Threads that simulate [default: as many as the machine has].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    threads: Option<u32>,
}

/// What `--json` writes. Over all bodies: the worst of them counts.
#[derive(Serialize)]
struct Report {
    /// The rig, and where it is from.
    from: String,
    notes: Vec<String>,
    bodies: usize,
    /// Of one body.
    particles: usize,
    /// Of one body as it is simulated \[kg\].
    mass_kg: f64,
    /// Largest side of a body as it is simulated \[m\].
    size_m: f32,
    /// By how much the rig was scaled for that.
    scale: f32,
    seconds: f32,
    steps: u64,
    substeps: u32,
    /// Substeps to be as stiff as the material; null without one.
    substeps_needed: Option<u32>,
    threads: usize,
    /// Every number of every body stayed one.
    finite: bool,
    /// Deepest that any ellipsoid has been in the floor \[m\].
    penetration_m: f32,
    /// The same at the end \[m\].
    penetration_at_end_m: f32,
    /// How deep the mesh itself is in the floor at the end \[m\]: what ellipsoids do not cover; null without a mesh.
    mesh_penetration_m: Option<f32>,
    /// From the lowest to the highest point of the least high body at the end \[m\].
    height_m: f32,
    /// The same at rest, upright \[m\].
    rest_height_m: f32,
    /// Of the fastest particle at the end \[m/s\].
    speed_m_s: f32,
    /// How much longer than at rest an edge has been at most, as a share of its length.
    edge_strain: f32,
    /// The same at the end.
    edge_strain_at_end: f32,
    /// All bodies sleep at the end.
    asleep: bool,
    /// When they fell asleep \[s\]; null if they did not.
    asleep_after_s: Option<f32>,
    /// The shortest step in which a body was awake \[ms\].
    step_ms_best: f32,
    /// Half of those steps took less \[ms\].
    step_ms_median: f32,
    /// Of the end, to the bit, hexadecimal.
    state_hash: String,
    /// What is wrong; empty if all is well.
    faults: Vec<String>,
}

/// Whether all checks hold.
pub(crate) fn run(arguments: &Arguments) -> Result<bool, CliError> {
    let Some(path) = &arguments.file else { return references::run(&arguments.references, &arguments.print) };
    let quiet = arguments.print.quiet;
    let source = source::read(path, arguments.mesh.as_deref(), &arguments.recipe, quiet)?;
    let name = path.display().to_string();
    if arguments.picture.png.is_some() && source.mesh.is_none() {
        return Err(CliError::NoMesh { rig: name });
    }
    if arguments.recipe.material.any() && source.rig.cells.is_none() {
        return Err(CliError::Option { name, what: "the rig has no cells for a material; rig it with --youngs-modulus" });
    }
    let size = size_of(&source);
    let scale = arguments.scene.size.unwrap_or(1.0) / size;
    let scene = &arguments.scene;
    let fall = Fall {
        scale,
        seconds: scene.seconds,
        height: scene.height,
        spin: scene.spin,
        count: scene.count as usize,
        hertz: scene.hertz,
        substeps: scene.substeps,
        threads: scene.threads.map(|n| n as usize),
    };
    let mut rig = source.rig.clone();
    // In place of the material, or with another one.
    rig.cells = rig.cells.filter(|_| scene.hertz.is_none());
    if let Some(cells) = &mut rig.cells {
        cells.material = arguments.recipe.material.over(Some(cells.material)).unwrap_or(cells.material);
    }
    let rig = Arc::new(rig);
    let bar = progress::bar(0, quiet);
    let landing = drop::fall(&rig, &name, &fall, &bar);
    bar.finish_and_clear();
    let landing = landing?;
    let meshes = match &source.mesh {
        Some(mesh) => {
            landing.bodies.iter().map(|b| skinned(mesh, &rig, &b.pose)).collect::<Result<Vec<Mesh>, _>>().map_err(PictureError::from)?
        }
        None => Vec::new(),
    };
    let report = report(&source, &fall, size, &landing, &meshes);
    if let Some(png) = &arguments.picture.png {
        draw(png, path, &rig, &landing, &meshes, &report, arguments.picture.turn)?;
    }
    let mut text = tell(&report, scene.size.is_none());
    if let Some(png) = &arguments.picture.png {
        // Writing to a string does not fail.
        let _ = writeln!(text, "picture    {}", png.display());
    }
    arguments.print.give(&report, &text)?;
    Ok(report.faults.is_empty())
}

/// Largest side of the mesh's box, or without one of the particles' \[the mesh's unit\].
fn size_of(source: &Source) -> f32 {
    let (low, high) = match &source.mesh {
        Some(mesh) => bounds(&mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]).collect::<Vec<_>>()),
        None => {
            let boxes = source.rig.particles.iter().flat_map(|p| [-1.0, 1.0].map(|s| p.position + Vec3::splat(s * p.radii.max_element())));
            bounds(&boxes.collect::<Vec<_>>())
        }
    };
    (high - low).max_element()
}

fn report(source: &Source, fall: &Fall, size: f32, landing: &Landing, meshes: &[Mesh]) -> Report {
    let rig = &source.rig;
    let worst = |of: fn(&drop::Fallen) -> f32| landing.bodies.iter().map(of).fold(0.0, f32::max);
    let (low, high) = drop::rest_span(rig, fall.scale);
    let mut step_ms = landing.step_ms.clone();
    step_ms.sort_by(f32::total_cmp);
    let scale = f64::from(fall.scale);
    let lowest = meshes.iter().flat_map(|m| m.triangles.iter().flatten().map(|&v| m.positions[v as usize].y)).fold(f32::INFINITY, f32::min);
    let mut report = Report {
        from: source.from.clone(),
        notes: source.notes.iter().map(ToString::to_string).collect(),
        bodies: landing.bodies.len(),
        particles: rig.particles.len(),
        mass_kg: rig.particles.iter().map(|p| f64::from(p.mass)).sum::<f64>() * scale * scale * scale,
        size_m: size * fall.scale,
        scale: fall.scale,
        seconds: landing.steps as f32 / drop::RATE,
        steps: landing.steps,
        substeps: landing.substeps,
        substeps_needed: landing.substeps_needed,
        threads: landing.threads,
        finite: landing.bodies.len() == fall.count && landing.bodies.iter().all(|b| b.finite),
        penetration_m: worst(|b| b.penetration),
        penetration_at_end_m: worst(|b| b.penetration_at_end),
        mesh_penetration_m: (!meshes.is_empty()).then_some((-lowest).max(0.0)),
        height_m: landing.bodies.iter().map(|b| b.height).fold(f32::INFINITY, f32::min),
        rest_height_m: high - low,
        speed_m_s: worst(|b| b.speed),
        edge_strain: worst(|b| b.strain),
        edge_strain_at_end: worst(|b| b.strain_at_end),
        asleep: landing.bodies.iter().all(|b| b.asleep),
        asleep_after_s: landing.asleep_after,
        step_ms_best: step_ms.first().copied().unwrap_or(0.0),
        step_ms_median: step_ms.get(step_ms.len() / 2).copied().unwrap_or(0.0),
        state_hash: format!("{:016x}", landing.state_hash),
        faults: Vec::new(),
    };
    if !report.finite {
        report.faults.push("a body did not stay finite".into());
    }
    if report.penetration_m > DEEPEST * report.size_m {
        report.faults.push(format!("a body was {} m deep in the floor, more than 1 % of its size", digits(report.penetration_m)));
    }
    if report.edge_strain > LONGEST {
        report.faults.push(format!(
            "an edge was {:.0} % longer than at rest, more than {:.0} %",
            100.0 * report.edge_strain,
            100.0 * LONGEST
        ));
    }
    report
}

fn tell(report: &Report, by_itself: bool) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = writeln!(text, "rig        {}", report.from);
    for note in &report.notes {
        let _ = writeln!(text, "note       {note}");
    }
    let bodies = if report.bodies == 1 { "1 body".into() } else { format!("{} bodies", report.bodies) };
    let _ = writeln!(
        text,
        "scene      {bodies} of {} particles, {} kg, {} m",
        report.particles,
        digits(report.mass_kg as f32),
        digits(report.size_m)
    );
    if (report.scale - 1.0).abs() > 1e-4 {
        let say = if by_itself { "; --size SIZE says otherwise" } else { "" };
        let _ = writeln!(text, "  scaled   by {} to {} m{say}", digits(report.scale), digits(report.size_m));
    }
    let _ = writeln!(text, "simulated  {} s: {} steps of {} substeps", digits(report.seconds), report.steps, report.substeps);
    if let Some(needed) = report.substeps_needed {
        let enough = if report.substeps >= needed { "" } else { ": IT IS SOFTER THAN ITS MATERIAL, see --substeps" };
        let _ = writeln!(text, "material   needs {needed} substeps{enough}");
    }
    let _ = writeln!(text, "finite     {}", if report.finite { "yes" } else { "NO" });
    let mm = |m: f32| digits(1000.0 * m);
    let mesh = report.mesh_penetration_m.map_or(String::new(), |m| format!("; of the mesh {} mm", mm(m)));
    let _ = writeln!(text, "in floor   {} mm at most, {} mm at the end{mesh}", mm(report.penetration_m), mm(report.penetration_at_end_m));
    let _ = writeln!(text, "height     {} m of {} m at rest", digits(report.height_m), digits(report.rest_height_m));
    let _ = writeln!(
        text,
        "edges      {:.1} % longer at most, {:.1} % at the end",
        100.0 * report.edge_strain,
        100.0 * report.edge_strain_at_end
    );
    let asleep = match report.asleep_after_s {
        Some(after) if report.asleep => format!("asleep after {} s", digits(after)),
        _ => "awake".into(),
    };
    let _ = writeln!(text, "at the end {asleep}, fastest particle {} m/s", digits(report.speed_m_s));
    let _ = writeln!(
        text,
        "step       {} ms best, {} ms median, awake, {} threads",
        digits(report.step_ms_best),
        digits(report.step_ms_median),
        report.threads
    );
    for fault in &report.faults {
        let _ = writeln!(text, "FAULT      {fault}");
    }
    text
}

fn draw(png: &Path, path: &Path, rig: &Rig, landing: &Landing, meshes: &[Mesh], report: &Report, turn: f32) -> Result<(), CliError> {
    let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let palette = draw_rig::palette(rig);
    let (mut skin, mut particles) = (Model::default(), Model::default());
    meshes.iter().for_each(|mesh| skin.add(draw_mesh::surface(mesh)));
    landing.bodies.iter().for_each(|body| particles.add(draw_rig::ellipsoids(rig, &body.pose, &palette)));
    let panels = [
        Panel { title: [name, format!("after {} s on the floor", digits(report.seconds))], model: skin, glass: None },
        Panel {
            title: ["particles".into(), format!("{} m of {} m high", digits(report.height_m), digits(report.rest_height_m))],
            model: particles,
            glass: None,
        },
    ];
    Ok(picture::write(png, &panels, 2, [800, 700], View { floor: 0.0, turn })?)
}
