//! Fuzzes the target `g2o` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("g2o");
