//! From the implicit shape to a first, fine mesh; and the check that it is one closed surface.

use std::collections::BTreeMap;

use fast_surface_nets::ndshape::{RuntimeShape, Shape as _};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::{DVec3, UVec3};

use super::OctopusError;
use super::shape::Shape;

/// Side of the sampling grid's cells \[m\]: the arms' tips are two and a half cells thick.
const CELL: f64 = 0.009;
/// Points along a block of the grid.
const BLOCK: u32 = 6;
const LOW: DVec3 = DVec3::new(-0.66, -0.42, -0.66);
const HIGH: DVec3 = DVec3::new(0.66, 0.54, 0.66);

/// Surface nets over a grid, then every vertex moved onto the skin.
pub(crate) fn mesh(shape: &Shape) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let counts = ((HIGH - LOW) / CELL).ceil().as_uvec3();
    let grid = RuntimeShape::<u32, 3>::new(counts.to_array());
    let mut samples = sample(shape, &grid, counts);
    untangle(&mut samples, &grid, counts);
    let mut net = SurfaceNetsBuffer::default();
    surface_nets(&samples, &grid, [0; 3], counts.to_array().map(|n| n - 1), &mut net);

    let positions: Vec<DVec3> =
        net.positions.iter().map(|&[x, y, z]| shape.project(LOW + DVec3::new(x.into(), y.into(), z.into()) * CELL)).collect();
    let mut triangles = net.indices.as_chunks::<3>().0.to_vec();
    let volume: f64 = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            a.dot(b.cross(c))
        })
        .sum();
    if volume < 0.0 {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    (positions, triangles)
}

/// Distances at the grid's points, exact near the skin; a block of points that the skin can't cross takes the one of its middle.
fn sample(shape: &Shape, grid: &RuntimeShape<u32, 3>, counts: UVec3) -> Vec<f32> {
    let mut samples = vec![0.0; grid.usize()];
    let blocks = counts / BLOCK + 1;
    for block in 0..blocks.element_product() {
        let at = UVec3::new(block % blocks.x, block / blocks.x % blocks.y, block / blocks.x / blocks.y);
        let first = at * BLOCK;
        let last = (first + BLOCK).min(counts);
        let middle = shape.distance(LOW + (first.as_dvec3() + f64::from(BLOCK) * 0.5) * CELL);
        // The function's slope is at most 1.5.
        let far = middle.abs() > 1.5 * 0.87 * f64::from(BLOCK) * CELL;
        for z in first.z..last.z {
            for y in first.y..last.y {
                for x in first.x..last.x {
                    let point = LOW + DVec3::new(x.into(), y.into(), z.into()) * CELL;
                    let value = if far { middle } else { shape.distance(point) };
                    samples[grid.linearize([x, y, z]) as usize] = value as f32;
                }
            }
        }
    }
    samples
}

/// Removes the one case in which surface nets makes no surface: a face of the grid with inside and outside crosswise, as where a
/// round ridge just breaks through it. The weakest of its corners changes sides, which moves the skin by less than the later
/// projection brings back.
fn untangle(samples: &mut [f32], grid: &RuntimeShape<u32, 3>, counts: UVec3) {
    let mut crosswise = true;
    while crosswise {
        crosswise = false;
        for i in 0..grid.size() {
            let at = UVec3::from(grid.delinearize(i));
            for (u, v) in [(UVec3::X, UVec3::Y), (UVec3::Y, UVec3::Z), (UVec3::Z, UVec3::X)] {
                if (at + u + v).cmpge(counts).any() {
                    continue;
                }
                let corners = [at, at + u, at + u + v, at + v].map(|c| grid.linearize(c.to_array()) as usize);
                let inside = corners.map(|c| samples[c] < 0.0);
                if inside[0] == inside[2] && inside[1] == inside[3] && inside[0] != inside[1] {
                    let weakest = corners.into_iter().min_by(|&a, &b| samples[a].abs().total_cmp(&samples[b].abs()));
                    if let Some(weakest) = weakest {
                        samples[weakest] = if samples[weakest] < 0.0 { 1e-6 } else { -1e-6 };
                        crosswise = true;
                    }
                }
            }
        }
    }
}

/// Fails unless the mesh is one closed, manifold surface without handles: V − E + F = 2, every side in two triangles, one part.
pub(crate) fn check_sphere(positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<(), OctopusError> {
    let mut sides: BTreeMap<[u32; 2], [u32; 2]> = BTreeMap::new();
    let mut part: Vec<usize> = (0..positions.len()).collect();
    let root = |part: &[usize], mut v: usize| {
        while part[v] != v {
            v = part[v];
        }
        v
    };
    for t in triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            // How often the side is walked up, and how often down.
            sides.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
            let (a, b) = (root(&part, a as usize), root(&part, b as usize));
            part[a.max(b)] = a.min(b);
        }
    }
    let open = sides.values().filter(|&&uses| uses != [1, 1]).count();
    let parts = (0..part.len()).filter(|&v| part[v] == v).count();
    let euler = positions.len() as i64 - sides.len() as i64 + triangles.len() as i64;
    if euler == 2 && open == 0 && parts == 1 { Ok(()) } else { Err(OctopusError::NotASphere { euler, open, parts }) }
}
