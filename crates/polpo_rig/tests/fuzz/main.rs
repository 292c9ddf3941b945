//! Whatever a file holds, reading it ends with a mesh, a rig or an error that names the file, and in little memory.

mod bombs;
mod counting;
mod large;
mod mutate;

#[path = "../seeds/mod.rs"]
mod seeds;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use mutate::{Mutation, mutated};
use polpo_rig::{Rig, parse_mesh};
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;

/// Bytes of memory that reading may take for each of the file, beside [`FLOOR`].
const GROWTH: usize = 128;
/// What a glTF or OBJ may grow to anyway, twice, since a list that grows is there twice for a moment.
const FLOOR: usize = 128 << 20;

/// Reads a file of the format that its name tells; what is wrong with the outcome, if anything is.
fn outcome(name: &str, bytes: &[u8]) -> Result<(), String> {
    let read = || match name.rsplit('.').next() {
        Some("ron") => Rig::from_ron(name, &String::from_utf8_lossy(bytes)).and_then(|rig| rig.validate()).map_err(|e| e.to_string()),
        Some("rig") => Rig::from_postcard(name, bytes).and_then(|rig| rig.validate()).map_err(|e| e.to_string()),
        _ => parse_mesh(name, bytes).and_then(|mesh| mesh.validate()).map_err(|e| e.to_string()),
    };
    let (result, peak) = counting::peak(|| catch_unwind(AssertUnwindSafe(read)));
    match result {
        Err(_) => Err("it panics".into()),
        Ok(Err(error)) if !error.starts_with(&format!("{name}: ")) => Err(format!("{error:?} does not name the file")),
        Ok(Err(error)) if error.len() > 2000 => Err(format!("an error of {} bytes", error.len())),
        Ok(_) if peak > FLOOR + GROWTH * bytes.len() => Err(format!("{peak} bytes of memory for {} of the file", bytes.len())),
        Ok(_) => Ok(()),
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 4000,
        failure_persistence: Some(Box::new(FileFailurePersistence::Off)),
        rng_seed: proptest::test_runner::RngSeed::Fixed(17),
        ..ProptestConfig::default()
    })]

    #[test]
    fn spoilt_files_are_read_or_refused(
        seed in any::<prop::sample::Index>(),
        other in any::<prop::sample::Index>(),
        mutations in prop::collection::vec(any::<Mutation>(), 1..6),
    ) {
        let seeds = seeds::all();
        let (name, file) = seed.get(&seeds);
        let (_, other) = other.get(&seeds);
        prop_assert_eq!(outcome(name, &mutated(file, other, &mutations)), Ok(()));
    }
}

#[test]
fn every_beginning_of_a_file_is_read_or_refused() {
    for (name, file) in seeds::all() {
        for end in 0..=file.len() {
            assert_eq!(outcome(name, &file[..end]), Ok(()), "{name}, the first {end} bytes");
        }
    }
}

/// `POLPO_FUZZ_SECONDS=600 cargo test --release -p polpo_rig --test fuzz -- --ignored --nocapture`; `POLPO_FUZZ_SEED` begins elsewhere.
#[test]
#[ignore = "runs for as long as it is told"]
fn for_a_time() {
    let number = |name: &str, or: u64| std::env::var(name).ok().and_then(|x| x.parse().ok()).unwrap_or(or);
    let seconds = Duration::from_secs(number("POLPO_FUZZ_SECONDS", 10));
    let first = number("POLPO_FUZZ_SEED", 0);
    let seeds = seeds::all();
    let begin = Instant::now();
    let (mut round, mut read, mut slowest, mut faults) = (first, 0, (Duration::ZERO, 0), Vec::new());
    while begin.elapsed() < seconds && faults.len() < 20 {
        let mut state = round.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x2545_f491_4f6c_dd1d);
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 16) as u32
        };
        let (name, file) = &seeds[random() as usize % seeds.len()];
        let (_, other) = &seeds[random() as usize % seeds.len()];
        let mutations: Vec<Mutation> = (0..1 + random() % 8).map(|_| (random() as u8, random(), random(), random())).collect();
        let bytes = mutated(file, other, &mutations);
        let start = Instant::now();
        match outcome(name, &bytes) {
            Ok(()) => read += 1,
            Err(fault) => {
                println!("round {round}, {name}: {fault}");
                faults.push((round, fault));
            }
        }
        slowest = slowest.max((start.elapsed(), round));
        round += 1;
    }
    println!("{read} files in {:?}; the slowest took {:?}, round {}", begin.elapsed(), slowest.0, slowest.1);
    assert!(faults.is_empty(), "{faults:?}");
}
