//! The cells of a rig as the rods of a body.

use glam::{Mat3A, Vec3A};
use polpo::{Cells, Facet, Limb, Material, RodShape, RodSolve, Rods, Section};
use polpo_rig::Rig;

use crate::recipe::MaterialOptions;

/// What makes a body of `rig`, `scale` times as large, as stiff as its material, or as what `options` put in its place. None without cells.
pub(crate) fn rods(rig: &Rig, scale: f32, options: &MaterialOptions) -> Option<Rods> {
    let cells = rig.cells.as_ref()?;
    let material = options.over(Some(cells.material))?;
    let volume: f64 = cells.volumes.iter().map(|&v| f64::from(v)).sum();
    let mass: f64 = rig.particles.iter().map(|p| f64::from(p.mass)).sum();
    let (s1, s2, s3) = (scale, scale * scale, scale * scale * scale);
    let facets = cells.facets.iter().map(|f| {
        let [xx, yy, zz, xy, xz, yz] = f.moments;
        let moments = Mat3A::from_cols(Vec3A::new(xx, xy, xz), Vec3A::new(xy, yy, yz), Vec3A::new(xz, yz, zz)) * (s2 * s2);
        Facet { pair: f.pair, area: Vec3A::from(f.area) * s2, centroid: Vec3A::from(f.centroid) * s1, moments }
    });
    let limb = cells.limb.map(|l| Limb {
        axis: l.axis.into(),
        section: Section { area: l.area * s2, bending: l.bending * s2 * s2, torsion: l.torsion * s2 * s2, shear: 5.0 / 6.0 },
    });
    let spin_radius = cells.limb.map_or(0.0, |l| 0.12 * l.length * s1);
    Some(Rods {
        material: Material {
            youngs_modulus: material.youngs_modulus,
            poissons_ratio: material.poissons_ratio,
            density: (mass / volume) as f32,
        },
        shape: RodShape::Cells(Cells { volumes: cells.volumes.iter().map(|v| v * s3).collect(), facets: facets.collect(), limb }),
        solve: RodSolve::Sweep { spin_radius },
        retardation: material.retardation,
    })
}
