//! Fuzzes the target `map_file` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("map_file");
