//! `cargo xtask sheet MESH…`: every mesh rigged by the default recipe and dropped on a floor, in one picture.
//!
//! The command `polpo` draws; here its pictures are cut into panels and laid side by side, a row a mesh.

use std::path::{Path, PathBuf};
use std::process::Command;

use image::imageops::FilterType;
use image::{RgbImage, imageops};

/// A panel of the sheet \[pixels\].
const PANEL: [u32; 2] = [400, 300];
/// Where the panels are in the two pictures that `polpo` draws, as shares of their width and height: left, top, width, height.
const RIG: [[f32; 4]; 4] = [[0.0, 0.0, 0.5, 0.5], [0.5, 0.0, 0.5, 0.5], [0.0, 0.5, 0.5, 0.5], [0.5, 0.5, 0.5, 0.5]];
const FALLEN: [[f32; 4]; 1] = [[0.0, 0.0, 0.5, 1.0]];

/// What the sheet is made of.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The meshes, a row each.
    #[arg(required = true)]
    meshes: Vec<PathBuf>,
    /// The picture.
    #[arg(short, long, default_value = "docs/rigs.png")]
    output: PathBuf,
}

/// Why there is no sheet.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SheetError {
    /// A file or a process.
    #[error("{what}: {source}")]
    Io {
        /// Which.
        what: String,
        /// Why.
        source: std::io::Error,
    },
    /// `polpo` did not do it, or its check failed.
    #[error("polpo {0} failed")]
    Failed(String),
    /// A picture could not be read or written.
    #[error("{path}: {source}")]
    Image {
        /// Which.
        path: String,
        /// Why.
        source: image::ImageError,
    },
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), SheetError> {
    let folder = std::env::temp_dir().join(format!("polpo_sheet_{}", std::process::id()));
    let io = |what: &Path, source| SheetError::Io { what: what.display().to_string(), source };
    std::fs::create_dir_all(&folder).map_err(|e| io(&folder, e))?;
    let columns = (RIG.len() + FALLEN.len()) as u32;
    let mut sheet = RgbImage::new(columns * PANEL[0], arguments.meshes.len() as u32 * PANEL[1]);
    for (row, mesh) in arguments.meshes.iter().enumerate() {
        // A copy, so that no rig or recipe beside the mesh has a say.
        let copy = folder.join(mesh.file_name().unwrap_or_default());
        std::fs::copy(mesh, &copy).map_err(|e| io(mesh, e))?;
        let file = copy.display().to_string();
        let [rig, fallen] = ["rig.png", "fallen.png"].map(|name| folder.join(name).display().to_string());
        polpo(&["rig", &file])?;
        polpo(&["inspect", &file, "--png", &rig])?;
        polpo(&["simulate", &file, "--seconds", "5", "--png", &fallen])?;
        let mut column = 0;
        for (path, panels) in [(rig, &RIG[..]), (fallen, &FALLEN[..])] {
            let picture = image::open(&path).map_err(|source| SheetError::Image { path, source })?.to_rgb8();
            for panel in panels {
                let cut = cut(&picture, *panel);
                imageops::replace(&mut sheet, &cut, i64::from(column * PANEL[0]), row as i64 * i64::from(PANEL[1]));
                column += 1;
            }
        }
    }
    let path = arguments.output.display().to_string();
    sheet.save(&arguments.output).map_err(|source| SheetError::Image { path, source })?;
    std::fs::remove_dir_all(&folder).map_err(|e| io(&folder, e))
}

/// One panel of a picture in the sheet's size; what is too high is cut off below.
fn cut(picture: &RgbImage, [left, top, width, height]: [f32; 4]) -> RgbImage {
    let (w, h) = (picture.width() as f32, picture.height() as f32);
    let width = (width * w) as u32;
    let height = ((height * h) as u32).min(width * PANEL[1] / PANEL[0]);
    let panel = imageops::crop_imm(picture, (left * w) as u32, (top * h) as u32, width, height).to_image();
    imageops::resize(&panel, PANEL[0], PANEL[1], FilterType::CatmullRom)
}

fn polpo(arguments: &[&str]) -> Result<(), SheetError> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(["run", "--release", "--quiet", "-p", "polpo_cli", "--"]).args(arguments).arg("--quiet");
    let status = command.status().map_err(|source| SheetError::Io { what: "cargo".into(), source })?;
    if status.success() { Ok(()) } else { Err(SheetError::Failed(arguments.join(" "))) }
}
