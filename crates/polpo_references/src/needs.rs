//! What a rig's material asks of the solver.

use core::fmt;

use glam::{Quat, Vec3};
use polpo_rig::Rig;
use polpo_solver::CalibrationError;

use crate::cell_body::CellBody;

/// How many substeps a rig needs for its material, swept, and what fewer give.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialNeeds {
    /// Steps a second \[Hz\].
    pub rate: f32,
    /// Substeps a step for which the body is as stiff as its material, within about 5 % in sag and frequency.
    pub substeps: u32,
    /// Whether it is a limb, whose stretch is capped so that it takes fewer: [`Cells::limb`](polpo_rig::Cells::limb).
    pub limb: bool,
    /// Substeps it would need uncapped; the same if it is no limb.
    pub uncapped: u32,
    /// Fewer substeps, and by what share the edges then give too much on the average: three quarters, a half (below which what they do means nothing), and a quarter.
    pub fewer: Vec<(u32, f32)>,
}

/// What the cells of `rig` need at `rate` steps a second; `None` for a rig without.
///
/// # Errors
///
/// A material or a facet that cannot be calibrated, or a rate that is not positive and finite.
pub fn material_needs(rig: &Rig, rate: f32) -> Option<Result<MaterialNeeds, CalibrationError>> {
    let cells = rig.cells.as_ref()?;
    Some(needs(&CellBody::new(rig, cells, Quat::IDENTITY, Vec3::ZERO), rate))
}

fn needs(body: &CellBody, rate: f32) -> Result<MaterialNeeds, CalibrationError> {
    if !(rate > 0.0 && rate.is_finite()) {
        return Err(CalibrationError::Range { what: "the rate", value: rate, range: "not positive and finite" });
    }
    let (whole, capped) = (body.calibrate(false)?, body.calibrate(true)?);
    let dt = 1.0 / rate;
    let substeps = capped.edges.recommended_substeps(&capped.particles, dt);
    let fewer = [substeps * 3 / 4, substeps / 2, substeps / 4].map(|n| n.max(1));
    Ok(MaterialNeeds {
        rate,
        substeps,
        limb: body.limb.is_some(),
        uncapped: whole.edges.recommended_substeps(&whole.particles, dt),
        fewer: fewer.into_iter().filter(|&n| n < substeps).map(|n| (n, capped.edges.softness(&capped.particles, dt / n as f32))).collect(),
    })
}

impl fmt::Display for MaterialNeeds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} substeps at {} Hz", self.substeps, self.rate)?;
        if self.limb && self.uncapped > self.substeps {
            write!(f, " (as a limb whose stretch is softer; {} without that)", self.uncapped)?;
        }
        for (substeps, softness) in &self.fewer {
            write!(f, "; {substeps} give about {:.0} % too much", 100.0 * softness)?;
        }
        Ok(())
    }
}
