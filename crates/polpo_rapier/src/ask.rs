//! One particle against one obstacle.

use bevy::math::Vec3A;
use rapier3d::geometry::{Shape, TypedShape};
use rapier3d::math::Pose;
use rapier3d::parry::bounding_volume::Aabb;

use crate::candidates::{Candidate, When};
use crate::convex::Convex;
use crate::nearest::Nearest;
use crate::obstacles::{Frame, Obstacle};
use crate::parts::{is_one_sided, visit_parts, way_out};
use crate::probe::{Finding, Probe, into_part};

/// A centre deeper under a height field than this many largest radii is taken to be meant to be there.
const GROUND: f32 = 4.0;

/// One obstacle, asked for the planes of one particle.
pub(crate) struct Ask<'a> {
    /// Which of the obstacles near the body it is.
    pub(crate) near: u32,
    pub(crate) obstacle: &'a Obstacle,
    pub(crate) shape: &'a dyn Shape,
    /// Where it is now, relative to the body's origin.
    pub(crate) frame: Frame,
    /// Length of the step \[s\].
    pub(crate) dt: f32,
    /// The particle's centre, and how far it will go in the step if nothing holds it, in the body's axes.
    pub(crate) now: Vec3A,
    pub(crate) way: Vec3A,
}

impl Ask<'_> {
    /// Adds the planes that the particle, `probe` in the obstacle's axes, may meet in this step.
    pub(crate) fn collect(&self, mut probe: Probe, out: &mut Vec<Candidate>) {
        let (mut mins, mut maxs) = (probe.now, probe.now);
        for at in [&probe.ends[0], &probe.ends[1], &probe.free].into_iter().flatten() {
            mins = mins.min(*at);
            maxs = maxs.max(*at);
        }
        let reach = Vec3A::splat(probe.bound + probe.slack);
        let (mins, maxs, local) = (mins - reach, maxs + reach, &self.obstacle.local_bounds);
        if !(Vec3A::from(local.mins).cmple(maxs).all() && mins.cmple(local.maxs.into()).all()) {
            return;
        }
        match self.shape.as_typed_shape() {
            TypedShape::Cuboid(shape) => self.ask(&probe, 0, None, shape, false, out),
            TypedShape::HalfSpace(shape) => self.ask(&probe, 0, None, shape, false, out),
            TypedShape::Ball(shape) => self.ask(&probe, 0, None, shape, false, out),
            TypedShape::Capsule(shape) => self.ask(&probe, 0, None, shape, false, out),
            _ => {
                let one_sided = is_one_sided(self.shape);
                if one_sided {
                    let travelled = probe.free.map_or(0.0, |at| at.distance(probe.now));
                    if let Some(plane) = way_out(self.shape, probe.now, GROUND * probe.bound + travelled) {
                        probe.inside = true;
                        self.keep(&probe, When::Now, u32::MAX, plane, self.obstacle.angular_velocity.into(), out);
                    }
                }
                visit_parts(self.shape, &Aabb::new(mins.into(), maxs.into()), &mut |part, pose, shape| match shape.as_typed_shape() {
                    TypedShape::Triangle(shape) => self.ask(&probe, part, pose, shape, one_sided, out),
                    TypedShape::Cuboid(shape) => self.ask(&probe, part, pose, shape, false, out),
                    _ => self.ask(&probe, part, pose, shape, one_sided, out),
                });
            }
        }
    }

    /// The same of one part.
    #[inline]
    fn ask<S: Convex + ?Sized>(&self, probe: &Probe, part: u32, pose: Option<&Pose>, shape: &S, one_sided: bool, out: &mut Vec<Candidate>) {
        let rigid = Vec3A::from(self.obstacle.angular_velocity);
        probe.ask(shape, pose, |found| match found {
            Finding::Near(plane) => {
                let still = rigid == Vec3A::ZERO;
                let turn = if still { rigid } else { self.turn(probe, plane.normal, shape, pose) };
                self.keep(probe, When::Now, part, plane, turn, out);
            }
            Finding::Ahead(time, plane) => self.keep(probe, When::Later(time), part, plane, rigid, out),
            // Through the ground from below is a way out, not in.
            Finding::Crossed(plane) if one_sided && shape.front().is_some_and(|front| front.dot(plane.normal) < 0.0) => {}
            Finding::Crossed(plane) => self.keep(probe, When::Crossed, part, plane, rigid, out),
        });
    }

    fn keep(&self, probe: &Probe, when: When, part: u32, plane: Nearest, turn: Vec3A, out: &mut Vec<Candidate>) {
        let distance = plane.normal.dot(probe.now - plane.point);
        out.push(Candidate {
            when,
            distance,
            nearness: distance / probe.support(plane.normal),
            point: self.frame.outside(plane.point),
            normal: self.frame.rotation * plane.normal,
            turn,
            obstacle: self.near,
            part,
        });
    }

    /// How fast the plane with `normal` (in the obstacle's axes) turns for this particle [rad/s].
    ///
    /// A flat face turns as the obstacle does. A rolling wheel's tangent plane does not: its material goes round, its shape stays. With δ the particle's motion relative to the obstacle, the normal
    /// that the particle sees changes by n(x + δ) − n(x) in the obstacle's axes, on top of ω × n; the change is taken over a part of δ so short that it stays on the same face. The spin about the
    /// normal, ω·n, is the obstacle's own.
    fn turn<S: Convex + ?Sized>(&self, probe: &Probe, normal: Vec3A, shape: &S, pose: Option<&Pose>) -> Vec3A {
        let rigid = Vec3A::from(self.obstacle.angular_velocity);
        // Relative to the material, by their velocities now. (The way between the end points of a turn is shorter and points inwards, which would tilt the planes of fast wheels.)
        let step = self.frame.rotation.inverse() * (self.way - self.obstacle.velocity_now_at(self.now, &self.frame) * self.dt);
        let length = step.length();
        if length <= 0.0 || self.dt <= 0.0 {
            return rigid;
        }
        let share = (0.1 * probe.least / length).min(1.0);
        let seen_from = |at: Vec3A| match pose {
            Some(pose) => pose.rotation * shape.nearest(into_part(pose, at)).normal,
            None => shape.nearest(at).normal,
        };
        let change = (seen_from(probe.now + step * share) - seen_from(probe.now)) / (share * self.dt);
        let n = self.frame.rotation * normal;
        let turn = n.cross(rigid.cross(n) + self.frame.rotation * change) + n * rigid.dot(n);
        // A jump to another face is not a turn.
        if turn.length_squared() <= 4.0 * rigid.length_squared() { turn } else { rigid }
    }
}
