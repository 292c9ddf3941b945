//! Solids cut into irregular cells, for the tests of facets, and their stiffness without any solver.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3, Mat3A, Quat, Vec3A};

use crate::edge_strain::EdgeStrain;
use crate::testing::Random;
use crate::{CalibratedEdges, Facet, Material, ParticleRest, Particles, Rings};

pub(crate) const DENSITY: f32 = 1000.0;

/// What is `inside` a box that begins at the wall x = 0 and has its middle on the x axis.
#[derive(Clone, Copy)]
pub(crate) struct Solid {
    pub(crate) size: Vec3A,
    /// A length of which all of the solid's are multiples \[m\].
    pub(crate) unit: f32,
    pub(crate) inside: fn(Vec3A) -> bool,
}

impl Solid {
    /// A bar of 1 m and `side` square.
    pub(crate) fn bar(side: f32) -> Self {
        Self { size: Vec3A::new(1.0, side, side), unit: side, inside: |_| true }
    }

    /// How many voxels of `size` it has along each axis, and where the middle of the `at`th is.
    pub(crate) fn grid(&self, voxel: f32) -> ([usize; 3], impl Fn(usize) -> Vec3A + use<>) {
        let count = [self.size.x, self.size.y, self.size.z].map(|s| (s / voxel).round() as usize);
        let corner = self.size * Vec3A::new(0.0, -0.5, -0.5);
        let middle = move |at: usize| {
            let (x, y, z) = (at % count[0], at / count[0] % count[1], at / count[0] / count[1]);
            (Vec3A::new(x as f32, y as f32, z as f32) + 0.5) * voxel + corner
        };
        (count, middle)
    }
}

/// A solid in cells, held by the wall.
pub(crate) struct Body {
    pub(crate) p: Particles,
    pub(crate) facets: Vec<Facet>,
    /// The facets on the face of the box that is farthest from the wall, of the cell and itself.
    pub(crate) end: Vec<Facet>,
    pub(crate) volumes: Vec<f32>,
    /// How many of the particles are not the wall.
    pub(crate) cells: usize,
}

/// Faces between voxels, each by its middle and its normal.
type Faces = Vec<(Vec3A, Vec3A)>;

const OUTSIDE: u32 = u32::MAX;

/// Labels each voxel with the nearest of the `points`, which move to the middle of their cells three times and are sorted along x, so that the stiffness has a narrow
/// band.
fn label(points: &mut [Vec3A], solid: &Solid, voxel: f32) -> Vec<u32> {
    let (count, middle) = solid.grid(voxel);
    let mut labels = vec![OUTSIDE; count[0] * count[1] * count[2]];
    for _ in 0..4 {
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        let mut sums = vec![(Vec3A::ZERO, 0.0f32); points.len()];
        for (at, label) in labels.iter_mut().enumerate() {
            let place = middle(at);
            if !(solid.inside)(place) {
                continue;
            }
            let mut least = f32::INFINITY;
            let middle = points.partition_point(|p| p.x < place.x);
            // Outwards along x, until no nearer one can come.
            let mut look = |k: usize| {
                let (along, distance) = (points[k].x - place.x, points[k].distance_squared(place));
                if distance < least {
                    (least, *label) = (distance, k as u32);
                }
                along * along < least
            };
            let _ = (0..middle).rev().all(&mut look) | (middle..points.len()).all(&mut look);
            let (sum, number) = &mut sums[*label as usize];
            *sum += place;
            *number += 1.0;
        }
        for (point, (sum, number)) in points.iter_mut().zip(sums) {
            *point = sum / number;
        }
    }
    labels
}

/// Adds up faces of `size` \[m²\]. Those of a staircase count by what they show of the facet's own direction.
fn facet(pair: [u32; 2], faces: &Faces, size: f32) -> Facet {
    let area = faces.iter().fold(Vec3A::ZERO, |sum, (_, n)| sum + *n) * size;
    let normal = area.normalize();
    let total: f32 = faces.iter().map(|(_, n)| n.dot(normal)).sum();
    let centroid = faces.iter().fold(Vec3A::ZERO, |sum, (x, n)| sum + *x * n.dot(normal)) / total;
    let moments = faces.iter().fold(Mat3A::ZERO, |sum, (x, n)| {
        let r = *x - centroid;
        sum + Mat3A::from_cols(r * r.x, r * r.y, r * r.z) * (n.dot(normal) / total)
    });
    Facet { pair, area, centroid, moments: moments * area.length() }
}

