//! A snapshot of Rapier's colliders at the start of a step: where each is, how it moves, how it rubs.

use bevy::math::Vec3A;
use polpo_solver::{quat_exp, quat_log};
use rapier3d::dynamics::{CoefficientCombineRule, RigidBody, RigidBodyHandle, RigidBodySet, RigidBodyType};
use rapier3d::geometry::{Collider, ColliderHandle, ColliderSet, InteractionGroups, SharedShape, TypedShape};
use rapier3d::math::{Rotation, Vector};
use rapier3d::parry::bounding_volume::Aabb;

/// All colliders that soft bodies can meet, as of the start of a step. Gather once a step, use for every body.
///
/// Sensors and disabled colliders are not among them. The order is that of the [`ColliderSet`].
#[derive(Debug, Default)]
pub struct Obstacles {
    pub(crate) list: Vec<Obstacle>,
    /// What they were in the step before, in the set's order.
    pub(crate) before: Vec<Obstacle>,
    /// Where something moves, has come, gone or changed since the step before.
    pub(crate) stirred: Vec<Stirred>,
    /// Whether there was a step before.
    begun: bool,
    /// Colliders that were left out as unusable, so that each is reported once.
    reported: Vec<ColliderHandle>,
}

/// A place where a collider is not as it was.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stirred {
    bounds: Aabb,
    layers: [InteractionGroups; 2],
    /// The rigid body that it belongs to.
    pub(crate) body: Option<RigidBodyHandle>,
    /// How fast its points move, or have come since the step before, in the root mean square over its box, as for soft bodies \[m/s\]; infinite if it has come, gone or is made otherwise.
    pub(crate) speed: f32,
}

#[derive(Clone, Debug)]
#[cfg_attr(feature = "serialize", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Obstacle {
    pub(crate) handle: ColliderHandle,
    /// The rigid body that it belongs to.
    pub(crate) body: Option<RigidBodyHandle>,
    /// Of the rigid body, or of the collider if it has none: a place in the world whose floats are coarse far from the origin.
    anchor: Vector,
    /// From there to the collider's origin, which is fine everywhere.
    offset: Vector,
    rotation: Rotation,
    /// Of the shape in its own axes.
    pub(crate) local_bounds: Aabb,
    /// In the world, over the whole step.
    bounds: Aabb,
    /// Of the collider's origin over this step, as its way divided by the time; and at this moment, which is not the same for one that goes in circles \[m/s\].
    velocity: Vector,
    velocity_now: Vector,
    /// \[rad/s\]
    pub(crate) angular_velocity: Vector,
    /// Length of this step \[s\].
    dt: f32,
    /// How far it went in the last step \[m\], and turned \[rad\]; that step may have been of another length.
    last_way: Vector,
    last_turn: Vector,
    friction: f32,
    rule: CoefficientCombineRule,
    layers: [InteractionGroups; 2],
    /// Kept so that another shape is told from this one by its place in memory, which nobody else can have meanwhile.
    #[cfg_attr(feature = "serialize", serde(skip, default = "no_shape"))]
    shape: SharedShape,
}

/// Until [`Obstacles::restore`] finds the right one.
#[cfg(feature = "serialize")]
fn no_shape() -> SharedShape {
    SharedShape::ball(0.0)
}

/// An obstacle's axes at one moment, relative to a body's origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) translation: Vec3A,
    pub(crate) rotation: Rotation,
}

impl Frame {
    pub(crate) fn inside(&self, at: Vec3A) -> Vec3A {
        self.rotation.inverse() * (at - self.translation)
    }

    pub(crate) fn outside(&self, at: Vec3A) -> Vec3A {
        self.rotation * at + self.translation
    }
}

