//! What rigging a mesh takes, stage by stage, and how well the ellipsoids fit: `measure MESH [PARTICLES] [PLACEMENT] [spheres]`.
//!
//! MESH is a file, `FILE+2` for one whose triangles are cut in four twice, or `sphere:100000` and `terrain:100000` for generated
//! ones with about so many triangles. PLACEMENT is one of auto, surface, volume, medial. With `spheres` it also says how many
//! spheres cover as much.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

use glam::Vec3;
use libm::{cosf, sinf};
use polpo_rig::{Coverage, Mesh, Placement, Recipe, Rig, build_rig, build_rig_with, coverage, read_mesh};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let name = arguments.first().ok_or("measure MESH [PARTICLES] [PLACEMENT] [spheres]")?;
    let particles = arguments.get(1).map_or(Ok(300), |n| n.parse())?;
    let placement = match arguments.get(2).map(String::as_str) {
        Some("surface") => Placement::Surface,
        Some("volume") => Placement::Volume,
        Some("medial") => Placement::Medial,
        _ => Placement::Auto,
    };
    let recipe = Recipe { placement, ..Recipe::with_particles(particles) };
    let mesh = mesh(name)?;

    let start = Instant::now();
    let mut stages: Vec<(String, Instant)> = Vec::new();
    let built = build_rig_with(&mesh, &recipe, &mut |stage| stages.push((format!("{stage:?}"), Instant::now())))?;
    let end = Instant::now();
    let times: Vec<String> = stages
        .iter()
        .enumerate()
        .map(|(s, (stage, from))| {
            let to = stages.get(s + 1).map_or(end, |next| next.1);
            format!("{} {:.2}", stage.to_lowercase(), (to - *from).as_secs_f64())
        })
        .collect();
    let (mesh_size, rig) = (size(&mesh), &built.rig);
    println!(
        "{name}: {} triangles, {} vertices, {} particles, {} edges",
        mesh.triangles.len(),
        mesh.positions.len(),
        rig.particles.len(),
        rig.edges.len()
    );
    println!("  {:.2} s: {}", (end - start).as_secs_f64(), times.join(", "));
    for note in &built.notes {
        println!("  {note}");
    }
    let start = Instant::now();
    let found = coverage(&mesh, rig);
    println!("  {}, measured in {:.2} s", told(found, mesh_size), start.elapsed().as_secs_f64());
    println!("  the skin's weights change {:.1} times a spacing where they change fastest", steepest(&mesh, rig));
    if arguments.iter().any(|a| a == "spheres") {
        spheres(&mesh, &recipe, found)?;
    }
    Ok(())
}

/// How many times weights change from one particle wholly to another on the way of one spacing, at most, along the triangles' sides; a jump is 20.
fn steepest(mesh: &Mesh, rig: &Rig) -> f32 {
    let length = |e: &[u32; 2]| rig.particles[e[0] as usize].position.distance(rig.particles[e[1] as usize].position);
    let spacing = rig.edges.iter().map(length).sum::<f32>() / rig.edges.len().max(1) as f32;
    let sides = mesh.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
    let steepness = sides.map(|side| {
        let [a, b] = side.map(|v| v as usize);
        let mut shares: BTreeMap<u32, f32> = rig.skin[a].used().collect();
        rig.skin[b].used().for_each(|(particle, weight)| *shares.entry(particle).or_default() -= weight);
        let change = 0.5 * shares.values().map(|c| c.abs()).sum::<f32>();
        change / (mesh.positions[a].distance(mesh.positions[b]) / spacing).max(0.05)
    });
    steepness.fold(0.0, f32::max)
}

fn told(c: Coverage, size: f32) -> String {
    format!(
        "covered {:.2} %, bare on average {:.3} %, overhang {:.3} % of the size",
        c.covered * 100.0,
        c.bare / size * 100.0,
        c.overhang / size * 100.0
    )
}

fn size(mesh: &Mesh) -> f32 {
    let (low, high) = mesh.positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |b, p| (b.0.min(*p), b.1.max(*p)));
    (high - low).max_element()
}

/// The rig with a sphere for every ellipsoid, of its volume but for a factor.
fn round(rig: &Rig, factor: f32) -> Rig {
    let mut rig = rig.clone();
    for p in &mut rig.particles {
        p.radii = Vec3::splat(factor * libm::cbrtf(p.radii.element_product()));
    }
    rig
}

