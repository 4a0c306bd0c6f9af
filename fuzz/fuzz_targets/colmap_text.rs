//! Fuzzes the target `colmap_text` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("colmap_text");
