//! Integration tests of the solvers, in one binary: a module a subject.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a failed unwrap is a failed test")]
#![allow(clippy::print_stdout, reason = "a skipped test says so in one line")]

mod behind_camera;
mod bundle_adjustment;
mod bundle_checkpoints;
mod bundle_hard;
mod bundle_kernels;
mod bundle_losses;
mod bundle_tracks;
mod certificate;
mod evaluation;
mod factors;
mod free_parameters;
mod geometry;
mod io;
mod linear;
mod linear_solver_choice;
mod marginalization;
mod pose_graph;
mod pose_refinement;
mod prices;
mod reconstruction;
mod residuals;
mod robust;
mod robust_odometry;
mod sparse_cholesky;
mod triangulation;
