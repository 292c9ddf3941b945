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

use bevy::ecs::batching::BatchingStrategy;
use bevy::math::Vec3A;
use bevy::prelude::*;
use polpo::{Awake, Collision, ExplicitState, SubstepTime};
use polpo_solver::{Particles, land_explicit_groups};
use rapier3d::dynamics::RigidBodyHandle;
use rapier3d::geometry::{BoundingVolume, ColliderSet, InteractionGroups};
use rapier3d::math::Vector;
use rapier3d::parry::bounding_volume::Aabb;

use crate::cast::cast;
use crate::detect::layers;
use crate::nearest::nearest;
use crate::obstacles::Obstacles;
use crate::parts::{is_one_sided, visit_parts};
use crate::plugin::{Detector, Surroundings};
use crate::probe::into_part;
use crate::push::Pushing;
use crate::{ContactDetector, PushRigidBodies, RapierWorld};

/// What the last looks of the running step have done so far, for all bodies.
///
/// The contacts of a step are those that a particle may meet on its straight way. So at the end of every substep, the centre of a particle that left its way is looked after: if it has gone into a collider, it is put back to the
/// surface and loses the velocity into it. That should be rare: it acts without friction and gives dynamic bodies no impulse. If it is not, take more substeps.
///
/// Held by it are the centres of all particles that are not pinned, by all colliders except those inside which they began the substep, those they are on their way back through, and those that the
/// body pushes ([`PushRigidBodies`]).
#[derive(Resource, Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LastLook {
    /// How often a way was cast against a part of a collider: what it costs.
    pub casts: u32,
    /// How many particles were put back, counted in every substep.
    pub put_back: u32,
}

/// In every substep, after all that moves particles.
///
/// What a member of a rigid group was put back by acts on the whole group; that may bring another member into something, which is put back in its turn.
pub(crate) fn last_look(
    (time, step): (Res<SubstepTime>, Res<Time>),
    world: Res<RapierWorld>,
    surroundings: Res<Surroundings>,
    pushing: Res<Pushing>,
    mut total: ResMut<LastLook>,
    mut bodies: Query<
        (&mut polpo::Particles, &Transform, &Collision, &mut Detector, Option<&mut ExplicitState>, Has<PushRigidBodies>),
        Awake,
    >,
) {
    /// What it takes to see that a particle is on its way, and what a parallel query must save before it gains anything \[ns\].
    const PARTICLE: usize = 5;
    const WORTHWHILE: usize = 200_000;
    /// After the last, members of a group may be put back one by one.
    const ROUNDS: usize = 6;
    *total = LastLook::default();
    let (obstacles, colliders) = (&surroundings.0, &world.colliders);
    if obstacles.is_empty() {
        return;
    }
    let look_at = |(mut particles, transform, collision, mut detector, mut groups, pushes): (
        Mut<polpo::Particles>,
        &Transform,
        &Collision,
        Mut<Detector>,
        Option<Mut<ExplicitState>>,
        bool,
    )| {
        let look = Look {
            origin: transform.translation,
            begin: time.index as f32 * time.delta,
            dt: time.delta,
            step: step.delta_secs(),
            layers: layers(collision.memberships, collision.filter),
            spared: if pushes { pushing.handles() } else { &[] },
        };
        for round in 1..=ROUNDS {
            let any = detector.0.put_back(&mut particles, &look, obstacles, colliders);
            match &mut groups {
                Some(groups) if any && round < ROUNDS => land_explicit_groups(groups, &mut particles, time.delta),
                _ => break,
            }
        }
    };
    // Bodies do not see each other here, so the result does not depend on the number of threads.
    let cost: usize = bodies.iter().map(|(particles, ..)| particles.len() * PARTICLE).sum();
    if cost > WORTHWHILE {
        bodies.par_iter_mut().batching_strategy(BatchingStrategy::new().max_batch_size(1)).for_each(look_at);
    } else {
        bodies.iter_mut().for_each(look_at);
    }
    for (.., detector, _, _) in &bodies {
        total.casts += detector.0.looked.casts;
        total.put_back += detector.0.looked.put_back;
    }
}

/// What the detection foresaw of a particle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    from: Vec3A,
    way: Vec3A,
    /// 1/|way|² \[1/m²\]; 0 for one that goes nowhere.
    per_square: f32,
    /// The share of the way up to the first plane on it: what comes behind may not have been seen.
    pub(crate) share: f32,
    /// Of the particle's smallest radius: nothing is so near to the way without being seen \[m\].
    pub(crate) margin: f32,
    /// The index of the obstacle through which it is on its way back.
    pub(crate) returning: Option<u32>,
}

