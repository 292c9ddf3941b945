//! The mirror of `skin.wgsl`: the same packed data, the same names, the same order of operations. It is the fallback where there is no compute shader, and what the shader is tested against.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x4, f32x8};
use glam::{Vec3, Vec4};

use crate::{Binding, FourInfluences, ParticleTransform};

/// Squared length \[1\] under which a blended normal has no direction and the rest normal stays.
pub const DEGENERATE_LENGTH_SQUARED: f32 = 1e-12;

/// Σ_k w_k·M_k over the influences of a vertex.
///
/// # Panics
/// If the binding has no such vertex, or `transforms` is shorter than its particles.
pub fn blend(binding: &Binding, vertex: usize, transforms: &[ParticleTransform]) -> ParticleTransform {
    let mut rows = [Vec4::ZERO; 3];
    for four in std::iter::once(&binding.vertices()[vertex].influences).chain(binding.more().get(vertex)) {
        for slot in 0..4 {
            let weight = four.weight(slot);
            let transform = &transforms[four.particle(slot) as usize];
            for (row, other) in rows.iter_mut().zip(transform.rows) {
                *row += weight * other;
            }
        }
    }
    ParticleTransform { rows }
}

/// The rotation of `blended` applied to a rest normal or tangent, normalised; `direction` itself where the result has no direction.
pub fn blend_direction(blended: &ParticleTransform, direction: Vec3) -> Vec3 {
    let rotated = Vec3::new(
        blended.rows[0].truncate().dot(direction),
        blended.rows[1].truncate().dot(direction),
        blended.rows[2].truncate().dot(direction),
    );
    let length_squared = rotated.dot(rotated);
    if length_squared > DEGENERATE_LENGTH_SQUARED { rotated / length_squared.sqrt() } else { direction }
}

/// Where [`skin`] writes. A slice shorter than the mesh leaves the rest of the mesh out; `None` leaves that attribute alone.
#[derive(Debug)]
pub struct SkinnedVertices<'a> {
    /// Positions \[m\], one per vertex.
    pub positions: &'a mut [[f32; 3]],
    /// Unit normals, one per vertex.
    pub normals: Option<&'a mut [[f32; 3]]>,
    /// Unit tangents, one per vertex; the handedness in the fourth component is left alone.
    pub tangents: Option<&'a mut [[f32; 4]]>,
}

/// Skins the whole mesh. `transforms` holds one map per particle of `binding`; if it holds fewer, nothing is written and the answer is false.
///
/// [`blend`] and [`blend_direction`] are the definition. Here maps are blended by their columns, so that nothing is summed across a vector register, and multiply-adds are fused where the processor can.
pub fn skin(binding: &Binding, transforms: &[ParticleTransform], out: SkinnedVertices<'_>) -> bool {
    if transforms.len() < binding.rest_particles().len() {
        return false;
    }
    let columns: Vec<Columns> = transforms.iter().map(Columns::from).collect();
    if binding.more().is_empty() {
        dispatch!(Level::new(), simd => skin_all::<_, false>(simd, binding, &columns, out));
    } else {
        dispatch!(Level::new(), simd => skin_all::<_, true>(simd, binding, &columns, out));
    }
    true
}

/// A map by its columns, two by two; the fourth of each column is zero.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Columns {
    xy: [f32; 8],
    zt: [f32; 8],
}

impl From<&ParticleTransform> for Columns {
    fn from(transform: &ParticleTransform) -> Self {
        let [a, b, c] = transform.rows.map(|row| row.to_array());
        let two = |k: usize| [a[k], b[k], c[k], 0.0, a[k + 1], b[k + 1], c[k + 1], 0.0];
        Self { xy: two(0), zt: two(2) }
    }
}

