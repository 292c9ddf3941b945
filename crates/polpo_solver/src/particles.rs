//! The state of a body: oriented particles as a structure of arrays.

use glam::{Quat, Vec3A};

use crate::{Ellipsoid, quat_exp};

/// One particle at rest, from which [`Particles`] is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParticleRest {
    /// Centre \[m\].
    pub position: Vec3A,
    /// Principal axes of the ellipsoid, unit length.
    pub frame: Quat,
    /// Half axes \[m\], positive.
    pub radii: Vec3A,
    /// Mass \[kg\], positive.
    pub mass: f32,
}

/// What is wrong with a particle's rest state.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ParticleError {
    /// There are more particles than a `u32` counts.
    #[error("{count} particles are more than a 32-bit index counts")]
    TooMany {
        /// How many there are.
        count: usize,
    },
    /// A position, frame or radius is NaN or infinite.
    #[error("particle {index}: {what} is not finite")]
    NotFinite {
        /// Which particle.
        index: usize,
        /// Which of its fields.
        what: &'static str,
    },
    /// The mass is not a positive, normal number with a normal inverse.
    #[error("particle {index}: mass {mass} kg is not positive and normal")]
    Mass {
        /// Which particle.
        index: usize,
        /// Its mass \[kg\].
        mass: f32,
    },
    /// A half axis is zero, negative, or so small that the spin inertia vanishes.
    #[error("particle {index}: half axes {radii} m do not span a volume")]
    Radii {
        /// Which particle.
        index: usize,
        /// Its half axes \[m\].
        radii: Vec3A,
    },
    /// The frame is not a unit quaternion.
    #[error("particle {index}: its frame is not a unit quaternion (length {length})")]
    Frame {
        /// Which particle.
        index: usize,
        /// Its length, which should be 1.
        length: f32,
    },
}

/// The particles of one body. All arrays have the same length.
///
/// Positions are relative to the body's origin, in axes that stay parallel to the world's, so that a body far from the world's origin computes like one at home. `position` and `rotation` are
/// what the constraints move; `previous_*` is where the substep began.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// Centres \[m\], relative to the body's origin.
    pub position: Vec<Vec3A>,
    /// Centres at the start of the substep \[m\].
    pub previous_position: Vec<Vec3A>,
    /// \[m/s\]
    pub velocity: Vec<Vec3A>,
    /// Rotation since rest, unit length.
    pub rotation: Vec<Quat>,
    /// Rotation at the start of the substep.
    pub previous_rotation: Vec<Quat>,
    /// \[rad/s\], world axes.
    pub angular_velocity: Vec<Vec3A>,
    /// \[kg\]
    pub mass: Vec<f32>,
    /// \[1/kg\], 0 for a particle whose position is pinned.
    pub inverse_mass: Vec<f32>,
    /// Spin inertia \[kg·m²\], see [`inverse_inertia`](Self::inverse_inertia).
    pub inertia: Vec<f32>,
    /// Inverse of the spin inertia \[1/(kg·m²)\], 0 for a particle whose orientation is pinned.
    ///
    /// The spin inertia is a scalar, the mean of the ellipsoid's three principal moments, (2/15)·m·(a² + b² + c²). The prediction keeps ω constant between constraints, which conserves
    /// spin momentum for a scalar and would not for a tensor.
    pub inverse_inertia: Vec<f32>,
    /// The impulse with which constraints pulled the others at each pinned particle in this substep \[N·s\]; empty unless somebody wants to know.
    pub reaction: Vec<Vec3A>,
    /// What constraints that nothing bends have added to each particle's velocity \[m/s\] and spin \[rad/s\] in this substep; empty if there are none. See [`restore_angular_momentum`](crate::restore_angular_momentum).
    pub(crate) rigid_push: Vec<[Vec3A; 2]>,
    /// Centres at rest \[m\], in the rig's axes.
    pub rest_position: Vec<Vec3A>,
    /// Principal axes at rest.
    pub frame: Vec<Quat>,
    /// Half axes \[m\].
    pub radii: Vec<Vec3A>,
}

