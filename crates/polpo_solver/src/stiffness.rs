//! Stiffness: in hertz with a damping ratio, or the paper's bare share; and what of it acts in one sweep.

use core::f32::consts::TAU;

/// How strongly a constraint pulls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// As the spring on which the constraint's own error would swing: the same at every time step, and, with stored multipliers, at every number of iterations.
    Hertz {
        /// Frequency f \[Hz\]. Range 0 (off) to infinity (rigid). As f·Δt grows past about 0.3 frequencies can no longer be told apart: take more substeps. Negative and NaN count as 0.
        frequency: f32,
        /// Damping ratio ζ of that spring: 0 swings for ever, 1 comes back without overshooting. Range 0 to infinity (the error keeps its size). Negative and NaN count as 0.
        damping_ratio: f32,
    },
    /// The share of its error that one sweep corrects, 0 … 1, as in the 2011 paper: what it means depends on the time step and on the number of sweeps. Values outside are clamped, NaN counts as 0.
    Fraction(f32),
}

impl Stiffness {
    /// No pull at all.
    pub const OFF: Self = Self::hertz(0.0);
    /// As stiff as a sweep can make it.
    pub const RIGID: Self = Self::hertz(f32::INFINITY);

    /// An undamped spring of `frequency` \[Hz\].
    pub const fn hertz(frequency: f32) -> Self {
        Self::Hertz { frequency, damping_ratio: 0.0 }
    }

    /// A spring of `frequency` \[Hz\] with the damping ratio `damping_ratio`.
    pub const fn damped(frequency: f32, damping_ratio: f32) -> Self {
        Self::Hertz { frequency, damping_ratio }
    }

    /// What acts of it in a substep of `dt` \[s\].
    ///
    /// The spring x″ = −ω₀²·e − 2ζω₀·ė with error e, stepped by implicit Euler from the predicted position, moves by δ = (κ·e + d·(e − e_before) − Λ)/(1 + κ + d), with κ = (ω₀Δt)², d = 2ζω₀Δt
    /// and Λ what the constraint has already moved in this substep. With one sweep a substep Λ = 0 and, undamped, δ = κ/(1 + κ)·e: 2 Hz becomes 1.89, 1.97, 1.998, 2.000 Hz at 30, 60, 240, 960 Hz. A
    /// bare share s per sweep gives asin(√s)/Δt instead.
    pub fn share(self, dt: f32) -> Share {
        match self {
            Self::Fraction(s) => Share { stiffness: if s > 0.0 { s.min(1.0) } else { 0.0 }, damping: 0.0, memory: 0.0 },
            Self::Hertz { frequency, damping_ratio } => {
                let x = TAU * frequency * dt;
                let kappa = x * x;
                // Also for NaN, and for a square that under- or overflows.
                if !(frequency > 0.0 && dt > 0.0 && kappa > 0.0) {
                    return Share { stiffness: 0.0, damping: 0.0, memory: 0.0 };
                }
                let d = if damping_ratio > 0.0 { 2.0 * damping_ratio * x } else { 0.0 };
                if !kappa.is_finite() || frequency == f32::INFINITY {
                    return Share { stiffness: 1.0, damping: 0.0, memory: 0.0 };
                }
                let sum = 1.0 + kappa + d;
                if !sum.is_finite() {
                    return Share { stiffness: 0.0, damping: 1.0, memory: 0.0 };
                }
                Share { stiffness: kappa / sum, damping: d / sum, memory: 1.0 / sum }
            }
        }
    }
}

/// What acts of a [`Stiffness`] in one sweep: a constraint with error e and multiplier Λ moves by stiffness·e + damping·(e − e_before) − memory·Λ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Of the error, 0 … 1.
    pub stiffness: f32,
    /// Of the error's change since the substep began, 0 … 1.
    pub damping: f32,
    /// Of what has been done before in this substep, 0 … 1.
    pub memory: f32,
}

impl Share {
    /// Whether it does nothing.
    #[inline]
    pub fn is_off(self) -> bool {
        self.stiffness <= 0.0 && self.damping <= 0.0
    }

    /// Whether it corrects the whole error at once, as what nothing can bend does; anything less is a spring. See [`restore_angular_momentum`](crate::restore_angular_momentum).
    #[inline]
    pub fn is_rigid(self) -> bool {
        self.stiffness >= 1.0
    }
}

