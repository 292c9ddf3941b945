//! What ties a mesh to its particles and never changes: rest vertices, influences and per-particle extents, checked once and packed for both kernels.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::bounds::RestExtent;
use crate::influences::{FourInfluences, pack};

/// The most particles one binding can address: indices are packed into 16 bits.
pub const MAX_PARTICLES: usize = 1 << 16;

/// One rest vertex, packed: 40 bytes, read word by word by the shader.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RestVertex {
    /// Rest position relative to [`Binding::origin`] \[m\].
    pub position: [f32; 3],
    /// Rest normal as the mesh has it; zero where the mesh has none.
    pub normal: [f32; 3],
    /// The first four particles that it follows. Their weights, with those in [`Binding::more`], sum to exactly 65535.
    pub influences: FourInfluences,
}

/// The rest mesh as the engine has it. All slices are per vertex.
#[derive(Clone, Copy, Debug)]
pub struct RestMesh<'a> {
    /// Rest positions [m in the mesh's own units].
    pub positions: &'a [[f32; 3]],
    /// Rest normals, one per vertex, or empty: then no normals are written.
    pub normals: &'a [[f32; 3]],
    /// Rest tangents with the handedness in the fourth component (which skinning leaves alone), one per vertex, or empty.
    pub tangents: &'a [[f32; 4]],
}

/// Why a mesh cannot be bound to its particles.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BindingError {
    /// The mesh has no vertices, or the body no particles.
    #[error("nothing to skin: {vertices} vertices, {particles} particles")]
    Empty {
        /// Vertices of the mesh.
        vertices: usize,
        /// Particles of the body.
        particles: usize,
    },
    /// A per-vertex array is not as long as the mesh's positions.
    #[error("{what}: {found} entries for {vertices} vertices")]
    Length {
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        vertices: usize,
    },
    /// More particles than 16-bit indices can address.
    #[error("{found} particles; one body can have {MAX_PARTICLES}")]
    TooManyParticles {
        /// Particles of the body.
        found: usize,
    },
    /// A vertex follows a particle that does not exist.
    #[error("vertex {vertex}, influence {slot}: particle {particle} of {particles}")]
    ParticleIndex {
        /// Which vertex.
        vertex: usize,
        /// Which of its influences.
        slot: usize,
        /// The index given.
        particle: u32,
        /// How many particles there are.
        particles: usize,
    },
    /// A weight is not a number, infinite or negative.
    #[error("vertex {vertex}, influence {slot}: weight {weight}")]
    Weight {
        /// Which vertex.
        vertex: usize,
        /// Which of its influences.
        slot: usize,
        /// The weight given.
        weight: f32,
    },
    /// The weights of a vertex do not sum to one within [`WEIGHT_SUM_TOLERANCE`](crate::influences::WEIGHT_SUM_TOLERANCE).
    #[error("vertex {vertex}: its weights sum to {sum}, not 1")]
    WeightSum {
        /// Which vertex.
        vertex: usize,
        /// What they sum to.
        sum: f32,
    },
    /// A rest position, normal, tangent, particle position or the origin is not finite.
    #[error("{what} {index} is not finite")]
    NotFinite {
        /// Which array.
        what: &'static str,
        /// Which item.
        index: usize,
    },
}

/// A mesh bound to its particles: immutable, shared by every body of the same mesh and rig.
#[derive(Clone, Debug)]
pub struct Binding {
    origin: Vec3,
    vertices: Vec<RestVertex>,
    more: Vec<FourInfluences>,
    tangents: Vec<[f32; 3]>,
    has_normals: bool,
    particles: Vec<Vec3>,
    extents: Vec<RestExtent>,
}

impl Binding {
    /// Checks and packs.
    ///
    /// * `particles`: rest positions of the body's particles \[m\], in the mesh's own space; 1 to 65536.
    /// * `influences`: for each vertex N particle indices and N weights \[1\], N from 1 to [`MOST_INFLUENCES`](crate::MOST_INFLUENCES). Weights are finite, at least 0 and sum to 1; unused slots
    ///   have weight 0 and any valid index.
    ///
    /// Weights are rounded to 1/65535 such that they still sum to one exactly (the largest takes the rest): a rigid motion stays rigid, and a vertex is off by at most
    /// (N − 1)/131070 of the distance between its influences' opinions of where it belongs.
    ///
    /// As long as every vertex has its weights in the first four slots, a vertex is 40 bytes; else all of them take 16 more, and longer to skin.
    pub fn new<const N: usize>(
        mesh: RestMesh<'_>,
        particles: &[Vec3],
        influences: impl ExactSizeIterator<Item = ([u32; N], [f32; N])>,
    ) -> Result<Self, BindingError> {
        let mut positions = mesh.positions.iter().map(|&position| Vec3::from(position));
        let first = positions.next().unwrap_or_default();
        let (min, max) = positions.fold((first, first), |(min, max), position| (min.min(position), max.max(position)));
        Self::about(0.5 * min + 0.5 * max, mesh, particles, influences)
    }

