//! `polpo inspect`: the numbers of a rig, its faults, and a picture.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use glam::Vec3;
use polpo_rig::{Mesh, Rig, read_mesh};
use serde::Serialize;

use crate::draw::picture::{self, Panel, View};
use crate::draw::pose::Pose;
use crate::draw::{mesh as draw_mesh, rig as draw_rig};
use crate::error::CliError;
use crate::figures::{CoverageFigures, MeshFigures, RigFigures, bounds};
use crate::output::{Output, digits};
use crate::source;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A rig, or a mesh with its rig beside or in it; a mesh without one is looked at alone.
    #[arg(value_name = "RIG|MESH")]
    file: PathBuf,
    /// The rig's mesh [default: the one beside it, fish.glb for fish.rig].
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    #[command(flatten)]
    picture: Picture,
    #[command(flatten)]
    print: Output,
}

/// How a picture is taken.
#[derive(clap::Args, Debug, Clone)]
pub(crate) struct Picture {
    /// Draw a picture into FILE.
    #[arg(long, value_name = "FILE")]
    pub(crate) png: Option<PathBuf>,
    /// From where it is taken: degrees about the vertical, 0 from the front (z), 90 from the right (x).
    #[arg(long, value_name = "DEGREES", default_value_t = 35.0, value_parser = crate::number::finite, allow_negative_numbers = true)]
    pub(crate) turn: f32,
}

/// What `--json` writes.
#[derive(Serialize)]
struct Report {
    mesh: Option<MeshFigures>,
    rig: Option<RigFigures>,
    /// Null without a mesh or a rig.
    coverage: Option<CoverageFigures>,
    /// Everything holds; false if the edges leave more than one piece.
    whole: bool,
}

/// Whether the rig is whole. One that breaks its rules, or is of another mesh, is an error.
pub(crate) fn run(arguments: &Arguments) -> Result<bool, CliError> {
    let path = &arguments.file;
    let (rig, mesh) = if source::is_rig(path) {
        let rig = Rig::read(path)?;
        let mesh = arguments.mesh.clone().or_else(|| source::mesh_beside(path));
        (Some(rig), mesh.as_deref().map(read_mesh).transpose()?)
    } else {
        let mesh = read_mesh(path)?;
        (source::rig_of(path)?.map(|(rig, _)| rig), Some(mesh))
    };
    if let (Some(rig), Some(mesh)) = (&rig, &mesh) {
        rig.check_mesh(mesh)?;
    }
    let figures = rig.as_ref().map(RigFigures::of);
    let whole = figures.as_ref().is_none_or(|rig| rig.pieces == 1);
    let report = Report {
        mesh: mesh.as_ref().map(MeshFigures::of),
        rig: figures,
        coverage: rig.as_ref().zip(mesh.as_ref()).map(|(rig, mesh)| CoverageFigures::of(mesh, rig)),
        whole,
    };
    if let Some(png) = &arguments.picture.png {
        draw(png, path, rig.as_ref(), mesh.as_ref(), &report, arguments.picture.turn)?;
    }
    let mut text = String::new();
    report.mesh.iter().for_each(|mesh| mesh.tell(&mut text));
    report.rig.iter().for_each(|rig| rig.tell(&mut text));
    report.coverage.iter().for_each(|coverage| coverage.tell(&mut text));
    // Writing to a string does not fail.
    let said = match (&rig, &mesh) {
        (Some(_), Some(_)) => "the rig keeps its rules and is one of this mesh",
        (Some(_), None) => "the rig keeps its rules; its mesh is not beside it",
        _ => "the mesh can be rigged; there is no rig beside or in it",
    };
    let _ = writeln!(text, "checked    {said}{}", if whole { "" } else { ", BUT ITS EDGES LEAVE IT IN PIECES" });
    if let Some(png) = &arguments.picture.png {
        let _ = writeln!(text, "picture    {}", png.display());
    }
    arguments.print.give(&report, &text)?;
    Ok(whole)
}

fn draw(png: &Path, path: &Path, rig: Option<&Rig>, mesh: Option<&Mesh>, report: &Report, turn: f32) -> Result<(), CliError> {
    let Some(mesh) = mesh else { return Err(CliError::NoMesh { rig: path.display().to_string() }) };
    let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let mut panels = vec![Panel {
        title: [name, format!("{} triangles, {} vertices", mesh.triangles.len(), mesh.positions.len())],
        model: draw_mesh::surface(mesh),
        glass: None,
    }];
    if let (Some(rig), Some(figures)) = (rig, &report.rig) {
        let palette = draw_rig::palette(rig);
        let pose = Pose::rest(rig);
        panels.push(Panel {
            title: ["particles".into(), format!("{}, {} kg", figures.particles, digits(figures.mass_kg as f32))],
            model: draw_rig::ellipsoids(rig, &pose, &palette),
            glass: None,
        });
        panels.push(Panel {
            title: ["edges".into(), format!("{}, {:.1} a particle", figures.edges, figures.edges_per_particle)],
            model: draw_rig::skeleton(rig, &pose, &palette),
            glass: Some(draw_mesh::glass(mesh)),
        });
        panels.push(Panel {
            title: [
                "weights".into(),
                format!("{:.1} influences a vertex, {} at most", figures.influences_per_vertex, figures.most_influences),
            ],
            model: draw_mesh::weights(mesh, &rig.skin, &palette),
            glass: None,
        });
    }
    let used: Vec<Vec3> = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]).collect();
    let (columns, size) = if panels.len() > 1 { (2, [800, 600]) } else { (1, [1600, 1200]) };
    Ok(picture::write(png, &panels, columns, size, View { floor: bounds(&used).0.y, turn })?)
}
