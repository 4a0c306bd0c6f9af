//! Fuzzes the target `jwt` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("jwt");
