//! Fuzzes the target `tokens` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("tokens");
