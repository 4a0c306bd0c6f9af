//! Fuzzes the target `volume` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("volume");
