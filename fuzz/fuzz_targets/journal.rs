//! Fuzzes the target `journal` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("journal");