/// Spheres as large as makes them stick out as much as the ellipsoids do: how bare they leave the skin.
fn best_spheres(mesh: &Mesh, recipe: &Recipe, particles: usize, like: Coverage) -> Result<Coverage, Box<dyn Error>> {
    let rig = build_rig(mesh, &Recipe { amount: polpo_rig::Amount::Particles(particles), ..recipe.clone() })?;
    let (mut low, mut high) = (0.2_f32, 3.0_f32);
    for _ in 0..10 {
        let middle = 0.5 * (low + high);
        let out = coverage(mesh, &round(&rig, middle)).overhang;
        if out < like.overhang { low = middle } else { high = middle }
    }
    Ok(coverage(mesh, &round(&rig, low)))
}

fn spheres(mesh: &Mesh, recipe: &Recipe, like: Coverage) -> Result<(), Box<dyn Error>> {
    let particles = match recipe.amount {
        polpo_rig::Amount::Particles(n) => n,
        polpo_rig::Amount::Spacing(_) => return Err("a count is needed".into()),
    };
    let size = size(mesh);
    for times in [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0] {
        let count = (particles as f64 * times) as usize;
        let found = best_spheres(mesh, recipe, count, like)?;
        println!("  {count} spheres ({times} times): {}", told(found, size));
        if found.covered >= like.covered && found.bare <= like.bare {
            break;
        }
    }
    Ok(())
}

fn mesh(name: &str) -> Result<Mesh, Box<dyn Error>> {
    if let Some(count) = name.strip_prefix("sphere:") {
        return Ok(sphere(count.parse()?));
    }
    if let Some(count) = name.strip_prefix("terrain:") {
        return Ok(terrain(count.parse()?));
    }
    let (file, cuts) = name.rsplit_once('+').unwrap_or((name, "0"));
    let mut mesh = read_mesh(Path::new(file))?;
    for _ in 0..cuts.parse()? {
        mesh = cut_in_four(&mesh);
    }
    Ok(mesh)
}

/// A ball of radius 1 with bumps, by latitude and longitude.
fn sphere(triangles: usize) -> Mesh {
    let rows = ((triangles / 4) as f32).sqrt() as u32;
    sheet(2 * rows, rows, |u, v| {
        let (longitude, latitude) = (u * std::f32::consts::TAU, (v - 0.5) * std::f32::consts::PI);
        let u = if u == 1.0 { 0.0 } else { u };
        let bump = 1.0 + 0.01 * ((u * 97.0).fract() - 0.5) + 0.05 * sinf(5.0 * latitude) * sinf(7.0 * u * std::f32::consts::TAU);
        let poles = if v == 0.0 || v == 1.0 { 1.0 } else { bump };
        let longitude = if u == 0.0 { 0.0 } else { longitude };
        let across = if v == 0.0 || v == 1.0 { 0.0 } else { cosf(latitude) };
        Vec3::new(cosf(longitude) * across, sinf(latitude), -sinf(longitude) * across) * poles
    })
}

/// An open sheet of 100 by 100 with hills of 5.
fn terrain(triangles: usize) -> Mesh {
    let side = ((triangles / 2) as f32).sqrt() as u32;
    sheet(side, side, |u, v| {
        let height = 3.0 * sinf(11.0 * u) * cosf(9.0 * v) + 1.5 * sinf(31.0 * u + 5.0 * v) + 0.5 * cosf(67.0 * v - 20.0 * u);
        Vec3::new(100.0 * u, height, -100.0 * v)
    })
}

fn sheet(columns: u32, rows: u32, place: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let mut mesh = Mesh { name: "sheet".into(), ..Mesh::default() };
    for j in 0..=rows {
        for i in 0..=columns {
            mesh.positions.push(place(i as f32 / columns as f32, j as f32 / rows as f32));
            if i < columns && j < rows {
                let a = j * (columns + 1) + i;
                let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    mesh.normals = vec![Vec3::Y; mesh.positions.len()];
    mesh
}

fn cut_in_four(mesh: &Mesh) -> Mesh {
    let mut fine = Mesh { name: mesh.name.clone(), positions: mesh.positions.clone(), ..Mesh::default() };
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        let [ab, bc, ca] = [[a, b], [b, c], [c, a]].map(|[a, b]| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                fine.positions.push((mesh.positions[a as usize] + mesh.positions[b as usize]) * 0.5);
                fine.positions.len() as u32 - 1
            })
        });
        fine.triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    fine.normals = vec![Vec3::Y; fine.positions.len()];
    fine
}
