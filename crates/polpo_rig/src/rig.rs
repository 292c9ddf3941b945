//! The rig: what is simulated, and how the mesh follows it.

use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};

use crate::{Mesh, MeshHash, RigError, RigFault};

/// An immutable soft-body rig, shared by all bodies made from it. In the mesh's own unit and axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// The mesh this rig was built for.
    pub mesh_hash: MeshHash,
    /// The oriented particles, at least one.
    pub particles: Vec<Particle>,
    /// Pairs of particles (i, j) with i < j, sorted, unique.
    pub edges: Vec<[u32; 2]>,
    /// The particles each vertex of the mesh follows, one entry a mesh vertex.
    pub skin: Vec<Influences>,
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Influences {
    /// Particle indices. An unused slot repeats slot 0's particle.
    pub particles: [u32; 4],
    /// Weights, not negative, with sum 1. An unused slot has 0.
    pub weights: [f32; 4],
}

impl Rig {
    /// Checks that the rig is whole: every number in its range, every index in its list, weights with sum 1 (within 1e-5).
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
        particle_faults.or_else(edge_faults).or_else(skin_faults)
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
    fn fault(&self, vertex: usize, particles: usize) -> Option<RigFault> {
        for slot in 0..4 {
            let (particle, weight) = (self.particles[slot], self.weights[slot]);
            if particle as usize >= particles {
                return Some(RigFault::InfluenceIndex { vertex, slot, particle, particles });
            }
            if !(weight.is_finite() && weight >= 0.0) {
                return Some(RigFault::Weight { vertex, slot, weight });
            }
        }
        let sum = self.weights.iter().sum::<f32>();
        ((sum - 1.0).abs() > 1e-5).then_some(RigFault::WeightSum { vertex, sum })
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
            skin: vec![Influences { particles: [0, 1, 0, 0], weights: [0.75, 0.25, 0.0, 0.0] }],
        }
    }

    /// One breach of the rig's rules, and the error that must name it.
    type Breach = (fn(&mut Rig), &'static str);

    #[test]
    fn every_fault_is_named() {
        assert!(rig().validate().is_ok());
        let breaches: [Breach; 12] = [
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
        ];
        for (breach, message) in breaches {
            let mut broken = rig();
            breach(&mut broken);
            let error = broken.validate().map_err(|e| e.to_string());
            assert_eq!(error, Err(message.to_string()));
        }
    }
}
