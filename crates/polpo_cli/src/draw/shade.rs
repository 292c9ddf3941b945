//! Light: a lamp with a soft shadow, a sky, and what crannies get of it.

use glam::{Vec2, Vec3};

use super::camera::Camera;
use super::canvas::Canvas;
use super::model::Model;

/// Samples a pixel, along either side.
pub(crate) const FINE: usize = 3;
/// Side of the lamp's view \[px\].
const LAMP_VIEW: usize = 1024;
/// How far a shadow's edge is softened, in pixels of the lamp's view.
const SOFTNESS: f32 = 9.0;
/// A sample; a pixel has several.
const SHADOW_TAPS: usize = 6;
/// How far around a place things darken it, as a share of the picture's width.
const CRANNY: f32 = 0.07;
const CRANNY_TAPS: usize = 7;
/// How many ways the taps of a sample are turned.
const TURNS: usize = 32;

const LAMP: Vec3 = Vec3::new(1.62, 1.52, 1.38);
const SKY: Vec3 = Vec3::new(0.46, 0.52, 0.62);
const GROUND: Vec3 = Vec3::new(0.26, 0.24, 0.22);
const BACKDROP: [Vec3; 2] = [Vec3::new(0.80, 0.81, 0.82), Vec3::new(0.55, 0.56, 0.57)];

/// A scene with its light.
pub(crate) struct Light<'a> {
    camera: &'a Camera,
    /// Unit vector to the lamp.
    lamp: Vec3,
    view: Camera,
    shadow: Canvas,
    shadow_taps: Vec<[Vec2; SHADOW_TAPS]>,
    cranny_taps: Vec<[Vec2; CRANNY_TAPS]>,
    /// Height of the floor \[m\].
    floor: f32,
}

