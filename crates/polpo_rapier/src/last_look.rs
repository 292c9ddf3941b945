//! In every substep, after all that moves a particle: has its centre gone into something that the detection did not see?
//!
//! The detection looks along the straight way that a particle is about to go. One that bounces off a wall, or is swung round by its neighbours, goes elsewhere, perhaps through walls that it has no plane of. So whoever is
//! farther from that way than its smallest radius has *strayed*: the way of its centre in this substep is cast against the colliders, in their own axes, which move. In free flight and in ordinary contact nobody strays, and all
//! that this costs is a distance from a line a particle.
//!
//! A centre that has gone into a part is put back to where it went in, and goes the rest of its way along the surface, to what it meets next; its velocity loses what points into the surface. No friction, no
//! turning, and no impulse to what was hit: the contacts of the next step see to those. A way only becomes shorter by that and a velocity smaller, so no energy is made.
//!
//! What begins inside a part is not held by that part, but by all others. A surface with one good side holds only what comes from there.

use polpo_solver::Particles;
use rapier3d::dynamics::RigidBodyHandle;
use rapier3d::geometry::{BoundingVolume, ColliderSet, InteractionGroups};
use rapier3d::math::Vector;
use rapier3d::parry::bounding_volume::Aabb;

use crate::ContactDetector;
use crate::cast::cast;
use crate::nearest::nearest;
use crate::obstacles::Obstacles;
use crate::parts::{is_one_sided, visit_parts};

/// What the detection foresaw of a particle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    from: Vector,
    way: Vector,
    /// The share of the way up to the first plane on it: what comes behind may not have been seen.
    pub(crate) share: f32,
    /// Of the particle's smallest radius: nothing is so near to the way without being seen \[m\].
    pub(crate) margin: f32,
    /// The index of the obstacle through which it is on its way back.
    pub(crate) returning: Option<u32>,
}

impl Seen {
    /// Particle `i` is about to go `way`.
    pub(crate) fn new(p: &Particles, i: usize, way: Vector) -> Self {
        Self { from: p.position[i].into(), way, share: 1.0, margin: p.radii[i].min_element(), returning: None }
    }

    /// Whether `at` is so near to the way that nothing unseen can be there. While nothing moves it may be there at any time, else only at `time`, as a share of the step.
    fn covers(&self, at: Vector, time: Option<f32>) -> bool {
        let ahead = at - self.from;
        let square = self.way.length_squared();
        let along = time.unwrap_or(if square > 0.0 { ahead.dot(self.way) / square } else { 0.0 });
        ahead.distance(self.way * along.clamp(0.0, self.share)) <= self.margin
    }
}

/// A substep to look back on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look<'a> {
    /// Where the particles' origin is in the world \[m\].
    pub(crate) origin: Vector,
    /// When it began, and how long it is and the whole step \[s\].
    pub(crate) begin: f32,
    pub(crate) dt: f32,
    pub(crate) step: f32,
    pub(crate) layers: InteractionGroups,
    /// Rigid bodies that do not count: where they are in the substep is not known here.
    pub(crate) spared: &'a [RigidBodyHandle],
}

/// A straight way between two moments, in seconds from the step's start.
#[derive(Clone, Copy, Debug)]
struct Way {
    places: [Vector; 2],
    times: [f32; 2],
    /// The particle's smallest radius \[m\], and what it is on its way back through.
    least: f32,
    returning: Option<u32>,
}

/// A centre goes into an obstacle.
#[derive(Clone, Copy, Debug)]
struct Entry {
    /// After this share of the way.
    share: f32,
    /// There, in the obstacle's axes: the centre, just outside, and the surface's normal.
    place: Vector,
    normal: Vector,
    obstacle: u32,
}

/// A centre that is put back stays this share of its smallest radius off the surface.
const OFF: f32 = 0.1;
/// So many surfaces in one substep hold a particle fast: three make a corner.
const SURFACES: usize = 4;

