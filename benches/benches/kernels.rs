//! What each kernel of the solver takes, alone; and how much faster those in vector lanes are than the same in plain glam.

use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use polpo_benches::kernels::{self, Kernel, SCALAR};
use polpo_benches::measure::Times;

/// How often each of two is run for their ratio.
const ROUNDS: usize = 3000;

fn kernels(criterion: &mut Criterion) {
    let mut kernels = kernels::all();
    for body in ["octopus", "block"] {
        let mut group = criterion.benchmark_group(format!("kernels/{body}"));
        group.sample_size(20).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
        for kernel in kernels.iter_mut().filter(|kernel| kernel.body == body) {
            group.throughput(Throughput::Elements(kernel.count as u64));
            let name = format!("{} ({}s)", kernel.name, kernel.unit);
            group.bench_function(name, |bencher| bencher.iter_custom(|runs| kernel.time(runs)));
        }
        group.finish();
    }
    compare(&mut kernels);
}

/// Runs the kernels that there are twice in turns, and prints the best time of either.
fn compare(kernels: &mut [Kernel]) {
    println!("\n{:<8} {:<26} {:>6} {:>9} {:>9} {:>6}", "body", "kernel", "unit", "wide/ns", "scalar/ns", "ratio");
    for k in 1..kernels.len() {
        let [wide, scalar] = &mut kernels[k - 1..=k] else { continue };
        if scalar.name.strip_suffix(SCALAR) != Some(wide.name) {
            continue;
        }
        let mut times = <[Times; 2]>::default();
        for _ in 0..ROUNDS {
            for (kernel, times) in [&mut *wide, &mut *scalar].into_iter().zip(&mut times) {
                times.note(kernel.time(1));
            }
        }
        let [a, b] = times.map(|times| 1e3 * times.best() / wide.count as f64);
        println!("{:<8} {:<26} {:>6} {a:>9.1} {b:>9.1} {:>6.2}", wide.body, wide.name, wide.unit, b / a);
    }
}

criterion_group!(benches, kernels);
criterion_main!(benches);
