//! Numbers on the command line, in their ranges.

fn checked(text: &str, holds: impl Fn(f64) -> bool, range: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if holds(x) => Ok(x),
        Ok(x) => Err(format!("{x} is not {range}")),
        Err(error) => Err(error.to_string()),
    }
}

/// Above 0 and finite, as an `f64`.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    checked(text, |x| x > 0.0 && x.is_finite(), "positive and finite")
}

/// Above 0 and finite, as an `f32` too.
pub(crate) fn positive_f32(text: &str) -> Result<f32, String> {
    checked(text, |x| (x as f32) > 0.0 && (x as f32).is_finite(), "positive and finite").map(|x| x as f32)
}

/// Finite.
pub(crate) fn finite(text: &str) -> Result<f32, String> {
    checked(text, |x| (x as f32).is_finite(), "finite").map(|x| x as f32)
}

/// A duration that ends some day \[s\].
pub(crate) fn seconds(text: &str) -> Result<f32, String> {
    checked(text, |x| x > 0.0 && x <= 1e5, "between 0 and 100000").map(|x| x as f32)
}
