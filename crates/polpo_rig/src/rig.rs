//! The rig: what is simulated, and how the mesh follows it.

use std::fmt;

use glam::{Quat, Vec3};
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::cells::Cells;
use crate::recipe::MOST_INFLUENCES;
use crate::region::{GroupKind, Region};
use crate::{Mesh, MeshHash, RigError, RigFault};

/// An immutable soft-body rig, shared by all bodies made from it. In the mesh's own unit and axes.
///
/// The fields are public, so that a tool can change a rig by hand; [`validate`](Rig::validate) says what then has to hold.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// The mesh this rig was built for.
    pub mesh_hash: MeshHash,
    /// The oriented particles, at least one.
    pub particles: Vec<Particle>,
    /// Pairs of particles (i, j) with i < j, sorted, unique.
    pub edges: Vec<[u32; 2]>,
    /// The particles each vertex of the mesh follows, one entry a mesh vertex.
    pub skin: Vec<Influences>,
    /// Parts that are not like the rest; a particle is in one at most.
    pub regions: Vec<Region>,
    /// What makes the body as stiff as a material, if it is to be.
    pub cells: Option<Cells>,
}

/// One oriented particle at rest: an ellipsoid of mass.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Particle {
    /// Centre \[m\].
    pub position: Vec3,
    /// The principal axes at rest: turns x, y, z into the directions of `radii`. A unit quaternion.
    ///
    /// This is the shape's frame, not the particle's orientation: orientations are relative to rest, the identity there.
    pub frame: Quat,
    /// Half axes along the frame's x, y, z \[m\], positive.
    pub radii: Vec3,
    /// Mass \[kg\], positive.
    pub mass: f32,
}

/// The particles a vertex follows, heaviest first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Influences {
    /// Particle indices. An unused slot repeats slot 0's particle.
    pub particles: [u32; MOST_INFLUENCES],
    /// Weights, not negative, with sum 1 (within 1e-6). An unused slot has 0.
    pub weights: [f32; MOST_INFLUENCES],
}

impl Rig {
    /// Checks that the rig is whole: every number in its range, every index in its list, weights with sum 1 (within 1e-6).
    ///
    /// # Errors
    /// [`RigError::Invalid`] with the first [`RigFault`] found, which names the item and its index.
    pub fn validate(&self) -> Result<(), RigError> {
        self.validate_as("rig")
    }

    pub(crate) fn validate_as(&self, name: &str) -> Result<(), RigError> {
        self.fault().map_or(Ok(()), |fault| Err(RigError::Invalid { name: name.into(), fault }))
    }

    fn fault(&self) -> Option<RigFault> {
        let particles = self.particles.len();
        if particles == 0 {
            return Some(RigFault::NoParticles);
        }
        if u32::try_from(particles).is_err() {
            return Some(RigFault::TooLarge { item: "particles", count: particles });
        }
        let particle_faults = self.particles.iter().enumerate().find_map(|(i, p)| p.fault(i));
        let edge_faults = || {
            self.edges.iter().enumerate().find_map(|(edge, &[first, second])| {
                if let Some(&particle) = [first, second].iter().find(|&&p| p as usize >= particles) {
                    return Some(RigFault::EdgeIndex { edge, particle, particles });
                }
                if first >= second {
                    return Some(RigFault::EdgeOrder { edge, first, second });
                }
                let sorted = edge == 0 || self.edges[edge - 1] < [first, second];
                (!sorted).then_some(RigFault::EdgesUnsorted { edge })
            })
        };
        let skin_faults = || self.skin.iter().enumerate().find_map(|(v, i)| i.fault(v, particles));
        let region_faults = || self.region_fault();
        let cell_faults = || self.cells.as_ref().and_then(|cells| cells.fault(particles));
        particle_faults.or_else(edge_faults).or_else(skin_faults).or_else(region_faults).or_else(cell_faults)
    }

