//! Fuzzes the target `colmap_binary` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("colmap_binary");
