//! The figures of a run.

use std::collections::BTreeMap;
use std::path::Path;

use bevy::diagnostic::DiagnosticsStore;
use bevy::prelude::*;
use polpo::render::{SKIN_GPU_TIME, SkinningStats};
use polpo::{ImplicitGroups, Particles, SoftBody, SoftBodyModel, SoftBodyScene, SolverSettings, StepTimings, state_hash};
use polpo_rapier::{RapierWorld, penetration};
use serde::Serialize;

use crate::Outfit;

/// Collects what each step took.
#[derive(Resource, Debug, Clone)]
pub struct Recorder {
    scene: &'static str,
    step_ms: Vec<f32>,
    phase_ms: BTreeMap<&'static str, Vec<f32>>,
    skin_ms: Vec<f32>,
}

/// Of a list of durations \[ms\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Half of them took less.
    pub median: f32,
    /// Nineteen of twenty took less.
    pub p95: f32,
    /// The longest.
    pub max: f32,
}

/// What `--stats` writes. Counts are over all bodies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// Name of the scene.
    pub scene: &'static str,
    /// Soft bodies.
    pub bodies: usize,
    /// Particles of all bodies.
    pub particles: usize,
    /// Edges of all bodies.
    pub edges: usize,
    /// Shape-matching groups of all bodies.
    pub groups: usize,
    /// Vertices of all bodies' meshes.
    pub vertices: usize,
    /// Triangles of all bodies' meshes.
    pub triangles: usize,
    /// Particles of each body.
    pub particles_per_body: Vec<usize>,
    /// Edges of each body.
    pub edges_per_body: Vec<usize>,
    /// Length of a step \[s\].
    pub dt: f64,
    /// Substeps a step.
    pub substeps: u32,
    /// Sweeps over the constraints a substep.
    pub iterations: u32,
    /// Threads that simulate.
    pub threads: usize,
    /// Steps taken.
    pub steps: u64,
    /// The whole step.
    pub step_ms: Spread,
    /// Median of each phase \[ms\].
    pub phase_ms: BTreeMap<&'static str, f32>,
    /// Median of skinning all bodies \[ms\]: on the GPU by its own clock, on the CPU by ours; null if nothing was skinned or the GPU has no clock.
    pub skin_ms: Option<f32>,
    /// Where it was skinned: `gpu` or `cpu`.
    pub skinned_on: &'static str,
    /// The graphics adapter; null if none was used.
    pub adapter: Option<String>,
    /// Whether every number of every body is one, and no body was frozen.
    pub finite: bool,
    /// Greatest depth of any particle's ellipsoid in a collider at the end \[m\].
    pub max_penetration_m: f32,
    /// Median of all particles' radii (the mean of the three half axes of each) \[m\], to compare the penetration with.
    pub median_radius_m: f32,
    /// Greatest speed of any particle at the end \[m/s\].
    pub max_speed_m_s: f32,
    /// Hash of the final state to the bit, hexadecimal.
    pub state_hash: String,
}

impl Recorder {
    /// For a scene.
    pub fn new(scene: &'static str) -> Self {
        Self { scene, step_ms: Vec::new(), phase_ms: BTreeMap::new(), skin_ms: Vec::new() }
    }

    /// Steps recorded so far.
    pub fn steps(&self) -> u64 {
        self.step_ms.len() as u64
    }

