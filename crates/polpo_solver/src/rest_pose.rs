//! The shape a body strives for where that is not the one it was made in: muscles and inflation.

use std::sync::Arc;

use glam::{Quat, Vec3A};

use crate::batches::Batches;
use crate::calibrated_edges::MadeEdge;
use crate::{CalibratedEdges, Edges, ImplicitGroups, Particles, Rings};

/// A rest pose other than the rig's. Change it from step to step, and the body works like a muscle: nothing pulls from outside, so momentum and angular momentum stay.
///
/// Only what differs between neighbours counts: a pose moved or turned as a whole is the same pose. Neighbouring places that contradict the places of theirs are met half way, by stiffness. A default
/// one is the shape that the body was made in.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RestPose {
    /// Where each particle is \[m\], in the axes of [`Particles::rest_position`]; empty: where it was made.
    pub position: Vec<Vec3A>,
    /// How each particle is turned there against how it was made, any length but zero; empty: not at all. A bent limb needs the turning as well as the places: groups of a chain hold on to both.
    pub rotation: Vec<Quat>,
    /// How many times larger the neighbourhood of each particle is than the places say, positive; empty: once. Of an edge, the mean of its ends. The particles themselves keep their radii, as the skin
    /// keeps its patches.
    pub size: Vec<f32>,
}

/// What is wrong with a rest pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// A list is neither empty nor as long as there are particles.
    #[error("there are {found} {what} for {expected} particles")]
    Count {
        /// Which list.
        what: &'static str,
        /// How long it is.
        found: usize,
        /// How many particles there are.
        expected: usize,
    },
    /// An entry is out of its range.
    #[error("particle {index}: its {what} is {problem}")]
    Range {
        /// Which particle.
        index: usize,
        /// Which of its numbers.
        what: &'static str,
        /// What is wrong with it.
        problem: &'static str,
    },
}

impl RestPose {
    /// Whether it is a pose for a body of `count` particles.
    ///
    /// # Errors
    ///
    /// The first list of another length, or the first entry that is not finite, a rotation of no length, or a size that is not positive and normal.
    pub fn check(&self, count: usize) -> Result<(), PoseError> {
        for (what, found) in [("positions", self.position.len()), ("rotations", self.rotation.len()), ("sizes", self.size.len())] {
            if found != 0 && found != count {
                return Err(PoseError::Count { what, found, expected: count });
            }
        }
        let bad = |what, problem| move |index| PoseError::Range { index, what, problem };
        let faults = [
            self.position.iter().position(|x| !x.is_finite()).map(bad("position", "not finite")),
            self.rotation.iter().position(|q| !q.length_squared().is_normal()).map(bad("rotation", "not one")),
            self.size.iter().position(|&s| !(s > 0.0 && s.is_normal())).map(bad("size", "not positive and normal")),
        ];
        faults.into_iter().flatten().next().map_or(Ok(()), Err)
    }

    #[inline]
    pub(crate) fn place(&self, particles: &Particles, i: u32) -> Vec3A {
        self.position.get(i as usize).copied().unwrap_or_else(|| particles.rest_position[i as usize])
    }

    #[inline]
    pub(crate) fn size(&self, i: u32) -> f32 {
        self.size.get(i as usize).copied().unwrap_or(1.0)
    }

    /// The centre of mass of `members` in the pose.
    pub(crate) fn center(&self, particles: &Particles, members: &[u32]) -> Vec3A {
        let (mut center, mut mass) = (Vec3A::ZERO, 0.0);
        for &i in members {
            mass += particles.mass[i as usize];
            center += self.place(particles, i) * particles.mass[i as usize];
        }
        center / mass
    }

    /// The length of the edge between `i` and `j`.
    #[inline]
    pub(crate) fn length(&self, particles: &Particles, [i, j]: [u32; 2]) -> f32 {
        let length = self.place(particles, i).distance(self.place(particles, j));
        if self.size.is_empty() { length } else { length * (0.5 * (self.size(i) + self.size(j))) }
    }
}

impl ImplicitGroups {
    /// Makes `pose`, which has passed its [`check`](RestPose::check), the one that the groups strive for. What has flowed plastically stays on top. Allocates the first time only.
    pub fn pose(&mut self, particles: &Particles, pose: &RestPose) {
        self.rest_rotation.clear();
        self.rest_rotation.extend(pose.rotation.iter().map(|q| q.normalize()));
        let rest = Arc::make_mut(&mut self.rest);
        rest.clear();
        for row in self.rows.windows(2) {
            let members = &self.members[row[0] as usize..row[1] as usize];
            let center = pose.center(particles, members);
            let size = pose.size(members[0]);
            rest.extend(members.iter().map(|&i| (pose.place(particles, i) - center) * size));
            if !self.flow.is_empty() {
                let turn = self.rest_rotation.get(members[0] as usize).copied().unwrap_or(Quat::IDENTITY);
                let row = row[0] as usize..row[1] as usize;
                for (r, &flow) in rest[row.clone()].iter_mut().zip(&self.flow[row]) {
                    *r += turn * flow;
                }
            }
        }
        Batches::rest(&mut self.batches, &self.rows, &self.rest);
    }
}

