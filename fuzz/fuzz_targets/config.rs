//! Fuzzes the target `config` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("config");
