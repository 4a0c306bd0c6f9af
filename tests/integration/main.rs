//! The integration tests, one binary: the map's invariants, the service over loopback, the cli.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a failed unwrap is a failed test")]
#![allow(clippy::print_stderr, reason = "a skipped test says so in one line")]

mod map_check;
mod map_fold;
mod map_problem;
mod map_support;
