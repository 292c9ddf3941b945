//! What skinning on the CPU takes, beside a loop that only reads and writes as much memory.

use std::hint::black_box;
use std::time::Duration;

use bevy::math::{Quat, Vec3};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use polpo_benches::measure::in_turns;
use polpo_benches::octopus;
use polpo_skinning::cpu::{SkinnedVertices, skin};
use polpo_skinning::{Binding, ParticleTransform, RestMesh};

/// How many vertices are skinned.
const VERTICES: usize = 63_000;
/// How much longer than the stream the skinning may take.
const WANTED: f64 = 3.0;
const ROUNDS: usize = 500;

/// A mesh and how its particles are, and where its vertices go: positions and normals.
struct Skin {
    binding: Binding,
    transforms: Vec<ParticleTransform>,
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
}

impl Skin {
    /// The octopus' mesh, in slightly larger copies of itself up to [`VERTICES`] vertices with up to four influences each, its particles turned this way and that.
    fn new() -> Self {
        let (mesh, rig) = octopus();
        let copies = |values: &[Vec3], growth: f32| -> Vec<[f32; 3]> {
            let count = values.len();
            (0..VERTICES).map(|i| (values[i % count] * (1.0 + growth * (i / count) as f32)).into()).collect()
        };
        let (positions, normals) = (copies(&mesh.positions, 0.002), copies(&mesh.normals, 0.0));
        let particles: Vec<Vec3> = rig.particles.iter().map(|p| p.position).collect();
        let influences = (0..VERTICES).map(|i| rig.skin[i % rig.skin.len()]).map(|influences| (influences.particles, influences.weights));
        let rest = RestMesh { positions: &positions, normals: &normals, tangents: &[] };
        let binding = Binding::new(rest, &particles, influences).expect("the octopus' rig fits its mesh");
        let pose = |(i, &rest): (usize, &Vec3)| {
            let rotation = Quat::from_scaled_axis(Vec3::new(0.3, -0.2, 0.1) * (i as f32).sin());
            ParticleTransform::new(rest * 1.1, rotation, 1.0, rest)
        };
        let transforms = binding.rest_particles().iter().enumerate().map(pose).collect();
        Self { binding, transforms, positions, normals }
    }

    fn skin(&mut self) {
        let out = SkinnedVertices { positions: &mut self.positions, normals: Some(&mut self.normals), tangents: None };
        assert!(skin(&self.binding, &self.transforms, out), "there is a transform for each particle");
    }
}

/// The floor of what skinning can take: reads 48 bytes a vertex and writes 24.
struct Stream {
    from: Vec<[f32; 12]>,
    to: Vec<[f32; 6]>,
}

impl Stream {
    fn new() -> Self {
        Self { from: vec![[1.5; 12]; VERTICES], to: vec![[0.0; 6]; VERTICES] }
    }

    fn copy(&mut self) {
        for (from, to) in self.from.iter().zip(&mut self.to) {
            for k in 0..6 {
                to[k] = from[k] + from[k + 6];
            }
        }
        black_box(&mut self.to);
    }
}

fn skinning(criterion: &mut Criterion) {
    let (mut mesh, mut stream) = (Skin::new(), Stream::new());
    let mut group = criterion.benchmark_group("skinning");
    group.sample_size(20).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    group.throughput(Throughput::Elements(VERTICES as u64));
    group.bench_function("cpu", |bencher| bencher.iter(|| mesh.skin()));
    group.bench_function("stream", |bencher| bencher.iter(|| stream.copy()));
    group.finish();
    let times = in_turns(ROUNDS, || mesh.skin(), || stream.copy());
    let [ours, floor] = times.each_ref().map(|times| times.best());
    let [our_median, floor_median] = times.each_ref().map(|times| times.median());
    let (ratio, median) = (ours / floor, our_median / floor_median);
    let reached = if ratio <= WANTED { "reached" } else { "missed" };
    println!(
        "\nskinning {VERTICES} vertices: {ours:.0} µs, the stream {floor:.0} µs: {ratio:.2} times as long, by the medians {median:.2}; wanted at most {WANTED:.0}: {reached}"
    );
}

criterion_group!(benches, skinning);
criterion_main!(benches);