    fn region_fault(&self) -> Option<RigFault> {
        let particles = self.particles.len();
        let mut taken = vec![false; particles];
        self.regions.iter().enumerate().find_map(|(region, r)| {
            let fault = |what| Some(RigFault::Region { region, what });
            for (at, &particle) in r.particles.iter().enumerate() {
                if particle as usize >= particles {
                    return fault("it names a particle that is not there");
                }
                if at > 0 && r.particles[at - 1] >= particle {
                    return fault("its particles are not sorted and unique");
                }
                if core::mem::replace(&mut taken[particle as usize], true) {
                    return fault("it has a particle that another region has");
                }
            }
            if r.friction.is_some_and(|f| !(f.is_finite() && f >= 0.0)) {
                return fault("its friction is negative or not finite");
            }
            let soft = match r.group {
                Some(GroupKind::Soft(spring)) => Some(spring),
                _ => None,
            };
            let broken = [r.stiffness, soft].iter().flatten().any(|spring| !spring.is_valid());
            if broken { fault("its stiffness is out of range") } else { None }
        })
    }

    /// Checks that this rig was built for `mesh`.
    ///
    /// # Errors
    /// [`RigError::VertexCount`] or [`RigError::MeshHash`].
    pub fn check_mesh(&self, mesh: &Mesh) -> Result<(), RigError> {
        let name = || mesh.name.clone();
        if self.skin.len() != mesh.positions.len() {
            return Err(RigError::VertexCount { name: name(), expected: self.skin.len(), found: mesh.positions.len() });
        }
        let found = mesh.hash();
        if found != self.mesh_hash {
            return Err(RigError::MeshHash { name: name(), expected: self.mesh_hash, found });
        }
        Ok(())
    }
}

impl Particle {
    fn fault(&self, particle: usize) -> Option<RigFault> {
        if !self.position.is_finite() {
            return Some(RigFault::Position { particle });
        }
        // Written so that a NaN length fails.
        let unit = (self.frame.length_squared() - 1.0).abs() <= 2e-4;
        if !unit {
            return Some(RigFault::Frame { particle });
        }
        if let Some(axis) = self.radii.to_array().iter().position(|r| !(r.is_finite() && *r > 0.0)) {
            return Some(RigFault::Radius { particle, axis, radius: self.radii[axis] });
        }
        let mass = self.mass;
        (!(mass.is_finite() && mass > 0.0)).then_some(RigFault::Mass { particle, mass })
    }
}

impl Influences {
    /// One particle, wholly.
    pub fn whole(particle: u32) -> Influences {
        Influences { particles: [particle; MOST_INFLUENCES], weights: core::array::from_fn(|slot| f32::from(u8::from(slot == 0))) }
    }

    /// Those of the `weighted` particles that weigh most, in the order of their weights, scaled to sum 1. None, or none that weighs anything: [`whole`](Influences::whole) of the first, or of particle 0.
    pub fn new(weighted: &[(u32, f64)]) -> Influences {
        let mut sorted: Vec<(u32, f64)> = weighted.iter().copied().filter(|w| w.1 > 0.0 && w.1.is_finite()).collect();
        sorted.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        sorted.truncate(MOST_INFLUENCES);
        let sum: f64 = sorted.iter().map(|w| w.1).sum();
        let Some(&(heaviest, _)) = sorted.first() else { return Influences::whole(weighted.first().map_or(0, |w| w.0)) };
        let mut this = Influences { particles: [heaviest; MOST_INFLUENCES], weights: [0.0; MOST_INFLUENCES] };
        for (slot, (particle, weight)) in sorted.into_iter().enumerate() {
            let weight = (weight / sum) as f32;
            if weight > 0.0 {
                this.particles[slot] = particle;
                this.weights[slot] = weight;
            }
        }
        // What rounding to f32 took, the heaviest gives back, as long as it stays that.
        this.weights[0] = (1.0 - this.weights[1..].iter().sum::<f32>()).max(this.weights[1]);
        this
    }

    /// The particles that it follows, with their weights.
    pub fn used(&self) -> impl Iterator<Item = (u32, f32)> {
        self.particles.into_iter().zip(self.weights).filter(|w| w.1 != 0.0)
    }

