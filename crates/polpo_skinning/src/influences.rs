//! The particles a vertex follows, packed: four to a record, and for those that follow more a second record.

use bytemuck::{Pod, Zeroable};

use crate::BindingError;

/// The most particles a vertex can follow.
pub const MOST_INFLUENCES: usize = 8;

/// How far weights may be from summing to one \[1\] before a vertex is refused. Within it they are scaled to one.
pub const WEIGHT_SUM_TOLERANCE: f32 = 1e-3;

/// Four influences: 16 bytes, read word by word by the shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct FourInfluences {
    /// Four particle indices of 16 bits, the lower half of each word first.
    pub particles: [u32; 2],
    /// Four weights in units of 1/65535, likewise.
    pub weights: [u32; 2],
}

impl FourInfluences {
    /// The index of influence `slot` (0 to 3).
    pub fn particle(&self, slot: usize) -> u32 {
        half(self.particles, slot)
    }

    /// The weight of influence `slot` (0 to 3) \[1\].
    pub fn weight(&self, slot: usize) -> f32 {
        half(self.weights, slot) as f32 / 65535.0
    }

    /// The indices of all four.
    pub(crate) fn particles(&self) -> [u16; 4] {
        halves(self.particles)
    }

    /// The weights of all four \[1\], but for the last bit.
    pub(crate) fn weights(&self) -> [f32; 4] {
        halves(self.weights).map(|weight| f32::from(weight) * (1.0 / 65535.0))
    }

    pub(crate) fn weighs_nothing(&self) -> bool {
        self.weights == [0; 2]
    }
}

/// The four halves of two words, in one instruction.
fn halves(words: [u32; 2]) -> [u16; 4] {
    bytemuck::cast::<[u32; 2], [u16; 4]>(words.map(u32::to_le)).map(u16::from_le)
}

fn half(words: [u32; 2], slot: usize) -> u32 {
    (words[slot >> 1] >> ((slot & 1) * 16)) & 0xffff
}

/// Packs up to eight influences of `vertex`: the first four, and the others. Unused slots weigh nothing and repeat slot 0's particle.
///
/// The weights of both together sum to exactly 65535 units. Particle indices have been checked to fit 16 bits.
pub(crate) fn pack<const N: usize>(vertex: usize, particles: [u32; N], weights: [f32; N]) -> Result<[FourInfluences; 2], BindingError> {
    const { assert!(0 < N && N <= MOST_INFLUENCES, "a vertex follows one to eight particles") };
    let units = quantise(vertex, weights)?;
    let particle = |slot: usize| particles[if slot < N { slot } else { 0 }];
    let unit = |slot: usize| if slot < N { units[slot] } else { 0 };
    Ok([0, 4].map(|k| FourInfluences {
        particles: [particle(k) | particle(k + 1) << 16, particle(k + 2) | particle(k + 3) << 16],
        weights: [unit(k) | unit(k + 1) << 16, unit(k + 2) | unit(k + 3) << 16],
    }))
}

/// Weights in units of 1/65535 that sum to exactly 65535; the largest takes what rounding left.
fn quantise<const N: usize>(vertex: usize, weights: [f32; N]) -> Result<[u32; N], BindingError> {
    for (slot, &weight) in weights.iter().enumerate() {
        if !weight.is_finite() || weight < 0.0 {
            return Err(BindingError::Weight { vertex, slot, weight });
        }
    }
    let sum: f32 = weights.iter().sum();
    if (sum - 1.0).abs() > WEIGHT_SUM_TOLERANCE {
        return Err(BindingError::WeightSum { vertex, sum });
    }
    let mut units = weights.map(|weight| (weight / sum * 65535.0 + 0.5).floor() as u32);
    let mut largest = 0;
    for slot in 1..N {
        if units[slot] > units[largest] {
            largest = slot;
        }
    }
    // The largest is at least an eighth of the whole and the rounding of the others at most 4 units, so this neither wraps nor goes negative.
    let others: u32 = units.iter().sum::<u32>() - units[largest];
    units[largest] = 65535 - others;
    Ok(units)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_after_packing() {
        for weights in
            [[0.25; 4], [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0], [0.999_99, 0.000_01, 0.0, 0.0], [0.4, 0.3, 0.2, 0.1], [0.0, 0.0, 0.0, 1.0]]
        {
            let units = quantise(0, weights).expect("valid weights");
            assert_eq!(units.iter().sum::<u32>(), 65535);
            for (unit, weight) in units.iter().zip(weights) {
                assert!((*unit as f32 / 65535.0 - weight).abs() <= 3.0 / 131_070.0);
            }
        }
        let units = quantise(0, [0.125; 8]).expect("valid weights");
        assert_eq!(units.iter().sum::<u32>(), 65535);
        assert!(units.iter().all(|unit| unit.abs_diff(8192) <= 7), "{units:?}");
    }

    #[test]
    fn influences_come_back_from_both_records() {
        let weights = [0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.06, 0.04];
        let packed = pack(0, [7, 1, 65535, 3, 4, 5, 6, 2], weights).expect("valid influences");
        for (slot, (particle, weight)) in [7, 1, 65535, 3, 4, 5, 6, 2].into_iter().zip(weights).enumerate() {
            assert_eq!(packed[slot / 4].particle(slot % 4), particle);
            assert!((packed[slot / 4].weight(slot % 4) - weight).abs() < 5e-5);
        }
        let four = pack(0, [7, 1, 65535, 3], [0.4, 0.3, 0.2, 0.1]).expect("valid influences");
        assert!(four[1].weighs_nothing());
        assert_eq!(
            pack(0, [7, 1, 65535, 3, 7, 7, 7, 7], [0.4, 0.3, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0]),
            Ok(four),
            "eight slots of which four are used"
        );
    }
}
