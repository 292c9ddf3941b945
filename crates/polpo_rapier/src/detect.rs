//! Finds, once a step, the planes that the particles of a body must stay above.

use bevy::math::Vec3A;
use polpo_solver::{Contact, Contacts, Ellipsoid, FreePositions, Particles};
use rapier3d::geometry::{ColliderSet, Group, InteractionGroups, InteractionTestMode};
use rapier3d::math::Vector;

use crate::ask::Ask;
use crate::candidates::{Candidate, When, reduce};
use crate::last_look::{LastLook, Seen};
use crate::obstacles::{Frame, Obstacles, slop};
use crate::probe::Probe;

/// A body as the detection sees it.
#[derive(Clone, Copy, Debug)]
pub struct DetectionInput<'a> {
    /// Its particles at the start of the step.
    pub particles: &'a Particles,
    /// Where the particles' origin is in the world \[m\].
    pub origin: Vector,
    /// What accelerates them besides constraints, gravity as a rule \[m/s²\].
    pub acceleration: Vector,
    /// Length of the step \[s\].
    pub dt: f32,
    /// Coulomb's coefficient of the body's skin, 0 … ∞; combined with the collider's by the collider's rule.
    pub friction: f32,
    /// The same by particle, where it is not the body's; a particle beyond the end has that.
    pub frictions: &'a [f32],
    /// The layers that the body is in, one bit each.
    pub memberships: u32,
    /// The layers whose colliders it meets.
    pub filter: u32,
}

/// The detection's scratch memory: reuse it, so that a warmed-up step allocates nothing.
///
/// For each particle and each convex part of a collider near it (a triangle, a box of a compound):
///
/// 1. the plane at the part's nearest point, if the gap to the ellipsoid is at most half its largest radius;
/// 2. for a particle that moves by more than a tenth of its smallest radius relative to the collider: the plane where it will touch the part in this step;
/// 3. the same for the way of the body's fastest particle, which may press this one along;
/// 4. the plane through which the centre came since it was last free.
///
/// Of all planes of a particle, from all colliders, those hidden behind more urgent ones are dropped, and at most four kept. All arithmetic is relative to the body's origin or in a collider's
/// own axes.
#[derive(Debug, Default)]
pub struct ContactDetector {
    near: Vec<Near>,
    /// How far each particle will go in the step if nothing holds it.
    ways: Vec<Vec3A>,
    /// How far the fastest particle will go in the step.
    rush: Vec3A,
    candidates: Vec<Candidate>,
    /// For each contact found last, the index of its obstacle.
    pub(crate) sources: Vec<u32>,
    /// For each particle, where it was looked for contacts.
    pub(crate) seen: Vec<Seen>,
    /// Whether anything that moves is near.
    pub(crate) astir: bool,
    /// Scratch of the last look: particles that strayed, and obstacles they may meet.
    pub(crate) strayed: Vec<u32>,
    pub(crate) met: Vec<u32>,
    /// Of the last looks since the detection.
    pub(crate) looked: LastLook,
}

/// An obstacle near the body: its index, and where it is now, at the end of the step and at the start of the last one.
#[derive(Clone, Copy, Debug)]
struct Near {
    index: u32,
    frames: [Frame; 3],
    /// The box within which it is in this step, relative to the body's origin.
    bounds: [Vec3A; 2],
}

/// Gaps up to this share of the largest radius count as near. Wider, and the plane at an edge becomes a ghost wall beside it; narrower, and neighbours push particles in before it is seen.
const SLACK: f32 = 0.5;
/// Motion of less than this share of the smallest radius in a step is not swept.
const STILL: f32 = 0.1;
/// What rises above a plane by less than this share of the smallest radius belongs to it.
const FLUSH: f32 = 0.02;

/// Room for a particle's planes from the start: more than it has among a few colliders. Among many parts of a mesh the list grows.
const ROOM: usize = 32;