impl Obstacles {
    /// Takes the snapshot for a step of `dt` \[s\], and compares it with the last one.
    ///
    /// Poses are those of the rigid bodies now, so whatever was inserted, moved or removed through Rapier's API since its last step counts at once. A body driven by
    /// `set_next_kinematic_position` moves at (next position − position)/dt, one driven by velocity and a dynamic one at its velocity; a fixed one that is teleported has no velocity.
    ///
    /// A collider whose pose or extent is not finite is left out, with one warning in the log. `dt` = 0 takes everything to be at rest.
    pub fn gather(&mut self, bodies: &RigidBodySet, colliders: &ColliderSet, dt: f32) {
        core::mem::swap(&mut self.list, &mut self.before);
        self.list.clear();
        self.stirred.clear();
        self.reported.retain(|&handle| colliders.contains(handle));
        let mut before = 0;
        for (handle, collider) in colliders.iter() {
            let parent = collider.parent().and_then(|body| bodies.get(body));
            if collider.is_sensor() || !collider.is_enabled() || parent.is_some_and(|body| !body.is_enabled()) {
                continue;
            }
            let Some(mut obstacle) = Obstacle::new(handle, collider, parent, dt) else {
                if !self.reported.contains(&handle) {
                    self.reported.push(handle);
                    tracing::warn!("collider {handle:?} has a pose or an extent that is not finite: soft bodies do not see it");
                }
                continue;
            };
            // Both lists are in the order of the set's slots. What is passed over is gone.
            while let Some(old) = self.before.get(before).filter(|old| old.slot() < obstacle.slot()) {
                self.stirred.push(old.stirred(f32::INFINITY));
                before += 1;
            }
            match self.before.get(before).filter(|old| old.slot() == obstacle.slot()) {
                Some(old) if old.handle == handle => {
                    obstacle.last_way = old.velocity * old.dt;
                    obstacle.last_turn = old.angular_velocity * old.dt;
                    if obstacle.moves() || !obstacle.is_like(old) {
                        let speed = obstacle.speed_since(old, dt);
                        self.stirred.extend([old.stirred(speed), obstacle.stirred(speed)]);
                    }
                    before += 1;
                }
                Some(old) => {
                    self.stirred.extend([old.stirred(f32::INFINITY), obstacle.stirred(f32::INFINITY)]);
                    before += 1;
                }
                None => self.stirred.push(obstacle.stirred(f32::INFINITY)),
            }
            self.list.push(obstacle);
        }
        self.stirred.extend(self.before[before..].iter().map(|old| old.stirred(f32::INFINITY)));
        // In the first step nothing is new, because nothing was known.
        if !self.begun {
            self.stirred.clear();
        }
        self.begun = true;
    }

    /// Sets what the next [`gather`](Self::gather) compares with: obstacles that were kept with these `colliders`.
    pub(crate) fn restore(&mut self, list: &[Obstacle], colliders: &ColliderSet) {
        self.list.clear();
        self.list.extend_from_slice(list);
        for obstacle in &mut self.list {
            if let Some(collider) = colliders.get(obstacle.handle) {
                obstacle.shape = collider.shared_shape().clone();
            }
        }
        self.begun = true;
    }