impl Edges {
    /// Makes `pose`, which has passed its [`check`](RestPose::check), the one in which edges have their rest length and no twist. What has flowed plastically stays on top. Allocates the first time only.
    pub fn pose(&mut self, particles: &Particles, pose: &RestPose) {
        for (e, (&pair, rest)) in self.pairs.iter().zip(&mut self.rest_length).enumerate() {
            *rest = pose.length(particles, pair) * self.flow.get(e).copied().unwrap_or(1.0);
        }
        self.rest_turn.clear();
        if !pose.rotation.is_empty() {
            // Each on its own first: the product of two very short or very long ones has no length that a float holds.
            let turn = |i: u32| pose.rotation[i as usize].normalize();
            self.rest_turn.extend(self.pairs.iter().map(|&[i, j]| (turn(j).inverse() * turn(i)).normalize()));
        }
    }
}

impl CalibratedEdges {
    /// Makes `pose`, which has passed its [`check`](RestPose::check), the one in which the edges have no strain. Their stiffness stays what they were made with, also where they are longer. Allocates the first
    /// time only.
    ///
    /// With r the ends' rotations and d their distance in the pose, the contact points are where the ends carry them, r·s, and the edge's axes those that the mean of r carries along, turned the shortest way so
    /// that what was the direction of d before is that of d now. A pose of places alone gives edges whose ends are not turned against each other. Ends in one place have no direction: the axes go with r.
    pub fn pose(&mut self, particles: &Particles, pose: &RestPose) {
        if self.made.is_empty() {
            let contact = |e: usize| self.contact.get(e).copied().unwrap_or_default();
            let edges = self.frame.iter().zip(&self.rest_gap).enumerate();
            self.made = edges.map(|(e, (&frame, &rest_gap))| MadeEdge { frame, rest_gap, contact: contact(e) }).collect();
        }
        self.rest_turn.clear();
        let as_made = pose.position.is_empty() && pose.size.is_empty();
        for (e, (&[i, j], made)) in self.pairs.iter().zip(&self.made).enumerate() {
            let size = 0.5 * (pose.size(i) + pose.size(j));
            let turn = [i, j].map(|k| pose.rotation.get(k as usize).map_or(Quat::IDENTITY, |q| q.normalize()));
            let contact = made.contact.map(|s| s * size);
            if let Some(to) = self.contact.get_mut(e) {
                *to = contact;
            }
            if !pose.rotation.is_empty() {
                self.rest_turn.push(turn.map(|r| r.inverse()));
            } else if as_made {
                (self.frame[e], self.rest_gap[e]) = (made.frame, made.rest_gap);
                continue;
            }
            let before = particles.rest_position[j as usize] - particles.rest_position[i as usize];
            let now = (pose.place(particles, j) - pose.place(particles, i)) * size;
            let mean = turn[0] + if turn[0].dot(turn[1]) < 0.0 { -turn[1] } else { turn[1] };
            let mean = if mean.length_squared() > 0.0 { mean.normalize() } else { turn[0] };
            let carried = mean * before;
            let aligned = match (carried.try_normalize(), now.try_normalize()) {
                (Some(a), Some(b)) => Quat::from_rotation_arc(a.into(), b.into()),
                _ => Quat::IDENTITY,
            };
            self.frame[e] = (aligned * mean * made.frame).normalize();
            let gap = now + turn[1] * contact[1] - turn[0] * contact[0];
            self.rest_gap[e] = self.frame[e].inverse() * gap;
        }
    }
}