impl ContactDetector {
    /// Fills `contacts` for the step, and brings `free` up to date.
    ///
    /// Non-finite particles and colliders of another generation than `obstacles` have no contacts.
    pub fn detect(
        &mut self,
        body: &DetectionInput,
        obstacles: &Obstacles,
        colliders: &ColliderSet,
        free: &mut FreePositions,
        contacts: &mut Contacts,
    ) {
        contacts.list.clear();
        self.sources.clear();
        self.candidates.clear();
        self.candidates.reserve(ROOM);
        self.seen.clear();
        self.seen.reserve_exact(body.particles.len());
        self.looked = LastLook::default();
        let p = body.particles;
        if free.position.len() != p.len() {
            free.position.clear();
            free.position.extend(p.position.iter().map(|x| Vector::from(*x)));
        }
        self.gather_near(body, obstacles, &free.position);
        self.astir = self.near.iter().any(|near| obstacles.list[near.index as usize].moves());
        if self.near.is_empty() {
            self.seen.extend((0..p.len()).map(|i| Seen::new(p, i, self.ways[i])));
            for (free, x) in free.position.iter_mut().zip(&p.position) {
                *free = (*x).into();
            }
            return;
        }
        for i in 0..p.len() {
            let ahead = self.find(body, i, obstacles, colliders, Some(free.position[i].into()));
            let mut seen = Seen::new(p, i, self.ways[i]);
            seen.share = ahead;
            for found in &self.candidates {
                match found.when {
                    // What it hides is at least as far away.
                    When::Now => seen.margin = seen.margin.min(found.distance),
                    When::Later(_) => {}
                    When::Crossed => seen.returning = Some(self.near[found.obstacle as usize].index),
                }
            }
            self.seen.push(seen);
            let now = p.position[i];
            free.position[i] = match self.candidates.first() {
                // Not where it came from but above where it is now: it may slide on under the surface, past other triangles.
                Some(plane) if plane.when == When::Crossed => now + plane.normal * (0.5 * p.radii[i].min_element() - plane.distance),
                _ => now,
            }
            .into();
            let friction = body.frictions.get(i).copied().unwrap_or(body.friction);
            for found in &self.candidates {
                let Near { index, frames: [frame, ..], .. } = self.near[found.obstacle as usize];
                let obstacle = &obstacles.list[index as usize];
                self.sources.push(index);
                contacts.list.push(Contact {
                    particle: i as u32,
                    friction: obstacle.friction_with(friction),
                    point: found.point,
                    normal: found.normal,
                    velocity: obstacle.plane_velocity(found.point, found.normal, &frame, body.dt),
                    angular_velocity: found.turn,
                    impulse: 0.0,
                });
            }
        }
    }

    /// The greatest overlap of any particle with anything \[m\], 0 if there is none.
    pub(crate) fn deepest(&mut self, body: &DetectionInput, obstacles: &Obstacles, colliders: &ColliderSet) -> f32 {
        self.gather_near(body, obstacles, &[]);
        let mut deepest = 0.0f32;
        if !self.near.is_empty() {
            for i in 0..body.particles.len() {
                // With the slack of the detection: a plane just out of reach hides others too.
                self.find(body, i, obstacles, colliders, None);
                let ellipsoid = body.particles.ellipsoid(i);
                for found in &self.candidates {
                    deepest = deepest.max(ellipsoid.support(found.normal).0 - found.distance);
                }
            }
        }
        deepest
    }

    /// The obstacles that the body's box meets, grown by its motion, into `self.near`.
    fn gather_near(&mut self, body: &DetectionInput, obstacles: &Obstacles, free: &[Vector]) {
        self.near.clear();
        self.rush = Vec3A::ZERO;
        let p = body.particles;
        self.ways.clear();
        self.ways.reserve_exact(p.len());
        let gain = Vec3A::from(body.acceleration) * body.dt;
        self.ways.extend(p.velocity.iter().map(|v| (*v + gain) * body.dt));
        for way in &self.ways {
            if way.length_squared() > self.rush.length_squared() {
                self.rush = *way;
            }
        }
        let (mut mins, mut maxs) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for i in 0..p.len() {
            let reach = (1.0 + SLACK) * p.radii[i].max_element();
            let now = p.position[i];
            let end = now + self.ways[i];
            let rush = now + self.rush;
            mins = mins.min(now.min(end).min(rush) - reach);
            maxs = maxs.max(now.max(end).max(rush) + reach);
        }
        for at in free {
            mins = mins.min((*at).into());
            maxs = maxs.max((*at).into());
        }
        // Also false for a body without particles.
        if !(mins.is_finite() && maxs.is_finite()) {
            return;
        }
        let layers = layers(body.memberships, body.filter);
        for (index, obstacle) in obstacles.list.iter().enumerate() {
            if obstacle.meets(mins.into(), maxs.into(), body.origin) && obstacle.lets_meet(layers) {
                let frames = obstacle.frames(body.origin, body.dt);
                let bounds = obstacle.bounds_from(body.origin);
                self.near.push(Near { index: index as u32, frames, bounds });
            }
        }
    }

