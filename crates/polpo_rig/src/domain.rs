//! Where particles may lie, and how far apart they want to be there: what tells one placement from another.
//!
//! Particles are for bending: a thin arm needs them close together, a thick mantle doesn't. By default the spacing follows the cube
//! root of the thickness, down to a third of the widest; along the middle of limbs it follows the thickness itself, so that a chain
//! of ellipsoids is as thick as it is long, link by link.

use crate::Placement;
use crate::flood::{BLOCKED, HEAVIEST, UNIT};
use crate::thickness::Thickness;
use crate::voxels::{STEPS_A_VOXEL, Voxels};

/// The closest that particles lie by default, as a weight.
const CLOSEST: u32 = 3 * UNIT;

/// The middle is where a voxel is so deep, as a share of the depth that vouches for it, tried from the narrowest on …
const MIDDLES: [f64; 4] = [0.9, 0.7, 0.5, 0.3];
/// … until particles are at least this share of the local depth apart. Closer ones crowd: then there is room beside the middle.
const CROWDED: f64 = 0.6;

/// The voxels that may hold a particle, and how finely they are spread.
pub(crate) struct Domain {
    /// The weight of every voxel: distances through it count `weight / UNIT` times, so cells become smaller by that factor. [`BLOCKED`] leads nowhere.
    pub(crate) weights: Vec<u32>,
    /// Which voxels may hold a particle, all if empty; and from which distance on they crowd, and the next, wider choice is taken.
    pub(crate) sites: Vec<(Vec<bool>, u32)>,
    /// Whether only the skin is divided, and the inside goes with it.
    pub(crate) shell: bool,
}

impl Domain {
    pub(crate) fn new(voxels: &Voxels, placement: Placement) -> Domain {
        let everywhere = || (Vec::new(), 0);
        let even = || vec![UNIT; voxels.len()];
        match placement {
            Placement::Volume => Domain { weights: even(), sites: vec![everywhere()], shell: false },
            Placement::Surface => {
                let skin: Vec<bool> = (0..voxels.len() as u32).map(|v| voxels.is_skin(v)).collect();
                let weights = skin.iter().map(|&s| if s { UNIT } else { BLOCKED }).collect();
                Domain { weights, sites: vec![(skin, 0)], shell: true }
            }
            Placement::Auto => {
                let Thickness { thickness, thickest, .. } = Thickness::new(voxels);
                let weight = |t: u32| {
                    let factor = libm::cbrt(f64::from(thickest) / f64::from(t));
                    ((f64::from(UNIT) * factor) as u32).min(CLOSEST)
                };
                Domain { weights: thickness.into_iter().map(weight).collect(), sites: vec![everywhere()], shell: false }
            }
            Placement::Medial => {
                let Thickness { depth, thickness, thickest } = Thickness::new(voxels);
                let weights = thickness.iter().map(|&t| (UNIT * thickest / t).min(HEAVIEST)).collect();
                let crowded = (CROWDED * f64::from(thickest)) as u32;
                let middle = |share: f64| depth.iter().zip(&thickness).map(|(&d, &t)| f64::from(d) >= share * f64::from(t)).collect();
                let mut sites: Vec<(Vec<bool>, u32)> = MIDDLES.iter().map(|&share| (middle(share), crowded)).collect();
                sites.push(everywhere());
                Domain { weights, sites, shell: false }
            }
        }
    }

    /// As many particles as there are voxels for.
    pub(crate) fn room(&self) -> usize {
        let all = self.weights.len();
        self.sites.iter().map(|(sites, _)| if sites.is_empty() { all } else { sites.iter().filter(|&&s| s).count() }).max().unwrap_or(0)
    }

    /// A distance in the unit box as it counts here on average, in steps.
    pub(crate) fn steps(&self, voxels: &Voxels, distance: f64) -> f64 {
        let open = || self.weights.iter().filter(|&&w| w != BLOCKED);
        let mean = open().map(|&w| f64::from(w)).sum::<f64>() / open().count().max(1) as f64;
        distance / voxels.size * STEPS_A_VOXEL * mean / f64::from(UNIT)
    }
}