    /// [`new`](Self::new) with rest data relative to `origin` [m, in the mesh's space] instead of the middle of the mesh's box. Meshes bound about the same origin to the same particles follow the
    /// same transforms.
    pub fn about<const N: usize>(
        origin: Vec3,
        mesh: RestMesh<'_>,
        particles: &[Vec3],
        influences: impl ExactSizeIterator<Item = ([u32; N], [f32; N])>,
    ) -> Result<Self, BindingError> {
        check_mesh(&mesh, particles, influences.len())?;
        if !origin.is_finite() {
            return Err(BindingError::NotFinite { what: "origin", index: 0 });
        }
        let particles: Vec<Vec3> = particles.iter().map(|particle| particle - origin).collect();

        let mut vertices = Vec::with_capacity(mesh.positions.len());
        let mut more = Vec::new();
        let mut extents = vec![RestExtent::NONE; particles.len()];
        for (vertex, (indices, weights)) in influences.enumerate() {
            let position = Vec3::from(mesh.positions[vertex]) - origin;
            for (slot, &particle) in indices.iter().enumerate() {
                let Some(rest) = particles.get(particle as usize) else {
                    return Err(BindingError::ParticleIndex { vertex, slot, particle, particles: particles.len() });
                };
                if weights[slot] > 0.0 {
                    extents[particle as usize].include(position, *rest);
                }
            }
            let [first, others] = pack(vertex, indices, weights)?;
            vertices.push(RestVertex {
                position: position.into(),
                normal: mesh.normals.get(vertex).copied().unwrap_or([0.0; 3]),
                influences: first,
            });
            // The first vertex with a fifth influence makes records for all of them.
            if !(more.is_empty() && others.weighs_nothing()) {
                more.resize(vertex, FourInfluences::zeroed());
                more.push(others);
            }
        }
        Ok(Self {
            origin,
            vertices,
            more,
            tangents: mesh.tangents.iter().map(|&[x, y, z, _]| [x, y, z]).collect(),
            has_normals: !mesh.normals.is_empty(),
            particles,
            extents,
        })
    }

    /// What rest data is stored relative to [m, in the mesh's space].
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// The packed rest vertices, in the mesh's order.
    pub fn vertices(&self) -> &[RestVertex] {
        &self.vertices
    }

    /// The fifth to eighth particle that each vertex follows, one a vertex; empty if none follows more than four.
    pub fn more(&self) -> &[FourInfluences] {
        &self.more
    }

    /// The rest tangents without handedness, one per vertex, or empty.
    pub fn tangents(&self) -> &[[f32; 3]] {
        &self.tangents
    }

    /// Whether the rest mesh has normals.
    pub fn has_normals(&self) -> bool {
        self.has_normals
    }

    /// Rest positions of the particles relative to [`Self::origin`] \[m\]: what [`ParticleTransform::new`](crate::ParticleTransform::new) takes as `rest`.
    pub fn rest_particles(&self) -> &[Vec3] {
        &self.particles
    }

    /// ρ_k: the largest distance of a rest vertex that follows particle k from its rest position \[m\]; 0 where none does.
    ///
    /// # Panics
    /// If `particle` is not an index of this binding.
    pub fn skin_radius(&self, particle: usize) -> f32 {
        self.extents[particle].radius()
    }

    pub(crate) fn extents(&self) -> &[RestExtent] {
        &self.extents
    }
}

