//! The command as one types it.

mod commands;
mod common;
mod references;
