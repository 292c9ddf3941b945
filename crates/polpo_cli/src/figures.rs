//! The numbers of a mesh and of a rig.

use std::fmt::Write;

use glam::{DVec3, Vec3};
use polpo_rig::{GroupKind, Mesh, Rig, coverage};
use serde::Serialize;

use crate::output::{Spread, digits};

/// Of a mesh, in its own unit, taken for metres.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct MeshFigures {
    pub(crate) triangles: usize,
    pub(crate) vertices: usize,
    /// Sides of its box \[m\].
    pub(crate) size_m: [f32; 3],
    /// What its triangles enclose \[m³\]; of an open mesh as if each hole were closed towards the middle of the box. Negative if it is inside out.
    pub(crate) volume_m3: f64,
    /// What it is recognised by.
    pub(crate) hash: String,
}

/// Of a rig, in its mesh's unit, taken for metres.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct RigFigures {
    pub(crate) particles: usize,
    pub(crate) mass_kg: f64,
    pub(crate) edges: usize,
    pub(crate) edges_per_particle: f32,
    /// Into how many pieces its edges tie it; 1 is whole.
    pub(crate) pieces: usize,
    /// Half axes of all ellipsoids \[m\].
    pub(crate) radius_m: Spread,
    /// From each particle to the nearest that it is tied to \[m\].
    pub(crate) spacing_m: Spread,
    /// Lengths of the edges \[m\].
    pub(crate) edge_m: Spread,
    /// Vertices that it skins.
    pub(crate) vertices: usize,
    /// Particles that a vertex follows, on the average.
    pub(crate) influences_per_vertex: f32,
    /// As many as a vertex follows at most.
    pub(crate) most_influences: usize,
    pub(crate) regions: Vec<RegionFigures>,
    /// Facets between the particles' cells; null for a rig without a material.
    pub(crate) facets: Option<usize>,
    /// The material's Young's modulus \[Pa\]; null without one.
    pub(crate) youngs_modulus_pa: Option<f32>,
    /// The mesh that it was made for.
    pub(crate) mesh_hash: String,
}

/// Of a region of a rig.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct RegionFigures {
    pub(crate) name: String,
    pub(crate) particles: usize,
    pub(crate) mass_kg: f64,
    /// `rigid` or `soft` if it is an explicit group.
    pub(crate) group: Option<&'static str>,
}

/// How well a rig's ellipsoids fill its mesh.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct CoverageFigures {
    /// The share of the skin within 2 % of the body's size of an ellipsoid.
    pub(crate) covered: f32,
    /// Mean distance of the skin from the ellipsoids \[m\].
    pub(crate) bare_m: f32,
    /// Mean distance that the ellipsoids stick out of the body \[m\].
    pub(crate) overhang_m: f32,
}

impl CoverageFigures {
    pub(crate) fn of(mesh: &Mesh, rig: &Rig) -> CoverageFigures {
        let coverage = coverage(mesh, rig);
        CoverageFigures { covered: coverage.covered, bare_m: coverage.bare, overhang_m: coverage.overhang }
    }

    pub(crate) fn tell(&self, text: &mut String) {
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "  cover    {:.1} % of the skin within 2 % of the size; bare by {} m, overhang {} m on average",
            100.0 * self.covered,
            digits(self.bare_m),
            digits(self.overhang_m)
        );
    }
}

impl MeshFigures {
    pub(crate) fn of(mesh: &Mesh) -> MeshFigures {
        let (low, high) = bounds(&mesh.positions);
        let middle = ((low + high) * 0.5).as_dvec3();
        let corner = |v: u32| mesh.positions.get(v as usize).map_or(DVec3::ZERO, |p| p.as_dvec3() - middle);
        let sixfold: f64 = mesh.triangles.iter().map(|t| corner(t[0]).cross(corner(t[1])).dot(corner(t[2]))).sum();
        MeshFigures {
            triangles: mesh.triangles.len(),
            vertices: mesh.positions.len(),
            size_m: (high - low).to_array(),
            volume_m3: sixfold / 6.0,
            hash: mesh.hash().to_string(),
        }
    }

    pub(crate) fn tell(&self, text: &mut String) {
        let [x, y, z] = self.size_m.map(digits);
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "mesh       {} triangles, {} vertices, {x} × {y} × {z} m, {} m³",
            self.triangles,
            self.vertices,
            digits(self.volume_m3 as f32)
        );
    }
}