impl Particles {
    /// Particles at rest at their rest positions.
    ///
    /// # Errors
    ///
    /// The first particle that is not finite, has no mass, no volume or no frame.
    pub fn new(rest: &[ParticleRest]) -> Result<Self, ParticleError> {
        if u32::try_from(rest.len()).is_err() {
            return Err(ParticleError::TooMany { count: rest.len() });
        }
        let n = rest.len();
        let mut particles = Self {
            position: Vec::with_capacity(n),
            mass: Vec::with_capacity(n),
            inverse_mass: Vec::with_capacity(n),
            inertia: Vec::with_capacity(n),
            inverse_inertia: Vec::with_capacity(n),
            frame: Vec::with_capacity(n),
            radii: Vec::with_capacity(n),
            ..Self::default()
        };
        for (index, p) in rest.iter().enumerate() {
            for (what, finite) in [
                ("position", p.position.is_finite()),
                ("frame", p.frame.is_finite()),
                ("radii", p.radii.is_finite()),
                ("mass", p.mass.is_finite()),
            ] {
                if !finite {
                    return Err(ParticleError::NotFinite { index, what });
                }
            }
            if !(p.mass.is_normal() && p.mass > 0.0 && (1.0 / p.mass).is_normal()) {
                return Err(ParticleError::Mass { index, mass: p.mass });
            }
            let inertia = 2.0 / 15.0 * p.mass * p.radii.length_squared();
            if p.radii.min_element() <= 0.0 || !inertia.is_normal() || !(1.0 / inertia).is_normal() {
                return Err(ParticleError::Radii { index, radii: p.radii });
            }
            let length = p.frame.length();
            if (length - 1.0).abs() > 1e-3 {
                return Err(ParticleError::Frame { index, length });
            }
            particles.position.push(p.position);
            particles.mass.push(p.mass);
            particles.inverse_mass.push(1.0 / p.mass);
            particles.inertia.push(inertia);
            particles.inverse_inertia.push(1.0 / inertia);
            particles.frame.push(p.frame.normalize());
            particles.radii.push(p.radii);
        }
        particles.rest_position = particles.position.clone();
        particles.previous_position = particles.position.clone();
        particles.velocity = vec![Vec3A::ZERO; n];
        particles.rotation = vec![Quat::IDENTITY; n];
        particles.previous_rotation = vec![Quat::IDENTITY; n];
        particles.angular_velocity = vec![Vec3A::ZERO; n];
        Ok(particles)
    }

    /// Number of particles.
    #[inline]
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// The ellipsoid of particle `i` as it stands now, about its own centre.
    #[inline]
    pub fn ellipsoid(&self, i: usize) -> Ellipsoid {
        Ellipsoid { radii: self.radii[i], orientation: self.rotation[i] * self.frame[i] }
    }

    /// Total mass \[kg\].
    pub fn total_mass(&self) -> f32 {
        self.mass.iter().sum()
    }

    /// Centre of mass \[m\], relative to the body's origin. The origin for a body without particles.
    pub fn center_of_mass(&self) -> Vec3A {
        let mut sum = Vec3A::ZERO;
        let mut mass = 0.0;
        for (x, m) in self.position.iter().zip(&self.mass) {
            sum += *x * *m;
            mass += m;
        }
        if mass > 0.0 { sum / mass } else { Vec3A::ZERO }
    }

    /// Moves the origin by `shift` \[m\]: every position loses it.
    pub fn shift_origin(&mut self, shift: Vec3A) {
        for x in self.position.iter_mut().chain(&mut self.previous_position) {
            *x -= shift;
        }
    }

    /// Turns and moves the whole body about its origin as a rigid piece; velocities turn with it.
    pub fn place(&mut self, rotation: Quat, translation: Vec3A) {
        for i in 0..self.len() {
            self.position[i] = rotation * self.position[i] + translation;
            self.previous_position[i] = self.position[i];
            self.velocity[i] = rotation * self.velocity[i];
            self.rotation[i] = (rotation * self.rotation[i]).normalize();
            self.previous_rotation[i] = self.rotation[i];
            self.angular_velocity[i] = rotation * self.angular_velocity[i];
        }
    }

    /// Moves particle `i` by `way` \[m\] within a substep of 1/`rate` \[s\]: what a constraint does to a particle. Its velocity takes the way too.
    ///
    /// Velocities are summed up like this, rather than read off positions at the end, because the difference of two positions of a metre carries 6e-8 m of rounding, which at 1 kHz is
    /// 6e-5 m/s a substep, always to the same side in a body at rest. Summed, a body keeps its linear momentum to 1e-6 where it would lose 1e-3 in seconds.
    ///
    /// # Panics
    ///
    /// If there is no particle `i`.
    #[inline]
    pub fn displace(&mut self, i: usize, way: Vec3A, rate: f32) {
        self.position[i] += way;
        self.velocity[i] += way * rate;
    }

    /// Turns particle `i` by the rotation vector `angle` \[rad\] within a substep of 1/`rate` \[s\]: what a constraint does to an orientation. Its spin takes the turn too, for the reason that
    /// [`displace`](Self::displace) gives.
    ///
    /// # Panics
    ///
    /// If there is no particle `i`.
    #[inline]
    pub fn turn(&mut self, i: usize, angle: Vec3A, rate: f32) {
        self.rotation[i] = (quat_exp(angle) * self.rotation[i]).normalize();
        self.angular_velocity[i] += angle * rate;
    }

    /// Makes room for what rigid constraints add, if there are any among `shares`.
    pub(crate) fn ready_rigid_push(&mut self, shares: crate::Shares) {
        if self.rigid_push.len() != self.len() && shares.any_rigid() {
            self.rigid_push.clear();
            self.rigid_push.resize(self.len(), [Vec3A::ZERO; 2]);
        }
    }

    /// Gives particle `i` another spin inertia than that of its ellipsoid \[kg·m²\]. One that is not positive and normal, with a normal inverse, changes nothing.
    ///
    /// # Panics
    ///
    /// If there is no particle `i`.
    pub fn set_inertia(&mut self, i: usize, inertia: f32) {
        let inverse = 1.0 / inertia;
        if inertia > 0.0 && inertia.is_normal() && inverse.is_normal() {
            self.inertia[i] = inertia;
            if self.inverse_inertia[i] != 0.0 {
                self.inverse_inertia[i] = inverse;
            }
        }
    }

