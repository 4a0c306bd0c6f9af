//! Tools for tests and demonstrations: numeric Jacobians, group laws, linear systems, seeded sampling.
//!
//! These functions assert, so they panic on purpose when a law fails; no solver code may call
//! them. Every random number comes from an explicit seed. Shared data are looked for in
//! `../shared/data` beside the repository, or where `COVIS_TEST_DATA` points.

pub mod hessian;
pub mod jacobian;
pub mod laws;
pub mod random;
pub mod scene;

use std::io::Write;
use std::path::{Path, PathBuf};

pub use hessian::{lower_triangle, normal_equations};
pub use jacobian::{JacobianMismatch, assert_jacobian, central_difference, check_jacobian};
pub use laws::{assert_group_laws, assert_tangent_laws};
pub use scene::{Scene, SceneObservation, SceneOptions};

/// The path of a data file or folder; `None` after [`skip`] where it is missing.
///
/// # Panics
/// Where it is missing and `COVIS_TEST_DATA_REQUIRED` is 1: a machine that has the data must not pass
/// without them.
#[must_use]
pub fn data(relative: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let root = std::env::var_os("COVIS_TEST_DATA").map_or_else(beside, PathBuf::from);
    let path = root.join(relative);
    if path.exists() {
        return Some(path);
    }
    let is_required = std::env::var_os("COVIS_TEST_DATA_REQUIRED").is_some_and(|v| v == "1");
    assert!(!is_required, "{} is missing, and COVIS_TEST_DATA_REQUIRED is 1", path.display());
    skip(&format!("no data ({relative})"));
    None
}

/// Tells that a test, or a part of it, cannot run here, and why: in its output and, where
/// `COVIS_TEST_SKIPPED` names a file, as a line of that file, so that a gate can list what it did not
/// see.
pub fn skip(why: &str) {
    // Not by the macro, whose output the harness keeps to itself when a test passes.
    let _unseen = writeln!(std::io::stderr(), "skipped: {why}");
    if let Some(list) = std::env::var_os("COVIS_TEST_SKIPPED") {
        let thread = std::thread::current();
        let line = format!("{}: {why}\n", thread.name().unwrap_or_default());
        let file = std::fs::OpenOptions::new().create(true).append(true).open(list);
        // A list that cannot be written is no reason for a test to fail.
        let _lost = file.and_then(|mut file| file.write_all(line.as_bytes()));
    }
}