fn particles(places: &[Vec3A]) -> Particles {
    let rest: Vec<ParticleRest> =
        places.iter().map(|&position| ParticleRest { position, frame: Quat::IDENTITY, radii: Vec3A::splat(0.02), mass: 1.0 }).collect();
    Particles::new(&rest).unwrap()
}

impl Body {
    /// `count` cells of at least eleven voxels across.
    pub(crate) fn new(solid: &Solid, count: usize, seed: u64) -> Self {
        let mut random = Random(seed);
        let mut volume = 0.0;
        let (coarse, middle) = solid.grid(0.25 * solid.unit);
        for at in 0..coarse.iter().product() {
            if (solid.inside)(middle(at)) {
                volume += (0.25 * solid.unit).powi(3);
            }
        }
        let spacing = libm::cbrtf(volume / count as f32);
        let mut points = Vec::new();
        while points.len() < count {
            let place = (random.vector() * 0.5 + Vec3A::X * 0.5) * solid.size;
            if (solid.inside)(place) {
                points.push(place);
            }
        }
        let voxel = solid.unit / (solid.unit / (spacing / 11.0)).round();
        let labels = label(&mut points, solid, voxel);
        let (grid, middle) = solid.grid(voxel);
        let mut volumes = vec![0.0f32; count];
        let mut table: BTreeMap<[u32; 2], Faces> = BTreeMap::new();
        let [mut wall, mut end]: [BTreeMap<u32, Faces>; 2] = Default::default();
        let steps = [(1, Vec3A::X), (grid[0], Vec3A::Y), (grid[0] * grid[1], Vec3A::Z)];
        for at in (0..labels.len()).filter(|&at| labels[at] != OUTSIDE) {
            volumes[labels[at] as usize] += voxel * voxel * voxel;
            let place = [at % grid[0], at / grid[0] % grid[1], at / grid[0] / grid[1]];
            let (x, half) = (middle(at), 0.5 * voxel);
            if place[0] == 0 {
                wall.entry(labels[at]).or_default().push((x - Vec3A::X * half, -Vec3A::X));
            }
            if place[0] + 1 == grid[0] {
                end.entry(labels[at]).or_default().push((x + Vec3A::X * half, Vec3A::X));
            }
            for (axis, (step, normal)) in steps.into_iter().enumerate() {
                if place[axis] + 1 < grid[axis] && labels[at + step] != OUTSIDE && labels[at] != labels[at + step] {
                    let (a, b) = (labels[at], labels[at + step]);
                    let face = (x + normal * half, if a < b { normal } else { -normal });
                    table.entry([a.min(b), a.max(b)]).or_default().push(face);
                }
            }
        }
        let size = voxel * voxel;
        let mut facets: Vec<Facet> = table.into_iter().map(|(pair, faces)| facet(pair, &faces, size)).collect();
        facets.retain(|f| f.area.dot(points[f.pair[1] as usize] - points[f.pair[0] as usize]) > 0.0);
        for (cell, faces) in wall {
            let at = points.len() as u32;
            points.push(points[cell as usize] * Vec3A::new(0.0, 1.0, 1.0));
            volumes.push(0.0);
            facets.push(facet([cell, at], &faces, size));
        }
        let end = end.into_iter().map(|(cell, faces)| facet([cell, cell], &faces, size)).collect();
        Self { p: particles(&points), facets, end, volumes, cells: count }
    }

    /// Without the wall, and the facets on it.
    pub(crate) fn free(mut self) -> Self {
        let cells = self.cells;
        self.facets.retain(|f| (f.pair[1] as usize) < cells);
        self.volumes.truncate(cells);
        self.p = particles(&self.p.rest_position[..cells]);
        self
    }

    pub(crate) fn calibrate(&mut self, material: &Material, spin_radius: f32) -> (CalibratedEdges, Rings) {
        let made = CalibratedEdges::from_facets(&mut self.p, &self.facets, &self.volumes, material, spin_radius).unwrap();
        for i in self.cells..self.p.len() {
            self.p.pin(i, true, true);
        }
        made
    }
}

/// A symmetric positive definite matrix: the rows up to the diagonal, and where each begins that is not zero.
pub(crate) struct Stiff {
    rows: Vec<Vec<f64>>,
    first: Vec<usize>,
}