/// The shares of a set of constraints.
#[derive(Clone, Copy, Debug)]
pub enum Shares<'a> {
    /// All the same.
    One(Share),
    /// One each, in the order of the particles for groups, of the edges for edges. Beyond the end counts as off.
    Each(&'a [Share]),
}

impl Shares<'_> {
    /// The share of constraint `i`.
    #[inline]
    pub fn of(self, i: usize) -> Share {
        match self {
            Self::One(share) => share,
            Self::Each(shares) => shares.get(i).copied().unwrap_or_default(),
        }
    }

    pub(crate) fn any_rigid(self) -> bool {
        match self {
            Self::One(share) => share.is_rigid(),
            Self::Each(shares) => shares.iter().any(|s| s.is_rigid()),
        }
    }

    /// Whether none does anything.
    pub fn are_off(self) -> bool {
        match self {
            Self::One(share) => share.is_off(),
            Self::Each(shares) => shares.iter().all(|s| s.is_off()),
        }
    }
}

impl From<Share> for Shares<'_> {
    fn from(share: Share) -> Self {
        Self::One(share)
    }
}

/// One pass over the constraints of a substep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Length of the substep \[s\], positive.
    pub dt: f32,
    /// Which pass of the substep, from 0.
    pub index: u32,
    /// How many there are. With one, nothing needs to be remembered from pass to pass.
    pub count: u32,
    /// Whether the last bits must be the same on every processor. Otherwise those that can multiply and add in one (x86 since 2013, 64-bit ARM) do so: it is faster, and rounded once instead of twice.
    pub deterministic: bool,
}

impl Sweep {
    /// The only pass of a substep of `dt` \[s\].
    pub const fn only(dt: f32) -> Self {
        Self { dt, index: 0, count: 1, deterministic: false }
    }

    /// Readies the multipliers of `len` constraints: none if there is one pass, zero at the first of several.
    pub(crate) fn ready<T: Clone + Default>(self, multipliers: &mut Vec<T>, len: usize) {
        if self.count <= 1 {
            multipliers.clear();
        } else if self.index == 0 || multipliers.len() != len {
            multipliers.clear();
            multipliers.resize(len, T::default());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_are_defined() {
        let share = |frequency: f32, dt: f32| Stiffness::hertz(frequency).share(dt).stiffness;
        assert_eq!(share(0.0, 0.01), 0.0);
        assert_eq!(share(-1.0, 0.01), 0.0);
        assert_eq!(share(f32::NAN, 0.01), 0.0);
        assert_eq!(share(f32::INFINITY, 0.01), 1.0);
        assert_eq!(share(1e30, 1.0), 1.0);
        assert_eq!(share(5.0, 0.0), 0.0);
        assert_eq!(Stiffness::Fraction(7.0).share(0.01).stiffness, 1.0);
        assert_eq!(Stiffness::Fraction(f32::NAN).share(0.01).stiffness, 0.0);
        assert_eq!(Stiffness::damped(5.0, f32::INFINITY).share(0.01).stiffness, 0.0);
        assert_eq!(Stiffness::damped(5.0, f32::NAN).share(0.01), Stiffness::hertz(5.0).share(0.01));
    }

    /// A point on a spring of 2 Hz swings at 2 Hz, at every step.
    #[test]
    fn frequency_survives_a_change_of_time_step() {
        for (rate, expected) in [(30.0, 1.89), (60.0, 1.97), (240.0, 1.998), (960.0, 2.0)] {
            let dt = 1.0 / rate;
            let s = Stiffness::hertz(2.0).share(dt).stiffness;
            let (mut x, mut v, mut crossings, mut last) = (1.0f32, 0.0f32, Vec::new(), 1.0f32);
            for step in 0..(rate as usize * 2) {
                let mut p = x + dt * v;
                p -= s * p;
                v = (p - x) / dt;
                x = p;
                if last * x < 0.0 {
                    // where the straight line between the two samples crosses zero
                    crossings.push((step as f32 + last / (last - x)) * dt);
                }
                last = x;
            }
            let measured = 0.5 * (crossings.len() - 1) as f32 / (crossings[crossings.len() - 1] - crossings[0]);
            assert!((measured - expected).abs() < 0.01, "{rate} Hz: {measured} against {expected}");
        }
    }
}
