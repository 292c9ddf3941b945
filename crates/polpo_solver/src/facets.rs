//! Facets: where the cells of a body touch, and the edges and rings that make it as stiff as its material.

use core::f32::consts::PI;

use glam::{Mat3A, Quat, Vec3A};

use crate::coloring::{color_rows, cut, rank};
use crate::lanes::LANES;
use crate::material::not_negative;
use crate::{CalibratedEdges, CalibrationError, Material, Particles, Rings};

/// Where the cells of two particles touch. Cells are the parts of the body nearest to each particle, or any other partition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facet {
    /// The particles on its two sides.
    pub pair: [u32; 2],
    /// Vector area S, facing from the first particle to the second \[m²\].
    pub area: Vec3A,
    /// Centroid c, in the axes of the particles' rest positions \[m\].
    pub centroid: Vec3A,
    /// Second moments of area about the centroid, ∫(x − c)(x − c)ᵀ dA \[m⁴\].
    pub moments: Mat3A,
}

impl CalibratedEdges {
    /// Edges and rings with which a body of `facets` stretches, shears, bends, twists and thins as its `material` does, and the particles' masses and spin inertias.
    ///
    /// `volumes` are those of the particles' cells \[m³\]: m = ρV. A particle with the volume 0 is a wall: it keeps its mass, is to be pinned, and stands where the particle that it holds is projected on
    /// the wall. The spin inertia is m·r² with r half the mean distance to the neighbours, or `spin_radius` \[m\] if that is larger: the twist of the limb's end is slower by about that, and substeps do not
    /// depend on it.
    ///
    /// With d = x_j − x_i at rest, h = |d|, e = d/h, A = S·e, b = ν/(1 + ν):
    ///
    /// - *Stretch and shear* at the facet's centroid: k = E/(1 + ν)·A/h, in all three directions. Together with the rings this makes any Voronoi partition strain evenly under an even stress.
    /// - *Fabric* M_i = sym Σ S⊗(c − x_i)/V_i over the cell's facets: 1 along what is held, 0 across a free surface. m = ½(tr M − eᵀMe), the mean of both sides, and t = normalise((M_i² + M_j²)·e), the
    ///   limb's direction as far as the cell knows it.
    /// - *Bend* E·I/h′ of the facet projected along t, about its own principal axes, with h′ = d·t, and with b·A·Σ(s/h)·r rᵀ on top of its moments, of both sides: s is the distance from the particle to the facet, and r how far
    ///   the facet's centroid lies, across t, from the mean of all of its cell's. A ring feels the mean stretch of a cell, and nothing of one that is longer on one side; this is what it misses there.
    /// - *Twist* (1 − ½m − 2½m²)·G·J/h′, not below 0, with J = 0.95·A⁴/(4π²·I_p), at most I_p (Saint-Venant's estimate). A limb of one cell across has m = 0 and all of it. Two and three across cannot warp as a section does, which
    ///   makes them too stiff with hardly any twist of their own; how much they get is fitted to bars, a tapered limb and an angle of 20 to 300 cells.
    /// - *Rings* for Poisson's ratio, see [`Rings`].
    ///
    /// # Errors
    ///
    /// A number out of its range (ν from 0 to 0.5 here: rings push, they do not pull), a facet that joins no two particles, is not finite or does not face from the first to the second, or a volume that is
    /// not one.
    pub fn from_facets(
        particles: &mut Particles,
        facets: &[Facet],
        volumes: &[f32],
        material: &Material,
        spin_radius: f32,
    ) -> Result<(Self, Rings), CalibrationError> {
        Self::make(particles, facets, volumes, material, spin_radius, true)
    }

    /// [`from_facets`](Self::from_facets) without rings: cheaper by these, and [`DirectEdges`](crate::DirectEdges) can solve it. Facets pull by E·A/h along the line between the particles and by E/(1 + ν)·A/h across, so limbs stretch and bend
    /// as they do with rings, within about 8 %; what is thick in all directions does not thin where it is stretched, and gives up to a sixth too much.
    ///
    /// # Errors
    ///
    /// Those of [`from_facets`](Self::from_facets).
    pub fn from_facets_alone(
        particles: &mut Particles,
        facets: &[Facet],
        volumes: &[f32],
        material: &Material,
        spin_radius: f32,
    ) -> Result<Self, CalibrationError> {
        Ok(Self::make(particles, facets, volumes, material, spin_radius, false)?.0)
    }

