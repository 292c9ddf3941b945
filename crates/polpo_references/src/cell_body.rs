//! A rig's cells as edges and rings of the solver, and held by a wall.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3, Mat3A, Quat, Vec3, Vec3A};
use polpo_rig::{Cells, Fidelity, Rig};
use polpo_solver::{CalibratedEdges, CalibrationError, Facet, Limb, Material, ParticleRest, Particles, Rings, Section};

/// A body of cells. The particles behind the first `cells` are its wall.
#[derive(Clone)]
pub(crate) struct CellBody {
    pub(crate) particles: Particles,
    pub(crate) facets: Vec<Facet>,
    pub(crate) volumes: Vec<f32>,
    pub(crate) cells: usize,
    pub(crate) material: Material,
    pub(crate) fidelity: Fidelity,
    pub(crate) limb: Option<(Limb, f32)>,
}

/// What it is calibrated to.
pub(crate) struct Calibrated {
    pub(crate) particles: Particles,
    pub(crate) edges: CalibratedEdges,
    pub(crate) rings: Rings,
}

impl CellBody {
    /// Of a rig with cells, moved and turned.
    pub(crate) fn new(rig: &Rig, cells: &Cells, turn: Quat, by: Vec3) -> Self {
        let place = |x: Vec3| Vec3A::from(turn * x + by);
        let rest = |p: &polpo_rig::Particle| ParticleRest {
            position: place(p.position),
            frame: turn * p.frame,
            radii: p.radii.into(),
            mass: p.mass,
        };
        let rest: Vec<ParticleRest> = rig.particles.iter().map(rest).collect();
        let particles = Particles::new(&rest).expect("a rig is checked");
        let turned = Mat3A::from_quat(turn);
        let facets = cells.facets.iter().map(|f| {
            let [xx, yy, zz, xy, xz, yz] = f.moments;
            let moments = Mat3A::from_cols(Vec3A::new(xx, xy, xz), Vec3A::new(xy, yy, yz), Vec3A::new(xz, yz, zz));
            Facet {
                pair: f.pair,
                area: turned * Vec3A::from(f.area),
                centroid: place(f.centroid),
                moments: turned * moments * turned.transpose(),
            }
        });
        let filled = || rig.particles.iter().zip(&cells.volumes).filter(|(_, v)| **v > 0.0);
        let mass: f64 = filled().map(|(p, _)| f64::from(p.mass)).sum();
        let volume: f64 = filled().map(|(_, v)| f64::from(*v)).sum();
        let limb = cells.limb.map(|l| {
            let section = Section { area: l.area, bending: l.bending, torsion: l.torsion, shear: 5.0 / 6.0 };
            (Limb { axis: turned * Vec3A::from(l.axis), section }, l.length)
        });
        let m = cells.material;
        Self {
            particles,
            facets: facets.collect(),
            volumes: cells.volumes.clone(),
            cells: rig.particles.len(),
            material: Material { youngs_modulus: m.youngs_modulus, poissons_ratio: m.poissons_ratio, density: (mass / volume) as f32 },
            fidelity: m.fidelity,
            limb,
        }
    }

    /// The facet of each cell on a face with this normal, cut into squares.
    pub(crate) fn on_face(&self, squares: &[(DVec3, f64)], normal: DVec3) -> BTreeMap<u32, Facet> {
        let mut sums: BTreeMap<u32, (f64, DVec3, DMat3)> = BTreeMap::new();
        for &(x, area) in squares {
            let distance = |i: &u32| self.particles.rest_position[*i as usize].as_dvec3().distance_squared(x);
            let nearest = (0..self.cells as u32).min_by(|a, b| distance(a).total_cmp(&distance(b))).expect("there are cells");
            let (sum, first, second) = sums.entry(nearest).or_insert((0.0, DVec3::ZERO, DMat3::ZERO));
            *sum += area;
            *first += x * area;
            *second += DMat3::from_cols(x * x.x, x * x.y, x * x.z) * area;
        }
        let facet = |(cell, (area, first, second)): (u32, (f64, DVec3, DMat3))| {
            let c = first / area;
            let moments = second - DMat3::from_cols(c * c.x, c * c.y, c * c.z) * area;
            (cell, Facet { pair: [cell; 2], area: (normal * area).as_vec3a(), centroid: c.as_vec3a(), moments: moments.as_mat3().into() })
        };
        sums.into_iter().map(facet).collect()
    }

    /// Holds on to each cell that reaches the wall x = 0.
    pub(crate) fn hold(&mut self, squares: &[(DVec3, f64)]) {
        let mut rest: Vec<ParticleRest> = (0..self.cells).map(|i| rest_of(&self.particles, i)).collect();
        for (cell, facet) in self.on_face(squares, DVec3::NEG_X) {
            let mut wall = rest[cell as usize];
            wall.position.x = 0.0;
            self.facets.push(Facet { pair: [cell, rest.len() as u32], ..facet });
            self.volumes.push(0.0);
            rest.push(wall);
        }
        self.particles = Particles::new(&rest).expect("a rig is checked");
    }

    pub(crate) fn calibrate(&self, capped: bool) -> Result<Calibrated, CalibrationError> {
        let mut particles = self.particles.clone();
        let limb = self.limb.filter(|_| capped);
        let radius = limb.map_or(0.0, |(_, length)| 0.12 * length);
        let of = (&mut particles, &self.facets, &self.volumes, &self.material, radius);
        let (mut edges, mut rings) = match self.fidelity {
            Fidelity::Cells => CalibratedEdges::from_facets(of.0, of.1, of.2, of.3, of.4)?,
            Fidelity::Edges => (CalibratedEdges::from_facets_alone(of.0, of.1, of.2, of.3, of.4)?, Rings::default()),
        };
        // What of the body is denser than the rest.
        for i in (0..self.cells).filter(|&i| self.volumes[i] > 0.0) {
            let share = self.particles.mass[i] / particles.mass[i];
            let inertia = particles.inertia[i] * share;
            particles.set_mass(i, self.particles.mass[i]);
            particles.set_inertia(i, inertia);
        }
        for i in self.cells..particles.len() {
            particles.pin(i, true, true);
        }
        if let Some((limb, _)) = limb {
            edges.cap_stretch(&mut rings, &particles, &self.material, &limb)?;
        }
        Ok(Calibrated { particles, edges, rings })
    }
}

fn rest_of(p: &Particles, i: usize) -> ParticleRest {
    ParticleRest { position: p.rest_position[i], frame: p.frame[i], radii: p.radii[i], mass: p.mass[i] }
}
