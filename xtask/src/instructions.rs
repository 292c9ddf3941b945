//! `cargo xtask instructions`: how many instructions each kernel takes, as callgrind counts them, in benches/instructions.json. Unlike times they are the same on every run, so that CI can hold them.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde::{Deserialize, Serialize};

/// The checked-in counts.
const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../benches/instructions.json");
/// By how much dearer a kernel may be than it was.
const TOLERANCE: f64 = 0.05;
/// The function of the counted program between whose beginning and end is counted. By its whole name: dumps know no wildcards.
const COUNTED: &str = "instructions::counted_by_callgrind";

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Write nothing; fail if a kernel takes over 5 % more instructions than benches/instructions.json says.
    #[arg(long)]
    check: bool,
}

/// Why kernels were not counted, or are not what they were.
#[derive(Debug, thiserror::Error)]
pub(crate) enum InstructionsError {
    /// There is nothing to count with, and so nothing to write.
    #[error("valgrind is not installed")]
    NoValgrind,
    /// A program could not be started.
    #[error("{program} could not be started: {source}")]
    NotStarted {
        /// Which.
        program: &'static str,
        /// Why.
        source: io::Error,
    },
    /// A program failed.
    #[error("{program} failed:\n{output}")]
    Failed {
        /// Which.
        program: &'static str,
        /// What it wrote to its standard error.
        output: String,
    },
    /// Cargo did not say where the program is that it built.
    #[error("cargo did not say where it put the program to count")]
    NoProgram,
    /// The program or callgrind wrote something else than they should.
    #[error("not understood: {0}")]
    Format(String),
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The checked-in counts are not as this command writes them.
    #[error("{PATH}: {0}")]
    Json(#[from] serde_json::Error),
    /// Kernels cost more, or are others than those in the file.
    #[error("{0}")]
    Differs(String),
}

/// The file's content.
#[derive(Debug, Serialize, Deserialize)]
struct Counts {
    /// Whose instructions.
    processor: String,
    /// Who chose them.
    compiler: String,
    kernels: Vec<Count>,
}

/// What one kernel takes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Count {
    body: String,
    kernel: String,
    unit: String,
    /// Instructions a unit, to a tenth.
    instructions: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), InstructionsError> {
    if !has_valgrind()? {
        if arguments.check {
            println!("SKIPPED: valgrind is not installed, so no instructions were counted");
            return Ok(());
        }
        return Err(InstructionsError::NoValgrind);
    }
    let counts = count()?;
    let before = match read() {
        Err(InstructionsError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound && !arguments.check => None,
        before => Some(before?),
    };
    let comparable = before.as_ref().is_none_or(|before| before.processor == counts.processor);
    print(&counts, before.as_ref().filter(|_| comparable));
    match before.filter(|_| arguments.check) {
        None => {
            let text = serde_json::to_string_pretty(&counts)? + "\n";
            fs::write(PATH, text).map_err(|source| InstructionsError::Io { path: PATH.into(), source })
        }
        Some(before) if !comparable => {
            println!("SKIPPED: the file has instructions of {}; these are of {}", before.processor, counts.processor);
            Ok(())
        }
        Some(before) => compare(&before, &counts),
    }
}

fn has_valgrind() -> Result<bool, InstructionsError> {
    match Command::new("valgrind").arg("--version").output() {
        Ok(output) => Ok(output.status.success()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(source) => Err(InstructionsError::NotStarted { program: "valgrind", source }),
    }
}

/// Builds the program that runs the kernels, and counts.
fn count() -> Result<Counts, InstructionsError> {
    let program = build()?;
    let folder = program.with_extension("callgrind");
    let io = |source| InstructionsError::Io { path: folder.clone(), source };
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(io)?;
    }
    fs::create_dir_all(&folder).map_err(io)?;
    let dump = folder.join("out");
    let mut callgrind = Command::new("valgrind");
    callgrind.arg("--tool=callgrind").arg(format!("--callgrind-out-file={}", dump.display()));
    callgrind.args(["--toggle-collect=", "--dump-after="].map(|option| format!("{option}{COUNTED}"))).arg(&program);
    let listing = output("valgrind", &mut callgrind)?;
    let mut lines = listing.lines();
    let processor = lines.next().unwrap_or_default().to_owned();
    let mut kernels = Vec::new();
    for (k, line) in lines.enumerate() {
        let unreadable = || InstructionsError::Format(line.to_owned());
        let &[number, body, kernel, unit] = &line.split('\t').collect::<Vec<_>>()[..] else { return Err(unreadable()) };
        let number: f64 = number.parse().map_err(|_| unreadable())?;
        // One dump a kernel, numbered from 1.
        let total = total(&dump.with_extension((k + 1).to_string()))?;
        let instructions = (10.0 * total as f64 / number).round() / 10.0;
        kernels.push(Count { body: body.into(), kernel: kernel.into(), unit: unit.into(), instructions });
    }
    let compiler = output("rustc", Command::new("rustc").arg("--version"))?.trim().to_owned();
    Ok(Counts { processor, compiler, kernels })
}

fn build() -> Result<PathBuf, InstructionsError> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(["build", "--release", "-p", "polpo_benches", "--bin", "instructions", "--message-format=json-render-diagnostics"]);
    let messages = output("cargo", command.stderr(std::process::Stdio::inherit()))?;
    let executable = |line: &str| {
        let message: serde_json::Value = serde_json::from_str(line).ok()?;
        message["executable"].as_str().map(PathBuf::from)
    };
    messages.lines().filter_map(executable).next_back().ok_or(InstructionsError::NoProgram)
}

