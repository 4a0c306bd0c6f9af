//! Fuzzes the target `pose_matrix` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("pose_matrix");