fn check_mesh(mesh: &RestMesh<'_>, particles: &[Vec3], influences: usize) -> Result<(), BindingError> {
    let vertices = mesh.positions.len();
    if vertices == 0 || particles.is_empty() {
        return Err(BindingError::Empty { vertices, particles: particles.len() });
    }
    if particles.len() > MAX_PARTICLES {
        return Err(BindingError::TooManyParticles { found: particles.len() });
    }
    let lengths = [("influences", influences, false), ("normals", mesh.normals.len(), true), ("tangents", mesh.tangents.len(), true)];
    for (what, found, may_be_empty) in lengths {
        if found != vertices && !(may_be_empty && found == 0) {
            return Err(BindingError::Length { what, found, vertices });
        }
    }
    let not_finite = |what, index| BindingError::NotFinite { what, index };
    fn first_bad<const N: usize>(items: &[[f32; N]]) -> Option<usize> {
        items.iter().position(|item| item.iter().any(|x| !x.is_finite()))
    }
    if let Some(index) = first_bad(mesh.positions) {
        return Err(not_finite("position", index));
    }
    if let Some(index) = first_bad(mesh.normals) {
        return Err(not_finite("normal", index));
    }
    if let Some(index) = first_bad(mesh.tangents) {
        return Err(not_finite("tangent", index));
    }
    if let Some(index) = particles.iter().position(|particle| !particle.is_finite()) {
        return Err(not_finite("particle", index));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]];

    fn bind(influences: Vec<([u32; 4], [f32; 4])>) -> Result<Binding, BindingError> {
        let mesh = RestMesh { positions: &TRIANGLE, normals: &[], tangents: &[] };
        Binding::new(mesh, &[Vec3::ZERO, Vec3::X], influences.into_iter())
    }

    fn whole(particle: u32) -> ([u32; 4], [f32; 4]) {
        ([particle; 4], [1.0, 0.0, 0.0, 0.0])
    }

    #[test]
    fn packs_and_unpacks_influences() {
        let binding = bind(vec![([1, 0, 1, 0], [0.4, 0.3, 0.2, 0.1]), whole(0), whole(1)]).expect("valid binding");
        let vertex = binding.vertices()[0];
        assert_eq!([0, 1, 2, 3].map(|slot| vertex.influences.particle(slot)), [1, 0, 1, 0]);
        for (slot, weight) in [0.4, 0.3, 0.2, 0.1].into_iter().enumerate() {
            assert!((vertex.influences.weight(slot) - weight).abs() < 2e-5);
        }
    }

    #[test]
    fn only_a_fifth_influence_takes_a_second_record() {
        let mesh = RestMesh { positions: &TRIANGLE, normals: &[], tangents: &[] };
        let particles = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, Vec3::ONE];
        let four = ([4, 3, 2, 1, 4, 4, 4, 4], [0.4, 0.3, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0]);
        let five = ([4, 3, 2, 1, 0, 4, 4, 4], [0.3, 0.2, 0.2, 0.2, 0.1, 0.0, 0.0, 0.0]);
        let narrow = Binding::new(mesh, &particles, [four; 3].into_iter()).expect("valid binding");
        assert!(narrow.more().is_empty());
        let first_four = ([4, 3, 2, 1], [0.4, 0.3, 0.2, 0.1]);
        assert_eq!(narrow.vertices(), Binding::new(mesh, &particles, [first_four; 3].into_iter()).expect("valid binding").vertices());
        let wide = Binding::new(mesh, &particles, [four, five, four].into_iter()).expect("valid binding");
        let fifths: Vec<f32> = wide.more().iter().map(|more| more.weight(0)).collect();
        assert_eq!(fifths.len(), 3);
        assert!(fifths[0] == 0.0 && (fifths[1] - 0.1).abs() < 2e-5 && fifths[2] == 0.0, "{fifths:?}");
        assert_eq!(wide.vertices()[0], narrow.vertices()[0]);
    }

    #[test]
    fn skin_radius_is_the_farthest_follower() {
        let binding = bind(vec![whole(0), whole(0), whole(0)]).expect("valid binding");
        assert_eq!(binding.skin_radius(0), 2.0);
        assert_eq!(binding.skin_radius(1), 0.0);
    }

    #[test]
    fn bad_input_is_named() {
        assert_eq!(
            bind(vec![whole(0), whole(2), whole(0)]).unwrap_err(),
            BindingError::ParticleIndex { vertex: 1, slot: 0, particle: 2, particles: 2 }
        );
        assert_eq!(bind(vec![whole(0), whole(0)]).unwrap_err(), BindingError::Length { what: "influences", found: 2, vertices: 3 });
        assert!(matches!(bind(vec![whole(0), ([0; 4], [0.5, 0.4, 0.0, 0.0]), whole(0)]), Err(BindingError::WeightSum { vertex: 1, .. })));
        for bad in [f32::NAN, f32::INFINITY, -0.5] {
            assert!(matches!(
                bind(vec![whole(0), whole(0), ([0; 4], [1.0, bad, 0.0, 0.0])]),
                Err(BindingError::Weight { vertex: 2, slot: 1, .. })
            ));
        }
        let mesh = RestMesh { positions: &[[0.0, f32::NAN, 0.0]], normals: &[], tangents: &[] };
        assert_eq!(
            Binding::new(mesh, &[Vec3::ZERO], [whole(0)].into_iter()).unwrap_err(),
            BindingError::NotFinite { what: "position", index: 0 }
        );
        let mesh = RestMesh { positions: &[], ..mesh };
        assert_eq!(
            Binding::new(mesh, &[Vec3::ZERO], [whole(0)].into_iter().take(0)).unwrap_err(),
            BindingError::Empty { vertices: 0, particles: 1 }
        );
    }
}
