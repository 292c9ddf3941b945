//! What the tests of the commands share.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs `polpo` with these arguments.
pub(crate) fn polpo(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_polpo")).args(arguments).output().expect("it starts")
}

pub(crate) fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("UTF-8")
}

/// What it printed, as JSON and nothing else.
pub(crate) fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {} {}", text(&output.stdout), text(&output.stderr)))
}

/// Exit code 2, nothing on standard output, and one line on standard error that says `what`.
pub(crate) fn refused(output: &Output, what: &str) {
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.starts_with("error: ") && error.lines().count() == 1 && error.contains(what), "{error}");
    assert!(output.stdout.is_empty());
}

/// A folder that goes with the value.
pub(crate) struct Folder(PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("polpo_{name}_{}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a folder");
        Folder(path)
    }

    /// The path of a file in it.
    pub(crate) fn at(&self, name: &str) -> String {
        self.0.join(name).to_str().expect("a plain path").into()
    }

    pub(crate) fn write(&self, name: &str, text: &str) -> String {
        std::fs::write(self.0.join(name), text).expect("it can be written");
        self.at(name)
    }

    /// A box of 1 × 0.5 × 0.25 m.
    pub(crate) fn block(&self) -> String {
        let mut obj = String::new();
        for i in 0..8 {
            obj += &format!("v {} {} {}\n", i & 1, 0.5 * f64::from(i >> 1 & 1), 0.25 * f64::from(i >> 2));
        }
        for quad in ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"] {
            obj += &format!("f {quad}\n");
        }
        self.write("block.obj", &obj)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left is in the system's folder for that.
        let _ = std::fs::remove_dir_all(Path::new(&self.0));
    }
}