    /// The colliders near the box `mins` … `maxs`, relative to `origin`, that a body with these `layers` can meet, and that move, have come, gone or changed.
    pub(crate) fn stirred_near(
        &self,
        mins: Vector,
        maxs: Vector,
        origin: Vector,
        layers: InteractionGroups,
    ) -> impl Iterator<Item = &Stirred> {
        self.stirred.iter().filter(move |s| near(&s.bounds, mins, maxs, origin) && let_meet(&s.layers, layers))
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}

impl Obstacle {
    fn new(handle: ColliderHandle, collider: &Collider, parent: Option<&RigidBody>, dt: f32) -> Option<Self> {
        let (anchor, offset, rotation) = match parent {
            Some(body) => {
                let here = body.position();
                // Composed by hand: the collider's own world pose is stale until Rapier's next step.
                let local = collider.position_wrt_parent().copied().unwrap_or_default();
                (here.translation, here.rotation * local.translation, here.rotation * local.rotation)
            }
            None => (collider.position().translation, Vector::ZERO, collider.position().rotation),
        };
        let length = rotation.length();
        let mut local_bounds = collider.shape().compute_local_aabb();
        let sound = anchor.is_finite()
            && offset.is_finite()
            && (length - 1.0).abs() < 1e-2
            && local_bounds.mins.is_finite()
            && local_bounds.maxs.is_finite()
            && local_bounds.mins.cmple(local_bounds.maxs).all();
        if !sound {
            return None;
        }
        let rotation = rotation.normalize();
        // What is just under a height field is its business too, see `way_out`; how far is said there.
        if let TypedShape::HeightField(_) = collider.shape().as_typed_shape() {
            local_bounds.mins.y -= 1000.0;
        }
        let (velocity_now, angular_velocity, velocity) =
            parent.map_or((Vector::ZERO, Vector::ZERO, Vector::ZERO), |body| motion(body, offset, dt));
        let mut bounds = world_bounds(&local_bounds, anchor + offset, rotation);
        let end = world_bounds(&local_bounds, anchor + offset + velocity * dt, turned(rotation, angular_velocity * dt));
        let bulge = bulge(&local_bounds, angular_velocity.length() * dt);
        bounds.mins = bounds.mins.min(end.mins) - bulge;
        bounds.maxs = bounds.maxs.max(end.maxs) + bulge;
        Some(Self {
            handle,
            body: collider.parent(),
            anchor,
            offset,
            rotation,
            local_bounds,
            bounds,
            velocity,
            velocity_now,
            angular_velocity,
            dt,
            last_way: velocity * dt,
            last_turn: angular_velocity * dt,
            friction: collider.friction(),
            rule: collider.friction_combine_rule(),
            layers: [collider.collision_groups(), collider.solver_groups()],
            shape: collider.shared_shape().clone(),
        })
    }

    fn slot(&self) -> u32 {
        self.handle.into_raw_parts().0
    }

    pub(crate) fn moves(&self) -> bool {
        self.velocity != Vector::ZERO || self.angular_velocity != Vector::ZERO
    }

    fn stirred(&self, speed: f32) -> Stirred {
        Stirred { bounds: self.bounds, layers: self.layers, body: self.body, speed }
    }

    /// Whether it is where `old`, the same a step ago, was, and made as that was. One that has stopped there is.
    fn is_like(&self, old: &Self) -> bool {
        (self.anchor, self.offset, self.rotation) == (old.anchor, old.offset, old.rotation) && self.is_made_like(old)
    }

    fn is_made_like(&self, old: &Self) -> bool {
        (self.local_bounds, self.friction, self.rule, self.layers) == (old.local_bounds, old.friction, old.rule, old.layers)
            && core::ptr::addr_eq(self.shape.0.as_ref(), old.shape.0.as_ref())
    }

    /// See [`Stirred::speed`]; `old` is the same, `dt` \[s\] ago.
    fn speed_since(&self, old: &Self, dt: f32) -> f32 {
        if !self.is_made_like(old) {
            return f32::INFINITY;
        }
        // Of a box about its origin the root mean square distance of its points.
        let size = reach(&self.local_bounds) * (1.0f32 / 3.0).sqrt();
        // Of a small turn by θ, twice the vector part is θ; of a great one it is still more than the rest of the body's way could make up for.
        let turn = 2.0 * (self.rotation * old.rotation.inverse()).xyz().length();
        let way = ((self.anchor - old.anchor) + (self.offset - old.offset)).length();
        let mean = |straight: f32, round: f32| (straight * straight + round * round).sqrt();
        mean(way / dt, turn * size / dt).max(mean(self.velocity.length(), self.angular_velocity.length() * size))
    }

    /// Where it is now, at the end of the step, and where it was at the start of the last one, relative to `origin`.
    ///
    /// The difference of two places far out is exact; only then is it rotated and added to.
    pub(crate) fn frames(&self, origin: Vector, dt: f32) -> [Frame; 3] {
        let [now, end] = [0.0, dt].map(|time| self.frame_at(origin, time));
        [now, end, Frame { translation: now.translation - Vec3A::from(self.last_way), rotation: turned(now.rotation, -self.last_turn) }]
    }

