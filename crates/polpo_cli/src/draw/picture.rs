//! A picture: panels side by side, all seen by one camera, each with its title; and its file.

use std::io::BufWriter;
use std::path::Path;

use glam::Vec3;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Rgb, RgbImage};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster};

use super::camera::Camera;
use super::model::Model;
use super::shade::{FINE, Light};

const MARGIN: f32 = 0.12;
const INK: Vec3 = Vec3::new(0.012, 0.014, 0.018);

/// One view of a body.
pub(crate) struct Panel {
    /// What is seen, in bold, and a line about it.
    pub(crate) title: [String; 2],
    pub(crate) model: Model,
    /// What is seen through.
    pub(crate) glass: Option<Model>,
}

/// Where a picture is taken from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    /// Height of the floor \[m\].
    pub(crate) floor: f32,
    /// Direction to the eye: degrees about the vertical, from the front (z) to the right (x).
    pub(crate) turn: f32,
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PictureError {
    /// A rig and a mesh that do not go together.
    #[error("the mesh does not go with the rig")]
    Skin(#[from] polpo_skinning::BindingError),
    /// The file could not be written.
    #[error("{path}: no picture was written")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: image::ImageError,
    },
}

/// Draws `panels` in rows of `columns`, each of `size` pixels, and writes them as PNG.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write(path: &Path, panels: &[Panel], columns: usize, size: [usize; 2], view: View) -> Result<(), PictureError> {
    let [width, height] = size;
    let rows = panels.len().div_ceil(columns.max(1));
    let mut picture = RgbImage::new((columns * width) as u32, (rows * height) as u32);
    let all = || panels.iter().flat_map(|p| [Some(&p.model), p.glass.as_ref()]).flatten().flat_map(|m| m.outline());
    let (sin, cos) = view.turn.to_radians().sin_cos();
    let points: Vec<Vec3> = all().filter(|p| p.is_finite()).collect();
    let camera = Camera::framing(points.iter().copied(), Vec3::new(sin, 0.36, cos), width * FINE, height * FINE, MARGIN);
    for (index, panel) in panels.iter().enumerate() {
        // Glass throws no shadow.
        let light = Light::new(&panel.model, &camera, view.floor);
        let pixels = light.shine(&panel.model, panel.glass.as_ref(), width, height);
        let corner = [index % columns * width, index / columns * height];
        for (i, &colour) in pixels.iter().enumerate() {
            picture.put_pixel((corner[0] + i % width) as u32, (corner[1] + i / width) as u32, Rgb(encode(colour)));
        }
        let [left, top] = corner.map(|c| c as u32);
        print(&mut picture, [left + 28, top + 16], &panel.title[0], FontWeight::Bold, RasterHeight::Size24);
        print(&mut picture, [left + 28, top + 44], &panel.title[1], FontWeight::Regular, RasterHeight::Size20);
        if index == 0 {
            rule(&mut picture, [left + 28, top + height as u32 - 34], camera.scale / FINE as f32, width as f32 * 0.3);
        }
    }
    for pixel in 0..picture.height() * u32::from(columns > 1) {
        (1..columns).for_each(|c| picture.put_pixel((c * width) as u32, pixel, Rgb([255; 3])));
    }
    for pixel in 0..picture.width() * u32::from(rows > 1) {
        (1..rows).for_each(|r| picture.put_pixel(pixel, (r * height) as u32, Rgb([255; 3])));
    }
    let refused = |source| PictureError::Write { path: path.display().to_string(), source };
    let file = std::fs::File::create(path).map_err(|e| refused(e.into()))?;
    let encoder = PngEncoder::new_with_quality(BufWriter::new(file), CompressionType::Best, FilterType::Adaptive);
    picture.write_with_encoder(encoder).map_err(refused)
}

/// Linear RGB to sRGB.
fn encode(colour: Vec3) -> [u8; 3] {
    colour.to_array().map(|x| {
        let x = x.clamp(0.0, 1.0);
        let curved = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (255.0 * curved).round() as u8
    })
}

/// A bar as long as a round number of metres, at most `most` pixels, and the number. Nothing where a metre has no length.
fn rule(picture: &mut RgbImage, corner: [u32; 2], scale: f32, most: f32) {
    let (most, scale) = (f64::from(most), f64::from(scale));
    let decade = 10f64.powf((most / scale).log10().floor());
    let Some(length) = [5.0, 2.0, 1.0].into_iter().map(|k| k * decade).find(|l| l * scale <= most).filter(|l| l.is_finite()) else {
        return;
    };
    let end = corner[0] + (length * scale) as u32;
    // Rounded: 0.05, not 0.050000000000000003.
    let length = length as f32;
    for x in corner[0]..=end {
        let cap = x < corner[0] + 2 || x + 2 > end;
        (corner[1] - if cap { 5 } else { 1 }..=corner[1] + if cap { 5 } else { 0 }).for_each(|y| blend(picture, [x, y], 0.8));
    }
    print(picture, [end + 12, corner[1] - 10], &format!("{length} m"), FontWeight::Regular, RasterHeight::Size20);
}

/// What the typeface has no character for is left blank.
fn print(picture: &mut RgbImage, [left, top]: [u32; 2], text: &str, weight: FontWeight, height: RasterHeight) {
    let mut x = left;
    for letter in text.chars() {
        let Some(shape) = get_raster(letter, weight, height).or_else(|| get_raster(' ', weight, height)) else { continue };
        for (dy, row) in (0..).zip(shape.rows()) {
            for (dx, &ink) in (0..).zip(row) {
                blend(picture, [x + dx, top + dy], f32::from(ink) / 255.0);
            }
        }
        x += shape.width() as u32;
    }
}

fn blend(picture: &mut RgbImage, [x, y]: [u32; 2], share: f32) {
    let Some(pixel) = picture.get_pixel_mut_checked(x, y) else { return };
    let ink = encode(INK);
    for (channel, ink) in pixel.0.iter_mut().zip(ink) {
        *channel = (f32::from(*channel) * (1.0 - share) + f32::from(ink) * share).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_light_is_encoded_as_srgb() {
        assert_eq!(encode(Vec3::new(0.0, 0.215_861, 1.0)), [0, 128, 255]);
        assert_eq!(encode(Vec3::new(-1.0, 7.0, f32::NAN)), [0, 255, 0]);
    }
}
