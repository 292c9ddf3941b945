//! Runs every kernel once where callgrind can count its instructions: what `cargo xtask instructions` counts.
//!
//! Writes to standard output whose instructions it runs, then a line a kernel, in the order in which they are run: how many units it works on, and, behind a tabulator each, the body, the kernel and the unit.

use std::hint::black_box;

use polpo_benches::kernels::{self, Kernel};

fn main() {
    println!("{}", processor());
    for mut kernel in kernels::all() {
        // What is made once is not counted.
        kernel.run();
        kernel.reset();
        counted_by_callgrind(&mut kernel);
        println!("{}\t{}\t{}\t{}", kernel.count, kernel.body, kernel.name, kernel.unit);
    }
}

/// Callgrind counts between this function's beginning and its end.
#[inline(never)]
fn counted_by_callgrind(kernel: &mut Kernel) {
    kernel.run();
    // A jump into the kernel, as the last thing that is done here, would have no end.
    black_box(());
}

/// What the processor is and, of what decides how wide kernels are, has. Callgrind knows no AVX-512, and says that there is none.
#[cfg(target_arch = "x86_64")]
fn processor() -> String {
    use std::arch::is_x86_feature_detected as has;
    let features = [("sse4.2", has!("sse4.2")), ("avx2", has!("avx2")), ("fma", has!("fma")), ("avx512f", has!("avx512f"))];
    features.into_iter().filter(|(_, there)| *there).fold("x86_64".into(), |all, (name, _)| format!("{all} {name}"))
}

#[cfg(not(target_arch = "x86_64"))]
fn processor() -> String {
    std::env::consts::ARCH.into()
}