impl Stiff {
    /// The stiffness of edges and rings at rest, of the free particles: position and turn of each.
    pub(crate) fn new(body: &Body, edges: &CalibratedEdges, rings: &Rings) -> Self {
        let n = 6 * body.cells;
        let mut k = vec![vec![0.0; n]; n];
        let x: Vec<DVec3> = body.p.rest_position.iter().map(|x| x.as_dvec3()).collect();
        for (e, ends) in edges.pairs.iter().enumerate() {
            let [i, j] = ends.map(|k| k as usize);
            let at = EdgeStrain::new(edges, e, [x[i], x[j]], [DQuat::IDENTITY; 2]);
            let diagonal = |c: Vec3A| at.axes * DMat3::from_diagonal(c.as_dvec3().recip()) * at.axes.transpose();
            let (stretch, bend) = (diagonal(edges.stretch_compliance[e]), diagonal(edges.bend_compliance[e]));
            let g = at.gradient();
            for a in 0..4 {
                for b in 0..4 {
                    let (i, j) = (ends[a / 2] as usize, ends[b / 2] as usize);
                    if i < body.cells && j < body.cells {
                        let mut block = g[a].transpose() * stretch * g[b];
                        if a % 2 == 1 && b % 2 == 1 {
                            block += bend * if a == b { 1.0 } else { -1.0 };
                        }
                        add(&mut k, 6 * i + 3 * (a % 2), 6 * j + 3 * (b % 2), block);
                    }
                }
            }
        }
        for (r, &middle) in rings.middle.iter().enumerate() {
            let mut gradient = vec![(middle as usize, DVec3::ZERO)];
            for at in rings.starts[r] as usize..rings.starts[r + 1] as usize {
                let j = rings.around[at] as usize;
                let pull = (x[j] - x[middle as usize]).normalize() * f64::from(rings.weight[at][0]);
                gradient.push((j, pull));
                gradient[0].1 -= pull;
            }
            let stiffness = 1.0 / f64::from(rings.compliance[r]).max(1e-30);
            for &(i, a) in &gradient {
                for &(j, b) in &gradient {
                    if i < body.cells && j < body.cells {
                        let b = b * stiffness;
                        add(&mut k, 6 * i, 6 * j, DMat3::from_cols(a * b.x, a * b.y, a * b.z));
                    }
                }
            }
        }
        let first = k.iter().map(|row| row.iter().position(|k| *k != 0.0).unwrap_or(0)).collect();
        let mut this = Self { rows: k, first };
        this.factorise();
        this
    }

    /// L·Lᵀ in place.
    fn factorise(&mut self) {
        let (a, first) = (&mut self.rows, &self.first);
        for i in 0..a.len() {
            for j in first[i]..=i {
                let (done, rest) = a.split_at_mut(i);
                let (row, other) = (&mut rest[0], done.get(j));
                let from = first[i].max(first[j]);
                let dot: f64 = other.unwrap_or(row)[from..j].iter().zip(&row[from..j]).map(|(x, y)| x * y).sum();
                let left = row[j] - dot;
                row[j] = match other {
                    Some(other) => left / other[j],
                    None => {
                        assert!(left > 0.0, "row {i} is not positive");
                        left.sqrt()
                    }
                };
            }
        }
    }

    /// What moves and turns by `force`, the force on each cell and its moment.
    pub(crate) fn respond(&self, force: &dyn Fn(usize) -> [DVec3; 2]) -> Vec<[DVec3; 2]> {
        let a = &self.rows;
        let mut x: Vec<f64> = (0..a.len() / 6).flat_map(|i| force(i).map(|v| v.to_array())).flatten().collect();
        for i in 0..x.len() {
            let dot: f64 = (self.first[i]..i).map(|j| a[i][j] * x[j]).sum();
            x[i] = (x[i] - dot) / a[i][i];
        }
        for i in (0..x.len()).rev() {
            x[i] /= a[i][i];
            for j in self.first[i]..i {
                x[j] -= a[i][j] * x[i];
            }
        }
        x.chunks_exact(6).map(|u| [DVec3::new(u[0], u[1], u[2]), DVec3::new(u[3], u[4], u[5])]).collect()
    }
}

fn add(k: &mut [Vec<f64>], i: usize, j: usize, block: DMat3) {
    for row in 0..3 {
        for column in 0..3 {
            k[i + row][j + column] += block.col(column)[row];
        }
    }
}
