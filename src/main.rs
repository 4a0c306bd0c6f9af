//! The binary: turns the command line's result into an exit code, and chooses the allocator.
//!
//! The system's allocator keeps what snapshots and solves worked with, and a server's memory creeps
//! up for days; this one gives it back (settings in `.cargo/config.toml`).

use std::process::ExitCode;

#[cfg(unix)]
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> ExitCode {
    covis::cli::run()
}