/// `WIDE` if there are vertices with more than four influences.
#[inline(always)]
fn skin_all<S: Simd, const WIDE: bool>(simd: S, binding: &Binding, transforms: &[Columns], mut out: SkinnedVertices<'_>) {
    let normals = out.normals.take().filter(|_| binding.has_normals()).unwrap_or_default();
    let tangents = out.tangents.take().unwrap_or_default();
    let tangents_at_rest = if tangents.is_empty() { &[] } else { binding.tangents() };
    let (mut turned_normals, mut turned_tangents) = (Turned::default(), Turned::default());
    for (eight, vertices) in binding.vertices().chunks(LANES).enumerate() {
        let first = eight * LANES;
        for (l, vertex) in vertices.iter().enumerate().take(LANES) {
            let mut sum = weighted(simd, &vertex.influences, transforms, [f32x8::splat(simd, 0.0); 2]);
            if WIDE && let Some(more) = binding.more().get(first + l) {
                sum = weighted(simd, more, transforms, sum);
            }
            let columns = columns(sum);
            if let Some(position) = out.positions.get_mut(first + l) {
                *position = truncate(rotate(simd, &columns, &vertex.position) + columns[3]);
            }
            if !normals.is_empty() {
                turned_normals.turn(simd, l, &columns, &vertex.normal);
            }
            if let Some(rest) = tangents_at_rest.get(first + l) {
                turned_tangents.turn(simd, l, &columns, rest);
            }
        }
        if let Some(normals) = normals.get_mut(first..) {
            turned_normals.normalise(simd);
            for ((normal, vertex), l) in normals.iter_mut().zip(vertices).zip(0..) {
                *normal = turned_normals.get(l, vertex.normal);
            }
        }
        if let (Some(tangents), Some(rest)) = (tangents.get_mut(first..), tangents_at_rest.get(first..)) {
            turned_tangents.normalise(simd);
            for ((tangent, &rest), l) in tangents.iter_mut().zip(rest).zip(0..LANES) {
                let [x, y, z] = turned_tangents.get(l, rest);
                *tangent = [x, y, z, tangent[3]];
            }
        }
    }
}

/// How many directions are normalised together.
const LANES: usize = 8;

/// Directions of as many vertices, turned and then normalised: [`blend_direction`] of each. A root and a quotient for all of them, which take as long as the rest of a vertex together.
#[derive(Default)]
struct Turned {
    /// The fourth is zero.
    vectors: [[f32; 4]; LANES],
    length_squared: [f32; LANES],
    per_length: [f32; LANES],
}

impl Turned {
    #[inline(always)]
    fn turn<S: Simd>(&mut self, simd: S, l: usize, columns: &[f32x4<S>; 4], direction: &[f32; 3]) {
        let vector: [f32; 4] = rotate(simd, columns, direction).into();
        let [x, y, z, _] = vector;
        (self.vectors[l], self.length_squared[l]) = (vector, x * x + y * y + z * z);
    }

    #[inline(always)]
    fn normalise<S: Simd>(&mut self, simd: S) {
        let length_squared = f32x8::load_array(simd, self.length_squared);
        self.per_length = (f32x8::splat(simd, 1.0) / length_squared.sqrt()).into();
    }

    /// The `l`th of them; `direction` itself where the result has no direction.
    #[inline(always)]
    fn get(&self, l: usize, direction: [f32; 3]) -> [f32; 3] {
        let ([x, y, z, _], per) = (self.vectors[l], self.per_length[l]);
        if self.length_squared[l] > DEGENERATE_LENGTH_SQUARED { [x * per, y * per, z * per] } else { direction }
    }
}

/// The maps of four influences by their weights, on top of `sum`.
#[inline(always)]
fn weighted<S: Simd>(simd: S, four: &FourInfluences, transforms: &[Columns], [mut xy, mut zt]: [f32x8<S>; 2]) -> [f32x8<S>; 2] {
    for (particle, weight) in four.particles().into_iter().zip(four.weights()) {
        let (transform, weight) = (&transforms[usize::from(particle)], f32x8::splat(simd, weight));
        xy = f32x8::load_array_ref(simd, &transform.xy).mul_add(weight, xy);
        zt = f32x8::load_array_ref(simd, &transform.zt).mul_add(weight, zt);
    }
    [xy, zt]
}