impl<'a> Light<'a> {
    /// The lamp hangs above the left shoulder of whoever looks through `camera` at `model`, which stands on a floor at the height `floor` \[m\].
    pub(crate) fn new(model: &Model, camera: &'a Camera, floor: f32) -> Light<'a> {
        let right = Vec3::Y.cross(camera.eye).normalize_or(Vec3::X);
        let lamp = (camera.eye * 0.5 - right * 0.5 + Vec3::Y * 1.1).normalize();
        let view = Camera::framing(model.outline(), lamp, LAMP_VIEW, LAMP_VIEW, 0.02);
        let shadow = Canvas::seen(model, &view, LAMP_VIEW, LAMP_VIEW);
        Light { camera, lamp, view, shadow, shadow_taps: spirals(), cranny_taps: spirals(), floor }
    }

    /// Linear RGB of every pixel of `model`, through `glass` if there is any: the mean of its samples.
    pub(crate) fn shine(&self, model: &Model, glass: Option<&Model>, width: usize, height: usize) -> Vec<Vec3> {
        let (wide, high) = (width * FINE, height * FINE);
        let mut canvas = Canvas::seen(model, self.camera, wide, high);
        let is_body: Vec<bool> = canvas.depth.iter().map(|d| d.is_finite()).collect();
        let near = near_body(&is_body, wide, CRANNY * wide as f32);
        self.lay_floor(&mut canvas);
        // Of every pixel the middle sample: near by in memory what is near by in the picture.
        let coarse: Vec<f32> =
            (0..width * height).map(|at| canvas.depth[(at / width * FINE + FINE / 2) * wide + at % width * FINE + FINE / 2]).collect();
        let glass = glass.map(|glass| Canvas::seen(glass, self.camera, wide, high));
        let is_glass = |at: usize| glass.as_ref().is_some_and(|glass| glass.depth[at].is_finite());
        let pixel = |x: usize, y: usize| {
            let samples = || (0..FINE * FINE).map(|k| (y * FINE + k / FINE) * wide + x * FINE + k % FINE);
            // On the bare floor the samples of a diagonal tell enough.
            let every = if samples().any(|at| is_body[at] || is_glass(at)) { 1 } else { FINE + 1 };
            let mut sum = Vec3::ZERO;
            for at in samples().step_by(every) {
                let close = near[0].contains(&(at % wide)) && near[1].contains(&(at / wide));
                let behind = self.sample(&canvas, at, is_body[at], close.then_some(coarse.as_slice()));
                let colour = match &glass {
                    Some(glass) if is_glass(at) && (glass.depth[at] > canvas.depth[at] || !is_body[at]) => self.through(glass, at, behind),
                    _ => behind,
                };
                sum += colour.clamp(Vec3::ZERO, Vec3::ONE);
            }
            sum / (FINE * FINE).div_ceil(every) as f32
        };
        let mut picture = vec![Vec3::ZERO; width * height];
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        let rows = height.div_ceil(threads).max(1);
        // A pixel's colour depends on nothing that is written here.
        std::thread::scope(|scope| {
            for (part, lines) in picture.chunks_mut(rows * width).enumerate() {
                let pixel = &pixel;
                scope.spawn(move || {
                    for (i, colour) in lines.iter_mut().enumerate() {
                        *colour = pixel(i % width, part * rows + i / width);
                    }
                });
            }
        });
        picture
    }

    /// Where nothing else is, the floor is. Seen from below there is none.
    fn lay_floor(&self, canvas: &mut Canvas) {
        if self.camera.eye.y < 0.05 {
            return;
        }
        for y in 0..canvas.height {
            for x in 0..canvas.width {
                let at = y * canvas.width + x;
                if canvas.depth[at] == f32::NEG_INFINITY {
                    let flat = Vec3::new(x as f32 + 0.5, y as f32 + 0.5, 0.0);
                    canvas.depth[at] = (self.floor - self.camera.world(flat).y) * self.camera.scale / self.camera.eye.y;
                    canvas.normal[at] = Vec3::Y;
                }
            }
        }
    }

    /// What has nothing `near` it, depths a pixel, is in the open.
    fn sample(&self, canvas: &Canvas, at: usize, is_body: bool, near: Option<&[f32]>) -> Vec3 {
        let (x, y) = (at % canvas.width, at / canvas.width);
        let down = y as f32 / canvas.height as f32;
        let backdrop = BACKDROP[0].lerp(BACKDROP[1], down * down);
        if !canvas.depth[at].is_finite() {
            return backdrop;
        }
        let place = Vec3::new(x as f32 + 0.5, y as f32 + 0.5, canvas.depth[at]);
        let normal = canvas.normal[at];
        let turn = turn(x, y);
        let open = near.map_or(1.0, |near| self.openness(near, canvas.width / FINE, place, normal, turn));
        let lit = self.lit(self.camera.world(place), normal, turn);
        if is_body { self.colour(canvas.colour[at], normal, open, lit) } else { backdrop * (0.35 + 0.65 * open) * (0.62 + 0.38 * lit) }
    }

    fn colour(&self, colour: Vec3, normal: Vec3, open: f32, lit: f32) -> Vec3 {
        let eye = self.camera.eye;
        let sky = GROUND.lerp(SKY, 0.5 + 0.5 * normal.y) * open;
        let fill = 0.28 * open * normal.dot((eye * 0.6 - self.lamp * 0.8 + Vec3::Y * 0.6).normalize_or(eye)).max(0.0);
        let glance = (1.0 - normal.dot(eye).clamp(0.0, 1.0)).powi(4);
        let gloss = normal.dot((self.lamp + eye).normalize_or(eye)).max(0.0).powi(48) * lit;
        let lamp = LAMP * (normal.dot(self.lamp).max(0.0) * lit * (0.4 + 0.6 * open));
        let light = colour * (sky + lamp + fill) + SKY * (0.16 * glance * open) + LAMP * (0.10 * gloss);
        // Bright places keep their hue as long as they can.
        light / (Vec3::ONE + light * 0.28)
    }

    /// Glass is the denser the more it is seen from its side.
    fn through(&self, glass: &Canvas, at: usize, behind: Vec3) -> Vec3 {
        let normal = glass.normal[at];
        let glance = 1.0 - normal.dot(self.camera.eye).clamp(0.0, 1.0);
        let gloss = normal.dot((self.lamp + self.camera.eye).normalize_or(Vec3::Y)).max(0.0).powi(40);
        let tint = glass.colour[at] * (0.55 + 0.45 * normal.dot(self.lamp).max(0.0));
        behind.lerp(tint, 0.18 + 0.75 * glance.powi(3)) + Vec3::splat(0.10 * gloss)
    }

    /// How much of the sky a place sees, 0 to 1: what stands above its tangent plane near it takes from it, the nearer and steeper the more.
    fn openness(&self, depth: &[f32], width: usize, place: Vec3, normal: Vec3, turn: usize) -> f32 {
        let normal = self.camera.turn(normal);
        let radius = CRANNY * (width * FINE) as f32;
        let mut taken = 0.0;
        for tap in self.cranny_taps[turn] {
            let to = (place.truncate() + tap * radius) / FINE as f32;
            let (x, y) = (to.x as usize, to.y as usize);
            if to.x < 0.0 || to.y < 0.0 || x >= width || (y + 1) * width > depth.len() {
                continue;
            }
            let middle = |x: usize| (x as f32 + 0.5) * FINE as f32;
            let way = Vec3::new(middle(x), middle(y), depth[y * width + x]) - place;
            let far = way.length();
            if far > FINE as f32 && far < 2.0 * radius {
                taken += (normal.dot(way) / far - 0.12).max(0.0) * (1.0 - far / (2.0 * radius));
            }
        }
        (1.0 - 2.6 * taken / CRANNY_TAPS as f32).clamp(0.0, 1.0)
    }

    /// How much of the lamp a place sees, 0 to 1. Around it the surface is taken for its tangent plane, so that it does not shade itself.
    fn lit(&self, point: Vec3, normal: Vec3, turn: usize) -> f32 {
        let facing = self.view.turn(normal);
        let place = self.view.place(point + normal * (1.5 / self.view.scale));
        let (width, height) = (self.shadow.width as f32 + SOFTNESS, self.shadow.height as f32 + SOFTNESS);
        if !((-SOFTNESS..width).contains(&place.x) && (-SOFTNESS..height).contains(&place.y)) {
            return 1.0;
        }
        let slope = if facing.z > 0.05 { -facing.truncate() / facing.z } else { Vec2::ZERO };
        let mut seen = 0;
        for tap in self.shadow_taps[turn] {
            let tap = tap * SOFTNESS;
            let to = place.truncate() + tap;
            let (x, y) = (to.x as usize, to.y as usize);
            let outside = !(to.x >= 0.0 && to.y >= 0.0) || x >= self.shadow.width || y >= self.shadow.height;
            let plane = place.z + slope.dot(tap).clamp(-3.0 * SOFTNESS, 3.0 * SOFTNESS) + 1.5;
            seen += u32::from(outside || self.shadow.depth[y * self.shadow.width + x] <= plane);
        }
        seen as f32 / SHADOW_TAPS as f32
    }
}

/// Places spread evenly over the unit disk (Vogel's spiral), turned in so many ways.
fn spirals<const TAPS: usize>() -> Vec<[Vec2; TAPS]> {
    let angle = |turn: usize, tap: usize| turn as f32 * (core::f32::consts::TAU / TURNS as f32) + tap as f32 * 2.399_963_2;
    let place = |turn: usize, tap: usize| Vec2::from_angle(angle(turn, tap)) * ((tap as f32 + 0.5) / TAPS as f32).sqrt();
    (0..TURNS).map(|turn| core::array::from_fn(|tap| place(turn, tap))).collect()
}

/// 0 to TURNS − 1, another one for every sample near by, the same in every picture (Jimenez' interleaved gradient noise).
fn turn(x: usize, y: usize) -> usize {
    let noise = (52.982_918 * (0.067_110_56 * x as f32 + 0.005_837_15 * y as f32).fract()).fract();
    (noise * TURNS as f32) as usize % TURNS
}

/// Columns and rows in which the body is, and `margin` samples around.
fn near_body(is_body: &[bool], width: usize, margin: f32) -> [std::ops::Range<usize>; 2] {
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    for (at, _) in is_body.iter().enumerate().filter(|(_, body)| **body) {
        for (k, x) in [at % width, at / width].into_iter().enumerate() {
            (low[k], high[k]) = (low[k].min(x), high[k].max(x));
        }
    }
    let margin = margin as usize + 1;
    core::array::from_fn(|k| low[k].saturating_sub(margin)..high[k] + margin + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::model::Ellipsoid;
    use glam::Quat;

    /// A ball of 1 m whose lowest point is `above` the floor, and the picture of it.
    fn ball(above: f32) -> (Camera, Vec<Vec3>) {
        let ball = Ellipsoid { centre: Vec3::ZERO, frame: Quat::IDENTITY, radii: Vec3::splat(0.5), colour: Vec3::X };
        let model = Model { ellipsoids: vec![ball], ..Model::default() };
        let camera =
            Camera::framing([Vec3::splat(-2.0), Vec3::splat(2.0)].into_iter(), Vec3::new(0.0, 0.5, 1.0), 120 * FINE, 120 * FINE, 0.0);
        let picture = Light::new(&model, &camera, -0.5 - above).shine(&model, None, 120, 120);
        (camera, picture)
    }

    #[test]
    fn a_ball_shades_the_floor_and_not_itself() {
        let (camera, picture) = ball(0.0);
        let at = |p: Vec3| {
            let place = camera.place(p) / FINE as f32;
            picture[place.y as usize * 120 + place.x as usize]
        };
        let to_lamp = Light::new(&Model::default(), &camera, 0.0).lamp;
        let behind = Vec3::new(-to_lamp.x, 0.0, -to_lamp.z) / to_lamp.y * 0.5;
        let (shade, open) = (at(behind - Vec3::Y * 0.5), at(-behind - Vec3::Y * 0.5 + behind * -1.5));
        assert!(shade.x < 0.75 * open.x, "{shade} in the shade, {open} in the open");
        // The lit side of a red ball is red, and much brighter than its other side.
        let across = (to_lamp - camera.eye * to_lamp.dot(camera.eye)).normalize() * 0.42;
        let (lit, dark) = (at(across), at(-across));
        assert!(lit.x > 0.6 && lit.x > 4.0 * lit.y && lit.x > 2.0 * dark.x, "{lit} {dark}");
        // High above the floor it shades what lies elsewhere.
        let (_, high) = ball(40.0);
        assert!(high.iter().zip(&picture).any(|(a, b)| a.x > 1.2 * b.x));
    }

    #[test]
    fn pictures_are_the_same_twice() {
        assert!(ball(0.1).1 == ball(0.1).1);
    }
}