    /// Sums the run up as the world stands now.
    pub fn stats(world: &mut World, adapter: Option<String>) -> Stats {
        let mut bodies: Vec<Entity> = world.query_filtered::<Entity, With<Particles>>().iter(world).collect();
        bodies.sort();
        let world = &*world;
        let recorder = world.resource::<Recorder>();
        let settings = world.resource::<SolverSettings>();
        let rapier = world.resource::<RapierWorld>();
        let on_cpu = world.get_resource::<SkinningStats>().is_none_or(|stats| stats.on_cpu);
        let gpu_ms = || {
            let diagnostic = world.get_resource::<DiagnosticsStore>()?.get(&SKIN_GPU_TIME)?;
            median(&mut diagnostic.values().map(|&v| v as f32).collect::<Vec<_>>())
        };
        let mut stats = Stats {
            scene: recorder.scene,
            bodies: bodies.len(),
            particles: 0,
            edges: 0,
            groups: 0,
            vertices: 0,
            triangles: 0,
            particles_per_body: Vec::new(),
            edges_per_body: Vec::new(),
            dt: world.resource::<Time<Fixed>>().timestep().as_secs_f64(),
            substeps: settings.substeps,
            iterations: settings.iterations,
            threads: bevy::tasks::ComputeTaskPool::get().thread_num(),
            steps: recorder.steps(),
            step_ms: spread(&recorder.step_ms),
            phase_ms: recorder.phase_ms.iter().map(|(&name, list)| (name, spread(list).median)).collect(),
            skin_ms: if on_cpu { median(&mut recorder.skin_ms.clone()) } else { gpu_ms() },
            skinned_on: if on_cpu { "cpu" } else { "gpu" },
            adapter,
            finite: true,
            max_penetration_m: 0.0,
            median_radius_m: 0.0,
            max_speed_m_s: 0.0,
            state_hash: String::new(),
        };
        let mut radii = Vec::new();
        let mut states = Vec::new();
        for &entity in &bodies {
            let body = world.entity(entity);
            let (Some(particles), Some(transform)) = (body.get::<Particles>(), body.get::<Transform>()) else {
                continue;
            };
            let rig = body.get::<SoftBody>().map(|body| &body.rig);
            let edges = rig.map_or(0, |rig| rig.edges.len());
            stats.particles += particles.len();
            stats.edges += edges;
            stats.particles_per_body.push(particles.len());
            stats.edges_per_body.push(edges);
            stats.groups += body.get::<ImplicitGroups>().map_or(0, |groups| groups.len());
            stats.vertices += rig.map_or(0, |rig| rig.skin.len());
            let model = body.get::<SoftBodyScene>().zip(world.get_resource::<Assets<SoftBodyModel>>());
            let model = model.and_then(|(scene, models)| models.get(&scene.model)).map(SoftBodyModel::mesh);
            if let Some(mesh) = model.or(body.get::<Outfit>().map(|outfit| &outfit.mesh)) {
                stats.triangles += mesh.triangles.len();
            }
            stats.finite &= particles.is_finite() && transform.is_finite() && !body.contains::<polpo::Frozen>();
            let depth = penetration(particles, transform.translation, &rapier.bodies, &rapier.colliders);
            stats.max_penetration_m = stats.max_penetration_m.max(depth);
            let speed = particles.velocity.iter().map(|v| v.length()).fold(0.0, f32::max);
            stats.max_speed_m_s = stats.max_speed_m_s.max(speed);
            radii.extend(particles.radii.iter().map(|r| r.element_sum() / 3.0));
            states.push((transform, particles));
        }
        stats.median_radius_m = median(&mut radii).unwrap_or(0.0);
        stats.state_hash = format!("{:016x}", state_hash(states));
        stats
    }
}

impl Stats {
    /// Writes the figures as JSON.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        let json = serde_json::to_string_pretty(self).map_err(std::io::Error::other)?;
        std::fs::write(path, json + "\n")
    }

    /// Prints what a person wants to know.
    pub(crate) fn print(&self) {
        println!(
            "{}: {} bodies, {} particles, {} edges, {} vertices; {} steps of 1/{:.0} s, {} substeps, {} iterations, {} threads",
            self.scene,
            self.bodies,
            self.particles,
            self.edges,
            self.vertices,
            self.steps,
            1.0 / self.dt,
            self.substeps,
            self.iterations,
            self.threads
        );
        println!(
            "step      median {:.3} ms, 95 % under {:.3} ms, longest {:.3} ms",
            self.step_ms.median, self.step_ms.p95, self.step_ms.max
        );
        for (name, ms) in &self.phase_ms {
            println!("  {name:<18} {ms:.3} ms");
        }
        if let Some(ms) = self.skin_ms {
            println!("skinning  {ms:.3} ms on the {}", self.skinned_on);
        }
        println!(
            "at the end: {}, deepest penetration {:.2} mm, fastest particle {:.3} m/s, state {}",
            if self.finite { "all finite" } else { "NOT FINITE" },
            1000.0 * self.max_penetration_m,
            self.max_speed_m_s,
            self.state_hash
        );
    }
}

/// After each fixed step.
pub(crate) fn record_step(timings: Res<StepTimings>, skinning: Option<Res<SkinningStats>>, mut recorder: ResMut<Recorder>) {
    let ms = |duration: std::time::Duration| 1000.0 * duration.as_secs_f32();
    recorder.step_ms.push(ms(timings.total()));
    for (name, spent) in timings.phases() {
        recorder.phase_ms.entry(name).or_default().push(ms(spent));
    }
    if let Some(skinning) = skinning.filter(|s| s.on_cpu && s.bodies > 0 && !s.cpu_skin_time.is_zero()) {
        recorder.skin_ms.push(ms(skinning.cpu_skin_time));
    }
}

fn median(list: &mut [f32]) -> Option<f32> {
    list.sort_by(f32::total_cmp);
    list.get(list.len() / 2).copied()
}

fn spread(list: &[f32]) -> Spread {
    let mut sorted = list.to_vec();
    sorted.sort_by(f32::total_cmp);
    let at = |share: f32| sorted.get(((sorted.len() as f32 * share) as usize).min(sorted.len().saturating_sub(1))).copied().unwrap_or(0.0);
    Spread { median: at(0.5), p95: at(0.95), max: at(1.0) }
}
