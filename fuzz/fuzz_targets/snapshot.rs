//! Fuzzes the target `snapshot` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("snapshot");
