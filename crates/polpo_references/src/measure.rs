//! Reading numbers off a run, finer than its steps.

/// The times at which a series crosses zero, by straight lines between samples.
#[derive(Default)]
pub(crate) struct Crossings {
    last: Option<(f64, f64)>,
    pub(crate) times: Vec<f64>,
}

impl Crossings {
    pub(crate) fn sample(&mut self, time: f64, value: f64) {
        if let Some((t, v)) = self.last
            && v * value < 0.0
        {
            self.times.push(t + (time - t) * v / (v - value));
        }
        // A sample at zero belongs to the crossing of its neighbours.
        if value != 0.0 {
            self.last = Some((time, value));
        }
    }

    /// Of the `k`-th crossing, from 0; NaN if there were not so many.
    pub(crate) fn time(&self, k: usize) -> f64 {
        self.times.get(k).copied().unwrap_or(f64::NAN)
    }

    /// Twice the mean time between crossings \[s\]; NaN if there were fewer than two.
    pub(crate) fn period(&self) -> f64 {
        let n = self.times.len();
        if n < 2 { f64::NAN } else { 2.0 * (self.times[n - 1] - self.times[0]) / (n - 1) as f64 }
    }
}

/// A decaying oscillation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Swing {
    /// Angle a sample \[rad\].
    pub(crate) angle: f64,
    /// ln of the amplitude of a sample over that of the next.
    pub(crate) decrement: f64,
}

impl Swing {
    /// The oscillation about zero that equally spaced samples are of.
    ///
    /// x_k = Re(c·z^k) obeys x_{k+1} = a·x_k − b·x_{k−1} with a = 2·|z|·cos θ, b = |z|², whatever c; a and b by least squares. The angle a sample should be somewhere between 0.2 and 2.
    pub(crate) fn of(samples: &[f64]) -> Self {
        let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for w in samples.windows(3) {
            let (y, x, z) = (-w[0], w[1], w[2]);
            xx += x * x;
            xy += x * y;
            yy += y * y;
            xz += x * z;
            yz += y * z;
        }
        let det = xx * yy - xy * xy;
        let (a, b) = ((xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det);
        Self { angle: (0.5 * a / b.sqrt()).acos(), decrement: -0.5 * b.ln() }
    }
}

/// The order of convergence that two errors show, the second at a setting `ratio` times finer.
pub(crate) fn order(coarse: f64, fine: f64, ratio: f64) -> f64 {
    (coarse / fine).abs().ln() / ratio.ln()
}

/// The arithmetic-geometric mean.
pub(crate) fn agm(mut a: f64, mut b: f64) -> f64 {
    for _ in 0..8 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    a
}

/// Where `f` changes sign between `low` and `high`, to the last digit.
pub(crate) fn root(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let sign = f(low).signum();
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if f(middle).signum() == sign { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// How much a series changes from its first sample to its last, by the straight line of least squares: what swings about it hardly counts.
pub(crate) fn drift(series: &[f64]) -> f64 {
    let n = series.len() as f64;
    let mean = series.iter().sum::<f64>() / n;
    let (mut xy, mut xx) = (0.0, 0.0);
    for (k, y) in series.iter().enumerate() {
        let x = k as f64 / (n - 1.0) - 0.5;
        xy += x * (y - mean);
        xx += x * x;
    }
    xy / xx
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_is_read_to_many_digits() {
        let samples: Vec<f64> = (0..20).map(|k| (-0.05 * f64::from(k)).exp() * (0.7 * f64::from(k) + 0.3).cos()).collect();
        let swing = Swing::of(&samples);
        assert!((swing.angle - 0.7).abs() < 1e-12 && (swing.decrement - 0.05).abs() < 1e-12, "{swing:?}");
    }

    #[test]
    fn crossings_lie_between_samples() {
        let mut crossings = Crossings::default();
        for k in 0..=1000 {
            crossings.sample(0.01 * f64::from(k), (0.01 * f64::from(k) + 0.5).sin());
        }
        assert!((crossings.time(0) - (core::f64::consts::PI - 0.5)).abs() < 1e-6);
        assert!((crossings.period() - core::f64::consts::TAU).abs() < 1e-6 && crossings.time(9).is_nan());
        assert!(Crossings::default().period().is_nan());
    }

    #[test]
    fn drift_is_the_slope() {
        let series: Vec<f64> = (0..1001).map(|k| 2.0 + 0.003 * f64::from(k) + (0.5 * f64::from(k)).sin()).collect();
        assert!((drift(&series) - 3.0).abs() < 0.02);
    }
}
