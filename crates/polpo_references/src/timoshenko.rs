//! Timoshenko's beam of squares, 1 m long and clamped at x = 0, in stations.

/// A beam's side at each place, and what it is made of.
pub(crate) struct Beam {
    pub(crate) side: fn(f64) -> f64,
    /// Young's and shear modulus \[Pa\].
    pub(crate) moduli: [f64; 2],
    pub(crate) density: f64,
}

const STATIONS: usize = 1000;

impl Beam {
    /// The integral from the wall to the middle of each station.
    fn sum(values: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut sum = 0.0;
        let step = |v: f64| {
            let middle = sum + 0.5 * v / STATIONS as f64;
            sum += v / STATIONS as f64;
            middle
        };
        values.map(step).collect()
    }

    fn from_end(values: &[f64]) -> Vec<f64> {
        let mut sums = Self::sum(values.iter().rev().copied());
        sums.reverse();
        sums
    }

    fn sides(&self) -> impl Iterator<Item = f64> {
        (0..STATIONS).map(|k| (self.side)((k as f64 + 0.5) / STATIONS as f64))
    }

    /// Weight in a field of 1 m/s² \[N/m\].
    pub(crate) fn weight(&self) -> Vec<f64> {
        self.sides().map(|a| self.density * a * a).collect()
    }

    /// How far it bends and shears under `load` \[N/m\].
    pub(crate) fn bend(&self, load: &[f64]) -> Vec<f64> {
        let [e, g] = self.moduli;
        let shear = Self::from_end(load);
        let moment = Self::from_end(&shear);
        let turn = Self::sum(moment.iter().zip(self.sides()).map(|(m, a)| m * 12.0 / (e * a * a * a * a)));
        Self::sum(turn.iter().zip(&shear).zip(self.sides()).map(|((turn, v), a)| turn + v / (5.0 / 6.0 * g * a * a)))
    }

    pub(crate) fn stretch(&self, load: &[f64]) -> Vec<f64> {
        Self::sum(Self::from_end(load).iter().zip(self.sides()).map(|(f, a)| f / (self.moduli[0] * a * a)))
    }

    /// Turn about the axis under a torque of 1 N·m at the end.
    pub(crate) fn twist(&self) -> Vec<f64> {
        Self::sum(self.sides().map(|a| 1.0 / (self.moduli[1] * 0.1406 * a * a * a * a)))
    }

    /// ω² of the first mode.
    pub(crate) fn first_mode(&self) -> f64 {
        let mut u: Vec<f64> = vec![1.0; STATIONS];
        let mut omega2 = 0.0;
        for _ in 0..20 {
            let load: Vec<f64> = u.iter().zip(self.weight()).map(|(u, w)| u * w).collect();
            let next = self.bend(&load);
            let dot = |a: &[f64]| a.iter().zip(&load).map(|(a, f)| a * f).sum::<f64>();
            omega2 = dot(&u) / dot(&next);
            let largest = next[STATIONS - 1];
            u = next.iter().map(|u| u / largest).collect();
        }
        omega2
    }

    pub(crate) fn at(field: &[f64], x: f64) -> f64 {
        let k = (x * STATIONS as f64 - 0.5).clamp(0.0, (STATIONS - 1) as f64);
        let low = (k as usize).min(STATIONS - 2);
        field[low] + (field[low + 1] - field[low]) * (k - low as f64)
    }
}