impl Seen {
    /// Particle `i` is about to go `way`.
    pub(crate) fn new(p: &Particles, i: usize, way: Vec3A) -> Self {
        let square = way.length_squared();
        let per_square = if square.is_normal() { 1.0 / square } else { 0.0 };
        Self { from: p.position[i], way, per_square, share: 1.0, margin: p.radii[i].min_element(), returning: None }
    }

    /// Whether `at` is so near to the way that nothing unseen can be there. While nothing moves it may be there at any time, else only at `time`, as a share of the step.
    fn covers(&self, at: Vec3A, time: Option<f32>) -> bool {
        let ahead = at - self.from;
        let along = time.unwrap_or(ahead.dot(self.way) * self.per_square);
        let off = ahead.distance_squared(self.way * along.clamp(0.0, self.share));
        // A centre under a plane has a margin below zero.
        self.margin >= 0.0 && off <= self.margin * self.margin
    }
}

/// A substep to look back on.
#[derive(Clone, Copy, Debug)]
struct Look<'a> {
    /// Where the particles' origin is in the world \[m\].
    origin: Vector,
    /// When it began, and how long it is and the whole step \[s\].
    begin: f32,
    dt: f32,
    step: f32,
    layers: InteractionGroups,
    /// Rigid bodies that do not count: where they are in the substep is not known here.
    spared: &'a [RigidBodyHandle],
}

/// A straight way between two moments, in seconds from the step's start.
#[derive(Clone, Copy, Debug)]
struct Way {
    places: [Vec3A; 2],
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
    place: Vec3A,
    normal: Vec3A,
    obstacle: u32,
}

/// A centre that is put back stays this share of its smallest radius off the surface.
const OFF: f32 = 0.1;
/// So many surfaces in one substep hold a particle fast: three make a corner.
const SURFACES: usize = 4;

impl ContactDetector {
    /// Puts the particles back that went into something. Whether there were any.
    fn put_back(&mut self, p: &mut Particles, look: &Look, obstacles: &Obstacles, colliders: &ColliderSet) -> bool {
        if self.seen.len() != p.len() || obstacles.is_empty() {
            return false;
        }
        let end = look.begin + look.dt;
        let time = self.astir.then_some(end / look.step);
        let (mut mins, mut maxs) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let mut longest = 0.0f32;
        self.strayed.clear();
        for (i, seen) in self.seen.iter().enumerate() {
            let [from, to] = [p.previous_position[i], p.position[i]];
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
            (counts && obstacle.meets(mins.into(), maxs.into(), look.origin)).then_some(index)
        }));
        if self.met.is_empty() {
            return false;
        }
        let mut any = false;
        for k in 0..self.strayed.len() {
            let i = self.strayed[k] as usize;
            let mut way = Way {
                places: [p.previous_position[i], p.position[i]],
                times: [look.begin, end],
                least: p.radii[i].min_element(),
                returning: self.seen[i].returning,
            };
            let mut velocity = p.velocity[i];
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
                p.position[i] = way.places[1];
                p.velocity[i] = velocity;
                self.looked.put_back += 1;
                any = true;
            }
        }
        any
    }

    /// The first thing that a centre goes into on its way.
    fn first_entry(&mut self, way: &Way, look: &Look, obstacles: &Obstacles, colliders: &ColliderSet) -> Option<Entry> {
        let mut first: Option<Entry> = None;
        for &index in &self.met {
            let obstacle = &obstacles.list[index as usize];
            let Some(collider) = colliders.get(obstacle.handle).filter(|_| way.returning != Some(index)) else { continue };
            let shape = collider.shape();
            let [from, to] = [0, 1].map(|k| obstacle.frame_at(look.origin, way.times[k]).inside(way.places[k]));
            // Also what floats resolve so far from the shape's origin.
            let off = (OFF * way.least).max(4e-7 * from.abs().max(to.abs()).max_element());
            let bounds = Aabb::new((from.min(to) - off).into(), (from.max(to) + off).into());
            if !obstacle.local_bounds.intersects(&bounds) {
                continue;
            }
            let one_sided = is_one_sided(shape);
            let casts = &mut self.looked.casts;
            visit_parts(shape, &bounds, &mut |_, pose, part| {
                let [begin, end] = [from, to].map(|at| pose.map_or(at, |pose| into_part(pose, at)));
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
                let from_behind = one_sided && part.as_triangle().is_some_and(|t| Vec3A::from(t.scaled_normal()).dot(hit.normal) < 0.0);
                if !leaves && !from_behind && first.is_none_or(|first| share < first.share) {
                    let normal = pose.map_or(hit.normal, |pose| pose.rotation * hit.normal);
                    first = Some(Entry { share, place: from + (to - from) * share, normal, obstacle: index });
                }
            });
        }
        first
    }
}
