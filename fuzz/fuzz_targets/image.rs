//! Fuzzes the target `image` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("image");