/// The columns of [`blend`].
#[inline(always)]
fn columns<S: Simd>([xy, zt]: [f32x8<S>; 2]) -> [f32x4<S>; 4] {
    let ((x, y), (z, t)) = (xy.split(), zt.split());
    [x, y, z, t]
}

/// The linear part of the map times a vector.
#[inline(always)]
fn rotate<S: Simd>(simd: S, [x, y, z, _]: &[f32x4<S>; 4], [a, b, c]: &[f32; 3]) -> f32x4<S> {
    let splat = |v: &f32| f32x4::splat(simd, *v);
    z.mul_add(splat(c), y.mul_add(splat(b), *x * splat(a)))
}

#[inline(always)]
fn truncate<S: Simd>(v: f32x4<S>) -> [f32; 3] {
    let [x, y, z, _] = v.into();
    [x, y, z]
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::RestMesh;

    /// Eight and three vertices come out as their definition says, but for rounding, whatever is wanted of them; those without a direction keep their own.
    #[test]
    fn lanes_do_what_the_definition_says() {
        let noise = |i: usize| Vec3::new((1.3 * i as f32).sin(), (2.1 * i as f32).sin(), (2.9 * i as f32).sin());
        let particles: Vec<Vec3> = (0..6).map(noise).collect();
        let positions: Vec<[f32; 3]> = (0..11).map(|i| (noise(i) * 2.0).into()).collect();
        let normals: Vec<[f32; 3]> = (0..11).map(|i| if i == 4 { [0.0; 3] } else { noise(i + 50).normalize().into() }).collect();
        let tangents: Vec<[f32; 4]> = (0..11).map(|i| noise(i + 90).normalize().extend(-1.0).into()).collect();
        let mesh = RestMesh { positions: &positions, normals: &normals, tangents: &tangents };
        let four = (0..11u32).map(|i| ([i % 6, (i + 1) % 6, (i + 3) % 6, (i + 4) % 6], [0.4, 0.3, 0.2, 0.1]));
        // Every other vertex follows six.
        let six = (0..11u32).map(|i| {
            let weights = if i % 2 == 0 { [0.3, 0.2, 0.2, 0.1, 0.1, 0.1] } else { [0.4, 0.3, 0.2, 0.1, 0.0, 0.0] };
            ([0, 1, 2, 3, 4, 5].map(|k| (i + k) % 6), weights)
        });
        let bindings = [Binding::new(mesh, &particles, four).unwrap(), Binding::new(mesh, &particles, six).unwrap()];
        assert!(bindings[0].more().is_empty() && bindings[1].more().len() == 11);
        let pose = |(i, &rest): (usize, &Vec3)| ParticleTransform::new(noise(i + 20), Quat::from_scaled_axis(noise(i)), 1.5, rest);
        for (binding, wanted) in bindings.iter().flat_map(|binding| [11, 9, 3, 0].map(|wanted| (binding, wanted))) {
            let transforms: Vec<_> = binding.rest_particles().iter().enumerate().map(pose).collect();
            let (mut x, mut n, mut t) = (vec![[7.0; 3]; 11], vec![[7.0; 3]; wanted], vec![[7.0; 4]; wanted]);
            let out = SkinnedVertices { positions: &mut x, normals: Some(&mut n), tangents: Some(&mut t) };
            assert!(skin(binding, &transforms, out));
            let close = |a: [f32; 3], b: Vec3| assert!(Vec3::from(a).distance(b) < 2e-6, "{a:?} {b}");
            for (i, vertex) in binding.vertices().iter().enumerate() {
                let blended = blend(binding, i, &transforms);
                close(x[i], blended.transform_point(vertex.position.into()));
                if i < wanted {
                    close(n[i], blend_direction(&blended, vertex.normal.into()));
                    let [a, b, c, hand] = t[i];
                    close([a, b, c], blend_direction(&blended, binding.tangents()[i].into()));
                    assert_eq!(hand, 7.0);
                }
            }
        }
    }
}
