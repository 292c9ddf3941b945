//! Whether the particles of a body are fit to be stepped.

use core::ops::Add;

use glam::{Quat, Vec3A};

use crate::Particles;

/// What is wrong with the particles of a body.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum StateError {
    /// An array has another length than the body has particles.
    #[error("{what} has {found} entries for {expected} particles")]
    Length {
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The number of particles.
        expected: usize,
    },
    /// A number is NaN or infinite.
    #[error("particle {particle}: {what} is not finite")]
    NotFinite {
        /// Which particle.
        particle: usize,
        /// Which of its arrays.
        what: &'static str,
    },
    /// A rotation or a frame is nowhere near a unit quaternion.
    #[error("particle {particle}: {what} has the length {length}, which should be 1")]
    Rotation {
        /// Which particle.
        particle: usize,
        /// Which of its arrays.
        what: &'static str,
        /// The quaternion's length.
        length: f32,
    },
}

impl Particles {
    /// Checks that the body has `count` particles, every array an entry for each, every number finite and every rotation near unit length. What a kernel is given has to be so; kernels do not look.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong: lengths before numbers.
    pub fn check(&self, count: usize) -> Result<(), StateError> {
        let lengths = [
            ("position", self.position.len()),
            ("previous_position", self.previous_position.len()),
            ("velocity", self.velocity.len()),
            ("rotation", self.rotation.len()),
            ("previous_rotation", self.previous_rotation.len()),
            ("angular_velocity", self.angular_velocity.len()),
            ("mass", self.mass.len()),
            ("inverse_mass", self.inverse_mass.len()),
            ("inertia", self.inertia.len()),
            ("inverse_inertia", self.inverse_inertia.len()),
            ("rest_position", self.rest_position.len()),
            ("frame", self.frame.len()),
            ("radii", self.radii.len()),
        ];
        for (what, found) in lengths {
            if found != count {
                return Err(StateError::Length { what, found, expected: count });
            }
        }
        if !(self.reaction.is_empty() || self.reaction.len() == count) {
            return Err(StateError::Length { what: "reaction", found: self.reaction.len(), expected: count });
        }
        let vectors = [
            ("position", &self.position),
            ("velocity", &self.velocity),
            ("angular_velocity", &self.angular_velocity),
            ("radii", &self.radii),
            ("rest_position", &self.rest_position),
            ("reaction", &self.reaction),
        ];
        for (what, list) in vectors {
            if sum_of_nothing(list, Vec3A::ZERO, |v| v * 0.0) != Vec3A::ZERO {
                return Err(not_finite(what, list.iter().map(|v| v.is_finite())));
            }
        }
        let numbers = [
            ("mass", &self.mass),
            ("inverse_mass", &self.inverse_mass),
            ("inertia", &self.inertia),
            ("inverse_inertia", &self.inverse_inertia),
        ];
        for (what, list) in numbers {
            if sum_of_nothing(list, 0.0, |v| v * 0.0) != 0.0 {
                return Err(not_finite(what, list.iter().map(|v| v.is_finite())));
            }
        }
        check_rotations("rotation", &self.rotation)?;
        check_rotations("frame", &self.frame)
    }
}

/// NaN and infinity survive being multiplied by zero; so the sum of it all has to be looked at only once. In four sums that do not wait for each other.
fn sum_of_nothing<T: Copy + Add<Output = T>>(list: &[T], zero: T, times_zero: impl Fn(T) -> T) -> T {
    let (fours, rest) = list.as_chunks::<4>();
    let [a, b, c, d] = fours.iter().fold([zero; 4], |sums, four| core::array::from_fn(|k| sums[k] + times_zero(four[k])));
    rest.iter().fold((a + b) + (c + d), |sum, &v| sum + times_zero(v))
}

fn not_finite(what: &'static str, mut finite: impl Iterator<Item = bool>) -> StateError {
    StateError::NotFinite { particle: finite.position(|fine| !fine).unwrap_or(0), what }
}

fn check_rotations(what: &'static str, list: &[Quat]) -> Result<(), StateError> {
    for (particle, q) in list.iter().enumerate() {
        let square = q.length_squared();
        if !(0.25..=4.0).contains(&square) {
            return Err(match q.is_finite() {
                true => StateError::Rotation { particle, what, length: q.length() },
                false => StateError::NotFinite { particle, what },
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::line;

    #[test]
    fn what_is_wrong_is_named() {
        let spoil: [(fn(&mut Particles), &str); 10] = [
            (|p| p.mass[5] = f32::NAN, "particle 5: mass is not finite"),
            (|p| p.position[2].y = f32::NAN, "particle 2: position is not finite"),
            (|p| p.velocity[1] = Vec3A::NEG_INFINITY, "particle 1: velocity is not finite"),
            (|p| p.angular_velocity[3].x = f32::NAN, "particle 3: angular_velocity is not finite"),
            (|p| p.inverse_mass[0] = f32::INFINITY, "particle 0: inverse_mass is not finite"),
            (|p| p.rotation[1] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), "particle 1: rotation has the length 0, which should be 1"),
            (|p| p.frame[1].w = f32::NAN, "particle 1: frame is not finite"),
            (|p| p.radii.truncate(3), "radii has 3 entries for 6 particles"),
            (|p| p.velocity.push(Vec3A::ZERO), "velocity has 7 entries for 6 particles"),
            (|p| p.reaction.push(Vec3A::ZERO), "reaction has 1 entries for 6 particles"),
        ];
        let good = line(6, 1.0, 0.1);
        assert_eq!(good.check(6), Ok(()));
        assert!(good.check(3).is_err());
        for (spoil, message) in spoil {
            let mut bad = good.clone();
            spoil(&mut bad);
            assert_eq!(bad.check(6).unwrap_err().to_string(), message);
        }
    }
}
