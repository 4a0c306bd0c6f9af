//! The binary: turns the command line's result into an exit code, and chooses the allocator.
//!
//! The system's allocator keeps what snapshots and solves worked with, and a server's memory creeps
//! up for days; this one gives it back (decision 0013). Everything else is in `covis::cli`.

use std::process::ExitCode;

#[cfg(unix)]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    covis::cli::run()
}
