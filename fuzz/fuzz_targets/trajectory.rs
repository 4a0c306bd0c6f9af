//! Fuzzes the target `trajectory` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("trajectory");