impl RigFigures {
    pub(crate) fn of(rig: &Rig) -> RigFigures {
        let place = |i: u32| rig.particles[i as usize].position;
        let lengths: Vec<f32> = rig.edges.iter().map(|e| place(e[0]).distance(place(e[1]))).collect();
        let mut nearest = vec![f32::INFINITY; rig.particles.len()];
        for (edge, &length) in rig.edges.iter().zip(&lengths) {
            edge.iter().for_each(|&i| nearest[i as usize] = nearest[i as usize].min(length));
        }
        let used: Vec<usize> = rig.skin.iter().map(|i| i.used().count()).collect();
        let mass = |particles: &[u32]| particles.iter().map(|&i| f64::from(rig.particles[i as usize].mass)).sum();
        RigFigures {
            particles: rig.particles.len(),
            mass_kg: rig.particles.iter().map(|p| f64::from(p.mass)).sum(),
            edges: rig.edges.len(),
            edges_per_particle: rig.edges.len() as f32 / rig.particles.len().max(1) as f32,
            pieces: pieces(rig),
            radius_m: Spread::of(rig.particles.iter().flat_map(|p| p.radii.to_array()).collect()),
            spacing_m: Spread::of(nearest.into_iter().filter(|d| d.is_finite()).collect()),
            edge_m: Spread::of(lengths),
            vertices: rig.skin.len(),
            influences_per_vertex: used.iter().sum::<usize>() as f32 / rig.skin.len().max(1) as f32,
            most_influences: used.iter().copied().max().unwrap_or(0),
            regions: rig
                .regions
                .iter()
                .map(|r| RegionFigures {
                    name: r.name.clone(),
                    particles: r.particles.len(),
                    mass_kg: mass(&r.particles),
                    group: r.group.map(|g| if matches!(g, GroupKind::Rigid) { "rigid" } else { "soft" }),
                })
                .collect(),
            facets: rig.cells.as_ref().map(|c| c.facets.len()),
            youngs_modulus_pa: rig.cells.as_ref().map(|c| c.material.youngs_modulus),
            mesh_hash: rig.mesh_hash.to_string(),
        }
    }

    pub(crate) fn tell(&self, text: &mut String) {
        let spread = |s: &Spread| format!("{} / {} / {} m", digits(s.least), digits(s.median), digits(s.most));
        let whole = if self.pieces == 1 { String::new() } else { format!(", IN {} PIECES", self.pieces) };
        // Writing to a string does not fail.
        let _ = writeln!(text, "particles  {}, {} kg", self.particles, digits(self.mass_kg as f32));
        let _ = writeln!(text, "  radii    {} (least / median / most)", spread(&self.radius_m));
        let _ = writeln!(text, "  spacing  {}", spread(&self.spacing_m));
        let _ = writeln!(text, "edges      {}, {:.2} a particle{whole}", self.edges, self.edges_per_particle);
        let _ = writeln!(text, "  lengths  {}", spread(&self.edge_m));
        let _ = writeln!(
            text,
            "skin       {} vertices, {:.2} influences each, {} at most",
            self.vertices, self.influences_per_vertex, self.most_influences
        );
        for region in &self.regions {
            let group = region.group.map_or(String::new(), |g| format!(", one {g} piece"));
            let _ =
                writeln!(text, "region     {}: {} particles, {} kg{group}", region.name, region.particles, digits(region.mass_kg as f32));
        }
        if let (Some(facets), Some(modulus)) = (self.facets, self.youngs_modulus_pa) {
            let _ = writeln!(text, "material   {} Pa by {facets} facets", digits(modulus));
        }
    }
}

/// Lowest and highest corner of the box around places.
pub(crate) fn bounds(places: &[Vec3]) -> (Vec3, Vec3) {
    places.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)))
}

/// How many pieces the edges leave of the particles.
fn pieces(rig: &Rig) -> usize {
    let mut parent: Vec<usize> = (0..rig.particles.len()).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    let mut count = parent.len();
    for &[a, b] in &rig.edges {
        let (a, b) = (root(&mut parent, a as usize), root(&mut parent, b as usize));
        if a != b {
            parent[a] = b;
            count -= 1;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;
    use polpo_rig::{Influences, Particle};

    #[test]
    fn a_rig_is_counted() {
        let particle = |x: f32| Particle { position: Vec3::X * x, frame: Quat::IDENTITY, radii: Vec3::new(0.1, 0.2, 0.3), mass: 0.5 };
        let rig = Rig {
            particles: [0.0, 1.0, 3.0, 9.0].map(particle).to_vec(),
            edges: vec![[0, 1], [1, 2]],
            skin: vec![Influences::whole(0), Influences::new(&[(0, 0.5), (1, 0.25), (2, 0.25)])],
            ..Rig::default()
        };
        let figures = RigFigures::of(&rig);
        assert_eq!((figures.particles, figures.edges, figures.pieces, figures.mass_kg), (4, 2, 2, 2.0));
        assert_eq!(figures.spacing_m, Spread { least: 1.0, median: 1.0, most: 2.0 });
        assert_eq!((figures.radius_m.least, figures.radius_m.most), (0.1, 0.3));
        assert_eq!((figures.influences_per_vertex, figures.most_influences), (2.0, 3));
    }
}
