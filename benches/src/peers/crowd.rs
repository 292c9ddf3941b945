//! A crowd of octopuses, or one large body, in a process of its own: how many threads a process has is settled with its first world.

use std::io::{self, BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bevy::prelude::*;
use polpo::prelude::SelfContact;
use polpo::{Particles, SoftBody, state_hash};
use polpo_benches::{cube, octopus};

use crate::ours::Ours;
use crate::scene::Scene;

/// A hundred thousand particles in octopuses.
const COUNT: usize = 333;

/// A step for every line of standard input; answers with what it took \[ns\] and the hash of all bodies.
///
/// A crowd, or one body of `side`³ particles that does not touch itself.
pub(crate) fn serve(threads: usize, side: Option<usize>) -> io::Result<()> {
    let crowd = match side {
        Some(side) => Ours::with_threads(threads, &Arc::new(cube(side)), &Scene::apart(1), |body| _ = body.remove::<SelfContact>()),
        None => Ours::with_threads(threads, &octopus().1, &Scene::apart(COUNT), |_| {}),
    };
    let mut crowd = crowd.settled();
    let mut out = io::stdout().lock();
    for line in io::stdin().lock().lines() {
        line?;
        let started = Instant::now();
        crowd.step();
        let nanoseconds = started.elapsed().as_nanos();
        let world = crowd.app.world_mut();
        let mut bodies = world.query_filtered::<(&Transform, &Particles), With<SoftBody>>();
        writeln!(out, "{nanoseconds} {}", state_hash(bodies.iter(world)))?;
        out.flush()?;
    }
    Ok(())
}

/// A crowd that another process steps.
pub(crate) struct Crowd {
    child: Child,
    ask: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
}

impl Crowd {
    /// Starts one on so many threads, or a body of `side`³ particles.
    pub(crate) fn start(threads: usize, side: Option<usize>) -> io::Result<Self> {
        let side = side.map(|side| ["--side".to_owned(), side.to_string()]);
        let mut child = Command::new(std::env::current_exe()?)
            .args(["--crowd", &threads.to_string()])
            .args(side.iter().flatten())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let (ask, answers) = (child.stdin.take(), child.stdout.take().map(BufReader::new));
        let answers = answers.ok_or_else(|| io::Error::other("the process has no output"))?;
        Ok(Self { child, ask, answers })
    }

    /// What a step took, and the hash of all bodies after it.
    pub(crate) fn step(&mut self) -> io::Result<(Duration, u64)> {
        let ask = self.ask.as_mut().ok_or_else(|| io::Error::other("the process has no input"))?;
        writeln!(ask)?;
        ask.flush()?;
        let mut answer = String::new();
        self.answers.read_line(&mut answer)?;
        let parsed = answer.split_once(' ').and_then(|(time, hash)| Some((time.parse().ok()?, hash.trim().parse().ok()?)));
        let (nanoseconds, hash) = parsed.ok_or_else(|| io::Error::other(format!("the process answered `{answer}`")))?;
        Ok((Duration::from_nanos(nanoseconds), hash))
    }
}

impl Drop for Crowd {
    /// Without input it ends.
    fn drop(&mut self) {
        self.ask = None;
        let _ = self.child.wait();
    }
}