impl Rings {
    /// Makes `pose`, which has passed its [`check`](RestPose::check), the one in which no cell is swollen or pressed: the distances to the neighbours are those in the pose.
    pub fn pose(&mut self, particles: &Particles, pose: &RestPose) {
        for (r, &i) in self.middle.iter().enumerate() {
            for k in self.starts[r] as usize..self.starts[r + 1] as usize {
                self.weight[k][1] = pose.length(particles, [i, self.around[k]]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::testing::blob;
    use crate::{
        ParticleRest, Shares, Stiffness, Sweep, Turning, blow, integrate, match_shapes, momentum, predict, quat_exp, quat_log,
        restore_angular_momentum, solve_distances, solve_torsion,
    };

    const DT: f32 = 1.0 / 300.0;

    struct Body(Particles, ImplicitGroups, Edges);

    impl Body {
        fn new(particles: Particles, pairs: &[[u32; 2]]) -> Self {
            let edges = Edges::new(&particles, pairs).unwrap();
            Self(particles.clone(), ImplicitGroups::new(&particles, &edges), edges)
        }

        fn pose(&mut self, pose: &RestPose) {
            pose.check(self.0.len()).unwrap();
            self.1.pose(&self.0, pose);
            self.2.pose(&self.0, pose);
        }

        fn constrain(&mut self, shares: Shares) {
            let Self(p, groups, edges) = self;
            let before = momentum(p).angular;
            match_shapes(groups, p, shares, Turning::AllMembers, Sweep::only(DT));
            solve_distances(edges, p, shares, shares, Sweep::only(DT));
            solve_torsion(edges, p, shares, Sweep::only(DT));
            restore_angular_momentum(p, before, DT);
        }

        fn step(&mut self, shares: Shares, water: f32) {
            blow(&mut self.0, Vec3A::ZERO, water, 1.0, DT);
            predict(&mut self.0, Vec3A::ZERO, DT);
            self.constrain(shares);
            integrate(&mut self.0, DT, 0.0);
        }
    }

    /// Bent about z by `bend` \[rad/m\] along x, twisted about x by `twist` \[rad/m\].
    fn bent(p: &Particles, bend: f32, twist: f32) -> RestPose {
        let mut pose = RestPose::default();
        for &x in &p.rest_position {
            let turn = quat_exp(Vec3A::X * (twist * x.x));
            let arc = quat_exp(Vec3A::Z * (bend * x.x));
            let spine = Vec3A::new(libm::sinf(bend * x.x), 1.0 - libm::cosf(bend * x.x), 0.0) / bend;
            pose.position.push(spine + arc * (turn * Vec3A::new(0.0, x.y, x.z)));
            pose.rotation.push(arc * turn);
        }
        pose
    }

    /// A body that is in its pose is left alone, wherever it is; one that is not, comes to it.
    #[test]
    fn a_posed_body_is_at_rest_in_its_pose() {
        let (rest, pairs) = blob();
        let mut body = Body::new(rest, &pairs);
        let mut pose = bent(&body.0, 2.0, 1.5);
        body.pose(&pose);
        let turn = quat_exp(Vec3A::new(0.5, -1.2, 0.7));
        for i in 0..pose.position.len() {
            body.0.position[i] = turn * pose.position[i];
            body.0.rotation[i] = turn * pose.rotation[i];
        }
        let before = body.0.clone();
        let shares: Shares = Stiffness::RIGID.share(DT).into();
        match_shapes(&mut body.1, &mut body.0, shares, Turning::AllMembers, Sweep::only(DT));
        solve_distances(&mut body.2, &mut body.0, shares, shares, Sweep::only(DT));
        solve_torsion(&mut body.2, &mut body.0, shares, Sweep::only(DT));
        for i in 0..pose.position.len() {
            assert!(body.0.position[i].distance(before.position[i]) < 3e-6, "{i}");
            assert!(quat_log(body.0.rotation[i] * before.rotation[i].inverse()).length() < 2e-5, "{i}");
        }
        // From its made shape, and larger.
        let (rest, _) = blob();
        let mut body = Body::new(rest, &pairs);
        pose.size = vec![1.3; pose.position.len()];
        body.pose(&pose);
        for _ in 0..600 {
            body.step(Stiffness::damped(20.0, 1.0).share(DT).into(), 0.0);
        }
        for &[i, j] in &pairs {
            let (i, j) = (i as usize, j as usize);
            let wanted = 1.3 * pose.position[i].distance(pose.position[j]);
            assert!((body.0.position[i].distance(body.0.position[j]) / wanted - 1.0).abs() < 1e-3);
            let turn = quat_log((pose.rotation[j] * pose.rotation[i].inverse()).normalize());
            assert!((quat_log(body.0.rotation[j] * body.0.rotation[i].inverse()).length() - turn.length()).abs() < 5e-3);
        }
        // And back.
        body.pose(&RestPose::default());
        let made = Body::new(blob().0, &pairs);
        assert_eq!((&body.1.rest, &body.2.rest_length), (&made.1.rest, &made.2.rest_length));
        assert!(body.1.rest_rotation.is_empty() && body.2.rest_turn.is_empty());
    }

    /// A muscle that bends, twists and inflates a free body gives it neither momentum nor angular momentum.
    #[test]
    fn muscles_pull_on_nothing_outside() {
        let (mut rest, pairs) = blob();
        rest.set_rigid_velocity(Vec3A::new(1.0, 0.5, 0.0), Vec3A::new(0.5, 1.0, 2.0));
        let mut body = Body::new(rest, &pairs);
        let before = momentum(&body.0);
        let mut bend = 0.0f32;
        for k in 0..3000 {
            let a = libm::sinf(k as f32 * 0.05);
            let mut pose = bent(&body.0, 3.0 * a + 1e-3, 2.0 * a);
            pose.size = (0..body.0.len()).map(|i| 1.0 + 0.2 * a * (i % 2) as f32).collect();
            body.pose(&pose);
            body.step(Stiffness::hertz(15.0).share(DT).into(), 0.0);
            bend = bend.max(quat_log(body.0.rotation[2] * body.0.rotation[0].inverse()).length());
            // As a body's origin does. Ten metres out, the rounding of places alone would be some 1e-4 of L.
            let center = body.0.center_of_mass();
            body.0.shift_origin(center);
        }
        let after = momentum(&body.0);
        let (dp, dl) = (after.linear.distance(before.linear), after.angular.distance(before.angular));
        println!("muscle: bends by {bend} rad, P {dp:.1e} of {}, L {dl:.1e} of {}", before.linear.length(), before.angular.length());
        assert!(bend > 0.5);
        assert!(dp < 1e-5 * before.linear.length() && dl < 1e-4 * before.angular.length());
    }

    /// A fish of twelve flat ellipsoids, nose at x = 0, tail at x = −1.1, whose spine is bent by a wave running from nose to tail.
    fn swim(water: f32, direction: f32) -> f32 {
        let rest: Vec<ParticleRest> = (0..12)
            .map(|i| ParticleRest {
                position: Vec3A::NEG_X * (0.1 * i as f32),
                frame: Quat::IDENTITY,
                radii: Vec3A::new(0.06, 0.03, 0.12),
                mass: 1.0,
            })
            .collect();
        let pairs: Vec<[u32; 2]> = (1..12).map(|i| [i - 1, i]).collect();
        let mut body = Body::new(Particles::new(&rest).unwrap(), &pairs);
        let mut pose = RestPose { position: vec![Vec3A::ZERO; 12], rotation: vec![Quat::IDENTITY; 12], ..RestPose::default() };
        for k in 0..3000 {
            let t = k as f32 * DT;
            // Curvature grows towards the tail; the spine is its integral.
            let (mut angle, mut x) = (0.0f32, Vec3A::ZERO);
            for i in 0..12 {
                let s = i as f32 / 11.0;
                angle += 0.1 * (1.0 + 2.0 * s) * libm::sinf(TAU * (s - direction * t)) * t.min(1.0);
                pose.rotation[i] = quat_exp(Vec3A::Z * angle);
                pose.position[i] = x;
                x -= pose.rotation[i] * Vec3A::X * 0.1;
            }
            body.pose(&pose);
            body.step(Stiffness::damped(30.0, 1.0).share(DT).into(), water);
        }
        assert!(body.0.is_finite());
        body.0.center_of_mass().x + 0.55
    }

    /// With the wave from nose to tail it swims nose first, with the wave the other way round tail first, and in empty space not at all.
    #[test]
    fn a_fish_swims_by_its_muscles() {
        let (ahead, astern, nowhere) = (swim(1000.0, 1.0), swim(1000.0, -1.0), swim(0.0, 1.0));
        println!("fish: {ahead} m in 10 s, backwards {astern} m, without water {nowhere} m");
        assert!(ahead > 0.5 && astern < -0.3 && nowhere.abs() < 1e-4);
    }

    /// Rotations of any length say the same.
    #[test]
    fn a_pose_may_have_quaternions_of_any_length() {
        let (rest, pairs) = blob();
        let mut body = Body::new(rest, &pairs);
        let mut pose = bent(&body.0, 2.0, 1.5);
        body.pose(&pose);
        let expected = body.2.rest_turn.clone();
        for length in [1e-15, 1e15] {
            pose.rotation.iter_mut().for_each(|q| *q = q.normalize() * length);
            body.pose(&pose);
            assert!(body.2.rest_turn.iter().zip(&expected).all(|(a, b)| a.dot(*b) > 0.999_999), "{length}");
        }
    }

    #[test]
    fn bad_poses_are_named() {
        let (p, _) = blob();
        let n = p.len();
        let error = |pose: RestPose| pose.check(n).unwrap_err().to_string();
        assert_eq!(error(RestPose { position: vec![Vec3A::ZERO; 3], ..RestPose::default() }), "there are 3 positions for 18 particles");
        let mut rotation = vec![Quat::IDENTITY; n];
        rotation[4] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        assert_eq!(error(RestPose { rotation, ..RestPose::default() }), "particle 4: its rotation is not one");
        let mut position = vec![Vec3A::ZERO; n];
        position[7].y = f32::NAN;
        assert_eq!(error(RestPose { position, ..RestPose::default() }), "particle 7: its position is not finite");
        let mut size = vec![1.0; n];
        size[1] = -1.0;
        assert_eq!(error(RestPose { size, ..RestPose::default() }), "particle 1: its size is not positive and normal");
    }
}