    /// Where it is `time` \[s\] after the step's start, relative to `origin`.
    pub(crate) fn frame_at(&self, origin: Vector, time: f32) -> Frame {
        Frame {
            translation: ((self.anchor - origin) + self.offset + self.velocity * time).into(),
            rotation: turned(self.rotation, self.angular_velocity * time),
        }
    }

    /// The velocity over the step of `dt` of the plane with normal `n` at `at` \[m/s\]. `at` and `frame`, where the obstacle is now, are relative to a body's origin.
    ///
    /// Along the plane it is the way from where the material is to where it will be, divided by `dt`: a particle that followed the tangent step by step would creep out of a turntable by r(ωΔt)²/2 a
    /// step. Along the normal it is the material's velocity now, which is also the surface's: the chord of a wheel points inwards, its surface stays.
    pub(crate) fn plane_velocity(&self, at: Vec3A, n: Vec3A, frame: &Frame, dt: f32) -> Vec3A {
        let velocity = Vec3A::from(self.velocity);
        if self.angular_velocity == Vector::ZERO || dt <= 0.0 {
            return velocity;
        }
        let arm = at - frame.translation;
        let way = velocity + (quat_exp((self.angular_velocity * dt).into()) * arm - arm) / dt;
        way + n * n.dot(self.velocity_now_at(at, frame) - way)
    }

    /// The velocity of its material at `at` at this moment \[m/s\].
    pub(crate) fn velocity_now_at(&self, at: Vec3A, frame: &Frame) -> Vec3A {
        Vec3A::from(self.velocity_now) + Vec3A::from(self.angular_velocity).cross(at - frame.translation)
    }

    /// Whether it may come near the box `mins` … `maxs`, relative to `origin`, in this step.
    pub(crate) fn meets(&self, mins: Vector, maxs: Vector, origin: Vector) -> bool {
        near(&self.bounds, mins, maxs, origin)
    }

    /// The box within which it is in this step, relative to `origin`, but for [`slop`].
    pub(crate) fn bounds_from(&self, origin: Vector) -> [Vec3A; 2] {
        [self.bounds.mins, self.bounds.maxs].map(|corner| (corner - origin).into())
    }

    /// Whether both the layers in which Rapier looks for contacts and those in which it acts on them let a body with these `layers` through.
    pub(crate) fn lets_meet(&self, layers: InteractionGroups) -> bool {
        let_meet(&self.layers, layers)
    }