    fn fault(&self, vertex: usize, particles: usize) -> Option<RigFault> {
        for slot in 0..MOST_INFLUENCES {
            let (particle, weight) = (self.particles[slot], self.weights[slot]);
            if particle as usize >= particles {
                return Some(RigFault::InfluenceIndex { vertex, slot, particle, particles });
            }
            if !(weight.is_finite() && weight >= 0.0) {
                return Some(RigFault::Weight { vertex, slot, weight });
            }
        }
        let sum = self.weights.iter().sum::<f32>();
        let whole = (sum - 1.0).abs() <= 1e-6;
        (!whole).then_some(RigFault::WeightSum { vertex, sum })
    }
}

/// In a file an influence is the list of those in use, (particle, weight).
impl Serialize for Influences {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.used().collect::<Vec<_>>())
    }
}

impl<'de> Deserialize<'de> for Influences {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Influences, D::Error> {
        struct List;

        impl<'de> Visitor<'de> for List {
            type Value = Influences;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "1 to {MOST_INFLUENCES} particles with their weights")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Influences, A::Error> {
                let first: (u32, f32) = list.next_element()?.ok_or_else(|| A::Error::invalid_length(0, &self))?;
                let mut this = Influences::whole(first.0);
                this.weights[0] = first.1;
                let mut slot = 1;
                while let Some((particle, weight)) = list.next_element()? {
                    if slot == MOST_INFLUENCES {
                        return Err(A::Error::invalid_length(slot + 1, &self));
                    }
                    (this.particles[slot], this.weights[slot]) = (particle, weight);
                    slot += 1;
                }
                Ok(this)
            }
        }

        deserializer.deserialize_seq(List)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> Rig {
        let particle = Particle { position: Vec3::ZERO, frame: Quat::IDENTITY, radii: Vec3::ONE, mass: 1.0 };
        Rig {
            mesh_hash: MeshHash(1),
            particles: vec![particle; 3],
            edges: vec![[0, 1], [1, 2]],
            skin: vec![Influences::new(&[(0, 0.75), (1, 0.25)])],
            regions: vec![Region { name: "tail".into(), particles: vec![1, 2], ..Region::default() }],
            cells: None,
        }
    }

    /// One breach of the rig's rules, and the error that must name it.
    type Breach = (fn(&mut Rig), &'static str);

    #[test]
    fn every_fault_is_named() {
        assert!(rig().validate().is_ok());
        let breaches: [Breach; 16] = [
            (|r| r.particles.clear(), "rig: there are no particles"),
            (|r| r.particles[1].position.y = f32::NAN, "rig: particle 1: position is not finite"),
            (|r| r.particles[2].frame.x = 0.1, "rig: particle 2: frame is not a unit quaternion"),
            (|r| r.particles[2].frame.w = f32::NAN, "rig: particle 2: frame is not a unit quaternion"),
            (|r| r.particles[0].radii.z = 0.0, "rig: particle 0: radius 2 is 0, must be finite and positive"),
            (|r| r.particles[0].mass = -1.0, "rig: particle 0: mass is -1, must be finite and positive"),
            (|r| r.edges[1] = [1, 3], "rig: edge 1 points to particle 3, but there are 3"),
            (|r| r.edges[1] = [2, 1], "rig: edge 1 is (2, 1), the first index must be the smaller"),
            (|r| r.edges[1] = [0, 1], "rig: edge 1 does not come after edge 0: edges must be sorted and unique"),
            (|r| r.skin[0].particles[3] = 9, "rig: vertex 0, influence 3 points to particle 9, but there are 3"),
            (|r| r.skin[0].weights[1] = f32::INFINITY, "rig: vertex 0, influence 1: weight is inf, must be finite and not negative"),
            (|r| r.skin[0].weights[1] = 0.5, "rig: vertex 0: weights sum to 1.25, must be 1"),
            (|r| r.regions[0].particles = vec![2, 1], "rig: region 0: its particles are not sorted and unique"),
            (|r| r.regions[0].particles = vec![3], "rig: region 0: it names a particle that is not there"),
            (|r| r.regions.push(r.regions[0].clone()), "rig: region 1: it has a particle that another region has"),
            (|r| r.regions[0].friction = Some(-1.0), "rig: region 0: its friction is negative or not finite"),
        ];
        for (breach, message) in breaches {
            let mut broken = rig();
            breach(&mut broken);
            let error = broken.validate().map_err(|e| e.to_string());
            assert_eq!(error, Err(message.to_string()));
        }
    }
}