/// What `command` writes to its standard output.
fn output(program: &'static str, command: &mut Command) -> Result<String, InstructionsError> {
    let Output { status, stdout, stderr } = command.output().map_err(|source| InstructionsError::NotStarted { program, source })?;
    if !status.success() {
        return Err(InstructionsError::Failed { program, output: String::from_utf8_lossy(&stderr).into_owned() });
    }
    Ok(String::from_utf8_lossy(&stdout).into_owned())
}

/// How many instructions one of callgrind's dumps tells of.
fn total(path: &Path) -> Result<u64, InstructionsError> {
    let dump = fs::read_to_string(path).map_err(|source| InstructionsError::Io { path: path.into(), source })?;
    let total = dump.lines().find_map(|line| line.strip_prefix("totals: ")).and_then(|total| total.trim().parse().ok());
    total.filter(|&total| total > 0).ok_or_else(|| InstructionsError::Format(format!("{}: nothing was counted", path.display())))
}

fn read() -> Result<Counts, InstructionsError> {
    let text = fs::read_to_string(PATH).map_err(|source| InstructionsError::Io { path: PATH.into(), source })?;
    Ok(serde_json::from_str(&text)?)
}

impl Counts {
    fn find(&self, like: &Count) -> Option<&Count> {
        self.kernels.iter().find(|count| count.body == like.body && count.kernel == like.kernel)
    }
}

fn print(counts: &Counts, before: Option<&Counts>) {
    println!("Instructions of {}, by {}.\n", counts.processor, counts.compiler);
    println!("{:<8} {:<40} {:<9} {:>12} {:>9} {:>8}", "body", "kernel", "unit", "instructions", "before", "change");
    for count in &counts.kernels {
        let Count { body, kernel, unit, instructions } = count;
        print!("{body:<8} {kernel:<40} {unit:<9} {instructions:>12.1}");
        match before.and_then(|before| before.find(count)) {
            Some(old) => println!(" {:>9.1} {:>+7.1}%", old.instructions, 100.0 * (instructions / old.instructions - 1.0)),
            None => println!(),
        }
    }
    println!();
}

/// Fails if a kernel takes more than it did, is new or is gone.
fn compare(before: &Counts, now: &Counts) -> Result<(), InstructionsError> {
    let mut faults = Vec::new();
    for count in &now.kernels {
        match before.find(count) {
            None => faults.push(format!("{}/{} is not in the file", count.body, count.kernel)),
            Some(old) if count.instructions > old.instructions * (1.0 + TOLERANCE) => {
                faults.push(format!(
                    "{}/{} takes {:.1} instructions a {} instead of {:.1}",
                    count.body, count.kernel, count.instructions, count.unit, old.instructions
                ));
            }
            Some(_) => {}
        }
    }
    let gone = before.kernels.iter().filter(|old| now.find(old).is_none());
    faults.extend(gone.map(|old| format!("{}/{} is in the file, and there is no such kernel", old.body, old.kernel)));
    if faults.is_empty() {
        return Ok(());
    }
    if before.compiler != now.compiler {
        faults.push(format!("counted with {}, the file with {}", now.compiler, before.compiler));
    }
    faults.push("if that is as it should be, run `cargo xtask instructions` and commit the result".into());
    Err(InstructionsError::Differs(faults.join("\n")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(kernels: &[(&str, f64)]) -> Counts {
        let count = |&(kernel, instructions): &(&str, f64)| Count {
            body: "octopus".into(),
            kernel: kernel.into(),
            unit: "group".into(),
            instructions,
        };
        Counts { processor: "any".into(), compiler: "any".into(), kernels: kernels.iter().map(count).collect() }
    }

    #[test]
    fn what_got_dearer_is_named() {
        let before = counts(&[("a", 100.0), ("b", 100.0), ("c", 100.0)]);
        assert!(compare(&before, &counts(&[("a", 104.9), ("b", 100.0), ("c", 10.0)])).is_ok());
        let Err(InstructionsError::Differs(why)) = compare(&before, &counts(&[("a", 105.1), ("b", 100.0), ("d", 1.0)])) else {
            panic!("dearer, new and gone kernels are not told")
        };
        assert!(why.contains("octopus/a takes 105.1") && why.contains("octopus/c is in the file") && why.contains("octopus/d is not"));
        assert!(!why.contains("octopus/b"));
    }

    /// The checked-in file is one that this command reads.
    #[test]
    fn the_file_can_be_read() {
        assert!(!read().expect("it is in the repository").kernels.is_empty());
    }
}