    fn make(
        particles: &mut Particles,
        facets: &[Facet],
        volumes: &[f32],
        material: &Material,
        spin_radius: f32,
        with_rings: bool,
    ) -> Result<(Self, Rings), CalibrationError> {
        material.check()?;
        not_negative("Poisson's ratio", material.poissons_ratio)?;
        not_negative("the spin radius", spin_radius)?;
        check(particles, facets, volumes, material)?;
        let count = particles.len();
        // By place, so that the order in which they came does not matter.
        let rank = rank(&particles.rest_position);
        let mut input: Vec<u32> = (0..facets.len() as u32).collect();
        input.sort_by_key(|&f| {
            let [a, b] = facets[f as usize].pair.map(|i| rank[i as usize]);
            (a.min(b), a.max(b))
        });
        let facets: Vec<Facet> = input.iter().map(|&f| facets[f as usize]).collect();
        let (e, g, nu) = (material.youngs_modulus, material.shear_modulus(), material.poissons_ratio);
        let x = |i: u32| particles.rest_position[i as usize];
        let mut fabric = vec![Mat3A::ZERO; count];
        let mut distance = vec![(0.0f32, 0u32); count];
        let mut walls: Vec<Vec<CellWall>> = vec![Vec::new(); count];
        for facet in &facets {
            let along = (x(facet.pair[1]) - x(facet.pair[0])).normalize();
            for (end, sign) in [(facet.pair[0], 1.0), (facet.pair[1], -1.0)] {
                let share = sign * facet.area.dot(facet.centroid - x(end));
                walls[end as usize].push(CellWall { share: share.max(0.0), along, centroid: facet.centroid });
                let volume = volumes[end as usize];
                if volume > 0.0 {
                    fabric[end as usize] += outer(facet.area * sign, facet.centroid - x(end)) * (1.0 / volume);
                }
                let (sum, number) = &mut distance[end as usize];
                *sum += x(facet.pair[0]).distance(x(facet.pair[1]));
                *number += 1;
            }
        }
        for m in &mut fabric {
            *m = (*m + m.transpose()) * 0.5;
        }
        let (order, colors) = color_rows(count, facets.iter().map(|f| f.pair.as_slice()));
        let mut this = Self { batches: cut(&colors, LANES), ..Self::default() };
        for &f in &order {
            let facet = &facets[f as usize];
            let [i, j] = facet.pair;
            let d = x(j) - x(i);
            let h = d.length();
            let along = d / h;
            // A wall has no fabric of its own.
            let sides = match (volumes[i as usize] > 0.0, volumes[j as usize] > 0.0) {
                (true, false) => [fabric[i as usize]; 2],
                (false, true) => [fabric[j as usize]; 2],
                _ => [fabric[i as usize], fabric[j as usize]],
            };
            let held = sides.iter().map(|m| 0.25 * (m.x_axis.x + m.y_axis.y + m.z_axis.z - along.dot(*m * along))).sum::<f32>();
            let limb = sides[0] * (sides[0] * along) + sides[1] * (sides[1] * along);
            let limb = limb.normalize_or(along);
            let limb = if limb.dot(d) > 0.0 { limb } else { along };
            let projected = Projection::new(facet, limb);
            let reach = d.dot(limb);
            let twist = (1.0 - held * (0.5 + 2.5 * held)).clamp(0.0, 1.0) * g * projected.torsion() / reach;
            let projected = if with_rings && nu > 0.0 {
                let missed = [i, j].into_iter().filter(|&i| volumes[i as usize] > 0.0).fold(Mat3A::ZERO, |sum, end| {
                    let off = facet.centroid - mean_wall(&walls[end as usize], limb);
                    let sign = if end == i { 1.0 } else { -1.0 };
                    let share = (sign * facet.area.dot(facet.centroid - x(end)) / h).max(0.0);
                    sum + outer(off, off) * (nu / (1.0 + nu) * share)
                });
                Projection::new(&Facet { moments: facet.moments + missed, ..*facet }, limb)
            } else {
                projected
            };
            this.pairs.push(facet.pair);
            this.input.push(input[f as usize]);
            this.contact.push([facet.centroid - x(i), facet.centroid - x(j)]);
            this.rest_gap.push(Vec3A::ZERO);
            let stretch = h * (1.0 + nu) / (e * facet.area.dot(along));
            this.frame.push(projected.frame);
            // Without rings it is more along the line between the particles, as much of it as shows along the frame's axes.
            let line = if with_rings { Vec3A::ZERO } else { projected.frame.inverse() * along };
            this.stretch_compliance.push(Vec3A::splat(stretch) / (1.0 + line * line * nu));
            // About y bends what is off the axis along z.
            let bend = Vec3A::new(twist, e * projected.moments[1] / reach, e * projected.moments[0] / reach);
            this.bend_compliance.push(bend.max(Vec3A::ZERO).recip());
            if !(bend.is_finite() && h.is_normal() && stretch.is_normal()) {
                return Err(CalibrationError::Facet { facet: input[f as usize] as usize, what: "its numbers are too large or too small" });
            }
        }
        for i in 0..count {
            let (sum, number) = distance[i];
            if volumes[i] > 0.0 {
                particles.set_mass(i, material.density * volumes[i]);
                if number > 0 {
                    let radius = (0.5 * sum / number as f32).max(spin_radius);
                    particles.set_inertia(i, particles.mass[i] * radius * radius);
                }
            }
        }
        let rings = if with_rings { Rings::new(particles, &facets, volumes, material, &rank) } else { Rings::default() };
        Ok((this, rings))
    }
}