    /// Gives particle `i` another mass \[kg\]. One that is not positive and normal, with a normal inverse, changes nothing.
    ///
    /// # Panics
    ///
    /// If there is no particle `i`.
    pub fn set_mass(&mut self, i: usize, mass: f32) {
        let inverse = 1.0 / mass;
        if mass > 0.0 && mass.is_normal() && inverse.is_normal() {
            self.mass[i] = mass;
            if self.inverse_mass[i] != 0.0 {
                self.inverse_mass[i] = inverse;
            }
        }
    }

    /// Pins or frees the position and, separately, the orientation of particle `i`: no constraint moves what is pinned. Pinned, it has infinite mass, or infinite inertia; the other of the two
    /// is left as it is.
    ///
    /// # Panics
    ///
    /// If there is no particle `i`.
    pub fn pin(&mut self, i: usize, position: bool, rotation: bool) {
        self.inverse_mass[i] = if position { 0.0 } else { 1.0 / self.mass[i] };
        self.inverse_inertia[i] = if rotation { 0.0 } else { 1.0 / self.inertia[i] };
    }

    /// Gives the whole body the velocity of a rigid piece: `linear` \[m/s\] at the centre of mass, `angular` \[rad/s\] about it.
    pub fn set_rigid_velocity(&mut self, linear: Vec3A, angular: Vec3A) {
        let center = self.center_of_mass();
        for i in 0..self.len() {
            self.velocity[i] = linear + angular.cross(self.position[i] - center);
            self.angular_velocity[i] = angular;
        }
    }

    /// Whether every position, rotation and velocity is a number.
    pub fn is_finite(&self) -> bool {
        self.position.iter().all(|v| v.is_finite())
            && self.rotation.iter().all(|q| q.is_finite())
            && self.velocity.iter().all(|v| v.is_finite())
            && self.angular_velocity.iter().all(|v| v.is_finite())
    }
}

/// What constraints change, as slices of the same length: a kernel that has them knows so of all when it has looked at one.
pub(crate) struct Moving<'a> {
    pub(crate) position: &'a mut [Vec3A],
    pub(crate) velocity: &'a mut [Vec3A],
    pub(crate) rotation: &'a mut [Quat],
    pub(crate) spin: &'a mut [Vec3A],
    pub(crate) rigid_push: &'a mut [[Vec3A; 2]],
}

impl<'a> Moving<'a> {
    #[inline(always)]
    pub(crate) fn of(p: &'a mut Particles) -> Self {
        let n = p.position.len();
        Self {
            position: &mut p.position,
            velocity: &mut p.velocity[..n],
            rotation: &mut p.rotation[..n],
            spin: &mut p.angular_velocity[..n],
            rigid_push: &mut p.rigid_push,
        }
    }

    /// Moves particle `i` by `way` \[m\] and turns it by `angle` \[rad\] to `rotation`.
    #[inline(always)]
    pub(crate) fn displace(&mut self, i: usize, way: Vec3A, angle: Vec3A, rotation: Quat, rate: f32) {
        self.position[i] += way;
        self.velocity[i] += way * rate;
        self.rotation[i] = rotation;
        self.spin[i] += angle * rate;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn particle() -> ParticleRest {
        ParticleRest { position: Vec3A::ZERO, frame: Quat::IDENTITY, radii: Vec3A::splat(0.1), mass: 1.0 }
    }

    #[test]
    fn bad_particles_are_named() {
        let good = particle();
        let cases = [
            (ParticleRest { position: Vec3A::new(0.0, f32::NAN, 0.0), ..good }, "particle 1: position is not finite"),
            (ParticleRest { mass: 0.0, ..good }, "particle 1: mass 0 kg is not positive and normal"),
            (ParticleRest { mass: f32::INFINITY, ..good }, "particle 1: mass is not finite"),
            (
                ParticleRest { frame: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
                "particle 1: its frame is not a unit quaternion (length 0)",
            ),
        ];
        for (bad, message) in cases {
            assert_eq!(Particles::new(&[good, bad]).unwrap_err().to_string(), message);
        }
        assert!(matches!(
            Particles::new(&[ParticleRest { radii: Vec3A::new(0.1, 0.0, 0.1), ..good }]),
            Err(ParticleError::Radii { index: 0, .. })
        ));
    }

    #[test]
    fn spin_inertia_is_that_of_the_ball() {
        let p = Particles::new(&[particle()]).unwrap();
        assert!((1.0 / p.inverse_inertia[0] - 0.4 * 0.01).abs() < 1e-8);
    }

    #[test]
    fn shifting_the_origin_keeps_the_body_where_it_is() {
        let mut p = Particles::new(&[particle(), ParticleRest { position: Vec3A::X, ..particle() }]).unwrap();
        let com = p.center_of_mass();
        p.shift_origin(com);
        assert!(p.center_of_mass().length() < 1e-7);
        assert_eq!(p.position[1] - p.position[0], Vec3A::X);
    }
}
