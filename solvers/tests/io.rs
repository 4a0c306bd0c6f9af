//! Readers and writers: round trips, conversions, refusals that name the place, and no panics.

mod bal;
mod bundler;
mod colmap;
pub(crate) mod data;
mod g2o;
mod g2o_landmarks;
mod openmvg;
mod ply;
mod pyfg;
mod robustness;
mod sparse_model;
mod trajectory;

use covis_solvers::io::IoError;

/// Asserts that reading fails and that the message names everything in `parts`.
#[track_caller]
pub(crate) fn refused<T>(result: Result<T, IoError>, parts: &[&str]) {
    let Err(error) = result else { panic!("accepted, expected a refusal with {parts:?}") };
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "`{message}` does not name `{part}`");
    }
}
