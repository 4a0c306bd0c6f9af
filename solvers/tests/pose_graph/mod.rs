//! Pose graphs: Jacobians, recovery, invariances, determinism, refusals, known optima of files.
//!
//! `graphs` makes the synthetic graphs; the other modules hold the tests, one subject each.

pub(crate) mod graphs;

mod bad_input;
mod bent;
mod chordal;
mod convergence;
mod files;
mod gauge_and_errors;
mod gnss;
mod growing;
mod growing_random;
mod jacobians;
mod landmark_starts;
mod landmarks;
mod priors;
mod ranges;
mod ranges_of_files;
mod recovery;
mod similarity;
mod start;