    /// Coulomb's coefficient against a body with coefficient `other`, by Rapier's rules; the body's own rule is the weakest, the average.
    pub(crate) fn friction_with(&self, other: f32) -> f32 {
        let (a, b) = (self.friction.max(0.0), other.max(0.0));
        match self.rule {
            CoefficientCombineRule::Average => 0.5 * (a + b),
            CoefficientCombineRule::Min => a.min(b),
            CoefficientCombineRule::Multiply => a * b,
            CoefficientCombineRule::Max => a.max(b),
            CoefficientCombineRule::ClampedSum => (a + b).clamp(0.0, 1.0),
            CoefficientCombineRule::GeometricMean => (a * b).sqrt(),
        }
    }
}

/// How far points of the box `bounds` get, at most, out of the box around where they are at both ends of a turn by `angle` about the origin: the arc of one at the distance r rises above its chord by r·(1 − cos ½θ), which is at
/// most r·θ²/8 and 2·r.
fn bulge(bounds: &Aabb, angle: f32) -> f32 {
    reach(bounds) * (0.125 * angle * angle).min(2.0)
}

/// How far from its origin a shape with `bounds` gets, at most. Finite, so that a half-space that does not turn has no way times an infinity.
fn reach(bounds: &Aabb) -> f32 {
    bounds.mins.abs().max(bounds.maxs.abs()).length().min(f32::MAX)
}

/// Whether the boxes meet; `mins` … `maxs` is relative to `origin`. The box grows by the [`slop`].
fn near(bounds: &Aabb, mins: Vector, maxs: Vector, origin: Vector) -> bool {
    let slop = slop(origin);
    (bounds.mins - origin).cmple(maxs + slop).all() && (bounds.maxs - origin).cmpge(mins - slop).all()
}

/// A few steps of the world's floats at `origin`, which are coarse far out \[m\].
pub(crate) fn slop(origin: Vector) -> f32 {
    1e-6 * origin.abs().max_element()
}

fn let_meet(own: &[InteractionGroups; 2], layers: InteractionGroups) -> bool {
    own.iter().all(|own| own.test(layers))
}

/// Of the point at `offset` from the rigid body's position: its velocity now, the angular velocity, and the velocity as its way over the step of `dt` divided by `dt`. Not finite counts as none.
fn motion(body: &RigidBody, offset: Vector, dt: f32) -> (Vector, Vector, Vector) {
    let rest = (Vector::ZERO, Vector::ZERO, Vector::ZERO);
    if body.is_fixed() || dt <= 0.0 {
        return rest;
    }
    // Everything turns about its centre: the centre of mass, or the position of one whose next position is given.
    let (linear, angular, arm) = if body.body_type() == RigidBodyType::KinematicPositionBased {
        let (now, next) = (body.position(), body.next_position());
        let turn = Vector::from(quat_log(next.rotation * now.rotation.inverse()));
        ((next.translation - now.translation) / dt, turn / dt, offset)
    } else {
        (body.linvel(), body.angvel(), offset - body.position().rotation * body.local_center_of_mass())
    };
    let way = quat_exp((angular * dt).into()) * arm - arm;
    let motion = (linear + angular.cross(arm), angular, linear + way / dt);
    if motion.0.is_finite() && motion.1.is_finite() && motion.2.is_finite() { motion } else { rest }
}

fn turned(rotation: Rotation, turn: Vector) -> Rotation {
    if turn == Vector::ZERO { rotation } else { (quat_exp(turn.into()) * rotation).normalize() }
}

/// The box around a turned box.
fn world_bounds(local: &Aabb, translation: Vector, rotation: Rotation) -> Aabb {
    let axes = rapier3d::math::Mat3::from_quat(rotation);
    let half = local.half_extents();
    let reach = axes.x_axis.abs() * half.x + axes.y_axis.abs() * half.y + axes.z_axis.abs() * half.z;
    let center = translation + rotation * local.center();
    Aabb::new(center - reach, center + reach)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rapier3d::prelude::*;

    const DT: f32 = 1.0 / 60.0;

    fn one(body: RigidBodyBuilder, collider: ColliderBuilder, change: impl FnOnce(&mut RigidBody)) -> Obstacles {
        let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
        let body = bodies.insert(body);
        colliders.insert_with_parent(collider, body, &mut bodies);
        change(&mut bodies[body]);
        let mut obstacles = Obstacles::default();
        obstacles.gather(&bodies, &colliders, DT);
        obstacles
    }

    #[test]
    fn a_driven_body_moves_to_where_it_will_be() {
        let obstacles = one(
            RigidBodyBuilder::kinematic_position_based().translation(Vector::new(1.0, 2.0, 3.0)),
            ColliderBuilder::ball(0.1).translation(Vector::new(0.5, 0.0, 0.0)),
            |body| body.set_next_kinematic_position(Pose::new(Vector::new(1.1, 2.0, 3.0), Vector::new(0.0, 0.3, 0.0))),
        );
        let obstacle = &obstacles.list[0];
        assert!((obstacle.angular_velocity - Vector::new(0.0, 0.3 / DT, 0.0)).length() < 1e-3);
        let [now, end, _] = obstacle.frames(Vector::new(1.0, 2.0, 3.0), DT);
        assert!((now.translation - Vec3A::new(0.5, 0.0, 0.0)).length() < 1e-6);
        let rim = Vector::new(0.1 + 0.5 * libm::cosf(0.3), 0.0, -0.5 * libm::sinf(0.3));
        assert!((end.translation - Vec3A::from(rim)).length() < 1e-5, "{} against {rim}", end.translation);
        assert!((end.inside(end.outside(Vec3A::ONE)) - Vec3A::ONE).length() < 1e-5);
    }

    #[test]
    fn a_driven_velocity_is_that_of_the_material() {
        let obstacles = one(
            RigidBodyBuilder::kinematic_velocity_based().linvel(Vector::X).angvel(Vector::Y * 2.0),
            ColliderBuilder::cuboid(1.0, 0.1, 1.0),
            |_| (),
        );
        let obstacle = &obstacles.list[0];
        let [now, ..] = obstacle.frames(Vector::ZERO, DT);
        assert!((obstacle.velocity_now_at(Vec3A::X * 0.5, &now) - Vec3A::new(1.0, 0.0, -1.0)).length() < 1e-6);
        let end = Vector::new(0.5 * libm::cosf(2.0 * DT) + DT, 0.0, -0.5 * libm::sinf(2.0 * DT));
        assert!((Vec3A::X * 0.5 + obstacle.plane_velocity(Vec3A::X * 0.5, Vec3A::Y, &now, DT) * DT - Vec3A::from(end)).length() < 1e-6);
    }

    #[test]
    fn a_teleported_fixed_body_has_no_velocity() {
        let obstacles = one(RigidBodyBuilder::fixed(), ColliderBuilder::ball(0.1), |body| body.set_translation(Vector::X * 5.0, true));
        let obstacle = &obstacles.list[0];
        let [now, end, before] = obstacle.frames(Vector::ZERO, DT);
        assert_eq!(now.translation, Vec3A::X * 5.0);
        assert_eq!((end.translation, before.translation), (now.translation, now.translation));
    }

    #[test]
    fn what_cannot_be_met_or_used_is_left_out() {
        let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
        colliders.insert(ColliderBuilder::ball(1.0).sensor(true));
        colliders.insert(ColliderBuilder::ball(1.0).enabled(false));
        colliders.insert(ColliderBuilder::ball(1.0).translation(Vector::new(f32::NAN, 0.0, 0.0)));
        colliders.insert(ColliderBuilder::ball(f32::INFINITY));
        let off = bodies.insert(RigidBodyBuilder::fixed().enabled(false));
        colliders.insert_with_parent(ColliderBuilder::ball(1.0), off, &mut bodies);
        let mut obstacles = Obstacles::default();
        obstacles.gather(&bodies, &colliders, DT);
        assert!(obstacles.is_empty());
        assert_eq!(obstacles.reported.len(), 2);
        colliders.insert(ColliderBuilder::new(SharedShape::new(HalfSpace::new(Vector::Y))));
        obstacles.gather(&bodies, &colliders, DT);
        assert_eq!((obstacles.len(), obstacles.reported.len()), (1, 2));
        // Nor are those remembered that are gone.
        let (mut islands, all) = (IslandManager::new(), obstacles.reported.clone());
        for handle in all {
            colliders.remove(handle, &mut islands, &mut bodies, true);
        }
        obstacles.gather(&bodies, &colliders, DT);
        assert_eq!((obstacles.len(), obstacles.reported.len()), (1, 0));
    }

    #[test]
    fn friction_follows_the_rule() {
        for (rule, expected) in [
            (CoefficientCombineRule::Average, 0.5),
            (CoefficientCombineRule::Min, 0.2),
            (CoefficientCombineRule::Multiply, 0.16),
            (CoefficientCombineRule::Max, 0.8),
            (CoefficientCombineRule::ClampedSum, 1.0),
            (CoefficientCombineRule::GeometricMean, 0.4),
        ] {
            let obstacles = one(RigidBodyBuilder::fixed(), ColliderBuilder::ball(0.1).friction(0.2).friction_combine_rule(rule), |_| ());
            assert!((obstacles.list[0].friction_with(0.8) - expected).abs() < 1e-6, "{rule:?}");
        }
    }
}