impl ContactDetector {
    /// Puts the particles back that went into something. Whether there were any.
    pub(crate) fn last_look(&mut self, p: &mut Particles, look: &Look, obstacles: &Obstacles, colliders: &ColliderSet) -> bool {
        if self.seen.len() != p.len() || obstacles.is_empty() {
            return false;
        }
        let end = look.begin + look.dt;
        let time = self.astir.then_some(end / look.step);
        let (mut mins, mut maxs) = (Vector::INFINITY, Vector::NEG_INFINITY);
        let mut longest = 0.0f32;
        self.strayed.clear();
        for (i, seen) in self.seen.iter().enumerate() {
            let [from, to] = [p.previous_position[i], p.position[i]].map(Vector::from);
            if !seen.covers(to, time) && p.inverse_mass[i] > 0.0 && from.is_finite() && to.is_finite() {
                self.strayed.push(i as u32);
                mins = mins.min(from).min(to);
                maxs = maxs.max(from).max(to);
                longest = longest.max(from.distance(to));
            }
        }
        if self.strayed.is_empty() {
            return false;
        }
        // Along a surface it may get out of the box of the ways.
        let (mins, maxs) = (mins - longest, maxs + longest);
        self.met.clear();
        self.met.extend((0u32..).zip(&obstacles.list).filter_map(|(index, obstacle)| {
            let counts = obstacle.lets_meet(look.layers) && obstacle.body.is_none_or(|body| !look.spared.contains(&body));
            (counts && obstacle.meets(mins, maxs, look.origin)).then_some(index)
        }));
        if self.met.is_empty() {
            return false;
        }
        let mut any = false;
        for k in 0..self.strayed.len() {
            let i = self.strayed[k] as usize;
            let mut way = Way {
                places: [p.previous_position[i], p.position[i]].map(Vector::from),
                times: [look.begin, end],
                least: p.radii[i].min_element(),
                returning: self.seen[i].returning,
            };
            let mut velocity = Vector::from(p.velocity[i]);
            let mut caught = false;
            for surface in 1..=SURFACES {
                let Some(entry) = self.first_entry(&way, look, obstacles, colliders) else { break };
                let obstacle = &obstacles.list[entry.obstacle as usize];
                let when = way.times[0] + (way.times[1] - way.times[0]) * entry.share;
                let [there, last] = [when, end].map(|time| obstacle.frame_at(look.origin, time));
                let place = there.outside(entry.place);
                let normal = there.rotation * entry.normal;
                let material = obstacle.velocity_now_at(place, &there);
                let rest = last.inside(way.places[1]) - entry.place;
                let on = last.outside(entry.place + rest - entry.normal * entry.normal.dot(rest));
                let inside = mins.cmple(on).all() && on.cmple(maxs).all();
                if surface < SURFACES && inside {
                    velocity += normal * normal.dot(material - velocity).max(0.0);
                    way = Way { places: [place, on], times: [when, end], ..way };
                } else {
                    velocity = material;
                    way.places[1] = last.outside(entry.place);
                }
                caught = true;
                if !inside {
                    break;
                }
            }
            if caught && way.places[1].is_finite() && velocity.is_finite() {
                p.position[i] = way.places[1].into();
                p.velocity[i] = velocity.into();
                self.hits += 1;
                any = true;
            }
        }
        any
    }

    /// The first thing that the centre of particle `i` goes into on its way.
    fn first_entry(&mut self, way: &Way, look: &Look, obstacles: &Obstacles, colliders: &ColliderSet) -> Option<Entry> {
        let mut first: Option<Entry> = None;
        for &index in &self.met {
            let obstacle = &obstacles.list[index as usize];
            let Some(collider) = colliders.get(obstacle.handle).filter(|_| way.returning != Some(index)) else { continue };
            let shape = collider.shape();
            let [from, to] = [0, 1].map(|k| obstacle.frame_at(look.origin, way.times[k]).inside(way.places[k]));
            // Also what floats resolve so far from the shape's origin.
            let off = (OFF * way.least).max(4e-7 * from.abs().max(to.abs()).max_element());
            let bounds = Aabb::new(from.min(to) - off, from.max(to) + off);
            if !obstacle.local_bounds.intersects(&bounds) {
                continue;
            }
            let one_sided = is_one_sided(shape);
            let casts = &mut self.casts;
            visit_parts(shape, &bounds, &mut |_, pose, part| {
                let [begin, end] = [from, to].map(|at| pose.map_or(at, |pose| pose.inverse_transform_point(at)));
                let here = nearest(part, begin);
                // What begins inside does not go in.
                if !here.is_finite() || here.distance < 0.0 || here.distance > off + begin.distance(end) {
                    return;
                }
                *casts += 1;
                let point = |at| {
                    let there = nearest(part, at);
                    (there.distance, there)
                };
                let Some((share, hit)) = cast(begin, end, off, (here.distance, here), point) else { return };
                let leaves = hit.normal.dot(end - hit.point) >= 0.5 * off || hit.normal.dot(end - begin) >= 0.0;
                let from_behind = one_sided && part.as_triangle().is_some_and(|t| t.scaled_normal().dot(hit.normal) < 0.0);
                if !leaves && !from_behind && first.is_none_or(|first| share < first.share) {
                    let normal = pose.map_or(hit.normal, |pose| pose.rotation * hit.normal);
                    first = Some(Entry { share, place: from + (to - from) * share, normal, obstacle: index });
                }
            });
        }
        first
    }
}
