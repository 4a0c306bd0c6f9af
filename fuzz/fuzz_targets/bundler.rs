//! Fuzzes the target `bundler` of `covis::fuzzing`.
#![no_main]

covis_fuzz::fuzz!("bundler");
