//! The binary: turns the command line's result into an exit code, nothing else.

use std::process::ExitCode;

fn main() -> ExitCode {
    covis::cli::run()
}