fn check(particles: &Particles, facets: &[Facet], volumes: &[f32], material: &Material) -> Result<(), CalibrationError> {
    let count = particles.len();
    if volumes.len() != count {
        return Err(CalibrationError::Volume { particle: volumes.len().min(count), count });
    }
    let weighs = |v: f32| (material.density * v).is_normal() && (1.0 / (material.density * v)).is_normal();
    if let Some(particle) = volumes.iter().position(|&v| !(v == 0.0 || v > 0.0 && weighs(v))) {
        return Err(CalibrationError::Volume { particle, count });
    }
    for (at, facet) in facets.iter().enumerate() {
        let [a, b] = facet.pair;
        if a == b || a as usize >= count || b as usize >= count {
            return Err(CalibrationError::Pair { facet: at, a, b, count });
        }
        let d = particles.rest_position[b as usize] - particles.rest_position[a as usize];
        if !(facet.area.is_finite() && facet.centroid.is_finite() && facet.moments.is_finite()) {
            return Err(CalibrationError::Facet { facet: at, what: "it is not finite" });
        }
        if !(facet.area.dot(d) > 0.0 && d.length().is_normal()) {
            return Err(CalibrationError::Facet { facet: at, what: "it does not face from its first particle to its second" });
        }
    }
    Ok(())
}

/// A facet as one of its cells sees it.
#[derive(Clone, Copy)]
struct CellWall {
    /// Of the cell's volume, what lies between its particle and the facet, thrice \[m³\].
    share: f32,
    /// The line between the particles.
    along: Vec3A,
    centroid: Vec3A,
}

/// Where, on the average, a cell's ring feels a stretch along `axis`; the facets' mean place if none lies that way.
fn mean_wall(walls: &[CellWall], axis: Vec3A) -> Vec3A {
    let (mut sum, mut total) = (Vec3A::ZERO, 0.0);
    for wall in walls {
        let cos = wall.along.dot(axis);
        let weight = wall.share * (cos * cos + 1e-6);
        sum += wall.centroid * weight;
        total += weight;
    }
    if total > 0.0 { sum / total } else { walls.first().map_or(Vec3A::ZERO, |w| w.centroid) }
}

/// a·bᵀ
fn outer(a: Vec3A, b: Vec3A) -> Mat3A {
    Mat3A::from_cols(a * b.x, a * b.y, a * b.z)
}

/// A facet seen along an axis.
struct Projection {
    /// x along the axis, y and z along the principal axes.
    frame: Quat,
    area: f32,
    /// ∫y² dA and ∫z² dA \[m⁴\].
    moments: [f32; 2],
}

impl Projection {
    fn new(facet: &Facet, axis: Vec3A) -> Self {
        let size = facet.area.length();
        let slant = (facet.area.dot(axis) / size).max(0.0);
        let (u, v) = axis.any_orthonormal_pair();
        let (a, b, c) = (u.dot(facet.moments * u), u.dot(facet.moments * v), v.dot(facet.moments * v));
        // The half angle of Mohr's circle: cos 2φ = (a − c)/D, with y along the larger moment. Equal moments have no axes of their own.
        let spread = ((a - c) * (a - c) + 4.0 * b * b).sqrt();
        let (cos, sin) = if spread > 1e-6 * (a + c) {
            let cos = (0.5 * (1.0 + (a - c) / spread)).max(0.0).sqrt();
            let sin = (0.5 * (1.0 - (a - c) / spread)).max(0.0).sqrt();
            (cos, if b < 0.0 { -sin } else { sin })
        } else {
            (1.0, 0.0)
        };
        let y = u * cos + v * sin;
        let z = axis.cross(y);
        let mean = 0.5 * (a + c);
        Self {
            frame: Quat::from_mat3a(&Mat3A::from_cols(axis, y, z)).normalize(),
            area: size * slant,
            moments: [(mean + 0.5 * spread) * slant, (mean - 0.5 * spread).max(0.0) * slant],
        }
    }

    /// Saint-Venant's estimate of the torsion constant, 0.95·A⁴/(4π²·I_p), at most I_p \[m⁴\]: within 5 % of a circle, a square and an ellipse.
    fn torsion(&self) -> f32 {
        let (area2, polar) = (self.area * self.area, self.moments[0] + self.moments[1]);
        if polar > 0.0 { (0.95 / (4.0 * PI * PI) * (area2 * area2) / polar).min(polar) } else { 0.0 }
    }
}