    /// The planes of particle `i`, reduced, into `self.candidates`. Returns after which share of the step it meets the first that is ahead, kept or not; 1 if none is.
    fn find(&mut self, body: &DetectionInput, i: usize, obstacles: &Obstacles, colliders: &ColliderSet, free: Option<Vec3A>) -> f32 {
        self.candidates.clear();
        let p = body.particles;
        let (now, way) = (p.position[i], self.ways[i]);
        let end = now + way;
        if !end.is_finite() {
            return 1.0;
        }
        let (bound, least) = (p.radii[i].max_element(), p.radii[i].min_element());
        let slack = SLACK * bound;
        let reach = Vec3A::splat(bound + slack);
        // Not where it goes by itself, but where those that still fly will press it when their body comes down.
        let rush = Some(now + self.rush).filter(|at| at.distance(end) > slack);
        let (mut mins, mut maxs) = (now.min(end) - reach, now.max(end) + reach);
        if let Some(at) = rush {
            mins = mins.min(at - reach);
            maxs = maxs.max(at + reach);
        }
        if let Some(at) = free {
            mins = mins.min(at);
            maxs = maxs.max(at);
        }
        let slop = slop(body.origin);
        let (mins, maxs) = (mins - slop, maxs + slop);
        let meets = |near: &Near| near.bounds[0].cmple(maxs).all() && near.bounds[1].cmpge(mins).all();
        // Most particles are not near anything.
        let Some(first) = self.near.iter().position(meets) else { return 1.0 };
        let ellipsoid = p.ellipsoid(i);
        if !ellipsoid.orientation.is_finite() {
            return 1.0;
        }
        for (near, it) in self.near.iter().enumerate().skip(first).filter(|(_, near)| meets(near)) {
            let [frame, frame_at_end, frame_before] = &it.frames;
            let obstacle = &obstacles.list[it.index as usize];
            let Some(collider) = colliders.get(obstacle.handle) else { continue };
            let local_now = frame.inside(now);
            let moves = |at: &Vec3A| at.distance(local_now) > STILL * least && body.dt > 0.0;
            let probe = Probe {
                now: local_now,
                ends: [Some(frame_at_end.inside(end)).filter(moves), rush.map(|at| frame_at_end.inside(at)).filter(moves)],
                free: free.map(|at| frame_before.inside(at)).filter(|at| at.distance(local_now) > 1e-3 * least),
                ellipsoid: Ellipsoid { orientation: frame.rotation.inverse() * ellipsoid.orientation, ..ellipsoid },
                round: bound == least,
                bound,
                least,
                slack,
                inside: false,
            };
            let ask = Ask { near: near as u32, obstacle, shape: collider.shape(), frame: *frame, dt: body.dt, now, way };
            ask.collect(probe, &mut self.candidates);
        }
        let ahead = self.candidates.iter().filter_map(|c| if let When::Later(share) = c.when { Some(share) } else { None });
        let ahead = ahead.fold(1.0, f32::min);
        reduce(&mut self.candidates, FLUSH * least);
        ahead
    }
}

/// The layers of a body as Rapier has them.
pub(crate) fn layers(memberships: u32, filter: u32) -> InteractionGroups {
    let groups = |bits| Group::from_bits_truncate(bits);
    InteractionGroups::new(groups(memberships), groups(filter), InteractionTestMode::And)
}

/// The box within which a body at rest sees colliders, relative to its origin. `None` if it has no particles or is not finite.
pub(crate) fn bounds_of(position: &[Vec3A], radii: &[Vec3A]) -> Option<(Vector, Vector)> {
    let (mut mins, mut maxs) = (Vector::INFINITY, Vector::NEG_INFINITY);
    for (x, radii) in position.iter().zip(radii) {
        let (x, reach) = (Vector::from(*x), (1.0 + SLACK) * radii.max_element());
        mins = mins.min(x - reach);
        maxs = maxs.max(x + reach);
    }
    (mins.is_finite() && maxs.is_finite()).then_some((mins, maxs))
}
